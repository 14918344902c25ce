"""A linear group as numbers, and how its flow moves half-spaces.

Purpose: `LinearGroup` holds x' = A x + B u + drift, the SC law u = K y + k on it, and its times.
`Hold` is one period of an SC run, `FreePhase` a time in which any control of U acts. Both map a row
c at a time t to (row, loss) with c x(t) <= row x(0) + loss; every bound is rounded outward.
Non-goals: polytopes (`half_spaces.py`), proofs (`proofs.py`).

Where the bounds come from, for one row c and drift = b + w, w symmetric after centring:
- c x(t) = c e^{At} x0 + c G(t) (B u + b) + int_0^t c e^{As} w(t - s) ds, G(t) = int_0^t e^{As} ds;
- the last term is at most nu(t) = int_0^t sum_i |c e^{As}|_i w_i ds, by trapezoids: |f| is at most
  the interpolation of |f| at the ends plus h^2/8 sup |f''|; nu does not decrease;
- between two grid times the deterministic part phi exceeds its ends by at most h^2/8 sup |phi''|,
  and phi'' = c A e^{At} (A x0 + B u + b), which |c A| e^{|A| t} D bounds, where D is the greatest
  |A x + B u + b| over the extent and U.
- Hold k lies at the nominal times [n_k, n_(k+1)], n_k = a_0 + k delta: counted from the instant at
  which the first output of SC acts with all its components, at which the state is in K; nothing
  lies between a_0 and n_0. Every a_k^i is in t_0 + k delta + [0, j] and so is a_0 for k = 0, hence
  a_k^i = n_k - p + [0, j] with one 0 <= p = a_0 - t_0 <= j for all k and i (docs/proof-sets.md).
- The read of hold k is y = x(n_k + s) + e, -d - j <= s <= j, and x(n + s) = x(n) + int x' with
  |x(n + s) - x(n)| <= |s| e^{|A||s|} (D + w). So K y is K (x - d/2 (A x + b + B u_c)) up to
  (d/2 + j) |K (A x + b + B u_c)| + (d + j) (|K B| u_r + |K| w)
  + (d + j)^2/2 |K A| e^{|A|(d + j)} (D + w) + |K| e; `rate` bounds the first factor at nominal
  times and is one of the set's half-spaces. Commands are anything in U there.
- Component i of hold k is that of u_(k-1) before a_k^i and that of u_(k+1) from a_(k+1)^i on: for
  at most j - p and p, in all j; 2 j <= delta keeps all others out. So an input of
  |u_(k+-1) - u_k|_i acts for j beside the command. The two reads lie in
  t_0 + k delta + [-d, j] and in the same a period off: at most delta + d + j apart.
- u_(k+1) is linear although x(n_(k+1)) in K is only shown with it: had no component of it acted
  before n_(k+1), the state would be in K there, and the read came before the first of them acted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TypeAlias

import numpy as np

from soter.verify.polytope.matrices import (
    Array,
    Ball,
    centred,
    exact,
    exponential,
    seconds,
    up_product,
    up_sum,
    up_times,
)

Pairs: TypeAlias = list[tuple[Ball, Array]]
"""Pairs (row, loss) or (row, limit), of N rows each."""

HOLD_STEPS = 2
FREE_STEP_NS = 10_000_000


def hold_instants(delta_ns: int) -> tuple[int, ...]:
    """The times of a hold, in ns, at which bounds are computed; those between are bounded, too."""
    return tuple(delta_ns * k // HOLD_STEPS for k in range(HOLD_STEPS + 1))


def free_instants(until_ns: int) -> tuple[int, ...]:
    """The times of a free phase, in ns, at which bounds are computed."""
    steps = max(1, -(-until_ns // FREE_STEP_NS))
    return tuple(until_ns * k // steps for k in range(steps + 1))


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearGroup:
    """x' = A x + B u + drift with n states and m controls; SI units; all numbers exact doubles.

    SC publishes u = gain y + offset, up to `remainder`, while gain y + offset lies between
    `law_low` and `law_high` (m,); y is its estimate.
    """

    state: Array
    """The matrix A, (n, n)."""
    control: Array
    """The matrix B, (n, m)."""
    drift_low: Array
    """The rest of x', (n,), at least: constants, disturbance, remainder, earlier groups."""
    drift_high: Array
    control_low: Array
    """The lower ends of U, the range of the controls, (m,)."""
    control_high: Array
    error: Array
    """E: measurement errors lie within +-error, (n,)."""
    gain: Array
    """K, the gain of SC, (m, n)."""
    offset: Array
    remainder: Array
    law_low: Array
    law_high: Array
    low: Array
    """The lower ends of the extent, (n,): states outside count as unsafe."""
    high: Array
    rows: Array
    """Further half-spaces rows x <= bounds of C, (q, n)."""
    bounds: Array
    delta_ns: int
    """The period of SC."""
    jitter_ns: int = 0
    delay_ns: int = 0
    """d: how old the state may be that a command answers when it begins to act."""

    def equals(self, other: LinearGroup) -> bool:
        """Whether every number is the same, bit for bit, so that the same is proved of both."""
        for name in (f.name for f in fields(self)):
            own, its = np.asarray(getattr(self, name)), np.asarray(getattr(other, name))
            if (own.dtype, own.shape, own.tobytes()) != (its.dtype, its.shape, its.tobytes()):
                return False
        return True

    @cached_property
    def drift(self) -> tuple[Array, Array]:
        """Centre and radius of the drift, (n,) each."""
        return centred(self.drift_low, self.drift_high)

    @cached_property
    def controls(self) -> tuple[Array, Array]:
        """Centre and radius of U, (m,) each."""
        return centred(self.control_low, self.control_high)

    @cached_property
    def extent(self) -> tuple[Array, Array]:
        """Centre and radius of the grid's extent, (n,) each."""
        return centred(self.low, self.high)

    @cached_property
    def reach(self) -> Array:
        """The largest |x_i| on the extent, (n,)."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @cached_property
    def constant(self) -> Ball:
        """The constant part of x': b + B u_c."""
        return exact(self.drift[0]) + exact(self.control) @ exact(self.controls[0])

    @cached_property
    def speed(self) -> Array:
        """D, (n,): an upper bound of |A x + B u + b| for x in the extent and u in U."""
        centre, radius = self.extent
        middle = (exact(self.state) @ exact(centre) + self.constant).magnitude()
        spread = up_product(np.abs(self.state), radius)
        return up_sum(middle, spread, up_product(np.abs(self.control), self.controls[1]))

    def growth(self, time_ns: int) -> Array:
        """An upper bound (n, n) of e^{|A| s} for 0 <= s <= t."""
        return exponential(np.abs(self.state), time_ns)[0].magnitude()

    def sagging(self, rows: Ball, step_ns: int, until_ns: int) -> Array:
        """h^2/8 sup |phi''| of the head of this file for each row; (N, n) -> (N,)."""
        second = up_product((rows @ exact(self.state)).magnitude(), self.growth(until_ns))
        h = float(seconds(step_ns).upper())
        return up_times(up_product(second, self.speed), h, h, 0.125)


