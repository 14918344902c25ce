"""Makes the test cases for the check of a decision module, and the expected answers.

Purpose: `topic_values` gives values of the topics that a DM reads, every class at least once: NaN,
infinities, huge numbers, zeros of both signs, the ends of each range and breakpoints with their
neighbours, all members of enums, and random points; `gate_states` gives every state of the gate.
`ExpectedFacts` evaluates `ttf` and `safer` in the reference interpreter. `LatchBytes` has the place
of a latch in a state, every memory that it may have, and the expected memory after each look
(written anew from docs/semantics.md, The latch).
Non-goals: trying any of it (`dm_check.py`).
"""

from __future__ import annotations

import itertools
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from soter.core.layout import encode_into, size_of
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import PredicateEvaluator, maybe_nan
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import AgeRead
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
    import random
    from collections.abc import Iterator, Mapping, Sequence

    from soter.codegen.unit import Unit
    from soter.core.layout import StateLayout
    from soter.language.evaluate.expressions import Compiled
    from soter.language.model.system import Bound, Module, System
    from soter.language.model.types import Type, Value

    Points = Mapping[tuple[int, int], Sequence[float]]


SC, AC = 0, 1
RANDOM_POINTS = 400
SPECIAL = (float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 0.0, -0.0, 5e-324)
WRAPPER = """
#include <string.h>
unsigned soter_check_decide(unsigned module, void *state);
unsigned soter_check_switch(unsigned mode, unsigned facts);
unsigned soter_check_decide(unsigned module, void *state) {{
  return (unsigned){prefix}_program.module[module].decide(state);
}}
void soter_check_cells(unsigned module, unsigned char *state, const size_t facts[2], size_t axes,
    const size_t *at, const double *points, size_t count, unsigned char *found);
void soter_check_cells(unsigned module, unsigned char *state, const size_t facts[2], size_t axes,
    const size_t *at, const double *points, size_t count, unsigned char *found) {{
  for (size_t k = 0; k < count; k++) {{
    for (size_t a = 0; a < axes; a++) {{
      (void)memcpy(state + at[a], points + k * axes + a, sizeof(double));
    }}
    (void){prefix}_program.module[module].decide(state);
    found[k] = state[facts[0]] != 0U ? 0U : state[facts[1]] != 0U ? 2U : 1U;
  }}
}}
unsigned soter_check_switch(unsigned mode, unsigned facts) {{
  return (unsigned){prefix}_switch((soter_mode)mode, (facts & 1U) != 0U, (facts & 2U) != 0U,
      (facts & 4U) != 0U, (facts & 8U) != 0U, (facts & 16U) != 0U);
}}
"""


def gate_states(module: Module) -> Iterator[tuple[int, int, int]]:
    """Yields every state of the gate: (mode, gate fault, clean outputs owed)."""
    owed = (0, 1, module.clean, 2**31, 2**32 - 1)
    for mode in (SC, AC):
        for gate_fault in (0, 1):
            for clean in dict.fromkeys(owed):
                yield mode, gate_fault, clean


def topic_values(
    system: System, read: Sequence[int], points: Points, chance: random.Random
) -> Iterator[tuple[Value, ...]]:
    """Yields values for the read topics: each leaf in each class, then random points."""
    flat = []
    for index in read:
        topic = system.topics[index]
        kinds = [kind for _, kind in leaves(topic.type)]
        for k, (kind, bound) in enumerate(zip(kinds, topic.bounds, strict=True)):
            flat.append(_TriedLeaf(kind, bound, points.get((index, k), ())))

    def values_from_leaves(chosen: list[Value]) -> tuple[Value, ...]:
        it = iter(chosen)
        return tuple(_value_from_leaves(system.topics[i].type, it) for i in read)

    for at, leaf in enumerate(flat):
        for value in leaf.values_of_each_class():
            drawn = [x.random_value(chance) for x in flat]
            drawn[at] = value
            yield values_from_leaves(drawn)
    for _ in range(RANDOM_POINTS if flat else 1):
        yield values_from_leaves([x.random_value(chance) for x in flat])


