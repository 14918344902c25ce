"""Linear flows solved in Arb: x' = A x + B u + c + W w with |w| <= 1, over any span of time.

Purpose: read A, B, c, W off the derivatives of a group of states; enclose e^{At}, its integrals and
what measurable disturbances can add.
Non-goals: flows that are not linear (refused), which sets to check (`sc_chains.py`); the
simulator's scheme, which is no solution (a printed assumption, decision 454).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

from flint import arb, arb_mat

from soter.certificate.reading.case_model import new_command_terms
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import HALF, ONE, UNIT, ZERO, exact, magnitude, upper
from soter.certificate.terms.straight_line import (
    dot,
    plus_scaled,
    product,
    side_by_side,
    total,
    unit_rows,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.straight_line import Rows

PIECES = 16
"""Into how many pieces a span of time is cut where a kernel may change its sign."""
NEARER, FAR = exact(0.9), 20
"""By which factor other scales of states have to be better; and by how many bits one may change."""
TAYLOR, TAYLOR_MAX = 24, 256
"""Terms of the series of e^{At}: at least, and at most where a span is long for its rates."""


@dataclass(frozen=True, eq=False)
class Solution:
    """x(t) = state x + control u + constant, for u constant up to t and all t of a span."""

    state: Rows
    control: Rows
    constant: list[arb]


@dataclass(frozen=True, eq=False)
class LinearFlow:
    """The flow of a group: its states are `members`, its noise is W, and `ranges` are of u."""

    members: tuple[int, ...]
    a: Rows
    b: Rows
    constant: list[arb]
    noise: Rows
    ranges: tuple[tuple[arb, arb], ...]

    def solution(self, start: Fraction, end: Fraction) -> Solution:
        """The solution for all times in [start, end], in s; both may be negative."""
        n, m = len(self.members), len(self.ranges)
        # the last column of e^{At} is linear in the constants: large ones make no long series
        largest = max((float(abs(c).upper()) for c in self.constant), default=0.0)
        unit = exact(2.0 ** math.frexp(largest)[1])
        full = [[*a, *b, c / unit] for a, b, c in zip(self.a, self.b, self.constant, strict=True)]
        full += [[ZERO] * (n + m + 1) for _ in range(m + 1)]
        e = exponential(full, start, end)[:n]
        return Solution(
            [row[:n] for row in e], [row[n : n + m] for row in e], [row[-1] * unit for row in e]
        )

    def noise_bounds(self, columns: Rows, start: Fraction, end: Fraction) -> list[arb]:
        """Bounds on what |w| <= 1 adds to each state in [start, end]; `columns` stand for W."""
        most = [ZERO] * len(columns)
        back = [[-x for x in row] for row in self.a]
        for time, a in ((-start, back), (end, self.a)):
            if time > 0 and any(columns):
                most = [x.max(y) for x, y in zip(most, _noise_sizes(a, columns, time), strict=True)]
        return most


def _noise_sizes(a: Rows, columns: Rows, time: Fraction) -> list[arb]:
    """For each state, a bound on the integral of |e^{As} W| over [0, time], over all columns."""
    share = time / PIECES
    whole = product(exp_integral(a, time), columns)
    around = _exponential_around_zero(a, share / 2)
    pieces = [
        product(_exponential(a, share * k + share / 2, around), columns) for k in range(PIECES)
    ]
    sizes = []
    for i, row in enumerate(whole):
        size = total(
            _bound_of_integral(x, [piece[i][k] for piece in pieces], exact(share))
            for k, x in enumerate(row)
        )
        sizes.append(arb(size.upper()))
    return sizes


def _bound_of_integral(whole: arb, over: Sequence[arb], share: arb) -> arb:
    """A bound on the integral of |f|, from that of f and the ranges of f on equal pieces of time.

    |f| = f + 2 max(-f, 0) = -f + 2 max(f, 0).
    """
    below_zero, above_zero, size = ZERO, ZERO, ZERO
    for x in over:
        below_zero += ZERO.max(arb((-x).upper()))
        above_zero += ZERO.max(arb(x.upper()))
        size += magnitude(x)
    bounds = (whole + 2 * share * below_zero, 2 * share * above_zero - whole, share * size)
    return min((arb(b.upper()) for b in bounds), key=float)


# ---------------------------------------------------------------- matrices


def _reachable_entries(a: Rows) -> list[list[bool]]:
    """Whether each entry of e^{At} may differ from the identity's, by paths in the graph of A."""
    n = len(a)
    closure = [[not a[i][j].is_zero() for j in range(n)] for i in range(n)]
    for k in range(n):
        for i in range(n):
            if closure[i][k]:
                for j in range(n):
                    closure[i][j] = closure[i][j] or closure[k][j]
    return closure


