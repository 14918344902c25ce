"""By how much `ttf`, `safer` or the start fail, and what would help.

Purpose: numbers beside the cells: for which H an inclusion would hold, how much sooner a predicate
would have to hold; of a start outside the grid, outside K, or from which SC comes too late, which
state it is, how far the set reaches along it, and what to write; predicates that read a scaled
observation as if it were the state. Margins of predicates are measured on the declared grid: on
finer ones, which were tried, they would be less, but a program that is changed by so much is proved
on the first.
Non-goals: verdicts; an empty K (`empty_invariant.py`); P2b (`recovery_failures.py`); polytopes,
whose claims say more themselves.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.durations import show_ns
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import FLOAT, leaves
from soter.verify.claims.cells import mesh_of
from soter.verify.claims.results import REFUTED, UNDECIDED, Cause
from soter.verify.diagnosis.experiments import axis_names, longest
from soter.verify.diagnosis.grid_ends import grid_ends, lost_at_ends
from soter.verify.diagnosis.model_runs import FALSE, PointModel, StepFaultError
from soter.verify.diagnosis.recovery_failures import recovery_causes
from soter.verify.grid.claims import GridProof
from soter.verify.grid.sets import CancelledError, UnboundedError
from soter.verify.problem.estimates import errors_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, Failure
    from soter.verify.claims.results import Finding, GroupSets, ModuleResult
    from soter.verify.diagnosis.experiments import CpuBudget
    from soter.verify.grid.sets import GridGroup
    from soter.verify.problem.problem import Interval, Problem

    Bools = NDArray[np.bool_]
    Floats = NDArray[np.float64]


def scaled(case: Case, part: GroupSets) -> Iterator[Cause]:
    """A cause where `safe` has no end on the grid and reads something that is no state."""
    if not part.allowed.all():
        return
    driven_topics = list(_driven_otherwise(case.problem))
    if not driven_topics:
        return
    how = "; ".join(f"`{topic}`, driven as `{value}`" for topic, value in driven_topics)
    text = f"`safe` holds on the whole grid: it reads {how}, and may count in other units"
    hint = (
        "drive the states as they are, in the units of `safe`, and divide in the controller that "
    )
    hint += "wants scaled numbers; or write the predicates in the units of the topic"
    yield Cause("scaled", text, hint, ())


def _driven_otherwise(problem: Problem) -> Iterator[tuple[str, str]]:
    """Topics that `safe` reads and a plant drives, in part, by more than a state; how."""
    symbol, scope = problem.module.symbol, problem.module.scope
    read = {scope.topics[t] for t in topic_reads(symbol.safe) if t in scope.topics}
    for c in problem.system.components:
        for topic, value in c.plant.drives if c.plant is not None else ():
            index = c.scope.topics[topic]
            numbers = [i for i, (_, t) in enumerate(leaves(topic.type)) if t == FLOAT]
            if index in read and any((index, i) not in problem.state_of_leaf for i in numbers):
                yield topic.name, " ".join(value.span.text.split())


def start_margins(case: Case, engine: GridGroup, part: GroupSets) -> Iterator[Cause]:
    """Where the start lies, and where it would have to lie."""
    names = axis_names(case, engine)
    ends = [case.problem.initial[s] for s in engine.axes]
    box = mesh_of(engine.edges, engine.turns, ends)
    outside = [k for k, b in enumerate(box) if b is None]
    if outside:
        yield _outside(case, engine, outside)
        return
    at = [b for b in box if b is not None]
    core = part.core > 0
    if not core[np.ix_(*at)].all():
        yield _apart(case, engine, core, at, names, ends)
        return
    h0 = case.problem.times.start
    good = longest(case, engine, core, h0, lambda reach: bool(reach[np.ix_(*at)].all()))
    text = f"the start lies in K, and SC would be in time if it acted within {show_ns(good)}"
    text += f"; it acts within {show_ns(h0)}"
    in_time = engine.safe_for(case.problem.in_horizon(h0), core)
    numbers = (("in_time_s", good / 1e9), ("acts_s", h0 / 1e9))
    moved = _apart(case, engine, in_time, at, names, ends, "it is in time from")
    text += f"; {moved.text}"
    yield Cause("start_late", text, moved.hint, (*numbers, *moved.numbers))


def _outside(case: Case, engine: GridGroup, axes: list[int]) -> Cause:
    """Not even in the grid: whether that is the grid's fault."""
    names = axis_names(case, engine)
    said = []
    for k in axes:
        start, edges = case.problem.initial[engine.axes[k]], engine.edges[k]
        where = f"{names[k]} in [{edges[0]:.6g}, {edges[-1]:.6g}]"
        said.append(f"{_value(names[k], start)}, outside the grid, which is {where}")
    text, grid = "; ".join(said), "a `grid` that holds the start"
    model = PointModel(case)
    if model.safe(model.start) == FALSE:
        text += "; `safe` is false there"
        grid = "a `safe` that holds at the start, with a `grid` that holds it"
    middle = f"{(engine.edges[axes[0]][0] + engine.edges[axes[0]][-1]) / 2:.6g}"
    return Cause("start_outside", text, f"{grid}, or {_written(names[axes[0]], middle)}")