@dataclass(frozen=True)
class _TriedLeaf:
    """The values to try for one scalar of a topic."""

    type: Type
    bound: Bound | None
    points: Sequence[float] = ()

    def values_of_each_class(self) -> Iterator[Value]:
        """Yields values of every class: special values, ends, points, and neighbours of these."""
        if isinstance(self.type, FloatType):
            yield from SPECIAL
            ends = () if self.bound is None else (self.bound.low, self.bound.high)
            for end in (*ends, *self.points):
                yield float(end)
                yield float(np.nextafter(end, np.inf))
                yield float(np.nextafter(end, -np.inf))
        elif isinstance(self.type, BoolType):
            yield from (False, True)
        elif isinstance(self.type, EnumType):
            yield from range(len(self.type.members))
        else:
            yield from self._int_range()

    def _int_range(self) -> tuple[int, int]:
        assert isinstance(self.type, IntType)
        return self.type.low, self.type.high

    def random_value(self, chance: random.Random) -> Value:
        """A random value within the leaf's range, if it has a range."""
        if isinstance(self.type, FloatType):
            if self.points:
                low, high = min(self.points), max(self.points)
                return chance.uniform(low - 0.1 * (high - low), high + 0.1 * (high - low))
            if self.bound is not None:
                return chance.uniform(self.bound.low, self.bound.high)
            return chance.choice((-1, 1)) * 10.0 ** chance.uniform(-3, 3)
        if isinstance(self.type, BoolType):
            return chance.random() < 0.5
        if isinstance(self.type, EnumType):
            return chance.randrange(len(self.type.members))
        return chance.randint(*self._int_range())


