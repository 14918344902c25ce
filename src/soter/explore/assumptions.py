"""The assumptions of the verdict on a test: its conditions, and what it leaves open, in words.

Purpose: `test_assumptions` writes sentences that are part of every result: values of parameters,
forced modules, what inputs take and when, which inputs take fewer values than their sets have, and
(`contract_notes`) contracts in the place of modules and nodes, with the tests that check these.
Non-goals: what a proof rests on (`verify/problem/problem.py`); verdicts of the tests that check a
contract: each is a test of its own.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.explore.judge import test_plan
from soter.explore.search_options import LEAVES_MAX
from soter.explore.trace_view import value_text
from soter.explore.vacuous_tests import symbol_at_path
from soter.language.check.declarations import scalar_text
from soter.language.check.dots_and_brackets import quoted
from soter.language.elaborate.derived_systems import OUTSIDE
from soter.language.elaborate.passes.stated_values import settings_in
from soter.language.model import typed
from soter.language.model.typed import Literal
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaves, show_ns
from soter.language.model.values import to_json

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.explore.engine.search import Found
    from soter.explore.model.exploration_plan import TimeChoices
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import (
        Bound,
        InputDrive,
        StandIn,
        System,
        TestPlan,
        TimingFault,
        Topic,
    )
    from soter.language.model.types import Type


NO_HARM = "that others of what its contract permits do no harm is assumed"


def replacements_in_test(test: typed.TestSymbol) -> tuple[tuple[str, str], ...]:
    """Pairs of the path of an instance that a test replaces, and the name of its replacement.

    Instances that are replaced by their contract are left out (`contract_notes`).
    """
    pairs = [*_replacements_in_system(test.system), *((p, by) for p, by, _ in test.replaces)]
    replacements = {path: by.name for path, by in pairs if not isinstance(by, typed.ByContract)}
    return tuple(replacements.items())


def _replacements_in_system(
    system: typed.SystemSymbol, prefix: str = ""
) -> Iterator[tuple[str, typed.NodeSymbol | typed.PlantSymbol | typed.ByContract]]:
    """Yields the replacements in inner systems, then those of this system, which override them."""
    for name, instance in system.by_name.items():
        if isinstance(instance.what, typed.SystemSymbol):
            yield from _replacements_in_system(instance.what, f"{prefix}{name}.")
    yield from ((prefix + path, by) for path, by, _ in system.replaces)


def contract_notes(system: System) -> Iterator[str]:
    """Yields a sentence for each module and node that its contract replaces."""
    stand_ins: dict[str, list[StandIn]] = {}
    for c in system.components:
        if c.stands_for is not None:
            stand_ins.setdefault(c.stands_for.of, []).append(c.stands_for)
    for instance, group in stand_ins.items():
        yield from _stand_in_notes(system, instance, group)


def _stand_in_notes(system: System, instance: str, group: list[StandIn]) -> Iterator[str]:
    clauses = _join_distinct(t for s in group for t in s.clauses)
    clauses = clauses or "no clause, any value of the sets of its topics"
    omitted = _join_distinct(t for s in group for t in s.left)
    more = f"; not asked for, so that more is permitted: {omitted}" if omitted else ""
    tested = _contract_test_note(system, instance)
    yield f"{instance} is replaced by its contract ({clauses}{more}): {tested}"
    tests = [name for name, how in _tests_with_instance(system, instance) if not how]
    others_note = f"that it publishes no other is asked by {quoted(tests)}" if tests else NO_HARM
    for text in dict.fromkeys(t for s in group for t in s.tried):
        yield f"what stands for {instance} was tried with {text} alone: {others_note}"


def _join_distinct(texts: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(texts))


def _contract_test_note(system: System, instance: str) -> str:
    tests_by_condition: dict[str, list[str]] = {}
    for name, how in _tests_with_instance(system, instance):
        tests_by_condition.setdefault(how, []).append(name)
    if "" in tests_by_condition:
        return (
            f"whether it keeps it is asked by {quoted(tests_by_condition[''])}, "
            "where it runs as it is, as far "
            "as horizon, inputs, skew, faults, order and replacements there go"
        )
    differing = ", ".join(f"{quoted(names)} {how}" for how, names in tests_by_condition.items())
    differing = f" ({differing})" if differing else ""
    return f"no test of this program runs it as it is{differing}: that it keeps it is assumed"


def tests_by_contract(system: System) -> dict[str, list[str]]:
    """For each instance that a contract replaces, the tests that run the instance itself."""
    names = {c.stands_for.of for c in system.components if c.stands_for is not None}
    return {
        path: [n for n, how in _tests_with_instance(system, path) if not how]
        for path in sorted(names)
    }


def _tests_with_instance(system: System, instance: str) -> Iterator[tuple[str, str]]:
    """Yields each test that runs the instance itself, and how that test differs from this test."""
    tests = system.program.tests
    here = tests.get(test_plan(system).name)
    for name, test in tests.items():
        how = None if here is None else _difference_in_words(test, here, instance)
        if how is not None:
            yield name, how


def _difference_in_words(
    test: typed.TestSymbol, here: typed.TestSymbol, instance: str
) -> str | None:
    """How a test that runs `instance` itself differs from the test `here`; "" if in nothing else.

    None if `test` does not have the instance, or replaces it as well.
    """
    original = symbol_at_path(test, instance)
    replaced = (
        None
        if original is None or original is not symbol_at_path(here, instance)
        else _replaced_paths(test, original, instance)
    )
    if test is here or replaced is None or instance in replaced:
        return None
    if test.system is not here.system:
        return "in another system"
    if settings_in(test) != settings_in(here):
        return "with other parameters"
    return "but for a controller" if replaced else ""


def _replaced_paths(
    test: typed.TestSymbol, replaced: typed.ModuleSymbol | typed.NodeSymbol, instance: str
) -> set[str]:
    """The paths that a test replaces in a module or node; the path `instance` means all of it."""
    inside = replaced.controllers if isinstance(replaced, typed.ModuleSymbol) else ()
    paths: set[str] = set()
    for path, _, _ in test.replaces:
        if path in {instance, replaced.name} or instance.startswith(f"{path}."):
            paths.add(instance)
        elif any(path in {n.name, n.name.rpartition(".")[2]} for n in inside) or path.startswith(
            f"{instance}."
        ):
            paths.add(path)
    return paths


NAMED_MAX = 12
"""The most parameters with declared values that are named; those that were set are all named."""


def setting_notes(system: System) -> Iterator[str]:
    """Yields a sentence on the parameters, then on each forced module and each driven input."""
    yield from _parameter_note(system)
    for module in system.modules:
        if module.forced is not None:
            mode = module.forced.upper()
            yield f"{module.name} is forced to {mode}: nothing is said of it where its DM decides"
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        every = f"every {show_ns(drive.every_ns)} and keeps it until then"
        if drive.values:
            values = ", ".join(value_text(to_json(topic.type, v)) for v in drive.values)
            picked = f"picked of {topic_set_text(topic)}"
            of_set = "which is its whole set" if covers_whole_set(topic, drive) else picked
            taken = f"one of {values}, {of_set},"
        else:
            taken = f"any value of {topic_set_text(topic)}"
        yield f"{topic.name} takes {taken} {every}: no other value and no other time was tried"


def partly_driven_inputs(system: System) -> list[str]:
    """The names of the inputs to which the test gives only some values of their sets."""
    drives = [(system.topics[d.topic], d) for d in system.inputs if d.values]
    return [topic.name for topic, drive in drives if not covers_whole_set(topic, drive)]


def covers_whole_set(topic: Topic, drive: InputDrive) -> bool:
    """Whether an input takes every value of its topic's set."""
    counts = [
        _value_count(t, b) for (_, t), b in zip(leaves(topic.type), topic.bounds, strict=True)
    ]
    if any("[]" in path for path, _ in leaves(topic.type)):
        return False
    return len(set(drive.values)) >= math.prod(counts)


