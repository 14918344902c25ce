"""Tries changes of a module that is not proved, advises those that help, and measures their cost.

Purpose: `diagnose` makes one change after the other that a person could make (the rows of
`variations.py`), proves again within a limit of CPU time, on merged cells first, and keeps a change
that helps. The advice says which changes helped, which did not, and which were not tried.
`enter_cost` runs the system without and with the changes, and compares takeovers a minute, AC's
share of the time and the bytes of the DM's tables.
Non-goals: verdicts: nothing of it is claimed of the program as it is; other laws, other plants;
costs in systems with externs, which `soter verify` never runs.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.codegen.unit import generate
from soter.core.layout import ac_share, state_dtype
from soter.core.steps import lower
from soter.diagnostics.current_phase import (
    CancelledError,
    announce,
    cancelled_when,
    phase,
    share_done,
    shares_to,
    within_phase,
)
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless, with_changed_topics
from soter.language.model.system import LEVELS_DEFAULT
from soter.native.loaded_program import Library
from soter.native.shared_library import library
from soter.verify.claims.results import (
    ASSUMED,
    PROVED,
    REFUTED,
    UNDECIDED,
    FlownFigures,
    RemedyCost,
)
from soter.verify.deploy.level_tables import tables_of_groups
from soter.verify.deploy.missing_predicates import (
    complete,
    find_sets,
    install_predicates,
    modules_to_complete,
)
from soter.verify.diagnosis.changed_runs import NARROWER
from soter.verify.diagnosis.model_runs import PointModel, patterns_to_try, run_of_sc
from soter.verify.diagnosis.open_claims import HABIT, REST, explain_open_claims
from soter.verify.diagnosis.vacuity import worst_vacuity
from soter.verify.diagnosis.variations import CALMER, HALF, OTHERS, NotProved, remedies
from soter.verify.enclose.enclosure_emitter import EnclosureError
from soter.verify.grid.case import verdicts_in_words
from soter.verify.grid.grid_refinement import cell_count, coarser_problem
from soter.verify.grid.group_model import UnboundedError
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from soter.language.model.system import Module, System
    from soter.verify.claims.results import LeavingRun, ModuleResult, ProofSearch
    from soter.verify.diagnosis.variations import Remedy
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Problem

    Attempt = Callable[[Problem], list[Case]]

SEED = 1
UNTIL_NS, PERIODS = 60_000_000_000, 200
"""Runs end after this time in ns, or after so many periods of the DM if that is later."""
SLICE_NS, SLICES = 1_000_000_000, 1000
"""The simulated time in ns after which the CPU time is checked, and how often that is at most."""
CPU_S = 5.0
"""The CPU seconds of both runs together, with the tables that they need."""


def enter_cost(result: ModuleResult, fresh: Callable[[], System]) -> None:
    """Enters the cost of the advised changes, if these prove every claim.

    For a module that is proved it enters the cost of smaller cells and fewer levels. `fresh` makes
    the system in which it was proved, as it flies.
    """
    held = result.verdict in (PROVED, ASSUMED)
    if held and result.cells_why and result.problem.computed:
        phase(f"{result.problem.name}: measuring what smaller cells cost")
        declared = replace(result.problem, groups=result.problem.declared_groups, cells_open=False)
        before = None if result.cells_why == "P2a" else replace(declared, declared_groups=())
        result.notes += (f"smaller cells: {_cost_of_remedy(before, result.problem, fresh)}",)
    if held and result.levels_why:
        phase(f"{result.problem.name}: measuring what fewer levels cost")
        default = replace(result.problem, levels=LEVELS_DEFAULT, levels_open=False)
        result.levels_cost = _cost_of_remedy(default, result.problem, fresh)
        result.notes += (f"fewer levels: {result.levels_cost}",)
    for finding in result.findings.values():
        if finding.remedied is not None:
            phase(f"{result.problem.name}: measuring what that costs")
            finding.cost = _cost_of_remedy(result.problem, finding.remedied, fresh)


def _cost_of_remedy(
    problem: Problem | None, remedied: Problem, fresh: Callable[[], System]
) -> RemedyCost:
    """The cost of running `remedied` instead of `problem`, which is None if it has no tables."""
    flat, ends = fresh(), time.process_time() + CPU_S
    if problem is not None and remedied.module.sc != problem.module.sc:
        return RemedyCost(flat.name, not_measured="it is a module with other controllers")
    if problem is not None and _plant_ranges(remedied) != _plant_ranges(problem):
        return RemedyCost(flat.name, not_measured="it is about another plant")
    why = _why_not_run(flat, remedied)
    if why or not flat.until_ns:
        return RemedyCost(flat.name, not_measured=why)
    until_ns = min(flat.until_ns, max(UNTIL_NS, PERIODS * remedied.times.delta_dm))
    try:
        with shares_to(None), cancelled_when(lambda: time.process_time() > ends):
            before = None if problem is None else _flown_figures(flat, problem, until_ns)
            changed = _system_with_remedy(fresh(), problem or remedied, remedied)
            after = _flown_figures(changed, remedied, until_ns)
    except CancelledError:
        why = f"its runs, and the tables that they need, take more than {CPU_S:g} s of CPU time"
    except SoterError as error:
        why = error.diagnostics[0].message
    except EnclosureError as error:
        why = str(error)
    if why or after is None:
        return RemedyCost(flat.name, not_measured=why or "no tables were found on the whole grid")
    return RemedyCost(flat.name, until_ns / 1e9, before, after)


def _plant_ranges(problem: Problem) -> object:
    """The numbers of the plants that a run needs: no system with changed ones can be run."""
    return problem.initial, problem.disturbances, problem.errors


def _why_not_run(flat: System, problem: Problem) -> str:
    """The reason why the system is not run to measure a cost; "" if it can be run."""
    asked = [x.name for x in flat.components if x.extern]
    asked += [f.source_name for f in lower(flat).functions if f.result is None]
    if asked:
        return f"`verify` asks no externs, and system `{flat.name}` has `{asked[0]}`"
    if not flat.until_ns:
        return f"system `{flat.name}` says no `until`"
    count = len(_modules_of_declaration(flat, problem))
    if count != 1:
        return f"the module stands {count} times in system `{flat.name}`, and one was tried"
    return "the module has views" if problem.view else ""


def _modules_of_declaration(flat: System, problem: Problem) -> list[Module]:
    """The modules of the system whose declaration has the same name as the problem's module."""
    return [m for m in flat.modules if m.symbol.name == problem.module.symbol.name]


