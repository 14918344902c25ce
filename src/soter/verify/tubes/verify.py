"""The verdicts on a module whose DM decides by tubes, and its entry in a certificate.

Purpose: `verify_by_tubes` turns the claims shown offline into a finding for each property. The
decisions in flight are never called proved: it is *assumed* that the compiled check is sound
(docs/proof-flight.md, "Decisions by tubes", condition 5). `certificate_entry` writes the claims
about the module, and the constants of its check.
Non-goals: showing the claims (`rest_claims.py`), checking a certificate (`certificate/tubes/`).
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import help_texts
from soter.language.elaborate.lints.rest_lints import doubt_about_rest
from soter.language.model.types import show_ns
from soter.verify.claims.claims import enter_static_claims
from soter.verify.claims.product_sets import NO_LAW
from soter.verify.claims.results import (
    ASSUMED,
    PROPERTIES,
    PROVED,
    STAYS,
    UNCLAIMED,
    UNDECIDED,
    Finding,
    ModuleResult,
)
from soter.verify.deploy.missing_predicates import rest_claims
from soter.verify.diagnosis.vacuity import mention_vacuity_in_claim, vacuity_of_rest
from soter.verify.diagnosis.variations import problem_with_younger_sc_reads
from soter.verify.problem.problem import Assumption
from soter.verify.proof_methods import figures_entry
from soter.verify.tubes.noise_estimate import noise_estimate
from soter.verify.tubes.problem import FARTHEST, TubeProblem, is_far
from soter.verify.tubes.rest_claims import rest_entry
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.turns import FARTHEST_TURN

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.verify.tubes.rest_claims import RestClaims


def certificate_entry(
    result: TubeResult, system: str, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """The module's entry in the manifest of a certificate; adds nothing to `files`."""
    del stem, files
    verdicts = {n: f.verdict for n, f in result.findings.items() if n not in UNCLAIMED}
    verdicts.pop("failsafe", None)  # none is declared: there is nothing to be claimed
    head = {"system": system, "module": result.problem.name, "claims": verdicts, "recover_ns": None}
    if not result.plans:
        return head | _entry_of_plan(result)
    return head | {"plans": {r.problem.plan: _entry_of_plan(r) for r in result.plans}}


def _entry_of_plan(result: TubeResult) -> dict[str, object]:
    """The part of an entry for one plan, or for the only plan of a module."""
    problem = result.problem
    return {
        "plants": [c.name for c in problem.system.components if c.role == "plant"],
        **figures_entry(problem),
        "rest": rest_entry(result.check, result.claims),
    }


HOW = "SC followed by tubes"
IN_FLIGHT = (
    "decided in flight: AC keeps control only where SC, followed from the estimate, surely comes "
    "to rest within C"
)
JUDGED = "; a command acts only where SC, followed from it and those that still act, comes to rest"
DECIDED = ", decided in flight (rest and start proved)"
SOUND = Assumption(
    "tubes", "the compiled check of the DM encloses what SC and the plants do: tested, not proved"
)
ANSWERS = "an SC that limits what it publishes (`clamp`), to a little less than the set"
KEPT = (
    "what disturbances do at rest, errors and ages of what SC reads, late commands, and SC at the "
    "end of its commands where all numbers of `rest` are at theirs at once, have to fit into `rest`"
    "{}: a larger one, a lower gain of SC, {}or an SC that holds a place (`soter explain anchor`)"
)
NEEDS = (
    " (by a linear estimate a tube that forgets nothing needs {share:.2g} times what it has of "
    "`{leaf}`: {on_time:.2g} if no command were late, {young:.2g} if no read were old; from its "
    "corners SC wants {command:.2g} times its largest command, and all of it is back {soon})"
)
NOT_GIVEN = "at the start the check of the DM does not let AC have control"
UNBOUNDED = (
    "bound {} in `rest`, or by a set of the topic, or say in `moves` how far SC moves it: else it "
    "is followed from wherever it may be; an angle that all read in `sin`, `cos` and `wrap_angle` "
    "alone needs neither, nor a set"
)
OPEN = "bound {} in `rest`, too: it moves what `rest` holds, and may be anything in its set"
UNMOVED = "`rest` reads nothing that commands move: say it of what SC brings to rest"
AT_START = (
    "a longer `within`, or a `rest` that lies in `safe` with all that SC leads through from there"
)
MOVES = (
    "a larger bound; where something pushes for ever none is true, so name a place that SC holds "
    "in `rest`, and not in `moves` (`soter explain anchor`)"
)


class TubeResult(ModuleResult):
    """The result for a module that decides by tubes; `claims` are the claims shown offline.

    For several plans `plans` has the result of each; `check` and `claims` are those of the first.
    """

    problem: TubeProblem
    check: TubeCheck
    claims: RestClaims
    plans: tuple[TubeResult, ...] = ()

    @property
    def verdict(self) -> str:
        """The verdict; it is never `proved`, as the check in flight is tested and not proved."""
        inner = super().verdict
        return ASSUMED if inner == PROVED else inner

    @property
    def verdict_note(self) -> str:
        """The note beside the verdict that decisions are made in flight; "" if not needed."""
        return DECIDED if self.verdict == ASSUMED else ""


