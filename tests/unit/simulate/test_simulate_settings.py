"""Lengths of time, as text and as numbers."""

from __future__ import annotations

import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.model.types import WrongTextError, duration_ns
from soter.simulate.run_options import until_ns
from tables import all_rows


@pytest.mark.parametrize(
    ("given", "ns"),
    [
        ("30s", 30_000_000_000),
        ("0.1s", 100_000_000),
        ("1.5 min", 90_000_000_000),
        ("1e3ms", 1_000_000_000),
        (" 2h ", 7_200_000_000_000),
        ("1us", 1_000),
        ("0s", 0),
        (0.1, 100_000_000),
        (3, 3_000_000_000),
        (1e-9, 1),
        (Decimal("0.25"), 250_000_000),
    ],
)
def test_a_length_of_time_is_exact(given: float | str, ns: int) -> None:
    assert duration_ns(given) == ns


@all_rows(
    "given",
    [
        "",
        "s",
        "30",
        "-3s",
        "0.5ns",
        "1e999s",
        "3 d",
        "3s 2s",
        "٣s",
        "9" * 200 + "s",
        math.nan,
        math.inf,
        1e300,
        None,
        True,
        [3],
    ],
)
def test_what_is_no_length_of_time(given: object) -> None:
    with pytest.raises(WrongTextError):
        duration_ns(given)  # type: ignore[arg-type]


@given(st.integers(min_value=0, max_value=2**62))
def test_nanoseconds_come_back(ns: int) -> None:
    assert duration_ns(f"{ns}ns") == ns


@given(st.text(max_size=30) | st.floats() | st.integers())
def test_anything_is_a_time_or_a_diagnostic(anything: str | float) -> None:
    try:
        ns = until_ns(anything)
    except SoterError as error:
        codes = [d.code for d in error.diagnostics]
    else:
        codes = ["U001"] if ns > 0 else []
    assert codes == ["U001"]


def test_a_close_name_is_suggested() -> None:
    assert nearest_or_all("GAIM", ["GAIN", "SPEED"]) == "did you mean `GAIN`?"
    assert nearest_or_all("zzz", ["GAIN", "SPEED"]) == "there are `GAIN`, `SPEED`"
    assert nearest_or_all("zzz", []) == ""
