"""A system made ready to run: every piece of its code compiled once.

Purpose: what the rules look things up in: per component its code, per topic its check, and the
environment in which code sees a configuration.
Non-goals: state; a machine never changes, so one serves any number of runs and forks.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates.decision_predicates import PredicateEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.language.model.system import queues_of
from soter.semantics.externs import (
    UnboundExternError,
    extern_node,
    extern_plant,
    step_of,
)
from soter.semantics.observer_records import AC
from soter.semantics.plant_code import PlantCode, compile_plant
from soter.semantics.publication_gate import check_of
from soter.semantics.random.faults import by_component
from soter.semantics.random.random_draws import SeededDraws
from soter.semantics.stored_values import storer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.evaluate.expressions import Compiled, Extern
    from soter.language.evaluate.statements import Executed
    from soter.language.model.system import Component, Module, Property, Scope, System
    from soter.language.model.typed import FunSymbol, Variable
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.random.random_draws import Draws


STACK_DEPTH = 10_000
"""Python frames a step may need: functions that call functions nest closures in closures."""


@dataclass(frozen=True, slots=True)
class NodeCode:
    """The code of a node: `outputs` are topic indices in the order of its `publishes`.

    `queues` are the queues that it reads, `bursts` the outputs of which a step may publish several
    messages.
    """

    locals: tuple[Variable, ...]
    store: Callable[[tuple[Value, ...]], tuple[Value, ...]]
    takeover: Executed | None
    step: Executed
    outputs: tuple[int, ...]
    queues: tuple[int, ...]
    bursts: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class DmCode:
    """The predicates of a decision module; None where the program leaves them to `verify`."""

    module: Module
    ttf: Compiled | None
    safer: Compiled | None


@dataclass(frozen=True, slots=True)
class ShieldCode:
    """The code of a module's shield: its topic, that topic's next value, what is permitted.

    With `toward sc` the topic of proposals, and what each number becomes.
    """

    topic: int
    held: Compiled
    permits: Compiled
    proposed: int | None = None
    moved: tuple[Compiled, ...] = ()


class ExecutableSystem:
    """The compiled system. `externs` maps component names and extern functions to callables.

    `draws` chooses disturbances, errors, starts and inputs; by default chance, under `seed`.
    Raises `UnboundExternError` where an extern component, or an extern function that the code
    calls, has no callable.
    """

    def __init__(
        self,
        system: System,
        seed: int,
        externs: Mapping[str, object],
        draws: Draws | None = None,
    ) -> None:
        sys.setrecursionlimit(max(sys.getrecursionlimit(), STACK_DEPTH))
        self.system = system
        self.seed = seed
        self.draws = draws or SeededDraws(seed)
        self.checks = tuple([check_of(topic) for topic in system.topics])
        self.nodes: dict[int, NodeCode] = {}
        self.dms: dict[int, DmCode] = {}
        self.plants: dict[int, PlantCode] = {}
        self.shields: dict[int, ShieldCode] = {}
        """Component -> the shield of its module."""
        self._externs = externs
        self._functions = self._extern_functions()
        self._evaluators: list[Evaluator] = []
        self._aged = _sources(system)
        self._dm_of = tuple([module.dm for module in system.modules])
        self._require_bound([c.name for c in system.components if c.extern])
        for component in system.components:
            self._compile(component)
        self.timing = by_component(system, of_time=True)
        """Component -> what happens to its releases."""
        self.faults = by_component(system, of_time=False)
        """Component -> what happens to its publications and disturbances."""
        self.properties = tuple([self._property(p) for p in system.properties])
        self.contracts: dict[int, list[tuple[str, int]]] = {}
        """Component -> its contracts: kind and property index."""
        for p in system.properties:
            if p.component is not None:
                self.contracts.setdefault(p.component, []).append((p.kind, p.index))
        self._require_bound([f.name for e in self._evaluators for f in e.unbound])

    def environment(self, c: Configuration, component: Component | None = None) -> Environment:
        """What code sees of a configuration; of a component, also its period and control."""
        return Environment(
            topics=c.Topics,
            stamps=[c.stamps[i] for i in self._aged] if self._aged else c.stamps,
            time_ns=c.ct,
            period_ns=component.period_ns if component else 0,
            in_control=c.OE[component.index] if component else True,
            mode=lambda module: c.L[self._dm_of[module]],
            truth=lambda plant: c.L[plant],
            margin_ns=lambda module: self._margin_ns(c, module),
        )

    def _margin_ns(self, c: Configuration, index: int) -> int:
        """How long a module surely keeps AC in control, by what its DM saw last; 0 in SC."""
        module = self.system.modules[index]
        assert module.looked is not None, module.name
        if c.L[module.dm] != AC:
            return 0
        return module.margin_ns(c.Topics[module.looked], c.ct - c.stamps[module.looked])

    # ------------------------------------------------------------ compiling

    def _extern_functions(self) -> dict[FunSymbol, Extern]:
        functions = self.system.program.funs.values()
        return {
            f: step_of(self._externs[f.name])
            for f in functions
            if f.extern and f.name in self._externs
        }

    def _require_bound(self, names: list[str]) -> None:
        missing = [name for name in names if name not in self._externs]
        if missing:
            raise UnboundExternError(sorted(set(missing)))

    def _evaluator(self, scope: Scope) -> Evaluator:
        evaluator = Evaluator.of(scope, self._functions)
        self._evaluators.append(evaluator)
        return evaluator

    def _compile(self, component: Component) -> None:
        if component.role == "dm":
            assert component.module is not None
            self.dms[component.index] = self._dm(self.system.modules[component.module])
        elif component.plant is not None:
            self.plants[component.index] = self._plant(component)
        else:
            self.nodes[component.index] = self._node(component)
            self._shield(component)

    def _shield(self, component: Component) -> None:
        """The shield of the module whose AC or SC it is; none where it could not be computed."""
        if component.module is None:
            return
        module = self.system.modules[component.module]
        shield = module.shield
        if shield is None or shield.held is None or shield.permits is None:
            return
        evaluator = self._evaluator(module.scope)
        held, permits = evaluator.expression(shield.held), evaluator.expression(shield.permits)
        moved = tuple([evaluator.expression(e) for e in shield.moved])
        self.shields[component.index] = ShieldCode(
            shield.topic, held, permits, shield.proposed, moved
        )

    def _dm(self, module: Module) -> DmCode:
        evaluator = PredicateEvaluator.of(module.scope, self._functions)
        self._evaluators.append(evaluator)
        ttf, safer = module.symbol.ttf, module.symbol.safer
        return DmCode(
            module,
            None if ttf is None else evaluator.expression(ttf),
            None if safer is None else evaluator.expression(safer),
        )

    def _plant(self, component: Component) -> PlantCode:
        move = None
        if component.extern:
            move = extern_plant(component, step_of(self._externs[component.name]))
        evaluator = self._evaluator(component.scope)
        return compile_plant(component, evaluator, self.system.topics, move)

    def _node(self, component: Component) -> NodeCode:
        node = component.node
        assert node is not None, component.name
        evaluator = self._evaluator(component.scope)
        if component.extern:
            step = extern_node(
                self.system.topics, component, step_of(self._externs[component.name])
            )
        else:
            step = evaluator.block(node.step)
        return NodeCode(
            locals=node.locals,
            store=storer(v.type for v in node.locals),
            takeover=None if node.takeover is None else evaluator.block(node.takeover),
            step=step,
            outputs=tuple([component.scope.topics[topic] for topic in node.publishes]),
            queues=queues_of(self.system, component),
            bursts=tuple([component.scope.topics[topic] for topic in node.bursts]),
        )

    def _property(self, prop: Property) -> tuple[Compiled, bool]:
        """The condition, and the value it has to have."""
        assert prop.kind in ("always", "never", "assumes", "guarantees"), prop.kind
        return self._evaluator(prop.scope).expression(prop.condition), prop.kind != "never"


def _sources(system: System) -> tuple[int, ...]:
    """Whose stamp says how old a topic is: of a queue, its source's. Empty without queues."""
    if all(t.queue_of is None for t in system.topics):
        return ()
    return tuple([t.index if t.queue_of is None else t.queue_of for t in system.topics])
