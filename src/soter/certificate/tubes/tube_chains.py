"""The re-checker's tubes: sets of states carried step by step, and what an estimate leads to.

Purpose: a `StateSet` holds all states in which a run may be at an instant, and the commands that
still act. `TubeChain` makes the next one: after a hold of SC, after a span of any command, or for
all instants of a span. `ConditionOnBoxes` says on which boxes a condition certainly holds, or
certainly does not; of boxes outside of the states' sets it says neither. `ModuleTube` follows SC of
one module from an estimate of a flight (`why_not_good`) or from all starts (`why_starts_not_good`),
as "Decisions by tubes" (proof-flight.md) has it, and gives a reason where it is not certain that SC
ends at rest within C.
Non-goals: how one step is enclosed (`grid/flow_chains.py`), which conditions there are
(`rest_problem.py`), what is shown beforehand (`rest_claims.py`).

The argument of a chain is that of `FlowChain`: a hold is rows over generators z, each of which is a
number in [-1, 1], or 1. Here z has as many columns as there are unknowns; behind a hold what rows
do not say (`rest`) is an unknown of its own for each state. Commands that may still act keep what
they share with the states. Unknowns that matter least are put together, one for each row (Girard):
whatever they were, their sum is within the sum of their sizes.

The argument of `why_not_good`: let s be the instant of the estimate, x^. Any command acts until a_0
in [s + alpha, s + H]. That window is cut, and of each part all states at some instant of it are
followed by themselves: every fall-back run is in one of these tubes. On all boxes that are met C is
certain, until some a_N: all states in which output N begins to act are in Q, and what rest may move
them to is in C. Parts where that does not come out are cut again, with shorter steps. Boxes are cut
off at ends of sets that no run crosses (`grid/sc_chains.py`): that they lie in C is what is asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import flint
from flint import arb

from soter.certificate.grid.chain_form_layout import OpenedForm, absolute_sum
from soter.certificate.grid.flow_chains import NOW, FlowChain
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.grid.sc_chains import uncrossed_ends
from soter.certificate.reading.case_model import ends_of_other_states
from soter.certificate.reading.symbolic_values import scalar_leaves, value_of_leaves
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.linear_enclosures import HALF, ONE, UNIT_ROUNDOFF, ZERO, exact
from soter.certificate.terms.straight_line import CERTAIN, NotCertainError, product
from soter.certificate.tubes.rest_problem import (
    A_TURN,
    LARGEST,
    NANOSECOND,
    UNKNOWN_END,
    RestModel,
    cut_point,
    state_constraint,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from fractions import Fraction

    from soter.certificate.grid.chain_form_layout import CommandRows, StateRows
    from soter.certificate.grid.flow_chains import Times
    from soter.certificate.grid.flow_enclosures import Enclosure, Interval
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.straight_line import Rows
    from soter.certificate.terms.terms import Linear, Proposition, Terms
    from soter.certificate.tubes.rest_problem import Range, RestProblem
    from soter.language.model.types import Value

    Box = list[Interval]


COLUMNS = 40
"""How many unknowns a state set keeps as they are, at most."""
CERTAINLY_FALSE = 1
"""The bits of a proposition that is certainly false."""
CUTS = 4
"""How often a part of the window is halved."""
FAR_CUTS, FAR = 8, arb(2) ** 64
"""How often what M has beyond `FAR` is cut: a sum there rounds by more than the rest of it is."""
PIECES = (1, 1, 2, 4, 8)
"""Into how many steps a hold is cut, by how often its part of the window was."""
FREE_PIECES = 4
FINE = 1400
"""Bits that tell a state beside `LARGEST`, which no state is beyond by assumption, from others."""


class TubeFlow(LocalFlow):
    """The flow of a tube; the time in which two commands may act is a separate step."""

    apart = True

    def least_step_count(self, span: Fraction) -> int:
        """Gives 1, as the tube itself decides where to cut a span."""
        del span
        return 1


@dataclass(eq=False)
class StateSet:
    """All states of a run at an instant: each state is in its interval of `box` and in its row.

    A row is a constant and factors of unknowns in [-1, 1], which all rows share. `memory`: the rows
    of the commands that may still act, latest first, with `ranges`; empty if any may have acted.
    """

    box: Box
    rows: Rows
    memory: Rows
    ranges: Box

    @classmethod
    def from_box(cls, box: Box) -> StateSet:
        """The set of all states of a box, whatever commands acted before."""
        rows = []
        for i, (low, high) in enumerate(box):
            row = [(low + high) * HALF, *[ZERO] * len(box)]
            row[1 + i] = (high - low) * HALF
            rows.append(row)
        return cls(box, rows, [], [])


class TubeChain(FlowChain):
    """Makes the state sets of one tube; raises `NotCertainError` if a step finds no enclosure.

    `messages`: for each state the topic by which SC sees it.
    """

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        flow: TubeFlow,
        holds: Times,
        messages: Sequence[int],
    ) -> None:
        super().__init__(model, members, flow, holds)
        self._messages = list(messages)
        self._known = 0
        self._reading = False

    # ------------------------------------------------------------ steps

    def follow_hold(self, body: StateSet, pieces: int) -> tuple[StateSet, list[Box]]:
        """Follows SC's next command until the following one may act; gives that set and the boxes.

        If commands may act late, the first box has all states in which this command starts to act.
        `pieces`: the number of steps into which the hold is cut.
        """
        fresh = not body.memory and self.depth > 0
        start = self._opened_rows(body)
        new = self._answer_of_sc(start, fresh=fresh)
        way, tube = self._lead_over(start, new, self.spans(pieces, fresh=fresh or not self.depth))
        return self._next_set(start, way, new), _split_into_boxes(tube, self.n)

    def follow_any_commands(self, body: StateSet, span: Fraction) -> tuple[StateSet, list[Box]]:
        """Follows any commands for `span` s; gives the set at the end, and the boxes until then."""
        start = self._opened_rows(StateSet(body.box, body.rows, [], []))
        way, tube = self._lead_over(start, self._any_commands(start), [(span, NOW)])
        return self._next_set(start, way, None), _split_into_boxes(tube, self.n)

    def at_some_instant(self, body: StateSet, span: Fraction) -> StateSet:
        """The set of all states that may occur within the next `span` s, under any commands."""
        start = self._opened_rows(StateSet(body.box, body.rows, [], []))
        way = self._states_in_span(
            start, (NOW, span), self._any_commands(start), self.flow.ranges, []
        )
        return self._next_set(start, way, None)

    # ------------------------------------------------------------ what SC reads

    def _answer_of_sc(self, start: OpenedForm, *, fresh: bool) -> CommandRows:
        """SC's answer, as in `FlowChain`, but all states of a message are those of one instant.

        A read at t + m + h e, with |e| <= 1 and m the middle of its span, adds h e (c + sum g_k
        e_k) if the rate is c + sum g_k e_k. Each message has the unknowns e and e e_k, which are
        numbers in [-1, 1]; the rows of z before the last errors are these sums, one for each state.
        """
        self._known = len(start.z[0]) - self.q
        added = len(set(self._messages)) * self._known
        for row in start.z:
            row[self._known : self._known] = [ZERO] * added
        at = self.n + self.depth * self.q
        start.z[at:at] = [[ZERO] * len(start.z[0]) for _ in range(self.n)]
        self._reading = True
        try:
            return super()._answer_of_sc(start, fresh=fresh)
        finally:
            self._reading = False

    def _integral_to_reads(self, local: Enclosure, begin: Fraction, end: Fraction) -> Rows:
        if not self._reading:
            return super()._integral_to_reads(local, begin, end)
        rows = self.flow.integral_less_time(local, begin, end)  # type: ignore[union-attr]
        for i, row in enumerate(rows):
            row[i] += exact((begin + end) / 2)
        return rows

    def _enter_shared_ages(
        self, start: OpenedForm, rows: Rows, rates: Rows, span: tuple[Fraction, Fraction]
    ) -> None:
        if not self._reading:
            return
        at, places = self.n + self.depth * self.q, list(dict.fromkeys(self._messages))
        half, known = exact((span[1] - span[0]) / 2), self._known
        for i, (message, rate) in enumerate(zip(self._messages, rates, strict=True)):
            first = known * (1 + places.index(message))
            start.z[at + i][first : first + known] = [half * x for x in rate[:known]]
            rows[i][at + i] += ONE

    # ------------------------------------------------------------ bodies

    def _opened_rows(self, body: StateSet) -> OpenedForm:
        """The rows z of a step: states, old commands, errors of new commands, and 1."""
        count, any_before = self.depth * self.q, not body.memory
        known = len(body.rows[0])
        pad = max(0, 1 + self.n - known)
        extra = pad + (count if any_before else 0) + self.q
        z = [[*row, *[ZERO] * extra] for row in (*body.rows, *body.memory)]
        ranges = list(body.ranges)
        if any_before:
            ranges = list(self.flow.ranges) * self.depth
            for k, (low, high) in enumerate(ranges):
                row = [ZERO] * (known + extra)
                row[0], row[known + pad + k] = (low + high) * HALF, (high - low) * HALF
                z.append(row)
        z += [[ZERO] * (known + extra) for _ in range(self.q)]
        z.append([ONE, *[ZERO] * (known + extra - 1)])
        return OpenedForm([*body.box, *ranges], z, [])

    def _next_set(self, start: OpenedForm, way: StateRows, new: CommandRows | None) -> StateSet:
        """The state set after a step; `new` is the command that acts now, None if any may act."""
        rows = product(way.rows, start.z)
        memory, ranges = [], []
        if new is not None and self.depth:
            n, old = self.n, (self.depth - 1) * self.q
            memory = [*product(new.rows, start.z), *start.z[n : n + old]]
            ranges = [*new.ranges, *start.ranges[n : n + old]]
        rows = [self._with_own_rest(row, i, way) for i, row in enumerate(rows)]
        memory = [[*row, *[ZERO] * self.n] for row in memory]
        rows, memory = _with_fewer_unknowns(rows, memory)
        return StateSet(list(way.box), rows, memory, ranges)

    def _with_own_rest(self, row: list[Any], i: int, way: StateRows) -> list[Any]:
        """A state's row with its rest as a new unknown; its range alone if that is half as wide."""
        unknowns = [ZERO] * self.n
        unknowns[i] = way.rest[i]
        low, high = way.box[i]
        half = (high - low) * HALF
        if half < HALF * (absolute_sum(row[1:]) + way.rest[i]):
            unknowns[i] = half
            return [(low + high) * HALF, *[ZERO] * (len(row) - 1), *unknowns]
        return [*row, *unknowns]