@dataclass(frozen=True, eq=False)
class TimeGrid:
    """Times 0 = t_0 < ... < t_q with e^{At} and its integral at each."""

    group: LinearGroup
    times_ns: tuple[int, ...]

    @cached_property
    def maps(self) -> list[tuple[Ball, Ball]]:
        """(e^{At}, G(t)) at every time."""
        return [exponential(self.group.state, t) for t in self.times_ns]

    @cached_property
    def step_ns(self) -> int:
        """The longest step between two times of the grid, in ns."""
        return max(
            (b - a for a, b in zip(self.times_ns, self.times_ns[1:], strict=False)), default=0
        )

    def noise(self, rows: Ball, columns: Ball) -> Array:
        """The bound nu at every time, (q + 1, N), of the input columns (n, k) with |w_k| <= 1."""
        group = self.group
        ends = [
            (rows @ e @ columns).magnitude().sum(axis=-1) * (1 + 2.0**-40) for e, _ in self.maps
        ]
        growth = group.growth(self.times_ns[-1])
        a = np.abs(group.state)
        bend = up_product(rows.magnitude(), up_product(a, a))
        bend = up_product(up_product(bend, growth), columns.magnitude())
        total = np.zeros(rows.mid.shape[0])
        bounds = [total]
        for k in range(len(self.times_ns) - 1):
            h = float(seconds(self.times_ns[k + 1] - self.times_ns[k]).upper())
            area = up_times(up_sum(ends[k], ends[k + 1]), h, 0.5)
            area = up_sum(area, up_times(bend.sum(axis=-1) * (1 + 2.0**-40), h, h, h, 0.125))
            total = up_sum(total, area)
            bounds.append(total)
        return np.array(bounds)


