"""A report of tests in the XML that continuous integration reads (JUnit's).

Purpose: one `testsuite` a program, one `testcase` a test: violated is a failure, a bound that was
reached is an error (nothing is wrong that is known, nothing is shown either), what was not started
is skipped.
Non-goals: traces in full; the file of a trace is named.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from soter.explore.results import BOUND, VIOLATED
from soter.report.html import write_text

if TYPE_CHECKING:
    from pathlib import Path

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
    counted = {k: str(v) for k, v in figures.items()} | {"time": f"{seconds:.3f}"}
    suites = ET.Element("testsuites", {"name": "soter test", **counted})
    suite = ET.SubElement(suites, "testsuite", {"name": report.path, **counted})
    for test in report.tests:
        _case(suite, report, test)
    for name in report.not_started:
        case = ET.SubElement(suite, "testcase", {"classname": report.path, "name": name})
        ET.SubElement(case, "skipped", {"message": "not started: one before was interrupted"})
    ET.indent(suites)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def write(report: ExploreReport, path: str | Path) -> Path:
    """Write it; `ReportError` where that cannot be."""
    return write_text(document(report), path)


def _case(suite: ET.Element, report: ExploreReport, test: TestResult) -> None:
    named = {
        "classname": report.path,
        "name": test.name,
        "file": report.path,
        "time": f"{test.seconds + test.minimise_s:.3f}",
    }
    case = ET.SubElement(suite, "testcase", named)
    if test.verdict == VIOLATED:
        what = test.broken.text if test.broken is not None else ""
        failure = ET.SubElement(case, "failure", {"type": VIOLATED, "message": what})
        failure.text = "" if test.trace is None else f"soter replay {test.trace}"
    elif test.verdict == BOUND:
        assert test.bound is not None
        told = {"type": test.bound, "message": "; ".join(filter(None, (test.why, test.covered)))}
        ET.SubElement(case, "error", told).text = "; ".join(
            f"{name} {part.reached}/{part.total}" for name, part in test.coverage.parts()
        )
    ET.SubElement(case, "system-out").text = "\n".join(("rests on", *test.assumptions))
