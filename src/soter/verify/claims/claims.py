"""The claims of one case, examined for each of its groups (docs/verification.md, section 3).

Purpose: for one combination of parameter values these functions compute C, K and R(H), check the
inclusions of `ttf` and `safer`, and compute the levels and tables of a DM without them. For P2b
they find a set Q_g for each group that SC keeps where every estimate satisfies `safer`, and the
time T from anywhere in K until AC has control again (from SC's first acting output until the
verdict is in force). Other functions find how plants cut C (a plant stops rather than publish
outside a topic's set), whether the proof covers the integration scheme that flies, and P1.
Symbols: head of `verify/grid/sets.py`; the index g is one group's part.
Non-goals: where control begins (`start.py`), how a group is proved (`verify/grid/`), refinement and
verdicts (`verify_module.py`), the error of a scheme (`grid/scheme_error.py`). That long arrays
and lists stay in their sets is an assumption.

P2b may take longer than all other claims. Where `ttf`, `safer` or the start fail, `postpone_p2b`
leaves P2b to an attempt on a finer grid. If there is none, the module is undecided anyway, and
`find_way_back_for_report` spends about as long on P2b as on these. CPU time decides no verdict.
"""

from __future__ import annotations

import time
from math import isfinite
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import CancelledError, cancelled_when, passing_phase, shares_to
from soter.language.evaluate.integration_stability import groups_that_diverge
from soter.language.model.types import leaf_name, leaves, show_ns
from soter.verify.claims import start
from soter.verify.claims.product_sets import (
    NOTHING_INSIDE,
    NOTHING_KEPT,
    VAIN,
    FailsafeClaim,
    claim_without_law,
    cut_to_law_core,
    product_holds,
    why_sc_leaves_sets_on_product,
)
from soter.verify.claims.results import ASSUMED, PROVED, UNDECIDED, Finding, ModuleResult
from soter.verify.deploy.level_tables import pairs_of, tables_of_groups
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.enclose.enclosed_steps import room_of
from soter.verify.grid import claims as grid_claims
from soter.verify.grid.case import Case, ClaimTimer
from soter.verify.grid.group_model import UnboundedError
from soter.verify.grid.sets import RESTS
from soter.verify.problem.problem import EVERY_SOLUTION, SCHEME, subjects_in_words
from soter.verify.problem.problem_times import DELAYS, horizon_in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.language.model.system import Bound
    from soter.verify.claims.product_sets import CellsPart
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.problem.problem import Assumption, Group, Problem


HOLDS = 8
"""The most periods per cell of C, on average, on smaller cells than declared; beyond it K is given
up. Where SC keeps a set, few cells need more than one period to come back to it; where it keeps
none, each is followed again and again: 20 to 60 periods for the robots tried, 4 for the lift."""
CLAMP = (
    "clamp what SC publishes to the topic's set: a float by `clamp`, each component of a vector by "
    "`saturate`, not by its norm; an int that SC keeps by `min` and `max`"
)


def open_case(
    problem: Problem,
    library: ReachLibrary,
    groups: Sequence[Group],
    parameter: tuple[int, ...],
    before: Case | None = None,
) -> Case:
    """Opens a case with a proof of each group; `UnboundedError` if dynamics lack an enclosure.

    A group that is the same as in the earlier attempt `before` keeps its sets and failures, because
    they depend only on the ranges of the other groups.
    """
    case = Case(problem, parameter, CompiledEnclosures(library, problem, parameter))
    case.holds = HOLDS if problem.declared_groups else 0
    for i, group in enumerate(groups):
        old = None if before is None else before.proofs[i]
        if old is None or before is None or old.group != group:
            case.proofs.append(grid_claims.new_proof(case, group))
            continue
        old.fresh = False
        case.proofs.append(old)
        case.failures += [f for f in before.failures if f.proof is old and f.claim != "start"]
    if before is not None:
        case.spent.update(before.spent)
        case.counts.update(before.counts)
    return case