def _system_with_remedy(flat: System, problem: Problem, remedied: Problem) -> System:
    """The system with the maximum ages of the remedy, without the predicates that it leaves out."""
    ages = {
        now.symbol.name: now.max_age_ns
        for now, was in zip(remedied.system.topics, problem.system.topics, strict=True)
        if now.max_age_ns != was.max_age_ns
    }
    if remedied.computed and not problem.computed:
        (module,) = _modules_of_declaration(flat, problem)
        module.symbol = replace(module.symbol, ttf=None, safer=None, topics_read=())
    younger = [
        replace(t, max_age_ns=ages[t.symbol.name])
        for t in flat.topics
        if t.symbol.name in ages and t.max_age_ns is not None
    ]
    return with_changed_topics(flat, younger)


def _flown_figures(flat: System, tried: Problem, until_ns: int) -> FlownFigures | None:
    """The figures of a run with the predicates computed for `tried`; None if it has no tables."""
    (module,) = _modules_of_declaration(flat, tried)
    count = 0
    if module in modules_to_complete(flat):
        declared = extract(faultless(flat), module)
        problem = replace(declared, groups=tried.groups, states=tried.states, levels=tried.levels)
        problem = replace(problem, declared_groups=tried.declared_groups)
        problem = replace(problem, levels_open=tried.levels_open, cells_open=tried.cells_open)
        problem, sets = find_sets(problem)
        level_tables = None if sets is None else tables_of_groups(problem, sets)
        if level_tables is None:
            return None
        install_predicates(flat, module, problem, level_tables)
        files: dict[str, bytes] = {}
        for k, table in enumerate(level_tables):
            table.entry([""] * len(problem.states), str(k), files)
        count = sum(map(len, files.values()))
    complete(flat)
    unit = generate(flat)
    program = Library(library(unit), unit.prefix, unit.layout.size)
    state = program.new_state(SEED)
    for until in (*range(0, until_ns, max(SLICE_NS, until_ns // SLICES)), until_ns):
        program.run_until(state, until)
        share_done(until / until_ns)
    last = state.view(state_dtype(unit.layout))[0]
    often = int(last["modules"][module.index]["to_sc"]) / (until_ns / 60e9)
    return FlownFigures(often, ac_share(last, module.index), count)


LEAST_S, OF_PROOF, SHOWN_S = 16.0, 1.0, 12.0
"""CPU seconds for all trials of a module: the greater of `LEAST_S` and `OF_PROOF` times the time of
the proof, and `SHOWN_S` for the runs that explain why it is open."""
COARSE = 40_000
"""The number of cells of a group on which a change is tried first."""
PILOT, LONGER = 1_500, 4.0
"""For a run with AC as SC: the number of cells, and its length in lengths of SC's own run."""
CHAIN_MAX = 3
"""The most changes that are made together."""
ORDER = ("P2a", "ttf", "safer", "start", "P2b")
CALMEST = CALMER.format([*NARROWER.values()][-1])
WORDS = {
    "a wider grid": "a longer axis",
    "wider ranges": "a longer axis",
    "smaller errors": CALMEST,
}
"""For the first words of a hint the remedy that is the same; if that is in vain the hint goes."""
SEARCHED = "in vain: other cells, in the search whose tries are listed"
OTHERS_FOUND = "other grids, or `rest`: `soter verify` without `--budget 0` looks for them"
"""The hint where all that is suggested was tried in vain; a search in vain removes it."""
NOT_TRIED = "(not tried)"
"""The mark of a suggestion that was not tried."""


class Trials:
    """Verifies changed problems of one module, within a limit of CPU time."""

    def __init__(self, cpu_s: float, attempt: Attempt) -> None:
        self._attempt = attempt
        self._until = time.process_time() + SHOWN_S + max(LEAST_S, OF_PROOF * cpu_s)

    def failing_claims(self, problem: Problem) -> tuple[str, ...] | None:
        """The claims of a problem that are not proved, in order; None if it was not verified.

        An AC that never has control counts as a failure of `ttf`.
        """
        done = self._cases_in_time(problem)
        if done is None:
            return None
        wrong = {f.claim for case in done for f in case.failures}
        if not wrong and worst_vacuity(done) is not None:
            wrong = {"ttf"}
        return tuple(claim for claim in ORDER if claim in wrong)

    def _cases_in_time(self, problem: Problem) -> list[Case] | None:
        if not self.go_on():
            return None
        try:
            # no progress is shown of the claims of a tried proof
            with within_phase(), cancelled_when(lambda: not self.go_on()):
                done = self._attempt(problem)
        except (CancelledError, UnboundedError, SoterError, EnclosureError):
            return None
        return done if self.go_on() else None

    def stays_longer(self, problem: Problem, leaving: LeavingRun | None) -> bool:
        """Whether the undisturbed run of a problem stays in C longer than the run `leaving` did."""
        done = self._cases_in_time(coarser_problem(problem, PILOT))
        if leaving is None or not done:
            return False
        model, until_s = PointModel(done[0]), LONGER * float(leaving.time_s[-1])
        trace = run_of_sc(model, model.start, next(patterns_to_try(model)), until_s, self.go_on)
        return not trace.left and trace.times[-1] > leaving.time_s[-1]

    def go_on(self) -> bool:
        """Whether there is CPU time left."""
        return time.process_time() < self._until


def ordered_trials(changes: Iterable[Remedy]) -> list[tuple[Remedy, Problem]]:
    """The trials of some changes, by cost and cells: each on merged cells, then on its own.

    So a grid with many cells does not use up the time of quick changes.
    """
    trials = []
    for change in changes:
        coarse = coarser_problem(change.problem, COARSE)
        if coarse.groups != change.problem.groups:
            trials.append((change, coarse))
        trials.append((change, change.problem))
    return sorted(trials, key=lambda trial: (trial[0].cost, cell_count(trial[1])))


def diagnose(done: Sequence[Case], result: ModuleResult, cpu_s: float, attempt: Attempt) -> None:
    """Explains the claims that are not proved, tries changes and enters the advice.

    It also explains why an SC is refuted. `cpu_s` is the CPU time of the proof in seconds.
    """
    failing = tuple(c for c in ORDER if not result.findings[c].holds)
    findings = [result.findings[c] for c in failing]
    trials = Trials(cpu_s, attempt)
    announce(lambda: _first_verdict(result))
    explain_open_claims(done, result, trials.go_on)
    announce(lambda: "\n".join(f"{result.name}: {c.text}" for f in findings for c in f.causes))
    if all(f.verdict != UNDECIDED for f in findings):
        return
    p2a = result.findings["P2a"]
    of_sc = p2a.verdict == REFUTED or any(c.kind == HABIT for c in p2a.causes)
    helped = _KeptChanges(NotProved(result.problem, failing, done, p2a.leaving, of_sc))
    while helped.found.failing and len(helped.advice) < CHAIN_MAX and helped.try_one_more(trials):
        pass
    helped.enter(result, failing)


def _first_verdict(result: ModuleResult) -> str:
    """The text of the verdicts so far, which is shown before any change is tried."""
    worst = [n for n, f in result.findings.items() if f.verdict == result.verdict]
    head = f"{result.name} is {result.verdict.upper()} ({', '.join(worst)})"
    return "\n".join((f"{head}; looking for the cause, and what helps", *verdicts_in_words(result)))


class _KeptChanges:
    """The changes kept so far; each new change is added to the earlier ones."""

    def __init__(self, found: NotProved) -> None:
        self.found = found
        self.advice: list[str] = []
        self.in_vain: dict[str, None] = {}
        self.untried: dict[str, None] = {}

    def try_one_more(self, trials: Trials) -> bool:
        """Tries changes until a change helps, and keeps it; returns False if none helps."""
        found = self.found
        for remedy, tried in ordered_trials(remedies(found)):
            if self._is_kept(remedy):
                continue
            if remedy.cost == OTHERS and not trials.stays_longer(tried, found.leaving):
                continue
            phase(f"{found.problem.name}: trying {remedy.advice}")
            now, as_it_is = trials.failing_claims(tried), tried is remedy.problem
            if now == () or (
                as_it_is and now is not None and _helps_in_part(remedy, now, found.failing)
            ):
                self.advice.append(remedy.advice)
                self.in_vain.pop(remedy.advice, None)
                self.found = replace(found, problem=remedy.problem, failing=now)
                return True
            if as_it_is and now is not None:
                self.in_vain[remedy.advice] = None
            elif as_it_is and not trials.go_on() and remedy.advice not in self.in_vain:
                # with time left, None means that it is no problem
                self.untried[remedy.advice] = None
        return False

    def _is_kept(self, remedy: Remedy) -> bool:
        """Whether the change is kept already, or a change to a still narrower world."""
        return remedy.advice in self.advice or (remedy.cost == HALF and CALMEST in self.advice)

    def enter(self, result: ModuleResult, failing: Sequence[str]) -> None:
        """Enters the advice at the first claim that is not proved."""
        left, joined = self.found.failing, "; ".join
        first = result.findings[failing[0]]
        if self.advice:
            first.remedied = None if left else self.found.problem
            then = f"all but {', '.join(left)} proved" if left else "every claim is proved"
            first.tried.append(f"with {joined(self.advice)}: {then}")
            untried = "" if "(tried" in first.hint else f" {NOT_TRIED}"
            otherwise = f"; or {first.hint}{untried}" if left and first.hint else ""
            first.hint = f"{'; and '.join(self.advice)} (tried: {then}){otherwise}"
            for claim in failing[1:] if not left else ():
                result.findings[claim].hint = f"as for `{failing[0]}`: with that it is proved, too"
        words = [w for w, of in WORDS.items() if any(r.startswith(of) for r in self.in_vain)]
        parts = [p for p in first.hint.split("; ") if self.advice or not p.startswith(tuple(words))]
        first.hint = joined(parts) or OTHERS_FOUND
        if self.in_vain:
            first.tried.append(f"in vain: {joined(self.in_vain)}")
        if self.untried and left:
            first.tried.append(f"not, for want of time: {joined(self.untried)}")
        p3 = result.findings["P3"]
        same = (f.hint for c in failing if (f := result.findings[c]).text == p3.text)
        p3.hint = next(same, p3.hint)


def _helps_in_part(remedy: Remedy, now: Sequence[str], left: Sequence[str]) -> bool:
    """Whether a change is kept though claims still fail; of narrower worlds only the narrowest."""
    return (remedy.cost != HALF or remedy.advice == CALMEST) and _fewer_claims_fail(now, left)


def _fewer_claims_fail(now: Sequence[str], left: Sequence[str]) -> bool:
    """Whether fewer claims fail now than before, or P2a has stopped failing."""
    asked = set(left) - {"P2b"} if "P2a" in now else set(left)  # without K nothing leads back
    return set(now) < asked or (left[0] == "P2a" and "P2a" not in now)


def remove_tried_advice(results: Sequence[ModuleResult], searches: Sequence[ProofSearch]) -> None:
    """Removes advice that searches have tried in vain: smaller cells, another search."""
    in_vain = {s.module: s.cells_in_vain for s in searches if not s.proved}
    for name, finding in ((r.name, f) for r in results for f in r.findings.values()):
        words = (REST, OTHERS_FOUND, *["smaller cells"] * in_vain.get(name, False))
        marked = f" {NOT_TRIED}" if finding.hint.endswith(NOT_TRIED) else ""
        parts = finding.hint.removesuffix(marked).split("; ")
        left = [p for p in parts if name not in in_vain or not p.startswith(words)]
        if left != parts:
            finding.tried.append(SEARCHED)
            finding.hint = "; ".join(left) + marked * bool(left)


def mark_untried(result: ModuleResult) -> ModuleResult:
    """Adds "(not tried)" to each suggestion that was not tried, and returns the result."""
    for finding in result.findings.values():
        if finding.hint and not any(word in finding.hint for word in ("tried", "as for `")):
            finding.hint += f" {NOT_TRIED}"
    return result
