"""Balls, and lines over functions: against points, exact fractions and derivatives."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from flint import arb

from soter.certificate.extras import prelude_functions
from soter.certificate.terms.linear_enclosures import (
    FUNCTIONS,
    UNIT,
    ball_key,
    exact,
    greatest_below,
    hull,
    larger,
    line_noisy_max0,
    line_or_range,
    lower,
    magnitude,
    range_max0,
    smaller,
    upper,
)
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

UNIVARIATE = {**FUNCTIONS, **prelude_functions.FUNCTIONS}
del UNIVARIATE["atan2"], UNIVARIATE["pow"]
INF = math.inf
TINY = Fraction(1, 2**100)
"""What is computed with 128 bits is no further off, at the numbers of these tests."""
ENDS = (-6.0, -2.5, -1.0, -0.25, 0.0, 0.5, 1.0, 1.75, 3.0, 6.0)


def fraction(x: arb) -> Fraction:
    """The midpoint of a ball."""
    man, exp = (int(v) for v in x.mid().man_exp())
    return Fraction(man) * Fraction(2) ** exp


def ends(x: arb) -> tuple[Fraction, Fraction]:
    man, exp = (int(v) for v in x.rad().man_exp())
    radius = Fraction(man) * Fraction(2) ** exp
    return fraction(x) - radius, fraction(x) + radius


def near(x: arb, wanted: Fraction | float, tolerance: Fraction = TINY) -> bool:
    low, high = ends(x)
    return abs(low - Fraction(wanted)) <= tolerance and abs(high - Fraction(wanted)) <= tolerance


# ---------------------------------------------------------------- numbers


def test_ends_in_doubles_are_outside_and_no_further_than_a_neighbour() -> None:
    draw = np.random.default_rng(3)
    for _ in range(200):
        middle = float(draw.normal() * 10.0 ** draw.integers(-8, 9))
        x = arb(middle, float(2.0 ** draw.integers(-70, 3)))
        low, high = ends(x)
        for bound, end, sign in ((lower(x), low, 1), (upper(x), high, -1)):
            off = sign * (end - Fraction(bound))
            assert 0 <= off <= 2 * Fraction(math.ulp(bound))
    for share in (0.2, 0.7):  # of the way to the next double: balls that end at one
        radius = share * math.ulp(1.0)
        reach = arb(0, radius).rad()
        assert lower(arb(1 + reach, radius)) == 1
        assert upper(arb(-1 - reach, radius)) == -1
    for x in (arb("nan"), arb(0, INF), -(exact(1.5) * exact(2.0) ** 1100)):
        assert lower(x) == -INF
        assert upper(-x) == INF
    for double in (0.0, 1.5, -2.75, 5e-324, 1.7e308):
        assert lower(exact(double)) == double == upper(exact(double))


def test_the_greatest_double_whose_sum_stays_below() -> None:
    draw = np.random.default_rng(5)
    pairs = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0), (0.1, 0.3), (1e16, 1.0)]
    pairs += [
        tuple(map(float, draw.normal(size=2) * 10.0 ** draw.integers(-9, 9, 2)))  # type: ignore[misc]
        for _ in range(300)
    ]
    for bound, added in pairs:
        most = greatest_below(bound, added)
        assert most + added <= bound
        assert math.nextafter(most, INF) + added > bound


def test_keys_are_equal_for_equal_balls_alone() -> None:
    balls = [arb(m, r) for m in (0, 1, 2, 0.5, -1) for r in (0, 0.5, 1)]
    for a, b in itertools.product(balls, repeat=2):
        assert (ball_key(a) == ball_key(b)) is (ends(a) == ends(b))
        assert ball_key(a) == ball_key(arb(a))
    for x in (arb("nan"), arb("inf"), arb(1, INF)):
        assert ball_key(x) != ball_key(arb(x))


def test_the_unit_ball_is_all_of_it_and_no_more() -> None:
    low, high = ends(UNIT)
    assert -1 - Fraction(1, 10**8) < low <= -1
    assert 1 <= high < 1 + Fraction(1, 10**8)


def test_sizes_hulls_and_better_bounds() -> None:
    balls = [arb(m, r) for m in (-2, -0.5, 0, 1, 3) for r in (0, 0.75)]
    for a in balls:
        low, high = ends(a)
        assert near(magnitude(a), max(abs(low), abs(high)), TINY * 2**75)
        assert magnitude(a).rad().is_zero()
        for b in balls:
            least, most = ends(b)
            both = ends(hull(a, b))
            assert both[0] <= min(low, least)
            assert both[1] >= max(high, most)
            assert both[1] - both[0] <= (max(high, most) - min(low, least)) * Fraction(1001, 1000)
            assert larger(a, b) is (a if low > most else b)
            assert smaller(a, b) is (a if high < least else b)


# ---------------------------------------------------------------- lines

EXACT: dict[str, Callable[[arb], arb]] = {
    "max0": lambda x: x.max(exact(0.0)),
    "abs": abs,
    "square": lambda x: x * x,
    "floor": arb.floor,
    "truncated": lambda x: x.floor() if x >= 0 else x.ceil(),
    "inverse": lambda x: 1 / x,
    "sqrt": arb.sqrt,
    "soft_sign": lambda x: x / (1 + abs(x)),
    "sin": arb.sin,
    "cos": arb.cos,
    "exp": arb.exp,
    "log": arb.log,
    "tanh": arb.tanh,
    "atan": arb.atan,
    "tan": arb.tan,
    "asin": arb.asin,
    "acos": arb.acos,
    "smooth_step": lambda x: (
        x.max(exact(0.0)).min(exact(1.0)) ** 2 * (3 - 2 * x.max(exact(0.0)).min(exact(1.0)))
    ),
    "wrap_angle": lambda x: x - 2 * arb.pi() * (x / (2 * arb.pi()) + exact(0.5)).floor(),
    "wrapped_double": lambda x: x - 2 * arb.pi() * (x / (2 * arb.pi()) + exact(0.5)).floor(),
}
POSITIVE = ("inverse", "log", "sqrt")


def intervals(name: str) -> list[tuple[float, float]]:
    pairs = list(itertools.combinations_with_replacement(ENDS, 2))
    if name == "inverse":
        return [p for p in pairs if p[0] > 0 or p[1] < -0.25]
    if name == "tan":
        return [p for p in pairs if p[0] >= -1.25 and p[1] <= 1.25]
    if name in ("asin", "acos"):
        return [(a / 6.0, b / 6.0) for a, b in pairs]
    least = {"log": 0.5, "sqrt": 0.0}.get(name, -INF)
    return [p for p in pairs if p[0] >= least]


@all_rows("name", sorted(UNIVARIATE))
@all_rows("radii", [(0.0, 0.0), (0.125, 0.125), (0.0, 0.2), (0.2, 0.0)])
def test_lines_and_ranges_enclose(name: str, radii: tuple[float, float]) -> None:
    assert UNIVARIATE.keys() == EXACT.keys()
    for a, b in intervals(name):
        low, high = arb(a, radii[0]), arb(b, radii[1])
        slope, offset, spread, least, most = line = UNIVARIATE[name](low, high)
        assert all(x.is_finite() for x in line)
        for share in (0, 1e-9, 0.125, 0.3, 0.5, 0.7, 0.99, 1):
            x = low.lower() + (high.upper() - low.lower()) * share
            if name == "sqrt" and not x >= 0:
                continue
            if name in ("asin", "acos") and not abs(x) <= 1:
                continue
            y = EXACT[name](x)
            assert not abs(y - slope * x - offset) > spread + exact(TINY)
            assert not y < least
            assert not y > most


@pytest.mark.parametrize("name", ["max0", "abs", "square", "sqrt", "soft_sign"])
def test_lines_are_the_best_ones_and_ranges_exact(name: str) -> None:
    """Half of the distance of chord and parallel tangent, where the function bends one way."""
    of = EXACT[name]
    tolerance = exact(2.0**-60)
    for a, b in intervals(name):
        if name == "soft_sign" and (a < 0 < b or a == b):
            continue
        low, high = exact(a), exact(b)
        slope, _, spread, least, most = UNIVARIATE[name](low, high)
        first, last = of(low), of(high)
        chord = (last - first) / (high - low) if a < b else slope
        if name == "square":  # the tangent in the middle is parallel to the chord
            best = (high - low) ** 2 / 8
        elif name in ("max0", "abs"):
            kink = -low * high / (high - low) if a < 0 < b else exact(0.0)
            best = kink / 2 * (2 if name == "abs" else 1)
        elif name == "sqrt":  # from 0 on: its range
            touch = 1 / (4 * chord) - (first - chord * low) if a < b else exact(0.0)
            best = touch / 2 if a > 0 else last / 2
        else:
            touch = (1 - chord.sqrt()) ** 2 - (abs(first) - chord * abs(low))
            best = touch / 2
        assert abs(spread - best) < tolerance, (a, b)
        if a < b and not (name == "sqrt" and a == 0):
            assert abs(slope - chord) < tolerance
        kept = [first, last, *([exact(0.0)] if a <= 0 <= b else [])]
        assert abs(least - min(kept, key=float)) < tolerance
        assert abs(most - max(kept, key=float)) < tolerance


def test_a_soft_sign_on_both_sides_is_as_near_as_its_humps() -> None:
    """On either side it is at most (1 - sqrt(slope))^2 off a line through 0 of that slope."""
    for a, b in itertools.product((-6.0, -1.0, -0.25), (0.5, 1.0, 6.0)):
        slope, offset, spread, least, most = UNIVARIATE["soft_sign"](exact(a), exact(b))
        first, last = a / (1 - a), b / (1 + b)
        chord = (last - first) / (b - a)
        hump = (1 - math.sqrt(chord)) ** 2
        high, low = max(hump, last - chord * b), min(-hump, first - chord * a)
        got = [float(x) for x in (slope, offset, spread, least, most)]
        wanted = [chord, (high + low) / 2, (high - low) / 2, first, last]
        assert got == pytest.approx(wanted, abs=1e-14)


@pytest.mark.parametrize("name", ["max0", "abs"])
def test_where_a_function_with_a_kink_has_none_its_line_is_exact(name: str) -> None:
    for low, high in ((0.0, INF), (0.0, 2.0), (2.0, INF), (-INF, 0.0), (-2.0, 0.0), (-INF, -1.0)):
        slope, offset, spread, least, most = UNIVARIATE[name](exact(low), exact(high))
        rising = low >= 0
        assert slope == (1 if rising else 0 if name == "max0" else -1)
        assert offset == 0 == spread
        wanted = (low, high) if rising else (0.0, 0.0) if name == "max0" else (-high, -low)
        assert (float(least), float(most)) == wanted


def test_the_range_of_a_kink_is_that_of_its_line() -> None:
    pairs = [(arb(a, r), arb(b, r)) for a, b in intervals("max0") for r in (0, 0.3)]
    pairs += [(exact(0.0), exact(INF)), (exact(-INF), exact(INF)), (exact(-INF), exact(0.0))]
    for low, high in pairs:
        (least, most), line = range_max0(low, high), UNIVARIATE["max0"](low, high)
        assert float(least.lower()) == float(line[3].lower())
        assert float(most.upper()) == float(line[4].upper())


def test_steps_of_floor() -> None:
    for k in range(-3, 4):
        for low, high in ((0.0, 0.0), (0.0, 0.75), (0.25, 0.5)):
            line = UNIVARIATE["floor"](exact(k + low), exact(k + high))
            assert [float(x) for x in line] == [0.0, k, 0.0, k, k]
        line = UNIVARIATE["floor"](exact(k + 0.25), exact(k + 1.0))
        assert [float(x) for x in line] == [1.0, -0.5, 0.5, k, k + 1]


SECOND: dict[str, Callable[[float], float]] = {
    "inverse": lambda x: 2 / x**3,
    "sin": lambda x: -math.sin(x),
    "cos": lambda x: -math.cos(x),
    "exp": math.exp,
    "log": lambda x: -1 / x**2,
    "tanh": lambda x: -2 * math.tanh(x) / math.cosh(x) ** 2,
    "atan": lambda x: -2 * x / (1 + x * x) ** 2,
    "tan": lambda x: 2 * math.tan(x) * (1 + math.tan(x) ** 2),
    "asin": lambda x: x / (1 - x * x) ** 1.5,
    "acos": lambda x: -x / (1 - x * x) ** 1.5,
    "smooth_step": lambda x: 6 - 12 * x if 0 < x < 1 else 0.0,
}
"""Second derivatives."""


@pytest.mark.parametrize("name", sorted(SECOND))
def test_a_smooth_function_is_as_near_its_line_as_it_bends(name: str) -> None:
    """Half of f'' r^2 / 2 over an interval of radius r, but for what f'' varies."""
    radius = 2.0**-12
    for middle in (0.4, 0.9, 1.3, 2.2, *((-0.6, -1.8) if name != "log" else ())):
        if name in ("asin", "acos") and abs(middle) > 1:
            continue
        low, high = exact(middle) - radius, exact(middle) + radius
        _, _, spread, least, most = UNIVARIATE[name](low, high)
        best = abs(SECOND[name](middle)) * radius**2 / 4
        assert float(spread) <= best * 1.02
        of = EXACT[name]
        width = abs(float(of(low) - of(high)))
        assert float(most - least) < width * 1.05 + radius**2


def test_where_a_tangent_says_nothing_the_range_does() -> None:
    """Products of intervals do not bound the second derivative of atan over a wide one."""
    slope, offset, spread, least, most = UNIVARIATE["atan"](exact(-5.0), exact(7.0))
    low, high = math.atan(-5.0), math.atan(7.0)
    assert slope == 0
    assert float(offset - spread) <= low
    assert high <= float(offset + spread)
    assert float(spread) < (high - low) / 2 * 1.2
    assert float(least) <= low
    assert float(most) >= high
    for name in ("sin", "cos"):
        _, offset, spread, least, most = UNIVARIATE[name](exact(-INF), exact(INF))
        assert [float(x) for x in (offset, spread, least, most)] == pytest.approx([0, 1, -1, 1])


@pytest.mark.parametrize("name", ["inverse", "log"])
def test_nothing_is_known_of_a_function_that_may_not_be_defined(name: str) -> None:
    undefined = [(0.0, 1.0), (-1.0, 1.0), (-1.0, 0.0), (0.0, 0.0)]
    undefined += [(-2.0, -1.0)] if name == "log" else []
    for low, high in undefined:
        slope, offset, spread, least, most = UNIVARIATE[name](exact(low), exact(high))
        assert slope == 0 == offset
        assert (float(spread), float(least), float(most)) == (INF, -INF, INF)


def test_a_root_of_what_may_be_negative_is_that_of_the_rest() -> None:
    for low, high in ((-1.0, 4.0), (0.0, 4.0), (-9.0, 4.0)):
        slope, offset, spread, least, most = UNIVARIATE["sqrt"](exact(low), exact(high))
        assert (float(slope), float(offset), float(spread)) == (0.0, 1.0, 1.0)
        assert (float(least), float(most)) == (0.0, 2.0)
    for low, high in ((-1.0, 0.0), (-2.0, -1.0), (0.0, 0.0)):
        assert all(x == 0 for x in UNIVARIATE["sqrt"](exact(low), exact(high)))


def test_of_a_soft_sign_without_ends_its_limits_are_known() -> None:
    for low, high in ((-INF, 1.0), (0.0, INF), (-INF, INF)):
        line = UNIVARIATE["soft_sign"](exact(low), exact(high))
        assert [float(x) for x in line] == [0.0, 0.0, 1.0, -1.0, 1.0]


# ---------------------------------------------------------------- lines beside noise


def test_a_noisy_kink_is_enclosed_by_the_best_line_of_its_chord() -> None:
    """Against a second way: the widest distance above and below, at all points that can bind."""
    for low, high in itertools.combinations_with_replacement(ENDS, 2):
        for noise in (0.0, 0.25, 1.0, 2.5, 8.0):
            slope, kept, offset, spread = line_noisy_max0(*map(exact, (low, high, noise)))
            assert float(kept) == (low >= noise and high + noise > 0)
            spread += kept * exact(noise)
            s = Fraction(float(slope))
            points = {Fraction(p) for p in (low, high, noise, -noise) if low <= p <= high}
            n = Fraction(noise)
            most = max(max(x + n, 0) - s * x for x in points)  # type: ignore[operator]
            least = min(max(x - n, 0) - s * x for x in points)  # type: ignore[operator]
            assert near(offset, (most + least) / 2, Fraction(1, 10**15))
            assert near(spread, (most - least) / 2, Fraction(1, 10**15))
            if low < high and high + noise > 0:
                first, last = max(low + noise, 0.0), max(high + noise, 0.0)
                wanted = 1.0 if low >= noise else (last - first) / (high - low)
                assert abs(float(slope) - wanted) < 1e-15


def test_noise_beside_limits_adds_nothing() -> None:
    far = exact(INF)
    assert all(x == 0 for x in line_noisy_max0(-far, exact(-1.0), exact(1.0)))
    line = line_noisy_max0(exact(1.0), far, exact(1.0))
    assert [float(x) for x in line] == [1.0, 1.0, 0.0, 0.0]


def test_the_less_spread_of_a_line_and_a_range() -> None:
    for offset, spread, low, high in itertools.product(
        (-1.0, 2.0), (0.0, 1.0, 3.0), (-2.0, 1.0), (1.0, 4.0)
    ):
        got = tuple(map(float, line_or_range(*map(exact, (offset, spread, low, high)))))
        half = (high - low) / 2
        kept: Any = (0.0, (low + high) / 2, half) if half < spread else (1.0, offset, spread)
        assert got == kept
