"""`soter test` without a terminal: from a flattened test to its result.

Purpose: `explore_test` searches, gives the verdict (`search_verdict`), minimises a violation, and
lets the reference interpreter replay it before anybody is told of it; `save_traces` writes it into
a file. `find_violating_run` looks for a run that violates a property whose proof failed.
Non-goals: the search itself (`engine/`), what is asked of it (`api/exploring.py`), what bounds
mean (`results.py`), printing (`cli/test.py`).
"""

from __future__ import annotations

import re
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from soter.diagnostics.diagnostic import SoterError
from soter.explore import assumptions, vacuous_tests
from soter.explore.judge import test_plan
from soter.explore.replay import find_violation_id, replay, with_chosen_values
from soter.explore.results import (
    BOUND,
    BOUNDS,
    CHOICES,
    DRAWN,
    EXHAUSTED,
    GRID,
    INTERRUPTED,
    LENGTH,
    MEMORY,
    NOT_ASKED,
    PART,
    PATIENCE,
    PICKED,
    RUNS,
    SAMPLED,
    STATES,
    TIME,
    UNDRIVEN,
    UNJUDGED,
    VIOLATED,
    WIDTH,
    TestResult,
    bound_text,
    why_not_shortest,
)
from soter.explore.search_options import SAMPLING, STEPS_MAX, SearchOptions
from soter.explore.trace import VIOLATION_KINDS, Trace, write_trace

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.explore.engine.coverage import Coverage
    from soter.explore.engine.search import Found, Search
    from soter.explore.replay import Replayed
    from soter.explore.search_options import SearchProgress
    from soter.explore.trace import Step
    from soter.explore.vacuous_tests import VacuousPart
    from soter.language.model.system import System

    Progress = Callable[[SearchProgress], None]


ENDS = {
    "memory": MEMORY,
    "states": STATES,
    "runs": RUNS,
    "stopped": INTERRUPTED,
    "no_memory": MEMORY,
    "choices": CHOICES,
    "width": WIDTH,
    "length": LENGTH,
}
"""The bound that each end of a search means."""


def vacuous_parts_of_search(
    system: System,
    search: Search,
    coverage: Coverage,
    search_result: Found,
    replaced: Sequence[tuple[str, str]],
) -> tuple[VacuousPart, ...]:
    """The parts of a test that say nothing; to find some of them, the search must have ended."""
    ended = search_result.status == "exhausted" and search.options.strategy not in SAMPLING
    never = coverage.modes.unreached
    return vacuous_tests.find_vacuous_parts(
        system, search.judged_and_tested_properties(), never, replaced, ended=ended
    )


def coverage_bound(system: System, search: Search, coverage: Coverage) -> str | None:
    """The bound that keeps an exhausted search from covering all executions; None if none does."""
    if not coverage.properties.reached:
        return UNJUDGED
    if assumptions.undriven_inputs(system):
        return UNDRIVEN
    if assumptions.partly_driven_inputs(system):
        return PICKED
    if assumptions.drawn_disturbances(system):
        return DRAWN
    if search.times is not None and (search.times.open or search.times.crowded):
        return GRID
    return SAMPLED if search.sampled else None


def search_verdict(
    search_result: Found, options: SearchOptions, short_of: str | None
) -> tuple[str, str | None]:
    """The verdict, and the bound reached or None; `short_of`: the bound of an exhausted search."""
    if search_result.status == "violated":
        return VIOLATED, None
    if search_result.status == "exhausted":
        if options.strategy in SAMPLING:
            return BOUND, RUNS
        return (EXHAUSTED, None) if short_of is None else (BOUND, short_of)
    return BOUND, TIME if search_result.stopped == TIME else ENDS[search_result.status]


def covered_before_ns(search_result: Found, system: System, options: SearchOptions) -> int | None:
    """The time before which every execution was judged; None if the search only samples."""
    if options.strategy in SAMPLING:
        return None
    return min(search_result.covered_ns, test_plan(system).horizon_ns)


TRACE_FILE_ENDING = ".trace.json"
INTERRUPTED_STEPS_MAX = 500
"""A trace of up to this many steps is replayed even after an interruption."""


