"""Makes a policy of each kind with its library, and what that answers; run by another Python.

    python bench/policies/make_kinds.py FOLDER [--observations 10000] [--only NAME]

Purpose: needs stable-baselines3, sb3-contrib, skl2onnx and torch.onnx, and no Soter: it writes a
file a kind, and beside it observations, episode starts and answers (`predict(deterministic=True)`),
with the largest value of a layer for each. Every policy learns for a moment, so that its weights
are any; none is good.
Non-goals: comparing (`policy_kinds.py`).
"""

# mypy: ignore-errors
# ruff: noqa: ANN401, ARG002, D102, PLC0415 - libraries without types
from __future__ import annotations

import argparse
import contextlib
import json
import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import sb3_contrib as contrib
import stable_baselines3 as sb3
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize
from stable_baselines3.common.vec_env.stacked_observations import StackedObservations
from torch import nn

warnings.simplefilter("ignore")
F32 = np.float32
SEEN = spaces.Box(-3.0, 3.0, (4,), F32)
PUSH = spaces.Box(np.array([-1.0, 0.0], F32), np.array([1.0, 5.0], F32))
FOUR = spaces.Discrete(4)
SEVERAL = spaces.MultiDiscrete([3, 5, 2])
BITS = spaces.MultiBinary(3)
NAMED = spaces.Dict(
    {"speed": spaces.Box(-5.0, 5.0, (3,), F32), "gear": spaces.Discrete(3), "arm": SEEN}
)
GOALS = spaces.Dict(
    {n: spaces.Box(-2.0, 2.0, (2,), F32) for n in ("observation", "achieved_goal", "desired_goal")}
)
ONLY = {"device": "cpu", "seed": 3}


class World(gym.Env):
    """Any observation, any reward, of given spaces."""

    def __init__(self, seen: spaces.Space, acted: spaces.Space) -> None:
        self.observation_space, self.action_space = seen, acted
        self.step_number = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict]:
        super().reset(seed=seed)
        if seed is not None:
            self.observation_space.seed(seed)
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict]:
        self.step_number += 1
        reward = float(np.sin(np.sum(np.asarray(action, float)) + self.step_number))
        return self.observation_space.sample(), reward, self.step_number % 17 == 0, False, {}

    def compute_reward(self, achieved: Any, desired: Any, _info: Any) -> Any:
        return -np.linalg.norm(np.asarray(achieved) - np.asarray(desired), axis=-1)

    def action_masks(self) -> Any:
        space = self.action_space
        sizes = {"Discrete": lambda: space.n, "MultiDiscrete": lambda: sum(space.nvec)}
        return np.ones(sizes.get(type(space).__name__, lambda: 2 * space.n)(), bool)


@dataclass
class Kind:
    """A policy: how it is made, and what is around it."""

    algorithm: Any
    seen: spaces.Space = field(default_factory=lambda: SEEN)
    acted: spaces.Space = field(default_factory=lambda: PUSH)
    kwargs: dict[str, Any] = field(default_factory=dict)
    policy: str = ""
    normalised: bool | dict[str, Any] = False
    frames: int = 1
    order: str | None = None
    steps: int = 64
    model: dict[str, Any] = field(default_factory=dict)


ON = {"n_steps": 32}
OFF = {"learning_starts": 10, "buffer_size": 500, "batch_size": 16}
HER = {"replay_buffer_class": sb3.HerReplayBuffer, "learning_starts": 40}


class Squared(sb3.common.torch_layers.BaseFeaturesExtractor):
    """Somebody's own preparation of observations."""

    def __init__(self, space: spaces.Box) -> None:
        super().__init__(space, space.shape[0])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x * x


def arch(sizes: Any, activation: Any = None, **more: Any) -> dict[str, Any]:
    return {"net_arch": sizes, **({"activation_fn": activation} if activation else {}), **more}


