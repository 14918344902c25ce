"""Random configurations of the explorer, written field by field from the page and the layout alone.

Purpose: what a packed configuration has to keep, with a draw and a place for each of its fields;
nothing here knows how bits are laid out.
Non-goals: reachable configurations (the explorer makes those).
"""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.core.layout import (
    NEVER,
    decode_from,
    encode_into,
    size_of,
    state_layout,
)
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy as np
    import numpy.typing as npt

    from soter.explore.engine.explorer_library import Engine
    from soter.language.model.system import Bound
    from soter.language.model.types import Type

    Configuration = npt.NDArray[np.uint8]

NO_DEADLINE = 2**63 - 1
COMPONENT, MODULE = 24, 40
"""Bytes of their records in the state."""
LATCHED, HAD_CONTROL = 14, 15
CLEAN_NEEDED, MODE, GATE_FAULT = 28, 32, 33


@dataclass(frozen=True)
class Field:
    """A part of a configuration that decides what may follow."""

    name: str
    offset: int
    size: int
    value: object
    others: Callable[[], object]
    """Another value for it, perhaps the same."""
    put: Callable[[Configuration, object], None]
    get: Callable[[Configuration], object]


class ConfigurationMaker:
    """Draws configurations of one engine's system."""

    def __init__(self, engine: Engine, seed: int) -> None:
        self.engine = engine
        self.system = engine.system
        self.plan = engine.plan
        self.layout = state_layout(self.system)
        self.random = random.Random(seed)  # noqa: S311 - no secrets
        assert self.system.test is not None
        self.test = self.system.test
        self.now = 0

    def fields(self, now: int) -> list[Field]:
        """Every field of a configuration at a time, with a value."""
        self.now = now
        return [
            self._scalar("now", "<q", self.layout.size, lambda: now),
            *self._schedule(),
            *self._obligations(),
            *self._records(),
            *self._stamps(),
            *self._values(),
            *self._held(),
        ]

    def time(self) -> int:
        """A time at which a configuration may be."""
        last = self.plan.horizon_ns // self.plan.tick_ns
        return self.random.randint(0, last) * self.plan.tick_ns

    # ------------------------------------------------------------ places

    def _scalar(self, name: str, code: str, offset: int, draw: Callable[[], object]) -> Field:
        def put(configuration: Configuration, value: object) -> None:
            struct.pack_into(code, configuration.data, offset, value)

        def get(configuration: Configuration) -> object:
            return struct.unpack_from(code, configuration.data, offset)[0]

        return Field(name, offset, struct.calcsize(code), draw(), draw, put, get)

    def _typed(self, name: str, offset: int, t: Type, bounds: Sequence[Bound | None]) -> Field:
        def put(configuration: Configuration, value: object) -> None:
            image = bytearray(size_of(t))
            encode_into(image, 0, t, value)
            configuration[offset : offset + len(image)] = memoryview(image)

        def get(configuration: Configuration) -> object:
            return decode_from(configuration.data, offset, t)

        def draw() -> object:
            return self.value(t, list(bounds))

        return Field(name, offset, size_of(t), draw(), draw, put, get)

    def value(self, t: Type, bounds: list[Bound | None]) -> Any:
        """A value of a type, inside the bounds of its leaves."""
        if isinstance(t, RecordType):
            return tuple([self.value(f, bounds) for _, f in t.fields])
        if isinstance(t, ArrayType):
            return tuple([self.value(t.element, bounds) for _ in range(t.size)])
        if isinstance(t, ListType):
            count = sum(1 for _ in leaves(t.element))
            inner, bounds[:count] = bounds[:count], []
            length = self.random.randint(0, t.capacity)
            return tuple([self.value(t.element, list(inner)) for _ in range(length)])
        bound = bounds.pop(0)
        if isinstance(t, BoolType):
            return self.random.random() < 0.5
        if isinstance(t, EnumType):
            return self.random.randrange(len(t.members))
        if isinstance(t, FloatType):
            some = (0.0, -0.0, 1.5, -3.25e-300, float("inf"), self.random.uniform(-9.0, 9.0))
            return self.random.choice(some)
        assert isinstance(t, IntType)
        low, high = (int(bound.low), int(bound.high)) if bound else (t.low, t.high)
        return self.random.choice((low, high, self.random.randint(low, high)))

    # ------------------------------------------------------------ the schedule

    def _offsets(self) -> tuple[int, int, int, int, int]:
        """Where due, verdict, done, lost and acted begin."""
        due = self.layout.size + 8
        verdict = due + 8 * len(self.test.timed)
        done = verdict + 8 * len(self.system.modules)
        lost = done + 4 * len(self.plan.actors)
        return due, verdict, done, lost, lost + 4 * len(self.plan.actors)

    def _schedule(self) -> Iterator[Field]:
        _, _, done, lost, _ = self._offsets()
        for i, a in enumerate(self.plan.actors):
            releases = range(a.phase_ns, self.plan.horizon_ns + 1, a.period_ns)
            must = sum(1 for r in releases if r + a.window_ns < self.now)
            most = max(sum(1 for r in releases if r <= self.now), must)
            if most == must == len(releases) and a.overrun_ns == 0:
                most = must
            yield self._scalar(
                f"done of {a.name}", "<I", done + 4 * i,
                lambda must=must, most=most: self.random.randint(must, most),  # type: ignore[misc]
            )  # fmt: skip
            if a.skips:
                yield self._scalar(
                    f"lost of {a.name}", "<I", lost + 4 * i,
                    lambda k=a.skips: self.random.randint(0, k),  # type: ignore[misc]
                )  # fmt: skip

    def _ticks(self, ns: int) -> int:
        return ns // self.plan.tick_ns

    def _ago(self, most: int) -> int:
        """A time up to `most` ns ago."""
        return self.now - self.random.randint(0, self._ticks(most)) * self.plan.tick_ns

    def _obligations(self) -> Iterator[Field]:
        due, verdict, _, _, acted = self._offsets()
        for i, t in enumerate(self.test.timed):
            if t.module is not None:
                limit = 2 * self.system.modules[t.module].period_ns
                yield self._scalar(
                    "verdict", "<q", verdict + 8 * t.module,
                    lambda limit=limit: self._ago(limit),  # type: ignore[misc]
                )  # fmt: skip
                yield self._scalar(
                    "acted", "<B", acted + t.module, lambda: self.random.randint(0, 1)
                )
                continue

            def owed(within: int = t.within_ns) -> int:
                ahead = self.random.randint(-1, self._ticks(within)) * self.plan.tick_ns
                return NO_DEADLINE if ahead < 0 else self.now + ahead

            yield self._scalar(f"due of {t.text}", "<q", due + 8 * i, owed)

    # ------------------------------------------------------------ components and modules

    def _bit(self, name: str, offset: int) -> Field:
        return self._scalar(name, "<B", offset, lambda: self.random.randint(0, 1))

    def _records(self) -> Iterator[Field]:
        for m in self.system.modules:
            at = self.layout.module_offset + MODULE * m.index
            if m.forced is None:
                yield self._bit(f"mode of {m.name}", at + MODE)
                yield self._bit(f"gate fault of {m.name}", at + GATE_FAULT)
                yield self._scalar(
                    f"clean of {m.name}", "<I", at + CLEAN_NEEDED,
                    lambda k=m.clean: self.random.randint(0, k),  # type: ignore[misc]
                )  # fmt: skip
        for x in self.system.components:
            at = self.layout.component_offset + COMPONENT * x.index
            if x.role not in {"ac", "dm"} and x.index in self.plan.may_fault:
                yield self._bit(f"latch of {x.name}", at + LATCHED)
            if x.node is not None and x.node.takeover is not None:
                yield self._bit(f"control of {x.name}", at + HAD_CONTROL)

    def _stamps(self) -> Iterator[Field]:
        for t in self.system.topics:
            at = self.layout.stamp_offset + 8 * t.index
            if t.policy == "fault":
                yield self._scalar(
                    f"mark of {t.name}", "<q", at, lambda: self.random.choice((NEVER, 0))
                )
            elif t.index in self.plan.aged:
                yield self._scalar(
                    f"stamp of {t.name}", "<q", at,
                    lambda: self.random.choice((NEVER, self._ago(self.now))),
                )  # fmt: skip
            elif t.index in self.plan.limited:
                limit = min(t.max_age_ns or 0, self.now)
                yield self._scalar(
                    f"stamp of {t.name}", "<q", at,
                    lambda k=limit: self.random.choice((NEVER, self._ago(k))),  # type: ignore[misc]
                )  # fmt: skip

    # ------------------------------------------------------------ values

    def _values(self) -> Iterator[Field]:
        for t in self.system.topics:
            if t.index in self.plan.read:
                at = self.layout.topic_offset(t.index)
                yield self._typed(t.name, at, t.type, t.bounds)
        for x in self.system.components:
            symbol = x.node.locals if x.node else x.plant.states if x.plant else ()
            for i, v in enumerate(symbol):
                at, kind = self.layout.member(x.index, i)
                none = [None for _ in leaves(kind)]
                yield self._typed(f"{x.name}.{v.name}", at, kind, none)

    def _held(self) -> Iterator[Field]:
        for i, a in enumerate(self.plan.actors):
            if not a.overrun_ns:
                continue
            at = int(self.engine.model.actor[i].held)
            limit = min(a.overrun_ns, self.now)
            yield self._scalar(
                f"since of {a.name}", "<q", at,
                lambda k=limit: self._ago(k),  # type: ignore[misc]
            )  # fmt: skip
            ones = (1 << len(a.outputs)) - 1
            yield self._scalar(
                f"mask of {a.name}",
                "<Q",
                at + 8,
                lambda ones=ones: ones,  # type: ignore[misc]
            )
            at += 16
            for topic in a.outputs:
                t = self.system.topics[topic]
                yield self._typed(f"held {t.name}", at, t.type, t.bounds)
                at += size_of(t.type) + -size_of(t.type) % 8
