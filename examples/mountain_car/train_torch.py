"""An actor-critic in torch over many worlds, once with the agent alone, once behind the module.

Purpose: `python examples/mountain_car/train_torch.py`: the worlds are the program's own plant,
stepped in one call (docs/gym.md); falls are counted. Needs `pip install 'soter-rta[learn]' torch`.
Non-goals: a good learner: one step of advantage, no replay, nothing tuned.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from torch import nn

from soter.gym import make_vec

if TYPE_CHECKING:
    from numpy.typing import NDArray

HERE = Path(__file__).parent
DISCOUNT, WIDTH, RATE = 0.98, 32, 1e-2
SCALE = torch.tensor([1.0, 20.0])
GOAL = 0.45


class Outcome(NamedTuple):
    """What training cost and gave."""

    steps: int
    falls: int
    goals: int
    reward: float
    """Mean of the last tenth of all steps."""
    wall_s: float


def height(seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Energy of the cars (n, 2), per mass: (n,)."""
    energy: NDArray[np.float64] = 0.5 * seen[:, 1] ** 2 + 0.0025 / 3.0 * np.sin(3.0 * seen[:, 0])
    return energy


def reward(seen: Any, action: Any, after: Any) -> NDArray[np.float64]:  # noqa: ANN401 - arrays
    """Energy gained in a step from (n, 2) by (n, 1) to (n, 2), and the flag: (n,)."""
    gained = 3000.0 * (height(after) - height(seen)) - 0.01 * action[:, 0] ** 2
    return np.asarray(gained + 10.0 * (after[:, 0] >= GOAL))


def arrived(_: Any, __: Any, after: Any) -> NDArray[np.bool_]:  # noqa: ANN401 - arrays
    """Which cars, (n, 2), are at the flag: (n,)."""
    return np.asarray(after[:, 0] >= GOAL)


def train(system: str, *, worlds: int, steps: int, seed: int) -> Outcome:
    """Train in all worlds of a system for so many steps each."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    actor = nn.Sequential(nn.Linear(2, WIDTH), nn.Tanh(), nn.Linear(WIDTH, 1), nn.Tanh())
    critic = nn.Sequential(nn.Linear(2, WIDTH), nn.Tanh(), nn.Linear(WIDTH, 1))
    optimiser = torch.optim.Adam([*actor.parameters(), *critic.parameters()], lr=RATE)
    env = make_vec(
        HERE / "cliff.soter",
        worlds,
        system=system,
        reward=reward,
        terminate=arrived,
        on_violation="terminate",
        max_steps=300,
        dtype=np.float32,
    )
    seen, _ = env.reset(seed=seed)
    falls, goals, rewards, began = 0, 0, [], time.perf_counter()
    for _ in range(steps):
        state = torch.from_numpy(seen) * SCALE
        wish = torch.distributions.Normal(actor(state), 0.5)
        action = wish.sample()
        seen, gained, ended, cut, info = env.step(action.clamp(-1.0, 1.0))
        with torch.no_grad():
            next_value = critic(torch.from_numpy(seen) * SCALE)[:, 0]
            alive = torch.from_numpy(1.0 - (ended | cut)).float()
            target = torch.from_numpy(gained).float() + DISCOUNT * alive * next_value
        advantage = target - critic(state)[:, 0]
        loss = advantage.pow(2).mean()
        loss = loss - (wish.log_prob(action)[:, 0] * advantage.detach()).mean()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        falls += int(info["cost"].sum())
        goals += int((ended & (info["cost"] == 0.0)).sum())
        rewards.append(float(gained.mean()))
    tail = rewards[-max(1, steps // 10) :]
    wall_s = time.perf_counter() - began
    return Outcome(steps * worlds, falls, goals, float(np.mean(tail)), wall_s)


def main() -> None:
    """Both trainings, one line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=256)
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for name, system in (("unprotected", "LearnedAdvanced"), ("protected", "LearnedProtected")):
        training = train(system, worlds=given.worlds, steps=given.steps, seed=given.seed)
        print(
            f"{name:<12} {training.steps:>9,} steps  {training.falls:>6,} falls  "
            f"{training.goals:>6,} goals"
            f"  reward {training.reward:6.3f} a step  {training.wall_s:5.1f} s"
        )


if __name__ == "__main__":
    main()
