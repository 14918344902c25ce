"""What would help, measured: the fixpoint K again, and problems that are changed a little.

Purpose: the share of C that K is with other cells, a wider grid, or only a part of disturbances,
errors and delays; bounded by a clock. One `Problem` made of another, as it would
be had something else been written: merged cells, `ttf` and
`safer` left out, a smaller `max_age`, an axis without ends or a longer one, AC and SC exchanged.
There is none where that is no problem, or where the module cannot be read again from its
verification system alone (views, `abstracts`, modes, a fail-safe law).
Non-goals: verdicts: nothing here is claimed of the declared problem; which of the changes helps
(`tried_remedies.py`); changing the program's text.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate import derived_systems
from soter.language.model.durations import show_ns
from soter.language.model.least_ages import least_age_ns
from soter.verify.claims.cells import share
from soter.verify.claims.product_sets import candidates, states_elsewhere
from soter.verify.grid.group_inputs import of_problem
from soter.verify.grid.policies import HOLDS, way
from soter.verify.grid.sets import AXIS_MAX, CancelledError, GridGroup, UnboundedError
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Group, Interval

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from soter.language.model.system import Module, System
    from soter.verify.claims.case import Case
    from soter.verify.grid.claims import GridProof
    from soter.verify.grid.group_inputs import GridInputs, Range
    from soter.verify.problem.problem import Axis, Problem

    Bools = NDArray[np.bool_]
    Floats = NDArray[np.float64]


T = TypeVar("T")
PARTS = ("disturbances", "errors", "delays")
COARSE = (8_000, 40_000)
"""Cells of a group in experiments that are repeated; the second where the first show nothing."""
MOST = 1_500_000
"""Cells of any experiment."""
HALVINGS = 7
"""So often a range is halved to find where something ends."""


class CpuBudget:
    """CPU seconds that a diagnosis may take; `cut` says that something was left out."""

    def __init__(self, seconds: float, whole: CpuBudget | None = None) -> None:
        self._until = time.process_time() + seconds
        self._whole = whole
        self.cut = False

    def goes_on(self) -> bool:
        """Whether there is time left."""
        return time.process_time() < self._until

    def leave_out(self) -> None:
        """Note that something was not measured, or not to its end."""
        self.cut = True
        if self._whole is not None:
            self._whole.leave_out()

    def part(self, seconds: float) -> CpuBudget:
        """So much of what is left, at most."""
        return CpuBudget(min(seconds, self._until - time.process_time()), self)


@dataclass(frozen=True)
class ProblemChange:
    """How a problem differs.

    Cells are split in 2 ** `split` along each axis, or merged to `most`; `scale`: which part of
    what stands against SC is left; `wider`: axis -> (low, high) of a wider grid.
    """

    split: int = 0
    most: int = MOST
    scale: Mapping[str, float] = field(default_factory=dict)
    wider: Mapping[int, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class InvariantShare:
    """K of an experiment: its share of C, on which cells per axis."""

    share: float
    shape: tuple[int, ...]

    @property
    def cells(self) -> str:
        """For people."""
        return " x ".join(f"{n:,}" for n in self.shape) + " cells"


def _tried(
    case: Case,
    grid: GridProof,
    change: ProblemChange,
    budget: CpuBudget,
    ask: Callable[[GridGroup], T],
) -> T | None:
    """What is asked of a group's engine under a change; None where time or cells do not suffice."""
    engine = _engine(case, grid.engine, change, budget)
    if engine is None or not budget.goes_on():
        budget.leave_out()
        return None
    try:
        return ask(engine)
    except CancelledError:
        budget.leave_out()
    except UnboundedError:
        pass
    return None


def kept(
    case: Case,
    grid: GridProof,
    change: ProblemChange,
    budget: CpuBudget,
    *,
    declared: bool = False,
) -> InvariantShare | None:
    """K of a group of a case under a change; None where time or cells do not suffice.

    `declared`: of what lies inside of the declared grid alone.
    """

    def ask(engine: GridGroup) -> InvariantShare:
        allowed = allowed_on(case, engine)
        core = engine.core(allowed).cells
        if declared:
            allowed, core = (cells & _inside(engine, grid.engine) for cells in (allowed, core))
        whole = share(allowed, engine.edges)
        return InvariantShare(share(core, engine.edges) / whole if whole else 0.0, engine.shape)

    return _tried(case, grid, change, budget, ask)


