"""Flows that are not linear, one short step at a time: a linear model around each step.

Purpose: `LocalFlow`: a box that holds every solution for a while (`around`), and over such a box
the matrices of x' = A x + B u + c +- w (`LocalLinearModel`), solved (`LocalSolution`).
Non-goals: chains and forms
(`nonlinear_chains.py`), linear flows, which are solved once (`linear_flows.py`).

Argument of `around`. Let X be a box of states, U one of commands, s <= 0 <= t, B a box and F the
range of the derivative over B x U x D, and let every point of X plus [s, t] F lie in B. The
functions on [s, t] with values in B, compact and convex, are mapped into themselves by x + integral
f, so a solution with values in X + [s, t] F exists (Schauder), and solutions are unique (printed,
where a flow is not linear): it is the one. Backwards, where roots are not Lipschitz, B is larger by
a hair on all sides: then no solution can leave it before it has left X + [s, t] F, and uniqueness
is not used.

Ends of axes that the flow keeps (`inward_flow.py`): there the derivative is that of the state
projected onto the grid in these axes, which only ever asks for f on the projected box. As long as
the other states stay in their grids, the projection does nothing. Whoever uses a box checks that it
lies in a set of cells, hence in the grid. Backwards in time it is the past of a run that is
projected: it lay in C, hence in the grid (docs/proof.md: the invariant), up to the instant from
which a chain begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flint import arb, arb_mat

from soter.certificate.reading.case_model import control_inputs
from soter.certificate.reading.linearisation import TAIL, compile_lines
from soter.certificate.terms.arb_balls import HALF, ONE, UNIT, ZERO, exact, magnitude
from soter.certificate.terms.terms import NotRecheckedError, Proposition, inputs_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.terms import Linear, Terms

    Interval = tuple[arb, arb]

ROUNDS = 8
"""How often a box is enlarged before there is none."""
LOOSE = arb("1.1")
"""How much further than it must a box is enlarged."""
HAIR = arb(2) ** -40
TERMS_MAX = 24
REST = arb(2) ** -40
"""Where a series may end, relative to its first term."""


@dataclass(frozen=True, eq=False)
class LocalLinearModel:
    """x' = a x + b u + constant +- noise over the box it was asked for; `rates`: its range."""

    a: arb_mat
    b: arb_mat
    constant: arb_mat
    noise: arb_mat
    rates: list[Interval]


@dataclass(frozen=True, eq=False)
class LocalSolution:
    """x(h) = state x + control u + constant +- noise for u that is constant over the step."""

    state: arb_mat
    control: arb_mat
    constant: arb_mat
    noise: arb_mat
    integral: arb_mat
    """Of e^{As} over the step."""


