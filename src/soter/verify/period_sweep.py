"""What the period of a decision module costs: sweeps of Delta and m.

Purpose: for multiples of the declared Delta the problem is derived again (H* follows; SC's period
is scaled with it only where it is Delta) and the sets recomputed: which share of the states is left
to AC, whether P1c and P2b hold, and the largest Delta for which everything is proved.
Non-goals: changing a program; certificates. Verdicts are those of `verify.py` without refinement.

The paper leaves the choice of Delta to future work. A short Delta leaves AC more room, a long one
costs less computing; m levels of hysteresis keep AC in control for at least (m - 1) Delta.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.model import typed
from soter.language.model.durations import show_ns
from soter.language.model.tree_walk import nodes
from soter.report.proof.advice import AdvicePage, Line
from soter.verify.claims import claims
from soter.verify.claims.cell_boxes import share
from soter.verify.claims.levels import deploy
from soter.verify.claims.levels import levels as add_levels
from soter.verify.claims.recovery import recover
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.grid.claims import Grids, grids
from soter.verify.grid.sets import UnboundedError
from soter.verify.problem.extract import cases, require_sets
from soter.verify.proof_methods import method_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from soter.verify.claims.case import Case, GroupProof
    from soter.verify.claims.results import GroupSets
    from soter.verify.enclose.engine_library import ReachLibrary
    from soter.verify.problem.problem import Problem

    Bools = NDArray[np.bool_]
    Progress = Callable[[float], None]

FACTORS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
LEVELS = (2, 3, 4)


@dataclass
class AdviceRow:
    """One Delta. Shares are of the grid's volume, products over groups, the least over cases.

    `levels`: m -> share of S_(m-2); `returns`: m -> whether P2b is proved with computed
    predicates; `written`: whether the program's own `ttf` and `safer` verify (None: it has none).
    """

    delta_ns: int
    sc_ns: int
    h_star_ns: int
    horizon_ns: int
    core: float = 0.0
    allowed: float = 0.0
    levels: dict[int, float] = field(default_factory=dict)
    returns: dict[int, bool] = field(default_factory=dict)
    starts: bool = False
    written: bool | None = None
    why: str = ""
    """What stands in the way, where something does."""

    @property
    def in_time(self) -> bool:
        """P1c."""
        return self.horizon_ns >= self.h_star_ns

    def verifies(self, levels: int) -> bool:
        """Whether everything is proved: with the program's predicates, or computed ones."""
        if not (self.in_time and self.starts):
            return False
        return self.written if self.written is not None else self.returns.get(levels, False)


