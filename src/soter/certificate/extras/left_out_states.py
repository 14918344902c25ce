"""Checks again states that claims leave out, wholly or beyond the ends of their axes.

Purpose: `leave_out_states` takes the states that a certificate leaves out from the problem;
`refuse_reads_of_left_out_states` checks that nothing which is asked depends on them.
`require_unread_states` shows that no rate and no command of SC reads a state whose axis is
unbounded; `read_turning` enters which axes wrap around, and `refuse_turns_read` checks that all
that reads their states is the same a turn further. `GridBeyondEnds` is a grid with such axes.
Non-goals: sets of the other states (`cell_sets.py`); the rates' values.

The argument for a state that is left out: what is asked are terms of the other states, so that a
run of all states shows a run of these. It has to go on for as long as is asked: the rates of what
is left out grow no faster than it does, with factors that everything else bounds (Gronwall).

The argument for an axis without ends, or one that wraps. Everything that is asked is a term. Each
is read with the state anywhere up to 3 `THIRD`, so that nothing is decided by where it is. There it
may only stand in arguments of functions of a full turn, as a whole multiple of itself, to which
only what does not depend on it is added: then the argument moves by whole turns as the state does,
and what is rounded of it there is within `FAR_TURNS`, which is added to it where runs are enclosed
near the grid. So a run a turn further is a run, and its commands, rates and predicates are enclosed
by those of the one near the grid. Estimates are those that the DM brings back to the grid, which is
off by less.

The first and the last cell of an axis without ends hold all that lies beyond. Of the runs that
begin there those are enclosed that begin between the edges. Let one begin at z beyond the upper
edge e, which a box from which runs are enclosed touches. Take from it, at all times, z - e along
that axis: that is a run from the box. Where it does not fall by more than the last cell is wide it
stays in the last cell, and the other one, which is above it, does so, too, while all else of the
two is the same (`holds_beyond_ends`).
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb

from soter.certificate.cell_sets import Grid
from soter.certificate.extras.prelude_functions import (
    EVERYWHERE,
    FAR_TURNS,
    OF_A_TURN,
    may_be_turned,
)
from soter.certificate.reading.case_model import FARTHEST, LEFT_OUT, CaseModel, new_command_terms
from soter.certificate.reading.module_facts import Facts, bounded_topics
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import all_certain
from soter.certificate.terms.linear_enclosures import exact, lower, upper
from soter.certificate.terms.terms import (
    Linear,
    Proposition,
    Terms,
    atoms_under,
    input_atoms,
    subpropositions,
)
from soter.language.model.assumption_words import in_words

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Block
    from soter.certificate.report import Said


BOUNDED = EVERYWHERE | {"soft_sign"}
LARGEST_OF = frozenset({"max0", "abs", "sqrt", "choice", "spread", "min", "max"})
THIRD = 5461.5
"""Terms hold on three times an extent: up to 16,384 is assumed of each such state."""
NEAR = exact(2.0**-44)
"""Ends of an axis are so near to a turn apart."""
TURN = 2 * math.pi
SEAM = 2.0**-40
"""By so much the cells at the ends of a full turn go on beyond them: the ends are a turn apart but
for rounding, so that these two cells meet."""
BACK = 2.0**-45
"""More than what is lost where a number is brought back by whole turns."""
FAR = 2.0**14
"""The farthest from 0 that a state on an axis which wraps around is assumed to be, in rad."""
FARTHEST_TURNED = 32.0
"""Farther numbers are not brought back."""
WIDER = 256
"""The factor by which each box is wider than the one before, on the way there."""


def leave_out_states(facts: Facts, names: Collection[str]) -> None:
    """Removes the states with these names from the problem.

    Raises RejectedError if the module declares an axis for one of them.
    """
    left = {i for i, s in enumerate(facts.states) if s.name in names}
    if not left:
        return
    if left & (facts.axes.keys() | facts.leaves.keys() | facts.unbounded) or facts.kind != "flow":
        raise RejectedError(f"there are no sets of {', '.join(sorted(names))}")
    kept = [i for i in range(len(facts.states)) if i not in left]
    place = {i: k for k, i in enumerate(kept)}
    facts.left_out = [facts.states[i] for i in sorted(left)]
    facts.states = [facts.states[i] for i in kept]
    facts.axes = {place[i]: x for i, x in facts.axes.items()}
    facts.leaves = {place[i]: x for i, x in facts.leaves.items()}
    facts.unbounded = {place[i] for i in facts.unbounded}
    facts.open_ends = {place[i] for i in facts.open_ends}


def refuse_reads_of_left_out_states(model: CaseModel) -> None:
    """Raises RejectedError if a claim depends on a left-out state, or such a state may end.

    Raises NotRecheckedError if the rate of a left-out state may be undefined.
    """
    facts = model.facts
    terms, states = model.new_terms()
    asked: list[Linear | Proposition] = list(model.sc_commands(terms, states))
    asked.append(model.truth_of(terms, states, facts.symbol.safe, errors=False))
    seen = [facts.ttf, facts.symbol.safer, facts.symbol.verify.enters]
    asked += [model.truth_of(terms, states, e, errors=True) for e in seen if e is not None]
    asked += [model.topic_in_set(terms, states, topic) for topic in bounded_topics(facts)]
    controls = new_command_terms(facts, terms)
    asked += [*model.rates(terms, states, controls)[0], *terms.obligations]
    terms.obligations.clear()
    of_left_out = model.rates_of_left_out_states(terms, states, controls)
    left = {i for i, atom in enumerate(terms.atoms) if atom.name.startswith(LEFT_OUT)}
    names = ", ".join(s.name for s in facts.left_out)
    if input_atoms(terms, asked) & left:
        raise RejectedError(f"something that is asked reads what is left out: {names}")
    if not all_certain(terms, terms.obligations):
        raise NotRecheckedError(f"the rate of what is left out is not defined everywhere: {names}")
    if any(growth_degree(terms, rate, left) > 1 for rate in of_left_out):
        raise RejectedError(f"what is left out may end before what is asked does: {names}")


def growth_degree(terms: Terms, x: Linear, inputs: Collection[int]) -> float:
    """The highest degree with which a term may grow in these inputs; inf if it is unknown."""
    known: dict[int, float] = {}
    for index in sorted(atoms_under(terms, [x])):  # arguments first
        atom = terms.atoms[index]
        parts = [max((known[a] for a in y.terms), default=0) for y in atom.arguments]
        if index in inputs or not any(parts):
            known[index] = index in inputs
        elif atom.kind in BOUNDED:
            known[index] = 0
        elif atom.kind == "product":
            known[index] = sum(parts)
        else:
            known[index] = max(parts) if atom.kind in LARGEST_OF else inf
    return max((known[a] for a in x.terms), default=0)


def require_unread_states(model: CaseModel, groups: int) -> None:
    """Raises NotRecheckedError if a rate or SC may read a state whose axis has no ends.

    To see every branch, also those beyond the grid, the rates and SC's step are evaluated with such
    states up to `FARTHEST`. The argument covers no maps, no `enters`, and only a single group.
    """
    facts = model.facts
    if facts.kind == "map" or facts.symbol.verify.enters is not None:
        raise NotRecheckedError("an axis without ends of a map, or of `enters`")
    if groups != 1:
        raise NotRecheckedError("an axis without ends beside other groups")
    terms, states = model.new_terms(FARTHEST)
    rates, _ = model.rates(terms, states, new_command_terms(facts, terms))
    read = input_atoms(terms, [*rates, *model.sc_commands(terms, states), *terms.obligations])
    for i in sorted(facts.unbounded):
        (atom,) = states[i].terms
        if atom in read:
            name = facts.states[i].name
            raise NotRecheckedError(f"`{name}`, whose axis has no ends, is read by SC or a plant")


def read_turning(facts: Facts, names: object) -> None:
    """Enters the states whose axes wrap around; raises RejectedError if one of them may not.

    The extents of all states must have been entered before.
    """
    if not isinstance(names, list) or not names or len({*map(str, names)}) != len(names):
        raise RejectedError("`wraps` is not as it should be")
    by_name = {s.name: i for i, s in enumerate(facts.states)}
    if not by_name.keys() >= {*names}:
        raise RejectedError("`wraps` names a state that there is not")
    symbol = facts.symbol
    beside = (symbol.shield, symbol.verify.enters)
    if facts.kind != "flow" or facts.view or beside != (None, None):
        raise RejectedError("an axis wraps around where that is not settled")
    facts.turning = {*map(by_name.__getitem__, names)}
    for i in facts.turning:
        low, high = map(exact, facts.extents[i])
        long = abs(high - low - 2 * arb.pi()) < NEAR and -low < 10 and high < 10
        if not long or i in facts.unbounded | facts.open_ends:
            raise RejectedError(f"the axis of {facts.states[i].name} is no full turn")


def refuse_turns_read(model: CaseModel) -> None:
    """Raises RejectedError if rates, commands or predicates change after a full turn."""
    facts, far = model.facts, (-THIRD, THIRD)
    extents = tuple(far if i in facts.turning else e for i, e in enumerate(model.extents))
    model = replace(model, extents=extents)
    terms, states = model.new_terms()
    asked: list[Linear | Proposition] = list(model.sc_commands(terms, states))
    true = [facts.symbol.safe, *([facts.symbol.rest.condition] if facts.symbol.rest else [])]
    asked += [model.truth_of(terms, states, e, errors=False) for e in true]
    seen = [e for e in (facts.ttf, facts.symbol.safer) if e is not None]
    asked += [model.truth_of(terms, states, e, errors=True) for e in seen]
    asked += [model.topic_in_set(terms, states, topic) for topic in bounded_topics(facts)]
    asked += model.rates(terms, states, new_command_terms(facts, terms))[0]
    asked += terms.obligations
    if not all(_is_turn_invariant(terms, x) for x in asked):
        names = ", ".join(facts.states[i].name for i in sorted(facts.turning))
        raise RejectedError(f"something reads how many turns there are in {names}")


def _is_turn_invariant(terms: Terms, asked: Linear | Proposition) -> bool:
    """Whether a term keeps its value when angles grow by full turns."""
    for index in atoms_under(terms, [asked]):
        atom = terms.atoms[index]
        if atom.condition is not None and not _compares_no_angle(terms, atom.condition):
            return False
        angles = [x for x in atom.arguments if may_be_turned(terms, x)]
        if angles and not (atom.kind in OF_A_TURN and all(_is_angle(terms, x) for x in angles)):
            return False
    return _compares_no_angle(terms, asked)


def _compares_no_angle(terms: Terms, x: Linear | Proposition) -> bool:
    """Whether neither a term nor any comparison in a proposition contains a bare angle."""
    if isinstance(x, Linear):
        return not may_be_turned(terms, x)
    compared = [p.argument for p in subpropositions(x) if p.argument is not None]
    return not any(may_be_turned(terms, y) for y in compared)


def _is_angle(terms: Terms, x: Linear) -> bool:
    """Whether a term counts each angle a whole number of times, with small rounding."""
    whole = all(x.terms[i].is_integer() for i in terms.turning & x.terms.keys())
    return whole and bool(x.radius <= 2 * FAR_TURNS)  # with that of the function


# ---------------------------------------------------------------- grids with such axes


@dataclass(frozen=True, eq=False)
class GridBeyondEnds(Grid):
    """A grid with axes that have no ends, or that are a full turn and wrap around."""

    unbounded: tuple[bool, ...]
    wraps: tuple[bool, ...]

    def cells_around_interval(self, axis: int, low: float, high: float) -> tuple[int, int] | None:
        """Cells as in `Grid`; on an axis that wraps around, numbers go on after the last cell."""
        edges = self.edges[axis]
        if self.wraps[axis]:
            near = -FARTHEST_TURNED <= low <= high <= FARTHEST_TURNED
            return _cells_of_turn_around(edges, low, high) if near else None
        if self.unbounded[axis]:
            width = edges[-1] - edges[0]
            if not (edges[0] - width <= low <= high <= edges[-1] + width):
                return None
            low, high = self.move_onto_axis(axis, low, high)
        return super().cells_around_interval(axis, low, high)

    def box_of(self, block: Block) -> list[tuple[arb, arb]]:
        """The box of a block of cells, a little wider at the ends of an axis that wraps around."""
        ends = []
        for edges, around, (low, high) in zip(self.edges, self.wraps, block, strict=True):
            cuts = (edges[0] - SEAM, *edges[1:-1], edges[-1] + SEAM) if around else edges
            ends.append((exact(cuts[low]), exact(cuts[high])))
        return ends

    def table_continued(self, table: NDArray[Any]) -> NDArray[Any]:
        """A table of the grid's shape, repeated along the axes that wrap around."""
        for k in np.flatnonzero(self.wraps):
            table = np.concatenate([table, table], axis=int(k))
        return table

    def holds_beyond_ends(self, start: Sequence[tuple[arb, arb]], boxes: Sequence[float]) -> bool:
        """Whether boxes that enclose runs from `start` also do so for runs from beyond axis ends.

        `boxes`: low, high, ... of all boxes in turn. The head of this file explains the rule.
        """
        width = 2 * len(self.edges)
        if not boxes:
            return True
        for k in (k for k in range(len(self.edges)) if self.unbounded[k]):
            edges, (low, high) = self.edges[k], start[k]
            least, most = min(boxes[2 * k :: width]), max(boxes[2 * k + 1 :: width])
            if not high < edges[-1] and not low - exact(least) <= _cell_width(edges, -2):
                return False
            if not low > edges[0] and not exact(most) - high <= _cell_width(edges, 0):
                return False
        return True

    def boxes_covering(self, block: Block, reads: Sequence[bool]) -> list[list[tuple[arb, arb]]]:
        """Boxes that cover a block and, along axes that are read, all beyond it up to `FARTHEST`.

        The first box is the block's. Each further box is wider by a large factor, so that the
        numbers in a box are of similar size and rounding stays small.
        """
        sides = []
        for k, inside in enumerate(self.box_of(block)):
            parts = [inside]
            if self.unbounded[k] and reads[k]:
                at_low, at_high = block[k][0] == 0, block[k][1] == self.shape[k]
                parts += intervals_beyond(self.edges[k], low=at_low, high=at_high)
            sides.append(parts)
        return [list(box) for box in product(*sides)]

    def move_onto_axis(self, axis: int, low: float, high: float) -> tuple[float, float]:
        """An interval moved onto an axis without ends, or turned back onto one that wraps."""
        edges = self.edges[axis]
        if self.unbounded[axis]:
            return min(max(low, edges[0]), edges[-1]), min(max(high, edges[0]), edges[-1])
        return interval_turned_back(edges, low, high) if self.wraps[axis] else (low, high)


