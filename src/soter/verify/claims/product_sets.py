"""Sets that are products over groups, and the check that a predicate holds on such a product.

Purpose: a `CellsPart` is one group's part of a set. `product_holds` checks that a predicate is true
all over the product of such parts (docs/verification.md, Groups). `why_sc_leaves_sets` checks that
SC neither faults there nor publishes outside its sets. `FailsafeClaim` cuts C to K_fs, the core of
the module with its fail-safe law in the place of SC. SC then has to keep K_fs instead of C, so that
the law may take over at any time (docs/proof.md, "When the trusted part stops").
Non-goals: dynamics; computing K_fs (`claims.py`), its problem
(`verify/problem/verification_system.py`), the lease.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.core.layout import Bools, Floats
    from soter.verify.claims.results import CaseSets
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.grid.sets import GridGroup
    from soter.verify.problem.problem import Problem

    Ranges = Mapping[int, tuple[float, float]]


Block: TypeAlias = list[slice]
SPLITS_MAX = 20_000
"""The most boxes that a check of a product examines; `LAW_SPLITS_MAX`: that of SC."""
LAW_SPLITS_MAX = 4_000


def states_elsewhere(
    problem: Problem, group: GridGroup, point: Floats
) -> dict[int, tuple[float, float]]:
    """The ranges that fix all states of other groups at `point`, (states,), by state number."""
    axes = set(group.axes)
    return {
        s: (float(point[s]), float(point[s])) for s in range(len(problem.states)) if s not in axes
    }


def points_to_try(problem: Problem) -> list[Floats]:
    """Points, (states,), where a predicate may hold: the start, zero, the middle of ranges."""
    low = np.array([r.low for r in problem.states])
    high = np.array([r.high for r in problem.states])
    start = np.array([i.low / 2 + i.high / 2 for i in problem.initial])
    return [np.clip(p, low, high) for p in (start, np.zeros_like(low), low / 2 + high / 2)]


@dataclass(frozen=True, eq=False)
class CellsPart:
    """A set of cells of one group's grid, as a factor of a product.

    A block is a list of slices of cells, with one slice for each axis.
    """

    engine: GridGroup
    cells: Bools

    def smallest_block(self, block: Block | None = None) -> Block | None:
        """The smallest block around the cells of the set inside `block`; None without cells."""
        whole = [slice(0, n) for n in self.cells.shape] if block is None else block
        return _smallest_block(self.cells, whole)

    def ranges_of_block(self, block: Block) -> Ranges:
        """The range of a block along each axis, by state number."""
        every = zip(self.engine.axes, self.engine.spans, block, strict=True)
        return {
            state: (float(edges[part.start]), float(edges[part.stop]))
            for state, edges, part in every
        }

    def first_cell(self, block: Block) -> Block:
        """The first cell, in C order, of the set's cells inside a block."""
        at = np.argwhere(self.cells[tuple(block)])[0]
        return [
            slice(p.start + int(i), p.start + int(i) + 1) for p, i in zip(block, at, strict=True)
        ]

    def holds_alone(self, predicate: str) -> bool:
        """Whether a predicate holds on every cell of the set for all values of other states."""
        return bool((self.engine.cells_true(predicate) | ~self.cells).all())


def product_holds(forms: CompiledEnclosures, parts: Sequence[CellsPart], predicate: str) -> bool:
    """Whether a predicate is shown to be true everywhere on the product of the parts.

    It is evaluated on the product of the sets' blocks. If it is undecided there, a block is split
    along its longest axis. That block is of a group that decides the predicate at a single cell, or
    else it is the longest block.
    """
    if len(parts) == 1 and parts[0].holds_alone(predicate):
        return True
    conjuncts = forms.conjunct_names(predicate)
    return all(_holds_on_product(forms, parts, part) for part in conjuncts or [predicate])


def _holds_on_product(
    forms: CompiledEnclosures, parts: Sequence[CellsPart], predicate: str
) -> bool:
    """Whether one conjunct is true all over the product: splits blocks until it is on each."""
    todo = [tuple(p.smallest_block() for p in parts)]
    looked = 0
    while todo:
        hulls = todo.pop()
        blocks = [b for b in hulls if b is not None]
        if len(blocks) < len(hulls):
            continue  # the product has no cells here
        looked += 1
        if looked > SPLITS_MAX:
            return False
        if forms.is_surely_true(predicate, _box_of_blocks(forms, parts, blocks)):
            continue
        split = _split_longest_block(forms, parts, blocks, predicate)
        if split is None:
            return False
        todo += split
    return True


def _smallest_block(cells: Bools, block: Block) -> Block | None:
    """The smallest block around the cells inside `block`; None if it has no cells."""
    inside = cells[tuple(block)]
    if not inside.any():
        return None
    slices = []
    for axis, part in enumerate(block):
        others = tuple(k for k in range(cells.ndim) if k != axis)
        at = np.flatnonzero(inside.any(axis=others))
        slices.append(slice(part.start + int(at[0]), part.start + int(at[-1]) + 1))
    return slices


def _box_of_blocks(
    forms: CompiledEnclosures, parts: Sequence[CellsPart], blocks: Sequence[Block]
) -> Floats:
    box = np.array(forms.whole)
    for part, block in zip(parts, blocks, strict=True):
        for state, ends in part.ranges_of_block(block).items():
            box[state] = ends
    return box


def _longest_side(block: Block) -> int:
    """The number of cells of a block along its longest side."""
    return max((p.stop - p.start for p in block), default=1)


