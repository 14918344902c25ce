"""Both engines under a driver that publishes inputs from outside, good ones and bad ones.

Purpose: `soter_publish` in C and `Interpreter.publish_input` with the same bytes at the same times,
every answer and every state compared; no input is drawn.
Non-goals: programs (`random_programs.py`), draws (`any_order_driver.py`).
"""

from __future__ import annotations

import random
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from cffi import FFI

from generators.engine_comparison import first_difference
from soter.core.layout import decode_from, encode_into, size_of
from soter.language.model.system import environment_topics
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    ListType,
    RecordType,
    leaves,
)
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import next_instant
from soter.simulate.run import state_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from generators.engine_comparison import Subject
    from soter.language.model.system import Bound, Topic
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration

DECLARATIONS = """
typedef struct soter_program soter_program;
void soter_start(const soter_program *p, void *state, uint64_t seed);
int64_t soter_next_instant(const soter_program *p, const void *state);
int soter_instant(const soter_program *p, void *state, uint32_t *due);
void soter_progress(const soter_program *p, void *state);
int soter_publish(const soter_program *p, void *state, uint32_t topic, const void *given,
                  int64_t time);
void soter_answer(const soter_program *p, void *state, uint32_t component, int fault,
                  const void *answer);
"""
WILD = (
    struct.pack("<d", float("nan")),
    struct.pack("<d", float("-inf")),
    struct.pack("<d", 1e300),
    b"\xff\xff\xff\x7f",
    b"\xff",
    b"\x02",
)


def _ffi() -> Any:
    """Whose types nobody knows."""
    return FFI()


class Outside:
    """The C engine, driven by whoever holds it."""

    def __init__(self, library: Path, s: Subject) -> None:
        self.subject = s
        self.ffi = _ffi()
        self.ffi.cdef(DECLARATIONS)
        self.ffi.cdef(f"extern const char {s.name}_program[];")
        self.lib = self.ffi.dlopen(str(library))
        address = self.ffi.addressof(self.lib, f"{s.name}_program")
        self.program = self.ffi.cast("const soter_program *", address)
        self.state = np.zeros(s.layout.size, dtype=np.uint8)
        self._due = self.ffi.new("uint32_t *")
        self.lib.soter_start(self.program, self._pointer, s.seed)

    @property
    def _pointer(self) -> Any:
        return self.ffi.cast("void *", self.state.ctypes.data)

    @property
    def record(self) -> Any:
        """The state, decoded."""
        return self.state.view(self.subject.dtype)[0]

    def topic(self, index: int) -> Value:
        """What a topic holds."""
        offset = self.subject.layout.topic_offset(index)
        return decode_from(self.state.tobytes(), offset, self.subject.system.topics[index].type)

    def next_instant(self) -> int:
        """When it is, ns."""
        return int(self.lib.soter_next_instant(self.program, self._pointer))

    def progress(self) -> None:
        """Time moves to the next instant, which has not ended then."""
        self.lib.soter_progress(self.program, self._pointer)

    def instant(self) -> int | None:
        """One instant, or the rest of one; the component that waits for an answer."""
        waits = self.lib.soter_instant(self.program, self._pointer, self._due)
        return int(self._due[0]) if waits else None

    def publish_bytes(self, topic: int, given: bytes, time_ns: int) -> int:
        """A value as bytes; 0 or the kind of fault."""
        # at an odd address: nobody promised more
        kept = self.ffi.from_buffer(b"-" + given)
        at = self.ffi.cast("const void *", self.ffi.cast("const char *", kept) + 1)
        return int(self.lib.soter_publish(self.program, self._pointer, topic, at, time_ns))

    def publish(self, topic: int, value: Value, time_ns: int) -> int:
        """The same of a value."""
        t = self.subject.system.topics[topic].type
        raw = bytearray(size_of(t))
        encode_into(raw, 0, t, value)
        return self.publish_bytes(topic, bytes(raw), time_ns)

    def answer(self, component: int, fault: int) -> None:
        """No usable answer of an extern."""
        self.lib.soter_answer(self.program, self._pointer, component, fault, self.ffi.NULL)


