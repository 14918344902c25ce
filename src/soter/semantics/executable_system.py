"""A system that is ready to run: every piece of its code is compiled once.

Purpose: `ExecutableSystem` has the tables of the rules: per component its code, per plant its
equations and what it drives, per topic its check, and the environment in which code sees a
configuration. Every NaN is stored as the one canonical NaN, so that states are compared as bytes.
Non-goals: state: the object never changes, so one serves any number of runs and forks; stepping
(`rules.py`, `interpreter.py`).
"""

from __future__ import annotations

import operator
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.evaluate import arithmetic
from soter.language.evaluate.arithmetic import FaultKind, StepFault, with_stored_nan
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import PredicateEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.language.model.read_together import allowed_stamp_differences, permits_on_close_reads
from soter.language.model.system import queues_read_by
from soter.language.model.tree_walk import lets_run_first, lets_that_choose
from soter.language.model.types import ArrayType, FloatType, ListType, RecordType, leaves, positions
from soter.semantics.configuration import AC
from soter.semantics.draws import SeededDraws
from soter.semantics.externs import UnboundExternError, extern_node, extern_plant, step_function
from soter.semantics.faults import group_by_component
from soter.semantics.publication_gate import check_of_topic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from soter.language.evaluate.expressions import Compiled, Extern
    from soter.language.evaluate.statements import Executed
    from soter.language.model.system import Component, Module, Property, Scope, System, Topic
    from soter.language.model.typed import FunSymbol, TypedExpr, Variable
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.draws import Draws
    from soter.semantics.externs import Move

    Store = Callable[[Value], Value]
    Named = tuple[tuple[Variable, Compiled], ...]


def stored_form_function(types: Iterable[Type]) -> Store:
    """Gives a function that replaces each NaN in a tuple by the NaN that is stored."""
    parts = [_stored_form_function(t) for t in types]
    if not any(parts):
        return _unchanged_value
    complete = [part or _unchanged_value for part in parts]
    return lambda values: tuple([f(v) for f, v in zip(complete, values, strict=True)])


def _stored_form_function(t: Type) -> Store | None:
    if isinstance(t, FloatType):
        return with_stored_nan
    if isinstance(t, RecordType):
        fields = [f for _, f in t.fields]
        return (
            stored_form_function(fields) if any(_stored_form_function(f) for f in fields) else None
        )
    if isinstance(t, (ArrayType, ListType)):
        element = _stored_form_function(t.element)
        return None if element is None else lambda values: tuple(map(element, values))
    return None


def _unchanged_value(value: Value) -> Value:
    return value


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """The sum `x + y` and the product `factor * x` for values of one `der` state."""

    add: Callable[[Value, Value], Value]
    scale: Callable[[float, Value], Value]


@dataclass(frozen=True, slots=True)
class ErrorStream:
    """A measurement error: the path to its leaf in the topic's value, its bound, its stream."""

    topic: int
    path: tuple[int, ...]
    bound: float
    stream: str


@dataclass(frozen=True, slots=True)
class PlantCode:
    """The compiled code of a plant; `move` replaces the motion of an extern plant.

    `first`: the lets that a step evaluates before all else. `chosen`: those of them that contain a
    choice, and so are not evaluated again.
    """

    component: Component
    states: tuple[Variable, ...]
    store: Callable[[tuple[Value, ...]], tuple[Value, ...]]
    first: Named
    chosen: frozenset[Variable]
    lets: Named
    der: Named
    next: Named
    arithmetic: tuple[Arithmetic, ...]
    method: str
    drives: tuple[tuple[int, Compiled], ...]
    readings: tuple[ErrorStream, ...]
    move: Move | None


def compile_plant(
    component: Component, evaluator: Evaluator, topics: Sequence[Topic], move: Move | None
) -> PlantCode:
    """Compiles a plant instance; `der` and `next` keep the order of the program."""
    plant = component.plant
    assert plant is not None, component.name

    def with_closures(pairs: Sequence[tuple[Variable, TypedExpr]]) -> Named:
        return tuple([(variable, evaluator.compiled(e)) for variable, e in pairs])

    scope = component.scope.topics
    return PlantCode(
        component=component,
        states=plant.states,
        store=stored_form_function(v.type for v in plant.states),
        first=with_closures(lets_run_first(plant)),
        chosen=frozenset(lets_that_choose(plant)),
        lets=with_closures(plant.lets),
        der=with_closures(tuple(plant.der.items())),
        next=with_closures(tuple(plant.next.items())),
        arithmetic=tuple([_state_arithmetic(v.type) for v in plant.der]),
        method=plant.method,
        drives=tuple([(scope[t], evaluator.compiled(e)) for t, e in plant.drives]),
        readings=tuple(
            [
                ErrorStream(m.topic, _leaf_at(topics[m.topic].type, m.leaf), m.bound, m.stream)
                for m in component.measured
            ]
        ),
        move=move,
    )


