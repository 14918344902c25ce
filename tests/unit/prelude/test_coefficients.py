"""Every number of `math.soter` is reproduced from its definition."""

from __future__ import annotations

import math
import re

import mpmath
import pytest
from derive_coefficients import DIGITS, derived, fit_error, fits  # type: ignore[import-not-found]
from mpmath import mpf
from prelude_source import comment_above, constants, public_functions, text  # type: ignore[import-not-found]
from soter_functions import SIGNATURES  # type: ignore[import-not-found]

from soter.language.prelude.function_error_bounds import BOUNDS
from tables import all_rows

STATED = {
    "ANGLE_MAX": 1.0e5,
    "_HUGE": math.nextafter(math.inf, 0.0),
    "_ROUNDER": 1.5 * 2.0**52,
    "_SPLITTER": 2.0**27 + 1.0,
    "_EXP_MAX": math.log(math.nextafter(math.inf, 0.0)),
    "_EXP_MIN": -745.1332191019412,
}
"""Constants that are plain statements."""


@pytest.mark.long
def test_constants_are_the_derived_ones() -> None:
    written = constants()
    for name, values in derived().items():
        assert written.pop(name) == values, name
    assert written.pop("_STEPS") == tuple(float(512 >> k) for k in range(10))
    assert written == {name: (value,) for name, value in STATED.items()}


@pytest.mark.parametrize(
    "name", ["_SIN", "_COS", "_ASIN", "_ATAN", "_TANH", "_EXP", "_LOG", "_LOG_POW"]
)
def test_polynomials_are_as_good_as_their_comments_say(name: str) -> None:
    space = r"\s+(?://\s*)?"
    pattern = rf"relative{space}error{space}2\^-([0-9.]+)\nconst {name}:"
    stated = re.search(pattern, text("math.soter"))
    assert stated, name
    with mpmath.workdps(DIGITS):
        error = fit_error(fits()[name], constants()[name])
        assert error <= mpf(2) ** -(float(stated[1]) - 0.06)
        assert error >= mpf(2) ** -(float(stated[1]) + 0.06)


def test_exp_limits_are_where_the_result_leaves_the_doubles() -> None:
    with mpmath.workprec(120):
        largest = mpf(STATED["_HUGE"])
        assert mpmath.exp(mpf(STATED["_EXP_MAX"])) <= largest
        assert mpmath.exp(mpf(math.nextafter(STATED["_EXP_MAX"], 1e3))) > largest
        half_of_least = mpf(2) ** -1075
        assert mpmath.exp(mpf(STATED["_EXP_MIN"])) < half_of_least
        assert mpmath.exp(mpf(math.nextafter(STATED["_EXP_MIN"], 0.0))) > half_of_least


def test_all_public_functions_are_tested() -> None:
    assert public_functions() == set(SIGNATURES)


@all_rows("name", BOUNDS)
def test_comment_states_the_bound(name: str) -> None:
    bound, comment = BOUNDS[name], comment_above(name)
    if bound.ulps:
        assert f"{bound.ulps:g} ulp" in comment
    if bound.relative and name != "lerp":
        assert f"{bound.relative:g} u {bound.scale}" in comment
    if bound.absolute and not bound.ulps:
        assert any(float(n) == bound.absolute for n in re.findall(r"[0-9.]+e-[0-9]+", comment))
    if not (bound.ulps or bound.relative or bound.absolute):
        assert "Exact" in comment or "exact" in comment
