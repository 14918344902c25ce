"""SC-runs of any small system, by brute force on a fine grid of times.

Purpose: an adversary that knows nothing of the engine. Every run chooses what acted before a_0, how
late it acts and reads, disturbances and errors; states are kept for the reads to come.
Non-goals: exactness: RK4 with steps of `DT`, so systems must be smooth between kinks.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from unit.verify.grid.small_enclosure_units import corner

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

DT = 1e-3


@dataclass
class Sampled:
    """x' = rate(x, u, w); u = law(y). Times in steps of DT; x has shape (axes, runs)."""

    rate: Callable[[Floats, Floats, Floats], Floats]
    law: Callable[[Floats], Floats]
    controls: tuple[float, float]
    winds: tuple[float, float]
    period: int
    delay: int = 0
    jitter: int = 0
    errors: float = 0.0
    past: list[Floats] = field(default_factory=list)

    def step(self, x: Floats, u: Floats, w: Floats, h: float) -> Floats:
        """RK4."""
        k1 = self.rate(x, u, w)
        k2 = self.rate(x + h / 2 * k1, u, w)
        k3 = self.rate(x + h / 2 * k2, u, w)
        k4 = self.rate(x + h * k3, u, w)
        return np.asarray(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))

    def habits(self, rng: np.random.Generator, ends: tuple[float, float], n: int) -> Floats:
        """Per run: always one end, always the other, or anything."""
        drawn = corner(rng, ends[0], ends[1], (n,))
        return np.where(self.habit == 1, ends[0], np.where(self.habit == 2, ends[1], drawn))

    def run(
        self, start: Floats, holds: Floats, rng: np.random.Generator
    ) -> tuple[Floats, Floats, Floats]:
        """From `start` over `holds` (per run): lowest and highest state on the way, the last one.

        The last one is that at a_N, the run's own.
        """
        n = start.shape[1]
        self.habit = rng.integers(0, 4, n)
        reach = self.delay + 1
        past = [start]
        before, w = self.habits(rng, self.controls, n), self.habits(rng, self.winds, n)
        for _ in range(self.delay):
            past.append(self.step(past[-1], before, w, -DT))
        past.reverse()
        end = int(holds.max())
        shifts = rng.integers(-self.jitter, self.jitter + 1, (end + 1, n))
        shifts[:, self.habit == 3] = self.jitter
        shifts[0] = 0
        acts = np.arange(end + 1)[:, None] * self.period + shifts
        x, u = start.copy(), np.zeros(n)
        low, high, last = start.copy(), start.copy(), start.copy()
        for t in range(int(acts[-1].max()) + 1):
            for k in range(end + 1):
                now = acts[k] == t
                if now.any():
                    late = np.where(rng.random(n) < 0.5, self.delay, rng.integers(0, reach, n))
                    seen = np.stack(past[-reach:])[reach - 1 - late, :, np.arange(n)].T
                    read = seen + corner(rng, -self.errors, self.errors, seen.shape)
                    u = np.where(now, self.law(read), u)
                    last = np.where(now & (holds == k), x, last)
            going = t < acts[holds, np.arange(n)]
            w = np.where(rng.random(n) < 0.1, self.habits(rng, self.winds, n), w)
            x = np.where(going, self.step(x, u, w, DT), x)
            low, high = np.minimum(low, x), np.maximum(high, x)
            past.append(x)
        return low, high, last
