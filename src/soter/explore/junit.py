"""A report of tests in the XML that continuous integration reads (JUnit's).

Purpose: one `testsuite` a program, one `testcase` a test: violated is a failure, a bound that was
reached is an error (nothing is wrong that is known, nothing is shown either), what was not started
is skipped. Where there is no report, every diagnostic is a `testcase` with an error.
Non-goals: traces in full; the file of a trace is named.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from soter.diagnostics.diagnostic import Severity
from soter.explore.results import BOUND, VIOLATED
from soter.report.html import write_text
from soter.report.junit_xml import case, clean, said
from soter.report.junit_xml import document as text_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.explore.results import ExploreReport, TestResult


def document(report: ExploreReport) -> str:
    """The XML of a report, as text."""
    of = {v: [t for t in report.tests if t.verdict == v] for v in (VIOLATED, BOUND)}
    seconds = sum(t.seconds + t.minimise_s for t in report.tests)
    figures = {
        "tests": len(report.tests) + len(report.not_started),
        "failures": len(of[VIOLATED]),
        "errors": len(of[BOUND]),
        "skipped": len(report.not_started),
    }
    suites, suite = _suite(report.path, figures, seconds)
    for test in report.tests:
        _case(suite, report, test)
    for name in report.not_started:
        one = case(suite, report.path, name)
        said(one, "skipped", "", message="not started: one before was interrupted")
    return text_of(suites)


def document_of_problems(file: str, problems: Iterable[Diagnostic]) -> str:
    """The XML where no test was explored: an error for every diagnostic that is one."""
    errors = [d for d in problems if d.severity is Severity.ERROR]
    count = len(errors)
    figures = {"tests": count, "failures": 0, "errors": count, "skipped": 0}
    suites, suite = _suite(file, figures, 0.0)
    for d in errors:
        where = "" if d.primary is None else d.primary.span.source.name
        if d.primary is not None:
            where += f":{d.primary.span.line}:{d.primary.span.column}"
        text = "\n".join(filter(None, (where, *d.notes, *d.helps)))
        said(case(suite, file, d.code), "error", text, type=d.code, message=d.message)
    return text_of(suites)


def _suite(file: str, figures: dict[str, int], seconds: float) -> tuple[ET.Element, ET.Element]:
    """The root and its one suite."""
    counted = {k: str(v) for k, v in figures.items()} | {"time": f"{seconds:.3f}"}
    suites = ET.Element("testsuites", {"name": "soter test", **counted})
    return suites, ET.SubElement(suites, "testsuite", {"name": clean(file), **counted})


def write_problems(file: str, problems: Iterable[Diagnostic], path: str | Path) -> Path:
    """Write why no test was explored; `ReportError` where that cannot be."""
    return write_text(document_of_problems(file, problems), path)


def write(report: ExploreReport, path: str | Path) -> Path:
    """Write it; `ReportError` where that cannot be."""
    return write_text(document(report), path)


def _case(suite: ET.Element, report: ExploreReport, test: TestResult) -> None:
    one = case(suite, report.path, test.name, test.seconds + test.minimise_s)
    if test.verdict == VIOLATED:
        what = test.broken.text if test.broken is not None else ""
        trace = "" if test.trace is None else f"soter replay {test.trace}"
        said(one, "failure", trace, type=VIOLATED, message=what)
    elif test.verdict == BOUND:
        assert test.bound is not None
        parts = "; ".join(f"{name} {p.reached}/{p.total}" for name, p in test.coverage.parts())
        why = "; ".join(filter(None, (test.why, test.covered)))
        said(one, "error", parts, type=test.bound, message=why)
    said(one, "system-out", "\n".join(("rests on", *test.assumptions)))
