"""JUnit's XML of `check` and `verify`; `soter test` has its own (`explore/junit.py`).

Purpose: one `testsuite` a file, one `testcase` a finding: what is wrong is a failure, what is open
an error, warnings stand in `system-out`; a file in which nothing was found is a case that passes.
Non-goals: attributes that only some readers know.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from soter.cli.ci.found import place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.ci.found import Found

NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML 1.0 may have, not even escaped."""


def junit(command: str, files: Sequence[str], found: Sequence[Found]) -> str:
    """The document, as text. Findings in no file count for the first one."""
    by_file: dict[str, list[Found]] = {name: [] for name in files or ("soter",)}
    first = next(iter(by_file))
    for f in found:
        at = place(f.span)
        own = first if f.span is None else f.span.source.name if at is None else at[0]
        by_file.setdefault(own, []).append(f)
    root = ET.Element("testsuites", {"name": f"soter {command}", **_counts(found, by_file)})
    for name, mine in by_file.items():
        one = {name: mine}
        suite = ET.SubElement(root, "testsuite", {"name": name, **_counts(mine, one)})
        cases = [f for f in mine if f.kind != "warning"]
        for f in cases:
            _case(suite, name, f)
        if not cases:
            ET.SubElement(suite, "testcase", _named(command, name, 0.0))
        warnings = [_text(f) for f in mine if f.kind == "warning"]
        if warnings:
            ET.SubElement(suite, "system-out").text = _clean("\n\n".join(warnings))
    ET.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ET.tostring(root, encoding="unicode")}'


def _counts(found: Sequence[Found], files: dict[str, list[Found]]) -> dict[str, str]:
    cases = [f for f in found if f.kind != "warning"]
    empty = sum(all(f.kind == "warning" for f in mine) for mine in files.values())
    return {
        "tests": str(len(cases) + empty),
        "failures": str(sum(f.kind == "fail" for f in cases)),
        "errors": str(sum(f.kind == "open" for f in cases)),
        "skipped": "0",
        "time": f"{sum(f.seconds for f in found):.3f}",
    }


def _named(name: str, file: str, seconds: float) -> dict[str, str]:
    return {"classname": file, "name": name, "file": file, "time": f"{seconds:.3f}"}


def _case(suite: ET.Element, file: str, f: Found) -> None:
    case = ET.SubElement(suite, "testcase", _named(_clean(f.name), file, f.seconds))
    if f.kind == "pass":
        ET.SubElement(case, "system-out").text = _clean(f.text)
        return
    kind = "failure" if f.kind == "fail" else "error"
    told = {"type": f.rule, "message": _clean(f.text)}
    ET.SubElement(case, kind, told).text = _clean(_text(f))


def _text(f: Found) -> str:
    at = place(f.span)
    where = "" if at is None else f"{at[0]}:{at[1]}:{at[2]}: "
    return "\n".join((f"{where}{f.rule}: {f.text}", *f.details))


def _clean(text: str) -> str:
    return NO_XML.sub("\ufffd", text)
