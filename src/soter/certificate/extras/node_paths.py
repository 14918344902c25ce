"""Nodes between the plants and a module in the system that runs, checked again: an extra.

Purpose: `NodeWays` finds the nodes from a sensor to what DM and SC read, and from what SC publishes
to the plant, with their declared times; `NodePath`, `NodeEffect` say what they add to ages, delays.
`check_ways` checks that what is read shows one instant, where nodes or silent sensors may differ.
Non-goals: what those nodes compute: that is an assumption, and named (`Ways.notes`).

As in `derived_times.py` what is asked is the worst schedule: every node runs by
itself, its runs neither overlap nor overtake, and of two that act in one instant either may come
first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.certificate.reading.derived_times import (
    NOW,
    Clock,
    Effect,
    TopicPath,
    Ways,
    path_of_plant,
    releases_in_hyperperiod,
)
from soter.certificate.reading.module_facts import DiffersError, driven_topics
from soter.certificate.reading.supported_constructs import code_parts
from soter.certificate.report import NotRecheckedError
from soter.language.model import typed
from soter.language.model.system import name_of_subsystem
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from soter.certificate.reading.derived_times import TimingSetting, TopicReading
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Said
    from soter.language.model.system import Component, System


NODES_MAX = 16
"""Nodes on a path, at most: no person wrote a longer one."""
LOOKS_MAX = 20_000
"""The most looks at topics, on all ways together."""

TEXTS = {
    "shows": "what {} publishes shows the state that it has just read, within the errors",
    "passes": "{} passes on what the module publishes at its next step, which is counted; what "
    "it makes of a command belongs to the plants of the proof",
    "in step": "{} runs in the thread of the module, behind SC in the same instant; what it "
    "makes of a command belongs to the plants of the proof, and no wait of it is counted "
    "beside `acts within`",
    "vehicle": "{} is part of the vehicle that is abstracted: its last value is its state, and "
    "what stands behind it, delays included, belongs to the abstraction",
    "extern": "{} publishes in every step",
    "beside": "{}, of which the proof knows nothing, is heard by nodes before the module: "
    "whatever it says, and however old that is, they show the plants of the proof",
}
"""The assumption on a node, by the kind of a note."""


@dataclass(frozen=True)
class NodePath(TopicPath):
    """The path of a topic from a sensor through a chain of nodes."""

    nodes: tuple[Clock, ...] = ()

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The clocks of the sensor and of the nodes after it."""
        return (self.sensor, *self.nodes)

    @property
    def path_before_last_node(self) -> TopicPath:
        """The path of the topic that the last node of this path reads."""
        rest = self.nodes[:-1]
        return NodePath(self.sensor, rest) if rest else TopicPath(self.sensor)

    def oldest_stamp(self, time: int) -> int:
        """The oldest stamp, in ns, that a read at `time` may show, long after the start.

        A reader certainly sees what a node published at release t only later than t + its longest
        run: at that very instant, the module's reader may come first. So the oldest stamp that may
        be seen is of the last release t with t + longest run < time; that publication happened at t
        at the earliest.
        """
        node = self.nodes[-1]
        return node.last_release(time - node.max_delay - 1)

    def oldest_state(self, time: int) -> int:
        """The oldest time of a state that a read at `time` may show, long after the start.

        What may be seen of a node does not get older with time, so the read is oldest if the node's
        step starts at its release.
        """
        return self.path_before_last_node.oldest_state(self.oldest_stamp(time))

    def age_peaks(self, start: int, end: int) -> Iterator[int]:
        """The times in [start, end] at which a read may be oldest: just before its age falls."""
        node = self.nodes[-1]
        yield from node.times_at_phase(start, end, node.phase + node.max_delay)
        yield end

    def longest_lag(self, silent: int) -> int:
        """P, the longest time from a state to its publication; longer if the sensor is silent."""
        node, before = self.nodes[-1], self.path_before_last_node
        worst = 0
        for t in releases_in_hyperperiod(node, [c.period for c in self.clocks]):
            for s in before.age_peaks(t, t + node.late):
                worst = max(worst, s + node.response - before.oldest_state(s))
        return worst + silent

    def certain_since(self, silent: int = 0) -> int:
        """The time from which a read certainly shows a state, if the sensor is silent for `silent`.

        It adds one ns, as a read sees only what was published before it.
        """
        return self._first_release_with_state(silent) + self.nodes[-1].max_delay + 1

    def _first_release_with_state(self, silent: int) -> int:
        """The first release of the last node from which on it certainly publishes a state."""
        return self.nodes[-1].next_release(self.path_before_last_node.certain_since(silent))

    def may_publish_nothing(self, silent: int = 0) -> bool:
        """Whether a new publication may rest on a default, so that it shows no state."""
        return self._first_release_with_state(silent) > self.nodes[-1].phase


