"""What the written code calls while it runs.

Purpose: enclosures too long for one line: products, tables, states between two instants.
Non-goals: those that the interpreter of terms shares (`arb_balls.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flint import arb

from soter.certificate.terms.arb_balls import above, below, exact

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def corners(al: arb, ah: arb, bl: arb, bh: arb) -> tuple[arb, arb]:
    """The range of a product."""
    a, b, c, d = al * bl, al * bh, ah * bl, ah * bh
    return a.min(b).min(c.min(d)), a.max(b).max(c.max(d))


def swept(
    low: arb,
    high: arb,
    low_after: arb,
    high_after: arb,
    between: arb,
    rest: arb,
    own: arb,
    grown: arb,
) -> tuple[float, float]:
    """The ends of a state x between two instants with these ranges, x' = own x + rest.

    Where x' has one sign over the box `between`, x runs from one range to the other. Elsewhere a
    comparison: x stays below the solution of y' = own y + max rest from `high`, which is monotone:
    it only rises where own high + max rest > 0, and then by that times `grown`, the integral of
    e^{own s} over the time.
    """
    rate = own * between + rest
    if rate >= 0:
        return below(low), above(high_after)
    if rate <= 0:
        return below(low_after), above(high)
    down, up = arb((own * low + rest).lower()), arb((own * high + rest).upper())
    return (
        below(low if down >= 0 else low + down * grown),
        above(high if up <= 0 else high + up * grown),
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
