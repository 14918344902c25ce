"""How a flow leads a form over one hold of SC, or over a span of any commands.

Purpose: `FlowChain` computes what `sc_chains.Chain` and `free_phase_steps` consist of. A *hold*
lasts from the instant at which a command of SC acts to that of the next one; a *form* describes all
states of a group at an instant (`terms/compile_terms.py`). A flow is enclosed step by step
(`flow_enclosures.py`), in balls; or as values of a program, of a flow that is the same everywhere.
Non-goals: which holds make a chain, and maps (`sc_chains.py`); sets (`group_claims.py`).

Everything is kept as rows over z: the states at the beginning of the hold, the commands that acted
before, for each new command what it may be off its row, and 1. `OpenedForm.z` has each entry of z
as a row over 1, the symbols of the cell, the betas of the states, those of the old commands, and
those of the new ones: ranges are sums of absolute values of `rows z`. A rest is an exact number,
the upper end of a bound: rows are subtracted later on, and what they have in common cancels in
numbers, but not in balls.

A command acts from e before its nominal time to l after it (`sc_chains.Window`), w = e + l. The
sample that it answers was taken at s in [-d, w] from k delta - e, while commands acted that are
known: x(s) = x + I(s) r +- noise, with r = A x + B u_1 + c the rate now and I(s) the integral of
e^{At} over [0, s]; what other commands than u_1 differ from it adds |e^{As} B| times the integral
of that, for as long as they may have acted. The k-th command before acts on [-k delta + w,
-(k - 1) delta] at least, the (k + 1)th beside it for w, so that in [-(k + 1) delta + w, -k delta +
w] one of the two acted. Older commands enter only through how much they may differ from the latest,
at each instant by the most that two values of their ranges differ: so a memory that ranges over U
stands for any function into U. The instant of a hand-over may be another one for each command.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import cycle, pairwise
from typing import TYPE_CHECKING, Any

from soter.certificate.grid.chain_form_layout import (
    CommandRows,
    FormLayout,
    OpenedForm,
    StateRows,
    absolute_sum,
    interval_hull,
)
from soter.certificate.grid.flow_enclosures import input_domains
from soter.certificate.reading.case_model import ends_of_other_states
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.compile_terms import TAIL, compile_lines
from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO, exact
from soter.certificate.terms.straight_line import (
    DEMAND,
    NotCertainError,
    apply_operation,
    bound_of_dot,
    dot,
    growth_bound,
    plus_scaled,
    product,
    side_by_side,
    unit_rows,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.grid.chain_form_layout import Form
    from soter.certificate.grid.flow_enclosures import (
        Enclosure,
        Interval,
        LocalFlow,
        SolvedFlow,
    )
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.reading.linear_flows import Solution
    from soter.certificate.terms.straight_line import Function, Rows

    Boxes = list[Any]
    Image = tuple[Form, Boxes]

NOW = Fraction(0)
DEPTH_MAX = 16
"""The most commands that a form carries along."""


@dataclass(frozen=True)
class Times:
    """Times in s: SC's period; `d`, a sample's greatest age; how early and late commands act."""

    delta: Fraction
    d: Fraction = NOW
    early: Fraction = NOW
    late: Fraction = NOW
    taken: tuple[Fraction, Fraction] = (NOW, NOW)
    """The span in which the first sample was taken, relative to a_0."""
    anew: bool = False
    """Whether each instant of a hold may answer a sample of its own, taken since d before it."""


class FlowChain:
    """Follows forms of a group over holds and free phases; raises NotCertainError if it cannot."""

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        flow: LocalFlow | SolvedFlow,
        times: Times,
    ) -> None:
        self.model, self.members, self.flow = model, members, flow
        self.n, self.q = len(members), len(flow.moves)
        if not self.q:
            times = Times(times.delta)  # no command moves this group: when one acts is the same
        self.times, self.delta = times, times.delta
        self.span = times.early + times.late
        """The time, at each switch, for which it is not certain which command acts."""
        reach = NOW if self.times.anew else times.d + self.span
        self.depth = int(-(-reach // self.delta))
        """How many commands may have acted since a sample was taken, or may still act."""
        if self.depth > DEPTH_MAX:
            raise NotRecheckedError("an SC that reads states much older than its period")
        self.layout = FormLayout(self.n, self.q, self.depth)
        self.behind = [exact(max(NOW, reach - k * self.delta)) for k in range(1, self.depth + 1)]
        """For k = 1, 2, ...: how long, from the sample on, others than the k latest may act."""
        self.least_pieces = flow.least_step_count(self.delta)

    @property
    def may_sample_elsewhere(self) -> bool:
        """Whether SC's sample may be another state than the one at the beginning of a hold."""
        return self.depth > 0 or self.times.anew

    @cached_property
    def sc_function(self) -> tuple[Function, list[Interval]]:
        """SC's step, as a function from a form of the sample to command rows, and its domain.

        The unknown part of the sample is noise. Near a limit of SC, a line over the known part
        stays inside; a line over both would pass the limit by slope times noise.
        """
        model, members = self.model, self.members
        terms, states = model.new_terms()
        commands = model.sc_commands(terms, states)
        atoms = [states[i].atom for i in members]
        outputs = [commands[k] for k in self.flow.moves]
        boxes = ends_of_other_states(model, states, members)
        must, noisy = terms.obligations, self.may_sample_elsewhere
        rows = compile_lines(terms, atoms, self.n, outputs, must, boxes, noisy=noisy)
        return rows, input_domains(terms, atoms)

    # ------------------------------------------------------------ steps of a chain

    def lead_over_first_hold(self, pieces: int, form: Form) -> Image:
        """Follows a form over the first hold, a_0 to delta - e; gives the end form and boxes."""
        before = self.flow.ranges * self.depth  # anything
        return self._lead_over_hold(self.layout.take_apart(form, before), pieces, fresh=True)

    def lead_over_later_hold(self, pieces: int, form: Form) -> Image:
        """Follows a form from k delta - e to (k + 1) delta - e; gives the end form and boxes."""
        return self._lead_over_hold(self.layout.take_apart(form, None), pieces, fresh=False)

    def last_switch_boxes(self, pieces: int, form: Form) -> Image:
        """The boxes in [0, e + l] after N delta - e, while the latest command may still act."""
        start = self.layout.take_apart(form, None)
        return (), self._lead_over(
            start, self._acting_command(start), [(self.span / pieces, NOW)] * pieces
        )[1]

    def boxes_under_any_commands(self, time: Fraction, pieces: int, form: Form) -> Image:
        """The boxes over [0, time] s under any commands."""
        start = self.layout.take_apart(form, self.flow.ranges * self.depth)
        spans = [(time / pieces, NOW)] * (pieces if time else 0)
        return (), self._lead_over(start, self._any_commands(start), spans)[1]

    def _lead_over_hold(self, start: OpenedForm, pieces: int, *, fresh: bool) -> Image:
        """Follows a form over a hold: gives the form at its end, and the boxes on the way.

        The claim: each run whose states at the beginning fit the form is in the boxes all the time,
        and at the end in the returned form. The sample is the state of an instant, which
        `_sampled_states` encloses. SC's step on it is a row over the sample; the error of that row
        is an unknown of z, one number for the hold, as one command acts. On the box of
        `flow.enclose`, which no run leaves during a step, the rate is A x + B u + c and noise. So
        later states are rows of its solution, with noise for as long as it acts
        (`_lead_over_step`); until `early` the old command may act (`_effect_of_old_command`).
        """
        new = self._answer_of_sc(start, fresh=fresh)
        way, boxes = self._lead_over(
            start, new, self.spans(pieces * self.least_pieces, fresh=fresh)
        )
        return self.layout.put_together(start, way, new), boxes

    def spans(self, count: int, *, fresh: bool) -> list[tuple[Fraction, Fraction]]:
        """The steps of a hold: how long each is in s, and how long old commands may act in it."""
        early = NOW if fresh else self.span
        whole = self.delta - self.times.early if fresh else self.delta
        if count == 1 and not self.flow.apart:
            return [(whole, early)]
        rest = whole - early
        handed = [(early, early)] if early else []
        return [*handed, *[(rest / count, NOW)] * (count if rest else 0)]

    def _acting_command(self, start: OpenedForm) -> CommandRows:
        """The command that already acts when the hold begins."""
        n, q = self.n, self.q
        return CommandRows(start.rows(n, q), start.ranges[n : n + q])

    def _any_commands(self, start: OpenedForm) -> CommandRows:
        """Any commands at any time: rows for the middles of their sets, and radii around these."""
        rows = start.rows(0, self.q)
        for row, (low, high) in zip(rows, self.flow.ranges, strict=True):
            row[:] = [*[ZERO] * (len(row) - 1), (low + high) * HALF]
        radii = [(high - low) * HALF for low, high in self.flow.ranges]
        return CommandRows(rows, self.flow.ranges, radii)

    # ------------------------------------------------------------ what SC reads

    def _answer_of_sc(self, start: OpenedForm, *, fresh: bool) -> CommandRows:
        """The commands that answer the sample; adds the unknowns of these commands to `start.z`.

        If each instant has a separate answer, no unknowns are added: then the command's distance
        from its row differs from instant to instant.
        """
        n, q = self.n, self.q
        sample = self._sampled_states(start, fresh=fresh)
        values = product(sample.rows, start.z)
        form = [end for interval in sample.box for end in interval]
        form += [row[0] for row in values]
        form += [x for row in values for x in row[1 : 1 + n]]
        form += [absolute_sum(row[1 + n :]) for row in values]
        form += sample.rest if self.may_sample_elsewhere else []  # else nothing is off the rows
        law, domain = self.sc_function
        for interval, most in zip(sample.box, domain, strict=True):
            apply_operation(DEMAND, apply_operation("inside", *interval, *most))
        lines = law(tuple(form))
        if lines is None:
            raise NotCertainError
        width, rows, ranges, radii = n + TAIL, [], [], []
        for k in range(q):
            *gain, constant, spread, low, high = lines[k * width : (k + 1) * width]
            (row,) = product([gain], sample.rows)
            row[-1] += constant
            rows.append(row)
            ranges.append((low, high))
            if self.times.anew:
                radii.append(_recentre_row(row, spread, (low, high), start.z))
            else:
                row[k - 1 - q] = ONE
                start.z[k - 1 - q][k - q] = apply_operation("magnitude", spread)
        return CommandRows(rows, ranges, radii)

    def _sampled_states(self, start: OpenedForm, *, fresh: bool) -> StateRows:
        """The states when the sample was taken; the first sample was taken before a_0.

        A read is never younger than the first component that answers it: when a later sample was
        taken, the latest old command acted from k delta - e until a_k.
        """
        way = self.layout.states_at_begin(start)
        if self.times.anew:
            span = -self.times.d, self.delta
            return self._states_in_span(
                start, span, self._any_commands(start), self.flow.ranges, []
            )
        if not self.depth:
            return way
        begin, end = self.times.taken if fresh else (-self.times.d, self.span)
        acting, others = (
            (self._any_commands(start), [])
            if fresh
            else (self._acting_command(start), self._integrals_of_gaps(start))
        )
        n, q = self.n, self.q
        ranges = [interval_hull(start.ranges[n + k :: q][: self.depth]) for k in range(q)]
        return self._states_in_span(start, (begin, end), acting, ranges, others)

    def _states_in_span(
        self,
        start: OpenedForm,
        span: tuple[Fraction, Fraction],
        acting: CommandRows,
        ranges: Sequence[Interval],
        others: Sequence[Any],
    ) -> StateRows:
        """The states at any instant of a span, while `acting` or commands within `ranges` act.

        `others`: the integrals of the differences between these commands and `acting`.
        """
        n, flow, way = self.n, self.flow, self.layout.states_at_begin(start)
        begin, end = span
        local = flow.enclose(way.box, ranges, begin, max(end, NOW))
        rate = product(side_by_side(local.a, local.b), [*way.rows, *acting.rows])
        for row, c in zip(rate, local.constant, strict=True):
            row[-1] += c
        held = [apply_operation("union", *ends) for ends in (*way.box, *acting.ranges)]
        sizes = []  # of the rate: by its row, and by ranges, which end where commands do
        values = product(rate, start.z)
        for row, factors, c in zip(
            values, side_by_side(local.a, local.b), local.constant, strict=True
        ):
            whole = apply_operation("magnitude", dot(factors, held) + c)
            sizes.append(apply_operation("min", whole, absolute_sum(row)))
        integral = self._integral_to_reads(local, begin, end)
        noise = flow.noise_bounds(local, begin, end, acting.radii)
        any_time = flow.exp_integral(local, begin, end) if others else []
        pushes = (
            product(plus_scaled(unit_rows(n), product(local.a, any_time)), local.b)
            if others
            else local.b
        )
        rest = []
        for i, row in enumerate(integral):
            wide = dot([x.rad() for x in row], sizes)
            size = noise[i] + wide + bound_of_dot(pushes[i], others)
            rest.append(apply_operation("magnitude", size))
        rows = plus_scaled(way.rows, product([[x.mid() for x in row] for row in integral], rate))
        self._enter_shared_ages(start, rows, values, (begin, end))
        placed = self._ranged_rows(start, StateRows(rows, rest, way.box), local)
        if self.times.anew:  # rows are about the middle of the span, with the noise of all of it
            placed.box = [
                (apply_operation("larger", low, a), apply_operation("smaller", high, b))
                for (a, b), (low, high) in zip(placed.box, local.box, strict=True)
            ]
        return placed

    def _integral_to_reads(self, local: Enclosure, begin: Fraction, end: Fraction) -> Rows:
        """The integral of e^{As} from now to instants of a span, less what shared ages add."""
        return self.flow.exp_integral(local, begin, end)

    def _enter_shared_ages(
        self, start: OpenedForm, rows: Rows, rates: Rows, span: tuple[Fraction, Fraction]
    ) -> None:
        """Enters the part shared by states of an instant; does nothing except in `TubeChain`."""

    def _integrals_of_gaps(self, start: OpenedForm) -> list[Any]:
        """The integral of each command's distance from older commands, back to the sample."""
        n, q = self.n, self.q
        integrals = []
        for k in range(q):
            gaps = [
                ZERO,
                *(
                    self._largest_difference(start, n + k, n + at * q + k)
                    for at in range(1, self.depth)
                ),
            ]
            lengths = [a - b for a, b in pairwise(self.behind)]
            longest = [apply_operation("max", a, b) for a, b in pairwise(gaps)]
            integrals.append(dot(lengths, longest))
        return integrals

    @staticmethod
    def _largest_difference(start: OpenedForm, one: int, other: int) -> Any:  # noqa: ANN401  a ball or a value
        apart = absolute_sum([x - y for x, y in zip(start.z[one], start.z[other], strict=True)])
        return apply_operation("min", apart, _greatest_gap(start.ranges[one], start.ranges[other]))

    # ------------------------------------------------------------ one step

    def _lead_over(
        self, start: OpenedForm, new: CommandRows, spans: Sequence[tuple[Fraction, Fraction]]
    ) -> tuple[StateRows, Boxes]:
        """Follows states over steps under the commands `new`: gives end states and boxes."""
        way, boxes = self.layout.states_at_begin(start), []
        for span, early in spans:
            way, tube = self._lead_over_step(start, way, new, span, early)
            boxes += tube
        return way, boxes

    def _lead_over_step(
        self,
        start: OpenedForm,
        way: StateRows,
        new: CommandRows,
        span: Fraction,
        early: Fraction,
    ) -> tuple[StateRows, Boxes]:
        """The states after `span` and the box on the way; old commands may act until `early`."""
        ranges = new.ranges
        if early:
            old = self._acting_command(start)
            ranges = [interval_hull(pair) for pair in zip(new.ranges, old.ranges, strict=True)]
        flow, local = self.flow, self.flow.enclose(way.box, ranges, NOW, span)
        law = flow.solution_over(local, span)
        rows = product(side_by_side(law.state, law.control), [*way.rows, *new.rows])
        noise = flow.noise_bounds(local, NOW, span, new.radii)
        if early:
            moved, more = self._effect_of_old_command(start, local, law, new, early)
            rows = plus_scaled(rows, moved)
            noise = [x + y for x, y in zip(noise, more, strict=True)]
        for row, c in zip(rows, law.constant, strict=True):
            row[-1] += c
        rest = [bound_of_dot(row, way.rest) + x for row, x in zip(law.state, noise, strict=True)]
        after = self._ranged_rows(start, StateRows(rows, rest, way.box), local)
        after.box = self._tightened_ranges(way.box, after.box, local, span)
        return after, self._way_box(way, after, local, span)

    @staticmethod
    def _tightened_ranges(
        before: Boxes, after: Boxes, local: Enclosure, span: Fraction
    ) -> list[Interval]:
        """The ranges after a step, narrowed by the ranges before, which are tighter at a limit."""
        box = []
        for i, (low, high) in enumerate(before):
            factor = local.a[i][i]
            law = factor, local.others[i], growth_bound(factor, exact(span))
            box.append(apply_operation("range_after", low, high, *after[i], *law, parts=2))
        return box

    def _ranged_rows(self, start: OpenedForm, way: StateRows, local: Enclosure) -> StateRows:
        """The states with ranges computed from rows; a state with rate 0 keeps its range."""
        box = []
        for i, row in enumerate(product(way.rows, start.z)):
            radius = absolute_sum(row[1:]) + way.rest[i]
            box.append(way.box[i] if local.has_zero_rate(i) else (row[0] - radius, row[0] + radius))
        return StateRows(way.rows, way.rest, self.flow.end_ranges(box, local))

    def _way_box(self, way: StateRows, after: StateRows, local: Enclosure, span: Fraction) -> Boxes:
        """The box of the states between two instants, as low, high, low, ..., rounded outwards."""
        tube = []
        for i, rates in enumerate(local.rates):
            factor = local.a[i][i]
            law = (*rates, factor, local.others[i], exact(span), growth_bound(factor, exact(span)))
            tube.append(apply_operation("range_between", *way.box[i], *after.box[i], *law, parts=2))
        ends = [end for interval in self.flow.clip_at_kept_ends(tube) for end in interval]
        return [apply_operation(name, end) for name, end in zip(cycle(("below", "above")), ends)]

    def _effect_of_old_command(
        self,
        start: OpenedForm,
        local: Enclosure,
        law: Solution,
        new: CommandRows,
        early: Fraction,
    ) -> tuple[Rows, list[Any]]:
        """The rows and noise of E (old - new): an old command's effect, acting until t <= early.

        E is the integral of e^{A(h - s)} B over [0, t], i.e. e^{Ah} times that of e^{-As}, times B.
        """
        old = self._acting_command(start)
        back = [[-x for x in row] for row in self.flow.exp_integral(local, -early, NOW)]
        reach = product(law.state, product(back, local.b))
        gap = plus_scaled(old.rows, new.rows, -ONE)
        sizes = [
            apply_operation("min", absolute_sum(values), _greatest_gap(a, b))
            for values, a, b in zip(product(gap, start.z), old.ranges, new.ranges, strict=True)
        ]
        noise = [dot([x.rad() for x in row], sizes) for row in reach]
        return product([[x.mid() for x in row] for row in reach], gap), noise


# ---------------------------------------------------------------- helpers


def _greatest_gap(a: Interval, b: Interval) -> Any:  # noqa: ANN401  a ball or a value
    return apply_operation("max", apply_operation("max", a[1] - b[0], b[1] - a[0]), ZERO)


def _recentre_row(row: list[Any], spread: Any, within: Interval, z: Rows) -> Any:  # noqa: ANN401
    """Centres a number's row to make its greatest error least, and returns that error.

    The error follows from the spread, the constant's radius, and the interval of the number. Near a
    limit the interval is tighter, as rows only touch the limit.
    """
    constant = apply_operation("mid", row[-1])
    spread += apply_operation("magnitude", row[-1] - constant)
    row[-1] = constant
    (value,) = product([row], z)
    far = absolute_sum(value[1:])
    least = apply_operation("max", -spread, within[0] - value[0] - far)
    most = apply_operation("min", spread, within[1] - value[0] + far)
    row[-1] += (least + most) * HALF
    return apply_operation("magnitude", (most - least) * HALF)
