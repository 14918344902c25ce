"""Refutations among the verdicts: a run that was found decides what was undecided.

Purpose: call the falsifier for what is not proved, and enter what it found.
Non-goals: finding runs (`refute.py`).
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from soter.language.elaborate.derived_systems import unlatched
from soter.verify.attack.refute import refute, refute_return
from soter.verify.claims.results import NO_CORE, PROVED, REFUTED, UNDECIDED

if TYPE_CHECKING:
    from soter.verify.attack.counterexample import Counterexample
    from soter.verify.attack.refute import RefutationSearch
    from soter.verify.claims.results import Finding, ModuleResult
    from soter.verify.problem.problem import Problem

SAFETY = ("P2a", "P3", "ttf", "safer", "start", "P1c")


def refuted(problem: Problem, result: ModuleResult) -> None:
    """Enter counterexamples for what is undecided."""
    findings = result.findings
    if problem.synthesize or problem.computed:
        return  # the DM or SC that would run is not there yet
    if any(findings[p].verdict == UNDECIDED for p in SAFETY):
        began = time.perf_counter()
        search = refute(problem.system, problem.module.name)
        if search.found is not None:
            for name in _blamed(findings, search.found):
                _enter(findings[name], search.found, time.perf_counter() - began)
        else:
            _tell(findings, SAFETY, search)
    if findings["P2b"].verdict == UNDECIDED:
        began = time.perf_counter()
        search = refute_return(unlatched(problem.system), problem.module.name)
        if search.found is not None:
            _enter(findings["P2b"], search.found, time.perf_counter() - began)
        else:
            _tell(findings, ("P2b",), search)


def _blamed(findings: dict[str, Finding], run: Counterexample) -> list[str]:
    """Which properties a run that leaves C refutes.

    By the theorem one of those that are not proved is false. Where SC has control at the end that
    is P2a if it is among them; otherwise AC had control too long: P3.
    """
    open_ = [p for p in SAFETY if findings[p].verdict == UNDECIDED]
    last = [step["modes"].get(run.module) for step in run.steps[-1:]]
    if "P2a" in open_ and (last == ["SC"] or findings["P3"].verdict == PROVED):
        return ["P2a"]
    if "P3" in open_:
        return [p for p in ("P3", "ttf") if p in open_]
    return open_[:1]


def _enter(finding: Finding, run: Counterexample, seconds: float) -> None:
    finding.seconds += seconds
    finding.method = "a run, replayed in the interpreter"
    end = f"{run.time_ns / 1e9:g} s"
    finding.rest_on(
        REFUTED,
        f"a run leaves C at {end}"
        if run.shows == "leaves_safe"
        else f"a run on which SC has control for ever (it repeats itself from {end})",
    )
    finding.counterexample = run


def _tell(findings: dict[str, Finding], names: tuple[str, ...], search: RefutationSearch) -> None:
    """What was tried in vain."""
    note = search.hindrance or f"{search.runs:,} runs under attack found nothing"
    for name in names:
        finding = findings[name]
        if finding.verdict == UNDECIDED:
            finding.counts["runs"] = search.runs
            if finding.text != NO_CORE:  # that is P2a's to say
                finding.tried.append(note)
