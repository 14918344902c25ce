"""A cart before a wall as a Gymnasium environment, and what the tests drive it with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
WALL = 10.0


class Cart(gymnasium.Env[Any, Any]):
    """x, v after 5 ms of a constant acceleration; ends at the wall or after `steps`."""

    def __init__(self, steps: int = 4000) -> None:
        self.observation_space = spaces.Box(-1000.0, 1000.0, (2,), np.float64)
        self.action_space = spaces.Box(-3.0, 3.0, (1,), np.float64)
        self.steps, self.done = steps, 0
        self.state = np.zeros(2)
        self.actions: list[float] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        del options
        self.state, self.done = np.array([self.np_random.uniform(-1.0, 1.0), 0.0]), 0
        return self.state.copy(), {"own": 1}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        x, v = self.state
        accel, h = float(action[0]), 0.005
        self.actions.append(accel)
        self.state = np.array([x + h * v + 0.5 * h * h * accel, v + h * accel])
        self.done += 1
        crashed = bool(self.state[0] >= WALL)
        return self.state.copy(), 1.0, crashed, self.done >= self.steps, {"own": self.done}


class Replay(gymnasium.Env[Any, Any]):
    """Goes through given states whatever is done, and notes what was."""

    def __init__(self, states: Any) -> None:
        self.observation_space = spaces.Box(-1000.0, 1000.0, (states.shape[1],), np.float64)
        self.action_space = spaces.Box(-3.0, 3.0, (1,), np.float64)
        self.states, self.at = states, 0
        self.actions: list[float] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        del options
        self.at, self.actions = 0, []
        return self.states[0], {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.actions.append(float(action[0]))
        self.at += 1
        return self.states[self.at], 0.0, False, self.at == len(self.states) - 1, {}