def verify_by_tubes(
    problem: TubeProblem,
    *,
    refute: bool = True,
    explain: bool | None = None,
    search: object = None,
    compiled: object = None,
) -> TubeResult:
    """Verifies one module by tubes; raises R007 if the theorem or the check does not cover it.

    With `refute` or `explain`, younger reads are tried if rest is not shown. `search` and
    `compiled` are unused parameters that every method has: no refuting run is searched.
    """
    if problem.plans:
        results = [verify_by_tubes(p, refute=refute, explain=explain) for p in problem.plans]
        return _joined_results(problem, results)
    del search, compiled
    began = time.perf_counter()
    phase(f"{problem.name}: whether SC keeps where it rests", anew=True)
    check = TubeCheck(problem)
    claims = rest_claims(check)
    result = TubeResult(
        problem, {}, [], added=(SOUND, *_far_assumptions(check), *_turns_assumptions(check))
    )
    result.check, result.claims = check, claims
    enter_static_claims(problem, result)
    cpu = time.perf_counter() - began
    why = claims.kept or claims.moves
    rest = Finding(UNDECIDED if why else PROVED, cpu, HOW, why or _kept_text(check, claims))
    if claims.answers:
        rest.hint = _advice_on_sets(check) + ANSWERS
    elif why:
        rest.hint = _advice_on_rest(check, claims, ask=bool(refute or explain))
    in_flight = IN_FLIGHT if problem.module.shield is None else IN_FLIGHT + JUDGED
    flies = Finding(UNDECIDED if why else ASSUMED, 0.0, HOW, why or in_flight)
    findings = {
        **result.findings,
        "P2a": rest,
        "P2b": _finding_on_return(problem),
        "P3": flies,
        "ttf": flies,
        "safer": flies,
        "start": Finding(
            UNDECIDED if claims.start or why else PROVED,
            0.0,
            HOW,
            claims.start or why or _start_text(check),
        ),
        "failsafe": Finding(ASSUMED, text=NO_LAW),
        "DM": Finding(ASSUMED, text="not tried: its predicates follow SC"),
    }
    if claims.start and not why:
        findings["start"].hint = _doubt_in_words(problem) or AT_START
    result.findings = {p: findings[p] for p in PROPERTIES}
    result.at_the_start = NOT_GIVEN if not (why or claims.ac_has_control) else ""
    result.vacuity = vacuity_of_rest(problem, result.at_the_start)
    mention_vacuity_in_claim(result)
    result.seconds = time.perf_counter() - began
    return result


def _joined_results(problem: TubeProblem, results: Sequence[TubeResult]) -> TubeResult:
    """The result for several plans; claims must hold for all plans, `start` only for the first."""
    added = dict.fromkeys(a for r in results for a in r.assumptions)
    result = TubeResult(problem, {}, [], added=tuple(added))
    result.check, result.claims, result.plans = results[0].check, results[0].claims, tuple(results)
    result.findings = {p: _joined_finding(results, p) for p in PROPERTIES}
    from_start = [r for r in results if not r.at_the_start]
    result.at_the_start = "" if from_start else results[0].at_the_start
    result.vacuity = vacuity_of_rest(problem, result.at_the_start)
    result.seconds = sum(r.seconds for r in results)
    return result


def _joined_finding(results: Sequence[TubeResult], name: str) -> Finding:
    kept = all(r.findings["P2a"].verdict == PROVED for r in results)
    every = results[:1] if name == "start" and kept else results
    worst = max((r.findings[name].verdict for r in every), key=(PROVED, ASSUMED, UNDECIDED).index)
    found = {r.problem.plan: r.findings[name] for r in every if r.findings[name].verdict == worst}
    same = len(found) == len(every) > len({f.text for f in found.values()}) == 1
    first = next(iter(found.values()))
    text = first.text if same else "; ".join(f"{plan}: {f.text}" for plan, f in found.items())
    seconds = sum(r.findings[name].seconds for r in every)
    hint = next((f.hint for f in found.values() if f.hint), "")
    return Finding(worst, seconds, first.method, text, hint)


def _advice_on_rest(check: TubeCheck, claims: RestClaims, *, ask: bool) -> str:
    """Advice for a rest that is not shown; `ask` says whether younger reads may be tried."""
    far = _unbounded_states(check, claims)
    unbounded = ", ".join(map(check.problem.leaf_of_state, far))
    asked = ask and not (far or claims.astray is not None)
    tried = _younger_reads_in_words(check.problem) if asked else ""
    if doubt := UNMOVED * (not check.commands_move_rest) or _doubt_in_words(check.problem):
        return doubt
    if not claims.kept:
        return f"{tried}, or {MOVES}" if tried else MOVES
    if far:
        return UNBOUNDED.format(unbounded)
    if left := _names_left_open(check, claims):
        return OPEN.format(left)
    if not claims.box:
        return ""
    needs, late = "", "".join(f"{advice}, " for advice in _advice_on_delays(check, tried))
    if ask and (found := noise_estimate(check, claims.box)) is not None and found.share > 0.0:
        leaf = check.problem.leaf_of_state(found.worst)
        soon = f"after {found.back} commands of SC" if found.back else "in none of those followed"
        needs = NEEDS.format(leaf=leaf, soon=soon, **found._asdict())
    return KEPT.format(needs, late)