def _state_arithmetic(t: Type) -> Arithmetic:
    zipped, each = arithmetic.function_on_pairs(t), arithmetic.function_on_components(t)
    return Arithmetic(
        add=lambda x, y: zipped(operator.add, x, y),
        scale=lambda factor, x: each(lambda component: factor * component, x),
    )


def _leaf_at(t: Type, leaf: int) -> tuple[int, ...]:
    """Gives the positions that lead from the value to its leaf with this number."""
    return tuple(positions(t, list(leaves(t))[leaf][0]))


STACK_DEPTH = 10_000
"""Python frames that a step may need, as calls of functions nest closures."""


@dataclass(frozen=True, slots=True)
class NodeCode:
    """The code of a node; `outputs` are topic indices in the order of its `publishes`.

    `queues` are the queues that the node reads; `bursts` are the outputs of which a step may
    publish several messages.
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
    """The code of a DM's predicates; a predicate is None if `soter verify` has to compute it."""

    module: Module
    ttf: Compiled | None
    safer: Compiled | None
    together: list[tuple[int, int, int]]
    """Pairs of topics, and how many ns their stamps may differ where neither is stale."""
    goods: tuple[Compiled, ...]
    """With several plans of SC: for each whether the estimate is good."""

    def decide(
        self, env: Environment, topics: Sequence[Value]
    ) -> tuple[bool, bool, int | None, bool]:
        """Gives `ttf`, `safer`, a good plan (or None), and whether a NaN was compared.

        With several plans, the last plan is checked first. A plan whose check faults is not good.
        """
        if self.module.plan is None or not self.goods:
            ttf, nan_in_ttf = _truth_of(self.ttf, env, unknown=True)
            safer, nan_in_safer = _truth_of(self.safer, env, unknown=False)
            return ttf, safer, None, nan_in_ttf or nan_in_safer
        last, nan = topics[self.module.plan], False
        for plan in sorted(range(len(self.goods)), key=lambda k: k != last):
            good, compared = _truth_of(self.goods[plan], env, unknown=False)
            nan = nan or compared
            if good:
                return False, True, plan, nan
        return True, False, None, nan


def _truth_of(predicate: Compiled | None, env: Environment, *, unknown: bool) -> tuple[bool, bool]:
    """Gives a predicate's truth (`unknown` if missing or faulting), and whether it met a NaN."""
    if predicate is None:
        return unknown, False
    try:
        return bool(predicate(env)), False
    except StepFault as fault:
        return unknown, fault.kind is FaultKind.NONFINITE


@dataclass(frozen=True, slots=True)
class ShieldCode:
    """The code of a module's shield: its topic, the topic's next value, the check of commands.

    With `toward sc` it also has the topic of proposals and the code that moves all numbers.
    """

    topic: int
    held: Compiled
    permits: Compiled
    proposed: int | None = None
    moved: Compiled | None = None


