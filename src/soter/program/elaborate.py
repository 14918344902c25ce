"""Flatten a system: instances named, parameters fixed, every number computed.

Purpose: `SystemSymbol` + overrides -> `System`, with diagnostics where numbers are wrong
(periods, value sets, defaults) or wiring is.
Non-goals: composition (`composition.py`), P1a and P1b (`wellformed.py`), behaviour, storage.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_const import Calculator
from soter.program.check_decl import show
from soter.program.check_node import UNKNOWN
from soter.program.composition import Composition, hyperperiod
from soter.program.durations import show_ns
from soter.program.measure import Measure
from soter.program.system import (
    Bound,
    Component,
    Disturbance,
    InputDrive,
    Measurement,
    Module,
    Property,
    Scope,
    System,
    Topic,
)
from soter.program.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
    leaves,
)
from soter.program.walk import (
    mode_reads,
    nodes,
    topic_reads,
    topics_beside,
    topics_mentioned,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.program.types import Type, Value

MIN_PERIOD_NS = 1_000
MAX_PERIOD_NS = 3_600_000_000_000
MAX_TIME_NS = 2**62
CLEAN_DEFAULT = 3
MAX_CLEAN = 1_000_000
MAX_SUBSTEPS = 1_000
MAX_CELLS = 1_000_000
MAX_LEVELS = 100
RANK = {"plant": 0, "dm": 1, "sc": 2, "ac": 3, "node": 3}

TopicKey = tuple[str, typed.TopicSymbol]
Wires = dict[typed.TopicSymbol, TopicKey]

__all__ = ["Elaborator", "elaborate", "first_outside", "implicit_system", "show_ns"]


@dataclass(eq=False)
class _Placed:
    """A plant, node or module found while walking the instances."""

    name: str
    symbol: typed.PlantSymbol | typed.NodeSymbol | typed.ModuleSymbol
    prefix: str
    wires: list[Wires]
    span: Span
    forced: str | None = None
    replaced: dict[str, typed.NodeSymbol] = field(default_factory=dict)

    def controllers(self) -> tuple[typed.NodeSymbol, typed.NodeSymbol]:
        """AC and SC of a module, replacements applied."""
        module = self.symbol
        assert isinstance(module, typed.ModuleSymbol)
        ac = self.replaced.get(module.ac.name, module.ac)
        return ac, self.replaced.get(module.sc.name, module.sc)


class Elaborator:
    """One elaboration of one system.

    `draft`: the system is what a file without one would run as; it may be meant for others to
    import, so that topics nobody drives are only warned about.
    """

    def __init__(
        self,
        program: typed.Program,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
        *,
        draft: bool = False,
    ) -> None:
        self.program = program
        self.symbol = symbol
        self.diagnostics = diagnostics
        self.draft = draft
        self.params = self._params(overrides)
        self.calculator = Calculator(diagnostics, self.params)
        self.measure = Measure(symbol, diagnostics)
        self.topics: list[Topic] = []
        self.placed: list[_Placed] = []
        self.unknown: set[str] = set()
        """Names of components whose period has an error: nothing is said about it again."""
        self.partial = symbol in program.damaged or (draft and program.incomplete)
        """Whether something is missing that was reported: then absence is no error."""
        self._by_key: dict[TopicKey, Topic] = {}
        self._ranges: dict[typed.TopicSymbol, tuple[tuple[Bound | None, ...], bool, Value]] = {}

    # ------------------------------------------------------------ parameters

    def _params(self, overrides: Mapping[str, Value]) -> dict[typed.ParamSymbol, Value]:
        values: dict[typed.ParamSymbol, Value] = {}
        sets = {param: (expr, span) for param, expr, span in self.symbol.sets}
        for param in self.program.params.values():
            assert isinstance(param.default, typed.Literal)
            values[param] = param.default.value
            if param.name in overrides:
                values[param] = overrides[param.name]
                self._check_param(param, values[param], param.span, "was set to")
            elif param in sets:
                expr, span = sets[param]
                assert isinstance(expr, typed.Literal)
                values[param] = expr.value
                self._check_param(param, values[param], span, "is set to")
        return values

    def _check_param(self, param: typed.ParamSymbol, value: Value, span: Span, how: str) -> None:
        if not isinstance(param.low, typed.Literal) or not isinstance(param.high, typed.Literal):
            return
        low, high = param.low.value, param.high.value
        if not low <= value <= high:
            shown = [show(x, param.type) for x in (value, low, high)]
            self.diagnostics.error(
                "V007",
                f"parameter `{param.name}` {how} {shown[0]}, outside [{shown[1]}, {shown[2]}]",
                span,
                also=((param.span, "declared here"),) if span is not param.span else (),
            )

    # ------------------------------------------------------------ numbers

    def number(self, expr: typed.Expr, what: str) -> Value | None:
        """The value of a constant expression under this system's parameters."""
        return self.calculator.value(expr, what)

    def duration(self, expr: typed.Expr, what: str) -> int | None:
        """A time in ns, None after a report: C001 when it is impossible, C002 when absurd."""
        if isinstance(expr, typed.Literal) and expr.name == UNKNOWN:
            return None
        value = self.number(expr, what)
        if value is None:
            return None
        assert isinstance(value, int)
        if value <= 0:
            self.diagnostics.error(
                "C001", f"{what} must be longer than zero", expr.span, f"this is {show_ns(value)}"
            )
            return None
        if not MIN_PERIOD_NS <= value <= MAX_PERIOD_NS:
            self.diagnostics.error(
                "C002",
                f"{what} cannot be {show_ns(value)}",
                expr.span,
                f"{show_ns(MIN_PERIOD_NS)} to {show_ns(MAX_PERIOD_NS)} are possible",
            )
            return None
        return value

    def long_duration(self, expr: typed.Expr | None, what: str) -> int | None:
        """The length of a run in ns, None where there is none or after a report."""
        value = self.number(expr, what) if expr is not None else None
        if value is None or expr is None:
            return None
        if value <= 0:
            self.diagnostics.error(
                "C001", f"{what} must be longer than zero", expr.span, f"this is {show_ns(value)}"
            )
            return None
        if value > MAX_TIME_NS:
            self.diagnostics.error(
                "C002", f"{what} is too long", expr.span, "at most 146 years are possible"
            )
            return None
        return int(value)

    def count(self, expr: typed.Expr | None, what: str, low: int, high: int) -> int | None:
        """A whole number in [low, high]; None where there is none or after a report (C002)."""
        value = self.number(expr, what) if expr is not None else None
        if value is None or expr is None:
            return None
        if not low <= value <= high:
            self.diagnostics.error(
                "C002", f"{what} cannot be {value}", expr.span, f"{low} to {high} are possible"
            )
            return None
        return int(value)

    def interval(
        self, low: typed.Expr, high: typed.Expr, span: Span, what: str
    ) -> tuple[float, float] | None:
        """Bounds, None after a report: V006 when they are not finite, V001 when out of order."""
        values = self.number(low, what), self.number(high, what)
        if values[0] is None or values[1] is None:
            return None
        shown = f"[{values[0]!r}, {values[1]!r}]"
        if not all(math.isfinite(v) for v in values):
            self.diagnostics.error(
                "V006", f"{what} must be bounded", span, f"this is {shown}"
            )
            return None
        if values[0] > values[1]:
            self.diagnostics.error(
                "V001", f"{shown} is empty", span, "the lower bound is above the upper one"
            )
            return None
        return values

    # ------------------------------------------------------------ walking instances

    def _walk(self, system: typed.SystemSymbol, prefix: str, outer: list[Wires]) -> None:
        for instance in system.instances:
            name = prefix + instance.name
            what = instance.what
            self.partial = self.partial or what in self.program.damaged
            self._check_wires(instance)
            wires = {
                inner: self._key(target, prefix, outer)
                for inner, target in instance.renames.items()
            }
            if isinstance(what, typed.SystemSymbol):
                self._ignored_sets(what)
                self._walk(what, name + ".", [wires])
                continue
            if isinstance(what, typed.ModuleSymbol):
                damaged = self.program.damaged
                self.partial = self.partial or what.ac in damaged or what.sc in damaged
            self.placed.append(_Placed(name, what, prefix, [wires, *outer], instance.span))
        for path, to, _ in system.forces:
            for placed in self.placed:
                if placed.name == prefix + path:
                    placed.forced = to
        for path, by, span in system.replaces:
            self._replace(prefix, path, by, span)

    def _check_wires(self, instance: typed.InstanceSymbol) -> None:
        """M013 for a wire to a topic that the instance does not have."""
        what = instance.what
        if not instance.renames or what in self.program.damaged:
            return
        is_system = isinstance(what, typed.SystemSymbol)
        known = set(topics_beside(what) if is_system else topics_mentioned(what))
        for topic, span in instance.rename_spans.items():
            if topic not in known:
                self.diagnostics.error(
                    "M013",
                    f"`{instance.name}` has no topic `{topic.name}` that could be wired",
                    span,
                    "left of `=` stands a topic of the instance",
                    also=((what.span, f"`{what.name}` is declared here"),),
                )

    def _ignored_sets(self, inner: typed.SystemSymbol) -> None:
        for param, _, span in inner.sets:
            if all(p is not param for p, _, _ in self.symbol.sets):
                self.diagnostics.warning(
                    "W006",
                    f"`set {param.name}` has no effect in system `{self.symbol.name}`",
                    span,
                    also=((self.symbol.span, f"this system has `{inner.name}` as a part"),),
                    notes=("parameters belong to the program: the system that runs sets them",),
                    helps=(f"repeat it in `{self.symbol.name}`",),
                )

    def _replace(
        self, prefix: str, path: str, by: typed.NodeSymbol | typed.PlantSymbol, span: Span
    ) -> None:
        self.partial = self.partial or by in self.program.damaged
        hit = False
        for placed in self.placed:
            if not placed.name.startswith(prefix):
                continue
            local, symbol = placed.name[len(prefix) :], placed.symbol
            if isinstance(symbol, typed.ModuleSymbol) and isinstance(by, typed.NodeSymbol):
                for node in (symbol.ac, symbol.sc):
                    short = node.name.rsplit(".", 1)[-1]
                    if path in {node.name, short, f"{local}.{short}"}:
                        hit = True
                        self._same_outputs(node, by, span)
                        placed.replaced[node.name] = by
                self._still_two(placed, span)
            elif type(symbol) is type(by) and path in {local, symbol.name}:
                hit = True
                self._same_outputs(symbol, by, span)
                self._same_truth(placed, by, span)
                placed.symbol = by
        if not hit and not self.partial:
            known = [p.name[len(prefix) :] for p in self.placed if p.name.startswith(prefix)]
            what = "plant" if isinstance(by, typed.PlantSymbol) else "node"
            self.diagnostics.error(
                "M013",
                f"this system has no {what} `{path}` to replace",
                span,
                notes=("its instances are " + ", ".join(f"`{n}`" for n in known[:12]),)
                if known
                else (),
            )

    def _same_outputs(self, old: object, new: object, span: Span) -> None:
        def outputs(s: object) -> set[typed.TopicSymbol]:
            if isinstance(s, typed.NodeSymbol):
                return set(s.publishes)
            return {t for t, _ in s.drives} if isinstance(s, typed.PlantSymbol) else set()

        if outputs(old) == outputs(new) or {old, new} & self.program.damaged:
            return
        assert isinstance(old, typed.Symbol)
        assert isinstance(new, typed.Symbol)
        self.diagnostics.error(
            "M014",
            f"`{new.name}` does not publish what `{old.name}` publishes",
            span,
            also=(
                (old.span, f"publishes {_names(outputs(old))}"),
                (new.span, f"publishes {_names(outputs(new))}"),
            ),
            helps=("a replacement offers the same topics",),
        )

    def _same_truth(self, placed: _Placed, by: object, span: Span) -> None:
        """M014 where a property reads a state that the replacement does not have."""
        if not isinstance(by, typed.PlantSymbol):
            return
        conditions = [p.condition for p in self.symbol.properties]
        for node in nodes(conditions):
            read = isinstance(node, typed.TruthRead) and node.instance == placed.name
            if read and node.type != by.truth:
                self.diagnostics.error(
                    "M014",
                    f"`{by.name}` has other states than `{placed.symbol.name}`",
                    span,
                    also=((node.span, "but a property reads them here"),),
                    helps=("declare the same states, in the same order",),
                )
                return

    def _still_two(self, placed: _Placed, span: Span) -> None:
        """AC != SC also after a replacement."""
        ac, sc = placed.controllers()
        module = placed.symbol
        assert isinstance(module, typed.ModuleSymbol)
        if ac is sc and module.ac is not module.sc:
            self.diagnostics.error(
                "M002",
                f"with this, `{ac.name}` is both AC and SC of module `{module.name}`",
                span,
                also=((module.span, "the module"),),
                helps=("to run one controller alone, write `force M ac;` or `force M sc;`",),
            )

    # ------------------------------------------------------------ topics

    def _key(self, topic: typed.TopicSymbol, prefix: str, wires: list[Wires]) -> TopicKey:
        stand_in = self.program.stand_ins.get(topic)
        if stand_in is not None:
            path, real = stand_in
            return self._sub_key(prefix, path, real)
        for table in wires:
            if topic in table:
                return table[topic]
        return prefix, topic

    def _sub_key(self, prefix: str, path: tuple[str, ...], topic: typed.TopicSymbol) -> TopicKey:
        """The key of a sub-system's topic, following the wires on the way down."""
        system: object = self.symbol
        at = ""
        outer: list[Wires] = []
        for part in [*filter(None, prefix.split(".")), *path]:
            if not isinstance(system, typed.SystemSymbol):
                break
            instance = next(i for i in system.instances if i.name == part)
            outer = [{i: self._key(t, at, outer) for i, t in instance.renames.items()}]
            at += part + "."
            system = instance.what
        for table in outer:
            if topic in table:
                return table[topic]
        return at, topic

    def topic(self, key: TopicKey) -> int:
        """Index of a topic, entered on first mention."""
        known = self._by_key.get(key)
        if known is None:
            prefix, symbol = key
            self.measure.add(symbol.type)
            if symbol not in self._ranges:
                bounds, declared = self._bounds(symbol)
                self._ranges[symbol] = bounds, declared, self._default(symbol, bounds)
            bounds, declared, default = self._ranges[symbol]
            max_age = None
            if symbol.max_age is not None:
                max_age = self.duration(symbol.max_age, f"`max_age` of `{symbol.name}`")
            known = Topic(
                len(self.topics),
                prefix + symbol.name,
                symbol,
                symbol.type,
                bounds,
                declared,
                default,
                max_age,
                "",
            )
            self._by_key[key] = known
            self.topics.append(known)
        return known.index

    def _bounds(self, symbol: typed.TopicSymbol) -> tuple[tuple[Bound | None, ...], bool]:
        """A bound for each leaf, and whether every number has one."""
        what = f"the set of `{symbol.name}`"
        resolved: dict[tuple[str, ...], Bound] = {}
        declared = True
        for path, values in symbol.values.items():
            interval = self.interval(values.low, values.high, values.span, what)
            if interval is not None:
                resolved[path] = Bound(*interval)
            else:
                self._unreliable(symbol)
        bounds: list[Bound | None] = []
        for path, t in leaves(symbol.type):
            bound = next(
                (resolved[path[:n]] for n in range(len(path), -1, -1) if path[:n] in resolved),
                None,
            )
            if bound is None and isinstance(t, IntType) and not t.is_full:
                bound = Bound(t.low, t.high)
            number = isinstance(t, (FloatType, IntType))
            declared = declared and (bound is not None or not number)
            bounds.append(bound if number else None)
        return tuple(bounds), declared

    def _unreliable(self, symbol: typed.TopicSymbol) -> None:
        """Its set has an error: nothing is said about what follows from it."""
        self.program.damaged.add(symbol)

    def _default(self, symbol: typed.TopicSymbol, bounds: tuple[Bound | None, ...]) -> Value:
        """The first value; V002 where it lies outside the set."""
        written = symbol.default
        what = f"the default of `{symbol.name}`"
        value = self.number(written, what) if written is not None else None
        if value is None:
            value = default_value(symbol.type)
        if symbol in self.program.damaged:
            return value
        outside = first_outside(symbol.type, value, bounds)
        if outside is not None:
            leaf, number, bound = outside
            where = f" (`{leaf}`)" if leaf else ""
            sets = tuple((r.span, "its set") for r in symbol.values.values())
            self.diagnostics.error(
                "V002",
                f"{what}{where} is {number!r}, outside {bound}",
                written.span if written is not None else symbol.span,
                f"starts at {number!r}" if written is None else "",
                also=sets if len(sets) == 1 else (),
                notes=()
                if written is not None
                else ("without `= ...` a topic starts at the default of its type",),
                helps=(f"give it a first value in {bound}: `= ...`",) if written is None else (),
            )
        return value

    # ------------------------------------------------------------ the result

    def run(self) -> System | None:
        """Flatten; None where the system is too large, meaningful only without errors."""
        if not self.measure.instances(self.program):
            return None
        self._walk(self.symbol, "", [])
        components: list[Component] = []
        pending: list[_Placed] = []
        for placed in self.placed:
            if isinstance(placed.symbol, typed.PlantSymbol):
                components.append(self._plant(placed, placed.symbol))
            elif isinstance(placed.symbol, typed.NodeSymbol):
                components.append(self._node(placed, placed.symbol, placed.name, "node"))
            else:
                components.extend(self._module_nodes(placed, placed.symbol, len(pending)))
                pending.append(placed)
            if self.measure.exceeded:
                return None
        components = _deployed_order(components)
        modules = self._modules(pending, components)
        self._modes_in_scope(components, modules)
        properties = self._properties(modules, components)
        inputs = self._inputs()
        system = System(
            self.symbol.name,
            self.program,
            tuple(self.topics),
            tuple(components),
            tuple(modules),
            tuple(properties),
            tuple(inputs),
            self.long_duration(self.symbol.until, "`until`"),
            {p.name: v for p, v in self.params.items()},
            1,
        )
        composition = Composition(
            system, self.symbol, self.diagnostics, partial=self.partial, draft=self.draft
        )
        composition.check()
        if not self.unknown:
            system.hyperperiod_ns = hyperperiod(system, self.symbol, self.diagnostics)
        return None if self.measure.exceeded else system

    def run_loose(self, topics: list[typed.TopicSymbol]) -> System | None:
        """Check the numbers of declarations that no system has, and of `topics`; no composition."""
        if not self.measure.instances(self.program):
            return None
        self.partial = True
        self._walk(self.symbol, "", [])
        components: list[Component] = []
        pending: list[_Placed] = []
        for placed in self.placed:
            if isinstance(placed.symbol, typed.PlantSymbol):
                components.append(self._plant(placed, placed.symbol))
            elif isinstance(placed.symbol, typed.NodeSymbol):
                components.append(self._node(placed, placed.symbol, placed.name, "sc"))
            else:
                components.extend(self._module_nodes(placed, placed.symbol, len(pending)))
                pending.append(placed)
        components = _deployed_order(components)
        modules = self._modules(pending, components)
        for topic in topics:
            self.topic(("", topic))
        if self.measure.exceeded:
            return None
        parts = (tuple(self.topics), tuple(components), tuple(modules))
        return System(self.symbol.name, self.program, *parts, (), (), None, {}, 1)

    def skew(self, expr: typed.Expr | None) -> None:
        """The skew of a test: zero is allowed."""
        value = self.number(expr, "`skew`") if expr is not None else None
        if expr is not None and value is not None and not 0 <= value <= MAX_PERIOD_NS:
            self.diagnostics.error(
                "C002",
                f"`skew` cannot be {show_ns(value)}",
                expr.span,
                f"0 s to {show_ns(MAX_PERIOD_NS)} are possible",
            )

    def _period(self, expr: typed.Expr, what: str, name: str) -> int:
        period = self.duration(expr, what)
        if period is None:
            self.unknown.add(name)
            return 1_000_000_000
        return period

    def _scope(self, placed: _Placed, topics: list[typed.TopicSymbol]) -> Scope:
        return Scope(
            {t: self.topic(self._key(t, placed.prefix, placed.wires)) for t in topics},
            self.params,
        )

    def _first_values(
        self, variables: tuple[typed.Variable, ...], initial: tuple[typed.Expr | None, ...]
    ) -> tuple[Value, ...]:
        found = []
        for variable, expr in zip(variables, initial, strict=True):
            self.measure.add(variable.type)
            what = f"the first value of `{variable.name}`"
            value = self.number(expr, what) if expr is not None else None
            found.append(default_value(variable.type) if value is None else value)
        return tuple(found)

    # ------------------------------------------------------------ plants

    def _plant(self, placed: _Placed, plant: typed.PlantSymbol) -> Component:
        scope = self._scope(placed, [*plant.reads, *(t for t, _ in plant.drives)])
        period = self._period(plant.period, f"the period of plant `{plant.name}`", placed.name)
        states = [v for v in plant.states if not self._is_damaged(v)]
        initial = {v: i for v, i in zip(plant.states, plant.initial, strict=True)}
        ranges: list[tuple[float, float] | None] = []
        for variable, interval in zip(plant.states, plant.initial_range, strict=True):
            what = f"the start of `{variable.name}`"
            found = None
            if interval is not None:
                span = interval[0].span.to(interval[1].span)
                found = self.interval(interval[0], interval[1], span, what)
            ranges.append(found)
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

    @staticmethod
    def _is_damaged(variable: typed.Variable) -> bool:
        return str(variable.type) == "<error>"

    def _disturbance(self, plant: str, d: typed.DisturbanceSymbol) -> Disturbance:
        name = d.variable.name
        span = d.low.span.to(d.high.span)
        interval = self.interval(d.low, d.high, span, f"disturbance `{name}`") or (0.0, 0.0)
        hold = None
        if d.hold is not None:
            hold = self.duration(d.hold, f"`hold` of `{name}`")
        streams: tuple[str, ...] = ()
        if not self._is_damaged(d.variable):
            paths = [path for path, _ in leaves(d.variable.type)]
            streams = tuple(".".join((plant, name, *path)) for path in paths)
        return Disturbance(d.variable, interval[0], interval[1], hold or 0, streams)

    def _measurements(
        self, name: str, plant: typed.PlantSymbol, scope: Scope
    ) -> list[Measurement]:
        found: list[Measurement] = []
        for m in plant.measured:
            bound = self.number(m.within, "the bound of an error")
            if bound is None:
                continue
            if not (math.isfinite(bound) and bound >= 0):
                self.diagnostics.error(
                    "V006",
                    "the bound of an error must be finite and not negative",
                    m.within.span,
                    f"this is {bound!r}",
                )
                continue
            topic = scope.topics[m.topic]
            for index, (path, _) in enumerate(leaves(m.topic.type)):
                if path[: len(m.path)] == m.path:
                    stream = ".".join((name, m.topic.name, *path))
                    found.append(Measurement(topic, index, bound, stream))
        return sorted(found, key=lambda m: (m.topic, m.leaf))

    # ------------------------------------------------------------ nodes

    def _node(
        self,
        placed: _Placed,
        node: typed.NodeSymbol,
        name: str,
        role: str,
        module: int | None = None,
    ) -> Component:
        scope = self._scope(placed, [*(s.topic for s in node.subscribes), *node.publishes])
        period = self._period(node.period, f"the period of node `{node.name}`", name)
        self._takeover_in_module(node, role)
        locals_ = [v for v in node.locals if not self._is_damaged(v)]
        initial = {v: i for v, i in zip(node.locals, node.initial, strict=True)}
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
        )

    def _phase(self, node: typed.NodeSymbol, period: int, name: str) -> int:
        phase = self.number(node.phase, "a phase") if node.phase is not None else None
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

    def _takeover_in_module(self, node: typed.NodeSymbol, role: str) -> None:
        if node.takeover is not None and role == "node":
            self.diagnostics.error(
                "M015",
                f"`{node.name}` has `on takeover`, but is in control all the time",
                node.span,
                also=((self.symbol.span, "in this system it belongs to no module"),),
                notes=("control is taken and given back inside an `rta` module only",),
                helps=("leave the block out, or make the node the AC or SC of a module",),
            )

    def _failsafe(self, node: typed.NodeSymbol, scope: Scope) -> dict[int, Value]:
        found: dict[int, Value] = {}
        for symbol, expr in node.failsafe.items():
            value = self.number(expr, f"the fail-safe value of `{symbol.name}`")
            if value is None:
                continue
            topic = self.topics[scope.topics[symbol]]
            found[topic.index] = value
            outside = first_outside(topic.type, value, topic.bounds)
            if outside is not None and topic.symbol not in self.program.damaged:
                leaf, number, bound = outside
                where = f" (`{leaf}`)" if leaf else ""
                self.diagnostics.error(
                    "V005",
                    f"the fail-safe value of `{symbol.name}`{where} is {number!r}, outside {bound}",
                    expr.span,
                    also=((topic.symbol.span, "the topic"),),
                    notes=("what is published after a step fault must be allowed too",),
                )
        return found

    # ------------------------------------------------------------ modules

    def _module_nodes(
        self, placed: _Placed, module: typed.ModuleSymbol, index: int
    ) -> list[Component]:
        ac, sc = placed.controllers()
        name = f"{placed.name}.dm"
        period = self._period(module.period, f"the period of module `{module.name}`", name)
        predicates = [e for e in (module.safe, module.ttf, module.safer) if e is not None]
        reads = list(dict.fromkeys([*module.topics_read, *topic_reads(*predicates)]))
        scope = self._scope(placed, reads)
        names = [f"{placed.name}.{n.name.rsplit('.', 1)[-1]}" for n in (ac, sc)]
        return [
            Component(0, name, "dm", period, 0, scope, placed.span, module=index),
            self._node(placed, sc, names[1], "sc", index),
            self._node(placed, ac, names[0], "ac", index),
        ]

    def _modules(self, pending: list[_Placed], components: list[Component]) -> list[Module]:
        roles: list[dict[str, Component]] = [{} for _ in pending]
        for c in components:
            if c.module is not None:
                roles[c.module][c.role] = c
        return [self._module(p, i, roles[i]) for i, p in enumerate(pending)]

    def _module(self, placed: _Placed, index: int, by_role: dict[str, Component]) -> Module:
        module = placed.symbol
        assert isinstance(module, typed.ModuleSymbol)
        clean = self.count(module.clean, "`clean`", 1, MAX_CLEAN)
        dm = by_role["dm"]
        outputs = tuple(
            self.topic(self._key(t, placed.prefix, placed.wires)) for t in module.sc.publishes
        )
        for output in outputs:
            self._has_set(self.topics[output], module)
        self._verify_block(module)
        return Module(
            index,
            placed.name,
            module,
            dm.index,
            by_role["ac"].index,
            by_role["sc"].index,
            dm.period_ns,
            dm.scope,
            CLEAN_DEFAULT if clean is None else clean,
            tuple(dm.scope.topics[t] for t in module.topics_read),
            outputs,
            placed.forced,
        )

    def _has_set(self, topic: Topic, module: typed.ModuleSymbol) -> None:
        """The theorem's "*": all the values that the AC may publish."""
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
                "theorem 3.1 is about everything the advanced controller may do: "
                "the gate refuses what lies outside the set",
            ),
            helps=("add a set: `in [-1.0, 1.0]` with your bounds",),
        )

    def _verify_block(self, module: typed.ModuleSymbol) -> None:
        """Numbers that only `soter verify` needs, checked now."""
        self.long_duration(module.horizon, "`horizon`")
        self.count(module.levels, "the number of levels", 2, MAX_LEVELS)
        for axis in module.grid:
            self.interval(axis.low, axis.high, axis.low.span.to(axis.high.span), "a grid axis")
            self.count(axis.cells, "the number of cells", 1, MAX_CELLS)

    # ------------------------------------------------------------ modes, properties, inputs

    def _modes_in_scope(self, components: list[Component], modules: list[Module]) -> None:
        """Let nodes read `mode(M)` of a module instance beside them."""
        prefixes = {p.name: p.prefix for p in self.placed}
        beside: dict[tuple[str, object], list[Module]] = {}
        for m in modules:
            beside.setdefault((prefixes[m.name], m.symbol), []).append(m)
        for component in components:
            wanted: dict[typed.ModuleSymbol | str, typed.Expr] = {}
            home = component.name
            if component.module is not None:
                home = modules[component.module].name
            if component.node is not None:
                wanted = mode_reads(*component.node.step, *(component.node.takeover or ()))
            elif component.role == "dm" and component.module is not None:
                m = modules[component.module].symbol
                wanted = mode_reads(*(e for e in (m.safe, m.ttf, m.safer) if e is not None))
            for symbol, read in wanted.items():
                found = beside.get((prefixes[home], symbol), [])
                if len(found) == 1:
                    component.scope.modules[symbol] = found[0].index
                elif isinstance(symbol, typed.ModuleSymbol):
                    self._no_module(symbol, len(found), read, f"beside `{component.name}`")

    def _no_module(
        self, symbol: typed.ModuleSymbol, count: int, read: typed.Expr, where: str
    ) -> None:
        if count == 0 and self.partial:
            return
        self.diagnostics.error(
            "M013",
            f"there {'is no' if count == 0 else f'are {count}'} module `{symbol.name}` {where}"
            f"{'' if count == 0 else ', so it is not clear which one is meant'}",
            read.span,
            "its mode is read here",
            also=((self.symbol.span, "in this system"),),
        )

    def _properties(self, modules: list[Module], components: list[Component]) -> list[Property]:
        result: list[Property] = []
        scope = Scope({}, self.params)
        scope.plants = {c.name: c.index for c in components if c.role == "plant"}
        scope.modules = {m.name: m.index for m in modules}
        counts: dict[object, int] = {}
        for m in modules:
            counts[m.symbol] = counts.get(m.symbol, 0) + 1
            scope.modules[m.symbol] = m.index
        for item in self.symbol.properties:
            roots = [e for e in (item.premise, item.condition) if e is not None]
            for topic in topic_reads(*roots):
                scope.topics[topic] = self.topic(self._key(topic, "", []))
            for module, read in mode_reads(*roots).items():
                if isinstance(module, typed.ModuleSymbol) and counts.get(module) != 1:
                    self._no_module(module, counts.get(module, 0), read, "in this system")
            if item.within is not None:
                self.long_duration(item.within, "`within`")
            if item.kind in {"always", "never"}:
                result.append(
                    Property(len(result), item.kind, item.condition, scope, item.text, item.span)
                )
        return result

    def _inputs(self) -> list[InputDrive]:
        result = []
        for item in self.symbol.inputs:
            index = self.topic(self._key(item.topic, "", []))
            every = self.duration(item.every, f"`every` of `{item.path}`")
            topic = self.topics[index]
            if not topic.set_declared and topic.symbol not in self.program.damaged:
                self.diagnostics.error(
                    "V009",
                    f"input topic `{topic.symbol.name}` has no value set to be drawn from",
                    item.span,
                    "drawn here",
                    also=((topic.symbol.span, "declared here"),),
                    helps=("add a set: `in [-1.0, 1.0]` with your bounds",),
                )
            result.append(InputDrive(index, every or 1_000_000_000))
        return result