def compute_constraint(case: Case) -> bool:
    """Gives each group its factor of C, and returns whether C is the product of these factors.

    Enters a failure of P2a if it is not, or if SC may fault or leave its sets on C.
    """
    parts = grid_claims.factors_of_predicate(case, "constraint")
    if parts is None:
        case.fail("P2a", "no state was found on which `safe` holds")
        return False
    if not product_holds(case.forms, parts, "constraint"):
        hint = "put states that `safe` compares with each other into one line"
        case.fail("P2a", "`safe` is no product over the groups", hint=hint)
        return False
    if case.problem.has_core_hint:
        hinted = grid_claims.parts_within_core_hint(case, parts)
        if hinted is None:
            case.fail("P2a", "no state was found on which `core` holds")
            return False
        parts = hinted
    case.lawful = claim_without_law(case.problem, parts) or _claim_of_law(case, parts)
    for proof, part in zip(case.proofs, case.lawful.parts, strict=True):
        proof.take_constraint(case, part)
    why = why_sc_leaves_sets_on_product(case.problem, case.forms, parts)
    if why:
        case.fail("P2a", why, hint=CLAMP)
    return True


def _claim_of_law(case: Case, parts: Sequence[CellsPart]) -> FailsafeClaim:
    """The claim with C cut to K_fs, the core of the fail-safe law, computed on the same groups."""
    problem = case.problem.law
    assert problem is not None
    names = [s.name for s in case.problem.quantities.states]
    if [s.name for s in problem.quantities.states] != names:
        return FailsafeClaim(parts, parts, "the law is not about the same states as SC")
    groups = [p.group for p in case.proofs]
    library, _ = library_of(problem)
    with passing_phase(f"{case.problem.name}: what its fail-safe law keeps"), shares_to(None):
        try:
            law = open_case(problem, library, groups, case.parameter)
            law.vain = VAIN
            if not (compute_constraint(law) and compute_core(law)):
                return FailsafeClaim(parts, parts, NOTHING_KEPT)
        except UnboundedError as error:
            return FailsafeClaim(parts, parts, str(error))
    return cut_to_law_core(law.sets, parts)


def compute_core(case: Case) -> bool:
    """Computes K of every group; returns whether no K is empty.

    If SC keeps nothing inside K_fs, the core of the fail-safe law, K is computed without the law.
    """
    all_found = _compute_cores(case)
    if all_found or case.lawful is None or not case.lawful.is_smaller:
        return all_found
    case.lawful.drop_law(NOTHING_INSIDE)
    for proof, part in zip(case.proofs, case.lawful.parts, strict=True):
        case.make_fresh(proof)
        proof.take_constraint(case, part)
    return _compute_cores(case)


def _compute_cores(case: Case) -> bool:
    all_found = True
    for proof in case.fresh_proofs:
        all_found = proof.find_core(case) and all_found
    return all_found


def compute_free_states(case: Case) -> None:
    """Computes R(H) of every group."""
    for proof in case.fresh_proofs:
        proof.find_free_states(case)


def check_inclusion(case: Case, predicate: str) -> None:
    """Checks that `ttf` or `safer` gives AC control only at estimates of states in R(H)."""
    for proof in case.fresh_proofs:
        proof.check_inclusion(case, predicate)


def compute_levels(case: Case) -> None:
    """Computes S_0 ... S_(m-2) of every group; enters a failure for each empty set."""
    for proof in case.fresh_proofs:
        proof.find_levels(case)


def make_tables(cases: Sequence[Case]) -> None:
    """Makes the tables of the DM from all cases; P2b needs them.

    The DM has one table for all parameter values: an estimate lets AC have control only if it is in
    S_0 of every case. If a case has no sets, the module gets no table.
    """
    problem = cases[0].problem
    pairs = [pairs_of(case.sets) for case in cases]
    if any(len(p) != len(problem.groups) for p in pairs):
        return
    level_tables = tables_of_groups(problem, pairs)
    for case in cases:
        for proof, table in zip(case.proofs, level_tables, strict=True):
            proof.take_table(case, table)


def check_after_core(case: Case) -> None:
    """Computes and checks everything that follows from K, except P2b."""
    with ClaimTimer(case, "P3"):
        compute_free_states(case)
    if case.problem.computed:
        with ClaimTimer(case, "ttf"):
            compute_levels(case)
    else:
        for predicate in ("ttf", "safer"):
            with ClaimTimer(case, predicate):
                check_inclusion(case, predicate)
    with ClaimTimer(case, "start"):
        start.check_start(case)


GIVE_BACK = "let one of them give control back whatever the other one does"
MS = 1_000_000
"""Nanoseconds in a millisecond: times in hints are rounded up to whole ones."""


def find_way_back(case: Case) -> None:
    """Computes Q, W and the time to Q of every group, and enters failures of P2b."""
    targets = _targets_of_recovery(case)
    if targets is None:
        return
    for proof, target in zip(case.proofs, targets, strict=True):
        proof.find_recovery(case, target)
    times = case.problem.times
    longest = max((p.return_ns for p in case.proofs), default=0)
    case.counts["recover_ns"] = longest + times.schedule.longest_to_decision
    check_return_time(case)


