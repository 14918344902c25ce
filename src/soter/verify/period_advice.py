"""Tries other times of a module for `soter advise`: other periods, and later commands.

Purpose: `sweep_periods` derives the problem again for multiples of the declared Delta, the period
of the DM (H* follows; SC's period stays, unless it equals Delta). It computes the sets: the share
of the states that is left to AC, whether P1c and P2b hold, and the largest Delta for which
everything is proved. `largest_delay` verifies the module again with longer and longer values of
`acts within`. It finds the largest proved one, the smallest one that failed, and why that failed.
Non-goals: changing a program; certificates; a bound that nobody verified. Verdicts of the sweep are
those of `verify_module.py` without finer grids.

The paper leaves the choice of Delta to future work. A short Delta leaves AC more room, a long one
costs less computing; m levels of hysteresis keep AC in control for at least (m - 1) Delta.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.current_phase import between, phase, share_done
from soter.diagnostics.diagnostic import SoterError
from soter.language.model import typed
from soter.language.model.system import LEVELS_LEAST
from soter.language.model.tree_walk import nodes
from soter.language.model.types import DURATION, show_ns, write_ns
from soter.report.proof_page import AdvicePage, Line
from soter.verify.claims import claims, start
from soter.verify.claims.claims import compute_levels, find_way_back, make_tables
from soter.verify.claims.results import PROVED
from soter.verify.diagnosis.variations import problem_of_changed_module, problem_with_periods
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.grid.group_model import UnboundedError
from soter.verify.grid.set_figures import volume_share
from soter.verify.problem.extract import extract, parameter_cases, require_proof_by_sets
from soter.verify.problem.time_checks import why_late_commands_uncovered
from soter.verify.verify_module import module_method

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.core.layout import Bools
    from soter.language.model.system import Module, System
    from soter.verify.claims.results import GroupSets
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.grid.case import Case
    from soter.verify.grid.claims import GridProof
    from soter.verify.grid.sets import GridGroup
    from soter.verify.problem.problem import Problem

    Progress = Callable[[float], None]

FACTORS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
LEVELS = (2, 3, 4)


@dataclass
class AdviceRow:
    """One row of the sweep, for one Delta and one period of SC.

    Shares are of the grid's volume: products over groups, and the least of all cases. `levels` has
    by m the share of S_(m-2); `returns` has by m whether P2b is proved with computed predicates;
    `written` says whether the program's `ttf` and `safer` verify (None if it has none).
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
    """The claim that is not proved, in words; "" if all are proved."""
    covered: bool = True
    """Whether the theorem covers such times; if not, no set was computed."""

    @property
    def in_time(self) -> bool:
        """Whether P1c holds, which means that the look-ahead is long enough."""
        return self.horizon_ns >= self.h_star_ns

    def verifies(self, levels: int) -> bool:
        """Whether everything is proved, with predicates of the program or with computed ones."""
        if not (self.in_time and self.starts):
            return False
        return self.written if self.written is not None else self.returns.get(levels, False)


OF_TIMES = (
    "period, SC: of the DM and of SC; P2b: the m with which SC gives control back.",
    "H*: at worst, from a state to SC's command that acts on it.",
    "*: the period that the program says.",
)
"""The words of a page about the columns that are no shares."""


