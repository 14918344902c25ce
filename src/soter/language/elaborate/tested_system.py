"""Elaborates a `test` block to a system: parts replaced, inputs, properties and faults added.

Purpose: turns a `TestSymbol` into a `System` with its `TestPlan`, and reports what makes a test
impossible: code that the explorer cannot run, a horizon too far, faults of what cannot have any.
Non-goals: P1 of a part that the test replaced (a test may be about a slow controller), exploring.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants_and_types import Calculator
from soter.language.elaborate import derived_systems
from soter.language.elaborate.distinguished import Readers
from soter.language.elaborate.elaborator import Elaborator
from soter.language.elaborate.faults import named, not_found
from soter.language.elaborate.instantiate import expressions_of
from soter.language.elaborate.stand_ins import (
    StatedValues,
    field_path,
    give_step,
    is_one_of,
    part_of,
    with_part,
)
from soter.language.elaborate.topics import refuse_overrun
from soter.language.elaborate.wellformed import check_periods, from_outside
from soter.language.model import typed
from soter.language.model.system import Property, TestPlan, TimedProperty, TimingFault
from soter.language.model.tree_walk import calls_in
from soter.language.model.types import RecordType, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.elaborate.distinguished import Path
    from soter.language.elaborate.instantiate import SubSystem
    from soter.language.model.system import Component, Metric, Module, Scope, StandIn, System
    from soter.language.model.types import Value


MAX_ACTORS = 64
"""Most components and inputs of a tested system: a set of them is one machine word."""
MAX_STEPS = 10_000_000
"""Most releases up to the horizon; with more even one execution would take too long."""
MAX_SKIPS = 1_000


def elaborate_test(
    program: typed.TypedProgram,
    test: typed.TestSymbol,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
) -> System | None:
    """Flattens the system of a test, with `System.test` set; None after an error.

    `overrides` maps full parameter names to values.
    """
    before = diagnostics.error_count
    elaborator = _TestElaborator(program, test, overrides, diagnostics)
    flat = elaborator.run_test()
    return flat if diagnostics.error_count == before else None


class _TestElaborator(Elaborator):
    """Elaborates the system of one test."""

    def __init__(
        self,
        program: typed.TypedProgram,
        test: typed.TestSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
    ) -> None:
        own = {(s.path, s.param) for s in test.sets}
        rest = [s for s in test.system.sets if (s.path, s.param) not in own]
        system = replace(
            test.system,
            replaces=(*test.system.replaces, *test.replaces),
            sets=(*test.sets, *rest),
        )
        if test.system in program.damaged:
            program.damaged.add(system)
        super().__init__(program, system, overrides, diagnostics)
        self.whole_modules = True
        self.test = test
        self.timed: list[TimedProperty] = []
        self.stated: dict[typed.TestSymbol, list[StatedValues]] = {}
        self.sound = True
        """Whether the parts are those that were meant: then what is missing or left is an error."""

    def run_test(self) -> System | None:
        """Flattens the system and adds its plan; None if it is too large."""
        horizon = self._horizon()
        skew = self.skew(self.test.skew)
        quantum = self.duration(self.test.quantum, "`quantum`")
        before = self.diagnostics.error_count
        flat = self.run()
        if flat is None:
            return None
        self._give_steps(flat)
        damaged = self.test in self.program.damaged
        self.sound = not damaged and self.diagnostics.error_count == before
        flat = self._without_idle_draws(flat)
        self._check_periods(flat)
        faults = (*self._faults(flat), *self._lasting(flat))
        name, span = self.test.name, self.test.span
        timed = tuple(self.timed)
        plan = TestPlan(name, skew, horizon or 0, quantum, faults, timed, span)
        plan.ordered = self.test.order is not None
        flat = derived_systems.with_test(flat, plan)
        if self.sound:
            self._check_code(flat)
        self._check_size(flat, horizon)
        self._check_quantum(plan)
        self._check_order(plan)
        if horizon is not None:
            self._check_deadlines(plan)
        return flat

    def _horizon(self) -> int | None:
        if self.test.horizon is not None:
            return self.long_duration(self.test.horizon, "`horizon`")
        if self.test not in self.program.damaged:
            self.diagnostics.error(
                "E007",
                f"test `{self.test.name}` has no horizon",
                self.test.span,
                notes=("an exploration covers every execution up to some time",),
                helps=("say how far: `horizon 1s;`",),
            )
        return None

    # ------------------------------------------------------------ what a test adds

    def conditions(self, part: SubSystem) -> list[typed.TypedExpr]:
        """The expressions of a part's properties; the test's belong to the outermost part."""
        own = [] if part.prefix else expressions_of(self.test.properties)
        return [*super().conditions(part), *own]

    def input_items(self) -> Iterator[tuple[SubSystem, typed.InputSymbol]]:
        """Yields the test's inputs first: they replace those of the system."""
        for item in self.test.inputs:
            yield self.parts[0], item
        yield from super().input_items()

    def _without_idle_draws(self, system: System) -> System:
        """The system without draws for topics that nothing reads after replacements."""
        own = {self.topic(self.key(i.topic, "", [])) for i in self.test.inputs}
        return derived_systems.drawn_where(
            system, lambda t: t in own or bool(system.topics[t].driver)
        )

    # ------------------------------------------------------------ stand-ins

    def _give_steps(self, system: System) -> None:
        """Gives stand-ins their steps, now that it is known what code reads their topics."""
        if self.partial or self.diagnostics.error_count:
            return
        asked = [(e, p.scope) for p in self.timed for e in (p.premise, p.condition) if e]
        readers = Readers(system, asked, self._constant)
        stated: dict[int, dict[Path, tuple[Value, ...]]] = {}
        own = self.stated[self.test]
        for s in own:
            stated.setdefault(s.topic, {})[s.path] = s.tried
        for c in system.components:
            if c.stands_for is None or c.node is None:
                continue
            outputs = {*c.writes}
            c.stands_for = _with_values(c.stands_for, [s for s in own if s.topic in outputs])
            give_step(c, system.topics, stated, readers, self.diagnostics)

    def _constant(self, e: typed.TypedExpr, scope: Scope) -> Value | None:
        """The value of a closed expression; None if it has none."""
        return Calculator(Diagnostics(), scope.params).value(e, "a constant")

    def _stated_values(self, test: typed.TestSymbol) -> list[StatedValues]:
        """The values that a test of this system states; V005 for one outside its set."""
        known: list[StatedValues] = []
        for item in test.stated:
            symbol, path = field_path(item.read)
            topic = self.topics[self.topic(self.key(symbol, "", []))]
            values = []
            for e in item.values:
                value = self.number(e, "the value of a stand-in")
                if value is not None:
                    values.append(value)
                    whole = with_part(topic.default, path, value)
                    self.in_set(topic, whole, e, f"this value of `{topic.symbol.name}`")
            first, promised = part_of(topic.default, path), item.kind == "guarantees"
            known.append(
                StatedValues(
                    topic.index, path, tuple(values), first, promised, item.text, item.span
                )
            )
        return known

    def _hold_to_values(self, components: list[Component], result: list[Property]) -> None:
        """Adds properties: a real part publishes only what other tests state for its stand-in."""
        sets = _sets_of(self.test)
        for test in self.program.tests.values():
            alike = test.system is self.test.system and _sets_of(test) == sets
            self.stated[test] = self._stated_values(test) if alike or test is self.test else []
        self._check_stated(components)
        for test, known in self.stated.items():
            for s in known:
                for c in components:
                    if test is not self.test and self._as_it_is(c, s.topic):
                        result.append(self._stated_property(c, s, test, len(result)))

    def _as_it_is(self, c: Component, topic: int) -> bool:
        """Whether `c` publishes `topic` and is the system's own, not put there by the test.

        A replacement by the system itself counts as its own: every test has it.
        """
        by_test = self.put_in.get(c.name) in [span for _, _, span in self.test.replaces]
        if c.node is None or c.stands_for is not None or by_test:
            return False
        return topic in c.writes

    def _stated_property(
        self, c: Component, s: StatedValues, test: typed.TestSymbol, index: int
    ) -> Property:
        assert c.node is not None
        symbol = next(t for t in c.node.publishes if c.scope.topics[t] == s.topic)
        read: typed.TypedExpr = typed.TopicRead(symbol.type, s.span, symbol)
        for i in s.path:
            assert isinstance(read.type, RecordType)
            read = typed.TypedField(read.type.fields[i][1], s.span, read, i)
        condition = is_one_of(read, s.tried)
        says = "has" if s.promised else "assumes"
        text = f"{s.text}, as {test.name} {says} it, in {c.name}"
        return Property(index, "guarantees", condition, c.scope, text, s.span, c.index)

    def _check_stated(self, components: list[Component]) -> None:
        """Reports E020 for values stated of no stand-in's topic, N002 for values stated twice."""
        published = {
            c.scope.topics[t]
            for c in components
            if c.stands_for is not None and c.node is not None
            for t in c.node.publishes
        }
        before: list[StatedValues] = []
        for s in self.stated[self.test]:
            for other in before:
                short = min(len(s.path), len(other.path))
                if s.topic == other.topic and s.path[:short] == other.path[:short]:
                    self.diagnostics.error(
                        "N002",
                        f"the values of `{self.topics[s.topic].name}` are stated twice",
                        s.span,
                        "again",
                        also=((other.span, "the first time"),),
                    )
            before.append(s)
            if s.topic not in published and not self.partial:
                self.diagnostics.error(
                    "E020",
                    f"nobody who publishes `{self.topics[s.topic].name}` is replaced by a contract",
                    s.span,
                    also=((self.test.span, "in this test"),),
                    notes=("values are stated of what stands in: who runs as it is has its own",),
                    helps=("write `replace ... by contract;`, or leave this line out",),
                )

    # ------------------------------------------------------------ its properties

    def _properties(self, modules: list[Module], components: list[Component]) -> list[Property]:
        result = super()._properties(modules, components)
        self._hold_to_values(components, result)
        for item in self.test.properties:
            if item.kind == "invariant":
                self._invariant(item, modules)
                continue
            scope = self.scope_of_property(self.parts[0], item)
            if item.kind in {"always", "never"}:
                self.add_property(result, item, scope, item.text)
                continue
            within = self.long_duration(item.within, "`within`")
            self.timed.append(
                TimedProperty(
                    index=len(self.timed),
                    kind=item.kind,
                    premise=item.premise,
                    condition=item.condition,
                    within_ns=within or 0,
                    module=None,
                    scope=scope,
                    text=item.whole or " ".join(item.span.text.split()).rstrip("; "),
                    span=item.span,
                    asks=item.asks,
                    promises=item.text,
                )
            )
        return result

    def _invariant(self, item: typed.PropertySymbol, modules: list[Module]) -> None:
        """Adds the invariant of Theorem 3.1 for one module, or for each one (Theorem 4.1)."""
        about = modules
        if item.module is not None:
            gone = self.gone.get(item.module)
            if gone is not None:
                self.mode_is_gone(item.module, gone, item.span)
                return
            about = [m for m in about if m.name == item.module]
        if not modules and not self.partial:
            self.diagnostics.error(
                "M013",
                f"system `{self.symbol.name}` has no module that could have an invariant",
                item.span,
                also=((self.symbol.span, "in this system"),),
            )
        for module in about:
            text = f"invariant({module.name})"
            index = len(self.timed)
            parts = (None, None, 0, module.index, module.scope, text, item.span)
            self.timed.append(TimedProperty(index, "invariant", *parts))

    def _hold(self, c: Component) -> None:
        """Makes no topic: the explorer itself holds what a test publishes later."""

    def disturb(self, system: System) -> None:
        """Reports E018 for a system with `faults`, E019 for one with topics from outside."""
        outside = from_outside(system)
        if outside:
            name = system.topics[outside[0].topic].name
            self.diagnostics.error(
                "E019",
                f"test `{self.test.name}` is of a system in the world: `{name}` comes from outside",
                outside[0].span,
                also=((self.test.span, "the test"),),
                notes=("nothing is published from outside in a test, so that little is tried",),
                helps=("test the system that has plants or nodes in the place of the world",),
            )
        if self.symbol.faults:
            self.diagnostics.error(
                "E018",
                f"test `{self.test.name}` is of a system with `faults`",
                self.symbol.faults[0].span,
                also=((self.test.span, "the test"),),
                notes=("chance decides on them in runs; a test tries everything that it permits",),
                helps=("test the system without them: `late`, `skip`, `replace` of the test",),
            )

    def measures(self) -> Iterator[Metric]:
        """Yields nothing: a test measures nothing."""
        yield from ()

    # ------------------------------------------------------------ faults

    def _lasting(self, system: System) -> Iterator[TimingFault]:
        """Yields an overrun for each node that `takes` time: every step of it is one."""
        for c in system.components:
            if c.takes_ns is not None:
                assert c.node is not None
                assert c.node.takes is not None
                low, high = c.takes_ns
                span = c.node.takes[0].span.to(c.node.takes[1].span)
                self._has_no_queue(system, c, span)
                yield TimingFault("overrun", c.index, high, 0, span, low)

    def _faults(self, system: System) -> Iterator[TimingFault]:
        seen: dict[tuple[str, int], typed.FaultSymbol] = {}
        for item in self.test.faults:
            by = self.duration(item.by, f"`by` of `{item.path}`") if item.by is not None else 0
            at_most = self.count(item.at_most, "`at most`", 1, MAX_SKIPS)
            components = self._fault_components(system, item)
            for component in components:
                first = seen.setdefault((item.kind, component.index), item)
                if first is not item:
                    self.diagnostics.error(
                        "N002",
                        f"`{item.kind}` of `{component.name}` is said twice",
                        item.span,
                        "again",
                        also=((first.span, "the first time"),),
                    )
                elif item.kind == "overrun":
                    self._overrun(system, component, item)
                skips = (at_most or 1) if item.kind == "skip" else 0
                yield TimingFault(item.kind, component.index, by or 0, skips, item.span)

    def _fault_components(self, system: System, item: typed.FaultSymbol) -> list[Component]:
        """The components that a path names; reports E009 if none, or one without such faults."""
        components = named(system, item.path)
        if not components:
            if not self.partial and self.sound:
                verb = _VERBS[item.kind]
                not_found(system, item.path, item.span, self.diagnostics, verb=verb, plants=False)
            return []
        wrong = {c.role for c in components} & (
            {"plant", "dm"} if item.kind == "overrun" else {"plant"}
        )
        if not wrong:
            return components
        plant = "plant" in wrong
        self.diagnostics.error(
            "E009",
            f"`{item.path}` is a {'plant' if plant else 'decision module'}: it cannot "
            f"{_VERBS[item.kind]}",
            item.span,
            also=((components[0].span, "declared here"),),
            notes=("physical time is never skewed",)
            if plant
            else ("a decision module publishes nothing that could come late",),
            helps=() if plant else (f"let its step be late: `late {item.path} by ...;`",),
        )
        return []

    def _overrun(self, system: System, c: Component, item: typed.FaultSymbol) -> None:
        assert c.node is not None
        refuse_overrun(system, c, f"overrun {item.path}", self.diagnostics)
        if c.takes_ns is None:
            self._has_no_queue(
                system, c, item.span, f"let it be late instead: `late {item.path} by ...;`"
            )
            return
        assert c.node.takes is not None
        self.diagnostics.error(
            "N002",
            f"how long a step of `{c.name}` takes is said twice",
            item.span,
            "an overrun",
            also=((c.node.takes[0].span.to(c.node.takes[1].span), "what it says itself"),),
            notes=("all times that the node says are tried",),
            helps=("leave out the overrun",),
        )

    def _has_no_queue(self, system: System, c: Component, span: Span, instead: str = "") -> None:
        """Reports E010 if something queues a topic that a component publishes later."""
        assert c.node is not None
        for symbol in c.node.publishes:
            topic = system.topics[c.scope.topics[symbol]]
            if not topic.queues:
                continue
            queue = system.topics[topic.queues[0]]
            what = "cannot overrun" if instead else "takes time, which no test can try"
            self.diagnostics.error(
                "E010",
                f"`{c.name}` {what}: it publishes `{topic.name}`, which is queued",
                span,
                also=((topic.symbol.span, f"collected in `{queue.name}`"),),
                notes=("a publication that takes effect later has no place in a queue",),
                helps=(instead or "replace it in this test by a node without `takes`",),
            )
            return

    # ------------------------------------------------------------ what cannot be explored

    def _check_periods(self, system: System) -> None:
        """Checks P1a, except for parts that the test replaced."""
        replaced = {
            c.name
            for m in system.modules
            for c in (system.components[m.ac], system.components[m.sc])
            if c.node not in (m.symbol.ac, m.symbol.sc)
        }
        check_periods(system, self.diagnostics, self.unknown | replaced)

    def _check_code(self, system: System) -> None:
        for c in system.components:
            if c.extern:
                self._extern(c)
        externs: dict[typed.FunSymbol, typed.TypedCall] = {}
        for root in _code(system):
            _externs_below(root, externs)
        for fun, call in externs.items():
            self.diagnostics.error(
                "E006",
                f"test `{self.test.name}` would call the extern function `{fun.name}`",
                self.test.span,
                also=((call.span, "called here"), (fun.span, "declared here")),
                notes=("the explorer runs Soter code: it repeats each step in many states",),
                helps=("replace the node by one that chooses what the function may answer",),
            )

    def _extern(self, c: Component) -> None:
        symbol = c.node or c.plant
        assert symbol is not None
        what = "plant" if c.plant is not None else "node"
        by = (
            "a node of Soter code that may do anything, with `choose`"
            if c.plant is None
            else "a plant of Soter code"
        )
        name = c.name.rpartition(".")[2] if c.module is not None else c.name
        self.diagnostics.error(
            "E005",
            f"test `{self.test.name}` leaves the extern {what} `{c.name}` in",
            self.test.span,
            also=((symbol.span, "extern"),),
            notes=(f"the explorer runs Soter code only: replace it by {by}",),
            helps=(f"write `replace {name} by ...;`",),
        )

    def _check_size(self, system: System, horizon: int | None) -> None:
        actors = [(c.phase_ns, c.period_ns) for c in system.components]
        actors += [(0, i.every_ns) for i in system.inputs]
        if len(actors) > MAX_ACTORS:
            self.diagnostics.error(
                "E011",
                f"test `{self.test.name}` has {len(actors)} actors",
                self.test.span,
                f"at most {MAX_ACTORS} are possible",
                notes=("actors are plants, nodes, decision modules and driven inputs",),
                helps=("test a smaller system: composed modules are safe one by one",),
            )
        if horizon is None or self.test.horizon is None or self.unknown:
            return
        steps = sum((horizon - phase) // period + 1 for phase, period in actors if phase <= horizon)
        if steps > MAX_STEPS:
            self.diagnostics.error(
                "E008",
                f"the horizon of test `{self.test.name}` can never be exhausted",
                self.test.horizon.span,
                f"{steps} steps lie before it, in each execution",
                notes=(f"at most {MAX_STEPS} are possible",),
                helps=("choose a horizon of a few hyperperiods",),
            )

    def _check_quantum(self, plan: TestPlan) -> None:
        expr = self.test.quantum
        if expr is None or plan.quantum_ns is None:
            return
        room = plan.skew_ns + max((f.by_ns for f in plan.faults), default=0)
        if plan.quantum_ns <= room:
            return
        self.diagnostics.warning(
            "W008",
            f"a quantum of {show_ns(plan.quantum_ns)} is coarser than the time a step may be late"
            if room
            else f"a quantum of {show_ns(plan.quantum_ns)} does nothing where no step may be late",
            expr.span,
            f"at most {show_ns(room)}" if room else "every step of this test is in time",
            notes=("a step happens as early as it can, or later, at a multiple of the quantum",),
            helps=("choose a quantum that divides the skew and the times of the faults",)
            if room
            else ("leave it out, or say `skew` or `late`",),
        )

    def _check_order(self, plan: TestPlan) -> None:
        """Reports a declared order beside faults of time: it is one of steps at their releases."""
        late = [f for f in plan.faults if f.kind != "skip"]
        if self.test.order is None or not (plan.skew_ns or late):
            return
        what = "skew" if plan.skew_ns else "takes" if late[0].least_ns else late[0].kind
        at = self.test.skew.span if plan.skew_ns and self.test.skew is not None else None
        self.diagnostics.error(
            "E017",
            f"`order deployed` and `{what}` exclude each other",
            self.test.order,
            "steps of an instant in the deployed order",
            also=((at or late[0].span, "steps that are late"),),
            notes=("a step that is late comes after those of later instants, too",),
            helps=("leave one of them out, or write two tests",),
        )

    def _check_deadlines(self, plan: TestPlan) -> None:
        for p in plan.timed:
            only = p.kind == "leadsto" and p.within_ns == plan.horizon_ns
            if p.kind == "invariant" or (p.within_ns <= plan.horizon_ns and not only):
                continue
            self.diagnostics.error(
                "E013",
                f"this property is {'hardly ever' if only else 'never'} judged: "
                f"the horizon of the test is {show_ns(plan.horizon_ns)}",
                p.span,
                f"within {show_ns(p.within_ns)}",
                notes=(
                    "only what holds at time 0 has its deadline before the end"
                    if only
                    else "a deadline beyond the horizon is not judged",
                ),
                helps=("raise the horizon, or shorten the deadline",),
            )


_VERBS = {"late": "be late", "skip": "skip a step", "overrun": "overrun"}


def _sets_of(test: typed.TestSymbol) -> set[tuple[str, typed.ParamSymbol, str]]:
    """The parameters that a test sets, and their values, as text."""
    return {(s.path, s.param, repr(s.value)) for s in test.sets}


def _with_values(of: StandIn, stated: Sequence[StatedValues]) -> StandIn:
    """The stand-in's record with the values that a test states for it, for reports."""
    promised = [s.text for s in stated if s.promised]
    tried = [s.text for s in stated if not s.promised]
    return replace(of, clauses=(*of.clauses, *promised), tried=tuple(tried))


def _code(system: System) -> Iterator[object]:
    """Yields all code that a step or a property may run."""
    for c in system.components:
        if c.node is not None:
            yield from (*c.node.step, *(c.node.takeover or ()))
        if c.plant is not None:
            yield from (e for _, e in c.plant.lets)
            yield from (*c.plant.der.values(), *c.plant.next.values())
            yield from (e for _, e in c.plant.drives)
    for m in system.modules:
        yield from m.symbol.predicates
    yield from (p.condition for p in system.properties)


def _externs_below(root: object, call_by_extern: dict[typed.FunSymbol, typed.TypedCall]) -> None:
    """Enters extern functions that code below `root` calls, each with its first call."""
    for call in calls_in(root):
        seen: set[typed.FunSymbol] = set()
        todo = [call.fun]
        while todo:
            fun = todo.pop()
            if fun in seen:
                continue
            seen.add(fun)
            if fun.extern:
                call_by_extern.setdefault(fun, call)
            todo += [inner.fun for inner in calls_in(*(fun.body or ()))]