class LocalFlow:
    """The flow of a group; states of other groups range over their grids."""

    def __init__(
        self, model: CaseModel, members: Sequence[int], kept: Sequence[tuple[bool, bool]] = ()
    ) -> None:
        """`kept`: for each member, whether its flow keeps the lower and the upper end."""
        self.n = len(members)
        terms, states = model.new_terms()
        controls = control_inputs(model.facts, terms)
        rates, _ = model.rates(terms, states, controls)
        own = [states[i] for i in members]
        outputs = [rates[i] for i in members]
        felt = inputs_of(terms, outputs)
        self.moves = [k for k, u in enumerate(controls) if _atom(u) in felt]
        """Controls that this group feels."""
        boxes = {
            _atom(x): (exact(low), exact(high))
            for i, (x, (low, high)) in enumerate(zip(states, model.extents, strict=True))
            if i not in members
        }
        must = _own_obligations(terms, own, states)
        inputs = [_atom(x) for x in own] + [_atom(controls[k]) for k in self.moves]
        self.written = compile_lines(terms, inputs, 0, outputs, must, boxes)
        self.domain = [(terms.atoms[_atom(x)].low, terms.atoms[_atom(x)].high) for x in own]
        self.grid = [(exact(low), exact(high)) for low, high in (model.extents[i] for i in members)]
        self.ranges = [
            (exact(c.low), exact(c.high)) for c in (model.facts.controls[k] for k in self.moves)
        ]
        self.hairs = [(high - low) * HAIR for low, high in self.grid]
        self.kept = list(kept) or [(False, False)] * self.n
        self._clips = any(end for ends in self.kept for end in ends)

    # ------------------------------------------------------------ boxes

    def clipped(self, box: Sequence[Interval]) -> list[Interval]:
        """A box without what lies beyond ends that the flow keeps."""
        if not self._clips:
            return list(box)
        intervals = []
        for (low, high), (first, last), ends in zip(box, self.kept, self.grid, strict=True):
            intervals.append(
                (low.max(ends[0]) if first else low, high.min(ends[1]) if last else high)
            )
        return intervals

    def lines(self, box: Sequence[Interval], commands: Sequence[Interval]) -> list[arb] | None:
        """The rows of the derivative over a box; None where it is not defined on all of it."""
        for (low, high), (least, most) in zip(box, self.domain, strict=True):
            if not (low >= least and high <= most and low <= high):
                return None
        whole = [*box, *commands]
        form = [end for interval in whole for end in interval]
        form += [(low + high) * HALF for low, high in whole]
        form += [(high - low) * HALF for low, high in whole]
        rows = self.written(tuple(form))
        return None if rows is None else list(rows)

    def rates(self, lines: Sequence[arb]) -> list[Interval]:
        """The ranges of the derivative out of its rows."""
        width = self.n + len(self.moves) + TAIL
        return [(lines[k * width - 2], lines[k * width - 1]) for k in range(1, self.n + 1)]

    def around(
        self, box: Sequence[Interval], commands: Sequence[Interval], start: arb, end: arb
    ) -> tuple[list[Interval], list[arb]] | None:
        """A box that holds every solution over [start, end], start <= 0 <= end, and rows there."""
        trial = self.clipped(box)
        lines = self.lines(trial, commands)
        for k in range(ROUNDS):
            if lines is None:
                return None
            moved = self._moved(box, self.rates(lines), start, end)
            if k and _within(moved, trial):
                return moved, lines
            trial = self.clipped(_looser(box, moved, self.hairs if start < 0 else None))
            lines = self.lines(trial, commands)
        return None

    def _moved(
        self, box: Sequence[Interval], rates: Sequence[Interval], start: arb, end: arb
    ) -> list[Interval]:
        """Where a state of the box may be in [start, end] with these rates, clipped."""
        intervals = []
        for (low, high), (least, most) in zip(box, rates, strict=True):
            down = (end * least).min(ZERO)
            up = (end * most).max(ZERO)
            if start < 0:
                down = down.min(start * most)
                up = up.max(start * least)
            intervals.append(outwards(low + down, high + up))
        return self.clipped(intervals)

    # ------------------------------------------------------------ solutions

    def local(self, lines: Sequence[arb]) -> LocalLinearModel:
        """The linear model out of the rows; a state that certainly stands still has zeros."""
        n, m = self.n, len(self.moves)
        width = n + m + TAIL
        a, b, constant, noise, rates = [], [], [], [], []
        for k in range(n):
            row = lines[k * width : (k + 1) * width]
            low, high = row[-2], row[-1]
            rates.append((low, high))
            if low.is_zero() and high.is_zero():
                a.append([ZERO] * n)
                b.append([ZERO] * m)
                constant.append([ZERO])
                noise.append([ZERO])
                continue
            a.append(list(row[:n]))
            b.append(list(row[n : n + m]))
            constant.append([row[n + m]])
            noise.append([row[n + m + 1]])
        return LocalLinearModel(
            arb_mat(a),
            arb_mat(n, m, [x for row in b for x in row]),
            arb_mat(constant),
            arb_mat(noise),
            rates,
        )


