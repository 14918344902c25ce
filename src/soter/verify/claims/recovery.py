"""P2b: SC gives control back.

Purpose: sets Q_g that SC keeps inside the states whose every estimate satisfies `safer`, and the
time that it takes to be there from all of K (docs/verification.md, section 3). T counts from SC's
first acting output to the instant at which the verdict that gives control back is in force.
Non-goals: whether AC then does anything useful; Q and the way there (`verify/grid/recovery.py`,
`verify/polytope/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.durations import show_ns
from soter.verify.claims.claims import parts_of
from soter.verify.claims.product_sets import product_holds
from soter.verify.claims.results import ASSUMED, PROVED, UNDECIDED
from soter.verify.problem.modes_of_other_modules import said

if TYPE_CHECKING:
    from soter.verify.claims.case import Case
    from soter.verify.claims.product_sets import SetFactor
    from soter.verify.claims.results import Finding
    from soter.verify.problem.problem import Problem

GIVE_BACK = "let one of them give control back whatever the other one does"
MS = 1_000_000
"""Times in hints are whole milliseconds, upwards."""


def recover(case: Case) -> None:
    """Q, W and the time to Q of every group; enters failures of P2b."""
    targets = _targets(case)
    if targets is None:
        return
    for proof, target in zip(case.proofs, targets, strict=True):
        proof.recover(case, target)
    times = case.problem.times
    longest = max((p.return_ns for p in case.proofs), default=0)
    case.counts["recover_ns"] = longest + times.decision + times.response_dm
    in_time(case)


def _targets(case: Case) -> list[SetFactor] | None:
    """Per group the states all of whose estimates satisfy `safer`."""
    if case.problem.computed:
        held = [p.held(case) for p in case.proofs]
        target_parts = [part for part in held if part is not None]
        if len(target_parts) < len(held):
            case.fail("P2b", "not every case has sets: the DM never gives control back")
            return None
        return target_parts
    predicate = case.problem.returning
    parts = parts_of(case, predicate)
    if parts is None:
        case.fail("P2b", "no state was found on which `safer` surely holds")
        return None
    if not product_holds(case.forms, parts, predicate):
        case.fail("P2b", "`safer` is no product over the groups")
        return None
    return parts


def in_time(case: Case) -> None:
    """The declared T, where there is one."""
    wanted, needed = case.problem.recover_ns, case.counts["recover_ns"]
    if wanted is not None and needed > wanted and not case.failed("P2b"):
        case.fail(
            "P2b",
            f"SC may need {show_ns(needed)}, longer than the {show_ns(wanted)} of `recover within`",
            hint=f"`recover within {-(-needed // MS)}ms;`, or a quicker SC",
        )


def waits(problem: Problem, finding: Finding) -> None:
    """P2b of a module that waits for others is about times at which these are in AC."""
    modes = problem.modes
    if modes is None or not modes.waits or finding.verdict != PROVED:
        return
    if modes.never:
        finding.rest_on(UNDECIDED, modes.never, GIVE_BACK)
    else:
        finding.rest_on(ASSUMED, f"{finding.text} while {said(modes.waits)} in AC: not proved")
