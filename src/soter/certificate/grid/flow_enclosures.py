"""Flows over a span of time, in Arb: a box of all solutions, a linear model, its solution.

Purpose: `flow_chains.py` makes its steps of these. `enclose` gives a box that holds every solution
for a span, and the matrices of x' = A x + B u + c +- w in it (`Enclosure`); `solution_over` their
solution. `LocalFlow` makes both anew around each box; `SolvedFlow`, a linear flow, once for all.
Non-goals: chains and forms (`flow_chains.py`); solving linear flows (`reading/linear_flows.py`).

Argument of `enclose`. Let X be a box of states, U one of commands, s <= 0 <= t, B a box and F the
range of the derivative over B x U x D, and let every point of X plus [s, t] F lie in B. The
functions on [s, t] with values in B, compact and convex, are mapped into themselves by x + integral
f, so a solution with values in X + [s, t] F exists (Schauder), and solutions are unique (printed,
where a flow is not linear): it is the one. Backwards, where roots are not Lipschitz, and where K
has cells at rest, B is larger by a hair: where X + [s, t] F reaches beyond X on a side it does so
at the end of the time alone, and where it does not, B is a hair wider than X there. So before the
end every solution is inside of B, none can leave it, and uniqueness is not used. Ends that the flow
keeps have no hair: there are none where K has cells at rest.

Ends of axes that the flow keeps (`sc_chains.py`): there the derivative is that of the state
projected onto the grid in these axes, which only ever asks for f on the projected box. As long as
the other states stay in their grids, the projection does nothing. Whoever uses a box checks that it
lies in a set of cells, hence in the grid. Backwards in time it is the past of a run that is
projected: it lay in C, hence in the grid (docs/proof.md: the invariant), up to the instant from
which a chain begins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import starmap
from typing import TYPE_CHECKING, Any

from flint import arb

from soter.certificate.reading.case_model import ends_of_other_states, new_command_terms
from soter.certificate.reading.linear_flows import (
    LinearFlow,
    Solution,
    exp_integrals,
    scaled_row_sum,
)
from soter.certificate.terms.compile_terms import TAIL, compile_lines
from soter.certificate.terms.linear_enclosures import (
    HALF,
    ONE,
    UNIT,
    ZERO,
    exact,
    larger,
    magnitude,
    smaller,
)
from soter.certificate.terms.straight_line import (
    NotCertainError,
    apply_operation,
    bound_of_dot,
    dot,
    plus_scaled,
    product,
    side_by_side,
    times_column,
    total,
    unit_rows,
)
from soter.certificate.terms.terms import Proposition, input_atoms

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.straight_line import Rows
    from soter.certificate.terms.terms import Terms

    Interval = tuple[Any, Any]

ROUNDS = 8
"""How often a box is enlarged before `enclose` gives up."""
LOOSE = arb("1.1")
"""The factor by which a box is enlarged further than it must be."""
NEARER = 2
"""How often a box of the past of a linear flow is made smaller by the rates that are in it."""
HAIR = arb(2) ** -40
STIFF, STEPS_MAX = arb("1.2"), 64
"""A step is at most `STIFF` over the rates, and a span is cut into at most `STEPS_MAX` steps."""


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A box that contains all solutions, where x' = a x + b u + constant +- noise, in `rates`."""

    box: list[Interval]
    a: Rows
    b: Rows
    constant: list[arb]
    noise: list[arb]
    rates: list[Interval]
    others: list[Any]
    """For each rate the ball that it is without a_ii x_i."""

    def has_zero_rate(self, i: int) -> bool:
        """Whether the rate of a state is certainly 0."""
        return all(isinstance(x, arb) and x.is_zero() for x in self.rates[i])


