"""PPO learns to drive among pillars: with nothing before it, behind `rest`, behind a CBF filter.

Purpose: the table of docs/gym.md, "Learning behind `rest`". The same network learns with the same
seeds on examples/rest/bicycle.soter to drive from the origin to (42, 24) within 15 s, once an arm:

- bare: `force Park ac`, so nothing stands between the learner and the car;
- any command: the decision module asks for any command, `shield;` is left out;
- toward sc: each command is judged, and moved toward SC's where it is not permitted;
- CBF: as bare, behind a filter of cbfpy (a quadratic program a step, for the kinematic car without
  lag and errors, with the pillars as they are); CBF + 0.3 m: with so much more room around them.

What each of them learned drives alone at last, once from each of 48 other seeds. Needs
`pip install stable-baselines3 cbfpy` beside the extra `learn`.
Non-goals: the best learner, or the best filter; proofs (`soter verify`).
"""
# ruff: noqa: ANN401, D102, PLC0415 - libraries without types

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnvWrapper

from soter.gym import make_sb3_vec
from soter.report.tables import table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[Any]

CAR = Path(__file__).resolve().parents[2] / "examples" / "rest" / "bicycle.soter"
SHIELD = "  shield;  // it steers clear where another command would have hit"
SHIELDS = {"any command": "", "toward sc": "  shield toward sc;"}
ROOM = {"CBF": 0.0, "CBF + 0.3 m": 0.3}
ARMS = ("bare", *SHIELDS, *ROOM)
ALONE = """
system Alone {
  c: Car;
  module Park;
  force Park ac;
  until 60s;
  always clear({ x: c.truth.x, y: c.truth.y, heading: 0.0, v: 0.0, steer: 0.0 });
}
"""
GOAL, NEAR = np.array([42.0, 24.0]), 3.0
WORLDS, STEPS, FLIGHTS = 24, 300, 48
DISCS = np.array([[25, -4], [30, 8], [53, 12], [24, 19], [-3, 16], [35, 35]], dtype=float)
RADII = np.array([1.0, 1.5, 1.0, 2.0, 1.0, 1.5]) + 1.2
ENGINE, BRAKES, FASTEST, WHEELBASE, LOCK = 3.0, 5.4, 12.0, 2.7, 0.45
HEADINGS = (
    *("arm", "episodes", "violated", "goals", "not as wished, %"),
    *("alone: return", "goals, %", "violated, %", "CPU s a seed"),
)


def away(pose: Array) -> Array:
    """How far the goal is, in m, (n,)."""
    return np.asarray(np.hypot(*(GOAL - pose[:, :2]).T))


def reward(seen: Array, action: Array, after: Array) -> Array:
    """A metre nearer is 1, a step costs 0.02, the goal is worth 20; (n,)."""
    del action
    return away(seen) - away(after) - 0.02 + 20.0 * (away(after) < NEAR)


def arrived(seen: Array, action: Array, after: Array) -> Array:
    """Whether the goal is reached, (n,)."""
    del seen, action
    return away(after) < NEAR


def filter_of(room: float) -> Any:
    """A function of an estimate (4,) and a wish (acceleration, tan of the steering angle), (2,).

    It gives the nearest to the wish with h'' + 4 h' + 4 h >= 0 for each pillar, h the distance to
    it less its radius and `room`; relaxed where there is none.
    """
    import jax  # type: ignore[import-not-found]
    import jax.numpy as jnp  # type: ignore[import-not-found]
    from cbfpy import CBF, CBFConfig  # type: ignore[import-not-found]

    class Car(CBFConfig):  # type: ignore[misc] # it may be Any
        def __init__(self) -> None:
            most = float(np.tan(LOCK))
            super().__init__(n=4, m=2, u_min=(-BRAKES, -most), u_max=(ENGINE, most))

        def f(self, z: Any) -> Any:
            return jnp.array([z[3] * jnp.cos(z[2]), z[3] * jnp.sin(z[2]), 0.0, 0.0])

        def g(self, z: Any) -> Any:
            return jnp.array([[0.0, 0.0], [0.0, 0.0], [0.0, z[3] / WHEELBASE], [1.0, 0.0]])

        def h_2(self, z: Any) -> Any:
            return jnp.hypot(z[0] - DISCS[:, 0], z[1] - DISCS[:, 1]) - RADII - room

        def alpha(self, h: Any) -> Any:
            return 2.0 * h

        def alpha_2(self, h_2: Any) -> Any:
            return 2.0 * h_2

    return jax.jit(jax.vmap(CBF.from_config(Car()).safety_filter))


