"""Where commands act later than half a period, enclosures contain every run of late commands."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from tables import all_rows
from unit.verify.grid.small_enclosure_units import car, corner, linear, linear_source, pendulum
from unit.verify.time.late_sc_runs import LateRuns

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

MS = 1_000_000
SLACK = 1e-9
"""Of RK4 with its small steps."""
RUNS, BOXES, HOLDS = 300, 6, 8

DRIFT = np.array([[-0.5, 1.0], [-1.0, -0.5]])
PUSH = np.array([[0.0], [1.0]])


def clipped(y: Floats, kp: float, kv: float, limit: float) -> Floats:
    return np.asarray(np.clip(-kp * y[0] - kv * y[1], -limit, limit))


CARS = LateRuns(
    lambda x, u, w: np.stack([x[1], u + w]), lambda y: clipped(y, 2.0, 3.0, 4.0),
    (-4.0, 4.0), (-0.3, 0.3), period=10, errors=0.02,
)  # fmt: skip
SPIRALS = LateRuns(
    lambda x, u, _: np.stack([-0.5 * x[0] + x[1], -x[0] - 0.5 * x[1] + u]),
    lambda y: clipped(y, 1.0, 1.5, 2.0), (-2.0, 2.0), (0.0, 0.0), period=10,
)  # fmt: skip
TURNING = np.array([[0.0, 314.0], [-314.0, 0.0]])
STRONG = np.array([[0.0], [50.0]])
TURNS = LateRuns(
    lambda x, u, _: np.stack([314.0 * x[1], -314.0 * x[0] + 50.0 * u]),
    lambda y: clipped(y, 1.0, 1.5, 2.0), (-2.0, 2.0), (0.0, 0.0), period=20, waits=20, acts=30,
)  # fmt: skip
PENDULUMS = LateRuns(
    lambda x, u, w: np.stack([x[1], -np.sin(x[0]) - 0.2 * x[1] * np.abs(x[1]) + u + w]),
    lambda y: clipped(y, 3.0, 2.0, 1.0), (-1.0, 1.0), (-0.1, 0.1), period=10,
)  # fmt: skip


def engine_of(runs: LateRuns, less: int = 0) -> GridGroup:
    """The engine for a system, told of reads that are less old than they may be."""
    errors: tuple[tuple[float, float], ...] = ((-runs.errors, runs.errors),) * 2
    ends = ((-2.0, 2.0), (-3.0, 3.0))
    disturbed: tuple[tuple[float, float], ...] = (runs.winds,)
    parameters: tuple[int, ...] = ()
    if runs.rate is CARS.rate:
        unit, parameters = car(), (2000, 3000, 4000)
    elif runs.rate in (SPIRALS.rate, TURNS.rate):
        flow = (TURNING, STRONG) if runs.rate is TURNS.rate else (DRIFT, PUSH)
        unit = linear(linear_source(*flow, np.array([[1.0, 1.5]]), 2.0))
        errors, disturbed = (), ((0.0, 0.0),) * 2
    else:
        unit, errors = pendulum(3.0, 2.0, 1.0), ()
    inputs = GridInputs(
        ends,
        (runs.controls,),
        disturbed,
        errors,
        period_ns=runs.period * MS,
        delay_ns=(runs.age + runs.acts) * MS,
        jitter_ns=(runs.waits + runs.acts) * MS,
        read_age_ns=(runs.read_age - less) * MS,
        parameters=parameters,
    )
    return GridGroup(unit, inputs, [(i, np.linspace(*e, 41)) for i, e in enumerate(ends)])


def outside(
    runs: LateRuns, engine: GridGroup, rng: np.random.Generator, holds: int = HOLDS
) -> float:
    """How far the worst run from a random box gets out of images or tubes."""
    low = rng.uniform((-0.8, -1.0), (0.6, 0.8))
    high = low + rng.uniform(0, 0.2, 2) * rng.choice([0.0, 0.01, 1.0])
    images, tubes = engine.images_and_tubes(low, high, holds)
    assert len(images)
    start = np.stack([corner(rng, low[i], high[i], (RUNS,)) for i in range(2)])
    worst = -np.inf
    for t, x in runs.states(start, len(images), rng):
        k, rest = divmod(t, runs.period)
        boxes = [images[k - 1]] if rest == 0 and k else []
        boxes += [tubes[k]] if k < len(tubes) else []
        for box in boxes:
            over = max(float((x - box[:, 1, None]).max()), float((box[:, 0, None] - x).max()))
            worst = max(worst, over)
    return worst


LATE: list[Callable[[LateRuns], LateRuns]] = [
    lambda runs: replace(runs, acts=6),
    lambda runs: replace(runs, acts=40, age=12),
    lambda runs: replace(runs, waits=9, acts=15, age=3),
    lambda runs: replace(runs, waits=10, acts=100, age=10),
]


@all_rows("late", range(len(LATE)))
@all_rows("system", [CARS, SPIRALS, PENDULUMS], ids=["car", "spiral", "pendulum"])
def test_runs_of_late_commands_stay_in_images_and_tubes(system: LateRuns, late: int) -> None:
    runs = LATE[late](system)
    engine = engine_of(runs)
    assert engine.is_linear == (system is not PENDULUMS)
    rng = np.random.default_rng(late)
    assert max(outside(runs, engine, rng) for _ in range(BOXES)) <= SLACK


@pytest.mark.parametrize("system", [CARS, SPIRALS, PENDULUMS], ids=["car", "spiral", "pendulum"])
def test_the_runs_would_show_reads_that_may_be_older(system: LateRuns) -> None:
    """By a period less nothing is seen: what is as old as D acts at the end of a hold."""
    runs = replace(system, acts=40, age=12)
    rng = np.random.default_rng(1)
    engine = engine_of(runs, less=2 * runs.period)
    assert max(outside(runs, engine, rng) for _ in range(2 * BOXES)) > SLACK


def test_two_commands_in_one_hold_move_what_one_would_bring_back() -> None:
    """A turn takes one period: of a command that is held for all of it nothing is left."""
    engine = engine_of(TURNS)
    rng = np.random.default_rng(3)
    assert max(outside(TURNS, engine, rng, 1) for _ in range(BOXES)) <= 0.02


@pytest.mark.parametrize("ahead", [True, False])
def test_what_is_read_during_a_hold_may_act_in_it(*, ahead: bool) -> None:
    """With a wind that no command is stronger than, what is read later is always faster."""
    runs = replace(CARS, acts=6, winds=(4.0, 4.0), errors=0.0)
    engine = engine_of(runs)
    if not ahead:
        engine.c.swept = 1e-12
    rng = np.random.default_rng(1)
    worst = max(outside(runs, engine, rng) for _ in range(20))
    assert (worst <= SLACK) == ahead
