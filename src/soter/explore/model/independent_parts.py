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
    from collections.abc import Iterable

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
    assert system.test is not None
    footprints = Footprints(system, lowered)
    if system.test.timed or TIME in footprints.read_by_properties():
        return None
    if any(a.window_ns or a.overrun_ns for a in plan.actors):
        return None
    properties = [footprints.read_by(p) for p in range(len(system.properties))]
    if max(len(plan.actors), len(properties)) > WIDTH:
        return None
    groups = _depending(plan)
    roots = list(dict.fromkeys(groups.of(i) for i in range(len(plan.actors))))
    homes = [sorted({groups.of(i) for i in _movers(plan, reads)}) for reads in properties]
    joined = [p for p, home in enumerate(homes) if len(home) > 1]
    if not joined or any(system.properties[p].component is not None for p in joined):
        return None
    own = [home[0] if home else roots[0] for home in homes]
    parts = tuple(
        IndependentPart(
            _mask(i for i in range(len(plan.actors)) if groups.of(i) == root),
            _mask(p for p in range(len(properties)) if own[p] == root and p not in joined),
            0,
        )
        for root in roots
    )
    return IndependentParts(
        parts, tuple(SharedProperty(p, tuple(roots.index(r) for r in homes[p])) for p in joined)
    )


def parts_of(
    system: System, lowered: CoreSystem, plan: ExplorationPlan
) -> tuple[IndependentPart, ...]:
    """The parts, in the order of their first actors; a single one where masks are too narrow."""
    assert system.test is not None
    footprints = Footprints(system, lowered)
    if system.test.timed or TIME in footprints.read_by_properties():
        return (IndependentPart(0, 0, 0),)
    times = [t for a in plan.actors for t in (a.period_ns, a.phase_ns)]
    if plan.timely and any(t % plan.quantum_ns for t in times):
        return (
            IndependentPart(0, 0, 0),
        )  # a step may happen when another part's did, off the grid
    properties = [footprints.read_by(p) for p in range(len(system.properties))]
    if max(len(plan.actors), len(properties)) > WIDTH:
        return (IndependentPart(0, 0, 0),)
    groups = _depending(plan)
    movers = [_movers(plan, reads) for reads in properties]
    for some in movers:
        groups.join(some)
    homes = [groups.of(some[0]) if some else groups.of(0) for some in movers]
    roots = dict.fromkeys(groups.of(i) for i in range(len(plan.actors)))
    return tuple(
        IndependentPart(
            _mask(i for i in range(len(plan.actors)) if groups.of(i) == root),
            _mask(p for p in range(len(properties)) if homes[p] == root),
            0,
        )
        for root in roots
    )


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
