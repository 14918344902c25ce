"""The functions of an enclosure: SC, plants and predicates of a verification system.

Purpose: an `EnclosedFunction` emits one of them: SC's commands from its reads, the plants'
derivatives or next states from what acts on them, or a predicate on true or estimated topics.
Non-goals: printing (`compiled_enclosures.py`), statements (`core_enclosure.py`).
"""

from __future__ import annotations

import math
import sys
from fractions import Fraction
from functools import reduce
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.lower_statements import FunctionTable
from soter.core.steps import lower_dm_predicate, lower_predicate
from soter.language.model.types import FloatType, IntType, RecordType, leaves
from soter.verify.enclose.core_enclosure import EnclosureBody
from soter.verify.enclose.enclosed_operations import UNKNOWN, EnclosureOperations, kind_of
from soter.verify.enclose.enclosure_emitter import (
    FAULT,
    AggregateParts,
    EnclosureError,
    FloatRange,
    Form,
    Item,
    KnownInt,
    KnownTruth,
    Sequence,
    float_literal,
    rounded_down,
)
from soter.verify.enclose.enclosure_inputs import EnclosureInputs, leaf_key, leaf_values

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.codegen import c_tree as c
    from soter.language.model.system import Bound, Component, Module, System
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type
    from soter.verify.enclose.enclosure_emitter import Emitter
    from soter.verify.problem.problem import Leaf, Quantities

FLOAT_MAX = sys.float_info.max