class Interruptions(Protocol):
    """Receives signals; `wanted`: the search should end; `running`: while set, no signal raises."""

    wanted: bool
    running: bool


class UnreproducedError(RuntimeError):
    """The explorer found a violation that the interpreter does not see: a defect of soter.

    `trace`: the trace that was found, for those who repair the defect.
    """

    def __init__(self, replay_result: Replayed) -> None:
        trace = replay_result.trace
        super().__init__(
            f"test {trace.test}: the reference interpreter does not reproduce the violation of "
            f"`{trace.broken.text}`: {replay_result.outcome}"
        )
        self.trace = trace


@dataclass(frozen=True)
class TraceHeader:
    """The facts on the program that a trace has besides its steps; `params` are JSON values."""

    program: str
    params: Mapping[str, object]
    replaced: tuple[tuple[str, str], ...] = ()


def explore_test(
    system: System,
    options: SearchOptions,
    header: TraceHeader,
    progress: Progress | None = None,
    listener: Interruptions | None = None,
) -> TestResult:
    """Explores a flattened test; shrinks a violation, and the interpreter replays it.

    Raises UnreproducedError if the replay does not show the violation. After an interruption the
    result has the coverage until then.
    """
    from soter.explore.engine.search import Search as Engine  # noqa: PLC0415 - needs a compiler

    def should_stop() -> bool:
        return listener is not None and listener.wanted

    with Engine(system, options, progress, should_stop) as search:
        with _without_signals(listener):
            search_result = search.run()
            result = _result_of_search(system, search, search_result, header.replaced)
        if result.verdict == VIOLATED:
            try:
                _add_replayed_trace(result, search, search_result, header)
                shown = result.replayed is not None and not result.interrupted
                if shown and options.all_properties:
                    _find_other_violations(result, search, search_result, header)
            except KeyboardInterrupt:
                _note_interruption(result)
    return result


def _result_of_search(
    system: System, search: Search, search_result: Found, replaced: Sequence[tuple[str, str]]
) -> TestResult:
    """The verdict and the coverage of a search, as a result without a trace."""
    options, coverage = search.options, search.coverage()
    vacuous = vacuous_parts_of_search(system, search, coverage, search_result, replaced)
    short_of = coverage_bound(system, search, coverage)
    verdict, bound = search_verdict(search_result, options, short_of)
    return TestResult(
        name=test_plan(system).name,
        system=system,
        options=options,
        verdict=verdict,
        bound=bound,
        states=search_result.states,
        transitions=search_result.transitions,
        runs=search_result.runs,
        seconds=search_result.seconds,
        depth=search_result.depth,
        bits=search.bits,
        parts=search.parts,
        contracts=assumptions.tests_by_contract(system),
        stands_for=tuple([r for r in replaced if r[0] not in search.unheard_actors]),
        table_bytes=search_result.table_bytes,
        frontier_bytes=search_result.frontier_bytes,
        total_bytes=search_result.total_bytes,
        covered_ns=covered_before_ns(search_result, system, options),
        closed_ns=search_result.closed_ns or None,
        short_of=short_of if short_of not in (bound, UNJUDGED) else None,
        threads=search_result.threads,
        why=_bound_reason(bound, search, search_result),
        quantum_ns=None if search.times is None else search.times.quantum_ns,
        coverage=coverage,
        vacuous=vacuous,
        assumptions=(
            *(v.text for v in vacuous),
            *assumptions.test_assumptions(system, options, search_result, replaced, search.times),
        ),
    )


@contextmanager
def _without_signals(listener: Interruptions | None) -> Iterator[None]:
    """Makes a `with` block in which signals do not raise KeyboardInterrupt."""
    if listener is None:
        yield
        return
    listener.running = True
    try:
        yield
    finally:
        listener.running = False


def _note_interruption(result: TestResult) -> None:
    """Notes in the result that the user interrupted the work on a violation already found."""
    if result.replayed is None:
        result.unshown = INTERRUPTED
    else:
        result.others_bound = INTERRUPTED


