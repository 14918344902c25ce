"""Train a driver twice: once as everybody does, once behind the module. Count the falls.

Purpose: `python examples/mountain_car/train.py`: the cross-entropy method in NumPy on
Gymnasium's car with the cliff, first alone, then inside `soter.gym.Protected`; the second policy is
written to policy.json and is the advanced controller `Learned` of cliff.soter.
Non-goals: a good learner. Equal seeds give equal policies.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cliff_env
import numpy as np
from policy import SIZE, WEIGHTS, Policy, write_weights

from soter.gym import Protected

if TYPE_CHECKING:
    import gymnasium
    from numpy.typing import NDArray

HERE = Path(__file__).parent
GENERATIONS, POPULATION, ELITE, EPISODES = 20, 32, 6, 2
STEPS_MAX = 300
"""A training episode; a good driver needs 120."""
STEP_COST = 0.1
FLAG_WORTH = 100.0
"""Of having come from the bottom half-way to the flag: the reward alone says nothing before."""


@dataclass
class Tally:
    """What training cost and gave."""

    episodes: int = 0
    steps: int = 0
    falls: int = 0
    goals: int = 0
    wall_s: float = 0.0
    scores: list[float] = field(default_factory=list)
    """Best of each generation."""


def episode(env: gymnasium.Env[Any, Any], policy: Policy, seed: int, tally: Tally) -> float:
    """The score of one episode: the reward, less a little for time, plus the way up."""
    observation, _ = env.reset(seed=seed)
    total, highest, ended = 0.0, -1.0, False
    for _ in range(STEPS_MAX):
        observation, reward, ended, cut, info = env.step(policy(observation))
        tally.steps += 1
        total += float(reward) - STEP_COST
        highest = max(highest, float(observation[0]))
        tally.falls += info["fell"]
        if ended or cut:
            break
    tally.episodes += 1
    tally.goals += ended and highest >= 0.45
    return total + FLAG_WORTH * min(highest + 0.5, 0.95)


def train(env: gymnasium.Env[Any, Any], seed: int) -> tuple[NDArray[np.float64], Tally]:
    """The cross-entropy method: sample, keep the best, fit a normal distribution, again."""
    rng = np.random.default_rng(seed)
    mean, spread = np.zeros(SIZE), np.full(SIZE, 1.5)
    tally, best, best_score = Tally(), mean, -np.inf
    began = time.perf_counter()
    for generation in range(GENERATIONS):
        sampled = mean + spread * rng.standard_normal((POPULATION, SIZE))
        starts = [seed * 100_000 + generation * EPISODES + i for i in range(EPISODES)]
        scores = np.array(
            [sum(episode(env, Policy(w), s, tally) for s in starts) / EPISODES for w in sampled]
        )
        order = np.argsort(-scores, kind="stable")[:ELITE]
        mean = sampled[order].mean(axis=0)
        spread = sampled[order].std(axis=0) + 0.3 / (1 + generation)
        tally.scores.append(float(scores[order[0]]))
        if scores[order[0]] > best_score:
            best, best_score = sampled[order[0]], float(scores[order[0]])
    tally.wall_s = time.perf_counter() - began
    return best, tally


def protected() -> Protected:
    """The car behind SafeCar."""
    return Protected(HERE / "cliff.soter", cliff_env.make())


def _line(what: str, tally: Tally) -> str:
    return (
        f"{what:<12} {tally.episodes:>6} episodes  {tally.steps:>7} steps  {tally.falls:>5} falls  "
        f"{tally.goals:>5} goals  best {tally.scores[-1]:6.1f}  {tally.wall_s:5.1f} s"
    )


def main() -> None:
    """Both trainings, one line each, and policy.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=WEIGHTS)
    given = parser.parse_args()
    _, alone = train(cliff_env.make(), given.seed)
    print(_line("unprotected", alone))
    weights, behind = train(protected(), given.seed)
    print(_line("protected", behind))
    facts = {"seed": given.seed, "falls_unprotected": alone.falls, "falls_protected": behind.falls}
    write_weights(weights, facts, given.output)
    print(f"wrote {given.output}")


if __name__ == "__main__":
    main()
