"""MAVLink in a mapping: the messages of a dialect, and the table `[mavlink]`.

Purpose: `read_dialect` reads a dialect of the package `pymavlink`, or of a user's file, as types
like those of ROS, with two more facts of MAVLink: units, and the number that means "not known".
`read_link` reads the addresses of messages, their senders, their delay, and what the autopilot does
when they stop. `dialect_xml` makes one safe document of a dialect, because pymavlink evaluates
values in it and copies its words into C. There all names are names of C, all numbers are numbers,
no text can end a comment, and enums are left out.
Non-goals: which topic is which message (`topic_mapping_parser.py`); C
(`targets/mavlink_package.py`); speaking MAVLink (`runtime/mavlink/`).
"""

from __future__ import annotations

import io
import re
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET
from xml.parsers import expat

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import closest
from soter.language.load.named_files import MIB, path_beside, read_bytes
from soter.mapping.mapping_errors import unknown_name_message
from soter.mapping.message_types import ARRAY, BASE, MessageType, StampSource, UnknownMessageError
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from soter.mapping.mapping_errors import MappingProblems


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
"""Attribute of a field that is taken over -> the form it must have; all others are left out."""
NOT_IN_COMMENTS = re.compile(r"[^\w .,;:()+=<>%'\"/&|!-]+")
"""Letters that mean something in a comment of C or in a template: `*`, `$`, `?` and others."""


def dialect_xml(path: Path) -> bytes:
    """Gives all messages of a dialect and of its includes as XML, innermost include first.

    An included file lies in the folder of the including file. Raises ValueError if a file is no
    dialect, OSError if it cannot be read.
    """
    document_root = ET.Element("mavlink")
    ids: set[int] = set()
    names: set[str] = set()
    for root in _documents(path):
        ET.SubElement(document_root, "version").text = _checked_number(
            root.findtext("version") or "2", 255
        )
        messages = ET.SubElement(document_root, "messages")
        for message in root.findall("messages/message"):
            messages.append(element := _message_element(message))
            number, name = int(element.attrib["id"]), element.attrib["name"].upper()
            if number in ids or name in names:
                raise ValueError(f"two messages are called {name} or have the id {number}")
            ids.add(number)
            names.add(name)
    document: bytes = ET.tostring(document_root, encoding="utf-8")
    return document


def comment_text(text: str) -> str:
    """Gives a text without the letters that could end a comment of C."""
    return NOT_IN_COMMENTS.sub(" ", " ".join(text.split()))


def _documents(path: Path) -> Iterator[ET.Element]:
    """Yields the documents of a dialect and of its includes, innermost first, each once."""
    seen: set[Path] = set()

    def read(at: Path, depth: int) -> Iterator[ET.Element]:
        seen.add(at.resolve())
        if len(seen) > FILES_MAX or depth > DEPTH_MAX:
            raise ValueError(f"it includes more than {FILES_MAX} files, or deeper than {DEPTH_MAX}")
        root = _parse_root(read_bytes(at, FILE_MAX))
        for include in root.findall("include"):
            name = (include.text or "").strip()
            inner = path_beside(at, name)
            if inner is None or "/" in name or "\\" in name:
                raise ValueError(f"it includes `{name[:60]}`, which is no file beside it")
            if inner.resolve() not in seen:
                yield from read(inner, depth + 1)
        yield root

    yield from read(path, 0)


def _parse_root(raw: bytes) -> ET.Element:
    """Gives the root of a document; raises ValueError if it has a document type (so entities)."""
    builder, parser = ET.TreeBuilder(), expat.ParserCreate()
    parser.StartDoctypeDeclHandler = _refuse_doctype
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


def _refuse_doctype(*_of_it: object) -> None:
    raise ValueError("it has a document type (`<!DOCTYPE`), which no dialect needs")


def _message_element(message: ET.Element) -> ET.Element:
    """Gives a checked copy of a message, with only the parts that pymavlink needs."""
    name = message.get("name", "")
    if not MESSAGE.fullmatch(name):
        raise ValueError(f"the message {name[:60]!r} has a name that is none in C")
    element = ET.Element(
        "message", {"name": name, "id": _checked_number(message.get("id", ""), IDS_END)}
    )
    fields: set[str] = set()
    for part in message:
        if part.tag == "field":
            element.append(field := _field_element(part, name))
            if field.attrib["name"] in fields:
                raise ValueError(f"{name} has two fields `{field.attrib['name']}`")
            fields.add(field.attrib["name"])
        elif part.tag == "description":
            ET.SubElement(element, part.tag).text = comment_text("".join(part.itertext()))
        elif part.tag in ("extensions", "wip"):
            ET.SubElement(element, part.tag)
    return element


