"""Cells on which predicates certainly hold, by the re-checker's own evaluation.

Purpose: `certain_cells` finds cells on which `safe` or `safer` holds, `cells_published_in_set`
those on which what plants publish is in its set; `cells_wrongly_admitted` shows that `ttf` and
`safer` let AC only where R(H) is.
Non-goals: computed predicates (`extras/estimates_and_shield.py`), which claims there are
(`case_check.py`).
"""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING

import numpy as np
from flint import arb

from soter.certificate.cell_sets import (
    Cells,
    block_index,
    cells_uncovered,
    halves,
    holds_in_parts,
    volume,
)
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.linear_enclosures import ZERO, exact
from soter.certificate.terms.terms import (
    FALSE,
    TRUE,
    Linear,
    Proposition,
    Terms,
    atoms_under,
    both,
    conjuncts,
    either,
    inputs_of,
    negation,
    parts_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Axes, Block, Grid
    from soter.certificate.reading.case_model import CaseModel
    from soter.language.model import typed


HOLDS, NEITHER = 2, 3
"""The bits of an answer about a proposition on a box: it may fail (1), it may hold (2)."""
ENDLESS = arb("inf")
"""A bound for states whose axis has no ends: rounding is one of the size of what is rounded."""
SPLITS_OF_PREDICATES = 10
"""How often a cell is halved where a predicate is evaluated: errors are halved, too."""
SPLITS_OF_SETS = 4
"""How often it is halved where only cells to use are sought: a failure costs cells, no proof."""


def certain_cells(
    model: CaseModel, groups: Sequence[Axes], expr: typed.TypedExpr, *, errors: bool
) -> list[Cells]:
    """For each group the cells on which its share of a predicate certainly holds.

    The predicate holds on the product of these sets: each of its conjuncts is the matter of one
    group, all other states ranging over their whole grids, in which their C's lie. It is that of
    the group on which it depends most; any choice is sound, and only this one is useful. Where
    `errors`, on every estimate of every state.
    """
    terms, states = model.new_terms(ENDLESS)
    truth = model.predicate(terms, states, expr, errors=errors)
    return _cells_by_share(model, groups, terms, states, truth)


def cells_published_in_set(model: CaseModel, groups: Sequence[Axes], topic: int) -> list[Cells]:
    """For each group the cells on which what plants publish on a topic is in its declared set.

    That of every estimate: outside of its set the plant stops. Shared out as by `certain_cells`.
    """
    terms, states = model.new_terms(ENDLESS)
    return _cells_by_share(model, groups, terms, states, model.in_set(terms, states, topic))


def _cells_by_share(
    model: CaseModel,
    groups: Sequence[Axes],
    terms: Terms,
    states: Sequence[Linear],
    truth: Proposition,
) -> list[Cells]:
    """The cells of each group on which its share of a proposition certainly holds."""
    shares: list[list[Proposition]] = [[] for _ in groups]
    atoms = [x.atom for x in states]
    for part in [*conjuncts(truth), *terms.obligations]:
        weights = [influence(terms, part, [atoms[i] for i in g.states]) for g in groups]
        owner = max(range(len(groups)), key=lambda k: float(weights[k]))
        shares[owner].append(part)
    return [
        decided_cells(Decision(model, g.states, terms, atoms, conjunction_of(share)), g.grid)
        for g, share in zip(groups, shares, strict=True)
    ]


def influence(terms: Terms, root: Proposition, inputs: Sequence[int]) -> arb:
    """Roughly how much inputs move what is compared in a proposition; a guide, no bound."""
    moved: dict[int, arb] = {}

    def of(x: Linear) -> arb:
        return sum((abs(f) * moved.get(a, ZERO) for a, f in x.terms.items()), ZERO)

    for index in sorted(atoms_under(terms, [root])):
        atom = terms.atoms[index]
        if atom.arguments:
            moved[index] = sum((of(x) for x in atom.arguments), ZERO)
        elif index in inputs:
            moved[index] = atom.high - atom.low

    return sum((of(p.argument) for p in parts_of(root) if p.argument is not None), ZERO)


def conjunction_of(parts: Sequence[Proposition]) -> Proposition:
    """The proposition that all of them hold."""
    conjunction = TRUE
    for p in parts:
        conjunction = both(conjunction, p)
    return conjunction


class Decision:
    """The truth of a proposition on boxes of some states, other states on their grids.

    Errors and other topics count as states here, behind those that are asked for, so that they are
    halved with the cell. `ranges`: theirs; `reads`: of each state that is asked for whether
    the proposition depends on it.
    """

    def __init__(
        self,
        model: CaseModel,
        states: Sequence[int],
        terms: Terms,
        atoms: Sequence[int],
        truth: Proposition,
    ) -> None:
        places = [atoms[i] for i in states]
        grids = [(exact(low), exact(high)) for low, high in model.extents]
        boxes = dict(zip(atoms, grids, strict=True))
        read = inputs_of(terms, [truth])
        free = sorted(i for i in read if terms.atoms[i].kind == "box")
        self.ranges = [(terms.atoms[i].low, terms.atoms[i].high) for i in free]
        self.reads = tuple(a in read for a in places)
        self._written = compile_truths(terms, [*places, *free], [truth], boxes)

    def bits_on_box(self, box: list[tuple[arb, arb]]) -> int:
        """Its bits on a box: it may fail, it may hold."""
        bits: int = self._written(form_of_box(box, symbols=False))[0]
        return bits

    def bits_on_block(self, grid: Grid, block: Block) -> int:
        """Its bits on a block of cells, with all that lies beyond axes without ends."""
        boxes = grid.whole_boxes(block, self.reads)
        return reduce(or_, (self.bits_on_box([*box, *self.ranges]) for box in boxes))

    def holds_on_box(self, box: list[tuple[arb, arb]], splits: int) -> bool:
        """Whether it certainly does on a box of states; it and the errors are halved so often."""
        return holds_in_parts(
            [*box, *self.ranges], lambda part: self.bits_on_box(part) == HOLDS, splits
        )

    def holds_on_block(self, grid: Grid, block: Block, splits: int) -> bool:
        """Whether it certainly holds on a block, with all that lies beyond axes without ends."""
        return all(self.holds_on_box(box, splits) for box in grid.whole_boxes(block, self.reads))


def decided_cells(decision: Decision, grid: Grid) -> Cells:
    """The cells on which a decision certainly holds."""
    members = np.zeros(grid.shape, dtype=np.bool_)
    waiting = [grid.whole]
    while waiting:
        block = waiting.pop()
        bits = decision.bits_on_block(grid, block)
        if bits == NEITHER and volume(block) > 1:
            waiting.extend(halves(block))
        elif bits == HOLDS or (
            bits == NEITHER and decision.holds_on_block(grid, block, SPLITS_OF_SETS)
        ):
            members[block_index(block)] = True
    return Cells(grid, members)


class AdmitCheck:
    """Asks whether `safe` fails or `expr` is, on every estimate, not `admits`: AC has no control.

    With `anywhere` (as of `enters`) it does not help that `safe` may fail.
    """

    def __init__(
        self,
        model: CaseModel,
        group: Axes,
        expr: typed.TypedExpr,
        *,
        admits: bool,
        anywhere: bool = False,
    ) -> None:
        self.group = group
        terms, states = model.new_terms(ENDLESS)
        fails = FALSE
        if not anywhere:
            safe = model.predicate(terms, states, model.facts.symbol.safe, errors=False)
            fails = both(negation(safe), conjunction_of(terms.obligations))
            terms.obligations.clear()
        truth = model.predicate(terms, states, expr, errors=True)
        sound_told = conjunction_of(terms.obligations)
        refused = negation(truth) if admits else truth
        fine = either(fails, both(refused, sound_told))
        atoms = [x.atom for x in states]
        self.decision = Decision(model, group.states, terms, atoms, fine)


def cells_wrongly_admitted(
    check: AdmitCheck, free: NDArray[np.bool_], block: Block
) -> Iterator[Block]:
    """Cells outside R where `safe` may hold and, on an estimate, the predicate gives AC control.

    `free`: shaped as the grid.
    """
    grid = check.group.grid

    def attempt(at: Block) -> bool:
        splits = SPLITS_OF_PREDICATES if volume(at) == 1 else 0
        return check.decision.holds_on_block(grid, at, splits)

    return cells_uncovered(~free, block, attempt, volume(grid.whole))