def _split_into_boxes(tube: Sequence[float], n: int) -> list[Box]:
    ends = [(exact(a), exact(b)) for a, b in zip(tube[::2], tube[1::2], strict=True)]
    return [ends[k : k + n] for k in range(0, len(ends), n)]


def _unshared_size(column: list[float], whole: list[float]) -> float:
    shares = [x / w for x, w in zip(column, whole, strict=True)]
    return sum(shares) - max(shares)


def _factors_of_left_columns(i: int, rows: int, left: Sequence[Sequence[Any]]) -> list[Any]:
    factors = [ZERO] * (rows if left else 0)
    if left:
        factors[i] = absolute_sum([c[i] for c in left])
    return factors


def _with_fewer_unknowns(rows: Rows, memory: Rows) -> tuple[Rows, Rows]:
    """Rows with the `COLUMNS` most shared unknowns at most, and one more unknown for each row."""
    every = [*rows, *memory]
    columns = [c for c in zip(*(row[1:] for row in every), strict=True) if any(c)]
    sizes = [[float(abs(x.mid())) for x in c[: len(rows)]] for c in columns]
    whole = [sum(of) or 1.0 for of in zip(*sizes, strict=True)] if columns else []
    scores = [_unshared_size(c, whole) for c in sizes]
    order = sorted(range(len(columns)), key=scores.__getitem__, reverse=True)
    kept = [columns[k] for k in order[:COLUMNS]]
    left = [columns[k] for k in order[COLUMNS:]]
    made = []
    for i, row in enumerate(every):
        made.append([row[0], *(c[i] for c in kept), *_factors_of_left_columns(i, len(every), left)])
    return made[: len(rows)], made[len(rows) :]


