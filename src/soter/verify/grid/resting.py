"""Cells from which SC comes to rest wherever the plant is ("Rest anywhere", docs/proof-sets.md).

Purpose: `cells_at_rest` finds cells of K that no chain can show. While SC stops a plant, a *way*,
a state that nothing reads, changes by ever less; but on a grid each period touches the next cell,
so chains never end. Instead, a potential bounds the whole change of the way: while another
state falls by 1, the way changes by c at most. B is the box of those other states, around 0.
Non-goals: all other cells of K (`sets.py`, whose head has the symbols).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import inf
from typing import TYPE_CHECKING, cast

import numpy as np

from soter.verify.grid.group_model import OUTSET
from soter.verify.problem.problem import FARTHEST, Interval
from soter.verify.tubes.enclosures import Enclosures
from soter.verify.tubes.expression_graph import NoExpressionError
from soter.verify.tubes.module_expressions import ModuleExpressions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from soter.core.layout import Bools
    from soter.verify.grid.case import Case
    from soter.verify.grid.sets import GridGroup
    from soter.verify.problem.problem import Problem
    from soter.verify.tubes.expression_graph import Expressions, Node
    from soter.verify.tubes.problem import TubeProblem

    Signs = tuple[int, ...]
    """For each state that is no way: -1 below 0, 0 at 0, 1 above 0."""
    Rates = Mapping[Signs, Sequence[Interval]]
    """The range of each state's rate, by the signs of the states that are no ways."""

MORE = Fraction(1, 2**20)
"""By this share each c is enlarged, as the c that the re-checker finds may be a little larger."""
SIDES = ((True, True), (True, False), (False, True), (False, False))
"""The boxes B that are tried: whether B reaches the grid's end, or one cell, below and above 0."""


@dataclass(frozen=True)
class _Potential:
    """Bounds a way's change by `below` or `above` times the state's distance on that side of 0."""

    axis: int
    below: Fraction
    above: Fraction

    def farthest_change(self, low: float, high: float) -> Fraction:
        """The largest change of the way that starts at any state in [low, high]."""
        return max(self.below * Fraction(max(0.0, -low)), self.above * Fraction(max(0.0, high)))


def cells_at_rest(case: Case, engine: GridGroup, allowed: Bools) -> Bools:
    """The cells of `allowed`, in the grid's shape, from which potentials show that SC stays in C.

    They count only for a module that may stay under SC: SC may never lead back from them.
    """
    assert case.problem.stays
    none = np.zeros(engine.shape, dtype=np.bool_)
    ways = _unread_axes(engine) if _is_rest_covered(case.problem, engine) else []
    if not ways or len(ways) == len(engine.axes):
        return none
    try:
        search = _RestSearch(case, engine, ways)
    except NoExpressionError:
        return none
    found = [none, *(search.cells_kept_with_box(allowed, *sides) for sides in SIDES)]
    return max(found, key=np.count_nonzero)


def _is_rest_covered(problem: Problem, engine: GridGroup) -> bool:
    """Whether the reasoning of `cells_at_rest` is valid for this problem."""
    symbol = problem.module.symbol
    alone = not (problem.view or problem.modes)
    return (
        problem.kind == "flow"
        and problem.computed
        and alone
        and len(problem.groups) == 1
        and not (problem.module.law or symbol.synthesized or symbol.shield or symbol.verify.enters)
        and not (engine.open_ends or engine.is_linear)
    )


def _unread_axes(engine: GridGroup) -> list[int]:
    """The axes whose states neither SC nor any rate reads."""
    reads = engine.library.reads
    if not {"law", "derivative"} <= reads.keys():
        return []
    read = reads["law"] | reads["derivative"]
    return [a for a, state in enumerate(engine.axes) if state not in read]


