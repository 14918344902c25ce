"""The reference interpreter: a driver that decides which rule comes next, and its environment.

Purpose: an `Interpreter` runs a system in virtual time. The two choices the paper leaves open, the
next node of FN and the environment's inputs, are functions passed in; by default they are those of
the deployed drivers (docs/semantics.md, Deployed order). `plant_step` draws the disturbances,
integrates, measures and publishes (docs/semantics.md, Plants); the calendar releases a plant as it
releases a node. `why_refused` checks the premises of ENVIRONMENT-INPUT before a value from outside
is believed; it is the twin of `soter_publish` in `runtime/soter.h`.
Non-goals: speed, logs, searching (`explore/` brings its own choices); what a plant means for proofs
(`verify/`), compiling it (`executable_system.py`); the rules (`rules.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.statements import with_part
from soter.language.model.system import Bound, environment_topics
from soter.language.model.types import leaf_count
from soter.language.model.values import is_value
from soter.semantics.configuration import (
    AC,
    NEVER,
    SC,
    Configuration,
    StepOutcome,
    enabled_at_first,
    with_value,
)
from soter.semantics.draws import choice_answerer, chosen_value, value_of_leaves
from soter.semantics.executable_system import ExecutableSystem
from soter.semantics.externs import reset_extern
from soter.semantics.faults import disturbance_factor, random_next_index, with_faults
from soter.semantics.judgements import violated_properties
from soter.semantics.publication_gate import (
    check_publications,
    latch_component,
    publish,
    with_rounded_ends,
)
from soter.semantics.rules import (
    ac_or_sc_step,
    discrete_time_progress_step,
    dm_step,
    environment_input,
    next_instant,
)
from soter.semantics.run_record import ComponentRecord, ModuleRecord, PropertyRecord, Record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from soter.language.evaluate.environment import Environment
    from soter.language.model.system import Component, Disturbance, InputDrive, Module, System
    from soter.language.model.typed import Variable
    from soter.language.model.types import Value
    from soter.semantics.configuration import DecisionVerdict
    from soter.semantics.draws import Draws
    from soter.semantics.executable_system import Arithmetic, PlantCode

    Derivative = Callable[[list[Value]], list[Value]]
    Steps = tuple[Arithmetic, ...]
    ChooseNode = Callable[[Configuration], int]
    ChooseInput = Callable[[Configuration], Iterable[tuple[int, Value]]]
    Observe = Callable[[Configuration, Record], object]


# ---------------------------------------------------------------- the step


def plant_step(
    machine: ExecutableSystem, c: Configuration, n: int
) -> tuple[Configuration, StepOutcome]:
    """Steps plant `n` at ct: it moves over the period that ends now, and then publishes.

    At its first release it only publishes. A step fault latches the plant. The run then counts as
    violated, because a world that has stopped is no environment to be safe in.
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
            drawn = _scaled_disturbances(machine, component, drawn, c.ct)
        env.variables.update(drawn)
        states = c.L[n]
        env.choose = choice_answerer(machine.draws, component, c.ct)
        _evaluate_choosing_lets(code, env, states)
        if moves:
            states = code.store(_next_states(code, env, states))
        out = _driven_values(code, env, states, machine.draws, c.ct)
        if n in machine.faults:
            out = with_faults(machine.system, machine.faults[n], component, machine.seed, c, out)
        check_publications(machine.checks, out, out, component.span)
    except StepFault as fault:
        return latch_component(c, n), StepOutcome(n, {}, fault, latched=True)
    c = publish(machine.system.topics, replace(c, L=with_value(c.L, n, states)), out)
    return c, StepOutcome(n, out)


def _disturbances(component: Component, draws: Draws, ct: int | None) -> dict[Variable, Value]:
    """Draws the disturbances of the period that ends at `ct` (None at the first release)."""
    drawn = {}
    for d in component.disturbances:
        hold = d.hold_ns or component.period_ns
        index = 0 if ct is None else (ct - component.period_ns) // hold
        drawn[d.variable] = _draw_disturbance(d, draws, index)
    return drawn


def _scaled_disturbances(
    machine: ExecutableSystem, component: Component, drawn: dict[Variable, Value], ct: int
) -> dict[Variable, Value]:
    """Gives the drawn disturbances, scaled by the plant's faults that are active at ct."""
    value_by_variable = dict(drawn)
    for i, d in enumerate(component.disturbances):
        by = disturbance_factor(machine.faults[component.index], component, i, machine.seed, ct)
        scaled = (x * by for x in _numbers_in(value_by_variable[d.variable]))
        value_by_variable[d.variable] = value_of_leaves(d.variable.type, scaled)
    return value_by_variable


