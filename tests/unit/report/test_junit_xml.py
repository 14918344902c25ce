"""JUnit documents: whatever a file, a test or a message is called, XML readers can read them."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from soter.cli.terminal.ci_formats import add_case, add_text, xml_document

NO_XML = ["a\x00b", "\x1b[31mred", "\ud800", "\ufffe"]
XML = ["", "<&>\"'", "é𝄞", "]]>", "a\tb\nc"]


@pytest.mark.parametrize("text", [*XML, *NO_XML], ids=repr)
def test_a_document_is_xml_whatever_stands_in_it(text: str) -> None:
    root = ET.Element("testsuites")
    suite = ET.SubElement(root, "testsuite")
    add_text(add_case(suite, text, text, 0.5), "failure", text, type="X", message=text)
    read = ET.fromstring(xml_document(root).encode("utf-8"))  # noqa: S314 - our own
    (one,) = read[0]
    told = [one.get("name"), one.get("file"), one[0].get("message"), one[0].text or ""]
    if text in XML:
        assert told == [text] * 4
    else:
        assert all("\ufffd" in (t or "") for t in told)
    assert one.get("time") == "0.500"
