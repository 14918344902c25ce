"""Trains `rush.zip` beside it, the policy of `rush.soter`, with Stable-Baselines3.

    pip install stable-baselines3
    python examples/wall/train_sb3.py

Two minutes of SAC on the cart of `cart.soter` without walls: it learns to be at a goal soon, and
nothing of what is dangerous. What machine it was trained on, and the state of the optimizers, are
left out of the file; the rest is what `model.save` wrote.
"""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3 import SAC

HERE = Path(__file__).resolve().parent
PERIOD_S = 0.05
FORCE = 3.0
LEFT_OUT = ("optimizer", "system_info", "critic")


class Cart(gym.Env[Any, Any]):
    """Place, speed and goal are seen; the goal is anywhere on the track."""

    def __init__(self) -> None:
        """An episode is ten seconds."""
        large = np.array([12.0, 10.0, 10.0], np.float32)
        self.observation_space = gym.spaces.Box(-large, large)
        self.action_space = gym.spaces.Box(-FORCE, FORCE, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:  # noqa: ANN401
        """Start anywhere, at rest."""
        super().reset(seed=seed, options=options)
        self.x, self.v, self.steps = self.np_random.uniform(-9.5, 9.5), 0.0, 0
        self.goal = self.np_random.uniform(-9.5, 9.5)
        return self._seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Any]:  # noqa: ANN401
        """Move for a period."""
        self.v += PERIOD_S * float(action[0])
        self.x += PERIOD_S * self.v
        self.steps += 1
        reward = -abs(self.x - self.goal) - 0.05 * abs(self.v)
        return self._seen(), reward / 10.0, abs(self.x) > 12.0, self.steps >= 200, {}

    def _seen(self) -> Any:  # noqa: ANN401
        return np.clip(
            np.array([self.x, self.v, self.goal], np.float32),
            self.observation_space.low,
            self.observation_space.high,
        )


def main() -> None:
    """Train and save."""
    model = SAC(
        "MlpPolicy",
        Cart(),
        policy_kwargs={"net_arch": [16, 16]},
        learning_rate=1e-3,
        learning_starts=500,
        device="cpu",
        seed=1,
    ).learn(12_000)
    with tempfile.TemporaryDirectory() as folder:
        model.save(Path(folder) / "rush.zip")
        with (
            zipfile.ZipFile(Path(folder) / "rush.zip") as old,
            zipfile.ZipFile(HERE / "rush.zip", "w", zipfile.ZIP_DEFLATED) as new,
        ):
            for part in old.namelist():
                if not any(word in part for word in LEFT_OUT):
                    info = zipfile.ZipInfo(part, (1980, 1, 1, 0, 0, 0))
                    info.compress_type = zipfile.ZIP_DEFLATED
                    new.writestr(info, old.read(part))


if __name__ == "__main__":
    main()
