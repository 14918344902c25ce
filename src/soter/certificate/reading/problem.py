"""The verification problem once more: read off the program text by different code.

Purpose: plants, inputs with their ranges, times, H*, declared axes of one module, as
docs/verification.md (section 1) defines them, to be compared with what a certificate says.
Non-goals: sharing code with `verify/problem/extract.py`; diagnostics (a program that determines no
problem has no certificate: `NotRecheckedError` or `DiffersError`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from soter.certificate.reading.module_facts import (
    DiffersError,
    Facts,
    Input,
    StateParameter,
    driven_topics,
    number_of,
    read_by_sc,
    topics_of_others,
)
from soter.certificate.reading.symbolic_values import flat
from soter.certificate.reading.verification_system import as_it_runs, verification_system_of
from soter.certificate.reading.view_predicates import seen, ttf_of_states
from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.module_times import read_times
from soter.language.evaluate.abstraction_start import start_behind
from soter.language.model import typed
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.certificate.reading.module_facts import InputKind
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type

__all__ = [
    "DiffersError",
    "Facts",
    "Input",
    "StateParameter",
    "driven_topics",
    "error_of",
    "followed",
    "number_of",
    "read_facts",
]
PARAMETER_VALUES_MAX = 4096


def read_facts(flat_system: System, name: str, view: str = "") -> Facts:
    """The problem of the module instance called `name`, as one of its views sees it.

    DiffersError where there is no such module, NotRecheckedError where its problem is none that is
    read here.
    """
    modules = [m for m in flat_system.modules if m.name == name]
    if len(modules) != 1:
        raise DiffersError(f"system `{flat_system.name}` has no module `{name}`")
    runs = modules[0]
    if view:
        runs = seen(runs, view)
    elif runs.symbol.verify.views:
        raise NotRecheckedError(f"`{name}` is proved in views")
    system, module, plants = verification_system_of(flat_system, runs)
    sc = system.components[module.sc]
    if not plants:
        raise NotRecheckedError("no verification plant drives what the module reads")
    kinds = {_kind(c) for c in plants}
    if len(kinds) != 1:
        raise NotRecheckedError("flows and maps in one module")
    facts = Facts(system, module, sc, plants, kinds.pop(), flat_system, runs)
    facts.view, facts.whole = view, modules[0].symbol
    as_it_runs(facts)
    _read_states(facts)
    _read_axes(facts)
    _read_topics(facts)
    read_times(facts)
    levels = module.symbol.verify.levels
    facts.levels = 3 if levels is None else number_of(facts, levels)
    return facts


def _kind(c: Component) -> Literal["flow", "map"]:
    plant = c.plant
    assert plant is not None
    if plant.extern:
        raise NotRecheckedError(f"the plant `{c.name}` is extern")
    if plant.der and plant.next:
        raise NotRecheckedError("flows and maps in one module")
    return "map" if plant.next else "flow"


# ---------------------------------------------------------------- inputs


def _flown(facts: Facts, name: str) -> Sequence[Any] | None:
    """The states of a plant of the proof at the start of a run, by its map; None: not known."""
    links = facts.symbol.verify.abstracts
    for link in links:
        if link.name == name:
            return start_behind(facts.flying, facts.flying_module, link)
    return None


def _read_states(facts: Facts) -> None:
    for c in facts.plants:
        plant = c.plant
        assert plant is not None
        flown = _flown(facts, c.name)
        every = zip(plant.states, c.initial, c.initial_range, flown or c.initial, strict=True)
        for variable, initial, drawn, real in every:
            moves = variable in plant.der or variable in plant.next
            if any("[]" in path for path, _ in leaves(variable.type)):
                raise NotRecheckedError(f"a list in the state `{variable.name}`")
            values, reals = flat(initial), flat(real)
            for k, (path, of) in enumerate(leaves(variable.type)):
                name = ".".join((c.name, variable.name, *path))
                if isinstance(of, FloatType):
                    low, high = drawn if drawn is not None else (values[k], values[k])
                    if flown is not None:
                        low, high = min(low, reals[k]), max(high, reals[k])
                    facts.states.append(
                        Input(
                            kind="state",
                            name=name,
                            owner=c.index,
                            variable=variable.name,
                            leaf=k,
                            low=low,
                            high=high,
                            moves=moves,
                        )
                    )
                elif moves:
                    raise NotRecheckedError(f"the state `{name}` moves and is no float")
                else:
                    facts.parameters.append(
                        StateParameter(name, c.index, variable.name, k, _values_of(of, name))
                    )
        for d in c.disturbances:
            for k, (path, of) in enumerate(leaves(d.variable.type)):
                name = ".".join((c.name, d.variable.name, *path))
                if not isinstance(of, FloatType):
                    raise NotRecheckedError(f"the disturbance `{name}` is no float")
                facts.disturbances.append(
                    Input(
                        kind="disturbance",
                        name=name,
                        owner=c.index,
                        variable=d.variable.name,
                        leaf=k,
                        low=d.low,
                        high=d.high,
                        unit=of.unit,
                    )
                )
        facts.disturbances += _of_others(facts, c)


def _of_others(facts: Facts, c: Component) -> Iterator[Input]:
    """Leaves of topics that somebody else publishes: they move the plant as disturbances do."""
    for symbol in topics_of_others(c, facts.module):
        for x in _leaves_of(facts, c.scope.topics[symbol], "disturbance"):
            path = x.name.removeprefix(facts.system.topics[x.owner].name)
            name = f"{c.name}.{symbol.name}{path}"
            yield replace(x, name=name, owner=c.index, variable=symbol.name, of_others=True)


def _values_of(of: Type, name: str) -> tuple[int, ...]:
    if isinstance(of, BoolType):
        return (0, 1)
    if isinstance(of, EnumType):
        return tuple(range(len(of.members)))
    if isinstance(of, IntType) and of.high - of.low < PARAMETER_VALUES_MAX:
        return tuple(range(of.low, of.high + 1))
    raise NotRecheckedError(f"the parameter `{name}` has too many values")


def _read_topics(facts: Facts) -> None:
    module, sc = facts.module, facts.sc
    read = [sc.scope.topics[t] for t in read_by_sc(sc)]
    predicates = [p for p in (module.symbol.ttf, module.symbol.safer) if p is not None]
    driven = driven_topics(facts)
    seen = {*read, *(module.scope.topics[t] for t in topic_reads(*predicates))}
    shown = [p for p in (ttf_of_states(module.symbol.ttf), module.symbol.safer) if p is not None]
    read += [module.scope.topics[t] for t in topic_reads(*shown)]
    read = list(dict.fromkeys(read))
    if not predicates:  # computed predicates read what carries the axes
        known = {*sc.scope.topics.values(), *module.scope.topics.values()}
        seen |= {topic for topic, _ in facts.leaves.values()} or known
    for index in module.outputs:
        facts.controls += _leaves_of(facts, index, "control")
    for c in facts.plants:
        for m in c.measured:
            if m.topic in seen and m.bound > 0.0:
                topic = facts.system.topics[m.topic]
                path, of = list(leaves(topic.type))[m.leaf]
                name = ".".join((topic.name, *path))
                facts.errors.append(
                    Input(
                        kind="error",
                        name=name,
                        owner=m.topic,
                        variable="",
                        leaf=m.leaf,
                        low=-m.bound,
                        high=m.bound,
                        unit=of.unit if isinstance(of, FloatType) else "",
                    )
                )
    for index in read:
        if index not in driven:
            facts.others += _leaves_of(facts, index, "other")


def _leaves_of(facts: Facts, index: int, kind: InputKind) -> list[Input]:
    topic = facts.system.topics[index]
    if topic.queue_of is not None:
        raise NotRecheckedError(f"`{topic.name}` is a queue")
    inputs = []
    for k, ((path, of), bound) in enumerate(zip(leaves(topic.type), topic.bounds, strict=True)):
        name = ".".join((topic.name, *path))
        if not isinstance(of, FloatType):
            raise NotRecheckedError(f"the {kind} `{name}` is no float")
        if bound is None:
            raise NotRecheckedError(f"`{name}` has no value set")
        inputs.append(
            Input(
                kind=kind,
                name=name,
                owner=index,
                variable="",
                leaf=k,
                low=bound.low,
                high=bound.high,
                unit=of.unit,
            )
        )
    return inputs


# ---------------------------------------------------------------- axes


def _read_axes(facts: Facts) -> None:
    """Extents that the module declares, by state. What it leaves open is a choice of the prover."""
    for group in facts.symbol.verify.groups:
        for axis in group.axes:
            state = _state_of_axis(facts, axis)
            if state is None:
                continue
            if axis.topic is not None:
                facts.leaves[state] = (_topic_of_axis(facts, axis.topic), axis.path)
            if axis.unbounded:
                facts.unbounded.add(state)
            elif axis.low is not None and axis.high is not None:
                high = axis.high if axis.open is None else axis.open
                facts.axes[state] = (
                    float(number_of(facts, axis.low)),
                    float(number_of(facts, high)),
                )
                if axis.open is not None:
                    facts.open_ends.add(state)


def _state_of_axis(facts: Facts, axis: typed.TypedGridAxis) -> int | None:
    """The state that an axis names; None for a topic leaf that is not plainly one state."""
    if axis.topic is None:
        ending = ".".join(axis.path)
        wanted = f"{axis.instance}.{ending}"
        named = [i for i, s in enumerate(facts.states) if ("." + s.name).endswith("." + wanted)]
        return named[0] if len(named) == 1 else None
    driven = driven_topics(facts)
    index = _topic_of_axis(facts, axis.topic)
    if index not in driven:
        return None
    component, expr = driven[index]
    return followed(facts, component, expr, axis.path)


def _topic_of_axis(facts: Facts, topic: typed.TopicSymbol) -> int:
    """The topic that an axis names, as the module sees it; -1 where it does not."""
    for scope in (facts.module.scope.topics, facts.sc.scope.topics):
        if topic in scope:
            return scope[topic]
    return -1


def error_of(facts: Facts, state: int) -> float:
    """By how much the estimate of a state may be off, in the topic leaf that is its axis.

    NotRecheckedError where no topic has it as its axis.
    """
    if state not in facts.leaves:
        raise NotRecheckedError(f"no topic carries `{facts.states[state].name}` as its axis")
    topic, path = facts.leaves[state]
    paths = [p for p, _ in leaves(facts.system.topics[topic].type)]
    bounds = [
        m.bound
        for c in facts.plants
        for m in c.measured
        if (m.topic, paths[m.leaf]) == (topic, path)
    ]
    return max(bounds, default=0.0)


def followed(
    facts: Facts, c: Component, expr: typed.TypedExpr, path: tuple[str, ...]
) -> int | None:
    """The state that a leaf of a driven topic is, where it is just a state."""
    plant = c.plant
    assert plant is not None
    if isinstance(expr, typed.VarRead):
        lets = dict(plant.lets)
        if expr.variable in lets:
            return followed(facts, c, lets[expr.variable], path)
        name = ".".join((c.name, expr.variable.name, *path))
        return next((i for i, s in enumerate(facts.states) if s.name == name), None)
    of = expr.type
    if isinstance(expr, typed.TypedField):
        fields = getattr(expr.target.type, "fields", ())
        return followed(facts, c, expr.target, (fields[expr.index][0], *path))
    if isinstance(expr, typed.Aggregate) and path:
        fields = getattr(of, "fields", None)
        names = [n for n, _ in fields] if fields else [f"[{i}]" for i in range(len(expr.elements))]
        if path[0] not in names:
            return None
        at = names.index(path[0])
        order = expr.order if expr.order is not None else tuple(range(len(expr.elements)))
        return followed(facts, c, expr.elements[order.index(at)], path[1:])
    return None