def _apart(
    case: Case,
    engine: GridGroup,
    cells: Bools,
    at: list[list[int]],
    names: list[str],
    ends: list[Interval],
    what: str = "SC was shown to keep `safe` from",
) -> Cause:
    """The start is not in a set of cells: along which state it is nearest, and how far it reaches.

    All other states stay as they start; where that is nowhere in the set, its nearest state.
    """
    best: tuple[float, int, float, float] | None = None
    for k, edges in enumerate(engine.edges):
        others = tuple(j for j in range(cells.ndim) if j != k)
        places = [[*range(len(edges) - 1)] if j == k else b for j, b in enumerate(at)]
        line = cells[np.ix_(*places)].all(axis=others)
        turns = np.flatnonzero(np.diff(np.concatenate(([0], line.astype(np.int8), [0]))))
        for a, b in zip(turns[::2], turns[1::2], strict=True):
            low, high = float(edges[a]), float(edges[b])
            far = max(ends[k].high - high, low - ends[k].low, 0.0) / float(edges[-1] - edges[0])
            if best is None or far < best[0]:
                best = far, k, low, high
    if best is None:
        return _nearest(case, engine, cells)
    _, k, low, high = best
    text = f"{_value(names[k], ends[k])}; with everything else as at the start {what} "
    text += f"{names[k]} in [{low:.6g}, {high:.6g}]"
    # a border belongs to both of its sides, and the declared grid has larger cells than one that
    # was refined around this start: a whole one of those inside
    width = min(float(np.diff(engine.edges[k]).max()), (high - low) / 4)
    inside = min(max(ends[k].low, low + width), high - width)
    hint = (
        f"{_written(names[k], f'{inside:.6g}')} or further inside; an SC that is stronger or sooner"
    )
    numbers = (("low", low), ("high", high), ("inside", inside))
    return Cause("start_not_in_core", text, hint, numbers)


def _nearest(case: Case, engine: GridGroup, core: Bools) -> Cause:
    """No one state brings it there: the nearest state, in widths of the grid."""
    cells = np.argwhere(core)
    if not len(cells):
        return Cause("start_not_in_core", "no start is in time: the set is empty")
    ends = [case.problem.initial[s] for s in engine.axes]
    x = np.array([i.low / 2 + i.high / 2 for i in ends])
    low = np.stack([e[cells[:, k]] for k, e in enumerate(engine.edges)], axis=1)
    high = np.stack([e[cells[:, k] + 1] for k, e in enumerate(engine.edges)], axis=1)
    nearest = np.clip(x, low, high)
    width = np.array([e[-1] - e[0] for e in engine.edges])
    best = nearest[int(np.argmin(np.abs((nearest - x) / width).max(axis=1)))]
    names = axis_names(case, engine)
    here = ", ".join(_value(n, i) for n, i in zip(names, ends, strict=True))
    where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(names, best, strict=True))
    text = "the start is not in K: SC was not shown to keep `safe` from it "
    return Cause("start_not_in_core", f"{text}({here}); K is nearest at {where}")


