"""Makes the components of a flat system of its placed instances.

Purpose: makes plants, nodes and the three components of a module, in deployed order, and reports
wrong numbers of them (periods, phases, first values, fail-safe values).
Non-goals: modules, which name their components (`make_modules.py`); P1a, P1b (`wellformed.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.passes.replace_parts import controller_names
from soter.language.elaborate.passes.stand_ins import make_stand_in
from soter.language.elaborate.passes.step_times import check_step_times, wcet_and_jitter
from soter.language.elaborate.passes.system_numbers import TooLargeError
from soter.language.elaborate.passes.topics import make_queue, topic_index_at
from soter.language.elaborate.passes.value_sets import require_in_set
from soter.language.model import typed
from soter.language.model.system import Component, Disturbance, Measurement, Scope
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import ErrorType, default_value, leaves, show_ns

if TYPE_CHECKING:
    from soter.language.elaborate.passes.flattening import Flattening, PlacedInstance
    from soter.language.model.types import Value

MAX_SUBSTEPS = 1_000
RANK = {"plant": 0, "dm": 1, "sc": 2, "ac": 3, "node": 3}


def make_components(flat: Flattening, role: str) -> None:
    """Adds `components`, `plants` and `unknown`, and topics of their scopes; needs `placed`.

    `role` becomes the role of each node outside of modules.
    """
    modules = 0
    for placed in flat.placed:
        with flat.with_params(placed.params):
            if isinstance(placed.symbol, typed.PlantSymbol):
                flat.components.append(_make_plant(flat, placed, placed.symbol))
            elif isinstance(placed.symbol, typed.NodeSymbol):
                flat.components.append(_make_node(flat, placed, placed.symbol, placed.name, role))
            else:
                flat.components += _make_dm_sc_and_ac(flat, placed, placed.symbol, modules)
                modules += 1
    # ruling 5: plants, DMs, SCs, the rest; ties by declaration
    flat.components.sort(key=lambda c: RANK[c.stands_for.role if c.stands_for else c.role])
    for index, component in enumerate(flat.components):
        component.index = index
    flat.plants = {c.name: c.index for c in flat.components if c.role == "plant"}


def _period_ns(flat: Flattening, expr: typed.TypedExpr, description: str, name: str) -> int:
    period = flat.duration_ns(expr, description)
    if period is None:
        flat.unknown.add(name)
        return 1_000_000_000
    return period


def scope_at(flat: Flattening, placed: PlacedInstance, topics: list[typed.TopicSymbol]) -> Scope:
    """Gives the scope of a placed instance: the topic that each of `topics` means there."""
    return Scope({t: topic_index_at(flat, placed, t) for t in topics}, placed.params)


def _first_values(
    flat: Flattening,
    variables: tuple[typed.Variable, ...],
    initial: tuple[typed.TypedExpr | None, ...],
) -> tuple[Value, ...]:
    values = []
    for variable, expr in zip(variables, initial, strict=True):
        if isinstance(variable.type, ErrorType):
            continue
        if not flat.sizes.has_room_for(variable.type):
            raise TooLargeError
        description = f"the first value of `{variable.name}`"
        value = flat.value_of(expr, description)
        values.append(default_value(variable.type) if value is None else value)
    return tuple(values)


def _make_plant(flat: Flattening, placed: PlacedInstance, plant: typed.PlantSymbol) -> Component:
    scope = scope_at(flat, placed, [*plant.reads, *(t for t, _ in plant.drives)])
    period = _period_ns(flat, plant.period, f"the period of plant `{plant.name}`", placed.name)
    ranges: list[tuple[float, float] | None] = []
    for variable, interval in zip(plant.states, plant.initial_range, strict=True):
        description = f"the start of `{variable.name}`"
        start_range = None
        if interval is not None:
            span = interval[0].span.to(interval[1].span)
            start_range = flat.interval(interval[0], interval[1], span, description)
        ranges.append(start_range)
    substeps = flat.count(plant.substeps, "the number of substeps", 1, MAX_SUBSTEPS)
    return Component(
        0,
        placed.name,
        "plant",
        period,
        0,
        scope,
        placed.span,
        plant=plant,
        initial=_first_values(flat, plant.states, plant.initial),
        initial_range=tuple(ranges),
        substeps=substeps or 1,
        disturbances=tuple(_make_disturbance(flat, placed.name, d) for d in plant.disturbances),
        measured=tuple(_make_measurements(flat, placed.name, plant, scope)),
        binding=plant.source,
    )


def _make_disturbance(flat: Flattening, plant: str, d: typed.DisturbanceSymbol) -> Disturbance:
    name = d.variable.name
    span = d.low.span.to(d.high.span)
    interval = flat.interval(d.low, d.high, span, f"disturbance `{name}`") or (0.0, 0.0)
    hold = flat.duration_ns(d.hold, f"`hold` of `{name}`")
    streams: tuple[str, ...] = ()
    if not isinstance(d.variable.type, ErrorType):
        paths = [path for path, _ in leaves(d.variable.type)]
        streams = tuple(".".join((plant, name, *path)) for path in paths)
    return Disturbance(d.variable, interval[0], interval[1], hold or 0, streams)


def _make_measurements(
    flat: Flattening, name: str, plant: typed.PlantSymbol, scope: Scope
) -> list[Measurement]:
    measurements: list[Measurement] = []
    for m in plant.measured:
        bound = flat.bound(m.within, "the bound of an error")
        if bound is None:
            continue
        topic = scope.topics[m.topic]
        for index, (path, _) in enumerate(leaves(m.topic.type)):
            if path[: len(m.path)] == m.path:
                stream = ".".join((name, m.topic.name, *path))
                measurements.append(Measurement(topic, index, bound, stream))
    return sorted(measurements, key=lambda m: (m.topic, m.leaf))


def _make_node(
    flat: Flattening,
    placed: PlacedInstance,
    node: typed.NodeSymbol,
    name: str,
    role: str,
    module: int | None = None,
) -> Component:
    by, stands_for = placed.by_contract.get(node.name), None
    if by is not None:
        scope_at(flat, placed, list(node.publishes))
        node, stands_for = make_stand_in(node, by, flat.diagnostics)
    scope = scope_at(flat, placed, [*(s.topic for s in node.subscribes), *node.publishes])
    for subscribed in node.subscribes:
        if subscribed.queue is not None:
            source = flat.topics[scope.topics[subscribed.topic]]
            scope.topics[subscribed.topic] = make_queue(flat, source, subscribed, name)
    period = _period_ns(flat, node.period, f"the period of node `{node.name}`", name)
    wcet, jitter = wcet_and_jitter(flat, node)
    return Component(
        0,
        name,
        role,
        period,
        _phase_ns(flat, node, period, name),
        scope,
        placed.span,
        module=module,
        node=node,
        initial=_first_values(flat, node.locals, node.initial),
        failsafe=failsafe_values(flat, node, scope),
        binding=node.source,
        stands_for=stands_for,
        takes_ns=_step_times_ns(flat, node, role if module is not None else "node"),
        wcet_ns=wcet,
        jitter_ns=jitter,
    )


def _step_times_ns(flat: Flattening, node: typed.NodeSymbol, role: str) -> tuple[int, int] | None:
    if node.takes is None:
        return None
    description = f"what a step of `{node.name}` takes"
    low, high = (flat.duration_ns(e, description) for e in node.takes)
    if low is None or high is None:
        return None
    if node not in flat.program.damaged:
        check_step_times(node, role, (low, high), flat.diagnostics)
    return low, max(low, high)


def _phase_ns(flat: Flattening, node: typed.NodeSymbol, period: int, name: str) -> int:
    phase = flat.value_of(node.phase, "a phase")
    if phase is None or node.phase is None:
        return 0
    if 0 <= phase < period or name in flat.unknown:
        return max(int(phase), 0)
    flat.diagnostics.error(
        "C004",
        f"the phase of node `{node.name}` must be shorter than its period"
        if phase > 0
        else f"the phase of node `{node.name}` cannot be negative",
        node.phase.span,
        f"this is {show_ns(phase)}",
        also=((node.period.span, f"steps every {show_ns(period)}"),),
    )
    return 0


def failsafe_values(
    flat: Flattening, node: typed.NodeSymbol | typed.ModuleSymbol, scope: Scope
) -> dict[int, Value]:
    """Gives topic -> the value to publish after a step fault, or to hold after a lease."""
    value_by_topic: dict[int, Value] = {}
    why = (
        "proofs of what acts after the lease speak of values in the set"
        if isinstance(node, typed.ModuleSymbol)
        else "what is published after a step fault must be allowed too"
    )
    for symbol, expr in node.failsafe.items():
        value = flat.value_of(expr, f"the fail-safe value of `{symbol.name}`")
        if value is None:
            continue
        # a queue's: the node reads its own output, which M001 was reported for
        topic = flat.topics[flat.topics[scope.topics[symbol]].source]
        value_by_topic[topic.index] = value
        description = f"the fail-safe value of `{symbol.name}`"
        require_in_set(flat, topic, value, expr, description, (why,))
    return value_by_topic


def _make_dm_sc_and_ac(
    flat: Flattening, placed: PlacedInstance, module: typed.ModuleSymbol, index: int
) -> list[Component]:
    ac, sc = placed.controllers()
    if sc is module.sc:
        _require_same_times_of_plans(flat, module)
    name = f"{placed.name}.dm"
    period = _period_ns(flat, module.period, f"the period of module `{module.name}`", name)
    predicates = topic_reads(*module.expressions)
    others = *module.moved_topics, *module.acknowledgements
    reads = list(dict.fromkeys([*module.topics_read, *predicates, *others]))
    scope = scope_at(flat, placed, reads)
    wcet, jitter = wcet_and_jitter(flat, module)
    ac_name, sc_name = controller_names(placed.name, ac, sc)
    dm = Component(
        0, name, "dm", period, 0, scope, placed.span, module=index, wcet_ns=wcet, jitter_ns=jitter
    )
    return [
        dm,
        _make_node(flat, placed, sc, sc_name, "sc", index),
        _make_node(flat, placed, ac, ac_name, "ac", index),
    ]


def _require_same_times_of_plans(flat: Flattening, module: typed.ModuleSymbol) -> None:
    """Reports M030 for a plan of SC with another period, phase, `wcet` or `jitter`."""

    def times_of_plan(node: typed.NodeSymbol) -> tuple[object, ...]:
        phase = flat.value_of(node.phase, "a phase") or 0
        return flat.duration_ns(node.period, "a period"), phase, *wcet_and_jitter(flat, node)

    for plan in module.plans[1:]:
        if times_of_plan(plan) != times_of_plan(module.plans[0]):
            flat.diagnostics.error(
                "M030",
                f"`{plan.name}` has other times than `{module.plans[0].name}`",
                plan.span,
                also=((module.sc_span or module.span, "both are plans here"),),
                notes=("plans of one module share one place in the calendar",),
                helps=("give both the same `period`, `phase`, `wcet` and `jitter`",),
            )
