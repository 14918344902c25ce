"""A synthesised table keeps its core whatever is estimated; the way to Q takes no longer than
claimed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify.find_sc import SynthesizedCommands, _Synthesis, core_synthesis
from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.recovery import recovery_ranks
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.grid_adversary import Runs
from unit.verify.grid.small_enclosure_units import corner, hill
from unit.verify.grid.test_grid_enclosures import CARS, MS, group_of
from unit.verify.grid.test_grid_sets import drawn, inside

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

COMMANDS = [[-1.0], [0.0], [1.0]]
X, V = (-0.5, 0.5), (-0.6, 0.6)


def engine() -> GridGroup:
    inputs = GridInputs(states=(X, V), controls=((-1.0, 1.0),), kind="map", period_ns=100 * MS)
    edges = [np.linspace(*X, 122), np.linspace(*V, 91)]
    return GridGroup(hill(1.0, 2.0), inputs, list(enumerate(edges)))


def entry(group: GridGroup, estimate: Floats) -> tuple[npt.NDArray[np.int64], ...]:
    """The cell [low, high) of an estimate, the last one closed; clipped to the grid."""
    return tuple(
        np.clip(np.searchsorted(e, estimate[a], side="right") - 1, 0, len(e) - 2)
        for a, e in enumerate(group.edges)
    )


def run(
    group: GridGroup, table: SynthesizedCommands, errors: dict[int, float], steps: int
) -> tuple[int, int]:
    """Runs from K under the table, errors at their bounds: how many leave K, how many find no
    entry. Estimates outside the grid read its last cell."""
    rng = np.random.default_rng(1)
    x, _ = drawn(group, table.cells, rng, 20000)
    left = missing = 0
    for _ in range(steps):
        bounds = [errors.get(a, 0.0) for a in range(2)]
        error = np.stack([corner(rng, -e, e, (x.shape[1],)) for e in bounds])
        choice = table.choice[entry(group, x + error)]
        missing += int((choice == 255).sum())
        u = table.commands[np.minimum(choice, len(COMMANDS) - 1), 0]
        v = np.clip(x[1] + 0.1 * u - 0.05 * x[0], -0.5, 0.5)
        x = np.stack([x[0] + v, v])
        stays = inside(group, table.cells, x)
        left += int((~stays).sum())
        x = x[:, stays]
    return left, missing


def test_the_table_keeps_the_core() -> None:
    group = engine()
    table = core_synthesis(group, np.ones(group.shape, dtype=bool), COMMANDS)
    assert 0.2 < table.cells.mean() < 0.9
    assert run(group, table, {}, 4) == (0, 0)


def test_a_table_that_forgets_the_error_is_found_out() -> None:
    group = engine()
    table = core_synthesis(group, np.ones(group.shape, dtype=bool), COMMANDS)
    left, missing = run(group, table, {1: 0.14}, 4)
    assert left > 0
    assert missing > 0


@pytest.mark.parametrize("axis", [0, 1])
def test_an_estimate_on_a_face_serves_the_cell_below_beside_its_own(axis: int) -> None:
    group = engine()
    work = _Synthesis(group, np.ones(group.shape, dtype=bool), np.array(COMMANDS))
    kept = np.zeros(group.shape, dtype=bool)
    own, below = [60, 60], [60, 60]
    below[axis] -= 1
    kept[tuple(below)] = True
    work.fine[:] = 0
    work.fine[tuple(own)], work.fine[tuple(below)] = 1, 2
    assert work.masks_by_estimate(kept)[tuple(own)] == 2  # of a cell outside of K only the face
    kept[tuple(own)] = True
    assert work.masks_by_estimate(kept)[tuple(own)] == 1


@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("in_turns", [False, True])
def test_the_way_back_takes_no_longer_than_claimed(number: int, *, in_turns: bool) -> None:
    c = CARS[number]
    group = group_of(c, cells=121)
    allowed = group.compute_constraint()
    core = group.compute_core(allowed, longest=80).cells
    middle = np.abs(group.edges[0][:-1] + group.edges[0][1:]) < 1.4
    rates = np.abs(group.edges[1][:-1] + group.edges[1][1:]) < 1.6
    goal = core & middle[:, None] & rates[None, :]
    first = recovery_ranks(group, core, allowed, goal, holds=(2, 5)) if in_turns else None
    way_back = recovery_ranks(group, core, allowed, goal, before=first)
    if first is not None:
        before = first.cells
        assert 0.1 * core.sum() < before.sum() < way_back.cells.sum()
        assert np.array_equal(way_back.rank[before], first.rank[before])
        assert way_back.rank[way_back.cells & ~before].min() > first.rank.max()
        assert np.array_equal(way_back.cells, recovery_ranks(group, core, allowed, goal).cells)
    assert np.array_equal(way_back.rank == 1, goal)
    assert (way_back.cells & core).sum() > 0.98 * core.sum()
    rng = np.random.default_rng(6)
    start, at = drawn(group, way_back.cells & ~goal, rng, 1500)
    limit = way_back.time_ns[at[:, 0], at[:, 1]] * 1e-9
    assert 0 < limit.max() <= way_back.longest_ns * 1e-9
    back = np.zeros(start.shape[1], dtype=bool)
    runs = Runs(c, start, rng)
    for _, x, _met in runs.holds(int(limit.max() / c.period) + 1):
        back |= inside(group, goal, x) & (runs.time <= limit + 1e-9)
    assert back.all()