def filtered(asked: Any, pose: Array, pedal: Array, wheel: Array) -> tuple[Array, Array]:
    """The pedal and the wheel (n,) that act in the place of these, at these estimates (n, 5)."""
    power = ENGINE * (1.0 - pose[:, 3].astype(float) / FASTEST)
    wish = np.stack([np.where(pedal > 0.0, power, BRAKES) * pedal, np.tan(wheel)], 1)
    a, bend = np.asarray(asked(pose[:, :4].astype(float), wish)).T
    pedal = a / np.where(a > 0.0, np.maximum(power, 0.1), BRAKES)
    return np.clip(pedal, -1.0, 1.0), np.clip(np.arctan(bend), -LOCK, LOCK)


@dataclass
class Counts:
    """What happened."""

    steps: int = 0
    changed: int = 0
    violations: int = 0
    goals: int = 0
    returns: list[float] = field(default_factory=list)


class Learner(VecEnvWrapper):  # type: ignore[misc] # it may be Any
    """What a learner sees, about in [-1, 1], and gives: a pedal (negative: brake) and the wheel.

    `once`: only the first episode of each world is counted.
    """

    def __init__(self, venv: Any, asked: Any, *, once: bool) -> None:
        seen = spaces.Box(-np.inf, np.inf, (7,), np.float32)
        super().__init__(venv, seen, spaces.Box(-1.0, 1.0, (2,), np.float32))
        self.asked, self.once, self.counts = asked, once, Counts()
        self.over, self.total = np.zeros(venv.num_envs, bool), np.zeros(venv.num_envs)
        self.pose = np.zeros((venv.num_envs, 5))

    def reset(self) -> Array:
        self.pose = self.venv.reset()
        return self.shown(self.pose)

    def shown(self, pose: Array) -> Array:
        """(n, 7) of the estimates (n, 5)."""
        to = GOAL - pose[:, :2]
        turn = np.arctan2(to[:, 1], to[:, 0]) - pose[:, 2]
        place = ((pose[:, 0] - 25.0) / 25.0, (pose[:, 1] - 12.0) / 25.0, away(pose) / 25.0 - 1.0)
        moves = (np.sin(turn), np.cos(turn), pose[:, 3] / 6.0 - 1.0, pose[:, 4] / LOCK)
        return np.stack([*place, *moves], 1).astype(np.float32)

    def step_async(self, actions: Array) -> None:
        pedal, wheel = actions[:, 0].astype(float), LOCK * actions[:, 1].astype(float)
        if self.asked is not None:
            wish = pedal, wheel
            pedal, wheel = filtered(self.asked, self.pose, pedal, wheel)
            off = np.abs(pedal - wish[0]) + np.abs(wheel - wish[1])
            self.counts.changed += int((off > 0.01).sum())
        drive = np.stack([np.maximum(pedal, 0.0), np.maximum(-pedal, 0.0), wheel], 1)
        self.venv.step_async(drive)

    def step_wait(self) -> Any:
        self.pose, rewards, over, infos = self.venv.step_wait()
        hit = np.array([info["cost"] > 0.0 for info in infos])
        rewards = rewards - 10.0 * hit
        self.total, c = self.total + rewards, self.counts
        c.steps += len(over)
        c.changed += sum(info["intervened"] for info in infos)
        for world in np.flatnonzero(over).tolist():
            info = infos[world]
            info["terminal_observation"] = self.shown(info["terminal_observation"][None])[0]
            if not (self.once and self.over[world]):
                c.violations += int(hit[world])
                c.goals += int(not hit[world] and not info["TimeLimit.truncated"])
                c.returns.append(float(self.total[world]))
            self.total[world] = 0.0
        self.over |= over
        return self.shown(self.pose), rewards, over, infos