def _with_exact_entries(a: Rows, e: Rows) -> Rows:
    """The matrix `e` = e^{At} with exact entries if the zeros of A make them 0 or 1."""
    reach = _reachable_entries(a)
    return [
        [x if reach[i][j] else (ONE if i == j else ZERO) for j, x in enumerate(row)]
        for i, row in enumerate(e)
    ]


def exponential(a: Rows, start: Fraction, end: Fraction) -> Rows:
    """e^{At} for all t in [start, end]: exact in the middle, with a Taylor series around it.

    Raises NotRecheckedError if the span is too long for the series.
    """
    around = unit_rows(len(a)) if start == end else _exponential_around_zero(a, (end - start) / 2)
    return _exponential(a, (start + end) / 2, around)


def _exponential(a: Rows, middle: Fraction, around: Rows) -> Rows:
    """e^{A middle} times `around`, i.e. e^{At} for t near 0; certain 0s and 1s are exact."""
    return _with_exact_entries(a, product((arb_mat(a) * exact(middle)).exp().tolist(), around))


def _exponential_around_zero(a: Rows, width: Fraction) -> Rows:
    """The matrix e^{At} for all t in [-width, width], by its series.

    The series has so many terms that each later term is at most half of the term before it.
    """
    half, absolute = exact(width), [list(map(magnitude, row)) for row in a]
    theta, scales = scaled_row_sum(absolute, half)
    last = TAYLOR
    while not theta / (last + 2) < HALF:
        if last == TAYLOR_MAX:
            raise NotRecheckedError("a span of time too long for these rates")
        last += 1
    around, power, reached, factor = unit_rows(len(a)), a, absolute, ONE
    for k in range(1, last + 1):
        factor = factor * half / k
        # t^k over [-half, half]: all of [-1, 1] for odd k, [0, 1] for even k
        around = plus_scaled(around, power, factor * (UNIT if k % 2 else arb(0.5, 0.5)))
        power, reached = product(power, a), product(reached, absolute)
    # later powers: |A|^(K+1) h^(K+1)/(K+1)! (1 + |A| h/(K+2) + ...), bounded by row sums
    tail = factor * half / (last + 1) * 2 * UNIT
    sums = [arb(dot(sizes, scales).upper()) * tail for sizes in reached]
    return [
        [x + whole / d for x, d in zip(row, scales, strict=True)]
        for row, whole in zip(around, sums, strict=True)
    ]


def scaled_row_sum(a: Rows, time: arb) -> tuple[arb, list[arb]]:
    """`time` times the largest row sum of |a_ij| d_j / d_i, and the scales d.

    If S is this sum, an entry of |A|^k is at most S^k d_i / d_j for any scales. The scales are
    powers of 2, moved toward those that make all sums equal as long as that gains a tenth.
    """
    sizes, scales = [list(map(magnitude, row)) for row in a], [ONE] * len(a)
    theta = time * reduce(arb.max, map(total, sizes), ZERO)
    while 1 < theta < arb.pos_inf():
        sums = [dot(row, scales) / d for row, d in zip(sizes, scales, strict=True)]
        halves = [round(math.log2(max(upper(time * x), 2.0**-FAR)) / 2) for x in sums]
        other = [d * exact(2.0**k) for d, k in zip(scales, halves, strict=True)]
        rows = [dot(row, other) / d for row, d in zip(sizes, other, strict=True)]
        less = time * reduce(arb.max, rows, ZERO)
        if not less < theta * NEARER:
            break
        theta, scales = less, other
    return arb(theta.upper()), scales