BOX23 = spaces.Box(-1.0, 1.0, (2, 3), F32)
WIDE = spaces.Box(-1e3, 1e3, (3,), F32)
IMAGE = spaces.Box(0, 255, (3, 36, 36), np.uint8)
KINDS: dict[str, Kind] = {
    "PPO tanh": Kind(sb3.PPO),
    "PPO relu, separate": Kind(sb3.PPO, kwargs=arch({"pi": [32, 16], "vf": [8]}, nn.ReLU)),
    "PPO elu": Kind(sb3.PPO, kwargs=arch([32, 32], nn.ELU)),
    "PPO leaky relu": Kind(sb3.PPO, kwargs=arch([32, 32], nn.LeakyReLU)),
    "PPO silu": Kind(sb3.PPO, kwargs=arch([32], nn.SiLU)),
    "PPO gelu": Kind(sb3.PPO, kwargs=arch([32], nn.GELU)),
    "PPO softplus": Kind(sb3.PPO, kwargs=arch([32], nn.Softplus)),
    "PPO prelu": Kind(sb3.PPO, kwargs=arch([32], nn.PReLU)),
    "PPO linear": Kind(sb3.PPO, kwargs=arch([])),
    "PPO 256 x 3": Kind(sb3.PPO, kwargs=arch([256, 256, 256])),
    "PPO observations to 1000": Kind(sb3.PPO, WIDE, kwargs=arch([64, 64], nn.ReLU)),
    "PPO Discrete": Kind(sb3.PPO, acted=FOUR),
    "PPO MultiDiscrete": Kind(sb3.PPO, acted=SEVERAL),
    "PPO MultiBinary": Kind(sb3.PPO, acted=BITS),
    "PPO of a Discrete": Kind(sb3.PPO, spaces.Discrete(6)),
    "PPO of a MultiDiscrete": Kind(sb3.PPO, SEVERAL),
    "PPO of a MultiBinary": Kind(sb3.PPO, BITS, FOUR),
    "PPO of two axes": Kind(sb3.PPO, BOX23),
    "PPO of a Dict": Kind(sb3.PPO, NAMED, policy="MultiInputPolicy"),
    "PPO of a Dict, VecNormalize": Kind(
        sb3.PPO, NAMED, policy="MultiInputPolicy", normalised={"norm_obs_keys": ["arm", "speed"]}
    ),
    "PPO VecNormalize": Kind(sb3.PPO, normalised=True),
    "PPO frames, VecNormalize": Kind(sb3.PPO, frames=3, normalised=True),
    "PPO frames": Kind(sb3.PPO, frames=4),
    "PPO frames of two axes": Kind(sb3.PPO, BOX23, frames=2),
    "PPO frames of two axes, first": Kind(sb3.PPO, BOX23, frames=2, order="first"),
    "PPO frames of two axes, VecNormalize": Kind(sb3.PPO, BOX23, frames=3, normalised=True),
    "PPO frames of three axes": Kind(sb3.PPO, spaces.Box(-1.0, 1.0, (2, 3, 2), F32), frames=2),
    "PPO gSDE": Kind(sb3.PPO, model={"use_sde": True}),
    "PPO gSDE, squashed": Kind(sb3.PPO, model={"use_sde": True}, kwargs={"squash_output": True}),
    "PPO actions in float64": Kind(sb3.PPO, acted=spaces.Box(-0.1, 0.7, (2,), np.float64)),
    "PPO CNN": Kind(sb3.PPO, IMAGE, FOUR, policy="CnnPolicy", steps=32),
    "PPO own features": Kind(sb3.PPO, kwargs={"features_extractor_class": Squared}),
    "A2C": Kind(sb3.A2C),
    "A2C Discrete, VecNormalize": Kind(sb3.A2C, acted=FOUR, normalised=True),
    "A2C gSDE": Kind(sb3.A2C, model={"use_sde": True}),
    "SAC": Kind(sb3.SAC),
    "SAC gSDE": Kind(sb3.SAC, model={"use_sde": True}),
    "SAC of a Dict": Kind(sb3.SAC, NAMED, policy="MultiInputPolicy"),
    "SAC with HER": Kind(sb3.SAC, GOALS, policy="MultiInputPolicy", model=HER),
    "TD3": Kind(sb3.TD3),
    "TD3 elu": Kind(sb3.TD3, kwargs=arch([32, 32], nn.ELU)),
    "DDPG": Kind(sb3.DDPG),
    "DQN": Kind(sb3.DQN, acted=FOUR),
    "DQN of a Dict": Kind(sb3.DQN, NAMED, FOUR, policy="MultiInputPolicy"),
    "QRDQN": Kind(contrib.QRDQN, acted=FOUR),
    "QRDQN of 25 quantiles": Kind(contrib.QRDQN, acted=FOUR, kwargs={"n_quantiles": 25}),
    "TQC": Kind(contrib.TQC),
    "TQC gSDE": Kind(contrib.TQC, model={"use_sde": True}),
    "TQC of a Dict": Kind(contrib.TQC, NAMED, policy="MultiInputPolicy"),
    "CrossQ": Kind(contrib.CrossQ),
    "TRPO": Kind(contrib.TRPO),
    "ARS": Kind(contrib.ARS),
    "ARS linear": Kind(contrib.ARS, policy="LinearPolicy"),
    "ARS Discrete": Kind(contrib.ARS, acted=FOUR),
    "MaskablePPO Discrete": Kind(contrib.MaskablePPO, acted=FOUR),
    "MaskablePPO MultiDiscrete": Kind(contrib.MaskablePPO, acted=SEVERAL),
    "MaskablePPO MultiBinary": Kind(contrib.MaskablePPO, acted=BITS),
    "RecurrentPPO": Kind(contrib.RecurrentPPO, policy="MlpLstmPolicy"),
    "RecurrentPPO 2 layers, Discrete": Kind(
        contrib.RecurrentPPO,
        acted=FOUR,
        policy="MlpLstmPolicy",
        kwargs={"n_lstm_layers": 2, "lstm_hidden_size": 32},
    ),
    "RecurrentPPO shared": Kind(
        contrib.RecurrentPPO,
        policy="MlpLstmPolicy",
        kwargs={"shared_lstm": True, "enable_critic_lstm": False},
    ),
    "RecurrentPPO of a Dict, VecNormalize": Kind(
        contrib.RecurrentPPO,
        NAMED,
        policy="MultiInputLstmPolicy",
        normalised={"norm_obs_keys": ["speed"]},
    ),
}