def _inside(engine: GridGroup, declared: GridGroup) -> NDArray[np.bool_]:
    """Cells whose middle lies in another grid of the same axes, in the shape of the first."""
    inside = np.ones(engine.shape, dtype=np.bool_)
    for k, (edges, ends) in enumerate(zip(engine.edges, declared.edges, strict=True)):
        middle = edges[:-1] / 2 + edges[1:] / 2
        shape = [1] * inside.ndim
        shape[k] = -1
        inside &= ((middle > ends[0]) & (middle < ends[-1])).reshape(shape)
    return inside


def returns(
    case: Case, grid: GridProof, change: ProblemChange, budget: CpuBudget
) -> InvariantShare | None:
    """The share of K from which SC comes back to a set that it keeps inside `safer`; 0: no set.

    None where time or cells do not suffice.
    """

    def ask(engine: GridGroup) -> InvariantShare:
        allowed = allowed_on(case, engine)
        home = engine.core(definitely(case, engine, case.problem.returning) & allowed).cells
        if not home.any():
            return InvariantShare(0.0, engine.shape)
        core = engine.core(allowed).cells | home
        back = way(engine, core, allowed, home, holds=HOLDS).cells
        return InvariantShare(
            share(core & back, engine.edges) / share(core, engine.edges), engine.shape
        )

    return _tried(case, grid, change, budget, ask)


def failing(
    case: Case,
    grid: GridProof,
    predicate: str,
    change: ProblemChange,
    zone: tuple[int, float, float],
    budget: CpuBudget,
) -> tuple[int, tuple[int, ...]] | None:
    """Cells between two values of an axis on which `ttf` or `safer` fails, and the grid's shape.

    `zone`: (axis of the group, low, high). None where time or cells do not suffice, or another
    group has a part in it.
    """
    if len(case.problem.groups) > 1:
        budget.leave_out()
        return None

    def ask(engine: GridGroup) -> tuple[int, tuple[int, ...]]:
        core = engine.core(allowed_on(case, engine)).cells
        free = engine.safe_for(case.problem.in_horizon(case.problem.times.horizon_ns), core)
        lets = engine.may_fail("ttf") if predicate == "ttf" else engine.may_hold("safer")
        wrong = lets & engine.may_hold("safe") & ~free
        axis, low, high = zone
        edges = engine.edges[axis]
        inside = (edges[:-1] < high) & (edges[1:] > low)
        shape = [1] * wrong.ndim
        shape[axis] = -1
        return int((wrong & inside.reshape(shape)).sum()), engine.shape

    return _tried(case, grid, change, budget, ask)


