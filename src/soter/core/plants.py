"""Lowers plants: draws, integration, publication.

Purpose: the numerical scheme of docs/semantics.md written out in Core, so that every back end
(doubles, intervals) sees the same operations in the same order.
Non-goals: the random generator (the runtime's), validated integration (`verify/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import cells_of_publication, footprint_of
from soter.core.lower_expressions import rebuild, select
from soter.core.lower_statements import Builder
from soter.language.model.tree_walk import lets_run_first, lets_that_choose
from soter.language.model.types import FLOAT, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.lower_statements import FunctionTable
    from soter.language.model import typed
    from soter.language.model.system import Component, System

    Derivative = Callable[[core.Expr, str], core.Var]


def lower_plant(functions: FunctionTable, system: System, component: Component) -> core.PlantStep:
    """Gives the Core of one release of a plant."""
    return _Plant(functions, system, component).lowered_step()


class _Plant:
    def __init__(self, functions: FunctionTable, system: System, component: Component) -> None:
        assert component.plant is not None
        self.functions = functions
        self.system = system
        self.component = component
        self.plant: typed.PlantSymbol = component.plant
        self.builder = Builder(functions, system, component.scope)
        self.builder.period_ns = component.period_ns
        self.copies: list[core.LocalCopy] = []
        self.chosen = lets_that_choose(component.plant)

    def lowered_step(self) -> core.PlantStep:
        b, plant = self.builder, self.plant
        for v in plant.states:
            name = b.name_variable(v)
            written = plant.extern or v in plant.der or v in plant.next
            cell = core.Cell("state", self.component.index, v.name)
            self.copies.append(core.LocalCopy(cell, name, v.type, written))
        disturbances = []
        for d in self.component.disturbances:
            name = b.name_variable(d.variable)
            draws = tuple(core.Draw(s, d.low, d.high, d.hold_ns) for s in d.streams)
            disturbances.append((name, d.variable.type, draws))
        for variable, value in lets_run_first(plant):
            self._emit_let(variable, value)
        choose = b.take_statements()
        integrate: tuple[core.Stmt, ...] = ()
        if not plant.extern:
            self._emit_motion()
            integrate = b.take_statements()
        self._emit_lets()
        outputs = []
        for number, (topic, value) in enumerate(plant.drives):
            b.emit(core.Publish(plant.span, number, b.expr(value)))
            index = self.component.scope.topics[topic]
            outputs.append(core.Output(index, topic.type, self.system.topics[index].bounds))
        publish = b.take_statements()
        by_topic = {o.topic: i for i, o in enumerate(outputs)}
        noise = tuple(
            (by_topic[m.topic], m.leaf, core.Draw(m.stream, -m.bound, m.bound, -1))
            for m in self.component.measured
        )
        footprint = footprint_of((*choose, *integrate, *publish))
        footprint.reads |= {c.cell for c in self.copies}
        footprint.writes |= {c.cell for c in self.copies if c.written}
        for o in outputs:
            footprint.writes.update(cells_of_publication(self.system, o.topic))
        return core.PlantStep(
            component=self.component.index,
            states=tuple(self.copies),
            disturbances=tuple(disturbances),
            choose=choose,
            integrate=integrate,
            publish=publish,
            outputs=tuple(outputs),
            noise=noise,
            footprint=footprint,
            span=plant.span,
            extern=plant.extern,
        )

    def _emit_lets(self) -> None:
        for variable, value in self.plant.lets:
            if variable not in self.chosen:
                self._emit_let(variable, value)

    def _emit_let(self, variable: typed.Variable, value: typed.TypedExpr) -> None:
        e = self.builder.expr(value)
        name = self.builder.name_variable(variable)
        self.builder.emit(core.Let(self.plant.span, name, e))

    def _emit_motion(self) -> None:
        b, plant, span = self.builder, self.plant, self.plant.span
        new: list[tuple[typed.Variable, core.Expr]] = []
        if plant.next:
            self._emit_lets()
            for v, e in plant.next.items():
                new.append((v, b.let(span, f"next_{v.name}", b.expr(e))))
        if plant.der:
            x = self._integrated_states()
            for i, v in enumerate(plant.der):
                t = v.type
                new.append((v, core.Field(t, x, i)))
        for v, value in new:
            b.emit(core.Set(span, b.names[v], v.type, (), value))

    def _integrated_states(self) -> core.Expr:
        """Emits the integration of all `der` states; gives the record with the new values."""
        b, plant, span = self.builder, self.plant, self.plant.span
        step_of_scheme = STEPS[plant.method]
        record = RecordType(tuple((v.name, v.type) for v in plant.der), f"{plant.name}.derivative")
        function, extra = self._derivative(record)
        h = float(self.component.period_ns) / 1e9 / float(self.component.substeps)
        old = core.Make(record, tuple(core.Var(v.type, b.names[v]) for v in plant.der))
        x = b.let(span, "x", old, mutable=True)

        def emit_derivative(at: core.Expr, name: str) -> core.Var:
            result = b.unused_name(name)
            b.emit(core.Call(span, result, function.name, (at, *extra), record))
            return core.Var(record, result)

        def emit_scheme_step() -> None:
            value = step_of_scheme(self, record, x, emit_derivative, h)
            b.emit(core.Set(span, x.name, record, (), value))

        if self.component.substeps == 1:
            emit_scheme_step()
        else:
            body, _ = b.statements_of(emit_scheme_step)
            b.emit(core.Loop(span, b.unused_name("substep"), 0, self.component.substeps, body))
        return x

    def euler_states(self, record: RecordType, x: core.Var, f: Derivative, h: float) -> core.Expr:
        """Gives the record of states after one step of Euler's scheme."""
        k = f(x, "k1")
        return rebuild(record, lambda p: _sum(select(x, p), _scaled(h, select(k, p))))

    def rk4_states(self, record: RecordType, x: core.Var, f: Derivative, h: float) -> core.Expr:
        """Gives the record of states after one step of the classical Runge-Kutta scheme."""
        b, span = self.builder, self.plant.span

        def emit_moved_states(name: str, scale: float, k: core.Var) -> core.Var:
            value = rebuild(record, lambda p: _sum(select(x, p), _scaled(scale, select(k, p))))
            return b.let(span, name, value)

        k1 = f(x, "k1")
        k2 = f(emit_moved_states("x2", h * 0.5, k1), "k2")
        k3 = f(emit_moved_states("x3", h * 0.5, k2), "k3")
        k4 = f(emit_moved_states("x4", h, k3), "k4")

        def new_leaf(p: tuple[int, ...]) -> core.Expr:
            total = _sum(
                _sum(_sum(select(k1, p), _scaled(2.0, select(k2, p))), _scaled(2.0, select(k3, p))),
                select(k4, p),
            )
            return _sum(select(x, p), _scaled(h / 6.0, total))

        return rebuild(record, new_leaf)

    def _derivative(self, record: RecordType) -> tuple[core.Function, tuple[core.Expr, ...]]:
        """Gives the function from `der` states to their derivatives, and its other arguments."""
        outer, plant, span = self.builder, self.plant, self.plant.span
        inner = _RightHandSide(self.functions, self.system, self.component.scope)
        inner.period_ns = self.component.period_ns
        parameters = [core.Parameter(inner.unused_name("x"), record)]
        extra: list[core.Expr] = []
        for i, v in enumerate(plant.der):
            name = inner.name_variable(v)
            inner.emit(core.Let(span, name, core.Field(v.type, core.Var(record, "x"), i)))
        others = [v for v in plant.states if v not in plant.der]
        others += [d.variable for d in self.component.disturbances]
        others += self.chosen
        for v in others:
            parameters.append(core.Parameter(inner.name_variable(v), v.type))
            extra.append(core.Var(v.type, outer.names[v]))
        for topic in plant.reads:
            name = inner.unused_name(topic.name.rsplit(".", 1)[-1])
            inner.topics[topic] = name
            parameters.append(core.Parameter(name, topic.type))
            extra.append(core.Get(topic.type, outer.topic_cell(topic)))
        inner.time = inner.unused_name("time")
        parameters.append(core.Parameter(inner.time, FLOAT))
        extra.append(core.Fact(FLOAT, "time"))
        for variable, value in plant.lets:
            if variable not in self.chosen:
                e = inner.expr(value)
                inner.emit(core.Let(span, inner.name_variable(variable), e))
        values = tuple(inner.expr(e) for e in plant.der.values())
        for index, name in inner.ages.items():
            parameters.append(core.Parameter(name, FLOAT))
            extra.append(core.Fact(FLOAT, "age", index))
        function = core.Function(
            name=self.functions.unique_name(f"{self.component.name}_derivative"),
            source_name=f"{plant.name}: der",
            parameters=tuple(parameters),
            result_type=record,
            body=inner.take_statements(),
            result=core.Make(record, values),
            span=span,
            source=None,
            can_fault=inner.can_fault,
        )
        self.functions.enter_function(function)
        return function, tuple(extra)


