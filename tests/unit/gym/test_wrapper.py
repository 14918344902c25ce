"""`soter.gym.SafetyWrapper`: a wrapper as any other of Gymnasium's."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gym_cart import CART, WALL, Cart  # type: ignore[import-not-found]
from gymnasium import spaces

import soter
from soter.gym import Protected, SafetyWarning, SafetyWrapper

CLIFF = Path(__file__).resolve().parents[3] / "examples" / "mountain_car" / "cliff.soter"
FULL = np.array([3.0])
LOW = np.float64(-1.0)


def driven(env: Any, steps: int = 400) -> list[Any]:
    """What full throttle sees and is told, from where the environment stands."""
    transitions = []
    for _ in range(steps):
        observation, reward, ended, cut, info = env.step(FULL)
        transitions.append((observation.tolist(), reward, ended, cut, str(info)))
    return transitions


def test_it_does_what_the_environment_does() -> None:
    wrapper, env = SafetyWrapper(Cart(), CART), Protected(CART, Cart())
    assert str(wrapper.reset(seed=5)) == str(env.reset(seed=5))
    assert driven(wrapper) == driven(env)
    assert wrapper.get_wrapper_attr("state")[0] < WALL


def test_wrappers_outside_and_inside_find_what_they_look_for() -> None:
    inner = gymnasium.wrappers.TimeLimit(Cart(), 7)
    env = gymnasium.wrappers.RecordEpisodeStatistics(SafetyWrapper(inner, CART))
    assert isinstance(env.unwrapped, Cart)
    assert env.get_wrapper_attr("steps") == 4000
    assert env.get_wrapper_attr("guard").session.module.name == "SafeCart"
    assert env.action_space == spaces.Box(-3.0, 3.0, (1,), np.float32)
    env.reset(seed=1)
    ends = [env.step(FULL)[3] for _ in range(4)]
    assert ends == [False, False, False, True], "the plant moves twice for each step of the agent"


def test_its_spec_makes_it_again() -> None:
    made = SafetyWrapper(gymnasium.make("MountainCarContinuous-v0"), str(CLIFF), alarm=False)
    assert made.spec is not None
    again = gymnasium.make(made.spec)
    assert isinstance(again, SafetyWrapper)
    assert again.guard.plant_model is None
    assert str(made.reset(seed=3)) == str(again.reset(seed=3))


def copied(env: Any) -> Any:
    return copy.deepcopy(env)


def pickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))  # noqa: S301 - our own


@pytest.mark.parametrize("how", [copied, pickled])
@pytest.mark.parametrize(
    "kind", [lambda: SafetyWrapper(Cart(), CART), lambda: Protected(CART, Cart())]
)
def test_a_copy_goes_on_as_the_original_and_apart_from_it(how: Any, kind: Any) -> None:
    env = kind()
    env.reset(seed=5)
    driven(env, 600)
    first, second = how(env), how(env)
    driven(second, 3)
    rest = driven(env)
    assert rest == driven(first)
    assert {"'AC'", "'SC'"} <= {part.strip(",") for row in rest for part in row[4].split()}
    assert str(env.reset()) == str(first.reset()), "episodes to come are the same, too"


def test_a_copy_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cart.soter"
    path.write_text(CART.read_text())
    data = pickle.dumps(Protected(path, Cart()))
    path.write_text(CART.read_text().replace("0.12", "0.13"))
    with pytest.raises(soter.SoterError, match="another program"):
        pickle.loads(data)  # noqa: S301 - our own


@pytest.mark.filterwarnings("ignore:.*precision lowered")  # of the space, by RescaleAction
@pytest.mark.filterwarnings("ignore:the program commands")  # more than what is rescaled
@pytest.mark.parametrize(
    ("wrapper", "changed"),
    [
        (gymnasium.wrappers.NormalizeObservation, "observations"),
        (lambda e: gymnasium.wrappers.RescaleAction(e, LOW, -LOW), "actions"),
    ],
)
def test_wrappers_inside_that_change_numbers_are_told(wrapper: Any, changed: str) -> None:
    with pytest.warns(SafetyWarning, match=f"changes the {changed}") as told:
        SafetyWrapper(wrapper(Cart()), CART)
    assert told[0].filename == __file__, "at the line that made it"
    SafetyWrapper(wrapper(Cart()), CART, observe=lambda o: {"x": o[0], "v": o[1]})
    wrapper(SafetyWrapper(Cart(), CART))


def test_an_unknown_option_is_said() -> None:
    with pytest.raises(TypeError, match="observ"):
        SafetyWrapper(Cart(), CART, observ=None)
