"""Lists the changes that may help to prove a problem, and makes the changed problems.

Purpose: each row of `VARIATIONS` has the words for a change, the function that makes the changed
problems, the claims at which it may help, and its cost. A changed `Problem` is the one that the
changed program would have. There is none where that program poses no problem, or where the module
cannot be read again from its verification system alone (views, `abstracts`, modes, a fail-safe
law). `remedies` gives the changes for a module, and `problem_with_periods` other periods.
Non-goals: verdicts: nothing here is claimed of the declared problem; which change helps
(`tried_remedies.py`); laws, plants and predicates of another shape; changing the program's text;
fewer cells (`grid/grid_refinement.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate import derived_systems
from soter.language.elaborate.derived_systems import with_module
from soter.language.elaborate.passes.read_ages import least_age_ns
from soter.language.model.typed import Literal, RestSymbol
from soter.language.model.types import DURATION, show_ns
from soter.verify.claims.choose_cells_and_levels import CELLS_MAX
from soter.verify.diagnosis.changed_runs import NARROWER
from soter.verify.diagnosis.model_runs import TRUE, PointModel
from soter.verify.grid.grid_refinement import cell_count, finer_problem
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.tube_check import TubeCheck

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.core.layout import Floats
    from soter.language.model.system import Module, System
    from soter.verify.claims.results import LeavingRun
    from soter.verify.grid.case import Case
    from soter.verify.grid.claims import GridProof
    from soter.verify.problem.problem import Axis, Problem
    from soter.verify.tubes.problem import TubeProblem

    Ends = dict[int, tuple[float, float]]
    Change = tuple[Problem | None, str]


LONGER = (0.1, 1.0)
"""The shares by which an axis is lengthened at an end where K is lost; the second if K is empty."""
SMALL = 4
"""An axis is shortened if it is more than so many times as long as the part where `safe` holds."""
CALMER = "disturbances and errors {}"
BEYOND = 0.01
"""The distance beyond an axis's end at which `safe` is evaluated, as a share of the axis."""


@dataclass(frozen=True)
class NotProved:
    """A module that is not proved, with its failing claims; `done` has the cases as declared."""

    problem: Problem
    """The problem with the changes that helped so far."""
    failing: Sequence[str]
    done: Sequence[Case]
    leaving: LeavingRun | None
    of_sc: bool = False
    """Whether runs show a fault of SC itself, so that no other grid, age or world helps."""

    @property
    def is_core_empty(self) -> bool:
        """Whether K is empty; all other claims depend on K."""
        return self.failing[0] == "P2a"


@dataclass(frozen=True)
class Variation:
    """A kind of change that `VARIATIONS` lists, with its advice, its cost and when it may help."""

    advice: str
    """The words that say what to write; `{}` stands for the words of the single change."""
    changes: Callable[[NotProved], Iterator[Change]]
    without_core: bool
    """Whether it may help where K is empty."""
    with_core: bool
    """Whether it may help where K is not empty and another claim fails."""
    cost: int = 0
    """Cheaper changes are tried first, and of equal ones those with few cells."""


@dataclass(frozen=True)
class Remedy:
    """A change of a module: advice on what to write, and the changed problem."""

    advice: str
    problem: Problem
    cost: int


def remedies(found: NotProved) -> Iterator[Remedy]:
    """Gives the changes listed in `VARIATIONS` that may help where these claims fail."""
    for row in VARIATIONS:
        if found.of_sc and row.cost != OTHERS:
            continue
        if row.without_core if found.is_core_empty else row.with_core:
            for problem, text in row.changes(found):
                if problem is not None:
                    yield Remedy(row.advice.format(text), problem, row.cost)


def _longer_axes(found: NotProved) -> Iterator[Change]:
    """Changes that lengthen axes at ends where K loses cells although `safe` holds beyond."""
    for part in LONGER if found.is_core_empty else LONGER[:1]:
        longer = problem_with_ends(found.problem, _longer_ends(found, part))
        if longer.groups != found.problem.groups and cell_count(longer) <= CELLS_MAX["P2a"]:
            yield longer, grid_lines_of(longer)


