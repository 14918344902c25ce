"""The claims of a certificate of an induction, each checked again.

Purpose: `recheck_induction` has z3 show that everything claimed holds in the first k hyperperiods
of every run, and after k in which it held; and that no execution stays in SC for as long as P2b
says. No search: k is the certificate's.
Non-goals: reading the program, executions (`induction_problem.py`, `solver_steps.py`).
"""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any

import z3

from soter.certificate.case_check import (
    CLAIMS,
    PROVED,
    check_module_claims,
    proved_claims,
)
from soter.certificate.induction.induction_problem import (
    TransitionSystem,
    actors_due,
    compare_entry,
    modes_of_others,
    read_induction,
)
from soter.certificate.induction.solver_values import and_of, negation, or_of
from soter.certificate.report import (
    GETS,
    KEEPS,
    NotRecheckedError,
    RecheckAssumption,
    RecheckedModule,
    RejectedError,
)
from soter.certificate.scope import acknowledgement_assumption, fitted_number_assumptions
from soter.certificate.vacuous_proofs import HOLDS_ANYWAY, READS_NOTHING
from soter.language.check.constants_and_types import declared_ns
from soter.language.evaluate.topic_ranges import truth_by_parts
from soter.language.model.assumption_words import in_words
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import show_ns
from soter.workers.interruptible_solver import ask_solver, ctrl_c_waits

if TYPE_CHECKING:
    from soter.certificate.induction.induction_problem import InductionFacts, Instant
    from soter.language.model.system import System

KEYS = ("system", "module", "claims", "recover_ns", "induction")
TOGETHER = ("P2a", "P3", "ttf", "safer", "start")
WORK = 600_000_000
"""The most for one query, in the solver's own units; a free core takes two minutes or so."""
WORK_OF_ALL = 3 * WORK
"""The most for all queries about a module."""
PATIENCE_MS = 900_000
RELEASES_MAX = 50_000
"""Releases in an execution that is followed, at most."""


@ctrl_c_waits()
def recheck_induction(
    flat: System, entry: dict[str, Any]
) -> tuple[InductionFacts, RecheckedModule]:
    """Checks a module's entry; raises RejectedError or NotRecheckedError if it is not confirmed."""
    if set(entry) != set(KEYS):
        raise RejectedError("a module that is proved by induction is not as it should be")
    facts = read_induction(flat, entry["module"])
    claims = proved_claims(entry["claims"])
    if "failsafe" in claims:
        raise RejectedError("failsafe: an induction says nothing of plants, so of no law")
    k, returns = compare_entry(facts, entry["induction"])
    verdicts = dict(entry["claims"])
    _check_static_claims(facts, verdicts)
    if wanted := claims & set(TOGETHER):
        if k < 1:
            raise RejectedError("an induction needs a hypothesis: k is 0")
        rests_on = _show_induction(facts, k)
    conditional = facts.latching or bool(facts.symbol.verify.progress)
    if "P2b" in claims and conditional:
        raise RejectedError("P2b rests on what nobody proves: it is assumed, not proved")
    if "P2b" in claims:
        _show_return_in_time(facts, returns, entry["recover_ns"])
    report = RecheckedModule(entry["module"], verdicts, system=flat.name)
    report.stays = bool(facts.symbol.stay_clause)
    report.safe = facts.symbol.safe.span.text_on_one_line
    report.assumptions = _assumptions_of_induction(facts)
    report.times = {"hyperperiod_ns": facts.hyperperiod, "k": k, "returns": returns}
    report.confirmed = [c for c in CLAIMS if verdicts.get(c) == PROVED]
    report.vacuous, report.unseen = "", "nothing is claimed"
    if wanted:
        report.vacuous, report.unseen = _why_vacuous(facts, rests_on)
    return facts, report


