"""Python's arithmetic made the machine's: compared with NumPy, `struct` and exact fractions."""

from __future__ import annotations

import math
import struct
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from soter.language.evaluate import arithmetic
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.model.types import INT_MAX, INT_MIN

if TYPE_CHECKING:
    from collections.abc import Callable

INT64 = st.integers(INT_MIN, INT_MAX) | st.integers(-3, 3) | st.sampled_from([INT_MIN, INT_MAX])
FLOAT64 = st.floats(width=64)


def bits(x: float) -> int:
    (word,) = struct.unpack("<Q", struct.pack("<d", x))
    return int(word)


def same(x: float, y: float) -> bool:
    """Bit for bit, but for the payload of a NaN, which nothing can observe before it is stored."""
    return bits(x) == bits(y) or (math.isnan(x) and math.isnan(y))


def fault_of(call: Callable[[], object]) -> FaultKind | None:
    try:
        call()
    except StepFault as fault:
        return fault.kind
    return None


# ---------------------------------------------------------------- int


@pytest.mark.parametrize(
    ("checked", "wrapping", "exact"),
    [
        (arithmetic.add_int, np.add, lambda a, b: a + b),
        (arithmetic.sub_int, np.subtract, lambda a, b: a - b),
        (arithmetic.mul_int, np.multiply, lambda a, b: a * b),
    ],
)
@given(a=INT64, b=INT64)
def test_int_operations_fault_exactly_where_the_machine_wraps(
    checked: Callable[[int, int], int],
    wrapping: np.ufunc,
    exact: Callable[[int, int], int],
    a: int,
    b: int,
) -> None:
    machine = int(wrapping(np.array([a]), np.array([b]))[0])
    if machine == exact(a, b):
        assert checked(a, b) == machine
    else:
        assert fault_of(lambda: checked(a, b)) is FaultKind.OVERFLOW


@given(a=INT64, b=INT64)
@example(a=INT_MIN, b=-1)
@example(a=-7, b=2)
@example(a=7, b=-2)
@example(a=INT_MIN, b=INT_MAX)
def test_division_truncates_towards_zero_as_in_c(a: int, b: int) -> None:
    if b == 0:
        assert fault_of(lambda: arithmetic.div_int(a, b)) is FaultKind.DIVIDE
    elif a == INT_MIN and b == -1:
        assert fault_of(lambda: arithmetic.div_int(a, b)) is FaultKind.OVERFLOW
    else:
        assert arithmetic.div_int(a, b) == math.trunc(Fraction(a, b))


@given(a=INT64, b=INT64)
@example(a=INT_MIN, b=-1)
@example(a=-7, b=2)
@example(a=7, b=-2)
def test_modulo_has_the_sign_of_the_dividend_as_in_c(a: int, b: int) -> None:
    if b == 0:
        assert fault_of(lambda: arithmetic.mod_int(a, b)) is FaultKind.DIVIDE
    else:
        assert arithmetic.mod_int(a, b) == a - b * math.trunc(Fraction(a, b))


@pytest.mark.parametrize("operation", [arithmetic.neg_int, arithmetic.abs_int])
def test_the_smallest_int_has_no_opposite(operation: Callable[[int], int]) -> None:
    assert fault_of(lambda: operation(INT_MIN)) is FaultKind.OVERFLOW
    assert abs(operation(INT_MIN + 1)) == INT_MAX


def test_narrow_lets_the_bounds_pass_and_nothing_beyond() -> None:
    assert arithmetic.require_in_range(0, 0, 9) == 0
    assert arithmetic.require_in_range(9, 0, 9) == 9
    assert fault_of(lambda: arithmetic.require_in_range(10, 0, 9)) is FaultKind.OVERFLOW
    assert fault_of(lambda: arithmetic.require_in_range(-1, 0, 9)) is FaultKind.OVERFLOW


# ---------------------------------------------------------------- float


