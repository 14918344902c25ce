"""Reads and writes the channels of a robot from Python: types, sets, values to bytes and back.

Purpose: a `Channel` is a topic's file in shared memory, to write, read or wait for; many threads
may use one. The C is that of the robot: the order of its stores and loads makes a value whole, and
Python says nothing about that. A `Topic` turns values into bytes and back, and judges what is to be
published as the gate would, before anybody sees it. `find_topics` finds the topics of a package, or
those that `soter build` would write of a program that was not built.
Non-goals: who may write: whoever may write into the folder.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol, cast
from weakref import WeakSet

from soter.core.layout import INT_KINDS, decode_from, encode_into, size_of
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.similar_names import likely
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_json_text
from soter.language.model.system import Bound
from soter.language.model.types import (
    BOOL,
    FLOAT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)
from soter.language.model.values import ValueShapeError, from_python, to_python, without_ranges
from soter.native.c_interface import declarations, interface
from soter.native.cache import cached, digest
from soter.native.compiler import DEFECT, STRICT, compile_with, find_compiler
from soter.native.shared_library import CHECK_FAILED, OWN_SYMBOLS, RUNTIME, c_texts, include_flags
from soter.targets import CHANNELS, CHANNELS_SCHEMA, TRUSTED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import System
    from soter.language.model.types import Type, Value

    Ends = tuple[float, float] | None


POSIX = RUNTIME / "posix"
SOURCES = (POSIX / "soter_outside.c", POSIX / "soter_channel.c", CHECK_FAILED)
LIBRARY = "channels.so"
INTS = {c_type: IntType(low, high) for _, _, low, high, c_type, _ in INT_KINDS}
ENUM_STORAGE = {1: "uint8_t", 2: "uint16_t"}
ANEW = "stop everything that uses the folder, empty it, start anew"


@lru_cache(maxsize=1)
def compiled_library() -> tuple[Any, Any]:
    """Gives cffi and the library; SoterError X004, X005 where nothing compiles here."""
    compiler = find_compiler()
    flags = (*STRICT, "-O2", "-fPIC", "-shared", *OWN_SYMBOLS)

    def make(work: Path) -> None:
        sources = [*include_flags(*SOURCES), *map(str, SOURCES), "-o", LIBRARY]
        command = [*compiler.command, *flags, *sources]
        compile_with(command, work, "channels do not compile: they need Linux", (DEFECT,))

    content = digest((compiler.identity, *flags, *c_texts(*SOURCES)))
    built = cached("channels", content, (LIBRARY,), make) / LIBRARY
    headers = [declarations(POSIX / n) for n in ("soter_channel.h", "soter_outside.h")]
    ffi = interface(*headers)
    return ffi, ffi.dlopen(str(built))


class Channel:
    """The file of a topic; `writes`: opened as its only writer, which a forked child is not."""

    def __init__(self, folder: Path, name: str, number: int, size: int, *, writes: bool) -> None:
        self._c: Any = None
        self._ffi, self._lib = compiled_library()
        self._name, self._size = name, size
        self._lock = Lock()
        self._c = self._ffi.new("soter_outside *")
        self._value = self._ffi.new("uint8_t[]", max(size, 1))
        self._time = self._ffi.new("int64_t *")
        self._head = self._ffi.new("soter_channel_head *")
        if writes:
            WRITERS.add(self)
        where = (str(folder).encode(), name.encode())
        wrong = self._lib.soter_outside_open(self._c, *where, number, size, writes)
        if wrong != self._ffi.NULL:
            raise self._unusable(self._ffi.string(wrong).decode(errors="replace"))
        if self._is_foreign():
            self.close()
            raise self._foreign()

    def write(self, stamp_ns: int, image: bytes) -> None:
        """Writes the next value; `image` has the topic's size."""
        assert len(image) == self._size
        with self._lock:
            self._require_open()
            self._lib.soter_outside_write(self._c, stamp_ns, self._ffi.from_buffer(image))

    def read(self) -> tuple[int, bytes] | None:
        """Gives stamp and bytes of a value not read before, or None; SoterError X013 if foreign."""
        with self._lock:
            self._require_open()
            value, null = self._value, self._ffi.NULL
            if self._lib.soter_outside_read(self._c, self._time, value, null):
                return int(self._time[0]), bytes(self._ffi.buffer(value, self._size))
            if self._is_foreign():
                raise self._foreign()
        return None

    def wait(self, most_ns: int) -> None:
        """Waits until something new is written, `most_ns` at most; other threads wait meanwhile."""
        with self._lock:
            self._require_open()
            self._lib.soter_outside_wait(self._c, most_ns)

    def close(self) -> None:
        """Gives the channel's memory back; the file stays."""
        with self._lock:
            self._lib.soter_outside_close(self._c)

    def close_in_child(self) -> None:
        """Closes in a forked process, where no other thread runs, whichever had the lock."""
        self._lock = Lock()
        self.close()

    def __del__(self) -> None:
        if self._c is not None:
            self.close()

    def _require_open(self) -> None:
        if self._c.place[0] == self._ffi.NULL:
            raise ValueError(
                f"the connection is closed: `{self._name}` is neither read nor written"
            )

    def _is_foreign(self) -> bool:
        """Whether a value of another layout stands here, and none of this topic's layout."""
        own, other = self._lib.SOTER_CHANNEL_OTHER, self._lib.SOTER_CHANNEL_LAYOUT
        c = self._c
        found = [
            self._lib.soter_channel_read(place, c.hash, self._size, 0, self._head, c.room)
            for place in c.place
        ]
        return other in found and own not in found

    def _foreign(self) -> SoterError:
        why = "it holds values of another type: who wrote them was built from another program"
        return self._unusable(f"{why}. Connect with the robot's own package, or {ANEW}")

    def _unusable(self, why: str) -> SoterError:
        return SoterError(
            (Diagnostic("X013", f"the channel `{self._name}` cannot be used: {why}"),)
        )


