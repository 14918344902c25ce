"""Flattens a system: instances get names, parameters values, and all numbers are computed.

Purpose: makes a `System` of a `SystemSymbol` and overrides of parameters, with diagnostics for
wrong numbers (periods, value sets, defaults) and wrong wires.
Non-goals: composition (`composition_check.py`), P1a and P1b (`wellformed.py`), behaviour, storage.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import append, exchange
from soter.language.elaborate.composition_check import Composition, hyperperiod
from soter.language.elaborate.faults import place_faults
from soter.language.elaborate.instantiate import controller_names
from soter.language.elaborate.stand_ins import stand_in
from soter.language.elaborate.step_times import (
    budget,
    check_double_response,
    held_topic,
    inlined,
    may_take,
)
from soter.language.elaborate.system_numbers import TooLargeError, warn_of_idle_settings
from soter.language.elaborate.topics import (
    Topics,
    beyond,
    first_outside,
    make_latch_topics,
    make_margin_topics,
    make_plan_topics,
    make_shield_topics,
    refuse_overrun,
)
from soter.language.model import typed
from soter.language.model.system import (
    LEVELS_DEFAULT,
    LEVELS_LEAST,
    Component,
    Disturbance,
    External,
    InputDrive,
    Measurement,
    Metric,
    Module,
    Property,
    Scope,
    System,
    Topic,
)
from soter.language.model.tree_walk import margin_reads, mode_reads, nodes, topic_reads
from soter.language.model.types import ErrorType, FloatType, IntType, default_value, leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics, Help, Span
    from soter.language.elaborate.instantiate import PlacedInstance, ReplacedModule, SubSystem
    from soter.language.model.types import Value

CLEAN_DEFAULT = 3
MAX_CLEAN = 1_000_000
MAX_SUBSTEPS = 1_000
MAX_CELLS = 1_000_000
MAX_BINS = 1_000
MAX_LEVELS = 100
RANK = {"plant": 0, "dm": 1, "sc": 2, "ac": 3, "node": 3}

__all__ = ["Elaborator", "elaborate", "first_outside", "implicit_system", "show_ns"]


class Elaborator(Topics):
    """Flattens one system; `run` may be called once."""

    def __init__(
        self,
        program: typed.TypedProgram,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
        *,
        draft: bool = False,
    ) -> None:
        super().__init__(program, symbol, overrides, diagnostics, draft=draft)
        self.unknown: set[str] = set()
        """Names of components whose period has an error: nothing is said about it again."""
        self.property_reads: list[tuple[int, Span]] = []
        """Topics that properties read, and where."""
        self._plants: dict[str, int] = {}
        self._modules_by_name: dict[str, Module] = {}
        self._margins: list[int] = []
        """Modules whose margin somebody reads."""
        self._shields: dict[int, int] = {}
        """Into how many cells the commands of modules are cut."""

    # ------------------------------------------------------------ the result

    def run(self) -> System | None:
        """Flattens the system; None if it is too large. After errors the result is incomplete."""
        try:
            return self._run() if self.measure.instances() else None
        except TooLargeError:
            return None

    def _run(self) -> System:
        self.walk(self.symbol, "", [])
        self.check_wired_sets()
        components, modules = self._components("node")
        self._modes_in_scope(components, modules)
        properties = self._properties(modules, components)
        inputs = self._inputs()
        externals = self._externals()
        measures = tuple(self.measures())
        self.topics += make_margin_topics(self._margins, modules, len(self.topics))
        self.topics += make_latch_topics(modules, len(self.topics))
        self.topics += make_plan_topics(modules, components, len(self.topics))
        for c in components:
            if c.takes_ns is not None:
                self._hold(c)
        self.topics += make_shield_topics(
            modules, self._shields, self.topics, components, self.diagnostics
        )
        system = System(
            name=self.symbol.name,
            program=self.program,
            topics=tuple(self.topics),
            components=tuple(components),
            modules=tuple(modules),
            properties=tuple(properties),
            inputs=tuple(inputs),
            until_ns=self.long_duration(self.symbol.until, "`until`"),
            params=self.parameters.named,
            hyperperiod_ns=1,
            externals=externals,
        )
        composition = Composition(
            system, self.symbol, self.diagnostics, partial=self.partial, draft=self.draft
        )
        composition.check(self.property_reads)
        self.disturb(system)
        system.measures = measures
        self._idle_settings()
        if not self.unknown:
            system.hyperperiod_ns = hyperperiod(system, self.symbol, self.diagnostics)
        return system

    def disturb(self, system: System) -> None:
        """Enters the faults of the system."""
        if self.symbol.faults:
            place_faults(self, system)
            for f in system.faults:
                if f.kind == "overrun":
                    self._hold(system.components[f.component])
                    refuse_overrun(system, system.components[f.component], f.text, self.diagnostics)
            system.topics = tuple(self.topics)

    def measures(self) -> Iterator[Metric]:
        """Yields the numbers that campaigns report about runs."""
        for item in self.symbol.measures:
            what = f"measure `{item.name}`"
            interval = self.interval(item.low, item.high, item.low.span.to(item.high.span), what)
            bins = self.count(item.bins, "the number of bins", 1, MAX_BINS)
            every = self.duration(item.every, f"`every` of {what}")
            scope = Scope({}, self.parts[0].params)
            self._names_of_property(self.parts[0], [item.value], scope)
            if interval and bins and every:
                low, high = interval
                yield Metric(
                    name=item.name,
                    value=item.value,
                    scope=scope,
                    every_ns=every,
                    low=low,
                    high=high,
                    bins=bins,
                    span=item.span,
                )

    def _idle_settings(self) -> None:
        """Warns W010 of settings that nothing reads, unless parts are missing, which may."""
        settings = self.parameters.of_instances()
        if not settings or self.partial:
            return
        code: list[tuple[str, tuple[object, ...]]] = [
            (part.prefix[:-1], (part.system.properties, part.system.inputs)) for part in self.parts
        ]
        code += [(p.name, (p.symbol, *p.replaced.values())) for p in self.placed]
        code += [
            (
                t.name.removesuffix(t.symbol.name).rstrip("."),
                (t.symbol.values, t.symbol.default, t.symbol.max_age),
            )
            for t in self.topics
        ]
        warn_of_idle_settings(settings, code, self.diagnostics)

    def run_loose(self, topics: list[typed.TopicSymbol]) -> System | None:
        """Checks numbers of declarations outside systems and of `topics`, but no composition."""
        self.partial = True
        try:
            self.walk(self.symbol, "", [])
            components, modules = self._components("sc")
            for topic in topics:
                self.topic(("", topic))
        except TooLargeError:
            return None
        return System(
            name=self.symbol.name,
            program=self.program,
            topics=tuple(self.topics),
            components=tuple(components),
            modules=tuple(modules),
            properties=(),
            inputs=(),
            until_ns=None,
            params={},
            hyperperiod_ns=1,
        )

    def _components(self, role: str) -> tuple[list[Component], list[Module]]:
        """Components, in deployed order, and modules; `role`: that of nodes outside modules."""
        components: list[Component] = []
        pending: list[PlacedInstance] = []
        for placed in self.placed:
            with self.under(placed.params):
                if isinstance(placed.symbol, typed.PlantSymbol):
                    components.append(self._plant(placed, placed.symbol))
                elif isinstance(placed.symbol, typed.NodeSymbol):
                    components.append(self._node(placed, placed.symbol, placed.name, role))
                else:
                    components.extend(self._module_nodes(placed, placed.symbol, len(pending)))
                    pending.append(placed)
        components = _deployed_order(components)
        modules = self._modules(pending, components)
        check_double_response(modules, components, self.diagnostics)
        if not self.partial:
            inlined(self.parts, components, self.diagnostics)
        return components, modules

    def _hold(self, c: Component) -> None:
        """Makes the hidden topic for outputs of steps that take time; these are the last topics.

        First those of nodes that `take` time, then those that only overrun by a fault.
        """
        if c.held is not None or c.node is None or not c.node.publishes:
            return
        topic = held_topic(len(self.topics), c, self.topics)
        if not self.measure.fits(topic.type):
            raise TooLargeError
        c.held = topic.index
        self.topics.append(topic)

    def _period(self, expr: typed.TypedExpr, what: str, name: str) -> int:
        period = self.duration(expr, what)
        if period is None:
            self.unknown.add(name)
            return 1_000_000_000
        return period

    def _scope(self, placed: PlacedInstance, topics: list[typed.TopicSymbol]) -> Scope:
        return Scope(
            {t: self.topic(self.key(t, placed.prefix, placed.wires)) for t in topics},
            placed.params,
        )

    def _first_values(
        self,
        variables: tuple[typed.Variable, ...],
        initial: tuple[typed.TypedExpr | None, ...],
    ) -> tuple[Value, ...]:
        values = []
        for variable, expr in zip(variables, initial, strict=True):
            if not self.measure.fits(variable.type):
                raise TooLargeError
            what = f"the first value of `{variable.name}`"
            value = self.number(expr, what)
            values.append(default_value(variable.type) if value is None else value)
        return tuple(values)

    # ------------------------------------------------------------ plants

    def _plant(self, placed: PlacedInstance, plant: typed.PlantSymbol) -> Component:
        scope = self._scope(placed, [*plant.reads, *(t for t, _ in plant.drives)])
        period = self._period(plant.period, f"the period of plant `{plant.name}`", placed.name)
        states = [v for v in plant.states if not isinstance(v.type, ErrorType)]
        initial = dict(zip(plant.states, plant.initial, strict=True))
        ranges: list[tuple[float, float] | None] = []
        for variable, interval in zip(plant.states, plant.initial_range, strict=True):
            what = f"the start of `{variable.name}`"
            start_range = None
            if interval is not None:
                span = interval[0].span.to(interval[1].span)
                start_range = self.interval(interval[0], interval[1], span, what)
            ranges.append(start_range)
        substeps = self.count(plant.substeps, "the number of substeps", 1, MAX_SUBSTEPS)
        return Component(
            0,
            placed.name,
            "plant",
            period,
            0,
            scope,
            placed.span,
            plant=plant,
            initial=self._first_values(tuple(states), tuple(initial[v] for v in states)),
            initial_range=tuple(ranges),
            substeps=substeps or 1,
            disturbances=tuple(self._disturbance(placed.name, d) for d in plant.disturbances),
            measured=tuple(self._measurements(placed.name, plant, scope)),
            binding=plant.source,
        )

    def _disturbance(self, plant: str, d: typed.DisturbanceSymbol) -> Disturbance:
        name = d.variable.name
        span = d.low.span.to(d.high.span)
        interval = self.interval(d.low, d.high, span, f"disturbance `{name}`") or (0.0, 0.0)
        hold = self.duration(d.hold, f"`hold` of `{name}`")
        streams: tuple[str, ...] = ()
        if not isinstance(d.variable.type, ErrorType):
            paths = [path for path, _ in leaves(d.variable.type)]
            streams = tuple(".".join((plant, name, *path)) for path in paths)
        return Disturbance(d.variable, interval[0], interval[1], hold or 0, streams)

    def _measurements(self, name: str, plant: typed.PlantSymbol, scope: Scope) -> list[Measurement]:
        measurements: list[Measurement] = []
        for m in plant.measured:
            bound = self._bound(m.within, "the bound of an error")
            if bound is None:
                continue
            topic = scope.topics[m.topic]
            for index, (path, _) in enumerate(leaves(m.topic.type)):
                if path[: len(m.path)] == m.path:
                    stream = ".".join((name, m.topic.name, *path))
                    measurements.append(Measurement(topic, index, bound, stream))
        return sorted(measurements, key=lambda m: (m.topic, m.leaf))

    def _bound(self, expr: typed.TypedExpr, what: str) -> float | None:
        """The value of a bound, not negative; None after a report."""
        bound = self.number(expr, what)
        if bound is None or (math.isfinite(bound) and bound >= 0):
            return bound
        self.diagnostics.error(
            "V006",
            f"{what} must be finite and not negative",
            expr.span,
            f"this is {bound!r}",
        )
        return None

    # ------------------------------------------------------------ nodes

    def _node(
        self,
        placed: PlacedInstance,
        node: typed.NodeSymbol,
        name: str,
        role: str,
        module: int | None = None,
    ) -> Component:
        by, stands_for = placed.by_contract.get(node.name), None
        if by is not None:
            self._scope(placed, list(node.publishes))
            node, stands_for = stand_in(node, by, self.diagnostics)
        scope = self._scope(placed, [*(s.topic for s in node.subscribes), *node.publishes])
        for subscribed in node.subscribes:
            if subscribed.queue is not None:
                source = self.topics[scope.topics[subscribed.topic]]
                scope.topics[subscribed.topic] = self.queue(source, subscribed, name)
        period = self._period(node.period, f"the period of node `{node.name}`", name)
        locals_ = [v for v in node.locals if not isinstance(v.type, ErrorType)]
        initial = dict(zip(node.locals, node.initial, strict=True))
        wcet, jitter = budget(self, node)
        return Component(
            0,
            name,
            role,
            period,
            self._phase(node, period, name),
            scope,
            placed.span,
            module=module,
            node=node,
            initial=self._first_values(tuple(locals_), tuple(initial[v] for v in locals_)),
            failsafe=self._failsafe(node, scope),
            binding=node.source,
            stands_for=stands_for,
            takes_ns=self._takes(node, role if module is not None else "node"),
            wcet_ns=wcet,
            jitter_ns=jitter,
        )

    def _takes(self, node: typed.NodeSymbol, role: str) -> tuple[int, int] | None:
        if node.takes is None:
            return None
        what = f"what a step of `{node.name}` takes"
        low, high = (self.duration(e, what) for e in node.takes)
        if low is None or high is None:
            return None
        if node not in self.program.damaged:
            may_take(node, role, (low, high), self.diagnostics)
        return low, max(low, high)

    def _phase(self, node: typed.NodeSymbol, period: int, name: str) -> int:
        phase = self.number(node.phase, "a phase")
        if phase is None or node.phase is None:
            return 0
        if 0 <= phase < period or name in self.unknown:
            return max(int(phase), 0)
        self.diagnostics.error(
            "C004",
            f"the phase of node `{node.name}` must be shorter than its period"
            if phase > 0
            else f"the phase of node `{node.name}` cannot be negative",
            node.phase.span,
            f"this is {show_ns(phase)}",
            also=((node.period.span, f"steps every {show_ns(period)}"),),
        )
        return 0

    def _failsafe(
        self, node: typed.NodeSymbol | typed.ModuleSymbol, scope: Scope
    ) -> dict[int, Value]:
        """Topic -> value published after a step fault, or held after the end of a lease."""
        value_by_topic: dict[int, Value] = {}
        why = (
            "proofs of what acts after the lease speak of values in the set"
            if isinstance(node, typed.ModuleSymbol)
            else "what is published after a step fault must be allowed too"
        )
        for symbol, expr in node.failsafe.items():
            value = self.number(expr, f"the fail-safe value of `{symbol.name}`")
            if value is None:
                continue
            # a queue's: the node reads its own output, which M001 was reported for
            topic = self.topics[self.topics[scope.topics[symbol]].source]
            value_by_topic[topic.index] = value
            self.in_set(
                topic,
                value,
                expr,
                f"the fail-safe value of `{symbol.name}`",
                (why,),
            )
        return value_by_topic

    def in_set(
        self,
        topic: Topic,
        value: Value,
        expr: typed.TypedExpr,
        what: str,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Reports V005 if a value lies outside its topic's set; `what` opens the message."""
        outside = first_outside(topic.type, value, topic.bounds)
        if outside is None or topic.symbol in self.program.damaged:
            return
        leaf, number, bound = outside
        where = f" (`{leaf}`)" if leaf else ""
        self.diagnostics.error(
            "V005",
            f"{what}{where} is {beyond(number, bound)}",
            expr.span,
            also=((topic.symbol.span, "the topic"),),
            notes=notes,
        )

    # ------------------------------------------------------------ modules

    def _module_nodes(
        self, placed: PlacedInstance, module: typed.ModuleSymbol, index: int
    ) -> list[Component]:
        ac, sc = placed.controllers()
        if sc is module.sc:
            self._in_the_same_times(module)
        name = f"{placed.name}.dm"
        period = self._period(module.period, f"the period of module `{module.name}`", name)
        predicates = topic_reads(*module.expressions)
        others = *module.moved, *module.acknowledgements
        reads = list(dict.fromkeys([*module.topics_read, *predicates, *others]))
        scope = self._scope(placed, reads)
        wcet, jitter = budget(self, module)
        ac_name, sc_name = controller_names(placed.name, ac, sc)
        return [
            Component(
                0,
                name,
                "dm",
                period,
                0,
                scope,
                placed.span,
                module=index,
                wcet_ns=wcet,
                jitter_ns=jitter,
            ),
            self._node(placed, sc, sc_name, "sc", index),
            self._node(placed, ac, ac_name, "ac", index),
        ]

    def _in_the_same_times(self, module: typed.ModuleSymbol) -> None:
        """Reports M030 for a plan of several that steps, or is late, at other times."""

        def times(node: typed.NodeSymbol) -> tuple[object, ...]:
            phase = self.number(node.phase, "a phase") or 0
            return self.duration(node.period, "a period"), phase, *budget(self, node)

        for plan in module.plans[1:]:
            if times(plan) != times(module.plans[0]):
                self.diagnostics.error(
                    "M030",
                    f"`{plan.name}` has other times than `{module.plans[0].name}`",
                    plan.span,
                    also=((module.sc_span or module.span, "both are plans here"),),
                    notes=("plans of one module share one place in the calendar",),
                    helps=("give both the same `period`, `phase`, `wcet` and `jitter`",),
                )

    def _modules(self, pending: list[PlacedInstance], components: list[Component]) -> list[Module]:
        roles: list[dict[str, Component]] = [{} for _ in pending]
        for c in components:
            if c.module is not None:
                roles[c.module][c.role] = c
        modules = []
        for i, placed in enumerate(pending):
            with self.under(placed.params):
                modules.append(self._module(placed, i, roles[i]))
        return modules

    def _module(self, placed: PlacedInstance, index: int, by_role: dict[str, Component]) -> Module:
        module = placed.symbol
        assert isinstance(module, typed.ModuleSymbol)
        clean = self.count(module.clean, "`clean`", 1, MAX_CLEAN)
        dm = by_role["dm"]
        outputs = tuple(
            self.topic(self.key(t, placed.prefix, placed.wires)) for t in module.sc.publishes
        )
        for output in outputs:
            self._has_set(self.topics[output], module)
        late_ns, levels = self._verify_block(module)
        if module.rest is not None:
            self.long_duration(module.rest.within, "the time of `rest`")
            for move in module.rest.moves:
                self._bound(move.by, "how far something moves")
        shield = self.count(module.shield, "`shield`", 1, typed.CELLS_MAX)
        if shield is not None:
            self._shields[index] = shield
        return Module(
            index=index,
            name=placed.name,
            symbol=module,
            dm=dm.index,
            ac=by_role["ac"].index,
            sc=by_role["sc"].index,
            period_ns=dm.period_ns,
            scope=dm.scope,
            clean=CLEAN_DEFAULT if clean is None else clean,
            inputs=tuple(dm.scope.topics[t] for t in module.topics_read),
            outputs=outputs,
            forced=placed.forced,
            around=self.params_at[placed.prefix],
            law=self._failsafe(module, self._scope(placed, list(module.failsafe))),
            late_ns=late_ns,
            levels=levels,
        )

    def _has_set(self, topic: Topic, module: typed.ModuleSymbol) -> None:
        """Reports V003 for an output without a set: it bounds what AC may publish (theorem 3.1)."""
        if topic.set_declared or topic.symbol in self.program.damaged:
            return
        bare = [
            ".".join(path)
            for (path, t), bound in zip(leaves(topic.type), topic.bounds, strict=True)
            if bound is None and isinstance(t, (FloatType, IntType))
        ]
        which = f"; `{bare[0]}` has none" if topic.symbol.values and bare[0] else ""
        self.diagnostics.error(
            "V003",
            f"output topic `{topic.symbol.name}` of module `{module.name}` has no value set{which}",
            topic.symbol.span,
            "every value it may take must be known",
            also=((module.span, "gated by this module"),),
            notes=(
                "theorem 3.1 is about everything the advanced controller may do",
                "the gate refuses what lies outside the set",
            ),
            helps=(_missing_set(topic, bare),),
        )

    def _verify_block(self, module: typed.ModuleSymbol) -> tuple[int, int]:
        """Checks the numbers of `verify`; how late the DM may be, in ns, and its levels."""
        verify = module.verify
        self.long_duration(verify.horizon, "`horizon`")
        self.long_duration(verify.recover, "`recover within`")
        levels = self.count(verify.levels, "the number of levels", LEVELS_LEAST, MAX_LEVELS)
        least_time = "the least time of `acts within`"
        delays = {
            "`late dm`": verify.late_dm,
            "`late sc`": verify.late_sc,
            "`response dm`": verify.response_dm,
            "`response sc`": verify.response_sc,
            least_time: verify.acts_least,
            "`acts within`": verify.acts,
            "`dropout`": verify.dropout,
            "`age`": verify.age,
            **{f"`late {n}`": e for n, e in verify.late_of.items()},
            **{f"`response {n}`": e for n, e in verify.response_of.items()},
        }
        value_by_delay = {what: self.delay(expr, what) for what, expr in delays.items()}
        least, most = (value_by_delay[w] for w in (least_time, "`acts within`"))
        self._acts_at_some_time(verify, least, most)
        for block in (verify, *(v.block for v in verify.views)):
            for axis in (a for group in block.groups for a in group.axes):
                self._axis(axis)
        for commands in verify.commands:
            for value in commands.values:
                self._command(commands, value)
        return value_by_delay["`late dm`"] or 0, levels or LEVELS_DEFAULT

    def _acts_at_some_time(
        self, verify: typed.TypedVerifyBlock, least_ns: int | None, most_ns: int | None
    ) -> None:
        """Reports V001 if the least time of `acts within` is above the greatest one."""
        if least_ns is None or most_ns is None or least_ns <= most_ns:
            return
        assert verify.acts_least is not None
        assert verify.acts is not None
        least, most = verify.acts_least.span, verify.acts.span
        self.diagnostics.error(
            "V001",
            f"no command acts {show_ns(least_ns)} to {show_ns(most_ns)} after it",
            least.to(most),
            "the least time is above the greatest one",
            helps=(exchange(least, most, "the other way round"),),
        )

    def _axis(self, axis: typed.TypedGridAxis) -> None:
        self.count(axis.cells, "the number of cells", 1, MAX_CELLS)
        span = axis.low.span.to(axis.high.span)
        interval = self.interval(axis.low, axis.high, span, "a grid axis")
        if interval is not None and interval[0] == interval[1]:
            self.diagnostics.error(
                "V001",
                f"[{interval[0]!r}, {interval[1]!r}] is a point",
                span,
                "an axis has some width",
            )
        if axis.open is None:
            return
        interval = self.interval(
            axis.high, axis.open, axis.open.span, "what is open of a grid axis"
        )
        if interval is not None and interval[0] == interval[1]:
            self.diagnostics.error(
                "V001",
                f"`open to {interval[1]!r}` opens nothing",
                axis.open.span,
                "the axis ends there",
            )

    def _command(self, commands: typed.TypedCommandSet, expr: typed.TypedExpr) -> None:
        """Reports a command of `commands` that lies outside its topic's set."""
        value = self.number(expr, "a command")
        if value is None:
            return
        topics = [t for t in self.topics if t.symbol is commands.topic]
        for topic in topics:
            for (path, _), bound in zip(leaves(topic.type), topic.bounds, strict=True):
                if path != commands.path or bound is None or bound.low <= value <= bound.high:
                    continue
                self.diagnostics.error(
                    "V005",
                    f"the command {value!r} is {beyond(value, bound)}",
                    expr.span,
                    also=((topic.symbol.span, "the topic"),),
                )

    # ------------------------------------------------------------ modes, properties, inputs

    def _modes_in_scope(self, components: list[Component], modules: list[Module]) -> None:
        """Enters in scopes which module instance `mode(M)` means for a node beside it."""
        prefixes = {p.name: p.prefix for p in self.placed}
        beside: dict[tuple[str, object], list[Module]] = {}
        for m in modules:
            beside.setdefault((prefixes[m.name], m.symbol), []).append(m)
        for component in components:
            wanted: dict[typed.ModuleSymbol | str, typed.TypedExpr] = {}
            margins: set[typed.ModuleSymbol | str] = set()
            of = component.module
            home = component.name if of is None else modules[of].name
            if component.node is not None:
                node = component.node
                contracts = (*node.assumes, *node.guarantees)
                code = (*node.step, *(node.takeover or ()), *contracts)
                wanted = mode_reads(*code)
                margins = margin_reads(*code) if wanted else set()
            elif component.role == "dm" and component.module is not None:
                own = modules[component.module].symbol
                wanted = mode_reads(*own.expressions)
                margins = margin_reads(*own.expressions) if wanted else set()
            for symbol, read in wanted.items():
                candidates = beside.get((prefixes[home], symbol), [])
                if len(candidates) == 1:
                    component.scope.modules[symbol] = candidates[0].index
                    self._margins += [candidates[0].index] if symbol in margins else []
                elif isinstance(symbol, typed.ModuleSymbol):
                    self._no_module(symbol, len(candidates), read, f"beside `{component.name}`")

    def _no_module(
        self, symbol: typed.ModuleSymbol, count: int, read: typed.TypedExpr, where: str
    ) -> None:
        if count == 0 and self.partial:
            return
        gone = [g for g in self.gone.values() if g.symbol is symbol]
        if count == 0 and gone:
            self.mode_is_gone(symbol.name, gone[0], read.span)
            return
        self.diagnostics.error(
            "M013",
            f"there is no module `{symbol.name}` {where}"
            if count == 0
            else f"there are {count} modules `{symbol.name}` {where}, and it is not clear which "
            "one is meant",
            read.span,
            "its mode is read here",
            also=((self.symbol.span, "in this system"),),
        )

    def mode_is_gone(self, name: str, gone: ReplacedModule, span: Span) -> None:
        """Reports E016 for a question about a module that a test replaced."""
        self.diagnostics.error(
            "E016",
            f"`{name}` is replaced as a whole: it has no decision module",
            span,
            "asked of it here",
            also=((gone.span, "replaced here"),),
            notes=("of what stands in its place nothing is known but what it publishes",),
            helps=("ask this in a test in which the module runs as it is",),
        )

    def _properties(self, modules: list[Module], components: list[Component]) -> list[Property]:
        """The properties of the system, of its sub-systems, then the contracts of nodes."""
        result: list[Property] = []
        self._plants = {c.name: c.index for c in components if c.role == "plant"}
        self._modules_by_name = {m.name: m for m in modules}
        for part in self.parts:
            for item in part.system.properties:
                scope = self.scope_of_property(part, item)
                text = f"{item.text} in {part.prefix[:-1]}" if part.prefix else item.text
                self.add_property(result, item, scope, text)
        for component in components:
            for kind, expr in _contracts(component):
                text = f"{' '.join(expr.span.text.split())} in {component.name}"
                scope = component.scope
                contract = Property(
                    len(result), kind, expr, scope, text, expr.span, component.index
                )
                result.append(contract)
        for module in modules:
            self._contract_of(module, components, result)
        return result

    def _contract_of(
        self, module: Module, components: list[Component], result: list[Property]
    ) -> None:
        """Adds the clauses of a module's contract, judged when one of its controllers steps."""
        own = [c for c in components if c.module == module.index and c.role in {"ac", "sc"}]
        for clause in module.symbol.contract:
            for c in own:
                text = f"{clause.name} of {module.name}: {clause.text} in {c.name}"
                parts = (clause.kind, clause.condition, module.scope, text, clause.span, c.index)
                result.append(Property(len(result), *parts))

    def add_property(
        self, result: list[Property], item: typed.PropertySymbol, scope: Scope, text: str
    ) -> None:
        """Adds an `always` or `never`; other kinds belong to tests."""
        if item.kind in {"always", "never"} and item.condition is not None:
            prop = Property(len(result), item.kind, item.condition, scope, text, item.span)
            result.append(prop)

    def scope_of_property(self, part: SubSystem, item: typed.PropertySymbol) -> Scope:
        """The scope of a property: what its names mean in its part."""
        scope = Scope({}, part.params)
        roots = [e for e in (item.premise, item.condition) if e is not None]
        self._names_of_property(part, roots, scope)
        return scope

    def _names_of_property(
        self,
        part: SubSystem,
        roots: list[typed.TypedExpr],
        scope: Scope,
    ) -> None:
        """Enters in `scope` what the names in a property mean in its part."""
        plants, modules = self._plants, self._modules_by_name
        for topic, read in topic_reads(*roots).items():
            scope.topics[topic] = self.topic(self.key(topic, part.prefix, part.wires))
            self.property_reads.append((scope.topics[topic], read.span))
        for node in nodes(roots):
            if isinstance(node, typed.TruthRead):
                scope.plants[node.instance] = plants[part.prefix + node.instance]
        for module, mode in mode_reads(*roots).items():
            if isinstance(module, str):
                gone = self.gone.get(part.prefix + module)
                if gone is not None:
                    self.mode_is_gone(part.prefix + module, gone, mode.span)
                    continue
                scope.modules[module] = modules[part.prefix + module].index
                continue
            candidates = [
                m for m in modules.values() if m.symbol is module and m.name.startswith(part.prefix)
            ]
            if len(candidates) == 1:
                scope.modules[module] = candidates[0].index
            else:
                self._no_module(module, len(candidates), mode, "in this system")
        self._margins += [scope.modules[m] for m in margin_reads(*roots) if m in scope.modules]

    def input_items(self) -> Iterator[tuple[SubSystem, typed.InputSymbol]]:
        """Yields `input`s of the system, then those of sub-systems that are not wired."""
        for part in self.parts:
            for item in part.system.inputs:
                if part.prefix and any(item.topic in table for table in part.wires):
                    continue  # it is wired: the outer system drives it
                yield part, item

    def _externals(self) -> tuple[External, ...]:
        """External topics of the system and its parts; the outermost declaration counts."""
        external_by_topic: dict[int, External] = {}
        for part in self.parts:
            for item in part.system.externals:
                index = self.topic(self.key(item.topic, part.prefix, part.wires))
                with self.under(part.params):
                    external_by_topic.setdefault(index, self._external(item, index))
        return tuple(external_by_topic.values())

    def _external(self, item: typed.ExternalSymbol, index: int) -> External:
        what = f"of external topic `{item.topic.name}`"
        every = self.duration(item.every, f"`every` {what}")
        delay = self.delay(item.delayed, f"`delayed` {what}")
        errors: list[float | None] = [None for _ in leaves(item.topic.type)]
        for m in item.measured:
            bound = self._bound(m.within, "the bound of an error")
            for k, (path, _) in enumerate(leaves(item.topic.type)):
                if path[: len(m.path)] == m.path:
                    errors[k] = bound
        return External(index, every, delay, tuple(errors), item.span)

    def _inputs(self) -> list[InputDrive]:
        """How each input topic is drawn; the outermost declaration counts."""
        result: dict[int, InputDrive] = {}
        for part, item in self.input_items():
            index = self.topic(self.key(item.topic, part.prefix, part.wires))
            with self.under(part.params):
                every = self.duration(item.every, f"`every` of `{item.path}`")
                if index in result:
                    continue
                topic = self.topics[index]
                values = self._values(item, topic)
            if not (item.values or topic.set_declared or topic.symbol in self.program.damaged):
                self.diagnostics.error(
                    "V009",
                    f"input topic `{topic.symbol.name}` has no value set to be drawn from",
                    item.span,
                    "drawn here",
                    also=((topic.symbol.span, "declared here"),),
                    helps=(
                        "add a set: `in [-1.0, 1.0]` with your bounds",
                        "or list values where it is drawn: `in { ... }`",
                    ),
                )
            result[index] = InputDrive(index, every or 1_000_000_000, values)
        return list(result.values())

    def _values(self, item: typed.InputSymbol, topic: Topic) -> tuple[Value, ...]:
        """The declared values of an input; reports V005 for one outside the topic's set."""
        values: list[Value] = []
        for expr in item.values:
            value = self.number(expr, "the value of an input")
            if value is None:
                continue
            values.append(value)
            self.in_set(topic, value, expr, f"this value of `{topic.symbol.name}`")
        return tuple(values)