@given(a=FLOAT64, b=FLOAT64)
@example(a=1e308, b=1e-308)
@example(a=math.inf, b=math.inf)
@example(a=0.0, b=-0.0)
@example(a=math.nan, b=0.0)
def test_float_division_faults_on_either_zero_and_is_ieee_elsewhere(a: float, b: float) -> None:
    if b == 0.0:
        assert fault_of(lambda: arithmetic.div_float(a, b)) is FaultKind.DIVIDE
    else:
        with np.errstate(all="ignore"):
            assert same(arithmetic.div_float(a, b), float(np.float64(a) / np.float64(b)))


@given(x=FLOAT64)
@example(x=-0.0)
@example(x=-1e-320)
@example(x=math.inf)
@example(x=-math.inf)
def test_sqrt_is_the_machines_and_nan_below_zero(x: float) -> None:
    with np.errstate(all="ignore"):
        assert same(arithmetic.sqrt(x), float(np.sqrt(np.float64(x))))


@given(x=FLOAT64)
@example(x=-0.0)
@example(x=-0.5)
@example(x=0.5)
@example(x=2.0**52 - 0.5)
@example(x=-(2.0**52) + 0.5)
@example(x=2.0**63)
@example(x=1e300)
@example(x=-math.inf)
def test_floor_keeps_minus_zero_infinities_and_nan(x: float) -> None:
    assert same(arithmetic.floor(x), float(np.floor(np.float64(x))))


@given(x=FLOAT64)
@example(x=2.0**63)
@example(x=-(2.0**63))
@example(x=math.nextafter(2.0**63, 0.0))
@example(x=math.nextafter(-(2.0**63), -math.inf))
@example(x=-0.9)
def test_int_of_float_truncates_or_faults(x: float) -> None:
    if math.isfinite(x) and INT_MIN <= int(x) <= INT_MAX:
        assert arithmetic.int_of_float(x) == int(np.array([x]).astype(np.int64)[0])
    else:
        assert fault_of(lambda: arithmetic.int_of_float(x)) is FaultKind.CONVERT


@given(a=FLOAT64, b=FLOAT64)
@example(a=0.0, b=-0.0)
@example(a=-0.0, b=0.0)
@example(a=math.nan, b=1.0)
@example(a=1.0, b=math.nan)
def test_min_and_max_keep_the_first_unless_the_second_is_strictly_better(
    a: float, b: float
) -> None:
    assert bits(arithmetic.minimum(a, b)) == bits(b if b < a else a)  # noqa: FURB136
    assert bits(arithmetic.maximum(a, b)) == bits(b if b > a else a)  # noqa: FURB136


@given(x=FLOAT64, limit=FLOAT64)
def test_saturate_is_a_max_inside_a_min(x: float, limit: float) -> None:
    assert same(
        arithmetic.saturate(x, limit), arithmetic.minimum(arithmetic.maximum(x, -limit), limit)
    )


@given(ns=INT64)
def test_seconds_divides_the_rounded_count(ns: int) -> None:
    assert bits(arithmetic.seconds(ns)) == bits(float(np.int64(ns).astype(np.float64) / 1e9))


@given(payload=st.integers(1, 2**51 - 1), sign=st.booleans(), quiet=st.booleans())
def test_a_stored_nan_is_canonical(payload: int, sign: bool, quiet: bool) -> None:
    pattern = (sign << 63) | (0x7FF << 52) | (quiet << 51) | payload
    (nan,) = struct.unpack("<d", struct.pack("<Q", pattern))
    assert bits(arithmetic.with_stored_nan(nan)) == 0x7FF8000000000000


@given(x=FLOAT64)
@example(x=-0.0)
def test_storing_changes_no_other_number(x: float) -> None:
    assert math.isnan(x) or bits(arithmetic.with_stored_nan(x)) == bits(x)


def test_fault_codes_are_those_of_the_table_in_the_specification() -> None:
    names = [
        *("overflow", "index", "divide", "convert", "assert"),
        *("capacity", "nonfinite", "range", "extern", "shield"),
    ]
    assert [kind.name.lower() for kind in FaultKind] == names
    assert [int(kind) for kind in FaultKind] == list(range(1, 11))
