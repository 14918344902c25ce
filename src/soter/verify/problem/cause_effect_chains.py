"""Finds the paths of data from sensors to a module, and from the module to the plants.

Purpose: `cause_effect_chains_of` finds, for a topic of the verification system, every path from a
sensor to its publishers, node by node, and, where the plants of the proof are abstractions, the
nodes that a module's commands pass on their way (docs/proof.md, "The model of time").
`require_publishes_in_every_step` checks what the times of such paths require.
Non-goals: what the nodes compute (that they show the state is an assumption, `assumptions.py`), the
times that follow (`schedule.py`); that no node faults is assumed.

Three kinds of nodes stand between SC and the plants. A node that also reads sensors is a controller
of its own. It belongs, with everything behind it, to the plants that the abstraction stands for: an
assumption names it, and it may not skip a command. A node that reads commands alone passes them on,
and its wait is counted. But a node that is released whenever SC is, is declared behind the node
before it and has no declared times runs behind SC in the same instant. Under a shield the first
node with sensors has to run so, too, since that bounds how long a command of AC may still act.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import gcd
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import topic_reads
from soter.verify.problem.schedule import ActuationPath, Releases, SensorPath
from soter.verify.problem.verification_system import topics_read_in_step

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.language.model.system import Component, Topic
    from soter.verify.problem.verification_system import VerificationSystem


class UnfollowedError(Exception):
    """Raised for a path of data that cannot be followed; the path ends at the component `node`."""

    def __init__(self, node: Component, why: str) -> None:
        super().__init__(why)
        self.node = node


def always_publishes(statements: Sequence[typed.TypedStmt], topic: typed.TopicSymbol) -> bool:
    """Whether every way through the statements publishes the topic; loops count as skipped."""
    for s in statements:
        if isinstance(s, typed.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, typed.TypedIf) and s.otherwise:
            parts = [body for _, body in s.arms] + [s.otherwise]
            if all(always_publishes(body, topic) for body in parts):
                return True
    return False


def require_publishes_in_every_step(node: Component, index: int) -> None:
    """Raises `UnfollowedError` if some step of the node can leave out the topic of that index."""
    assert node.node is not None
    if node.node.extern:
        return  # an assumption names what an extern does
    symbols = [t for t in node.node.publishes if node.scope.topics[t] == index]
    if not all(always_publishes(node.node.step, t) for t in symbols):
        raise UnfollowedError(node, "some of its steps publish nothing")


WAYS_MAX = 64


@dataclass(frozen=True, eq=False)
class DownstreamPath:
    """The nodes on one path from an output to a plant, sorted by how the proof counts waits."""

    counted: tuple[Component, ...] = ()
    in_step: tuple[Component, ...] = ()
    inner: tuple[Component, ...] = ()


def find_downstream_paths(place: VerificationSystem) -> list[DownstreamPath]:
    """Every path from the module's outputs to a plant of the flying system.

    Raises `UnfollowedError` for more than `WAYS_MAX` paths.
    """
    ways: list[DownstreamPath] = []
    for index in place.home.outputs:
        for nodes in _paths_to_plant(place, index, ()):
            ways.append(_downstream_path(place, nodes))
            if len(ways) > WAYS_MAX:
                sc = place.flat.components[place.home.sc]
                raise UnfollowedError(sc, f"more than {WAYS_MAX} ways lead from it to plants")
    return ways


def _paths_to_plant(
    place: VerificationSystem, index: int, seen: tuple[Component, ...]
) -> Iterator[tuple[Component, ...]]:
    """The nodes, in order, on every path without circles from a topic to a plant."""
    for c in place.flat.components:
        if c.plant is not None and index in c.reads:
            yield seen
        if c.node is None or c in seen or index not in _topics_read(place, c):
            continue
        for topic in c.node.publishes:
            yield from _paths_to_plant(place, c.scope.topics[topic], (*seen, c))


def _topics_read(place: VerificationSystem, c: Component) -> set[int]:
    """The topics that a node reads, including those that a queue collects for it."""
    assert c.node is not None
    return {place.flat.topics[c.scope.topics[s.topic]].source for s in c.node.subscribes}


def _downstream_path(place: VerificationSystem, nodes: tuple[Component, ...]) -> DownstreamPath:
    """The path through these nodes, with each node sorted by how the proof counts its wait."""
    counted: list[Component] = []
    in_step: list[Component] = []
    before = -1
    for k, node in enumerate(nodes):
        assert node.node is not None
        if node.role != "node":
            raise UnfollowedError(node, "the AC of another module may publish anything there")
        if _reads_sensors(place, node, set(nodes[: k + 1])):
            if place.module.symbol.shield is not None and not counted and node.index > before:
                in_step += [node] if _takes_over_at_once(place, node) else []
            return DownstreamPath(tuple(counted), tuple(in_step), nodes[k:])
        _check_passes_on(place, node, nodes[k + 1] if k + 1 < len(nodes) else None)
        if _steps_with_sc(place, node) and not counted and node.index > before:
            in_step.append(node)
            before = node.index
        else:
            counted.append(node)
    return DownstreamPath(tuple(counted), tuple(in_step))


def _check_passes_on(place: VerificationSystem, node: Component, after: Component | None) -> None:
    """Raises `UnfollowedError` if a node may pass on an old command, or no command."""
    assert node.node is not None
    topics = place.flat.topics
    if any(topics[node.scope.topics[s.topic]].queue_of is not None for s in node.node.subscribes):
        raise UnfollowedError(node, "it reads a queue, whose commands may be of any age")
    for topic in node.node.publishes:
        published = node.scope.topics[topic]
        if after is None or published in _topics_read(place, after):
            require_publishes_in_every_step(node, published)


def _takes_over_at_once(place: VerificationSystem, node: Component) -> bool:
    """Whether a node with sensors takes over each command in the instant of SC, behind SC."""
    assert node.node is not None
    always = all(always_publishes(node.node.step, t) for t in node.node.publishes)
    return always and has_outputs_in_proof_state(place, node) and _steps_with_sc(place, node)


def has_outputs_in_proof_state(place: VerificationSystem, node: Component) -> bool:
    """Whether the maps of `abstracts` read every topic that a node publishes."""
    assert node.node is not None
    shown = topic_reads(*(link.value for link in place.module.symbol.verify.abstracts))
    return set(node.node.publishes) <= shown.keys()


def _steps_with_sc(place: VerificationSystem, node: Component) -> bool:
    """Whether a node is in the thread, is released whenever SC is, and has no declared times."""
    if node.extern and not node.inline:
        return False
    sc = place.sc
    aligned = gcd(node.period_ns, sc.period_ns) == node.period_ns
    aligned = aligned and (sc.phase_ns - node.phase_ns) % node.period_ns == 0
    return aligned and all(place.declared_time(node, w) is None for w in ("late", "response"))


def _topics_driven_by(c: Component) -> set[int]:
    """The topics that a plant drives; empty for a component that is no plant."""
    return set() if c.plant is None else {*c.writes}


def _reads_sensors(place: VerificationSystem, node: Component, behind: set[Component]) -> bool:
    """Whether a node reads a plant's data that does not come through the nodes `behind`."""
    flat, todo, seen = place.flat, [node], {node}
    while todo:
        c = todo.pop()
        assert c.node is not None
        named = topics_read_in_step(c.node)  # a subscribed topic that it never reads is no sensor
        read = {flat.topics[c.scope.topics[t]].source for t in named}
        for other in flat.components:
            if read & _topics_driven_by(other):
                return True
            if other.node is None or other in seen or other in behind or other.role != "node":
                continue
            if read & {*other.writes}:
                seen.add(other)
                todo.append(other)
    return False


