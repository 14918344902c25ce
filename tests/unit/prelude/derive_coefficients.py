"""Derive every constant of `src/soter/language/prelude/math.soter`, from nothing but mpmath.

Purpose: `derived()` gives name -> values; `test_coefficients.py` shows that the Soter source holds
exactly these. `python tests/unit/prelude/derive_coefficients.py` prints them, with the
error of each polynomial as it stands, its coefficients rounded to binary64.

Method: a polynomial is the weighted minimax fit on a Chebyshev grid (the Remez exchange, run on the
grid). Coefficients are rounded one after the other, the lowest power first, and the rest is fitted
again each time, so that what rounding one coefficient spoils the later ones repair.

Non-goals: rounding errors of the evaluation in binary64, which `test_math_bounds.py` measures.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import mpmath
from mpmath import mp, mpf

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

DIGITS = 45
GRID_POINTS = 320


@dataclass(frozen=True)
class Fit:
    """A polynomial p of `terms` coefficients with weight(t) * |target(t) - p(t)| <= error.

    On [low, high]; the weight turns the error of p into the relative error of the whole function.
    """

    low: mpf
    high: mpf
    terms: int
    target: Callable[[mpf], mpf]
    weight: Callable[[mpf], mpf]


def _grid(low: mpf, high: mpf) -> list[mpf]:
    """Chebyshev points of [low, high]; an even number: none is 0, where targets are 0/0."""
    middle, half = (low + high) / 2, (high - low) / 2
    return [
        middle - half * mpmath.cos(mp.pi * (2 * k + 1) / (2 * GRID_POINTS))
        for k in range(GRID_POINTS)
    ]


def _extrema(errors: Sequence[mpf], count: int) -> list[int]:
    """The largest error of every run of one sign, cut down to `count` with alternating signs."""
    runs: list[int] = []
    for index, error in enumerate(errors):
        if runs and (error > 0) == (errors[runs[-1]] > 0):
            if abs(error) > abs(errors[runs[-1]]):
                runs[-1] = index
        else:
            runs.append(index)
    size = [abs(errors[r]) for r in runs]
    while len(runs) > count:
        if len(runs) == count + 1:
            first = 0 if size[0] < size[-1] else len(runs) - 1
            cut = slice(first, first + 1)
        else:  # the weakest neighbours go together, which keeps the signs alternating
            first = min(range(len(runs) - 1), key=lambda k: max(size[k], size[k + 1]))
            cut = slice(first, first + 2)
        del runs[cut], size[cut]
    return runs


def _minimax(
    points: Sequence[mpf], values: Sequence[mpf], weights: Sequence[mpf], size: int
) -> list[mpf]:
    """The `size` coefficients with the least weighted maximum error on the points."""
    chosen = [len(points) * (2 * k + 1) // (2 * size + 2) for k in range(size + 1)]
    basis = [[p**power for power in range(size)] for p in points]
    for _ in range(30):
        system = mpmath.matrix(size + 1, size + 1)
        right = mpmath.matrix(size + 1, 1)
        for row, index in enumerate(chosen):
            for column in range(size):
                system[row, column] = basis[index][column]
            system[row, size] = (-1) ** row / weights[index]
            right[row] = values[index]
        solution = mpmath.lu_solve(system, right)
        coefficients = [solution[k] for k in range(size)]
        errors = [
            w * (v - mpmath.fdot(b, coefficients))
            for w, v, b in zip(weights, values, basis, strict=True)
        ]
        exchanged = _extrema(errors, size + 1)
        if exchanged == chosen or len(exchanged) <= size:
            return coefficients
        chosen = exchanged
    return coefficients


def fit(problem: Fit) -> tuple[float, ...]:
    """The coefficients of a fit as doubles, rounded from the lowest power up."""
    points = _grid(problem.low, problem.high)
    weights = [problem.weight(p) for p in points]
    rest = [problem.target(p) for p in points]
    rounded: list[float] = []
    for terms in range(problem.terms, 0, -1):
        rounded.append(float(_minimax(points, rest, weights, terms)[0]))
        # What is left is again a polynomial times a weight: (target - c) / t, with |t| as weight.
        rest = [(r - mpf(rounded[-1])) / p for r, p in zip(rest, points, strict=True)]
        weights = [w * abs(p) for w, p in zip(weights, points, strict=True)]
    return tuple(rounded)


def _polynomial(coefficients: Sequence[float], t: mpf) -> mpf:
    value = mpf(0)
    for coefficient in reversed(coefficients):
        value = value * t + mpf(coefficient)
    return value


def fit_error(problem: Fit, coefficients: Sequence[float]) -> mpf:
    """The largest weighted error of the rounded coefficients."""
    points = _grid(problem.low, problem.high)
    return max(
        problem.weight(p) * abs(problem.target(p) - _polynomial(coefficients, p)) for p in points
    )


def parts(value: mpf, bits: int, count: int) -> tuple[float, ...]:
    """A value as a sum of doubles: all but the last hold `bits` bits, so products stay exact."""
    result: list[float] = []
    for _ in range(count - 1):
        exponent = int(mpmath.floor(mpmath.log(abs(value), 2)))
        unit = mpf(2) ** (exponent + 1 - bits)
        part = mpmath.floor(value / unit) * unit
        result.append(float(part))
        value -= part
    return (*result, float(value))


# ------------------------------------------------------------- what is fitted


def _odd_series(function: Callable[[mpf], mpf], z: mpf) -> mpf:
    """(f(x)/x - 1) / z for an odd function with f'(0) = 1, where z = x*x."""
    x = mpmath.sqrt(z)
    return (function(x) / x - 1) / z


