"""SC-runs whose commands act later than half a period, by brute force on a fine grid of times.

Purpose: an adversary that knows the definitions only: outputs that are released every period start
late, read late, wait on their way, and act in order; before a_0 anything acted. Nothing here knows
of D, nor that each instant may answer another read.
Non-goals: exactness: RK4 with steps of `DT`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unit.verify.grid.sampled_sc_runs import DT, Sampled
from unit.verify.grid.small_enclosure_units import corner

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]


@dataclass
class LateRuns(Sampled):
    """In steps of DT: `waits` from a release to a start, `acts` from that to its effect, at most;
    `age` of what is read. `overtaking`: outputs act in any order, as they must not."""

    waits: int = 0
    acts: int = 0
    age: int = 0
    overtaking: bool = False

    @property
    def read_age(self) -> int:
        """D, in steps of DT."""
        return self.age + self.period + self.waits + self.acts

    def ends_of(self, rng: np.random.Generator, most: int, n: int) -> Ints:
        """Of every run: an end, always the same one or not, or anything."""
        drawn = np.where(
            rng.random(n) < 0.7, most * rng.integers(0, 2, n), rng.integers(0, most + 1, n)
        )
        return np.where(self.habit == 1, most, np.where(self.habit == 2, 0, drawn))

    def states(
        self, start: Floats, holds: int, rng: np.random.Generator
    ) -> Iterator[tuple[int, Floats]]:
        """(time after a_0, states), from `start`: output 0 acts at 0."""
        n = start.shape[1]
        self.habit = rng.integers(0, 4, n)
        back, end = self.read_age + self.period, holds * self.period
        seen = np.empty((back + end + 2, *start.shape))
        seen[back] = start
        before, w = self.habits(rng, self.controls, n), self.habits(rng, self.winds, n)
        for t in range(back, 0, -1):
            before = np.where(rng.random(n) < 0.02, self.habits(rng, self.controls, n), before)
            seen[t - 1] = self.step(seen[t], before, w, -DT)
        starts, acts = self._outputs(holds, rng, n)
        x, u, reads = start.copy(), np.zeros(n), np.zeros((len(starts), *start.shape))
        for k in range(len(starts)):
            reads[k] = self._read(seen, back + np.minimum(starts[k], 0), rng)
        for t in range(end + 1):
            seen[back + t] = x
            for k in np.flatnonzero((starts == t).any(axis=1)).tolist():
                read = self._read(seen, np.full(n, back + t), rng)
                reads[k] = np.where(starts[k] == t, read, reads[k])
            for k in np.flatnonzero((acts == t).any(axis=1)).tolist():
                u = np.where(acts[k] == t, self.law(reads[k]), u)
            yield t, x
            w = np.where(rng.random(n) < 0.1, self.habits(rng, self.winds, n), w)
            x = self.step(x, u, w, DT)

    def _outputs(self, holds: int, rng: np.random.Generator, n: int) -> tuple[Ints, Ints]:
        """When output k starts and acts: (outputs, runs) each. Output 0 acts at 0.

        An output that would act before an earlier one acts with it, which is still in its window,
        as no start is later than the next one.
        """
        assert self.waits <= self.period
        count = holds + 2 + (self.waits + self.acts) // self.period
        first = -self.ends_of(rng, self.waits + self.acts, n)
        starts = np.zeros((count, n), dtype=np.int64)
        acts = np.zeros((count, n), dtype=np.int64)
        for k in range(count):
            starts[k] = first + k * self.period + self.ends_of(rng, self.waits, n)
            acts[k] = starts[k] + self.ends_of(rng, self.acts, n)
            if k == 0:
                starts[0], acts[0] = np.clip(starts[0], -self.acts, 0), 0
            else:
                acts[k] = np.maximum(acts[k], 0 if self.overtaking else acts[k - 1])
        return starts, acts

    def _read(self, seen: Floats, at: Ints, rng: np.random.Generator) -> Floats:
        """What each run reads then, up to `age` old."""
        n = len(at)
        found = seen[at - self.ends_of(rng, self.age, n), :, np.arange(n)].T
        return np.asarray(found + corner(rng, -self.errors, self.errors, found.shape))
