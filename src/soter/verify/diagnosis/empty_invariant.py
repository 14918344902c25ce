"""Why K is empty: causes told apart, each by a measurement.

Purpose: for what stays undecided, what was measured about it: by which end of the grid runs leave
(`grid_ends.py`), whether SC only just fails, and the run that leaves soonest. `adds_up`: whether SC
brings the plant anywhere or only stops it: where two undisturbed runs that begin apart along one
state end as far apart, nothing pulls that state back. Of a linear group the same is read off its
matrices. Other claims have their margins (`failure_margins.py`); smaller cells were tried before
(`claims/choice.py`).
Non-goals: verdicts. Nothing here turns undecided into anything else. It takes a few CPU seconds at
most, and says where that was not enough. Which law would do.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.claims.results import UNDECIDED, Cause
from soter.verify.diagnosis.experiments import (
    COARSE,
    CpuBudget,
    InvariantShare,
    ProblemChange,
    against,
    kept,
)
from soter.verify.diagnosis.failure_margins import OPEN, ORDER, margins, scaled
from soter.verify.diagnosis.grid_ends import LOST, faces, lost_at_ends
from soter.verify.diagnosis.model_runs import (
    FALSE,
    TRUE,
    LeavingSearch,
    PointModel,
    patterns,
    run,
    soonest,
)
from soter.verify.grid.claims import GridProof
from soter.verify.polytope.claims import WEAK, PolytopeProof

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, Failure
    from soter.verify.claims.results import Finding, ModuleResult
    from soter.verify.problem.problem import Problem

    Floats = NDArray[np.float64]


APART = 0.1
"""Of an axis, so far apart two runs begin."""
KEPT = 0.9
"""Of that distance, so much is left at the end where nothing pulls."""
STILL = 1e-4
"""Of an axis, so little a state moves in the last quarter of a run that has come to rest."""
HOLDS = 600


SINGULAR = 1e-9
"""Relative to the closed loop's matrix: a sum of states that changes more slowly stays."""
ROUNDED = 1e-6
"""A coefficient of such a sum, the largest of which is 1, that is none."""
FILLED_S = 1e4
"""A sum that its disturbance takes longer to move over its range is none worth telling."""


def adds_up(proof: PolytopeProof, problem: Problem) -> Iterator[Cause]:
    """Sums of states that neither plant nor SC changes, and something disturbs.

    l with l (A + B K) = 0: then (l x)' = l w, whatever x is.
    """
    if proof.found.model is None:
        return
    group = proof.found.model.group
    closed = group.state + group.control @ group.gain
    disturbance = group.drift[1]
    names = [problem.quantities.states[a.state].name for a in proof.group.axes]
    for row in _still(closed):
        rate = float(np.abs(row) @ disturbance)
        if rate * FILLED_S <= float(np.abs(row) @ (group.high - group.low)):
            continue
        sum_ = _sum(row, names)
        text = f"nothing pulls {sum_} back: neither the plant nor SC changes it, and what disturbs "
        text += f"it adds up, by as much as {rate:.3g} a second"
        reached = np.abs(row @ group.control) > SINGULAR * np.abs(row) @ np.abs(group.control)
        hint = "an SC that goes by it" if reached.any() else "no command moves it: a plant that"
        if not reached.any():
            hint += " pulls it back, if the vehicle does (`der v = ... + k * (b - v) + w` where v "
            hint += "follows b), or no disturbance on it"
        yield Cause("adds_up", text, hint, (("rate", rate),))


def _still(closed: Floats) -> Floats:
    """Rows l with l closed = 0, (k, n), in echelon form: each of as few states as can be."""
    left, sizes, _ = np.linalg.svd(closed)
    rows: Floats = left.T[sizes <= SINGULAR * max(1.0, float(sizes.max(initial=0.0)))].copy()
    for i in range(len(rows)):
        k, at = np.unravel_index(int(np.argmax(np.abs(rows[i:]))), rows[i:].shape)
        rows[[i, i + k]] = rows[[i + k, i]]
        rows[i] /= rows[i, at]
        others = [j for j in range(len(rows)) if j != i]
        rows[others] -= np.outer(rows[others, at], rows[i])
    rows[np.abs(rows) < ROUNDED] = 0.0
    return rows