def _targets_of_recovery(case: Case) -> list[CellsPart] | None:
    """For each group the states whose estimates all satisfy `safer`; None if P2b fails here."""
    if case.problem.computed:
        parts_by_proof = [p.cells_that_give_ac_control(case) for p in case.proofs]
        target_parts = [part for part in parts_by_proof if part is not None]
        if len(target_parts) < len(parts_by_proof):
            case.fail("P2b", "not every case has sets: the DM never gives control back")
            return None
        return target_parts
    predicate = case.problem.return_predicate
    parts = grid_claims.factors_of_predicate(case, predicate)
    if parts is None:
        case.fail("P2b", "no state was found on which `safer` surely holds")
        return None
    if not product_holds(case.forms, parts, predicate):
        case.fail("P2b", "`safer` is no product over the groups")
        return None
    return parts


def check_return_time(case: Case) -> None:
    """Enters a failure of P2b if the time T is longer than `recover within` allows."""
    wanted, needed = case.problem.recover_ns, case.counts["recover_ns"]
    if wanted is not None and needed > wanted and not case.failures_of("P2b"):
        case.fail(
            "P2b",
            f"SC may need {show_ns(needed)}, longer than the {show_ns(wanted)} of `recover within`",
            hint=f"`recover within {-(-needed // MS)}ms;`, or a quicker SC",
        )


def weaken_if_waiting(problem: Problem, finding: Finding) -> None:
    """Weakens P2b of a module that waits for others: P2b holds only while they are in AC."""
    modes = problem.modes
    if modes is None or not modes.waits or finding.verdict != PROVED:
        return
    if modes.never:
        finding.weaken_to(UNDECIDED, modes.never, GIVE_BACK)
    else:
        finding.weaken_to(
            ASSUMED, f"{finding.text} while {subjects_in_words(modes.waits)} in AC: not proved"
        )


CHEAPER = ("ttf", "safer", "start")
LEAST_S = 4.0
"""The CPU seconds that `find_way_back_for_report` may take even if the rest was quicker."""


def postpone_p2b(case: Case) -> bool:
    """Returns whether a cheaper claim fails; if so, enters P2b as a failure not examined."""
    failing = next((f.claim for f in case.failures if f.claim in CHEAPER), None)
    if failing is not None:
        case.fail("P2b", f"not looked at to the end: `{failing}` fails first").cut = True
    return failing is not None


def find_way_back_for_report(case: Case) -> None:
    """Runs a postponed `find_way_back` for a limited time; drops an incomplete result."""
    not_looked_at = [f for f in case.failures if f.cut]
    assert not_looked_at, "a case that may be proved has no budget"
    case.failures = [f for f in case.failures if not f.cut]
    until = time.process_time() + max(LEAST_S, sum(case.spent.values()))
    try:
        with cancelled_when(lambda: time.process_time() > until):
            find_way_back(case)
    except CancelledError:
        for part in case.sets.groups:
            part.target = part.home = part.rank = part.rank_holds = None
        case.failures = [f for f in case.failures if f.claim != "P2b"] + not_looked_at


FAULT = "what plants drive may fault"


def narrowed_leaves_in_words(problem: Problem, forms: CompiledEnclosures) -> list[str]:
    """A text for each leaf whose set a plant may leave somewhere in the ranges of states."""
    driven = list(_driven_leaves(problem))
    if len(driven) > forms.results:
        return []
    ends = forms.result_bounds("drives", forms.whole, len(driven))
    if ends is None:
        return [FAULT]
    messages = []
    for (name, bound, error, numbered), (low, high) in zip(driven, ends, strict=True):
        if bound is None:
            if numbered and not (isfinite(low) and isfinite(high)):
                messages.append(f"`{name}` takes only finite numbers")
            continue
        least, most = room_of(bound, error)
        if not least <= low <= high <= most:
            messages.append(f"`{name}` takes only [{bound.low:.6g}, {bound.high:.6g}]")
    return messages


