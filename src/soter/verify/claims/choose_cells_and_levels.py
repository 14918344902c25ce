"""The choice of what a program leaves open: smaller cells, fewer levels, fewer cells of K.

Purpose: `choose_cells_and_levels` tries the declared cells, then smaller ones, and the default
number of levels, then the fewest. Proofs and flights use the same choice. Two functions give up a
few cells of K from which no way back to `safer` was found: `shrink_core` where the program has
`ttf` and `safer`; `cases_with_way_back`, which computes all that follows from K anew, where these
predicates are computed. Symbols: head of `verify/grid/sets.py`.
Non-goals: what follows from K, and the levels (`claims.py`); cells that are split near borders
(`grid_refinement.py`); W (`verify/grid/recovery.py`); tables (`verify/deploy/`).

Computed predicates depend on K: with a smaller K fewer estimates leave AC in control, and Q may
lose cells, too. Proofs are about the sets of the last round, or else K stays as it was.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.language.model.system import LEVELS_DEFAULT, LEVELS_LEAST
from soter.verify.claims import start
from soter.verify.claims.claims import check_after_core, compute_levels, find_way_back, make_tables
from soter.verify.grid.case import ClaimTimer
from soter.verify.grid.grid_refinement import cell_count, cell_counts_in_words, finer_problem
from soter.verify.grid.group_model import UnboundedError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.verify.grid.case import Case, Failure
    from soter.verify.problem.problem import Group, Problem

    Attempt = Callable[[Problem], list[Case] | None]


OF_LEVELS = ("ttf", "safer", "P2b")
"""The claims that depend on the number of levels."""
SHRINK_MAX = 0.1
"""The largest share of K that may be given up because no way back from it was found."""
ROUNDS = 4
"""The most rounds in which cells are given up where predicates are computed."""
GIVEN_UP, HAD = "given_up", "had"
"""Names of a case's counts: cells that were removed from K, and cells that K had before."""


def shrink_core(case: Case) -> bool:
    """Replaces K by W if only a few cells of K lack a way back, and returns whether it did.

    At its border K has cells that SC keeps only by chains whose images need all of K. W serves as
    well: its cells have chains in C whose images lie in W, and SC keeps Q.
    """
    failures = case.failures_of("P2b")
    if case.problem.computed or not failures or not _has_few_stuck_cells(failures):
        return False
    _give_up_stuck_cells(case, failures)
    return True


def _has_few_stuck_cells(failures: list[Failure]) -> bool:
    """Whether all failures are about cells of K without a way back, and these cells are few."""
    return all(f.stuck and f.proof and f.proof.stuck_share <= SHRINK_MAX for f in failures)


def _give_up_stuck_cells(case: Case, failures: list[Failure]) -> None:
    stuck = [f.proof for f in failures if f.proof is not None]
    for proof in case.proofs:
        proof.fresh = proof in stuck
    for proof in stuck:
        had = proof.core_cells
        case.counts.setdefault(HAD, sum(p.core_cells for p in case.proofs))
        proof.restrict_core_to_way(case)
        case.counts[GIVEN_UP] = case.counts.get(GIVEN_UP, 0) + had - proof.core_cells
    case.failures = [f for f in case.failures if f.proof not in stuck and f.claim != "start"]


def cases_with_way_back(done: list[Case]) -> list[Case]:
    """The cases with P2b examined, where predicates are computed.

    If a few cells of K have no way back, they are given up and all that follows from K is computed
    anew. The new sets are kept if they show P2b and no other claim is lost.
    """
    _examine_way_back(done)
    if not any(case.failures_of("P2b") for case in done):
        return done
    before, started = [_CaseBackup(case) for case in done], [_is_start_shown(case) for case in done]
    shown = _is_shown_with_fewer_cells(done)
    if not (
        shown
        and all(_is_start_shown(case) for case, well in zip(done, started, strict=True) if well)
    ):
        for kept in before:
            kept.restore_case()
    return done


def _is_shown_with_fewer_cells(done: list[Case]) -> bool:
    """Gives up cells of K in rounds; returns whether all claims except the start are shown."""
    for _ in range(ROUNDS):
        if not all(map(_may_give_up, done)):
            break
        for case in done:
            if failures := case.failures_of("P2b"):
                _give_up_stuck_cells(case, failures)
                check_after_core(case)
        _examine_way_back(done)
        if not any(map(_unshown_failures, done)):
            return True
    return False


def _examine_way_back(done: list[Case]) -> None:
    make_tables(done)
    for case in done:
        if case.failures_of("P2b") or case.problem.stays:
            continue  # no K, no enclosure, or a module that may stay under SC
        try:
            with ClaimTimer(case, "P2b"):
                find_way_back(case)
        except UnboundedError as error:
            case.fail("P2b", str(error), hint=error.hint)


def _unshown_failures(case: Case) -> list[Failure]:
    """The failures of P2a, `ttf`, `safer` and P2b; the start is examined separately."""
    return [f for f in case.failures if f.claim in (*OF_LEVELS, "P2a")]


def _may_give_up(case: Case) -> bool:
    """Whether only P2b fails, and only on a few cells of K."""
    failures = _unshown_failures(case)
    return all(f.claim == "P2b" for f in failures) and _has_few_stuck_cells(failures)


def _is_start_shown(case: Case) -> bool:
    """Whether the claim `start` is shown; the case itself is not changed."""
    probe = replace(case, failures=[], spent={}, counts={})
    start.check_start(probe)
    return not probe.failures