def has_no_ends(grid: Grid, axis: int) -> bool:
    """Whether an axis has no ends, so that its outer cells contain all states beyond."""
    return isinstance(grid, GridBeyondEnds) and grid.unbounded[axis]


def reached_breakpoints(grid: Grid, axis: int) -> tuple[float, ...]:
    """The breakpoints of an axis; the outer two are moved as far out as their cells reach."""
    edges, far = grid.edges[axis], float(FARTHEST)
    return (-far, *edges[1:-1], far) if has_no_ends(grid, axis) else edges


def intervals_beyond(edges: Sequence[float], *, low: bool, high: bool) -> list[tuple[arb, arb]]:
    """Intervals that cover the numbers beyond the ends of an axis, up to `FARTHEST`."""
    first, last = edges[0], edges[-1]
    below_it = [(-b, -a) for a, b in _intervals_above(-first, last - first)] if low else []
    return [*below_it, *(_intervals_above(last, last - first) if high else ())]


def _cells_of_turn_around(edges: Sequence[float], low: float, high: float) -> tuple[int, int]:
    """The cells of a full turn that cover an interval; numbers go on after the first turn."""
    count, turns = len(edges) - 1, [math.floor((x - edges[0]) / TURN) for x in (low, high)]
    if turns[0] == -1 and low >= edges[0] - SEAM:
        turns[0] = 0  # of the first cell still
    if turns[1] == 1 and high <= edges[-1] + SEAM:
        turns[1] = 0  # of the last one
    low, high = (
        x - TURN * k + apart * (k != 0)
        for x, k, apart in zip((low, high), turns, (-BACK, BACK), strict=True)
    )
    first = min(max(bisect_right(edges, low) - 1, 0), count - 1) + turns[0] * count
    last = max(min(bisect_left(edges, high), count), 1) + turns[1] * count
    if last - first >= count:
        return 0, count
    last = max(last, first + 1)
    return first % count, first % count + last - first