ROUTES_MAX = 64
"""The most paths from sensors to one topic that are followed."""


@dataclass(frozen=True, eq=False)
class CauseEffectChain:
    """One path from a sensor to a topic of DM or SC, with the nodes of the flying system on it."""

    path: SensorPath
    topic: Topic
    sensor: Component | None
    """None: an input of the system, or a node that no plant stands behind."""
    nodes: tuple[Component, ...] = ()
    source: bool = False
    """Whether no plant stands behind the first node. Its publication is a state of its own, which
    lasts until it publishes again (an assumption), so that a reader sees the instant of reading."""

    @property
    def stations(self) -> tuple[Component, ...]:
        """The nodes of `path`, without a first node that is a source and reads no plant."""
        return self.nodes[len(self.nodes) - len(self.path.nodes) :]


@dataclass(eq=False)
class CauseEffectChains:
    """All paths of data on which the times of one module depend."""

    by_dm: list[CauseEffectChain] = field(default_factory=list)
    by_sc: list[CauseEffectChain] = field(default_factory=list)
    ways: list[DownstreamPath] = field(default_factory=list)
    """The paths from SC to plants."""
    beside: dict[tuple[str, str], None] = field(default_factory=dict)
    """Pairs of a topic's name and the name of a component outside of the proof that its publishers
    hear: a plant that no `abstracts` names, or a controller of another module. What it says is no
    state of the proof's plants, so its age does not matter (an assumption, printed)."""
    releases: dict[Component, Releases] = field(default_factory=dict)
    """The releases of the nodes behind SC."""

    @property
    def behind(self) -> list[Component]:
        """The nodes behind SC whose wait counts, each once."""
        return list(dict.fromkeys(n for w in self.ways for n in w.counted))

    @property
    def nodes(self) -> list[Component]:
        """The nodes between sensors and the module, each once."""
        stations = [n for r in (*self.by_dm, *self.by_sc) for n in r.stations]
        return list(dict.fromkeys(stations))