class _CaseBackup:
    """A copy of the sets and failures of a case, from which they can be restored."""

    def __init__(self, case: Case) -> None:
        self.case, self.failures, self.counts = case, list(case.failures), dict(case.counts)
        self.found = [copy(proof.found) for proof in case.proofs]

    def restore_case(self) -> None:
        """Restores the sets and failures of the case."""
        self.case.failures, self.case.counts = self.failures, self.counts
        for proof, found in zip(self.case.proofs, self.found, strict=True):
            proof.found = found


def given_up_note(done: list[Case]) -> tuple[str, ...]:
    """A note if cells of K were given up for computed predicates, else ()."""
    if not done or not done[0].problem.computed:
        return ()
    lost, of = (max(c.counts.get(name, 0) for c in done) for name in (GIVEN_UP, HAD))
    text = f"P2b: {lost:,} of {of:,} cells that SC keeps are no part of K: no way back was found"
    return (text,) * bool(lost)


CELLS_MAX = {"P2a": 400_000, "P2b": 100_000}
"""The most smaller cells, of all groups, that are tried where a claim fails on declared ones."""
FAILED = {"P2a": "K is empty", "P2b": "P2b is not shown"}
SIZES = ("half", "a quarter of")
"""The sizes of cells that are tried in turn, as parts of the declared ones along each axis."""


@dataclass(frozen=True)
class Choice:
    """A problem with the chosen cells and number of levels, and its cases.

    `done`: all cases; None if the dynamics have no enclosure. `why`: what is not shown with
    `LEVELS_DEFAULT` levels, in words, if fewer were chosen, else "". `size`: the size of the cells
    in words, if smaller cells than declared were chosen, else "". `failed`: the claim of `FAILED`
    for which they were chosen. `tried`: if none were chosen, a line for each size that was tried.
    """

    problem: Problem
    done: list[Case] | None
    why: str = ""
    size: str = ""
    failed: str = "P2a"
    tried: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """Lines for each group whose cells are smaller, and one if fewer levels were chosen."""
        levels = f"levels {self.problem.levels}: with {LEVELS_DEFAULT}, as by default, {self.why}"
        pairs = zip(self.problem.declared_groups, self.problem.groups, strict=False)
        counts = filter(None, (cell_counts_in_words(a, b) for a, b in pairs))
        head = f"cells of {self.size} the size: on the declared ones {FAILED[self.failed]}"
        return [*(f"{head}: {text}" for text in counts), *([levels] if self.why else [])]


def choose_cells_and_levels(problem: Problem, attempt: Attempt) -> Choice:
    """Chooses the declared cells, or smaller cells if only these show P2a, or also P2b.

    Smaller cells are tried for P2b only if `safer` is computed. Counts of cells decide, never CPU
    time. The cases that `attempt` returns must have all failures of P2a.
    """
    first = _choice_with_levels(problem, attempt)
    if not problem.cells_open:
        return first
    found, tried = _finer_choice(first, "P2a", attempt)
    if found is first and not tried and problem.computed:
        found, tried = _finer_choice(first, "P2b", attempt)
    return found if found is not first else replace(first, tried=tuple(tried))


def _finer_choice(first: Choice, claim: str, attempt: Attempt) -> tuple[Choice, list[str]]:
    """The first choice with smaller cells that shows a claim, or `first`; also the tried sizes."""
    found = first
    tried = []
    for size in SIZES:
        coarse = _failing_groups(found, claim)
        if not coarse:
            break
        finer, most = finer_problem(found.problem, coarse), CELLS_MAX[claim]
        if cell_count(finer) > most:
            tried.append(
                f"not: cells of {size} the size, as {cell_count(finer):,} are more than {most:,}"
            )
            break
        found = _choice_with_levels(finer, attempt)
        lost = _unshown_claims(found.done)
        if found.done is not None and not ({claim, "P2a"} & lost.keys()):
            return replace(found, size=size, failed=claim), []
        tried.append(f"in vain: cells of {size} the size")
    return first, tried


def _failing_groups(choice: Choice, claim: str) -> list[Group]:
    """The groups in which a claim fails on known cells in some case."""
    failures = (f for case in choice.done or () for f in case.failures_of(claim))
    return [f.proof.group for f in failures if f.proof is not None and f.cells is not None]


def _choice_with_levels(problem: Problem, attempt: Attempt) -> Choice:
    """The choice with the program's number of levels, or, if it is open, with the better of two.

    The default number is taken, unless with the fewest levels only some of the same claims fail.
    CPU time does not decide. Where P2a fails the default number is kept.
    """
    if problem.levels_open and problem.levels != LEVELS_DEFAULT:
        problem = replace(problem, levels=LEVELS_DEFAULT)
    done = attempt(problem)
    lost = _unshown_claims(done)
    if problem.levels_open and lost and "P2a" not in lost:
        fewest = replace(problem, levels=LEVELS_LEAST)
        again = _cases_with_other_levels(done or (), fewest) or attempt(fewest)
        if again is not None and _unshown_claims(again).keys() < lost.keys():
            return Choice(fewest, again, next(lost[c] for c in OF_LEVELS if c in lost))
    return Choice(problem, done)


def _cases_with_other_levels(done: Sequence[Case], problem: Problem) -> list[Case] | None:
    """The cases with another number of levels and the same K and R(H); None if impossible."""
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
            compute_levels(new)
        again.append(new)
    return cases_with_way_back(again)


def _unshown_claims(done: Sequence[Case] | None) -> dict[str, str]:
    """The text of the first failure of P2a, and of each claim that depends on levels, by claim."""
    failures = [f for case in done or () for f in case.failures]
    return {f.claim: f.text for f in reversed(failures) if f.claim in (*OF_LEVELS, "P2a")}
