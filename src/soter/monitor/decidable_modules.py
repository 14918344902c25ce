"""Finds the modules that a log can decide.

Purpose: `replay_plan` finds the nodes of the program that can run on the topics of a log, the
modules that then have all that their decision modules read, and what the others miss and why.
Non-goals: running anything (`log_replay.py`); whether a read is young enough (`topics_heard.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.tree_walk import calls_in, mode_reads, topic_reads

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import FunSymbol, ModuleSymbol


@dataclass(frozen=True)
class Missing:
    """A topic that the log does not have, and why no node that publishes it can run."""

    topic: str
    why: str

    def __str__(self) -> str:
        return f"{self.topic} ({self.why})"


@dataclass(frozen=True)
class ReplayPlan:
    """The nodes to run (component indices), the modules to decide, and the topics others miss.

    By module: `missing` has the topics without which it cannot be decided. `blind` has unknown
    topics that `safe` of a decided module reads. `unheard` has unknown topics of acknowledgements.
    """

    nodes: tuple[int, ...]
    modules: tuple[int, ...]
    missing: dict[int, tuple[Missing, ...]]
    blind: dict[int, tuple[Missing, ...]]
    unheard: dict[int, tuple[Missing, ...]]


def replay_plan(system: System, mapped: Iterable[int]) -> ReplayPlan:
    """The nodes and modules that can run on these topics (indices), and what the others lack."""
    search = _Search(system, frozenset(mapped))
    search.remove_undecidable()
    modules = tuple(m.index for m in system.modules if m.index in search.modules)
    missing = {
        m.index: search.why_undecided(m) for m in system.modules if m.index not in search.modules
    }
    blind, unheard = {}, {}
    for m in modules:
        if lost := search.missing_topics(topics_of_safe(system.modules[m])):
            blind[m] = lost
        if lost := search.missing_topics(_reads_of_dm(system, system.modules[m])):
            unheard[m] = lost
    return ReplayPlan(search.needed_nodes(), modules, missing, blind, unheard)


def topics_of_safe(module: Module) -> set[int]:
    """The indices of the topics that `safe` reads."""
    return {module.scope.topics[topic] for topic in topic_reads(module.symbol.safe)}


def source_topics(system: System, nodes: Iterable[int], topics: Iterable[int]) -> set[int]:
    """The topics in `topics`, and all that `nodes` read, even indirectly, to publish them."""
    reads = {n: reads_of_node(system, system.components[n]) for n in nodes}
    writes = {n: writes_of_node(system.components[n]) for n in nodes}
    behind = {system.topics[i].source for i in topics}
    while more := {i for n in reads if writes[n] & behind for i in reads[n]} - behind:
        behind |= more
    return behind


class _Search:
    """Starts with all nodes and modules, and removes those with missing topics."""

    def __init__(self, system: System, mapped: frozenset[int]) -> None:
        self.system, self.mapped = system, mapped
        self.reads = {
            c.index: reads_of_node(system, c) for c in system.components if c.node is not None
        }
        self.writes = {c.index: writes_of_node(c) for c in system.components if c.node is not None}
        self.modules = {m.index for m in system.modules}
        self.nodes = {
            c.index for c in system.components if c.role == "node" and not self._why_not_run(c)
        }

    def remove_undecidable(self) -> None:
        """Removes nodes and modules with missing topics, until no more can be removed."""
        while True:
            have = self._known_topics()
            nodes = {
                n for n in self.nodes if self.reads[n] <= have and self._knows_modes_in_node(n)
            }
            modules = {
                m
                for m in self.modules
                if not self._lacks_reads_or_modes(self.system.modules[m], have)
            }
            if nodes == self.nodes and modules == self.modules:
                return
            self.nodes, self.modules = nodes, modules

    def needed_nodes(self) -> tuple[int, ...]:
        """The nodes on which decided modules depend, directly or through other nodes."""
        decided = [self.system.modules[m] for m in self.modules]
        wanted = {i for m in decided for i in (*_reads_of_dm(self.system, m), *topics_of_safe(m))}
        nodes: set[int] = set()
        while True:
            new = {n for n in self.nodes - nodes if self.writes[n] & wanted}
            if not new:
                return tuple(sorted(nodes))
            nodes |= new
            wanted |= {i for n in new for i in self.reads[n]}

    def why_undecided(self, module: Module) -> tuple[Missing, ...]:
        """The reasons why a module cannot be decided: what it misses, traced back to the log."""
        missing_by_name: dict[str, Missing] = {}
        have = self._known_topics()
        for name in _extern_names(module.symbol.predicates):
            missing_by_name[name] = Missing(name, "a function that is not Soter")
        for other in _modules_of_read_modes(module.scope.modules, module.symbol.predicates):
            if other not in self.modules and other != module.index:
                name = self.system.modules[other].name
                missing_by_name[name] = Missing(name, "whose mode it reads")
        self._enter_missing(_topics_of_inputs(self.system, module) - have, missing_by_name, set())
        return tuple(missing_by_name.values())

    def missing_topics(self, topics: set[int]) -> tuple[Missing, ...]:
        """The missing topics that explain why some of these topics are not known."""
        missing_by_name: dict[str, Missing] = {}
        self._enter_missing(topics - self._known_topics(), missing_by_name, set())
        return tuple(missing_by_name.values())

    # ------------------------------------------------------------ what is there

    def _known_topics(self) -> set[int]:
        """The topics in the log, the topics of running nodes, and topics that never change."""
        nobody = {t.index for t in self.system.topics if not t.driver and t.queue_of is None}
        return {*self.mapped, *nobody}.union(*(self.writes[n] for n in self.nodes))

    def _why_not_run(self, c: Component) -> str:
        """The reason why a node can never be run, in words; "" if it can."""
        if c.extern:
            return "an extern"
        if self.writes[c.index] & self.mapped:
            return "of which the log has other topics"
        if c.takes_ns is not None:
            return "whose steps take a time that is drawn"
        assert c.node is not None
        return "which calls a function that is not Soter" if _extern_names(c.node.step) else ""

    def _lacks_reads_or_modes(self, module: Module, have: set[int]) -> bool:
        modes = _modules_of_read_modes(module.scope.modules, module.symbol.predicates)
        others = modes - self.modules - {module.index}
        return bool(
            _topics_of_inputs(self.system, module) - have
            or others
            or _extern_names(module.symbol.predicates)
        )

    def _knows_modes_in_node(self, n: int) -> bool:
        c = self.system.components[n]
        assert c.node is not None
        return _modules_of_read_modes(c.scope.modules, (c.node.step,)) <= self.modules

    # ------------------------------------------------------------ why not

    def _enter_missing(
        self, topics: Iterable[int], missing_by_name: dict[str, Missing], asked: set[int]
    ) -> None:
        for i in sorted(topics):
            if i in asked:
                continue
            asked.add(i)
            topic = self.system.topics[i]
            writers = [n for n, written in self.writes.items() if i in written]
            nodes = [self.system.components[n] for n in writers]
            if any(c.role in ("ac", "sc") for c in nodes):
                why = f"which the controllers of {topic.driver} publish"
            elif nodes and self._why_not_run(nodes[0]):
                why = f"which `{nodes[0].name}` publishes, {self._why_not_run(nodes[0])}"
            elif nodes:
                lost = self.reads[nodes[0].index] - self._known_topics()
                self._enter_missing(lost, missing_by_name, asked)
                if lost:
                    continue
                why = f"which `{nodes[0].name}` publishes, for a module that is not decided"
            else:
                why = "an input" if topic.driver == "input" else f"which {topic.driver} drives"
            missing_by_name[topic.name] = Missing(topic.name, why)


def _topics_of_inputs(system: System, module: Module) -> set[int]:
    return {system.topics[i].source for i in module.inputs}


def _reads_of_dm(system: System, module: Module) -> set[int]:
    """The topics that a DM reads: its inputs, and the topic of its acknowledgement."""
    return {system.topics[i].source for i in module.reads}


def reads_of_node(system: System, c: Component) -> frozenset[int]:
    """The topics that a node subscribes to; for a queue, the topic that fills it."""
    assert c.node is not None
    return frozenset(system.topics[i].source for i in c.reads)


def writes_of_node(c: Component) -> frozenset[int]:
    """The topics that a node publishes."""
    assert c.node is not None
    return frozenset(c.scope.topics[topic] for topic in c.node.publishes)


def _modules_of_read_modes(
    known: Mapping[ModuleSymbol | str, int], code: tuple[object, ...]
) -> set[int]:
    """The indices of the modules whose mode this code reads."""
    return {known[m] for m in mode_reads(*code) if m in known}


def _extern_names(code: object) -> list[str]:
    """The names of extern functions that this code calls, directly or indirectly."""
    names: dict[str, None] = {}
    asked: set[FunSymbol] = set()
    todo = [c.fun for c in calls_in(code)]
    while todo:
        fun = todo.pop()
        if fun in asked:
            continue
        asked.add(fun)
        if fun.extern:
            names[fun.name] = None
        todo += [c.fun for c in calls_in(fun.body or ())]
    return list(names)