def cause_effect_chains_of(
    place: VerificationSystem,
    dm: list[int],
    sc: list[int],
    ns: Callable[[typed.TypedExpr | None], int],
) -> CauseEffectChains:
    """The paths to topics `dm` and `sc` (indices in the proof's system), and from SC to plants."""
    chains = CauseEffectChains()

    def releases(c: Component) -> Releases:
        return releases_of(place, c, ns)

    chains.by_dm += [
        r for index in dm for r in _chains_to_topic(place, index, releases, chains.beside)
    ]
    chains.by_sc += [
        r for index in sc for r in _chains_to_topic(place, index, releases, chains.beside)
    ]
    if place.abstract:
        chains.ways = find_downstream_paths(place)
        chains.releases = {n: releases(n) for n in chains.behind}
    return chains


def releases_of(
    place: VerificationSystem, c: Component, ns: Callable[[typed.TypedExpr | None], int]
) -> Releases:
    """The releases of a node of the flying system, with the times that the module declares."""
    late, response = place.declared_time(c, "late"), place.declared_time(c, "response")
    return Releases(c.period_ns, c.phase_ns, ns(late), ns(response))


def side_input_publishers(place: VerificationSystem) -> dict[str, str]:
    """The publisher of each topic of SC without a plant, if one node publishes in every step."""
    publisher_by_topic = {}
    for topic in topics_read_in_step(place.sc.node) if place.abstract and place.sc.node else ():
        in_proof, index = place.sc.scope.topics[topic], place.flying_index(topic)
        nodes = [c for c in place.flat.components if _is_published_by(c, index)]
        if in_proof in place.driven or [c.role for c in nodes] != ["node"]:
            continue
        try:
            require_publishes_in_every_step(nodes[0], index)
        except UnfollowedError:
            continue
        publisher_by_topic[place.system.topics[in_proof].name] = nodes[0].name
    return publisher_by_topic


def _is_published_by(c: Component, index: int) -> bool:
    """Whether the node `c` publishes the topic with this index."""
    return c.node is not None and index in c.writes