def _find_other_violations(
    result: TestResult, search: Search, search_result: Found, header: TraceHeader
) -> None:
    """Searches for violations of other properties, and searches again after each violation."""
    assert search_result.broken is not None
    known, others = [search_result.broken], []
    while True:
        search_result = search.run(tuple(known))
        short_of = coverage_bound(result.system, search, search.coverage())
        verdict, bound = search_verdict(search_result, result.options, short_of)
        if verdict != VIOLATED:
            result.others_bound = bound
            break
        assert search_result.broken is not None
        assert search_result.broken not in known, search_result.broken
        known.append(search_result.broken)
        other = replace(
            result,
            minimal=False,
            least_bound=None,
            minimise_s=0.0,
            shrunk_from=0,
            unshown=None,
            states=search_result.states,
            transitions=search_result.transitions,
            runs=search_result.runs,
            seconds=search_result.seconds,
            depth=search_result.depth,
            replayed=None,
        )
        _add_replayed_trace(other, search, search_result, header)
        others.append(other)
        if other.interrupted or other.replayed is None:
            result.others_bound = other.unshown or other.least_bound
            break
    result.others = tuple(others)
    result.coverage = search.coverage()


def _bound_reason(bound: str | None, search: Search, search_result: Found) -> str:
    """Why the search stopped at its bound, in words; "" without a bound."""
    if bound is None:
        return ""
    if search_result.status == "no_memory" and search_result.needed_bytes:
        return f"{BOUNDS[MEMORY]}: the first tables alone take {search_result.needed_bytes:,} bytes"
    return bound_text(bound, search.options, search.chooser_text(search_result), search.words)


def _add_replayed_trace(
    result: TestResult, search: Search, search_result: Found, header: TraceHeader
) -> None:
    """Shortens and replays a violation's trace; `result` gets the replay, or why it has none."""
    assert search_result.broken is not None
    kind, index = search_result.broken
    result.broken = find_violation_id(result.system, VIOLATION_KINDS[kind], index)
    assert result.broken is not None, search_result.broken
    steps = _minimised_steps(result, search, search_result)
    interrupted = INTERRUPTED in (search_result.stopped, result.least_bound)
    if not steps or (interrupted and len(steps) > INTERRUPTED_STEPS_MAX):
        result.unshown = _why_unshown(search_result, interrupted=interrupted)
        return
    trace = make_trace(result, header, steps)
    replayed = replay(trace, result.system)
    if not replayed.reproduced:
        raise UnreproducedError(replayed)
    result.replayed = with_chosen_values(replayed)


def _why_unshown(search_result: Found, *, interrupted: bool) -> str:
    """The reason, as a key of `UNSHOWN`, why no execution shows the violation."""
    if interrupted:
        return INTERRUPTED
    if search_result.stopped == TIME:
        return TIME
    if search_result.apart:
        return PART
    return LENGTH if search_result.depth >= STEPS_MAX else MEMORY


def _minimised_steps(result: TestResult, search: Search, search_result: Found) -> tuple[Step, ...]:
    """The steps of the shortest trace found; notes in `result` whether it is surely the shortest.

    A sampled trace is long, so it is shrunk before the shortest trace is searched. Any other trace
    is shrunk only if that search does not end. Each gets half of the time, and any unused rest.
    """
    if search_result.stopped == INTERRUPTED:
        result.least_bound = INTERRUPTED
        return search_result.steps
    until = time.perf_counter() + result.options.minimise
    half = result.options.minimise / 2
    if half == 0:
        result.least_bound = NOT_ASKED
        return search_result.steps
    smaller = search_result
    shrinks_first = result.options.strategy in SAMPLING
    if shrinks_first:
        smaller = _shrink(result, search, search_result, half)
    if result.least_bound is None:
        patience_s = until - time.perf_counter() if shrinks_first else half
        least = _find_shortest_trace(result, search, search_result, patience_s)
        if result.minimal:
            result.shrunk_from = 0
            return least
    if not shrinks_first and result.least_bound != INTERRUPTED:
        smaller = _shrink(result, search, search_result, until - time.perf_counter())
    return smaller.steps


