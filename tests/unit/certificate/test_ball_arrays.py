"""Arrays of balls in doubles hold what the exact operations give; their comparisons are certain."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from flint import arb

from soter.certificate.batches import array_lines
from soter.certificate.batches.ball_arrays import BallArray, no_underflow
from soter.certificate.batches.ball_matrices import product, total
from soter.certificate.batches.sines import cosine, sine
from soter.certificate.terms.arb_balls import UNIVARIATE, exact

if TYPE_CHECKING:
    from collections.abc import Callable

COUNT = 400
SIZES = (0.0, 1e-16, 1e-9, 0.3)


def balls(draw: np.random.Generator) -> tuple[BallArray, list[Fraction]]:
    """Balls of many sizes, some exact, and a number out of each: often one of its ends."""
    centre = draw.choice([1.0, 1.0, 1e-7, 1e9], COUNT) * draw.uniform(-3, 3, COUNT)
    centre = np.where(draw.random(COUNT) < 0.1, np.round(centre), centre)
    radius = np.abs(centre) * draw.choice(SIZES, COUNT)
    side = draw.choice([-1.0, 1.0, 0.0, 0.5], COUNT)
    numbers = [
        Fraction(float(c)) + Fraction(float(r)) * Fraction(float(s))
        for c, r, s in zip(centre, radius, side, strict=True)
    ]
    return BallArray(centre, radius), numbers


def holds(x: BallArray, values: list[Any]) -> bool:
    radius = np.zeros(COUNT) if x.radius is None else x.radius
    return all(
        abs(v - Fraction(float(c))) <= Fraction(float(r))
        for v, c, r in zip(values, x.centre, radius, strict=True)
        if np.isfinite(r)
    )


OPERATIONS: dict[str, tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any]]] = {
    "sum": (lambda x, y: x + y, lambda a, b: a + b),
    "difference": (lambda x, y: x - y, lambda a, b: a - b),
    "product": (lambda x, y: x * y, lambda a, b: a * b),
    "twice": (lambda x, _: 2 * x, lambda a, _: 2 * a),
    "from one": (lambda x, _: 1 - x, lambda a, _: 1 - a),
    "times a constant": (lambda x, _: BallArray.of(0.1) * x, lambda a, _: Fraction(0.1) * a),
    "times a third": (lambda x, _: x * BallArray.of(arb(1) / 3), lambda a, _: a / 3),
    "max": (lambda x, y: x.max(y), max),
    "min": (lambda x, y: x.min(y), min),
    "absolute": (lambda x, _: abs(x), lambda a, _: abs(a)),
    "union": (lambda x, y: x.union(y), lambda a, _: a),
    "inverse": (lambda x, _: x.inverse(), lambda a, _: 1 / a if a else Fraction(0)),
}


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_operations_hold_the_exact_results(name: str) -> None:
    of_balls, of_numbers = OPERATIONS[name]
    for seed in range(5):
        draw = np.random.default_rng(seed)
        (x, a), (y, b) = balls(draw), balls(draw)
        with no_underflow():
            image = of_balls(x, y)
        assert image.radius is not None
        values = [of_numbers(p, q) for p, q in zip(a, b, strict=True)]
        assert holds(image, values), (name, seed)
        wide = np.abs(image.centre) * 1e-14 < image.radius
        assert not wide.all() or name == "union", "radii that say nothing"


def test_sums_and_products_of_matrices_hold_the_exact_results() -> None:
    draw = np.random.default_rng(1)
    parts = [balls(draw) for _ in range(12)]
    x = BallArray(
        np.stack([p.centre for p, _ in parts]).reshape(3, 4, COUNT),
        np.stack([p.radius for p, _ in parts if p.radius is not None]).reshape(3, 4, COUNT),
    )
    numbers = [values for _, values in parts]
    for i in range(3):
        summed = [sum(row, Fraction(0)) for row in zip(*numbers[4 * i : 4 * i + 4], strict=True)]
        assert holds(total(x, axis=1)[i], summed)
    y = BallArray(x.centre.reshape(4, 3, COUNT), None)
    image = product(x, y)
    for k in range(COUNT):
        for i in range(3):
            value = sum(
                (numbers[4 * i + j][k] * Fraction(float(y.centre[j, 1, k])) for j in range(4)),
                Fraction(0),
            )
            assert image.radius is not None
            off = abs(value - Fraction(float(image.centre[i, 1, k])))
            assert off <= Fraction(float(image.radius[i, 1, k]))


def test_comparisons_are_certain_and_ends_are_outside() -> None:
    draw = np.random.default_rng(2)
    (x, a), (y, b) = balls(draw), balls(draw)
    near = BallArray(x.centre + draw.choice([0.0, 1e-16, -1e-16], COUNT), x.radius)
    for other, numbers in ((y, b), (near, None)):
        for k, (low, high) in enumerate(zip(x.lower(), x.upper(), strict=True)):
            assert Fraction(float(low)) <= a[k] <= Fraction(float(high))
        if numbers is not None:
            for less, p, q in zip(x < other, a, numbers, strict=True):
                assert not less or p < q
        wide = (x.radius > 0) if x.radius is not None else np.zeros(COUNT, dtype=np.bool_)
        again = BallArray(x.centre, x.radius)
        assert not ((x <= again) & wide).any()
    unknown = BallArray(np.full(1, np.nan), np.zeros(1))
    assert not ((unknown <= 1) | (unknown >= 0)).any()
    endless = BallArray(np.zeros(1), np.full(1, np.inf))
    assert not ((endless <= 1) | (endless >= 0)).any()


def test_an_underflow_is_told() -> None:
    tiny = BallArray(np.array([1e-200]), np.array([1e-210]))
    with pytest.raises(FloatingPointError), no_underflow():
        tiny * tiny


@pytest.mark.parametrize("turned", [False, True])
def test_sines_hold_those_of_arb(turned: bool) -> None:
    draw = np.random.default_rng(3)
    x, numbers = balls(draw)
    with no_underflow():
        image = (cosine if turned else sine)(x)
    assert image.radius is not None
    for k, number in enumerate(numbers):
        value = exact(number).cos() if turned else exact(number).sin()
        off = abs(value - exact(float(image.centre[k])))
        assert off <= exact(float(image.radius[k])), float(number)
    assert (image.radius < 1e-13).any()


@pytest.mark.parametrize("name", sorted(UNIVARIATE))
def test_lines_hold_what_those_of_arb_are_about(name: str) -> None:
    """At points of an interval the function lies within the line, and within the range."""
    draw = np.random.default_rng(4)
    low = draw.uniform(-3, 3, COUNT)
    low = np.where(draw.random(COUNT) < 0.2, np.round(low), low)
    high = low + 10.0 ** draw.uniform(-6, 0.6, COUNT)
    if name == "log":
        low, high = np.abs(low) + 0.01, np.abs(low) + 0.01 + (high - low)
    with no_underflow():
        line = array_lines.NAMES[f"line_{name}"](BallArray(low), BallArray(high))
        rows = [[np.broadcast_to(y, COUNT) for y in (x.centre, x.lower(), x.upper())] for x in line]
    known = 0
    for k in range(COUNT):
        offset, spread = rows[1], rows[2]
        if not (np.isfinite(spread[2][k]) and np.isfinite(rows[4][2][k])):
            continue
        known += 1
        for part in (0.0, 0.3, 1.0):
            at = min(float(low[k] + part * (high[k] - low[k])), float(high[k]))
            if name in ("sqrt", "inverse") and at <= 0:
                continue
            value = UNIVARIATE[name](exact(at), exact(at))[3]
            slack = exact(1e-25) * (1 + abs(value))
            middle = value - exact(float(rows[0][0][k])) * exact(at)
            assert not middle > exact(float(offset[2][k])) + exact(float(spread[2][k])) + slack
            assert not middle < exact(float(offset[1][k])) - exact(float(spread[2][k])) - slack
            assert not value > exact(float(rows[4][2][k])) + slack
            assert not value < exact(float(rows[3][1][k])) - slack
    unknown_here = ("exp", "log", "tanh", "atan")
    assert (known > COUNT // 3) != (name in unknown_here)