def _deployed_order(components: list[Component]) -> list[Component]:
    """Ruling 5: plants, DMs, SCs, the rest; ties by declaration."""
    ordered = sorted(components, key=lambda c: RANK[c.role])
    for index, component in enumerate(ordered):
        component.index = index
    return ordered


def _names(topics: set[typed.TopicSymbol]) -> str:
    return ", ".join(sorted(f"`{t.name}`" for t in topics)) or "nothing"


def first_outside(
    t: Type, value: Value, bounds: tuple[Bound | None, ...]
) -> tuple[str, float, Bound] | None:
    """The first leaf of a value outside its bound: (path, value, bound), or None."""
    found, _ = _outside(t, value, bounds, 0, "")
    return found


def _outside(
    t: Type, value: Value, bounds: tuple[Bound | None, ...], at: int, path: str
) -> tuple[tuple[str, float, Bound] | None, int]:
    """The first leaf outside, and the position in `bounds` behind this value's leaves."""
    if isinstance(t, RecordType):
        for (name, ft), fv in zip(t.fields, value, strict=True):
            found, at = _outside(ft, fv, bounds, at, f"{path}.{name}" if path else name)
            if found is not None:
                return found, at
        return None, at
    if isinstance(t, ArrayType):
        for i, e in enumerate(value):
            found, at = _outside(t.element, e, bounds, at, f"{path}[{i}]")
            if found is not None:
                return found, at
        return None, at
    if isinstance(t, ListType):
        after = at + sum(1 for _ in leaves(t.element))
        for i, e in enumerate(value):
            found, _ = _outside(t.element, e, bounds, at, f"{path}[{i}]")
            if found is not None:
                return found, after
        return None, after
    bound = bounds[at]
    if bound is None and isinstance(t, FloatType) and not math.isfinite(value):
        bound = Bound(-math.inf, math.inf)
    inside = isinstance(t, (BoolType, EnumType)) or bound is None
    if inside or (bound.low <= value <= bound.high and math.isfinite(value)):
        return None, at + 1
    return (path, value, bound), at + 1


def elaborate(
    program: typed.Program,
    symbol: typed.SystemSymbol,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
) -> System | None:
    """Flatten `symbol`; `overrides` maps full parameter names to values. None after an error."""
    return Elaborator(program, symbol, overrides, diagnostics).run()


def implicit_system(program: typed.Program) -> typed.SystemSymbol | None:
    """For a file without systems: everything it declares, once."""
    used = {n for m in program.modules.values() for n in (m.ac, m.sc)}
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
        "Main", own[0].span, True, instances, None, (), (), (), (), ()  # noqa: FBT003
    )
