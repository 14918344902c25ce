"""Gymnasium's car as an extern plant: what gymnasium.soter is answered by.

Purpose: one step of the environment from the state that Soter holds (it is float32 from the
second step on; the first is rounded to it).
Non-goals: rewards, episodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from cliff_env import CliffCar

if TYPE_CHECKING:
    from types import SimpleNamespace


class GymCar:
    """x, v of the next step from x, v and the force."""

    def __init__(self) -> None:
        self.env = CliffCar()

    def step(self, inputs: SimpleNamespace) -> dict[str, float]:
        """Move the environment from the given state."""
        self.env.state = np.array([inputs.state.x, inputs.state.v], dtype=np.float32)
        observation, *_ = self.env.step(np.array([inputs.force]))
        return {"x": float(observation[0]), "v": float(observation[1])}
