"""What the fail-safe law keeps, as the claims of a module take it.

Purpose: `FailsafeClaim`: the parts of C inside K_fs, the core of the module with its law in the
place of SC; SC is then asked to keep these instead of C, so that the law may take over at any time
(docs/proof.md, "When the trusted part stops").
Non-goals: computing K_fs (`claims.py`), its problem (`verify/problem/failsafe_problem.py`), the
lease.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.verify.claims.product_sets import CellsPart

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.claims.product_sets import SetFactor
    from soter.verify.claims.results import CaseSets
    from soter.verify.problem.problem import Problem

NO_LAW = "no fail-safe law is declared: nothing is said of what acts once the trusted part stops"


NOT_FOR_LAWS = (
    "a law is looked at where plants flow (`der`), nobody else moves them, and no node stands "
    "between the module and its actuators"
)
OTHER_CELLS = "a law is not looked at on a"
NOTHING_KEPT = "no set was found that the law keeps"
VAIN = 0.001
"""Of C: with more cells that stay in it and never come back to the set it is given up as empty.

A law that drifts leaves nothing, one layer of cells a round, and each is followed to the end: a
hundred times the work of SC's own set, for an answer that is known after the first layers. Of every
law that keeps something, in the examples and the tests, there was not one such cell.
"""
NOTHING_INSIDE = "SC keeps nothing inside what the law keeps"


def hint_of(why: str) -> str:
    """What would help where the law is looked at and not shown; `why`: of a `FailsafeClaim`."""
    if why.startswith(OTHER_CELLS):
        return "a `grid` for what the law moves"
    if why == NOTHING_INSIDE:
        return "an SC that stays where the law can take over; a finer grid"
    return (
        "a law under which the plant comes to rest, exactly, and stays (`x' = u`, 0.0): a constant "
        "that brakes a speed reverses it in the end; a finer grid"
    )


@dataclass(eq=False)
class FailsafeClaim:
    """`parts`: C_g inside K_fs, or C_g itself; `why`: why it is C_g itself, "" where it is not.

    `cells`: of K_fs, and of C, of all groups together.
    """

    parts: Sequence[SetFactor]
    whole: Sequence[SetFactor]
    why: str = ""
    cells: tuple[int, int] = (0, 0)
    law: CaseSets | None = None
    """The sets of the law, where it is not."""

    @property
    def narrows(self) -> bool:
        """Whether SC is asked for more than `safe`."""
        return self.parts is not self.whole

    def give_up(self, why: str) -> None:
        """SC is asked for `safe` alone."""
        self.parts, self.why = self.whole, why


def without_law(problem: Problem, parts: Sequence[SetFactor]) -> FailsafeClaim | None:
    """The answer where there is nothing to compute; None: there is a law to be looked at."""
    if problem.law is not None:
        return None
    return FailsafeClaim(parts, parts, problem.law_unread or NO_LAW)


def inside(law: CaseSets, parts: Sequence[SetFactor]) -> FailsafeClaim:
    """C_g inside K_fs, from the sets of the law, on the same cells."""
    core_parts: list[SetFactor] = []
    kept = of = 0
    for proof, part in zip(law.proofs, parts, strict=True):
        core = getattr(proof.found, "core", None)
        if not isinstance(part, CellsPart) or core is None or core.shape != part.cells.shape:
            return FailsafeClaim(parts, parts, f"{OTHER_CELLS} {proof.group.representation}")
        core_parts.append(CellsPart(part.engine, part.cells & (core > 0)))
        kept, of = kept + int((core > 0).sum()), of + int(part.cells.sum())
    return FailsafeClaim(core_parts, parts, "", (kept, of), law)
