"""Writes findings for continuous integration: SARIF, JUnit's XML, commands of GitHub Actions.

Purpose: `sarif_text`: one run with a result for each finding that is wrong or open, and a rule for
every code with its page of `soter explain`; a proved or clean one is no result, as viewers show
each as an alert. `junit_text`: one `testsuite` a file, one `testcase` a finding: a wrong one is a
failure, an open one an error, warnings stand in `system-out`; a file without findings is a case
that passes. `junit_of_tests`: the same for `soter test`: a violated test is a failure, a bound that
was reached an error, a test that was not started is skipped. `github_commands`: a line `::error
file=...,line=...::message` for each finding that is wrong or open.
Non-goals: other versions; fixes; attributes that only some readers know; traces, whose files are
named.
Source: OASIS Standard "Static Analysis Results Interchange Format (SARIF) Version 2.1.0"; GitHub's
documentation, "Workflow commands for GitHub Actions".
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote
from xml.etree import ElementTree as ET

from soter.cli.terminal.ci_findings import CiFinding, diagnostic_findings, place_in_file
from soter.diagnostics.codes import explain, title
from soter.diagnostics.diagnostic import Diagnostic, Severity
from soter.diagnostics.legible_text import legible
from soter.explore.results import BOUND, VIOLATED, ExploreReport, TestResult
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.cli.terminal.command_outcome import CommandOutcome


NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML 1.0 may have, not even escaped."""


def xml_text(text: str) -> str:
    """The text, with a replacement for each character that XML does not allow."""
    return NO_XML.sub("\ufffd", text)


def add_case(suite: ET.Element, file: str, name: str, seconds: float = 0.0) -> ET.Element:
    """Adds a `testcase` to a suite, with the file that it is about as class name."""
    where = xml_text(file)
    named = {"classname": where, "name": xml_text(name), "file": where, "time": f"{seconds:.3f}"}
    return ET.SubElement(suite, "testcase", named)


def add_text(case_: ET.Element, kind: str, text: str, **attributes: str) -> None:
    """Adds `failure`, `error`, `skipped` or `system-out` with a text to a case or a suite."""
    cleaned = {k: xml_text(v) for k, v in attributes.items()}
    ET.SubElement(case_, kind, cleaned).text = xml_text(text) or None


