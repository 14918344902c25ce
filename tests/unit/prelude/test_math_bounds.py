"""The scalar functions stay within the bounds of `bounds.py`, against mpmath at 160 bits.

`SOTER_PRELUDE_SAMPLES=100000 pytest tests/unit/prelude/test_math_bounds.py -s` is the long
sweep; with `-s` each function shows its worst error and where it was found.
"""

from __future__ import annotations

import math

import mpmath
import pytest
from exact_functions import (  # type: ignore[import-not-found]
    HARDEST,
    PRECISION_BITS,
    SCALAR,
    arguments_of,
    distance,
    exact,
    hard_angles,
    seeded,
    ulp,
)
from mpmath import mp, mpf
from soter_functions import SCALARS, soter_function  # type: ignore[import-not-found]

from long_tests import examples
from soter.language.prelude.function_error_bounds import BOUNDS, UNIT_ROUNDOFF, ErrorBound
from tables import all_rows

SAMPLES = examples(250)


def _allowed(name: str, bound: ErrorBound, arguments: tuple[float, ...], value: mpf) -> mpf:
    """The bound at these arguments."""
    allowed = bound.ulps * ulp(value) + mpf(bound.absolute)
    if name == "lerp":
        a, b, t = (mpf(x) for x in arguments)
        allowed += bound.relative * UNIT_ROUNDOFF * (abs(1 - t) * abs(a) + abs(t) * abs(b))
    return allowed


@pytest.mark.parametrize("name", SCALAR)
def test_error_stays_within_bound(name: str) -> None:
    function, bound = soter_function(name), BOUNDS[name]
    worst, worst_at = mpf(0), ()
    for arguments in arguments_of(name, SAMPLES):
        computed = function(*arguments)
        assert isinstance(computed, float)
        value = exact(name, arguments)
        error, allowed = distance(computed, value), _allowed(name, bound, arguments, value)
        assert error <= allowed, (
            f"{name}{arguments} = {computed!r}, exact {mpmath.nstr(value, 25)}: "
            f"off by {float(error / ulp(value)):.3f} ulp, {float(error):.3g} absolute"
        )
        low, high = bound.values
        assert low <= computed <= high, f"{name}{arguments} = {computed!r}"
        if allowed and error / allowed > worst:
            worst, worst_at = error / allowed, arguments
    print(f"{name}: {float(worst):.3f} of the bound at {worst_at}")


@all_rows("name", HARDEST)
def test_hardest_known_cases_come_near_the_bound(name: str) -> None:
    """A bound far above anything ever met would be no information."""
    function, bound = soter_function(name), BOUNDS[name]
    worst = mpf(0)
    for arguments in HARDEST[name]:
        value = exact(name, arguments) if name in SCALAR else mpf(0)
        if name == "wrap_angle":
            error = _turn_error(arguments[0], function(*arguments))
        else:
            error = distance(function(*arguments), value)
        worst = max(worst, error / _allowed(name, bound, arguments, value))
    assert 0.6 < worst <= 1


def _turn_error(x: float, wrapped: float) -> mpf:
    """The distance of two angles, modulo a full turn."""
    with mpmath.workprec(PRECISION_BITS):
        difference = mpf(x) - mpf(wrapped)
        return abs(difference - 2 * mp.pi * mpmath.nint(difference / (2 * mp.pi)))


def test_wrapped_angle_is_the_same_direction() -> None:
    rng = seeded("wrap_angle")
    wrap, bound = soter_function("wrap_angle"), BOUNDS["wrap_angle"]
    angles = [rng.uniform(-1e5, 1e5) for _ in range(8 * SAMPLES)]
    angles += [rng.uniform(-10.0, 10.0) for _ in range(4 * SAMPLES)]
    angles += [(2 * rng.randint(-15915, 15914) + 1) * math.pi for _ in range(4 * SAMPLES)]
    angles += [s * x for x in hard_angles() for s in (1.0, -1.0)]
    angles += [a for (a,) in HARDEST["wrap_angle"]]
    for x in angles:
        wrapped = wrap(x)
        assert isinstance(wrapped, float)
        assert -math.pi < wrapped <= math.pi, x
        assert _turn_error(x, wrapped) <= bound.absolute, x
        if -math.pi < x <= math.pi:
            assert wrapped == x


def test_reduction_meets_the_nearest_multiples_of_half_pi() -> None:
    """The claim of `_reduce`: within the domain none is nearer than 2^-68.5 |x|."""
    with mpmath.workprec(400):
        gaps = {
            x: abs(mpf(x) - mp.pi / 2 * mpmath.nint(2 * mpf(x) / mp.pi)) / x for x in hard_angles()
        }
        nearest = min(gaps, key=lambda x: gaps[x])
        assert nearest == 91553.86390724055
        assert mpf(2) ** -68.5 < gaps[nearest] < mpf(2) ** -68.4


@all_rows("base", range(2, 40))
def test_whole_powers_that_fit_are_exact(base: int) -> None:
    power = soter_function("pow")
    exponent = 0
    while base**exponent < 2**53:
        assert power(float(base), float(exponent)) == base**exponent
        if base & (base - 1) == 0:
            assert power(float(base), float(-exponent)) == 1 / base**exponent
        exponent += 1


@all_rows("exponent", [*range(-1074, 1024, 7), -1074, -1022, -1023, 1023])
def test_powers_of_two_are_exact(exponent: int) -> None:
    assert soter_function("pow")(2.0, float(exponent)) == math.ldexp(1.0, exponent)


def test_every_public_scalar_function_has_a_bound() -> None:
    assert set(SCALARS) <= set(BOUNDS)
    assert set(SCALARS) == {*SCALAR, "wrap_angle"}
