"""Who stands between the plants and a module, in the system that runs.

Purpose: from the flattened system to the `TimingSetting` of `derived_times.py`: the nodes from a
sensor to what DM and SC read, and from what SC publishes to the plant, with their declared times.
Non-goals: what follows from them (`derived_times.py`); what those nodes compute: that is an
assumption, and named (`Ways.notes`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.derived_times import (
    Clock,
    Effect,
    TimingSetting,
    TopicPath,
    TopicReading,
)
from soter.certificate.tower import tower_of
from soter.language.model import typed
from soter.language.model.system import holder_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from soter.language.model.system import Component, Module, System

NODES_MAX = 16
"""On a path; more is no path that a person wrote."""
LOOKS_MAX = 20_000
"""At topics, on all ways together."""
NOW = Clock("now", 1)
"""What shows the state of the very instant in which it is read."""


@dataclass
class ModulePaths:
    """The paths of a module; `notes`: what has to be assumed of those on them, by kind and name."""

    system: System
    module: Module
    number: Callable[[typed.TypedExpr], int]
    """The value of a time of the `verify` block."""
    notes: dict[tuple[str, str], None] = field(default_factory=dict)
    undeclared: dict[str, None] = field(default_factory=dict)
    """Nodes on the paths whose times are not declared."""
    looked: int = 0
    """How often a topic was looked at."""

    @cached_property
    def own(self) -> set[int]:
        """The module, and those above and below it: what they publish is a command."""
        return {m.index for m in tower_of(self.system, self.module)}

    # ------------------------------------------------------------ towards the module

    def to(self, index: int) -> tuple[TopicPath, ...]:
        """All ways from a sensor to a topic; `NotRecheckedError` where there is none."""
        paths = self._to(index, ())
        if not paths:
            name = self.system.topics[index].name
            raise NotRecheckedError(f"no plant stands behind `{name}` in `{self.system.name}`")
        return tuple(dict.fromkeys(paths))

    def _to(self, index: int, behind: tuple[int, ...]) -> list[TopicPath]:
        """The same for a part of it; `behind`: the nodes that were followed already."""
        self._looks()
        paths: list[TopicPath] = []
        for c in self._writers(index):
            if c.plant is not None:
                if self._of_the_proof(c):
                    paths.append(TopicPath(Clock(c.name, c.period_ns, c.phase_ns)))
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
            paths += self._over(c, index, (*behind, c.index))
        return paths

    def _over(self, c: Component, index: int, behind: tuple[int, ...]) -> list[TopicPath]:
        """What a node publishes is as old as what it reads; what it is itself is as it publishes.

        A node behind the module that reads no sensor on its own is part of what is abstracted:
        its state is what it last published.
        """
        assert c.node is not None
        read = _subscribed(self.system, c)
        before = [p for i in read for p in self._to(i, behind)]
        if before:
            self._steps(c, index)
            self._noted(c)
            self.notes["shows", c.name] = None
            for i in read:
                if not self._to(i, behind) and self._commanded(i, behind):
                    self.notes["vehicle", self.system.topics[i].name] = None
            return [TopicPath(p.sensor, (*p.nodes, self._clock(c))) for p in before]
        if len(behind) == 1 and any(self._commanded(i, behind) for i in read):
            self._steps(c, index)
            self._noted(c)
            self.notes["vehicle", self.system.topics[index].name] = None
            return [TopicPath(NOW, (self._clock(c),))]
        return []

    def _commanded(self, index: int, behind: tuple[int, ...]) -> bool:
        """Whether a topic depends on what the module publishes, by nodes alone."""
        self._looks()
        if index in self.module.outputs:
            return True
        for c in self._writers(index):
            if c.role == "node" and c.index not in behind and len(behind) < NODES_MAX:
                more = (*behind, c.index)
                if any(self._commanded(i, more) for i in _subscribed(self.system, c)):
                    return True
        return False

    # ------------------------------------------------------------ from the module

    def effects(self, least: int, most: int) -> tuple[Effect, ...]:
        """All ways from an output to the plants, or to what belongs to the vehicle.

        NotRecheckedError where an output has none.
        """
        effects: list[Effect] = []
        for index in self.module.outputs:
            ends = [Effect(nodes, least, most) for nodes in self._from(index, (), ())]
            if not ends:
                name = self.system.topics[index].name
                raise NotRecheckedError(f"no plant feels `{name}` in `{self.system.name}`")
            effects += ends
        return tuple(dict.fromkeys(effects))

    def _from(
        self, index: int, nodes: tuple[Clock, ...], behind: tuple[int, ...]
    ) -> Iterable[tuple[Clock, ...]]:
        self._looks()
        vehicle = {name for kind, name in self.notes if kind == "vehicle"}
        if behind and self.system.topics[index].name in vehicle:
            return [nodes]
        routes: list[tuple[Clock, ...]] = []
        for c in self.system.components:
            if c.plant is not None and index in {c.scope.topics[t] for t in c.plant.reads}:
                routes.append(nodes)
            if c.role != "node" or c.index in behind or index not in _subscribed(self.system, c):
                continue
            if len(behind) >= NODES_MAX:
                raise NotRecheckedError(f"more than {NODES_MAX} nodes on a path")
            assert c.node is not None
            for topic in c.node.publishes:
                after = c.scope.topics[topic]
                step = self._in_step(c, nodes, behind)
                on = nodes if step else (*nodes, self._clock(c))
                ends = list(self._from(after, on, (*behind, c.index)))
                if ends:
                    self._steps(c, after)
                    if not step:
                        self._noted(c)
                    self.notes["in step" if step else "passes", c.name] = None
                routes += ends
        return routes

    def _in_step(self, c: Component, nodes: tuple[Clock, ...], behind: tuple[int, ...]) -> bool:
        """Whether a node is released whenever SC is, behind all before it, and says no times.

        Then it is taken to run in the module's thread, behind SC (an assumption, printed): it
        passes an output on in the instant in which it is published.
        """
        sc = self.system.components[self.module.sc]
        verify = self.module.symbol.verify
        said = {**verify.late_of, **verify.response_of}
        if nodes or c.takes_ns is not None or any(n in said for n in self._names(c)):
            return False
        if behind and behind[-1] > c.index:
            return False
        meets = sc.period_ns % c.period_ns == 0 and (sc.phase_ns - c.phase_ns) % c.period_ns == 0
        return meets and c.phase_ns <= sc.phase_ns

    # ------------------------------------------------------------ parts

    def _looks(self) -> None:
        self.looked += 1
        if self.looked > LOOKS_MAX:
            raise NotRecheckedError("more ways between plants and module than are followed")

    def _names(self, c: Component) -> list[str]:
        """How the `verify` block may call a node."""
        home = holder_of(self.system, self.module)
        return [c.name, c.name.removeprefix(f"{home}.") if home else c.name]

    def _of_the_proof(self, c: Component) -> bool:
        """Whether a plant is one that `abstracts` names; all are where it names none."""
        links = self.module.symbol.verify.abstracts
        return not links or any(link.instance in self._names(c) for link in links)

    def _writers(self, index: int) -> list[Component]:
        """Plants, nodes, and controllers of other modules that publish a topic."""
        writers = []
        for c in self.system.components:
            if c.plant is not None:
                written = [t for t, _ in c.plant.drives]
            elif c.node is not None and c.module not in self.own:
                written = list(c.node.publishes)
            else:
                continue
            if index in {c.scope.topics[t] for t in written}:
                writers.append(c)
        return writers

    def _steps(self, c: Component, index: int) -> None:
        """That a node publishes a topic in every step: seen, or of an extern assumed."""
        assert c.node is not None
        if c.node.extern:
            self.notes["extern", c.name] = None
        elif not any(_always(c.node.step, t) for t, i in c.scope.topics.items() if i == index):
            name = self.system.topics[index].name
            raise NotRecheckedError(f"`{c.name}` may not publish `{name}` in every step")

    def _clock(self, c: Component) -> Clock:
        """When a node steps; its times are zero where they are not declared."""
        late, response = (self._declared(c, of) for of in ("late_of", "response_of"))
        clock = Clock(c.name, c.period_ns, c.phase_ns, late or 0, response or 0)
        if clock.slow > clock.period:
            raise NotRecheckedError(f"a run of `{c.name}` may not be over when the next one is due")
        return clock

    def _noted(self, c: Component) -> None:
        """That the times of a node on a path are assumed where they are not declared."""
        if None in (self._declared(c, "late_of"), self._declared(c, "response_of")):
            self.undeclared[c.name] = None

    def _declared(self, c: Component, of: str) -> int | None:
        """A time of a node, where the `verify` block has one, or the node says it itself."""
        if of == "response_of" and c.takes_ns is not None:
            return c.takes_ns[1]
        times: dict[str, typed.TypedExpr] = getattr(self.module.symbol.verify, of)
        expr = next((times[n] for n in self._names(c) if n in times), None)
        return None if expr is None else self.number(expr)


def _subscribed(system: System, c: Component) -> list[int]:
    """The topics that a node reads; a queue shows old values, and nobody says how old."""
    assert c.node is not None
    topics = []
    for s in c.node.subscribes:
        index = c.scope.topics[s.topic]
        if s.queue is not None or system.topics[index].queue_of is not None:
            index = system.topics[index].queue_of or index
            raise NotRecheckedError(f"`{c.name}` reads a queue of `{system.topics[index].name}`")
        topics.append(index)
    return topics


def _always(body: tuple[typed.TypedStmt, ...], topic: typed.TopicSymbol) -> bool:
    """Whether a body publishes a topic whatever it reads."""
    for s in body:
        if isinstance(s, typed.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, typed.TypedIf):
            sides = [b for _, b in s.arms] + [s.otherwise]
            if all(_always(b, topic) for b in sides):
                return True
    return False


def setting_of(
    ways: ModulePaths, by_dm: dict[int, int], by_sc: dict[int, int], times: dict[str, int]
) -> TimingSetting:
    """Everything together. `by_dm`, `by_sc`: topics of the running system and their `max_age`."""
    system, module = ways.system, ways.module
    dm, sc = system.components[module.dm], system.components[module.sc]

    def reads(topics: dict[int, int]) -> tuple[TopicReading, ...]:
        return tuple(
            TopicReading(system.topics[i].name, ways.to(i), age) for i, age in topics.items()
        )

    found_dm, found_sc = reads(by_dm), reads(by_sc)  # before effects: they say what is vehicle
    return TimingSetting(
        Clock("the DM", module.period_ns, dm.phase_ns, times["J_dm_ns"], times["R_dm_ns"]),
        Clock("SC", sc.period_ns, sc.phase_ns, times["J_sc_ns"], times["R_sc_ns"]),
        found_dm,
        found_sc,
        ways.effects(0, times["L_ns"]),
        times["silent_ns"],
        bool(times["instants"]),
    )
