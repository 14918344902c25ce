"""Ranges of numbers, and the operations of the language on ranges.

Purpose: computes sound bounds of every operation on binary64 and 64-bit ints, whether it may give
a NaN, and whether it may fault. Rounding to nearest is monotone, so the bounds of a float operation
are its results at the ends.
Non-goals: expressions (`range_evaluation.py`), reals (`verify/enclose/`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.evaluate import arithmetic
from soter.language.model.types import INT_MAX, INT_MIN

if TYPE_CHECKING:
    from collections.abc import Callable

INF = math.inf
TOTAL = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "tanh", "hypot"),
    *("wrap_angle", "sign", "pow"),
}
"""Prelude functions that return a number for all numbers of their domain, of `pow` for x >= 0."""


@dataclass(frozen=True)
class Range:
    """All numbers from `low` to `high`, as floats or ints (bools and enums are ints).

    With `nan`, NaN is included. Infinities are included if an end is infinite.
    """

    low: float
    high: float
    nan: bool = False

    @property
    def single(self) -> bool:
        """Whether the range holds a single number; zeros of either sign count as one."""
        return self.low == self.high and not self.nan

    def union(self, other: Range) -> Range:
        """Gives the smallest range that contains both ranges."""
        low, high = min(self.low, other.low), max(self.high, other.high)
        return Range(low, high, self.nan or other.nan)

    def overlap(self, other: Range) -> Range:
        """Gives the range of the numbers in both ranges, which must have a number in common."""
        low, high = max(self.low, other.low), min(self.high, other.high)
        return Range(low, high, self.nan and other.nan)

    def holds(self, value: float) -> bool:
        """Whether a number is in the range."""
        return self.low <= value <= self.high


TRUE, FALSE, EITHER = Range(1, 1), Range(0, 0), Range(0, 1)
ANY_FLOAT = Range(-INF, INF, nan=True)
ANY_INT = Range(INT_MIN, INT_MAX)


class Faults:
    """A record of whether any operation so far may have faulted."""

    def __init__(self) -> None:
        self.possible = False

    def note_fault_unless(self, fine: bool) -> None:
        """Sets `possible`, unless the operation is certainly `fine`."""
        self.possible |= not fine


def truth_range(surely: bool, never: bool) -> Range:
    """Gives the range of a truth value that is surely true, never true, or unknown."""
    return TRUE if surely else FALSE if never else EITHER


def negated_truth(a: Range) -> Range:
    """Gives the range of `!a`."""
    return Range(1 - a.high, 1 - a.low)


def range_of_prelude(name: str, arguments: list[Range]) -> Range:
    """Gives the range of a function in TOTAL; includes NaN if an argument may be out of domain."""
    from soter.language.prelude.function_error_bounds import BOUNDS  # noqa: PLC0415 - rarely asked

    bound = BOUNDS[name]
    domain = ((0.0, INF), bound.domain[1]) if name == "pow" else bound.domain
    inside = all(
        low <= a.low and a.high <= high and not a.nan
        for a, (low, high) in zip(arguments, domain, strict=True)
    )
    return Range(*bound.values, nan=not inside)


# ---------------------------------------------------------------- comparisons


def comparison_range(op: str, a: Range, b: Range, *, same: bool = False) -> Range:
    """Gives the truth of `a op b`; `same`: both sides are one expression, equal unless NaN."""
    if op == "!=":
        return negated_truth(comparison_range("==", a, b, same=same))
    if op in {">", ">="}:
        return comparison_range({">": "<", ">=": "<="}[op], b, a, same=same)
    number = not (a.nan or b.nan)
    if same and op == "<":
        return FALSE
    if op == "==":
        surely = number and (same or (a.low == a.high == b.low == b.high))
        return truth_range(surely, a.high < b.low or b.high < a.low)
    if op == "<":
        return truth_range(number and a.high < b.low, a.low >= b.high)
    return truth_range(number and (same or a.high <= b.low), a.low > b.high)


# ---------------------------------------------------------------- floats


def _range_of_monotone(op: Callable[[float, float], float], a: Range, b: Range) -> Range:
    """Gives the range of the results of a monotone operation on two ranges."""
    ends = [op(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    if a.nan or b.nan or any(math.isnan(x) for x in ends):
        return ANY_FLOAT
    return Range(min(ends), max(ends))


def float_add(a: Range, b: Range) -> Range:
    """Gives the range of `a + b`."""
    return _range_of_monotone(lambda x, y: x + y, a, b)


def zero_difference(a: Range) -> Range:
    """Gives the range of `x - x`, with x in `a`: 0, and NaN if x may be infinite or NaN."""
    return Range(0, 0, a.nan or math.isinf(a.low) or math.isinf(a.high))


def float_subtract(a: Range, b: Range) -> Range:
    """Gives the range of `a - b`."""
    return _range_of_monotone(lambda x, y: x - y, a, b)


def float_multiply(a: Range, b: Range, *, same: bool = False) -> Range:
    """Gives the range of `a * b`; NaN is possible for zero times infinity."""
    endless = any(math.isinf(x) for x in (a.low, a.high, b.low, b.high))
    if endless and (a.holds(0.0) or b.holds(0.0)):
        return ANY_FLOAT if not (same and not a.nan) else Range(0.0, INF)
    product = _range_of_monotone(lambda x, y: x * y, a, b)
    return (
        Range(max(product.low, 0.0), product.high, product.nan)
        if same and not product.nan
        else product
    )


def float_divide(a: Range, b: Range, faults: Faults) -> Range:
    """Gives the range of `a / b`; records a possible fault if b may be zero."""
    faults.note_fault_unless(not b.holds(0.0) and not b.nan)
    endless = [math.isinf(x.low) or math.isinf(x.high) for x in (a, b)]
    if b.holds(0.0) or all(endless) or a.nan or b.nan:
        return Range(-INF, INF, nan=all(endless) or a.nan or b.nan)
    return _range_of_monotone(lambda x, y: x / y, a, b)


def square_root(a: Range) -> Range:
    """Gives the range of `sqrt(a)`; NaN is possible for numbers below zero."""
    low, high = max(a.low, 0.0), max(a.high, 0.0)
    return Range(math.sqrt(low), math.sqrt(high), a.nan or a.low < 0.0)


def minimum(a: Range, b: Range) -> Range:
    """Gives the range of `min(a, b)`, which is `b < a ? b : a`."""
    bounds = Range(min(a.low, b.low), min(a.high, b.high), a.nan)
    return bounds.union(a) if b.nan else bounds.union(Range(b.low, b.high)) if a.nan else bounds


def maximum(a: Range, b: Range) -> Range:
    """Gives the range of `max(a, b)`, which is `b > a ? b : a`."""
    bounds = Range(max(a.low, b.low), max(a.high, b.high), a.nan)
    return bounds.union(a) if b.nan else bounds.union(Range(b.low, b.high)) if a.nan else bounds


def absolute_range(a: Range) -> Range:
    """Gives the range of `abs(a)` of a float."""
    ends = abs(a.low), abs(a.high)
    low = type(a.low)(0) if a.holds(0) else min(ends)
    return Range(low, max(ends), a.nan)


# ---------------------------------------------------------------- ints


def int_range(low: int, high: int, faults: Faults) -> Range:
    """Gives the range [low, high] limited to 64 bits; notes a fault if it lies partly outside."""
    faults.note_fault_unless(low >= INT_MIN and high <= INT_MAX)
    return Range(max(low, INT_MIN), max(min(high, INT_MAX), low, INT_MIN))


def int_operation(op: str, a: Range, b: Range, faults: Faults) -> Range:
    """Gives the range of `+`, `-`, `*`, `/` or `%` of ints, and records possible faults."""
    xs, ys = (int(a.low), int(a.high)), (int(b.low), int(b.high))
    if op in "+-*":
        of = {"+": int.__add__, "-": int.__sub__, "*": int.__mul__}[op]
        ends = [of(x, y) for x in xs for y in ys]
        return int_range(min(ends), max(ends), faults)
    faults.note_fault_unless(not b.holds(0))
    divisors = [d for d in {*ys, 1, -1} if d and b.holds(d)]
    if not divisors:
        return ANY_INT
    if op == "/":
        ends = [_quotient(x, d) for x in (*xs, *([0] if a.holds(0) else [])) for d in divisors]
        return int_range(min(ends), max(ends), faults)
    if a.single and b.single:
        only = arithmetic.mod_int(xs[0], ys[0])
        return Range(only, only)
    most = max(abs(d) for d in divisors) - 1
    return Range(-min(most, max(-xs[0], 0)), min(most, max(xs[1], 0)))


def _quotient(a: int, b: int) -> int:
    """Gives `a / b` truncated towards zero, for ints of any size."""
    quotient = abs(a) // abs(b)
    return quotient if (a < 0) == (b < 0) else -quotient


def int_of_float(a: Range, faults: Faults) -> Range:
    """Gives the range of `int(a)`; records a possible fault if the int may not fit 64 bits."""
    fits = not a.nan and a.low >= -(2.0**63) and a.high < 2.0**63
    faults.note_fault_unless(fits)
    return Range(int(a.low), int(a.high)) if fits else ANY_INT


def range_in_type(a: Range, low: int, high: int, faults: Faults) -> Range:
    """Gives the range of an int stored in [low, high]; records a fault if it may not fit."""
    faults.note_fault_unless(low <= a.low and a.high <= high)
    return Range(min(max(a.low, low), high), max(min(a.high, high), low))
