"""Cells from which SC comes to rest, wherever it then is: "Rest anywhere" of docs/proof-sets.md.

Purpose: `Resting` shows that SC keeps C for ever from the cells that a certificate
marks so. It marks them, and no more: which states nothing reads (the *ways*), the box B that the
others stay in, and how far a way gets in all is found here.
Non-goals: cells with a number of holds (`group_claims.py`).

Let B be a box of the other states around 0, and a little more. Where each is above 0 (below it,
0), the signs of all of a run at an instant, every rate is enclosed, comparisons with 0 decided by
the sign. A state whose rate is never positive above 0 and never negative below gets no farther from
0. Let y be one, z a way and s z' its growth in a direction. If for c >= 0 always s z' + (c |y|)' <=
0, where c may be another one above and below 0, z grows by c |y| at most: with y = 0 on a set of
times y' is 0 on almost all of it, so there s z' <= 0 is asked.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.extras.left_out_states import has_no_ends, intervals_beyond
from soter.certificate.reading.case_model import FARTHEST, new_command_terms
from soter.certificate.reading.linear_flows import has_linear_rates
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import all_certain
from soter.certificate.terms.linear_enclosures import ZERO, exact, lower, upper
from soter.certificate.terms.terms import FALSE, TRUE, Terms, input_atoms

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Axes, Block, Cells
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.terms import Linear, Proposition

    Interval = tuple[arb, arb]
    Signs = tuple[int, ...]
    Rates = Mapping[Signs, Sequence[Interval]]

HAIR = exact(2.0**-21)
"""The share of B's width by which it is looked at beyond its ends, where a run that left it is."""


@dataclass(eq=False)
class TermsBesideZero(Terms):
    """Terms over inputs, some of which never reach one of their two ends."""

    excluded: dict[int, int] = field(default_factory=dict)
    """Inputs that lie above their lower end (1), or below their upper one (-1)."""

    def below_zero(self, x: Linear, *, strict: bool = True) -> Proposition:
        """The proposition x < 0 as in `Terms`, also decided at ends that inputs never reach."""
        if self._is_beside_zero(x, 1 if strict else -1):
            return TRUE if strict else FALSE
        return super().below_zero(x, strict=strict)

    def is_outside_state(self, x: Linear) -> bool:
        """Whether x reads an input that never reaches an end; both truths count at that end."""
        return any(self.excluded.get(index, 0) for index in x.terms)

    def _is_beside_zero(self, x: Linear, sign: int) -> bool:
        """Whether sign * x <= 0, with 0 only if an input is at an end that it never reaches."""
        most, beside = sign * x.const + x.radius, False
        for index, factor in x.terms.items():
            atom, slope = self.atoms[index], sign * factor
            most += (slope * atom.low).max(slope * atom.high)
            beside |= bool(-slope * self.excluded.get(index, 0) > 0)
        return beside and bool(most <= 0)