class KeptEnds:
    """The extents of a group's states, and which of these ends no run crosses (`sc_chains.py`)."""

    def __init__(
        self, model: CaseModel, members: Sequence[int], kept: Sequence[tuple[bool, bool]]
    ) -> None:
        self.n = len(members)
        self.grid = [(exact(low), exact(high)) for low, high in (model.extents[i] for i in members)]
        self.kept = list(kept) or [(False, False)] * self.n

    def clip_at_kept_ends(self, box: Sequence[Interval]) -> list[Interval]:
        """The part of a box within the ends that no run crosses."""
        return [
            (
                apply_operation("max", low, least) if first else low,
                apply_operation("min", high, most) if last else high,
            )
            for (low, high), (first, last), (least, most) in zip(
                box, self.kept, self.grid, strict=True
            )
        ]


class SolvedFlow(KeptEnds):
    """A linear flow: it has the same matrices everywhere, and is solved over any time span."""

    apart = True
    """Whether the time in which two commands may act is a step of its own."""

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        flow: LinearFlow,
        kept: Sequence[tuple[bool, bool]] = (),
    ) -> None:
        """`kept`: for each member, whether its flow keeps the lower and the upper end."""
        super().__init__(model, members, kept)
        columns = range(len(flow.ranges))
        self.moves = [k for k in columns if any(not row[k].is_zero() for row in flow.b)]
        """Controls that this group feels."""
        self.ranges = [flow.ranges[k] for k in self.moves]
        felt = [[row[k] for k in self.moves] for row in flow.b]
        self.flow = replace(flow, b=felt, ranges=tuple(self.ranges))
        self.disturbed = [total(map(abs, row)) for row in flow.noise]
        self._solution = lru_cache(maxsize=None)(self.flow.solution)
        self._added = lru_cache(maxsize=None)(self._noise_and_gains)

    def least_step_count(self, span: Fraction) -> int:
        """1: a span is not cut, as the flow is solved over all of it."""
        del span
        return 1

    def enclose(
        self, box: Sequence[Interval], commands: Sequence[Interval], start: Fraction, end: Fraction
    ) -> Enclosure:
        """The enclosure over [start, end], start <= 0 <= end: x + (E - 1) x + F u + c +- noise.

        Commands may change at any time within their ranges; their distance from the middle counts
        as noise. Before the time of the box, noise is large and rates may tell more: they are
        bounded in the box that is met, and a state changes at most by its rate times the span.
        """
        flow, law = self.flow, self._solution(start, end)
        hulls = [apply_operation("union", *ends) for ends in box]
        middles = [(low + high) * HALF for low, high in commands]
        radii = [(high - low) * HALF for low, high in commands]
        met = []
        drift, noise = (
            plus_scaled(law.state, unit_rows(self.n), -ONE),
            self.noise_bounds(None, start, end, radii),
        )
        for i, (low, high) in enumerate(box):
            off = dot([*drift[i], *law.control[i]], [*hulls, *middles]) + law.constant[i]
            ends = low + off - noise[i], high + off + noise[i]
            met.append(
                (apply_operation("min", low, ends[0]), apply_operation("max", high, ends[1]))
            )
        met = self.clip_at_kept_ends(met)
        rates, others = self._rates_in_box(met, commands)
        for _ in range(NEARER if start < 0 else 0):
            near = []
            for (low, high), (least, most), rate in zip(box, met, rates, strict=True):
                way = apply_operation("union", rate * exact(start), rate * exact(end))
                first, last = (
                    apply_operation("min", low, low + way),
                    apply_operation("max", high, high + way),
                )
                near.append(
                    (apply_operation("max", least, first), apply_operation("min", most, last))
                )
            met = near
            rates, others = self._rates_in_box(met, commands)
        pairs = [(x, x) for x in rates]
        return Enclosure(met, flow.a, flow.b, flow.constant, self.disturbed, pairs, others)

    def _rates_in_box(
        self, met: Sequence[Interval], commands: Sequence[Interval]
    ) -> tuple[list[Any], list[Any]]:
        """The rate of each state in a box, with and without the term a_ii x_i."""
        flow, rates, others = self.flow, [], []
        held = [apply_operation("union", *ends) for ends in (*met, *commands)]
        for i, row in enumerate(side_by_side(flow.a, flow.b)):
            rest = flow.constant[i] + self.disturbed[i] * UNIT
            others.append(dot([*row[:i], ZERO, *row[i + 1 :]], held) + rest)
            rates.append(row[i] * held[i] + others[i])
        return rates, others

    def _noise_and_gains(self, start: Fraction, end: Fraction) -> tuple[list[arb], Rows]:
        """Bounds on what disturbances add to each state, and what each command in [-1, 1] adds."""
        flow, columns = self.flow, range(len(self.moves))
        gains = [flow.noise_bounds([[row[k]] for row in flow.b], start, end) for k in columns]
        rows = [[gain[i] for gain in gains] for i in range(self.n)]
        return flow.noise_bounds(flow.noise, start, end), rows

    def end_ranges(self, box: Sequence[Interval], enclosure: Enclosure) -> list[Interval]:
        """The states' ranges at the end of a span: `box` itself, as the enclosure adds nothing."""
        del enclosure  # says no more
        return self.clip_at_kept_ends(box)

    def solution_over(self, enclosure: Enclosure, span: Fraction) -> Solution:
        """The solution over a time span, which is the same in every enclosure."""
        del enclosure
        return self._solution(span, span)

    def noise_bounds(
        self,
        enclosure: Enclosure | None,
        start: Fraction,
        end: Fraction,
        radii: Sequence[Any],
    ) -> list[Any]:
        """Bounds on what disturbances add in [start, end], if commands differ by up to `radii`."""
        del enclosure
        noise, gains = self._added(start, end)
        return [x + bound_of_dot(row, radii) for x, row in zip(noise, gains, strict=True)]

    def exp_integral(self, enclosure: Enclosure, start: Fraction, end: Fraction) -> Rows:
        """The integral of e^{As} over [0, t], for all t in [start, end]."""
        return exp_integrals(enclosure.a, start, end)


