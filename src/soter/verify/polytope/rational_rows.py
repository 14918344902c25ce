"""Rows solved for some of their inputs, in rationals.

Purpose: `pivots_of`: which rows, for which inputs; `inverse_of` what is left of them.
Non-goals: what the rows are of (`extract_group.py`).
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from soter.core.layout import Floats


F = Fraction


def pivots_of(gain: Floats, radius: Floats) -> tuple[list[int], list[int]]:
    """Independent rows, and an input for each that the row can be solved for.

    `gain`: a row a state, a column an input; `radius`: one an input.
    """
    work = [[F(x) for x in row] for row in gain]
    rows: list[int] = []
    pivots: list[int] = []
    for a, row in enumerate(work):
        weight = [0.0 if i in pivots else abs(float(x)) * radius[i] for i, x in enumerate(row)]
        p = int(np.argmax(weight))
        if weight[p] <= 0.0:
            continue
        for later in work[a + 1 :]:
            factor = later[p] / row[p]
            later[:] = [x - factor * y for x, y in zip(later, row, strict=True)]
        rows.append(a)
        pivots.append(p)
    return rows, pivots


def inverse_of(matrix: list[list[Fraction]]) -> list[list[Fraction]]:
    """Of an invertible matrix of rationals (Gauss-Jordan)."""
    n = len(matrix)
    work = [[*row, *(F(int(i == j)) for j in range(n))] for i, row in enumerate(matrix)]
    for i in range(n):
        swap = next(k for k in range(i, n) if work[k][i] != 0)
        work[i], work[swap] = work[swap], work[i]
        head = work[i][i]
        work[i] = [x / head for x in work[i]]
        for k in range(n):
            if k != i:
                factor = work[k][i]
                work[k] = [x - factor * y for x, y in zip(work[k], work[i], strict=True)]
    return [row[n:] for row in work]