class FreePhase:
    """A time in which any control of U acts: R(t) is computed by it."""

    def __init__(self, group: LinearGroup, until_ns: int) -> None:
        self.group = group
        self.grid = TimeGrid(group, free_instants(until_ns))

    def everywhere(self, rows: Ball) -> Pairs:
        """Pairs (row, loss): c x(t) <= max of row x0 + loss for t in the whole [0, until]."""
        group, grid = self.group, self.grid
        push = exact(group.control).times(exact(group.controls[1]))
        drift = np.diag(group.drift[1])
        both = Ball(np.hstack([push.mid, drift]), np.hstack([push.rad, np.zeros_like(drift)]))
        noise = grid.noise(rows, both)
        sag = group.sagging(rows, grid.step_ns, grid.times_ns[-1])
        pairs = []
        for k, (e, g) in enumerate(grid.maps):
            later = noise[min(k + 1, len(noise) - 1)]
            pairs.append((rows @ e, up_sum((rows @ g @ group.constant).upper(), later, sag)))
        return pairs


class Hold:
    """One hold (period) of an SC run: [k delta, (k + 1) delta] after its first output acted."""

    def __init__(self, group: LinearGroup, rate: Array) -> None:
        """`rate` (m,): a bound of |K (A x + b + B u_c)| on the set, where commands are `timed`."""
        self.group = group
        self.rate = rate
        self.timed = group.delay_ns + group.jitter_ns > 0
        self.grid = TimeGrid(group, hold_instants(group.delta_ns))
        gain = exact(group.gain)
        half = exact(group.delay_ns / 1e9 / 2)
        self.rate_rows = gain @ exact(group.state)
        self.rate_offset = gain @ group.constant
        self.gain = gain - self.rate_rows.times(half)
        self.offset = exact(group.offset) - self.rate_offset.times(half)
        self.constant = exact(group.control) @ self.offset + exact(group.drift[0])
        self.spread = up_sum(group.remainder, self._read_error())
        self.other = self._neighbour_difference()

    def _push_bound(self) -> Array:
        """A bound of |K (B (u - u_c) + w)|: how fast commands and drift move K x."""
        group = self.group
        steered = (exact(group.gain) @ exact(group.control)).magnitude()
        steered = up_product(steered, group.controls[1])
        return up_sum(steered, up_product(np.abs(group.gain), group.drift[1]))

    def _bend_bound(self, time_ns: int) -> Array:
        """A bound of |K A (x(s) - x(a))| / |s - a| for |s - a| <= `time_ns`, x(a) in the extent."""
        group = self.group
        away = up_product(group.growth(time_ns), up_sum(group.speed, group.drift[1]))
        return up_product(self.rate_rows.magnitude(), away)

    def _read_error(self) -> Array:
        """A bound of what errors and ages of reads change in the command, beyond the age d / 2."""
        group = self.group
        error = up_product(np.abs(group.gain), group.error)
        if not self.timed:
            return error
        far = float(seconds(group.delay_ns + group.jitter_ns).upper())
        off = float(seconds(group.delay_ns + 2 * group.jitter_ns).upper()) * 0.5 * (1 + 2.0**-40)
        bend = up_times(self._bend_bound(group.delay_ns + group.jitter_ns), far, far, 0.5)
        return up_sum(error, up_times(self.rate, off), up_times(self._push_bound(), far), bend)

    def _neighbour_difference(self) -> Array:
        """A bound of |u_(k+-1) - u_k|: the neighbours' commands may act near the hold's ends."""
        group = self.group
        if group.jitter_ns == 0:
            return np.zeros(len(self.rate))
        apart_ns = group.delta_ns + group.delay_ns + group.jitter_ns
        apart = float(seconds(apart_ns).upper())
        speed = up_sum(self.rate, self._push_bound(), up_times(self._bend_bound(apart_ns), apart))
        error = up_sum(group.remainder, up_product(np.abs(group.gain), group.error))
        return up_sum(up_times(speed, apart), up_times(error, 2.0))

    def _exchange_loss(self, rows: Ball) -> Array:
        """A bound of what the neighbours' commands, which act for j in all, add to c x."""
        group = self.group
        total = np.zeros(rows.mid.shape[0])
        if group.jitter_ns == 0:
            return total
        steer = np.max(
            [(rows @ e @ exact(group.control)).magnitude() for e, _ in self.grid.maps], 0
        )
        a = np.abs(group.state)
        bend = up_product(rows.magnitude(), up_product(a, a))
        bend = up_product(up_product(bend, group.growth(group.delta_ns)), np.abs(group.control))
        h = float(seconds(self.grid.step_ns).upper())
        steer = up_sum(steer, up_times(bend, h, h, 0.125))
        return up_times(up_product(steer, self.other), float(seconds(group.jitter_ns).upper()))

    def _mapped_rows(self, rows: Ball, maps: tuple[Ball, Ball]) -> tuple[Ball, Array]:
        e, g = maps
        through = rows @ g
        steer = through @ exact(self.group.control)
        loss = (through @ self.constant[:, None]).upper()[:, 0]
        return rows @ e + steer @ self.gain, up_sum(
            loss, up_product(steer.magnitude(), self.spread)
        )

    def everywhere(self, rows: Ball) -> Pairs:
        """Pairs (row, loss): c x(t) <= max of row x + loss at every t of the hold."""
        group = self.group
        noise = self.grid.noise(rows, exact(np.diag(group.drift[1])))
        sag = group.sagging(rows, self.grid.step_ns, group.delta_ns)
        common = up_sum(sag, self._exchange_loss(rows))
        pairs = []
        for k, maps in enumerate(self.grid.maps):
            row, loss = self._mapped_rows(rows, maps)
            pairs.append((row, up_sum(loss, noise[min(k + 1, len(noise) - 1)], common)))
        return pairs

    def after(self, rows: Ball) -> tuple[Ball, Array]:
        """(row, loss): c x <= row x + loss when the hold ends. c (N, n), loss (N,)."""
        noise = self.grid.noise(rows, exact(np.diag(self.group.drift[1])))[-1]
        row, loss = self._mapped_rows(rows, self.grid.maps[-1])
        return row, up_sum(loss, noise, self._exchange_loss(rows))

    def commands(self) -> tuple[Ball, Array, Array]:
        """(row, low, high): low <= row x <= high keeps the law linear, whatever the read was.

        Shapes: row (m, n); low and high (m,).
        """
        group = self.group
        high = -up_sum(self.offset.upper(), self.spread, -group.law_high)
        low = up_sum(-self.offset.lower(), self.spread, group.law_low)
        return self.gain, low, high