@dataclass(frozen=True)
class NodeEffect(Effect):
    """The delay of an output through nodes: `least` to `most` after the last node publishes."""

    nodes: tuple[Clock, ...] = ()

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The clocks of the nodes on the way."""
        return self.nodes

    def earliest_action(self, published: int) -> int:
        """The earliest time at which an output published at `published` may act."""
        at = published
        for node in self.nodes:
            # the first release whose start may be as late as that; in one instant it is seen
            t = at - node.late + (node.phase - at + node.late) % node.period
            at = max(t, at)
        return super().earliest_action(at)

    def latest_action(self, published: int, *, at_once: bool) -> int:
        """The latest time at which the output may act; `at_once`: nodes starting then see it.

        A node that starts just before the publication sees nothing. Its first release after that
        sees the output, and may start and publish as late as its times allow.
        """
        at, seen = published, at_once
        for node in self.nodes:
            at = node.next_release(at if seen else at + 1) + node.max_delay
            seen = False
        return super().latest_action(at, at_once=seen)


@dataclass
class NodeWays(Ways):
    """The ways of a module over nodes, and to what belongs to an abstraction."""

    number: Callable[[typed.TypedExpr], int]
    """The value of a time of the `verify` block."""
    looked: int = 0
    """The number of looks at topics until now."""

    # ------------------------------------------------------------ towards the module

    def _paths_to(self, index: int, behind: tuple[int, ...]) -> list[TopicPath]:
        """The ways to a topic; `behind` lists the nodes that were already followed."""
        self._count_followed_way()
        paths: list[TopicPath] = []
        for c in self._publishers_of(index):
            if c.plant is not None:
                if self._is_proved_plant(c):
                    paths.append(path_of_plant(c))
                else:
                    self.notes["beside", c.name] = None
                continue
            if c.role != "node":
                self.notes["beside", c.name] = None
                continue
            if c.index in behind:
                continue  # what it feeds back to itself
            if len(behind) >= NODES_MAX:
                raise NotRecheckedError(f"more than {NODES_MAX} nodes on a path")
            paths += self._paths_by_node(c, index, (*behind, c.index))
        return paths

    def _paths_by_node(self, c: Component, index: int, behind: tuple[int, ...]) -> list[TopicPath]:
        """The paths to a topic through a node, whose publications are as old as its reads.

        A node behind the module that reads no sensor belongs to the abstracted vehicle: its state
        is the value that it last published.
        """
        assert c.node is not None
        topics = _node_reads(self.system, c)
        if before := [p for i in topics for p in self._paths_to(i, behind)]:
            self._require_each_step(c, index)
            self._note_undeclared(c)
            self.notes["shows", c.name] = None
            for i in topics:
                if not self._paths_to(i, behind) and self._obeys_module(i, behind):
                    self.notes["vehicle", self.system.topics[i].name] = None
            return [NodePath(p.sensor, (*p.clocks[1:], self._clock_of(c))) for p in before]
        if len(behind) == 1 and any(self._obeys_module(i, behind) for i in topics):
            self._require_each_step(c, index)
            self._note_undeclared(c)
            self.notes["vehicle", self.system.topics[index].name] = None
            return [NodePath(NOW, (self._clock_of(c),))]
        return []

    def _obeys_module(self, index: int, behind: tuple[int, ...]) -> bool:
        """Whether a topic depends on outputs of the module, through nodes alone."""
        self._count_followed_way()
        if index in self.module.outputs:
            return True
        for c in self._publishers_of(index):
            if c.role == "node" and c.index not in behind and len(behind) < NODES_MAX:
                more = (*behind, c.index)
                if any(self._obeys_module(i, more) for i in _node_reads(self.system, c)):
                    return True
        return False

    # ------------------------------------------------------------ from the module

    def find_effects(self, least: int, most: int) -> tuple[Effect, ...]:
        """The ways from all outputs to the plants or to nodes of the abstracted vehicle.

        Raises NotRecheckedError if an output leads nowhere.
        """
        effects: list[Effect] = []
        for index in self.module.outputs:
            ends = [NodeEffect(least, most, nodes) for nodes in self._routes_from(index, (), ())]
            if not ends:
                name = self.system.topics[index].name
                raise NotRecheckedError(f"no plant feels `{name}` in `{self.system.name}`")
            effects += ends
        return tuple(dict.fromkeys(effects))

    def _routes_from(
        self, index: int, nodes: tuple[Clock, ...], behind: tuple[int, ...]
    ) -> Iterable[tuple[Clock, ...]]:
        self._count_followed_way()
        vehicle = {name for kind, name in self.notes if kind == "vehicle"}
        if behind and self.system.topics[index].name in vehicle:
            return [nodes]
        routes: list[tuple[Clock, ...]] = []
        for c in self.system.components:
            if c.plant is not None and index in c.reads:
                routes.append(nodes)
            other = c.module != self.module.index  # what the module itself publishes is a command
            if c.role in ("ac", "sc") and other and self._reads_or_queues(c, index):
                name = self.system.topics[index].name
                raise NotRecheckedError(f"`{c.name}` of another module reads `{name}`")
            if c.role != "node" or c.index in behind or index not in _node_reads(self.system, c):
                continue
            if len(behind) >= NODES_MAX:
                raise NotRecheckedError(f"more than {NODES_MAX} nodes on a path")
            routes += self._routes_through_node(c, nodes, behind)
        return routes

    def _routes_through_node(
        self, c: Component, nodes: tuple[Clock, ...], behind: tuple[int, ...]
    ) -> Iterable[tuple[Clock, ...]]:
        assert c.node is not None
        for topic in c.node.publishes:
            after = c.scope.topics[topic]
            step = self._is_released_with_sc(c, nodes, behind)
            on = nodes if step else (*nodes, self._clock_of(c))
            if ends := list(self._routes_from(after, on, (*behind, c.index))):
                self._require_each_step(c, after)
                if not step:
                    self._note_undeclared(c)
                self.notes["in step" if step else "passes", c.name] = None
            yield from ends

    def _is_released_with_sc(
        self, c: Component, nodes: tuple[Clock, ...], behind: tuple[int, ...]
    ) -> bool:
        """Whether a node is released with SC, after all nodes before it, and declares no times.

        It is then assumed (and printed) to run in the module's thread behind SC, and to pass an
        output on in the instant of its publication. An extern runs in a separate process unless the
        system takes it into the thread.
        """
        sc = self.system.components[self.module.sc]
        verify = self.module.symbol.verify
        bounded = {**verify.late_of, **verify.response_of}
        if nodes or c.takes_ns is not None or any(n in bounded for n in self._names_of_node(c)):
            return False
        if (c.extern and not c.inline) or (behind and behind[-1] > c.index):
            return False
        meets = sc.period_ns % c.period_ns == 0 and (sc.phase_ns - c.phase_ns) % c.period_ns == 0
        return meets and c.phase_ns <= sc.phase_ns

    # ------------------------------------------------------------ parts

    def _count_followed_way(self) -> None:
        self.looked += 1
        if self.looked > LOOKS_MAX:
            raise NotRecheckedError("more ways between plants and module than are followed")

    def _names_of_node(self, c: Component) -> list[str]:
        """The names by which the `verify` block may call a node."""
        home = name_of_subsystem(self.module)
        return [c.name, c.name.removeprefix(f"{home}.") if home else c.name]

    def _is_proved_plant(self, c: Component) -> bool:
        """Whether a plant is part of the proof: `abstracts` names it, or names no plant."""
        links = self.module.symbol.verify.abstracts
        return not links or any(link.instance in self._names_of_node(c) for link in links)

    def _publishers_of(self, index: int) -> list[Component]:
        """The plants, nodes, and controllers of other modules that publish a topic."""
        return [
            c
            for c in self.system.components
            if index in c.writes and (c.plant is not None or c.module != self.module.index)
        ]

    def _reads_or_queues(self, c: Component, index: int) -> bool:
        return any(index in (i, self.system.topics[i].queue_of) for i in c.reads)

    def _require_each_step(self, c: Component, index: int) -> None:
        """NotRecheckedError unless a node publishes a topic in every step; assumed of an extern."""
        assert c.node is not None
        if c.node.extern:
            self.notes["extern", c.name] = None
        elif not any(
            _always_publishes(c.node.step, t) for t, i in c.scope.topics.items() if i == index
        ):
            name = self.system.topics[index].name
            raise NotRecheckedError(f"`{c.name}` may not publish `{name}` in every step")

    def _clock_of(self, c: Component) -> Clock:
        """The clock of a node; undeclared times count as zero."""
        late, response = (self._declared_time(c, of) for of in ("late_of", "response_of"))
        clock = Clock(c.name, c.period_ns, c.phase_ns, late or 0, response or 0)
        if clock.max_delay > clock.period:
            raise NotRecheckedError(f"a run of `{c.name}` may not be over when the next one is due")
        return clock

    def _note_undeclared(self, c: Component) -> None:
        """Notes a node on a path if its times are undeclared and therefore assumed."""
        if None in (self._declared_time(c, "late_of"), self._declared_time(c, "response_of")):
            self.undeclared[c.name] = None

    def _declared_time(self, c: Component, of: str) -> int | None:
        """A time that the `verify` block or the node declares for a node; None if neither does."""
        if of == "response_of" and c.takes_ns is not None:
            return c.takes_ns[1]
        times: dict[str, typed.TypedExpr] = getattr(self.module.symbol.verify, of)
        expr = next((times[n] for n in self._names_of_node(c) if n in times), None)
        return None if expr is None else self.number(expr)


def _node_reads(system: System, c: Component) -> list[int]:
    """The topics that a node reads. Raises NotRecheckedError for a queue, whose age is unknown."""
    assert c.node is not None
    topics = []
    for s in c.node.subscribes:
        index = c.scope.topics[s.topic]
        if s.queue is not None or system.topics[index].queue_of is not None:
            index = system.topics[index].queue_of or index
            raise NotRecheckedError(f"`{c.name}` reads a queue of `{system.topics[index].name}`")
        topics.append(index)
    return topics


def _always_publishes(body: tuple[typed.TypedStmt, ...], topic: typed.TopicSymbol) -> bool:
    """Whether statements always publish a topic, whatever they read."""

    def is_publishing(s: typed.TypedStmt) -> bool:
        if isinstance(s, typed.TypedIf):
            return all(_always_publishes(b, topic) for b in (*(b for _, b in s.arms), s.otherwise))
        return isinstance(s, typed.TypedPublish) and s.topic is topic

    return any(map(is_publishing, body))


def node_assumptions(ways: Ways) -> Said:
    """The assumptions about nodes between the plants and the module."""
    for kind, name in ways.notes:
        yield f"{kind} {name}", TEXTS[kind].format(name)
    yield "nodes run", "no node between plants and module faults or skips a step"


# ---------------------------------------------------------------- instants that are shown


def check_ways(facts: Facts, setting: TimingSetting, reads: tuple[list[int], list[int]]) -> None:
    """Raises DiffersError unless an estimate shows one instant and SC sees each state with one age.

    The DM compares the stamps of messages from plants. The stamp of a node does not show what the
    node has read: all numbers of the estimate must get that by the same way, and from one topic if
    sensors may be silent. In chains and tubes each state that SC reads has one age, so no state may
    come through two topics of different ages, nor through two numbers of one topic that is made of
    several reads.
    """
    by_dm, by_sc = (
        {w for r in of for w in _plant_ways(facts, r)} for of in (setting.by_dm, setting.by_sc)
    )
    numbers = sum(1 for i in reads[0] for _ in leaves(facts.system.topics[i].type))
    apart = len({clocks for clocks, _ in by_dm}) > 1 < numbers
    if setting.silent and any(clocks[1:] for clocks, _ in by_dm):
        apart |= len({name for _, name in by_dm}) > 1
    if apart:
        raise DiffersError("what the DM reads may show several instants, and no stamp tells")
    if _instant_count(by_sc, setting) < 2:
        return
    shown = []
    for read, index in zip(setting.by_sc, reads[1], strict=True):
        plant, published = driven_topics(facts)[index]
        apart = _instant_count(_plant_ways(facts, read), setting) > 1
        parts = _number_expressions(published) if apart else [published]
        shown += [_variables_behind(plant, part) for part in parts]
    twice = sum(map(len, shown)) > len(set[object]().union(*shown))
    if twice:
        raise DiffersError("what SC reads may show several instants, and counts as one")


def _instant_count(ways: Iterable[tuple[tuple[Clock, ...], str]], setting: TimingSetting) -> int:
    """How many instants ways show at most: the number of different ways, or of silent topics."""
    every = set(ways)
    heard = {name for _, name in every} if setting.silent else set()
    return max(len({clocks for clocks, _ in every}), len(heard))


def _number_expressions(published: typed.TypedExpr) -> list[typed.TypedExpr]:
    """The expression of each number in a value; the value's expression if it has no parts."""
    if isinstance(published, typed.Aggregate):
        return [x for e in published.elements for x in _number_expressions(e)]
    return [published for _ in leaves(published.type)]


def _plant_ways(facts: Facts, read: TopicReading) -> Iterator[tuple[tuple[Clock, ...], str]]:
    """The ways of a topic from plants, as clocks, each with the plant's topic where it starts.

    Plants of the same period and phase share a clock.
    """
    for path in read.paths:
        clocks = (replace(path.clocks[0], name=""), *path.clocks[1:])
        if path.sensor is NOW:
            continue
        if len(clocks) == 1:
            yield clocks, read.name
            continue
        plant, first = (facts.flying.component(c.name) for c in path.clocks[:2])
        for index in {*plant.writes} & {*first.reads}:
            yield clocks, facts.flying.topics[index].name


def _variables_behind(plant: Component, published: typed.TypedExpr) -> set[tuple[int, object]]:
    """The variables from which a plant computes a published value, also through its lets."""
    assert plant.plant is not None
    lets: dict[object, object] = dict(plant.plant.lets)
    todo: list[object] = [published]
    found: set[tuple[int, object]] = set()
    while todo:
        for part in code_parts([todo.pop()]):
            if isinstance(part, typed.VarRead) and (plant.index, part.variable) not in found:
                found.add((plant.index, part.variable))
                todo += [lets[part.variable]] if part.variable in lets else []
    return found
