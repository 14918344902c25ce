"""Explains a claim that was not proved by a run of the model, in a few CPU seconds at most.

Purpose: where K is empty, `explain_open_claims` finds the run under SC that leaves C soonest. Where
the way back (P2b) is not shown, it finds the run that ends furthest outside `safer`. It says so if
no such run was seen. It explains a refuted claim, too, as a refuting run does not show the cause.
Non-goals: verdicts: these are runs of the model, and none of them refutes; what would help
(`variations.py`), which is measured by proving again; an SC that is merely too weak.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.types import show_ns
from soter.verify.claims.results import REFUTED, UNDECIDED, Cause
from soter.verify.diagnosis.changed_runs import (
    OLD,
    changes_that_bring_back,
    changes_that_keep_c,
    constant_command,
)
from soter.verify.diagnosis.habits_of_sc import (
    HOLDS,
    MOVED,
    STILL,
    Habit,
    comes_to_rest,
    habit_of_moving_on,
    habit_of_sc,
)
from soter.verify.diagnosis.model_runs import (
    FALSE,
    NS,
    TRUE,
    LeavingSearch,
    PointModel,
    StepFaultError,
    pattern_text,
    patterns_to_try,
    point_text,
    run_of_sc,
    soonest_leaving_run,
    without_rounding,
)
from soter.verify.diagnosis.unbounded_terms import term_without_bound
from soter.verify.diagnosis.variations import why_no_rest
from soter.verify.grid.claims import GridProof
from soter.verify.grid.grid_refinement import cells_around_interval
from soter.verify.grid.group_model import NO_ENCLOSURE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.core.layout import Bools, Floats
    from soter.verify.claims.results import Finding, ModuleResult
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern
    from soter.verify.grid.case import Case, Failure

    GoOn = Callable[[], bool]


OPEN = (UNDECIDED, REFUTED)
"""The verdicts that are explained; a refuting run does not say why SC keeps nothing."""
EMPTY, HABIT = "K is empty", "habit"
RUNS_S, BACK_S, HABIT_S, CHANGED_S = 2.5, 1.5, 2.0, 10.0
"""CPU seconds for runs that leave C, for runs that do not come back, for SC's habit, and for runs
with one thing changed."""
FROM_START = 0.7
"""The share of the time for runs from the declared start; others get half of the rest each."""
WALK_HOLDS = 2000
"""The number of periods for which a run is followed to see where it ends."""
DECLARED = "the declared start"
GIVEN_ALL_THE_SAME = (
    "`{}` says that AC need not get control back (P2b), not that it never does: the DM gives it "
    "wherever `safer` holds, so that has to be safe"
)
SMALLER = "smaller errors, delays or disturbances"
WIDER_GRID = "a wider grid; "
REST = "`rest`, for an SC that stops, which `soter verify` looks for without `--budget 0`"
ANSWERS = "an SC that answers what it reads"
UNMOVED = ": it publishes {}, whatever it reads"
NOT_ONE = (
    "another law in SC: with one sign or strength of this one changed, or one disturbance or error "
    "narrower, a run still leaves C (tried in runs of the model)"
)
LATE = 20
"""A command that answers a state of more periods of SC before hardly keeps anything."""
MOVED_ACROSS = (
    "{0} and {1} in one `grid` line: {1} moves {0}, and may be anything there while it has another"
)
HINTS_ON_RETURN = {
    "comes_back": "smaller cells where SC ends; smaller errors or delays",
    "no_target": "smaller errors; smaller cells; fewer levels, or a larger `safer`",
}
"""Advice on P2b, by the cause, where no run shows a fault of SC."""
NOT_FINITE = "over the whole grid {} has no finite range, by {}"
FINITE = (
    "`max(that, LEAST)` where it never is below a LEAST above 0 (or `min`, if it is negative), or "
    "shorter axes"
)
TURNS = "; {axis} is an angle whose axis does not wrap around, as {who} reads how far it has turned"


def explain_open_claims(done: Sequence[Case], result: ModuleResult, go_on: GoOn) -> None:
    """Adds to the findings why K is empty, or why SC does not give control back."""
    p2a, p2b, safer = (result.findings[claim] for claim in ("P2a", "P2b", "safer"))
    empty = next((c for c in done if c.failures_of("P2a")), None)
    if p2a.verdict in OPEN and empty is not None:
        _explain_empty(done, empty, p2a, go_on)
    elif p2b.verdict in OPEN:
        for case in done:
            stuck = next((f for f in case.failures_of("P2b") if _has_no_way_back(f)), None)
            if stuck is not None:
                cause = _WayBackSearch(case, stuck).cause_of_failure(go_on)
                p2b.causes.append(cause)
                p2b.hint = cause.hint or HINTS_ON_RETURN.get(cause.kind, p2b.hint)
                break
    clause = result.problem.module.symbol.stay_clause
    if safer.verdict in OPEN and empty is None and clause:
        safer.causes.append(Cause("asked_all_the_same", GIVEN_ALL_THE_SAME.format(clause)))


def _go_on_for(seconds: float, go_on: GoOn) -> GoOn:
    """A function that is true for this many CPU seconds, as long as `go_on` is true."""
    until = time.process_time() + seconds
    return lambda: go_on() and time.process_time() < until


def _explain_empty(done: Sequence[Case], case: Case, finding: Finding, go_on: GoOn) -> None:
    failure = case.failures_of("P2a")[0]
    if failure.text == NO_ENCLOSURE and (term := term_without_bound(case.problem)):
        finding.causes.append(Cause("no_enclosure", NOT_FINITE.format(*term)))
        finding.hint = FINITE
    if EMPTY not in failure.text:
        return
    model, proof = PointModel(case), failure.proof
    if isinstance(proof, GridProof) and not proof.found.allowed.any():
        why, cause = "there is no C", _cause_without_c(model)
    else:
        search = _search_run_of_model(case, model, _go_on_for(RUNS_S, go_on))
        finding.leaving = search.soonest
        if search.soonest is not None:
            why, cause = _leaving_cause(search, case)
        else:
            stop = _where_sc_stops(model, _go_on_for(HABIT_S, go_on))
            why = "but no run of the model was seen to leave C"
            cause, finding.hint = _no_run_cause(search, case, stop, finding.tried)
        by_safe = search.soonest is None or search.soonest.safe
        found = habit_of_sc(model, model.start, _go_on_for(HABIT_S, go_on)) if by_safe else None
        if found is not None:
            cause = Cause(HABIT, found.text, "", cause.numbers)
            finding.hint = found.hint
        changed = _advice_of_changed_runs(model, search, found, go_on)
        if changed == NOT_ONE and found is None:
            cause, finding.hint = _cause_if_no_change_helps(model, search, cause, go_on)
        elif changed != NOT_ONE:
            finding.hint = changed or finding.hint
    if model.inputs.delay_ns > LATE * model.inputs.period_ns and "(tried" not in finding.hint:
        finding.hint = OLD.format(show_ns(model.inputs.delay_ns))
    for axis in (a for a, who in case.problem.turns_read.items() if not who):
        finding.hint = f"`{axis} in [-PI, PI]`: of exactly a turn, this axis wraps around"
    for state, other in list(_states_moved_across_groups(model, case))[:1]:
        finding.hint = MOVED_ACROSS.format(model.state_names[state], model.state_names[other])
    failing = sum(bool(c.failures_of("P2a")) for c in done)
    if len(done) > 1:
        pairs = zip(case.problem.parameters, case.parameter, strict=True)
        at = ", ".join(f"{p.name} = {v}" for p, v in pairs)
        cause = Cause(cause.kind, f"with {at} (of {len(done)} values {failing} fail) {cause.text}")
    finding.causes.append(cause)
    if finding.verdict == UNDECIDED:  # else the text about the refuting run stays
        finding.text = f"{EMPTY}: {why}"


def _advice_of_changed_runs(
    model: PointModel, search: LeavingSearch, found: Habit | None, go_on: GoOn
) -> str:
    """Describes the changes with which runs stay in C; `NOT_ONE` if no change helps.

    The result is "" if time ran out, or if SC has a habit that shows no leaving run.
    """
    if found is not None and found.trace is None:
        return ""
    wider = "" if search.soonest is None or search.soonest.safe else WIDER_GRID
    all_asked = search.trace is not None
    for trace in (search.trace, search.undisturbed if found is None else found.trace):
        in_time = _go_on_for(CHANGED_S, go_on)
        if trace and (kept := changes_that_keep_c(model, trace, search.furthest, in_time)):
            return wider + kept
        all_asked &= in_time()
    return NOT_ONE if all_asked and not wider else ""


def _cause_if_no_change_helps(
    model: PointModel, search: LeavingSearch, cause: Cause, go_on: GoOn
) -> tuple[Cause, str]:
    """The cause and the advice if no single change of SC or the world keeps runs in C."""
    hint, moving = NOT_ONE, habit_of_moving_on(model, model.start, _go_on_for(HABIT_S, go_on))
    if moving is not None:
        cause, hint = Cause(cause.kind, f"{cause.text}; {moving.text}"), moving.hint
    if search.trace and (sent := constant_command(model, search.trace)) is not None:
        hint = ANSWERS if moving is None else hint
        hint += UNMOVED.format(_commands_in_words(model, sent))
    return cause, hint


def _commands_in_words(model: PointModel, sent: Floats) -> str:
    """Describes the commands of SC, (controls,), in words."""
    names = (c.name for c in model.problem.quantities.controls)
    return ", ".join(f"`{n}` = {v:.4g}" for n, v in zip(names, sent, strict=True))


def _states_moved_across_groups(model: PointModel, case: Case) -> Iterator[tuple[int, int]]:
    """Yields pairs of a state and a state of another group of axes that moves it."""
    group = {a.state: k for k, proof in enumerate(case.proofs) for a in proof.group.axes}
    x, inputs = model.start, (case.problem.controls, case.problem.disturbances)
    still = [np.zeros(len(r)) for r in inputs]
    for other in group if len(case.proofs) > 1 else ():
        y = x.copy()
        y[other] += MOVED * (model.high[other] - model.low[other])
        with suppress(StepFaultError):
            moved = np.flatnonzero(model.rate(y, *still) != model.rate(x, *still))
            yield from ((int(s), other) for s in moved if group.get(int(s), -1) != group[other])


def _cause_without_c(model: PointModel) -> Cause:
    """The cause that no cell of the grid lies in C."""
    start, held = model.start, model.safe(model.start)
    text = "`safe` holds on no whole cell of the grid"
    if (start == np.clip(start, model.low, model.high)).all() and held in (FALSE, TRUE):
        text += f"; at the declared start it is {'true' if held == TRUE else 'false'}"
    return Cause("constraint", text)


def _leaving_cause(search: LeavingSearch, case: Case) -> tuple[str, Cause]:
    run_ = search.soonest
    assert run_ is not None
    if run_.safe:
        why = text = "under SC a run of the model leaves `safe`"
    else:
        why = "under SC a run of the model leaves the grid where `safe` still holds"
        text = f"{why}, at {run_.axis} = {run_.states[-1][run_.names.index(run_.axis)]:.6g}: what "
        text += "lies beyond counts as unsafe"
        if who := case.problem.turns_read.get(run_.axis):
            text += TURNS.format(axis=run_.axis, who=who)
    if (alone := search.undisturbed) is not None:
        text += f"; without any disturbance, error or delay after {alone.times[-1]:.4g} s"
    return why, Cause("leaves", text, "", (("left_s", float(run_.time_s[-1])),))


def _where_sc_stops(model: PointModel, go_on: GoOn) -> Floats | None:
    """The states, (states,), at which an undisturbed run comes to rest; None if it does not."""
    until_s = 3 * HOLDS * model.inputs.period_ns * NS
    trace = run_of_sc(model, model.start, next(patterns_to_try(model)), until_s, go_on, beyond=True)
    return trace.states[-1] if go_on() and comes_to_rest(model, trace) else None


def _ends_where_sc_stops(case: Case, stop: Floats | None) -> Iterator[str]:
    """Each axis in whose outermost cell SC stops, with the value; `stop`: where SC stops."""
    if stop is None:
        return
    for a in (a for proof in case.proofs for a in proof.group.axes):
        at = float(stop[a.state])
        below, above = at < a.edges[1], at > a.edges[-2] and not a.open
        if (below or above) and not (a.unbounded or a.wraps):
            yield f"{a.name} = {without_rounding(at):.4g}"


def _no_run_cause(
    search: LeavingSearch, case: Case, stop: Floats | None, tried: Sequence[str]
) -> tuple[Cause, str]:
    """The cause and advice if no run leaves C, so that too large cells, not SC, lose K.

    `stop`: the states at which SC comes to rest, (states,); None if it does not.
    """
    text = f"of {search.runs} runs of the model, up to {search.longest_s:.4g} s, none leaves C"
    text += " (cut off)" * search.cut + ": perhaps SC keeps C, and the sets do not show it"
    advice = [] if any("cells of" in t for t in tried) else ["smaller cells"]
    if ends := ", ".join(_ends_where_sc_stops(case, stop)):
        text += f"; undisturbed, SC stops at {ends}, in the last cell of the axis: what is pushed "
        text += "beyond counts as lost"
        advice.insert(0, f"a wider grid: an axis that goes on beyond {ends}, where SC stops")
    reads = {"derivative": frozenset[int](), **case.forms.library.reads}
    unread = set(reads.get("safe", ())).difference(reads.get("law", ()), reads["derivative"])
    ways = [n.name for k, n in enumerate(case.problem.quantities.states) if k in unread]
    if stop is not None and ways:
        text += f"; SC stops, and brings {', '.join(ways)} to no place: chains of cells go on there"
    if stop is not None and ways:
        if why_not := why_no_rest(case.problem):
            text += f"; `rest`, which is for an SC that stops, cannot follow it: {why_not}"
        advice.insert(0, "rates and an SC that `rest` can follow" if why_not else REST)
    numbers = ("runs", float(search.runs)), ("longest_s", search.longest_s)
    return Cause("no_run", text, "", numbers), "; ".join((*advice, SMALLER))


def _search_run_of_model(case: Case, model: PointModel, go_on: GoOn) -> LeavingSearch:
    """Searches for the run that leaves C soonest, from the declared start, then from others."""
    last = LeavingSearch()
    for start, whose in _start_points(case, model):
        if model.is_beyond_ends(start).any() or not model.safe(start) & TRUE:
            continue
        part = FROM_START if whose == DECLARED else (1.0 - FROM_START) / 2
        search = soonest_leaving_run(model, start, whose, _go_on_for(part * RUNS_S, go_on))
        search.runs += last.runs
        search.longest_s = max(search.longest_s, last.longest_s)
        search.cut |= last.cut
        last = search
        if search.soonest is not None or not go_on():
            break
    return last


def _start_points(case: Case, model: PointModel) -> Iterator[tuple[Floats, str]]:
    """Yields starts to try, with texts: the declared one, C's middle, half way to each end."""
    yield model.start, DECLARED
    middle = model.start
    for proof in case.proofs:
        for state, value in proof.deepest_state.items():
            middle[state] = value
    middle = np.clip(middle, model.low, model.high)
    yield middle, "the middle of C"
    for axis in range(len(middle)):
        for end in (model.high, model.low):
            x = middle.copy()
            x[axis] = (middle[axis] + end[axis]) / 2
            yield x, "inside C"


