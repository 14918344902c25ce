"""K without the states from which there is no way back, and what then rests on it.

Purpose: everything that rests on K; W in place of K where a few cells of K are not led back to
`safer`; and of computed predicates P2b of all cases, until it holds of such a K.
Non-goals: W (`verify/grid/recovery.py`), finer grids (`grid_refinement.py`).

Computed predicates rest on K as well: with a smaller one fewer estimates leave AC in control, and Q
may lose cells, too. What is proved is proved of the sets of the last round, or K is as it was.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.verify.claims import claims
from soter.verify.claims.case import ClaimTimer
from soter.verify.claims.levels import OF_LEVELS, deploy, levels
from soter.verify.claims.recovery import recover
from soter.verify.grid.sets import UnboundedError

if TYPE_CHECKING:
    from soter.verify.claims.case import Case, Failure

SHRINK_MAX = 0.1
"""Share of K that may be given up because there is no way back from it."""
ROUNDS = 4
"""So often cells may be given up where predicates are computed."""
GIVEN_UP, HAD = "given_up", "had"
"""Counted of a case: cells that are no part of K any more, and those of K before."""


def after_core(case: Case) -> None:
    """Everything that rests on K."""
    with ClaimTimer(case, "P3"):
        claims.free_phase(case)
    if case.problem.computed:
        with ClaimTimer(case, "ttf"):
            levels(case)
    else:
        for predicate in ("ttf", "safer"):
            with ClaimTimer(case, predicate):
                claims.inclusion(case, predicate)
    with ClaimTimer(case, "start"):
        claims.start(case)


def shrunk(case: Case) -> bool:
    """Give up the few cells of K from which no way back was found: W in place of K.

    At its border K has cells that SC keeps, but only by chains whose images are all of K. W is
    as good: its cells have chains in C whose images lie in W, and Q is kept.
    """
    failures = case.failed("P2b")
    if case.problem.computed or not failures or not _few(failures):
        return False
    _give_up(case, failures)
    return True


def _few(failures: list[Failure]) -> bool:
    """Whether all of them are of cells of K that are not led back, few of every group."""
    return all(f.stuck and f.proof and f.proof.stuck <= SHRINK_MAX for f in failures)


def _give_up(case: Case, failures: list[Failure]) -> None:
    stuck = [f.proof for f in failures if f.proof is not None]
    for proof in case.proofs:
        proof.fresh = proof in stuck
    for proof in stuck:
        had = proof.core_cells
        case.counts.setdefault(HAD, sum(p.core_cells for p in case.proofs))
        proof.give_up(case)
        case.counts[GIVEN_UP] = case.counts.get(GIVEN_UP, 0) + had - proof.core_cells
    case.failures = [f for f in case.failures if f.proof not in stuck and f.claim != "start"]


# ---------------------------------------------------------------- computed predicates


def returned(done: list[Case]) -> list[Case]:
    """With P2b: the DM has one table for all cases, and SC returns to what it holds.

    Where few cells of K are not led back they are given up, and all that rests on K is found
    anew; if that shows P2b and costs no other claim, these are the sets.
    """
    _recovered(done)
    if not any(case.failed("P2b") for case in done):
        return done
    before, started = [_Before(case) for case in done], [_starts(case) for case in done]
    for _ in range(ROUNDS):
        if not all(_may_give_up(case) for case in done):
            break
        for case in done:
            failures = case.failed("P2b")
            if failures:
                _give_up(case, failures)
                after_core(case)
        _recovered(done)
        if not any(_unshown(case) for case in done):
            if all(_starts(case) for case, well in zip(done, started, strict=True) if well):
                return done
            break
    for kept in before:
        kept.restore()
    return done


def _recovered(done: list[Case]) -> None:
    deploy(done)
    for case in done:
        if case.failed("P2b") or case.problem.stays:
            continue  # there is no K, or no enclosure; or it is not asked
        try:
            with ClaimTimer(case, "P2b"):
                recover(case)
        except UnboundedError as error:
            case.fail("P2b", str(error), hint="a smaller grid, or a shorter horizon")


def _unshown(case: Case) -> list[Failure]:
    """Failures of levels, and of P2a; the start is looked at for itself."""
    return [f for f in case.failures if f.claim in (*OF_LEVELS, "P2a")]


def _may_give_up(case: Case) -> bool:
    """Whether it fails in nothing but a few cells of K, if at all."""
    failures = _unshown(case)
    return all(f.claim == "P2b" for f in failures) and _few(failures)


def _starts(case: Case) -> bool:
    """Whether the start is shown; of a flight nobody has asked."""
    probe = replace(case, failures=[], spent={}, counts={})
    claims.start(probe)
    return not probe.failures


class _Before:
    """A case as it is, to go back to."""

    def __init__(self, case: Case) -> None:
        self.case, self.failures, self.counts = case, list(case.failures), dict(case.counts)
        self.found = [copy(proof.found) for proof in case.proofs]

    def restore(self) -> None:
        """All sets, and what fails of them."""
        self.case.failures, self.case.counts = self.failures, self.counts
        for proof, found in zip(self.case.proofs, self.found, strict=True):
            proof.found = found


def given_up(done: list[Case]) -> tuple[str, ...]:
    """A line where computed predicates rest on a smaller K than SC keeps."""
    if not done or not done[0].problem.computed:
        return ()
    lost, of = (max(c.counts.get(name, 0) for c in done) for name in (GIVEN_UP, HAD))
    text = f"P2b: {lost:,} of {of:,} cells that SC keeps are no part of K: no way back was found"
    return (text,) * bool(lost)
