"""Why P2b is not proved: where SC brings the plant, and what would have to change.

Purpose: runs of the model under SC, undisturbed and with every adversary held: where they come to
rest, for which values `safer` holds beside that place, and by how much it would have to be wider;
whether finer cells, or less against SC, show the way back. Also beside a run that refutes P2b,
which says where it ends and not why.
Non-goals: verdicts; polytopes; finer cells or fewer levels where predicates are computed
(`tried_remedies.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.system import LEVELS_LEAST
from soter.verify.claims.cells import cells_of, holding
from soter.verify.claims.choice import CELLS_MAX
from soter.verify.claims.results import Cause
from soter.verify.diagnosis.experiments import (
    COARSE,
    HALVINGS,
    ProblemChange,
    against,
    axis_names,
    returns,
)
from soter.verify.diagnosis.model_runs import TRUE, PointModel, pattern_text, patterns, run
from soter.verify.grid.claims import GridProof
from soter.verify.problem.estimates import errors_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, Failure
    from soter.verify.claims.results import GroupSets
    from soter.verify.diagnosis.experiments import CpuBudget
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern
    from soter.verify.grid.sets import GridGroup

    Bools = NDArray[np.bool_]
    Floats = NDArray[np.float64]

WALK_HOLDS = 2000
"""How long a run is followed to see where SC brings it."""
PUSHED_S = 1.5
"""CPU seconds for runs with an adversary."""
FINER_S = 3.0
STILL = 1e-3
"""Of an axis: a run that moves less in the last quarter of its time has come to rest."""
SCANNED = 800
"""Points of an axis at which `safer` is asked."""
DECLARED = "the declared start"
REST = "let SC come to rest where `safer` holds"
SIZES = ((1, "half"), (2, "a quarter of"), (3, "an eighth of"))


def recovery_causes(
    case: Case, failure: Failure, grid: GridProof, budget: CpuBudget
) -> Iterator[Cause]:
    """Why there is no set inside `safer` that SC keeps, or no way there."""
    model, part = PointModel(case), grid.found
    goal = _Goal(case, model, grid)
    start, whose = model.start, DECLARED
    if failure.stuck and failure.cells is not None:
        start, whose = _inside(model, grid, failure.cells), "one of them"
    elif not _in_core(grid, start):
        start, whose = _inside(model, grid, part.core > 0), "inside K"
    if part.target is not None and not part.target.any():
        text = "`safer` holds on no whole cell with the errors of its estimates added"
        yield Cause("no_target", text, "" if goal.computed else _wide_enough(case, grid))
        return
    causes = list(_rests(goal, start, whose, budget))
    yield from causes
    if goal.computed:
        many = case.problem.levels
        text = f"`safer` is computed: S_{many - 2} of {many} levels, on the grid as it is declared"
        text += ", with 2 no more is shown" * (case.problem.levels_open and many > LEVELS_LEAST)
        less = ", ".join(f"smaller {name}" for name in against(case))
        yield Cause("computed", text, "" if any(c.hint for c in causes) else _cells_of(case) + less)
        return
    if any(c.kind in ("stays_away", "leaves", "pushed_out") for c in causes):
        if not failure.stuck:
            yield from _wider(case, grid.engine, part)
        return
    measured = list(_cells(case, grid, budget))
    yield from measured
    if not any(c.hint for c in measured):
        what = ", ".join(f"smaller {name}" for name in against(case))
        yield Cause("unknown", "nothing that was tried shows the way", f"a wider `safer`, {what}")
    if not failure.stuck:
        yield from _wider(case, grid.engine, part)


def _in_core(grid: GridProof, x: Floats) -> bool:
    return _in(grid, grid.found.core > 0, x)


def _in(grid: GridProof, cells: Bools, x: Floats) -> bool:
    """Whether all cells that hold a state, (states,), are in a set of the grid's shape."""
    pairs = zip(grid.engine.axes, grid.engine.edges, strict=True)
    at = [holding(edges, float(x[state]), float(x[state])) for state, edges in pairs]
    inside = tuple(b for b in at if b is not None)
    return len(inside) == len(at) and bool(cells[inside].all())