def _find_shortest_trace(
    result: TestResult, search: Search, search_result: Found, patience_s: float
) -> tuple[Step, ...]:
    """The shortest trace to the violation; () if it was not found, and `result` then says why."""
    least = search.find_shortest_trace(search_result, patience_s)
    result.minimise_s += least.seconds
    result.minimal = least.status == "violated" and bool(least.steps)
    if not result.minimal:
        patience = least.stopped == TIME
        result.least_bound = PATIENCE if patience else ENDS.get(least.status, LENGTH)
        return ()
    return least.steps


def _shrink(result: TestResult, search: Search, search_result: Found, patience_s: float) -> Found:
    """The search result with a smaller trace; unchanged if shrinking found no smaller trace."""
    shrunk = search.shrink(search_result, patience_s) if search_result.steps else None
    if shrunk is None:
        return search_result
    result.minimise_s += shrunk.seconds
    if shrunk.stopped == "interrupted":
        result.least_bound = INTERRUPTED
    before = len(search_result.steps)
    result.shrunk_from = before if len(shrunk.steps) < before else 0
    return shrunk


def make_trace(result: TestResult, header: TraceHeader, steps: Sequence[Step]) -> Trace:
    """The `Trace` of a violated test, from these steps, the program's hash and the settings."""
    assert result.broken is not None
    plan, program, options = test_plan(result.system), result.system.program, result.options
    return Trace(
        program=header.program,
        sha256=program.sha256,
        system=result.system.name,
        test=plan.name,
        params=header.params,
        seed=result.options.seed,
        skew_ns=plan.skew_ns,
        horizon_ns=plan.horizon_ns,
        broken=result.broken,
        steps=tuple(steps),
        minimal=result.minimal,
        not_shortest=(
            "" if result.least_bound is None else why_not_shortest(result.least_bound, options)
        ),
        assumptions=result.assumptions,
        shrunk_from=result.shrunk_from,
    )


# ---------------------------------------------------------------- files


def save_traces(result: TestResult, folder: Path) -> Path | None:
    """Writes the trace of a violated test, and returns its path; None without a trace.

    Other properties' traces go beside it, with `-2` and so on in the name. Raises SoterError D006.
    """
    if result.replayed is None:
        return None
    stem = file_stem(result.replayed.trace)
    result.trace = write_trace(result.replayed.trace, folder / f"{stem}{TRACE_FILE_ENDING}")
    for number, other in enumerate(result.others, 2):
        if other.replayed is not None:
            path = folder / f"{stem}-{number}{TRACE_FILE_ENDING}"
            other.trace = write_trace(other.replayed.trace, path)
    return result.trace


def file_stem(trace: Trace) -> str:
    """The file name of a trace, without ending: `<program>-<test>`."""
    name = f"{Path(trace.program).stem}-{trace.test}"
    return re.sub(r"[^A-Za-z0-9_.=+-]", "_", name)


SEARCH_S = 30.0
SHORTEN_S = 5.0
MEMORY_BYTES = 2**29


@dataclass(frozen=True)
class ViolatingRun:
    """A run with a violation: its kind (`property`, `fault`, ...), text, time and step lines."""

    what: str
    text: str
    time_ns: int
    lines: tuple[str, ...]


def find_violating_run(system: System) -> ViolatingRun | None:
    """Searches a flat test for a run that violates a property; None if it found no such run."""
    options = SearchOptions(time=SEARCH_S, minimise=SHORTEN_S, memory=MEMORY_BYTES)
    try:
        result = explore_test(system, options, TraceHeader(system.program.path, {}))
    except (SoterError, UnreproducedError):
        return None
    if result.verdict != VIOLATED or result.replayed is None or not result.replayed.reproduced:
        return None
    assert result.broken is not None
    lines = []
    steps = result.replayed.trace.steps
    for step in steps:
        chosen = ", ".join(str(c.value) for c in step.choices if c.value is not None)
        choices = f" chooses {chosen}" if chosen else ""
        lines.append(f"{step.time_ns / 1e6:g} ms  {step.actor or 'start'}{choices}")
    time_ns = steps[-1].time_ns
    lines.append(f"{time_ns / 1e6:g} ms  violated: {result.broken.text}")
    return ViolatingRun(result.broken.what, result.broken.text, time_ns, tuple(lines))