def _field_element(field: ET.Element, message: str) -> ET.Element:
    for key, form in FIELD.items():
        if not form.fullmatch(value := field.get(key, "")):
            raise ValueError(f"a field of {message} has the {key} {value[:60]!r}")
    element = ET.Element("field", {key: field.attrib[key] for key in FIELD if field.get(key)})
    element.text = comment_text("".join(field.itertext()))
    return element


def _checked_number(text: str, end: int) -> str:
    """Gives the decimal digits of a whole number in [0, end); raises ValueError for other texts."""
    digits = text.strip()
    if not (digits.isascii() and digits.isdigit() and len(digits) < 10 and int(digits) < end):
        raise ValueError(f"{digits[:60]!r} is no number from 0 to {end - 1}")
    return str(int(digits))


MAVLINK = 3
"""The family of definitions, beside ROS 1 and ROS 2."""
PACKAGE = "mavlink"
NAME = re.compile(r"mavlink/([A-Z][A-Z0-9_]*)", re.ASCII)
UNITS = {"m/s/s": "m/s^2", "mG": "mg", "g": "gram"}
"""Unit of MAVLink -> our name of that unit, where the two names differ."""
QUATERNION = re.compile(r"(?:\w+_)?q(?:[1-4]|uaternion)?", re.ASCII)
"""Fields whose numbers are those of an orientation: MAVLink gives them no unit."""
STAMPS = {("time_boot_ms", "uint32"): 10**6, ("time_usec", "uint64"): 10**3}
"""Fields that say when a message was measured, on the autopilot's clock, and their unit in ns."""
_KIND = {"float": "float32", "double": "float64", "char": "string"}


@dataclass(frozen=True)
class MavlinkMessage(MessageType):
    """A message type of a dialect; `invalid` maps fields to the number that means "not known".

    `extensions` are the fields that frames of MAVLink 1 do not have.
    """

    id: int = 0
    units: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    invalid: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    fields_in_order: tuple[str, ...] = ()
    extensions: frozenset[str] = frozenset()

    def unit(self, path: str) -> str | None:
        """Gives the unit that the dialect declares for a field; None without one."""
        name = path.partition(".")[0]
        return self.units.get(name, "1" if QUATERNION.fullmatch(name) else None)

    @property
    def default_stamp(self) -> StampSource | None:
        """Gives the message field that holds the time of measurement; None if there is none."""
        for (name, kind), ns in STAMPS.items():
            if name in self.fields_in_order and self.primitive_type(name) == kind:
                return StampSource(name, "number", Fraction(ns))
        return None


@dataclass(frozen=True)
class ChecksumEntry:
    """The shortest and longest length of a message, and its checksum byte `extra`, for a parser."""

    id: int
    extra: int
    shortest: int
    longest: int
    flags: int
    target_system: int
    target_component: int


@dataclass(frozen=True)
class Dialect:
    """The messages of a dialect and of its includes; `xml` is all of them as one document."""

    name: str
    xml: bytes = field(repr=False)
    messages: Mapping[str, MavlinkMessage]
    checksums: tuple[ChecksumEntry, ...]

    def message_named(self, name: str) -> MavlinkMessage:
        """Gives the message of this name; raises UnknownMessageError."""
        match = NAME.fullmatch(name)
        if match is None:
            raise UnknownMessageError("a message is written as `mavlink/LOCAL_POSITION_NED`")
        found = self.messages.get(match[1])
        if found is None:
            near = closest(match[1], sorted(self.messages), 0.8)
            hint = f"did you mean `mavlink/{near[0]}`?" if near else ""
            raise UnknownMessageError(hint or f"the dialect {self.name} has no such message")
        return found


def is_mavlink(name: object) -> bool:
    """Whether a `type` of a mapping names a message of MAVLink."""
    return isinstance(name, str) and name.startswith(f"{PACKAGE}/")


def require_mavlink_package() -> None:
    """Raises SoterError D007 if the package with MAVLink's dialects is missing."""
    if find_spec("pymavlink") is None:
        text = "messages of MAVLink are known to the package `pymavlink`, which is not installed"
        help_ = f"install it: {pip_command('robots')}"
        raise SoterError((Diagnostic("D007", text, helps=(help_,)),))


def standard_dialects() -> list[str]:
    """Gives the names of the dialects in the package `pymavlink`, sorted."""
    return sorted(p.stem for p in _dialect_folder().glob("*.xml") if p.stem not in ("all", "test"))


