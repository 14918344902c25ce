"""Gymnasium's own mountain car with a cliff where its left wall was.

Purpose: MountainCarContinuous-v0, byte for byte but for one thing: nothing stops the car at -1.2.
Whoever gets there falls, which ends the episode and costs 100.
Non-goals: protection (`soter.gym`), the certified model (cliff.soter).
"""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.classic_control.continuous_mountain_car import Continuous_MountainCarEnv

CLIFF = -1.2
FALL_REWARD = -100.0
STEPS_MAX = 999
"""As MountainCarContinuous-v0 is registered."""


class CliffCar(Continuous_MountainCarEnv):
    """MountainCarContinuous without a left wall; `info["fell"]` says that x <= CLIFF."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.min_position = CLIFF - 2.0 * self.max_speed  # never reached: it fell before
        low = np.array([self.min_position, -self.max_speed], dtype=np.float32)
        self.observation_space = spaces.Box(low, self.high_state, dtype=np.float32)

    def step(self, action: np.ndarray) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """One step of Gymnasium's; a fall ends the episode."""
        observation, reward, ended, cut, info = super().step(action)
        fell = bool(float(observation[0]) <= CLIFF)
        gained = float(reward) + (FALL_REWARD if fell else 0.0)
        return observation, gained, ended or fell, cut, {**info, "fell": fell}


def make(render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """The environment as `gymnasium.make` would give it: 999 steps at most."""
    return gymnasium.wrappers.TimeLimit(CliffCar(render_mode), STEPS_MAX)
