"""Which steps of a trace matter to its violation: a slice (docs/testing.md, "The slice").

Purpose: a `Slicer` goes from what the property reads back to the steps that may have changed it, by
what the steps of each actor may read and write (`explore/model/footprints.py`) and by what they did
change. Whatever the other steps choose, the property is violated, unless another one is before.
Non-goals: a smallest such set; finding traces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.core.steps import lower
from soter.explore.model.footprints import Footprints
from soter.explore.trace import BEGIN, EFFECT, LOST, PROPERTY, START, TIMED, VIOLATION_KINDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from soter.explore.engine.explorer_library import Engine, RawStep
    from soter.explore.model.exploration_plan import PlannedActor
    from soter.explore.model.footprints import Label
    from soter.explore.replay import ReplayedStep

CALENDAR = ("time", "done", "lost")
"""Labels of what no choice of a step changes."""
ALWAYS = ("stamp", "held", "due", "verdict")
"""Labels of what is packed like an age: its bits do not show whether it was changed."""


@dataclass(frozen=True)
class _Effect:
    """What one step may have written, and what that depends on."""

    writes: frozenset[Label]
    reads: frozenset[Label]


class Slicer:
    """Slices the traces of one engine's system."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._system = engine.system
        self._footprints = Footprints(engine.system, lower(engine.system))
        self._bits: dict[Label, int] = {}
        for label, at, width in engine.generated.fields:
            mask = ((1 << width) - 1) << at
            self._bits[label] = self._bits.get(label, 0) | mask

    def mark_steps(
        self,
        raw: Sequence[RawStep],
        done: Sequence[ReplayedStep],
        broken: tuple[int, int],
        seed: int,
    ) -> tuple[bool, ...]:
        """For each step whether it matters; the last one does: there it is violated.

        `raw` and `done` are the same steps, of the engine and as the interpreter made them.
        """
        possible, _, configurations = self._engine.replay(raw, seed)
        if possible < len(raw) or not done or done[0].kind != START:
            return (True,) * len(raw)
        packed = np.array([self._engine.pack(w) for w in configurations])
        first_read = min(self._first_step_read(broken, raw, configurations), len(raw) - 1)
        labels_read = self._labels_read(broken)
        marks = [False] * len(raw)
        wanted: set[Label] = set()
        for number in range(len(raw) - 1, 0, -1):
            last = number == len(raw) - 1
            if number >= first_read:
                wanted |= labels_read
            actor = self._engine.actors[raw[number].actor]
            if last and not labels_read:  # what is violated is the step itself
                wanted |= actor.reads | actor.writes
            effect = self._effect(actor, raw[number].actor, done[number])
            touched = effect.writes & wanted
            if touched:
                lost = done[number].kind == LOST
                marks[number] = (
                    lost
                    or bool(raw[number].choices)
                    or self._changes_bits(touched, *packed[number - 1 : number + 1])
                )
                if not lost:
                    wanted = (wanted - effect.writes) | effect.reads
        marks[-1] = True
        marks[0] = bool(raw[0].choices) and any(label[0] == "cell" for label in wanted)
        return tuple(marks)

    # ------------------------------------------------------------ what is looked at

    def _labels_read(self, broken: tuple[int, int]) -> set[Label]:
        """The labels that the property reads of a configuration; none for a contract or fault."""
        kind, index = VIOLATION_KINDS[broken[0]], broken[1]
        labels: set[Label] = set()
        if kind == PROPERTY:
            labels = self._footprints.property_reads(index)
        elif kind == TIMED:
            labels = self._footprints.timed_property_reads(index)
        return {label for label in labels if label[0] not in CALENDAR}

    def _first_step_read(
        self, broken: tuple[int, int], raw: Sequence[RawStep], configurations: npt.NDArray[np.uint8]
    ) -> int:
        """The first step after which the property looks, where it looks more than once."""
        if VIOLATION_KINDS[broken[0]] != TIMED:
            return len(raw)
        assert self._system.test is not None
        prop = self._system.test.timed[broken[1]]
        if prop.module is None:
            due = self._clock(configurations, broken[1])
            earlier = np.flatnonzero(due != due[-1])
            return int(earlier[-1]) + 1 if len(earlier) else 0
        verdict = int(self._clock(configurations, len(self._system.test.timed) + prop.module)[-1])
        return max(next(k for k, s in enumerate(raw) if s.time_ns >= verdict) - 1, 0)

    def _clock(self, configurations: npt.NDArray[np.uint8], number: int) -> npt.NDArray[np.int64]:
        """The deadlines of the timed properties, then the last AC verdicts of the modules.

        (steps, configuration_size) -> (steps,), ns; see `soter_explore.h`.
        """
        size = int(self._engine.model.program.state_size)
        at = size + -size % 8 + 8 + 8 * number
        clock_ns: npt.NDArray[np.int64] = configurations[:, at : at + 8].copy().view(np.int64)[:, 0]
        return clock_ns

    # ------------------------------------------------------------ what a step does

    def _effect(self, actor: PlannedActor, number: int, done: ReplayedStep) -> _Effect:
        """The effect of a step, without what the time and the calendar decide."""
        topics = frozenset(label for label in actor.writes if label[0] in ("topic", "stamp"))
        own = frozenset(self._own_queues(actor))
        held: Label = ("held", number)
        reads = frozenset(label for label in actor.reads if label[0] not in CALENDAR)
        if done.kind == EFFECT:
            return _Effect((topics - own) | {held}, reads | {held})
        writes = actor.writes
        if done.kind == BEGIN:
            writes = (writes - topics) | own | {held}
        elif done.gated:
            writes = (writes - topics) | own
        return _Effect(writes, reads)

    def _own_queues(self, actor: PlannedActor) -> Iterator[Label]:
        """The queues that an actor empties as it steps."""
        for t in self._system.topics:
            if t.queue_of is not None and t.name.startswith(f"{actor.name}."):
                yield ("topic", t.index)
                yield ("stamp", t.index)

    def _changed_bits(self, before: npt.NDArray[np.uint64], after: npt.NDArray[np.uint64]) -> int:
        """The bits that differ in two packed configurations, (words,) each, as one number."""
        return int.from_bytes((before ^ after).astype("<u8").tobytes(), "little")

    def _changes_bits(
        self, labels: Iterable[Label], before: npt.NDArray[np.uint64], after: npt.NDArray[np.uint64]
    ) -> bool:
        changed = self._changed_bits(before, after)
        return any(x[0] in ALWAYS or bool(self._bits.get(x, 0) & changed) for x in labels)
