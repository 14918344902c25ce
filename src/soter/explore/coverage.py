"""What a search has seen of a program, and by name what it has not.

Purpose: actors that stepped, modes, switches, branches of step functions and classes of topic
values: reached, out of how many, and the unreached ones as a person would call them.
Non-goals: collecting (the engine does), judging: what is unreached may be unreachable.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.program.types import BoolType, EnumType, IntType

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.program.types import Type

EACH_VALUE_MAX = 64
"""An int with at most so many values has a class for each of them."""
CLASSES = ("low", "high", "negative", "zero", "positive")
EACH = 8
"""The engine's number of the first value of a small set of ints."""


@dataclass(frozen=True)
class Part:
    """One kind of thing: how many there are, and the names of those that were not reached."""

    total: int = 0
    unreached: tuple[str, ...] = ()

    @property
    def reached(self) -> int:
        """How many were."""
        return self.total - len(self.unreached)

    def merged(self, other: Part) -> Part:
        """Of two searches of the same program."""
        both = set(other.unreached)
        return Part(self.total, tuple([n for n in self.unreached if n in both]))


@dataclass(frozen=True)
class Coverage:
    """What a search reached. The parts in this order wherever they are shown."""

    actors: Part = field(default_factory=Part)
    modes: Part = field(default_factory=Part)
    switches: Part = field(default_factory=Part)
    branches: Part = field(default_factory=Part)
    values: Part = field(default_factory=Part)

    def parts(self) -> Iterator[tuple[str, Part]]:
        """Name and part."""
        yield "actors", self.actors
        yield "modes", self.modes
        yield "switches", self.switches
        yield "branches", self.branches
        yield "values", self.values

    @property
    def unreached(self) -> tuple[str, ...]:
        """The names of everything that was not reached."""
        return tuple([name for _, part in self.parts() for name in part.unreached])


def part_of(named: Iterable[tuple[str, bool]]) -> Part:
    """Names, and whether each was reached."""
    found = list(named)
    return Part(len(found), tuple([name for name, reached in found if not reached]))


@dataclass(frozen=True)
class Leaf:
    """A scalar of a topic: full name with its path, type, bounds (infinite: none)."""

    name: str
    type: Type
    low: float
    high: float


def classes_of(leaf: Leaf) -> list[tuple[int, str]]:
    """The classes that the values of a leaf fall into: the engine's number, and a name.

    A value belongs to one class: an end of its set first, otherwise its sign.
    """
    if isinstance(leaf.type, BoolType):
        return [(0, f"{leaf.name} = false"), (1, f"{leaf.name} = true")]
    if isinstance(leaf.type, EnumType):
        members = list(enumerate(leaf.type.members))[:256]
        return [(i, f"{leaf.name} = {member}") for i, member in members]
    if isinstance(leaf.type, IntType) and leaf.high - leaf.low < EACH_VALUE_MAX:
        count = int(leaf.high - leaf.low) + 1
        return [(EACH + i, f"{leaf.name} = {int(leaf.low) + i}") for i in range(count)]
    return [(i, _class_name(leaf, i)) for i in _possible(leaf)]


def _possible(leaf: Leaf) -> list[int]:
    """Classes that a value may be in: inside, a sign that the set has."""
    low, high = leaf.low, leaf.high
    bounded_below, bounded_above = low > -float("inf"), high < float("inf")
    found = [0] if bounded_below else []
    found += [1] if bounded_above and low < high else []
    found += [2] if low < 0.0 else []
    found += [3] if low < 0.0 < high else []
    found += [4] if high > 0.0 else []
    return found if low < high else found[:1]


def _class_name(leaf: Leaf, number: int) -> str:
    if number == 0:
        return f"{leaf.name} = {leaf.low:g}"
    if number == 1:
        return f"{leaf.name} = {leaf.high:g}"
    return f"{leaf.name} {CLASSES[number]}"


def values_part(leaves: Sequence[Leaf], seen: Sequence[Sequence[int]]) -> Part:
    """`seen`: per leaf, per class number, whether a value of that class was published."""
    return part_of(
        (name, bool(row[number]))
        for leaf, row in zip(leaves, seen, strict=True)
        for number, name in classes_of(leaf)
    )


def modules_parts(
    modules: Sequence[tuple[str, str | None]],
    modes: Sequence[Sequence[int]],
    switches: Sequence[Sequence[int]],
) -> tuple[Part, Part]:
    """Modes and switches. `modules`: name and the mode it is forced to, if any: it keeps that."""
    named_modes: list[tuple[str, bool]] = []
    named_switches: list[tuple[str, bool]] = []
    for (name, forced), seen, switched in zip(modules, modes, switches, strict=True):
        for i, mode in enumerate(("SC", "AC")):
            if forced is None or forced.upper() == mode:
                named_modes.append((f"{name} in {mode}", bool(seen[i])))
            if forced is None:
                named_switches.append((f"{name} to {mode}", bool(switched[i])))
    return part_of(named_modes), part_of(named_switches)


def branches_part(names: Sequence[str], bits: Sequence[int]) -> Part:
    """`names`: one a branch; `bits`: words of 64, branch b is bit b % 64 of word b // 64."""
    return part_of((name, bool(bits[b // 64] >> (b % 64) & 1)) for b, name in enumerate(names))