def read_entry(flat: System, entry: dict[str, Any]) -> None:
    """Reads code and times like `recheck_induction`, raises the same errors, asks no solver."""
    facts = read_induction(flat, entry["module"])
    k, _ = compare_entry(facts, entry["induction"])
    _require_affordable(facts, k + 1)
    for first in (True, False):
        TransitionSystem(facts, first=first).run_until(facts.hyperperiod + 1)


def _check_static_claims(facts: InductionFacts, verdicts: dict[str, str]) -> None:
    check_module_claims(facts.flying, facts.flying_module, verdicts)
    if verdicts.get("P1c") == PROVED and facts.undeclared:
        raise RejectedError("P1c rests on times that are not declared: it is assumed, not proved")


def _show_induction(facts: InductionFacts, k: int) -> int:
    """Shows each instant of a hyperperiod from the instants before it, then the start of a run.

    Returns how many hyperperiods of hypothesis suffice, at most k.
    """
    _require_affordable(facts, k + 1)
    times = sorted(actors_due(facts, (k + 1) * facts.hyperperiod))
    late = [at for at in times if at >= k * facts.hyperperiod]
    rests_on = max(_ns_of_hypothesis(facts, at, times) for at in late)
    run = TransitionSystem(facts, first=True)
    run.run_until(facts.settled_at + min(rests_on, k * facts.hyperperiod))
    _require_unsat(_ask_for_failure(facts, _solver_of(run), run.instants), "the first hyperperiods")
    return min(-(-rests_on // facts.hyperperiod), k)


def _require_affordable(facts: InductionFacts, turns: int) -> None:
    """Raises NotRecheckedError if so many hyperperiods have more than `RELEASES_MAX` releases."""
    longest = max(c.phase_ns + c.period_ns for c in facts.actors)
    end = turns * facts.hyperperiod + 2 * longest
    count = sum(end // c.period_ns for c in facts.actors)
    if count > RELEASES_MAX:
        raise NotRecheckedError(
            f"{count:,} releases in {turns} hyperperiods: more than are gone through"
        )


def _ns_of_hypothesis(facts: InductionFacts, at: int, times: list[int]) -> int:
    """For how long (ns) all must have held before an instant so that all holds then, too.

    It tries few instants first, from any state: if few suffice, then more suffice, too.
    """
    before = [0, *(b for b in times if 0 < b < at)]
    many = 1
    while True:
        begin = before[max(len(before) - many, 0)]
        run = TransitionSystem(facts, first=False, begin=begin)
        run.run_until(at + 1)
        last = begin == 0
        solver = _solver_of(run)
        solver.add(*[i.holds for i in run.instants[:-1]])
        answer = _ask_for_failure(facts, solver, run.instants[-1:], WORK if last else WORK // 10)
        if last:
            _require_unsat(answer, "the induction")
        if last or answer == z3.unsat:
            return at - begin
        many *= 2


def _ask_for_failure(
    facts: InductionFacts, solver: z3.Solver, instants: list[Instant], work: int = WORK
) -> z3.CheckSatResult:
    solver.add(or_of(*[negation(and_of(i.holds, i.always)) for i in instants]))
    return _ask_solver(facts, solver, work)


def _ask_solver(facts: InductionFacts, solver: z3.Solver, work: int) -> z3.CheckSatResult:
    """Asks the solver, with a limit of `work`; all queries together may use `WORK_OF_ALL`."""
    if facts.work >= WORK_OF_ALL:
        raise NotRecheckedError("the solver needs more work than is done")
    before = _work_of_solvers(solver)
    solver.set("rlimit", min(work, WORK_OF_ALL - facts.work))
    verdict = ask_solver(solver)
    facts.work += max(_work_of_solvers(solver) - before, 0)
    return verdict


def _work_of_solvers(solver: z3.Solver) -> int:
    """The total work of all solvers of this process, in the solver's unit."""
    count: int = dict(iter(solver.statistics())).get("rlimit count", 0)
    return count


def _show_return_in_time(facts: InductionFacts, turns: int, recover_ns: object) -> None:
    if turns < 1 or (recover_ns is not None and recover_ns != (turns + 1) * facts.hyperperiod):
        raise RejectedError("P2b: no time within which SC gives control back")
    declared = facts.symbol.verify.recover
    if declared is not None and (turns + 1) * facts.hyperperiod > declared_ns(
        facts.flying_module, declared
    ):
        raise RejectedError("P2b: SC gives control back later than `recover within` says")
    _require_affordable(facts, turns)
    run = TransitionSystem(facts, first=False, fresh=True)
    run.run_until(turns * facts.hyperperiod)
    solver = _solver_of(run)
    solver.add(*[i.holds for i in run.instants])
    solver.add(*[or_of(negation(d.turn), d.stays) for d in run.decisions])
    _require_unsat(_ask_solver(facts, solver, WORK), "P2b")


def _why_vacuous(facts: InductionFacts, k: int) -> tuple[str, str]:
    """Two texts: why no decision lets AC get or keep control, and why that was not checked.

    Each text is "" if it does not apply. As everything holds at every instant, each decision of a
    run is in the first hyperperiods or comes after k others.
    """
    if not topic_reads(facts.symbol.safe):
        return READS_NOTHING, ""
    if truth_by_parts(facts.symbol.safe, facts.flying, facts.flying_module.scope):
        return HOLDS_ANYWAY, ""
    last = max(c.phase_ns + c.period_ns for c in facts.actors)
    ends = (
        (False, (k + 1) * facts.hyperperiod),
        (True, facts.settled_at + k * facts.hyperperiod + last),
    )
    for text, kind in ((GETS, attrgetter("gets")), (KEEPS, attrgetter("keeps"))):
        answers = set()
        for first, end in ends:
            run = TransitionSystem(facts, first=first)
            run.run_until(end)
            solver = _solver_of(run)
            solver.add(*[i.holds for i in run.instants[:-1]])
            since = 0 if first else k * facts.hyperperiod
            solver.add(or_of(*[and_of(d.turn, kind(d)) for d in run.decisions if d.at >= since]))
            answers.add(str(_ask_solver(facts, solver, WORK // 10)))
            if "sat" in answers:
                break
        if answers == {"unsat"}:
            return f"{text} (at no decision of any run)", ""
        if "sat" not in answers:
            return "", "the solver does not decide whether AC ever has control"
    return "", ""


def _solver_of(run: TransitionSystem) -> z3.Solver:
    solver = z3.Solver()
    solver.set("timeout", PATIENCE_MS)
    solver.add(*run.constraints)
    return solver


def _require_unsat(answer: z3.CheckSatResult, claim: str) -> None:
    if answer == z3.sat:
        raise RejectedError(f"{claim}: something fails in an execution")
    if answer != z3.unsat:
        raise NotRecheckedError(f"{claim}: the solver does not decide it")


def _assumptions_of_induction(facts: InductionFacts) -> list[RecheckAssumption]:
    flying, module = facts.flying, facts.flying_module
    ac = flying.components[module.ac].name
    stated = [
        (f"any {ac}", in_words("ac", ac)),
        ("order", "steps of one instant come in any order; no release is skipped"),
        *((key, in_words(key)) for key in ("fresh", "z3", "machine")),
    ]
    stated += acknowledgement_assumption(facts.symbol)
    stated += fitted_number_assumptions(facts)
    if facts.latching:
        text = (
            "a step that faults in what is opaque latches its node: `safe` holds all the same, "
            "and nothing says that AC gets control back then"
        )
        stated.append(("latching", text))
    stated += [
        (f"mode {name}", f"mode({name}): SC or AC, anew at every step that reads it")
        for name in modes_of_others(facts)
    ]
    if facts.undeclared:
        stated.append(("undeclared", "undeclared times are zero: nobody is late, or takes time"))
    for c in facts.actors:
        text = f"{c.name} steps every {show_ns(c.period_ns)}, from {show_ns(c.phase_ns)} on"
        stated.append((f"released {c.name}", text))
    return [RecheckAssumption(key, text) for key, text in stated]
