"""The judgements of `soter monitor` as findings.

Purpose: one for each module, where it is declared: an alarm, or a read outside `safe`, is wrong.
Non-goals: a module that a log leaves undecided: that is a diagnostic (D017).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.cli.ci.findings import CiFinding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.ci.findings import Kind
    from soter.monitor.logs.result import LogJudgement
    from soter.monitor.model_membership import Judgement

RULE = "monitor"


def of_judgements(judged: Sequence[Judgement]) -> tuple[CiFinding, ...]:
    """Whether the plant of the proof explains each step."""
    findings = []
    for j in judged:
        text = f"{j.module}: the model explains each of {j.steps:,} steps, judged on {j.source}"
        if j.alarms:
            text = (
                f"{j.module}: the model is false: alarms in {j.alarms:,} of {j.steps:,} steps, "
                f"the first at {j.first_alarm_s:.3f} s, judged on {j.source}"
            )
        details = tuple(f"{state}: {n:,} alarms" for state, n in j.alarm_states.items())
        kind: Kind = "fail" if j.alarms else "pass"
        findings.append(CiFinding(kind, RULE, j.module, text, j.span, details))
    return tuple(findings)


def of_log(judged: LogJudgement) -> tuple[CiFinding, ...]:
    """Whether a read of each decided module lay outside `safe`; what is assumed stands with it."""
    findings = []
    for m in judged.modules:
        if not m.decided:
            continue
        text = f"{m.module}: none of {m.fresh:,} reads lay outside `safe`"
        if m.blind:
            text = f"{m.module}: `safe` is not judged; it reads {', '.join(m.blind)}"
        if m.outside:
            text = (
                f"{m.module}: {m.outside:,} of {m.fresh:,} reads lay outside `safe`, "
                f"the first at {m.first_outside_s:.3f} s"
            )
        details = tuple(f"assumed: {a}" for a in judged.assumptions)
        kind: Kind = "fail" if m.outside else "pass"
        findings.append(CiFinding(kind, RULE, m.module, text, m.span, details))
    return tuple(findings)