def _doubt_in_words(problem: TubeProblem) -> str:
    """The warning W022 of `soter check` about `rest`, with its help; "" without a warning."""
    found = doubt_about_rest(problem.system, problem.module, unproved=True)
    return "" if found is None else f"{found[1]}, {found[2]}: {help_texts([found[3]])[0]}"


def _younger_reads_in_words(problem: TubeProblem) -> str:
    """The smaller `age` that was tried, and whether it shows rest; "" if none can be tried."""
    changed = problem_with_younger_sc_reads(problem)
    if changed is None or not isinstance(changed[0], TubeProblem):
        return ""
    phase(f"{problem.name}: whether SC keeps where it rests with younger reads", anew=True)
    claims = rest_claims(TubeCheck(changed[0]))
    shown = not (claims.kept or claims.moves)
    return f"{changed[1]} (tried: {'rest is shown' if shown else 'not enough'})"


def _advice_on_delays(check: TubeCheck, tried: str) -> Iterator[str]:
    """Advice on old reads and on delays of commands, which make SC late."""
    times = check.problem.times
    if tried or (check.read_by_law and times.age_sc > times.delta_sc):
        yield (
            tried or f"reads that are younger (`age`, `max_age`, now up to {show_ns(times.age_sc)})"
        )
    if times.acts:
        late = f"with `response dm` and `response sc` {show_ns(times.jitter_sc)} late at most"
        yield f"less delay (`acts within`, now {show_ns(times.acts)}; {late})"


def _advice_on_sets(check: TubeCheck) -> str:
    """Advice to declare sets for topics that SC reads; "" if all have sets."""
    far = [
        check.problem.leaf_of_state(s)
        for s in sorted(check.read_by_law)
        if is_far(check.read_sets[s])
    ]
    sets = ", ".join(f"`{leaf} in [-l, l]`" for leaf in far)
    return f"sets of what SC reads, as {sets} in its topic; or " if far else ""


def _unbounded_states(check: TubeCheck, claims: RestClaims) -> list[int]:
    """The states that `rest` leaves unbounded though SC reads them or a run is lost in them.

    If none exist, it gives the states that were left out of the box around rest.
    """
    unsaid = (check.read_by_law | {claims.astray}) - check.read_by_rest
    box = claims.box.items()
    ends = [s for s, r in box if s in unsaid or max(-r.low, r.high) >= FARTHEST]
    return ends or [s for s in claims.ways if s not in claims.box]


def _names_left_open(check: TubeCheck, claims: RestClaims) -> str:
    """The names, joined by commas, of states that rates read but `rest` does not."""
    asked = check.read_by_rates - check.read_by_rest
    return ", ".join(check.problem.leaf_of_state(s) for s in claims.box if s in asked)


def _far_assumptions(check: TubeCheck) -> list[Assumption]:
    """A list with the assumption that states without sets stay below `FARTHEST`; may be empty."""
    unmoved_states = [s for s in check.states if s not in check.problem.drifts]
    far = {s for s in unmoved_states if is_far(check.rooms[s])}
    far |= {s for s in check.read_by_law if is_far(check.read_sets[s])}
    names = [check.problem.quantities.states[s].name for s in sorted(far)]
    who = "states whose topics have no sets, or larger ones,"
    text = f"{who} stay below {FARTHEST:g}: {', '.join(names)}"
    return [Assumption("far", text)] if far else []


def _turns_assumptions(check: TubeCheck) -> list[Assumption]:
    """A list with the assumption on angles that need not come back, or an empty list."""
    names = ", ".join(check.problem.quantities.states[s].name for s in check.turning)
    text = f"{names} stays within {FARTHEST_TURN:,.0f} rad of 0: it is read modulo a full turn"
    return [Assumption("turns", f"{text}, and need not come back")] if names else []


def _kept_text(check: TubeCheck, claims: RestClaims) -> str:
    """The text of the finding that SC keeps rest, with the ranges on the way."""
    names = check.problem.quantities.states
    kept = ((names[s].name, claims.ways[s]) for s in claims.box)
    ways = [f"{name} in [{r.low:.3g}, {r.high:.3g}]" for name, r in kept]
    where = f", within {', '.join(ways)}" if ways else ""
    return f"once `rest` holds SC leads back there again and again{where}"


def _start_text(check: TubeCheck) -> str:
    return f"from there SC, acting within {show_ns(check.times.start)}, comes to rest within C"


def _finding_on_return(problem: TubeProblem) -> Finding:
    """The finding on P2b; it is assumed, as it depends on estimates and maps in flight."""
    stays = problem.module.symbol.stay_clause
    if stays:
        return Finding(ASSUMED, text=STAYS.format(stays))
    text = (
        f"at rest within {show_ns(problem.within_ns)}; AC has control again where the check is good"
    )
    return Finding(ASSUMED, text=text)
