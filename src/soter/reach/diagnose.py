"""Why K is empty: causes told apart, each by a measurement.

Purpose: for what stays undecided, what was measured about it: by which face of the grid runs leave
and whether anything could hold them, an angle without its wrap-around, an end of the grid that
acts as a wall, an SC that only just fails, cells that are too coarse; and the run that leaves
soonest. Other claims have their margins (`margins.py`).
Non-goals: verdicts. Nothing here turns undecided into anything else. It takes a few CPU seconds at
most, and says where that was not enough.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from soter.reach.experiments import COARSE, Budget, Change, Kept, against, kept
from soter.reach.model_runs import FALSE, TRUE, Model, Search, StepFaultError, soonest
from soter.reach.results import UNDECIDED, Cause

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.reach.claims import Case, Failure
    from soter.reach.results import Finding, LeavingRun, ModuleResult

    Floats = NDArray[np.float64]

BUDGET_S = 8.0
RUNS_S = 3.5
FINER_S = 2.5
PRECISION = 32
"""Parts in which the strength of what stands against SC is told."""
DECLARED = "the declared start"
SAME = 1e-9
"""Relative difference up to which two points of an axis count as the same to the plant."""
POINTS = 12
SIZES = ((1, "half"), (2, "a quarter of"))
"""How often cells are halved to see whether that helps, and what that is in words."""
TURNS = (2 * math.pi, 360.0)
NAMES = {
    "constraint": "there is no C",
    "wrap_around": "an axis that should wrap around",
    "one_sided": "an end of the grid acts as a wall",
    "drift_of_all": "the flow leaves C whatever SC does",
    "drift": "the flow leaves the grid under SC",
    "cells": "the cells are too coarse",
    "strength": "too much stands against SC",
    "no_run": "but no run of the model was seen to leave C",
    "weak": "with nothing against SC, too",
}
"""Causes, the first of which that was found is named in the table."""
HOPELESS = ("wrap_around", "drift_of_all")
"""Causes beside which cells and strength are not looked at."""
EMPTY = "K is empty"


def diagnose(done: Sequence[Case], result: ModuleResult) -> None:
    """Enter causes and margins for what is undecided."""
    from soter.reach.margins import margins  # noqa: PLC0415 - only then

    budget = Budget(BUDGET_S)
    finding = result.findings["P2a"]
    case = next((c for c in done if c.failed("P2a")), None)
    if finding.verdict == UNDECIDED and case is not None:
        failure = case.failed("P2a")[0]
        _why_empty(case, failure, finding, budget)
        _named(done, case, finding)
    elif any(f.verdict == UNDECIDED for f in result.findings.values()):
        margins(done, result, budget)
    if budget.cut:
        _say_cut(result)


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
    for name in ("P2a", "ttf", "safer", "start", "P2b"):
        finding = result.findings[name]
        if finding.verdict == UNDECIDED and (finding.causes or name == "P2a"):
            finding.causes.append(Cause("cut", text))
            return


# ---------------------------------------------------------------- K


def _why_empty(case: Case, failure: Failure, finding: Finding, budget: Budget) -> None:
    if EMPTY not in failure.text:
        return
    model = Model(case)
    if failure.group is not None and not case.sets.groups[failure.group].allowed.any():
        finding.causes = list(_no_constraint(case, model, failure.group))
    else:
        search = _runs(case, model, budget.part(RUNS_S))
        finding.leaving = search.soonest
        causes = list(_faces(case, model, failure, search, budget))
        if failure.group is not None and not any(c.kind in HOPELESS for c in causes):
            causes += _cells_and_strength(case, failure.group, budget)
        causes += _simulated(search)
        order = [*NAMES, "not_cells", "undisturbed"]
        finding.causes = sorted(causes, key=lambda c: order.index(c.kind))
    main = next((c for c in finding.causes if c.kind in NAMES), None)
    if main is not None:
        finding.text = f"{EMPTY}: {NAMES[main.kind]}"
        finding.causes.remove(main)
        finding.causes.insert(0, main)
        finding.hint = main.hint or finding.hint


def _no_constraint(case: Case, model: Model, index: int) -> Iterator[Cause]:
    """C itself has no cell."""
    start = _declared_start(model)
    held = model.safe(start)
    where = "at the declared start" if (start == np.clip(start, model.low, model.high)).all() else ""
    if where and held == FALSE:
        yield Cause("constraint", "`safe` is false at the declared start, and holds on no cell")
    elif where and held == TRUE:
        text = "`safe` holds at the declared start, but on no whole cell"
        yield Cause("constraint", text, _more_cells(case, index))
    else:
        yield Cause("constraint", "`safe` holds on no whole cell of the grid")


def _declared_start(model: Model) -> Floats:
    return np.array([i.low / 2 + i.high / 2 for i in model.problem.initial])


def _runs(case: Case, model: Model, budget: Budget) -> Search:
    """The soonest run from the declared start, else from another state of C."""
    found = Search()
    for start, whose in _starts(case, model):
        inside = (start >= model.low).all() and (start <= model.high).all()
        if not inside or not model.safe(start) & TRUE:
            continue
        allowance = budget.part(RUNS_S * 0.7 if whose == DECLARED else RUNS_S * 0.15)
        search = soonest(model, start, whose, allowance.goes_on)
        search.runs += found.runs
        search.longest_s = max(search.longest_s, found.longest_s)
        search.cut |= found.cut
        found = search
        if search.soonest is not None or not budget.goes_on():
            break
    return found


def _starts(case: Case, model: Model) -> Iterator[tuple[Floats, str]]:
    """The declared start, the middle of C, and half way from there to either end of each axis."""
    yield _declared_start(model), DECLARED
    middle = _middle(case, model)
    yield middle, "the middle of C"
    for axis in range(len(middle)):
        for end in (model.high, model.low):
            x = middle.copy()
            x[axis] = (middle[axis] + end[axis]) / 2
            yield x, "inside C"


def _middle(case: Case, model: Model) -> Floats:
    """A state deep inside every C_g."""
    x = _declared_start(model)
    for part in case.sets.groups:
        deepest = part.allowed
        while True:
            inner = deepest.copy()
            for axis in range(inner.ndim):
                n = inner.shape[axis]
                if n < 3:
                    continue
                inner &= np.roll(deepest, 1, axis) & np.roll(deepest, -1, axis)
                ends = [slice(None)] * inner.ndim
                for end in (0, n - 1):
                    ends[axis] = end  # type: ignore[call-overload]
                    inner[tuple(ends)] = False
            if not inner.any():
                break
            deepest = inner
        if deepest.any():
            at = np.argwhere(deepest)[int(deepest.sum()) // 2]
            for axis, e, i in zip(part.group.axes, part.edges, at, strict=True):
                x[axis.state] = (e[i] + e[i + 1]) / 2
    for polytope in case.sets.polytopes:
        for axis, (low, high) in zip(polytope.group.axes, polytope.limits, strict=True):
            x[axis.state] = (low + high) / 2
    return np.clip(x, model.low, model.high)


def _simulated(search: Search) -> Iterator[Cause]:
    """What the runs showed beside the one that leaves soonest."""
    if search.soonest is None:
        if search.runs:
            yield Cause(
                "no_run",
                f"of {search.runs} runs of the model of up to {search.longest_s:.4g} s none leaves C"
                + (" (cut off)" if search.cut else "")
                + ": perhaps SC keeps C, and the sets do not show it",
                "a finer grid, or `core` that says where to look for K",
                (("runs", float(search.runs)), ("longest_s", search.longest_s)),
            )
    elif search.undisturbed_s is not None:
        yield Cause(
            "undisturbed",
            f"without any disturbance, error or delay it leaves C after {search.undisturbed_s:.4g} s",
            "",
            (("left_s", search.undisturbed_s),),
        )


# ---------------------------------------------------------------- by which face


def _faces(
    case: Case, model: Model, failure: Failure, search: Search, budget: Budget
) -> Iterator[Cause]:
    """Drift, an axis that wraps around, a wall that nobody meant."""
    yield from _drift(case, model)
    run = search.soonest
    if run is None or run.safe:
        return
    axis = run.names.index(run.axis)
    end = float((model.low, model.high)[run.side > 0][axis])
    if _wraps(model, axis):
        width = float(model.high[axis] - model.low[axis])
        yield Cause(
            "wrap_around",
            f"runs leave at {run.axis} = {end:.6g} and should come in at the other end: "
            "an axis that wraps around is not supported yet",
            f"a grid on which {run.axis} need not turn over, and a `safe` that says so",
            (("end", end), ("width", width)),
        )
        return
    yield _wall(case, model, failure, run, axis, end, budget)


def _wall(
    case: Case,
    model: Model,
    failure: Failure,
    run: LeavingRun,
    axis: int,
    end: float,
    budget: Budget,
) -> Cause:
    """The run left the grid where `safe` holds: by a wall that only the grid makes."""
    width = float(model.high[axis] - model.low[axis])
    beyond, other = run.states[-1].copy(), run.states[0].copy()
    beyond[axis] = end + run.side * width
    other[axis] = end - run.side * 1.001 * width
    numbers = (("end", end), ("side", float(run.side)))
    wider = _wider(case, model, failure, axis, run.side, budget)
    if model.safe(beyond) & TRUE and model.safe(other) == FALSE:
        text = (
            f"`safe` bounds {run.axis} on one side only, and runs leave at the grid's other end, "
            f"{run.axis} = {end:.6g}, which counts as unsafe"
        )
        return Cause("one_sided", text + wider, _bound(run, end), numbers)
    text = f"under SC the flow leaves the grid at {run.axis} = {end:.6g}, where `safe` still holds"
    return Cause("drift", text + wider, _bound(run, end), numbers)


def _bound(run: LeavingRun, end: float) -> str:
    low = "beyond" if run.side > 0 else "below"
    return f"a grid that goes {low} {end:.6g}, or an SC that keeps {run.axis} from getting there"


def _wider(
    case: Case, model: Model, failure: Failure, axis: int, side: int, budget: Budget
) -> str:
    """What twice the range on that side changes."""
    index = failure.group
    if index is None or axis not in case.groups[index].axes:
        return ""
    low, high = float(model.low[axis]), float(model.high[axis])
    ends = (low, high + (high - low)) if side > 0 else (low - (high - low), high)
    found = kept(case, index, Change(most=COARSE[1], wider={axis: ends}), budget)
    if found is None:
        return ""
    much = f"K is {found.share:.1%} of C" if found.share else "K is empty as well"
    return f"; with a grid up to {ends[side > 0]:.6g} {much} ({found.cells})"


def _drift(case: Case, model: Model) -> Iterator[Cause]:
    """A state that, whatever anybody does, only goes one way: enclosed over all of C."""
    box = case.forms.whole.copy()
    for part in case.sets.groups:
        for k, axis in enumerate(part.group.axes):
            others = tuple(j for j in range(part.allowed.ndim) if j != k)
            at = np.flatnonzero(part.allowed.any(axis=others))
            if len(at):
                box[axis.state] = part.edges[k][at[0]], part.edges[k][at[-1] + 1]
    n = len(model.low)
    if model.is_map:
        rates = _moves(case, box, n)
    else:
        rates = case.forms.numbers("derivative", box, n)
    if rates is None:
        return
    per = "a step" if model.is_map else "/s"
    for i in range(n):
        low, high = float(rates[i, 0]), float(rates[i, 1])
        if low > 0.0 or high < 0.0:
            name, end = model.problem.quantities.states[i].name, float(box[i, int(low > 0.0)])
            least = low if low > 0.0 else high
            yield Cause(
                "drift_of_all",
                f"the flow leaves at {name} = {end:.6g} whatever SC does: all over C {name} "
                f"{'rises' if low > 0.0 else 'falls'} by {abs(least):.4g} {per} at least",
                f"a state that only grows has no set that is kept: leave {name} out, or let it wrap",
                (("end", end), ("rate", least)),
            )


def _moves(case: Case, box: Floats, n: int) -> Floats | None:
    """Bounds of next(x) - x over a box, (n, 2): differences of forms."""
    middle, half = box.mean(axis=1), (box[:, 1] - box[:, 0]) / 2
    forms = np.zeros((len(box), 4 + case.forms.library.inputs))
    forms[:, 0], forms[:, 1], forms[:, 2] = box[:, 0], box[:, 1], middle
    forms[range(len(box)), range(4, 4 + len(box))] = half
    out = case.forms.affine("next", forms, n)
    if out is None:
        return None
    out[:, 2] -= middle[:n]
    out[range(n), range(4, 4 + n)] -= half[:n]
    spread = np.abs(out[:, 4:]).sum(axis=1) + out[:, 3]
    return np.stack([out[:, 2] - spread, out[:, 2] + spread], axis=1)


def _wraps(model: Model, axis: int) -> bool:
    """Whether plant and `safe` are the same at both ends of an axis, and it is no mere place.

    No mere place: the plant depends on it in between, or its range is a full turn.
    """
    chance = np.random.default_rng(0)
    low, high = float(model.low[axis]), float(model.high[axis])
    turns = [(high - low) / t for t in TURNS]
    is_turn = any(t > 0.5 and abs(t - round(t)) < 1e-3 * t for t in turns)
    depends = False
    whole = model.forms.whole
    for _ in range(POINTS):
        point = chance.uniform(whole[:, 0], whole[:, 1])
        u, w = point[model.controls], point[model.disturbances]
        seen = []
        for value in (low, high, float(chance.uniform(low, high))):
            x = point[model.states].copy()
            x[axis] = value
            try:
                rate = model.rate(x, u, w)
            except StepFaultError:
                return False
            if model.is_map:
                rate[axis] -= value
            seen.append((rate, model.safe(x)))
        size = 1e-12 + float(np.abs(seen[0][0]).max())
        if np.abs(seen[0][0] - seen[1][0]).max() > SAME * size or seen[0][1] != seen[1][1]:
            return False
        depends |= bool(np.abs(seen[0][0] - seen[2][0]).max() > 1e-6 * size)
    return depends or is_turn


# ---------------------------------------------------------------- cells and strength


def _more_cells(case: Case, index: int, times: int = 2) -> str:
    axes = case.sets.groups[index].group.axes
    return "more cells: " + ", ".join(f"{a.name} / {times * (len(a.edges) - 1)}" for a in axes)


def _cells_and_strength(case: Case, index: int, budget: Budget) -> Iterator[Cause]:
    """Cells of half the size, then less against SC, then cells of a quarter of the size."""
    last: Cause | None = None
    for split, size in SIZES:
        found = kept(case, index, Change(split=split), budget.part(FINER_S))
        if found is not None:
            last = _finer(case, index, split, size, found)
        if last is not None and last.kind == "cells":
            yield last
            return
        if split == 1:
            yield from _strength(case, index, budget)
    if last is not None:
        yield last


def _finer(case: Case, index: int, split: int, size: str, found: Kept) -> Cause:
    """What smaller cells change."""
    numbers = (("share_of_C", found.share), ("split", float(2**split)))
    if not found.share:
        text = f"with cells of {size} the size K is empty as well ({found.cells})"
        return Cause("not_cells", text, "", numbers)
    text = f"with cells of {size} the size K is {found.share:.1%} of C ({found.cells})"
    return Cause("cells", text, _more_cells(case, index, 2**split), numbers)


def _strength(case: Case, index: int, budget: Budget) -> Iterator[Cause]:
    """With which part of what stands against SC there would be a K."""
    there = against(case)
    if not there:
        yield Cause("weak", "nothing stands against SC: no disturbance, error or delay")
        return
    listed = _and(there)

    def part(share: float, most: int, names: tuple[str, ...] = there) -> Kept | None:
        return kept(case, index, Change(most=most, scale=dict.fromkeys(names, share)), budget)

    most, best = COARSE[0], part(0.0, COARSE[0])
    if best is not None and not best.share and case.sets.groups[index].core.size > most:
        most = COARSE[1]
        best = part(0.0, most)
    if best is None:
        return
    if not best.share:
        text = f"even without {listed} SC keeps nothing ({best.cells})"
        yield Cause("weak", text, "another SC, or a finer grid")
        return
    low, high = 0, PRECISION
    while high - low > 1:
        middle = (low + high) // 2
        found = part(middle / PRECISION, most)
        if found is None:
            break
        if found.share:
            low, best = middle, found
        else:
            high = middle
    alone = []
    for name in there if len(there) > 1 else ():
        found = part(0.0, most, (name,))
        if found is not None and found.share:
            alone.append(f"without {name} {found.share:.1%}")
    at = f"{low / PRECISION:.0%} of the declared {listed}" if low else f"no {_and(there, 'or')}"
    fails = f"at {high / PRECISION:.0%} " + ("none was found" if high < PRECISION else "nothing")
    yield Cause(
        "strength",
        f"with {at} SC keeps {best.share:.1%} of C, {fails} ({best.cells})"
        + (f"; {', '.join(alone)}" if alone else ""),
        f"a stronger SC, or smaller {listed}",
        (("part", low / PRECISION), ("fails_at", high / PRECISION), ("share_of_C", best.share)),
    )


def _and(words: tuple[str, ...], word: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {word} {words[-1]}"