def _close_in_child() -> None:
    for channel in tuple(WRITERS):
        channel.close_in_child()


WRITERS: WeakSet[Channel] = WeakSet()
"""Channels that a forked process closes: it would keep their locks when the writer has ended."""
os.register_at_fork(after_in_child=_close_in_child)


@dataclass(frozen=True)
class Topic:
    """A topic with a channel. `number`: of its layout; `writable`: others than the robot write it.

    `ends`: for each leaf of the type the least and the greatest value, None for a leaf without
    bounds.
    """

    name: str
    channel: str
    number: int
    writable: bool
    type: Type
    ends: tuple[Ends, ...]

    @property
    def size(self) -> int:
        """The bytes of a value."""
        return size_of(self.type)

    def image(self, given: object, *, clip: bool, path: str = "") -> bytes:
        """The bytes of a value; SoterError U012 where the topic cannot take it."""
        where = path or self.name
        if not isinstance(self.type, (RecordType, ArrayType, ListType)):
            given = _only_element(given)
        try:
            value = from_python(without_ranges(self.type), given, where)
        except ValueShapeError as error:
            raise _refusal(str(error)) from error
        fitting = _Fitting(self.ends, clip=clip).fitted_value(self.type, value, where)
        buffer = bytearray(self.size)
        encode_into(buffer, 0, self.type, fitting)
        return bytes(buffer)

    def value(self, image: bytes) -> Any:  # noqa: ANN401 - any type of Soter
        """The value in these bytes, records as dicts; SoterError X013 where they hold none."""
        try:
            return to_python(self.type, decode_from(image, 0, self.type), record=dict)
        except (ValueError, IndexError) as error:
            message = f"what stands in the channel `{self.channel}` is no `{self.type}`"
            raise SoterError((Diagnostic("X013", message),)) from error


class Topics:
    """The topics by the name that the program gives them, or that of their channel."""

    def __init__(self, system: str, topics: Sequence[Topic]) -> None:
        self.system = system
        self.all = tuple(topics)
        self._known = {n: t for t in topics for n in (t.channel, t.name)}

    def find(self, name: str) -> Topic:
        """The topic of this name; SoterError U001 where there is none."""
        found = self._known.get(name)
        if found is None:
            near = likely(name, self._known)
            listed = f"did you mean `{near}`?" if near else f"it has {_topic_list(self.all)}"
            message = f"system `{self.system}` has no channel `{name}`: {listed}"
            raise SoterError((Diagnostic("U001", message),))
        return found

    def to_publish(self, name: str) -> Topic:
        """The topic of this name; SoterError U001 also where the robot publishes it itself."""
        topic = self.find(name)
        if not topic.writable:
            open_ = _topic_list([t for t in self.all if t.writable])
            message = f"`{name}` is published by the robot itself; open to others: {open_}"
            raise SoterError((Diagnostic("U001", message),))
        return topic