class LocalFlow(KeptEnds):
    """A group's flow, enclosed around each box; states of other groups are in their grids."""

    apart = False

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        kept: Sequence[tuple[bool, bool]] = (),
        outside: int | None = None,
    ) -> None:
        """`kept`: for each member, whether its flow keeps the lower and the upper end.

        `outside`: the member that lies outside its grid, or None.
        """
        super().__init__(model, members, kept)
        terms, states = model.new_terms()
        terms.outside = None if outside is None else states[members[outside]].atom
        controls = new_command_terms(model.facts, terms)
        rates, _ = model.rates(terms, states, controls)
        atoms = [states[i].atom for i in members]
        outputs = [rates[i] for i in members]
        felt = input_atoms(terms, outputs)
        self.compared = [x in terms.compared for x in atoms]
        """Members that are compared with numbers where a rate may jump."""
        self.moves = [k for k, u in enumerate(controls) if u.atom in felt]
        """Controls that this group feels."""
        inputs = atoms + [controls[k].atom for k in self.moves]
        must = _obligations(terms, atoms, [x.atom for x in states])
        boxes = ends_of_other_states(model, states, members)
        self.may_branch = model.facts.at_rest
        """Whether there may be several solutions."""
        self.written = compile_lines(terms, inputs, 0, outputs, must, boxes)
        self.domain = input_domains(terms, atoms)
        self.ranges = [
            (exact(c.low), exact(c.high)) for c in (model.facts.controls[k] for k in self.moves)
        ]

    def least_step_count(self, span: Fraction) -> int:
        """The least number of steps to divide a span into, so that each is short for the rates."""
        try:
            lines = self.derivative_rows(self.grid, self.ranges)
        except NotCertainError:
            return 2
        rates = largest_row_sum(self.enclosure_by_rows(self.grid, self.ranges, lines).a)
        return max(1, math.ceil(min(float(rates * exact(span) / STIFF), STEPS_MAX)))

    def derivative_rows(self, box: Sequence[Interval], commands: Sequence[Interval]) -> list[arb]:
        """The rows of the derivative over a box, in the order of `compile_lines`.

        Raises NotCertainError unless the derivative is defined on all of the box.
        """
        for (low, high), (least, most) in zip(box, self.domain, strict=True):
            if not (low >= least and high <= most and low <= high):
                raise NotCertainError
        whole = [*box, *commands]
        form = [end for interval in whole for end in interval]
        form += [(low + high) * HALF for low, high in whole]
        form += [(high - low) * HALF for low, high in whole]
        rows = self.written(tuple(form))
        if rows is None:
            raise NotCertainError
        return list(rows)

    def rate_ranges(self, lines: Sequence[arb]) -> list[Interval]:
        """The ranges of the derivative, taken from its rows."""
        width = self.n + len(self.moves) + TAIL
        return [(lines[k * width - 2], lines[k * width - 1]) for k in range(1, self.n + 1)]

    def enclose(
        self, box: Sequence[Interval], commands: Sequence[Interval], start: Fraction, end: Fraction
    ) -> Enclosure:
        """The enclosure over [start, end], start <= 0 <= end.

        Raises NotCertainError if no enclosure is found.
        """
        first, last = exact(start), exact(end)
        box, commands = (list(starmap(round_outwards, x)) for x in (box, commands))
        trial = self.clip_at_kept_ends(box)
        lines = self.derivative_rows(trial, commands)
        for k in range(ROUNDS):
            moved = self._box_during_span(box, self.rate_ranges(lines), first, last)
            if k and is_within(moved, trial):
                return self.enclosure_by_rows(moved, commands, lines)
            hair = HAIR if start < 0 or self.may_branch else ZERO
            trial = self.clip_at_kept_ends(self._looser_box(box, moved, hair=hair))
            lines = self.derivative_rows(trial, commands)
        raise NotCertainError

    def _box_during_span(
        self, box: Sequence[Interval], rates: Sequence[Interval], start: arb, end: arb
    ) -> list[Interval]:
        """The box that contains states of `box` during [start, end] at these rates, clipped."""
        intervals = []
        for (low, high), (least, most) in zip(box, rates, strict=True):
            down = (end * least).min(start * most).min(ZERO)
            up = (end * most).max(start * least).max(ZERO)
            intervals.append(round_outwards(low + down, high + up))
        return self.clip_at_kept_ends(intervals)

    def _looser_box(
        self, box: Sequence[Interval], moved: Sequence[Interval], hair: arb
    ) -> list[Interval]:
        """A box around `moved`, wider by a tenth of its distance from `box`, and by `hair`."""
        intervals = []
        for (low, high), (least, most), (first, last) in zip(box, moved, self.grid, strict=True):
            more = (last - first).min(ONE + abs(low) + abs(high)) * hair  # a set may be endless
            intervals.append(
                (low + (least - low) * LOOSE - more, high + (most - high) * LOOSE + more)
            )
        return intervals

    # ------------------------------------------------------------ solutions

    def enclosure_by_rows(
        self, box: Sequence[Interval], commands: Sequence[Interval], lines: Sequence[arb]
    ) -> Enclosure:
        """The enclosure from rows of the derivative; a state with rate 0 has a zero row."""
        n, m = self.n, len(self.moves)
        width = n + m + TAIL
        rows, rates = [], self.rate_ranges(lines)
        for k, (low, high) in enumerate(rates):
            still = low.is_zero() and high.is_zero()
            rows.append([ZERO] * width if still else list(lines[k * width : (k + 1) * width]))
        held = [low.union(high) for low, high in (*box, *commands)]
        others = []
        for i, row in enumerate(rows):
            rest = row[n + m] + row[n + m + 1] * UNIT
            others.append(dot([*row[:i], ZERO, *row[i + 1 : n + m]], held) + rest)
        return Enclosure(
            list(box),
            [row[:n] for row in rows],
            [row[n : n + m] for row in rows],
            [row[n + m] for row in rows],
            [row[n + m + 1] for row in rows],
            rates,
            others,
        )

    def end_ranges(self, box: Sequence[Interval], enclosure: Enclosure) -> list[Interval]:
        """The states' ranges at the end of a span, from both `box` and the enclosure."""
        pairs = zip(box, enclosure.box, strict=True)
        return self.clip_at_kept_ends(
            [round_outwards(larger(a, c), smaller(b, d)) for (a, b), (c, d) in pairs]
        )

    def solution_over(self, enclosure: Enclosure, span: Fraction) -> Solution:
        """The solution over a step of length `span`."""
        integral = exp_integrals(enclosure.a, span, span)
        return Solution(
            plus_scaled(unit_rows(self.n), product(enclosure.a, integral)),
            product(integral, enclosure.b),
            times_column(integral, enclosure.constant),
        )

    def noise_bounds(
        self, enclosure: Enclosure, start: Fraction, end: Fraction, radii: Sequence[arb]
    ) -> list[arb]:
        """Bounds on what disturbances add in [start, end], if commands differ by up to `radii`.

        By |e^{As}| <= e^{Ms}: M has |a_ij| off the diagonal and a_ii on it (backwards: -a_ii; both
        ways: |a_ii|), for with A + k >= 0 on the diagonal e^{As} = e^{-ks} e^{(A + k) s}, and
        |e^{(A + k) s}| <= e^{|A + k| s} entry by entry.
        """
        major = [list(map(magnitude, row)) for row in enclosure.a]
        for i, row in enumerate(enclosure.a):
            major[i][i] = row[i] if start >= 0 else (-row[i] if end <= 0 else major[i][i])
        pairs = zip(enclosure.noise, enclosure.b, strict=True)
        sizes = [x + bound_of_dot(row, radii) for x, row in pairs]
        longest = max(-start, end)
        return times_column(exp_integrals(major, longest, longest), sizes)

    def exp_integral(self, enclosure: Enclosure, start: Fraction, end: Fraction) -> Rows:
        """The integral of e^{As} over [0, t], for all t in [start, end]."""
        rows = self.integral_less_time(enclosure, start, end)
        for i, row in enumerate(rows):
            row[i] += exact(start).union(exact(end))
        return rows

    def integral_less_time(self, enclosure: Enclosure, start: Fraction, end: Fraction) -> Rows:
        """The integral of e^{As} over [0, t], less t, for all t in [start, end].

        It is A t^2/2 to within |A|^2 |t|^3/6 e^{|A t|}, |A| the largest sum of a row of scaled
        states, and exactly 0 in the rows of states whose rate depends on no state.
        """
        far = exact(max(-start, end))
        least = ZERO if start <= 0 <= end else exact(min(abs(start), abs(end)))
        square = (least * least).union(far * far) * HALF
        theta, scales = scaled_row_sum(enclosure.a, far)
        rest = far * theta * theta / 6 * theta.exp() * UNIT
        rows = []
        for i, row in enumerate(enclosure.a):
            more = ZERO if all(x.is_zero() for x in row) else rest * scales[i]
            rows.append([x * square + more / d for x, d in zip(row, scales, strict=True)])
        return rows


def largest_row_sum(a: Rows) -> arb:
    """The largest row sum of absolute values, as a number without radius."""
    size = ZERO
    for row in a:
        size = size.max(total(map(abs, row)))
    return arb(size.upper())


# ---------------------------------------------------------------- helpers


def input_domains(terms: Terms, inputs: Sequence[int]) -> list[Interval]:
    """The range of each input outside which the terms do not hold."""
    return [(terms.atoms[a].low, terms.atoms[a].high) for a in inputs]


def round_outwards(low: arb, high: arb) -> Interval:
    """The interval with ends that have no radius, so that equal ends compare as equal."""
    return arb(low.lower()), arb(high.upper())


def is_within(box: Sequence[Interval], other: Sequence[Interval]) -> bool:
    """Whether a box lies in another box."""
    return all(a >= c and b <= d for (a, b), (c, d) in zip(box, other, strict=True))


def _obligations(terms: Terms, members: Sequence[int], states: Sequence[int]) -> list[Proposition]:
    """The obligations of the derivative, except those about other groups alone."""
    obligations = []
    for truth in terms.obligations:
        inputs = input_atoms(terms, [truth]).intersection(states)
        if not inputs or inputs.intersection(members):
            obligations.append(truth)
    return obligations