def _longer_ends(found: NotProved, part: float) -> Ends:
    """New ends of axes, by state, further out by the share `part` where K is lost or a run left."""
    ends: Ends = {}

    def lengthen(state: int, edges: Sequence[float], side: int) -> None:
        more = (edges[-1] - edges[0]) * part
        low, high = ends.get(state, (edges[0], edges[-1]))
        ends[state] = (low, high + more) if side else (low - more, high)

    left = found.leaving
    by = None if left is None else (left.names.index(left.axis), left.side > 0)
    for grid, case in _declared_grids(found.done):
        for k, side in _losing_ends(PointModel(case), grid):
            axis = grid.group.axes[k]
            if by is None or by == (axis.state, side > 0):
                lengthen(axis.state, axis.edges, side)
    return ends


def _declared_grids(done: Sequence[Case]) -> Iterator[tuple[GridProof, Case]]:
    """Gives the declared grid of each group, with its case, for all cases."""
    for case in (last.first or last for last in done):
        for proof in case.proofs:
            yield proof, case


def _losing_ends(model: PointModel, grid: GridProof) -> list[tuple[int, int]]:
    """The ends (axis number, 1 if high) where K loses cells although `safe` holds beyond."""
    sides = []
    lost = grid.found.allowed & ~(grid.found.core > 0)
    for k, axis in enumerate(grid.group.axes):
        if axis.open or axis.unbounded or axis.wraps:
            continue
        far = (axis.edges[-1] - axis.edges[0]) * BEYOND
        for side, end in ((0, axis.edges[0] - far), (1, axis.edges[-1] + far)):
            at = np.argwhere(np.take(lost, -side, axis=k))
            for cell in at[[0, len(at) // 2, -1]] if len(at) else ():
                x, place = model.start, np.insert(cell, k, 0)
                for a, edges, i in zip(grid.group.axes, grid.engine.edges, place, strict=True):
                    x[a.state] = (edges[i] + edges[i + 1]) / 2
                x[axis.state] = end
                if model.safe(x) == TRUE:
                    sides.append((k, side))
                    break
    return sides


def _shorter_axes(found: NotProved) -> Iterator[Change]:
    """A change that shortens each axis on which `safe` holds only in a small part."""
    ends: Ends = {}
    for grid, _ in _declared_grids(found.done):
        for k, axis in enumerate(grid.group.axes):
            cells = np.moveaxis(grid.found.allowed, k, 0).reshape(len(axis.edges) - 1, -1)
            at = np.flatnonzero(cells.any(axis=1))
            if len(at) and SMALL * (at[-1] - at[0] + 1) < len(cells):
                low, high = max(at[0] - 1, 0), min(at[-1] + 2, len(cells))
                ends[axis.state] = axis.edges[low], axis.edges[high]
    shorter = problem_with_ends(found.problem, ends)
    if shorter.groups != found.problem.groups:
        yield shorter, grid_lines_of(shorter)


def _opened_axis(found: NotProved) -> Iterator[Change]:
    """A change to `open` of the axis through whose end a run leaves the grid."""
    left = found.leaving
    if left is not None and not left.safe:
        opened = problem_with_open_axis(found.problem, left.names.index(left.axis))
        yield opened, "" if opened is None else grid_lines_of(opened)


def _predicates_left_out(found: NotProved) -> Iterator[Change]:
    yield problem_without_predicates(found.problem), ""


def _return_left_out(found: NotProved) -> Iterator[Change]:
    problem, symbol = found.problem, found.problem.module.symbol
    if problem.computed and not symbol.stay_clause and "P2b" in found.failing:
        verify = replace(symbol.verify, stays=symbol.span, recover=None)
        module = replace(problem.module, symbol=replace(symbol, verify=verify))
        yield _extract_again(problem, problem.system, module), ""


def why_no_rest(problem: Problem) -> str:
    """Why no proof by tubes can follow SC, whatever `rest` says, in words; "" if one can."""
    symbol = problem.module.symbol
    if problem.kind != "flow" or symbol.shield:
        return "it is of plants that flow, and of modules without `shield`"
    at = symbol.safe.span
    anything = RestSymbol(symbol.safe, (), Literal(DURATION, at, problem.module.period_ns), at)
    symbol = replace(symbol, rest=anything, ttf=None, safer=None, topics_read=())
    module = replace(problem.module, symbol=symbol)
    try:
        TubeCheck(cast("TubeProblem", problem_of_changed_module(problem.system, module)))
    except SoterError as error:
        return error.diagnostics[0].message.rpartition("by tubes, and ")[2]
    return ""


def _younger_reads(found: NotProved) -> Iterator[Change]:
    younger = problem_with_younger_reads(found.problem)
    if younger is not None:
        yield younger[0], " and ".join(younger[1])


def _nearer_start(found: NotProved) -> Iterator[Change]:
    """The change to the nearest start from which SC acts in time."""
    if "start" not in found.failing:
        return
    initial, texts = list(found.problem.initial), []
    for grid, case in _declared_grids(found.done):
        for state, value in _nearest_starts(case, grid):
            initial[state] = Interval(value, value)
            name = case.problem.quantities.states[state].name.rpartition(".")[2]
            texts.append(f"`state {name}: float = {value:.6g};` in the plant")
    if texts:
        yield replace(found.problem, initial=tuple(initial)), " and ".join(dict.fromkeys(texts))


def _nearest_starts(case: Case, grid: GridProof) -> Iterator[tuple[int, float]]:
    """The nearest start: the few states that it changes, each as (state, new value)."""
    times, engine = case.problem.times, grid.engine
    in_time = engine.cells_safe_for(case.problem.whole_periods(times.start), grid.found.core > 0)
    cells = np.argwhere(in_time)
    if not len(cells):
        return
    ends = [case.problem.initial[s] for s in engine.axes]
    x = np.array([i.low / 2 + i.high / 2 for i in ends])
    low = np.stack([e[cells[:, k]] for k, e in enumerate(engine.edges)], axis=1)
    high = np.stack([e[cells[:, k] + 1] for k, e in enumerate(engine.edges)], axis=1)
    # a border belongs to both of its sides
    inside = np.clip(x, 0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high)
    moved = np.where((x >= low) & (x <= high), x, inside)
    far = np.abs(moved - x) / np.array([e[-1] - e[0] for e in engine.edges])
    best = np.lexsort((far.max(axis=1), (far > 0.0).sum(axis=1)))[0]
    for k in np.flatnonzero(far[best] > 0.0):
        yield engine.axes[k], float(f"{moved[best, k]:.6g}")


def _more_cells(found: NotProved) -> Iterator[Change]:
    smaller = replace(finer_problem(found.problem, found.problem.groups), declared_groups=())
    if cell_count(smaller) <= CELLS_MAX["P2a"]:
        yield smaller, grid_lines_of(smaller)


def _narrower_disturbances(found: NotProved) -> Iterator[Change]:
    """Changes to narrower disturbances and errors, to see whether these or SC cause the failure."""
    p = found.problem

    def narrowed(ranges: tuple[Interval, ...], by: float) -> tuple[Interval, ...]:
        near, far = 0.5 + by / 2, 0.5 - by / 2
        return tuple(
            Interval(near * i.low + far * i.high, far * i.low + near * i.high) for i in ranges
        )

    for by, text in NARROWER.items() if not p.influences else ():
        changed = replace(
            p, disturbances=narrowed(p.disturbances, by), errors=narrowed(p.errors, by)
        )
        if (changed.disturbances, changed.errors) != (p.disturbances, p.errors):
            yield changed, text


def _exchanged_controllers(found: NotProved) -> Iterator[Change]:
    """The change that exchanges AC and SC, if a run of SC leaves `safe`."""
    if found.leaving is not None and found.leaving.safe:
        symbol = found.problem.module.symbol
        yield (
            problem_with_exchanged_controllers(found.problem),
            f"ac {symbol.sc.name}; sc {symbol.ac.name};",
        )


CELLS, HALF, OTHERS = 1, 2, 3
"""Costs above 0: for other cells, for a narrower world, for another controller in flight."""
VARIATIONS = (
    Variation("a shorter axis: `{}`", _shorter_axes, without_core=True, with_core=True),
    Variation("a longer axis: `{}`", _longer_axes, without_core=True, with_core=True, cost=CELLS),
    Variation("no ends where runs leave: `{}`", _opened_axis, without_core=True, with_core=False),
    Variation(
        "neither `ttf` nor `safer`: left out, both are computed",
        _predicates_left_out,
        without_core=False,
        with_core=True,
    ),
    Variation(
        "`recover never`, if it may stay where SC stops",
        _return_left_out,
        without_core=True,
        with_core=False,
    ),
    Variation("{}", _younger_reads, without_core=True, with_core=True),
    Variation("{}", _nearer_start, without_core=False, with_core=True),
    Variation("more cells: `{}`", _more_cells, without_core=False, with_core=True, cost=CELLS),
    Variation(CALMER, _narrower_disturbances, without_core=True, with_core=True, cost=HALF),
    Variation(
        "`{}`, if that is what was meant",
        _exchanged_controllers,
        without_core=True,
        with_core=False,
        cost=OTHERS,
    ),
)


def problem_without_predicates(problem: Problem) -> Problem | None:
    """The problem with `ttf` and `safer` computed, not declared; None if no problem results."""
    if problem.computed:
        return None
    symbol = replace(problem.module.symbol, ttf=None, safer=None, topics_read=())
    return _extract_again(problem, problem.system, replace(problem.module, symbol=symbol))


def problem_with_younger_reads(problem: Problem) -> tuple[Problem, tuple[str, ...]] | None:
    """The problem with the least `max_age` of what SC and DM read, and the texts, or None."""
    texts, changed = [], []
    paths = (*problem.times.schedule.read_by_sc, *problem.times.schedule.read_by_dm)
    read = {p.topic for p in paths}
    for index, topic in enumerate(problem.system.topics):
        least = least_age_ns(problem.system, index)
        if topic.name not in read or least is None or topic.max_age_ns is None:
            continue
        if topic.max_age_ns > least:
            changed.append(replace(topic, max_age_ns=least))
            texts.append(f"`max_age {show_ns(least).replace(' ', '')}` of `{topic.name}`")
    if not texts:
        return None
    system = derived_systems.with_changed_topics(problem.system, changed)
    again = _extract_again(problem, system, problem.module)
    return None if again is None else (again, tuple(texts))


def problem_with_younger_sc_reads(problem: Problem) -> tuple[Problem, str] | None:
    """The problem with the least `age` of SC's reads, and its text; None if the age is not lower.

    The least age is at least the publisher's period, though phases may make reads younger.
    """
    schedule, verify = problem.times.schedule, problem.module.symbol.verify
    ages = (max(schedule.stamp_age_sc(p), p.last_station.period) for p in schedule.read_by_sc)
    least = max(ages, default=0)
    if not any((p.max_age or 0) > least for p in schedule.read_by_sc):
        return None
    age = Literal(DURATION, verify.span or problem.module.symbol.span, least)
    symbol = replace(problem.module.symbol, verify=replace(verify, age=age))
    again = _extract_again(problem, problem.system, replace(problem.module, symbol=symbol))
    text = f"`verify {{ age {show_ns(least).replace(' ', '')}; }}`"
    return None if again is None else (again, text)


def problem_with_open_axis(problem: Problem, state: int) -> Problem | None:
    """The problem with the axis of a state `open`; a trial shows whether something reads it."""
    if problem.computed or len(problem.groups) > 1 or problem.kind != "flow":
        return None
    group = problem.groups[0]
    if any(a.open or a.unbounded or a.wraps for a in group.axes):
        return None
    axes = tuple(_unbounded_axis(a) if a.state == state else a for a in group.axes)
    states = list(problem.states)
    edges = next(a.edges for a in axes if a.state == state)
    states[state] = Interval(edges[0], edges[-1])
    groups = (replace(group, axes=axes),)
    return replace(problem, groups=groups, declared_groups=(), states=tuple(states))


def extended_edges(edges: Floats, low: float, high: float) -> Floats:
    """Edges (cells + 1,) with more cells, as large as the outermost ones, from `low` to `high`."""
    width = float(edges[1] - edges[0]), float(edges[-1] - edges[-2])
    below = np.arange(edges[0] - width[0], low - width[0] / 2, -width[0])[::-1]
    above = np.arange(edges[-1] + width[1], high + width[1] / 2, width[1])
    return np.concatenate([below, edges, above])


def problem_with_ends(problem: Problem, ends: Mapping[int, tuple[float, float]]) -> Problem:
    """The problem with other ends of the axes of some states.

    A longer axis gets more cells of the same size; a shorter axis keeps its number of cells.
    """
    states = list(problem.states)

    def moved_axis(axis: Axis) -> Axis:
        if axis.state not in ends:
            return axis
        low, high = ends[axis.state]
        edges = extended_edges(np.array(axis.edges), low, high)
        if low > axis.edges[0] or high < axis.edges[-1]:
            edges = np.linspace(low, high, len(axis.edges))
        states[axis.state] = Interval(float(edges[0]), float(edges[-1]))
        return replace(axis, edges=tuple(edges.tolist()))

    groups = tuple(replace(g, axes=tuple(moved_axis(a) for a in g.axes)) for g in problem.groups)
    return replace(problem, groups=groups, declared_groups=(), states=tuple(states))


def problem_with_exchanged_controllers(problem: Problem) -> Problem | None:
    """The problem with AC and SC exchanged; None if no valid problem results."""
    m, components = problem.module, problem.system.components
    symbol = replace(m.symbol, ac=m.symbol.sc, sc=m.symbol.ac)
    roles = replace(components[m.ac], role="sc"), replace(components[m.sc], role="ac")
    system = derived_systems.with_components(problem.system, roles)
    return _extract_again(problem, system, replace(m, ac=m.sc, sc=m.ac, symbol=symbol))


def problem_of_changed_module(system: System, changed: Module) -> Problem:
    """The problem of a module changed in its system; raises `SoterError` as `extract` does."""
    return extract(with_module(system, changed), changed)


def _extract_again(problem: Problem, system: System, module: Module) -> Problem | None:
    """The problem of a changed module in its verification system, on the changed grids; or None."""
    whole = problem.view or problem.modes or problem.influences or problem.law
    if whole or problem.module.symbol.verify.abstracts:
        return None
    if module.shield is not None:  # what it permitted was of the other sets
        module = replace(module, shield=replace(module.shield, held=None, permits=None, moved=None))
    try:
        again = problem_of_changed_module(system, module)
    except SoterError:
        return None
    if again.computed and any(a.unbounded for g in problem.groups for a in g.axes):
        return None  # R007
    return replace(again, groups=problem.groups, states=problem.states)


def _unbounded_axis(axis: Axis) -> Axis:
    width = axis.edges[-1] - axis.edges[0]
    ends = (axis.edges[0] - width, *axis.edges, axis.edges[-1] + width)
    return replace(axis, edges=ends, unbounded=True)


def grid_lines_of(problem: Problem) -> str:
    """The `grid` lines of a program that declare the problem's grid."""
    return " ".join(f"grid {', '.join(_axis_in_words(a) for a in g.axes)};" for g in problem.groups)


def _axis_in_words(axis: Axis) -> str:
    edges = axis.edges[1:-1] if axis.unbounded else axis.edges
    edges = edges[:-1] if axis.open else edges
    low, high = map(axis.end_in_words, (edges[0], edges[-1]))
    text = f"{axis.name} in [{low}, {high}] / {len(edges) - 1}"
    if axis.open:
        return f"{text} open to {axis.end_in_words(axis.edges[-1])}"
    return f"{text} open" if axis.unbounded else text


def problem_with_periods(problem: Problem, delta_ns: int, sc_ns: int) -> Problem:
    """The problem with another Delta and another period of SC, but with the same phases.

    The error of the plant's scheme stays, because it depends on the plant's step.
    """
    times, was = problem.times, problem.times.schedule
    dm, sc = replace(was.dm, period=delta_ns), replace(was.sc, period=sc_ns)
    schedule = replace(was, dm=dm, sc=sc)
    law = problem.law
    if law is not None:
        law = replace(law, times=replace(law.times, schedule=schedule))
    return replace(problem, times=replace(times, schedule=schedule), law=law)
