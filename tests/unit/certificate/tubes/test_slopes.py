"""Slopes of terms: two values of a function are no further apart than its slope says."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest
from flint import arb

from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO, exact
from soter.certificate.terms.terms import Terms
from soter.certificate.tubes.rest_claims import NoSlopeError, slopes_in_input
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.certificate.terms.terms import Linear

FUNCTIONS: dict[str, Callable[[arb], arb]] = {
    "max0": lambda x: x.max(ZERO),
    "abs": abs,
    "square": lambda x: x * x,
    "soft_sign": lambda x: x / (1 + abs(x)),
    "sin": arb.sin,
    "cos": arb.cos,
    "exp": arb.exp,
    "tanh": arb.tanh,
    "atan": arb.atan,
    "inverse": lambda x: 1 / x,
    "sqrt": arb.sqrt,
    "log": arb.log,
    "asin": arb.asin,
    "acos": arb.acos,
    "pow": lambda x: x ** exact(2.5),
}


def over(name: str, low: float, high: float) -> arb:
    terms = Terms()
    x = terms.add_input("state", "x", exact(low), exact(high))
    more = [terms.constant(2.5)] if name == "pow" else []
    return slopes_in_input(terms, terms.apply_function(name, x, *more), x.atom)


@all_rows("name", FUNCTIONS)
def test_a_slope_holds_between_any_two_places(name: str) -> None:
    draw, f = random.Random(name), FUNCTIONS[name]  # noqa: S311
    for _ in range(50):
        low = draw.uniform(0.1, 3.0) * (1 if name in ("inverse", "sqrt", "log", "pow") else -1)
        low = draw.uniform(-0.9, 0.4) if name in ("asin", "acos") else low
        high = low + draw.uniform(0.01, 0.5)
        found = over(name, low, high)
        assert found.is_finite()
        for _ in range(5):
            a, b = (exact(draw.uniform(low, high)) for _ in range(2))
            assert (found * (b - a)).overlaps(f(b) - f(a))


def test_a_kink_at_an_end_is_none() -> None:
    for name, below, above in (("max0", ZERO, ONE), ("abs", -ONE, ONE)):
        assert over(name, -1.7, 0.0) == below
        assert over(name, 0.0, 1.7) == above
        assert over(name, -0.1, 1.7).contains(HALF)


def test_what_jumps_has_none() -> None:
    terms = Terms()
    x: Linear = terms.add_input("state", "x", exact(-1.0), exact(1.0))
    jump = terms.choose(terms.below_zero(x), terms.constant(0.0), terms.constant(1.0))
    with pytest.raises(NoSlopeError):
        slopes_in_input(terms, jump, x.atom)


@all_rows("kind", ["minimum", "maximum"])
def test_a_slope_of_an_extreme_is_that_of_what_it_is(kind: str) -> None:
    draw = random.Random(kind)  # noqa: S311
    for k in range(60):
        terms, low = Terms(), draw.uniform(-2.0, 2.0)
        x = terms.add_input("state", "x", exact(low), exact(low + 1.0))
        level = terms.constant((low - 0.5, low + 0.5, low + 1.5)[k % 3])
        other = terms.combine(((exact(draw.uniform(-3.0, 3.0)), x),))
        pair = (x, level) if k % 2 else (level, other)
        found = slopes_in_input(terms, getattr(terms, kind)(*pair, tight=True), x.atom)
        f = arb.min if kind == "minimum" else arb.max
        factor, at = (ONE, level.const) if k % 2 else (other.terms.get(x.atom, ZERO), level.const)
        for _ in range(5):
            a, b = (exact(draw.uniform(low, low + 1.0)) for _ in range(2))
            assert (found * (b - a)).overlaps(f(factor * b, at) - f(factor * a, at))
        if k % 2 and k % 3 != 1:
            assert found in (ZERO, ONE)