def _value_from_leaves(t: Type, values: Iterator[Value]) -> Value:
    """Builds a value of type `t` from the next leaf values, in order."""
    if isinstance(t, RecordType):
        return tuple(_value_from_leaves(f, values) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(_value_from_leaves(t.element, values) for _ in range(t.size))
    if isinstance(t, ListType):
        return (_value_from_leaves(t.element, values),) * t.capacity
    return next(values)


NOW_NS = 10**15


class ExpectedFacts:
    """Evaluates the predicates of a module in the reference interpreter."""

    def __init__(self, system: System, module: Module) -> None:
        self.system = system
        evaluator = PredicateEvaluator.for_scope(module.scope, {})
        symbol = module.symbol
        evaluator.nan_checks = maybe_nan(system, module)  # topics are NaN here, which none ever is
        self._ttf = None if symbol.ttf is None else evaluator.compiled(symbol.ttf)
        self._safer = None if symbol.safer is None else evaluator.compiled(symbol.safer)
        self._safe = evaluator.compiled(symbol.safe)
        self.period_ns = module.period_ns
        self.reads_ages = any(isinstance(n, AgeRead) for n in nodes([symbol.ttf, symbol.safer]))
        self._image = bytearray()
        """The bytes of a state with all topics at their defaults."""

    def expected_ttf_and_safer(
        self, topics: tuple[Value, ...], ages: Mapping[int, int]
    ) -> tuple[bool, bool]:
        """The values of ttf and safer that the DM must find; a fault counts as unsafe.

        `ages`: the ages, in ns, of topics that were not published just now.
        """
        env = self._environment(topics, ages)
        return self._truth_or_fault(self._ttf, env, fault=True), self._truth_or_fault(
            self._safer, env, fault=False
        )

    def safe(self, topics: tuple[Value, ...]) -> bool:
        """Whether `safe` holds for these topic values; a fault counts as unsafe."""
        return self._truth_or_fault(self._safe, self._environment(topics, {}), fault=False)

    def _environment(self, topics: tuple[Value, ...], ages: Mapping[int, int]) -> Environment:
        return Environment(
            topics=topics,
            stamps=tuple(NOW_NS - ages.get(i, 0) for i in range(len(topics))),
            time_ns=NOW_NS,
            period_ns=self.period_ns,
            in_control=True,
            mode=lambda _: SC,
            truth=lambda _: (),
        )

    def _truth_or_fault(self, predicate: Compiled | None, env: Environment, *, fault: bool) -> bool:
        """The truth value of a predicate; `fault` if the predicate faults or is None."""
        try:
            return fault if predicate is None else bool(predicate(env))
        except StepFault:
            return fault

    def state_bytes(self, unit: Unit, topics: tuple[Value, ...]) -> bytearray:
        """The bytes of a state that holds these topic values."""
        defaults = [t.default for t in self.system.topics]
        self._image = self._image or _state_with_topics(bytearray(unit.layout.size), unit, defaults)
        new = (None if v is d else v for v, d in zip(topics, defaults, strict=True))
        return _state_with_topics(bytearray(self._image), unit, tuple(new))


def _state_with_topics(out: bytearray, unit: Unit, topics: Sequence[Value | None]) -> bytearray:
    """Writes the topic values into the state `out` and returns it; None keeps the old value."""
    for at, m in (
        (g.offset, m) for g in unit.layout.groups if g.owner < 0 for m in g.struct.members
    ):
        if (value := topics[m.index]) is not None:
            out[at + m.offset : at + m.offset + size_of(m.type)] = bytes(size_of(m.type))
            encode_into(out, at + m.offset, m.type, value)
    return out


NEVER = -(2**62)
WAITS, READY, ACKNOWLEDGED = range(3)
Held = tuple[int, int]
"""The memory of a latch: the value and the stamp of the topic that holds it."""


class Seen(NamedTuple):
    """The inputs of one DM look at its latch: memory, button, and the button's stamp in ns."""

    held: Held
    pressed: bool = False
    stamp: int = NEVER


@dataclass(frozen=True)
class LatchBytes:
    """The byte offsets of a module's latch in a state; `button` is None for `returns never`."""

    value: int
    since: int
    button: int | None
    stamp: int
    max_age: int

    @classmethod
    def of_module(cls, system: System, layout: StateLayout, module: Module) -> LatchBytes | None:
        """The byte offsets of a module's latch; None if the module has no latch."""
        if module.latch is None:
            return None
        button = module.acknowledgement
        return cls(
            layout.topic_offset(module.latch),
            layout.stamp_offset + 8 * module.latch,
            None if button is None else layout.topic_offset(button),
            0 if button is None else layout.stamp_offset + 8 * button,
            0 if button is None else system.topics[button].max_age_ns or 0,
        )

    def release(self, state: bytearray) -> None:
        """Writes a latch that lets AC have control: acknowledged, or never engaged."""
        now = struct.unpack_from("<q", state, 0)[0]
        held = (0, NEVER) if self.button is None else (ACKNOWLEDGED, now)
        self.write_look(state, Seen(held))

    def write_look(self, state: bytearray, seen: Seen) -> None:
        """Writes the inputs of a look (memory, button and stamp) into a state."""
        struct.pack_into("<b", state, self.value, seen.held[0])
        struct.pack_into("<q", state, self.since, seen.held[1])
        if self.button is not None:
            struct.pack_into("<?", state, self.button, seen.pressed)
            struct.pack_into("<q", state, self.stamp, seen.stamp)

    def read_memory(self, state: bytearray) -> Held:
        """Reads the memory that the DM wrote into a state."""
        value = struct.unpack_from("<b", state, self.value)[0]
        return int(value), int(struct.unpack_from("<q", state, self.since)[0])

    def all_looks(self, now: int) -> Iterator[Seen]:
        """Yields all looks to try, with each memory value, order of times, and age at the limit."""
        if self.button is None:
            yield from (Seen((value, NEVER)) for value in (0, 1))
            return
        ages = dict.fromkeys((0, 1, self.max_age, self.max_age + 1, 2 * self.max_age + 2))
        times = (NEVER, *(now - age for age in ages))
        for value, since, stamp in itertools.product((WAITS, READY, ACKNOWLEDGED), times, times):
            for pressed in (False, True):
                yield Seen((value, since), pressed, stamp)

    def memory_after_look(self, seen: Seen, now: int) -> tuple[Held, bool]:
        """The memory after a look in mode SC, and whether the latch lets AC have control."""
        value, since = seen.held
        if self.button is None:
            return seen.held, value == 0
        since = now if since == NEVER else since
        if value == ACKNOWLEDGED and now - since > self.max_age:
            value = WAITS
        new, old = seen.stamp > since, now - seen.stamp > self.max_age
        if new and value == WAITS and not seen.pressed:
            return (READY, seen.stamp), False
        if new and value == READY and seen.pressed:
            return (WAITS if old else ACKNOWLEDGED, seen.stamp), not old
        return (value, since), value == ACKNOWLEDGED

    def memory_after_switch(self, mode: int, now: int) -> Held:
        """The memory of the latch after a switch to this mode."""
        if self.button is None:
            return 1, NEVER
        return WAITS, NEVER if mode == AC else now