class _RestSearch:
    """Searches for boxes B, and for potentials in these boxes, for one group."""

    def __init__(self, case: Case, engine: GridGroup, ways: Sequence[int]) -> None:
        self.case, self.engine, self.ways = case, engine, ways
        self.moving = [a for a in range(len(engine.axes)) if a not in ways]
        expressions = ModuleExpressions(cast("TubeProblem", case.problem))
        self.make, self.rates = expressions.make, expressions.rates()
        n, forms = len(case.problem.states), case.forms
        whole = forms.whole.copy()
        whole[:n, 0], whole[:n, 1] = engine.low[:n], engine.high[:n]
        self.whole = whole
        self.law = forms.result_bounds("law", whole, len(case.problem.controls))
        self.ranges = {("x", s): Interval(*map(float, whole[s])) for s in range(n)}
        self.signs = tuple(product((-1, 0, 1), repeat=len(self.moving)))
        self.enclosures = self._rate_enclosures() if self.law is not None else None

    def cells_kept_with_box(self, allowed: Bools, below: bool, above: bool) -> Bools:
        """The cells kept with one box B; `below`, `above` say if B reaches the grid's ends."""
        none = np.zeros_like(allowed)
        box = [self._side_of_box(axis, below, above) for axis in self.moving]
        within = [b for b in box if b is not None]
        if self.law is None or len(within) < len(box) or not self._are_plants_defined_in(within):
            return none
        rates = self._rate_ranges_in_box(within)
        if not self._do_all_states_approach_zero(rates):
            return none
        far = [[self._potentials_of_way(rates, way, sign) for sign in (-1, 1)] for way in self.ways]
        return self._cells_that_stay_in_c(allowed, within, far)

    def _side_of_box(self, axis: int, below: bool, above: bool) -> Interval | None:
        """The side of B along an axis; None if 0 is not inside the grid."""
        edges = self.engine.edges[axis]
        if not edges[0] < 0.0 < edges[-1]:
            return None
        low = edges[0] if below else edges[edges < 0.0][-1]
        high = edges[-1] if above else edges[edges > 0.0][0]
        return Interval(float(low), float(high))

    def _enlarged_box(self, box: Sequence[Interval]) -> list[Interval]:
        """A box a little larger than B; a run that leaves B stays in this box for a while."""
        ends = []
        for axis, r in zip(self.moving, box, strict=True):
            state = self.engine.axes[axis]
            hair = (r.high - r.low) * OUTSET / 2
            low, high = self.engine.low[state], self.engine.high[state]
            ends.append(Interval(max(r.low - hair, low), min(r.high + hair, high)))
            assert ends[-1].low < r.low
            assert ends[-1].high > r.high
        return ends

    def _are_plants_defined_in(self, box: Sequence[Interval]) -> bool:
        """Whether no plant can fault at states of the box B."""
        inputs = self.whole.copy()
        for axis, r in zip(self.moving, self._enlarged_box(box), strict=True):
            inputs[self.engine.axes[axis]] = r.low, r.high
        assert self.law is not None
        n = len(self.case.problem.states)
        inputs[n : n + len(self.law)] = self.law
        return self.case.forms.result_bounds("derivative", inputs, n) is not None

    def _rate_enclosures(self) -> Enclosures:
        """Enclosures of all rates under any command of SC; each choice of signs has a list."""
        assert self.law is not None
        make, winds = self.make, self.case.problem.disturbances
        self.ranges |= {("u", k): Interval(float(a), float(b)) for k, (a, b) in enumerate(self.law)}
        self.ranges |= {("w", k): Interval(d.low, d.high) for k, d in enumerate(winds)}
        certain = {
            make.input(*at): make.constant(r.low)
            for at, r in self.ranges.items()
            if r.low == r.high
        }
        lists = []
        for signs in self.signs:
            known = dict(certain)
            for axis, sign in zip(self.moving, signs, strict=True):
                known |= _sign_replacements(make, make.input("x", self.engine.axes[axis]), sign)
            lists.append([make.substituted(e, known) for e in self.rates])
        return Enclosures(lists)

    def _rate_ranges_in_box(self, box: Sequence[Interval]) -> Rates:
        """The ranges of the rates in B, and a little beyond, by the signs of the states.

        At 0 the rates of both sides count, because a run that often crosses 0 may have any of them.
        """
        found = {}
        assert self.enclosures is not None
        for signs in self.signs:
            ranges = dict(self.ranges)
            for axis, r, sign in zip(self.moving, self._enlarged_box(box), signs, strict=True):
                ends = {-1: (r.low, 0.0), 0: (0.0, 0.0), 1: (0.0, r.high)}[sign]
                ranges["x", self.engine.axes[axis]] = Interval(*ends)
            beside = product(*((s,) if s else (-1, 0, 1) for s in signs))
            every = [self.enclosures.ranges(self.signs.index(at), ranges) for at in beside]
            found[signs] = [
                Interval(min(r.low for r in of), max(r.high for r in of))
                for of in zip(*every, strict=True)
            ]
        return found

    def _do_all_states_approach_zero(self, rates: Rates) -> bool:
        """Whether in B every state stays or moves toward 0."""
        for signs, rates_by_state in rates.items():
            for axis, sign in zip(self.moving, signs, strict=True):
                rate = rates_by_state[self.engine.axes[axis]]
                if (sign > 0 and not rate.high <= 0.0) or (sign < 0 and not rate.low >= 0.0):
                    return False
        return True

    def _potentials_of_way(self, rates: Rates, way: int, sign: int) -> list[_Potential]:
        """Potentials that bound how far a way changes, down for `sign` -1 and up for 1."""
        state = self.engine.axes[way]
        grows = {signs: _range_times_sign(r[state], sign).high for signs, r in rates.items()}
        found = []
        for k, axis in enumerate(self.moving):
            slopes = {-1: Fraction(0), 1: Fraction(0)}
            for signs, by_state in rates.items():
                most, at = grows[signs], signs[k]
                if most <= 0.0:
                    continue
                rate = by_state[self.engine.axes[axis]]
                falls = -rate.high if at > 0 else rate.low
                if not at or not falls > 0.0 or most == inf:
                    break
                slopes[at] = max(slopes[at], Fraction(most) / Fraction(falls))
            else:
                below, above = (slopes[s] * (1 + MORE) for s in (-1, 1))
                found.append(_Potential(axis, below, above))
        return found

    def _cells_that_stay_in_c(
        self, allowed: Bools, box: Sequence[Interval], far: Sequence[Sequence[list[_Potential]]]
    ) -> Bools:
        """The cells of B from which no run leaves C."""
        cells, edges = np.zeros_like(allowed), self.engine.edges
        beyond = [[self._is_safe_beyond(box, way, sign) for sign in (-1, 1)] for way in self.ways]
        inside = [
            [k for k in range(len(e) - 1) if r.low <= e[k] and e[k + 1] <= r.high]
            for e, r in ((edges[a], r) for a, r in zip(self.moving, box, strict=True))
        ]
        for of_moving in product(*inside):
            place = dict(zip(self.moving, of_moving, strict=True))
            to_rest = [slice(*_cells_up_to_zero(e, place.get(a))) for a, e in enumerate(edges)]
            fine: Bools = np.asarray(allowed[tuple(to_rest)].all(axis=tuple(self.moving)))
            for k, (way, of, out) in enumerate(zip(self.ways, far, beyond, strict=True)):
                least = [
                    min((self._reach_from_cell(p, place) for p in side), default=inf) for side in of
                ]
                fine = _cells_fine_all_around(fine, k, edges[way], least, out)
            cells[tuple(place.get(a, slice(None)) for a in range(len(edges)))] = fine
        return cells & allowed

    def _reach_from_cell(self, potential: _Potential, place: Mapping[int, int]) -> float:
        """The largest change of a way that starts in a cell, rounded up."""
        edges, k = self.engine.edges[potential.axis], place[potential.axis]
        most = potential.farthest_change(float(edges[k]), float(edges[k + 1]))
        return float(np.nextafter(float(most), inf)) if most else 0.0

    def _is_safe_beyond(self, box: Sequence[Interval], way: int, sign: int) -> bool:
        """Whether all states beyond one end of a way lie in C, for any values of the other ways."""
        inputs, edges = self.whole.copy(), self.engine.edges
        if self.engine.axes[way] in self.engine.unbounded:
            return True  # the outer cells hold all that lies beyond
        for other in self.ways:
            inputs[self.engine.axes[other]] = -FARTHEST, FARTHEST
        for axis, r in zip(self.moving, box, strict=True):
            inputs[self.engine.axes[axis]] = r.low, r.high
        ends = (-FARTHEST, edges[way][0]) if sign < 0 else (edges[way][-1], FARTHEST)
        inputs[self.engine.axes[way]] = ends
        named = self.engine.library.symbol("constraint") != self.engine.library.ffi.NULL
        return self.case.forms.is_surely_true("constraint" if named else "safe", inputs)


