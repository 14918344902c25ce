"""What to write, tried before it is said, and what it costs.

Purpose: for a module that is not proved one loop: change what a person could change, prove again
within a bound on its CPU time, on merged cells first, and keep what helps. Those that helped, those
that did not, and those that were not tried are told apart. `enter_cost`: takeovers a minute, AC's
share of the time and the bytes of the DM's tables, in one run of the system as it is and in one as
it would be with what was tried.
Non-goals: verdicts: nothing of it is claimed of the program as it is; other laws, other plants;
costs in systems with externs, which `soter verify` never runs.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.codegen.unit import generate
from soter.core.layout import ac_share, state_dtype
from soter.core.steps import lower
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless, with_changed_topics
from soter.language.model.system import LEVELS_DEFAULT
from soter.native.library import Library
from soter.native.shared_library import library
from soter.verify.claims.case import SPENT
from soter.verify.claims.cells import cells_of, smaller_cells
from soter.verify.claims.choice import CELLS_MAX
from soter.verify.claims.results import ASSUMED, PROVED, UNDECIDED, FlownFigures, RemedyCost
from soter.verify.deploy.missing_predicates import complete, open_modules, put, sets_of
from soter.verify.diagnosis import experiments
from soter.verify.diagnosis.experiments import COARSE
from soter.verify.diagnosis.grid_ends import LOST, longer_of
from soter.verify.diagnosis.model_runs import PointModel, patterns, run
from soter.verify.diagnosis.vacuity import vacuity
from soter.verify.enclose.c_emitter import EnclosureError
from soter.verify.grid.sets import CancelledError, UnboundedError
from soter.verify.problem.extract import extract
from soter.verify.proof_methods import tables

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from soter.language.model.system import Module, System
    from soter.verify.claims.case import Case
    from soter.verify.claims.results import Cause, LeavingRun, ModuleResult
    from soter.verify.problem.problem import Axis, Problem

    Tell = Callable[[str, float], None]
    Attempt = Callable[[Problem, Tell], list[Case]]


SEED = 1
UNTIL_NS, PERIODS = 60_000_000_000, 200
"""A run that lasts longer ends here, or after so many periods of the DM, if that is later."""
SLICE_NS, SLICES = 1_000_000_000, 1000
"""After so long it is asked whether there is CPU time left, so often at most."""
CPU_S = 5.0
"""So many CPU seconds of this process both runs get, with the tables that they need."""


def enter_cost(result: ModuleResult, fresh: Callable[[], System]) -> None:
    """Enter what the changes cost that prove every claim, beside their advice.

    And what was chosen for a module that is proved: smaller cells, fewer levels. `fresh`: gives the
    system that it was proved in, as it flies.
    """
    held = result.verdict in (PROVED, ASSUMED)
    if held and result.cells_why and result.problem.computed:
        phase(f"{result.problem.name}: measuring what smaller cells cost")
        declared = replace(result.problem, groups=result.problem.declared_groups, cells_open=False)
        before = None if result.cells_why == "P2a" else replace(declared, declared_groups=())
        result.notes += (f"smaller cells: {_cost(before, result.problem, fresh)}",)
    if held and result.levels_why:
        phase(f"{result.problem.name}: measuring what fewer levels cost")
        default = replace(result.problem, levels=LEVELS_DEFAULT, levels_open=False)
        result.levels_cost = _cost(default, result.problem, fresh)
        result.notes += (f"fewer levels: {result.levels_cost}",)
    for finding in result.findings.values():
        if finding.remedied is not None:
            phase(f"{result.problem.name}: measuring what that costs")
            finding.cost = _cost(result.problem, finding.remedied, fresh)


def _cost(problem: Problem | None, remedied: Problem, fresh: Callable[[], System]) -> RemedyCost:
    """`problem`: as it is; None: without tables."""
    flat, ends = fresh(), time.process_time() + CPU_S
    if problem is not None and remedied.module.sc != problem.module.sc:
        return RemedyCost(flat.name, not_measured="it is a module with other controllers")

    def tell(what: str, share: float) -> None:
        del what, share
        if time.process_time() > ends:
            raise CancelledError

    why = _why_not(flat, remedied)
    if why or not flat.until_ns:
        return RemedyCost(flat.name, not_measured=why)
    until_ns = min(flat.until_ns, max(UNTIL_NS, PERIODS * remedied.times.delta_dm))
    try:
        before = None if problem is None else _flown(flat, problem, until_ns, tell)
        changed = _changed(fresh(), problem or remedied, remedied)
        after = _flown(changed, remedied, until_ns, tell)
    except CancelledError:
        why = f"its runs, and the tables that they need, take more than {CPU_S:g} s of CPU time"
    except SoterError as error:
        why = error.diagnostics[0].message
    except EnclosureError as error:
        why = str(error)
    if why or after is None:
        return RemedyCost(flat.name, not_measured=why or "no tables were found on the whole grid")
    return RemedyCost(flat.name, until_ns / 1e9, before, after)


def _why_not(flat: System, problem: Problem) -> str:
    """Why the system is not run; "" where it is."""
    asked = [x.name for x in flat.components if x.extern]
    asked += [f.source_name for f in lower(flat).functions if f.result is None]
    if asked:
        return f"`verify` asks no externs, and system `{flat.name}` has `{asked[0]}`"
    if not flat.until_ns:
        return f"system `{flat.name}` says no `until`"
    count = len(_instances(flat, problem))
    if count != 1:
        return f"the module stands {count} times in system `{flat.name}`, and one was tried"
    return "the module has views" if problem.view else ""


def _instances(flat: System, problem: Problem) -> list[Module]:
    """The modules that what is written of this one is written of."""
    declared = problem.module.symbol.span
    return [m for m in flat.modules if m.symbol.span == declared]


def _changed(flat: System, problem: Problem, remedied: Problem) -> System:
    """A fresh system with the ages that were tried, and without predicates that were left out."""
    ages = {
        now.symbol: now.max_age_ns
        for now, was in zip(remedied.system.topics, problem.system.topics, strict=True)
        if now.max_age_ns != was.max_age_ns
    }
    if remedied.computed and not problem.computed:
        (module,) = _instances(flat, problem)
        module.symbol = replace(module.symbol, ttf=None, safer=None, topics_read=())
    younger = [
        replace(t, max_age_ns=ages[t.symbol])
        for t in flat.topics
        if t.symbol in ages and t.max_age_ns is not None
    ]
    return with_changed_topics(flat, younger)


def _flown(flat: System, tried: Problem, until_ns: int, tell: Tell) -> FlownFigures | None:
    """A run, with predicates computed on the cells and levels of `tried`; None: there are none."""
    (module,) = _instances(flat, tried)
    count = 0
    if module in open_modules(flat):
        own = extract(faultless(flat), module)
        problem = replace(own, groups=tried.groups, states=tried.states, levels=tried.levels)
        problem = replace(problem, declared_groups=tried.declared_groups)
        problem = replace(problem, levels_open=tried.levels_open, cells_open=tried.cells_open)
        problem, sets = sets_of(problem, tell=tell)
        level_tables = None if sets is None else tables(problem, sets)
        if level_tables is None:
            return None
        put(flat, module, problem, level_tables)
        files: dict[str, bytes] = {}
        for k, table in enumerate(level_tables):
            table.entry([""] * len(problem.states), str(k), files)
        count = sum(map(len, files.values()))
    complete(flat, tell=tell)
    unit = generate(flat)
    program = Library(library(unit), unit.prefix, unit.layout.size)
    state = program.new_state(SEED)
    for until in (*range(0, until_ns, max(SLICE_NS, until_ns // SLICES)), until_ns):
        program.run(state, until)
        tell("", until / until_ns)
    last = state.view(state_dtype(flat, unit.layout))[0]
    often = int(last["modules"][module.index]["to_sc"]) / (until_ns / 60e9)
    return FlownFigures(often, ac_share(last, module.index), count)


LEAST_S, OF_PROOF = 8.0, 1.0
"""CPU seconds that all trials of a module get: so many, or so often what the proof has taken."""
PILOT, LONGER = 1_500, 4.0
"""Cells on which AC in SC's place is set up for a run, and how often as long as SC's it is."""
CHAIN_MAX = 3
"""So many changes are made together at most."""
HOPELESS = ("wrap_around", "drift_of_all")
"""Causes that no other grid, age or predicate mends; another SC does."""
ORDER = ("P2a", "ttf", "safer", "start", "P2b")
NOT_TRIED = "(not tried)"
"""Behind what is suggested, and nobody has proved the module with."""


@dataclass(frozen=True)
class Remedy:
    """A change: what to write, and the problem that it makes; None: it was not tried."""

    said: str
    problem: Problem | None
    exchanged: bool = False
    """It changes what AC and SC are: asked last."""


class Trials:
    """Verifications of changed problems of one module, and what they took."""

    def __init__(self, problem: Problem, cpu_s: float, attempt: Attempt) -> None:
        self.problem, self._attempt = problem, attempt
        self._until = time.process_time() + max(LEAST_S, OF_PROOF * cpu_s)

    def failing(self, problem: Problem) -> tuple[str, ...] | None:
        """The claims that are not proved of a problem, in order; None: that was not seen.

        An AC that never has control counts as a failure of `ttf`.
        """
        done = self._done(problem)
        if done is None:
            return None
        wrong = {f.claim for case in done for f in case.failures}
        if not wrong and vacuity(done) is not None:
            wrong = {"ttf"}
        return tuple(claim for claim in ORDER if claim in wrong)

    def _done(self, problem: Problem) -> list[Case] | None:
        def tell(what: str, share: float) -> None:
            del what, share
            if not self.goes_on():
                raise CancelledError

        if not self.goes_on():
            return None
        try:
            done = self._attempt(problem, tell)
        except (CancelledError, UnboundedError, SoterError, EnclosureError):
            return None
        return done if self.goes_on() else None

    def stays(self, problem: Problem, leaving: LeavingRun | None) -> bool:
        """Whether the undisturbed run of a problem stays in C, and for longer than that one."""
        done = self._done(experiments.merged(problem, PILOT))
        if leaving is None or not done:
            return False
        model, until_s = PointModel(done[0]), LONGER * float(leaving.time_s[-1])
        trace = run(model, model.start, next(patterns(model)), until_s, self.goes_on)
        return not trace.left and trace.times[-1] > leaving.time_s[-1]

    def goes_on(self) -> bool:
        """Whether there is CPU time left."""
        return time.process_time() < self._until


def in_order(changes: Iterable[Remedy]) -> list[tuple[Remedy, Problem]]:
    """What is tried of some changes, few cells first: on merged cells each, then as it is.

    So that one grid of many cells does not take the time of all that would have been quick.
    """
    trials = []
    for change in changes:
        if change.problem is None:
            continue
        coarse = experiments.merged(change.problem, COARSE[1])
        if coarse.groups != change.problem.groups:
            trials.append((change, coarse))
        trials.append((change, change.problem))
    return sorted(trials, key=lambda trial: (trial[0].exchanged, cells_of(trial[1])))


def remedies(problem: Problem, failing: Sequence[str], result: ModuleResult) -> Iterator[Remedy]:
    """What may help where these claims fail; `result`: as nothing is changed.

    None of its problems is what was asked of `result`.
    """
    causes = [cause for claim in ORDER for cause in result.findings[claim].causes]
    if not (failing[0] == "P2a" and any(c.kind in HOPELESS for c in causes)):
        yield from _of_the_problem(problem, failing, result, causes)
    wall = any(c.kind == "one_sided" for c in causes)
    if failing[0] == "P2a" and result.findings["P2a"].leaving is not None and not wall:
        names = problem.module.symbol.sc.name, problem.module.symbol.ac.name
        said = "`ac {}; sc {};`, if that is what was meant".format(*names)
        yield Remedy(said, experiments.exchanged(problem), exchanged=True)


def _of_the_problem(
    problem: Problem, failing: Sequence[str], result: ModuleResult, causes: Sequence[Cause]
) -> Iterator[Remedy]:
    """With the controllers as they are."""
    for lost in (c for c in causes if c.kind == LOST):
        longer = experiments.longer_axes(problem, longer_of(lost, len(problem.states)))
        if longer.groups != problem.groups:
            yield Remedy(f"a longer axis: `{lines_of(longer)}`", longer)
    left = result.findings["P2a"].leaving
    if failing[0] == "P2a" and left is not None and not left.safe:
        at = left.names.index(left.axis)
        said = f"no ends where runs leave: `{lines_of(problem, at)}`"
        yield Remedy(said, experiments.without_ends(problem, at))
    if failing[0] != "P2a":
        said = "neither `ttf` nor `safer`: left out, both are computed"
        yield Remedy(said, experiments.predicates_left_out(problem))
    younger = experiments.younger_reads(problem)
    if younger is not None:
        yield Remedy(" and ".join(younger[1]), younger[0])
    grids = [g for g in problem.groups if g.representation == "grid"]
    if failing[0] != "P2a" and grids:
        smaller = replace(smaller_cells(problem, grids), declared_groups=())
        if cells_of(smaller) <= CELLS_MAX["P2a"]:
            yield Remedy(f"more cells: `{lines_of(smaller)}`", smaller)


def lines_of(problem: Problem, opened: int | None = None) -> str:
    """The `grid` lines of a problem, the axis of one state `open`."""
    return " ".join(
        f"grid {', '.join(_written(a, opened) for a in g.axes)};"
        for g in problem.groups
        if g.representation == "grid"
    )


def _written(axis: Axis, opened: int | None) -> str:
    edges = axis.edges[1:-1] if axis.unbounded else axis.edges
    edges = edges[:-1] if axis.open else edges
    low, high = map(axis.end, (edges[0], edges[-1]))
    said = f"{axis.name} in [{low}, {high}] / {len(edges) - 1}"
    if axis.open:
        return f"{said} open to {axis.end(axis.edges[-1])}"
    return f"{said} open" if axis.unbounded or axis.state == opened else said


def try_remedies(result: ModuleResult, cpu_s: float, attempt: Attempt) -> None:
    """Enter what was tried at the first claim that is not proved, where any is undecided.

    Changes are made one on top of the other, each kept where it helps, until all is proved.
    `cpu_s`: what the proof took, in CPU seconds.
    """
    failing = [c for c in ORDER if not result.findings[c].holds]
    findings = [result.findings[c] for c in failing]
    if all(f.verdict != UNDECIDED for f in findings) or any(SPENT in f.text for f in findings):
        return  # where work was cut short no change makes less of it
    trials = Trials(result.problem, cpu_s, attempt)
    problem, left = trials.problem, tuple(failing)
    helped: list[str] = []
    in_vain: list[str] = []
    untried: list[str] = []
    going = True
    while going and left and len(helped) < CHAIN_MAX:
        going = False
        for remedy, tried in in_order(remedies(problem, left, result)):
            if remedy.exchanged and not trials.stays(tried, result.findings["P2a"].leaving):
                continue
            phase(f"{problem.name}: trying {remedy.said}")
            now, as_it_is = trials.failing(tried), tried is remedy.problem
            better = now == () or (as_it_is and now is not None and _better(now, left))
            if better and now is not None:
                helped.append(remedy.said)
                problem, left, going = remedy.problem or problem, now, True
                break
            if as_it_is and now is not None:
                in_vain.append(remedy.said)
            elif as_it_is and not trials.goes_on():  # else it is no problem
                untried.append(remedy.said)
    first, told = result.findings[failing[0]], "; ".join
    if helped:
        first.remedied = None if left else problem
        then = f"all but {', '.join(left)} proved" if left else "every claim is proved"
        first.tried.append(f"with {told(helped)}: {then}")
        otherwise = f"; or {first.hint} {NOT_TRIED}" if left and first.hint else ""
        first.hint = f"{'; and '.join(helped)} (tried: {then}){otherwise}"
        for claim in failing[1:] if not left else ():
            result.findings[claim].hint = f"as for `{failing[0]}`: with that it is proved, too"
    if in_vain:
        first.tried.append(f"in vain: {told(dict.fromkeys(in_vain))}")
    if untried and left:
        first.tried.append(f"not, for want of time: {told(dict.fromkeys(untried))}")
    p3 = result.findings["P3"]
    p3.hint = next((f.hint for c in failing if (f := result.findings[c]).text == p3.text), p3.hint)


def _better(now: Sequence[str], left: Sequence[str]) -> bool:
    """Whether fewer claims fail, or SC keeps something at last."""
    return set(now) < set(left) or (left[0] == "P2a" and "P2a" not in now)


def mark_untried(result: ModuleResult) -> ModuleResult:
    """Say behind each suggestion that was not tried that it was not."""
    for finding in result.findings.values():
        if finding.hint and not any(word in finding.hint for word in ("tried", "as for `")):
            finding.hint += f" {NOT_TRIED}"
    return result