def _value(name: str, start: Interval) -> str:
    until = f" to {start.high:.6g}" if start.high > start.low else ""
    return f"{name} starts at {start.low:.6g}{until}"


def _written(name: str, value: str) -> str:
    """What to write: the state's own line in its plant."""
    return f"`state {name.rpartition('.')[2]}: float = {value};` in the plant"


SLACK = 1e-6
"""Of an axis: numbers that people write down are rounded outward by so much."""
OPEN = (UNDECIDED, REFUTED)
"""A run says that something fails, and not by how much, or why SC does not come back."""
ORDER = ("ttf", "safer", "start", "P2b")
HINTS = 3
GIVEN_ALL_THE_SAME = (
    "`{}` says that AC need not get control back (P2b), not that it never does: the DM gives it "
    "wherever `safer` holds, so that has to be safe"
)


def margins(done: Sequence[Case], result: ModuleResult, budget: CpuBudget) -> None:
    """Enter margins for the first failure of every claim that is undecided."""
    searched = False
    for claim in ORDER:
        finding = result.findings[claim]
        first_failure = _failure(done, claim)
        if finding.verdict not in OPEN or first_failure is None:
            continue
        case, failure, grid = first_failure
        try:
            with _stopping(grid.engine, budget):
                finding.causes += _of_claim(case, failure, grid, budget)
            if not searched and not any(c.kind == "grid_end" for c in finding.causes):
                finding.causes[:0] = lost_at_ends(case, PointModel(case), grid, budget)
                searched = True
        except CancelledError:
            budget.leave_out()
        except (UnboundedError, StepFaultError):
            pass
        _helped(finding)
    p3, ttf, safer = (result.findings[n] for n in ("P3", "ttf", "safer"))
    if p3.verdict == UNDECIDED:
        p3.causes = list(ttf.causes or safer.causes)


def _helped(finding: Finding) -> None:
    """What was measured says what helps, in the place of a general word."""
    unsure = [c for c in finding.causes if c.kind == "grid_end" and dict(c.numbers).get("cells")]
    sure = [c for c in finding.causes if c not in unsure]
    hints = [c.hint for c in (*sure, *unsure) if c.hint][:HINTS]
    finding.hint = "; ".join(dict.fromkeys(hints)) or finding.hint


def _failure(done: Sequence[Case], claim: str) -> tuple[Case, Failure, GridProof] | None:
    """The first failure of a claim in a grid group, predicates on the declared grid."""
    for last in done:
        if last.failed(claim):
            declared = last.first if claim in ("ttf", "safer") else None
            for case in filter(None, (declared, last)):
                for failure in case.failed(claim):
                    if isinstance(failure.proof, GridProof):
                        return case, failure, failure.proof
    return None


def _of_claim(case: Case, failure: Failure, grid: GridProof, budget: CpuBudget) -> Iterator[Cause]:
    engine, part = grid.engine, grid.found
    if failure.claim in ("ttf", "safer"):
        if case.problem.computed:
            yield from _levels(case, engine, part)
        else:
            otherwise = list(scaled(case, part))
            yield from otherwise or grid_ends(case, PointModel(case), failure, grid, budget)
            yield from _inclusion(case, failure.claim, engine, part)
        if failure.claim == "safer" and (clause := case.problem.module.symbol.stays):
            yield Cause("asked_all_the_same", GIVEN_ALL_THE_SAME.format(clause))
    elif failure.claim == "start":
        yield from start_margins(case, engine, part)
    elif failure.stuck or (part.home is not None and not part.home.any()):
        yield from recovery_causes(case, failure, grid, budget)


