"""Linear flows, solved: x' = A x + B u + c + W w with |w| <= 1, over any span of time.

Purpose: read A, B, c, W off the derivatives of a group of states; enclose e^{At}, its integrals and
what measurable disturbances can add; the scheme's own error, as one more disturbance.
Non-goals: flows that are not linear (refused), which sets to check (`chains.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from flint import arb, arb_mat

from soter.recheck.balls import HALF, ONE, ZERO, exact, magnitude
from soter.recheck.model import control_inputs
from soter.recheck.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.recheck.model import Model

    Matrix = list[list[arb]]

PIECES = 16
"""Into how many pieces a span of time is cut where a kernel may change its sign."""
TAYLOR = 24


@dataclass(frozen=True, eq=False)
class Motion:
    """States at a time t within a span, from those at time 0.

    x(t) in state x + control u + constant +- noise, the coefficients being balls over the span.
    """

    state: Matrix
    control: Matrix
    constant: list[arb]
    noise: list[arb]


@dataclass(frozen=True, eq=False)
class LinearFlow:
    """One group. `members`: its states; `noise`: columns W; `controls` with their ranges."""

    members: tuple[int, ...]
    a: Matrix
    b: Matrix
    constant: list[arb]
    noise: Matrix
    ranges: tuple[tuple[arb, arb], ...]

    def free(self) -> LinearFlow:
        """The same with every control an arbitrary measurable function into its set."""
        constant = list(self.constant)
        noise = [list(row) for row in self.noise]
        for k, (low, high) in enumerate(self.ranges):
            for i, row in enumerate(self.b):
                constant[i] += row[k] * (low + high) * HALF
                noise[i].append(row[k] * (high - low) * HALF)
        empty: Matrix = [[] for _ in self.members]
        return LinearFlow(self.members, self.a, empty, constant, noise, ())

    def motion(self, start: Fraction, end: Fraction) -> Motion:
        """For all times in [start, end], in s; both may be negative."""
        n, m = len(self.members), len(self.ranges)
        size = n + m + 1
        full = [[ZERO] * size for _ in range(size)]
        for i in range(n):
            full[i][:n] = self.a[i]
            full[i][n : n + m] = self.b[i]
            full[i][n + m] = self.constant[i]
        e = exponential(full, start, end)
        longest = max(abs(start), abs(end))
        backwards = start < 0
        if backwards and end > 0:
            sides = [self._noise(-start, backwards=True), self._noise(end, backwards=False)]
            noise = [x.max(y) for x, y in zip(*sides, strict=True)]
        else:
            noise = self._noise(longest, backwards=backwards)
        return Motion(
            [row[:n] for row in e[:n]],
            [row[n : n + m] for row in e[:n]],
            [row[n + m] for row in e[:n]],
            noise,
        )

    def _noise(self, time: Fraction, *, backwards: bool) -> list[arb]:
        """The integral of |e^{As} W| over [0, time], for each state."""
        n = len(self.members)
        if time == 0:
            return [ZERO] * n
        a = [[-x for x in row] for row in self.a] if backwards else self.a
        count = len(self.noise[0])
        if count == 0:
            return [ZERO] * n
        whole = integral(a, time)
        pieces = [exponential(a, time * k / PIECES, time * (k + 1) / PIECES) for k in range(PIECES)]
        found = []
        for i in range(n):
            total = ZERO
            for k in range(count):
                column = [row[k] for row in self.noise]
                over = [_dot(piece[i], column) for piece in pieces]
                total += _absolute_integral(_dot(whole[i], column), over, exact(time) / PIECES)
            found.append(arb(total.upper()))
        return found


def _absolute_integral(whole: arb, over: Sequence[arb], share: arb) -> arb:
    """A bound on the integral of |f| from that of f and its ranges over equal pieces of time.

    |f| = f + 2 max(-f, 0) = -f + 2 max(f, 0).
    """
    below_zero, above_zero, size = ZERO, ZERO, ZERO
    for x in over:
        below_zero += ZERO.max(arb((-x).upper()))
        above_zero += ZERO.max(arb(x.upper()))
        size += magnitude(x)
    bounds = (whole + 2 * share * below_zero, 2 * share * above_zero - whole, share * size)
    return min((arb(b.upper()) for b in bounds), key=float)


def _dot(a: Sequence[arb], b: Sequence[arb]) -> arb:
    total = ZERO
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


# ---------------------------------------------------------------- matrices


def _reach(a: Matrix) -> list[list[bool]]:
    """Which entries of e^{At} can differ from the identity's: paths of the graph of A."""
    n = len(a)
    found = [[not a[i][j].is_zero() for j in range(n)] for i in range(n)]
    for k in range(n):
        for i in range(n):
            if found[i][k]:
                for j in range(n):
                    found[i][j] = found[i][j] or found[k][j]
    return found