class EnclosedFunction:
    """The enclosure of one function while its C code is emitted."""

    def __init__(
        self,
        system: System,
        core_system: core.CoreSystem,
        module: Module,
        quantities: Quantities,
        emitter: Emitter,
        prelude: set[str],
    ) -> None:
        self.system = system
        self.core = core_system
        self.module = module
        self.quantities = quantities
        self.emitter = emitter
        self.ops = EnclosureOperations(emitter)
        self.inputs = EnclosureInputs(self.ops, quantities)
        self.functions = {f.name: f for f in core_system.functions}
        self.prelude = prelude
        self.estimated = False
        """Whether topics are read with their measurement errors."""
        self.moving = False
        """Whether controls and disturbances are inputs, as for derivatives and next states."""
        self._topics: dict[int, Item] = {}
        self._driven: dict[int, Item] | None = None

    def new_body(self, more: Mapping[str, core.Function] | None = None) -> EnclosureBody:
        """A new execution of Core that emits into this function."""
        functions = {**self.functions, **(more or {})}
        return EnclosureBody(self.emitter, functions, self.cell_value, self.prelude)

    def cell_value(self, cell: core.Cell, t: Type) -> Item:
        """The value of a cell of Core, which is a plant's state or a topic."""
        if cell.kind == "state":
            return self.inputs.state_value(cell.owner, cell.name, t)
        assert cell.kind == "topic"
        if cell.owner not in self._topics:
            self._topics[cell.owner] = self._topic_value(cell.owner)
        return self._topics[cell.owner]

    def _topic_value(self, index: int) -> Item:
        topic = self.system.topics[index]
        if topic.queue_of is not None:
            name = self.system.topics[topic.queue_of].name
            msg = f"what waits in the queue of `{name}` cannot be enclosed"
            raise EnclosureError(msg)
        driven = any(o.topic == index for p in self.core.plants.values() for o in p.outputs)
        if self.moving:
            # another plant's topic is sampled, with errors: its whole set covers both
            return self.inputs.topic_value(topic, {} if driven else self.inputs.controls)
        if driven and self._driven is not None:
            bounds = self.error_bound_by_path(index)
            true = self._driven[index]
            if not self.estimated or not bounds:
                return true
            return self.inputs.measured_value(index, topic.type, true, bounds=bounds)
        return self.inputs.topic_value(topic, self.inputs.others if self.estimated else {})

    def error_bound_by_path(self, topic: int) -> dict[tuple[str, ...], float]:
        """The bounds of the measurement errors of a driven topic, by the path of the leaf."""
        t = self.system.topics[topic].type
        all_paths = [p for p, _ in leaves(t)]
        return {
            all_paths[m.leaf]: m.bound
            for x in self.system.components
            for m in x.measured
            if m.topic == topic
        }

    def plants_with_steps(self) -> list[tuple[Component, core.PlantStep]]:
        """The verification plants with their steps; raises `EnclosureError` where one is extern."""
        plants = [(self.system.components[i], p) for i, p in sorted(self.core.plants.items())]
        for component, step in plants:
            if step.extern:
                msg = f"plant `{component.name}` is extern: its motion cannot be enclosed"
                raise EnclosureError(msg)
        return plants

    def _plant_body(self, component: Component, step: core.PlantStep) -> EnclosureBody:
        """A new execution in which a plant's states and disturbances are bound."""
        body = self.new_body()
        for x in step.states:
            body.bind(x.name, x.type, self.cell_value(x.cell, x.type))
        named = {d.variable.name: d for d in component.disturbances}
        drawn = zip(step.disturbances, component.disturbances, strict=True)
        for (name, t, _), d in drawn:
            assert named[d.variable.name] is d
            value = self.inputs.disturbance_value(component.index, d, read=self.moving)
            body.bind(name, t, value)
        return body

    def compute_driven_topics(self) -> None:
        """Computes from the states the values of the topics that plants drive."""
        driven: dict[int, Item] = {}
        for component, step in self.plants_with_steps():
            body = self._plant_body(component, step)
            body.run(step.publish)
            for number, output in enumerate(step.outputs):
                driven[output.topic] = body.frame.outputs[number][1]
        self._driven = driven
        self._topics = {}

    def _make_estimates(self, topics: Iterable[int]) -> None:
        """Reads the topics before any branch, so that code after the branch can use the values."""
        for index in topics:
            self._topics[index] = self._topic_value(index)

    def commands_of_sc(self) -> list[c.CExpr]:
        """The commands of SC, one per control; raises `EnclosureError` if SC is extern."""
        self.compute_driven_topics()
        self.estimated = True
        step = self.core.nodes[self.module.sc]
        component = self.system.components[self.module.sc]
        if component.extern:
            msg = f"SC `{component.name}` is extern: its commands cannot be enclosed"
            raise EnclosureError(msg)
        self._make_estimates(component.scope.topics.values())
        body = self.new_body()
        for x in step.locals:
            body.bind(x.name, x.type, self.ops.any_value(x.type))
        if step.takeover:
            body.branch(UNKNOWN, lambda: body.run(step.takeover), lambda: None)
        body.run(step.body)
        published = {
            o.topic: self._value_behind_gate(body, k, o) for k, o in enumerate(step.outputs)
        }
        return [
            self.leaf_form(self._published_leaf(published, x)) for x in self.quantities.controls
        ]

    def _value_behind_gate(self, body: EnclosureBody, number: int, output: core.Output) -> Item:
        """The value of an output behind the gate: the published value, or the one before it."""
        topic = self.system.topics[output.topic]
        held = self.inputs.topic_value(topic, {})
        has, value, _ = body.frame.outputs.get(number, (KnownTruth(False), held, topic.type))
        checked: dict[tuple[str, ...], Item] = {}
        bounds = dict(zip((p for p, _ in leaves(topic.type)), output.bounds, strict=True))

        def check() -> None:
            for path, t, v in leaf_values(topic.type, value):
                checked[path] = self._leaf_behind_gate(t, v, bounds.get(path))

        if has == KnownTruth(True):
            check()
        else:
            body.branch(has, check, lambda: None)
            checked = {p: v for p, _, v in leaf_values(topic.type, value)}
        return self.ops.selection(has, self.inputs.value_of_leaves(topic.type, checked), held)

    def _leaf_behind_gate(self, t: Type, v: Item, bound: Bound | None) -> Item:
        """A leaf behind the gate; notes a fault if the leaf may be outside its bounds."""
        if isinstance(t, FloatType):
            low, high = (bound.low, bound.high) if bound else (-float("inf"), float("inf"))
            ends = (float_literal(low), float_literal(high))
            form = self.ops.form_of(v)
            return Form(self.emitter.emit("form", "soter_n_gate", form, *ends, FAULT, kept=True))
        if isinstance(t, IntType) and bound is not None:
            return self.ops.narrowed_int(v, math.ceil(bound.low), math.floor(bound.high))
        return v

    def _published_leaf(self, topics: Mapping[int, Item], leaf: Leaf) -> Item:
        t = self.system.topics[leaf.owner].type
        if leaf.owner not in topics:
            msg = f"SC does not publish `{leaf.name}`"
            raise EnclosureError(msg)
        return {p: v for p, _, v in leaf_values(t, topics[leaf.owner])}[leaf.path]

    def leaf_form(self, v: Item) -> c.CExpr:
        """The form of a leaf for the caller; the form of a list has no bounds."""
        if isinstance(v, Sequence):
            v = FloatRange(-math.inf, math.inf)
        return self.ops.form_of(v if kind_of(v) == "form" else self.ops.float_of_int(v))

    def driven_leaves(self) -> list[c.CExpr]:
        """The leaves of all driven topics, in order of topic number and of declaration."""
        self.compute_driven_topics()
        assert self._driven is not None
        return [
            self.leaf_form(v)
            for topic, value in sorted(self._driven.items())
            for _, _, v in leaf_values(self.system.topics[topic].type, value)
        ]

    def set_conditions(self) -> list[Item]:
        """The conditions that each driven leaf lies in its declared set with every error.

        The last condition is that leaves without a set are finite. Call this after
        `compute_driven_topics`. Lists, arrays too long to be numbered, and leaves that equal a
        state that is no input or is read modulo a full turn have no condition.
        """
        assert self._driven is not None
        conditions: list[Item] = []
        rest: Item = KnownTruth(True)
        for index, value in sorted(self._driven.items()):
            topic = self.system.topics[index]
            bounds = dict(zip((p for p, _ in leaves(topic.type)), topic.bounds, strict=True))
            errors = self.error_bound_by_path(index)
            for path, t, v in leaf_values(topic.type, value):
                bound = bounds.get(path)
                if isinstance(t, FloatType):
                    low, high = room_of(bound, errors.get(path, 0.0))
                    ends: tuple[Item, Item] = FloatRange(low, low), FloatRange(high, high)
                elif isinstance(t, IntType) and bound is not None:
                    ends = KnownInt(math.ceil(bound.low)), KnownInt(math.floor(bound.high))
                else:
                    continue
                turns = isinstance(v, Form) and v.turns > 0  # assumed to stay near 0
                if bound is None and (self.ops.is_any_number(v) or turns):
                    continue
                inside = (self.ops.compare("<=", ends[0], v), self.ops.compare("<=", v, ends[1]))
                if bound is None:
                    rest = self.ops.conjunction(rest, self.ops.conjunction(*inside))
                else:
                    conditions.append(self.ops.conjunction(*inside))
        return [*conditions, rest]

    @staticmethod
    def is_flow(core_system: core.CoreSystem) -> bool:
        """Whether plants move, and each moving plant follows only a differential equation."""
        moving = [p for p in core_system.plants.values() if p.integrate]
        functions = {f.name: f for f in core_system.functions}
        return bool(moving) and all(right_hand_side(p, functions) is not None for p in moving)

    def derivatives(self) -> list[c.CExpr]:
        """The derivatives of all states, in their order."""
        self.moving = True
        derivatives: dict[tuple[int, str, tuple[str, ...]], Item] = {}
        for component, step in self.plants_with_steps():
            call = right_hand_side(step, self.functions)
            if call is None:
                continue
            body = self._plant_body(component, step)
            function = self.functions[call.function]
            record = function.parameters[0].type
            assert isinstance(record, RecordType)
            fields = record.fields
            cells = {x.cell.name: x for x in step.states}
            x = AggregateParts(tuple(self.cell_value(cells[n].cell, t) for n, t in fields))
            others = tuple(body.expr(a) for a in call.arguments[1:])
            result = body.result_of(function, (x, *others))
            for path, _, v in leaf_values(record, result):
                derivatives[component.index, path[0], path[1:]] = v
        zero = self.ops.form_of(FloatRange(0.0, 0.0))
        return [
            self.leaf_form(derivatives[leaf_key(s)]) if leaf_key(s) in derivatives else zero
            for s in self.quantities.states
        ]

    def next_states(self) -> list[c.CExpr]:
        """The values of all states after one step of their plants, in their order."""
        self.moving = True
        next_values: dict[tuple[int, str, tuple[str, ...]], Item] = {}
        for component, step in self.plants_with_steps():
            body = self._plant_body(component, step)
            body.run(step.integrate)
            for x in step.states:
                for path, _, v in leaf_values(x.type, body.frame.variables[x.name]):
                    next_values[component.index, x.cell.name, path] = v
        return [self.leaf_form(next_values[leaf_key(s)]) for s in self.quantities.states]

    def truth_of_predicate(
        self, p: core.Predicate, more: Mapping[str, core.Function], *, estimated: bool
    ) -> c.CExpr:
        """The truth of a predicate of Core on true or estimated topics."""
        return self.ops.truth_of(self._predicate_value(p, more, estimated=estimated))

    def _predicate_value(
        self, p: core.Predicate, more: Mapping[str, core.Function], *, estimated: bool
    ) -> Item:
        self.compute_driven_topics()
        self.estimated = estimated
        self._make_estimates(self.module.scope.topics.values())
        body = self.new_body(more)
        body.run(p.body)
        return body.expr(p.value)

    def _expression_value(self, e: TypedExpr, *, estimated: bool) -> Item:
        table = FunctionTable(self.system)
        system, module = self.system, self.module
        if estimated:  # what the DM evaluates
            p = lower_dm_predicate(table, system, module, e)
        else:
            p = lower_predicate(table, system, module.scope, e, e.span)
        return self._predicate_value(p, table.by_name, estimated=estimated)

    def truth_of_expression(self, e: TypedExpr, *, estimated: bool) -> c.CExpr:
        """The truth of a checked expression on true or estimated topics."""
        return self.ops.truth_of(self._expression_value(e, estimated=estimated))

    def truth_of_publishing(self, number: int | None = None) -> c.CExpr:
        """The truth that plants publish within their sets; `number` selects one condition."""
        self.compute_driven_topics()
        conditions = self.set_conditions()
        if number is not None:
            conditions = conditions[number : number + 1]
        return self.ops.truth_of(reduce(self.ops.conjunction, conditions))

    def truth_of_constraint(self, safe: TypedExpr) -> c.CExpr:
        """The truth of C: `safe` holds on true states, and plants publish within their sets."""
        holds = self._expression_value(safe, estimated=False)
        return self.ops.truth_of(reduce(self.ops.conjunction, self.set_conditions(), holds))


