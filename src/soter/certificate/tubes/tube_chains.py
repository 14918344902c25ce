"""The re-checker's tubes: sets of states as generators, carried step by step, and what holds.

Purpose: `Body`, a set of states with the commands that still act; `TubeChain`: holds of SC, spans
of any command, the states at any instant of a window, each from a body to a body. `Truths`: which
conditions are certain over boxes of states, and which are certainly not; nothing is, outside of
their sets.
Non-goals: what a hold is (`grid/flow_chains.py`); which tubes (`flight_verdict.py`), which
conditions (`rest_problem.py`).

The argument is that of `FlowChain`: a hold is rows over generators z, each of which is a number in
[-1, 1], or 1. Here z has as many columns as there are unknowns; behind a hold what rows do not say
(`rest`) is an unknown of its own for each state. Commands that may still act keep what they share
with the states. Unknowns that matter least are put together, one for each row (Girard): whatever
they were, their sum is within the sum of their sizes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.certificate.grid.chain_form_layout import OpenedForm, spread_of
from soter.certificate.grid.flow_chains import NOW, FlowChain
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.reading.map_steps import atom_of, boxes_of
from soter.certificate.terms.arb_balls import HALF, ONE, ZERO, exact
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.straight_line import CERTAIN, product

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from fractions import Fraction

    from soter.certificate.grid.chain_form_layout import CommandRows, StateRows
    from soter.certificate.grid.flow_enclosures import Interval
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.straight_line import Rows
    from soter.certificate.terms.terms import Linear, Proposition, Terms

    Box = list[Interval]


COLUMNS = 40
"""Unknowns that are kept as they are."""


class TubeFlow(LocalFlow):
    """A flow that is cut as its tube says; where two commands may act is a step of its own."""

    apart = True

    def steps(self, span: Fraction) -> int:
        """A span is never cut: the tube says where."""
        del span
        return 1


@dataclass(eq=False)
class Body:
    """States in `box` and in rows of a constant and factors of unknowns in [-1, 1].

    `memory`: rows of the commands that may still act, the latest first, with their `ranges`; none
    where any may have acted.
    """

    box: Box
    rows: Rows
    memory: Rows
    ranges: Box

    @classmethod
    def of(cls, box: Box) -> Body:
        """All of a box, whatever acted before."""
        rows = []
        for i, (low, high) in enumerate(box):
            row = [(low + high) * HALF, *[ZERO] * len(box)]
            row[1 + i] = (high - low) * HALF
            rows.append(row)
        return cls(box, rows, [], [])


class TubeChain(FlowChain):
    """Steps of one tube; `NotCertainError` where nothing is found."""

    # ------------------------------------------------------------ steps

    def hold(self, body: Body, pieces: int) -> tuple[Body, list[Box]]:
        """SC's next command and where it leads, up to the earliest instant of the one after it.

        The boxes on the way; where commands act late the first one has all states in which this
        one begins to act.
        """
        fresh = not body.memory and self.depth > 0
        start = self._opened(body)
        new = self._answered(start, fresh=fresh)
        way, tube = self._led(start, new, self.spans(pieces, fresh=fresh or not self.depth))
        return self._closed(start, way, new), _boxes(tube, self.n)

    def anything(self, body: Body, span: Fraction) -> tuple[Body, list[Box]]:
        """Any commands for so long."""
        start = self._opened(Body(body.box, body.rows, [], []))
        way, tube = self._led(start, self._any(start), [(span, NOW)])
        return self._closed(start, way, None), _boxes(tube, self.n)

    def window(self, body: Body, span: Fraction) -> Body:
        """The states at some instant of the next `span`, under any commands."""
        start = self._opened(Body(body.box, body.rows, [], []))
        way = self._moved(start, (NOW, span), self._any(start), self.flow.ranges, [])
        return self._closed(start, way, None)

    # ------------------------------------------------------------ bodies

    def _opened(self, body: Body) -> OpenedForm:
        """The unknowns z of a step: states, what acted, what SC answers beside its rows, 1."""
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

    def _closed(self, start: OpenedForm, way: StateRows, new: CommandRows | None) -> Body:
        """What came of it, over unknowns; `new`: what acts now, None: anything."""
        rows = product(way.rows, start.z)
        memory, ranges = [], []
        if new is not None and self.depth:
            n, old = self.n, (self.depth - 1) * self.q
            memory = [*product(new.rows, start.z), *start.z[n : n + old]]
            ranges = [*new.ranges, *start.ranges[n : n + old]]
        rows = [self._with_own(row, i, way) for i, row in enumerate(rows)]
        memory = [[*row, *[ZERO] * self.n] for row in memory]
        rows, memory = _fewer(rows, memory)
        return Body(list(way.box), rows, memory, ranges)

    def _with_own(self, row: list[Any], i: int, way: StateRows) -> list[Any]:
        """A row with its rest; that of its range where this is much the smaller one."""
        own = [ZERO] * self.n
        own[i] = way.rest[i]
        low, high = way.box[i]
        half = (high - low) * HALF
        if half < HALF * (spread_of(row[1:]) + way.rest[i]):
            own[i] = half
            return [(low + high) * HALF, *[ZERO] * (len(row) - 1), *own]
        return [*row, *own]


def _boxes(tube: Sequence[float], n: int) -> list[Box]:
    ends = [(exact(a), exact(b)) for a, b in zip(tube[::2], tube[1::2], strict=True)]
    return [ends[k : k + n] for k in range(0, len(ends), n)]


def _lost(column: list[float], whole: list[float]) -> float:
    shares = [x / w for x, w in zip(column, whole, strict=True)]
    return sum(shares) - max(shares)


def _own_unknown(i: int, rows: int, left: Sequence[Sequence[Any]]) -> list[Any]:
    own = [ZERO] * (rows if left else 0)
    if left:
        own[i] = spread_of([c[i] for c in left])
    return own


def _fewer(rows: Rows, memory: Rows) -> tuple[Rows, Rows]:
    """The same with `COLUMNS` unknowns and one a row: those stay that a box loses most of."""
    every = [*rows, *memory]
    columns = [c for c in zip(*(row[1:] for row in every), strict=True) if any(c)]
    sizes = [[float(abs(x.mid())) for x in c[: len(rows)]] for c in columns]
    whole = [sum(of) or 1.0 for of in zip(*sizes, strict=True)] if columns else []
    scores = [_lost(c, whole) for c in sizes]
    order = sorted(range(len(columns)), key=scores.__getitem__, reverse=True)
    kept = [columns[k] for k in order[:COLUMNS]]
    left = [columns[k] for k in order[COLUMNS:]]
    made = []
    for i, row in enumerate(every):
        made.append([row[0], *(c[i] for c in kept), *_own_unknown(i, len(every), left)])
    return made[: len(rows)], made[len(rows) :]


NOWHERE = 1
"""The bits of what is certainly false."""


class Truths:
    """Conditions on true states, over boxes of some of them."""

    def __init__(
        self,
        model: CaseModel,
        members: Sequence[int],
        said: Callable[[Terms, list[Linear]], Proposition],
    ) -> None:
        terms, states = model.new_terms()
        first = said(terms, states)
        own = [atom_of(states[i]) for i in members]
        known = [(terms.atoms[a].low, terms.atoms[a].high) for a in own]
        boxes = boxes_of(model, states, members)
        self._truths = compile_truths(terms, own, [first, *terms.obligations], boxes)
        self._ends = [
            ends if i in model.facts.unbounded else (exact(low), exact(high))
            for i, ends, (low, high) in zip(
                members, known, (model.extents[i] for i in members), strict=True
            )
        ]

    def certain(self, box: Box) -> bool:
        """Whether it holds, and is defined, in all of a box."""
        return self._within(box) and all(t == CERTAIN for t in self._of(box))

    def nowhere(self, box: Box) -> bool:
        """Whether it holds in none of it."""
        return self._within(box) and self._of(box)[0] == NOWHERE

    def _within(self, box: Box) -> bool:
        pairs = zip(box, self._ends, strict=True)
        return all(low >= a and high <= b and low <= high for (low, high), (a, b) in pairs)

    def _of(self, box: Box) -> Sequence[int]:
        found: Sequence[int] = self._truths(form_of_box(box, symbols=False))
        return found
