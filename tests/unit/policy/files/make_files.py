"""Makes the files of Stable-Baselines3 beside it, and what its `predict` says of observations.

`pip install stable-baselines3`, then `python tests/unit/policy/files/make_files.py`. Nothing is
trained to be good: each policy learns for a moment, so that its weights are any. Each file is
what `model.save` wrote, deflated, without the state of its optimizers and what machine it was.
"""

from __future__ import annotations

import json
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
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
            for part in old.namelist():
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


if __name__ == "__main__":
    main()
