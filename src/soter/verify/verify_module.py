"""Verifies one module, with a verdict on every property.

Purpose: `verify_module` proves all cases over sets of states, on finer grids where claims fail only
at borders, looks for counterexamples to claims that are not proved, and returns a `ModuleResult`. A
claim of which something has no bound is undecided. `module_method` gives, for each kind of problem,
the functions that verify it, write its certificate entry, and check what a deployed system gives.
Non-goals: the claims themselves (`verify/claims/`), proofs by induction (`induction/verify.py`) and
by tubes (`tubes/verify.py`); how groups of states are proved (`proof_methods.py`).
"""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.diagnostics.current_phase import between, phase, share_done, shares_to
from soter.language.model.assumption_words import in_words
from soter.language.model.types import show_ns
from soter.verify.claims import claims
from soter.verify.claims.choose_cells_and_levels import (
    cases_with_way_back,
    choose_cells_and_levels,
    given_up_note,
    shrink_core,
)
from soter.verify.claims.claims import (
    HOW,
    IN_PROOF,
    check_after_core,
    check_return_time,
    enter_static_claims,
    find_way_back,
    find_way_back_for_report,
    keys_of_shown_scheme,
    note_narrowed_leaves,
    postpone_p2b,
    solution_assumptions,
    weaken_if_waiting,
    why_scheme_diverges,
)
from soter.verify.claims.product_sets import NO_LAW, NOT_FOR_LAWS, FailsafeClaim, hint_for_law
from soter.verify.claims.results import (
    ASSUMED,
    NO_CORE,
    PROPERTIES,
    PROVED,
    REFUTED,
    STAYS,
    UNDECIDED,
    Finding,
    ModuleResult,
)
from soter.verify.claims.start import why_not_entered
from soter.verify.deploy import deployed_sensors
from soter.verify.diagnosis.vacuity import (
    OF_NOTHING,
    mention_vacuity_in_claim,
    note_on_start,
    worst_vacuity,
)
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.grid.case import Case, ClaimTimer, notes_on_interruption, verdicts_in_words
from soter.verify.grid.claims import HOW as HOW_ON_GRIDS
from soter.verify.grid.claims import proved_in_words
from soter.verify.grid.grid_refinement import announce_work, refined_groups, refinement_notes
from soter.verify.grid.group_model import UnboundedError
from soter.verify.grid.scheme_error import STIFF_HINT
from soter.verify.induction import verify as induction
from soter.verify.induction.verify import verify_by_induction
from soter.verify.problem.extract import parameter_cases
from soter.verify.problem.problem import Assumption
from soter.verify.problem.supported_constructs import note_on_ages
from soter.verify.proof_methods import module_entry
from soter.verify.tubes.verify import certificate_entry as tubes_entry
from soter.verify.tubes.verify import verify_by_tubes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import System
    from soter.verify.claims.choose_cells_and_levels import Choice
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.induction.prove_or_refute import Search
    from soter.verify.problem.problem import Group, Problem, ProblemKind


REFINEMENTS_MAX = 2
STAGES = ("safe", "core", "tubes", "ttf", "safer", "way")
"""The stages of progress that are reported, in the order in which they take place."""
CASES, ATTACKED = 0.6, 0.9
"""The shares of a module's time, roughly, after which its cases, and the next steps, are done."""
RESTS_ON = ("P1c", "P2a", "P3", "start")
"""The claims by which the state is in K when the fail-safe law begins to act."""
CLAIMS = ("P2a", "ttf", "safer", "start", "P2b")
NOT_ENTERED = (
    "a guard that lets less in, over what the view's plants drive; or leave `enters` out: then "
    "every change is an assumption"
)


