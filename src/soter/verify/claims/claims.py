"""The claims of one case, asked of its groups in turn (docs/verification.md, section 3).

Purpose: for one combination of parameter values: C, K, R(H), the inclusions of `ttf` and `safer`,
the start. What a group cannot show it says itself; here is what concerns several of them.
Non-goals: how a group is proved (`case.py`, `verify/grid/`, `verify/polytope/`), P2b
(`recovery.py`), refinement and verdicts (`verify.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import passing_phase
from soter.verify.claims.case import Case
from soter.verify.claims.failsafe_claim import (
    NOTHING_INSIDE,
    NOTHING_KEPT,
    VAIN,
    FailsafeClaim,
    inside,
    without_law,
)
from soter.verify.claims.handback_claim import handed_back
from soter.verify.claims.product_sets import law_stays_inside, product_holds
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.grid.sets import UnboundedError
from soter.verify.proof_methods import by_method, in_order, method_of
from soter.verify.time.sc_on_default_inputs import fault_on_defaults

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.claims.case import Tell
    from soter.verify.claims.product_sets import SetFactor
    from soter.verify.enclose.engine_library import ReachLibrary
    from soter.verify.problem.problem import Group, Problem

HOLDS = 8
"""Of a cell of C, on average, on smaller cells than declared: with more K is given up there.

Where SC keeps a set, few cells take more than one hold to come back to it; where it keeps none,
each is followed again and again, 20 to 60 holds of robots that were tried, and 4 of the lift's.
"""
CLAMP = (
    "clamp what SC publishes to the topic's set: a float by `clamp`, each component of a vector by "
    "`saturate`, not by its norm"
)


def open_case(
    problem: Problem,
    library: ReachLibrary,
    groups: Sequence[Group],
    parameter: tuple[int, ...],
    tell: Tell | None,
    before: Case | None = None,
) -> Case:
    """The proofs of every group; UnboundedError where the dynamics have no enclosure.

    Of an earlier attempt `before`, groups that are the same keep their sets and their failures: the
    analysis of a group looks at the ranges of the others only.
    """
    case = Case(problem, parameter, CompiledEnclosures(library, problem, parameter), tell=tell)
    case.holds = HOLDS if problem.declared_groups else 0
    for i, group in enumerate(in_order(groups)):
        old = None if before is None else before.proofs[i]
        if old is None or before is None or old.group != group:
            case.proofs.append(method_of(group).opened(case, group, tell))
            continue
        old.fresh = False
        case.proofs.append(old)
        case.failures += [f for f in before.failures if f.proof is old and f.claim != "start"]
    if before is not None:
        case.spent.update(before.spent)
        case.counts.update(before.counts)
    return case


def parts_of(case: Case, predicate: str) -> list[SetFactor] | None:
    """A part for every group on which a predicate holds; None where none was found."""
    all_parts: list[SetFactor] = []
    for method, proofs in by_method(case):
        parts = method.parts(case, proofs, predicate)
        if parts is None:
            return None
        all_parts += parts
    return all_parts


def constraint(case: Case) -> bool:
    """C_g for every group, the product check, and that SC stays inside its sets; False: no C."""
    parts = parts_of(case, "constraint")
    if parts is None:
        case.fail("P2a", "no state was found on which `safe` holds")
        return False
    if not product_holds(case.forms, parts, "constraint"):
        hint = "put states that `safe` compares with each other into one line"
        hint += "".join(method.hint for method, _ in by_method(case))
        case.fail("P2a", "`safe` is no product over the groups", hint=hint)
        return False
    if case.problem.has_core_hint:
        hinted = _hinted(case, parts)
        if hinted is None:
            case.fail("P2a", "no state was found on which `core` holds")
            return False
        parts = hinted
    case.lawful = without_law(case.problem, parts) or _kept_by_law(case, parts)
    for proof, part in zip(case.proofs, case.lawful.parts, strict=True):
        proof.take(case, part)
    why = law_stays_inside(case.problem, case.forms, parts)
    if why:
        case.fail("P2a", why, hint=CLAMP)
    return True


def _kept_by_law(case: Case, parts: Sequence[SetFactor]) -> FailsafeClaim:
    """K_fs on the same groups, and C inside it."""
    problem = case.problem.law
    assert problem is not None
    names = [s.name for s in case.problem.quantities.states]
    if [s.name for s in problem.quantities.states] != names:
        return FailsafeClaim(parts, parts, "the law is not about the same states as SC")
    groups = [p.group for p in case.proofs]
    library, _ = library_of(problem)
    with passing_phase(f"{case.problem.name}: what its fail-safe law keeps"):
        try:
            law = open_case(problem, library, groups, case.parameter, None)
            law.vain = VAIN
            if not (constraint(law) and core(law)):
                return FailsafeClaim(parts, parts, NOTHING_KEPT)
        except UnboundedError as error:
            return FailsafeClaim(parts, parts, str(error))
    return inside(law.sets, parts)


def _hinted(case: Case, parts: Sequence[SetFactor]) -> list[SetFactor] | None:
    """The parts inside `core e;`."""
    left = dict(zip(map(id, case.proofs), parts, strict=True))
    core_parts: list[SetFactor] = []
    for method, proofs in by_method(case):
        inside = method.hinted(case, proofs, [left[id(p)] for p in proofs])
        if inside is None:
            return None
        core_parts += inside
    return core_parts


def core(case: Case) -> bool:
    """K of every group; False where one is empty.

    Where SC keeps nothing inside what the fail-safe law keeps, K is looked for without the law.
    """
    whole = _cores(case)
    if whole or case.lawful is None or not case.lawful.narrows:
        return whole
    case.lawful.give_up(NOTHING_INSIDE)
    for proof, part in zip(case.proofs, case.lawful.parts, strict=True):
        case.again(proof)
        proof.take(case, part)
    return _cores(case)


def _cores(case: Case) -> bool:
    whole = True
    for proof in case.fresh:
        whole = proof.core(case) and whole
    return whole


def free_phase(case: Case) -> None:
    """R(H) of every group."""
    for proof in case.fresh:
        proof.free_phase(case)


def inclusion(case: Case, predicate: str) -> None:
    """`ttf` or `safer`: an estimate from which AC may have control comes from a state in R(H)."""
    for proof in case.fresh:
        proof.inclusion(case, predicate)


def start(case: Case) -> None:
    """The declared initial states lie in R(h_0), h_0 the first instant SC's output acts.

    Below another module that one has control first: asked is where it gives control back.
    """
    if case.problem.above:
        handed_back(case)
        return
    if not case.problem.starts_with(case.parameter):
        return
    wrong_read = fault_on_defaults(case.problem)
    if wrong_read:
        hint = "let SC step only after what it reads was published: `phase`"
        case.fail("start", wrong_read, hint=hint)
    until_ns = case.problem.in_horizon(case.problem.times.start)
    for proof in case.proofs:
        proof.start(case, until_ns)