class Resting:
    """The argument for the marked cells of a group; raises NotRecheckedError if it fails."""

    def __init__(self, model: CaseModel, group: Axes, marked: NDArray[np.bool_], c: Cells) -> None:
        """`marked` has the grid's shape; `c` contains the cells of C."""
        self.model, self.group, self.grid = model, group, group.grid
        self.marked, self.c = marked, c
        self._require_resting_case()
        self.commands, read = self._ranges_of_commands()
        self.ways = [k for k, state in enumerate(group.states) if state not in read]
        self.moving = [k for k in range(len(group.states)) if k not in self.ways]
        if not self.ways:
            raise NotRecheckedError("P2a: K has cells at rest, and no state that nothing reads")
        self.box = [self._interval_of_b(k) for k in self.moving]
        self.rates = {
            signs: self._rate_ranges(signs)
            for signs in product((-1, 0, 1), repeat=len(self.moving))
        }
        self._require_nearing_zero()
        self.far = [[self._growth_factors(way, sign) for sign in (-1, 1)] for way in self.ways]
        self.beyond = [[self._is_safe_beyond(way, sign) for sign in (-1, 1)] for way in self.ways]

    def _require_resting_case(self) -> None:
        facts = self.model.facts
        symbol = facts.symbol
        others = facts.view or facts.reads_any_mode or facts.module.law
        alone = len(self.group.states) == len(facts.states)
        asked = symbol.shield is not None or symbol.verify.enters is not None
        if (
            facts.kind != "flow"
            or not facts.is_computed
            or others
            or facts.open_ends
            or asked
            or not alone
            or has_linear_rates(self.model, self.group.states)
        ):
            raise NotRecheckedError("P2a: K has cells at rest where their meaning is not settled")

    # ------------------------------------------------------------ terms

    def _new_terms(self, ranges: Mapping[int, Interval]) -> tuple[TermsBesideZero, list[Linear]]:
        terms = TermsBesideZero()
        whole = -FARTHEST, FARTHEST
        names = [s.name for s in self.model.facts.states]
        states = [
            terms.add_input("state", name, *ranges.get(i, whole)) for i, name in enumerate(names)
        ]
        return terms, states

    def _ranges_of_commands(self) -> tuple[list[Interval], set[int]]:
        """The range of each SC command over all states, and the states that SC or a rate reads.

        Reads are found with states anywhere, so that no branch is left out.
        """
        model = self.model
        terms, states = self._new_terms({})
        rates, _ = model.rates(terms, states, new_command_terms(model.facts, terms))
        found = input_atoms(terms, [*rates, *model.sc_commands(terms, states), *terms.obligations])
        read = {i for i, x in enumerate(states) if x.atom in found}
        near, states = model.new_terms()
        answers = model.sc_commands(near, states)
        if not all_certain(near, near.obligations):
            raise NotRecheckedError("P2a: SC does not certainly answer within its sets")
        bounds = zip(answers, model.facts.controls, strict=True)
        return [(u.low.max(exact(c.low)), u.high.min(exact(c.high))) for u, c in bounds], read

    def _interval_of_b(self, axis: int) -> Interval:
        """The interval of B on an axis: the smallest that contains 0 and all marked cells."""
        others = tuple(k for k in range(self.marked.ndim) if k != axis)
        places = np.flatnonzero(self.marked.any(axis=others))
        edges = self.grid.edges[axis]
        low, high = edges[int(places[0])], edges[int(places[-1]) + 1]
        return exact(min(low, 0.0)), exact(max(high, 0.0))

    def _rate_ranges(self, signs: Signs) -> list[Interval]:
        """The ranges of all rates at states in or just beyond B that have these signs.

        For a state that is 0, both sides count as well, since a run may go back and forth there.
        """
        found = self._rate_ranges_with_signs(signs, signs)
        for at in product(*((s,) if s else (-1, 1) for s in signs)):
            if at != signs:
                more = self._rate_ranges_with_signs(signs, at)
                found = [(a.min(c), b.max(d)) for (a, b), (c, d) in zip(found, more, strict=True)]
        return found

    def _rate_ranges_with_signs(self, signs: Signs, compared: Signs) -> list[Interval]:
        """The ranges of rates at states with `signs`; comparisons use the signs in `compared`."""
        ranges = {}
        for axis, (low, high), sign in zip(self.moving, self.box, signs, strict=True):
            hair = (high - low) * HAIR
            ends = {-1: (low - hair, ZERO), 0: (ZERO, ZERO), 1: (ZERO, high + hair)}
            ranges[self.group.states[axis]] = ends[sign]
        terms, states = self._new_terms(ranges)
        for axis, sign in zip(self.moving, compared, strict=True):
            terms.excluded[states[self.group.states[axis]].atom] = sign
        controls = [
            terms.add_input("box", c.name, low, high)
            for c, (low, high) in zip(self.model.facts.controls, self.commands, strict=True)
        ]
        rates, _ = self.model.rates(terms, states, controls)
        if not all_certain(terms, terms.obligations):
            raise NotRecheckedError("P2a: a plant's equation is not defined everywhere at rest")
        return [(rates[i].low, rates[i].high) for i in self.group.states]

    # ------------------------------------------------------------ B, and how far ways get

    def _require_nearing_zero(self) -> None:
        """Raises NotRecheckedError if a state of B may move away from 0."""
        for signs, rates in self.rates.items():
            for axis, sign in zip(self.moving, signs, strict=True):
                low, high = rates[axis]
                if (sign > 0 and not high <= 0) or (sign < 0 and not low >= 0):
                    name = self.model.facts.states[self.group.states[axis]].name
                    raise NotRecheckedError(f"P2a: SC does not certainly bring {name} nearer to 0")

    def _growth_factors(self, way: int, sign: int) -> list[tuple[int, arb, arb]]:
        """(y, c below 0, c above 0) for each state y for which c |y| limits the growth of `way`."""
        found = []
        for k, axis in enumerate(self.moving):
            c = {-1: ZERO, 1: ZERO}
            for signs, rates in self.rates.items():
                low, high = rates[way]
                grows = high if sign > 0 else -low
                if grows <= 0:
                    continue
                least, most = rates[axis]
                nears = -most if signs[k] > 0 else least
                if not (signs[k] and nears > 0):
                    break
                c[signs[k]] = c[signs[k]].max(grows / nears)
            else:
                found.append((axis, c[-1], c[1]))
        return found

    def _is_safe_beyond(self, way: int, sign: int) -> bool:
        """Whether all states beyond an end of a way are in C, for any values of other ways."""
        facts = self.model.facts
        if has_no_ends(self.grid, way):
            return True  # its outer cells are in C with all that lies beyond
        at = {self.group.states[k]: r for k, r in zip(self.moving, self.box, strict=True)}
        for part in intervals_beyond(self.grid.edges[way], low=sign < 0, high=sign > 0):
            terms, states = self._new_terms({**at, self.group.states[way]: part})
            held = [self.model.truth_of(terms, states, facts.symbol.safe, errors=False)]
            held += [self.model.topic_in_set(terms, states, t) for t in bounded_topics(facts)]
            if not all_certain(terms, [*held, *terms.obligations]):
                return False
        return True

    # ------------------------------------------------------------ cells

    def cells_unshown(self, block: Block) -> Iterator[Block]:
        """The marked cells of a block from which a run may leave C."""
        marked = self.marked[tuple(slice(a, b) for a, b in block)]
        for place in np.argwhere(marked):
            cell = tuple(
                (a + int(k), a + int(k) + 1) for (a, _), k in zip(block, place, strict=True)
            )
            box = self._reached_ranges(cell)
            if box is None or not self.c.contains(box):
                yield cell

    def _reached_ranges(self, cell: Block) -> list[float] | None:
        """The ranges that a run from a cell reaches in the grid; None if it may leave unsafely."""
        ends = self.grid.box_of(cell)
        reached: list[float] = []
        for k, edges in enumerate(self.grid.edges):
            low, high = ends[k]
            if k in self.moving:
                reached += [lower(low.min(ZERO)), upper(high.max(ZERO))]
                continue
            at = self.ways.index(k)
            for sign, start in ((-1, low), (1, high)):
                end = start + sign * self._greatest_growth(at, sign, ends)
                last = exact(edges[0] if sign < 0 else edges[-1])
                if not sign * (last - end) >= 0:
                    if not self.beyond[at][sign > 0]:
                        return None
                    end = last
                reached.append(lower(end) if sign < 0 else upper(end))
        return reached

    def _greatest_growth(self, at: int, sign: int, ends: Sequence[Interval]) -> arb:
        """How far, at most, way number `at` leads from a box in the direction of `sign`."""
        most = exact(np.inf)
        for axis, under, over in self.far[at][sign > 0]:
            low, high = ends[axis]
            most = most.min((under * -low).max(over * high).max(ZERO))
        return most


def resting_cells_unshown(
    model: CaseModel, group: Axes, marked: NDArray[np.bool_], c: Cells
) -> partial[Iterator[Block]]:
    """A function from a block to its `marked` cells (shaped as the grid) that remain unshown.

    Raises RejectedError if a marked cell is not in `c`, NotRecheckedError as `Resting` does.
    """
    if not (marked <= c.members).all():
        raise RejectedError("K has cells at rest on which `safe` is not certain")
    return partial(Resting.cells_unshown, Resting(model, group, marked, c))