def verify_module(
    problem: Problem,
    *,
    refute: bool = True,
    explain: bool | None = None,
    search: Search | None = None,
    compiled: tuple[ReachLibrary, tuple[str, ...]] | None = None,
) -> ModuleResult:
    """Verifies one module by sets; raises `SoterError` R... if its program cannot be enclosed.

    `explain` asks why a claim stays undecided; None means as `refute`. `compiled` is the result of
    `library_of`. `search` is not used, but every method takes it.
    """
    del search
    began = time.perf_counter()
    library, prelude = compiled or library_of(problem)
    announce_work(problem, lambda p, at: _examined_case(p, library, p.groups, at, None))
    with between(0.0, CASES):
        chosen, cpu = _choose_cells_and_levels(problem, library)
    problem, done = chosen.problem, chosen.done or []
    result = _result_with_verdicts(chosen, prelude)
    phase(f"{problem.name}: the compiled DM")
    share_done(CASES)
    result.findings["DM"] = _dm_finding(result)
    result.findings = {p: result.findings[p] for p in PROPERTIES}
    result.recover_s = _return_time_s(done, result)
    result.shares = _least_shares(done)
    result.vacuity, result.at_the_start = worst_vacuity(done), note_on_start(done)
    mention_vacuity_in_claim(result)
    if refute:
        phase(f"{problem.name}: looking for a counterexample")
    share_done(ATTACKED)
    with shares_to(None), notes_on_interruption(lambda: verdicts_in_words(result)):
        if refute and problem.modes is None:  # in a run somebody has to decide what the others do
            from soter.verify.refute import enter_refutations  # noqa: PLC0415 - compiles all of it

            enter_refutations(problem, result)
        if (refute if explain is None else explain) and result.verdict in (UNDECIDED, REFUTED):
            from soter.verify.diagnosis.tried_remedies import diagnose  # noqa: PLC0415 - only here

            diagnose(done, result, cpu, _cases_of_changed_problem)
    note_narrowed_leaves(result, done, CLAIMS)
    result.seconds = time.perf_counter() - began
    return result


def _result_with_verdicts(chosen: Choice, prelude: tuple[str, ...]) -> ModuleResult:
    """The result with all findings but the DM's; `prelude` has the proof's prelude functions."""
    problem, done = chosen.problem, chosen.done or []
    entered, why_unentered = _hand_over_assumptions(problem, done)
    ages = note_on_ages(problem.module.symbol.ttf)
    scheme, solutions = keys_of_shown_scheme(problem, done), solution_assumptions(problem, done)
    notes = (*entered.values(), *ages, *chosen.notes, *([IN_PROOF] if scheme else []))
    result = ModuleResult(
        problem,
        {},
        [c.sets for c in done],
        notes=(*refinement_notes(done), *given_up_note(done), *notes),
        cells_why=chosen.failed if chosen.size else "",
        levels_why=chosen.why,
        added=(
            *_prelude_assumptions(prelude),
            *_simultaneity_assumptions(problem, done),
            *solutions,
        ),
        shown=scheme | {a.key for a in solutions} | set(entered),
    )
    _enter_verdicts(result, done, why_unentered)
    result.findings["P2a"].tried += chosen.tried
    return result


def _choose_cells_and_levels(problem: Problem, library: ReachLibrary) -> tuple[Choice, float]:
    """The chosen cells and levels with all cases, and the CPU seconds of the first attempt."""
    spent: list[float] = []

    def attempt(problem: Problem) -> list[Case]:
        began = time.process_time()
        with shares_to(None) if spent else nullcontext():
            done = _cases_of_problem(problem, library)
        spent.append(time.process_time() - began)
        return done

    return choose_cells_and_levels(problem, attempt), spent[0]


def _cases_of_problem(problem: Problem, library: ReachLibrary) -> list[Case]:
    every = list(parameter_cases(problem))
    done = []
    for i, parameter in enumerate(every):
        with between(i / len(every), (i + 1) / len(every), STAGES):
            done.append(_case_on_finer_grids(problem, library, parameter))
    return cases_with_way_back(done) if problem.computed else done


