"""Which cells and how many levels a module has where its program leaves that open.

Purpose: `choose`: one answer for proofs and for whatever flies.
Non-goals: the levels (`levels.py`), grids finer at borders alone (`grid_refinement.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.language.model.system import LEVELS_DEFAULT, LEVELS_LEAST
from soter.verify.claims.case import ClaimTimer
from soter.verify.claims.grid_refinement import cells_of, counts_of, smaller_cells
from soter.verify.claims.levels import OF_LEVELS, levels
from soter.verify.claims.smaller_core import returned

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.verify.claims.case import Case
    from soter.verify.problem.problem import Group, Problem

    Attempt = Callable[[Problem], list[Case] | None]

CELLS_MAX = {"P2a": 400_000, "P2b": 100_000}
"""More cells of all groups together are not chosen, where this claim fails on the declared ones."""
FAILED = {"P2a": "K is empty", "P2b": "P2b is not shown"}
SIZES = ("half", "a quarter of")
"""Of the declared cells, along each axis, tried one after the other."""


@dataclass(frozen=True)
class Choice:
    """A problem with its cells and its number of levels, and what was found with it.

    `done`: every case; None where the dynamics have no enclosure. `why`: what is not shown with
    `LEVELS_DEFAULT` levels, where the program leaves the number open and fewer were chosen; else
    "". `size`: of the cells in words, where smaller ones than declared were chosen; else "".
    `failed`: of the claims in `FAILED` that for which they were. `tried`: where none were, what was
    tried, a line each.
    """

    problem: Problem
    done: list[Case] | None
    why: str = ""
    size: str = ""
    failed: str = "P2a"
    tried: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """A line where fewer levels were chosen, one a group whose cells are smaller."""
        levels = f"levels {self.problem.levels}: with {LEVELS_DEFAULT}, as by default, {self.why}"
        pairs = zip(self.problem.declared_groups, self.problem.groups, strict=False)
        counts = filter(None, (counts_of(a, b) for a, b in pairs))
        what = f"cells of {self.size} the size: on the declared ones {FAILED[self.failed]}"
        return [*(f"{what}: {text}" for text in counts), *([levels] if self.why else [])]


def choose(problem: Problem, attempt: Attempt) -> Choice:
    """On the declared cells; on smaller ones where that shows P2a of every group, or P2b as well.

    P2b has to be shown in full, for a computed `safer`: `_with_levels` gives the levels. Counts of
    cells decide, and no CPU time. What `attempt` gives has all failures of P2a.
    """
    first = _with_levels(problem, attempt)
    if not problem.cells_open:
        return first
    found, tried = _on_smaller_cells(first, "P2a", attempt)
    if found is first and not tried and problem.computed:
        found, tried = _on_smaller_cells(first, "P2b", attempt)
    return found if found is not first else replace(first, tried=tuple(tried))


def _on_smaller_cells(first: Choice, claim: str, attempt: Attempt) -> tuple[Choice, list[str]]:
    """On the largest cells on which nothing fails for which smaller ones are taken, else `first`.

    And what was tried in vain, in words.
    """
    found = first
    tried = []
    for size in SIZES:
        coarse = _failing(found, claim)
        if not coarse:
            break
        finer, most = smaller_cells(found.problem, coarse), CELLS_MAX[claim]
        if cells_of(finer) > most:
            tried.append(
                f"not: cells of {size} the size, as {cells_of(finer):,} are more than {most:,}"
            )
            break
        found = _with_levels(finer, attempt)
        lost = _unshown(found.done)
        if found.done is not None and not ({claim, "P2a"} & lost.keys()):
            return replace(found, size=size, failed=claim), []
        tried.append(f"in vain: cells of {size} the size")
    return first, tried


def _failing(choice: Choice, claim: str) -> list[Group]:
    """The grids of which a claim fails in some case."""
    failures = (f for case in choice.done or () for f in case.failed(claim))
    return [f.proof.group for f in failures if f.proof is not None and f.cells is not None]


def _with_levels(problem: Problem, attempt: Attempt) -> Choice:
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
        again = _with_other_levels(done or (), fewest) or attempt(fewest)
        if again is not None and _unshown(again).keys() < lost.keys():
            return Choice(fewest, again, next(lost[c] for c in OF_LEVELS if c in lost))
    return Choice(problem, done)


def _with_other_levels(done: Sequence[Case], problem: Problem) -> list[Case] | None:
    """Cases of grids with another number of levels, of which neither K nor R(H) knows."""
    again = []
    for case in done:
        renewed = [proof.without_levels() for proof in case.proofs]
        proofs = [proof for proof in renewed if proof is not None]
        if len(proofs) < len(case.proofs):
            return None
        by_old = dict(zip(map(id, case.proofs), proofs, strict=True))
        failures = [
            replace(f, proof=by_old.get(id(f.proof)))
            for f in case.failures
            if f.claim not in OF_LEVELS
        ]
        spent = {claim: s for claim, s in case.spent.items() if claim not in OF_LEVELS}
        new = replace(case, problem=problem, proofs=proofs, failures=failures)
        new.spent, new.counts = spent, dict(case.counts)
        with ClaimTimer(new, "ttf"):
            levels(new)
        again.append(new)
    return returned(again)


def _unshown(done: Sequence[Case] | None) -> dict[str, str]:
    """Claim -> what fails first of it: those of levels, and P2a."""
    failures = [f for case in done or () for f in case.failures]
    return {f.claim: f.text for f in reversed(failures) if f.claim in (*OF_LEVELS, "P2a")}