def longest(
    case: Case, engine: GridGroup, core: Bools, until_ns: int, holds: Callable[[Bools], bool]
) -> int:
    """The longest time in ns, up to `until_ns`, for which something holds of R (it holds of K).

    core, and what `holds` is asked of: of the grid's shape.
    """
    step = case.problem.plant_period_ns if case.problem.kind == "map" else 1
    good, bad = 0, -(-case.problem.in_horizon(until_ns) // step)
    for _ in range(HALVINGS):
        middle = (good + bad) // 2
        if middle == good:
            break
        if holds(engine.safe_for(middle * step, core)):
            good = middle
        else:
            bad = middle
    return good * step


def axis_names(case: Case, engine: GridGroup) -> list[str]:
    """The states that are a group's axes, by name."""
    return [case.problem.quantities.states[s].name for s in engine.axes]


def definitely(case: Case, engine: GridGroup, predicate: str) -> NDArray[np.bool_]:
    """Cells of another grid, of its shape, where a predicate holds; other groups where it does."""
    if len(case.problem.groups) == 1:
        return engine.definitely(predicate)
    cells = np.zeros(engine.shape, dtype=np.bool_)
    for point in candidates(case.problem):
        elsewhere = states_elsewhere(case.problem, engine, point)
        cells = engine.definitely(predicate, ranges=elsewhere)
        if cells.any():
            break
    return cells


def allowed_on(case: Case, engine: GridGroup) -> NDArray[np.bool_]:
    """C_g on another grid, in its shape, the other groups where `safe` holds somewhere."""
    allowed = np.zeros(engine.shape, dtype=np.bool_)
    for point in candidates(case.problem):
        pinned = states_elsewhere(case.problem, engine, point)
        if len(case.problem.groups) == 1:
            pinned = {}
        allowed = engine.constraint(hint=case.problem.has_core_hint, ranges=pinned)
        if allowed.any():
            break
    return allowed


def _engine(
    case: Case, given: GridGroup, change: ProblemChange, budget: CpuBudget
) -> GridGroup | None:
    inputs = _scaled(of_problem(case.problem, case.parameter), change.scale)
    states = list(inputs.states)
    edges = []
    for state, e in zip(given.axes, given.edges, strict=True):
        ends = change.wider.get(state)
        if ends is not None:
            e = extended(e, *ends)  # noqa: PLW2901 - the axis as it is from here on
            states[state] = ends
        halved = split(e, change.split)
        if halved is None:
            return None
        edges.append(halved)
    if change.most < MOST:
        edges = _merged(edges, change.most)
    if np.prod([len(e) - 1 for e in edges], dtype=np.int64) > MOST:
        return None
    inputs = replace(inputs, states=tuple(states))
    axes = list(zip(given.axes, edges, strict=True))
    try:
        return GridGroup(case.forms.library, inputs, axes, stop=lambda: not budget.goes_on())
    except UnboundedError:
        return None


def split(edges: Floats, times: int) -> Floats | None:
    """Every cell of an axis halved so often; None where doubles or the engine have no room.

    (cells + 1,) -> (cells * 2^times + 1,).
    """
    for _ in range(times):
        edges = np.sort(np.concatenate([edges, edges[:-1] / 2 + edges[1:] / 2]))
    return edges if len(edges) <= AXIS_MAX and (np.diff(edges) > 0).all() else None


def extended(edges: Floats, low: float, high: float) -> Floats:
    """The same cells, and more of the size of the outermost beyond."""
    width = float(edges[1] - edges[0]), float(edges[-1] - edges[-2])
    below = np.arange(edges[0] - width[0], low - width[0] / 2, -width[0])[::-1]
    above = np.arange(edges[-1] + width[1], high + width[1] / 2, width[1])
    return np.concatenate([below, edges, above])


def _merged(edges: list[Floats], most: int) -> list[Floats]:
    """As many cells a step are merged along every axis as leave `most` of them."""
    size = float(np.prod([len(e) - 1 for e in edges], dtype=np.int64))
    step = max(1, int(np.ceil((size / most) ** (1 / len(edges)))))
    return [np.unique(np.append(e[::step], e[-1])) for e in edges]


def _scaled(inputs: GridInputs, scale: Mapping[str, float]) -> GridInputs:
    """Ranges shrunk about their middles, delays shortened."""

    def shrunk(ranges: tuple[Range, ...], p: float) -> tuple[Range, ...]:
        middles = [(a / 2 + b / 2, b / 2 - a / 2) for a, b in ranges]
        return tuple((m - p * r, m + p * r) for m, r in middles)

    late = scale.get("delays", 1.0)
    return replace(
        inputs,
        disturbances=shrunk(inputs.disturbances, scale.get("disturbances", 1.0)),
        errors=shrunk(inputs.errors, scale.get("errors", 1.0)),
        delay_ns=int(inputs.delay_ns * late),
        jitter_ns=int(inputs.jitter_ns * late),
    )


def against(case: Case) -> tuple[str, ...]:
    """Of `PARTS` those that there are."""
    inputs = of_problem(case.problem, case.parameter)
    there = (
        any(a < b for a, b in inputs.disturbances),
        any(a < b for a, b in inputs.errors),
        bool(inputs.delay_ns or inputs.jitter_ns),
    )
    return tuple(name for name, is_there in zip(PARTS, there, strict=True) if is_there)


def merged(problem: Problem, most: int) -> Problem:
    """As many cells a step are merged along every axis as leave `most` of them in each group."""
    groups = tuple(_merged_group(g, most) for g in problem.groups)
    return replace(problem, groups=groups, declared_groups=())


def predicates_left_out(problem: Problem) -> Problem | None:
    """Neither `ttf` nor `safer`."""
    if problem.computed:
        return None
    symbol = replace(problem.module.symbol, ttf=None, safer=None, topics_read=())
    return _read_again(problem, problem.system, replace(problem.module, symbol=symbol))


def younger_reads(problem: Problem) -> tuple[Problem, tuple[str, ...]] | None:
    """`max_age` of what SC and the DM read of plants, as small as it can be, and what to write."""
    told, changed = [], []
    paths = (*problem.times.schedule.read_by_sc, *problem.times.schedule.read_by_dm)
    read = {p.topic for p in paths}
    for index, topic in enumerate(problem.system.topics):
        least = least_age_ns(problem.system, index)
        if topic.name not in read or least is None or topic.max_age_ns is None:
            continue
        if topic.max_age_ns > least:
            changed.append(replace(topic, max_age_ns=least))
            told.append(f"`max_age {show_ns(least).replace(' ', '')}` of `{topic.name}`")
    if not told:
        return None
    system = derived_systems.with_changed_topics(problem.system, changed)
    again = _read_again(problem, system, problem.module)
    return None if again is None else (again, tuple(told))


def without_ends(problem: Problem, state: int) -> Problem | None:
    """The axis of a state `open`; that nothing reads the state is seen when it is tried."""
    if problem.computed or len(problem.groups) > 1 or problem.kind != "flow":
        return None
    group = problem.groups[0]
    if any(a.open or a.unbounded or a.wraps for a in group.axes) or group.representation != "grid":
        return None
    axes = tuple(_unbounded(a) if a.state == state else a for a in group.axes)
    states = list(problem.states)
    edges = next(a.edges for a in axes if a.state == state)
    states[state] = Interval(edges[0], edges[-1])
    groups = (replace(group, axes=axes),)
    return replace(problem, groups=groups, declared_groups=(), states=tuple(states))


def longer_axes(problem: Problem, ends: Mapping[int, tuple[float, float]]) -> Problem:
    """Axes with more cells of the same size; `ends`: by state, from where to where."""
    states = list(problem.states)

    def changed(axis: Axis) -> Axis:
        if axis.state not in ends:
            return axis
        edges = extended(np.array(axis.edges), *ends[axis.state])
        states[axis.state] = Interval(float(edges[0]), float(edges[-1]))
        return replace(axis, edges=tuple(edges.tolist()))

    groups = tuple(replace(g, axes=tuple(changed(a) for a in g.axes)) for g in problem.groups)
    return replace(problem, groups=groups, declared_groups=(), states=tuple(states))


def exchanged(problem: Problem) -> Problem | None:
    """AC in the place of SC."""
    m, components = problem.module, problem.system.components
    if problem.below:
        return None
    symbol = replace(m.symbol, ac=m.symbol.sc, sc=m.symbol.ac)
    roles = replace(components[m.ac], role="sc"), replace(components[m.sc], role="ac")
    system = derived_systems.with_components(problem.system, roles)
    return _read_again(problem, system, replace(m, ac=m.sc, sc=m.ac, symbol=symbol))


def _read_again(problem: Problem, system: System, module: Module) -> Problem | None:
    """The problem of a module that was changed in its own verification system.

    Grids that were changed before stay so.
    """
    whole = problem.view or problem.modes or problem.influences or problem.law
    if whole or problem.module.symbol.verify.abstracts:
        return None
    if module.shield is not None:  # what it permitted was of the other sets
        module = replace(module, shield=replace(module.shield, held=None, permits=None, moved=()))
    try:
        again = extract(derived_systems.with_module(system, module), module)
    except SoterError:
        return None
    if again.computed and any(a.unbounded for g in problem.groups for a in g.axes):
        return None  # R007
    return replace(again, groups=problem.groups, states=problem.states)


# ---------------------------------------------------------------- grids


def _size(group: Group) -> int:
    return int(np.prod([len(a.edges) - 1 for a in group.axes], dtype=np.int64))


def _merged_group(group: Group, most: int) -> Group:
    if group.representation != "grid" or _size(group) <= most:
        return group
    step = int(np.ceil((_size(group) / most) ** (1 / len(group.axes))))
    return replace(group, axes=tuple(_every(a, step) for a in group.axes))


def _every(axis: Axis, step: int) -> Axis:
    edges = axis.edges[::step]
    last = axis.edges[-1]
    return replace(axis, edges=edges if edges[-1] == last else (*edges, last))


def _unbounded(axis: Axis) -> Axis:
    width = axis.edges[-1] - axis.edges[0]
    ends = (axis.edges[0] - width, *axis.edges, axis.edges[-1] + width)
    return replace(axis, edges=ends, unbounded=True)