def _missing_set(topic: Topic, bare: Sequence[str]) -> Help:
    """Help that adds a set for the leaves `bare` of a topic."""
    if not topic.symbol.values or not all(bare):
        return "add a set: `in [-1.0, 1.0]` with your bounds"
    last = max((r.span for r in topic.symbol.values.values()), key=lambda s: s.end)
    more = ", ".join(f"{leaf} in [-1.0, 1.0]" for leaf in bare)
    return append(last, f", {more}", f"add to the braces: `{more}` with your bounds")


def _contracts(component: Component) -> list[tuple[str, typed.TypedExpr]]:
    node = component.node
    if node is None:
        return []
    assumed = [("assumes", e) for e in node.assumes]
    return [*assumed, *(("guarantees", e) for e in node.guarantees)]


def _deployed_order(components: list[Component]) -> list[Component]:
    """The components ordered by ruling 5: plants, DMs, SCs, the rest; ties by declaration."""
    ordered = sorted(components, key=lambda c: RANK[c.stands_for.role if c.stands_for else c.role])
    for index, component in enumerate(ordered):
        component.index = index
    return ordered


def elaborate(
    program: typed.TypedProgram,
    symbol: typed.SystemSymbol,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
) -> System | None:
    """Flattens `symbol`; `overrides`: full parameter name -> value. None after an error."""
    return Elaborator(program, symbol, overrides, diagnostics).run()


def implicit_system(program: typed.TypedProgram) -> typed.SystemSymbol | None:
    """The system of a file that declares none: everything in the file, once."""
    used = {n for m in program.modules.values() for n in m.named}
    whats: list[typed.PlantSymbol | typed.ModuleSymbol | typed.NodeSymbol] = [
        *program.plants.values(),
        *program.modules.values(),
        *(n for n in program.nodes.values() if n not in used),
    ]
    own = [w for w in whats if "." not in w.name]
    if not own:
        return None
    instances = tuple(typed.InstanceSymbol(w.name, w, {}, {}, w.span) for w in own)
    return typed.SystemSymbol(
        name="Main",
        span=own[0].span,
        default=True,
        instances=instances,
    )
