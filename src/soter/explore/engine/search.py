"""The engine in the words of the program: names for what it counts.

Purpose: searches of one test whose traces name actors and streams, and whose coverage names
modes, branches and values.
Non-goals: the engine (`engine.py`), verdicts (`command.py`).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.engine.coverage import (
    Coverage,
    Leaf,
    branches_part,
    class_of,
    leaf_value,
    modules_parts,
    part_of,
    values_part,
)
from soter.explore.engine.engine import (
    Engine,
    Progress,
    RawChoice,
    RawStep,
    SearchResult,
    Settings,
)
from soter.explore.engine.guided import Guided, array_of, steps_of
from soter.explore.engine.shrink import Shrinker
from soter.explore.engine.slice import Slicer
from soter.explore.methods import EXHAUSTIVE
from soter.explore.results import Looked
from soter.explore.trace.choices import ENDING
from soter.explore.trace.schedule import INPUT, plan_of
from soter.explore.trace.trace import STEP_KINDS, Choice, Step
from soter.program.model.types import IntType, leaves
from soter.semantics.random_draws import fnv, leaf_name
from soter.semantics.record import AC, SC

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.codegen.body import Branch
    from soter.explore.engine.engine import Searched
    from soter.explore.judge.replay import Replayed
    from soter.explore.model.parts import Part
    from soter.explore.results import Options
    from soter.program.model.system import System


TOLD = 64
"""Executions between two looks at how far shrinking is."""

Found = SearchResult[Step]
"""What a search found, steps with names."""


class Search:
    """Searches of one flattened test. A context: leaving it gives back what the engine holds."""

    def __init__(
        self,
        system: System,
        options: Options,
        progress: Callable[[Looked], None] | None = None,
        wanted: Callable[[], bool] | None = None,
    ) -> None:
        """`wanted`: whether somebody wants it to end; asked ten times a second."""
        self._system = system
        self.options = options
        self._settings = Settings(**vars(options))
        self._progress = progress
        self._time_s = options.time
        self._engine = Engine(system)
        self._engine.wanted = wanted or self._engine.wanted
        self._streams = {fnv(name): name for name in _streams(system)}
        self.bits = self._engine.bits
        self.words = self._engine.words
        self.sampled = self._engine.plan.sampled
        self.times = self._engine.plan.times
        self.parts = 1
        """How many parts of the system the last search explored apart."""

    def __enter__(self) -> Search:  # noqa: PYI034 - typing.Self came with Python 3.11
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.close()

    # ------------------------------------------------------------ searching

    def run(self, known: tuple[tuple[int, int], ...] = ()) -> Found:
        """The search that was asked for; with all reductions, part by part.

        With `known` violations it looks for others, in all of the system.
        """
        settings = replace(self._settings, known=known)
        until = time.perf_counter() + self._time_s
        parts: tuple[Part | None, ...] = (None,)
        if settings.reduction == "all" and settings.strategy in EXHAUSTIVE and not known:
            apart = len(self._engine.parts) > 1 and not self._engine.starts_broken(self._time_s)
            parts = self._engine.parts if apart else (None,)
        self.parts = len(parts)
        found: list[Searched] = []
        for part in parts:
            left = settings.max_states - sum(f.states for f in found)
            once = replace(settings, part=part, max_states=left if settings.max_states else 0)
            left_s = max(until - time.perf_counter(), 0.0)
            found.append(self._engine.explore(once, self._look(minimising=False), left_s))
            if found[-1].status == "violated" and part is not None:
                whole = self._engine.complete(once, found[-1].steps)
                if whole is None:  # its steps alone are no execution of the system
                    found[-1] = replace(found[-1], steps=(), apart=bool(found[-1].steps))
                else:
                    found[-1] = replace(found[-1], steps=whole.steps, broken=whole.broken)
            if found[-1].status != "exhausted" or (
                settings.max_states and found[-1].states >= left
            ):
                break
        if len(found) < len(parts) and found[-1].status == "exhausted":
            found[-1] = replace(found[-1], status="states")  # the other parts were not looked at
        return self._named(_sum(found))

    def least(self, found: Found, patience_s: float) -> Found:
        """The least execution to the same violation; `status` is "violated" where it is one.

        It takes at most `patience_s` seconds.
        """
        assert found.broken is not None
        look = self._look(minimising=True)
        return self._named(self._engine.least(self._settings, found.broken, look, patience_s))

    def shrunk(self, found: Found, patience_s: float) -> Found | None:
        """Something that is not larger and violates the same, sought for so long.

        None where what was found violates nothing. `transitions` are the executions tried.
        """
        assert found.broken is not None
        look = self._look(minimising=True)
        guided = Guided(self._engine, self._settings.seed, found.broken)
        began = time.perf_counter()

        def told(tried: int, length: int) -> None:
            if look is not None and tried % TOLD == 0:
                look(Progress(0, tried, length, time.perf_counter() - began))

        shrinker = Shrinker(guided, self._engine.actors, deadline_s=began + patience_s, look=told)
        made = shrinker.run(array_of([self._raw(s) for s in found.steps]))
        if made is None:
            return None
        steps = tuple([self._step(raw) for raw in steps_of(made.steps)])
        seconds = time.perf_counter() - began
        return replace(
            found, steps=steps, transitions=made.tried, seconds=seconds, stopped=made.stopped
        )

    def matters(self, replayed: Replayed, found: Found) -> tuple[bool, ...]:
        """For each step of a trace whether what was found to be violated depends on it."""
        assert found.broken is not None
        raw = [self._raw(s) for s in replayed.trace.steps]
        slicer = Slicer(self._engine)
        return slicer.matters(raw, replayed.steps, found.broken, self._settings.seed)

    def _raw(self, s: Step) -> RawStep:
        numbers = {self._actor(i): i for i in range(len(self._engine.actors))}
        choices = tuple([RawChoice(fnv(c.stream), c.of, c.pick) for c in s.choices])
        kind = STEP_KINDS.index(s.kind)
        return RawStep(numbers.get(s.actor, -1), kind, s.release_ns, s.time_ns, choices)

    def _look(self, *, minimising: bool) -> Callable[[Progress], None] | None:
        progress = self._progress
        if progress is None:
            return None
        name, began = plan_of(self._system).name, time.perf_counter()

        def look(p: Progress) -> None:
            spent = time.perf_counter() - began
            progress(
                Looked(
                    name,
                    p.states,
                    p.transitions,
                    p.depth,
                    p.bytes,
                    spent,
                    minimising=minimising,
                    tracing=p.tracing,
                    answers=p.answers,
                )
            )

        return look

    # ------------------------------------------------------------ names

    def _named(self, s: Searched) -> Found:
        return Found(
            status=s.status,
            broken=s.broken,
            states=s.states,
            transitions=s.transitions,
            runs=s.runs,
            table_bytes=s.table_bytes,
            frontier_bytes=s.frontier_bytes,
            depth=s.depth,
            seconds=s.seconds,
            steps=tuple([self._step(raw) for raw in s.steps]),
            stopped=s.stopped,
            total_bytes=s.total_bytes,
            needed_bytes=s.needed_bytes,
            threads=s.threads,
            chooser=s.chooser,
            apart=s.apart,
        )

    def _step(self, raw: RawStep) -> Step:
        choices = tuple([Choice(self._streams[c.stream], c.pick, c.count) for c in raw.choices])
        name = self._actor(raw.actor) if raw.actor >= 0 else ""
        return Step(name, STEP_KINDS[raw.kind], raw.release_ns, raw.time_ns, choices)

    def chooser(self, found: Found) -> str:
        """Who asks for too many choices in a step."""
        return f"a step of {self._actor(found.chooser)}" if found.chooser >= 0 else "the start"

    def _actor(self, number: int) -> str:
        actor = self._engine.actors[number]
        if actor.input is None:
            return actor.name
        return INPUT + self._system.topics[self._system.inputs[actor.input].topic].name

    # ------------------------------------------------------------ coverage

    def coverage(self) -> Coverage:
        """What all searches so far have reached."""
        seen, system = self._engine.seen, self._system
        modes_seen = seen.modes.tolist()
        for m, row in zip(system.modules, modes_seen, strict=True):
            row[AC if m.forced == "ac" else SC] = 1  # where it starts
        modes, switches = modules_parts(
            [(m.name, m.forced) for m in system.modules], modes_seen, seen.switches.tolist()
        )
        branches = self._engine.generated.unit.branches
        return Coverage(
            properties=part_of(self._judged()),
            actors=part_of(
                (self._actor(i), bool(fired)) for i, fired in enumerate(seen.fired.tolist())
            ),
            modes=modes,
            switches=switches,
            branches=branches_part([branch_name(b) for b in branches], seen.branches.tolist()),
            values=values_part(list(self._leaves()), self._classes()),
        )

    def _judged(self) -> Iterator[tuple[str, bool]]:
        """What the test and its nodes state, and whether it was ever judged."""
        seen, system = self._engine.seen, self._system
        judged = [bool(x) for x in seen.judged.tolist()]
        fired = {
            a.component for a, once in zip(self._engine.actors, seen.fired, strict=True) if once
        }
        for p in system.properties:
            once = judged[p.index] if p.component is None else p.component in fired
            yield f"{p.kind} {p.text}", once
        for t in plan_of(system).timed:
            yield t.text, judged[len(system.properties) + t.index]

    def _classes(self) -> list[list[int]]:
        """Per leaf and class: whether a value of it was published, or is the topic's default."""
        found = [list(row) for row in self._engine.seen.classes.tolist()]
        given = [(self._system.topics[i], path) for i, path in self._engine.generated.leaves]
        for row, leaf, (topic, path) in zip(found, self._leaves(), given, strict=True):
            value = leaf_value(topic.type, topic.default, path)
            if isinstance(value, (bool, int, float)) and (number := class_of(leaf, value)) >= 0:
                row[number] = 1
        return found

    def _leaves(self) -> Iterator[Leaf]:
        for index, path in self._engine.generated.leaves:
            topic = self._system.topics[index]
            found = list(leaves(topic.type))
            at = next(i for i, (own, _) in enumerate(found) if own == tuple(path))
            t, bound = found[at][1], topic.bounds[at]
            low, high = (-math.inf, math.inf) if bound is None else (bound.low, bound.high)
            if isinstance(t, IntType):
                low, high = max(low, t.low), min(high, t.high)
            yield Leaf(leaf_name(topic.name, path), t, low, high)