class ConditionOnBoxes:
    """A condition on the true states, asked of boxes of `members`; others may be anywhere."""

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        truth_of: Callable[[Terms, list[Linear]], Proposition],
    ) -> None:
        terms, states = model.new_terms()
        first = truth_of(terms, states)
        atoms = [states[i].atom for i in members]
        known = [(terms.atoms[a].low, terms.atoms[a].high) for a in atoms]
        boxes = ends_of_other_states(model, states, members)
        self._truths = compile_truths(terms, atoms, [first, *terms.obligations], boxes)
        self._ends = [
            ends if i in model.facts.unbounded | model.facts.turning else (exact(low), exact(high))
            for i, ends, (low, high) in zip(
                members, known, (model.extents[i] for i in members), strict=True
            )
        ]

    def is_certain(self, box: Box) -> bool:
        """Whether the condition certainly holds, and is defined, in all of a box."""
        return self._is_within(box) and all(t == CERTAIN for t in self._truths_on(box))

    def is_certainly_false(self, box: Box) -> bool:
        """Whether the condition certainly holds in no state of a box."""
        return self._is_within(box) and self._truths_on(box)[0] == CERTAINLY_FALSE

    def _is_within(self, box: Box) -> bool:
        pairs = zip(box, self._ends, strict=True)
        return all(low >= a and high <= b and low <= high for (low, high), (a, b) in pairs)

    def _truths_on(self, box: Box) -> Sequence[int]:
        found: Sequence[int] = self._truths(form_of_box(box, symbols=False))
        return found


