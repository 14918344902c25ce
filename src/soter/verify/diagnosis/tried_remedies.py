"""What to write, tried before it is said.

Purpose: for a module that is not proved: changes that a person could make, one after the other,
each verified with a bound on its CPU time, on merged cells first; those that helped, those that did
not, and those that were not tried are told apart. Where SC keeps nothing: whether AC would.
Non-goals: verdicts: nothing of it is claimed of the program as it is; other laws, other plants.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError
from soter.verify.claims.grid_refinement import smaller_cells
from soter.verify.claims.results import UNDECIDED, Cause
from soter.verify.diagnosis import changed_problems
from soter.verify.diagnosis.experiments import COARSE
from soter.verify.diagnosis.grid_end_failures import LOST, longer_of
from soter.verify.diagnosis.vacuity import vacuity
from soter.verify.enclose.c_emitter import EnclosureError
from soter.verify.grid.sets import CancelledError, UnboundedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.verify.claims.case import Case
    from soter.verify.claims.results import Finding, ModuleResult
    from soter.verify.problem.problem import Axis, Problem

    Tell = Callable[[str, float], None]
    Attempt = Callable[[Problem, Tell], list[Case]]

LEAST_S, OF_PROOF = 8.0, 1.0
"""CPU seconds that all trials of a module get: so many, or so often what the proof has taken."""
CHAIN_MAX = 3
"""So many changes are made together at most."""
MEASURED = (
    *("cells", "border", "sooner", "grid_end", "start_late", "start_not_in_core", "computed"),
    *("no_target", "scaled", "outside_core", LOST),
)
"""Causes whose remedy comes from a measurement of what it changes."""
HOPELESS = ("wrap_around", "drift_of_all")
"""Causes that no other grid, age or predicate mends."""
ORDER = ("P2a", "ttf", "safer", "start", "P2b")
EXCHANGED = "`ac {}; sc {};`, if that is what was meant"
LEFT_OUT = "neither `ttf` nor `safer`: left out, both are computed"


@dataclass(frozen=True)
class Remedy:
    """A change: what to write, and the problem that it makes; None: it was not tried."""

    said: str
    problem: Problem | None


class Trials:
    """Verifications of changed problems of one module, and what they took."""

    def __init__(self, problem: Problem, cpu_s: float, attempt: Attempt) -> None:
        self.problem, self._attempt = problem, attempt
        self._until = time.process_time() + max(LEAST_S, OF_PROOF * cpu_s)

    def failing(self, problem: Problem) -> tuple[str, ...] | None:
        """The claims that are not proved of a problem, in order; None: that was not seen.

        An AC that never has control counts as a failure of `ttf`.
        """
        coarse = changed_problems.merged(problem, COARSE[1])
        found = None
        for one in (coarse, problem) if coarse.groups != problem.groups else (problem,):
            found = self._failing(one)
            if found == ():
                break
        return found

    def coarsely(self, problem: Problem) -> list[Case] | None:
        """All cases on merged cells alone; None where time does not suffice."""
        return self._done(changed_problems.merged(problem, COARSE[1]))

    def _failing(self, problem: Problem) -> tuple[str, ...] | None:
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

    def goes_on(self) -> bool:
        """Whether there is CPU time left."""
        return time.process_time() < self._until


def remedies(
    problem: Problem, failing: Sequence[str], leaves: int | None, lost: Cause | None = None
) -> Iterator[Remedy]:
    """What may help where these claims fail, the cheapest first.

    `leaves`: the state by whose end of the grid a run leaves under SC where `safe` holds. `lost`:
    that K is lost at ends of the grid.
    """
    younger = changed_problems.younger_reads(problem)
    if lost is not None:
        ends = longer_of(lost, len(problem.states))
        longer = changed_problems.longer_axes(problem, ends)
        if longer.groups != problem.groups:
            yield Remedy(f"a longer axis: `{_lines(longer)}`", longer)
    if failing[0] == "P2a":
        opened = None if leaves is None else changed_problems.without_ends(problem, leaves)
        if opened is not None:
            yield Remedy(f"no ends where runs leave: `{_lines(problem, leaves)}`", opened)
        if younger is not None:
            yield Remedy(" and ".join(younger[1]), younger[0])
        return
    if not problem.computed:
        yield Remedy(LEFT_OUT, changed_problems.predicates_left_out(problem))
    if younger is not None:
        yield Remedy(" and ".join(younger[1]), younger[0])
    grids = [g for g in problem.groups if g.representation == "grid"]
    if grids:
        smaller = replace(smaller_cells(problem, grids), declared_groups=())
        yield Remedy(f"more cells: `{_lines(smaller)}`", smaller)


def _lines(problem: Problem, opened: int | None = None) -> str:
    """The `grid` lines of a problem, the axis of one state `open`."""
    return " ".join(
        f"grid {', '.join(_written(a, opened) for a in g.axes)};"
        for g in problem.groups
        if g.representation == "grid"
    )


def _written(axis: Axis, opened: int | None) -> str:
    edges = axis.edges[1:-1] if axis.unbounded else axis.edges
    edges = edges[:-1] if axis.open else edges
    said = f"{axis.name} in [{edges[0]:.6g}, {edges[-1]:.6g}] / {len(edges) - 1}"
    if axis.open:
        return f"{said} open to {axis.edges[-1]:.6g}"
    return f"{said} open" if axis.unbounded or axis.state == opened else said


def try_remedies(result: ModuleResult, cpu_s: float, attempt: Attempt) -> None:
    """Enter what was tried at the first claim that is undecided; its `help` says no more than that.

    AC in the place of SC is tried where SC keeps nothing, also where a run refutes that. `cpu_s`:
    what the proof took, in CPU seconds.
    """
    failing = [c for c in ORDER if not result.findings[c].holds]
    if not failing:
        return
    trials = Trials(result.problem, cpu_s, attempt)
    first = result.findings[failing[0]]
    if failing[0] == "P2a" and _exchanged(trials, first):
        return
    if any(result.findings[c].verdict == UNDECIDED for c in failing):
        _try_all(trials, result, failing)
    p3 = result.findings["P3"]
    p3.hint = next(
        (f.hint for f in map(result.findings.get, failing) if f and f.text == p3.text), p3.hint
    )


def _exchanged(trials: Trials, finding: Finding) -> bool:
    """Whether AC keeps a set, where SC keeps none."""
    problem = changed_problems.exchanged(trials.problem)
    done = None if problem is None else trials.coarsely(problem)
    if done is None or any(case.failed("P2a") for case in done):
        return False
    symbol = trials.problem.module.symbol
    share = min(
        (p.core_share for case in done for p in case.proofs if p.core_share is not None),
        default=1.0,
    )
    text = f"`{symbol.ac.name}`, which is AC, keeps C from {share:.1%} of it, and "
    text += f"`{symbol.sc.name}`, which is SC, from nowhere: they may stand in each other's place"
    hint = EXCHANGED.format(symbol.sc.name, symbol.ac.name)
    finding.causes.insert(0, Cause("exchanged", text, hint, (("share_of_C", share),)))
    finding.hint = hint
    return True


def _try_all(trials: Trials, result: ModuleResult, failing: Sequence[str]) -> None:
    """Changes one on top of the other, each kept where it helps, until all is proved."""
    if any(c.kind in HOPELESS for c in result.findings["P2a"].causes):
        return  # nothing of this kind helps there
    problem, left = trials.problem, tuple(failing)
    leaves = _left_by(result.findings["P2a"])
    causes = (cause for claim in failing for cause in result.findings[claim].causes)
    lost = next((cause for cause in causes if cause.kind == LOST), None)
    helped: list[str] = []
    in_vain: list[str] = []
    untried: list[str] = []
    while left and len(helped) < CHAIN_MAX:
        for remedy in remedies(problem, left, leaves, lost):
            phase(f"{trials.problem.name}: trying {remedy.said}")
            now = None if remedy.problem is None else trials.failing(remedy.problem)
            if now is None:
                untried += [] if trials.goes_on() else [remedy.said]  # else it is no problem
            elif remedy.problem is not None and _better(now, left):
                helped.append(remedy.said)
                problem, left = remedy.problem, now
                break
            else:
                in_vain.append(remedy.said)
        else:
            break
    _enter(result, failing, left, (helped, in_vain, untried))
    if not left:
        result.findings[failing[0]].remedied = problem


def _left_by(finding: Finding) -> int | None:
    """The state by whose end of the grid a run leaves where `safe` holds."""
    run = finding.leaving
    return None if run is None or run.safe else run.names.index(run.axis)


def _better(now: Sequence[str], before: Sequence[str]) -> bool:
    """Whether fewer claims fail, or K is there where it was not."""
    return set(now) < set(before) or (before[0] == "P2a" and "P2a" not in now)


def _enter(
    result: ModuleResult,
    failing: Sequence[str],
    left: Sequence[str],
    tried: tuple[list[str], list[str], list[str]],
) -> None:
    helped, in_vain, untried = tried
    finding = result.findings[failing[0]]
    if LEFT_OUT in (*helped, *in_vain):
        for claim in failing:
            other = result.findings[claim]
            other.hint = other.hint.replace(f"; or {LEFT_OUT}", "").removeprefix(f"or {LEFT_OUT}")
    if helped:
        what = "; and ".join(helped)
        then = f"{', '.join(left)} still not" if left else "every claim is proved"
        finding.tried.append(f"with {what}: {then}")
        if any(c.kind == LOST for c in finding.causes):
            finding.hint = ""  # the same ends, not tried
        otherwise = f"; or {finding.hint}" if finding.hint else ""
        finding.hint = f"{what} (tried: {then}){otherwise}"
        for claim in failing[1:] if not left else ():
            other = result.findings[claim]
            otherwise = f"; or {other.hint}" if other.hint else ""
            other.hint = f"as for `{failing[0]}`: with that it is proved, too{otherwise}"
    elif finding.hint and not any(c.kind in MEASURED for c in finding.causes if c.hint):
        finding.hint += " (not tried)"
    if in_vain:
        finding.tried.append(f"in vain: {'; '.join(dict.fromkeys(in_vain))}")
    if untried and not (helped and not left):
        finding.tried.append(f"not, for want of time: {'; '.join(dict.fromkeys(untried))}")
