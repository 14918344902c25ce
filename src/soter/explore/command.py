"""`soter test` and `soter replay` without a terminal: from a flattened test to its result.

Purpose: search, minimise, and let the reference interpreter replay what was found before anybody
is told of a violation; traces to files and back.
Non-goals: the search itself (`explore/engine/c/soter_explore*.c`, `search.py`), printing.
"""

from __future__ import annotations

import re
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.explore import assumptions, contract_use
from soter.explore.allowed_steps import plan_of
from soter.explore.replay import replay, violation_id_of
from soter.explore.results import (
    BOUNDS,
    INTERRUPTED,
    LENGTH,
    MEMORY,
    NOT_ASKED,
    PART,
    PATIENCE,
    TIME,
    UNJUDGED,
    VIOLATED,
    CheckpointState,
    TestResult,
    bound_text,
    why_not_shortest,
)
from soter.explore.search_options import SAMPLING, STEPS_MAX
from soter.explore.trace import TIME_MAX, VIOLATION_KINDS, Trace, write_trace
from soter.explore.verdict import ENDS, covered_before, short_of_test, vacuous_parts, verdict_of
from soter.language.elaborate.derived_systems import with_test
from soter.language.elaborate.tested_system import MAX_STEPS
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.explore.checkpoints import Checkpoint
    from soter.explore.engine.search import Found, Search
    from soter.explore.replay import Replayed
    from soter.explore.search_options import SearchOptions, SearchProgress
    from soter.explore.trace import Step
    from soter.language.model.system import System
    from soter.language.model.typed import TestSymbol

    Progress = Callable[[SearchProgress], None]

FOLDER = Path(".soter")
ENDING = ".trace.json"
LONG = 500
"""Steps that are replayed even where somebody waits for an answer."""


class Interruptions(Protocol):
    """Who listens to signals: `wanted`, the end; while `running` no exception says so."""

    wanted: bool
    running: bool


class UnreproducedError(RuntimeError):
    """The explorer believes in a violation that the interpreter does not see: soter's defect.

    `trace`: what was believed, for whoever repairs it.
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
    """What a trace says of the program beside its steps; `params` as JSON."""

    program: str
    params: Mapping[str, object]
    replaced: tuple[tuple[str, str], ...] = ()


# ---------------------------------------------------------------- which tests


def chosen(
    tests: Mapping[str, TestSymbol], path: str, names: str | Sequence[str] | None
) -> list[TestSymbol]:
    """The tests that are meant, in the program's order; `SoterError` U010 where there is none."""
    wanted = [names] if isinstance(names, str) else names
    unknown = [n for n in wanted or () if n not in tests]
    if tests and not unknown:
        return [t for n, t in tests.items() if wanted is None or n in wanted]
    if not unknown:
        help_ = "write one: `test Name { system S; horizon 1s; always ...; }`"
        problem = Diagnostic("U010", f"`{path}` has no `test`", helps=(help_,))
    else:
        there = ", ".join(f"`{n}`" for n in tests) or "none"
        message = f"there is no test `{unknown[0]}`"
        problem = Diagnostic("U010", message, notes=(f"there are: {there}",))
    raise SoterError((problem,))


def with_times(system: System, skew_ns: int | None, horizon_ns: int | None) -> System:
    """The same test with another skew or horizon; `SoterError` U001 where that cannot be."""
    plan = plan_of(system)
    for what, given, least in (("skew", skew_ns, 0), ("horizon", horizon_ns, 1)):
        if given is not None and not least <= given <= TIME_MAX:
            raise SoterError((Diagnostic("U001", f"the {what} cannot be {show_ns(given)}"),))
    skew = plan.skew_ns if skew_ns is None else skew_ns
    horizon = plan.horizon_ns if horizon_ns is None else horizon_ns
    _require_few_steps(system, horizon)
    for t in plan.timed:
        reach = t.within_ns + (1 if t.kind == "leadsto" else 0)
        if t.kind != "invariant" and reach > horizon:
            message = f"with a horizon of {show_ns(horizon)} `{t.text}` is not judged"
            note = f"its deadline of {show_ns(t.within_ns)} has to lie before the end"
            raise SoterError((Diagnostic("E013", message, notes=(note,)),))
    if plan.ordered and skew:
        message = f"test {plan.name} declares the deployed order: no step of it may be late"
        note = f"with a skew of {show_ns(skew)} steps of one instant happen at different times"
        raise SoterError((Diagnostic("E017", message, notes=(note,)),))
    return with_test(system, replace(plan, skew_ns=skew, horizon_ns=horizon))


