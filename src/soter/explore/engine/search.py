"""Searches of one test, with the names of the program for the engine's numbers.

Purpose: a `Search` runs the engine; its traces name actors and streams, and its coverage names
modes, branches and values.
Non-goals: the engine (`explorer_library.py`), verdicts (`explore/command.py`).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.engine.coverage import (
    Coverage,
    CoveredLeaf,
    EngineProgress,
    branches_coverage,
    kind_coverage,
    leaf_value,
    modules_coverage,
    value_class,
    values_coverage,
)
from soter.explore.engine.explorer_library import (
    Engine,
    EngineSettings,
    RawChoice,
    RawStep,
    SearchResult,
    array_to_steps,
    steps_to_array,
)
from soter.explore.engine.reductions import ComposedSearch, completed_trace, explore_by_quicker
from soter.explore.engine.shrink import Guided, Shrinker
from soter.explore.judge import INPUT, test_plan
from soter.explore.search_options import SAMPLING, SearchProgress
from soter.explore.trace import CHOOSE_STREAM_ENDING, STEP_KINDS, Choice, Step
from soter.language.model.types import IntType, leaves
from soter.semantics.configuration import AC, SC
from soter.semantics.draws import fnv1a_64, stream_of_leaf

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.codegen.body import StepBranch
    from soter.explore.engine.explorer_library import Searched
    from soter.explore.model.exploration_plan import IndependentPart
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import System


JUDGED, MET = 1, 2
"""The engine's bits `SOTER_JUDGED` and `SOTER_MET`."""
REPORT_EVERY = 64
"""How many executions lie between two reports of the progress of shrinking."""

Found = SearchResult[Step]
"""The result of a search, with names of the program in its steps."""