def _cleaned(a: Matrix, e: Matrix) -> Matrix:
    """What is 0 or 1 by structure is exactly that."""
    reach = _reach(a)
    return [
        [x if reach[i][j] else (ONE if i == j else ZERO) for j, x in enumerate(row)]
        for i, row in enumerate(e)
    ]


def _times(a: Matrix, b: Matrix) -> Matrix:
    return (arb_mat(a) * arb_mat(b)).tolist()


def exponential(a: Matrix, start: Fraction, end: Fraction) -> Matrix:
    """e^{At} for all t in [start, end]: exact in the middle, a Taylor series around it."""
    middle, half = exact((start + end) / 2), exact((end - start) / 2)
    n = len(a)
    at_middle = (arb_mat(a) * middle).exp().tolist()
    if start == end:
        return _cleaned(a, at_middle)
    around = [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]
    power, absolute = a, [[magnitude(x) for x in row] for row in a]
    reached = absolute
    factor = ONE
    for k in range(1, TAYLOR + 1):
        factor = factor * half / k
        # t^k over [-half, half]: all of [-1, 1] for odd k, [0, 1] for even k
        span = arb(0, 1) if k % 2 else arb(0.5, 0.5)
        for i in range(n):
            for j in range(n):
                around[i][j] += power[i][j] * (factor * span)
        power = _times(power, a)
        reached = _times(reached, absolute)
    size = max((float(sum(row, ZERO).upper()) for row in absolute), default=0.0)
    ratio = exact(size) * half / (TAYLOR + 2)
    if not ratio < HALF:
        raise NotRecheckedError("a span of time too long for these rates")
    tail = factor * half / (TAYLOR + 1) * 2
    for i in range(n):
        for j in range(n):
            # later powers: |A|^(K+1) h^(K+1)/(K+1)! (1 + |A| h/(K+2) + ...), bounded by row sums
            bound = arb(sum(reached[i], ZERO).upper())
            around[i][j] += bound * tail * arb(0, 1)
    return _cleaned(a, _times(at_middle, around))


def integral(a: Matrix, time: Fraction) -> Matrix:
    """The integral of e^{As} over [0, time]."""
    n = len(a)
    full = [[ZERO] * (2 * n) for _ in range(2 * n)]
    for i in range(n):
        full[i][:n] = a[i]
        full[i][n + i] = ONE
    e = exponential(full, time, time)
    return [row[n:] for row in e[:n]]


# ---------------------------------------------------------------- reading


def linear_flow(model: Model, members: Sequence[int]) -> LinearFlow:
    """The flow of a group; what other groups do to it counts as a disturbance."""
    a, b, constant, noise = _whole(model)
    error = _scheme_error(model, a, b, constant, noise)
    inside = set(members)
    rows_noise: Matrix = []
    rows_constant = []
    for i in members:
        extra = []
        c = constant[i]
        for j, (low, high) in enumerate(model.extents):
            if j not in inside and not a[i][j].is_zero():
                x, y = exact(low), exact(high)
                c += a[i][j] * (x + y) * HALF
                extra.append((j, a[i][j] * (y - x) * HALF))
        outside = [ZERO] * len(model.extents)
        for j, x in extra:
            outside[j] = x
        own = [error[i] if k == i else ZERO for k in members]
        rows_noise.append([*noise[i], *outside, *own])
        rows_constant.append(c)
    used = [k for k in range(len(rows_noise[0])) if not all(r[k].is_zero() for r in rows_noise)]
    return LinearFlow(
        tuple(members),
        [[a[i][j] for j in members] for i in members],
        [list(b[i]) for i in members],
        rows_constant,
        [[r[k] for k in used] for r in rows_noise],
        tuple((exact(c.low), exact(c.high)) for c in model.facts.controls),
    )