def _odd_weight(function: Callable[[mpf], mpf], z: mpf) -> mpf:
    """Turns the error of the series above into the relative error of f."""
    x = mpmath.sqrt(z)
    return abs(z * x / function(x))


def _odd(function: Callable[[mpf], mpf], reach: mpf, terms: int) -> Fit:
    """f(x) = x + x*z*p(z) for |x| <= reach."""
    return Fit(
        mpf(0),
        reach**2,
        terms,
        lambda z: _odd_series(function, z),
        lambda z: _odd_weight(function, z),
    )


def fits() -> dict[str, Fit]:
    """Every polynomial of the prelude. Ranges have a slack of 1e-9 for a rounded reduction."""
    slack = 1 + mpf(10) ** -9
    quarter = mp.pi / 4 * slack
    half_ln2 = mp.ln2 / 2 * slack
    # m in [sqrt(1/2), sqrt(2)]: s = (m-1)/(m+1) and z = s*s
    s_max = (mpmath.sqrt(2) - 1) / (mpmath.sqrt(2) + 1) * slack
    return {
        "_SIN": _odd(mpmath.sin, quarter, 6),
        # cos x = 1 - z/2 + z*z*p(z)
        "_COS": Fit(
            mpf(0),
            quarter**2,
            6,
            lambda z: (mpmath.cos(mpmath.sqrt(z)) - 1 + z / 2) / z**2,
            lambda z: z**2 / mpmath.cos(mpmath.sqrt(z)),
        ),
        "_ATAN": _odd(mpmath.atan, mpf(1) / 2, 12),
        "_ASIN": _odd(mpmath.asin, mpf(1) / 2, 13),
        "_TANH": _odd(mpmath.tanh, mpf("0.55"), 11),
        # exp r = 1 + r + r*r*p(r)
        "_EXP": Fit(
            -half_ln2,
            half_ln2,
            10,
            lambda r: (mpmath.exp(r) - 1 - r) / r**2,
            lambda r: r**2 / mpmath.exp(r),
        ),
        # log((1+s)/(1-s)) = 2*s + s*z*p(z)
        "_LOG": Fit(
            mpf(0),
            s_max**2,
            7,
            lambda z: (2 * mpmath.atanh(mpmath.sqrt(z)) / mpmath.sqrt(z) - 2) / z,
            lambda z: z * mpmath.sqrt(z) / (2 * mpmath.atanh(mpmath.sqrt(z))),
        ),
        # 3/2 * log((1+s)/(1-s)) = s * (3 + z + z*z*p(z)), to about 2^-67
        "_LOG_POW": Fit(
            mpf(0),
            s_max**2,
            7,
            lambda z: (3 * mpmath.atanh(mpmath.sqrt(z)) / mpmath.sqrt(z) - 3 - z) / z**2,
            lambda z: z**2 * mpmath.sqrt(z) / (3 * mpmath.atanh(mpmath.sqrt(z))),
        ),
    }


