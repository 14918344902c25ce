"""The operations of straight-line programs, each an enclosure of what it names.

Purpose: `OPERATIONS`: by name, functions of balls; of truths as bits (0: may be false, 1: may be
true); products of intervals, tables, states between two instants.
Non-goals: lines over functions of one number (`arb_balls.py`); programs (`straight_line.py`).
"""

from __future__ import annotations

import math
import operator
from typing import TYPE_CHECKING, Any

from flint import arb

from soter.certificate.terms.arb_balls import (
    UNIVARIATE,
    ZERO,
    above,
    below,
    exact,
    larger,
    line_noisy_max0,
    line_or_range,
    magnitude,
    range_max0,
    smaller,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

CERTAIN = 2
"""The bits of what is certainly true."""
PART, DEMAND = "part", "demand"


class NotCertainError(Exception):
    """Something that is demanded may be false."""


def corners(al: arb, ah: arb, bl: arb, bh: arb) -> tuple[arb, arb]:
    """The range of a product."""
    a, b, c, d = al * bl, al * bh, ah * bl, ah * bh
    return a.min(b).min(c.min(d)), a.max(b).max(c.max(d))


def swept(
    low: arb,
    high: arb,
    low_after: arb,
    high_after: arb,
    least: arb,
    most: arb,
    own: arb,
    rest: arb,
    span: arb,
    grown: arb,
) -> tuple[arb, arb]:
    """The ends of a state x between two instants with these ranges, x' = own x + rest.

    `least` and `most` bound x': where it has one sign x runs from one range to the other. Elsewhere
    a comparison: x stays below the solution of y' = own y + max rest from `high`, which is
    monotone: it only rises where own high + max rest > 0, and then by that times `grown`, the
    integral of e^{own s} over the time. And it is no further above `high_after` than -least says.
    """
    if least >= 0:
        return low, high_after
    if most <= 0:
        return low_after, high
    down, up = arb((own * low + rest).lower()), arb((own * high + rest).upper())
    least, most = arb(least.lower()), arb(most.upper())
    return (
        (low if down >= 0 else low + down * grown).max(low_after - span * most.max(ZERO)),
        (high if up <= 0 else high + up * grown).min(high_after - span * least.min(ZERO)),
    )


def compared(
    low: arb, high: arb, low_after: arb, high_after: arb, own: arb, rest: arb, grown: arb
) -> tuple[arb, arb]:
    """The ends of a state some time after a range, as they are known and by that comparison."""
    down, up = arb((own * low + rest).lower()), arb((own * high + rest).upper())
    return (
        low_after.max(low + down.min(ZERO) * grown),
        high_after.min(high + up.max(ZERO) * grown),
    )


def grown(own: arb, span: arb) -> arb:
    """The integral of e^{own s} over [0, span], from above."""
    if own > 0 or own < 0:
        return arb((((own * span).exp() - 1) / own).upper())
    return span if own <= 0 else span * (own * span).exp()


def bits(yes: bool, no: bool) -> int:
    """The bits of a proposition: 0: may be false, 1: may be true."""
    return 2 if yes else (1 if no else 3)


def by_truth(truth: int, yes: arb, no: arb, both: arb) -> arb:
    """What is so where a proposition is true, where it is false, where neither is certain."""
    return yes if truth == 2 else (no if truth == 1 else both)


def pick(values: NDArray[np.float64], *ends: float) -> tuple[arb, arb]:
    """The range of a table between positions, which are whole numbers.

    `values`: one number a cell, of the table's shape (n_1, ..., n_k); `ends`: low and high by axis.
    """
    part = []
    for axis, size in enumerate(values.shape):
        low, high = ends[2 * axis], ends[2 * axis + 1]
        first = 0 if not low > 0 else min(math.ceil(low), size - 1)
        last = size - 1 if not high < size - 1 else max(math.floor(high), 0)
        part.append(slice(first, last + 1) if first <= last else slice(None))
    there = values[tuple(part)]
    return exact(float(there.min())), exact(float(there.max()))


def demanded(truth: int) -> None:
    """`NotCertainError` where a proposition may be false."""
    if truth != CERTAIN:
        raise NotCertainError


OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "neg": operator.neg,
    "abs": abs,
    "min": arb.min,
    "max": arb.max,
    "mid": arb.mid,
    "union": arb.union,
    "larger": larger,
    "smaller": smaller,
    "below": below,
    "above": above,
    "magnitude": magnitude,
    "corners": corners,
    "swept": swept,
    "compared": compared,
    "inside": lambda low, high, least, most: bits(low >= least and high <= most, no=False),
    "pick": pick,
    "range_max0": range_max0,
    "line_noisy_max0": line_noisy_max0,
    "line_or_range": line_or_range,
    **{f"line_{name}": line for name, line in UNIVARIATE.items()},
    "negative": lambda low, high: bits(high < 0, low >= 0),
    "not_positive": lambda low, high: bits(high <= 0, low > 0),
    "not": (0, 2, 1, 3).__getitem__,
    "and": lambda a, b: ((a | b) & 1) | (a & b & 2),
    "or": lambda a, b: ((a | b) & 2) | (a & b & 1),
    "by_truth": by_truth,
    DEMAND: demanded,
}
