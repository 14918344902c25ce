"""The judgements of `soter monitor` as findings.

Purpose: one for each module, where it is declared: an alarm, or a read outside `safe`, is wrong;
where nothing was judged, or a log leaves it undecided, it is open.
Non-goals: the warning of a module that is undecided (D017).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.cli.ci.findings import CiFinding
from soter.cli.terminal.log_judgement import (
    NOTHING,
    lost_of,
    of_the_log,
    unheard,
    verdict_of,
)

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
        how = f"judged on {j.source}{of_the_log(j.judged_share)}"
        text = f"{j.module}: the model explains each of {j.steps:,} steps, {how}"
        if j.alarms:
            text = (
                f"{j.module}: the model is false: alarms in {j.alarms:,} of {j.steps:,} steps, "
                f"the first at {j.first_alarm_s:.3f} s, {how}"
            )
        elif not j.judged:
            text = f"{j.module}: {NOTHING}"
        details = (*(f"{state}: {n:,} alarms" for state, n in j.alarm_states.items()), *j.notes)
        kind: Kind = "fail" if j.alarms else "pass" if j.judged else "open"
        findings.append(CiFinding(kind, RULE, j.module, text, j.span, details))
    return tuple(findings)


def of_log(judged: LogJudgement) -> tuple[CiFinding, ...]:
    """Whether a read of each module lay outside `safe`; what is assumed stands with it."""
    findings = []
    for m in judged.modules:
        if not m.decided:
            missing = tuple(f"missing: {name}" for name in m.missing)
            told = f"{m.module}: {verdict_of(m)}"
            findings.append(CiFinding("open", RULE, m.module, told, m.span, missing))
            continue
        text = f"{m.module}: {verdict_of(m)}"
        lost = (t.strip() for t in lost_of(judged))
        details = (*unheard(m), *lost, *(f"assumed: {a}" for a in judged.assumptions))
        kind: Kind = "fail" if m.violated else "pass" if m.judged else "open"
        findings.append(CiFinding(kind, RULE, m.module, text, m.span, details))
    return tuple(findings)