def _sum(row: Floats, names: list[str]) -> str:
    """The sum of states, its first coefficient 1."""
    there = [i for i in range(len(row)) if row[i] != 0.0]
    text = names[there[0]]
    for i in there[1:]:
        factor = float(row[i] / row[there[0]])
        size = "" if round(abs(factor), 6) == 1.0 else f"{abs(factor):.4g} * "
        text += f" {'-' if factor < 0 else '+'} {size}{names[i]}"
    return text if len(there) == 1 else f"`{text}`"


def no_pull(model: PointModel, middle: Floats, budget: CpuBudget) -> Iterator[Cause]:
    """States that SC lets stay wherever they are. `middle`: (states,), inside C."""
    if not model.problem.controls:
        return
    for axis, state in enumerate(model.problem.quantities.states):
        width = float(model.high[axis] - model.low[axis])
        ends = []
        for side in (-0.5, 0.5):
            x = middle.copy()
            x[axis] += side * APART * width
            end = _end(model, x, axis, budget)
            if end is None:
                break
            ends.append(end)
        if len(ends) == 2 and ends[1] - ends[0] > KEPT * APART * width:
            low, high = (float(middle[axis] + s * APART * width) for s in (-0.5, 0.5))
            text = f"SC brings {state.name} to no place: undisturbed, a run from {low:.4g} ends at "
            text += f"{ends[0]:.4g}, one from {high:.4g} at {ends[1]:.4g}; what disturbs it adds up"
            yield Cause("no_pull", text, "", (("low_ends", ends[0]), ("high_ends", ends[1])))


