"""What the verdict on a test rests on, under which conditions it was explored, what it leaves open.

Purpose: plain sentences, which are part of every result: values of parameters, forced modules, what
inputs take and when, which inputs take fewer values than their sets have.
Non-goals: what a proof rests on (`verify/problem/problem.py`), which contracts stand in
(`contract_use.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.explore import contract_use
from soter.explore.allowed_steps import plan_of
from soter.explore.search_options import LEAVES_MAX
from soter.explore.trace_view import shown
from soter.language.check.declarations import show
from soter.language.elaborate.derived_systems import OUTSIDE
from soter.language.model.typed import Literal
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaves, show_ns
from soter.language.model.values import to_json

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.explore.engine.search import Found
    from soter.explore.model.exploration_plan import TimeChoices
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import Bound, InputDrive, System, TestPlan, TimingFault, Topic
    from soter.language.model.types import Type


NAMED = 12
"""So many parameters that are as declared are named; those that are not are, however many."""


def told(system: System) -> Iterator[str]:
    """A sentence for all parameters, one for each forced module and each driven input."""
    yield from _parameters(system)
    for m in system.modules:
        if m.forced is not None:
            mode = m.forced.upper()
            yield f"{m.name} is forced to {mode}: nothing is said of it where its DM decides"
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        every = f"every {show_ns(drive.every_ns)} and keeps it until then"
        if drive.values:
            values = [shown(to_json(topic.type, v)) for v in drive.values]
            which = f"one of {', '.join(values)}"
            which += ", which is its whole set," if has_all(topic, drive) else ""
            which += "" if has_all(topic, drive) else f", picked of {set_of(topic)},"
        else:
            which = f"any value of {set_of(topic)}"
        yield f"{topic.name} takes {which} {every}: no other value and no other time was tried"


def picked(system: System) -> list[str]:
    """Inputs that take some values of a set that has more."""
    drives = [(system.topics[d.topic], d) for d in system.inputs if d.values]
    return [topic.name for topic, drive in drives if not has_all(topic, drive)]


def has_all(topic: Topic, drive: InputDrive) -> bool:
    """Whether the values of a drive are all that the set of its topic has."""
    counts = [_count(t, b) for (_, t), b in zip(leaves(topic.type), topic.bounds, strict=True)]
    if any("[]" in path for path, _ in leaves(topic.type)):
        return False
    return len(set(drive.values)) >= math.prod(counts)


def set_of(topic: Topic) -> str:
    """The set of a topic as people write it."""
    bound = topic.bounds[0] if len(topic.bounds) == 1 else None
    if bound is None:
        return "its set"
    low, high = bound.low, bound.high
    if isinstance(topic.type, IntType):
        low, high = int(low), int(high)
    return f"[{low:,}, {high:,}]" if isinstance(low, int) else f"[{low:g}, {high:g}]"


def _count(t: Type, bound: Bound | None) -> float:
    """How many values a leaf may have; of a float with more than one, no end of them."""
    if isinstance(t, BoolType):
        return 2
    if isinstance(t, EnumType):
        return len(t.members)
    low, high = (-math.inf, math.inf) if bound is None else (bound.low, bound.high)
    if isinstance(t, IntType):
        return max(high, t.low) - low + 1 if bound is not None else t.high - t.low + 1
    assert isinstance(t, FloatType), t
    return 1 if low == high else math.inf


def _parameters(system: System) -> Iterator[str]:
    """Their values; of one that is set, its own as well: those come first, all of them."""
    changed, values = [], []
    for name, value in system.params.items():
        param = system.program.param(name)
        if param is None:
            continue
        own = param.default.value if isinstance(param.default, Literal) else value
        at = f"{name} = {show(value, param.type)}"
        if value == own:
            values.append(at)
        else:
            changed.append(f"{at} (by itself {show(own, param.type)})")
    if changed or values:
        more = f" and {len(values) - NAMED} more" if len(values) > NAMED else ""
        yield f"said of these values of parameters: {', '.join(changed + values[:NAMED])}{more}"


FINGERPRINT_BITS = 64
PLACES = 3
"""So many places of the program are named."""


def of_test(
    system: System,
    options: SearchOptions,
    search_result: Found,
    replaced: Sequence[tuple[str, str]],
    times: TimeChoices | None,
) -> tuple[str, ...]:
    """Everything; `replaced`: components and what stands in their place.

    `times`: the grid of them; None where no step could choose.
    """
    return tuple(_all(system, options, search_result, replaced, times))


def undriven(system: System) -> list[str]:
    """Inputs that somebody reads and nobody draws."""
    drawn = {d.topic for d in system.inputs}
    return [
        t.name
        for t in system.topics
        if t.driver == OUTSIDE and t.queue_of is None and t.index not in drawn
    ]


def _all(
    system: System,
    options: SearchOptions,
    search_result: Found,
    replaced: Sequence[tuple[str, str]],
    times: TimeChoices | None,
) -> Iterator[str]:
    plan = plan_of(system)
    yield _how_long(show_ns(plan.horizon_ns), search_result)
    yield _orders(plan, times)
    yield from told(system)
    for name in undriven(system):
        yield f"{name} keeps its default: the test has no `input {name} every ...;`"
    yield from (f"{system.components[f.component].name} {_does(f)}" for f in plan.faults)
    for name, by in replaced:
        yield f"{name} is replaced by {by}: said of whatever does only what {by} may do"
    yield from contract_use.told(system)
    lasts = any(f.least_ns for f in plan.faults)
    but = "unless it overruns" + (" or takes time" if lasts else "")
    yield f"steps are atomic: a step reads, computes and publishes at one time, {but}"
    yield "the compiled steps are those that `soter build` deploys: the same C, the same arithmetic"
    yield from _calculated(times)
    if not search_result.closed_ns and any(p.kind in ("eventually", "leadsto") for p in plan.timed):
        yield "deadlines beyond the horizon are not judged"
    if not system.properties and not plan.timed:
        yield "the test states no property: only step faults of trusted components were looked for"
    yield from _uncounted(system)
    yield from _sampled(system)
    yield from _held(system, options.seed)
    if options.storage == "fingerprint":
        yield _missed(search_result.states)


def _how_long(horizon: str, search_result: Found) -> str:
    if search_result.closed_ns:
        return (
            f"said of all times, not only up to the horizon, {horizon}: every configuration after "
            f"{show_ns(search_result.closed_ns)} is one that came before, "
            "at the same place of the calendar"
        )
    hope = search_result.closable and search_result.status == "exhausted"
    more = "; a longer one may show that it holds for ever" if hope else ""
    return f"nothing is said about times after the horizon, {horizon}{more}"


def _does(f: TimingFault) -> str:
    """What goes wrong with the steps of a component."""
    if f.kind == "skip":
        return f"loses at most {f.at_most} release{_s(f.at_most)} in a row"
    if f.least_ns:
        span = " to ".join(dict.fromkeys([show_ns(f.least_ns), show_ns(f.by_ns)]))
        return f"takes {span} a step, and loses its releases meanwhile, as it says"
    return f"{'is late' if f.kind == 'late' else 'overruns'} by at most {show_ns(f.by_ns)}"


def _orders(plan: TestPlan, times: TimeChoices | None) -> str:
    if plan.ordered:
        return (
            "steps happen at their release, within an instant in the deployed order, inputs first, "
            "as the test declares: other orders were not tried"
        )
    late = any(f.kind == "late" for f in plan.faults)
    but = ", but for those that are told below," if late else ""
    if plan.skew_ns == 0:
        said = (
            f"steps happen at their release{but or ','} in every order within an instant (skew 0)"
        )
    else:
        said = f"every step happens within {show_ns(plan.skew_ns)} of its release{but.rstrip(',')}"
    if times is None:
        return said
    return (
        f"{said}; a step that may be late happens as early as it can or at a multiple of "
        f"{show_ns(times.quantum_ns)}: no other times were tried"
    )


def _calculated(times: TimeChoices | None) -> Iterator[str]:
    """Where the program calculates with times, passes them on, or compares too many of them."""
    if times is None:
        return
    for spans, what in (
        (times.open, "the time is calculated with"),
        (times.crowded, "more times are compared than the grid is fine enough for,"),
    ):
        places = list(dict.fromkeys(f"{s.source.name.rsplit('/', 1)[-1]}:{s.line}" for s in spans))
        if places:
            more = f" and {len(places) - PLACES} more places" if len(places) > PLACES else ""
            yield (
                f"{what} in {', '.join(places[:PLACES])}{more}: times between "
                "those of the grid may do otherwise (`quantum ...;` takes a grid for granted)"
            )


def _uncounted(system: System) -> Iterator[str]:
    """Scalars of topics that coverage has no room for."""
    told = [t for t in system.topics if t.queue_of is None]
    scalars = sum("[]" not in path for t in told for path, _ in leaves(t.type))
    if scalars > LEAVES_MAX:
        yield f"what was reached counts the first {LEAVES_MAX:,} scalars of topics, of {scalars:,}"


def _s(count: int) -> str:
    return "" if count == 1 else "s"


def _sampled(system: System) -> Iterator[str]:
    """Continua of which three values were taken."""
    names = [
        f"{c.name}.{d.variable.name}"
        for c in system.components
        for d in c.disturbances
        if d.low < d.high and not d.hold_ns
    ]
    names += [f"{c.name} (measurement)" for c in system.components if c.measured]
    names += [
        f"{c.name} (start)"
        for c in system.components
        if any(r is not None for r in c.initial_range)
    ]
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        if not drive.values and any(isinstance(t, FloatType) for _, t in leaves(topic.type)):
            names.append(topic.name)
    if names:
        yield f"of these floats only the middle, the least, the largest value: {', '.join(names)}"


def held(system: System) -> list[str]:
    """Disturbances that are drawn by chance from the seed, for all executions the same."""
    return [
        f"{c.name}.{d.variable.name}"
        for c in system.components
        for d in c.disturbances
        if d.hold_ns and d.low < d.high
    ]


def _held(system: System, seed: int) -> Iterator[str]:
    names = held(system)
    if names:
        yield f"drawn by chance once, with seed {seed}: {', '.join(names)}"


def _missed(states: int) -> str:
    """The chance that two of n configurations share a fingerprint of 64 bits: n^2 / 2^65."""
    chance = min(states * states / 2.0 ** (FINGERPRINT_BITS + 1), 1.0)
    return (
        f"fingerprints of 64 bits: a configuration was missed with probability about {chance:.1g}"
    )
