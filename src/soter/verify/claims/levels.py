"""Computed predicates: the sets S_0, S_1, ... on estimates (docs/verification.md, section 3).

Purpose: for a module without `ttf` and `safer`: ttf := estimate not in S_0, safer := S_(m-2), of
every case; and what of that the DM holds for all of them, to which P2b returns.
Non-goals: how many levels there are (`choice.py`), the sets of a group (`verify/grid/levels.py`,
`verify/polytope/`), reading them from tables (`verify/tables/`), putting them into a program
(`missing_predicates.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.verify.proof_methods import pairs_of, tables

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.claims.case import Case

OF_LEVELS = ("ttf", "safer", "P2b")
"""Claims that the number of levels enters."""


def levels(case: Case) -> None:
    """S_0 ... S_(m-2) of every group; failures of `ttf` and `safer` where they are empty."""
    for proof in case.fresh:
        proof.levels(case)


def deploy(cases: Sequence[Case]) -> None:
    """What the DM holds, of all cases together; before P2b, which needs control to come back.

    The DM has one table for all values of the parameters: an estimate lets AC have control only
    where S_0 of every case holds it. Where a case has no sets there is no table.
    """
    problem = cases[0].problem
    pairs = [pairs_of(case.sets) for case in cases]
    if any(len(p) != len(problem.groups) for p in pairs) or any(withheld(c) for c in cases):
        return
    level_tables = tables(problem, pairs)
    for case in cases:
        for proof, table in zip(case.proofs, level_tables, strict=True):
            proof.admit(case, table)


def withheld(case: Case) -> bool:
    """Whether some group has levels that were not proved: they are not put into a DM."""
    return any(p.withheld(case) for p in case.proofs)