def xml_document(root: ET.Element) -> str:
    """The XML, indented, with its declaration and a last line break."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)
LEVELS = {"fail": "error", "open": "error", "warning": "warning"}
"""Kind of a finding -> how SARIF and GitHub call it."""


def formatted_outcome(format_: str, command: str, outcome: CommandOutcome) -> str:
    """The outcome in one of the formats, as text; "" for `github` if there is nothing to report."""
    findings = [
        replace(f, text=legible(f.text), details=tuple(map(legible, f.details)))
        for f in (*diagnostic_findings(outcome.diagnostics), *outcome.found)
    ]
    if format_ == "sarif":
        return sarif_text(command, findings, outcome.exit)
    if format_ == "github":
        return github_commands(findings)
    return outcome.junit or junit_text(command, outcome.files, findings)


def sarif_text(command: str, findings: Sequence[CiFinding], exit_code: int) -> str:
    """The SARIF document, as text."""
    shown = [f for f in findings if f.kind != "pass"]
    rules = sorted({f.rule for f in shown})
    run = {
        "tool": {
            "driver": {
                "name": "soter",
                "version": VERSION,
                "rules": [_sarif_rule(r) for r in rules],
            }
        },
        "columnKind": "unicodeCodePoints",
        "automationDetails": {"id": f"soter/{command}/"},
        "invocations": [{"executionSuccessful": exit_code in (0, 1, 3, 4), "exitCode": exit_code}],
        "results": [_sarif_result(f, rules.index(f.rule)) for f in shown],
    }
    log = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2, allow_nan=False)


def _sarif_rule(code: str) -> dict[str, Any]:
    rule: dict[str, Any] = {"id": code}
    if (page := explain(code)) is not None:
        rule["shortDescription"] = {"text": title(code) or code}
        rule["help"] = {"text": page, "markdown": page}
    return rule


def _sarif_result(finding: CiFinding, rule: int) -> dict[str, Any]:
    result: dict[str, Any] = {
        "ruleId": finding.rule,
        "ruleIndex": rule,
        "level": LEVELS[finding.kind],
        "message": {"text": "\n".join((finding.text, *finding.details))},
    }
    if (at := place_in_file(finding.span)) is not None:
        name, line, column, end_line, end_column = at
        region = {
            "startLine": line,
            "startColumn": column,
            "endLine": end_line,
            "endColumn": end_column,
        }
        physical = {"artifactLocation": {"uri": _file_uri(name)}, "region": region}
        result["locations"] = [{"physicalLocation": physical}]
    return result


def _file_uri(name: str) -> str:
    path = Path(name)
    return path.as_uri() if path.is_absolute() else quote(path.as_posix())


def junit_text(command: str, files: Sequence[str], findings: Sequence[CiFinding]) -> str:
    """The findings as JUnit XML; findings without a file count for the first file."""
    by_file: dict[str, list[CiFinding]] = {name: [] for name in files or ("soter",)}
    first = next(iter(by_file))
    for f in findings:
        at = place_in_file(f.span)
        file = first if f.span is None else f.span.source.name if at is None else at[0]
        by_file.setdefault(file, []).append(f)
    root = ET.Element(
        "testsuites", {"name": f"soter {command}", **_suite_counts(findings, by_file)}
    )
    for name, mine in by_file.items():
        one = {name: mine}
        suite = ET.SubElement(
            root, "testsuite", {"name": xml_text(name), **_suite_counts(mine, one)}
        )
        cases = [f for f in mine if f.kind != "warning"]
        for f in cases:
            _add_finding(suite, name, f)
        if not cases:
            add_case(suite, name, command)
        if warnings := [_finding_text(f) for f in mine if f.kind == "warning"]:
            add_text(suite, "system-out", "\n\n".join(warnings))
    return xml_document(root)


def _suite_counts(
    findings: Sequence[CiFinding], files: dict[str, list[CiFinding]]
) -> dict[str, str]:
    cases = [f for f in findings if f.kind != "warning"]
    empty = sum(all(f.kind == "warning" for f in mine) for mine in files.values())
    return {
        "tests": str(len(cases) + empty),
        "failures": str(sum(f.kind == "fail" for f in cases)),
        "errors": str(sum(f.kind == "open" for f in cases)),
        "skipped": "0",
        "time": f"{sum(f.seconds for f in findings):.3f}",
    }


def _add_finding(suite: ET.Element, file: str, f: CiFinding) -> None:
    one = add_case(suite, file, f.name, f.seconds)
    if f.kind == "pass":
        add_text(one, "system-out", "\n".join((f.text, *f.details)))
        return
    word = "failure" if f.kind == "fail" else "error"
    add_text(one, word, _finding_text(f), type=f.rule, message=f.text)


def _finding_text(f: CiFinding) -> str:
    at = place_in_file(f.span)
    where = "" if at is None else f"{at[0]}:{at[1]}:{at[2]}: "
    return "\n".join((f"{where}{f.rule}: {f.text}", *f.details))


def github_commands(findings: Sequence[CiFinding]) -> str:
    """The commands for GitHub Actions, one a line; "" if there is nothing to report."""
    return "\n".join(_github_command(f) for f in findings if f.kind != "pass")


def _github_command(finding: CiFinding) -> str:
    properties = {"title": f"soter: {finding.rule}"}
    if (at := place_in_file(finding.span)) is not None:
        name, line, column, end_line, end_column = at
        properties |= {"file": name, "line": str(line), "endLine": str(end_line)}
        if line == end_line:  # else GitHub refuses columns
            properties |= {"col": str(column), "endColumn": str(end_column)}
    text_of_properties = ",".join(
        f"{key}={_escaped_property(value)}" for key, value in properties.items()
    )
    text = "\n".join((finding.text, *finding.details))
    return f"::{LEVELS[finding.kind]} {text_of_properties}::{_escaped_message(text)}"


def _escaped_message(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _escaped_property(text: str) -> str:
    return _escaped_message(text).replace(":", "%3A").replace(",", "%2C")


def junit_of_tests(report: ExploreReport) -> str:
    """JUnit's XML of the tests of a report, as text."""
    of = {v: [t for t in report.tests if t.verdict == v] for v in (VIOLATED, BOUND)}
    seconds = sum(t.seconds + t.minimise_s for t in report.tests)
    figures = {
        "tests": len(report.tests) + len(report.not_started),
        "failures": len(of[VIOLATED]),
        "errors": len(of[BOUND]),
        "skipped": len(report.not_started),
    }
    suites, suite = _new_suite(report.path, figures, seconds)
    for test in report.tests:
        _add_test(suite, report, test)
    for name in report.not_started:
        one = add_case(suite, report.path, name)
        add_text(one, "skipped", "", message="not started: one before was interrupted")
    return xml_document(suites)


def junit_of_problems(file: str, problems: Iterable[Diagnostic]) -> str:
    """JUnit XML for a file whose tests were not explored: an `error` for each error."""
    errors = [d for d in problems if d.severity is Severity.ERROR]
    count = len(errors)
    figures = {"tests": count, "failures": 0, "errors": count, "skipped": 0}
    suites, suite = _new_suite(file, figures, 0.0)
    for d in errors:
        where = "" if d.primary is None else d.primary.span.source.name
        if d.primary is not None:
            where += f":{d.primary.span.line}:{d.primary.span.column}"
        text = "\n".join(filter(None, (where, *d.notes, *d.helps)))
        add_text(add_case(suite, file, d.code), "error", text, type=d.code, message=d.message)
    return xml_document(suites)


def _new_suite(file: str, figures: dict[str, int], seconds: float) -> tuple[ET.Element, ET.Element]:
    """A new root element, and the only suite inside the root."""
    counted = {k: str(v) for k, v in figures.items()} | {"time": f"{seconds:.3f}"}
    suites = ET.Element("testsuites", {"name": "soter test", **counted})
    return suites, ET.SubElement(suites, "testsuite", {"name": xml_text(file), **counted})


def _add_test(suite: ET.Element, report: ExploreReport, test: TestResult) -> None:
    one = add_case(suite, report.path, test.name, test.seconds + test.minimise_s)
    if test.verdict == VIOLATED:
        broken = test.broken.text if test.broken is not None else ""
        trace = "" if test.trace is None else f"soter replay {test.trace}"
        add_text(one, "failure", trace, type=VIOLATED, message=broken)
    elif test.verdict == BOUND:
        assert test.bound is not None
        parts = "; ".join(
            f"{name} {p.reached}/{p.total}" for name, p in test.coverage.kinds_by_name()
        )
        why = "; ".join(filter(None, (test.why, test.covered_text)))
        add_text(one, "error", parts, type=test.bound, message=why)
    add_text(one, "system-out", "\n".join(("rests on", *test.assumptions)))
