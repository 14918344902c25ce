"""Gives the verdicts on a module that is proved by induction, and its certificate entry.

Purpose: `verify_by_induction` turns the result of an induction into findings, one a property, with
a refutation where a run was found, and with the assumptions that only this proof makes.
`certificate_entry` writes the depth of the induction and the times of its nodes for `soter recheck`
(docs/verification.md, section 4). `covered_inputs` says what a deployed system has to give.
Non-goals: the induction (`prove_or_refute.py`), checking a certificate, deciding which proofs hold
for a deployed system (`deploy/proof_transfer.py`).

A proof by induction needs nothing of what comes from outside: a topic that none of its nodes
publishes may hold any value of its set, of any age; other values are refused when published.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.wellformed import allowed_lateness, topics_from_outside
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import show_ns
from soter.verify.claims.product_sets import NO_LAW
from soter.verify.claims.results import (
    ASSUMED,
    PROPERTIES,
    PROVED,
    REFUTED,
    STAYS,
    UNCLAIMED,
    UNDECIDED,
    Finding,
    ModuleResult,
)
from soter.verify.diagnosis.vacuity import mention_vacuity_in_claim, vacuity_of_nodes
from soter.verify.induction.prove_or_refute import prove_by_induction, refuting_run
from soter.verify.problem.problem import Assumption, subjects_in_words

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import System
    from soter.verify.induction.problem import InductionProblem
    from soter.verify.induction.prove_or_refute import Induction, Search


def covered_inputs(
    deployed: System, proved: System, problem: InductionProblem, diagnostics: Diagnostics
) -> tuple[list[str], list[str]]:
    """The inputs from outside that the proof covers, and assumptions on the loop, in words."""
    del proved, diagnostics
    names = [deployed.topics[e.topic].name for e in topics_from_outside(deployed)]
    free = [f"{n}: any value of its set, of any age" for n in names if n in problem.any_value]
    judged = {deployed.components[i].name for i in allowed_lateness(deployed)}
    nodes = [c.name for c in problem.system.components if c.role == "node"]
    untold = ", ".join(n for n in nodes if n not in judged)
    return free, [f"{untold}: in time, which SOTER_LATE does not tell"] if untold else []


def certificate_entry(
    result: InductionResult, system: str, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """The module's entry in the manifest of a certificate; it adds no files."""
    del stem, files
    problem, induction = result.problem, result.induction
    claims = {n: f.verdict for n, f in result.findings.items() if n not in UNCLAIMED}
    claims.pop("failsafe", None)  # of plants, and nothing is proved of it here
    returns = induction.returns if claims.get("P2b") == PROVED else 0
    declared = problem.recover_ns is not None and returns
    return {
        "system": system,
        "module": problem.name,
        "claims": claims,
        "recover_ns": induction.returns_ns if declared else None,
        "induction": {
            "k": induction.k,
            "returns": returns,
            "hyperperiod_ns": induction.hyperperiod_ns,
            "lemmas": list(problem.lemma_texts),
            "progress": list(problem.progress_texts),
            "latching": bool(induction.latching),
            "clocks": {
                problem.system.components[c.component].name: [c.period, c.phase, c.late, c.response]
                for c in problem.declared
            },
        },
    }


HOW = "k-induction over every schedule"
TOGETHER = ("P3", "ttf", "safer", "start")
"""Properties that share the verdict of the induction on `safe`."""
TEXTS = {
    "P3": "whatever AC publishes, `safe` holds until the DM and SC have answered",
    "ttf": "whenever the DM leaves AC in control, `safe` goes on holding",
    "safer": "whenever the DM gives AC control, `safe` goes on holding",
    "start": "the first hyperperiods of every run, from the declared first values",
}


UNTRIED = (typed.AgeRead, typed.ModeRead)
"""Kinds of reads for which the check of the compiled DM has no values to try."""


class InductionResult(ModuleResult):
    """The result for a module proved by induction, together with the induction."""

    problem: InductionProblem
    induction: Induction


