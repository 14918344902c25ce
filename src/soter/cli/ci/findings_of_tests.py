"""The verdicts of `soter test` as findings.

Purpose: one for each test, at its `test` block; a test that was not started is open.
Non-goals: traces: their file is named.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.cli.ci.findings import CiFinding, Kind

if TYPE_CHECKING:
    from soter.explore.results import ExploreReport

KINDS: dict[str, Kind] = {"exhausted": "pass", "violated": "fail", "bound": "open"}
RULE = "test"


def of_tests(report: ExploreReport) -> tuple[CiFinding, ...]:
    """A finding a test."""
    findings = []
    for t in report.tests:
        text = f"{t.name}: every execution was covered, none violates a property"
        details: tuple[str, ...] = ()
        if t.broken is not None:
            text = f"{t.name}: violated: {t.broken.text}"
            details = () if t.trace is None else (f"soter replay {t.trace}",)
        elif t.verdict == "bound":
            text = f"{t.name}: no violation was found, and not everything was covered: {t.why}"
        span = None if t.system.test is None else t.system.test.span
        findings.append(CiFinding(KINDS[t.verdict], RULE, t.name, text, span, details, t.seconds))
    findings += [
        CiFinding("open", RULE, name, f"{name}: not started") for name in report.not_started
    ]
    return tuple(findings)
