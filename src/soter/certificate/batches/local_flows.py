"""Flows that are not linear over many boxes at once.

Purpose: `LocalFlows`: what `inclusions/nonlinear_flow.py` says of a box, of arrays of boxes.
Non-goals: its arguments, which stand there. Chains (`local_chains.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.batches.ball_arrays import GROWN, BallArray, chosen
from soter.certificate.batches.ball_matrices import (
    applied,
    constants,
    identity,
    joined,
    product,
    stacked,
    total,
)
from soter.certificate.reading.linearisation import TAIL
from soter.certificate.terms.arb_balls import exact

if TYPE_CHECKING:
    from flint import arb

    from soter.certificate.batches.ball_arrays import Floats, Truths
    from soter.certificate.inclusions.nonlinear_flow import LocalFlow

    Ends = tuple[BallArray, BallArray]

ROUNDS = 8
"""How often a box is enlarged before there is none."""
LOOSE, HAIR = 1.1, 2.0**-40
TERMS_MAX = 24
REST = 2.0**-40
ZERO, HALF = BallArray.of(0.0), BallArray.of(0.5)


@dataclass(eq=False)
class LocalModels:
    """x' = a x + b u + constant +- noise over each box, and the ranges of x'."""

    a: BallArray
    b: BallArray
    constant: BallArray
    noise: BallArray
    rates: Ends


@dataclass(frozen=True, eq=False)
class LocalSolutions:
    """x(h) = state x + control u + constant +- noise for u that is constant over the step."""

    state: BallArray
    control: BallArray
    constant: BallArray
    noise: BallArray


class LocalFlows:
    """The flow of a group over many boxes; a box is two arrays, each (states, boxes)."""

    def __init__(self, flow: LocalFlow) -> None:
        self.flow, self.n, self.q = flow, flow.n, len(flow.moves)
        self.ranges: Ends = _ends(flow.ranges)
        self.domain: Ends = _ends(flow.domain)
        self.hairs = constants(flow.hairs)
        low, high = _ends(flow.grid)
        first, last = (np.array([[k[i]] for k in flow.kept]) for i in (0, 1))
        self._grid = np.where(first, low.lower(), -np.inf), np.where(last, high.upper(), np.inf)

    def clipped(self, box: Ends) -> Ends:
        """Boxes without what lies beyond ends that the flow keeps; an end of those is exact."""
        low, high = self._grid
        return (
            BallArray(np.maximum(box[0].lower(), low)),
            BallArray(np.minimum(box[1].upper(), high)),
        )

    def lines(self, box: Ends, commands: Ends) -> tuple[BallArray, Truths]:
        """The rows of the derivative over each box, and where it is defined, (boxes,)."""
        inside = (box[0] >= self.domain[0]) & (box[1] <= self.domain[1]) & (box[0] <= box[1])
        low, high = (joined([x, u]) for x, u in zip(box, commands, strict=True))
        middle, radius = (low + high) * HALF, (high - low) * HALF
        count = self.n + self.q
        form = [end for i in range(count) for end in (low[i], high[i])]
        form += [middle[i] for i in range(count)] + [radius[i] for i in range(count)]
        rows, sure = self.flow.written.of_many(tuple(form))
        whole = stacked(rows)
        assert whole.radius is not None
        shape = self.n, count + TAIL, whole.centre.shape[-1]
        rows = BallArray(whole.centre.reshape(shape), whole.radius.reshape(shape))
        return rows, sure & inside.all(axis=0)

    def around(
        self, box: Ends, commands: Ends, start: BallArray, end: BallArray
    ) -> tuple[Ends, BallArray, Truths]:
        """Boxes with every solution over [start, end], rows there, and where they are, (boxes,)."""
        trial = self.clipped(box)
        backwards = bool((start < 0).all())
        rows, defined = self.lines(trial, commands)
        held = np.zeros(1, dtype=np.bool_)
        moved, known = trial, rows
        for k in range(ROUNDS):
            now = self._moved(box, (rows[:, -2], rows[:, -1]), start, end)
            if k:
                within = ((now[0] >= trial[0]) & (now[1] <= trial[1])).all(axis=0) & defined
                fresh = within & ~held
                moved = chosen(fresh, now[0], moved[0]), chosen(fresh, now[1], moved[1])
                known = chosen(fresh, rows, known)
                held = held | within
                if (held | ~defined).all():
                    break
            trial = self.clipped(self._looser(box, now, hairs=backwards))
            rows, still = self.lines(trial, commands)
            defined = defined & still
        return moved, known, held

    def _moved(self, box: Ends, rates: Ends, start: BallArray, end: BallArray) -> Ends:
        least, most = rates
        down, up = (end * least).min(ZERO), (end * most).max(ZERO)
        if (start < 0).all():
            down, up = down.min(start * most), up.max(start * least)
        low = chosen(_is_zero(down), box[0], box[0] + down)
        high = chosen(_is_zero(up), box[1], box[1] + up)
        return self.clipped(outwards(low, high))

    def _looser(self, box: Ends, moved: Ends, *, hairs: bool) -> Ends:
        low, high = (a + (b - a) * BallArray.of(LOOSE) for a, b in zip(box, moved, strict=True))
        if hairs:
            low, high = low - self.hairs, high + self.hairs
        return outwards(low, high)

    def local(self, rows: BallArray) -> LocalModels:
        """The linear models out of the rows; a state that certainly stands still has zeros."""
        n, q = self.n, self.q
        low, high = rows[:, -2], rows[:, -1]
        rows = chosen(_is_zero(low)[:, None] & _is_zero(high)[:, None], ZERO, rows)
        parts = rows[:, :n], rows[:, n : n + q], rows[:, n + q], rows[:, n + q + 1]
        return LocalModels(*parts, (low, high))


def solved(local: LocalModels, time: BallArray) -> LocalSolutions:
    """The solution formula over a step of this length (`nonlinear_flow.solved`)."""
    n = local.a.centre.shape[0]
    integral = integral_of(local.a, time)
    diagonal = np.eye(n, dtype=np.bool_)[:, :, None]
    major = chosen(diagonal, local.a, BallArray(abs(local.a).upper()))
    return LocalSolutions(
        identity(n) + product(local.a, integral),
        product(integral, local.b),
        applied(integral, local.constant),
        applied(integral_of(major, time), local.noise),
    )


def integral_of(a: BallArray, time: BallArray) -> BallArray:
    """The integral of e^{As} over [0, time], as in `nonlinear_flow.py`; else anything."""
    scaled = a * time
    rows = total(abs(scaled), axis=1).upper()
    theta = rows.max(axis=0)
    largest = float(np.max(theta, where=np.isfinite(theta), initial=0.0))
    count, size = 1, largest * 0.5
    while count < TERMS_MAX and not size < REST:
        count += 1
        size *= largest / (count + 1)
    one = identity(a.centre.shape[0])
    integral, rest = one, theta * 0.5 * GROWN
    for k in range(count, 1, -1):
        integral = one + product(scaled, integral) * BallArray.of(1 / exact(float(k)))
        rest = rest * theta / (k + 1) * GROWN
    share = 1.0 - theta / (count + 2) * GROWN
    rest = np.where(theta < count + 1, rest / share * GROWN, np.inf) * time.upper() * GROWN
    rest = np.where(rows > 0, rest, 0.0)[:, None]
    integral = integral * time
    return integral + _spread(rest, integral)


def _spread(rest: Floats, like: BallArray) -> BallArray:
    """0 +- rest."""
    shape = np.broadcast_shapes(rest.shape, like.centre.shape)
    return BallArray(np.zeros(shape), np.broadcast_to(rest, shape))


def outwards(low: BallArray, high: BallArray) -> Ends:
    """Ends without radius."""
    return BallArray(low.lower()), BallArray(high.upper())


def _is_zero(x: BallArray) -> Truths:
    zero: Truths = x.centre == 0
    return zero if x.radius is None else zero & (x.radius == 0)


def _ends(intervals: list[tuple[arb, arb]]) -> Ends:
    return constants([a for a, _ in intervals]), constants([b for _, b in intervals])