def worlds(folder: Path, arm: str, count: int, seed: int, *, once: bool = False) -> Learner:
    """Worlds of an arm as its learner has them."""
    text = CAR.read_text(encoding="utf-8")
    assert SHIELD in text
    path = folder / f"{ARMS.index(arm)}.soter"
    path.write_text(text.replace(SHIELD, SHIELDS.get(arm, "")) + ALONE, encoding="utf-8")
    made = make_sb3_vec(
        path,
        count,
        system="Protected" if arm in SHIELDS else "Alone",
        reward=reward,
        terminate=arrived,
        on_violation="terminate",
        max_steps=STEPS,
    )
    made.seed(seed)
    return Learner(made, filter_of(ROOM[arm]) if arm in ROOM else None, once=once)


def learned(folder: Path, arm: str, seed: int, steps: int) -> tuple[Any, Counts, float]:
    """The policy, what happened as it learned, and the CPU s of that."""
    made = worlds(folder, arm, WORLDS, 1000 * seed)
    model = PPO(
        "MlpPolicy",
        made,
        n_steps=100,
        batch_size=300,
        learning_rate=1e-3,
        policy_kwargs={"net_arch": [32, 32]},
        seed=seed,
        device="cpu",
    )
    begun = time.process_time()
    model.learn(steps)
    return model, made.counts, time.process_time() - begun


def flown(folder: Path, model: Any) -> Counts:
    """What a policy does alone, without chance of its own."""
    made = worlds(folder, "bare", FLIGHTS, 777_000, once=True)
    seen = made.reset()
    while not made.over.all():
        seen, *_ = made.step(model.predict(seen, deterministic=True)[0])
    return made.counts


def row(arm: str, seeds: list[tuple[Counts, Counts, float]]) -> list[str]:
    """The row of an arm: sums and means over its seeds, and the least mean return of a seed."""
    on_way, alone = [c for c, _, _ in seeds], [c for _, c, _ in seeds]
    flights = sum(len(c.returns) for c in alone)
    returns = [float(np.mean(c.returns)) for c in alone]
    return [
        arm,
        str(sum(len(c.returns) for c in on_way)),
        str(sum(c.violations for c in on_way)),
        str(sum(c.goals for c in on_way)),
        f"{100.0 * sum(c.changed for c in on_way) / sum(c.steps for c in on_way):.1f}",
        f"{np.mean(returns):.1f} ({min(returns):.1f})",
        f"{100.0 * sum(c.goals for c in alone) / flights:.1f}",
        f"{100.0 * sum(c.violations for c in alone) / flights:.1f}",
        f"{np.mean([cpu for _, _, cpu in seeds]):.0f}",
    ]


def main() -> None:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seeds", type=int, default=5)
    asked.add_argument("--steps", type=int, default=60_000)
    asked.add_argument("--arms", default=",".join(ARMS))
    options = asked.parse_args()
    torch.set_num_threads(1)
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for arm in options.arms.split(","):
            seeds = []
            for seed in range(1, options.seeds + 1):
                model, counts, cpu = learned(Path(name), arm, seed, options.steps)
                seeds.append((counts, flown(Path(name), model), cpu))
                print(*row(f"{arm} {seed}", seeds[-1:]), sep=" | ", flush=True)
            rows.append(row(arm, seeds))
    print(table(HEADINGS, rows))


if __name__ == "__main__":
    main()