STEPS = {"euler": _Plant.euler_states, "rk4": _Plant.rk4_states}
"""One step of every scheme (`SCHEMES`)."""


class _RightHandSide(Builder):
    """A builder inside a pure function, which gets topics, time and ages as parameters."""

    def __init__(self, functions: FunctionTable, system: System, scope: object) -> None:
        super().__init__(functions, system, scope)  # type: ignore[arg-type]
        self.topics: dict[typed.TopicSymbol, str] = {}
        self.time = ""
        self.ages: dict[int, str] = {}
        """Topic index -> parameter with its age, for the ages that are read."""

    def _lower_topicread(self, e: typed.TopicRead) -> core.Expr:
        return core.Var(e.type, self.topics[e.topic])

    def _lower_timeread(self, e: typed.TimeRead) -> core.Expr:
        return core.Var(e.type, self.time)

    def _lower_ageread(self, e: typed.AgeRead) -> core.Expr:
        index = self.topic_cell(e.topic).owner
        if index not in self.ages:
            short = e.topic.name.rsplit(".", 1)[-1]
            self.ages[index] = self.unused_name(f"age_{short}")
        return core.Var(e.type, self.ages[index])


def _sum(a: core.Expr, b: core.Expr) -> core.Expr:
    return core.Binary(FLOAT, "+", a, b)


def _scaled(scale: float, e: core.Expr) -> core.Expr:
    return core.Binary(FLOAT, "*", core.Const(FLOAT, scale), e)