@contextmanager
def _stopping(engine: GridGroup, budget: CpuBudget) -> Iterator[None]:
    """The engine stops when the budget ends."""
    before = engine.stop, engine.progress
    engine.stop, engine.progress = (lambda: not budget.goes_on()), None
    try:
        yield
    finally:
        engine.stop, engine.progress = before


# ---------------------------------------------------------------- `ttf` and `safer`


def _inclusion(case: Case, claim: str, engine: GridGroup, part: GroupSets) -> Iterator[Cause]:
    lets = part.lets_ac if claim == "ttf" else part.gives_back
    assert lets is not None
    assert part.free is not None
    if len(engine.axes) == 1:
        yield _where_it_must(case, claim, engine, lets & ~part.free, part.free)
    elif part.free.any():
        yield from _sooner(claim, engine, axis_names(case, engine), lets, part.free)
    core = part.core > 0
    if (lets & ~core).any():
        count = int((lets & ~core).sum())
        text = f"on {count:,} of these cells SC itself was not shown to keep C: no H would do"
        how = "holds" if claim == "ttf" else "ends"
        hint = f"a `{claim}` that {how} before SC comes too late there"
        yield Cause("outside_core", text, hint, (("cells", float(count)),))
        return
    needed = case.problem.times.horizon_ns
    least = longest(case, engine, core, needed, lambda reach: not (lets & ~reach).any())
    yield Cause(
        "horizon",
        f"as it is, `{claim}` would do for an H of {show_ns(least)}; H is {show_ns(needed)}",
        "",
        (("holds_for_s", least / 1e9), ("horizon_s", needed / 1e9)),
    )
    if not part.free.any():
        most = longest(case, engine, core, needed, lambda reach: bool(reach.any()))
        text = f"R(H) is empty: AC could leave K from everywhere; R({show_ns(most)}) is not empty"
        yield Cause("no_free", text, "less delay, or a smaller period of the DM", ())


def _sooner(
    claim: str, engine: GridGroup, names: list[str], lets: Bools, free: Bools
) -> Iterator[Cause]:
    """The least distance along one axis by which the predicate would have to hold sooner.

    Where a predicate is false on an estimate, and on all within m of it along an axis, every cell
    within m of that state's is among `lets`: whole cells k with k * width <= m. So the states from
    which AC may then have control lie in `lets` shrunk by k cells along the axis.
    """
    best: tuple[float, int, float] | None = None
    for axis, edges in enumerate(engine.edges):
        k = _least_shrinking(lets, free, axis)
        if k is not None:
            margin = k * float(np.diff(edges).max())
            share = margin / float(edges[-1] - edges[0])
            if best is None or share < best[0]:
                best = (share, axis, margin)
    if best is None:
        return
    name = names[best[1]]
    what = "hold" if claim == "ttf" else "end"
    text = f"`{claim}` would have to {what} {best[2]:.4g} sooner along {name}"
    how = "holds" if claim == "ttf" else "ends"
    hint = f"a `{claim}` that {how} {best[2]:.4g} sooner along {name}"
    yield Cause("sooner", text, hint, (("margin", best[2]), ("axis", float(best[1]))))


def _where_it_must(case: Case, claim: str, engine: GridGroup, wrong: Bools, free: Bools) -> Cause:
    """On one axis: the estimates on which the predicate must exclude AC, as numbers."""
    (edges,), name = engine.edges, axis_names(case, engine)[0]
    # cells are closed and `<` is not: what must hold at an edge must hold a little beyond it
    error = errors_of(case.problem).get(engine.axes[0], 0.0) + SLACK * float(edges[-1] - edges[0])
    ends = np.flatnonzero(np.diff(np.concatenate(([0], wrong.astype(np.int8), [0]))))
    said, numbers = [], []
    for a, b in zip(ends[::2], ends[1::2], strict=True):
        low, high = float(edges[a]) - error, float(edges[b]) + error
        if not free[:a].any():
            said.append(f"below {high:.7g}")
            numbers.append(("below", high))
        elif not free[b:].any():
            said.append(f"above {low:.7g}")
            numbers.append(("above", low))
        else:
            said.append(f"in [{low:.7g}, {high:.7g}]")
    what = "hold" if claim == "ttf" else "be false"
    text = f"`{claim}` would have to {what} on estimates of {name} {' and '.join(said[:4])}"
    how = "holds" if claim == "ttf" else "is false"
    hint = f"a `{claim}` that {how} {' and '.join(said[:4])}"
    return Cause("border", text, hint, tuple(numbers))


