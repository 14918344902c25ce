"""The faults that a run meets, as the `faults` of its system say.

Purpose: says whether a fault is active at a time, when a release really happens, and what becomes
of a publication (docs/semantics.md, Faults). All of it follows from seed and time alone: a run that
is continued from a copy meets the same faults.
Non-goals: which faults a system has (`language/elaborate/faults.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import maximum, minimum, with_stored_nan
from soter.language.evaluate.statements import with_part
from soter.language.model.types import leaves, positions
from soter.semantics.draws import draw_bits, draw_float

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Bound, Component, Fault, System
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration


FINE = 20
"""How many random bits say where between two quantiles a lateness lies."""
ON_TIME = 4096
"""One in so many releases is on time, whatever happens, so that a next release always exists."""
LEAVES = 256
"""How many indices of the stream of amounts belong to one slot, or to one step."""
ORDERS = 64
"""How many indices of the stream of orders belong to one instant."""


def group_by_component(system: System, *, changes_releases: bool) -> dict[int, tuple[Fault, ...]]:
    """Maps each component to its faults that change releases, or else to its other faults."""
    faults_by_component: dict[int, tuple[Fault, ...]] = {}
    for f in system.faults:
        if f.changes_releases == changes_releases:
            faults_by_component[f.component] = (*faults_by_component.get(f.component, ()), f)
    return faults_by_component


# ---------------------------------------------------------------- when


def fault_slot(fault: Fault, seed: int, t: int, period_ns: int) -> int:
    """Gives the number of the fault's slot that t lies in; a draw a slot says if it is faulty."""
    if fault.slot_ns == 0:
        return t // period_ns
    return (t + _slot_offset(fault, seed)) // fault.slot_ns


def _slot_offset(fault: Fault, seed: int) -> int:
    return draw_bits(seed, f"{fault.stream}.at", 0) % fault.slot_ns


def _is_slot_faulty(fault: Fault, seed: int, slot: int) -> bool:
    return draw_float(seed, fault.stream, slot, 0.0, 1.0) < fault.probability


def is_active(fault: Fault, seed: int, t: int, period_ns: int) -> bool:
    """Whether a fault is active at t; with `apart`, not directly after another faulty slot."""
    slot = fault_slot(fault, seed, t, period_ns)
    if not _is_slot_faulty(fault, seed, slot):
        return False
    return not fault.apart or not _is_slot_faulty(fault, seed, slot - 1)


def _end_of_hold(fault: Fault, seed: int, t: int, period_ns: int) -> int:
    """Gives the time until which the fault holds a component up at t; t if it does not."""
    slot = fault_slot(fault, seed, t, period_ns)
    if not is_active(fault, seed, t, period_ns):
        return t
    begin = slot * fault.slot_ns - _slot_offset(fault, seed)
    end = begin + 1 + draw_bits(seed, f"{fault.stream}.by", slot) % fault.slot_ns
    return max(t, end)


def _lateness_ns(fault: Fault, seed: int, stream: str, release: int) -> int:
    """Gives how many ns late a release is: uniform in one of the intervals between quantiles."""
    times = [int(x) for x in fault.amount]
    stretches = len(times) - 1
    place = draw_bits(seed, stream, release) % (stretches << FINE)
    k, within = place >> FINE, place & ((1 << FINE) - 1)
    return times[k] + (((times[k + 1] - times[k]) * within) >> FINE)


def actual_release_ns(
    system: System, faults: Sequence[Fault], c: Component, seed: int, release: int
) -> int | None:
    """Gives the time at which a release really happens; None if the release is lost."""
    nominal = c.phase_ns + release * c.period_ns
    t = nominal
    for f in faults if release % ON_TIME != ON_TIME - 1 else ():
        if f.kind == "skip":
            if is_active(f, seed, nominal, c.period_ns):
                return None
        elif f.on is not None:
            t = max(t, _awaited_release_ns(system, f.on, seed, nominal) or t)
        elif f.slot_ns:
            t = _end_of_hold(f, seed, t, c.period_ns)
        else:
            t += _lateness_ns(f, seed, f"{f.stream}.by", release)
    return t if t == nominal or t < nominal + c.period_ns else None


