"""Makes the files of Stable-Baselines3 beside it, and what its `predict` says of observations.

`pip install stable-baselines3 sb3-contrib`, then
`python tests/unit/policy/files/make_files.py`, or with `--kinds` for the files of `kinds.json`
alone, of the other algorithms, spaces and options. Nothing is
trained to be good: each policy learns for a moment, so that its weights are any. Each file is
what `model.save` wrote, deflated, without the state of its optimizers and what machine it was.
"""

# mypy: ignore-errors
from __future__ import annotations

import json
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import sb3_contrib as contrib
import torch
from gymnasium import spaces
from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize
from torch import nn

HERE = Path(__file__).resolve().parent
STEPS = 40
COMMON = {"device": "cpu", "seed": 3}
SHORT = {"buffer_size": 200, "learning_starts": 10}


def env(name: str) -> Any:
    return DummyVecEnv([lambda: gym.make(name)])


def repacked(model: Any, name: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        model.save(Path(folder) / name)
        with (
            zipfile.ZipFile(Path(folder) / name) as old,
            zipfile.ZipFile(HERE / name, "w", zipfile.ZIP_DEFLATED) as new,
        ):
            for part in sorted(old.namelist()):
                if "optimizer" not in part and part != "system_info.txt":
                    info = zipfile.ZipInfo(part, (1980, 1, 1, 0, 0, 0))
                    info.compress_type = zipfile.ZIP_DEFLATED
                    new.writestr(info, old.read(part))


def answers(
    model: Any, venv: Any, frames: int, normalise: Any = None, *, stacked_first: bool = True
) -> dict[str, Any]:
    """What a user of Stable-Baselines3 gets, observation by observation."""
    rng = np.random.default_rng(5)
    space = venv.observation_space
    low = np.maximum(space.low, -5.0)
    high = np.minimum(space.high, 5.0)
    seen = rng.uniform(low, high, (STEPS, low.size)).astype(np.float32)
    stack = np.zeros(frames * low.size, np.float32)
    acted = []
    for one in seen:
        given = one if stacked_first or normalise is None else normalise(one)
        stack = np.concatenate([stack[low.size :], given])
        whole = normalise(stack) if stacked_first and normalise is not None else stack
        action, _ = model.predict(whole, deterministic=True)
        acted.append(np.asarray(action).reshape(-1).tolist())
    return {"observations": seen.tolist(), "actions": acted}


def main() -> None:
    expected = {}
    car = env("MountainCarContinuous-v0")
    normalised = VecNormalize(car)
    small = {"net_arch": [8, 8]}
    model = PPO(
        "MlpPolicy",
        normalised,
        policy_kwargs={**small, "activation_fn": nn.ReLU},
        n_steps=64,
        **COMMON,
    ).learn(64)
    repacked(model, "ppo.zip")
    normalised.save(HERE / "ppo_vecnormalize.pkl")
    expected["ppo.zip:ppo_vecnormalize.pkl"] = answers(model, car, 1, normalised.normalize_obs)
    model = SAC(
        "MlpPolicy", env("Pendulum-v1"), policy_kwargs=dict(small), **SHORT, **COMMON
    ).learn(20)
    repacked(model, "sac.zip")
    expected["sac.zip"] = answers(model, env("Pendulum-v1"), 1)
    model = TD3(
        "MlpPolicy", env("Pendulum-v1"), policy_kwargs=dict(small), **SHORT, **COMMON
    ).learn(20)
    repacked(model, "td3.zip")
    expected["td3.zip"] = answers(model, env("Pendulum-v1"), 1)
    model = DQN("MlpPolicy", env("Acrobot-v1"), policy_kwargs=dict(small), **SHORT, **COMMON).learn(
        20
    )
    repacked(model, "dqn.zip")
    expected["dqn.zip"] = answers(model, env("Acrobot-v1"), 1)
    inner = VecNormalize(env("Pendulum-v1"))
    stacked = VecFrameStack(inner, 3)
    model = A2C("MlpPolicy", stacked, policy_kwargs={"net_arch": [8]}, **COMMON).learn(20)
    repacked(model, "a2c_of_frames.zip")
    inner.save(HERE / "a2c_vecnormalize.pkl")
    expected["a2c_of_frames.zip:a2c_vecnormalize.pkl"] = answers(
        model, env("Pendulum-v1"), 3, inner.normalize_obs, stacked_first=False
    )
    (HERE / "predicted.json").write_text(json.dumps(expected) + "\n", encoding="utf-8")


# ---------------------------------------------------------------- other algorithms and spaces

SEEN = spaces.Box(-2.0, 2.0, (3,), np.float32)
PUSH = spaces.Box(-1.0, 3.0, (2,), np.float32)
NAMED = spaces.Dict({"speed": spaces.Box(-5.0, 5.0, (2,), np.float32), "gear": spaces.Discrete(3)})
SEVERAL = spaces.MultiDiscrete([3, 2])


class World(gym.Env):
    """Of any spaces; what it does is no matter."""

    def __init__(self, seen: spaces.Space, acted: spaces.Space) -> None:
        self.observation_space, self.action_space, self.steps = seen, acted, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ARG002
        super().reset(seed=seed)
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> Any:
        self.steps += 1
        reward = float(np.sum(action))
        return self.observation_space.sample(), reward, self.steps % 9 == 0, False, {}

    def action_masks(self) -> Any:
        return np.ones(int(sum(self.action_space.nvec)), bool)


def kind(
    name: str, algorithm: Any, policy: str, seen: Any, acted: Any, more: Any = None, **options: Any
) -> dict[str, Any]:
    """Save one, and say what it answers in episodes of 8 steps."""
    venv: Any = DummyVecEnv([lambda: World(seen, acted)])
    if isinstance(seen, spaces.Dict):
        venv = VecNormalize(venv, norm_obs_keys=["speed"])
    kwargs = {"net_arch": [8], **(more or {})}
    model = algorithm(policy, venv, policy_kwargs=kwargs, **options, **COMMON).learn(32)
    rng = np.random.default_rng(4)
    with torch.no_grad():
        for weight in model.policy.parameters():
            weight.add_(torch.tensor(rng.normal(0.0, 0.4, weight.shape), dtype=torch.float32))
    repacked(model, f"{name}.zip")
    if isinstance(seen, spaces.Dict):
        venv.save(HERE / f"{name}_vecnormalize.pkl")
        venv.training = False
    seen.seed(9)
    rows, acts, state = [], [], None
    for step in range(STEPS):
        row = seen.sample()
        row = row if isinstance(row, dict) else {"seen": row}
        rows.append({n: np.atleast_1d(x).tolist() for n, x in row.items()})
        given: Any = row
        if isinstance(seen, spaces.Dict):
            batch = {n: np.asarray(x)[None] for n, x in row.items()}
            given = {n: x[0] for n, x in venv.normalize_obs(batch).items()}
        start = np.array([step % 8 == 0])
        given = given if isinstance(seen, spaces.Dict) else given["seen"]
        act, state = model.predict(given, state, start, deterministic=True)
        acts.append(np.asarray(act).reshape(-1).tolist())
    return {"observations": rows, "actions": acts, "whole": not isinstance(acted, spaces.Box)}


def kinds() -> None:
    on, small = {"n_steps": 16, "batch_size": 16}, {"lstm_hidden_size": 6, "n_lstm_layers": 2}
    told = {
        "qrdqn": kind(
            "qrdqn",
            contrib.QRDQN,
            "MlpPolicy",
            SEEN,
            spaces.Discrete(3),
            {"n_quantiles": 7},
            **SHORT,
        ),
        "tqc_sde": kind("tqc_sde", contrib.TQC, "MlpPolicy", SEEN, PUSH, use_sde=True, **SHORT),
        "maskable": kind("maskable", contrib.MaskablePPO, "MlpPolicy", SEVERAL, SEVERAL, **on),
        "bits": kind("bits", PPO, "MlpPolicy", spaces.MultiBinary(3), spaces.MultiBinary(4), **on),
        "ppo_sde": kind(
            "ppo_sde",
            PPO,
            "MlpPolicy",
            SEEN,
            PUSH,
            {"squash_output": True, "activation_fn": nn.GELU},
            use_sde=True,
            **on,
        ),
        "crossq": kind("crossq", contrib.CrossQ, "MlpPolicy", SEEN, PUSH, **SHORT),
        "recurrent": kind(
            "recurrent", contrib.RecurrentPPO, "MultiInputLstmPolicy", NAMED, PUSH, small, **on
        ),
    }
    (HERE / "kinds.json").write_text(json.dumps(told) + "\n", encoding="utf-8")


if __name__ == "__main__":
    kinds() if "--kinds" in sys.argv else main()