def _sum(found: list[Searched]) -> Searched:
    """Of the searches of parts, in order; status, violation and trace of the last one."""
    return replace(
        found[-1],
        states=sum(f.states for f in found),
        transitions=sum(f.transitions for f in found),
        table_bytes=sum(f.table_bytes for f in found),
        frontier_bytes=max(f.frontier_bytes for f in found),
        total_bytes=max(f.total_bytes for f in found),
        depth=max(f.depth for f in found),
        seconds=sum(f.seconds for f in found),
    )


def branch_name(b: Branch) -> str:
    """`SafeMotion.Careful, cart.soter:41, the condition holds`."""
    side = "where the condition holds" if b.taken else "where the condition does not hold"
    return f"{b.component}, {Path(b.span.source.name).name}:{b.span.line}, {side}"


def _streams(system: System) -> Iterator[str]:
    """The names of all streams that a step may ask a choice from."""
    for c in system.components:
        yield c.name + ENDING
        for d in c.disturbances:
            yield from d.streams
        for m in c.measured:
            yield m.stream
        for i, span in enumerate(c.initial_range):
            if span is not None and c.plant is not None:
                state = c.plant.states[i]
                for path, _ in leaves(state.type):
                    yield leaf_name(f"{c.name}.{state.name}.start", path)
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        yield INPUT + topic.name
        for path, _ in leaves(topic.type):
            yield leaf_name(INPUT + topic.name, path)