def _leaves(t: Type) -> int:
    return sum(1 for _ in leaves(t))


def some_value(t: Type, bounds: Sequence[Bound | None], chance: random.Random) -> Value:
    """A value within its bounds, one for each leaf of `t`."""
    if isinstance(t, RecordType):
        fields, at = [], 0
        for _, f in t.fields:
            count = _leaves(f)
            fields.append(some_value(f, bounds[at : at + count], chance))
            at += count
        return tuple(fields)
    if isinstance(t, ArrayType):
        count = _leaves(t.element)
        places = range(0, t.size * count, count)
        return tuple(some_value(t.element, bounds[i : i + count], chance) for i in places)
    if isinstance(t, ListType):
        length = chance.randint(0, t.capacity)
        return tuple(some_value(t.element, bounds, chance) for _ in range(length))
    (bound,) = bounds
    if isinstance(t, FloatType):
        low, high = (bound.low, bound.high) if bound else (-1e3, 1e3)
        return chance.choice((low, high, min(low + (high - low) * chance.random(), high)))
    if isinstance(t, BoolType):
        return chance.random() < 0.5
    if isinstance(t, EnumType):
        return chance.randrange(len(t.members))
    limits = (int(bound.low), int(bound.high)) if bound else (t.low, t.high)  # type: ignore[attr-defined]
    return chance.choice((*limits, chance.randint(*limits)))


def some_bytes(topic: Topic, chance: random.Random) -> bytes:
    """A value of the topic's set as bytes; sometimes spoilt."""
    raw = bytearray(size_of(topic.type))
    encode_into(raw, 0, topic.type, some_value(topic.type, topic.bounds, chance))
    if chance.random() < 0.4:
        wild = chance.choice(WILD)
        step = len(wild) if len(raw) % len(wild) == 0 else 1
        at = chance.randrange(0, len(raw), step)
        raw[at : at + len(wild)] = wild
        del raw[size_of(topic.type) :]
    return bytes(raw)


def read(t: Type, raw: bytes) -> Value:
    """What the bytes mean; None where they are no value at all."""
    try:
        return decode_from(raw, 0, t)
    except ValueError:
        return None


def first_disagreement(
    s: Subject, library: Path, instants: int, kinds: list[int] | None = None
) -> str | None:
    """What first differs, in words; None where nothing does. `kinds` collects the answers."""
    chance = random.Random(s.seed)  # noqa: S311 - not for secrets
    native, interpreter = Outside(library, s), Interpreter(s.system, s.seed)
    c, record = interpreter.initial(), interpreter.record()
    own = environment_topics(s.system)

    def differs(what: str, c: Configuration) -> str | None:
        other = np.frombuffer(state_bytes(s.system, s.layout, c, record, s.seed), dtype=np.uint8)
        states = (native.state.reshape(1, -1), other.reshape(1, -1))
        words = first_difference(s, *states)
        return words and f"{what} at {c.ct} ns:\n{words}"

    for number in range(instants):
        for _ in range(chance.choice((0, 1, 1, 2, 4))):
            index = chance.choice(own) if chance.random() < 0.95 else len(s.system.topics) - 1
            topic = s.system.topics[index]
            raw = some_bytes(topic, chance)
            until = next_instant(interpreter.machine, c)
            times = (c.ct, until, (c.ct + until) // 2, c.stamps[index], c.stamps[index] - 1)
            time_ns = chance.choice((*times, until + 1) if chance.random() < 0.2 else times[:3])
            kind = native.publish_bytes(index, raw, time_ns)
            c, refused = interpreter.publish_input(c, index, read(topic.type, raw), time_ns)
            what = f"instant {number}, {topic.name} from {raw.hex()} of {time_ns} ns"
            if kind != (refused or 0):
                return f"{what}: {kind} in C, {refused!r} in the interpreter"
            if kinds is not None:
                kinds.append(kind)
            words = differs(what, c)
            if words:
                return words
        assert native.instant() is None
        c = interpreter.instant(c, choose_input=lambda _: (), record=record)
        words = differs(f"instant {number}", c)
        if words:
            return words
    return None
