"""Images of half-spaces under linear flows, in balls: over a hold of SC, or under any command.

Purpose: `HoldImage` (one period of SC) and `FreeImage` (any command) give, for rows c and times t,
(row, loss) with c x(t) <= row x(0) + loss. `polytope_check.py` makes its inclusions of that.
Non-goals: reading programs (`linear_laws.py`, `linear_flows.py`); sets (`polytope_check.py`).

x' = A x + B u + b + W w with |w| <= 1 measurable, u in U, x in the box of C: D bounds
|A x + B u + b| there. For one row c:

- *noise*: int |c e^{As} W| ds. On [m - r, m + r] f(s) = c e^{As} W is f(m) + f'(m) (s - m) up to
  (s - m)^2/2 |c e^{Am} A^2| e^{|A| r} |W|; |f(m) + f'(m) s| is integrated exactly.
- *sag*: between instants h apart phi(t) = c x(t) of one held u (without w) exceeds the greater of
  its ends by at most h^2/8 sup |phi''|, phi'' = c A e^{At} (A x + B u + b).
- *a hold*. n_k = a_0 + k delta, a_0 the instant at which SC's first output acts with all
  components. Outputs k act in [t_0 + k delta, t_0 + k delta + j], and a_0 does for k = 0: so at
  n_k - p + [0, j] with one p in [0, j] for all of a run. Before, component i is still that of
  k - 1, and from n_(k+1) - p on it may be that of k + 1: for at most j - p and p, in all j;
  2 j <= delta keeps others out. |u_i - u_k,i| <= other_i moves c x by at most
  j sup over [0, delta] of |c e^{As} B| other.
- *its read* is of n_k + s, s in [-d - p, j - p]. From x = x(n_k) on, backwards too, K x' is
  K (A x + b + B u_c) (on the set at most `rate`) up to |K B| u_r + |K W| and
  |K A| |x(n_k + s) - x|, and |x(n_k + s) - x| <= |s| e^{|A| |s|} (D + |W| 1). Integrated, with s
  within d/2 + j of -d/2, that is the spread of a read.
- *other*: reads of neighbours lie in t_0 + k delta + [-d, j] and the same a period off: within
  delta + d + j of each other and of n_k. That u_(k+1) is linear although n_(k+1) is not reached: if
  no component of it acted before n_(k+1) the state would be in K there, and its read is older.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

from flint import arb, arb_mat

from soter.certificate.reading.linear_flows import integral
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import HALF, ZERO, exact, magnitude

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.certificate.polytope.certificate_tables import Rows
    from soter.certificate.polytope.linear_laws import CommandLaw
    from soter.certificate.reading.linear_flows import LinearFlow

    Moved = tuple[list[list[arb]], list[arb]]
    """Rows and losses."""

NS = Fraction(1, 10**9)
PIECES = 2
"""Pieces between two instants where noise and sag are bounded."""
PIECES_OF_EXCHANGE = 8
"""Pieces of a hold where the effect of commands that act too early or too late is bounded."""


def absolute_bounds(m: arb_mat) -> arb_mat:
    """For each entry of a matrix its largest absolute value."""
    return arb_mat([[magnitude(x) for x in row] for row in m.tolist()])


def column_matrix(values: Sequence[arb]) -> arb_mat:
    """The matrix of one column."""
    return arb_mat([[x] for x in values])


def first_column(m: arb_mat) -> list[arb]:
    """The first column of a matrix."""
    return [row[0] for row in m.tolist()]


def _centres(ranges: Sequence[tuple[arb, arb]]) -> tuple[list[arb], list[arb]]:
    """The middles of ranges, and half of their widths."""
    middles = [(low + high) * HALF for low, high in ranges]
    return middles, [(high - low) * HALF for low, high in ranges]


class BallFlow:
    """A group's flow on the box of C, moved by the controls `acting`: what every image needs."""

    def __init__(
        self, flow: LinearFlow, box: Sequence[tuple[float, float]], acting: Sequence[int]
    ) -> None:
        n = len(flow.members)
        unused = [k for k in range(len(flow.ranges)) if k not in acting]
        if any(not row[k].is_zero() for row in flow.b for k in unused):
            raise NotRecheckedError("a command moves a polytope group that its law leaves out")
        self.n, self.exact_a = n, flow.a
        self.a, self.size_a = arb_mat(flow.a), absolute_bounds(arb_mat(flow.a))
        self.b = arb_mat([[row[k] for k in acting] for row in flow.b])
        self.w = arb_mat([row or [ZERO] for row in flow.noise])
        ranges = [flow.ranges[k] for k in acting]
        self.control_centre, self.control_radius = _centres(ranges)
        centre, radius = map(
            column_matrix, _centres([(exact(low), exact(high)) for low, high in box])
        )
        self.constant = column_matrix(flow.constant) + self.b * column_matrix(self.control_centre)
        """b + B u_c."""
        self.calm = absolute_bounds(self.a * centre + self.constant) + self.size_a * radius
        """|A x + b + B u_c|."""
        self.speed = self.calm + absolute_bounds(self.b) * column_matrix(self.control_radius)
        """D."""
        ones = column_matrix([arb(1)] * self.w.ncols())
        self.shaken = absolute_bounds(self.w) * ones
        """|W| 1."""
        self._exponentials: dict[Fraction, arb_mat] = {}
        self._growths: dict[Fraction, arb_mat] = {}

    def exponential(self, time: Fraction) -> arb_mat:
        """The matrix e^{At}."""
        if time not in self._exponentials:
            self._exponentials[time] = (self.a * exact(time)).exp()
        return self._exponentials[time]

    def growth(self, time: Fraction) -> arb_mat:
        """e^{|A| t}: bounds every entry of e^{As}, |s| <= t."""
        if time not in self._growths:
            self._growths[time] = absolute_bounds((self.size_a * exact(time)).exp())
        return self._growths[time]

    def integral(self, time: Fraction) -> arb_mat:
        """The integral of e^{As} over [0, t]."""
        return arb_mat(integral(self.exact_a, time))

    # ------------------------------------------------------------ between instants

    def _time_pieces(
        self, rows: arb_mat, start: Fraction, end: Fraction, count: int
    ) -> Iterator[tuple[arb, Fraction, arb_mat]]:
        """(r, r, c e^{Am}) of each piece [m - r, m + r]."""
        r = (end - start) / (2 * count)
        for k in range(count):
            yield exact(r), r, rows * self.exponential(start + (2 * k + 1) * r)

    def _line_bounds(
        self, at: arb_mat, r: Fraction, columns: arb_mat
    ) -> Iterator[tuple[list[arb], list[arb], list[arb]]]:
        """Per row |f(m)|, |f'(m)| and a bound of |f''| on the piece, for every column."""
        bend = absolute_bounds(at * self.a * self.a) * self.growth(r) * absolute_bounds(columns)
        three = (
            absolute_bounds(at * columns),
            absolute_bounds(at * self.a * columns),
            absolute_bounds(bend),
        )
        yield from zip(*(m.tolist() for m in three), strict=True)

    def noise(self, rows: arb_mat, columns: arb_mat, times: Sequence[Fraction]) -> list[list[arb]]:
        """At every time the integral of |c e^{As} columns| 1 from 0 on."""
        total = [ZERO] * rows.nrows()
        integrals = [total]
        for start, end in pairwise(times):
            for r, exact_r, at in self._time_pieces(rows, start, end, PIECES):
                lines = self._line_bounds(at, exact_r, columns)
                total = [t + _area(*line, r) for t, line in zip(total, lines, strict=True)]
            integrals.append(total)
        return integrals

    def greatest_effect(self, rows: arb_mat, columns: arb_mat, end: Fraction) -> list[list[arb]]:
        """For each row c and column the greatest |c e^{As} column|, s in [0, end]."""
        maxima: list[list[arb]] = [[ZERO] * columns.ncols() for _ in range(rows.nrows())]
        for r, exact_r, at in self._time_pieces(rows, Fraction(0), end, PIECES_OF_EXCHANGE):
            for k, (p, q, bend) in enumerate(self._line_bounds(at, exact_r, columns)):
                here = [a + r * b + r * r * HALF * c for a, b, c in zip(p, q, bend, strict=True)]
                maxima[k] = [x.max(y) for x, y in zip(maxima[k], here, strict=True)]
        return maxima

    def sag(self, rows: arb_mat, speed: arb_mat, start: Fraction, end: Fraction) -> list[arb]:
        """h^2/8 sup |phi''| between two instants; `speed` bounds |A x + B u + b|."""
        suprema = [ZERO] * rows.nrows()
        h = exact(end - start)
        for _, r, at in self._time_pieces(rows, start, end, PIECES):
            here = first_column(absolute_bounds(at * self.a) * self.growth(r) * speed)
            suprema = [x.max(y) for x, y in zip(suprema, here, strict=True)]
        return [x * h * h / 8 for x in suprema]

    def between_instants(
        self,
        c: arb_mat,
        moved: Sequence[tuple[arb_mat, list[arb]]],
        columns: arb_mat,
        speed: arb_mat,
        times: Sequence[Fraction],
    ) -> list[Moved]:
        """Rows and losses at instants, with noise, and with the larger sag of the two beside it."""
        noise = self.noise(c, columns, times)
        steps = [self.sag(c, speed, a, b) for a, b in pairwise(times)]
        bounds = []
        for (row, loss), later, before, after in zip(
            moved, [*noise[1:], noise[-1]], [steps[0], *steps], [*steps, steps[-1]], strict=True
        ):
            parts = zip(loss, later, before, after, strict=True)
            bounds.append((row.tolist(), [x + w + a.max(b) for x, w, a, b in parts]))
        return bounds


