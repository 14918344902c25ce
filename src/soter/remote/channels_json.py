"""Finds the topics of a robot, which `channels.json` of its package declares.

Purpose: `find_topics` reads the topics of a package, or makes those of a program as `soter build`
would.
Non-goals: writing that file (`targets/world_interface.py`); values (`topics.py`).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from soter.core.layout import INT_KINDS, size_of
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_json_text
from soter.language.model.types import (
    BOOL,
    FLOAT,
    ArrayType,
    EnumType,
    IntType,
    ListType,
    RecordType,
    leaves,
)
from soter.remote.topics import Topic, Topics
from soter.targets import CHANNELS, CHANNELS_SCHEMA, TRUSTED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import System
    from soter.language.model.types import Type

INTS = {c_type: IntType(low, high) for _, _, low, high, c_type, _ in INT_KINDS}
ENUM_STORAGE = {1: "uint8_t", 2: "uint16_t"}


def find_topics(program: str | Path | Declared, system: str | None) -> Topics:
    """The topics of a package (folder or channels.json) or of a program (file or loaded)."""
    if isinstance(program, (str, Path)):
        path = Path(program)
        if path.is_dir():
            places = [f / CHANNELS for f in (path, path / TRUSTED)]
            return _package_topics(next((f for f in places if f.is_file()), places[0]), system)
        if path.suffix == ".json":
            return _package_topics(path, system)
    return parse_channels(channels_document(program, system), "the program")


def _package_topics(path: Path, system: str | None) -> Topics:
    try:
        document = json.loads(read_json_text(path))
    except OSError as error:
        message = f"cannot read `{path}`: {reason(error)}; `soter build --target posix` writes it"
        raise SoterError((Diagnostic("X013", message),)) from error
    except (ValueError, RecursionError) as error:
        raise _document_error(str(path)) from error
    topics = parse_channels(document, str(path))
    if system is not None and system not in (topics.system, topics.system.rpartition(".")[2]):
        message = f"`{path}` is about system `{topics.system}`, not `{system}`"
        raise SoterError((Diagnostic("X013", message),))
    return topics


def parse_channels(document: object, where: str) -> Topics:
    """The topics in a `channels.json`; raises X013 if it is malformed or has no channels."""
    try:
        fields = cast("Mapping[str, Any]", document)
        if fields["schema"] != CHANNELS_SCHEMA:
            raise _document_error(where)
        topics = [_parsed_topic(t) for t in fields["topics"]]
        system = str(fields["system"])
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise _document_error(where) from error
    if not topics:
        message = f"system `{system}` has no channels: no `external topic` is declared in it"
        raise SoterError((Diagnostic("X013", message),))
    return Topics(system, topics)


def _document_error(where: str) -> SoterError:
    message = f"`{where}` is no channels.json of this version of soter: build the package anew"
    return SoterError((Diagnostic("X013", message),))


def _parsed_topic(t: Mapping[str, Any]) -> Topic:
    made = _parsed_type(t["type"])
    ends = tuple(
        None if e is None else (_finite_number(e[0]), _finite_number(e[1])) for e in t["set"]
    )
    if len(ends) != sum(1 for _ in leaves(made)) or size_of(made) != t["type"]["size"]:
        raise ValueError(t["name"])
    return Topic(
        name=str(t["name"]),
        channel=str(t["channel"]),
        number=int(t["number"], 16),
        writable=t["published"] == "outside",
        type=made,
        ends=ends,
    )


def _finite_number(number: object) -> float:
    if isinstance(number, bool) or not isinstance(number, (int, float)):
        raise TypeError(number)
    return number


def _parsed_type(d: Mapping[str, Any]) -> Type:
    """The type in a description by `targets/firmware_interface.py`; ints have storage ranges."""
    kind = d["kind"]
    if "members" in d:
        made = EnumType("enum", tuple(map(str, d["members"])))
        if ENUM_STORAGE.get(size_of(made)) != kind:
            raise ValueError(kind)
        return made
    if kind == "record":
        return RecordType(tuple((str(f["name"]), _parsed_type(f["type"])) for f in d["fields"]))
    if kind == "array":
        return ArrayType(_parsed_type(d["element"]), int(d["length"]))
    if kind == "list":
        return ListType(_parsed_type(d["element"]), int(d["capacity"]))
    if kind == "double":
        return FLOAT
    return BOOL if d.get("bool") else INTS[kind]


class Declared(Protocol):
    """The systems of a program, as `soter.load` gives them."""

    def declared(self, system: str | None = None) -> System:
        """A system of the program; SoterError where there is none."""


def channels_document(program: str | Path | Declared, system: str | None) -> dict[str, object]:
    """The content of `channels.json` for a system of a program; raises SoterError U002."""
    from soter.language.front_end import check_file, system_of  # noqa: PLC0415 - as below
    from soter.targets.world_interface import channel_document  # noqa: PLC0415 - not of a package

    if isinstance(program, (str, Path)):
        return channel_document(system_of(check_file(str(program)), system))
    return channel_document(program.declared(system))