@dataclass
class Advice:
    """The sweep of one module, with a row for each pair of periods that was tried."""

    module: str
    delta_ns: int
    levels: int
    rows: list[AdviceRow]

    @property
    def best_ns(self) -> int | None:
        """The largest tried Delta in ns that verifies; None if none does."""
        deltas_ns = [r.delta_ns for r in self.rows if r.verifies(self.levels)]
        return max(deltas_ns, default=None)

    @property
    def legend(self) -> str:
        """The words that explain the columns of shares."""
        return (
            "shares of the grid: K, where SC keeps `safe`; S_0, where AC may have control; "
            "S_(m-2), where it gets it back with m levels of hysteresis"
        )

    @property
    def summary(self) -> str:
        """The result of the sweep in one sentence."""
        best = self.best_ns
        if best is None:
            return (
                f"no period that was tried ({self.periods_tried}) verifies on the grid as it is "
                "declared; `soter verify` refines it where that may help"
            )
        more = ", the longest" if best == self.rows[-1].delta_ns else ""
        return (
            f"of the periods tried ({self.periods_tried}) the largest that verifies on the grid as "
            f"it is declared is {show_ns(best)}{more}"
        )

    @property
    def periods_tried(self) -> str:
        """The DM's periods that were tried, and whether SC's period changed with them, in words."""
        deltas = ", ".join(show_ns(d) for d in sorted({r.delta_ns for r in self.rows}))
        kept = sorted({r.sc_ns for r in self.rows if r.sc_ns != r.delta_ns})
        says = [f"kept at {show_ns(ns)}" for ns in kept]
        changes = len({r.sc_ns for r in self.rows}) > 1
        says += ["changed with it"] * changes
        return f"{deltas}; SC's period {' and '.join(says)}" if says else deltas

    def table(self) -> tuple[list[str], list[list[str]]]:
        """The head and the rows of the table, as texts for people."""
        tried = sorted({m for r in self.rows for m in r.levels})
        alone = 2 not in tried  # with two levels AC gets control back where it may have it: S_0
        head = ["period", "SC", "H*", "K", *(["S_0"] if alone else [])]
        head += [f"S_{m - 2} (m\u00a0=\u00a0{m})" for m in tried]
        head += ["P1c", "P2b", "verifies", "why not"]
        return head, [self._row_cells(r, tried, alone=alone) for r in self.rows]

    def _row_cells(self, r: AdviceRow, tried: list[int], *, alone: bool) -> list[str]:
        mark = " *" if r.delta_ns == self.delta_ns else ""
        times = [show_ns(r.delta_ns) + mark, show_ns(r.sc_ns), show_ns(r.h_star_ns)]
        shares = [r.core, *([r.allowed] if alone else [])]
        shares += [r.levels.get(m, 0.0) for m in tried]
        back = ", ".join(f"m\u00a0=\u00a0{m}" for m in tried if r.returns.get(m)) or "no"
        verifies = r.verifies(self.levels)
        shown = [f"{s:.1%}" if r.covered else "-" for s in shares]
        cells = [*times, *shown, "yes" if r.in_time else "no", back]
        return [*cells, "yes" if verifies else "no", "" if verifies else r.why]

    def page(self, program: str = "") -> AdvicePage:
        """The data of the page with the figure; `program` is the program's file."""
        tried = sorted({m for r in self.rows for m in r.levels})
        drawn = self._drawn_rows
        curves = [Line("K", self._curve(lambda r: r.core), tuple(r.core > 0 for r in drawn))]
        for m in tried:
            sure = tuple(r.in_time and r.starts and r.returns.get(m, False) for r in drawn)
            points = self._curve(lambda r, m=m: r.levels.get(m, 0.0))  # type: ignore[misc]
            curves.append(Line(f"S_{m - 2} (m = {m})", points, sure))
        head, rows = self.table()
        best = self.best_ns
        return AdvicePage(
            self.module,
            self.summary,
            tuple(curves),
            tuple(head),
            tuple(tuple(r) for r in rows),
            says=(f"{self.legend}.", *OF_TIMES, *self._notes_on_undrawn),
            best_ms=None if best is None else best / 1e6,
            program=program,
        )

    def _curve(self, share_of: Callable[[AdviceRow], float]) -> tuple[tuple[float, float], ...]:
        return tuple((r.delta_ns / 1e6, share_of(r)) for r in self._drawn_rows)

    @property
    def _drawn_rows(self) -> list[AdviceRow]:
        """For each Delta with computed sets, the row with the longest period of SC."""
        return list({r.delta_ns: r for r in self.rows if r.covered}.values())

    @property
    def _notes_on_undrawn(self) -> tuple[str, ...]:
        """Notes on the rows that the table shows but the figure does not."""
        if sum(r.covered for r in self.rows) == len(self._drawn_rows):
            return ()
        return ("Drawn where SC's period is changed with \u0394; the table has both.",)