def _area(p: list[arb], q: list[arb], bend: list[arb], r: arb) -> arb:
    """The integral of |p + q s| + bend s^2/2 over [-r, r], summed; it does not fall with p, q."""
    total = ZERO
    for a, b, c in zip(p, q, bend, strict=True):
        total += 2 * r * a if a >= b * r else (a * a + b * b * r * r) / b
        total += r * r * r / 3 * c
    return total


class FreeImage:
    """Half-spaces at instants of a phase in which any command of U acts."""

    def __init__(self, flow: BallFlow, instants_ns: Sequence[int]) -> None:
        self.flow = flow
        self.times = [t * NS for t in instants_ns]
        push = [
            [x * r for x, r in zip(row, flow.control_radius, strict=True)]
            for row in flow.b.tolist()
        ]
        self.columns = arb_mat([a + b for a, b in zip(push, flow.w.tolist(), strict=True)])

    def at_all_times(self, rows: Rows) -> list[Moved]:
        """For every instant (row, loss): the greatest of them bounds c x in between, too."""
        flow, c = self.flow, arb_mat(rows)
        still = [
            (c * flow.exponential(t), first_column(c * flow.integral(t) * flow.constant))
            for t in self.times
        ]
        return flow.between_instants(c, still, self.columns, flow.calm, self.times)


