"""Watches one decision module while a log is replayed.

Purpose: `ModuleWatch` notes the steps of a DM, what they decided and how far `ttf` and `safe` were
from changing.
Non-goals: stepping (`log_replay.py`), what a judgement means (`log_judgement.py`).
"""

from __future__ import annotations

from math import copysign, isinf
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.predicates import PredicateEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.monitor.log_judgement import LoggedModeChange, ModuleOfLog, NearestMargin
from soter.monitor.predicate_margins import PredicateMargins, PredicatePosition
from soter.semantics.configuration import AC, DecisionVerdict
from soter.simulate.decisions import PredicateValues, decision_reason

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.evaluate.environment import Environment
    from soter.language.model.system import Module
    from soter.monitor.predicate_margins import Distance

AGAINST = PredicatePosition(sense=-1.0)
"""The position of `ttf`: the further `ttf` is from holding, the better."""


class ModuleWatch:
    """Counts and measures the steps of one DM."""

    def __init__(self, module: Module, module_log: ModuleOfLog) -> None:
        self.module, self.module_log = module, module_log
        evaluator = Evaluator.for_scope(module.scope)
        symbol = module.symbol
        self.margins = PredicateMargins(PredicateEvaluator.for_scope(module.scope))
        self.ttf = None if symbol.ttf is None else self.margins.distance_of(symbol.ttf, AGAINST)
        self.safe_margins = PredicateMargins(evaluator)
        self.safe = None if module_log.blind else self.safe_margins.distance_of(symbol.safe)
        self.last_safe_reads: list[object] = []
        """The stamps and values on which `safe` was last asked."""
        self.first_s: float | None = None

    def note_decision(self, verdict: DecisionVerdict, env: Environment, time_s: float) -> None:
        """Notes a step of the DM; `env` is what the DM read."""
        module_log = self.module_log
        module_log.steps += 1
        self.first_s = time_s if self.first_s is None else self.first_s
        module_log.ac += verdict.after == AC
        if verdict.before != verdict.after:
            before, after = ("AC", "SC") if verdict.before == AC else ("SC", "AC")
            saw = PredicateValues(verdict.ttf, verdict.safer, verdict.stale, verdict.gate_fault)
            why = decision_reason(before, after, saw)  # type: ignore[arg-type]
            module_log.changes.append(LoggedModeChange(time_s, after, why))
        if verdict.stale:
            module_log.stale += 1
            return
        module_log.ttf += verdict.ttf
        module_log.safer += verdict.safer
        module_log.nan_looks += verdict.nan
        self._note_distances(env, time_s)

    def _note_distances(self, env: Environment, time_s: float) -> None:
        module_log = self.module_log
        far = self._measured_distance(self.ttf, env)
        if far is not None:
            module_log.margin = _nearest_margin(
                module_log.margin, -far.far, far, self.margins, time_s
            )
            for bound, distance in self.margins.seen.items():
                text = self.margins.label_of_bound(bound)
                last = module_log.bounds.get(text)
                if last is None or distance < last.distance:
                    module_log.bounds[text] = NearestMargin(distance, time_s, text)
            self.margins.seen.clear()

    def judge_reads(self, env: Environment, time_s: float, *, fresh: bool) -> None:
        """Asks `safe` about reads that are young enough for it; `fresh`: for the DM as well."""
        holds = self._is_safe(env, time_s)
        if holds is not None:
            self.module_log.asked += 1
            self.module_log.judged_steps += fresh
            self.module_log.outside += not holds

    def judge_late_sample(self, env: Environment, time_s: float) -> None:
        """Asks `safe` about a sample that no step judges: it was late, refused or lost."""
        self.module_log.outside_late += self._is_safe(env, time_s) is False

    def _is_safe(self, env: Environment, time_s: float) -> bool | None:
        """Whether `safe` holds, and notes its distance; None if `safe` faults."""
        clear = self._measured_distance(self.safe, env)
        if clear is None:
            return None
        module_log = self.module_log
        module_log.clearance = _nearest_margin(
            module_log.clearance, clear.far, clear, self.safe_margins, time_s
        )
        holds = copysign(1.0, clear.far) > 0
        assert module_log.times is not None
        module_log.times.alarms[module_log.times.column_at(time_s)] += not holds
        for bound, (value, *band) in self.safe_margins.sides.items():
            module_log.times.note_value(
                self.safe_margins.compared_signal(bound), time_s, value, band, alarm=not holds
            )
        self.safe_margins.sides.clear()
        if not holds and module_log.first_outside_s is None:
            module_log.first_outside_s = time_s
        return holds

    def _measured_distance(
        self, measure: Callable[[Environment], Distance] | None, env: Environment
    ) -> Distance | None:
        if measure is None:
            return None
        try:
            return measure(env)
        except StepFault:
            self.module_log.faults += 1
            return None


def _nearest_margin(
    before: NearestMargin | None, far: float, d: Distance, margins: PredicateMargins, time_s: float
) -> NearestMargin:
    if before is not None and before.distance <= far:
        return before
    bound = margins.label_of_bound(d.bound) if d.bound >= 0 and not isinf(far) else ""
    return NearestMargin(far, time_s, bound)
