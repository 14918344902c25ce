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
    cell_count,
    cells_uncovered,
    halves_of_block,
    holds_in_parts,
)
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.linear_enclosures import ZERO, exact
from soter.certificate.terms.terms import (
    FALSE,
    TRUE,
    Linear,
    Proposition,
    Terms,
    and_of,
    atoms_under,
    conjuncts,
    input_atoms,
    negation,
    or_of,
    subpropositions,
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
    """For each group, the cells on which its share of a predicate certainly holds.

    The predicate holds on the product of these sets. Each conjunct belongs to the group on which it
    depends most (any choice is sound); all other states range over their whole grids. With `errors`
    it holds for every estimate of every state.
    """
    terms, states = model.new_terms(ENDLESS)
    truth = model.truth_of(terms, states, expr, errors=errors)
    return _cells_by_share(model, groups, terms, states, truth)


def cells_published_in_set(model: CaseModel, groups: Sequence[Axes], topic: int) -> list[Cells]:
    """For each group, the cells where the plants' values of a topic lie in its declared set.

    This holds for every estimate, because the plant stops outside of this set.
    """
    terms, states = model.new_terms(ENDLESS)
    return _cells_by_share(model, groups, terms, states, model.topic_in_set(terms, states, topic))


def _cells_by_share(
    model: CaseModel,
    groups: Sequence[Axes],
    terms: Terms,
    states: Sequence[Linear],
    truth: Proposition,
) -> list[Cells]:
    """For each group, the cells on which its share of a proposition certainly holds."""
    shares: list[list[Proposition]] = [[] for _ in groups]
    atoms = [x.atom for x in states]
    for part in [*conjuncts(truth), *terms.obligations]:
        weights = [influence_of_inputs(terms, part, [atoms[i] for i in g.states]) for g in groups]
        owner = max(range(len(groups)), key=lambda k: float(weights[k]))
        shares[owner].append(part)
    return [
        cells_where_certain(
            TruthOverBox(model, g.states, terms, atoms, conjunction_of(share)), g.grid
        )
        for g, share in zip(groups, shares, strict=True)
    ]


def influence_of_inputs(terms: Terms, root: Proposition, inputs: Sequence[int]) -> arb:
    """An estimate (no bound) of how far inputs move the numbers that a proposition compares."""
    moved: dict[int, arb] = {}

    def width(x: Linear) -> arb:
        return sum((abs(f) * moved.get(a, ZERO) for a, f in x.terms.items()), ZERO)

    for index in sorted(atoms_under(terms, [root])):
        atom = terms.atoms[index]
        if atom.arguments:
            moved[index] = sum((width(x) for x in atom.arguments), ZERO)
        elif index in inputs:
            moved[index] = atom.high - atom.low

    return sum((width(p.argument) for p in subpropositions(root) if p.argument is not None), ZERO)


def conjunction_of(parts: Sequence[Proposition]) -> Proposition:
    """The conjunction of some propositions."""
    joined = TRUE
    for p in parts:
        joined = and_of(joined, p)
    return joined


class TruthOverBox:
    """Evaluates a proposition on boxes of some states; other states range over their grids.

    Errors and other topics that it reads are further axes of a box, with `ranges`, so that they are
    halved with the cell. `reads`: for each state, whether the proposition depends on it.
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
        read = input_atoms(terms, [truth])
        free = sorted(i for i in read if terms.atoms[i].kind == "box")
        self.ranges = [(terms.atoms[i].low, terms.atoms[i].high) for i in free]
        self.reads = tuple(a in read for a in places)
        self._written = compile_truths(terms, [*places, *free], [truth], boxes)

    def bits_on_box(self, box: list[tuple[arb, arb]]) -> int:
        """The bits of the proposition on a box: 1 if it may fail, 2 if it may hold."""
        bits: int = self._written(form_of_box(box, symbols=False))[0]
        return bits

    def bits_on_block(self, grid: Grid, block: Block) -> int:
        """The bits of the proposition on a block of cells, and beyond axes without ends."""
        boxes = grid.boxes_covering(block, self.reads)
        return reduce(or_, (self.bits_on_box([*box, *self.ranges]) for box in boxes))

    def holds_on_box(self, box: list[tuple[arb, arb]], splits: int) -> bool:
        """Whether the proposition certainly holds on a box, halved up to `splits` times."""
        return holds_in_parts(
            [*box, *self.ranges], lambda part: self.bits_on_box(part) == HOLDS, splits
        )

    def holds_on_block(self, grid: Grid, block: Block, splits: int) -> bool:
        """Whether it certainly holds on a block of cells, and beyond axes without ends."""
        return all(self.holds_on_box(box, splits) for box in grid.boxes_covering(block, self.reads))


def cells_where_certain(decision: TruthOverBox, grid: Grid) -> Cells:
    """The cells on which the proposition certainly holds."""
    members = np.zeros(grid.shape, dtype=np.bool_)
    waiting = [grid.all_cells]
    while waiting:
        block = waiting.pop()
        bits = decision.bits_on_block(grid, block)
        if bits == NEITHER and cell_count(block) > 1:
            waiting.extend(halves_of_block(block))
        elif bits == HOLDS or (
            bits == NEITHER and decision.holds_on_block(grid, block, SPLITS_OF_SETS)
        ):
            members[block_index(block)] = True
    return Cells(grid, members)


class AdmitCheck:
    """The proposition that a predicate denies AC control, prepared for blocks of cells.

    It holds if `safe` fails, or if no estimate of the state makes the predicate grant control: by
    being true (`admits`), or false. With `anywhere` a failing `safe` does not count.
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
            safe = model.truth_of(terms, states, model.facts.symbol.safe, errors=False)
            fails = and_of(negation(safe), conjunction_of(terms.obligations))
            terms.obligations.clear()
        truth = model.truth_of(terms, states, expr, errors=True)
        sound_told = conjunction_of(terms.obligations)
        refused = negation(truth) if admits else truth
        fine = or_of(fails, and_of(refused, sound_told))
        atoms = [x.atom for x in states]
        self.decision = TruthOverBox(model, group.states, terms, atoms, fine)


def cells_wrongly_admitted(
    check: AdmitCheck, free: NDArray[np.bool_], block: Block
) -> Iterator[Block]:
    """Yields cells outside R where `safe` may hold and the predicate may give AC control.

    `free`: the cells of R, shaped as the grid.
    """
    grid = check.group.grid

    def attempt(at: Block) -> bool:
        splits = SPLITS_OF_PREDICATES if cell_count(at) == 1 else 0
        return check.decision.holds_on_block(grid, at, splits)

    return cells_uncovered(~free, block, attempt, cell_count(grid.all_cells))