def _require_few_steps(system: System, horizon: int) -> None:
    calendars = [(c.phase_ns, c.period_ns) for c in system.components]
    calendars += [(0, drive.every_ns) for drive in system.inputs]
    steps = sum((horizon - phase) // period + 1 for phase, period in calendars if phase <= horizon)
    if steps > MAX_STEPS:
        message = f"a horizon of {show_ns(horizon)} can never be exhausted"
        note = f"{steps} steps lie before it, in each execution; at most {MAX_STEPS} are possible"
        raise SoterError((Diagnostic("E008", message, notes=(note,)),))


# ---------------------------------------------------------------- one test


def explore_test(
    system: System,
    options: SearchOptions,
    told: TraceHeader,
    progress: Progress | None = None,
    listener: Interruptions | None = None,
    checkpoint: Checkpoint | None = None,
) -> TestResult:
    """Explore a flattened test. A violation is minimised and replayed: `UnreproducedError`.

    Once it is compiled, who interrupts it gets what was covered. `SoterError` D006, D012, D014
    where a checkpoint cannot be written or is none.
    """
    from soter.explore.engine.search import Search as Engine  # noqa: PLC0415 - needs a compiler

    def wanted() -> bool:
        return listener is not None and listener.wanted

    with Engine(system, options, progress, wanted, checkpoint) as search:
        with _quiet(listener):
            search_result = search.run()
            coverage = search.coverage()
            says_nothing = vacuous_parts(system, search, coverage, search_result, told.replaced)
            short_of = short_of_test(system, search, coverage)
            verdict, bound = verdict_of(search_result, options, short_of)
            result = TestResult(
                name=plan_of(system).name,
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
                equal_instances=search.equal,
                contracts=contract_use.tests_by_contract(system),
                stands_for=tuple([r for r in told.replaced if r[0] not in search.unheard]),
                table_bytes=search_result.table_bytes,
                frontier_bytes=search_result.frontier_bytes,
                total_bytes=search_result.total_bytes,
                covered_ns=covered_before(search_result, system, options),
                closed_ns=search_result.closed_ns or None,
                checkpoint=_kept(checkpoint),
                short_of=short_of if short_of not in (bound, UNJUDGED) else None,
                threads=search_result.threads,
                why=_why(bound, search, search_result),
                quantum_ns=None if search.times is None else search.times.quantum_ns,
                coverage=coverage,
                robustness=search.robustness(),
                vacuous=says_nothing,
                assumptions=(
                    *(v.text for v in says_nothing),
                    *assumptions.of_test(
                        system, options, search_result, told.replaced, search.times
                    ),
                ),
            )
        if verdict == VIOLATED:
            try:
                _explain(result, search, search_result, told)
                shown = result.replayed is not None and not result.interrupted
                if shown and options.all_properties:
                    _go_on(result, search, search_result, told)
            except KeyboardInterrupt:
                _interrupted(result)
    return result


@contextmanager
def _quiet(listener: Interruptions | None) -> Iterator[None]:
    """Inside, nothing is raised by signals."""
    if listener is None:
        yield
        return
    listener.running = True
    try:
        yield
    finally:
        listener.running = False


def _interrupted(result: TestResult) -> None:
    """Somebody stopped what comes after a violation was found: what was had until then counts."""
    if result.replayed is None:
        result.unshown = INTERRUPTED
    else:
        result.others_bound = INTERRUPTED


def _go_on(result: TestResult, search: Search, search_result: Found, told: TraceHeader) -> None:
    """Look for other properties that can be violated, one search for each."""
    assert search_result.broken is not None
    known, others = [search_result.broken], []
    while True:
        search_result = search.run(tuple(known))
        short_of = short_of_test(result.system, search, search.coverage())
        verdict, bound = verdict_of(search_result, result.options, short_of)
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
        _explain(other, search, search_result, told)
        others.append(other)
        if other.interrupted or other.replayed is None:
            result.others_bound = other.unshown or other.least_bound
            break
    result.others = tuple(others)
    result.coverage, result.robustness = search.coverage(), search.robustness()


def _kept(c: Checkpoint | None) -> CheckpointState | None:
    return None if c is None else CheckpointState(c.path, c.states, c.problem, c.resumed)


def _why(bound: str | None, search: Search, search_result: Found) -> str:
    """The bound for people."""
    if bound is None:
        return ""
    if search_result.status == "no_memory" and search_result.needed_bytes:
        return f"{BOUNDS[MEMORY]}: the first tables alone take {search_result.needed_bytes:,} bytes"
    return bound_text(bound, search.options, search.chooser(search_result), search.words)


def _explain(result: TestResult, search: Search, search_result: Found, told: TraceHeader) -> None:
    """The trace of a violation: the least one, replayed by the interpreter."""
    assert search_result.broken is not None
    what, index = search_result.broken
    result.broken = violation_id_of(result.system, VIOLATION_KINDS[what], index)
    assert result.broken is not None, search_result.broken
    steps = _smallest(result, search, search_result)
    interrupted = INTERRUPTED in (search_result.stopped, result.least_bound)
    if not steps or (interrupted and len(steps) > LONG):
        result.unshown = _why_unshown(search_result, interrupted=interrupted)
        return
    trace = trace_of(result, told, steps)
    replayed = replay(trace, result.system)
    if not replayed.reproduced:
        raise UnreproducedError(replayed)
    result.replayed = with_marks(with_values(replayed), search.matters(replayed, search_result))


def _why_unshown(search_result: Found, *, interrupted: bool) -> str:
    """Why there is no execution that shows a violation."""
    if interrupted:
        return INTERRUPTED
    if search_result.stopped == TIME:
        return TIME
    if search_result.apart:
        return PART
    return LENGTH if search_result.depth >= STEPS_MAX else MEMORY


def _smallest(result: TestResult, search: Search, search_result: Found) -> tuple[Step, ...]:
    """The least trace to the violation that was found, or the smallest that was had, and why.

    What was sampled is long: it is shrunk first. Otherwise the search for the least comes first,
    and shrinking where it does not end. Each has half of the time, and what the other has left.
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
    first = result.options.strategy in SAMPLING
    if first:
        smaller = _shrunk(result, search, search_result, half)
    if result.least_bound is None:
        least = _least(
            result, search, search_result, until - time.perf_counter() if first else half
        )
        if result.minimal:
            result.shrunk_from = 0
            return least
    if not first and result.least_bound != INTERRUPTED:
        smaller = _shrunk(result, search, search_result, until - time.perf_counter())
    return smaller.steps


def _least(
    result: TestResult, search: Search, search_result: Found, patience_s: float
) -> tuple[Step, ...]:
    """The least trace to the violation that was found; none where it was not had, and why."""
    least = search.least(search_result, patience_s)
    result.minimise_s += least.seconds
    result.minimal = least.status == "violated" and bool(least.steps)
    if not result.minimal:
        patience = least.stopped == TIME
        result.least_bound = PATIENCE if patience else ENDS.get(least.status, LENGTH)
        return ()
    return least.steps


def _shrunk(result: TestResult, search: Search, search_result: Found, patience_s: float) -> Found:
    """What was found, or something smaller."""
    made = search.shrunk(search_result, patience_s) if search_result.steps else None
    if made is None:
        return search_result
    result.minimise_s += made.seconds
    if made.stopped == "interrupted":
        result.least_bound = INTERRUPTED
    result.shrunk_from = (
        len(search_result.steps) if len(made.steps) < len(search_result.steps) else 0
    )
    return made


def trace_of(result: TestResult, told: TraceHeader, steps: Sequence[Step]) -> Trace:
    """The trace of a violated test."""
    assert result.broken is not None
    plan, program, options = plan_of(result.system), result.system.program, result.options
    return Trace(
        program=told.program,
        sha256=program.sha256,
        system=result.system.name,
        test=plan.name,
        params=told.params,
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


def with_values(replay_result: Replayed) -> Replayed:
    """The same, its trace with the values that were chosen, as the interpreter saw them."""
    steps = tuple(
        replace(step, choices=done.choices)
        for step, done in zip(replay_result.trace.steps, replay_result.steps, strict=True)
    )
    return replace(replay_result, trace=replace(replay_result.trace, steps=steps))


def with_marks(replay_result: Replayed, matters: Sequence[bool]) -> Replayed:
    """The same, its trace and its steps with whether each of them matters."""
    told = [replace(s, matters=m) for s, m in zip(replay_result.trace.steps, matters, strict=True)]
    done = [replace(s, matters=m) for s, m in zip(replay_result.steps, matters, strict=True)]
    return replace(
        replay_result, trace=replace(replay_result.trace, steps=tuple(told)), steps=tuple(done)
    )


# ---------------------------------------------------------------- files


def save(result: TestResult, folder: Path = FOLDER) -> Path | None:
    """Write the trace of a violated test; `SoterError` D006. None where there is nothing.

    Those of other properties are beside it, `-2` after the name and so on.
    """
    if result.replayed is None:
        return None
    stem = file_stem(result.replayed.trace)
    result.trace = write_trace(result.replayed.trace, folder / f"{stem}{ENDING}")
    for number, other in enumerate(result.others, 2):
        if other.replayed is not None:
            path = folder / f"{stem}-{number}{ENDING}"
            other.trace = write_trace(other.replayed.trace, path)
    return result.trace


def file_stem(trace: Trace) -> str:
    """`<program>-<test>`."""
    name = f"{Path(trace.program).stem}-{trace.test}"
    return re.sub(r"[^A-Za-z0-9_.=+-]", "_", name)


def changed_program(trace: Trace, path: str) -> SoterError:
    """D011: the program is not the one that the trace was found in."""
    problem = Diagnostic(
        "D011",
        f"the trace belongs to another version of `{path}`",
        notes=(f"it was found in the program with the hash {trace.sha256[:12]}",),
        helps=("search again: `soter test`",),
    )
    return SoterError((problem,))


def missing_program(trace: Trace, path: str) -> SoterError:
    """D001: the program of a trace is not where the trace says."""
    problem = Diagnostic(
        "D001",
        f"the program of the trace is not there: `{path}`",
        notes=("a trace looks for its program relative to its own place",),
        helps=(f"move them together: the trace says `{trace.program}`",),
    )
    return SoterError((problem,))
