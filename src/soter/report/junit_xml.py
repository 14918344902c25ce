"""What every JUnit document of Soter is made with (`soter test`, `check`, `verify`).

Purpose: text that any XML may hold, a case by its name, the document as text.
Non-goals: what counts as a failure: that is for whoever reports.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML 1.0 may have, not even escaped."""


def clean(text: str) -> str:
    """The text, with a replacement character for each that no XML may have."""
    return NO_XML.sub("\ufffd", text)


def case(suite: ET.Element, file: str, name: str, seconds: float = 0.0) -> ET.Element:
    """A new `testcase` of a suite, named by the file that it is about."""
    where = clean(file)
    named = {"classname": where, "name": clean(name), "file": where, "time": f"{seconds:.3f}"}
    return ET.SubElement(suite, "testcase", named)


def said(case_: ET.Element, kind: str, text: str, **attributes: str) -> None:
    """Put `failure`, `error`, `skipped` or `system-out` into a case or a suite."""
    told = {k: clean(v) for k, v in attributes.items()}
    ET.SubElement(case_, kind, told).text = clean(text) or None


def document(root: ET.Element) -> str:
    """The XML, indented, with its declaration and a last line break."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