def _least_shrinking(lets: Bools, free: Bools, axis: int) -> int | None:
    """How many cells of an axis `lets` must shrink by to lie in `free`; the grid's ends stay."""
    cells = lets
    for k in range(1, lets.shape[axis]):
        ahead, behind = np.ones_like(cells), np.ones_like(cells)
        inner, outer = [slice(None)] * cells.ndim, [slice(None)] * cells.ndim
        inner[axis], outer[axis] = slice(1, None), slice(None, -1)
        behind[tuple(inner)] = cells[tuple(outer)]
        ahead[tuple(outer)] = cells[tuple(inner)]
        cells = cells & ahead & behind
        if not cells.any():
            return None
        if not (cells & ~free).any():
            return k
    return None


def _levels(case: Case, engine: GridGroup, part: GroupSets) -> Iterator[Cause]:
    """S_0 is empty: for which H it would not be; or only a later one is."""
    assert part.free is not None
    if part.levels and part.levels[0].any():
        count = next((j for j, s in enumerate(part.levels) if not s.any()), 0)
        if count:
            which = "S_0 is" if count == 1 else f"S_0 to S_{count - 1} are"
            text = f"{which} not empty: `levels {count + 1}` would do"
            yield Cause("levels", text, "", (("levels", float(count + 1)),))
        return
    errors = errors_of(case.problem)
    core = part.core > 0
    if not engine.erode(core, errors).any():
        yield Cause("errors", "the errors alone are as large as K", "smaller errors", ())
        return
    needed = case.problem.times.horizon_ns
    most = longest(case, engine, core, needed, lambda r: bool(engine.erode(r, errors).any()))
    text = f"for an H of {show_ns(most)} S_0 would not be empty; H is {show_ns(needed)}"
    yield Cause("horizon", text, "", (("holds_for_s", most / 1e9),))
    yield from _moved(case, engine, part)


def _moved(case: Case, engine: GridGroup, part: GroupSets) -> Iterator[Cause]:
    """A state that commands alone move through all of K within H: there no S_0 is."""
    model, seconds = PointModel(case), case.problem.times.horizon_ns / 1e9
    cells = np.argwhere(part.core > 0)
    at = cells[len(cells) // 2]
    box = case.forms.whole.copy()
    box[model.disturbances] = box[model.disturbances].mean(axis=1, keepdims=True)
    for state, edges, i in zip(engine.axes, engine.edges, at, strict=True):
        box[state] = edges[i]
    rates = None if model.is_map else case.forms.numbers("derivative", box, len(model.low))
    for k, state in enumerate(engine.axes if rates is not None else ()):
        assert rates is not None
        kept = float(engine.edges[k][cells[:, k].max() + 1] - engine.edges[k][cells[:, k].min()])
        moved = float(rates[state, 1] - rates[state, 0]) * seconds
        if moved > kept:
            text = f"what AC may command moves {model.names[state]} within H by {moved:.4g}, from "
            text += f"one end to the other, and K is {kept:.4g} wide there"
            if case.problem.module.shield is None:
                text += ": `shield n;` would look at each command, but gives control back where "
                text += "any may follow, so not here"
            hint = "a smaller set for what is commanded, or a shorter H"
            yield Cause("moved", text, hint, (("moved", moved), ("width", kept)))