def verify_by_induction(
    problem: InductionProblem,
    *,
    refute: bool = True,
    explain: bool | None = None,
    search: Search | None = None,
    compiled: object = None,
) -> InductionResult:
    """Verifies one module by induction; raises `SoterError` D007 if the solver is not installed.

    `search` looks for a run that refutes, unless it is None or `refute` is false. `explain` and
    `compiled` are not used; they are parameters because every method takes them.
    """
    del explain, compiled
    began = time.perf_counter()
    induction = prove_by_induction(problem)
    result = InductionResult(problem, {}, [])
    result.induction = induction
    findings = result.findings
    _enter_period_claims(problem, findings)
    findings["P2a"] = _safe_finding(problem, induction)
    findings["P2b"] = _return_finding(problem, induction)
    result.added = (*_return_assumptions(problem, induction),)
    for name in TOGETHER:
        findings[name] = _finding_from_safe(name, findings["P2a"])
    if induction.proved and findings["P2b"].verdict == PROVED:
        result.recover_s = induction.returns_ns / 1e9
    elif (
        not induction.proved
        and refute
        and search is not None
        and induction.about in ("safe", "fault")
        and induction.fails_ns is not None
    ):
        _enter_refuting_run(problem, induction, findings, search)
    findings["failsafe"] = _failsafe_finding(problem)
    findings["DM"] = _finding_on_dm(result)
    result.findings = {p: findings[p] for p in PROPERTIES}
    result.vacuity = vacuity_of_nodes(problem, induction.never)
    mention_vacuity_in_claim(result)
    if induction.uninterpreted:
        names = ", ".join(induction.uninterpreted)
        result.notes = (f"opaque (of equal arguments equal answers, and nothing else): {names}",)
    result.seconds = time.perf_counter() - began
    return result


def _failsafe_finding(problem: InductionProblem) -> Finding:
    """The finding on a fail-safe law; induction shows nothing about a law, which acts on plants."""
    if not problem.module.law:
        return Finding(ASSUMED, text=NO_LAW)
    text = "a fail-safe law acts on plants, of which a proof by induction says nothing"
    return Finding(UNDECIDED, text=text, hint="leave the law out, or prove it with a grid")


def _enter_period_claims(problem: InductionProblem, findings: dict[str, Finding]) -> None:
    times = problem.times
    findings["P1a"] = Finding(
        PROVED,
        method="periods compared",
        text=f"SC every {show_ns(times.delta_sc)}, DM every {show_ns(times.delta_dm)}",
    )
    findings["P1b"] = Finding(
        PROVED, method="outputs compared", text="AC and SC publish the same topics"
    )
    findings["P1c"] = Finding(
        ASSUMED if problem.undeclared else PROVED,
        method="every schedule is in the relation",
        text="every order of steps that periods, phases, lateness and responses allow",
    )


def _safe_finding(problem: InductionProblem, induction: Induction) -> Finding:
    verdict = PROVED if induction.proved else UNDECIDED
    finding = Finding(verdict, induction.seconds - induction.returns_s, HOW)
    finding.counts = {"k": induction.k, "steps": induction.steps, "lemmas": len(problem.lemmas)}
    if induction.proved:
        many = len(problem.lemmas)
        lemmas = "" if not many else f", with {many} lemma{'s' if many > 1 else ''}"
        plural = "s" if induction.k > 1 else ""
        finding.text = (
            f"induction over {induction.k} hyperperiod{plural} of "
            f"{show_ns(induction.hyperperiod_ns)} "
            f"({induction.steps} steps each){lemmas}"
        )
        return finding
    if induction.fails_ns is not None:
        within = show_ns(induction.fails_ns)
        how = "" if induction.about == "fault" else " fails"
        finding.text = f"{induction.failure}{how} within {within} in a run of the relation"
        if induction.undecided:
            finding.text += f"; taken for granted that it latches then: {induction.undecided}"
        finding.hint = {
            "lemma": "a lemma is proved together with `safe`: mend it, or leave it out",
            "fault": "show that the step cannot fault: bounded types, a check before it",
        }.get(induction.about, "a longer threshold, a faster DM or SC")
        return finding
    finding.text = induction.why
    finding.hint = "say as a `lemma` what else is always true: of a candidate, its age, the mode"
    return finding


