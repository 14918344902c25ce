"""Many worlds for Stable-Baselines3: the steps are those of `make_vec`, ends as its `VecEnv` has.

The library itself (and torch below it) is not needed: its base class is a double with the same
constructor. That PPO and SAC learn over the real one was tried by hand (docs/gym.md).
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.gym import make_sb3_vec, make_vec

if TYPE_CHECKING:
    from collections.abc import Callable

CLIFF = Path(__file__).resolve().parents[3] / "examples" / "mountain_car" / "cliff.soter"
STEPS = 40


class VecEnv:
    """As stable_baselines3.common.vec_env.base_vec_env has it."""

    def __init__(self, num_envs: int, observation_space: Any, action_space: Any) -> None:
        self.num_envs, self.observation_space = num_envs, observation_space
        self.action_space = action_space
        self.reset_infos: list[Any] = []
        self._seeds: list[int | None] = [None] * num_envs
        assert self.get_attr("render_mode") == [None] * num_envs  # type: ignore[attr-defined]

    def seed(self, seed: int) -> None:
        self._seeds = [seed + k for k in range(self.num_envs)]

    def _reset_seeds(self) -> None:
        self._seeds = [None] * self.num_envs

    def _reset_options(self) -> None:
        pass

    def step(self, actions: Any) -> Any:
        self.step_async(actions)  # type: ignore[attr-defined]
        return self.step_wait()  # type: ignore[attr-defined]


@pytest.fixture(autouse=True)
def _library(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["stable_baselines3", "common", "vec_env", "base_vec_env"]
    for depth in range(1, len(names) + 1):
        module = ModuleType(".".join(names[:depth]))
        module.VecEnv = VecEnv  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)


def reward(seen: Any, action: Any, after: Any) -> Any:
    return after[:, 0] - seen[:, 0] + action[:, 0]


def made(**options: Any) -> Any:
    return make_sb3_vec(CLIFF, 3, reward=reward, max_steps=STEPS, **options)


def test_steps_are_those_of_make_vec() -> None:
    theirs, ours = made(), make_vec(CLIFF, 3, reward=reward, max_steps=STEPS, autoreset="SameStep")
    theirs.seed(5)
    seen, told = theirs.reset(), ours.reset(seed=5)[0]
    assert (seen == told.astype(np.float32)).all()
    assert theirs.action_space.dtype == theirs.observation_space.dtype == np.float32
    ends = 0
    for k in range(2 * STEPS + 5):
        actions = np.full((3, 1), np.sin(k), np.float32)
        seen, rewards, over, infos = theirs.step(actions)
        told, wanted, ended, cut, info = ours.step(actions)
        assert (seen == told.astype(np.float32)).all()
        assert (rewards == wanted.astype(np.float32)).all()
        assert (over == (ended | cut)).all()
        for world in np.flatnonzero(over):
            last = info["final_obs"][world].astype(np.float32)
            assert (infos[world]["terminal_observation"] == last).all()
            assert infos[world]["TimeLimit.truncated"]
            ends += 1
    assert ends == 6


def test_an_episode_that_ended_was_not_cut() -> None:
    worlds = made(terminate=lambda seen, _, after: after[:, 0] > seen[:, 0] - 1.0)
    worlds.reset()
    _, _, over, infos = worlds.step(np.zeros((3, 1), np.float32))
    assert over.all()
    assert not any(info["TimeLimit.truncated"] for info in infos)


def test_worlds_are_told_what_was_asked_for() -> None:
    worlds = made(info_keys=("taken_by", "cause", "cost"))
    worlds.reset()
    infos = worlds.step(np.full((3, 1), np.nan, np.float32))[3]
    assert [info["taken_by"] for info in infos] == ["AC"] * 3
    assert [info["cause"] for info in infos] == ["gate"] * 3
    assert [info["cost"] for info in infos] == [0.0] * 3
    with pytest.raises(SoterError, match="has no `speed`"):
        made(info_keys=("speed",))


def test_what_one_world_alone_cannot_do_is_refused() -> None:
    worlds = made()
    assert worlds.env_is_wrapped(object) == [False] * 3
    assert worlds.get_attr("num_envs", [0, 2]) == [3, 3]
    asks: tuple[Callable[[], object], ...] = (
        lambda: worlds.set_attr("x", 1),
        lambda: worlds.env_method("reset"),
        lambda: worlds.env_method("action_masks"),
        lambda: made(autoreset="Disabled"),
    )
    for ask in asks:
        with pytest.raises(SoterError) as caught:
            ask()
        assert caught.value.diagnostics[0].code == "U001"


def test_a_learner_of_sb3_contrib_is_given_the_masks_of_its_worlds() -> None:
    worlds: Any = make_sb3_vec(CLIFF, 3, actions=np.linspace(-1.0, 1.0, 7)[:, None])
    worlds.reset()
    assert worlds.action_space.n == 7
    assert np.stack(worlds.env_method("action_masks")).shape == (3, 7)
    assert len(worlds.env_method("action_masks", indices=[0, 2])) == 2
    assert len(worlds.step(np.array([0, 3, 6]))[0]) == 3