def _case_on_finer_grids(
    problem: Problem, library: ReachLibrary, parameter: tuple[int, ...]
) -> Case:
    """A case; on finer grids if only borders of sets fail and no predicates are computed."""
    first = case = _examined_case(problem, library, problem.groups, parameter, None)
    for _ in range(0 if problem.computed else REFINEMENTS_MAX):
        if (finer := refined_groups(case)) is None:
            break
        case = _examined_case(problem, library, finer, parameter, case)
        case.first = first
    if any(f.cut for f in case.failures):
        try:
            _examine_return(case, find_way_back_for_report)
        except UnboundedError as error:
            _enter_unbounded_failures(case, error)
    return case


def _examined_case(
    problem: Problem,
    library: ReachLibrary,
    groups: tuple[Group, ...],
    parameter: tuple[int, ...],
    before: Case | None,
) -> Case:
    """A case for one combination of parameter values, with all claims examined."""
    case = Case(problem, parameter, CompiledEnclosures(library, problem, parameter))
    try:
        case = claims.open_case(problem, library, groups, parameter, before)
        _examine_claims(case)
    except UnboundedError as error:
        _enter_unbounded_failures(case, error)
    return case


def _enter_unbounded_failures(case: Case, error: UnboundedError) -> None:
    for claim in CLAIMS:
        case.fail(claim, str(error), hint=error.hint)


def _examine_claims(case: Case) -> None:
    with ClaimTimer(case, "P2a"):
        has_core = claims.compute_constraint(case) and claims.compute_core(case)
    if not has_core:
        for claim in CLAIMS[1:]:
            case.fail(claim, NO_CORE)
        return
    check_after_core(case)
    waits_for_all = case.problem.computed  # P2b, for the sets of all cases
    if not (waits_for_all or case.problem.stays or postpone_p2b(case)):
        _examine_return(case, find_way_back)


def _examine_return(case: Case, way_back: Callable[[Case], None]) -> None:
    """Examines P2b; if K loses cells for it, examines all claims that depend on K again."""
    with ClaimTimer(case, "P2b"):
        way_back(case)
    if shrink_core(case):
        check_after_core(case)
        check_return_time(case)


def _enter_verdicts(result: ModuleResult, done: list[Case], unentered: str) -> None:
    """Enters all findings except the one on the DM; `unentered` says why `enters` is not shown."""
    problem, findings = result.problem, result.findings
    enter_static_claims(problem, result)
    findings |= {claim: _finding_on_claim(problem, done, claim) for claim in CLAIMS}
    findings["P3"] = _p3_finding(result, sum(c.spent.get("P3", 0.0) for c in done))
    if "scheme" in result.assumed and (diverges := why_scheme_diverges(problem)):
        _weaken_if_proved(findings["P2a"], diverges, STIFF_HINT)
    for claim in ("P2a", "P3") if unentered else ():
        _weaken_if_proved(findings[claim], unentered, NOT_ENTERED)
    weaken_if_waiting(problem, findings["P2b"])
    findings["failsafe"] = _failsafe_finding(problem, result, done)
    if findings["failsafe"].verdict == PROVED:
        result.laws = [c.lawful.law for c in done if c.lawful and c.lawful.law]
        result.added += (_lease_assumption(problem),)


def _dm_finding(result: ModuleResult) -> Finding:
    """The finding that the generated C of the DM decides as declared."""
    from soter.verify.deploy.dm_check import check_module  # noqa: PLC0415 - compiles the DM

    began = time.perf_counter()
    check = check_module(result)
    return Finding(check.verdict, time.perf_counter() - began, HOW["DM"], check.summary)


def _prelude_assumptions(functions: tuple[str, ...]) -> list[Assumption]:
    text = "error bounds of the prelude's functions: tested, not proved"
    return [Assumption("prelude enclosed", text)] * bool(functions)


def _simultaneity_assumptions(problem: Problem, done: list[Case]) -> list[Assumption]:
    """The assumptions that all commands that move a group begin to act at the same instant."""
    if problem.times.jitter_sc == 0:
        return []
    assumptions = []
    for proof in (p for case in done for p in case.proofs):
        if proof.simultaneous_controls:
            names = ", ".join(
                problem.quantities.controls[k].name for k in proof.simultaneous_controls
            )
            assumptions.append(Assumption(f"together {names}", in_words("together", names)))
    return assumptions


