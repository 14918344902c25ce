"""The verification problem once more: read off the program text by different code.

Purpose: `read_facts` reads plants, inputs with their ranges, times, H* and axes of one module,
as docs/verification.md (section 1) defines them, to be compared with what a certificate says.
Non-goals: sharing code with `verify/problem/`; diagnostics (a program that determines no problem
has no certificate: `NotRecheckedError` or `DiffersError`).

The argument: what moves a state is the plant, what SC commands, and what nobody knows; each thing
that nobody knows is an input with the range that the program declares, or there is no problem.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from soter.certificate.extras import extras
from soter.certificate.reading.module_facts import (
    DiffersError,
    Facts,
    Input,
    StateParameter,
    const_value,
    driven_topics,
    named_leaves,
    topics_of_others,
    topics_read_by_sc,
)
from soter.certificate.reading.module_times import read_times
from soter.certificate.reading.symbolic_values import scalar_leaves
from soter.certificate.report import NotRecheckedError
from soter.language.model import typed
from soter.language.model.system import name_of_subsystem
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaf_name, leaves

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.reading.module_facts import InputKind
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type

PARAMETER_VALUES_MAX = 4096
LARGEST_ERROR = 2.0**1000
"""With a larger error the sum of value and error may be no number, and end the plant."""


def read_facts(flat_system: System, name: str, view: str = "") -> Facts:
    """Reads the problem of the module called `name`, in one of its views if it has views.

    Raises DiffersError if the module does not exist, NotRecheckedError if this reader cannot handle
    its problem.
    """
    modules = [m for m in flat_system.modules if m.name == name]
    if len(modules) != 1:
        raise DiffersError(f"system `{flat_system.name}` has no module `{name}`")
    runs = modules[0]
    if runs.plan is not None:
        raise NotRecheckedError(f"`{name}` has several plans, each of which is read alone")
    if view:
        runs = extras.views.module_in_view(runs, view)
    elif runs.symbol.verify.views:
        raise NotRecheckedError(f"`{name}` is proved in views")
    if runs.symbol.verify.abstracts:
        system, module, plants = extras.views.make_abstracted_system(flat_system, runs)
    else:
        system, module, plants = flat_system, runs, _plants_of(flat_system, runs)
    if not plants:
        raise NotRecheckedError("no verification plant drives what the module reads")
    kinds = {_plant_kind(c) for c in plants}
    if len(kinds) != 1:
        raise NotRecheckedError("flows and maps in one module")
    sc = system.components[module.sc]
    facts = Facts(system, module, sc, plants, kinds.pop(), flat_system, runs)
    facts.view, facts.whole = view, modules[0].symbol
    if system is flat_system:
        facts.running = {topic.index: topic.index for topic in system.topics}
    else:
        extras.views.require_same_as_flown(facts)
    for c in plants:
        _read_states(facts, c)
        _read_disturbances(facts, c)
    _read_axes(facts)
    _read_topics(facts)
    read_times(facts)
    levels = module.symbol.verify.levels
    facts.levels = 3 if levels is None else const_value(facts, levels)
    return facts


def _plants_of(system: System, module: Module) -> tuple[Component, ...]:
    """The plants that drive topics read by SC, a predicate or an axis, or that an axis names."""
    sc = system.components[module.sc]
    wanted = {sc.scope.topics[t] for t in topics_read_by_sc(sc)}
    wanted |= {module.scope.topics[t] for t in topic_reads(*module.symbol.predicates)}
    if module.symbol.rest is not None:
        wanted |= set(module.scope.topics.values())
    axes = [a for group in module.symbol.verify.groups for a in group.axes]
    for scope in (module.scope.topics, sc.scope.topics):
        wanted |= {scope[a.topic] for a in axes if a.topic is not None and a.topic in scope}
    home = name_of_subsystem(module)
    names = {f"{home}.{a.instance}" if home else a.instance for a in axes if a.instance}
    return tuple(c for c in system.components if _is_needed_plant(c, names, wanted))


def _is_needed_plant(c: Component, names: set[str], topics: set[int]) -> bool:
    return c.plant is not None and (
        c.name in names or any(c.scope.topics[t] in topics for t, _ in c.plant.drives)
    )


def _plant_kind(c: Component) -> Literal["flow", "map"]:
    plant = c.plant
    assert plant is not None
    if plant.extern:
        raise NotRecheckedError(f"the plant `{c.name}` is extern")
    if plant.der and plant.next:
        raise NotRecheckedError("flows and maps in one module")
    return "map" if plant.next else "flow"


# ---------------------------------------------------------------- inputs


def _read_states(facts: Facts, c: Component) -> None:
    """Enters a plant's floats as states with ranges at the start, other values as parameters.

    A run may start as the plant declares, or where the map of `abstracts` puts the flying system.
    """
    plant = c.plant
    assert plant is not None
    begun = extras.views.states_at_start(facts, c.name) if facts.symbol.verify.abstracts else None
    starts = zip(plant.states, c.initial, c.initial_range, begun or c.initial, strict=True)
    for variable, initial, drawn, real in starts:
        moves = variable in plant.der or variable in plant.next
        if any("[]" in path for path, _ in leaves(variable.type)):
            raise NotRecheckedError(f"a list in the state `{variable.name}`")
        values, reals = scalar_leaves(initial), scalar_leaves(real)
        for k, name, of in named_leaves(f"{c.name}.{variable.name}", variable.type):
            if isinstance(of, FloatType):
                low, high = drawn if drawn is not None else (values[k], values[k])
                if begun is not None:
                    low, high = min(low, reals[k]), max(high, reals[k])
                state = Input("state", name, c.index, k, low, high, variable=variable.name)
                facts.states.append(state)
            elif moves:
                raise NotRecheckedError(f"the state `{name}` moves and is no float")
            else:
                begins = (int(values[k]), int(reals[k]))
                every = _discrete_values(of, name)
                parameter = StateParameter(name, c.index, variable.name, k, every, begins)
                facts.parameters.append(parameter)


def _read_disturbances(facts: Facts, c: Component) -> None:
    """Enters a plant's disturbances and the topics of others that move the plant."""
    for d in c.disturbances:
        for k, name, of in named_leaves(f"{c.name}.{d.variable.name}", d.variable.type):
            assert isinstance(of, FloatType)  # else T018
            disturbance = Input("disturbance", name, c.index, k, d.low, d.high, unit=of.unit)
            facts.disturbances.append(replace(disturbance, variable=d.variable.name))
    for symbol in topics_of_others(c, facts.module):
        for x in _leaves_of(facts, c.scope.topics[symbol], "disturbance"):
            path = x.name.removeprefix(facts.system.topics[x.owner].name)
            name = f"{c.name}.{symbol.name}{path}"
            facts.disturbances.append(
                replace(x, name=name, owner=c.index, variable=symbol.name, of_others=True)
            )


