"""Flatten a system: instances named, parameters fixed, every number computed.

Purpose: `SystemSymbol` + overrides -> `System`, with diagnostics where numbers are wrong
(periods, value sets, defaults) or the composition is (two drivers, nobody drives).
Non-goals: P1a and P1b (`wellformed.py`), behaviour, storage.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.arith import StepFault
from soter.program.evaluate import BudgetExceeded, Evaluator
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
    DurationType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    ArrayType,
    default_value,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.program.types import Type, Value

MIN_PERIOD_NS = 1_000
MAX_PERIOD_NS = 3_600_000_000_000
MAX_HYPERPERIOD_NS = 2**62
CLEAN_DEFAULT = 3
RANK = {"plant": 0, "dm": 1, "sc": 2, "ac": 3, "node": 3}

TopicKey = tuple[str, typed.TopicSymbol]
Mapping_ = dict[typed.TopicSymbol, TopicKey]


def instance_path(prefix: str, name: str) -> str:
    """Full name of an instance below a prefix such as `left.`."""
    return prefix + name


@dataclass(eq=False)
class _Placed:
    """A plant, node or module found while walking the instances."""

    kind: str
    name: str
    symbol: typed.PlantSymbol | typed.NodeSymbol | typed.ModuleSymbol
    prefix: str
    renames: list[dict[typed.TopicSymbol, TopicKey]]
    span: Span
    forced: str | None = None
    replaced: dict[str, typed.NodeSymbol] = field(default_factory=dict)


class Elaborator:
    """One elaboration of one system."""

    def __init__(
        self,
        program: typed.Program,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
    ) -> None:
        self.program = program
        self.symbol = symbol
        self.diagnostics = diagnostics
        self.params = self._params(overrides)
        self.evaluator = Evaluator(self.params, None, 2_000_000)
        self.topics: dict[TopicKey, Topic] = {}
        self.placed: list[_Placed] = []
        self.plant_index: dict[str, int] = {}
        self.module_index: dict[str, int] = {}

    # ------------------------------------------------------------ numbers

    def _params(self, overrides: Mapping[str, Value]) -> dict[typed.ParamSymbol, Value]:
        values: dict[typed.ParamSymbol, Value] = {}
        basic = Evaluator({}, None, 2_000_000)
        chosen: dict[typed.ParamSymbol, tuple[typed.Expr, Span]] = {
            p: (p.default, p.span) for p in self.program.params.values()
        }
        for param, expr, span in self.symbol.sets:
            chosen[param] = (expr, span)
        for param, (expr, span) in chosen.items():
            if param.name in overrides:
                values[param] = overrides[param.name]
                span = param.span
            else:
                value = self._try(basic, expr)
                values[param] = default_value(param.type) if value is None else value
            self._check_param(param, values[param], span, basic)
        return values

    def _check_param(
        self, param: typed.ParamSymbol, value: Value, span: Span, basic: Evaluator
    ) -> None:
        if param.low is None or param.high is None:
            return
        low, high = self._try(basic, param.low), self._try(basic, param.high)
        if low is not None and high is not None and not low <= value <= high:
            unit = " ns" if isinstance(param.type, DurationType) else ""
            self.diagnostics.error(
                "V007",
                f"parameter `{param.name}` = {value}{unit} is outside [{low}, {high}]{unit}",
                span,
            )

    def _try(self, evaluator: Evaluator, expr: typed.Expr) -> Value | None:
        try:
            return evaluator.value(expr)
        except StepFault as fault:
            self.diagnostics.error(
                "T008", f"this has no value: {fault.kind.name.lower()}", expr.span
            )
        except BudgetExceeded:
            self.diagnostics.error("T008", "computing this takes too long", expr.span)
        return None

    def number(self, expr: typed.Expr) -> Value | None:
        """The value of a constant expression under this system's parameters."""
        return self._try(self.evaluator, expr)

    def duration(self, expr: typed.Expr, what: str) -> int:
        """A period in ns; C001/C002 when it is impossible or absurd; 1 s then, to go on."""
        value = self.number(expr)
        if value is None:
            return 1_000_000_000
        assert isinstance(value, int)
        if isinstance(expr, typed.Literal) and expr.name == "<error>":
            return 1_000_000_000
        if value <= 0:
            self.diagnostics.error(
                "C001", f"{what} must be longer than zero", expr.span, show_ns(value)
            )
            return 1_000_000_000
        if not MIN_PERIOD_NS <= value <= MAX_PERIOD_NS:
            self.diagnostics.error(
                "C002",
                f"{what} of {show_ns(value)} is absurd: 1 us to 1 h are possible",
                expr.span,
            )
            return 1_000_000_000
        return value

    # ------------------------------------------------------------ walking instances

    def _walk(
        self, system: typed.SystemSymbol, prefix: str,
        outer: list[dict[typed.TopicSymbol, TopicKey]],
    ) -> None:
        for instance in system.instances:
            name = prefix + instance.name
            what = instance.what
            renames = {
                inner: self._key(target, prefix, outer)
                for inner, target in instance.renames.items()
            }
            if isinstance(what, typed.SystemSymbol):
                self._walk(what, name + ".", [renames])
                continue
            kind = {
                typed.PlantSymbol: "plant", typed.NodeSymbol: "node", typed.ModuleSymbol: "module",
            }[type(what)]
            self.placed.append(
                _Placed(kind, name, what, prefix, [renames, *outer], instance.span)
            )
        self._apply(system, prefix)

    def _apply(self, system: typed.SystemSymbol, prefix: str) -> None:
        for path, to, _ in system.forces:
            for placed in self.placed:
                if placed.kind == "module" and placed.name == prefix + path:
                    placed.forced = to
        for path, by, span in system.replaces:
            self._replace(prefix, path, by, span)

    def _replace(
        self, prefix: str, path: str, by: typed.NodeSymbol | typed.PlantSymbol, span: Span
    ) -> None:
        hit = False
        for placed in self.placed:
            if not placed.name.startswith(prefix):
                continue
            local = placed.name[len(prefix) :]
            if isinstance(placed.symbol, typed.ModuleSymbol) and isinstance(by, typed.NodeSymbol):
                for node in (placed.symbol.ac, placed.symbol.sc):
                    short = node.name.rsplit(".", 1)[-1]
                    if path in {node.name, short, f"{local}.{short}"}:
                        hit = True
                        self._same_topics(node, by, span)
                        placed.replaced[node.name] = by
            elif type(placed.symbol) is type(by) and path in {local, placed.symbol.name}:
                hit = True
                self._same_topics(placed.symbol, by, span)
                placed.symbol = by
        if not hit:
            self.diagnostics.error(
                "M013", f"there is nothing called `{path}` to replace in this system", span
            )

    def _same_topics(self, old: object, new: object, span: Span) -> None:
        def outputs(s: object) -> set[typed.TopicSymbol]:
            if isinstance(s, typed.NodeSymbol):
                return set(s.publishes)
            return {t for t, _ in s.drives} if isinstance(s, typed.PlantSymbol) else set()

        if outputs(old) != outputs(new):
            old_names = ", ".join(sorted(f"`{t.name}`" for t in outputs(old)))
            new_names = ", ".join(sorted(f"`{t.name}`" for t in outputs(new)))
            self.diagnostics.error(
                "M014",
                f"the replacement publishes {new_names or 'nothing'} instead of {old_names}",
                span,
                helps=("a replacement must offer the same topics",),
            )

    def _key(
        self, topic: typed.TopicSymbol, prefix: str,
        renames: list[dict[typed.TopicSymbol, TopicKey]],
    ) -> TopicKey:
        stand_in = self.program.stand_ins.get(topic)
        if stand_in is not None:
            path, real = stand_in
            return self._sub_key(prefix, path, real)
        for table in renames:
            if topic in table:
                return table[topic]
        return prefix, topic

    def _sub_key(self, prefix: str, path: tuple[str, ...], topic: typed.TopicSymbol) -> TopicKey:
        """The key of a sub-system's topic, following the renames on the way down."""
        system: object = self.symbol
        at = ""
        outer: list[dict[typed.TopicSymbol, TopicKey]] = []
        full = [*filter(None, prefix.split(".")), *path]
        for part in full:
            if not isinstance(system, typed.SystemSymbol):
                break
            instance = next(i for i in system.instances if i.name == part)
            outer = [
                {i: self._key(t, at, outer) for i, t in instance.renames.items()}
            ]
            at += part + "."
            system = instance.what
        for table in outer:
            if topic in table:
                return table[topic]
        return at, topic

    def topic(self, key: TopicKey) -> int:
        """Index of a topic, entered on first mention."""
        known = self.topics.get(key)
        if known is None:
            known = self._new_topic(key)
            self.topics[key] = known
        return known.index

    def _new_topic(self, key: TopicKey) -> Topic:
        prefix, symbol = key
        bounds, declared = self._bounds(symbol)
        default = self._default(symbol, bounds)
        max_age = None
        if symbol.max_age is not None:
            max_age = self.duration(symbol.max_age, f"`max_age` of `{symbol.name}`")
        return Topic(
            len(self.topics), prefix + symbol.name, symbol, symbol.type, bounds, declared,
            default, max_age, "",
        )

    def _bounds(self, symbol: typed.TopicSymbol) -> tuple[tuple[Bound | None, ...], bool]:
        resolved: dict[tuple[str, ...], Bound] = {}
        for path, values in symbol.values.items():
            low, high = self.number(values.low), self.number(values.high)
            if low is None or high is None:
                continue
            if not (math.isfinite(low) and math.isfinite(high)):
                self.diagnostics.error("V006", "the bounds of a set are finite", values.span)
            elif low > high:
                self.diagnostics.error("V001", f"[{low}, {high}] is empty", values.span)
            else:
                resolved[path] = Bound(low, high)
        bounds: list[Bound | None] = []
        declared = True
        for path, t in leaves(symbol.type):
            bound = next(
                (resolved[path[:n]] for n in range(len(path), -1, -1) if path[:n] in resolved),
                None,
            )
            if bound is None and isinstance(t, IntType) and not t.is_full:
                bound = Bound(t.low, t.high)
            if bound is None and isinstance(t, (FloatType, IntType)):
                declared = False
            bounds.append(bound if isinstance(t, (FloatType, IntType)) else None)
        return tuple(bounds), declared

    def _default(self, symbol: typed.TopicSymbol, bounds: tuple[Bound | None, ...]) -> Value:
        written = symbol.default is not None
        value = self.number(symbol.default) if symbol.default is not None else None
        if value is None:
            value = default_value(symbol.type)
        outside = first_outside(symbol.type, value, bounds)
        if outside is not None:
            leaf, number, bound = outside
            where = f" ({leaf})" if leaf else ""
            self.diagnostics.error(
                "V002",
                f"the default of `{symbol.name}`{where} is {number}, outside [{bound.low}, {bound.high}]",
                symbol.default.span if symbol.default else symbol.span,
                helps=() if written else (f"give `{symbol.name}` a default inside: `= ...`",),
                notes=()
                if written
                else ("without `= value` a topic starts at the default of its type",),
            )
        return value

    # ------------------------------------------------------------ the result

    def run(self) -> System:
        """Flatten; meaningful only when no error was added."""
        self._walk(self.symbol, "", [])
        components: list[Component] = []
        modules: list[Module] = []
        pending: list[tuple[_Placed, int]] = []
        for placed in self.placed:
            if isinstance(placed.symbol, typed.PlantSymbol):
                components.append(self._plant(placed, placed.symbol))
            elif isinstance(placed.symbol, typed.NodeSymbol):
                components.append(self._node(placed, placed.symbol, placed.name, "node"))
            else:
                pending.append((placed, len(components)))
                components.extend(self._module_nodes(placed, placed.symbol, len(pending) - 1))
        components = self._deployed_order(components)
        for placed, _ in pending:
            modules.append(self._module(placed, len(modules), components))
        self._modes_in_scope(components, modules)
        properties = self._properties(modules, components)
        inputs = self._inputs()
        self._composition(components, modules)
        until = (
            self.duration_at_least_zero(self.symbol.until) if self.symbol.until is not None else None
        )
        hyperperiod = self._hyperperiod(components)
        return System(
            self.symbol.name, self.program, tuple(self.topics.values()), tuple(components),
            tuple(modules), tuple(properties), tuple(inputs), until,
            {p.name: v for p, v in self.params.items()}, hyperperiod,
        )

    def duration_at_least_zero(self, expr: typed.Expr) -> int | None:
        """A run length in ns; C001 when it is not positive."""
        value = self.number(expr)
        if value is not None and value <= 0:
            self.diagnostics.error("C001", "`until` must be longer than zero", expr.span)
            return None
        return value if isinstance(value, int) else None

    def _deployed_order(self, components: list[Component]) -> list[Component]:
        """Ruling 5: plants, DMs, SCs, the rest; ties by declaration."""
        ordered = sorted(components, key=lambda c: RANK[c.role])
        for index, component in enumerate(ordered):
            component.index = index
            if component.role == "plant":
                self.plant_index[component.name] = index
        return ordered

    def _scope(self, placed: _Placed, topics: list[typed.TopicSymbol]) -> Scope:
        return Scope(
            {t: self.topic(self._key(t, placed.prefix, placed.renames)) for t in topics},
            self.params,
        )

    def _plant(self, placed: _Placed, plant: typed.PlantSymbol) -> Component:
        scope = self._scope(placed, [*plant.reads, *(t for t, _ in plant.drives)])
        period = self.duration(plant.period, f"the period of plant `{plant.name}`")
        initial: list[Value] = []
        ranges: list[tuple[float, float] | None] = []
        for variable, expr, interval in zip(
            plant.states, plant.initial, plant.initial_range, strict=True
        ):
            value = self.number(expr) if expr is not None else None
            initial.append(default_value(variable.type) if value is None else value)
            ranges.append(self._interval(interval, expr))
        substeps = self.number(plant.substeps) if plant.substeps is not None else 1
        if substeps is None or not 1 <= substeps <= 1000:  # noqa: PLR2004
            if substeps is not None and plant.substeps is not None:
                self.diagnostics.error(
                    "C002", f"{substeps} substeps are absurd: 1 to 1000 are possible",
                    plant.substeps.span,
                )
            substeps = 1
        return Component(
            0, placed.name, "plant", period, 0, scope, placed.span, plant=plant,
            initial=tuple(initial), initial_range=tuple(ranges), substeps=substeps,
            disturbances=tuple(self._disturbance(placed.name, d) for d in plant.disturbances),
            measured=tuple(self._measurements(placed.name, plant, scope)),
            binding=plant.source,
        )

    def _interval(
        self, interval: tuple[typed.Expr, typed.Expr] | None, _: object
    ) -> tuple[float, float] | None:
        if interval is None:
            return None
        low, high = self.number(interval[0]), self.number(interval[1])
        if low is None or high is None:
            return None
        if not low <= high or not math.isfinite(low) or not math.isfinite(high):
            self.diagnostics.error("V001", f"[{low}, {high}] is empty", interval[0].span)
            return None
        return (low, high)

    def _disturbance(self, plant: str, d: typed.DisturbanceSymbol) -> Disturbance:
        interval = self._interval((d.low, d.high), None) or (0.0, 0.0)
        hold = 0
        if d.hold is not None:
            hold = self.duration(d.hold, f"`hold` of `{d.variable.name}`")
        streams = tuple(
            ".".join((plant, d.variable.name, *path)) for path, _ in leaves(d.variable.type)
        )
        return Disturbance(d.variable, interval[0], interval[1], hold, streams)

    def _measurements(
        self, name: str, plant: typed.PlantSymbol, scope: Scope
    ) -> list[Measurement]:
        found: list[Measurement] = []
        for m in plant.measured:
            bound = self.number(m.within)
            if bound is None:
                continue
            if not (math.isfinite(bound) and bound >= 0):
                self.diagnostics.error(
                    "V006", f"an error bound is finite and not negative, not {bound}", m.within.span
                )
                continue
            topic = scope.topics[m.topic]
            for index, (path, _) in enumerate(leaves(m.topic.type)):
                if path[: len(m.path)] == m.path:
                    stream = ".".join((name, m.topic.name, *path))
                    found.append(Measurement(topic, index, bound, stream))
        return sorted(found, key=lambda m: (m.topic, m.leaf))

    def _node(
        self, placed: _Placed, node: typed.NodeSymbol, name: str, role: str,
        module: int | None = None,
    ) -> Component:
        scope = self._scope(placed, [*(s.topic for s in node.subscribes), *node.publishes])
        period = self.duration(node.period, f"the period of `{node.name}`")
        phase = 0
        if node.phase is not None:
            phase = self.number(node.phase) or 0
            if not 0 <= phase < period:
                self.diagnostics.error(
                    "C004", f"the phase of `{node.name}` must lie in [0, period)", node.phase.span
                )
                phase = 0
        initial = []
        for variable, expr in zip(node.locals, node.initial, strict=True):
            value = self.number(expr) if expr is not None else None
            initial.append(default_value(variable.type) if value is None else value)
        failsafe: dict[int, Value] = {}
        for topic, expr in node.failsafe.items():
            value = self.number(expr)
            if value is None:
                continue
            index = scope.topics[topic]
            bounds = next(t.bounds for t in self.topics.values() if t.index == index)
            outside = first_outside(topic.type, value, bounds)
            if outside is not None:
                _, number, bound = outside
                self.diagnostics.error(
                    "V005",
                    f"the fail-safe value {number} is outside [{bound.low}, {bound.high}]",
                    expr.span,
                )
            failsafe[index] = value
        if node.takeover is not None and role == "node":
            self.diagnostics.error(
                "M015", f"`{node.name}` has `on takeover` but is the AC or SC of no module here",
                node.span,
            )
        return Component(
            0, name, role, period, phase, scope, placed.span, module=module, node=node,
            initial=tuple(initial), failsafe=failsafe, binding=node.source,
        )

    def _module_nodes(
        self, placed: _Placed, module: typed.ModuleSymbol, index: int
    ) -> list[Component]:
        ac = placed.replaced.get(module.ac.name, module.ac)
        sc = placed.replaced.get(module.sc.name, module.sc)
        period = self.duration(module.period, f"the period of module `{module.name}`")
        reads = list(module.topics_read)
        for expr in (module.safe, module.ttf, module.safer):
            if expr is not None:
                reads.extend(t for t in topics_in(expr) if t not in reads)
        dm = Component(
            0, f"{placed.name}.dm", "dm", period, 0, self._scope(placed, reads), placed.span,
            module=index,
        )
        names = [f"{placed.name}.{n.name.rsplit('.', 1)[-1]}" for n in (ac, sc)]
        return [
            dm,
            self._node(placed, sc, names[1], "sc", index),
            self._node(placed, ac, names[0], "ac", index),
        ]

    def _module(self, placed: _Placed, index: int, components: list[Component]) -> Module:
        module = placed.symbol
        assert isinstance(module, typed.ModuleSymbol)
        by_role = {c.role: c for c in components if c.module == index}
        clean = CLEAN_DEFAULT
        if module.clean is not None:
            value = self.number(module.clean)
            if value is not None:
                if not 1 <= value <= 1_000_000:  # noqa: PLR2004
                    self.diagnostics.error(
                        "C002", "`clean` is 1 to 1000000 outputs", module.clean.span
                    )
                else:
                    clean = value
        dm = by_role["dm"]
        self.module_index[placed.name] = index
        outputs = tuple(
            self.topic(self._key(t, placed.prefix, placed.renames)) for t in module.sc.publishes
        )
        result = Module(
            index, placed.name, module, dm.index, by_role["ac"].index, by_role["sc"].index,
            dm.period_ns, dm.scope, clean,
            tuple(dm.scope.topics[t] for t in module.topics_read), outputs, placed.forced,
        )
        for topic in self.topics.values():
            if topic.index in outputs and not topic.set_declared:
                self.diagnostics.error(
                    "V003",
                    f"output topic `{topic.name}` of module `{module.name}` has no value set",
                    topic.symbol.span,
                    "every value it may take must be known",
                    also=((module.span, "gated by this module"),),
                    notes=(
                        "the theorem needs to know what the advanced controller can do at worst: "
                        "the gate refuses everything outside",
                    ),
                    helps=("add a set, such as `in [-1.0, 1.0]`",),
                )
        return result

    def _modes_in_scope(self, components: list[Component], modules: list[Module]) -> None:
        """Let nodes read `mode(M)` of a module instance beside them."""
        prefixes = {p.name: p.prefix for p in self.placed}
        for component in components:
            prefix = prefixes.get(component.name)
            if prefix is None:
                prefix = prefixes.get(component.name.rsplit(".", 1)[0], "")
            wanted = set()
            if component.node is not None:
                wanted = modules_in(component.node)
            elif component.role == "dm" and component.module is not None:
                m = modules[component.module].symbol
                for e in (m.safe, m.ttf, m.safer):
                    if e is not None:
                        _collect_modules(e, wanted)
            for symbol in wanted:
                found = [
                    m for m in modules
                    if m.symbol is symbol and prefixes[m.name] == prefix
                ]
                if len(found) == 1:
                    component.scope.modules[symbol] = found[0].index
                elif isinstance(symbol, typed.ModuleSymbol):
                    n = "no" if not found else f"{len(found)}"
                    self.diagnostics.error(
                        "M013",
                        f"`{component.name}` reads `mode({symbol.name})`, "
                        f"but this system has {n} such module",
                        component.span,
                    )

    def _properties(
        self, modules: list[Module], components: list[Component]
    ) -> list[Property]:
        result: list[Property] = []
        scope = Scope({}, self.params)
        scope.plants = {c.name: c.index for c in components if c.role == "plant"}
        scope.modules = {m.name: m.index for m in modules}
        for m in modules:
            same = [x for x in modules if x.symbol is m.symbol]
            if len(same) == 1:
                scope.modules[m.symbol] = m.index
        for item in self.symbol.properties:
            for topic in topics_in(item.condition):
                scope.topics[topic] = self.topic(self._key(topic, "", []))
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
            topic = next(t for t in self.topics.values() if t.index == index)
            if not topic.set_declared:
                self.diagnostics.error(
                    "V003", f"`{topic.name}` needs a value set to be drawn from", item.span
                )
            result.append(InputDrive(index, every))
        return result

    # ------------------------------------------------------------ composition

    def _composition(self, components: list[Component], modules: list[Module]) -> None:
        """Disjoint nodes, one driver a topic, nobody's topics (paper: composability)."""
        topics = list(self.topics.values())
        drivers: dict[int, list[tuple[str, Span]]] = {}
        for c in components:
            if c.role == "plant" and c.plant is not None:
                for t, _ in c.plant.drives:
                    drivers.setdefault(c.scope.topics[t], []).append((f"plant `{c.name}`", c.span))
            elif c.role == "node" and c.node is not None:
                for t in c.node.publishes:
                    drivers.setdefault(c.scope.topics[t], []).append((f"node `{c.name}`", c.span))
        for m in modules:
            for index in m.outputs:
                drivers.setdefault(index, []).append((f"module `{m.name}`", m.symbol.span))
        for index, found in drivers.items():
            topics[index].driver = found[0][0]
            if len(found) > 1:
                both_modules = all(w.startswith("module") for w, _ in found)
                rule = (
                    "the outputs of composed modules must be disjoint"
                    if both_modules
                    else "a topic has exactly one driver"
                )
                self.diagnostics.error(
                    "M004",
                    f"topic `{topics[index].name}` is driven by {found[0][0]} and {found[1][0]}",
                    found[1][1],
                    "second driver",
                    also=((found[0][1], "first driver"),),
                    notes=(rule,),
                )
        self._undriven(components, drivers, topics)
        self._disjoint_nodes(modules)

    def _undriven(
        self, components: list[Component], drivers: dict[int, list[tuple[str, Span]]],
        topics: list[Topic],
    ) -> None:
        for c in components:
            reads: list[tuple[typed.TopicSymbol, Span]] = []
            if c.node is not None:
                reads = [(s.topic, s.span) for s in c.node.subscribes]
            elif c.plant is not None:
                reads = [(t, c.plant.span) for t in c.plant.reads]
            elif c.role == "dm":
                reads = [(t, c.span) for t in c.scope.topics]
            for symbol, span in reads:
                topic = topics[c.scope.topics[symbol]]
                if topic.index in drivers or symbol.input:
                    if symbol.input and topic.index not in drivers:
                        topic.driver = "input"
                    continue
                self.diagnostics.error(
                    "M005",
                    f"`{c.name}` reads `{topic.name}`, which nobody drives",
                    span,
                    "read here",
                    also=((symbol.span, "declared here"),),
                    helps=(
                        f"if the environment sets it, declare `input topic {symbol.name}`",
                        "otherwise add the node or plant that publishes it to the system",
                    ),
                )

    def _disjoint_nodes(self, modules: list[Module]) -> None:
        seen: dict[tuple[str, typed.NodeSymbol], Module] = {}
        for m in modules:
            prefix = m.name.rsplit(".", 1)[0] if "." in m.name else ""
            for node in (m.symbol.ac, m.symbol.sc):
                other = seen.get((prefix, node))
                if other is not None and other.symbol is not m.symbol:
                    self.diagnostics.error(
                        "M003",
                        f"node `{node.name}` is in modules `{other.name}` and `{m.name}`",
                        m.symbol.span,
                        "second module",
                        also=((other.symbol.span, "first module"),),
                        notes=("the nodes of composed modules must be disjoint",),
                    )
                seen.setdefault((prefix, node), m)

    def _hyperperiod(self, components: list[Component]) -> int:
        value = 1
        for c in components:
            value = math.lcm(value, c.period_ns)
            if value > MAX_HYPERPERIOD_NS:
                periods = ", ".join(sorted({show_ns(x.period_ns) for x in components}))
                self.diagnostics.error(
                    "C003",
                    "the periods of this system have no common multiple that fits 64 bits",
                    self.symbol.span,
                    notes=(f"the periods are {periods}",),
                    helps=("choose periods that divide each other",),
                )
                return 1
        return value