class _Goal:
    """Where SC gives control back: by `safer`, or by the table of the DM where it is computed."""

    def __init__(self, case: Case, model: PointModel, grid: GridProof) -> None:
        self.case, self.model, self.grid = case, model, grid
        self.computed = case.problem.computed

    def holds(self, x: Floats) -> bool:
        """On the exact estimate of a state, (states,)."""
        return self.surely(x) if self.computed else self.model.safer(x)

    def surely(self, x: Floats) -> bool:
        """On every estimate of a state, (states,)."""
        if self.computed:
            target = self.grid.found.target
            return target is not None and _in(self.grid, target, x)
        box = self.case.forms.whole.copy()
        box[self.model.states] = np.stack([x, x], axis=1)
        return self.case.forms.truth(self.case.problem.returning, box) == TRUE


def _inside(model: PointModel, grid: GridProof, of: Bools) -> Floats:
    """The middle of the cell of a set that is nearest to the grid's middle; the start elsewhere."""
    x = model.start
    cells = np.argwhere(of)
    middle = np.array(of.shape) / 2
    at = cells[int(np.argmin((np.abs(cells - middle) / middle).max(axis=1)))]
    for state, edges, i in zip(grid.engine.axes, grid.engine.edges, at, strict=True):
        x[state] = (edges[i] + edges[i + 1]) / 2
    return x


# ---------------------------------------------------------------- where SC brings the plant


@dataclass(frozen=True, eq=False)
class _Rest:
    """The last quarter of a run: the ends of every state there, (states,) each."""

    low: Floats
    high: Floats
    still: bool
    last: Floats
    time_s: float

    @property
    def middle(self) -> Floats:
        return self.low / 2 + self.high / 2


def _rest(model: PointModel, trace: ModelTrace) -> _Rest:
    times, states = np.array(trace.times), np.array(trace.states)
    late = states[times >= 0.75 * times[-1]]
    low, high = late.min(axis=0), late.max(axis=0)
    width = np.maximum(model.high - model.low, 1e-300)
    still = bool(((high - low) <= STILL * width).all())
    return _Rest(low, high, still, states[-1], float(times[-1]))