def _discrete_values(type_: Type, name: str) -> tuple[int, ...]:
    if isinstance(type_, BoolType):
        return (0, 1)
    if isinstance(type_, EnumType):
        return tuple(range(len(type_.members)))
    if isinstance(type_, IntType) and type_.high - type_.low < PARAMETER_VALUES_MAX:
        return tuple(range(type_.low, type_.high + 1))
    raise NotRecheckedError(f"the parameter `{name}` has too many values")


def _read_topics(facts: Facts) -> None:
    """Enters commands, errors of topics that are read, and topics that no plant drives."""
    module, sc, symbol = facts.module, facts.sc, facts.symbol
    by_sc = [sc.scope.topics[t] for t in topics_read_by_sc(sc)]
    errors_of = {*by_sc, *(module.scope.topics[t] for t in facts.topics_read_by_dm(symbol.ttf))}
    if facts.is_computed:  # computed predicates read what carries the axes
        known = {*sc.scope.topics.values(), *module.scope.topics.values()}
        errors_of |= dict(facts.leaves.values()).keys() or known
    for index in module.outputs:
        facts.controls += _leaves_of(facts, index, "control")
    for m in (m for c in facts.plants for m in c.measured):
        topic = facts.system.topics[m.topic]
        if m.bound > LARGEST_ERROR and topic.bounds[m.leaf] is None:
            raise NotRecheckedError(f"`{topic.name}` is measured, and the sum may be no number")
        if m.topic in errors_of and m.bound > 0.0:
            _, name, of = list(named_leaves(topic.name, topic.type))[m.leaf]
            unit = of.unit if isinstance(of, FloatType) else ""
            error = Input("error", name, m.topic, m.leaf, -m.bound, m.bound, unit=unit)
            facts.errors.append(error)
    driven = driven_topics(facts)
    by_dm = [module.scope.topics[t] for t in facts.topics_read_by_dm(facts.ttf)]
    for index in dict.fromkeys([*by_sc, *by_dm]):
        if index not in driven:
            facts.others += _leaves_of(facts, index, "other")