def interval_turned_back(edges: Sequence[float], low: float, high: float) -> tuple[float, float]:
    """Shifts an interval back by whole turns until it begins on the axis, rounded outwards.

    An interval on the axis or too far out stays unchanged. An interval of half a turn or more
    becomes the whole axis, as enclosures reach half a turn beyond the axis.
    """
    if edges[0] <= low <= high <= edges[-1] or not max(-low, high) <= FAR:
        return low, high
    if high - low >= TURN / 2:
        return edges[0] - SEAM, edges[-1] + SEAM
    back = 2 * arb.pi() * math.floor((low - edges[0]) / TURN)
    return lower(exact(low) - back), upper(exact(high) - back)


def _cell_width(edges: Sequence[float], cell: int) -> arb:
    """The width of a cell of an axis; -2 is the last cell."""
    return exact(edges[cell + 1]) - exact(edges[cell])


@lru_cache(maxsize=64)
def _intervals_above(end: float, width: float) -> Sequence[tuple[arb, arb]]:
    """Intervals from an end upwards to `FARTHEST`."""
    intervals, low, step = [], exact(end), exact(width)
    while low < FARTHEST:
        high = (exact(end) + step).min(FARTHEST)
        intervals.append((low, high))
        low, step = high, step * WIDER
    return intervals


def axis_assumptions(facts: Facts) -> Said:
    """Yields the assumptions about open ends, left-out states, and axes that wrap around."""
    for state in sorted(facts.open_ends):
        name, end = facts.states[state].name, facts.axes[state][1]
        yield f"open {name} {end!r}", in_words("open", name, end)
    for s in facts.left_out:
        yield f"left out {s.name}", in_words("left out", s.name)
    for name in (facts.states[i].name for i in sorted(facts.turning)):
        text = "read modulo a full turn, so that its axis wraps around, and within 16,384 rad of 0"
        yield f"turns {name}", f"{text}: {name}"