def topic_set_text(topic: Topic) -> str:
    """The set of a topic in words: the interval if the topic is one number, else "its set"."""
    bound = topic.bounds[0] if len(topic.bounds) == 1 else None
    if bound is None:
        return "its set"
    low, high = bound.low, bound.high
    if isinstance(topic.type, IntType):
        low, high = int(low), int(high)
    return f"[{low:,}, {high:,}]" if isinstance(low, int) else f"[{low:g}, {high:g}]"


def _value_count(t: Type, bound: Bound | None) -> float:
    """The number of values of a leaf; infinity for a float, unless its interval is a point."""
    if isinstance(t, BoolType):
        return 2
    if isinstance(t, EnumType):
        return len(t.members)
    low, high = (-math.inf, math.inf) if bound is None else (bound.low, bound.high)
    if isinstance(t, IntType):
        return max(high, t.low) - low + 1 if bound is not None else t.high - t.low + 1
    assert isinstance(t, FloatType), t
    return 1 if low == high else math.inf


def _parameter_note(system: System) -> Iterator[str]:
    """Yields one sentence with all parameters' values; those set to another value come first."""
    changed, values = [], []
    for name, value in system.params.items():
        param = system.program.param(name)
        if param is None:
            continue
        declared = param.default.value if isinstance(param.default, Literal) else value
        text = f"{name} = {scalar_text(value, param.type)}"
        if value == declared:
            values.append(text)
        else:
            changed.append(f"{text} (by itself {scalar_text(declared, param.type)})")
    if changed or values:
        left_out = f" and {len(values) - NAMED_MAX} more" if len(values) > NAMED_MAX else ""
        named = ", ".join(changed + values[:NAMED_MAX])
        yield f"said of these values of parameters: {named}{left_out}"


