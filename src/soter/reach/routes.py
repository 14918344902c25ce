"""Ways through the flying system: from sensors to what a module reads, from it to the plant.

Purpose: for a topic of the verification system the `Path`s of its publishers, hop by hop, and the
nodes that stand between SC and the plant (docs/proof.md, "The model of time").
Non-goals: what the nodes compute (that they show the state is an assumption, `assumed.py`), the
times that follow (`schedule.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import gcd
from typing import TYPE_CHECKING

from soter.reach.schedule import Path, Releases

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.program import typed
    from soter.program.system import Component, Topic
    from soter.reach.place import Place

ROUTES_MAX = 64
"""More ways than these from sensors to one topic are not followed."""


class UnfollowedError(Exception):
    """A way that cannot be followed: the node that it ends at, and why."""

    def __init__(self, node: Component, why: str) -> None:
        super().__init__(why)
        self.node = node


@dataclass(frozen=True, eq=False)
class Route:
    """One way from a sensor to a topic, with its stations in the flying system."""

    path: Path
    topic: Topic
    sensor: Component | None
    """None: an input of the system, or a node that no plant stands behind."""
    nodes: tuple[Component, ...] = ()
    source: bool = False
    """The first node stands behind no plant: what it publishes is a state of its own, which is
    what it is until it publishes again, the default before its first step (an assumption). So who
    reads it sees the instant of the reading."""

    @property
    def stations(self) -> tuple[Component, ...]:
        """The nodes that belong to `path`: without a source that others read."""
        return self.nodes[len(self.nodes) - len(self.path.nodes) :]


@dataclass(eq=False)
class Routes:
    """Every way that matters for the times of one module."""

    by_dm: list[Route] = field(default_factory=list)
    by_sc: list[Route] = field(default_factory=list)
    behind: list[Component] = field(default_factory=list)
    """Nodes that read what SC publishes, and whose steps do not simply follow SC's."""
    in_step: list[Component] = field(default_factory=list)
    """Nodes that read it and are released whenever SC is: they run behind it, in its thread."""

    @property
    def nodes(self) -> list[Component]:
        """Nodes between sensor and module, each once."""
        found = [n for r in (*self.by_dm, *self.by_sc) for n in r.stations]
        return list(dict.fromkeys(found))


def routes_of(
    place: Place, dm: list[int], sc: list[int], ns: Callable[[typed.Expr | None], int]
) -> Routes:
    """The ways to the topics that DM and SC read (indices of the verification system)."""
    verify = place.module.symbol.verify

    def releases(c: Component) -> Releases:
        late, response = verify.late_of.get(c.name), verify.response_of.get(c.name)
        return Releases(c.period_ns, c.phase_ns, ns(late), ns(response))

    found = Routes()
    found.by_dm += [r for index in dm for r in _to(place, index, releases)]
    found.by_sc += [r for index in sc for r in _to(place, index, releases)]
    if place.abstract:
        _behind(place, found)
    return found


def _to(place: Place, index: int, releases: Callable[[Component], Releases]) -> Iterator[Route]:
    topic = place.system.topics[index]
    if not place.abstract:
        plant = place.driven[index]
        at = Releases(plant.period_ns, plant.phase_ns)
        yield Route(Path(at, (), topic.max_age_ns), topic, plant)
        return
    for k, way in enumerate(_upstream(place, place.flying(topic.symbol), ())):
        if k == ROUTES_MAX:
            raise UnfollowedError(way.nodes[-1], f"more than {ROUTES_MAX} ways lead to it")
        nodes = way.nodes[1:] if way.source and len(way.nodes) > 1 else way.nodes
        path = Path(way.first, tuple(releases(n) for n in nodes), topic.max_age_ns)
        yield Route(path, topic, way.sensor, way.nodes, way.source)


@dataclass(frozen=True, eq=False)
class _Way:
    sensor: Component | None
    nodes: tuple[Component, ...]
    first: Releases
    source: bool = False


def _upstream(place: Place, index: int, seen: tuple[Component, ...]) -> Iterator[_Way]:
    """Every way to a topic of the flying system that does not run in a circle."""
    flat = place.flat
    for drive in flat.inputs:
        if drive.topic == index:
            yield _Way(None, (), Releases(drive.every_ns))
    for c in flat.components:
        if c.plant is not None and any(c.scope.topics[t] == index for t, _ in c.plant.drives):
            yield _Way(c, (), Releases(c.period_ns, c.phase_ns))
        if c.node is None or c.role != "node" or c in seen:
            continue
        if index not in [c.scope.topics[t] for t in c.node.publishes]:
            continue
        ways = 0
        for s in c.node.subscribes:
            read = c.scope.topics[s.topic]
            if flat.topics[read].queue_of is not None:
                raise UnfollowedError(c, "it reads a queue, whose values may be of any age")
            for way in _upstream(place, read, (*seen, c)):
                ways += 1
                yield replace(way, nodes=(*way.nodes, c))
        if not ways:
            yield _Way(None, (c,), Releases(1), source=True)


def _behind(place: Place, found: Routes) -> None:
    """Nodes that read the module's outputs in the flying system."""
    sc, verify = place.sc, place.module.symbol.verify
    outputs = set(place.home.outputs)
    for c in place.flat.components:
        if c.node is None or c.role != "node":
            continue
        if not outputs & {c.scope.topics[s.topic] for s in c.node.subscribes}:
            continue
        aligned = gcd(c.period_ns, sc.period_ns) == c.period_ns
        aligned = aligned and (sc.phase_ns - c.phase_ns) % c.period_ns == 0
        declared = c.name in verify.late_of or c.name in verify.response_of
        (found.in_step if aligned and not declared else found.behind).append(c)
