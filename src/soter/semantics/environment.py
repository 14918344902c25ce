"""The environment: plants that a program describes itself, and values from outside.

Purpose: the step of a plant draws the disturbances, integrates, measures and publishes
(docs/semantics.md, Plants); the calendar releases a plant as it releases a node. The premises of
ENVIRONMENT-INPUT are checked before a value from outside is believed; this is the twin of
`soter_publish` in `runtime/soter.h`.
Non-goals: what a plant means for proofs (`verify/`), compiling it (`executable_system.py`), who
publishes what (drivers), the rule itself (`rules.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.statements import replaced
from soter.language.model.system import environment_topics
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.semantics.configuration import StepOutcome, put
from soter.semantics.draws import assemble, chooser
from soter.semantics.faults import disturbed, factor
from soter.semantics.publication_gate import check_publications, latch, publish, to_ends
from soter.semantics.rules import next_instant

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.evaluate.environment import Environment
    from soter.language.model.system import Component, Disturbance
    from soter.language.model.typed import Variable
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.draws import Draws
    from soter.semantics.executable_system import Arithmetic, ExecutableSystem, PlantCode

    Derivative = Callable[[list[Value]], list[Value]]
    Steps = tuple[Arithmetic, ...]


# ---------------------------------------------------------------- the step


def plant_step(
    machine: ExecutableSystem, c: Configuration, n: int
) -> tuple[Configuration, StepOutcome]:
    """One step of the plant `n` at ct: it moves over the period that ends now, and publishes.

    At its first release it only publishes. A step fault latches it: a stopped world is no
    environment to be safe in, so the run counts as violated.
    """
    c = replace(c, FN=tuple(i for i in c.FN if i != n))
    if c.latched[n]:
        return c, StepOutcome(n, {})
    code = machine.plants[n]
    component = code.component
    moves = c.ct > component.phase_ns
    env = machine.environment(c, component)
    try:
        drawn = _disturbances(component, machine.draws, c.ct if moves else None)
        if n in machine.faults:
            drawn = _scaled(machine, component, drawn, c.ct)
        env.variables.update(drawn)
        states = c.L[n]
        env.choose = chooser(machine.draws, component, c.ct)
        _choose_lets(code, env, states)
        if moves:
            states = code.store(_moved(code, env, states))
        out = _measured(code, env, states, machine.draws, c.ct)
        if n in machine.faults:
            out = disturbed(machine.system, machine.faults[n], component, machine.seed, c, out)
        check_publications(machine.checks, out, out, component.span)
    except StepFault as fault:
        return latch(c, n), StepOutcome(n, {}, fault, latched=True)
    c = publish(machine.system.topics, replace(c, L=put(c.L, n, states)), out)
    return c, StepOutcome(n, out)


def _disturbances(component: Component, draws: Draws, ct: int | None) -> dict[Variable, Value]:
    """The disturbances over the period that ends at `ct`; at the first release (None) draw 0."""
    drawn = {}
    for d in component.disturbances:
        hold = d.hold_ns or component.period_ns
        index = 0 if ct is None else (ct - component.period_ns) // hold
        drawn[d.variable] = _disturbance(d, draws, index)
    return drawn


def _scaled(
    machine: ExecutableSystem, component: Component, drawn: dict[Variable, Value], ct: int
) -> dict[Variable, Value]:
    """The disturbances, as faults of the system make them larger or smaller."""
    value_by_variable = dict(drawn)
    for i, d in enumerate(component.disturbances):
        by = factor(machine.faults[component.index], component, i, machine.seed, ct)
        scaled = (x * by for x in _flat(value_by_variable[d.variable]))
        value_by_variable[d.variable] = assemble(d.variable.type, scaled)
    return value_by_variable


def _flat(value: Value) -> list[float]:
    return [x for part in value for x in _flat(part)] if isinstance(value, tuple) else [value]


def _disturbance(d: Disturbance, draws: Draws, index: int) -> Value:
    drawn = (draws.uniform(stream, index, d.low, d.high) for stream in d.streams)
    return assemble(d.variable.type, drawn)


# ---------------------------------------------------------------- motion


def _moved(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> tuple[Value, ...]:
    """The states one period later: every `next` from the old states, every `der` integrated."""
    if code.move is not None:
        return code.move(env, states)
    new = dict(zip(code.states, states, strict=True))
    if code.next:
        _see(code, env, states)
        new.update({variable: value(env) for variable, value in code.next})
    if code.der:
        new.update(_integrated(code, env, states))
    return tuple([new[variable] for variable in code.states])


def _integrated(
    code: PlantCode, env: Environment, states: tuple[Value, ...]
) -> dict[Variable, Value]:
    """All `der` states together over one period, in `substeps` equal steps; the others held."""
    variables = [variable for variable, _ in code.der]

    def f(x: list[Value]) -> list[Value]:
        env.variables.update(zip(variables, x, strict=True))
        _evaluate_lets(code, env)
        return [derivative(env) for _, derivative in code.der]

    _set_states(code, env, states)
    x = [env.variables[variable] for variable in variables]
    h = float(code.component.period_ns) / 1e9 / float(code.component.substeps)
    step = STEPS[code.method]
    for _ in range(code.component.substeps):
        x = step(f, x, h, code.arithmetic)
    return dict(zip(variables, x, strict=True))


def _euler(f: Derivative, x: list[Value], h: float, arithmetic: Steps) -> list[Value]:
    """`x + h*f(x)`."""
    return _along(x, h, f(x), arithmetic)


def _rk4(f: Derivative, x: list[Value], h: float, arithmetic: Steps) -> list[Value]:
    """`x + (h/6)*(((k1 + 2*k2) + 2*k3) + k4)`."""
    k1 = f(x)
    k2 = f(_along(x, h * 0.5, k1, arithmetic))
    k3 = f(_along(x, h * 0.5, k2, arithmetic))
    k4 = f(_along(x, h, k3, arithmetic))
    k = _along(_along(k1, 2.0, k2, arithmetic), 2.0, k3, arithmetic)
    k = [a.add(y, z) for a, y, z in zip(arithmetic, k, k4, strict=True)]
    return _along(x, h / 6.0, k, arithmetic)


STEPS = {"euler": _euler, "rk4": _rk4}
"""One step of every scheme (`SCHEMES`)."""


def _along(x: list[Value], factor: float, k: list[Value], arithmetic: Steps) -> list[Value]:
    """`x + factor*k`."""
    return [a.add(y, a.scale(factor, z)) for a, y, z in zip(arithmetic, x, k, strict=True)]


# ---------------------------------------------------------------- measurement


def _measured(
    code: PlantCode, env: Environment, states: tuple[Value, ...], draws: Draws, ct: int
) -> dict[int, Value]:
    """What the plant publishes: its `drives` on these states, measurement errors added."""
    _see(code, env, states)
    out = {topic: value(env) for topic, value in code.drives}
    for r in code.readings:
        error = draws.uniform(r.stream, ct // code.component.period_ns, -r.bound, r.bound)
        leaf = out[r.topic]
        for position in r.path:
            leaf = leaf[position]
        out[r.topic] = replaced(out[r.topic], r.path, leaf + error)
    return out


def _see(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> None:
    """Let expressions see these states, and the lets that follow from them."""
    _set_states(code, env, states)
    _evaluate_lets(code, env)


def _set_states(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> None:
    env.variables.update(zip(code.states, states, strict=True))


def _evaluate_lets(code: PlantCode, env: Environment) -> None:
    """All but those that chose at the beginning of the step."""
    for variable, value in code.lets:
        if variable not in code.chosen:
            env.variables[variable] = value(env)


def _choose_lets(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> None:
    """The lets that choose, once a step, on the states that it begins with."""
    if not code.first:
        return
    _set_states(code, env, states)
    for variable, value in code.first:
        env.variables[variable] = value(env)


def refusal(
    machine: ExecutableSystem,
    c: Configuration,
    topic: int,
    value: Value,
    time_ns: int,
    *,
    within: bool = False,
) -> FaultKind | None:
    """Why `topic` does not take `value`, measured at `time_ns`; None where it does.

    EXTERN: the topic is not the environment's, the value is none of its type, or the time is before
    the topic's stamp or after the next instant (while one waits: after ct). NONFINITE, RANGE: the
    value is not in the topic's set (`to_ends`). `within`: time has moved to an instant that is not
    over, though FN may be empty: nobody is released when only an input is drawn.
    """
    topics = machine.system.topics
    if topic not in environment_topics(machine.system):
        return FaultKind.EXTERN
    latest = c.ct if c.FN or within else next_instant(machine, c)
    if not c.stamps[topic] <= time_ns <= latest or not is_value(topics[topic].type, value):
        return FaultKind.EXTERN
    try:
        machine.checks[topic](to_ends(topics[topic], value), topics[topic].symbol.span)
    except StepFault as fault:
        return fault.kind
    return None


def is_value(t: Type, value: Value) -> bool:
    """Whether an object is a value of a type, as the interpreter keeps it."""
    if isinstance(t, FloatType):
        return isinstance(value, float)
    if isinstance(t, BoolType):
        return isinstance(value, bool)
    if isinstance(t, (EnumType, IntType)):
        low, high = (0, len(t.members) - 1) if isinstance(t, EnumType) else (t.low, t.high)
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
    if not isinstance(value, tuple):
        return False
    if isinstance(t, RecordType):
        return len(value) == len(t.fields) and all(
            is_value(f, v) for (_, f), v in zip(t.fields, value, strict=True)
        )
    assert isinstance(t, (ArrayType, ListType)), t
    fits = len(value) == t.size if isinstance(t, ArrayType) else len(value) <= t.capacity
    return fits and all(is_value(t.element, v) for v in value)