FINGERPRINT_BITS = 64
PLACES_MAX = 3
"""The most places of the program that are named."""


def undriven_inputs(system: System) -> list[str]:
    """The names of topics from outside to which the test gives no value."""
    drawn = {d.topic for d in system.inputs}
    return [
        t.name
        for t in system.topics
        if t.driver == OUTSIDE and t.queue_of is None and t.index not in drawn
    ]


def test_assumptions(
    system: System,
    options: SearchOptions,
    search_result: Found,
    replaced: Sequence[tuple[str, str]],
    times: TimeChoices | None,
) -> Iterator[str]:
    """Yields every assumption of a test; `replaced`: pairs of a component and what replaces it.

    `times`: the grid on which steps chose their times; None if no step could choose.
    """
    plan = test_plan(system)
    yield _horizon_note(show_ns(plan.horizon_ns), search_result)
    yield _step_order_note(plan, times)
    yield from setting_notes(system)
    for name in undriven_inputs(system):
        yield f"{name} keeps its default: the test has no `input {name} every ...;`"
    yield from (f"{system.components[f.component].name} {_fault_words(f)}" for f in plan.faults)
    for name, by in replaced:
        yield f"{name} is replaced by {by}: said of whatever does only what {by} may do"
    yield from contract_notes(system)
    lasts = any(f.least_ns for f in plan.faults)
    but = "unless it overruns" + (" or takes time" if lasts else "")
    yield f"steps are atomic: a step reads, computes and publishes at one time, {but}"
    yield "the compiled steps are those that `soter build` deploys: the same C, the same arithmetic"
    yield from _time_grid_notes(times)
    if not search_result.closed_ns and any(p.kind in ("eventually", "leadsto") for p in plan.timed):
        yield "deadlines beyond the horizon are not judged"
    if not system.properties and not plan.timed:
        yield "the test states no property: only step faults of trusted components were looked for"
    yield from _coverage_limit_note(system)
    yield from _sampled_floats_note(system)
    if drawn := drawn_disturbances(system):
        yield f"drawn by chance once, with seed {options.seed}: {', '.join(drawn)}"
    if options.storage == "fingerprint":
        yield _collision_note(search_result.states)