def _return_finding(problem: InductionProblem, induction: Induction) -> Finding:
    returned = induction.proved and bool(induction.returns)
    symbol = problem.module.symbol
    if symbol.stay_clause == "returns never" or (symbol.stay_clause and not returned):
        return Finding(ASSUMED, induction.returns_s, HOW, STAYS.format(symbol.stay_clause))
    finding = Finding(PROVED if returned else UNDECIDED, induction.returns_s, HOW)
    finding.text = "there is no proof that `safe` is kept"
    if returned:
        finding.text = f"SC gives control back within {show_ns(induction.returns_ns)}"
        finding.text += ", if it is acknowledged" if symbol.acknowledgements else ""
        if granted := [*_return_conditions(problem, induction)]:
            text = f"{finding.text} while {_joined_names(granted, 'and')}: not proved"
            finding.weaken_to(ASSUMED, text)
        if problem.modes is not None and problem.modes.never:
            hint = "let one of them give control back whatever the other one does"
            finding.weaken_to(UNDECIDED, problem.modes.never, hint)
    elif induction.contradicted:
        grounds = "what the DM reads is fresh" + ", and `progress` holds" * bool(problem.progress)
        finding.text = f"what it takes for granted holds in no run for so long: {grounds}"
        finding.hint = "a `max_age` of what the DM reads that its publisher keeps"
        if problem.progress:
            finding.hint = "say what always holds: at the start, too, and of topics' defaults"
    elif induction.proved:
        finding.text = "not proved: from some state that nothing excludes SC keeps control"
        finding.hint = "a lemma that excludes it, or a `safer` that SC reaches"
        if problem.recover_ns is not None:
            finding.hint = f"longer than `recover within` {show_ns(problem.recover_ns)}"
    return finding


def _return_conditions(problem: InductionProblem, induction: Induction) -> Iterator[str]:
    """The conditions under which SC gives control back, as clauses of a sentence."""
    if problem.progress:
        yield "`progress` holds"
    if constant := sorted(problem.system.topics[i].name for i in problem.heard):
        yield f"{_joined_names(constant, 'and')} stays as it is"
    if problem.modes is not None and problem.modes.waits:
        yield f"{subjects_in_words(problem.modes.waits)} in AC"
    if induction.latching:
        yield f"no step of {_joined_names(induction.latching, 'or')} faults"


def _return_assumptions(problem: InductionProblem, induction: Induction) -> Iterator[Assumption]:
    """The unproved assumptions that only P2b needs, and not the proof of `safe`."""
    for text in problem.progress_texts:
        yield Assumption("progress", f"progress, for P2b alone, proved by nobody: `{text}`")
    if induction.proved and induction.latching:
        yield Assumption(
            "no faults",
            f"for P2b alone: no step of {_joined_names(induction.latching, 'or')} faults, which "
            "nothing shows of what is opaque; one that faults is latched, and `safe` holds all the "
            "same",
        )


def _joined_names(names: Sequence[str], word: str) -> str:
    *most, last = names
    return f"{', '.join(most)} {word} {last}" if most else last


def _finding_from_safe(name: str, safe: Finding) -> Finding:
    text = TEXTS[name] if safe.verdict == PROVED else safe.text
    return Finding(safe.verdict, 0.0, HOW, text, safe.hint)


def _enter_refuting_run(
    problem: InductionProblem, induction: Induction, findings: dict[str, Finding], search: Search
) -> None:
    began = time.perf_counter()
    assert induction.fails_ns is not None
    run = refuting_run(problem, induction.fails_ns, search, fault=induction.about == "fault")
    for name in ("P2a", "P3"):
        finding = findings[name]
        if run is None:
            finding.hint += " (no run of the program was found that shows it)"
            continue
        finding.weaken_to(REFUTED, f"a run violates {induction.failure} at {show_ns(run.time_ns)}")
        finding.method = "a run, replayed in the interpreter"
        finding.counterexample = run
    findings["P2a"].seconds += time.perf_counter() - began


def _finding_on_dm(result: ModuleResult) -> Finding:
    """The finding that the generated C of the DM decides as declared, on the inputs tried."""
    from soter.verify.deploy.dm_check import check_module  # noqa: PLC0415 - compiles the DM

    began = time.perf_counter()
    how = "the compiled DM on all facts, and tried on every class of input"
    symbol = result.problem.module.symbol
    read = nodes([e for e in (symbol.ttf, symbol.safer) if e is not None])
    if any(isinstance(n, UNTRIED) for n in read):
        return Finding(ASSUMED, 0.0, how, "not tried: `ttf` or `safer` reads an age, or a mode")
    try:
        check = check_module(result)
    except (SoterError, NotImplementedError) as error:
        return Finding(ASSUMED, time.perf_counter() - began, how, f"not tried: {error}")
    return Finding(check.verdict, time.perf_counter() - began, how, check.summary)