class HoldImage:
    """One hold of SC: from one nominal time to the next."""

    def __init__(
        self,
        flow: BallFlow,
        law: CommandLaw,
        rate: Sequence[float],
        instants_ns: Sequence[int],
        delays_ns: tuple[int, int],
    ) -> None:
        """`delays_ns`: d and j."""
        self.flow, self.law = flow, law
        self.times = [t * NS for t in instants_ns]
        self.delay, self.jitter = (t * NS for t in delays_ns)
        self.timed = any(delays_ns)
        self.rate = [exact(float(x)) for x in rate]
        self.k = arb_mat(law.gain)
        self.rate_rows = self.k * flow.a
        self.rate_offset = first_column(self.k * flow.constant)
        half = exact(self.delay / 2)
        self.gain = self.k - self.rate_rows * half
        self.offset = [a - b * half for a, b in zip(law.offset, self.rate_offset, strict=True)]
        self.spread = [a + b for a, b in zip(law.spread, self._read_gap(), strict=True)]

    @cached_property
    def push(self) -> list[arb]:
        """|K (B (u - u_c) + W w)|."""
        flow = self.flow
        by_u = first_column(absolute_bounds(self.k * flow.b) * column_matrix(flow.control_radius))
        by_w = first_column(
            absolute_bounds(self.k * flow.w) * column_matrix([arb(1)] * flow.w.ncols())
        )
        return [a + b for a, b in zip(by_u, by_w, strict=True)]

    def _command_slope(self, time: Fraction) -> list[arb]:
        """|K A (x(n + s) - x(n))| / |s|."""
        flow = self.flow
        away = flow.growth(time) * (flow.speed + flow.shaken)
        return first_column(absolute_bounds(self.rate_rows) * away)

    def _read_gap(self) -> list[arb]:
        """The most that a read differs from one of age d / 2, row by row (see "its read" above)."""
        if not self.timed:
            return [ZERO] * len(self.rate)
        far, off = exact(self.delay + self.jitter), exact(self.delay / 2 + self.jitter)
        bend = self._command_slope(self.delay + self.jitter)
        return [
            off * r + far * p + far * far * HALF * b
            for r, p, b in zip(self.rate, self.push, bend, strict=True)
        ]

    @cached_property
    def neighbour_gap(self) -> list[arb]:
        """A bound of |u_(k+-1) - u_k|, control by control (see "other" above)."""
        span = self.times[-1] + self.delay + self.jitter
        apart = exact(span)
        bend = self._command_slope(span)
        return [
            apart * (r + p + apart * b) + 2 * s
            for r, p, b, s in zip(self.rate, self.push, bend, self.law.spread, strict=True)
        ]

    def _exchange_loss(self, c: arb_mat) -> list[arb]:
        if self.jitter == 0:
            return [ZERO] * c.nrows()
        steer = self.flow.greatest_effect(c, self.flow.b, self.times[-1])
        j = exact(self.jitter)
        return [
            j * sum((a * b for a, b in zip(row, self.neighbour_gap, strict=True)), ZERO)
            for row in steer
        ]

    def _row_image(self, c: arb_mat, time: Fraction) -> tuple[arb_mat, list[arb]]:
        flow = self.flow
        through = c * flow.integral(time)
        steer = through * flow.b
        # b + B u = (b + B u_c) + B (u - u_c), u = gain x + offset up to the spread
        held = [a - b for a, b in zip(self.offset, flow.control_centre, strict=True)]
        loss = through * flow.constant + steer * column_matrix(held)
        loss = loss + absolute_bounds(steer) * column_matrix(self.spread)
        return c * flow.exponential(time) + steer * self.gain, first_column(loss)

    def at_all_times(self, rows: Rows) -> list[Moved]:
        """For every instant (row, loss): the greatest of them bounds c x during the hold."""
        flow, c = self.flow, arb_mat(rows)
        moved, more = [self._row_image(c, t) for t in self.times], self._exchange_loss(c)
        still = [(row, [a + b for a, b in zip(loss, more, strict=True)]) for row, loss in moved]
        return flow.between_instants(c, still, flow.w, flow.speed, self.times)

    def at_end(self, rows: Rows) -> Moved:
        """(row, loss): `rows` of the end of the hold are at most row x + loss, x its begin."""
        c = arb_mat(rows)
        noise = self.flow.noise(c, self.flow.w, self.times)[-1]
        row, loss = self._row_image(c, self.times[-1])
        parts = zip(loss, noise, self._exchange_loss(c), strict=True)
        return row.tolist(), [sum(p, ZERO) for p in parts]

    def linearity_limits(self) -> list[Moved]:
        """(rows, limits) that a state must satisfy for the law to be linear, and for `rate`."""
        rows, minus = self.gain.tolist(), (-self.gain).tolist()
        ends = zip(self.law.low, self.law.high, self.offset, self.spread, strict=True)
        both = [(high - o - s, o - s - low) for low, high, o, s in ends]
        constraints = [(rows, [a for a, _ in both]), (minus, [b for _, b in both])]
        if self.timed:
            pairs = list(zip(self.rate, self.rate_offset, strict=True))
            constraints.append((self.rate_rows.tolist(), [r - o for r, o in pairs]))
            constraints.append(((-self.rate_rows).tolist(), [r + o for r, o in pairs]))
        return constraints