def show_ns(ns: int) -> str:
    """A duration as people write it: `10ms`, `1.5us`."""
    for unit, size in (("s", 10**9), ("ms", 10**6), ("us", 10**3)):
        if abs(ns) >= size:
            text = f"{ns / size:.6f}".rstrip("0").rstrip(".")
            return f"{text} {unit}"
    return f"{ns} ns"


def first_outside(
    t: Type, value: Value, bounds: tuple[Bound | None, ...]
) -> tuple[str, float, Bound] | None:
    """The first leaf of a value outside its bound: (path, value, bound), or None."""
    counter = [0]

    def walk(t: Type, v: Value, path: str) -> tuple[str, float, Bound] | None:
        if isinstance(t, RecordType):
            for (name, ft), fv in zip(t.fields, v, strict=True):
                found = walk(ft, fv, f"{path}.{name}" if path else name)
                if found:
                    return found
            return None
        if isinstance(t, ArrayType):
            for i, e in enumerate(v):
                found = walk(t.element, e, f"{path}[{i}]")
                if found:
                    return found
            return None
        if isinstance(t, ListType):
            start = counter[0]
            result = None
            for i, e in enumerate(v):
                counter[0] = start
                result = result or walk(t.element, e, f"{path}[{i}]")
            counter[0] = start + sum(1 for _ in leaves(t.element))
            return result
        bound = bounds[counter[0]]
        counter[0] += 1
        if bound is not None and not bound.low <= v <= bound.high:
            return path, v, bound
        if isinstance(t, FloatType) and not math.isfinite(v):
            return path, v, Bound(-math.inf, math.inf)
        return None

    return walk(t, value, "")