def actuation_paths(chains: CauseEffectChains, least: int, acts: int) -> tuple[ActuationPath, ...]:
    """The different paths from SC to the plants, in the form that `Schedule.outputs` has."""
    ways = [
        ActuationPath(least, acts, tuple(chains.releases[n] for n in w.counted))
        for w in chains.ways
    ]
    return tuple(dict.fromkeys(ways)) or (ActuationPath(least, acts),)


def _chains_to_topic(
    place: VerificationSystem,
    index: int,
    releases: Callable[[Component], Releases],
    beside: dict[tuple[str, str], None],
) -> Iterator[CauseEffectChain]:
    topic = place.system.topics[index]
    if not place.abstract:
        plant = place.driven[index]
        releases_of_plant = Releases(plant.period_ns, plant.phase_ns)
        path = SensorPath(
            releases_of_plant, (), topic.max_age_ns, topic=topic.name, publisher=plant.name
        )
        yield CauseEffectChain(path, topic, plant)
        return
    count, shown = 0, False
    for way in _upstream_prefixes(place, place.flying_index(topic.symbol), ()):
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
            publisher=_publisher_name(way, topic),
        )
        shown = shown or (way.sensor is not None and way.sensor.name == place.plant_shown_by(index))
        yield CauseEffectChain(path, topic, way.sensor, way.nodes, way.source)
    if not count:
        raise UnfollowedError(place.sc, f"nobody publishes `{topic.name}` in the flying system")
    if not shown:
        plant_name = place.plant_shown_by(index)
        message = f"`{topic.name}` is to show `{plant_name}`, and no way leads to it from there"
        raise UnfollowedError(place.sc, message)


def _publisher_name(way: _ChainPrefix, topic: Topic) -> str:
    if way.nodes:
        return way.nodes[-1].name
    return topic.name if way.sensor is None else way.sensor.name


@dataclass(frozen=True, eq=False)
class _ChainPrefix:
    """The beginning of a path: the sensor, or None without a plant, and the nodes after it."""

    sensor: Component | None
    nodes: tuple[Component, ...]
    first: Releases
    source: bool = False
    beside: Component | None = None
    """The component at its beginning, if that is no part of the proof."""


def _upstream_prefixes(
    place: VerificationSystem, index: int, seen: tuple[Component, ...]
) -> Iterator[_ChainPrefix]:
    """Every path without circles from a sensor or a source to a topic of the flying system."""
    flat, links = place.flat, place.module.symbol.verify.abstracts
    shown = {place.home_prefix + link.instance for link in links}
    for drive in flat.inputs:
        if drive.topic == index:
            yield _ChainPrefix(None, (), Releases(drive.every_ns))
    for c in flat.components:
        if index in _topics_driven_by(c):
            beside = None if c.name in shown else c
            yield _ChainPrefix(c, (), Releases(c.period_ns, c.phase_ns), beside=beside)
        if c.node is None or c in seen or c.module == place.home.index:
            continue
        if _is_published_by(c, index):
            yield from _prefixes_through(place, c, index, seen)


def _prefixes_through(
    place: VerificationSystem, c: Component, index: int, seen: tuple[Component, ...]
) -> Iterator[_ChainPrefix]:
    """The paths to a topic whose last component is `c`, which publishes the topic."""
    assert c.node is not None
    if c.role != "node":
        if not seen:
            raise UnfollowedError(c, "the AC of another module may publish anything there")
        yield _ChainPrefix(None, (c,), Releases(1), beside=c)
        return
    require_publishes_in_every_step(c, index)
    ways = 0
    for s in c.node.subscribes:
        read = c.scope.topics[s.topic]
        if place.flat.topics[read].queue_of is not None:
            raise UnfollowedError(c, "it reads a queue, whose values may be of any age")
        for way in _upstream_prefixes(place, read, (*seen, c)):
            ways += 1
            yield replace(way, nodes=(*way.nodes, c))
    if not ways:
        yield _ChainPrefix(None, (c,), Releases(1), source=True)