def _numbers_in(value: Value) -> list[float]:
    return [x for part in value for x in _numbers_in(part)] if isinstance(value, tuple) else [value]


def _draw_disturbance(d: Disturbance, draws: Draws, index: int) -> Value:
    drawn = (draws.uniform(stream, index, d.low, d.high) for stream in d.streams)
    return value_of_leaves(d.variable.type, drawn)


# ---------------------------------------------------------------- motion


def _next_states(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> tuple[Value, ...]:
    """Gives the states one period later: `next` is evaluated on the old ones, `der` integrated."""
    if code.move is not None:
        return code.move(env, states)
    new = dict(zip(code.states, states, strict=True))
    if code.next:
        _set_states_and_lets(code, env, states)
        new.update({variable: value(env) for variable, value in code.next})
    if code.der:
        new.update(_integrated_states(code, env, states))
    return tuple([new[variable] for variable in code.states])


def _integrated_states(
    code: PlantCode, env: Environment, states: tuple[Value, ...]
) -> dict[Variable, Value]:
    """Gives the `der` states after a period of `substeps` equal steps; others are constant."""
    variables = [variable for variable, _ in code.der]

    def derivatives(x: list[Value]) -> list[Value]:
        env.variables.update(zip(variables, x, strict=True))
        _evaluate_lets(code, env)
        return [derivative(env) for _, derivative in code.der]

    _set_states(code, env, states)
    x = [env.variables[variable] for variable in variables]
    h = float(code.component.period_ns) / 1e9 / float(code.component.substeps)
    step = STEPS[code.method]
    for _ in range(code.component.substeps):
        x = step(derivatives, x, h, code.arithmetic)
    return dict(zip(variables, x, strict=True))


def _euler_step(f: Derivative, x: list[Value], h: float, arithmetic: Steps) -> list[Value]:
    """Gives `x + h*f(x)`."""
    return _moved_along(x, h, f(x), arithmetic)


def _rk4_step(f: Derivative, x: list[Value], h: float, arithmetic: Steps) -> list[Value]:
    """Gives `x + (h/6)*(((k1 + 2*k2) + 2*k3) + k4)`."""
    k1 = f(x)
    k2 = f(_moved_along(x, h * 0.5, k1, arithmetic))
    k3 = f(_moved_along(x, h * 0.5, k2, arithmetic))
    k4 = f(_moved_along(x, h, k3, arithmetic))
    k = _moved_along(_moved_along(k1, 2.0, k2, arithmetic), 2.0, k3, arithmetic)
    k = [a.add(y, z) for a, y, z in zip(arithmetic, k, k4, strict=True)]
    return _moved_along(x, h / 6.0, k, arithmetic)


STEPS = {"euler": _euler_step, "rk4": _rk4_step}
"""One step of every scheme (`SCHEMES`)."""


def _moved_along(x: list[Value], factor: float, k: list[Value], arithmetic: Steps) -> list[Value]:
    """Gives `x + factor*k`."""
    return [a.add(y, a.scale(factor, z)) for a, y, z in zip(arithmetic, x, k, strict=True)]


# ---------------------------------------------------------------- measurement


def _driven_values(
    code: PlantCode, env: Environment, states: tuple[Value, ...], draws: Draws, ct: int
) -> dict[int, Value]:
    """Gives the topic values that the plant publishes: `drives` of these states, plus errors."""
    _set_states_and_lets(code, env, states)
    out = {topic: value(env) for topic, value in code.drives}
    for r in code.readings:
        error = draws.uniform(r.stream, ct // code.component.period_ns, -r.bound, r.bound)
        leaf = out[r.topic]
        for position in r.path:
            leaf = leaf[position]
        out[r.topic] = with_part(out[r.topic], r.path, leaf + error)
    return out


def _set_states_and_lets(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> None:
    """Makes these states, and the lets that depend on them, readable for expressions."""
    _set_states(code, env, states)
    _evaluate_lets(code, env)


def _set_states(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> None:
    env.variables.update(zip(code.states, states, strict=True))


def _evaluate_lets(code: PlantCode, env: Environment) -> None:
    """Evaluates all lets except those that made a choice at the beginning of the step."""
    for variable, value in code.lets:
        if variable not in code.chosen:
            env.variables[variable] = value(env)


def _evaluate_choosing_lets(code: PlantCode, env: Environment, states: tuple[Value, ...]) -> None:
    """Evaluates the lets that make a choice, once in a step, on the states at its beginning."""
    if not code.first:
        return
    _set_states(code, env, states)
    for variable, value in code.first:
        env.variables[variable] = value(env)


def why_refused(
    machine: ExecutableSystem,
    c: Configuration,
    topic: int,
    value: Value,
    time_ns: int,
    *,
    within: bool = False,
) -> FaultKind | None:
    """Gives why `topic` refuses `value`, measured at `time_ns`; None if it takes it.

    EXTERN: the topic is not the environment's, the value is not of its type, or the time is before
    the topic's stamp or after the next instant (while one waits: after ct). NONFINITE, RANGE: the
    value is not in the topic's set (`rounded_to_ends`). `within`: time has moved to an instant that
    is not over, though FN may be empty: nobody is released when only an input is drawn.
    """
    topics = machine.system.topics
    if topic not in environment_topics(machine.system):
        return FaultKind.EXTERN
    latest = c.ct if c.FN or within else next_instant(machine, c)
    if not c.stamps[topic] <= time_ns <= latest or not is_value(topics[topic].type, value):
        return FaultKind.EXTERN
    try:
        machine.checks[topic](with_rounded_ends(topics[topic], value), topics[topic].symbol.span)
    except StepFault as fault:
        return fault.kind
    return None


def first_in_deployed_order(c: Configuration) -> int:
    """Gives the next node of FN in deployed order: plants, DMs, SCs, others, each as declared."""
    return c.FN[0]


class Interpreter:
    """Runs one system under one seed.

    `externs` maps the names of extern nodes, plants and functions to callables of one argument
    (functions: of their declared arguments), or to objects with a method `step` and perhaps
    `reset(seed)`; `language/model/values.py` describes arguments and answers. Raises
    `UnboundExternError` if an extern is missing. `draws` makes the choices of the environment.
    """

    def __init__(
        self,
        system: System,
        seed: int = 0,
        externs: Mapping[str, object] | None = None,
        draws: Draws | None = None,
    ) -> None:
        self.system = system
        self._externs = externs or {}
        self.machine = ExecutableSystem(system, seed, self._externs, draws)

    # ------------------------------------------------------------ the start

    def initial(self) -> Configuration:
        """Gives (L0, OE0, ct0, FN0, Topics0) after a reset of externs (`ExternResetError`)."""
        for name, bound in self._externs.items():
            reset_extern(name, bound, self.machine.seed)
        components, modules = self.system.components, self.system.modules
        return Configuration(
            L=tuple([self._first_state(n) for n in components]),
            OE=enabled_at_first(self.system, [_first_mode(m) for m in modules]),
            ct=-1,
            FN=(),
            Topics=tuple([topic.default for topic in self.system.topics]),
            stamps=(NEVER,) * len(self.system.topics),
            latched=(False,) * len(components),
            had_control=(False,) * len(components),
            gate_fault=(False,) * len(modules),
            clean_needed=(0,) * len(modules),
        )

    def record(self) -> Record:
        """Gives an empty record for a run from `initial()`."""
        return Record(
            modules=[ModuleRecord(_first_mode(m)) for m in self.system.modules],
            components=[ComponentRecord() for _ in self.system.components],
            properties=[
                PropertyRecord(contract=p.component is not None) for p in self.system.properties
            ],
        )

    def _first_state(self, n: Component) -> Value:
        if n.role == "dm":
            return _first_mode(self._module_of(n))
        if n.plant is None:
            return n.initial
        return tuple([self._first_plant_state(n, i) for i in range(len(n.plant.states))])

    def _first_plant_state(self, n: Component, i: int) -> Value:
        span = n.initial_range[i] if i < len(n.initial_range) else None
        if span is None:
            return n.initial[i]
        assert n.plant is not None, n.name
        state = n.plant.states[i]
        bounds = [Bound(*span)] * leaf_count(state.type)
        return chosen_value(
            state.type, bounds, self.machine.draws, f"{n.name}.{state.name}.start", 0
        )

    def _module_of(self, n: Component) -> Module:
        assert n.module is not None, n.name
        return self.system.modules[n.module]

    # ------------------------------------------------------------ transitions

    def enabled(self, c: Configuration) -> tuple[int, ...]:
        """Gives the components that may fire next; () if time may progress."""
        return c.FN

    def fire(self, c: Configuration, n: int) -> tuple[Configuration, DecisionVerdict | StepOutcome]:
        """Fires component `n` by the rule for its role; gives the configuration and a report."""
        role = self.system.components[n].role
        if role == "plant":
            return plant_step(self.machine, c, n)
        if role == "dm":
            return dm_step(self.machine, c, n)
        return ac_or_sc_step(self.machine, c, n)

    def next_node(self, c: Configuration) -> int:
        """Gives the next node in deployed order; if shuffled, a random one after the plants."""
        first = first_in_deployed_order(c)
        if not self.system.shuffled or self.system.components[first].role == "plant":
            return first
        return c.FN[random_next_index(self.machine.seed, c.ct, len(c.FN))]

    def publish(self, c: Configuration, published: Mapping[int, Value]) -> Configuration:
        """Puts values on topics and their queues, for drivers that delay publications."""
        return publish(self.system.topics, c, published)

    def publish_input(
        self, c: Configuration, topic: int, value: Value, time_ns: int, *, within: bool = False
    ) -> tuple[Configuration, FaultKind | None]:
        """Publishes a value from outside, measured at `time_ns`, as `soter_publish` does in C.

        The topic gets it with this stamp; if it is refused nothing changes, and the kind says why
        (`why_refused`). `within`: the driver has moved time and not ended the instant, which C
        knows by itself, but a configuration with FN empty does not show.
        """
        refused = why_refused(self.machine, c, topic, value, time_ns, within=within)
        if refused is not None:
            return c, refused
        taken = with_rounded_ends(self.system.topics[topic], value)
        return environment_input(self.machine, c, topic, taken, time_ns), None

    def due_inputs(self, c: Configuration) -> Iterable[tuple[int, Value]]:
        """Yields (topic, value) for each `input t every d` that is due at ct, with drawn values."""
        for drive in self.system.inputs:
            if c.ct % drive.every_ns == 0:
                yield drive.topic, self.drawn_input(drive, c.ct)

    def drawn_input(self, drive: InputDrive, ct: int) -> Value:
        """Gives the value that the draws choose for an input at ct."""
        topic, draws = self.system.topics[drive.topic], self.machine.draws
        stream, index = f"input.{topic.name}", ct // drive.every_ns
        if drive.values:
            return drive.values[draws.choice(stream, index, len(drive.values))]
        return chosen_value(topic.type, topic.bounds, draws, stream, index)

    def instant(
        self,
        c: Configuration,
        choose_node: ChooseNode | None = None,
        choose_input: ChooseInput | None = None,
        record: Record | None = None,
    ) -> Configuration:
        """Runs one instant: time progresses, inputs change, FN fires; gives the new configuration.

        `choose_node` picks a node from the FN of a configuration; `choose_input` gives the new
        instant's inputs, (topic index, value). `record` gets the reports and violated properties.
        """
        choose = choose_node or self.next_node
        c = discrete_time_progress_step(self.machine, c)
        for topic, value in (choose_input or self.due_inputs)(c):
            c = environment_input(self.machine, c, topic, value)
        while c.FN:
            c, event = self.fire(c, choose(c))
            if record is not None:
                record.note_event(event, c.ct)
        if record is not None:
            record.note_properties(violated_properties(self.machine, c), c.ct)
        return c

    def run(
        self,
        until_ns: int | None = None,
        observe: Observe | None = None,
        choose_node: ChooseNode | None = None,
        choose_input: ChooseInput | None = None,
    ) -> tuple[Configuration, Record]:
        """Runs all instants up to and including `until_ns`, by default the system's `until`.

        `observe` sees the configuration and the record after every instant.
        """
        until = self.system.until_ns if until_ns is None else until_ns
        assert until is not None, "the system says no `until`: pass one"
        c, record = self.initial(), self.record()
        while next_instant(self.machine, c) <= until:
            c = self.instant(c, choose_node, choose_input, record)
            if observe is not None:
                observe(c, record)
        return c, record


def _first_mode(module: Module) -> int:
    """Gives the mode in which a module starts: SC, or AC if the system forces AC."""
    return AC if module.forced == "ac" else SC
