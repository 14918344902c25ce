"""JUnit's XML of `check`, `verify` and `monitor`; `soter test` has its own (`explore/junit.py`).

Purpose: one `testsuite` a file, one `testcase` a finding: what is wrong is a failure, what is open
an error, warnings stand in `system-out`; a file in which nothing was found is a case that passes.
Non-goals: attributes that only some readers know.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from soter.cli.ci.findings import place
from soter.report.junit_xml import case, clean, document, said

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.ci.findings import CiFinding


def junit(command: str, files: Sequence[str], findings: Sequence[CiFinding]) -> str:
    """The document, as text. Findings in no file count for the first one."""
    by_file: dict[str, list[CiFinding]] = {name: [] for name in files or ("soter",)}
    first = next(iter(by_file))
    for f in findings:
        at = place(f.span)
        own = first if f.span is None else f.span.source.name if at is None else at[0]
        by_file.setdefault(own, []).append(f)
    root = ET.Element("testsuites", {"name": f"soter {command}", **_counts(findings, by_file)})
    for name, mine in by_file.items():
        one = {name: mine}
        suite = ET.SubElement(root, "testsuite", {"name": clean(name), **_counts(mine, one)})
        cases = [f for f in mine if f.kind != "warning"]
        for f in cases:
            _case(suite, name, f)
        if not cases:
            case(suite, name, command)
        warnings = [_text(f) for f in mine if f.kind == "warning"]
        if warnings:
            said(suite, "system-out", "\n\n".join(warnings))
    return document(root)


def _counts(findings: Sequence[CiFinding], files: dict[str, list[CiFinding]]) -> dict[str, str]:
    cases = [f for f in findings if f.kind != "warning"]
    empty = sum(all(f.kind == "warning" for f in mine) for mine in files.values())
    return {
        "tests": str(len(cases) + empty),
        "failures": str(sum(f.kind == "fail" for f in cases)),
        "errors": str(sum(f.kind == "open" for f in cases)),
        "skipped": "0",
        "time": f"{sum(f.seconds for f in findings):.3f}",
    }


def _case(suite: ET.Element, file: str, f: CiFinding) -> None:
    one = case(suite, file, f.name, f.seconds)
    if f.kind == "pass":
        said(one, "system-out", "\n".join((f.text, *f.details)))
        return
    kind = "failure" if f.kind == "fail" else "error"
    said(one, kind, _text(f), type=f.rule, message=f.text)


def _text(f: CiFinding) -> str:
    at = place(f.span)
    where = "" if at is None else f"{at[0]}:{at[1]}:{at[2]}: "
    return "\n".join((f"{where}{f.rule}: {f.text}", *f.details))