def _hand_over_assumptions(problem: Problem, done: list[Case]) -> tuple[Mapping[str, str], str]:
    """The proofs, in words, of shown assumptions about `enters`, by key; or why none is shown.

    If they are not shown, the module is undecided. No single case shows them, because `enters` must
    imply R(H) in all cases.
    """
    entered, why = problem.jumps.entered, problem.jumps.unkept
    if entered and not why:
        open_ = next(filter(None, map(why_not_entered, done)), "")
        why = f"nothing shows that `enters` implies R(H): {open_}" if open_ else ""
    return ({} if why else entered), why


def _weaken_if_proved(finding: Finding, why: str, hint: str) -> None:
    """Makes a proved finding undecided for the reason `why`; any other finding stays as it was."""
    if finding.verdict == PROVED:
        finding.weaken_to(UNDECIDED, why, hint)


def _lease_assumption(problem: Problem) -> Assumption:
    return Assumption("lease", in_words("lease", show_ns(problem.times.acts)))


def _failsafe_finding(problem: Problem, result: ModuleResult, done: list[Case]) -> Finding:
    """The finding that the fail-safe law keeps C once the lease has ended."""
    if problem.law is None and not problem.law_unread:
        return Finding(ASSUMED, method=HOW["failsafe"], text=NO_LAW)
    lawful = [c.lawful for c in done if c.lawful is not None]
    why = next(filter(None, (x.why for x in lawful)), problem.law_unread)
    if why or len(lawful) < len(done) or not all(c.proofs for c in done):
        hint = NOT_FOR_LAWS if problem.law_unread else hint_for_law(why)
        return Finding(UNDECIDED, method=HOW["failsafe"], text=why or NO_CORE, hint=hint)
    open_ = [n for n in RESTS_ON if not result.findings[n].holds]
    if open_:
        text = f"the law keeps K, and nothing says that it begins there: {', '.join(open_)}"
        return Finding(UNDECIDED, method=HOW["failsafe"], text=text)
    return Finding(PROVED, method=HOW["failsafe"], text=_law_in_words(problem, lawful))


def _law_in_words(problem: Problem, lawful: list[FailsafeClaim]) -> str:
    kept, of = (sum(x.cells[k] for x in lawful) for k in (0, 1))
    lease = show_ns(problem.times.lease_ns)
    text = f"the law keeps C from K_fs: {kept:,} of {of:,} cells; K lies in it; "
    return f"{text}each lease ends at most {lease} after its release"


def _finding_on_claim(problem: Problem, done: list[Case], claim: str) -> Finding:
    if claim == "P2b" and problem.stays:  # nobody has to give control back, K or no K
        return Finding(ASSUMED, text=STAYS.format(problem.module.symbol.stay_clause))
    finding = Finding(PROVED, method=HOW_ON_GRIDS[claim])
    finding.seconds = sum(c.spent.get(claim, 0.0) for c in done)
    names = [p.name for p in problem.parameters]
    for case in done:
        for failure in case.failures_of(claim):
            finding.weaken_to(UNDECIDED)
            finding.text = finding.text or failure.text
            finding.hint = finding.hint or failure.hint
            if failure.cells is not None and failure.proof is not None:
                parameters = list(zip(names, case.parameter, strict=True))
                finding.regions += failure.proof.boxes_around(failure.cells, parameters)
            if failure.where is not None:
                finding.regions.append(failure.where)
    if not finding.text:
        finding.text = _proved_text(problem, done, claim, finding)
    return finding