# ---------------------------------------------------------------- walks over typed trees


def children(node: object) -> list[object]:
    """Direct typed sub-nodes of an expression, statement or place."""
    found: list[object] = []
    for name in getattr(node, "__dataclass_fields__", {}):
        if name in {"type", "span", "fun", "param", "topic", "module", "variable"}:
            continue
        value = getattr(node, name)
        stack = [value]
        while stack:
            v = stack.pop()
            if isinstance(v, (typed.Expr, typed.Stmt, typed.Place)):
                found.append(v)
            elif isinstance(v, tuple):
                stack.extend(v)
    return found


def topics_in(root: object) -> list[typed.TopicSymbol]:
    """Topics an expression reads, in some fixed order."""
    found: dict[typed.TopicSymbol, None] = {}
    todo = [root]
    while todo:
        node = todo.pop()
        if isinstance(node, (typed.TopicRead, typed.AgeRead)):
            found.setdefault(node.topic)
        todo.extend(children(node))
    return list(found)


def _collect_modules(root: object, into: set[typed.ModuleSymbol | str]) -> None:
    todo = [root]
    while todo:
        node = todo.pop()
        if isinstance(node, typed.ModeRead):
            into.add(node.module)
        todo.extend(children(node))


def modules_in(node: typed.NodeSymbol) -> set[typed.ModuleSymbol | str]:
    """Modules whose mode a node reads."""
    found: set[typed.ModuleSymbol | str] = set()
    for stmt in (*node.step, *(node.takeover or ())):
        _collect_modules(stmt, found)
    return found


def elaborate(
    program: typed.Program,
    symbol: typed.SystemSymbol,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
) -> System:
    """Flatten `symbol`; `overrides` maps full parameter names to values."""
    return Elaborator(program, symbol, overrides, diagnostics).run()


def implicit_system(program: typed.Program) -> typed.SystemSymbol | None:
    """For a file without systems: everything it declares, once."""
    from soter.diagnostics.source import Source  # noqa: PLC0415 - rare
    from soter.diagnostics.span import Span  # noqa: PLC0415 - rare

    used = {n for m in program.modules.values() for n in (m.ac, m.sc)}
    whats: list[typed.PlantSymbol | typed.ModuleSymbol | typed.NodeSymbol] = [
        *program.plants.values(),
        *program.modules.values(),
        *(n for n in program.nodes.values() if n not in used),
    ]
    if not whats:
        return None
    span = whats[0].span if whats else Span(Source(program.path, ""), 0, 0)
    instances = tuple(typed.InstanceSymbol(w.name, w, {}, w.span) for w in whats)
    return typed.SystemSymbol("Main", span, True, instances, None, (), (), (), (), ())  # noqa: FBT003