def _awaited_release_ns(system: System, on: int, seed: int, nominal: int) -> int | None:
    """Gives the time of the last release of component `on` due by `nominal`, or None."""
    other = system.components[on]
    since = nominal - other.phase_ns
    if since < 0:
        return None
    faults = [f for f in system.faults if f.component == on and f.changes_releases]
    return actual_release_ns(system, faults, other, seed, since // other.period_ns)


def is_released(system: System, faults: Sequence[Fault], c: Component, seed: int, ct: int) -> bool:
    """Whether a release of the component happens at ct."""
    release = (ct - c.phase_ns) // c.period_ns
    return ct >= c.phase_ns and actual_release_ns(system, faults, c, seed, release) == ct


def next_release(system: System, faults: Sequence[Fault], c: Component, seed: int, ct: int) -> int:
    """Gives the first release that happens after ct."""
    release = max((ct - c.phase_ns) // c.period_ns, 0)
    while True:
        t = actual_release_ns(system, faults, c, seed, release)
        if t is not None and t > ct:
            return t
        release += 1


def overrun_ns(faults: Sequence[Fault], c: Component, seed: int, ct: int) -> int:
    """Gives how many ns longer a step that begins at ct lasts, because of `overrun` faults."""
    active = [f for f in faults if f.kind == "overrun" and is_active(f, seed, ct, c.period_ns)]
    return sum(int(f.amount[0]) for f in active)


def begin_times(fault: Fault, c: Component, seed: int, until_ns: int) -> list[int]:
    """Gives the times up to `until_ns` at which a fault began; [] if `late` hits all releases."""
    if fault.on is not None or (fault.kind == "late" and fault.slot_ns == 0):
        return []
    step = max(fault.slot_ns, c.period_ns)
    first = -_slot_offset(fault, seed) if fault.slot_ns > c.period_ns else c.phase_ns
    times = range(first, until_ns + 1, step)
    return [max(t, 0) for t in times if is_active(fault, seed, max(t, 0), c.period_ns)]


# ---------------------------------------------------------------- what


def with_faults(
    system: System,
    faults: Sequence[Fault],
    c: Component,
    seed: int,
    before: Configuration,
    out: dict[int, Value],
) -> dict[int, Value]:
    """Gives the topic values that a step publishes under these faults, in the state `before`."""
    value_by_topic, ct, now = dict(out), before.ct, before.Topics
    for f in faults:
        if f.topic not in value_by_topic or f.topic is None:
            continue
        if not is_active(f, seed, ct, c.period_ns):
            continue
        if f.kind == "silent" and c.plant is not None and ct == c.phase_ns:
            continue  # a sensor speaks at its first release
        if f.kind == "silent":
            del value_by_topic[f.topic]
            continue
        topic = system.topics[f.topic]
        paths = [positions(topic.type, path) for path, _ in leaves(topic.type)]
        slot = fault_slot(f, seed, ct, c.period_ns)
        for i in f.leaves:
            if f.kind == "stuck":
                new = _value_at(now[f.topic], paths[i])
            else:
                new = _faulty_leaf(
                    f,
                    seed,
                    (slot, ct, i),
                    _value_at(value_by_topic[f.topic], paths[i]),
                    topic.bounds[i],
                )
            bound = topic.bounds[i]
            if c.plant is not None and bound is not None and isinstance(new, float):
                new = maximum(bound.low, minimum(bound.high, new))
            value_by_topic[f.topic] = with_part(value_by_topic[f.topic], paths[i], new)
    return value_by_topic


def _faulty_leaf(
    f: Fault, seed: int, at: tuple[int, int, int], old: Value, bound: Bound | None
) -> Value:
    """Gives the faulty value of a leaf; `at` holds the slot, ct and the number of the leaf."""
    if f.kind == "nan":
        return with_stored_nan(math.nan)
    slot, ct, leaf = at
    index = (ct if f.kind == "noise" else slot) * LEAVES + leaf % LEAVES
    if f.kind == "saturated":
        assert bound is not None
        end = bound.high if draw_bits(seed, f"{f.stream}.by", index) >> 63 else bound.low
        return end if isinstance(old, float) else int(end)
    (x,) = f.amount
    if f.kind == "scale":
        return old * x
    return old + draw_float(seed, f"{f.stream}.by", index, -abs(x), abs(x))


def disturbance_factor(faults: Sequence[Fault], c: Component, d: int, seed: int, ct: int) -> float:
    """Gives the factor that scales disturbance number `d` of a plant at ct."""
    scale = 1.0
    for f in faults:
        if f.disturbance == d and is_active(f, seed, ct, c.period_ns):
            scale *= f.amount[0]
    return scale


def _value_at(value: Value, path: Sequence[int]) -> Value:
    for i in path:
        value = value[i]
    return value


def random_next_index(seed: int, ct: int, waiting: int) -> int:
    """Gives the index of the node that steps next, drawn among `waiting` nodes at ct."""
    return draw_bits(seed, "fault.order", ct * ORDERS + waiting % ORDERS) % waiting
