"""The verification problem once more: read off the program text by different code.

Purpose: plants, inputs with their ranges, times, H*, declared axes of one module, as
docs/verification.md (section 1) defines them, to be compared with what a certificate says.
Non-goals: sharing code with `reach/extract.py`; diagnostics (a program that determines no problem
has no certificate: `NotRecheckedError` or `DiffersError`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from math import gcd
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.program import typed
from soter.program.elaborate import Elaborator
from soter.program.evaluate import Evaluator
from soter.program.types import BoolType, EnumType, FloatType, IntType, leaves
from soter.program.walk import topic_reads
from soter.recheck.symbolic import flat
from soter.recheck.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.program.system import Component, Module, System
    from soter.program.types import Type

PARAMETER_VALUES_MAX = 4096


class DiffersError(Exception):
    """The certificate says something else than the program."""


@dataclass(frozen=True)
class Input:
    """One scalar input: `owner` is a component for states and disturbances, else a topic."""

    kind: str
    name: str
    owner: int
    variable: str
    leaf: int
    low: float
    high: float
    moves: bool = True


@dataclass(frozen=True)
class Parameter:
    """A discrete plant state without dynamics."""

    name: str
    owner: int
    variable: str
    leaf: int
    values: tuple[int, ...]


@dataclass(eq=False)
class Facts:
    """What the program says about one module. States have the range of their initial values."""

    system: System
    module: Module
    sc: Component
    plants: tuple[Component, ...]
    kind: str
    states: list[Input] = field(default_factory=list)
    controls: list[Input] = field(default_factory=list)
    disturbances: list[Input] = field(default_factory=list)
    errors: list[Input] = field(default_factory=list)
    others: list[Input] = field(default_factory=list)
    parameters: list[Parameter] = field(default_factory=list)
    axes: dict[int, tuple[float, float]] = field(default_factory=dict)
    """State -> its declared extent."""
    leaves: dict[int, tuple[int, tuple[str, ...]]] = field(default_factory=dict)
    """State -> the topic leaf that is declared as its axis."""
    times: dict[str, int] = field(default_factory=dict)
    levels: int = 3

    @property
    def symbol(self) -> typed.ModuleSymbol:
        """The declaration of the module."""
        return self.module.symbol

    @property
    def computed(self) -> bool:
        """Whether `ttf` and `safer` are left to the prover."""
        return self.symbol.ttf is None and self.symbol.safer is None

    def cases(self) -> Iterator[tuple[int, ...]]:
        """Every combination of parameter values."""
        return product(*(p.values for p in self.parameters))


def read_facts(flat_system: System, name: str) -> Facts:
    """The problem of the module instance called `name`."""
    modules = [m for m in flat_system.modules if m.name == name]
    if len(modules) != 1:
        raise DiffersError(f"system `{flat_system.name}` has no module `{name}`")
    system, module, plants = _home(flat_system, modules[0])
    sc = system.components[module.sc]
    if not plants:
        raise NotRecheckedError("no verification plant drives what the module reads")
    kinds = {_kind(c) for c in plants}
    if len(kinds) != 1:
        raise NotRecheckedError("flows and maps in one module")
    facts = Facts(system, module, sc, plants, kinds.pop())
    _read_states(facts)
    _read_axes(facts)
    _read_topics(facts)
    facts.times = _times(facts)
    levels = module.symbol.verify.levels
    facts.levels = 3 if levels is None else number_of(facts, levels)
    return facts


def _home(system: System, module: Module) -> tuple[System, Module, tuple[Component, ...]]:
    """The system to prove in, and its verification plants."""
    symbol = module.symbol
    sc = system.components[module.sc]
    links = symbol.verify.abstracts
    if links:
        ac = system.components[module.ac].node
        assert ac is not None
        assert sc.node is not None
        span = symbol.span
        parts: list[tuple[str, Any]] = [(link.name, link.plant) for link in links]
        own = _with_controllers(symbol, ac, sc.node)
        instances = tuple(
            typed.InstanceSymbol(n, what, {}, {}, span) for n, what in [*parts, (symbol.name, own)]
        )
        made = typed.SystemSymbol("recheck", span, False, instances, None, (), (), (), (), ())
        found = Diagnostics()
        elaborator = Elaborator(system.program, made, dict(system.params), found)
        elaborator.partial = True
        flattened = elaborator.run()
        if flattened is None or found.has_errors:
            raise SoterError(found.items)
        plants = tuple(c for c in flattened.components if c.role == "plant")
        return flattened, flattened.modules[0], plants
    wanted = {sc.scope.topics[t] for t in _read_by_sc(sc)}
    wanted |= {module.scope.topics[t] for t in topic_reads(*symbol.predicates)}
    named = {a.instance for g in symbol.verify.groups for a in g.axes if a.instance}
    for group in symbol.verify.groups:
        for axis in group.axes:
            scopes = (module.scope.topics, sc.scope.topics)
            wanted |= {s[axis.topic] for s in scopes if axis.topic is not None and axis.topic in s}
    home = module.name.rpartition(".")[0]
    names = {f"{home}.{n}" if home else n for n in named}
    plants = tuple(
        c
        for c in system.components
        if c.plant is not None
        and (c.name in names or any(c.scope.topics[t] in wanted for t, _ in c.plant.drives))
    )
    return system, module, plants


def _with_controllers(
    symbol: typed.ModuleSymbol, ac: typed.NodeSymbol, sc: typed.NodeSymbol
) -> typed.ModuleSymbol:
    if symbol.ac is ac and symbol.sc is sc:
        return symbol
    values = {**vars(symbol), "ac": ac, "sc": sc}
    return typed.ModuleSymbol(**values)


def _read_by_sc(sc: Component) -> list[typed.TopicSymbol]:
    if sc.node is None or sc.node.extern:
        raise NotRecheckedError("SC is not Soter source: nothing is known about its commands")
    return list(topic_reads(*sc.node.step))


def _kind(c: Component) -> str:
    plant = c.plant
    assert plant is not None
    if plant.extern:
        raise NotRecheckedError(f"the plant `{c.name}` is extern")
    if plant.der and plant.next:
        raise NotRecheckedError("flows and maps in one module")
    return "map" if plant.next else "flow"


# ---------------------------------------------------------------- inputs


def _read_states(facts: Facts) -> None:
    for c in facts.plants:
        plant = c.plant
        assert plant is not None
        for variable, initial, drawn in zip(plant.states, c.initial, c.initial_range, strict=True):
            moves = variable in plant.der or variable in plant.next
            if any("[]" in path for path, _ in leaves(variable.type)):
                raise NotRecheckedError(f"a list in the state `{variable.name}`")
            values = flat(initial)
            for k, (path, of) in enumerate(leaves(variable.type)):
                name = ".".join((c.name, variable.name, *path))
                if isinstance(of, FloatType):
                    low, high = drawn if drawn is not None else (values[k], values[k])
                    facts.states.append(
                        Input("state", name, c.index, variable.name, k, low, high, moves)
                    )
                elif moves:
                    raise NotRecheckedError(f"the state `{name}` moves and is no float")
                else:
                    facts.parameters.append(
                        Parameter(name, c.index, variable.name, k, _values_of(of, name))
                    )
        for d in c.disturbances:
            for k, (path, of) in enumerate(leaves(d.variable.type)):
                name = ".".join((c.name, d.variable.name, *path))
                if not isinstance(of, FloatType):
                    raise NotRecheckedError(f"the disturbance `{name}` is no float")
                facts.disturbances.append(
                    Input("disturbance", name, c.index, d.variable.name, k, d.low, d.high)
                )


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
    read = [sc.scope.topics[t] for t in _read_by_sc(sc)]
    predicates = [p for p in (module.symbol.ttf, module.symbol.safer) if p is not None]
    read += [module.scope.topics[t] for t in topic_reads(*predicates)]
    read = list(dict.fromkeys(read))
    driven = driven_topics(facts)
    seen = set(read)
    if not predicates:  # computed predicates read what carries the axes
        known = {*sc.scope.topics.values(), *module.scope.topics.values()}
        seen |= {topic for topic, _ in facts.leaves.values()} or known
    for index in module.outputs:
        facts.controls += _leaves_of(facts, index, "control")
    for c in facts.plants:
        for m in c.measured:
            if m.topic in seen and m.bound > 0.0:
                topic = facts.system.topics[m.topic]
                path = list(leaves(topic.type))[m.leaf][0]
                name = ".".join((topic.name, *path))
                facts.errors.append(Input("error", name, m.topic, "", m.leaf, -m.bound, m.bound))
    for index in read:
        if index not in driven:
            facts.others += _leaves_of(facts, index, "other")


def driven_topics(facts: Facts) -> dict[int, tuple[Component, typed.Expr]]:
    """Topic -> the plant that drives it, and how."""
    return {
        c.scope.topics[topic]: (c, expr)
        for c in facts.plants
        if c.plant is not None
        for topic, expr in c.plant.drives
    }


def _leaves_of(facts: Facts, index: int, kind: str) -> list[Input]:
    topic = facts.system.topics[index]
    if topic.queue_of is not None:
        raise NotRecheckedError(f"`{topic.name}` is a queue")
    found = []
    for k, ((path, of), bound) in enumerate(zip(leaves(topic.type), topic.bounds, strict=True)):
        name = ".".join((topic.name, *path))
        if not isinstance(of, FloatType):
            raise NotRecheckedError(f"the {kind} `{name}` is no float")
        if bound is None:
            raise NotRecheckedError(f"`{name}` has no value set")
        found.append(Input(kind, name, index, "", k, bound.low, bound.high))
    return found


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
            if axis.low is not None and axis.high is not None:
                extent = (float(number_of(facts, axis.low)), float(number_of(facts, axis.high)))
                facts.axes[state] = extent


def _state_of_axis(facts: Facts, axis: typed.GridAxis) -> int | None:
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
    return _followed(facts, component, expr, axis.path)


def _topic_of_axis(facts: Facts, topic: typed.TopicSymbol) -> int:
    """The topic that an axis names, as the module sees it; -1 where it does not."""
    for scope in (facts.module.scope.topics, facts.sc.scope.topics):
        if topic in scope:
            return scope[topic]
    return -1


def error_of(facts: Facts, state: int) -> float:
    """By how much the estimate of a state may be off, in the topic leaf that is its axis."""
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


def _followed(facts: Facts, c: Component, expr: typed.Expr, path: tuple[str, ...]) -> int | None:
    """The state that a leaf of a driven topic is, where it is just a state."""
    plant = c.plant
    assert plant is not None
    if isinstance(expr, typed.VarRead):
        lets = dict(plant.lets)
        if expr.variable in lets:
            return _followed(facts, c, lets[expr.variable], path)
        name = ".".join((c.name, expr.variable.name, *path))
        return next((i for i, s in enumerate(facts.states) if s.name == name), None)
    of = expr.type
    if isinstance(expr, typed.Field):
        fields = getattr(expr.target.type, "fields", ())
        return _followed(facts, c, expr.target, (fields[expr.index][0], *path))
    if isinstance(expr, typed.Aggregate) and path:
        fields = getattr(of, "fields", None)
        names = [n for n, _ in fields] if fields else [f"[{i}]" for i in range(len(expr.elements))]
        if path[0] not in names:
            return None
        at = names.index(path[0])
        order = expr.order if expr.order is not None else tuple(range(len(expr.elements)))
        return _followed(facts, c, expr.elements[order.index(at)], path[1:])
    return None


# ---------------------------------------------------------------- times


def number_of(facts: Facts, expr: typed.Expr | None) -> Any:  # noqa: ANN401  a Soter value
    """The value of a constant expression of the module; 0 where there is none."""
    return 0 if expr is None else Evaluator(facts.module.scope.params).value(expr)


def _times(facts: Facts) -> dict[str, int]:
    """Every time in ns, by its name in the manifest."""
    verify = facts.symbol.verify
    dm = facts.system.components[facts.module.dm]
    found = {
        "Delta_ns": facts.module.period_ns,
        "delta_ns": facts.sc.period_ns,
        "J_dm_ns": number_of(facts, verify.late_dm),
        "J_sc_ns": number_of(facts, verify.late_sc),
        "R_dm_ns": number_of(facts, verify.response_dm),
        "R_sc_ns": number_of(facts, verify.response_sc),
        "L_ns": number_of(facts, verify.acts),
    }
    driven = driven_topics(facts)
    predicates = [p for p in (facts.symbol.ttf, facts.symbol.safer) if p is not None]
    by_dm = {facts.module.scope.topics[t] for t in topic_reads(*predicates)} & set(driven)
    by_sc = {facts.sc.scope.topics[t] for t in _read_by_sc(facts.sc)} & set(driven)
    if not predicates:  # computed predicates read what carries the axes
        by_dm = {topic for topic, _ in facts.leaves.values()} or set(driven)
    if facts.kind == "map":
        _check_map(facts, found, by_dm | by_sc)
        found["A_ns"] = found["A_sc_ns"] = 0
    else:
        found["A_ns"] = _oldest(facts, by_dm)
        found["A_sc_ns"] = _oldest(facts, by_sc)
    if not facts.symbol.verify.abstracts:
        for together in (by_dm, by_sc):
            if len({(driven[t][0].period_ns, driven[t][0].phase_ns) for t in together}) > 1:
                raise DiffersError("what is read together is published at different times")
    period, delta = found["Delta_ns"], found["delta_ns"]
    common = gcd(period, delta)
    behind = (facts.sc.phase_ns - dm.phase_ns) % common
    gap = delta - common + behind
    wait = max(found["J_dm_ns"] + found["R_dm_ns"], gap + found["J_sc_ns"])
    star = found["A_ns"] + period + wait + found["R_sc_ns"] + found["L_ns"]
    found["H_star_ns"] = star
    found["H_ns"] = star if verify.horizon is None else int(number_of(facts, verify.horizon))
    if found["H_ns"] < star:
        raise DiffersError("P1c: the horizon is shorter than H*")
    return found


def _oldest(facts: Facts, topics: set[int]) -> int:
    ages = [facts.system.topics[i].max_age_ns for i in topics]
    if any(a is None for a in ages):
        raise NotRecheckedError("a topic that the module reads has no `max_age`")
    return max((a for a in ages if a is not None), default=0)


def _check_map(facts: Facts, times: dict[str, int], topics: set[int]) -> None:
    step = facts.plants[0].period_ns
    if any(c.period_ns != step for c in facts.plants):
        raise NotRecheckedError("maps with different periods")
    if times["Delta_ns"] % step or times["delta_ns"] % step or facts.sc.phase_ns % step:
        raise NotRecheckedError("a module that does not step together with its map")
    if any(times[k] for k in ("J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")):
        raise NotRecheckedError("delays beside a map")
    for index in topics:
        age = facts.system.topics[index].max_age_ns
        if age is None or age >= step:
            raise NotRecheckedError("beside a map `max_age` must be shorter than its period")