def _double(value: mpf) -> tuple[float]:
    return (float(value),)


def _left_over(value: mpf) -> tuple[float]:
    """What the nearest double leaves over."""
    return (float(value - mpf(float(value))),)


def _constants() -> dict[str, tuple[float, ...]]:
    """Numbers in several parts, and the tables of powers of two."""
    # n * the first part is exact for |n| < 2^11: 42 + 11 = 53 bits
    ln2 = parts(mp.ln2, 42, 2)
    ln2_pow = parts(3 * mp.ln2 / 2, 42, 2)
    return {
        # n * part is exact for |n| < 2^16: 37 + 16 = 53 bits
        "_HALF_PI": parts(mp.pi / 2, 37, 3),
        "_LN2_HIGH": (ln2[0],),
        "_LN2_LOW": (ln2[1],),
        "_LN2_POW_HIGH": (ln2_pow[0],),
        "_LN2_POW_LOW": (ln2_pow[1],),
        # k * pi / 4 for k = 0..4, and what the double leaves over
        "_EIGHTH_TURNS": tuple(_double(k * mp.pi / 4)[0] for k in range(5)),
        "_EIGHTH_TURNS_LOW": tuple(_left_over(k * mp.pi / 4)[0] for k in range(5)),
        "_QUARTER_PI": _double(mp.pi / 4),
        "_QUARTER_PI_LOW": _left_over(mp.pi / 4),
        "_HALF_PI_HIGH": _double(mp.pi / 2),
        "_HALF_PI_LOW": _left_over(mp.pi / 2),
        "_TAU_LOW": _left_over(2 * mp.pi),
        "_TWO_OVER_PI": _double(2 / mp.pi),
        "_ONE_OVER_LN2": _double(1 / mp.ln2),
        "_TWO_OVER_3LN2": _double(2 / (3 * mp.ln2)),
        "_TWO_THIRDS": _double(mpf(2) / 3),
        "_ROOT_HALF": _double(mpmath.sqrt(mpf(1) / 2)),
        "_ROOT_TWO": _double(mpmath.sqrt(2)),
        "PI": _double(mp.pi),
        "TAU": _double(2 * mp.pi),
        "E": _double(mp.e),
        "_POWERS": tuple(2.0**k for k in range(-24, 25)),
        "_POWERS_48": tuple(2.0 ** (48 * k) for k in range(-22, 22)),
        "_STEPS_UP": tuple(2.0 ** (512 >> k) for k in range(10)),
        "_STEPS_DOWN": tuple(2.0 ** -(512 >> k) for k in range(10)),
        "_GROW": (2.0**600,),
        "_SHRINK": (2.0**-600,),
        "_TINY": (2.0**-27,),
    }


@cache
def derived() -> dict[str, tuple[float, ...]]:
    """Every constant array of the mathematical prelude: name -> values."""
    with mpmath.workdps(DIGITS):
        polynomials = {name: fit(problem) for name, problem in fits().items()}
        return polynomials | _constants()


def main() -> None:
    """Print the arrays as they stand in the prelude, and how good each polynomial is."""
    with mpmath.workdps(DIGITS):
        problems = fits()
        for name, values in derived().items():
            print(f"const {name}: float[{len(values)}] = [")
            for value in values:
                print(f"    {value!r},")
            print("];")
            if name in problems:
                error = fit_error(problems[name], values)
                print(f"// relative error 2^{float(mpmath.log(error, 2)):.1f}")


if __name__ == "__main__":
    main()
