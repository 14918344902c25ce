"""Saves a search work: explores parts alone, and chooses between two reductions.

Purpose: a `ComposedSearch` searches parts alone that share nothing but time and some properties,
and judges such a property on all combinations of what its parts noted at one time
(docs/testing.md, "Joined parts"). With reduction `all`, `explore_by_quicker` begins two searches:
one stores only ends of instants and combines what groups of actors do, the other also stores
configurations between ends, with ample sets; the one that came further after as many steps goes
on. The choice reads no clock: it is the same everywhere.
Non-goals: which parts there are (`model/exploration_plan.py`); verdicts, which are the same either
way.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.explore.engine.coverage import Observations
from soter.explore.engine.explorer_library import EngineSettings
from soter.explore.model.exploration_plan import IndependentPart
from soter.explore.search_options import STATUSES, STORAGES, STRATEGIES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.core.layout import Words
    from soter.explore.engine.coverage import EngineProgress
    from soter.explore.engine.explorer_library import Engine, RawStep, Searched
    from soter.explore.model.exploration_plan import SharedProperty


BIRTH = 4
"""The kind of the step that is the start."""
NOTES_SHARE = 8
"""One part in this many of the memory is for notes; combining them takes about three times that."""
NOTES_BYTES_MIN = 1 << 20
"""The least bytes for the notes on a part."""
JOINED_PARTS_MAX = 8
"""The most parts that a property may read so that its combinations are tried."""


class ComposedSearch:
    """One search of the parts of a system that only properties join."""

    def __init__(
        self,
        engine: Engine,
        settings: EngineSettings,
        look: Callable[[EngineProgress], None] | None,
    ) -> None:
        assert engine.joined_parts is not None
        self._engine = engine
        self._settings = settings
        self._look = look
        self._joined = engine.joined_parts
        self._notes_bytes = settings.memory // (NOTES_SHARE * len(engine.joined_parts.parts))

    @staticmethod
    def can_search(engine: Engine, settings: EngineSettings) -> bool:
        """Whether joined parts can be searched alone: breadth first, exact, with all reductions."""
        joined = engine.joined_parts
        if joined is None or not engine.model.plain or settings.known or settings.max_states:
            return False
        if engine.model.ordered:  # what is put together would be in the order of the parts
            return False
        if settings.memory < NOTES_BYTES_MIN * NOTES_SHARE * len(joined.parts):
            return False
        if (settings.strategy, settings.storage) != ("bfs", "exact"):
            return False
        few = all(len(j.parts) <= JOINED_PARTS_MAX for j in joined.joints)
        return few and settings.reduction == "all"

    def search_parts(self, patience_s: float) -> list[Searched] | None:
        """Searches part by part, until one is violated or stopped; None if memory is too small."""
        engine, until = self._engine, time.perf_counter() + patience_s
        searches: list[Searched] = []
        kept: list[Any] = []
        try:
            for part in self._joined.parts:
                left = max(until - time.perf_counter(), 0.0)
                noted = Observations(self._mask_of_noted_bits(part), self._notes_bytes)
                last = self._run_part(part, noted, left)
                kept.append(engine.take_stored())
                if last.status == "memory":  # perhaps that of the notes, which have a share of it
                    return None
                if last.status == "violated":
                    own_settings = replace(self._settings, part=part)
                    last = completed_trace(engine, own_settings, last, last.steps)
                searches.append(last)
                if last.status != "exhausted":
                    return searches
            for joint in self._joined.joints:
                left = max(until - time.perf_counter(), 0.0)
                status, goals, stopped = self._joint_verdict(joint, kept, left)
                if status == "memory":
                    return None
                if status == "stopped":
                    last = replace(searches[-1], status=status, stopped=stopped, states=0)
                    return [*searches, last]
                if status == "violated":
                    return [*searches, self._joint_violation(joint, goals, until)]
        finally:
            for stored in kept:
                engine.lib.soter_explore_free(stored)
        return searches

    def _run_part(self, part: IndependentPart, noted: Observations, patience_s: float) -> Searched:
        part_settings = replace(self._settings, part=part, noted=noted)
        return self._engine.explore(part_settings, self._look, patience_s)

    def _mask_of_noted_bits(self, part: IndependentPart) -> Words:
        mask = np.zeros(self._engine.words, dtype=np.uint64)
        words = self._engine.ffi.cast("uint64_t *", mask.ctypes.data)
        self._engine.lib.soter_explore_noted(self._engine.model, part.actors, words)
        return mask

    # ------------------------------------------------------------ properties of several parts

    def _joint_verdict(
        self, joint: SharedProperty, kept: list[Any], patience_s: float
    ) -> tuple[str, Words, str]:
        """Judges a property on all combinations: status, goals (parts, words), why it stopped."""
        engine = self._engine
        goals = np.zeros((len(joint.parts), engine.words), dtype=np.uint64)
        sides = engine.ffi.new("soter_side[]", len(joint.parts))
        for side, number in zip(sides, joint.parts, strict=True):
            side.actors, side.kept = self._joined.parts[number].actors, kept[number]
        words = engine.ffi.cast("uint64_t *", goals.ctypes.data)
        progress = engine.ffi.new("soter_explore_progress *")
        options, coverage = engine.option_struct(self._settings), engine.coverage()
        ended: list[int] = []

        def combine() -> None:
            ended.append(
                engine.lib.soter_explore_joined(
                    engine.model,
                    options,
                    sides,
                    len(sides),
                    joint.property,
                    progress,
                    coverage,
                    words,
                )
            )

        stopped = engine.run_in_thread(combine, progress, self._look, patience_s)
        return STATUSES[ended[0]], goals, stopped

    def _joint_violation(self, joint: SharedProperty, goals: Words, until: float) -> Searched:
        """The joined execution of the parts to the violation; no steps if a part has no trace."""
        broken, steps = (0, joint.property), []
        actors = 0
        last: Searched | None = None
        for number, goal in zip(joint.parts, goals, strict=True):
            part = self._joined.parts[number]
            actors |= part.actors
            left = max(until - time.perf_counter(), 0.0)
            noted = Observations(
                self._mask_of_noted_bits(part), self._notes_bytes, goal, joint.property
            )
            last = self._run_part(IndependentPart(part.actors, 0, part.timeds), noted, left)
            if last.broken != broken or not last.steps:
                return replace(last, status="violated", broken=broken, steps=(), states=0)
            steps.append(last.steps)
        assert last is not None
        last = replace(last, broken=broken, states=0)
        part = IndependentPart(actors, 1 << joint.property, 0)
        own_settings = replace(self._settings, part=part)
        return completed_trace(self._engine, own_settings, last, _merge_executions(steps))


def completed_trace(
    engine: Engine, settings: EngineSettings, violated: Searched, steps: Sequence[RawStep]
) -> Searched:
    """The violation; its `steps` of one part are completed to an execution of the whole system.

    It has no steps, and is `apart`, if the other parts allow no such execution.
    """
    completed = engine.complete_trace(settings, steps) if steps else None
    if completed is None:
        return replace(violated, steps=(), apart=bool(steps))
    return replace(violated, steps=completed.steps, broken=completed.broken)


def _merge_executions(steps: list[tuple[RawStep, ...]]) -> tuple[RawStep, ...]:
    """Merges executions of parts into one: a single start, then all steps in order of time."""
    initial = steps[0][0]
    assert all(s[0].kind == BIRTH for s in steps)
    rest = [step for execution in steps for step in execution[1:]]
    return (initial, *sorted(rest, key=lambda step: step.time_ns))


TRIAL_STEPS = 2_000
"""How many steps each of the two trial searches runs: about those of a thousand configurations."""
SHORT_OF_MEMORY = ("memory", "no_memory")
CUT_SHORT = (*SHORT_OF_MEMORY, "states", "stopped")


def may_pick_reduction(settings: EngineSettings) -> bool:
    """Whether a search may choose between the two reductions.

    It may not if the user chose, or if the stored set matters: with a bound on configurations, if
    they are kept, or if ends are noted.
    """
    user_chose = (
        settings.reduction != "all"
        or settings.strategy != STRATEGIES[0]
        or settings.storage != STORAGES[0]
    )
    storage_matters = (
        settings.max_states
        or settings.keep
        or settings.go_on
        or settings.known
        or settings.noted is not None
    )
    return not (user_chose or storage_matters or settings.plainly)


def explore_by_quicker(
    engine: Engine,
    settings: EngineSettings,
    look: Callable[[EngineProgress], None] | None = None,
    left_s: float = math.inf,
) -> Searched:
    """Explores for at most `left_s` seconds, by the quicker of two reductions if both are allowed.

    If memory is too small for configurations between ends of instants, only ends are stored.
    """
    began = time.perf_counter()

    def seconds_left() -> float:
        return max(left_s - (time.perf_counter() - began), 0.0)

    def explore(how: EngineSettings) -> Searched:
        return engine.explore(how, look, seconds_left())

    pick = _choose_settings(engine, settings, left_s) if may_pick_reduction(settings) else settings
    result = explore(pick) if isinstance(pick, EngineSettings) else pick
    if result.status in SHORT_OF_MEMORY and pick != settings:
        ends = explore(settings)
        if ends.status not in CUT_SHORT or ends.covered_ns >= result.covered_ns:
            result = ends  # a violation or a full search counts, however far the other one came
    return replace(result, seconds=time.perf_counter() - began)


def _choose_settings(
    engine: Engine, settings: EngineSettings, left_s: float
) -> EngineSettings | Searched:
    """The settings to continue with, or the result if a trial search already ended."""
    if _observes_only_ends(engine):
        return _pick_reduction(engine, settings, left_s)
    return replace(settings, between=True) if engine.model.brief else settings


def _observes_only_ends(engine: Engine) -> bool:
    """Whether properties see only ends of instants, as no step may be late."""
    late = any(a.window_ns or a.overrun_ns for a in engine.actors)
    return not engine.plan.timely and not late


def _pick_reduction(
    engine: Engine, settings: EngineSettings, left_s: float
) -> EngineSettings | Searched:
    """The settings whose trial search came further, or the result of one that already ended."""
    ends = engine.explore(replace(settings, max_ran=TRIAL_STEPS, threads=1), None, left_s)
    if ends.status != "states" or ends.stopped:
        return ends
    middle_settings = replace(settings, between=True)
    middle = engine.explore(replace(middle_settings, max_ran=TRIAL_STEPS, threads=1), None, left_s)
    if middle.status != "states" or middle.stopped:
        return middle
    lead_ns = ends.covered_ns - middle.covered_ns
    combines = ends.combined * 2 > ends.transitions
    return settings if lead_ns > 0 or (lead_ns == 0 and combines) else middle_settings