def dialect_path(name: str, folder: Path) -> Path:
    """Gives the file of a dialect: pymavlink's by name, or a user's `.xml` in `folder`."""
    return folder / name if name.endswith(".xml") else _dialect_folder() / f"{name}.xml"


@cache
def read_dialect(path: Path) -> Dialect:
    """Reads a dialect from a file; raises ValueError if it is no dialect, OSError if unreadable."""
    messages: dict[str, MavlinkMessage] = {}
    checksums: dict[int, ChecksumEntry] = {}
    document = dialect_xml(path)
    for parsed in _parsed_messages(document):
        messages[parsed.name] = _make_message(parsed)
        checksums[parsed.id] = ChecksumEntry(
            parsed.id,
            parsed.crc_extra,
            parsed.wire_min_length,
            parsed.wire_length,
            parsed.message_flags,
            parsed.target_system_ofs,
            parsed.target_component_ofs,
        )
    if not messages:
        raise ValueError("it has no messages")
    return Dialect(path.stem, document, messages, tuple(checksums[i] for i in sorted(checksums)))


def _dialect_folder() -> Path:
    spec = find_spec("pymavlink")
    assert spec is not None, "require_mavlink_package"
    assert spec.origin is not None
    return Path(spec.origin).parent / "dialects" / "v20"


def _parsed_messages(document: bytes) -> list[Any]:
    """Gives the messages as pymavlink parses them, the innermost file's first."""
    from pymavlink.generator import mavparse  # noqa: PLC0415 - an extra

    with tempfile.TemporaryDirectory() as place:
        at = Path(place) / "dialect.xml"
        at.write_bytes(document)
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                return list(mavparse.MAVXML(str(at), mavparse.PROTOCOL_2_0).message)
        except (Exception, SystemExit) as error:  # it may raise anything
            raise ValueError(str(error)[:120].replace("\n", " ") or "it is no dialect") from error


def _field_unit(f: Any) -> str:  # noqa: ANN401 - of a package without types
    """Gives the unit of a field, with a multiplier as in `deg*360/255`; "" if it has no unit."""
    unit = str(f.units or "").strip("[]")
    return f"{unit or '1'}*{f.multiplier}" if f.multiplier else UNITS.get(unit, unit)


def _make_message(parsed: Any) -> MavlinkMessage:  # noqa: ANN401 - of a package without types
    kinds: list[tuple[str, Any]] = []
    for part in parsed.fields:
        kind: Any = (BASE, (_KIND.get(part.type, part.type.removesuffix("_t")), 0))
        if part.type == "char":
            kind = (BASE, ("string", max(part.array_length, 1)))
        elif part.array_length:
            kind = (ARRAY, (kind, part.array_length))
        kinds.append((part.name, kind))
    units = {part.name: unit for part in parsed.fields if (unit := _field_unit(part))}
    return MavlinkMessage(
        PACKAGE,
        parsed.name,
        {MAVLINK: {f"{PACKAGE}/msg/{parsed.name}": ([], kinds)}},
        id=parsed.id,
        units=units,
        invalid={part.name: part.invalid for part in parsed.fields if part.invalid},
        fields_in_order=tuple(part.name for part in parsed.fields),
        extensions=frozenset(part.name for part in parsed.fields[parsed.base_fields() :]),
    )


KEYS = (
    *("url", "dialect", "system", "component", "own_system", "own_component"),
    *("delay", "resend", "offboard_loss"),
)
URLS = "udpin://0.0.0.0:14540, udpout://HOST:PORT or serial:///dev/NAME:BAUD"
UDP = re.compile(r"udp(in|out)://(\d{1,3}(?:\.\d{1,3}){3}|\[[0-9a-fA-F:]+\]):(\d{1,5})", re.ASCII)
SERIAL = re.compile(r"serial://(/dev/[A-Za-z0-9_./-]+):(\d{3,7})", re.ASCII)
BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 1000000, 2000000, 3000000)
LINKS_MAX = 4
AUTOPILOT, ONBOARD_COMPUTER = 1, 191
RESEND_NS, OFFBOARD_LOSS_NS = 50_000_000, 1_000_000_000
PROOF_OF_LIFE_NS = 500_000_000
"""PX4 leaves its mode OFFBOARD where set-points come less often than twice a second."""
SOURCE = re.compile(r"(\d{1,3})/(\d{1,3})", re.ASCII)


