"""Ways through the flying system: from sensors to what a module reads, from it to the plant.

Purpose: for a topic of the verification system the `SensorPath`s of its publishers, hop by hop, and
the nodes that stand between SC and the plant (docs/proof.md, "The model of time").
Non-goals: what the nodes compute (that they show the state is an assumption, `assumptions.py`), the
times that follow (`schedule.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.language.model.system import tower_of
from soter.verify.problem.verification_system import sc_reads
from soter.verify.time.always_publishes import UnfollowedError, must_publish
from soter.verify.time.downstream_paths import find_downstream_paths
from soter.verify.time.schedule import ActuationPath, Releases, SensorPath

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.model import typed
    from soter.language.model.system import Component, Topic
    from soter.verify.problem.verification_system import VerificationSystem
    from soter.verify.time.downstream_paths import DownstreamPath

ROUTES_MAX = 64
"""More ways than these from sensors to one topic are not followed."""


@dataclass(frozen=True, eq=False)
class CauseEffectChain:
    """One way from a sensor to a topic, with its stations in the flying system."""

    path: SensorPath
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
class CauseEffectChains:
    """Every way that matters for the times of one module."""

    by_dm: list[CauseEffectChain] = field(default_factory=list)
    by_sc: list[CauseEffectChain] = field(default_factory=list)
    ways: list[DownstreamPath] = field(default_factory=list)
    """From SC to plants."""
    beside: dict[tuple[str, str], None] = field(default_factory=dict)
    """Topics and who else their publishers listen to, that is no part of the proof: plants that no
    `abstracts` names, controllers of other modules. They say what is done, not where the plant of
    the proof is, so how old that is does not matter (an assumption, printed)."""
    releases: dict[Component, Releases] = field(default_factory=dict)
    """Of the nodes behind SC."""

    @property
    def behind(self) -> list[Component]:
        """Nodes behind SC whose wait counts, each once."""
        return list(dict.fromkeys(n for w in self.ways for n in w.counted))

    @property
    def nodes(self) -> list[Component]:
        """Nodes between sensor and module, each once."""
        stations = [n for r in (*self.by_dm, *self.by_sc) for n in r.stations]
        return list(dict.fromkeys(stations))


def chains_of(
    place: VerificationSystem,
    dm: list[int],
    sc: list[int],
    ns: Callable[[typed.TypedExpr | None], int],
) -> CauseEffectChains:
    """The ways to the topics that DM and SC read (indices of the verification system)."""
    chains = CauseEffectChains()

    def releases(c: Component) -> Releases:
        return releases_of(place, c, ns)

    chains.by_dm += [r for index in dm for r in _to(place, index, releases, chains.beside)]
    chains.by_sc += [r for index in sc for r in _to(place, index, releases, chains.beside)]
    if place.abstract:
        chains.ways = find_downstream_paths(place)
        chains.releases = {n: releases(n) for n in chains.behind}
    return chains


def releases_of(
    place: VerificationSystem, c: Component, ns: Callable[[typed.TypedExpr | None], int]
) -> Releases:
    """Of a node of the flying system, with the times that the module declares of it."""
    late, response = place.declared(c, "late"), place.declared(c, "response")
    return Releases(c.period_ns, c.phase_ns, ns(late), ns(response))


def side_inputs(place: VerificationSystem) -> dict[str, str]:
    """Topics of SC that no plant of the proof drives -> the one node that always publishes them."""
    publisher_by_topic = {}
    for topic in sc_reads(place.sc.node) if place.abstract and place.sc.node else ():
        own, index = place.sc.scope.topics[topic], place.flying(topic)
        nodes = [c for c in place.flat.components if _publishes(c, index)]
        if own in place.driven or [c.role for c in nodes] != ["node"]:
            continue
        try:
            must_publish(nodes[0], index)
        except UnfollowedError:
            continue
        publisher_by_topic[place.system.topics[own].name] = nodes[0].name
    return publisher_by_topic


def _publishes(c: Component, index: int) -> bool:
    return c.node is not None and index in [c.scope.topics[t] for t in c.node.publishes]


def outputs_of(chains: CauseEffectChains, least: int, acts: int) -> tuple[ActuationPath, ...]:
    """What lies between SC and the plants, one entry for every different way."""
    ways = [
        ActuationPath(least, acts, tuple(chains.releases[n] for n in w.counted))
        for w in chains.ways
    ]
    return tuple(dict.fromkeys(ways)) or (ActuationPath(least, acts),)


def _to(
    place: VerificationSystem,
    index: int,
    releases: Callable[[Component], Releases],
    beside: dict[tuple[str, str], None],
) -> Iterator[CauseEffectChain]:
    topic = place.system.topics[index]
    if not place.abstract:
        plant = place.driven[index]
        at = Releases(plant.period_ns, plant.phase_ns)
        path = SensorPath(at, (), topic.max_age_ns, topic=topic.name, publisher=plant.name)
        yield CauseEffectChain(path, topic, plant)
        return
    count, shown = 0, False
    for way in _upstream(place, place.flying(topic.symbol), ()):
        count += 1
        if count > ROUTES_MAX:
            raise UnfollowedError(way.nodes[-1], f"more than {ROUTES_MAX} ways lead to it")
        if way.beside is not None:
            beside[topic.name, way.beside.name] = None
            continue
        nodes = way.nodes[1:] if way.source and len(way.nodes) > 1 else way.nodes
        path = SensorPath(
            way.first,
            tuple(releases(n) for n in nodes),
            topic.max_age_ns,
            topic=topic.name,
            publisher=_publisher(way, topic),
        )
        shown = shown or (way.sensor is not None and way.sensor.name == place.shown_by(index))
        yield CauseEffectChain(path, topic, way.sensor, way.nodes, way.source)
    if not count:
        raise UnfollowedError(place.sc, f"nobody publishes `{topic.name}` in the flying system")
    if not shown:
        who = place.shown_by(index)
        what = f"`{topic.name}` is to show `{who}`, and no way leads to it from there"
        raise UnfollowedError(place.sc, what)


def _publisher(way: _ChainPrefix, topic: Topic) -> str:
    if way.nodes:
        return way.nodes[-1].name
    return topic.name if way.sensor is None else way.sensor.name


@dataclass(frozen=True, eq=False)
class _ChainPrefix:
    sensor: Component | None
    nodes: tuple[Component, ...]
    first: Releases
    source: bool = False
    beside: Component | None = None
    """Who stands at its beginning, where that is no part of the proof."""


def _upstream(
    place: VerificationSystem, index: int, seen: tuple[Component, ...]
) -> Iterator[_ChainPrefix]:
    """Every way to a topic of the flying system that does not run in a circle."""
    flat, links = place.flat, place.module.symbol.verify.abstracts
    shown = {place.around + link.instance for link in links}
    own = {m.index for m in tower_of(flat, place.home.index)}
    for drive in flat.inputs:
        if drive.topic == index:
            yield _ChainPrefix(None, (), Releases(drive.every_ns))
    for c in flat.components:
        if c.plant is not None and any(c.scope.topics[t] == index for t, _ in c.plant.drives):
            beside = None if c.name in shown else c
            yield _ChainPrefix(c, (), Releases(c.period_ns, c.phase_ns), beside=beside)
        if c.node is None or c in seen or c.module in own:
            continue
        if not _publishes(c, index):
            continue
        if c.role != "node":
            if seen:
                yield _ChainPrefix(None, (c,), Releases(1), beside=c)
                continue
            raise UnfollowedError(c, "the AC of another module may publish anything there")
        must_publish(c, index)
        ways = 0
        for s in c.node.subscribes:
            read = c.scope.topics[s.topic]
            if flat.topics[read].queue_of is not None:
                raise UnfollowedError(c, "it reads a queue, whose values may be of any age")
            for way in _upstream(place, read, (*seen, c)):
                ways += 1
                yield replace(way, nodes=(*way.nodes, c))
        if not ways:
            yield _ChainPrefix(None, (c,), Releases(1), source=True)