def _rests(goal: _Goal, start: Floats, whose: str, budget: CpuBudget) -> Iterator[Cause]:
    """Whether the undisturbed run comes to `safer`; if so, whether those with an adversary do."""
    model = goal.model
    holds = WALK_HOLDS * model.inputs.period_ns / 1e9
    every = iter(patterns(model))
    trace = run(model, start, next(every), holds, budget.goes_on)
    head = f"from {whose} ({_told(model, start)}) the undisturbed run of the model"
    end = _rest(model, trace)
    if trace.left:
        at = _told(model, trace.states[-1])
        text = f"{head} leaves C after {trace.times[-1]:.4g} s at {at}"
        yield Cause("leaves", text, REST)
        return
    inside = [goal.holds(x) for x in trace.states]
    if not inside[-1] or not (end.still or all(inside[-(len(inside) // 4 + 1) :])):
        yield _away(goal, head, end)
        return
    pushed, followed = _pushed(goal, start, list(every), budget.part(PUSHED_S), end)
    if pushed is not None:
        yield pushed
        return
    last = max((i for i, held in enumerate(inside) if not held), default=-1)
    when = trace.times[min(last + 1, len(trace.times) - 1)]
    text = f"{head} is in `safer` from {when:.4g} s on"
    if followed:
        ends = "with disturbances, errors and delays at their ends"
        text += f", and of {followed} runs {ends} each is so for the last quarter of its time"
    text += ": no run that was tried stays away, and no set was shown that all runs stay in"
    yield Cause("comes_back", text, "", (("back_s", when),))


def _away(goal: _Goal, head: str, end: _Rest) -> Cause:
    """SC brings the plant to where `safer` does not hold."""
    model = goal.model
    asked = _asked(goal, end.last)
    moves = "" if end.still else f", still between {_ranges(model, end)}"
    text = f"{head} {'comes to rest at' if end.still else 'is at'} {_told(model, end.last)} "
    text += f"after {end.time_s:.4g} s{moves}: `safer` does not hold there"
    if asked is None:
        return Cause("stays_away", text, REST)
    name, at, low, high = asked
    text += f"; it holds there for {name} in [{low:.4g}, {high:.4g}]"
    hint = f"let SC bring {name} to {low / 2 + high / 2:.4g} instead of {at:.4g} (a law that only "
    hint += "stops does not, and a proportional one stays behind a constant load)"
    if not goal.computed:
        hint += f", or write a `safer` that holds around {name} = {at:.4g}"
    return Cause("stays_away", text, hint, (("low", low), ("high", high), ("at", at)))


def _pushed(
    goal: _Goal, start: Floats, rest: Sequence[Pattern], budget: CpuBudget, alone: _Rest
) -> tuple[Cause | None, int]:
    """The run with an adversary that ends furthest outside `safer`; None where all are inside.

    And how many were followed to the end. `alone`: where the undisturbed run ends.
    """
    model = goal.model
    holds = WALK_HOLDS * model.inputs.period_ns / 1e9
    worst: tuple[float, Pattern, _Rest] | None = None
    low, high = np.full(len(start), np.inf), np.full(len(start), -np.inf)
    followed = 0
    for pattern in rest:
        if not budget.goes_on():
            break
        trace = run(model, start, pattern, holds, budget.goes_on)
        if trace.left or not budget.goes_on():
            continue
        end = _rest(model, trace)
        followed += 1
        low, high = np.minimum(low, end.low), np.maximum(high, end.high)
        quarter = [
            x for t, x in zip(trace.times, trace.states, strict=True) if t >= 0.75 * end.time_s
        ]
        outside = sum(not goal.surely(x) for x in quarter) / len(quarter)
        if outside and (worst is None or outside > worst[0]):
            worst = outside, pattern, end
    if worst is None:
        return None, followed
    _, pattern, end = worst
    asked = _asked(goal, end.last)
    what = ", ".join(pattern_text(model, pattern))
    at = (
        f"comes to rest at {_told(model, end.last)}"
        if end.still
        else f"stays between {_ranges(model, end)}"
    )
    text = f"with {what} SC's run of the model {at}, where `safer` does not hold of every estimate"
    if asked is None:
        wider = "" if goal.computed else "a wider `safer`, "
        hint = f"{wider}smaller disturbances, or a stronger SC"
        return Cause("pushed_out", text, hint), followed
    name, value, first, last = asked
    axis = model.names.index(name)
    error = errors_of(model.problem).get(axis, 0.0)
    ends = float(low[axis]) - error, float(high[axis]) + error
    text += (
        f": with everything else as it is there it holds for {name} in [{first:.4g}, {last:.4g}]"
    )
    wide = f"{name} from {ends[0]:.4g} to {ends[1]:.4g}"
    hint = "" if goal.computed else f"a `safer` that holds on estimates of {wide} and more, or "
    if ends[1] - ends[0] < last - first:  # there is room for it, at another place
        middle, own = _near_zero(first / 2 + last / 2), float(alone.last[axis])
        hint += f"let SC bring {name} to {middle:.4g} instead of {own:.4g}, as it strays, or "
    hint += f"an SC that keeps {name} closer (a larger gain, an integral part), or smaller bounds"
    numbers = ("at", value), ("low", ends[0]), ("high", ends[1])
    return Cause("pushed_out", text, hint, numbers), followed


def _asked(goal: _Goal, x: Floats) -> tuple[str, float, float, float] | None:
    """The axis along which `safer` is nearest: its name, the value there, and where it holds.

    All other states stay as they are; of several ranges of one axis the nearest. None where moving
    one state alone does not bring it there.
    """
    best: tuple[float, int, float, float] | None = None
    model = goal.model
    for axis in range(len(x)):
        points = np.linspace(model.low[axis], model.high[axis], SCANNED + 1)
        held = np.zeros(len(points) + 2, dtype=np.int8)
        for k, value in enumerate(points):
            y = x.copy()
            y[axis] = value
            held[k + 1] = goal.surely(y)
        turns = np.flatnonzero(np.diff(held))
        for a, b in zip(turns[::2], turns[1::2], strict=True):
            low, high = float(points[a]), float(points[b - 1])
            far = max(low - x[axis], x[axis] - high, 0.0) / float(points[-1] - points[0])
            if best is None or far < best[0]:
                best = far, axis, low, high
    if best is None:
        return None
    return model.names[best[1]], float(x[best[1]]), best[2], best[3]


def _told(model: PointModel, x: Floats) -> str:
    pairs = zip(model.names, x, strict=True)
    return ", ".join(f"{n} = {_near_zero(v):.5g}" for n, v in pairs)


def _ranges(model: PointModel, end: _Rest) -> str:
    every = zip(model.names, end.low, end.high, strict=True)
    return ", ".join(f"{n} = {_near_zero(a):.4g} and {_near_zero(b):.4g}" for n, a, b in every)


def _near_zero(value: float) -> float:
    """A number that is 0 but for rounding, as 0."""
    return 0.0 if abs(value) < 1e-9 else value


# ---------------------------------------------------------------- the grid


def _wide_enough(case: Case, grid: GridProof) -> str:
    """By how much `safer` has to be wider than errors and a cell."""
    errors = errors_of(case.problem)
    least = []
    for axis, edges in zip(grid.group.axes, grid.engine.edges, strict=True):
        need = 2 * errors.get(axis.state, 0.0) + 2 * float(np.diff(edges).max())
        least.append(f"{need:.4g} in {axis.name}")
    wide = ", ".join(least)
    return f"a `safer` that is wider than twice the error and two cells ({wide}), or more cells"


def _cells_of(case: Case) -> str:
    """That more cells may show it, where those of half the size are too many for all trials."""
    halved = cells_of(case.problem) * 2 ** max(len(g.axes) for g in case.problem.groups)
    if halved <= CELLS_MAX["P2a"]:
        return ""
    return f"more cells (half the size, {halved:,}, is more than is looked at by itself), "


def _cells(case: Case, grid: GridProof, budget: CpuBudget) -> Iterator[Cause]:
    """Smaller cells than those of the declared grid, then less against SC."""
    first = case if case.first is None else case.first
    at = case.proofs.index(grid)
    declared = first.proofs[at] if at < len(first.proofs) else grid
    given = declared if isinstance(declared, GridProof) else grid
    for split, size in SIZES:
        outcome = returns(case, given, ProblemChange(split=split), budget.part(FINER_S))
        if outcome is None:
            break
        if not outcome.share:
            text = f"with cells of {size} the size SC keeps no set inside `safer` ({outcome.cells})"
            yield Cause("not_cells", text)
            continue
        share = f"{outcome.share:.1%} of K ({outcome.cells})"
        text = f"with cells of {size} the size SC returns from {share}"
        more = ", ".join(
            f"{a.name} in [{a.end(a.edges[0])}, {a.end(a.edges[-1])}] / {n}"
            for a, n in zip(given.group.axes, outcome.shape, strict=True)
        )
        yield Cause("cells", text, f"more cells: `grid {more};`", (("share_of_K", outcome.share),))
        return
    for name in against(case):
        change = ProblemChange(most=COARSE[1], scale={name: 0.0})
        outcome = returns(case, given, change, budget.part(FINER_S))
        if outcome is not None and outcome.share:
            text = f"without {name} SC returns from {outcome.share:.1%} of K "
            f"({outcome.cells})"
            hint = f"smaller {name}, or a stronger SC"
            yield Cause("strength", text, hint, (("share_of_K", outcome.share),))


def _wider(case: Case, engine: GridGroup, part: GroupSets) -> Iterator[Cause]:
    """By how much `safer` would have to grow for SC to keep a set in it."""
    assert part.target is not None
    sizes = part.target.shape
    good, bad = max(sizes), 0
    while good - bad > max(1, max(sizes) // 2**HALVINGS):
        middle = (good + bad) // 2
        steps = [-(-middle * n // max(sizes)) for n in sizes]
        if engine.core(_grown(part.target, steps) & part.allowed).cells.any():
            good = middle
        else:
            bad = middle
    if good == max(sizes):
        return
    by = [
        (name, -(-good * n // max(sizes)) * float(np.diff(e).max()))
        for name, n, e in zip(axis_names(case, engine), sizes, engine.edges, strict=True)
    ]
    how = ", ".join(f"{size:.4g} in {name}" for name, size in by)
    text = f"SC keeps a set where `safer` is wider by {how} on either side"
    yield Cause("safer_wider", text, "", tuple(by))


def _grown(cells: Bools, steps: Sequence[int]) -> Bools:
    """Cells within so many of the set along each axis."""
    for axis, count in enumerate(steps):
        n = cells.shape[axis]
        sums = np.cumsum(np.insert(cells.astype(np.int32), 0, 0, axis=axis), axis=axis)
        low = np.maximum(np.arange(n) - count, 0)
        high = np.minimum(np.arange(n) + count + 1, n)
        cells = np.take(sums, high, axis=axis) > np.take(sums, low, axis=axis)
    return np.asarray(cells)