@dataclass(frozen=True)
class MavlinkLink:
    """The table `[mavlink]` of a mapping, with defaults for missing keys.

    `delay_ns` is the greatest age of a message at its arrival; None if not declared. `resend_ns`:
    the period at which an unchanged value is sent again. `offboard_loss_ns`: COM_OF_LOSS_T of PX4.
    """

    urls: tuple[str, ...]
    dialect: Dialect
    system: int = 1
    component: int = AUTOPILOT
    own_system: int = 1
    own_component: int = ONBOARD_COMPUTER
    delay_ns: int | None = None
    resend_ns: int = RESEND_NS
    offboard_loss_ns: int = OFFBOARD_LOSS_NS

    @property
    def autopilot(self) -> tuple[int, int]:
        """Gives (system, component) of the autopilot: the sender if `publisher` is not set."""
        return self.system, self.component


def read_link(table: Mapping[str, Any], folder: Path, problems: MappingProblems) -> MavlinkLink:
    """Reads the table `[mavlink]`; unusable if `problems` grow. Raises D007 without pymavlink."""
    require_mavlink_package()
    problems.note_unknown_keys(table, KEYS, "`mavlink`")
    urls = _read_urls(table.get("url"), problems)
    ids = {
        key: _read_id(table, key, default, problems)
        for key, default in (
            ("system", 1),
            ("component", AUTOPILOT),
            ("own_system", 1),
            ("own_component", ONBOARD_COMPUTER),
        )
    }
    if (ids["system"], ids["component"]) == (ids["own_system"], ids["own_component"]):
        problems.add("`mavlink`: the bridge cannot be the autopilot: `own_component` is its own")
    times = {
        key: problems.positive_ns(table, key, "mavlink") if key in table else default
        for key, default in (("resend", RESEND_NS), ("offboard_loss", OFFBOARD_LOSS_NS))
    }
    resend, loss = times["resend"], times["offboard_loss"]
    if resend >= PROOF_OF_LIFE_NS:
        problems.add("`resend` of `mavlink` is below 500ms: OFFBOARD needs more than 2 a second")
    elif 3 * resend > loss:
        problems.add(
            "`offboard_loss` of `mavlink` is shorter than three times `resend`: two lost "
            "set-points would end OFFBOARD"
        )
    delay = problems.positive_ns(table, "delay", "mavlink") if "delay" in table else None
    dialect = _find_dialect(table.get("dialect", "common"), folder, problems)
    return MavlinkLink(
        urls, dialect, **ids, delay_ns=delay, resend_ns=resend, offboard_loss_ns=loss
    )


def parse_source(text: str) -> tuple[int, int] | None:
    """Gives system and component of a sender such as `1/191`; None for a text of other form."""
    match = SOURCE.fullmatch(text)
    ids = (int(match[1]), int(match[2])) if match else (0, 0)
    return ids if all(1 <= n <= 255 for n in ids) else None


def _read_urls(value: object, problems: MappingProblems) -> tuple[str, ...]:
    urls = [value] if isinstance(value, str) else value
    if not isinstance(urls, list) or not 1 <= len(urls) <= LINKS_MAX:
        problems.add(f"`mavlink` needs a `url`, or up to {LINKS_MAX} of them: {URLS}")
        return ()
    for url in urls:
        if not isinstance(url, str) or not _is_url(url):
            problems.add(f"`url` of `mavlink` is {str(url)[:60]!r}: there are {URLS}")
    if len({str(u) for u in urls}) != len(urls):
        problems.add("`url` of `mavlink` names one twice")
    return tuple(str(u) for u in urls)


def _is_url(url: str) -> bool:
    udp, serial = UDP.fullmatch(url), SERIAL.fullmatch(url)
    if udp is not None:
        numbers = [] if udp[2].startswith("[") else udp[2].split(".")
        return 1 <= int(udp[3]) <= 65535 and all(int(n) <= 255 for n in numbers)
    return serial is not None and int(serial[2]) in BAUDS


def _read_id(table: Mapping[str, Any], key: str, default: int, problems: MappingProblems) -> int:
    number = table.get(key, default)
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= 255:
        problems.add(f"`{key}` of `mavlink` is a number from 1 to 255, not {str(number)[:40]}")
        return default
    return number


def _find_dialect(value: object, folder: Path, problems: MappingProblems) -> Dialect:
    name = value if isinstance(value, str) and value else "common"
    known = standard_dialects()
    if name is not value:
        problems.add(f"`dialect` of `mavlink` is no name: {value!r}")
    elif name not in known and not name.endswith(".xml"):
        problems.add(unknown_name_message("`mavlink` has no dialect", name, known))
        name = "common"
    try:
        return read_dialect(dialect_path(name, folder).resolve())
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: links in a circle
        problems.add(f"the dialect `{name}` of `mavlink` cannot be read: {error}")
        return read_dialect(dialect_path("common", folder).resolve())