class ModuleTube:
    """Follows the SC of one module, whose problem was read, in tubes.

    `ways`: Y, the ranges at rest of the states that `moves` does not name. If a state has no range,
    nothing is known of it at rest.
    """

    def __init__(self, problem: RestProblem, ways: Mapping[int, Range]) -> None:
        facts, members = problem.facts, problem.followed
        self.problem, self.ways = problem, dict.fromkeys(facts.turning, A_TURN) | dict(ways)
        model = RestModel(facts, (), facts.extents)
        self._seen: list[str] | None = None
        self._set_constraint(problem.default_maps)
        self.rest = ConditionOnBoxes(
            model, members, lambda t, x: model.truth_of(t, x, problem.rest.condition, errors=False)
        )
        flow = TubeFlow(model, members, uncrossed_ends(model, members))
        self.chain = TubeChain(
            model, members, flow, problem.times.chain, problem.topics_of(members)
        )

    @property
    def estimate_fields(self) -> list[str]:
        """The fields of an estimate, as `topic.field`: those of states in order, then of maps."""
        maps = [name for names in self.problem.map_leaves.values() for name in names]
        return [*(self.problem.field_read(s) for s in self.problem.followed), *maps]

    @property
    def judges_commands(self) -> bool:
        """Whether the DM judges commands, too: then it may accept what `why_not_good` refuses.

        `why_not_good` demands that every command is harmless until the next verdict is in force.
        """
        return self.problem.facts.symbol.shield is not None

    def why_not_good(self, estimate: Mapping[str, float]) -> str | None:
        """Why an estimate (a number for each of `estimate_fields`) may be bad; None: it is good."""
        box, maps = [], {}
        for index, names in self.problem.map_leaves.items():
            numbers = [estimate[name] for name in names]
            if not all(isfinite(x) for x in numbers):
                return f"a number of `{self.problem.facts.system.topics[index].name}` is none"
            maps[index] = value_of_leaves(self.problem.facts.system.topics[index].type, numbers)
        self._set_constraint(maps)
        for s in self.problem.followed:
            x = exact(estimate[self.problem.field_read(s)])
            error = exact(self.problem.max_error(s))
            if not x.is_finite():
                return f"`{self.problem.field_read(s)}` is no number"
            error += (abs(x) + error) * UNIT_ROUNDOFF * 2  # a sensor rounds the sum
            box.append((x - error, x + error))
        times = self.problem.times
        return self.why_not_settled(box, times.alpha, times.horizon)

    def why_starts_not_good(self) -> str | None:
        """Why an initial state may not be good, or None; until h_0 any command may act."""
        states, times = self.problem.facts.states, self.problem.times
        box = [(exact(states[s].low), exact(states[s].high)) for s in self.problem.followed]
        self._set_constraint(self.problem.default_maps)
        return self.why_not_settled(box, times.start_alpha, times.start)

    def _set_constraint(self, maps: Mapping[int, Value]) -> None:
        seen = [x.hex() for of in maps.values() for x in scalar_leaves(of)]
        if seen != self._seen:
            model = RestModel(self.problem.facts, (), self.problem.facts.extents, known=maps)
            self._seen = seen
            self.constraint = ConditionOnBoxes(
                model, self.problem.followed, lambda t, x: state_constraint(model, t, x)
            )

    # ------------------------------------------------------------ tubes

    def why_not_settled(self, box: Box, earliest: int, latest: int) -> str | None:
        """Why SC, acting first in [earliest, latest] ns, may not rest from a box; None: it does."""
        if not self.is_within_c(box):
            return "C is not certain of the estimate itself"
        body, step = StateSet.from_box(box), earliest * NANOSECOND / FREE_PIECES
        try:
            for _ in range(FREE_PIECES if earliest else 0):
                body, boxes = self.chain.follow_any_commands(body, step)
                if not self.are_within_c(boxes):
                    return "any command may lead out of C before SC acts"
        except NotCertainError:
            return "where any command leads before SC acts is not known"
        return self._why_not_settled_in_window(body, (latest - earliest) * NANOSECOND, 0)

    def _why_not_settled_in_window(self, body: StateSet, span: Fraction, cut: int) -> str | None:
        """Why SC may not rest if an output begins to act within `span` s; None if it does rest."""
        try:
            inside = self.chain.at_some_instant(body, span) if span else body
            why = None
            if not self.is_within_c(inside.box):
                why = "any command may lead out of C before SC acts"
            why = why or self.why_not_settled_at(inside, PIECES[cut])
            if why is None or cut == CUTS:
                return why
            if not span:
                return self._why_not_settled_in_window(body, span, cut + 1)
            middle, _ = self.chain.follow_any_commands(body, span / 2)
            return self._why_not_settled_in_window(
                body, span / 2, cut + 1
            ) or self._why_not_settled_in_window(middle, span / 2, cut + 1)
        except NotCertainError:
            return "a tube has no end"

    def why_not_settled_at(self, body: StateSet, pieces: int, used: int = 0) -> str | None:
        """Why SC may not rest if output `used` begins to act in a state of `body`; or None."""
        if self.is_settled(body.box):
            return None
        late = bool(self.chain.span)
        for n in range(self.problem.times.switches + 1 - used):
            if n and not late and self.is_settled(body.box):
                return None
            body, boxes = self.chain.follow_hold(body, pieces)
            if n and late:  # the first box has all states in which this output begins to act
                first, *boxes = boxes
                if self.is_within_c(first) and self.is_settled(first):
                    return None
                boxes = [first, *boxes]
            if not self.are_within_c(boxes):
                return f"SC may lead out of C within {n + 1} of its steps"
        return "SC is not certainly at rest in time"

    def is_within_c(self, box: Box) -> bool:
        """Whether all of a box is certainly in C, and no end of it is beyond `UNKNOWN_END`."""
        near = all(low >= -UNKNOWN_END and high <= UNKNOWN_END for low, high in box)
        return near and self.constraint.is_certain(box)

    def are_within_c(self, boxes: Sequence[Box]) -> bool:
        """Whether all boxes are certainly in C; tries the cheaper box around all of them first."""
        sides = [zip(*of_state, strict=True) for of_state in zip(*boxes, strict=True)]
        around = [(reduce(arb.min, lows), reduce(arb.max, highs)) for lows, highs in sides]
        return self.is_within_c(around) or (len(boxes) > 1 and all(map(self.is_within_c, boxes)))

    def is_settled(self, box: Box) -> bool:
        """Whether a box is in Q, and all states to which SC may move from it (M) are in C."""
        if not self.rest.is_certain(box):
            return False
        moved, endless = [], False
        for s, (low, high) in zip(self.problem.followed, box, strict=True):
            drift, way = self.problem.drifts.get(s), self.ways.get(s)
            if drift is not None:
                below, above = drift
                endless = endless or inf in drift
                moved.append(
                    (
                        -exact(LARGEST) if below == inf else low - exact(below),
                        exact(LARGEST) if above == inf else high + exact(above),
                    )
                )
            elif way is not None:
                moved.append((exact(way[0]), exact(way[1])))
            else:
                endless = True
                moved.append((-exact(LARGEST), exact(LARGEST)))
        precision = flint.ctx.prec
        try:
            if endless:
                flint.ctx.prec = FINE
            return self._is_certain_far_out(moved, FAR_CUTS if endless else 0)
        finally:
            flint.ctx.prec = precision

    def _is_certain_far_out(self, box: Box, cuts: int) -> bool:
        """Whether C certainly holds on a box; may cut the box into parts far from 0 to find out."""
        if self.constraint.is_certain(box):
            return True
        axis = max(range(len(box)), key=lambda i: (box[i][1] - box[i][0]).mid())
        low, high = box[axis]
        if not cuts or high - low < FAR:
            return False
        middle = cut_point(low, high)
        halves = ([*box[:axis], h, *box[axis + 1 :]] for h in ((low, middle), (middle, high)))
        return all(self._is_certain_far_out(half, cuts - 1) for half in halves)
