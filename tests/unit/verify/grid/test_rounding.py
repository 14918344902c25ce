"""Bounds on rounding, against exact arithmetic: enclosures contain what rationals say."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from soter.verify.grid.grid_problem import GridInputs
from soter.verify.grid.sets import GridGroup
from unit.verify.grid.small_enclosure_units import car

HOLDS = 12
PERIOD_NS = 30_000_001


def group_of(far: float, fast: float, command: float) -> GridGroup:
    """The car, p' = v, v' = u, with |p| up to `far`, |v| up to `fast`, under one command."""
    inputs = GridInputs(
        states=((-4 * far, 4 * far), (-4 * fast, 4 * fast)),
        controls=((-10.0, 10.0),),
        disturbances=((0.0, 0.0),),
        errors=((0.0, 0.0), (0.0, 0.0)),
        period_ns=PERIOD_NS,
        parameters=(1000, 1000, 10_000),
    )
    axes = [(i, np.linspace(-2 * size, 2 * size, 3)) for i, size in enumerate((far, fast))]
    group = GridGroup(car(), inputs, axes)
    held = np.array([command])
    group.c.held_low = group.c.held_high = group.pointer(held, "double *")
    group._kept.append(held)
    return group


def exact(p: float, v: float, u: float) -> list[tuple[Fraction, Fraction]]:
    """States after each hold, as rationals."""
    h, a = Fraction(PERIOD_NS, 10**9), Fraction(u)
    x, y, states = Fraction(p), Fraction(v), []
    for _ in range(HOLDS):
        x, y = x + y * h + a * h * h / 2, y + a * h
        states.append((x, y))
    return states


@pytest.mark.parametrize(
    ("far", "fast", "push"),
    [(1e-6, 1e-6, 10.0), (1.0, 1.0, 10.0), (1e9, 1e9, 10.0), (1e9, 1.0, 0.0), (1e9, 1.0, 1.0)],
)
def test_images_of_points_contain_the_exact_states(far: float, fast: float, push: float) -> None:
    """Where the state is far and slow, nothing but the bounds on rounding is there to help."""
    rng = np.random.default_rng(11)
    for _ in range(40):
        u = float(rng.uniform(-push, push))
        x = rng.uniform((-far, -fast), (far, fast))
        images, tubes = group_of(far, fast, u).images_and_tubes(x, x, HOLDS)
        for image, tube, state in zip(images, tubes, exact(x[0], x[1], u), strict=False):
            for (low, high), (least, most), y in zip(image, tube, state, strict=True):
                assert Fraction(low) <= y <= Fraction(high)
                assert Fraction(least) <= y <= Fraction(most)
                assert high - low <= 1e-10 * max(far, 1)


def test_the_corners_of_a_box_stay_in_its_images() -> None:
    rng = np.random.default_rng(12)
    for _ in range(40):
        u = float(rng.uniform(-10, 10))
        low = rng.uniform(-1.0, 1.0, 2)
        high = low + rng.uniform(0, 0.3, 2)
        images, _ = group_of(1.0, 1.0, u).images_and_tubes(low, high, HOLDS)
        for p in (low[0], high[0]):
            for v in (low[1], high[1]):
                for image, state in zip(images, exact(float(p), float(v), u), strict=False):
                    for (least, most), x in zip(image, state, strict=True):
                        assert Fraction(least) <= x <= Fraction(most)