def room_of(bound: Bound | None, error: float) -> tuple[float, float]:
    """The range of floats that stay inside a set after an error up to `error` is added.

    The range is exact: each sum of a float from the range and an error, rounded, is in the set.
    """
    low, high = (bound.low, bound.high) if bound is not None else (-FLOAT_MAX, FLOAT_MAX)
    least, most = Fraction(low) + Fraction(error), Fraction(high) - Fraction(error)
    return -rounded_down(-least), rounded_down(most)


def right_hand_side(
    step: core.PlantStep, functions: Mapping[str, core.Function]
) -> core.Call | None:
    """The call of a plant's derivative function; None if the plant moves in steps by `next`."""
    calls = [
        s
        for s in _statements_without_loops(step.integrate)
        if isinstance(s, core.Call) and functions[s.function].source_name.endswith(": der")
    ]
    written = {x.name for x in step.states if x.written}
    if not calls:
        return None
    record = functions[calls[0].function].result_type
    assert isinstance(record, RecordType)
    return calls[0] if len(written) == len(record.fields) else None


def _statements_without_loops(statements: tuple[core.Stmt, ...]) -> list[core.Stmt]:
    """The statements, with each loop replaced by the statements in its body."""
    result: list[core.Stmt] = []
    for s in statements:
        result += _statements_without_loops(s.body) if isinstance(s, core.Loop) else [s]
    return result
