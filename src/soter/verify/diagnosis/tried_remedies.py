"""What to write, tried before it is said.

Purpose: for a module that is not proved one loop: change what a person could change, prove again
within a bound on its CPU time, few cells first, and keep what helps. Those that helped, those
that did not, and those that were not tried are told apart.
Non-goals: verdicts: nothing of it is claimed of the program as it is; other laws, other plants.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError
from soter.verify.claims.case import SPENT
from soter.verify.claims.choice import CELLS_MAX
from soter.verify.claims.grid_refinement import cells_of, smaller_cells
from soter.verify.claims.results import UNDECIDED
from soter.verify.diagnosis import changed_problems
from soter.verify.diagnosis.experiments import COARSE
from soter.verify.diagnosis.grid_end_failures import LOST, longer_of
from soter.verify.diagnosis.model_runs import PointModel, patterns, run
from soter.verify.diagnosis.vacuity import vacuity
from soter.verify.enclose.c_emitter import EnclosureError
from soter.verify.grid.sets import CancelledError, UnboundedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from soter.verify.claims.case import Case
    from soter.verify.claims.results import Cause, LeavingRun, ModuleResult
    from soter.verify.problem.problem import Axis, Problem

    Tell = Callable[[str, float], None]
    Attempt = Callable[[Problem, Tell], list[Case]]

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
        done = self._done(changed_problems.merged(problem, PILOT))
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
        coarse = changed_problems.merged(change.problem, COARSE[1])
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
        yield Remedy(said, changed_problems.exchanged(problem), exchanged=True)


def _of_the_problem(
    problem: Problem, failing: Sequence[str], result: ModuleResult, causes: Sequence[Cause]
) -> Iterator[Remedy]:
    """With the controllers as they are."""
    for lost in (c for c in causes if c.kind == LOST):
        longer = changed_problems.longer_axes(problem, longer_of(lost, len(problem.states)))
        if longer.groups != problem.groups:
            yield Remedy(f"a longer axis: `{lines_of(longer)}`", longer)
    left = result.findings["P2a"].leaving
    if failing[0] == "P2a" and left is not None and not left.safe:
        at = left.names.index(left.axis)
        said = f"no ends where runs leave: `{lines_of(problem, at)}`"
        yield Remedy(said, changed_problems.without_ends(problem, at))
    if failing[0] != "P2a":
        said = "neither `ttf` nor `safer`: left out, both are computed"
        yield Remedy(said, changed_problems.predicates_left_out(problem))
    younger = changed_problems.younger_reads(problem)
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