def _whole(model: Model) -> tuple[Matrix, Matrix, list[arb], Matrix]:
    """A, B, c and W of all states together."""
    terms, states = model.new_terms()
    controls = control_inputs(model.facts, terms)
    rates, disturbances = model.rates(terms, states, controls)

    def index(x: object) -> int:
        (atom,) = x.terms  # type: ignore[attr-defined]
        return int(atom)

    columns = [[index(x) for x in group] for group in (states, controls, disturbances)]
    known = {k for group in columns for k in group}
    a, b, constant, noise = [], [], [], []
    for rate in rates:
        if not set(rate.terms) <= known or not rate.radius.is_zero():
            raise NotRecheckedError("a flow that is not linear is not rechecked yet")
        a.append([rate.terms.get(k, ZERO) for k in columns[0]])
        b.append([rate.terms.get(k, ZERO) for k in columns[1]])
        c, row = rate.const, []
        for k in columns[2]:
            low, high = terms.atoms[k].low, terms.atoms[k].high
            factor = rate.terms.get(k, ZERO)
            c += factor * (low + high) * HALF
            row.append(factor * (high - low) * HALF)
        constant.append(c)
        noise.append(row)
    return a, b, constant, noise


def _scheme_error(
    model: Model, a: Matrix, b: Matrix, constant: list[arb], noise: Matrix
) -> list[arb]:
    """A bound on the constant extra rate that turns the exact solution into the scheme's step.

    One step of the scheme is P x + Q v, the solution Phi x + Gamma v, v = B u + c + W w held. The
    extra rate r solves Gamma r = (P - Phi) x + (Q - Gamma) v, with x in the grid.
    """
    n = len(a)
    schemes = {
        (c.plant.method, c.period_ns, c.substeps) for c in model.facts.plants if c.plant is not None
    }
    if len(schemes) != 1:
        raise NotRecheckedError("plants with different schemes or periods")
    method, period_ns, substeps = schemes.pop()
    machine = Fraction(float(period_ns) / 1e9 / substeps)
    true = Fraction(period_ns, 10**9 * substeps)
    order = {"euler": 1, "rk4": 4}[method]
    phi, gamma = exponential(a, true, true), integral(a, true)
    h = exact(machine)
    p = [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]
    q = [[h if i == j else ZERO for j in range(n)] for i in range(n)]
    power = [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]
    factor = ONE
    for k in range(1, order + 1):
        power = _times(power, a)
        factor = factor * h / k
        for i in range(n):
            for j in range(n):
                p[i][j] += power[i][j] * factor
                if k < order:
                    q[i][j] += power[i][j] * factor * h / (k + 1)
    back = arb_mat(gamma).inv().tolist()
    of_x = _times(back, [[p[i][j] - phi[i][j] for j in range(n)] for i in range(n)])
    of_v = _times(back, [[q[i][j] - gamma[i][j] for j in range(n)] for i in range(n)])
    states = [magnitude(exact(lo)).max(magnitude(exact(hi))) for lo, hi in model.extents]
    rates = []
    for i in range(n):
        rate = abs(constant[i])
        for k, c in enumerate(model.facts.controls):
            rate += abs(b[i][k]) * magnitude(exact(c.low)).max(magnitude(exact(c.high)))
        for x in noise[i]:
            rate += abs(x)
        rates.append(rate)
    found = []
    for i in range(n):
        total = ZERO
        for j in range(n):
            total += magnitude(of_x[i][j]) * states[j] + magnitude(of_v[i][j]) * rates[j]
        still = rates[i].is_zero() and all(x.is_zero() for x in a[i])
        found.append(ZERO if still else arb(total.upper()))
    return found
