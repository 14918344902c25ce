"""Linear modules at random, and an adversary who times everything against them.

Purpose: `random_group`, and `Attack`: SC-runs as docs/proof.md has them, from the border of K,
in which each component of a command switches when it hurts most inside its window, reads are as old
or as fresh as hurts most, errors and disturbances stand at their bounds.
Non-goals: sharing anything with what bounds the flows: here they are stepped by series, 1 ms at a
time, exact for inputs that are constant in between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.polytope.half_spaces import LinearProgram, Polytope
from soter.verify.polytope.linear_group import LinearGroup

if TYPE_CHECKING:
    from soter.verify.polytope.matrices import Array

MS = 1_000_000
H = 1e-3
LOOKS_AHEAD = (1, 1, 2, 4, 12)
"""In periods: after how many a half-space is to be broken."""


@dataclass
class Excess:
    """By how much C was exceeded at any time, and K at nominal times; in the units of the rows."""

    constraint: float
    core: float
    nominal: list[Array] = field(default_factory=list)
    """States at nominal times."""


def series(a: Array, t: float) -> tuple[Array, Array]:
    """(e^{At}, int e^{As})."""
    halvings = max(0, math.ceil(math.log2(max(np.abs(a).sum(axis=1).max() * abs(t), 1e-9))) + 6)
    n = len(a)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = a, np.eye(n)
    step, total = block * t / 2**halvings, np.eye(2 * n)
    term = total
    for k in range(1, 16):
        term = term @ step / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total[:n, :n], total[:n, n:]


def random_group(rng: np.random.Generator, *, delay_ms: int, jitter_ms: int) -> LinearGroup:
    """One or two pushed axes, coupled, perhaps behind a lag, with a law that holds them."""
    axes = int(rng.integers(1, 3))
    lag = bool(rng.random() < 0.4)
    per = 3 if lag else 2
    n = per * axes
    a, b = np.zeros((n, n)), np.zeros((n, axes))
    gain = np.zeros((axes, n))
    high = np.zeros(n)
    for k in range(axes):
        at = per * k
        a[at, at + 1] = 1.0
        a[at + 1, at + 1] = -rng.uniform(0.0, 0.3)
        rate = rng.uniform(10.0, 20.0)
        if lag:
            a[at + 1, at + 2], a[at + 2, at + 2], b[at + 2, k] = 1.0, -rate, rate
        else:
            b[at + 1, k] = 1.0
        p = rng.uniform(1.0, 2.5)
        gain[k, at], gain[k, at + 1] = -p, -rng.uniform(1.6, 2.2) * math.sqrt(p)
        high[at : at + per] = [1.5, 6.0, 6.0][:per]
    if axes > 1:
        a[1, per], a[per + 1, 0] = rng.uniform(-0.1, 0.1, 2)
    drift = np.zeros(n)
    drift[1::per] = rng.uniform(0.05, 0.2, axes)
    error = np.zeros(n)
    error[0::per], error[1::per] = rng.uniform(0.0, 0.02, axes), rng.uniform(0.0, 0.04, axes)
    return LinearGroup(
        state=a,
        control=b,
        drift_low=-drift,
        drift_high=drift,
        control_low=np.full(axes, -5.0),
        control_high=np.full(axes, 5.0),
        error=error,
        gain=gain,
        offset=np.zeros(axes),
        remainder=np.full(axes, 1e-9),
        law_low=np.full(axes, -5.0),
        law_high=np.full(axes, 5.0),
        low=-high,
        high=high,
        rows=np.zeros((0, n)),
        bounds=np.zeros(0),
        delta_ns=int(rng.integers(15, 31)) * MS,
        jitter_ns=jitter_ms * MS,
        delay_ns=delay_ms * MS,
    )


def border(p: Polytope, directions: Array) -> Array:
    """The point of a polytope that is extreme in each direction."""
    program = LinearProgram(p)
    return np.array([program.greatest(row)[1] for row in directions]) * (1 - 1e-10)


class Attack:
    """Many runs at once; `lead` in ms: by how much a_0 is after the start of its window."""

    def __init__(
        self, group: LinearGroup, core: Polytope, runs: int, lead: int, rng: np.random.Generator
    ) -> None:
        self.group, self.core, self.rng, self.lead = group, core, rng, lead
        self.n = len(group.low)
        self.period, self.d, self.j = (
            t // MS for t in (group.delta_ns, group.delay_ns, group.jitter_ns)
        )
        assert 0 <= lead <= self.j
        self.e, self.g = series(group.state, H)
        rows = np.concatenate([np.eye(self.n), -np.eye(self.n), core.rows])
        rows = rows[rng.integers(len(rows), size=runs)]
        whole, held = series(group.state, self.period * H)
        # what a row is worth a period earlier, were every read fresh
        back = whole + held @ group.control @ group.gain
        self.left = rng.choice(LOOKS_AHEAD, size=runs)
        self.aims = [rows]
        for _ in range(max(LOOKS_AHEAD)):
            self.aims.append(self.aims[-1] @ back)
        self.held = held
        x = border(core, np.array([self.aims[k][i] for i, k in enumerate(self.left)]))
        self._aim(0)
        self.past = [x]
        self._before(x)
        self.x, self.runs = x, runs
        self.style = rng.integers(3, size=runs)
        """0: components switch when that hurts, 1: at random ends, 2: anywhere."""

    def _aim(self, period: int) -> None:
        """Directions of commands, errors and disturbances for one period."""
        group = self.group
        ahead = np.maximum(self.left - period - 1, 0)
        aim = np.array([self.aims[k][i] for i, k in enumerate(ahead)]) @ self.held
        self.push = aim @ group.control
        self.wind = np.sign(aim) * group.drift_high
        self.error = np.sign(self.push @ group.gain) * group.error

    def _before(self, x: Array) -> None:
        """States before a_0 under any command; where that leaves C, nothing old is read."""
        group, rng = self.group, self.rng
        e, g = series(-group.state, H)
        u = rng.choice([-1.0, 1.0], self.push.shape) * group.control_high
        w = rng.choice([-1.0, 1.0], x.shape) * group.drift_high
        back, fine = [x], np.ones(len(x), dtype=bool)
        for _ in range(self.d + self.j):
            back.append(back[-1] @ e.T - (u @ group.control.T + w) @ g.T)
            fine &= (np.abs(back[-1]) <= group.high).all(axis=1)
        self.past = [np.where(fine[:, None], y, x) for y in back[:0:-1]] + [x]
        self.oldest = np.where(fine, -(self.d + self.j), 0)

    def _read(self, first: Array, last: Array, now: int) -> Array:
        """The command after a read within [first, last]: of the state that hurts most."""
        group = self.group
        best = np.full(self.runs, -np.inf)
        commands = np.zeros(self.push.shape)
        first = np.minimum(np.maximum(first, self.oldest), last)
        for age in range(self.d + self.j + 1):
            at = now - age
            if at < -(self.d + self.j):
                break
            y = self.past[at + self.d + self.j] + self.error
            u = np.clip(y @ group.gain.T + group.offset, group.control_low, group.control_high)
            value = np.where((first <= at) & (at <= last), (u * self.push).sum(axis=1), -np.inf)
            commands = np.where((value > best)[:, None], u, commands)
            best = np.maximum(best, value)
        assert np.isfinite(best).all()
        return commands

    def _offsets(self, u: Array, now: int) -> Array:
        """When, after the start of its window, every component switches."""
        here = np.full(self.runs, now)
        new = self._read(here - self.d, here, now)
        eager = np.where(self.push * (new - u) > 0, 0, self.j)
        ends = self.rng.choice([0, self.j], self.push.shape)
        offsets = np.where((self.style == 0)[:, None], eager, ends)
        anywhere = self.rng.integers(0, self.j + 1, self.push.shape)
        offsets = np.where((self.style == 2)[:, None], anywhere, offsets)
        # one read serves all: it lies in [latest - d, earliest]
        spread = offsets.max(axis=1, keepdims=True) - offsets
        last = offsets.max(axis=1, keepdims=True)
        return np.asarray(last - np.minimum(spread, self.d))

    def run(self, periods: int) -> Excess:
        """The runs go on for so many periods."""
        group, rows, limits = self.group, *self.core.faces
        u = self._read(np.full(self.runs, -self.d), np.zeros(self.runs, dtype=int), 0)
        coming = u
        offsets = np.zeros(self.push.shape, dtype=int)
        worst = Excess(-np.inf, -np.inf)
        for t in range(periods * self.period + 1):
            if t and t % self.period == 0:
                worst.core = max(worst.core, float((self.x @ rows.T - limits).max()))
            if t % self.period == 0:
                worst.nominal.append(self.x)
                self._aim(t // self.period)
            since = (t + self.lead) % self.period
            if since == 0 and t + self.lead >= self.period:
                offsets = self._offsets(u, t)
            if since <= self.j and t + self.lead >= self.period:
                reading = offsets.min(axis=1) == since
                if reading.any():
                    start = t - since
                    last = np.full(self.runs, t)
                    seen = self._read(start + offsets.max(axis=1) - self.d, last, t)
                    coming = np.where(reading[:, None], seen, coming)
                u = np.where(offsets == since, coming, u)
            self.x = self.x @ self.e.T + (u @ group.control.T + self.wind) @ self.g.T
            self.past.append(self.x)
            out = np.maximum(self.x - group.high, group.low - self.x)
            worst.constraint = max(worst.constraint, float(out.max()))
        return worst