def _proved_text(problem: Problem, done: list[Case], claim: str, finding: Finding) -> str:
    many = f" for each of {len(done)} parameter values" if len(done) > 1 else ""
    if claim == "P2a":
        text, finding.counts = proved_in_words(done, claim)
        return f"SC keeps C from K: {text}{many}"
    if claim in ("ttf", "safer"):
        if problem.computed:
            return f"`{claim}` is computed from the sets{many}"
        premise = {"ttf": "not ttf", "safer": "safer"}[claim]
        where, finding.counts = proved_in_words(done, claim)
        nothing = "" if any(finding.counts.values()) else OF_NOTHING
        return f"{nothing}{premise} implies R(H), {where}{many}"
    if claim == "P2b":
        seconds = max((c.counts.get("recover_ns", 0) for c in done), default=0)
        if problem.module.symbol.acknowledgements:
            many += ", if it is acknowledged"
        if problem.times.acts > problem.module.period_ns:
            many = f" after a command of it acts first{many}"
        return f"SC gives control back within {show_ns(seconds)}{many}"
    return f"initial states lie in R({show_ns(problem.times.start)})"


def _p3_finding(result: ModuleResult, seconds: float) -> Finding:
    """The finding on P3, which holds if both `ttf` and `safer` are proved."""
    ttf, safer = result.findings["ttf"], result.findings["safer"]
    bad = next((f for f in (ttf, safer) if f.verdict != PROVED), None)
    times = result.problem.times
    text = f"whatever AC publishes for {show_ns(times.horizon_ns)}, the state stays in K"
    finding = Finding(PROVED, seconds + ttf.seconds + safer.seconds, HOW["P3"], text)
    if bad is not None:
        finding.weaken_to(bad.verdict, bad.text, bad.hint)
        finding.regions = list(bad.regions)
    return finding


def _return_time_s(done: list[Case], result: ModuleResult) -> float | None:
    if result.findings["P2b"].verdict != PROVED:
        return None
    return max((c.counts.get("recover_ns", 0) for c in done), default=0) / 1e9


def _least_shares(done: list[Case]) -> dict[str, float]:
    """The share of each set, by name: the product over groups, and the least of all cases."""
    shares_by_name: dict[str, list[float]] = {}
    for case in done:
        one: dict[str, float] = {}
        for proof in case.proofs:
            for name, value in proof.volume_shares(case).items():
                one[name] = one.get(name, 1.0) * value
        for name, value in one.items():
            shares_by_name.setdefault(name, []).append(value)
    return {name: min(values) for name, values in shares_by_name.items()}


def _cases_of_changed_problem(problem: Problem) -> list[Case]:
    """The cases of a changed problem, verified as if the program declared this problem."""
    library, _ = library_of(problem)
    return choose_cells_and_levels(problem, lambda p: _cases_of_problem(p, library)).done or []


@dataclass(frozen=True)
class ModuleMethod:
    """The functions of one proof method, for the method's problems and results."""

    verify: Callable[..., ModuleResult]
    """Takes (problem, refute=, explain=, search=, compiled=); gives verdicts of all properties."""
    entry: Callable[[Any, str, str, dict[str, bytes]], dict[str, object]]
    """Takes (result, system, stem of its files, files); gives the module's entry in a manifest."""
    covers: Callable[[System, System, Any, Diagnostics], tuple[list[str], list[str]]]
    """Takes (deployed system, proved one, problem, diagnostics); gives what is covered, assumed."""
    compiled: Callable[[Problem], object] | None = None
    """Compiles the value that `verify` takes as `compiled`, and makes itself if that is None."""


SETS = ModuleMethod(verify_module, module_entry, deployed_sensors.check_sensors, library_of)
METHODS: dict[ProblemKind, ModuleMethod] = {
    "flow": SETS,
    "map": SETS,
    "nodes": ModuleMethod(
        verify_by_induction, induction.certificate_entry, induction.covered_inputs
    ),
    "tubes": ModuleMethod(verify_by_tubes, tubes_entry, deployed_sensors.check_sensors),
}


def module_method(problem: Problem) -> ModuleMethod:
    """The method that proves the module of a problem."""
    return METHODS[problem.kind]