@dataclass
class Advice:
    """The sweep of one module; `best_ns` is the largest Delta tried that verifies."""

    module: str
    delta_ns: int
    levels: int
    rows: list[AdviceRow]

    @property
    def best_ns(self) -> int | None:
        """The largest Delta that verifies; None where none of those tried does."""
        deltas_ns = [r.delta_ns for r in self.rows if r.verifies(self.levels)]
        return max(deltas_ns, default=None)

    @property
    def legend(self) -> str:
        """What the columns are shares of the grid of."""
        return (
            "shares of the grid: K, where SC keeps `safe`; S_0, where AC may have control; "
            "S_(m-2), where it gets it back with m levels of hysteresis"
        )

    @property
    def summary(self) -> str:
        """One sentence."""
        best = self.best_ns
        if best is None:
            return (
                "no period that was tried verifies on the grid as it is declared; `soter verify` "
                "refines it where that may help"
            )
        more = ", the longest that was tried" if best == self.rows[-1].delta_ns else ""
        return f"the largest period that verifies is {show_ns(best)}{more}"

    def table(self) -> tuple[list[str], list[list[str]]]:
        """(head, rows) for people."""
        tried = sorted({m for r in self.rows for m in r.levels})
        alone = 2 not in tried  # with two levels AC gets control back where it may have it: S_0
        head = ["period", "SC", "H*", "K", *(["S_0"] if alone else [])]
        head += [f"S_{m - 2} (m\u00a0=\u00a0{m})" for m in tried]
        head += ["P1c", "P2b", "verifies", "why not"]
        rows = []
        for r in self.rows:
            mark = " *" if r.delta_ns == self.delta_ns else ""
            times = [show_ns(r.delta_ns) + mark, show_ns(r.sc_ns), show_ns(r.h_star_ns)]
            shares = [r.core, *([r.allowed] if alone else [])]
            shares += [r.levels.get(m, 0.0) for m in tried]
            back = ", ".join(f"m\u00a0=\u00a0{m}" for m in tried if r.returns.get(m)) or "no"
            verifies = r.verifies(self.levels)
            cells = [*times, *(f"{s:.1%}" for s in shares), "yes" if r.in_time else "no", back]
            rows.append([*cells, "yes" if verifies else "no", "" if verifies else r.why])
        return head, rows

    def page(self) -> AdvicePage:
        """What the figure shows."""
        tried = sorted({m for r in self.rows for m in r.levels})
        curves = [Line("K", self._points(lambda r: r.core), tuple(r.core > 0 for r in self.rows))]
        for m in tried:
            name = "S_0 (m = 2)" if m == 2 else f"S_{m - 2} (m = {m})"
            sure = tuple(r.in_time and r.starts and r.returns.get(m, False) for r in self.rows)
            points = self._points(lambda r, m=m: r.levels.get(m, 0.0))  # type: ignore[misc]
            curves.append(Line(name, points, sure))
        head, rows = self.table()
        best = self.best_ns
        return AdvicePage(
            self.module,
            self.summary,
            tuple(curves),
            tuple(head),
            tuple(tuple(r) for r in rows),
            says=(f"{self.legend}.", "*: the period that the program says."),
            best_ms=None if best is None else best / 1e6,
        )

    def _points(self, share_of: Callable[[AdviceRow], float]) -> tuple[tuple[float, float], ...]:
        return tuple((r.delta_ns / 1e6, share_of(r)) for r in self.rows)


def advise(
    problem: Problem,
    factors: Sequence[float] = FACTORS,
    levels: Sequence[int] = LEVELS,
    progress: Progress | None = None,
) -> Advice:
    """Sweep Delta over multiples of the declared one, and m over `levels`.

    SoterError U001 where a group is no grid, R031 where there are no groups but an induction.
    """
    require_sets(problem)
    other = next((m.kind for m in map(method_of, problem.groups) if not isinstance(m, Grids)), None)
    if other is not None:
        message = f"module `{problem.name}` has a `{other}` group"
        notes = ("the sweep compares shares of grids",)
        raise SoterError((Diagnostic("U001", message, notes=notes),))
    library, _ = library_of(problem)
    wanted = sorted({*levels, problem.levels})
    every = _periods(problem, factors)
    advice = Advice(problem.name, problem.times.delta_dm, problem.levels, [])
    opened: dict[int, list[Case]] = {}
    for i, delta in enumerate(every):
        if progress is not None:
            phase(f"{problem.name}: a period of {show_ns(delta)}")
            progress(i / len(every))
        changed = at_period(problem, delta)
        times = changed.times
        row = AdviceRow(delta, times.delta_sc, times.h_star, times.horizon_ns)
        advice.rows.append(row)
        try:
            if times.delta_sc not in opened:
                opened[times.delta_sc] = _opened(changed, library)
            _fill(row, changed, opened[times.delta_sc], wanted)
        except UnboundedError as error:
            row.why = str(error)
    return advice


def advise_all(
    problems: Sequence[Problem],
    factors: Sequence[float],
    levels: Sequence[int],
    progress: Progress | None = None,
) -> list[Advice]:
    """`advise` for one problem after the other; `SoterError` U001 as there."""
    advices = []
    for i, problem in enumerate(problems):

        def tell(share: float, i: int = i) -> None:
            if progress is not None:
                progress((i + share) / len(problems))

        advices.append(advise(problem, factors, levels, tell))
    return advices


def _periods(problem: Problem, factors: Sequence[float]) -> list[int]:
    """Multiples of the declared Delta that are multiples of SC's period (a map: of its own)."""
    times = problem.times
    if _scales(problem):
        return sorted({max(1, round(f * times.delta_dm)) for f in factors})
    unit = times.delta_sc if problem.kind == "flow" else problem.plant_period_ns
    return sorted({max(1, round(f * times.delta_dm / unit)) * unit for f in factors})


