"""Chains and free phases of flows that are not linear: forms carried over short steps.

Purpose: the functions of `chains.Chain` and `chains.FreePhase` for a group whose flow is enclosed
step by step (`nonlinear_flow.py`); forms are those of `certificate/terms/compile_terms.py`.
Non-goals: linear flows (`sc_chains.py`), sets (`group_claims.py`).

Everything is kept as rows over z: the states at the beginning of the hold, the commands that acted
before, one unknown in [-1, 1] times `rho` for each new command, and 1. `Start.z` has the generators
of z as rows over 1, the symbols of the cell, the betas of the states, those of the old commands,
and those of the new ones: ranges are sums of absolute values of `rows z`.

A command acts from e before its nominal time to l after it (`chains.Window`), w = e + l. The sample
that it answers was taken at s in [-d, w] from k delta - e, while commands acted
that are known: x(s) = x + s r + rest, with r = A x + B u_1 + c the rate now, and, as |x(t) - x| <=
|t| F, |rest| <= |A| F s^2/2 + w |s| + |B| (what other commands than u_1 differ from it, for as long
as they may have acted). What is linear in s lies between its values at the two ends of the window.
The k-th command before acts on [-k delta + w, -(k - 1) delta] at least, the (k + 1)th beside it
for w, so that in [-(k + 1) delta + w, -k delta + w] one of the two acted.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from flint import arb, arb_mat

from soter.certificate.grid.chain_form_layout import (
    CommandRows,
    FormLayout,
    OpenedForm,
    StateRows,
    between,
    flat_box,
    hull_of,
    propagated,
    rows_of,
    size_from,
)
from soter.certificate.grid.nonlinear_flow import LocalFlow, outwards, size_of, solved
from soter.certificate.reading.linearisation import TAIL, compile_lines
from soter.certificate.terms.arb_balls import (
    HALF,
    ONE,
    UNIT,
    ZERO,
    exact,
    larger,
    magnitude,
    smaller,
)
from soter.certificate.terms.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.grid.nonlinear_flow import LocalLinearModel, LocalSolution
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.straight_line import Function

    Form = tuple[arb, ...]
    Boxes = tuple[float, ...]
    Found = tuple[Form, Boxes] | None

NANOSECOND = Fraction(1, 10**9)
DEPTH_MAX = 16
"""Commands that a form carries along at most."""
STIFF = arb("1.2")
"""A step is at most this long, times the rates."""
STEPS_MAX = 64


class LocalChain:
    """The three steps of a chain, and free phases, of one group."""

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        kept: Sequence[tuple[bool, bool]],
        times: tuple[Fraction, Fraction, Fraction, Fraction],
    ) -> None:
        """`times`: delta, d, e, l in s."""
        self.flow = LocalFlow(model, members, kept)
        self.n, self.q = len(members), len(self.flow.moves)
        delta, d, early, late = times
        if not self.q:
            d = early = late = Fraction(0)  # no command moves this group: when one acts is the same
        span = early + late
        self.delta, self.d, self.early, self.span = (exact(t) for t in (delta, d, early, span))
        self.late = span > 0
        """Whether it matters that a command may act late."""
        self.depth = int(-(-(d + span) // delta))
        """How many commands may have acted since a sample was taken, or may still act."""
        if span > delta:
            raise NotRecheckedError("an SC whose jitter exceeds half its period")
        if self.depth > DEPTH_MAX:
            raise NotRecheckedError("an SC that reads states much older than its period")
        self.layout = FormLayout(self.n, self.q, self.depth)
        self.behind = [
            exact(max(Fraction(0), d + span - k * delta)) for k in range(1, self.depth + 1)
        ]
        """How far the sample reaches back beyond the certain rule of the k latest commands."""
        self.law = self._read_law(model, members)
        self.pieces = self._least_pieces()

    def _read_law(self, model: CaseModel, members: Sequence[int]) -> Function:
        terms, states = model.new_terms()
        commands = model.commands(terms, states)
        boxes = {}
        for i, (x, (low, high)) in enumerate(zip(states, model.extents, strict=True)):
            if i not in members:
                (atom,) = x.terms
                boxes[atom] = (exact(low), exact(high))
        own = [next(iter(states[i].terms)) for i in members]
        outputs = [commands[k] for k in self.flow.moves]
        return compile_lines(terms, own, self.n, outputs, terms.obligations, boxes)

    def _least_pieces(self) -> int:
        """Into how many steps a period is cut at least: few where rates are slow."""
        lines = self.flow.lines(self.flow.grid, self.flow.ranges)
        if lines is None:
            return 2
        wanted = float(size_of(self.flow.local(lines).a) * self.delta / STIFF)
        return max(1, math.ceil(min(wanted, STEPS_MAX)))

    # ------------------------------------------------------------ steps of a chain

    def first(self, pieces: int, form: Form) -> Found:
        """From a_0 to delta - e."""
        before = self.flow.ranges * self.depth  # anything
        return self._hold(self.layout.opened(form, before), pieces, fresh=True)

    def later(self, pieces: int, form: Form) -> Found:
        """From k delta - e to (k + 1) delta - e."""
        return self._hold(self.layout.opened(form, None), pieces, fresh=False)

    def last(self, pieces: int, form: Form) -> Found:
        """From N delta - e over [0, e + l], the latest command still acting."""
        start = self.layout.opened(form, None)
        old = self._old(start)
        way, boxes = self.layout.begun(start), []
        for _ in range(pieces):
            image = self._step(start, way, old, None, self.span / pieces, ZERO)
            if image is None:
                return None
            way, tube = image
            boxes += tube
        return (), tuple(boxes)

    def _hold(self, start: OpenedForm, pieces: int, *, fresh: bool) -> Found:
        """One command of SC: what it answers, and where it leads."""
        new = self._answered(start, fresh=fresh)
        if new is None:
            return None
        way, boxes = self.layout.begun(start), []
        for span, early in self.spans(pieces * self.pieces, fresh=fresh):
            image = self._step(
                start, way, new, self._old(start) if early > 0 else None, span, early
            )
            if image is None:
                return None
            way, tube = image
            boxes += tube
        return self.layout.closed(start, way, new), tuple(boxes)

    def spans(self, count: int, *, fresh: bool) -> list[tuple[arb, arb]]:
        """The steps of a hold, and for how long the old command may act in each."""
        early = ZERO if fresh else self.span
        if count == 1:
            return [(self.delta - self.early if fresh else self.delta, early)]
        rest = self.delta - (self.early if fresh else early)
        handed = [(early, early)] if early > 0 else []
        return [*handed, *[(rest / count, ZERO)] * count]

    def _old(self, start: OpenedForm) -> CommandRows:
        """The command that acts already."""
        n, q = self.n, self.q
        return CommandRows(rows_of(start, n, q), start.ranges[n : n + q])

    # ------------------------------------------------------------ what SC reads

    def _answered(self, start: OpenedForm, *, fresh: bool) -> CommandRows | None:
        """The commands that answer the sample; their unknowns are entered into `start.z`."""
        n, q = self.n, self.q
        sample = self._sampled(start, fresh=fresh)
        if sample is None:
            return None
        values = sample.rows * start.z
        form: list[arb] = [end for interval in sample.box for end in interval]
        form += [values[i, 0] for i in range(n)]
        form += [values[i, 1 + k] for i in range(n) for k in range(n)]
        form += [size_from(values, i, 1 + n) + sample.rest[i] for i in range(n)]
        for (low, high), (least, most) in zip(sample.box, self.flow.domain, strict=True):
            if not (low >= least and high <= most):
                return None
        lines = self.law(tuple(form))
        if lines is None:
            return None
        width, count = n + TAIL, start.z.nrows()
        gain = arb_mat(q, n, [lines[k * width + i] for k in range(q) for i in range(n)])
        rows = gain * sample.rows if q else arb_mat(0, count)
        ranges = []
        for k in range(q):
            row = lines[k * width : (k + 1) * width]
            rho = row[n + 1]
            for i in range(n):
                rho += abs(gain[k, i]) * sample.rest[i]
            rows[k, count - 1] += row[n]
            rows[k, count - 1 - q + k] = ONE
            start.z[count - 1 - q + k, start.z.ncols() - q + k] = rho
            ranges.append((row[-2], row[-1]))
        return CommandRows(rows, ranges)

    def _sampled(self, start: OpenedForm, *, fresh: bool) -> StateRows | None:
        """The states when the sample was taken; the window begins with a_0 in the first hold."""
        ahead = ZERO if fresh else self.span
        if not self.depth:
            return self.layout.begun(start)
        n, q = self.n, self.q
        commands = [hull_of(start.ranges[n + k :: q][: self.depth]) for k in range(q)]
        enclosure = self.flow.around(start.ranges[:n], commands, -self.d, ahead)
        if enclosure is None:
            return None
        box, lines = enclosure
        local = self.flow.local(lines)
        middle, radius = (ahead - self.d) * HALF, (ahead + self.d) * HALF
        rate = local.a * rows_of(start, 0, n)
        last = start.z.nrows() - 1
        if fresh:  # around the middle of what any command may be
            middles = [(low + high) * HALF for low, high in self.flow.ranges]
            drift = local.b * arb_mat(q, 1, middles)
            for i in range(n):
                rate[i, last] += drift[i, 0]
        else:
            rate = rate + local.b * rows_of(start, n, q)
        for i in range(n):
            rate[i, last] += local.constant[i, 0]
        values = rate * start.z
        other = self._others(start, fresh=fresh)
        rows, rest = rows_of(start, 0, n) + rate * middle, []
        for i in range(n):
            size = size_from(values, i, 1)
            now = values[i, 0] - size, values[i, 0] + size
            low, high = ZERO, ZERO
            for far, side in ((self.d, -radius), (ahead, radius)):
                off = far * self._noise_until(local, i, far)
                if fresh:  # any command all the time: none at the end of the window that is now
                    for k in range(q):
                        off += far * magnitude(local.b[i, k]) * other[k]
                ends = side * now[0], side * now[1]
                low = low.min(ends[0].min(ends[1]) - off)
                high = high.max(ends[0].max(ends[1]) + off)
            spread = (high - low) * HALF
            if not fresh:
                for k in range(q):
                    spread += magnitude(local.b[i, k]) * other[k]
            rows[i, last] += (low + high) * HALF
            rest.append(spread)
        return StateRows(rows, rest, box)

    def _noise_until(self, local: LocalLinearModel, i: int, far: arb) -> arb:
        """How far the mean rate up to `far` is from that now: noise, and |A| F s/2."""
        total = local.noise[i, 0]
        for k, (low, high) in enumerate(local.rates):
            total += magnitude(local.a[i, k]) * abs(low).max(abs(high)) * far * HALF
        return total

    def _others(self, start: OpenedForm, *, fresh: bool) -> list[arb]:
        """The integral of what other commands than the latest differ from it, back to the sample.

        In the first hold the most that any command differs from the middle of its set.
        """
        n, q = self.n, self.q
        integrals = []
        for k in range(q):
            if fresh:  # anything all the time
                low, high = self.flow.ranges[k]
                integrals.append((high - low) * HALF)
                continue
            later = range(1, self.depth)
            gaps = [ZERO, *(self._gap(start, n + k, n + at * q + k) for at in later)]
            total = ZERO
            for at, reach in enumerate(self.behind[:-1]):
                length = reach - self.behind[at + 1]
                total += length * gaps[at].max(gaps[at + 1])
            integrals.append(total)
        return integrals

    @staticmethod
    def _gap(start: OpenedForm, one: int, other: int) -> arb:
        """By how much two old commands differ at most."""
        z = start.z
        total = abs(z[one, 0] - z[other, 0])
        for g in range(1, z.ncols()):
            total += abs(z[one, g] - z[other, g])
        (a, b), (c, d) = start.ranges[one], start.ranges[other]
        return total.min((b - c).max(d - a).max(ZERO))

    # ------------------------------------------------------------ one step

    def _step(
        self,
        start: OpenedForm,
        way: StateRows,
        new: CommandRows,
        old: CommandRows | None,
        span: arb,
        early: arb,
    ) -> tuple[StateRows, list[float]] | None:
        """`span` later; up to `early` the old commands may act. The box of all states between."""
        ranges = new.ranges
        if old is not None:
            ranges = [hull_of([a, b]) for a, b in zip(new.ranges, old.ranges, strict=True)]
        enclosure = self.flow.around(way.box, ranges, ZERO, span)
        if enclosure is None:
            return None
        box, lines = enclosure
        local = self.flow.local(lines)
        law = solved(local, span)
        rows = law.state * way.rows + law.control * new.rows
        noise = [law.noise[i, 0] for i in range(self.n)]
        if old is not None:
            self._handed_over(start, local, law, new, old, early=early, rows=rows, noise=noise)
        last = rows.ncols() - 1
        for i in range(self.n):
            rows[i, last] += law.constant[i, 0]
        rest = propagated(law.state, way.rest, noise)
        values = rows * start.z
        after = []
        for i, (low, high) in enumerate(box):
            if local.rates[i][0].is_zero() and local.rates[i][1].is_zero():
                after.append(way.box[i])
                continue
            radius = size_from(values, i, 1) + rest[i]
            after.append(
                outwards(larger(values[i, 0] - radius, low), smaller(values[i, 0] + radius, high))
            )
        after = self.flow.clipped(after)
        tube = self.flow.clipped(between(way.box, after, local.rates, span))
        return StateRows(rows, rest, after), flat_box(tube)

    def _handed_over(
        self,
        start: OpenedForm,
        local: LocalLinearModel,
        law: LocalSolution,
        new: CommandRows,
        old: CommandRows,
        *,
        early: arb,
        rows: arb_mat,
        noise: list[arb],
    ) -> None:
        """The old command acts until some t <= early: it adds E(t) (old - new).

        E(t) is the integral of e^{A(h - s)} B over [0, t], e^{Ah} times that of e^{-As}, times B.
        That integral is t - A t^2/2 to within |A|^2 t^3/6 e^{|A| t}, |A| the largest sum of a row,
        and exactly t in the rows of states whose rate depends on none of them.
        """
        n = self.n
        inner = arb_mat(n, n)
        some = early * arb(0.5, 0.5)
        square = some * early * HALF
        theta = size_of(local.a) * early
        rest = early * theta * theta / 6 * theta.exp() * UNIT
        for i, row in enumerate(local.a.tolist()):
            still = all(x.is_zero() for x in row)
            for j, x in enumerate(row):
                inner[i, j] = some if i == j else ZERO
                if not still:
                    inner[i, j] += rest - x * square
        reach = law.state * inner * local.b
        gap = old.rows - new.rows
        values = gap * start.z
        middle = arb_mat(n, self.q)
        for k in range(self.q):
            (a, b), (c, d) = old.ranges[k], new.ranges[k]
            size = (abs(values[k, 0]) + size_from(values, k, 1)).min((b - c).max(d - a).max(ZERO))
            for i in range(n):
                e = reach[i, k]
                middle[i, k] = e.mid()
                noise[i] += e.rad() * size
        moved = middle * gap
        for i in range(n):
            for k in range(rows.ncols()):
                rows[i, k] += moved[i, k]

    # ------------------------------------------------------------ free phases

    def free(self, time: arb, pieces: int, form: Form) -> Found:
        """Over [0, time] under any commands."""
        n = self.n
        start = self.layout.opened(form, self.flow.ranges * self.depth)
        way, boxes = self.layout.begun(start), []
        middles = arb_mat(self.q, 1, [(low + high) * HALF for low, high in self.flow.ranges])
        radii = arb_mat(self.q, 1, [(high - low) * HALF for low, high in self.flow.ranges])
        span = time / pieces
        last = start.z.nrows() - 1
        for _ in range(pieces):
            enclosure = self.flow.around(way.box, self.flow.ranges, ZERO, span)
            if enclosure is None:
                return None
            box, lines = enclosure
            local = self.flow.local(lines)
            for i in range(n):
                for k in range(self.q):
                    local.noise[i, 0] += magnitude(local.b[i, k]) * radii[k, 0]
            law = solved(local, span)
            rows = law.state * way.rows
            drift = law.control * middles + law.constant
            for i in range(n):
                rows[i, last] += drift[i, 0]
            rest = propagated(law.state, way.rest, [law.noise[i, 0] for i in range(n)])
            values = rows * start.z
            after = []
            for i, (low, high) in enumerate(box):
                radius = size_from(values, i, 1) + rest[i]
                after.append(
                    outwards(
                        larger(values[i, 0] - radius, low), smaller(values[i, 0] + radius, high)
                    )
                )
            after = self.flow.clipped(after)
            boxes += flat_box(self.flow.clipped(between(way.box, after, local.rates, span)))
            way = StateRows(rows, rest, after)
        return (), tuple(boxes)