def made(kind: Kind) -> tuple[Any, Any]:
    """The model after a moment of learning, and its VecNormalize or None."""
    env: Any = DummyVecEnv([lambda: World(kind.seen, kind.acted)])
    env.seed(3)
    normal = None
    if kind.normalised:
        more = kind.normalised if isinstance(kind.normalised, dict) else {}
        env = normal = VecNormalize(env, **more)
    if kind.frames > 1:
        env = VecFrameStack(env, kind.frames, channels_order=kind.order)
    off = issubclass(kind.algorithm, (sb3.SAC, sb3.TD3, sb3.DQN, contrib.QRDQN, contrib.TQC))
    settings: dict[str, Any] = OFF if off or kind.algorithm is contrib.CrossQ else ON
    if kind.algorithm in {sb3.PPO, contrib.MaskablePPO, contrib.RecurrentPPO, contrib.TRPO}:
        settings = {**ON, "batch_size": 32}
    if kind.algorithm is contrib.ARS:
        settings = {"n_delta": 2}
    policy = kind.policy or "MlpPolicy"
    options = {**settings, **kind.model, **ONLY}
    model = kind.algorithm(policy, env, policy_kwargs=dict(kind.kwargs), **options)
    model.learn(kind.steps)
    shake(model.policy)
    if normal is not None:
        normal.training = False
    return model, normal


def shake(module: nn.Module) -> None:
    """Weights as after long training: the last layers of new policies are almost zero.

    What is added has the variance 1 / inputs, so that numbers keep their size through layers.
    """
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for weight in module.parameters():
            size = 1.0 / np.sqrt(weight.shape[-1]) if weight.ndim > 1 else 0.2
            weight.add_(size * torch.randn(weight.shape, generator=generator))


# ---------------------------------------------------------------- observations and answers


def drawn(space: spaces.Space, count: int, rng: Any) -> Any:
    """So many observations (count, ...) of a space, by name for a Dict."""
    if isinstance(space, spaces.Dict):
        return {name: drawn(part, count, rng) for name, part in space.spaces.items()}
    if isinstance(space, spaces.Box):
        return rng.uniform(space.low, space.high, (count, *space.shape)).astype(space.dtype)
    if isinstance(space, spaces.MultiBinary):
        return rng.integers(0, 2, (count, space.n)).astype(np.int8)
    sizes = [space.n] if isinstance(space, spaces.Discrete) else space.nvec
    whole = np.stack([rng.integers(0, n, count) for n in sizes], axis=1)
    return whole[:, 0] if isinstance(space, spaces.Discrete) else whole