def _scales(problem: Problem) -> bool:
    """Whether SC's period goes with Delta: a flow's where both are one, and SC reads no `dt`."""
    times = problem.times
    if problem.kind != "flow" or times.delta_sc != times.delta_dm:
        return False
    node = problem.system.components[problem.module.sc].node
    return node is not None and not any(isinstance(n, typed.PeriodRead) for n in nodes(node.step))


def at_period(problem: Problem, delta_ns: int) -> Problem:
    """The problem with another Delta; nothing else changes but SC's period where that was Delta.

    Phases stay: they are those of the calendar. The scheme's error is that of the plant's step.
    """
    times = problem.times
    schedule = times.schedule
    sc = delta_ns if _scales(problem) else times.delta_sc
    schedule = replace(
        schedule,
        dm=replace(schedule.dm, period=delta_ns),
        sc=replace(schedule.sc, period=sc),
    )
    law = problem.law
    if law is not None:
        law = replace(law, times=replace(law.times, schedule=schedule))
    return replace(problem, times=replace(times, schedule=schedule), law=law)


def _opened(problem: Problem, library: ReachLibrary) -> list[Case]:
    """Engines, C and K of every case: they do not depend on Delta."""
    open_cases = []
    for parameter in cases(problem):
        case = claims.open_case(problem, library, problem.groups, parameter, None)
        if claims.constraint(case):
            claims.core(case)
        open_cases.append(case)
    return open_cases


def _fill(row: AdviceRow, problem: Problem, opened: list[Case], wanted: list[int]) -> None:
    done = [_at(case, problem) for case in opened]
    row.core = _share(done, lambda g: g.core > 0)
    broken = next((f for c in opened for f in c.failed("P2a")), None)
    if broken is not None:
        row.why = broken.text
        return
    for case in done:
        claims.free_phase(case)
        claims.start(case)
    row.starts = not any(c.failed("start") for c in done)
    if not problem.computed:
        row.written = all(_own(case) for case in done)
    for m in wanted:
        computed = replace(problem, computed=True, levels=m)
        tried = [_at(case, computed) for case in done]
        for case in tried:
            add_levels(case)
        deploy(tried)
        row.allowed = _share(tried, lambda g: _held(g, 0))
        row.levels[m] = _share(tried, lambda g: _held(g, 1))
        row.returns[m] = row.levels[m] > 0.0 and all(_returns(case) for case in tried)
    row.why = row.why or _why(row, done)


def _at(case: Case, problem: Problem) -> Case:
    """The same engines and sets for another problem; nothing has failed yet."""
    proofs: list[GroupProof] = [replace(p, found=replace(p.found)) for p in grids(case.proofs)]
    return replace(case, problem=problem, proofs=proofs, failures=[], spent={}, counts={})


def _own(case: Case) -> bool:
    """Whether the program's predicates verify at this period: `ttf`, `safer`, P2b."""
    for predicate in ("ttf", "safer"):
        claims.inclusion(case, predicate)
    if not case.problem.stays:
        recover(case)
    return not any(case.failed(c) for c in ("ttf", "safer", "P2b"))


def _held(part: GroupSets, which: int) -> Bools:
    """S_0 or S_(m-2) as the DM would hold it for all cases; grids always have a table."""
    assert part.deployed is not None
    return part.deployed[which]


def _returns(case: Case) -> bool:
    """Whether P2b is shown, or not asked (`recover never`)."""
    if case.problem.stays:
        return True
    recover(case)
    return not case.failed("P2b")


def _why(row: AdviceRow, done: list[Case]) -> str:
    """The first thing that stands in the way."""
    if not row.in_time:
        return "the declared horizon is shorter than H*"
    return next((f.text for c in done for f in c.failures), "")


def _share(done: list[Case], cells: Callable[[GroupSets], Bools]) -> float:
    least = 1.0
    for case in done:
        one = 1.0
        for grid in grids(case.proofs):
            one *= share(np.asarray(cells(grid.found), dtype=np.bool_), grid.engine.edges)
        least = min(least, one)
    return least
