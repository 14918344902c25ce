"""Runs of the car under its law with errors, delays and jitter at their bounds, exactly.

All runs of a batch at once; x = (p, v), p' = v, v' = u + w, u and w constant on pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unit.verify.grid.small_enclosure_units import corner

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Car:
    """What the adversary may do."""

    kp: float
    kv: float
    brake: float
    period: float
    delay: float = 0.0
    jitter: float = 0.0
    wind: float = 0.0
    errors: tuple[float, float] = (0.0, 0.0)

    def law(self, y: Floats) -> Floats:
        """SC."""
        return np.asarray(np.clip(-self.kp * y[0] - self.kv * y[1], -self.brake, self.brake))


def flow(x: Floats, a: Floats, t: Floats) -> Floats:
    """The exact solution after t (which may be negative) under acceleration a."""
    return np.stack([x[0] + x[1] * t + a * t * t / 2, x[1] + a * t])


class Runs:
    """A batch of SC-runs (docs/verification.md, section 3): `states` yields the states met."""

    def __init__(self, car: Car, start: Floats, rng: np.random.Generator) -> None:
        """`start`: shape (2, runs), the states at a_0 = 0."""
        self.car, self.rng, self.x = car, rng, start.copy()
        self.n = start.shape[1]
        self.time = np.zeros(self.n)
        self.habit = rng.integers(0, 5, self.n)
        """0: random; 1, 2: everything pushes one way; 3, 4: the same on the way, errors against."""
        self.read = self._first_read()

    def _drawn(self, low: float, high: float, sign: float = 1.0) -> Floats:
        drawn = corner(self.rng, low, high, (self.n,))
        drawn = np.where(self.habit % 2 == 1, high if sign > 0 else low, drawn)
        return np.where((self.habit > 0) & (self.habit % 2 == 0), low if sign > 0 else high, drawn)

    def _wind(self) -> Floats:
        return self._drawn(-self.car.wind, self.car.wind)

    def _error(self) -> Floats:
        sign = -1.0
        return np.stack([self._drawn(-e, e, sign) for e in self.car.errors])

    def _late(self) -> Floats:
        late = corner(self.rng, 0.0, self.car.delay, (self.n,))
        return np.where(self.habit > 0, self.car.delay, late)

    def _first_read(self) -> Floats:
        before = self._drawn(-self.car.brake, self.car.brake) + self._wind()
        return flow(self.x, before, -self._late()) + self._error()

    def holds(self, count: int) -> Iterator[tuple[int, Floats, list[Floats]]]:
        """For each hold k: k + 1, x(a_(k+1)), and states met on the way there."""
        car = self.car
        for k in range(count):
            u = car.law(self.read)
            shift = corner(self.rng, -car.jitter, car.jitter, (self.n,))
            shift = np.where(self.habit > 0, car.jitter * (1 if k % 2 else -1), shift)
            shift = np.where(self.habit > 2, car.jitter, shift)
            end = (k + 1) * car.period + shift
            met = []
            late = np.minimum(self._late(), end - self.time)
            cut = (end - late - self.time) * self.rng.uniform(0, 1, self.n)
            for until in (self.time + cut, end - late, end):
                self.x = flow(self.x, u + self._wind(), until - self.time)
                self.time = until
                met.append(self.x)
                if len(met) == 2:
                    self.read = self.x + self._error()
            yield k + 1, self.x, met