def _sign_replacements(make: Expressions, x: Node, sign: int) -> dict[Node, Node]:
    """The replacements for comparisons of x with 0, for x of this sign; for sign 0, of x by 0."""
    if not sign:
        return {x: make.constant(0.0)}
    zero, held = make.constant(0.0), {True: make.true, False: make.false}
    pairs = ((x, zero, sign > 0), (zero, x, sign < 0))
    return {make.compare(op, a, b): held[true] for a, b, true in pairs for op in (">", ">=")}


def _range_times_sign(r: Interval, sign: int) -> Interval:
    return r if sign > 0 else Interval(-r.high, -r.low)


def _cells_up_to_zero(edges: NDArray[np.float64], k: int | None) -> tuple[int, int]:
    """The range (first, last + 1) of the cells from cell k to 0; all cells if k is None."""
    if k is None:
        return 0, len(edges) - 1
    first = int(np.searchsorted(edges, 0.0, side="right")) - 1
    last = int(np.searchsorted(edges, 0.0, side="left")) - 1
    return min(k, first), max(k, last) + 1


def _cells_fine_all_around(
    fine: Bools, axis: int, edges: NDArray[np.float64], far: Sequence[float], beyond: Sequence[bool]
) -> Bools:
    """The cells of `fine` for which all cells within distance `far` along an axis are in `fine`."""
    low = edges[:-1] if not far[0] else np.nextafter(edges[:-1] - far[0], -inf)
    high = edges[1:] if not far[1] else np.nextafter(edges[1:] + far[1], inf)
    first = np.searchsorted(edges, low, side="right") - 1
    last = np.searchsorted(edges, high, side="left") - 1
    ends = ((low >= edges[0]) | beyond[0]) & ((high <= edges[-1]) | beyond[1])
    sums = np.insert(np.cumsum(~fine, axis=axis), 0, 0, axis=axis)
    wrong = np.take(sums, np.minimum(last, len(low) - 1) + 1, axis=axis)
    wrong = wrong - np.take(sums, np.maximum(first, 0), axis=axis)
    along = ends.reshape([-1 if k == axis else 1 for k in range(fine.ndim)])
    found: Bools = (wrong == 0) & along
    return found
