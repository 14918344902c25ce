"""Files that Stable-Baselines3 wrote answer what its `predict` answered when they were written."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium import spaces
from policy_files import FILES, change_pickle, changed  # type: ignore[import-not-found]

from soter.language.load.named_files import binding_of
from soter.language.model.types import FloatType, IntType
from soter.policy.policy_extern import load_policy
from soter.policy.sb3_file import read_sb3

PREDICTED = json.loads((FILES / "predicted.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", PREDICTED)
def test_answers_are_those_of_predict(name: str) -> None:
    binding = binding_of(f"sb3:{name}")
    assert binding is not None
    observations, actions = PREDICTED[name]["observations"], PREDICTED[name]["actions"]
    names = [f"x{i}" for i in range(len(observations[0]))]
    topic = IntType(0, 2) if name == "dqn.zip" else FloatType()
    reads = [(n, FloatType()) for n in names]
    policy = load_policy(binding.in_folder(FILES), reads, [("u", topic)], None)
    for _ in range(2):  # the frames are forgotten
        policy.reset(1)
        for observation, action in zip(observations, actions, strict=True):
            answered = policy.step(SimpleNamespace(**dict(zip(names, observation, strict=True))))
            assert answered == (pytest.approx(action[0], abs=1e-6),)
    assert len({a[0] for a in actions}) > 1


def test_what_the_file_does_not_say_is_named() -> None:
    assert read_sb3(FILES / "sac.zip").assumed == (
        "observations are not normalised: no file of a VecNormalize is named or beside it",
    )
    assert read_sb3(FILES / "ppo.zip", Path("none")).assumed == ()
    read = read_sb3(FILES / "ppo.zip", FILES / "ppo_vecnormalize.pkl")
    assert read.assumed == ()
    assert read.facts["normalised"] == "by `ppo_vecnormalize.pkl`, clipped to 10"


def test_observations_in_double_precision_are_rounded_as_torch_does(tmp_path: Path) -> None:
    """As MuJoCo's environments have them."""
    space = spaces.Box(-3.0, 2.0, (2,), np.float64)
    path = tmp_path / "p.zip"
    path.write_bytes(
        changed(
            "ppo.zip",
            lambda s: change_pickle(s, "observation_space", lambda _: pickle.dumps(space)),
        )
    )
    read = read_sb3(path)
    assert read.facts["observation"] == "Box of 2: [-3, 2], [-3, 2]"
    assert read.box is not None
    assert [ends.tolist() for ends in read.box] == [[-3.0, -3.0], [2.0, 2.0]]


def test_statistics_of_one_frame_normalise_each() -> None:
    read = read_sb3(FILES / "a2c_of_frames.zip", FILES / "a2c_vecnormalize.pkl")
    assert read.per_frame is not None
    assert (read.per_frame.mean.size, read.network.inputs) == (3, 9)
    assert read.facts["normalised"].endswith("each of 3 frames before they are stacked")