def sweep_periods(
    problem: Problem, factors: Sequence[float] = FACTORS, levels: Sequence[int] = LEVELS
) -> Advice:
    """Sweeps Delta over multiples of the declared Delta, and m over `levels`.

    Raises `SoterError` R031 for a module that is proved by induction.
    """
    require_proof_by_sets(problem)
    library, _ = library_of(problem)
    level_numbers = sorted({*levels, problem.levels})
    periods = _periods_to_try(problem, factors)
    advice = Advice(problem.name, problem.times.delta_dm, problem.levels, [])
    opened: dict[int, list[Case]] = {}
    for i, (delta, sc) in enumerate(periods):
        phase(f"{problem.name}: a period of {show_ns(delta)}")
        share_done(i / len(periods))
        changed = problem_with_periods(problem, delta, sc)
        times = changed.times
        row = AdviceRow(delta, times.delta_sc, times.h_star, times.horizon_ns)
        row.why = _why_times_uncovered(changed)
        row.covered = not row.why
        advice.rows.append(row)
        if not row.covered:
            continue
        try:
            if times.delta_sc not in opened:
                opened[times.delta_sc] = _cases_with_core(changed, library)
            _fill_row(row, changed, opened[times.delta_sc], level_numbers)
        except UnboundedError as error:
            row.why = str(error)
        if problem.levels_open and delta == advice.delta_ns and not row.verifies(advice.levels):
            advice.levels = LEVELS_LEAST if row.verifies(LEVELS_LEAST) else advice.levels
    return advice


def sweep_all(
    problems: Sequence[Problem], factors: Sequence[float], levels: Sequence[int]
) -> list[Advice]:
    """The sweep of each problem; raises `SoterError` R031 for a module proved by induction."""
    advices = []
    for i, problem in enumerate(problems):
        with between(i / len(problems), (i + 1) / len(problems)):
            advices.append(sweep_periods(problem, factors, levels))
    return advices


def _periods_to_try(problem: Problem, factors: Sequence[float]) -> list[tuple[int, int]]:
    """The pairs (Delta, SC's period) to try, in ns, for multiples of the declared Delta.

    SC's period changes with Delta or stays. If it stays, each Delta is a multiple of SC's period;
    for a map, of the map's period.
    """
    times = problem.times
    unit = times.delta_sc if problem.kind == "flow" else problem.plant_period_ns
    every = {max(1, round(f * times.delta_dm / unit)) * unit for f in factors}
    pairs = {(delta, times.delta_sc) for delta in every}
    if _sc_period_follows(problem):
        scaled = {max(1, round(f * times.delta_dm)) for f in factors}
        longer = {(delta, sc) for delta, sc in pairs if delta > sc}
        pairs = longer | {(delta, delta) for delta in scaled}
    return sorted(pairs)


def _sc_period_follows(problem: Problem) -> bool:
    """Whether SC's period changes with Delta: in a flow with equal periods and no `dt` in SC."""
    times = problem.times
    if problem.kind != "flow" or times.delta_sc != times.delta_dm:
        return False
    node = problem.system.components[problem.module.sc].node
    return node is not None and not any(isinstance(n, typed.PeriodRead) for n in nodes(node.step))


def _why_times_uncovered(problem: Problem) -> str:
    """Why the theorem does not cover the times of a changed problem; "" if it covers them.

    These are the conditions of `check_times` on the periods of the DM and of SC.
    """
    schedule, jitter = problem.times.schedule, problem.times.jitter_sc
    dm, sc = schedule.dm, schedule.sc
    ac = problem.system.components[problem.module.ac]
    if ac.period_ns > dm.period:
        return f"P1a: AC steps every {show_ns(ac.period_ns)}"
    if dm.latest > dm.period:
        return f"R015: the DM may take {show_ns(dm.latest)}, longer than its period"
    if problem.kind == "map":
        return ""
    if schedule.latest_output > sc.period:
        return f"R015: SC may take {show_ns(schedule.latest_output)}, longer than its period"
    if not schedule.are_windows_short and why_late_commands_uncovered(
        problem.module.symbol, schedule
    ):
        return f"R015: SC may act {show_ns(jitter)} late, more than half of its period"
    for path in schedule.read_by_sc:
        oldest = schedule.stamp_age_sc(path)
        if path.max_age is not None and oldest > path.max_age:
            return f"R011: SC may read what is {show_ns(oldest)} old, longer than its `max_age`"
    if any(o.skipping_node(sc, schedule.latest_output) is not None for o in schedule.outputs):
        return "R018: a node may miss a command of SC"
    return ""