class Largest:
    """The largest value of a layer for each observation of the last call."""

    def __init__(self, policy: nn.Module) -> None:
        self.values: list[Any] = []
        for module in policy.modules():
            if not list(module.children()):
                module.register_forward_hook(self._seen)

    def _seen(self, _module: nn.Module, _given: Any, answered: Any) -> None:
        for out in answered if isinstance(answered, tuple) else (answered,):
            if isinstance(out, torch.Tensor):
                self.values.append(out.detach().abs().reshape(-1, out.shape[-1]).amax(1).numpy())

    def taken(self, count: int) -> Any:
        fitting = [v for v in self.values if len(v) == count]
        self.values = []
        return np.max(fitting, axis=0) if fitting else np.ones(count)


def stacked(seen: Any, kind: Kind, starts: Any) -> Any:
    """Frames (count, ...) as the library's own `VecFrameStack` stacks them."""
    stack, none, rows = (
        StackedObservations(1, kind.frames, kind.seen, kind.order),
        np.zeros(1, bool),
        [],
    )
    for one, start in zip(seen[:, None].astype(F32), starts, strict=True):
        whole = stack.reset(one) if start else stack.update(one, none, [{}])[0]
        rows.append(whole[0].copy())
    return np.array(rows)


def answered(model: Any, kind: Kind, normal: Any, seen: Any, starts: Any) -> tuple[Any, Any]:
    """What `predict` answers (count, n), and the largest value of a layer (count,)."""
    given = normal.normalize_obs(seen) if normal is not None else seen
    if kind.frames > 1:
        given = stacked(given, kind, starts)
    largest, count = Largest(model.policy), len(starts)
    if not isinstance(model, contrib.RecurrentPPO):
        acted, _ = model.predict(given, deterministic=True)
        acted = np.asarray(acted, np.float64).reshape(count, -1)
        return acted, np.maximum(largest.taken(count), np.abs(acted).max(1))
    state, rows, scales = None, [], []
    for k in range(count):
        one = {n: v[k] for n, v in given.items()} if isinstance(given, dict) else given[k]
        start = np.array([bool(starts[k])])
        acted, state = model.predict(one, state=state, episode_start=start, deterministic=True)
        rows.append(np.asarray(acted, np.float64).reshape(-1))
        scales.append(max(largest.taken(1)[0], np.abs(rows[-1]).max()))
    return np.array(rows), np.array(scales)


def columns(space: spaces.Space, seen: Any) -> dict[str, Any]:
    """Observations as numbers by topic: (count, n) each, a Box in its own shape."""
    if isinstance(space, spaces.Dict):
        return {n: v.reshape(len(v), -1) for n, v in seen.items()}
    return {"seen": seen if isinstance(space, spaces.Box) else seen.reshape(len(seen), -1)}


def starts_of(count: int, rng: Any) -> Any:
    """Where episodes begin: after 1 to 200 steps."""
    starts = np.zeros(count, bool)
    starts[np.concatenate([[0], np.cumsum(rng.integers(1, 200, count))]) % count] = False
    at = 0
    while at < count:
        starts[at] = True
        at += int(rng.integers(1, 200))
    return starts


def slug(name: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in name.lower())


def write(folder: Path, name: str, count: int) -> dict[str, Any]:
    kind, rng = KINDS[name], np.random.default_rng(7)
    own = folder / slug(name)
    own.mkdir(parents=True, exist_ok=True)
    model, normal = made(kind)
    model.save(own / "policy.zip")
    if normal is not None:
        normal.save(own / "vecnormalize.pkl")
    few = min(count, 50) if kind.policy == "CnnPolicy" else count
    seen, starts = drawn(kind.seen, few, rng), starts_of(few, rng)
    acted, scale = answered(model, kind, normal, seen, starts)
    np.savez(own / "answers.npz", starts=starts, acted=acted, scale=scale)
    np.savez(own / "seen.npz", **columns(kind.seen, seen))
    whole = not isinstance(kind.acted, spaces.Box)
    return {"name": name, "from": f"sb3:{slug(name)}/policy.zip", "whole": whole}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--observations", type=int, default=10_000)
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    torch.set_num_threads(1)
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    from make_onnx_kinds import ONNX_KINDS, write_onnx  # beside this file

    told = []
    for name in [*KINDS, *ONNX_KINDS]:
        if args.only not in name:
            continue
        with contextlib.redirect_stdout(sys.stderr):
            make = write if name in KINDS else write_onnx
            told.append(make(args.folder, name, args.observations))
    versions = {m.__name__: m.__version__ for m in (sb3, contrib, torch)}
    (args.folder / "kinds.json").write_text(json.dumps({"versions": versions, "kinds": told}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
