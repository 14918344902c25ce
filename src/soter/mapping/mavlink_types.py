"""The messages of MAVLink: what a field such as `vx` of `mavlink/LOCAL_POSITION_NED` is.

Purpose: the dialects that the package `pymavlink` brings, and a file of one's own, as types like
those of ROS, with what MAVLink says besides: units, and which number means "not known".
Non-goals: C for them (`targets/mavlink/`); frames on a wire.
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

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import closest
from soter.mapping.dialect_xml import dialect_xml
from soter.mapping.message_types import ARRAY, BASE, MessageType, UnknownMessageError
from soter.mapping.stamp_source import StampSource

if TYPE_CHECKING:
    from collections.abc import Mapping

MAVLINK = 3
"""The family of definitions, beside ROS 1 and ROS 2."""
PACKAGE = "mavlink"
NAME = re.compile(r"mavlink/([A-Z][A-Z0-9_]*)", re.ASCII)
UNITS = {"m/s/s": "m/s^2", "mG": "mg", "g": "gram"}
"""Where MAVLink writes a unit in another way, or with letters that mean something else here."""
QUATERNION = re.compile(r"(?:\w+_)?q(?:[1-4]|uaternion)?", re.ASCII)
"""Fields whose numbers are those of an orientation: MAVLink gives them no unit."""
STAMPS = {("time_boot_ms", "uint32"): 10**6, ("time_usec", "uint64"): 10**3}
"""Fields that say when a message was measured, on the autopilot's clock, and their unit in ns."""
_KIND = {"float": "float32", "double": "float64", "char": "string"}


@dataclass(frozen=True)
class MavlinkMessage(MessageType):
    """A message of a dialect. `invalid`: by field, the number that means that it is not known.

    `extensions`: the fields that frames of MAVLink 1 do not have.
    """

    id: int = 0
    units: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    invalid: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    fields_in_order: tuple[str, ...] = ()
    extensions: frozenset[str] = frozenset()

    def unit(self, path: str) -> str | None:
        """What a field is in, as MAVLink says."""
        name = path.partition(".")[0]
        return self.units.get(name, "1" if QUATERNION.fullmatch(name) else None)

    @property
    def default_stamp(self) -> StampSource | None:
        """The field that says when it was measured."""
        for (name, kind), ns in STAMPS.items():
            if name in self.fields_in_order and self.leaf(name) == kind:
                return StampSource(name, "number", Fraction(ns))
        return None


@dataclass(frozen=True)
class ChecksumEntry:
    """What a parser has to know of any message: of its length and its checksum."""

    id: int
    extra: int
    shortest: int
    longest: int
    flags: int
    target_system: int
    target_component: int


@dataclass(frozen=True)
class Dialect:
    """The messages of a dialect and of all that it includes; `xml`: them, in one document."""

    name: str
    xml: bytes = field(repr=False)
    messages: Mapping[str, MavlinkMessage]
    checksums: tuple[ChecksumEntry, ...]

    def named(self, name: str) -> MavlinkMessage:
        """The type; raises UnknownMessageError."""
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
    """Whether a `type` of a mapping is meant as a message of MAVLink."""
    return isinstance(name, str) and name.startswith(f"{PACKAGE}/")


def require_mavlink_package() -> None:
    """SoterError D007 where the package that knows MAVLink's dialects is not installed."""
    if find_spec("pymavlink") is None:
        text = "messages of MAVLink are known to the package `pymavlink`, which is not installed"
        help_ = "install it: pip install 'soter[mavlink]'"
        raise SoterError((Diagnostic("D007", text, helps=(help_,)),))


def standard_dialects() -> list[str]:
    """The dialects that the package brings."""
    return sorted(p.stem for p in _folder().glob("*.xml") if p.stem not in ("all", "test"))


def dialect_path(name: str, folder: Path) -> Path:
    """Of a dialect by its name, or of a file of one's own, beside the mapping."""
    return folder / name if name.endswith(".xml") else _folder() / f"{name}.xml"


@cache
def read_dialect(path: Path) -> Dialect:
    """The dialect; ValueError where the file is none, OSError where it cannot be read."""
    messages: dict[str, MavlinkMessage] = {}
    checksums: dict[int, ChecksumEntry] = {}
    document = dialect_xml(path)
    for m in _parsed(document):
        messages[m.name] = _message(m)
        checksums[m.id] = ChecksumEntry(
            m.id,
            m.crc_extra,
            m.wire_min_length,
            m.wire_length,
            m.message_flags,
            m.target_system_ofs,
            m.target_component_ofs,
        )
    if not messages:
        raise ValueError("it has no messages")
    return Dialect(path.stem, document, messages, tuple(checksums[i] for i in sorted(checksums)))


def _folder() -> Path:
    spec = find_spec("pymavlink")
    assert spec is not None, "require_mavlink_package"
    assert spec.origin is not None
    return Path(spec.origin).parent / "dialects" / "v20"


def _parsed(document: bytes) -> list[Any]:
    """The messages as pymavlink has them, the innermost file's first."""
    from pymavlink.generator import mavparse  # noqa: PLC0415 - an extra

    with tempfile.TemporaryDirectory() as place:
        at = Path(place) / "dialect.xml"
        at.write_bytes(document)
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                return list(mavparse.MAVXML(str(at), mavparse.PROTOCOL_2_0).message)
        except (Exception, SystemExit) as error:  # it raises whatever it comes upon
            raise ValueError(str(error)[:120].replace("\n", " ") or "it is no dialect") from error


def _unit(f: Any) -> str:  # noqa: ANN401 - of a package without types
    """What a field is in; "" where MAVLink does not say. `deg*360/255` is no unit of ours."""
    unit = str(f.units or "").strip("[]")
    return f"{unit or '1'}*{f.multiplier}" if f.multiplier else UNITS.get(unit, unit)


def _message(m: Any) -> MavlinkMessage:  # noqa: ANN401 - of a package without types
    kinds: list[tuple[str, Any]] = []
    for f in m.fields:
        kind: Any = (BASE, (_KIND.get(f.type, f.type.removesuffix("_t")), 0))
        if f.type == "char":
            kind = (BASE, ("string", max(f.array_length, 1)))
        elif f.array_length:
            kind = (ARRAY, (kind, f.array_length))
        kinds.append((f.name, kind))
    units = {f.name: unit for f in m.fields if (unit := _unit(f))}
    return MavlinkMessage(
        PACKAGE,
        m.name,
        {MAVLINK: {f"{PACKAGE}/msg/{m.name}": ([], kinds)}},
        id=m.id,
        units=units,
        invalid={f.name: f.invalid for f in m.fields if f.invalid},
        fields_in_order=tuple(f.name for f in m.fields),
        extensions=frozenset(f.name for f in m.fields[m.base_fields() :]),
    )