def _horizon_note(horizon: str, search_result: Found) -> str:
    if search_result.closed_ns:
        return (
            f"said of all times, not only up to the horizon, {horizon}: every configuration after "
            f"{show_ns(search_result.closed_ns)} is one that came before, "
            "at the same place of the calendar"
        )
    hope = search_result.closable and search_result.status == "exhausted"
    more = "; a longer one may show that it holds for ever" if hope else ""
    return f"nothing is said about times after the horizon, {horizon}{more}"


def _fault_words(fault: TimingFault) -> str:
    """Words for the effect of a timing fault on the steps of its component."""
    if fault.kind == "skip":
        return f"loses at most {fault.at_most} release{_plural_ending(fault.at_most)} in a row"
    if fault.least_ns:
        span = " to ".join(dict.fromkeys([show_ns(fault.least_ns), show_ns(fault.by_ns)]))
        return f"takes {span} a step, and loses its releases meanwhile, as it says"
    return f"{'is late' if fault.kind == 'late' else 'overruns'} by at most {show_ns(fault.by_ns)}"


def _step_order_note(plan: TestPlan, times: TimeChoices | None) -> str:
    if plan.ordered:
        return (
            "steps happen at their release, within an instant in the deployed order, inputs first, "
            "as the test declares: other orders were not tried"
        )
    late = any(f.kind == "late" for f in plan.faults)
    but = ", but for those that are told below," if late else ""
    if plan.skew_ns == 0:
        order = (
            f"steps happen at their release{but or ','} in every order within an instant (skew 0)"
        )
    else:
        order = f"every step happens within {show_ns(plan.skew_ns)} of its release{but.rstrip(',')}"
    if times is None:
        return order
    return (
        f"{order}; a step that may be late happens as early as it can or at a multiple of "
        f"{show_ns(times.quantum_ns)}: no other times were tried"
    )


def _time_grid_notes(times: TimeChoices | None) -> Iterator[str]:
    """Yields notes on code whose use of the time is not covered by the grid of times."""
    if times is None:
        return
    for spans, reason in (
        (times.open, "the time is calculated with"),
        (times.crowded, "more times are compared than the grid is fine enough for,"),
    ):
        places = list(dict.fromkeys(f"{s.source.name.rsplit('/', 1)[-1]}:{s.line}" for s in spans))
        if places:
            more = f" and {len(places) - PLACES_MAX} more places" if places[PLACES_MAX:] else ""
            yield (
                f"{reason} in {', '.join(places[:PLACES_MAX])}{more}: times between "
                "those of the grid may do otherwise (`quantum ...;` takes a grid for granted)"
            )


def _coverage_limit_note(system: System) -> Iterator[str]:
    """Yields a note if topics have more scalars than coverage counts."""
    topics = [t for t in system.topics if t.queue_of is None]
    scalars = sum("[]" not in path for t in topics for path, _ in leaves(t.type))
    if scalars > LEAVES_MAX:
        yield f"what was reached counts the first {LEAVES_MAX:,} scalars of topics, of {scalars:,}"


def _plural_ending(count: int) -> str:
    return "" if count == 1 else "s"


def _sampled_floats_note(system: System) -> Iterator[str]:
    """Yields a note on the floats for which the search tried only three values."""
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


def drawn_disturbances(system: System) -> list[str]:
    """The names of the disturbances that are drawn from the seed once, for all executions."""
    return [
        f"{c.name}.{d.variable.name}"
        for c in system.components
        for d in c.disturbances
        if d.hold_ns and d.low < d.high
    ]


def _collision_note(states: int) -> str:
    """A note on the chance that two of n configurations share a 64-bit fingerprint: n^2 / 2^65."""
    chance = min(states * states / 2.0 ** (FINGERPRINT_BITS + 1), 1.0)
    return (
        f"fingerprints of 64 bits: a configuration was missed with probability about {chance:.1g}"
    )