class Search:
    """Searches one flattened test; leaving its `with` block frees what the engine holds."""

    def __init__(
        self,
        system: System,
        options: SearchOptions,
        progress: Callable[[SearchProgress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> None:
        """`should_stop`: whether the search should end; it is called ten times a second."""
        self._system = system
        self.options = options
        self._settings = EngineSettings(**vars(options), closes=True)
        self._progress = progress
        self._time_s = math.inf if options.time is None else options.time
        self._engine = Engine(system)
        self._engine.should_stop = should_stop or self._engine.should_stop
        self._streams = {fnv1a_64(name): name for name in _choice_streams(system)}
        self.bits = self._engine.bits
        self.words = self._engine.words
        self.sampled = self._engine.plan.sampled
        self.times = self._engine.plan.times
        self.unheard_actors = self._engine.plan.unheard_actors
        self.parts = 1
        """How many parts of the system the last search explored apart."""

    def __enter__(self) -> Search:  # noqa: PYI034 - typing.Self came with Python 3.11
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    # ------------------------------------------------------------ searching

    def run(self, known: tuple[tuple[int, int], ...] = ()) -> Found:
        """Runs the search that the options ask for; part by part if the reduction is `all`.

        With `known` violations, it searches the whole system for other violations.
        """
        settings = replace(self._settings, known=known)
        until = time.perf_counter() + self._time_s
        parts: tuple[IndependentPart | None, ...] = (None,)
        if settings.reduction == "all" and settings.strategy not in SAMPLING and not known:
            apart = self._may_search_apart(settings)
            searches = self._search_joined_parts(settings, until) if apart else None
            if searches is not None:
                return self._with_named_steps(_sum_of_searches(searches))
            parts = self._engine.parts if apart else (None,)
        return self._with_named_steps(_sum_of_searches(self._search_parts(settings, parts, until)))

    def _may_search_apart(self, settings: EngineSettings) -> bool:
        """Whether the system has parts, and no start violates a property before any step."""
        engine = self._engine
        has_parts = len(engine.parts) > 1 or ComposedSearch.can_search(engine, settings)
        return has_parts and not engine.is_violated_at_start(self._time_s)

    def _search_joined_parts(self, settings: EngineSettings, until: float) -> list[Searched] | None:
        """The searches of parts that only properties join; None if that does not work."""
        engine = self._engine
        if not ComposedSearch.can_search(engine, settings):
            return None
        assert engine.joined_parts is not None
        self.parts = len(engine.joined_parts.parts)
        left_s, look = (
            max(until - time.perf_counter(), 0.0),
            self._progress_reporter(minimising=False),
        )
        searches = ComposedSearch(engine, settings, look).search_parts(left_s)
        if searches and searches[-1].status != "exhausted":  # joining properties were not judged
            searches[-1] = replace(searches[-1], covered_ns=0)
        return searches

    def _search_parts(
        self, settings: EngineSettings, parts: tuple[IndependentPart | None, ...], until: float
    ) -> list[Searched]:
        """The searches of parts that share nothing; `(None,)` stands for the whole system."""
        self.parts = len(parts)
        searches: list[Searched] = []
        for part in parts:
            states_left = settings.max_states - sum(f.states for f in searches)
            own_settings = replace(
                settings, part=part, max_states=states_left if settings.max_states else 0
            )
            left_s = max(until - time.perf_counter(), 0.0)
            look = self._progress_reporter(minimising=False)
            searches.append(explore_by_quicker(self._engine, own_settings, look, left_s))
            if searches[-1].status == "violated" and part is not None:
                searches[-1] = completed_trace(
                    self._engine, own_settings, searches[-1], searches[-1].steps
                )
            if searches[-1].status != "exhausted" or (
                settings.max_states and searches[-1].states >= states_left
            ):
                break
        if len(searches) < len(parts):  # the other parts were not looked at
            ended = searches[-1].status == "exhausted"
            status = "states" if ended else searches[-1].status
            searches[-1] = replace(searches[-1], status=status, covered_ns=0)
        return searches

    def find_shortest_trace(self, search_result: Found, patience_s: float) -> Found:
        """Searches the shortest trace to the same violation, for at most `patience_s` seconds.

        The `status` is "violated" if it found the trace.
        """
        assert search_result.broken is not None
        look = self._progress_reporter(minimising=True)
        return self._with_named_steps(
            self._engine.find_shortest_trace(self._settings, search_result.broken, look, patience_s)
        )

    def shrink(self, search_result: Found, patience_s: float) -> Found | None:
        """Searches `patience_s` seconds for a trace to the same violation that is not longer.

        None if the trace violates nothing. `transitions`: the number of executions tried.
        """
        assert search_result.broken is not None
        look = self._progress_reporter(minimising=True)
        guided = Guided(self._engine, self._settings.seed, search_result.broken)
        began = time.perf_counter()

        def report(tried: int, length: int) -> None:
            if look is not None and tried % REPORT_EVERY == 0:
                look(EngineProgress(0, tried, length, time.perf_counter() - began))

        shrinker = Shrinker(guided, self._engine.actors, deadline_s=began + patience_s, look=report)
        shrunk = shrinker.shrink(steps_to_array([self._raw_step(s) for s in search_result.steps]))
        if shrunk is None:
            return None
        steps = tuple([self._named_step(raw) for raw in array_to_steps(shrunk.steps)])
        seconds = time.perf_counter() - began
        return replace(
            search_result,
            steps=steps,
            transitions=shrunk.tried,
            seconds=seconds,
            stopped=shrunk.stopped,
        )

    def _raw_step(self, step: Step) -> RawStep:
        numbers = {self._actor_name(i): i for i in range(len(self._engine.actors))}
        choices = tuple([RawChoice(fnv1a_64(c.stream), c.of, c.pick) for c in step.choices])
        kind = STEP_KINDS.index(step.kind)
        return RawStep(numbers.get(step.actor, -1), kind, step.release_ns, step.time_ns, choices)

    def _progress_reporter(self, *, minimising: bool) -> Callable[[EngineProgress], None] | None:
        progress = self._progress
        if progress is None:
            return None
        name, began = test_plan(self._system).name, time.perf_counter()

        def report(p: EngineProgress) -> None:
            spent = time.perf_counter() - began
            progress(
                SearchProgress(
                    name,
                    p.states,
                    p.transitions,
                    p.depth,
                    p.bytes,
                    spent,
                    minimising=minimising,
                    tracing=p.tracing,
                    answers=p.answers,
                    covered_ns=p.covered_ns,
                )
            )

        return report

    # ------------------------------------------------------------ names

    def _with_named_steps(self, searched: Searched) -> Found:
        """The result of the engine, with the program's names in its steps."""
        steps = tuple(map(self._named_step, searched.steps))
        return Found(**{**vars(searched), "steps": steps})

    def _named_step(self, raw: RawStep) -> Step:
        choices = tuple([Choice(self._streams[c.stream], c.pick, c.count) for c in raw.choices])
        name = self._actor_name(raw.actor) if raw.actor >= 0 else ""
        return Step(name, STEP_KINDS[raw.kind], raw.release_ns, raw.time_ns, choices)

    def chooser_text(self, search_result: Found) -> str:
        """The step that asks for too many choices, in words: "a step of ..." or "the start"."""
        return (
            f"a step of {self._actor_name(search_result.chooser)}"
            if search_result.chooser >= 0
            else "the start"
        )

    def _actor_name(self, number: int) -> str:
        actor = self._engine.actors[number]
        if actor.input is None:
            return actor.name
        return INPUT + self._system.topics[self._system.inputs[actor.input].topic].name

    # ------------------------------------------------------------ coverage

    def coverage(self) -> Coverage:
        """The coverage of all searches so far."""
        seen, system = self._engine.seen, self._system
        modes_seen = seen.modes.tolist()
        for module, row in zip(system.modules, modes_seen, strict=True):
            row[AC if module.forced == "ac" else SC] = 1  # where it starts
        modes, switches = modules_coverage(
            [(module.name, module.forced) for module in system.modules],
            modes_seen,
            seen.switches.tolist(),
        )
        branches = self._engine.generated.unit.branches
        return Coverage(
            properties=kind_coverage(self._judged_properties()),
            actors=kind_coverage(
                (self._actor_name(i), bool(fired)) for i, fired in enumerate(seen.fired.tolist())
            ),
            modes=modes,
            switches=switches,
            branches=branches_coverage([branch_name(b) for b in branches], seen.branches.tolist()),
            values=values_coverage(list(self._leaves()), self._published_classes()),
        )

    def _judged_properties(self) -> Iterator[tuple[str, bool]]:
        """Yields the name of each property of the test and its nodes, and whether it was judged."""
        seen, system = self._engine.seen, self._system
        judged = [bool(x & JUDGED) for x in seen.judged.tolist()]
        fired = {
            a.component
            for a, judged_once in zip(self._engine.actors, seen.fired, strict=True)
            if judged_once
        }
        for prop in system.properties:
            judged_once = judged[prop.index] if prop.component is None else prop.component in fired
            yield f"{prop.kind} {prop.text}", judged_once
        for timed in test_plan(system).timed:
            yield timed.text, judged[len(system.properties) + timed.index]

    def judged_and_tested_properties(self) -> list[tuple[bool, bool]]:
        """For each property, then each timed property: whether it was judged, and whether tested.

        An `always` is tested if its premise holds, an `eventually` if it is open while time passes.
        """
        tested = [bool(x & MET) for x in self._engine.seen.judged.tolist()]
        pairs = zip(self._judged_properties(), tested, strict=False)
        return [(judged, was_tested) for (_, judged), was_tested in pairs]

    def _published_classes(self) -> list[list[int]]:
        """By leaf and class: 1 if a value of it was published or is the topic's default, else 0."""
        rows = [list(row) for row in self._engine.seen.classes.tolist()]
        tried_leaves = [(self._system.topics[i], path) for i, path in self._engine.generated.leaves]
        for row, leaf, (topic, path) in zip(rows, self._leaves(), tried_leaves, strict=True):
            value = leaf_value(topic.type, topic.default, path)
            if isinstance(value, (bool, int, float)) and (number := value_class(leaf, value)) >= 0:
                row[number] = 1
        return rows

    def _leaves(self) -> Iterator[CoveredLeaf]:
        """Yields the leaves of topics that count for coverage, with their ranges."""
        for index, path in self._engine.generated.leaves:
            topic = self._system.topics[index]
            leaf_types = list(leaves(topic.type))
            number = next(i for i, (at, _) in enumerate(leaf_types) if at == tuple(path))
            leaf_type, bound = leaf_types[number][1], topic.bounds[number]
            low, high = (-math.inf, math.inf) if bound is None else (bound.low, bound.high)
            if isinstance(leaf_type, IntType):
                low, high = max(low, leaf_type.low), min(high, leaf_type.high)
            yield CoveredLeaf(stream_of_leaf(topic.name, path), leaf_type, low, high)


def _sum_of_searches(searches: list[Searched]) -> Searched:
    """The sum of the searches of parts; status, violation and trace are from the last search."""
    return replace(
        searches[-1],
        states=sum(f.states for f in searches),
        transitions=sum(f.transitions for f in searches),
        table_bytes=sum(f.table_bytes for f in searches),
        frontier_bytes=max(f.frontier_bytes for f in searches),
        total_bytes=max(f.total_bytes for f in searches),
        depth=max(f.depth for f in searches),
        seconds=sum(f.seconds for f in searches),
        covered_ns=min(f.covered_ns for f in searches),
        closed_ns=max(f.closed_ns for f in searches) if all(f.closed_ns for f in searches) else 0,
        closable=all(f.closable for f in searches),
    )


def branch_name(branch: StepBranch) -> str:
    """The name of a branch: `SafeMotion.Careful, cart.soter:41:8, where the condition holds`."""
    side = "where the condition holds" if branch.taken else "where the condition does not hold"
    at = branch.span
    return f"{branch.component}, {Path(at.source.name).name}:{at.line}:{at.column}, {side}"


def _choice_streams(system: System) -> Iterator[str]:
    """Yields the names of all streams from which a step may ask for a choice."""
    for component in system.components:
        yield component.name + CHOOSE_STREAM_ENDING
        for disturbance in component.disturbances:
            yield from disturbance.streams
        for measured in component.measured:
            yield measured.stream
        for number, span in enumerate(component.initial_range):
            if span is not None and component.plant is not None:
                state = component.plant.states[number]
                for path, _ in leaves(state.type):
                    yield stream_of_leaf(f"{component.name}.{state.name}.start", path)
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        yield INPUT + topic.name
        for path, _ in leaves(topic.type):
            yield stream_of_leaf(INPUT + topic.name, path)
