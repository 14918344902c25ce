"""Chains and free phases of flows that are not linear, for many forms at once.

Purpose: `LocalChains`: the steps of `inclusions/nonlinear_chains.LocalChain` over arrays of balls.
Non-goals: what they rest on, which is written there, name by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.batches.ball_arrays import BallArray, chosen, larger, smaller
from soter.certificate.batches.ball_matrices import (
    applied,
    identity,
    joined,
    picked,
    product,
    stacked,
    total,
    with_last,
)
from soter.certificate.batches.local_flows import LocalFlows, outwards, solved
from soter.certificate.reading.linearisation import TAIL
from soter.certificate.terms.arb_balls import HALF as HALF_BALL
from soter.certificate.terms.arb_balls import exact

if TYPE_CHECKING:
    from flint import arb

    from soter.certificate.batches.ball_arrays import Floats, Truths
    from soter.certificate.batches.form_arrays import Forms
    from soter.certificate.batches.local_flows import Ends, LocalModels, LocalSolutions
    from soter.certificate.inclusions.nonlinear_chains import LocalChain

    Image = tuple[tuple[Forms, list[Floats]], Truths]

ZERO, ONE, HALF = BallArray.of(0.0), BallArray.of(1.0), BallArray.of(0.5)


@dataclass(eq=False)
class Opened:
    """Forms, taken apart: ranges of states and old commands, generators, shares of memories."""

    ranges: Ends
    z: BallArray
    memories: BallArray


@dataclass(eq=False)
class States:
    """The states somewhere in a hold: rows over z, a rest each, and ranges."""

    rows: BallArray
    rest: BallArray
    box: Ends


@dataclass(eq=False)
class Commands:
    """New commands: rows over z, ranges."""

    rows: BallArray
    ranges: Ends


class LocalChains:
    """The steps of a local chain over many forms."""

    def __init__(self, chain: LocalChain) -> None:
        self.chain, self.flow = chain, LocalFlows(chain.flow)
        self.n, self.q, self.depth = chain.n, chain.q, chain.depth
        self.count = self.n + self.depth * self.q
        self.width = self.count + self.q + 1
        """Entries of z."""

    # ------------------------------------------------------------ steps of a chain

    def first(self, pieces: int, form: Forms) -> Image:
        """From a_0 to delta - e."""
        return self._hold(self._opened(form, fresh=True), pieces, fresh=True)

    def later(self, pieces: int, form: Forms) -> Image:
        """From k delta - e to (k + 1) delta - e."""
        return self._hold(self._opened(form, fresh=False), pieces, fresh=False)

    def last(self, pieces: int, form: Forms) -> Image:
        """From N delta - e over [0, e + l], the latest command still acting."""
        start = self._opened(form, fresh=False)
        boxes: list[Floats] = []
        old, way = self._old(start), self._begun(start)
        every: Truths = np.ones(1, dtype=np.bool_)
        for _ in range(pieces):
            span = BallArray.of(self.chain.span / pieces)
            way, tube, sure = self._step(start, way, old, None, span, exact(0.0))
            every, boxes = every & sure, boxes + tube
        return ((), boxes), every

    def _hold(self, start: Opened, pieces: int, *, fresh: bool) -> Image:
        """One command of SC: what it answers, and where it leads."""
        new, every = self._answered(start, fresh=fresh)
        boxes: list[Floats] = []
        way = self._begun(start)
        for span, early in self.chain.spans(pieces * self.chain.pieces, fresh=fresh):
            old = self._old(start) if early > 0 else None
            way, tube, sure = self._step(start, way, new, old, BallArray.of(span), early)
            every, boxes = every & sure, boxes + tube
        return (self._closed(start, way, new), boxes), every

    # ------------------------------------------------------------ forms

    def _opened(self, form: Forms, *, fresh: bool) -> Opened:
        """`fresh`: nothing is known of what acted before."""
        n, q = self.n, self.q
        given = n if fresh else self.count
        low, high = outwards(stacked(form[: 2 * given : 2]), stacked(form[1 : 2 * given : 2]))
        columns = 1 + 2 * n + self.depth * q + q
        z = [[ZERO] * columns for _ in range(self.width)]
        z[-1][0] = ONE
        rest = 3 * given + given * n
        for i in range(given):
            z[i][0] = form[2 * given + i]
            z[i][1 : 1 + n] = form[3 * given + i * n : 3 * given + (i + 1) * n]
            z[i][1 + n + i] = form[rest + i]
        shares = BallArray(np.zeros((self.count - n, n, 1)))
        if fresh and self.depth:
            anything = [joined([x] * self.depth) for x in self.flow.ranges]
            low, high = joined([low, anything[0]]), joined([high, anything[1]])
            for k in range(n, self.count):
                z[k][0] = (low[k] + high[k]) * HALF
                z[k][1 + n + k] = (high[k] - low[k]) * HALF
        elif self.count > n:
            common = form[rest + given :]
            shares = stacked([stacked(common[k : k + n]) for k in range(0, len(common), n)])
            for k in range(self.count - n):
                for i in range(n):
                    z[n + k][1 + n + i] = common[k * n + i] * form[rest + i]
        return Opened((low, high), stacked([stacked(row) for row in z]), shares)

    def _begun(self, start: Opened) -> States:
        n = self.n
        low, high = start.ranges
        return States(picked(self.width, 0, n), BallArray(np.zeros((n, 1))), (low[:n], high[:n]))

    def _old(self, start: Opened) -> Commands:
        n, q = self.n, self.q
        low, high = start.ranges
        return Commands(picked(self.width, n, q), (low[n : n + q], high[n : n + q]))

    def _closed(self, start: Opened, way: States, new: Commands) -> Forms:
        """The forms at the end."""
        n, q = self.n, self.q
        spread = product(way.rows, start.z)
        rests = total(abs(spread[:, 1 + n :]), axis=1) + way.rest
        ranges = [(way.box[0][i], way.box[1][i]) for i in range(n)]
        centres = [spread[i, 0] for i in range(n)]
        symbols = [spread[i, 1 + k] for i in range(n) for k in range(n)]
        radii, common = [rests[i] for i in range(n)], list[BallArray]()
        if self.depth and q:
            old = (self.depth - 1) * q
            values = joined([product(new.rows, start.z), start.z[n : n + old]])
            own = joined([new.rows[:, :n], start.memories[:old]])
            a = (2 * own - product(own, way.rows[:, :n])).mid()
            left = values[:, 1 + n :] - product(a, spread[:, 1 + n :])
            rest = applied(abs(a), way.rest) + total(abs(left), axis=1)
            for k in range(q + old):
                lows, highs = new.ranges if k < q else start.ranges
                at = k if k < q else n + k - q
                ranges.append((lows[at], highs[at]))
                centres.append(values[k, 0])
                symbols += [values[k, 1 + i] for i in range(n)]
                radii.append(rest[k])
                common += [a[k, i] for i in range(n)]
        return (*(end for pair in ranges for end in pair), *centres, *symbols, *radii, *common)

    # ------------------------------------------------------------ what SC reads

    def _answered(self, start: Opened, *, fresh: bool) -> tuple[Commands, Truths]:
        """The commands that answer the sample; their unknowns are entered into `start.z`."""
        n, q = self.n, self.q
        sample, sure = self._sampled(start, fresh=fresh)
        values = product(sample.rows, start.z)
        low, high = sample.box
        rests = total(abs(values[:, 1 + n :]), axis=1) + sample.rest
        form = [end for i in range(n) for end in (low[i], high[i])]
        form += [values[i, 0] for i in range(n)]
        form += [values[i, 1 + k] for i in range(n) for k in range(n)]
        form += [rests[i] for i in range(n)]
        inside = (low >= self.flow.domain[0]) & (high <= self.flow.domain[1])
        lines, defined = self.chain.law.of_many(tuple(form))
        sure = sure & defined & inside.all(axis=0)
        if not q:
            none = BallArray(np.zeros((0, 1)))
            return Commands(BallArray(np.zeros((0, self.width, 1))), (none, none)), sure
        width = n + TAIL
        rows = stacked([stacked(lines[k * width : (k + 1) * width]) for k in range(q)])
        gain = rows[:, :n]
        rho = rows[:, n + 1] + applied(abs(gain), sample.rest)
        self._entered(start, rho)
        answer = with_last(product(gain, sample.rows), rows[:, n])
        own = picked(self.width, self.width - 1 - q, q)  # nothing else has a share in them yet
        return Commands(answer + own, (rows[:, -2], rows[:, -1])), sure

    def _entered(self, start: Opened, rho: BallArray) -> None:
        """The spread of each new command is its own."""
        rows = self.width - 1 - self.q
        diagonal = identity(self.q) * rho[None]
        block = joined(
            [BallArray(np.zeros((self.q, start.z.centre.shape[1] - self.q, 1))), diagonal], axis=1
        )
        start.z = joined([start.z[:rows], block, start.z[-1:]])

    def _sampled(self, start: Opened, *, fresh: bool) -> tuple[States, Truths]:
        """The states when the sample was taken."""
        every: Truths = np.ones(1, dtype=np.bool_)
        if not self.depth:
            return self._begun(start), every
        n, q, chain = self.n, self.q, self.chain
        ahead = exact(0.0) if fresh else chain.span
        low, high = start.ranges
        acted = [
            BallArray(f(x.centre[n:].reshape(self.depth, q, -1), axis=0))
            for x, f in ((low, np.min), (high, np.max))
        ]
        back, on = BallArray.of(-chain.d), BallArray.of(ahead)
        box, rows, sure = self.flow.around((low[:n], high[:n]), (acted[0], acted[1]), back, on)
        local = self.flow.local(rows)
        middle, radius = BallArray.of((ahead - chain.d) * HALF_BALL), (ahead + chain.d) * HALF_BALL
        constant = local.constant
        rate = product(local.a, picked(self.width, 0, n))
        if fresh:
            middles = (self.flow.ranges[0] + self.flow.ranges[1]) * HALF
            constant = constant + applied(local.b, middles)
        else:
            rate = rate + product(local.b, picked(self.width, n, q))
        rate = with_last(rate, constant)
        values = product(rate, start.z)
        other = self._others(start, fresh=fresh)
        size = total(abs(values[:, 1:]), axis=1)
        now = values[:, 0] - size, values[:, 0] + size
        least = most = BallArray(np.zeros((n, 1)))
        spreads = applied(abs(local.b), other)
        for far, side in ((chain.d, -radius), (ahead, radius)):
            reach = BallArray.of(far)
            off = reach * self._noise_until(local, reach)
            if fresh:
                off = off + reach * spreads
            ends = BallArray.of(side) * now[0], BallArray.of(side) * now[1]
            least = least.min(ends[0].min(ends[1]) - off)
            most = most.max(ends[0].max(ends[1]) + off)
        rest = (most - least) * HALF
        if not fresh:
            rest = rest + spreads
        moved = with_last(picked(self.width, 0, n) + rate * middle, (least + most) * HALF)
        return States(moved, rest, box), sure

    @staticmethod
    def _noise_until(local: LocalModels, far: BallArray) -> BallArray:
        """How far the mean rate up to `far` is from that now."""
        low, high = local.rates
        return local.noise + applied(abs(local.a), abs(low).max(abs(high))) * far * HALF

    def _others(self, start: Opened, *, fresh: bool) -> BallArray:
        """The integral of what other commands than the latest differ from it."""
        n, q = self.n, self.q
        if fresh:
            return (self.flow.ranges[1] - self.flow.ranges[0]) * HALF
        z, (low, high) = start.z, start.ranges
        gaps = [BallArray(np.zeros((q, 1)))]
        for at in range(1, self.depth):
            one, other = slice(n, n + q), slice(n + at * q, n + (at + 1) * q)
            apart = (high[one] - low[other]).max(high[other] - low[one]).max(ZERO)
            gaps.append(total(abs(z[one] - z[other]), axis=1).min(apart))
        integral = BallArray(np.zeros((q, 1)))
        for at, reach in enumerate(self.chain.behind[:-1]):
            length = BallArray.of(reach - self.chain.behind[at + 1])
            integral = integral + length * gaps[at].max(gaps[at + 1])
        return integral

    # ------------------------------------------------------------ one step

    def _step(
        self,
        start: Opened,
        way: States,
        new: Commands,
        old: Commands | None,
        span: BallArray,
        early: arb,
    ) -> tuple[States, list[Floats], Truths]:
        """`span` later; up to `early` the old commands may act. The boxes of all states between."""
        ranges = new.ranges
        if old is not None:
            ranges = ranges[0].min(old.ranges[0]), ranges[1].max(old.ranges[1])
        box, lines, sure = self.flow.around(way.box, ranges, ZERO, span)
        local = self.flow.local(lines)
        law = solved(local, span)
        rows = product(law.state, way.rows) + product(law.control, new.rows)
        noise = law.noise
        if old is not None:
            more, noise = self._handed_over(start, local, law, (old, new), early)
            rows = rows + more
        rows = with_last(rows, law.constant)
        return *self._after(start, way, local, law, (rows, noise, box, span)), sure

    def _after(
        self,
        start: Opened,
        way: States,
        local: LocalModels,
        law: LocalSolutions,
        found: tuple[BallArray, BallArray, Ends, BallArray],
    ) -> tuple[States, list[Floats]]:
        """The states at the end of a step with these rows, and between."""
        rows, noise, box, span = found
        rest = BallArray((applied(abs(law.state), way.rest) + noise).upper())
        values = product(rows, start.z)
        radius = total(abs(values[:, 1:]), axis=1) + rest
        low = larger(values[:, 0] - radius, box[0])
        high = smaller(values[:, 0] + radius, box[1])
        low, high = outwards(low, high)
        still = (local.rates[0] >= 0) & (local.rates[1] <= 0)
        after = self.flow.clipped((chosen(still, way.box[0], low), chosen(still, way.box[1], high)))
        tube = self.flow.clipped(_between(way.box, after, local.rates, span))
        lows, highs = tube[0].lower(), tube[1].upper()
        flat = [end for i in range(self.n) for end in (lows[i], highs[i])]
        return States(rows, rest, after), flat

    def _handed_over(
        self,
        start: Opened,
        local: LocalModels,
        law: LocalSolutions,
        commands: tuple[Commands, Commands],
        early: arb,
    ) -> tuple[BallArray, BallArray]:
        """The old command acts until some t <= early: rows that it adds, and all noise."""
        old, new = commands
        until = BallArray.of(early)
        some = BallArray.between(np.zeros(1), until.upper())
        square = some * until * HALF
        rows = total(abs(local.a), axis=1)
        theta = BallArray(rows.upper().max(axis=0)) * until
        # e^x <= 1 + x + x^2 for x <= 1
        growth = chosen(theta <= 1, ONE + theta + theta * theta, BallArray.of(np.inf))
        rest = (until * theta * theta * growth * BallArray.of(1 / exact(6.0))).upper()
        inner = identity(self.n) * some
        curved = BallArray(np.zeros_like(rest), rest) - local.a * square
        inner = inner + chosen((rows.upper() > 0)[:, None], curved, ZERO)
        reach = product(product(law.state, inner), local.b)
        gap = old.rows - new.rows
        values = product(gap, start.z)
        (a, b), (c, d) = old.ranges, new.ranges
        size = total(abs(values), axis=1).min((b - c).max(d - a).max(ZERO))
        assert reach.radius is not None
        noise = law.noise + applied(BallArray(reach.radius), size)
        return product(reach.mid(), gap), noise

    # ------------------------------------------------------------ free phases

    def free(self, time: arb, pieces: int, form: Forms) -> Image:
        """Over [0, time] under any commands."""
        start = self._opened(form, fresh=True)
        boxes: list[Floats] = []
        way = self._begun(start)
        every: Truths = np.ones(1, dtype=np.bool_)
        low, high = self.flow.ranges
        middles, radii = (low + high) * HALF, (high - low) * HALF
        span = BallArray.of(time / pieces)
        for _ in range(pieces):
            box, lines, sure = self.flow.around(way.box, self.flow.ranges, ZERO, span)
            local = self.flow.local(lines)
            local.noise = local.noise + applied(abs(local.b), radii)
            law = solved(local, span)
            drift = applied(law.control, middles) + law.constant
            rows = with_last(product(law.state, way.rows), drift)
            way, tube = self._after(start, way, local, law, (rows, law.noise, box, span))
            every, boxes = every & sure, boxes + tube
        return ((), boxes), every


def _between(before: Ends, after: Ends, rates: Ends, span: BallArray) -> Ends:
    """The boxes of the states between two instants."""
    (low, high), (a, b), (least, most) = before, after, rates
    up, down = span * most.max(ZERO), span * (-least).max(ZERO)
    rising, falling = least >= 0, most <= 0
    lows = chosen(rising, low, chosen(falling, a, (low - down).max(a - up)))
    return lows, chosen(rising, b, chosen(falling, high, (high + up).min(b + down)))