def _has_no_way_back(failure: Failure) -> bool:
    """Whether a failure is about cells without a way back, or about an empty target set Q."""
    if not isinstance(failure.proof, GridProof):
        return False
    home = failure.proof.found.home
    return failure.stuck or (home is not None and not home.any())


@dataclass(frozen=True, eq=False)
class _RunEnd:
    """A run with the ranges of its states in the last quarter, and the share outside `safer`."""

    trace: ModelTrace
    pattern: Pattern
    outside: float
    low: Floats
    high: Floats


class _WayBackSearch:
    """Finds to where SC brings the plant, and whether the DM gives control back there."""

    def __init__(self, case: Case, failure: Failure) -> None:
        self.case, self.failure, self.model = case, failure, PointModel(case)
        assert isinstance(failure.proof, GridProof)
        self.grid = failure.proof

    def cause_of_failure(self, go_on: GoOn) -> Cause:
        """The cause of the failure: a run that ends outside `safer`, or the lack of such a run."""
        target = self.grid.found.target
        if target is not None and not target.any():
            text = "there is no cell all of whose estimates satisfy `safer`"
            return Cause("no_target", text)
        start, whose = self._start_point()
        head = f"from {whose} ({point_text(self.model, start)}) SC's run of the model"
        worst: _RunEnd | None = None
        followed: list[Pattern] = []
        in_time = _go_on_for(BACK_S, go_on)
        for pattern in patterns_to_try(self.model):
            end = self._run_end(self.model, start, pattern, in_time)
            if end is None:
                break
            followed.append(pattern)
            if end.trace.left:
                if not pattern.is_disturbed:
                    text = f"{head} leaves C after {end.trace.times[-1]:.4g} s"
                    return Cause("leaves", text)
            elif end.outside and (worst is None or end.outside > worst.outside):
                worst = end
                if not pattern.is_disturbed:
                    break
        if worst is not None:
            kind = "pushed_out" if worst.pattern.is_disturbed else "stays_away"
            returns = partial(self._run_returns, start, _go_on_for(CHANGED_S, go_on))
            hint = changes_that_bring_back(self.model, worst.pattern, followed, returns)
            return Cause(kind, f"{head} {self._end_in_words(worst)}", hint)
        text = (
            f"of {len(followed)} runs of the model from {whose} none stays outside `safer`: no set "
        )
        return Cause("comes_back", text + "was shown that all runs stay in")

    def _start_point(self) -> tuple[Floats, str]:
        """The start of runs: a cell without a way back, the declared start, or a cell of K."""
        if self.failure.stuck and self.failure.cells is not None:
            return self._middle_of_cell(self.failure.cells), "one of them"
        if self._lies_in_all_cells_around(self.grid.found.core > 0, self.model.start):
            return self.model.start, DECLARED
        return self._middle_of_cell(self.grid.found.core > 0), "inside K"

    def _middle_of_cell(self, of: Bools) -> Floats:
        """The middle of the cell of a set (in the grid's shape) nearest to the grid's middle."""
        x, cells, middle = self.model.start, np.argwhere(of), np.array(of.shape) / 2
        at = cells[int(np.argmin((np.abs(cells - middle) / middle).max(axis=1)))]
        for state, edges, i in zip(self.grid.engine.axes, self.grid.engine.edges, at, strict=True):
            x[state] = (edges[i] + edges[i + 1]) / 2
        return x

    def _lies_in_all_cells_around(self, cells: Bools, x: Floats) -> bool:
        """Whether all cells that hold a state, (states,), are in a set of the grid's shape."""
        pairs = zip(self.grid.engine.axes, self.grid.engine.edges, strict=True)
        at = [
            cells_around_interval(edges, float(x[state]), float(x[state])) for state, edges in pairs
        ]
        inside = tuple(b for b in at if b is not None)
        return len(inside) == len(at) and bool(cells[inside].all())

    def _gives_back(self, x: Floats, *, exact: bool) -> bool:
        """Whether the DM gives control back at a state, for the exact or for every estimate."""
        if self.case.problem.computed:
            target = self.grid.found.target
            return target is not None and self._lies_in_all_cells_around(target, x)
        if exact:
            return self.model.safer(x)
        box = self.case.forms.whole.copy()
        box[self.model.states] = np.stack([x, x], axis=1)
        return self.case.forms.truth(self.case.problem.return_predicate, box) == TRUE

    def _run_returns(self, start: Floats, go_on: GoOn, model: PointModel, pattern: Pattern) -> bool:
        """Whether a run from `start` (states,) ends where the DM gives control back."""
        end = self._run_end(model, start, pattern, go_on)
        return end is not None and go_on() and not end.trace.left and not end.outside

    def _run_end(
        self, model: PointModel, start: Floats, pattern: Pattern, go_on: GoOn
    ) -> _RunEnd | None:
        holds = WALK_HOLDS * self.model.inputs.period_ns / 1e9
        trace = run_of_sc(model, start, pattern, holds, go_on)
        if pattern.is_disturbed and not go_on():
            return None
        pairs = zip(trace.times, trace.states, strict=True)
        late = [x for t, x in pairs if t >= 0.75 * trace.times[-1]]
        wrong = sum(not self._gives_back(x, exact=not pattern.is_disturbed) for x in late)
        ends = np.min(late, axis=0), np.max(late, axis=0)
        return _RunEnd(trace, pattern, wrong / len(late), *ends)

    def _end_in_words(self, end: _RunEnd) -> str:
        model, low, high = self.model, end.low, end.high
        still = (high - low <= STILL * np.maximum(model.high - model.low, 1e-300)).all()
        every = zip(model.state_names, low, high, strict=True)
        between = ", ".join(
            f"{n} = {without_rounding(a):.4g} and {without_rounding(b):.4g}" for n, a, b in every
        )
        at = f"stays between {between}" if not still else ""
        at = at or f"comes to rest at {point_text(model, end.trace.states[-1])}"
        chosen = ", ".join(pattern_text(model, end.pattern))
        against = f"with {chosen} " if chosen else ""
        text = f"{against}{at} after {end.trace.times[-1]:.4g} s: `safer` does not hold there"
        return text + " of every estimate" * end.pattern.is_disturbed
