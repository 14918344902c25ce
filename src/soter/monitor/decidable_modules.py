"""Finds the modules that a log can decide.

Purpose: `decidable` finds the nodes of the program that can be run on the topics of a log, the
modules that then have all that their decision modules read, and what the others miss and why.
Non-goals: running anything (`log_replay.py`); whether a read is young enough (`topics_heard.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.tree_walk import calls_in, mode_reads, topic_reads

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import FunSymbol


@dataclass(frozen=True)
class Missing:
    """A topic that the log does not give, and who would have: nobody can be run for it."""

    topic: str
    why: str

    def __str__(self) -> str:
        return f"{self.topic} ({self.why})"


@dataclass(frozen=True)
class Decidable:
    """Nodes that run (component indices), modules that are decided, and what others miss.

    `blind`: decided modules whose `safe` reads more than is known, and what. `unheard`: decided
    modules that give control back after a press, of which nothing is known, and of what.
    """

    nodes: tuple[int, ...]
    modules: tuple[int, ...]
    missing: dict[int, tuple[Missing, ...]]
    blind: dict[int, tuple[Missing, ...]]
    unheard: dict[int, tuple[Missing, ...]]


def decidable(system: System, mapped: Iterable[int]) -> Decidable:
    """The modules that can be judged from these topics (indices), and what the others lack."""
    search = _Search(system, frozenset(mapped))
    search.settle()
    modules = tuple(m.index for m in system.modules if m.index in search.modules)
    missing = {m.index: search.missing(m) for m in system.modules if m.index not in search.modules}
    blind, unheard = {}, {}
    for m in modules:
        if lost := search.missing_of(topics_of_safe(system.modules[m])):
            blind[m] = lost
        if lost := search.missing_of(_reads_of_dm(system, system.modules[m])):
            unheard[m] = lost
    return Decidable(search.needed(), modules, missing, blind, unheard)


def topics_of_safe(module: Module) -> set[int]:
    """The topics that `safe` reads."""
    return {module.scope.topics[topic] for topic in topic_reads(module.symbol.safe)}


def topics_behind(system: System, nodes: Iterable[int], topics: Iterable[int]) -> set[int]:
    """These topics, and all that `nodes` read to publish them, directly or through one another."""
    reads = {n: reads_of_node(system, system.components[n]) for n in nodes}
    writes = {n: written_by_node(system.components[n]) for n in nodes}
    behind = {_source(system, i) for i in topics}
    while more := {i for n in reads if writes[n] & behind for i in reads[n]} - behind:
        behind |= more
    return behind


class _Search:
    """Begins with all nodes and modules and takes away those that miss something."""

    def __init__(self, system: System, mapped: frozenset[int]) -> None:
        self.system, self.mapped = system, mapped
        self.reads = {
            c.index: reads_of_node(system, c) for c in system.components if c.node is not None
        }
        self.writes = {c.index: written_by_node(c) for c in system.components if c.node is not None}
        self.modules = {m.index for m in system.modules}
        self.nodes = {c.index for c in system.components if c.role == "node" and not self._never(c)}

    def settle(self) -> None:
        """Take away nodes and modules that miss something, until nothing changes."""
        while True:
            have = self._have()
            nodes = {n for n in self.nodes if self.reads[n] <= have and self._modes_of_node(n)}
            modules = {m for m in self.modules if not self._lost(self.system.modules[m], have)}
            if nodes == self.nodes and modules == self.modules:
                return
            self.nodes, self.modules = nodes, modules

    def needed(self) -> tuple[int, ...]:
        """The nodes that decided modules hang on, directly or through others."""
        decided = [self.system.modules[m] for m in self.modules]
        wanted = {i for m in decided for i in (*_reads_of_dm(self.system, m), *topics_of_safe(m))}
        nodes: set[int] = set()
        while True:
            new = {n for n in self.nodes - nodes if self.writes[n] & wanted}
            if not new:
                return tuple(sorted(nodes))
            nodes |= new
            wanted |= {i for n in new for i in self.reads[n]}

    def missing(self, module: Module) -> tuple[Missing, ...]:
        """The topics at the roots of why a module cannot be decided."""
        missing_by_name: dict[str, Missing] = {}
        have = self._have()
        for name in self._functions(module):
            missing_by_name[name] = Missing(name, "a function that is not Soter")
        for other in _modes(module.scope.modules, module.symbol.predicates):
            if other not in self.modules and other != module.index:
                name = self.system.modules[other].name
                missing_by_name[name] = Missing(name, "whose mode it reads")
        self._enter_roots(_inputs(self.system, module) - have, missing_by_name, set())
        return tuple(missing_by_name.values())

    def missing_of(self, topics: set[int]) -> tuple[Missing, ...]:
        """The roots of why these topics are not known, which a decided module reads beside."""
        missing_by_name: dict[str, Missing] = {}
        self._enter_roots(topics - self._have(), missing_by_name, set())
        return tuple(missing_by_name.values())

    # ------------------------------------------------------------ what is there

    def _have(self) -> set[int]:
        """Topics that are known: of the log, of nodes that run, and what nobody ever changes."""
        nobody = {t.index for t in self.system.topics if not t.driver and t.queue_of is None}
        return {*self.mapped, *nobody}.union(*(self.writes[n] for n in self.nodes))

    def _never(self, c: Component) -> str:
        """Why a node cannot be run, if it cannot."""
        if c.extern:
            return "an extern"
        if self.writes[c.index] & self.mapped:
            return "of which the log has other topics"
        if c.takes_ns is not None:
            return "whose steps take a time that is drawn"
        assert c.node is not None
        return "which calls a function that is not Soter" if _externs(c.node.step) else ""

    def _lost(self, module: Module, have: set[int]) -> bool:
        modes = _modes(module.scope.modules, module.symbol.predicates)
        others = modes - self.modules - {module.index}
        return bool(_inputs(self.system, module) - have or others or self._functions(module))

    def _functions(self, module: Module) -> list[str]:
        return _externs(module.symbol.predicates)

    def _modes_of_node(self, n: int) -> bool:
        c = self.system.components[n]
        assert c.node is not None
        return _modes(c.scope.modules, (c.node.step,)) <= self.modules

    # ------------------------------------------------------------ why not

    def _enter_roots(
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
            elif nodes and self._never(nodes[0]):
                why = f"which `{nodes[0].name}` publishes, {self._never(nodes[0])}"
            elif nodes:
                lost = self.reads[nodes[0].index] - self._have()
                self._enter_roots(lost, missing_by_name, asked)
                if lost:
                    continue
                why = f"which `{nodes[0].name}` publishes, for a module that is not decided"
            else:
                why = "an input" if topic.driver == "input" else f"which {topic.driver} drives"
            missing_by_name[topic.name] = Missing(topic.name, why)


def _source(system: System, index: int) -> int:
    """The topic behind a queue."""
    of = system.topics[index].queue_of
    return index if of is None else of


def _inputs(system: System, module: Module) -> set[int]:
    return {_source(system, i) for i in module.inputs}


def _reads_of_dm(system: System, module: Module) -> set[int]:
    """The topics that a DM reads: its inputs, and that of a press after which it gives back."""
    return {_source(system, i) for i in module.reads}


def reads_of_node(system: System, c: Component) -> frozenset[int]:
    """The topics that a node subscribes to; behind a queue its topic."""
    assert c.node is not None
    return frozenset(_source(system, i) for i in c.reads)


def written_by_node(c: Component) -> frozenset[int]:
    """The topics that a node publishes."""
    assert c.node is not None
    return frozenset(c.scope.topics[topic] for topic in c.node.publishes)


def _modes(known: dict, code: tuple) -> set[int]:  # type: ignore[type-arg]
    """Modules whose mode is read, by index."""
    return {known[m] for m in mode_reads(*code) if m in known}


def _externs(code: object) -> list[str]:
    """Functions that are not Soter, called directly or by functions."""
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
