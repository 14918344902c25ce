"""Computed predicates: the sets S_0, S_1, ... on estimates (docs/verification.md, section 3).

Purpose: for a module without `ttf` and `safer`: ttf := estimate not in S_0, safer := S_(m-2), of
every case; and what of that the DM holds for all of them, to which P2b returns. How many levels
there are where the program leaves it open: one answer for proofs and for whatever flies.
Non-goals: the sets of a group (`verify/grid/levels.py`, `verify/polytope/`), reading them from
tables (`verify/tables/`), putting them into a program (`missing_predicates.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.language.model.system import LEVELS_DEFAULT, LEVELS_LEAST
from soter.verify.proof_methods import pairs_of, tables

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.verify.claims.case import Case
    from soter.verify.problem.problem import Problem

    Attempt = Callable[[Problem], list[Case] | None]

OF_LEVELS = ("ttf", "safer", "P2b")
"""Claims that the number of levels enters."""


@dataclass(frozen=True)
class ChosenLevels:
    """A problem with its number of levels, and what was found with it.

    `done`: every case; None where there is no K. `why`: what is not shown with `LEVELS_DEFAULT`
    levels, where the program leaves the number open and fewer were chosen; else "".
    """

    problem: Problem
    done: list[Case] | None
    why: str = ""

    @property
    def notes(self) -> list[str]:
        """A line, where fewer were chosen."""
        said = f"levels {self.problem.levels}: with {LEVELS_DEFAULT}, as by default, {self.why}"
        return [said] if self.why else []


def with_levels(problem: Problem, attempt: Attempt) -> ChosenLevels:
    """As many levels as the program says; where it leaves that open, the default or the fewest.

    The fewest where what is shown with them is more, claim by claim: no CPU time decides. What
    `attempt` gives has all failures of `OF_LEVELS`, and those of P2a: without it nothing is chosen.
    """
    if problem.levels_open and problem.levels != LEVELS_DEFAULT:
        problem = replace(problem, levels=LEVELS_DEFAULT)
    done = attempt(problem)
    lost = _unshown(done)
    if problem.levels_open and lost and "P2a" not in lost:
        fewest = replace(problem, levels=LEVELS_LEAST)
        again = attempt(fewest)
        if again is not None and _unshown(again).keys() < lost.keys():
            return ChosenLevels(fewest, again, next(lost[c] for c in OF_LEVELS if c in lost))
    return ChosenLevels(problem, done)


def _unshown(done: Sequence[Case] | None) -> dict[str, str]:
    """Claim -> what fails first of it: those of levels, and P2a."""
    failures = [f for case in done or () for f in case.failures]
    return {f.claim: f.text for f in reversed(failures) if f.claim in (*OF_LEVELS, "P2a")}


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