def _leaves_of(facts: Facts, index: int, kind: InputKind) -> Iterator[Input]:
    topic = facts.system.topics[index]
    if topic.queue_of is not None:
        raise NotRecheckedError(f"`{topic.name}` is a queue")
    for (k, name, of), bound in zip(
        named_leaves(topic.name, topic.type), topic.bounds, strict=True
    ):
        if not isinstance(of, FloatType):
            raise NotRecheckedError(f"the {kind} `{name}` is no float")
        if bound is None:
            raise NotRecheckedError(f"`{name}` has no value set")
        yield Input(kind, name, index, k, bound.low, bound.high, unit=of.unit)


# ---------------------------------------------------------------- axes


def _read_axes(facts: Facts) -> None:
    """Enters the declared axis of each state. The prover may choose all other axes."""
    for group in facts.symbol.verify.groups:
        for axis in group.axes:
            state = _state_of_axis(facts, axis)
            if state is None:
                continue
            if axis.topic is not None:
                facts.leaves[state] = (_topic_of_axis(facts, axis.topic), axis.path)
            if axis.unbounded:
                facts.unbounded.add(state)
            else:
                ends = axis.low, axis.high if axis.open is None else axis.open
                low, high = (float(const_value(facts, e)) for e in ends)
                facts.axes[state] = low, high
                if axis.open is not None:
                    facts.open_ends.add(state)


def _state_of_axis(facts: Facts, axis: typed.TypedGridAxis) -> int | None:
    """The number of the state that an axis names; None if the topic leaf is not just a state."""
    if axis.topic is None:
        wanted = leaf_name(axis.instance, axis.path)
        named = [i for i, s in enumerate(facts.states) if ("." + s.name).endswith("." + wanted)]
        return named[0] if len(named) == 1 else None
    driven = driven_topics(facts)
    if (index := _topic_of_axis(facts, axis.topic)) not in driven:
        return None
    return state_published(facts, *driven[index], axis.path)


def _topic_of_axis(facts: Facts, topic: typed.TopicSymbol) -> int:
    """The number of the topic that an axis names; -1 if neither module nor SC knows the topic."""
    for scope in (facts.module.scope.topics, facts.sc.scope.topics):
        if topic in scope:
            return scope[topic]
    return -1


def state_published(
    facts: Facts, c: Component, expr: typed.TypedExpr, path: tuple[str, ...]
) -> int | None:
    """The number of the state that a topic leaf shows unchanged; None if it shows no state so."""
    plant = c.plant
    assert plant is not None
    if isinstance(expr, typed.VarRead):
        lets = dict(plant.lets)
        if expr.variable in lets:
            return state_published(facts, c, lets[expr.variable], path)
        name = leaf_name(f"{c.name}.{expr.variable.name}", path)
        return next((i for i, s in enumerate(facts.states) if s.name == name), None)
    if isinstance(expr, typed.TypedField):
        fields = getattr(expr.target.type, "fields", ())
        return state_published(facts, c, expr.target, (fields[expr.index][0], *path))
    if isinstance(expr, typed.Index) and isinstance(expr.index, typed.Literal):
        return state_published(facts, c, expr.target, (f"[{expr.index.value}]", *path))
    if isinstance(expr, typed.Aggregate) and path:
        element = _element_of_aggregate(expr, path[0])
        return None if element is None else state_published(facts, c, element, path[1:])
    return None


def _element_of_aggregate(expr: typed.Aggregate, part: str) -> typed.TypedExpr | None:
    fields = getattr(expr.type, "fields", None)
    names = [n for n, _ in fields] if fields else [f"[{i}]" for i in range(len(expr.elements))]
    if part not in names:
        return None
    order = expr.order if expr.order is not None else tuple(range(len(expr.elements)))
    return expr.elements[order.index(names.index(part))]