def _cases_with_core(problem: Problem, library: ReachLibrary) -> list[Case]:
    """Every case with its engines, and with C and K, which do not depend on Delta."""
    open_cases = []
    for parameter in parameter_cases(problem):
        case = claims.open_case(problem, library, problem.groups, parameter)
        if claims.compute_constraint(case):
            claims.compute_core(case)
        open_cases.append(case)
    return open_cases


def _fill_row(row: AdviceRow, problem: Problem, opened: list[Case], wanted: list[int]) -> None:
    """Computes a row from cases with K; `wanted` has the numbers of levels to try."""
    row_cases = [_case_for_problem(case, problem) for case in opened]
    row.core = _least_share(row_cases, lambda g: g.core > 0)
    broken = next((f for c in opened for f in c.failures_of("P2a")), None)
    if broken is not None:
        row.why = broken.text
        return
    for case in row_cases:
        claims.compute_free_states(case)
        start.check_start(case)
    row.starts = not any(c.failures_of("start") for c in row_cases)
    if not problem.computed:
        row.written = all(_declared_predicates_verify(case) for case in row_cases)
    for m in wanted:
        computed = replace(problem, computed=True, levels=m)
        tried = [_case_for_problem(case, computed) for case in row_cases]
        for case in tried:
            compute_levels(case)
        make_tables(tried)
        row.allowed = _least_share(tried, lambda g: _level_in_table(g, 0))
        row.levels[m] = _least_share(tried, lambda g: _level_in_table(g, 1))
        row.returns[m] = row.levels[m] > 0.0 and all(_is_return_shown(case) for case in tried)
    late = [] if row.in_time else ["the declared horizon is shorter than H*"]
    stands = (*late, *(f.text for c in row_cases for f in c.failures), "")
    row.why = row.why or stands[0]


def _case_for_problem(case: Case, problem: Problem) -> Case:
    """The case for another problem, with the same engines and sets, without failures."""
    proofs: list[GridProof] = [replace(p, found=replace(p.found)) for p in case.proofs]
    return replace(case, problem=problem, proofs=proofs, failures=[], spent={}, counts={})


def _declared_predicates_verify(case: Case) -> bool:
    """Whether `ttf`, `safer` and P2b are proved with the program's predicates at this period."""
    for predicate in ("ttf", "safer"):
        claims.check_inclusion(case, predicate)
    return _is_return_shown(case) and not any(case.failures_of(c) for c in ("ttf", "safer"))


def _level_in_table(part: GroupSets, which: int) -> Bools:
    """The set S_0 (`which` 0) or S_(m-2) (1) that the DM would have for all cases."""
    assert part.deployed is not None
    return part.deployed[which]


def _is_return_shown(case: Case) -> bool:
    """Whether P2b is shown, or not required (`recover never`)."""
    if case.problem.stays:
        return True
    find_way_back(case)
    return not case.failures_of("P2b")


def _least_share(done: list[Case], cells: Callable[[GroupSets], Bools]) -> float:
    def share_of_group(part: GroupSets, engine: GridGroup) -> float:
        return volume_share(np.asarray(cells(part), dtype=np.bool_), engine.edges)

    return min((1.0, *(prod(share_of_group(g.found, g.engine) for g in c.proofs) for c in done)))


CLOSE = 0.1
"""The search ends if the least value that failed is within this share of the largest proved."""
TRIES_MAX = 14
"""The most verifications of a module."""
FIRST = 0.1
"""The first step, as a share of SC's period."""