class ExecutableSystem:
    """The compiled system. `externs` maps component names and extern functions to callables.

    `draws` chooses disturbances, errors, starts and inputs; by default it draws by chance from
    `seed`. Raises `UnboundExternError` if an extern component or a called extern function has no
    callable.
    """

    def __init__(
        self, system: System, seed: int, externs: Mapping[str, object], draws: Draws | None = None
    ) -> None:
        sys.setrecursionlimit(max(sys.getrecursionlimit(), STACK_DEPTH))
        self.system = system
        self.seed = seed
        self.draws = draws or SeededDraws(seed)
        self.checks = tuple([check_of_topic(topic) for topic in system.topics])
        self.nodes: dict[int, NodeCode] = {}
        self.dms: dict[int, DmCode] = {}
        self.plants: dict[int, PlantCode] = {}
        self.shields: dict[int, ShieldCode] = {}
        """Component -> the shield of its module."""
        self._externs = externs
        self._functions = self._extern_functions()
        self._evaluators: list[Evaluator] = []
        self._aged = _stamp_sources(system)
        self._dm_of = tuple([module.dm for module in system.modules])
        self._require_bound([c.name for c in system.components if c.extern])
        for component in system.components:
            self._compile_component(component)
        self.timing = group_by_component(system, changes_releases=True)
        """Component -> its faults that change releases."""
        self.faults = group_by_component(system, changes_releases=False)
        """Component -> its faults that change publications or disturbances."""
        self.properties = tuple([self._compile_property(p) for p in system.properties])
        self.contracts: dict[int, list[tuple[str, int]]] = {}
        """Component -> its contracts: kind and property index."""
        for p in system.properties:
            if p.component is not None:
                self.contracts.setdefault(p.component, []).append((p.kind, p.index))
        self._require_bound([f.name for e in self._evaluators for f in e.unbound])

    def environment(self, c: Configuration, component: Component | None = None) -> Environment:
        """Gives the environment in which the code of a component (or of none) reads `c`."""
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
        """Gives for how many ns AC surely keeps control after the last DM step; 0 in SC mode."""
        module = self.system.modules[index]
        assert module.looked is not None, module.name
        if c.L[module.dm] != AC:
            return 0
        return module.margin_ns(c.Topics[module.looked], c.ct - c.stamps[module.looked])

    # ------------------------------------------------------------ compiling

    def _extern_functions(self) -> dict[FunSymbol, Extern]:
        functions = self.system.program.funs.values()
        return {
            f: step_function(self._externs[f.name])
            for f in functions
            if f.extern and f.name in self._externs
        }

    def _require_bound(self, names: list[str]) -> None:
        missing = [name for name in names if name not in self._externs]
        if missing:
            raise UnboundExternError(sorted(set(missing)))

    def _evaluator_for(self, scope: Scope) -> Evaluator:
        evaluator = Evaluator.for_scope(scope, self._functions)
        self._evaluators.append(evaluator)
        return evaluator

    def _compile_component(self, component: Component) -> None:
        if component.role == "dm":
            assert component.module is not None
            self.dms[component.index] = self._compile_dm(self.system.modules[component.module])
        elif component.plant is not None:
            self.plants[component.index] = self._compile_plant(component)
        else:
            self.nodes[component.index] = self._compile_node(component)
            self._enter_shield(component)

    def _enter_shield(self, component: Component) -> None:
        """Compiles the shield that applies to a controller, if its module has a computed shield."""
        if component.module is None:
            return
        module = self.system.modules[component.module]
        shield = module.shield
        if shield is None or shield.held is None or shield.permits is None:
            return
        evaluator = self._evaluator_for(module.scope)
        held = evaluator.compiled(shield.held)
        permits = evaluator.compiled(permits_on_close_reads(self.system, module))
        moved = None if shield.moved is None else evaluator.compiled(shield.moved)
        self.shields[component.index] = ShieldCode(
            shield.topic, held, permits, shield.proposed, moved
        )

    def _compile_dm(self, module: Module) -> DmCode:
        evaluator = PredicateEvaluator.for_scope(module.scope, self._functions)
        self._evaluators.append(evaluator)
        ttf, safer = module.symbol.ttf, module.symbol.safer
        return DmCode(
            module,
            None if ttf is None else evaluator.compiled(ttf),
            None if safer is None else evaluator.compiled(safer),
            allowed_stamp_differences(self.system, module.inputs),
            tuple([evaluator.compiled(e) for e in module.goods]),
        )

    def _compile_plant(self, component: Component) -> PlantCode:
        move = None
        if component.extern:
            move = extern_plant(component, step_function(self._externs[component.name]))
        evaluator = self._evaluator_for(component.scope)
        return compile_plant(component, evaluator, self.system.topics, move)

    def _compile_node(self, component: Component) -> NodeCode:
        node = component.node
        assert node is not None, component.name
        evaluator = self._evaluator_for(component.scope)
        if component.extern:
            step = extern_node(
                self.system.topics, component, step_function(self._externs[component.name])
            )
        else:
            step = evaluator.compiled_block(node.step)
        return NodeCode(
            locals=node.locals,
            store=stored_form_function(v.type for v in node.locals),
            takeover=None if node.takeover is None else evaluator.compiled_block(node.takeover),
            step=step,
            outputs=tuple([component.scope.topics[topic] for topic in node.publishes]),
            queues=queues_read_by(self.system, component),
            bursts=tuple([component.scope.topics[topic] for topic in node.bursts]),
        )

    def _compile_property(self, prop: Property) -> tuple[Compiled, bool]:
        """Gives the compiled condition of a property and the truth value that it must have."""
        assert prop.kind in ("always", "never", "assumes", "guarantees"), prop.kind
        return self._evaluator_for(prop.scope).compiled(prop.condition), prop.kind != "never"


def _stamp_sources(system: System) -> tuple[int, ...]:
    """Gives for each topic the one whose stamp is its age: a queue's source. () without queues."""
    if all(t.queue_of is None for t in system.topics):
        return ()
    return tuple([t.index if t.queue_of is None else t.queue_of for t in system.topics])
