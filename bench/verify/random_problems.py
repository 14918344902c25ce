"""Random verification problems: modules of the closed-loop adversary, and their plant in NumPy.

Purpose: `problem(number)`: double integrators, lags, a pole, maps, one to three states, a command
and a law, drawn as `bench/adversary/module_families.py` draws them. The NumPy side is exact for
linear plants (zero-order hold a tick) and RK4 for the others; it knows nothing of the engine.
Non-goals: being easy to prove; many are not, and then nothing is claimed about them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from bench.adversary.module_families import FAMILIES, pole
from bench.adversary.random_modules import DRAG, Module

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

KINDS = ("integrator", "tank", "lag", "pole", "chain", "map1", "map2", "swing", "mode", "drag")
CELLS = {1: (400,), 2: (80, 80), 3: (60, 60, 20)}
"""By the number of states."""


@dataclass(frozen=True)
class RandomProblem(Module):
    """One problem. Times in ticks (1 ms for flows, one step for maps)."""

    horizon: int = 0
    """Declared H in ns; 0: H*."""

    @property
    def d(self) -> int:
        """How old the state may be that a command answers."""
        return self.times.max_age + self.times.response_sc + self.times.acts

    @property
    def j(self) -> int:
        """Jitter of acting."""
        return self.times.late_sc + self.times.response_sc + self.times.acts

    @property
    def text(self) -> str:
        """The program."""
        declared = f"    horizon {self.horizon}ns;\n" if self.horizon else ""
        return super().text.replace("  verify {\n", f"  verify {{\n{declared}")

    @cached_property
    def _steps(self) -> dict[int, tuple[Array, Array]]:
        return {k: self.exact(k * 1e-3) for k in (1, -1)}

    def move(self, x: Array, u: Array, w: Array, ticks: int = 1) -> Array:
        """States (n, runs) a tick later (`ticks` = -1: earlier) under u (runs,) and w (n, runs)."""
        if self.is_map:
            return np.clip(self._rates(x, u, w), -1e6, 1e6)
        h = 1e-3 * ticks
        if not self.terms:
            phi, gamma = self._steps[ticks]
            return phi @ x + gamma @ (np.array(self.b) * u + w)
        k1 = self._rates(x, u, w)
        k2 = self._rates(x + 0.5 * h * k1, u, w)
        k3 = self._rates(x + 0.5 * h * k2, u, w)
        k4 = self._rates(x + h * k3, u, w)
        return np.clip(x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), -1e6, 1e6)

    def _rates(self, x: Array, u: Array, w: Array) -> Array:
        rate = np.array(self.a) @ x + np.array(self.b) * u + w
        for kind, of, to, factor in self.terms:
            rate[to] += factor * x[of] * (np.abs(x[of]) if kind == DRAG else 1.0 - x[of] ** 2 / 6.0)
        return rate

    def law(self, y: Array) -> Array:
        """SC's command on estimates (n, runs)."""
        command: Array = np.array(self.gain[0][0]) @ y
        return np.clip(-command, -self.force[0], self.force[0])

    def safe(self, x: Array, slack: float = 1e-9) -> npt.NDArray[np.bool_]:
        """Whether states lie in C."""
        inside: npt.NDArray[np.bool_] = np.all(np.array(self.box) + slack > np.abs(x).T, axis=1)
        return inside

    def surely_lost(self, x: Array) -> npt.NDArray[np.bool_]:
        """Closed form: no law whatever keeps these in C against the worst disturbance.

        Only for the double integrator: braking as hard as the set of controls allows.
        """
        if self.family != "integrator" or self.wind[0]:
            return np.zeros(x.shape[1], dtype=bool)
        brake = self.control[0] - self.wind[1]
        stop = x[1] * x[1] / (2.0 * brake) if brake > 0.0 else np.full(x.shape[1], np.inf)
        lost: npt.NDArray[np.bool_] = np.sign(x[1]) * x[0] + stop > self.box[0] + 1e-9
        return lost


def problem(number: int) -> RandomProblem:
    """Problem number `number`: one law, and all phases zero."""
    rng = np.random.default_rng([2026, number])
    family = KINDS[number % len(KINDS)]
    drawn = {**FAMILIES, "pole": pole}[family](number, rng)
    times = replace(drawn.times, sc_phase=0)
    one = replace(drawn, gain=drawn.gain[:1], cells=CELLS[drawn.n], times=times)
    return RandomProblem(**vars(one))