def solved(local: LocalLinearModel, time: arb) -> LocalSolution:
    """The solution formula over a step of this length; the noise by |e^{As}| <= e^{Ms}.

    M has |a_ij| off the diagonal and a_ii on it: with A + k >= 0 on the diagonal, e^{As} =
    e^{-ks} e^{(A + k) s}, and |e^{(A + k) s}| <= e^{|A + k| s} entry by entry.
    """
    n = local.a.nrows()
    integral = integral_of(local.a, time)
    major = arb_mat(
        [
            [x if i == j else magnitude(x) for j, x in enumerate(row)]
            for i, row in enumerate(local.a.tolist())
        ]
    )
    return LocalSolution(
        _identity(n) + local.a * integral,
        integral * local.b,
        integral * local.constant,
        integral_of(major, time) * local.noise,
        integral,
    )


def integral_of(a: arb_mat, time: arb) -> arb_mat:
    """The integral of e^{As} over [0, time], time >= 0: t (1 + At/2 (1 + At/3 (1 + ...))).

    What is left out after `count` terms: theta^count/(count + 1)! (1 + theta/(count + 2) + ...) t
    at most, theta = |A|t by rows. A row of zeros in A has none. NotRecheckedError where it is
    beyond `TERMS_MAX` terms.
    """
    n = a.nrows()
    scaled = a * time
    rows = _row_sizes(scaled)
    theta = ZERO
    for row in rows:
        theta = theta.max(row)
    count, rest = 1, theta * HALF
    while count < TERMS_MAX and not rest < REST:
        count += 1
        rest = rest * theta / (count + 1)
    if not theta < count + 1:
        raise NotRecheckedError("a span of time too long for these rates")
    one = _identity(n)
    integral = one
    for k in range(count, 1, -1):
        integral = one + scaled * integral * (ONE / k)
    rest = rest / (1 - theta / (count + 2)) * time * UNIT
    integral = integral * time
    for i, row in enumerate(rows):
        if not row.is_zero():
            for j in range(n):
                integral[i, j] += rest
    return integral


def _row_sizes(a: arb_mat) -> list[arb]:
    """The sums of the largest absolute values of each row, without radius."""
    sizes = []
    for row in a.tolist():
        total = ZERO
        for x in row:
            total += abs(x)
        sizes.append(arb(total.upper()))
    return sizes


def size_of(a: arb_mat) -> arb:
    """The largest of them."""
    size = ZERO
    for x in _row_sizes(a):
        size = size.max(x)
    return size


_IDENTITIES: dict[int, arb_mat] = {}


def _identity(n: int) -> arb_mat:
    if n not in _IDENTITIES:
        _IDENTITIES[n] = arb_mat([[ONE if i == j else ZERO for j in range(n)] for i in range(n)])
    return _IDENTITIES[n]


# ---------------------------------------------------------------- helpers


def _atom(x: Linear) -> int:
    (atom,) = x.terms
    return atom


def outwards(low: arb, high: arb) -> Interval:
    """Ends without radius: equal ends are seen to be equal."""
    return arb(low.lower()), arb(high.upper())


def _within(box: Sequence[Interval], other: Sequence[Interval]) -> bool:
    return all(a >= c and b <= d for (a, b), (c, d) in zip(box, other, strict=True))


def _looser(
    box: Sequence[Interval], moved: Sequence[Interval], hairs: Sequence[arb] | None
) -> list[Interval]:
    """Further from `box` than `moved` by a tenth, and by hairs."""
    intervals = []
    for k, ((low, high), (least, most)) in enumerate(zip(box, moved, strict=True)):
        hair = ZERO if hairs is None else hairs[k]
        intervals.append((low + (least - low) * LOOSE - hair, high + (most - high) * LOOSE + hair))
    return intervals


def _own_obligations(
    terms: Terms, own: Sequence[Linear], states: Sequence[Linear]
) -> list[Proposition]:
    """What must hold for the derivative to be defined, but for what is another group's matter."""
    mine = {_atom(x) for x in own}
    every = {_atom(x) for x in states}
    obligations = []
    for truth in terms.obligations:
        inputs = inputs_of(terms, [truth]) & every
        if not inputs or inputs & mine:
            obligations.append(truth)
    return obligations
