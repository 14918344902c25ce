"""Forms of a local chain, taken apart and put together again.

Purpose: `Layout.opened`: a form as generators of z (`nonlinear_chains.py`); `Layout.closed`: the
form of what came of it; `StateRows` and `CommandRows`: states and commands as rows over z.
Non-goals: what happens in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flint import arb, arb_mat

from soter.certificate.grid.nonlinear_flow import outwards
from soter.certificate.terms.arb_balls import HALF, ONE, ZERO, above, below

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.grid.nonlinear_flow import Interval

    Form = tuple[arb, ...]


@dataclass(eq=False)
class OpenedForm:
    """A form, taken apart. `ranges`: of states, then of old commands, the latest first."""

    n: int
    ranges: list[Interval]
    z: arb_mat
    memories: list[list[arb]]
    """Per old command its coefficients on the betas of the states."""


@dataclass(eq=False)
class StateRows:
    """The states somewhere in a hold: rows over z, a rest each, and ranges."""

    rows: arb_mat
    rest: list[arb]
    box: list[Interval]


@dataclass(eq=False)
class CommandRows:
    """The new commands: rows over z (their own unknowns among it), ranges."""

    rows: arb_mat
    ranges: list[Interval]


@dataclass(frozen=True)
class FormLayout:
    """`n` states, `q` commands that they feel; a form carries the `depth` latest of each."""

    n: int
    q: int
    depth: int

    def opened(self, form: Form, before: list[Interval] | None) -> OpenedForm:
        """`before`: the ranges of what acted before, where the form does not have it."""
        n, q = self.n, self.q
        count = n + self.depth * q
        width = 1 + 2 * n + self.depth * q + q
        z = arb_mat(count + q + 1, width)
        z[count + q, 0] = ONE
        given = n if before is not None else count
        ranges = [outwards(form[2 * i], form[2 * i + 1]) for i in range(given)]
        centre, symbols = 2 * given, 3 * given
        rest = symbols + given * n
        for i in range(given):
            z[i, 0] = form[centre + i]
            for k in range(n):
                z[i, 1 + k] = form[symbols + i * n + k]
            z[i, 1 + n + i] = form[rest + i]
        memories = []
        if before is not None:
            ranges += before
            for k, (low, high) in enumerate(before):
                z[n + k, 0] = (low + high) * HALF
                z[n + k, 1 + 2 * n + k] = (high - low) * HALF
                memories.append([ZERO] * n)
        else:
            common = rest + given
            for k in range(count - n):
                row = list(form[common + k * n : common + (k + 1) * n])
                memories.append(row)
                for i, a in enumerate(row):
                    z[n + k, 1 + n + i] = a * form[rest + i]
        return OpenedForm(n, ranges, z, memories)

    def begun(self, start: OpenedForm) -> StateRows:
        """The states at the beginning."""
        n = self.n
        return StateRows(rows_of(start, 0, n), [ZERO] * n, list(start.ranges[:n]))

    def closed(self, start: OpenedForm, way: StateRows, new: CommandRows) -> Form:
        """The form at the end; `Writer._in_common` says what commands share with the states."""
        n, q = self.n, self.q
        spread = way.rows * start.z
        kept = [new.rows * start.z] if self.depth else []
        old = (self.depth - 1) * q
        if old > 0:
            kept.append(rows_of(start, n, old) * start.z)
        ranges = list(way.box)
        betas = [size_from(spread, i, 1 + n) + way.rest[i] for i in range(n)]
        centres = [spread[i, 0] for i in range(n)]
        symbols = [spread[i, 1 + k] for i in range(n) for k in range(n)]
        rests = list(betas)
        common: list[arb] = []
        turned = [[way.rows[i, k] for k in range(n)] for i in range(n)]
        names = [(new.rows, kept[0], k) for k in range(q)] if self.depth else []
        for rows, values, k in names:
            coefficients = [rows[k, i] for i in range(n)]
            self._remember(
                values, k, coefficients, turned, spread, way, (centres, symbols, rests, common)
            )
            ranges.append(new.ranges[k])
        for k in range(max(old, 0)):
            self._remember(
                kept[1],
                k,
                start.memories[k],
                turned,
                spread,
                way,
                (centres, symbols, rests, common),
            )
            ranges.append(start.ranges[n + k])
        flat = [end for interval in ranges for end in interval]
        return (*flat, *centres, *symbols, *rests, *common)

    def _remember(
        self,
        values: arb_mat,
        k: int,
        own: Sequence[arb],
        turned: Sequence[Sequence[arb]],
        spread: arb_mat,
        way: StateRows,
        into: tuple[list[arb], list[arb], list[arb], list[arb]],
    ) -> None:
        """A command over the betas of the new states: `own` its coefficients on the old ones."""
        n = self.n
        a = []
        for i in range(n):  # a = S (2 - R), nearly S R^-1
            total = 2 * own[i]
            for j in range(n):
                total -= own[j] * turned[j][i]
            a.append(total.mid())
        rest = ZERO
        for i in range(n):
            rest += abs(a[i]) * way.rest[i]
        for g in range(1 + n, values.ncols()):
            left = values[k, g]
            for i in range(n):
                if not a[i].is_zero():
                    left -= a[i] * spread[i, g]
            rest += abs(left)
        centres, symbols, rests, common = into
        centres.append(values[k, 0])
        symbols += [values[k, 1 + i] for i in range(n)]
        rests.append(rest)
        common += a


# ---------------------------------------------------------------- helpers


def rows_of(start: OpenedForm, first: int, count: int) -> arb_mat:
    """Rows that pick entries of z."""
    rows = arb_mat(count, start.z.nrows())
    for k in range(count):
        rows[k, first + k] = ONE
    return rows


def size_from(values: arb_mat, i: int, first: int) -> arb:
    """The sum of the absolute values of a row from a column on."""
    total = abs(values[i, first])
    for g in range(first + 1, values.ncols()):
        total += abs(values[i, g])
    return total


def propagated(state: arb_mat, rest: Sequence[arb], noise: Sequence[arb]) -> list[arb]:
    """|state| rest + noise, without radius: nothing later may cancel it."""
    radii = []
    for i, more in enumerate(noise):
        total = more
        for j, r in enumerate(rest):
            if not r.is_zero():
                total += abs(state[i, j]) * r
        radii.append(arb(total.upper()))
    return radii


def hull_of(intervals: Sequence[Interval]) -> Interval:
    """The smallest interval around all of them."""
    low, high = intervals[0]
    for a, b in intervals[1:]:
        low, high = low.min(a), high.max(b)
    return low, high


def between(
    before: Sequence[Interval], after: Sequence[Interval], rates: Sequence[Interval], span: arb
) -> list[Interval]:
    """The box of the states between two instants.

    x(t) <= x(0) + t max x', and x(t) <= x(h) - (h - t) min x'.
    """
    intervals: list[Interval] = []
    for (low, high), (a, b), (least, most) in zip(before, after, rates, strict=True):
        if least >= 0:
            intervals.append((low, b))
        elif most <= 0:
            intervals.append((a, high))
        else:
            up, down = span * most.max(ZERO), span * (-least).max(ZERO)
            intervals.append(((low - down).max(a - up), (high + up).min(b + down)))
    return intervals


def flat_box(box: Sequence[Interval]) -> list[float]:
    """Low, high, low, high, ..., outwards."""
    return [end for low, high in box for end in (below(low), above(high))]