def _topic_list(topics: Sequence[Topic]) -> str:
    return ", ".join(f"`{t.name}`" for t in topics) or "none"


# ---------------------------------------------------------------- from a package, or a program


def find_topics(program: str | Path | Declared, system: str | None) -> Topics:
    """The topics of a package (its folder, its channels.json) or of a program (file or loaded)."""
    if isinstance(program, (str, Path)):
        path = Path(program)
        if path.is_dir():
            there = [f / CHANNELS for f in (path, path / TRUSTED)]
            return _package_topics(next((f for f in there if f.is_file()), there[0]), system)
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
    """The topics of a `channels.json`; SoterError X013 if it is malformed or has no channels."""
    try:
        whole = cast("Mapping[str, Any]", document)
        if whole["schema"] != CHANNELS_SCHEMA:
            raise _document_error(where)
        topics = [_parsed_topic(t) for t in whole["topics"]]
        system = str(whole["system"])
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


def _finite_number(given: object) -> float:
    if isinstance(given, bool) or not isinstance(given, (int, float)):
        raise TypeError(given)
    return given


def _parsed_type(d: Mapping[str, Any]) -> Type:
    """The type that `targets/firmware_interface.py` described; of ints the storage, no names."""
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


# ---------------------------------------------------------------- values


def _only_element(given: object) -> object:
    """The number in an array of one, which networks answer; anything else as it is."""
    if hasattr(given, "tolist") and hasattr(given, "ndim"):
        given = cast("Any", given).tolist()
    return given[0] if isinstance(given, (list, tuple)) and len(given) == 1 else given


class _Fitting:
    """Checks that a value is in its topic's set, else U012; `clip`: puts numbers at its ends."""

    def __init__(self, ends: Sequence[Ends], *, clip: bool) -> None:
        self._ends = iter(ends)
        self._clip = clip

    def fitted_value(self, t: Type, given: Value, path: str) -> Value:
        """The value, checked; takes as many ends as the type has leaves."""
        if isinstance(t, RecordType):
            parts = zip(t.fields, given, strict=True)
            return tuple([self.fitted_value(f, v, f"{path}.{n}") for (n, f), v in parts])
        if isinstance(t, ArrayType):
            return tuple(
                [self.fitted_value(t.element, v, f"{path}[{i}]") for i, v in enumerate(given)]
            )
        if isinstance(t, ListType):
            own = [next(self._ends) for _ in leaves(t.element)]
            each = [(_Fitting(own, clip=self._clip), v) for v in given]
            return tuple(
                [f.fitted_value(t.element, v, f"{path}[{i}]") for i, (f, v) in enumerate(each)]
            )
        return self._leaf(t, given, next(self._ends), path)

    def _leaf(self, t: Type, given: Value, ends: Ends, path: str) -> Value:
        if isinstance(t, (BoolType, EnumType)):
            return given
        if isinstance(t, FloatType) and not math.isfinite(given):
            raise _refusal(f"{path}: {given} is no finite number")
        if ends is None or ends[0] <= given <= ends[1]:
            return given
        low, high = Bound(*ends).singles if isinstance(t, FloatType) else ends
        if self._clip or low <= given <= high:
            return type(given)(min(max(given, ends[0]), ends[1]))
        raise _refusal(f"{path}: {given} is not in [{ends[0]}, {ends[1]}] (clip=True clips it)")


def _refusal(message: str) -> SoterError:
    return SoterError((Diagnostic("U012", message),))


class Declared(Protocol):
    """The systems of a program, as `soter.load` gives them."""

    def declared(self, system: str | None = None) -> System:
        """A system of the program; SoterError where there is none."""


def channels_document(program: str | Path | Declared, system: str | None) -> dict[str, object]:
    """Gives `channels.json` of a system of a file or loaded program; SoterError U002."""
    from soter.language.front_end import check_file, system_of  # noqa: PLC0415 - as below
    from soter.targets.world_interface import channel_document  # noqa: PLC0415 - not of a package

    if isinstance(program, (str, Path)):
        return channel_document(system_of(check_file(str(program)), system))
    return channel_document(program.declared(system))
