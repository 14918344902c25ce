"""Parts of a tested system that share nothing: each is explored alone.

Purpose: actors that depend on each other, directly or through what one property reads, are one
part. An execution of the system is one of every part, interleaved, and a property sees one
part only: the system violates it iff that part does (docs/testing.md, "Parts"). All parts share one
thing: time. Where a property has a deadline or reads the time there is one part only.
Where nothing is late, a property may read several parts and they are explored alone all the same
(`IndependentParts`, docs/testing.md, "Joined parts"). Non-goals: dependence itself (`actors.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore.model.actors import TIME, Footprints

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.core.core import CoreSystem
    from soter.explore.model.exploration_plan import ExplorationPlan, Label
    from soter.language.model.system import System

WIDTH = 64
"""Actors, properties and timed properties that a mask can name."""


@dataclass(frozen=True)
class IndependentPart:
    """Bit masks: who moves, and which properties and timed properties are judged."""

    actors: int
    properties: int
    timeds: int


@dataclass(frozen=True)
class SharedProperty:
    """A property of the end of an instant that reads several parts: their numbers, two or more."""

    property: int
    parts: tuple[int, ...]


@dataclass(frozen=True)
class IndependentParts:
    """Parts that share no resource; `joints`: what is judged on several of them."""

    parts: tuple[IndependentPart, ...]
    joints: tuple[SharedProperty, ...]


def loose_parts_of(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> IndependentParts | None:
    """The parts that only properties join; None where none does, or windows are no points."""
    properties = _reads_of_properties(system, lowered, plan)
    if properties is None or any(a.window_ns or a.overrun_ns for a in plan.actors):
        return None
    groups = _depending(plan)
    roots = groups.roots()
    homes = [sorted({groups.of(i) for i in _movers(plan, reads)}) for reads in properties]
    joined = {p: home for p, home in enumerate(homes) if len(home) > 1}
    if not joined or any(system.properties[p].component is not None for p in joined):
        return None
    own = {p: (*home, roots[0])[0] for p, home in enumerate(homes) if p not in joined}
    shared = [SharedProperty(p, tuple(map(roots.index, home))) for p, home in joined.items()]
    return IndependentParts(groups.parts(own), tuple(shared))


def parts_of(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> tuple[IndependentPart, ...]:
    """The parts, in the order of their first actors; a single one where masks are too narrow."""
    properties = _reads_of_properties(system, lowered, plan)
    if properties is None or (  # a step may happen when another part's did, off the grid
        plan.timely
        and any(t % plan.quantum_ns for a in plan.actors for t in (a.period_ns, a.phase_ns))
    ):
        return (IndependentPart(0, 0, 0),)
    groups = _depending(plan)
    movers = [_movers(plan, reads) for reads in properties]
    for some in movers:
        groups.join(some)
    return groups.parts({p: groups.of(some[0] if some else 0) for p, some in enumerate(movers)})


def _reads_of_properties(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> list[set[Label]] | None:
    """What each property reads; None where one reads the time, or masks are too narrow."""
    assert system.test is not None
    footprints = Footprints(system, lowered)
    if system.test.timed or TIME in footprints.read_by_properties():
        return None
    properties = [footprints.read_by(p) for p in range(len(system.properties))]
    return None if max(len(plan.actors), len(properties)) > WIDTH else properties


def _depending(plan: ExplorationPlan) -> _Groups:
    """Actors that depend on each other, directly or through others."""
    groups = _Groups(len(plan.actors))
    for i, actor in enumerate(plan.actors):
        groups.join([i, *(j for j in range(len(plan.actors)) if actor.dependent >> j & 1)])
    return groups


def _movers(plan: ExplorationPlan, reads: set[Label]) -> list[int]:
    """Actors whose steps may change what is read."""
    return [i for i, actor in enumerate(plan.actors) if actor.writes & reads]


def _mask(bits: Iterable[int]) -> int:
    return sum(1 << b for b in bits)


class _Groups:
    """Sets that are joined; a set is known by its least member."""

    def __init__(self, count: int) -> None:
        self._root = list(range(count))

    def of(self, i: int) -> int:
        """The least member of the set of i."""
        while self._root[i] != i:
            i = self._root[i]
        return i

    def join(self, members: list[int]) -> None:
        """Make one set of the sets of all members."""
        roots = sorted({self.of(i) for i in members})
        for r in roots[1:]:
            self._root[r] = roots[0]

    def roots(self) -> list[int]:
        """The least members of all sets."""
        return [i for i, root in enumerate(self._root) if i == root]

    def parts(self, judged_by: Mapping[int, int]) -> tuple[IndependentPart, ...]:
        """A part for each set of actors; `judged_by`: property -> the least member of its set."""
        members = range(len(self._root))
        return tuple(
            IndependentPart(
                _mask(i for i in members if self.of(i) == root),
                _mask(p for p, own in judged_by.items() if own == root),
                0,
            )
            for root in self.roots()
        )
