"""The four rules of the paper's Figure "Semantics of an RTA System".

Purpose: each rule is one function from a configuration to a configuration; the figure's conditions
are named beside the line that is them. Rulings beyond the paper: docs/semantics.md.
Non-goals: which rule comes next, with what input, and steps of plants (`interpreter.py`); shields
(`shields.py`), properties (`judgements.py`), onsets and counts (`run_record.py`).

Every rule assumes its premises; `FN` is the set of components that remain to be fired.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.semantics.configuration import (
    AC,
    NEVER,
    SC,
    DecisionVerdict,
    StepOutcome,
    enabled_outputs,
    with_value,
)
from soter.semantics.draws import choice_answerer, draw_bits
from soter.semantics.faults import is_released, next_release, overrun_ns, with_faults
from soter.semantics.judgements import violated_contracts
from soter.semantics.latches import read_latch, with_latch_after_change, with_plan
from soter.semantics.publication_gate import (
    check_publications,
    clear_lost_queues,
    count_clean_step,
    empty_queues,
    latch_component,
    note_ac_fault,
    publish,
    require_nothing_lost,
)
from soter.semantics.shields import apply_shield

if TYPE_CHECKING:
    from soter.language.model.system import Component, Module
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


def environment_input(
    machine: ExecutableSystem,
    c: Configuration,
    topic: int,
    value: Value,
    time_ns: int | None = None,
) -> Configuration:
    """ENVIRONMENT-INPUT: an input topic takes a value of its set, at any time; None is ct.

    (L, OE, ct, FN, Topics) -> (L, OE, ct, FN, Topics[e -> v])
    """
    return publish(machine.system.topics, c, {topic: value}, time_ns)


def discrete_time_progress_step(machine: ExecutableSystem, c: Configuration) -> Configuration:
    """DISCRETE-TIME-PROGRESS-STEP: once nothing is left to fire, time moves to the next release.

    (L, OE, ct, FN, Topics) -> (L, OE, ct', FN', Topics).
    """
    assert not c.FN, "dt1: FN is empty"
    ct = next_instant(machine, c)  # dt2: the earliest (x, t) of the calendar with t > ct
    fn = [n.index for n in machine.system.components if _is_due(machine, c, n, ct)]  # dt3
    return replace(c, ct=ct, FN=tuple(fn))


def dm_step(
    machine: ExecutableSystem, c: Configuration, dm: int
) -> tuple[Configuration, DecisionVerdict]:
    """DM-STEP: the decision module reads the state topics and sets the mode.

    (L, OE, ct, FN, Topics) -> (L[dm -> l'], OE[ac -> en, sc -> not en], ct, FN minus {dm}, Topics)
    """
    code = machine.dms[dm]
    module = code.module
    mode = c.L[dm]
    env = machine.environment(c, machine.system.components[dm])
    stale = is_stale(machine, c, module)
    ttf, safer, plan, nan = code.decide(env, c.Topics)
    gate_fault = c.gate_fault[module.index]
    c, returns = read_latch(machine.system, c, module, mode)

    unsafe = ttf or stale or gate_fault
    after = mode
    if module.forced is None and mode == AC:
        after = SC if unsafe else AC
    elif module.forced is None:
        clean = not stale and c.clean_needed[module.index] == 0
        after = AC if safer and clean and returns else SC
    if after != mode:
        c = with_latch_after_change(c, module, after)
    c = with_plan(c, module, after, plan)
    if module.looked is not None:  # what `margin` counts from
        looks = module.periods_left(unsafe=unsafe, safer=safer)
        c = publish(machine.system.topics, c, {module.looked: looks})
    c = replace(
        c,
        L=with_value(c.L, dm, after),
        OE=enabled_outputs(c.OE, module, after),  # dm1, dm2
        FN=_without_node(c.FN, dm),
        gate_fault=with_value(c.gate_fault, module.index, False),
    )
    verdict = DecisionVerdict(module.index, ttf, safer, stale, gate_fault, mode, after, nan=nan)
    return c, verdict


def ac_or_sc_step(
    machine: ExecutableSystem, c: Configuration, n: int
) -> tuple[Configuration, StepOutcome]:
    """AC-OR-SC-STEP: a node (an AC, an SC, or one outside every module) steps.

    (L, OE, ct, FN, Topics) -> (L[n -> l'], OE, ct, FN minus {n}, Topics')
    """
    component = machine.system.components[n]
    c = replace(c, FN=_without_node(c.FN, n))
    if component.held is None:
        return _node_step(machine, c, component)
    late: dict[int, Value] = {}
    if c.stamps[component.held] == c.ct:
        c, late = publish_held(machine, c, component)
        if not _is_released(machine, component, c.ct):
            return c, StepOutcome(n, late)
    runs = not c.latched[n]
    c, outcome = _node_step(machine, c, component)
    c = draw_end(machine, c, component) if runs else c
    if c.stamps[component.held] == c.ct:  # the step took no time
        c, now = publish_held(machine, c, component)
        late |= now
    return c, replace(outcome, published={**late, **outcome.published})


def _node_step(
    machine: ExecutableSystem, c: Configuration, component: Component
) -> tuple[Configuration, StepOutcome]:
    """Steps a node; gives configuration and report. If the step takes time, outputs are held."""
    n = component.index
    oe, code = c.OE[n], machine.nodes[n]
    if c.latched[n]:
        return _publish_fail_safe(machine, c, component, StepOutcome(n, {}))
    assumed = violated_contracts(machine, c, component, "assumes")
    try:
        kept, out = _run_step(machine, c, component)  # (l, in, l', out) in T(n)
        if n in machine.faults:
            out = with_faults(machine.system, machine.faults[n], component, machine.seed, c, out)
        check_publications(machine.checks, code.outputs, out, component.span, code.bursts)
        commands = apply_shield(machine, c, component, out)
        out = commands.published
    except StepFault as fault:
        c, outcome = _outcome_after_fault(machine, c, component, fault)
        return c, replace(outcome, contract_violations=assumed)
    c = replace(c, L=with_value(c.L, n, kept), had_control=with_value(c.had_control, n, oe))
    c = empty_queues(c, code.queues)
    c = publish(machine.system.topics, c, commands.proposed)
    if component.role == "ac":
        c = count_clean_step(c, _module_of(machine, component), code.outputs, out)
    before = c if component.held is None else hold_outputs(machine, c, component, out if oe else {})
    if not oe:
        return before, StepOutcome(n, {}, contract_violations=assumed)
    # n1: ITE(OE[n], Topics' = out united with Topics[T \ dom(out)], Topics' = Topics)
    c = publish(machine.system.topics, c, {**out, **commands.held}, bursts=code.bursts)
    guaranteed = (
        {} if any(assumed.values()) else violated_contracts(machine, c, component, "guarantees")
    )
    if component.held is not None:
        return before, StepOutcome(n, {}, contract_violations={**assumed, **guaranteed})
    several = {t: out[t] for t in code.bursts if t in out}
    values = {**out, **{t: of_step[-1] for t, of_step in several.items()}}
    return c, StepOutcome(n, values, contract_violations={**assumed, **guaranteed}, bursts=several)


# ---------------------------------------------------------------- premises


def next_instant(machine: ExecutableSystem, c: Configuration) -> int:
    """Gives the earliest time after ct at which a release, an input or a step's end is due."""
    system, ct = machine.system, c.ct
    times = [_next_release(machine, ct, n) for n in system.components]
    times += [_next_multiple(ct, 0, i.every_ns) for i in system.inputs]
    held = [c.stamps[n.held] for n in system.components if n.held is not None]
    return min(times + [t for t in held if t != NEVER])


def _next_release(machine: ExecutableSystem, ct: int, n: Component) -> int:
    """Gives the first release of a component after `ct`, with the system's faults applied."""
    late = machine.timing.get(n.index)
    if late is None:
        return _next_multiple(ct, n.phase_ns, n.period_ns)
    return next_release(machine.system, late, n, machine.seed, ct)


def _is_due(machine: ExecutableSystem, c: Configuration, n: Component, ct: int) -> bool:
    """Whether a component fires at `ct`: its step ends, or it is released and no step lasts."""
    ends = NEVER if n.held is None else c.stamps[n.held]
    return ends == ct or (ends == NEVER and _is_released(machine, n, ct))


def _next_multiple(ct: int, phase: int, period: int) -> int:
    """Gives the smallest phase + k * period, k >= 0, after `ct`."""
    return phase if ct < phase else ct + period - (ct - phase) % period


def _is_released(machine: ExecutableSystem, n: Component, ct: int) -> bool:
    """Whether the component is released at `ct`, with the system's faults applied."""
    late = machine.timing.get(n.index)
    if late is not None:
        return is_released(machine.system, late, n, machine.seed, ct)
    return ct >= n.phase_ns and (ct - n.phase_ns) % n.period_ns == 0


def _without_node(fn: tuple[int, ...], n: int) -> tuple[int, ...]:
    """Gives FN' = FN minus {n}."""
    assert n in fn, "a component fires once an instant"
    return tuple([i for i in fn if i != n])


# ---------------------------------------------------------------- of a DM


def is_stale(machine: ExecutableSystem, c: Configuration, module: Module) -> bool:
    """Whether a topic that the DM reads is older than its `max_age`, or shows another instant."""
    for index in module.inputs:
        max_age = machine.system.topics[index].max_age_ns
        if max_age is not None and c.ct - c.stamps[index] > max_age:
            return True
    together = machine.dms[module.dm].together
    return any(abs(c.stamps[i] - c.stamps[j]) > most for i, j, most in together)


# ---------------------------------------------------------------- of a step that takes time


def draw_end(machine: ExecutableSystem, c: Configuration, component: Component) -> Configuration:
    """Draws when the step that begins now ends; the held topic's stamp stores that time."""
    assert component.held is not None
    low, high = component.takes_ns or (0, 0)
    faults = machine.faults.get(component.index, ())
    index = (c.ct - component.phase_ns) // component.period_ns
    drawn = draw_bits(machine.seed, f"{component.name}.takes", index)
    took = low + drawn % (high - low + 1) + overrun_ns(faults, component, machine.seed, c.ct)
    return replace(c, stamps=with_value(c.stamps, component.held, c.ct + took))


def hold_outputs(
    machine: ExecutableSystem, c: Configuration, component: Component, out: dict[int, Value]
) -> Configuration:
    """Stores the publications of a step in its held topic until they take effect."""
    assert component.held is not None
    value: list[Value] = list(machine.system.topics[component.held].default)
    for k, topic in enumerate(machine.nodes[component.index].outputs):
        if topic in out:
            value[3 * k : 3 * k + 3] = [True, c.ct, out[topic]]
    return replace(c, Topics=with_value(c.Topics, component.held, tuple(value)))


def publish_held(
    machine: ExecutableSystem, c: Configuration, component: Component
) -> tuple[Configuration, dict[int, Value]]:
    """Publishes held outputs if they are enabled; also gives the published values by topic."""
    assert component.held is not None
    value = c.Topics[component.held]
    outputs = machine.nodes[component.index].outputs
    out = {t: value[3 * k + 2] for k, t in enumerate(outputs) if value[3 * k]}
    nothing = machine.system.topics[component.held].default
    c = replace(
        c,
        Topics=with_value(c.Topics, component.held, nothing),
        stamps=with_value(c.stamps, component.held, NEVER),
    )
    if not c.OE[component.index]:
        return c, {}
    return publish(machine.system.topics, c, out), out


# ---------------------------------------------------------------- of a node


def _run_step(
    machine: ExecutableSystem, c: Configuration, component: Component
) -> tuple[tuple[Value, ...], dict[int, Value]]:
    """Gives (l', out) of one step, with `on takeover` if control is new; raises StepFault."""
    n = component.index
    code = machine.nodes[n]
    env = machine.environment(c, component)
    env.variables.update(zip(code.locals, c.L[n], strict=True))
    env.choose = choice_answerer(machine.draws, component, c.ct)
    control_is_new = c.OE[n] and not c.had_control[n]
    takeover = code.takeover if control_is_new else None
    if not component.extern:
        require_nothing_lost(c, code.queues, component.span)
        if takeover is not None:
            takeover(env)
    code.step(env)
    if component.extern:  # which is asked first, and sees no locals
        require_nothing_lost(c, code.queues, component.span)
        if takeover is not None:
            takeover(env)
    return code.store(tuple([env.variables[v] for v in code.locals])), env.published


def _outcome_after_fault(
    machine: ExecutableSystem, c: Configuration, component: Component, fault: StepFault
) -> tuple[Configuration, StepOutcome]:
    """Handles a step fault: gates AC, or latches a trusted node; also gives a report."""
    n = component.index
    if fault.kind is FaultKind.CAPACITY:
        c = clear_lost_queues(c, machine.nodes[n].queues)
    if component.role == "ac":
        module = _module_of(machine, component)
        return note_ac_fault(c, module), StepOutcome(n, {}, fault, module=module.index)
    return _publish_fail_safe(
        machine, latch_component(c, n), component, StepOutcome(n, {}, fault, latched=True)
    )


def _publish_fail_safe(
    machine: ExecutableSystem, c: Configuration, component: Component, outcome: StepOutcome
) -> tuple[Configuration, StepOutcome]:
    """Publishes the fail-safe values of a latched node, if its outputs are enabled."""
    if not c.OE[component.index]:
        return c, outcome
    c = publish(machine.system.topics, c, component.failsafe)
    return c, replace(outcome, published=component.failsafe)


def _module_of(machine: ExecutableSystem, component: Component) -> Module:
    assert component.module is not None, component.name
    return machine.system.modules[component.module]