def _split_longest_block(
    forms: CompiledEnclosures, parts: Sequence[CellsPart], blocks: Sequence[Block], predicate: str
) -> list[tuple[Block | None, ...]] | None:
    """The two products after a split; None if all blocks are single cells."""
    best: int | None = None
    for g, block in enumerate(blocks):
        if _longest_side(block) == 1:
            continue
        # with this group at one cell of its set the predicate may be decided: then split it
        alone = list(blocks)
        alone[g] = parts[g].first_cell(block)
        if forms.is_surely_true(predicate, _box_of_blocks(forms, parts, alone)):
            best = g
            break
        if best is None or _longest_side(block) > _longest_side(blocks[best]):
            best = g
    if best is None:
        return None
    sizes = [p.stop - p.start for p in blocks[best]]
    axis = int(np.argmax(sizes))
    part = blocks[best][axis]
    middle = (part.start + part.stop) // 2
    products: list[tuple[Block | None, ...]] = []
    for half in (slice(part.start, middle), slice(middle, part.stop)):
        block = list(blocks[best])
        block[axis] = half
        halves: list[Block | None] = list(blocks)
        halves[best] = parts[best].smallest_block(block)
        products.append(tuple(halves))
    return products


def why_sc_leaves_sets_on_product(
    problem: Problem, forms: CompiledEnclosures, parts: Sequence[CellsPart]
) -> str:
    """Why SC might publish outside its sets, or fault, on the hull of the sets; "" if it cannot.

    SC steps at any time, in control or not, so all of C is examined, with every error.
    """
    hulls = [p.smallest_block() for p in parts]
    blocks = [b for b in hulls if b is not None]
    if len(blocks) < len(hulls):
        return ""
    return why_sc_leaves_sets(problem, forms, _box_of_blocks(forms, parts, blocks))


def why_sc_leaves_sets(problem: Problem, forms: CompiledEnclosures, box: Floats) -> str:
    """Says why SC might fault or leave its sets on a box (inputs, 2); "" if it cannot."""
    count = len(problem.controls)
    limits = np.array([(c.low, c.high) for c in problem.controls])
    moving = [i for i in range(len(box)) if box[i, 0] < box[i, 1]]
    todo = [box]
    looked = 0
    while todo:
        part = todo.pop()
        answer = forms.result_bounds("law", part, count)
        if (
            answer is not None
            and np.all(answer[:, 0] >= limits[:, 0])
            and np.all(answer[:, 1] <= limits[:, 1])
        ):
            continue
        looked += 1
        if looked > LAW_SPLITS_MAX:
            if answer is None:
                return "SC might fault, or publish outside its set"
            outside = np.flatnonzero((answer[:, 0] < limits[:, 0]) | (answer[:, 1] > limits[:, 1]))
            name = problem.quantities.controls[int(outside[0])].name
            return f"SC could publish {name} outside its set"
        widths = [(part[i, 1] - part[i, 0]) / (box[i, 1] - box[i, 0]) for i in moving]
        i = moving[int(np.argmax(widths))]
        middle = part[i, 0] / 2 + part[i, 1] / 2
        for low, high in ((part[i, 0], middle), (middle, part[i, 1])):
            half = part.copy()
            half[i] = low, high
            todo.append(half)
    return ""


NO_LAW = "no fail-safe law is declared: nothing is said of what acts once the trusted part stops"


NOT_FOR_LAWS = (
    "a law is looked at where plants flow (`der`), nobody else moves them, and no node stands "
    "between the module and its actuators"
)
NOTHING_KEPT = "no set was found that the law keeps"
VAIN = 0.001
"""K_fs is given up where more than this share of the cells of C stays in C but does not come back.

A law that drifts loses one layer of cells in each round until none is left, and each cell is
followed to the end: a hundred times the work for the set of SC. No law that keeps a set, in the
examples and tests, had one such cell."""
NOTHING_INSIDE = "SC keeps nothing inside what the law keeps"


def hint_for_law(why: str) -> str:
    """Advice for a fail-safe law whose claim is not shown for the reason `why`."""
    if why == NOTHING_INSIDE:
        return "an SC that stays where the law can take over; a finer grid"
    return (
        "a law under which the plant comes to rest, exactly, and stays (`x' = u`, 0.0): a constant "
        "that brakes a speed reverses it in the end; a finer grid"
    )


@dataclass(eq=False)
class FailsafeClaim:
    """The set C cut to K_fs, by group (`parts`), or all of C (`whole`) if `why` gives a reason.

    `cells`: the number of cells of K_fs and that of C, each summed over all groups.
    """

    parts: Sequence[CellsPart]
    whole: Sequence[CellsPart]
    why: str = ""
    cells: tuple[int, int] = (0, 0)
    law: CaseSets | None = None
    """The sets of the law, if C is cut to K_fs."""

    @property
    def is_smaller(self) -> bool:
        """Whether SC has to keep a smaller set than C."""
        return self.parts is not self.whole

    def drop_law(self, why: str) -> None:
        """Lets SC keep all of C again, because the law is not shown for the reason `why`."""
        self.parts, self.why = self.whole, why


def claim_without_law(problem: Problem, parts: Sequence[CellsPart]) -> FailsafeClaim | None:
    """The claim of a module without a law to examine; None if the module has a law."""
    if problem.law is not None:
        return None
    return FailsafeClaim(parts, parts, problem.law_unread or NO_LAW)


def cut_to_law_core(law: CaseSets, parts: Sequence[CellsPart]) -> FailsafeClaim:
    """The claim with C cut to K_fs; `law` has the sets of the law, on the same cells as `parts`."""
    core_parts: list[CellsPart] = []
    kept = of = 0
    for proof, part in zip(law.proofs, parts, strict=True):
        core = proof.found.core
        core_parts.append(CellsPart(part.engine, part.cells & (core > 0)))
        kept, of = kept + int((core > 0).sum()), of + int(part.cells.sum())
    return FailsafeClaim(core_parts, parts, "", (kept, of), law)
