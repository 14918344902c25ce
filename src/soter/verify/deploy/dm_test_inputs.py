"""Classes of input for the check of a decision module.

Purpose: values of the topics that a DM reads, every class at least once: NaN, infinities, huge
ones, zeros of both signs, the ends of each range and breakpoints with their neighbours, all members
of enums, and points drawn at random; and every state of the gate. The C by which a DM is called.
Non-goals: trying them (`dm_check.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.core.layout import size_of, struct_of
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


def gates(module: Module) -> Iterator[tuple[int, int, int]]:
    """(mode, gate fault, clean outputs owed)."""
    owed = (0, 1, module.clean, 2**31, 2**32 - 1)
    for mode in (SC, AC):
        for gate_fault in (0, 1):
            for clean in dict.fromkeys(owed):
                yield mode, gate_fault, clean


def values(
    system: System,
    read: Sequence[int],
    points: Points,
    chance: random.Random,
) -> Iterator[tuple[Value, ...]]:
    """Values of the topics that are read: each leaf in each class, and points drawn at random."""
    flat = []
    for index in read:
        topic = system.topics[index]
        kinds = [kind for _, kind in leaves(topic.type)]
        for k, (kind, bound) in enumerate(zip(kinds, topic.bounds, strict=True)):
            flat.append(_TriedLeaf(kind, bound, points.get((index, k), ())))

    def built(chosen: list[Value]) -> tuple[Value, ...]:
        it = iter(chosen)
        return tuple(_build(system.topics[i].type, it) for i in read)

    for at, leaf in enumerate(flat):
        for value in leaf.classes():
            drawn = [x.draw(chance) for x in flat]
            drawn[at] = value
            yield built(drawn)
    for _ in range(RANDOM_POINTS if flat else 1):
        yield built([x.draw(chance) for x in flat])


@dataclass(frozen=True)
class _TriedLeaf:
    """One scalar of a topic: which values are tried."""

    type: Type
    bound: Bound | None
    points: Sequence[float] = ()

    def classes(self) -> Iterator[Value]:
        """Every class once."""
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
            yield from self._ints()

    def _ints(self) -> tuple[int, int]:
        assert isinstance(self.type, IntType)
        return self.type.low, self.type.high

    def draw(self, chance: random.Random) -> Value:
        """Some value: of the range where there is one."""
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
        return chance.randint(*self._ints())


def _build(t: Type, values: Iterator[Value]) -> Value:
    """A value from its leaves in order."""
    if isinstance(t, RecordType):
        return tuple(_build(f, values) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(_build(t.element, values) for _ in range(t.size))
    if isinstance(t, ListType):
        return (_build(t.element, values),) * t.capacity
    return next(values)


def leaf_offset(t: Type, leaf: int) -> int:
    """Byte offset of a scalar leaf inside a value."""
    if isinstance(t, RecordType):
        for member in struct_of(t).members:
            count = sum(1 for _ in leaves(member.type))
            before = sum(sum(1 for _ in leaves(f)) for _, f in t.fields[: member.index])
            if before <= leaf < before + count:
                return member.offset + leaf_offset(member.type, leaf - before)
    if isinstance(t, ArrayType):
        count = sum(1 for _ in leaves(t.element))
        return leaf // count * size_of(t.element) + leaf_offset(t.element, leaf % count)
    return 0