def note_narrowed_leaves(result: ModuleResult, done: Sequence[Case], claims: Iterable[str]) -> None:
    """Notes that C is limited to values that plants can publish; undecided claims get a hint."""
    texts = narrowed_leaves_in_words(result.problem, done[0].forms)
    if not texts:
        return
    result.notes += (
        f"C is cut to what plants can publish, as a plant stops beyond: {', '.join(texts)}",
    )
    sets = [text for text in texts if " takes only [" in text]
    for finding in (result.findings[c] for c in claims if sets):
        if finding.verdict == UNDECIDED:
            wider = f"a wider set ({sets[0]}: a plant stops there)"
            finding.hint = f"{finding.hint}; or {wider}" if finding.hint else wider


def _driven_leaves(problem: Problem) -> Iterator[tuple[str, Bound | None, float, bool]]:
    """Yields the name, set and error of each driven leaf, and whether `drives` numbers it.

    Leaves of lists and of long arrays have no number; that they stay in their sets is assumed.
    """
    system = problem.system
    plants = [c for c in system.components if c.plant is not None]
    topics = {c.scope.topics[t] for c in plants if c.plant for t, _ in c.plant.drives}
    measured = {(m.topic, m.leaf): m.bound for c in plants for m in c.measured}
    for index in sorted(topics):
        topic = system.topics[index]
        leaf_paths = [path for path, _ in leaves(topic.type)]
        for path, _ in leaves(topic.type, whole_lists=True):
            number = leaf_paths.index(path) if path in leaf_paths else None
            bound = None if number is None else topic.bounds[number]
            error = 0.0 if number is None else measured.get((index, number), 0.0)
            yield leaf_name(topic.name, path), bound, error, number is not None


IN_PROOF = (
    "the simulator's scheme is in the proof, as all flows are linear; `soter recheck` assumes it"
)


def keys_of_shown_scheme(problem: Problem, done: Sequence[Case]) -> frozenset[str]:
    """The key of the assumption SCHEME if the proof shows it (all flows are linear), else none."""
    assumed = SCHEME in problem.assumptions
    return frozenset((SCHEME.key,)) if assumed and all(map(_covers_scheme, done)) else frozenset()


def solution_assumptions(problem: Problem, done: Sequence[Case]) -> list[Assumption]:
    """The assumption that replaces SCHEME if SC comes to rest, because rates may then jump."""
    groups = [g for c in done for g in c.sets.groups]
    rests = SCHEME in problem.assumptions and any((g.core == RESTS).any() for g in groups)
    return [EVERY_SOLUTION] * rests


def why_scheme_diverges(problem: Problem) -> str:
    """Says why the assumed scheme surely diverges; "" if that is not known."""
    states = zip(problem.quantities.states, problem.states, strict=True)
    within = {(s.owner, s.member, s.path): (r.low, r.high) for s, r in states}
    for c in problem.system.components:
        ranges = {(name, path): r for (owner, name, path), r in within.items() if owner == c.index}
        for d in groups_that_diverge(problem.system, c, ranges):
            names = ", ".join(d.names)
            return (
                f"the scheme of {c.name} makes {names} diverge: a step multiplies by {d.growth:.3g}"
            )
    return ""


def _covers_scheme(case: Case) -> bool:
    """Whether the simulator's steps are solutions of the models of all groups."""
    if len(case.proofs) < len(case.problem.groups):
        return False
    return all(p.covers_scheme for p in case.proofs)


HOW = {
    "P1a": "periods compared",
    "P1b": "outputs compared",
    "P1c": "worst case over all releases",
    "P3": "inclusions of `ttf` and `safer`",
    "failsafe": "K inside the core of the fail-safe law",
    "DM": "the compiled DM on all facts, and tried on every class of input",
}
"""How each claim is shown that is not shown group by group, in words."""


def enter_static_claims(problem: Problem, result: ModuleResult) -> None:
    """Enters the findings on P1a and P1b, which `soter check` shows, and on P1c, about times."""
    times = problem.times
    result.findings["P1a"] = Finding(
        PROVED,
        method=HOW["P1a"],
        text=f"SC every {show_ns(times.delta_sc)}, DM every {show_ns(times.delta_dm)}",
    )
    result.findings["P1b"] = Finding(
        PROVED, method=HOW["P1b"], text="AC and SC publish the same topics"
    )
    enough = times.horizon_ns >= times.h_star
    verdict = PROVED if all(n in times.declared for n in (*DELAYS, "nodes")) else ASSUMED
    result.findings["P1c"] = Finding(
        verdict if enough else UNDECIDED,
        method=HOW["P1c"],
        text=horizon_in_words(times),
        hint="" if enough else f"a horizon of {show_ns(times.h_star)} or more, or less delay",
    )