def exp_integral(a: Rows, time: Fraction) -> Rows:
    """The integral of e^{As} over [0, time]."""
    return exp_integrals(a, time, time)


def exp_integrals(a: Rows, start: Fraction, end: Fraction) -> Rows:
    """The integral of e^{As} over [0, t] for all t in [start, end]."""
    n = len(a)
    full = [*side_by_side(a, unit_rows(n)), *([ZERO] * (2 * n) for _ in range(n))]
    e = exponential(full, start, end)
    return [row[n:] for row in e[:n]]


# ---------------------------------------------------------------- reading


def has_linear_rates(model: CaseModel, members: Sequence[int]) -> bool:
    """Whether the rates of these states are linear in states, commands and disturbances."""
    rows = _rows_of_all_states(model)
    return all(rows[i] is not None for i in members)


def linear_flow(model: CaseModel, members: Sequence[int]) -> LinearFlow:
    """The flow of a group, with the states of other groups as disturbances.

    Raises NotRecheckedError if a state of the group has no linear flow.
    """
    rows = _rows_of_all_states(model)
    rows_of_group = [row for i in members if (row := rows[i]) is not None]
    if len(rows_of_group) != len(members):
        raise NotRecheckedError("a flow that is not linear is not solved at once")
    noises: Rows = []
    constants = []
    for row in rows_of_group:
        c, outside = _outside_noise(model, row, members)
        noises.append([*row.noise, *outside])
        constants.append(c)
    used = [k for k in range(len(noises[0])) if not all(r[k].is_zero() for r in noises)]
    return LinearFlow(
        tuple(members),
        [[row.a[j] for j in members] for row in rows_of_group],
        [list(row.b) for row in rows_of_group],
        constants,
        [[r[k] for k in used] for r in noises],
        tuple((exact(c.low), exact(c.high)) for c in model.facts.controls),
    )


@dataclass(frozen=True, eq=False)
class FlowRow:
    """The rate of a state: x_i' = a x + b u + constant + noise w, with |w| <= 1."""

    a: list[arb]
    b: list[arb]
    constant: arb
    noise: list[arb]


def _outside_noise(model: CaseModel, row: FlowRow, members: Sequence[int]) -> tuple[arb, list[arb]]:
    """The constant and noise of a row, with states of other groups anywhere in their extents."""
    c, outside = row.constant, [ZERO] * len(model.extents)
    for j, (low, high) in enumerate(model.extents):
        if j not in members and not row.a[j].is_zero():
            x, y = exact(low), exact(high)
            c += row.a[j] * (x + y) * HALF
            outside[j] = row.a[j] * (y - x) * HALF
    return c, outside


def _rows_of_all_states(model: CaseModel) -> list[FlowRow | None]:
    """The rates of all states as rows; None for a rate that is not linear."""
    terms, states = model.new_terms()
    controls = new_command_terms(model.facts, terms)
    rates, disturbances = model.rates(terms, states, controls)

    columns = [[x.atom for x in group] for group in (states, controls, disturbances)]
    known = {k for group in columns for k in group}
    optional_rows: list[FlowRow | None] = []
    for rate in rates:
        if not set(rate.terms) <= known or not rate.radius.is_zero():
            optional_rows.append(None)
            continue
        c, row = rate.const, []
        for k in columns[2]:
            low, high = terms.atoms[k].low, terms.atoms[k].high
            factor = rate.terms.get(k, ZERO)
            c += factor * (low + high) * HALF
            row.append(factor * (high - low) * HALF)
        a = [rate.terms.get(k, ZERO) for k in columns[0]]
        b = [rate.terms.get(k, ZERO) for k in columns[1]]
        optional_rows.append(FlowRow(a, b, c, row))
    return optional_rows
