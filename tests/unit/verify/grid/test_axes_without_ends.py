"""Cells without an outer end: what is said of them holds of every state that they hold.

The engine against runs that know nothing of it, with all choices at their bounds, from places up
to a kilometre beyond the breakpoints; and plants that move far through cells of another kind.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.passive_program import FALLING, PASSIVE
from soter.language.front_end import check_file, system_of
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.grid.sets import GridGroup
from soter.verify.problem.extract import extract
from unit.verify.grid.small_enclosure_units import safe_in_pieces

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.verify.problem.problem import Problem

    Floats = npt.NDArray[np.float64]

A, W, SLOPE, REST, ERROR = 2.5, 1.0, 0.05, 0.15, 0.01
FAR = (0.0, 0.5, 7.0, 1000.0)


def problem_of(text: str) -> Problem:
    checked = check_file("rover.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return extract(flat, flat.modules[0])


def engine_of(text: str) -> tuple[GridGroup, Problem]:
    problem = problem_of(text)
    return GridGroup.for_group(library_of(problem)[0], problem, problem.groups[0]), problem


@pytest.fixture(scope="module")
def rover() -> tuple[GridGroup, Problem]:
    return engine_of(PASSIVE)


def corners(engine: GridGroup, cells: npt.NDArray[np.bool_]) -> Floats:
    """Corners (2, n) of cells at the border of a set, those of outer cells moved outwards, too."""
    gaps, speeds = engine.spans[0].copy(), engine.edges[1]
    gaps[0], gaps[-1] = engine.edges[0][0], engine.edges[0][-1]
    found = []
    for k in range(len(speeds) - 1):
        rows = np.flatnonzero(cells[:, k])
        if not rows.size:
            continue
        for v in speeds[k : k + 2]:
            found += [(gaps[rows[0]] + 1e-9, v), (gaps[rows[-1] + 1], v)]
            if rows[-1] == len(gaps) - 2:
                found += [(gaps[-1] + far, v) for far in FAR]
            if rows[0] == 0:
                found += [(gaps[0] - far, v) for far in FAR]
    points: Floats = np.array(found, dtype=np.float64).T
    return points


class Walkers:
    """SC-runs of many rovers at once by the formulas of constant acceleration; x is (2, n)."""

    def __init__(self, start: Floats, problem: Problem) -> None:
        times = problem.times
        self.x, self.wrong = start.copy(), np.zeros(start.shape[1], dtype=bool)
        self.delta, self.delay = times.delta_sc * 1e-9, times.delay_sc * 1e-9
        self.jitter = times.jitter_sc * 1e-9
        self.past = [self.x[1]]

    def move(self, u: Floats, walks: Floats, slope: Floats, span: Floats) -> None:
        """Over a span, in eight pieces, each looked at."""
        for _ in range(8):
            h, a = span / 8, u + slope
            self.x[0] += walks * h - self.x[1] * h - a * h * h / 2
            self.x[1] += a * h
            self.wrong |= (self.x[0] <= 0.0) & (np.abs(self.x[1]) >= REST)


def law(v: Floats) -> Floats:
    return np.asarray(np.clip(-4.0 * v, -A, A))


def run(walkers: Walkers, choices: list[Floats], before: Floats) -> None:
    """One hold for each of `choices`: (walks, slope, error, late, jitter), each +-1, (5, n).

    The read of hold 0 is d old, while `before` acted; of later ones it is of a_k or, where late,
    of `d` before, by the command that acted then, which is the last one as d is about a period.
    """
    v = walkers.x[1]
    late = (choices[0][3] + 1) / 2 * walkers.delay
    read = v - (before + choices[0][1] * SLOPE) * late
    shift = np.zeros_like(v)
    for k, (walks, slope, error, late_, jitter) in enumerate(choices):
        u = law(read + error * ERROR)
        following = choices[k + 1] if k + 1 < len(choices) else choices[k]
        moved = (jitter + 1) / 2 * walkers.jitter
        span = walkers.delta + moved - shift
        shift = moved
        back = np.minimum((following[3] + 1) / 2 * walkers.delay, span)
        walkers.move(u, walks * W, slope * SLOPE, span - back)
        read = walkers.x[1].copy()
        walkers.move(u, walks * W, slope * SLOPE, back)
        del late_


SIGNS = np.array(list(product((-1.0, 1.0), repeat=5))).T  # (5, 32)


def every_choice(start: Floats, holds: int) -> tuple[Floats, list[Floats]]:
    """Each start with every sequence of choices: the starts, and the choices hold by hold."""
    count = SIGNS.shape[1] ** holds
    at = np.arange(count)
    hold = [SIGNS[:, (at // SIGNS.shape[1] ** k) % SIGNS.shape[1]] for k in range(holds)]
    n = start.shape[1]
    return np.repeat(start, count, axis=1), [np.tile(c, (1, n)) for c in hold]


def test_every_choice_from_the_border_of_k_keeps_safe(rover: tuple[GridGroup, Problem]) -> None:
    engine, problem = rover
    start = corners(engine, engine.compute_core(engine.compute_constraint()).cells)
    some = start[:, np.linspace(0, start.shape[1] - 1, 60).astype(int)]
    for before in (-A, A):
        starts, choices = every_choice(some, 3)
        walkers = Walkers(starts, problem)
        run(walkers, choices, np.full(starts.shape[1], before))
        assert not walkers.wrong.any(), starts[:, walkers.wrong][:, :3]


def test_long_runs_from_k_and_from_beyond_keep_safe(rover: tuple[GridGroup, Problem]) -> None:
    engine, problem = rover
    start = corners(engine, engine.compute_core(engine.compute_constraint()).cells)
    assert (start[0] >= 1000.0).any()
    assert (start[0] <= -1000.0).any()
    assert missed(start, problem, holds=300) == 0


def test_the_runs_would_show_what_is_no_part_of_k(rover: tuple[GridGroup, Problem]) -> None:
    """From 0.45 m nearer than K reaches some are hit."""
    engine, problem = rover
    start = corners(engine, engine.compute_core(engine.compute_constraint()).cells)
    nearer = start[:, (start[0] > 0.5) & (start[0] < 5.0)] - [[0.45], [0.0]]
    assert missed(nearer, problem, holds=60) > 0


def missed(start: Floats, problem: Problem, holds: int) -> int:
    """How many runs from these states leave `safe`, under habits and at random."""
    rng = np.random.default_rng(7)
    starts = np.repeat(start, 12, axis=1)
    n = starts.shape[1]
    towards = rng.random(n) < 0.5  # somebody who walks into it all the way
    same = rng.choice((-1.0, 1.0), (5, n))
    steady = rng.random(n) < 0.5
    walkers = Walkers(starts, problem)
    choices = []
    for _ in range(holds):
        drawn = np.where(steady, same, rng.choice((-1.0, 1.0), (5, n)))
        drawn[0] = np.where(towards, -1.0, drawn[0])
        choices.append(drawn)
    run(walkers, choices, np.where(rng.random(n) < 0.5, A, -A))
    return int(walkers.wrong.sum())


def test_whatever_ac_does_for_h_leaves_it_in_k(rover: tuple[GridGroup, Problem]) -> None:
    engine, problem = rover
    core = engine.compute_core(engine.compute_constraint()).cells
    horizon = problem.times.horizon_ns * 1e-9
    start = corners(engine, engine.cells_safe_for(problem.times.horizon_ns, core))
    rng = np.random.default_rng(3)
    starts = np.repeat(start, 40, axis=1)
    walkers, n = Walkers(starts, problem), starts.shape[1]
    steady = rng.choice((-1.0, 1.0), (3, n))
    for _ in range(4):
        now = np.where(rng.random(n) < 0.5, steady, rng.choice((-1.0, 1.0), (3, n)))
        walkers.move(A * now[0], W * now[1], SLOPE * now[2], np.full(n, horizon / 4))
        assert inside(engine, core, walkers.x).all()
    outwards = start[:, np.abs(start[0]) < 5.0] - [[0.3], [0.0]]
    walkers = Walkers(outwards, problem)
    u = np.full(outwards.shape[1], A)
    walkers.move(u, -W * u / A, SLOPE * u / A, np.full(outwards.shape[1], horizon))
    assert not inside(engine, core, walkers.x).all()


def inside(engine: GridGroup, cells: npt.NDArray[np.bool_], x: Floats) -> npt.NDArray[np.bool_]:
    """Whether states (2, n) lie in a set; one on an edge lies in both cells."""
    at = []
    for edges, value in zip(engine.edges, x, strict=True):
        clipped = np.clip(value, edges[0] + 1e-12, edges[-1] - 1e-12)
        at.append(np.clip(np.searchsorted(edges, clipped, side="right") - 1, 0, len(edges) - 2))
    return np.asarray(cells[at[0], at[1]])


# ---------------------------------------------------------------- from far away


def test_a_cell_without_an_end_is_judged_by_its_farthest_states() -> None:
    """From 5 to 10 it comes down in time, from 20 it is too fast before: none of it is in K."""
    engine, _ = engine_of(FALLING)
    allowed = engine.compute_constraint()
    core = engine.compute_core(allowed).cells
    speeds = engine.edges[1]
    slow = int(np.searchsorted(speeds, 0.0))
    assert allowed[-1, slow]
    assert not core[-1, :].any()
    assert core[1, slow]


def test_under_any_command_it_is_judged_by_them_as_well() -> None:
    engine, _ = engine_of(FALLING)
    target = engine.compute_constraint()
    free = safe_in_pieces(engine, 4_000_000_000, target, 64)
    slow = int(np.searchsorted(engine.edges[1], 0.0))
    assert not free[-1, slow:].any()
    assert free[1, slow]


def test_on_the_way_they_count_as_well() -> None:
    """What is near has come down before 2 < v < 2.4, which is not allowed of what is far."""
    engine, _ = engine_of(FALLING)
    allowed = np.ones(engine.shape, dtype=bool)
    speeds = engine.edges[1]
    allowed[-1, np.searchsorted(speeds, 2.05) : np.searchsorted(speeds, 2.35)] = False
    core = engine.compute_core(allowed).cells
    slow, fast = (int(np.searchsorted(speeds, v)) for v in (0.0, 3.0))
    assert not core[-1, slow]
    assert core[-1, fast], "it is past that"
    assert core[1, slow]


def test_predicates_are_looked_at_all_the_way_out() -> None:
    """Up to 30, which the breakpoints of the last cell, 5 and 10, do not show."""
    near, everywhere = (
        engine_of(FALLING.replace("safe seen.x < 5.0 ||", f"safe seen.x < {end} ||"))[
            0
        ].compute_constraint()
        for end in ("30.0", "1e302")
    )
    fast = -1
    assert not near[-1, fast]
    assert near[-2, fast]
    assert everywhere[-1, fast]


@pytest.mark.parametrize("seed", range(5))
def test_estimates_of_what_lies_beyond_are_those_of_the_outer_cells(
    seed: int, rover: tuple[GridGroup, Problem]
) -> None:
    """A state whose estimate is in an eroded set is in the set, wherever beyond the ends it is."""
    engine, _ = rover
    chance = np.random.default_rng(seed)
    edges = engine.edges[0]
    cells = chance.random(engine.shape) < 0.97
    cells[0], cells[-1] = chance.random(2) < 0.5
    error = 0.37 * (edges[2] - edges[1]) * (1 + seed)
    eroded = engine.erode(cells, {engine.axes[0]: error})

    def at(x: Floats) -> npt.NDArray[np.int64]:
        return np.clip(np.searchsorted(edges, x, side="right") - 1, 0, engine.shape[0] - 1)

    width = edges[-1] - edges[0]
    places = np.concatenate([chance.uniform(edges[0] - width, edges[-1] + width, 400), FAR])
    places = np.concatenate([places, edges[-1] + np.array([0.0, 1e6, 2.0**90]), edges])
    states = np.concatenate([places + e for e in (-error, -error / 2, 0.0, error / 2, error)])
    estimates = np.tile(places, 5)
    let = eroded[at(estimates)]
    assert let.any()
    assert not let.all()
    assert (~let | cells[at(states)]).all()