def _end(model: PointModel, start: Floats, axis: int, budget: CpuBudget) -> float | None:
    """Where a state ends; None where the run leaves, does not come to rest, or time is over."""
    if not model.safe(start) & TRUE or not budget.goes_on():
        return None
    trace = run(
        model, start, next(patterns(model)), HOLDS * model.inputs.period_ns / 1e9, budget.goes_on
    )
    if trace.left or not budget.goes_on():
        return None
    values = np.array(trace.states)[:, axis]
    late = values[3 * len(values) // 4 :]
    return float(values[-1]) if np.ptp(late) <= STILL * (model.high - model.low)[axis] else None


BUDGET_S = 5.0
RUNS_S = 2.5
PULL_S = 1.0
PRECISION = 32
"""Parts in which the strength of what stands against SC is told."""
DECLARED = "the declared start"
NAMES = {
    "constraint": "there is no C",
    "scaled": "`safe` holds on the whole grid, and reads what is no state",
    "wrap_around": "an axis that should wrap around",
    "drift_of_all": "the flow leaves C whatever SC does",
    "one_sided": "an end of the grid acts as a wall",
    "adds_up": "nothing pulls a disturbed state back",
    "no_pull": "SC only stops, and brings the plant to no place",
    "drift": "the flow leaves the grid under SC",
    LOST: "K is lost at an end of the grid",
    "no_run": "but no run of the model was seen to leave C",
    "strength": "too much stands against SC",
    "weak": "with nothing against SC, too",
}
"""Causes, the first of which that was found is named in the table."""
ENDS = ("one_sided", "drift", LOST)
"""Causes beside which SC keeps nothing whatever stands against it: runs leave by that end."""
OF_SC = ("strength", "weak")
"""Causes that speak of SC, measured by sets."""
HOPELESS = ("wrap_around", "drift_of_all")
"""Causes beside which strength is not looked at."""
EMPTY = "K is empty"
HELPS = 2
"""So many remedies are told, those of the first causes."""


def diagnose(done: Sequence[Case], result: ModuleResult) -> None:
    """Enter causes and margins for what is undecided, or refuted where SC keeps nothing."""
    budget = CpuBudget(BUDGET_S)
    finding = result.findings["P2a"]
    case = next((c for c in done if c.failed("P2a")), None)
    if finding.verdict in OPEN and case is not None:
        failure = case.failed("P2a")[0]
        _why_empty(case, failure, finding, budget)
        _named(done, case, finding)
    elif open_in(result):
        margins(done, result, budget)
    if budget.cut:
        _say_cut(result)


def open_in(result: ModuleResult) -> bool:
    """Whether there is anything to measure."""
    refuted = any(result.findings[claim].verdict in OPEN for claim in ORDER)
    return refuted or any(f.verdict == UNDECIDED for f in result.findings.values())


def _named(done: Sequence[Case], case: Case, finding: Finding) -> None:
    """Of which parameter values that was measured."""
    if len(done) < 2 or not finding.causes:
        return
    failing = sum(bool(c.failed("P2a")) for c in done)
    pairs = zip(case.problem.parameters, case.parameter, strict=True)
    at = ", ".join(f"{p.name} = {v}" for p, v in pairs)
    text = f"all this was measured with {at}; {failing} of {len(done)} parameter values fail"
    finding.causes.append(Cause("parameters", text))


def _say_cut(result: ModuleResult) -> None:
    """Where measuring ended early, that is said with what was found."""
    text = f"measuring was cut off ({BUDGET_S:g} s of CPU time in all): more could be said"
    names = ("P2a", "ttf", "safer", "start", "P2b")
    open_ = [f for f in (result.findings[n] for n in names) if f.verdict == UNDECIDED]
    finding = next((f for f in open_ if f.causes), open_[0] if open_ else None)
    if finding is not None:
        finding.causes.append(Cause("cut", text))


# ---------------------------------------------------------------- K


def _why_empty(case: Case, failure: Failure, finding: Finding, budget: CpuBudget) -> None:
    if EMPTY not in failure.text:
        return
    model = PointModel(case)
    grid = failure.proof if isinstance(failure.proof, GridProof) else None
    if grid is not None and not grid.found.allowed.any():
        finding.causes = list(_no_constraint(model))
    else:
        search = _runs(case, model, budget.part(RUNS_S))
        finding.leaving = search.soonest
        causes = list(faces(case, model, failure, search, budget))
        if not any(c.kind in HOPELESS for c in causes):
            stops = list(no_pull(model, _middle(case, model), budget.part(PULL_S)))
            if not stops and isinstance(failure.proof, PolytopeProof):
                stops = list(adds_up(failure.proof, case.problem))
            causes += stops
        if grid is not None and not any(c.kind in HOPELESS for c in causes):
            if not any(c.kind in ENDS for c in causes):
                causes += lost_at_ends(case, model, grid, budget)
            causes += _strength(case, grid, budget)
            causes += scaled(case, grid.found)
        causes += _simulated(search, gridded=grid is not None)
        if any(c.kind == "no_run" for c in causes):  # SC is not to blame for what cells lose
            causes = [replace(c, hint="") if c.kind in OF_SC else c for c in causes]
        order = [*NAMES, "undisturbed"]
        finding.causes = sorted(causes, key=lambda c: order.index(c.kind))
    main = next((c for c in finding.causes if c.kind in NAMES), None)
    if main is not None:
        if finding.verdict == UNDECIDED:  # a run that refutes it says more
            finding.text = f"{EMPTY}: {NAMES[main.kind]}"
        finding.causes.remove(main)
        finding.causes.insert(0, main)
        told = [c for c in finding.causes if c is main or c.kind != "weak" or main.kind not in ENDS]
        hints = [c.hint for c in told if c.hint and c.kind in NAMES]
        finding.hint = "; ".join(dict.fromkeys(hints[:HELPS])) or finding.hint


def _no_constraint(model: PointModel) -> Iterator[Cause]:
    """C itself has no cell."""
    start = model.start
    held = model.safe(start)
    where = (
        "at the declared start" if (start == np.clip(start, model.low, model.high)).all() else ""
    )
    if where and held == FALSE:
        yield Cause("constraint", "`safe` is false at the declared start, and holds on no cell")
    elif where and held == TRUE:
        text = "`safe` holds at the declared start, but on no whole cell"
        yield Cause("constraint", text)
    else:
        yield Cause("constraint", "`safe` holds on no whole cell of the grid")


def _runs(case: Case, model: PointModel, budget: CpuBudget) -> LeavingSearch:
    """The soonest run from the declared start, else from another state of C."""
    last_search = LeavingSearch()
    for start, whose in _starts(case, model):
        inside = (start >= model.low).all() and (start <= model.high).all()
        if not inside or not model.safe(start) & TRUE:
            continue
        allowance = budget.part(RUNS_S * 0.7 if whose == DECLARED else RUNS_S * 0.15)
        search = soonest(model, start, whose, allowance.goes_on)
        search.runs += last_search.runs
        search.longest_s = max(search.longest_s, last_search.longest_s)
        search.cut |= last_search.cut
        last_search = search
        if search.soonest is not None or not budget.goes_on():
            break
    return last_search


def _starts(case: Case, model: PointModel) -> Iterator[tuple[Floats, str]]:
    """The declared start, the middle of C, and half way from there to either end of each axis."""
    yield model.start, DECLARED
    middle = _middle(case, model)
    yield middle, "the middle of C"
    for axis in range(len(middle)):
        for end in (model.high, model.low):
            x = middle.copy()
            x[axis] = (middle[axis] + end[axis]) / 2
            yield x, "inside C"


def _middle(case: Case, model: PointModel) -> Floats:
    """A state deep inside every C_g."""
    x = model.start
    for proof in case.proofs:
        for state, value in proof.deepest.items():
            x[state] = value
    return np.clip(x, model.low, model.high)


def _simulated(search: LeavingSearch, *, gridded: bool) -> Iterator[Cause]:
    """What the runs showed beside the one that leaves soonest."""
    if search.soonest is None:
        if search.runs:
            yield Cause(
                "no_run",
                f"of {search.runs} runs of the model, up to {search.longest_s:.4g} s, none leaves C"
                + (" (cut off)" if search.cut else "")
                + ": perhaps SC keeps C, and the sets do not show it",
                "`core` that says where to look for K" if gridded else WEAK,
                (("runs", float(search.runs)), ("longest_s", search.longest_s)),
            )
    elif search.undisturbed_s is not None:
        when = search.undisturbed_s
        yield Cause(
            "undisturbed",
            f"without any disturbance, error or delay it leaves C after {when:.4g} s",
            "",
            (("left_s", when),),
        )


# ---------------------------------------------------------------- strength


def _strength(case: Case, grid: GridProof, budget: CpuBudget) -> Iterator[Cause]:
    """With which part of what stands against SC there would be a K."""
    there = against(case)
    if not there:
        modes = " but modes of others, which may change at any step" if case.problem.modes else ""
        yield Cause("weak", f"nothing stands against SC{modes}: no disturbance, error or delay")
        return
    listed = _and(there)

    def part(share: float, most: int, names: tuple[str, ...] = there) -> InvariantShare | None:
        return kept(case, grid, ProblemChange(most=most, scale=dict.fromkeys(names, share)), budget)

    most, best = COARSE[0], part(0.0, COARSE[0])
    if best is not None and not best.share and grid.found.core.size > most:
        most = COARSE[1]
        best = part(0.0, most)
    if best is None:
        return
    if not best.share:
        text = f"even without {listed} SC keeps nothing ({_on(best, grid)})"
        yield Cause("weak", text, "another SC")
        return
    low, high = 0, PRECISION
    while high - low > 1:
        middle = (low + high) // 2
        outcome = part(middle / PRECISION, most)
        if outcome is None:
            break
        if outcome.share:
            low, best = middle, outcome
        else:
            high = middle
    alone = []
    for name in there if len(there) > 1 else ():
        outcome = part(0.0, most, (name,))
        if outcome is not None and outcome.share:
            alone.append(f"without {name} {outcome.share:.1%}")
    at = f"{low / PRECISION:.0%} of the declared {listed}" if low else f"no {_and(there, 'or')}"
    fails = f"at {high / PRECISION:.0%} " + ("none was found" if high < PRECISION else "nothing")
    yield Cause(
        "strength",
        f"with {at} SC keeps {best.share:.1%} of C, {fails} ({_on(best, grid)})"
        + (f"; {', '.join(alone)}" if alone else ""),
        f"a stronger SC, or smaller {listed}",
        (("part", low / PRECISION), ("fails_at", high / PRECISION), ("share_of_C", best.share)),
    )


def _on(measured: InvariantShare, grid: GridProof) -> str:
    """The cells of a measurement, and whether they are those of the program."""
    coarser = measured.shape != grid.engine.shape
    return measured.cells + ", coarser than the declared ones" * coarser


def _and(words: tuple[str, ...], word: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {word} {words[-1]}"
