"""A dialect of MAVLink as data: its messages out of XML, checked, and written anew.

Purpose: pymavlink evaluates values that stand in a dialect, and writes C with its words. What it
is given here is one document of our own: messages and fields whose names are names, whose numbers
are numbers and whose words cannot end a comment; nothing of enums.
Non-goals: what the messages mean (`mavlink_types.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET
from xml.parsers import expat

from soter.language.load.bounded_read import MIB, beside, read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FILE_MAX, FILES_MAX, DEPTH_MAX = 4 * MIB, 50, 20
IDS_END = 2**24
MESSAGE = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}", re.ASCII)
FIELD = {
    "name": MESSAGE,
    "type": re.compile(r"[a-z0-9_]{1,40}(\[\d{1,3}\])?", re.ASCII),
    "units": re.compile(r"([\w%^/. -]|\*(?!/))*", re.ASCII),
    "multiplier": re.compile(r"[\w/.+-]*", re.ASCII),
    "invalid": re.compile(r"[\w.,:+\[\] -]*", re.ASCII),
}
"""What is taken of a field; everything else that a file says of it is left out."""
NOT_IN_COMMENTS = re.compile(r"[^\w .,;:()+=<>%'\"/&|!-]+")
"""What a comment of C or the templates of the generator could read as theirs: `*`, `$`, `?`."""


def dialect_xml(path: Path) -> bytes:
    """All messages of a dialect and of what it includes, the innermost first, as one document.

    An included file lies in the folder of the one that names it. ValueError where a file is no
    dialect, OSError where it cannot be read.
    """
    made = ET.Element("mavlink")
    ids: set[int] = set()
    names: set[str] = set()
    for root in _files(path):
        ET.SubElement(made, "version").text = _number(root.findtext("version") or "2", 255)
        messages = ET.SubElement(made, "messages")
        for m in root.findall("messages/message"):
            messages.append(one := _message(m))
            number, name = int(one.attrib["id"]), one.attrib["name"].upper()
            if number in ids or name in names:
                raise ValueError(f"two messages are called {name} or have the id {number}")
            ids.add(number)
            names.add(name)
    document: bytes = ET.tostring(made, encoding="utf-8")
    return document


def comment_text(text: str) -> str:
    """Words as they may stand in a comment of C."""
    return NOT_IN_COMMENTS.sub(" ", " ".join(text.split()))


def _files(path: Path) -> Iterator[ET.Element]:
    """The documents, the innermost first, each once."""
    seen: set[Path] = set()

    def read(at: Path, depth: int) -> Iterator[ET.Element]:
        seen.add(at.resolve())
        if len(seen) > FILES_MAX or depth > DEPTH_MAX:
            raise ValueError(f"it includes more than {FILES_MAX} files, or deeper than {DEPTH_MAX}")
        root = _tree(read_bytes(at, FILE_MAX))
        for include in root.findall("include"):
            name = (include.text or "").strip()
            inner = beside(at, name)
            if inner is None or "/" in name or "\\" in name:
                raise ValueError(f"it includes `{name[:60]}`, which is no file beside it")
            if inner.resolve() not in seen:
                yield from read(inner, depth + 1)
        yield root

    yield from read(path, 0)


def _tree(raw: bytes) -> ET.Element:
    """The root; a document type, and with it entities of its own, is refused."""
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    parser.StartDoctypeDeclHandler = _refuse
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(raw, True)
    except (expat.ExpatError, LookupError) as error:  # it knows few encodings
        raise ValueError(str(error)) from error
    root: ET.Element = builder.close()
    if root.tag != "mavlink":
        raise ValueError("its root is no `mavlink`")
    return root


def _refuse(*_of_it: object) -> None:
    raise ValueError("it has a document type (`<!DOCTYPE`), which no dialect needs")


def _message(m: ET.Element) -> ET.Element:
    """A message with what pymavlink reads of one."""
    name = m.get("name", "")
    if not MESSAGE.fullmatch(name):
        raise ValueError(f"the message {name[:60]!r} has a name that is none in C")
    made = ET.Element("message", {"name": name, "id": _number(m.get("id", ""), IDS_END)})
    fields: set[str] = set()
    for part in m:
        if part.tag == "field":
            made.append(field := _field(part, name))
            if field.attrib["name"] in fields:
                raise ValueError(f"{name} has two fields `{field.attrib['name']}`")
            fields.add(field.attrib["name"])
        elif part.tag == "description":
            ET.SubElement(made, part.tag).text = comment_text("".join(part.itertext()))
        elif part.tag in ("extensions", "wip"):
            ET.SubElement(made, part.tag)
    return made


def _field(f: ET.Element, message: str) -> ET.Element:
    for key, form in FIELD.items():
        if not form.fullmatch(said := f.get(key, "")):
            raise ValueError(f"a field of {message} has the {key} {said[:60]!r}")
    made = ET.Element("field", {key: f.attrib[key] for key in FIELD if f.get(key)})
    made.text = comment_text("".join(f.itertext()))
    return made


def _number(text: str, end: int) -> str:
    """A whole number from 0 to below `end`, as decimal digits."""
    said = text.strip()
    if not (said.isascii() and said.isdigit() and len(said) < 10 and int(said) < end):
        raise ValueError(f"{said[:60]!r} is no number from 0 to {end - 1}")
    return str(int(said))
