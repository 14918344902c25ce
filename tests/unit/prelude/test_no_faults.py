"""No argument makes a prelude function fault, and a NaN that goes in comes out."""

from __future__ import annotations

import itertools
import math

import pytest
from exact_functions import seeded  # type: ignore[import-not-found]
from hypothesis import given
from hypothesis import strategies as st
from soter_functions import SIGNATURES, components, flat_call  # type: ignore[import-not-found]

from tables import all_rows

LARGEST = math.nextafter(math.inf, 0.0)
LEAST = 5e-324
MAGNITUDES = (
    0.0, LEAST, 1.5e-323, 2.2250738585072014e-308, 1e-200, 1e-160, 1e-130, 2.0**-27, 0.25, 0.5,
    math.nextafter(0.5, 1.0), math.sqrt(0.5), math.pi / 4, 0.55, math.nextafter(1.0, 0.0), 1.0,
    math.nextafter(1.0, 2.0), math.sqrt(2.0), math.pi / 2, 2.0, 3.0, math.pi, 2 * math.pi, 22.0,
    709.782712893384, 709.8, 745.1332191019411, 746.0, 1e5, math.nextafter(1e5, 1e6), 2.0**31,
    2.0**52 + 1.0, 2.0**53, 2.0**63, 1e21, 1e150, 1e300, 2.0**996, LARGEST / 2, LARGEST, math.inf,
)  # fmt: skip
SPECIAL = (*MAGNITUDES, *(-m for m in MAGNITUDES), math.nan)

IGNORES_NAN = {"unit": range(3, 6), "unit2": range(2, 4)}
"""Components that count only in special cases: the fallback of a direction."""


def _check(name: str, arguments: tuple[float, ...]) -> None:
    result = flat_call(name, arguments)  # a fault would be raised
    counted = [a for k, a in enumerate(arguments) if k not in IGNORES_NAN.get(name, range(0))]
    if any(math.isnan(a) for a in counted):
        assert any(math.isnan(r) for r in result), f"{name}{arguments} = {result}"


@all_rows("name", [n for n in SIGNATURES if components(n) <= 2])
def test_all_special_arguments(name: str) -> None:
    for arguments in itertools.product(SPECIAL, repeat=components(name)):
        _check(name, arguments)


@all_rows("name", [n for n in SIGNATURES if components(n) > 2])
def test_many_special_arguments(name: str) -> None:
    rng = seeded(name)
    for _ in range(2000):
        few = rng.choices(SPECIAL, k=rng.randint(1, 4))
        _check(name, tuple(rng.choices(few, k=components(name))))


@pytest.mark.parametrize("name", SIGNATURES)
def test_any_arguments(name: str) -> None:
    floats = st.floats() | st.sampled_from(SPECIAL)

    @given(st.tuples(*(floats for _ in range(components(name)))))
    def check(arguments: tuple[float, ...]) -> None:
        _check(name, arguments)

    check()