@dataclass
class DelayAdvice:
    """The declared value of `acts within`, and each value that was tried with what failed."""

    module: str
    declared_ns: int
    least_ns: int = 0
    """The declared least time until a command acts, which is not changed."""
    why_not: dict[int, str] = field(default_factory=dict)
    """For each value in ns, in the order of trials, why it is not proved; "" if it is proved."""

    @property
    def largest_ns(self) -> int | None:
        """The largest delay in ns with which all claims are proved; None if no delay is proved."""
        return max((ns for ns, why in self.why_not.items() if not why), default=None)

    @property
    def refused_ns(self) -> int | None:
        """The least failed delay in ns above the largest proved delay; None if none failed."""
        least = self.largest_ns if self.largest_ns is not None else -1
        return min((ns for ns, why in self.why_not.items() if why and ns > least), default=None)

    @property
    def summary(self) -> str:
        """The result of the trials in one or two sentences."""
        largest, refused = self.largest_ns, self.refused_ns
        if largest is None:
            why = self.why_not[self.declared_ns]
            return f"not proved with `{self._written(self.declared_ns)}` as declared: {why}"
        more = show_ns(largest - self.declared_ns)
        text = f"commands may act {show_ns(largest)} late, {more} more than declared, "
        text += f"and everything is proved: `{self._written(largest)}`"
        if refused is None:
            return f"{text}; nothing longer was tried"
        return f"{text}; not with {show_ns(refused)}: {self.why_not[refused]}"

    def _written(self, most_ns: int) -> str:
        """The clause of the program with this longest delay."""
        least = f"{write_ns(self.least_ns)} to " if self.least_ns else ""
        return f"acts within {least}{write_ns(most_ns)}"


def largest_delay(flat: System, module: Module) -> DelayAdvice:
    """Verifies a module of a flat system with longer and longer delays of the commands.

    Times that the theorem does not cover count as not proved. Raises `SoterError` if the problem
    cannot be posed as declared.
    """
    problem = extract(flat, module)
    advice = DelayAdvice(module.name, problem.times.acts, problem.times.acts_least)
    proved, failed = advice.declared_ns, None
    while len(advice.why_not) < TRIES_MAX:
        acts_ns = _next_delay(proved, failed, advice, problem.times.delta_sc)
        if acts_ns is None:
            break
        phase(f"{module.name}: commands that act {show_ns(acts_ns)} late")
        share_done(len(advice.why_not) / TRIES_MAX)
        advice.why_not[acts_ns] = _failing_claim_in_words(flat, module, acts_ns)
        if advice.why_not[acts_ns]:
            failed = acts_ns
        else:
            proved = acts_ns
        if failed == advice.declared_ns:
            break
    return advice


def _next_delay(proved: int, failed: int | None, advice: DelayAdvice, period_ns: int) -> int | None:
    """The next delay to try, in ns: the declared one, longer ones, a middle; None at the end."""
    if not advice.why_not:
        return advice.declared_ns
    if failed is None:
        more = 2 * (proved - advice.declared_ns)
        return advice.declared_ns + max(more, _rounded_to_two_digits(FIRST * period_ns))
    middle = _rounded_to_two_digits((proved + failed) / 2)
    near = failed - proved <= CLOSE * max(proved, FIRST * period_ns)
    return None if near or not proved < middle < failed else middle


def _rounded_to_two_digits(ns: float) -> int:
    """A time rounded to two digits, which makes it easy to read."""
    return max(1, int(float(f"{ns:.2g}")))


def _failing_claim_in_words(flat: System, module: Module, acts_ns: int) -> str:
    """The first unproved claim if commands act after `acts_ns`, in words; "" if all are proved."""
    at = module.symbol.verify.span or module.symbol.span
    verify = replace(module.symbol.verify, acts=typed.Literal(DURATION, at, acts_ns))
    changed = replace(module, symbol=replace(module.symbol, verify=verify))
    try:
        problem = problem_of_changed_module(flat, changed)
        result = module_method(problem).verify(problem, refute=False, explain=False)
    except SoterError as error:
        first = error.diagnostics[0]
        return f"{first.code}: {first.message}"
    if result.verdict == PROVED:
        return ""
    claim, finding = next((c, f) for c, f in result.findings.items() if f.verdict == result.verdict)
    return f"{claim} {finding.verdict}: {finding.text}"
