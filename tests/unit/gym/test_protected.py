"""`soter.gym`: the compiled module between an agent and its environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from gym_cart import CART, WALL, Cart, Replay  # type: ignore[import-not-found]
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from hypothesis import example, given
from hypothesis import strategies as st

import soter
from soter.gym import Protected
from soter.gym.mapping import action_space
from soter.program.model.system import Bound

if TYPE_CHECKING:
    from pathlib import Path

FULL = np.array([3.0], dtype=np.float32)


def rammed(env: Any, steps: int = 3000) -> tuple[Any, dict[str, Any], bool]:
    """An agent that only knows full throttle: last observation, last info, whether it ended."""
    observation, info = env.reset(seed=5)
    for _ in range(steps):
        observation, _, ended, cut, info = env.step(FULL)
        if ended or cut:
            return observation, info, ended
    return observation, info, False


@pytest.mark.filterwarnings("ignore:.*we recommend using a symmetric")  # +-3 m/s^2 is what it is
def test_it_is_an_environment_as_gymnasium_wants_it() -> None:
    env = Protected(CART, Cart())
    check_env(env, skip_render_check=True)
    assert env.action_space == spaces.Box(-3.0, 3.0, (1,), np.float32)
    assert env.observation_space == env.env.observation_space


def test_an_agent_that_rams_the_wall_never_gets_there() -> None:
    assert rammed(Cart())[2], "without the module it does"
    observation, info, ended = rammed(Protected(CART, Cart()))
    assert not ended
    assert observation[0] < WALL
    assert info["violations"] == 0


def test_with_the_module_forced_to_the_agent_the_wall_is_hit_and_counted() -> None:
    _, info, ended = rammed(Protected(CART, Cart(), system="Unprotected"))
    assert ended
    assert (info["violations"], info["mode"], info["ttf"]) == (1, "AC", True)


def test_the_agent_is_asked_every_10_ms_and_the_cart_moves_every_5() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    *_, info = env.step(FULL)
    reward = env.step(FULL)[1]
    assert (reward, env.env.unwrapped.done, info["own"]) == (2.0, 4, 2)  # type: ignore[attr-defined]


def test_a_run_of_the_program_is_the_same_run_with_agent_and_plant_outside() -> None:
    program = soter.load(CART)
    run = program.simulate(until="20s", seed=3)
    truth = run.truth("c")
    outside = Replay(np.stack([truth["x"], truth["v"]], axis=1))
    env = Protected(CART, outside)
    env.reset(seed=0)
    session = env.session
    first = [float(v) for v in outside.states[0]]
    session.reset(3, first)  # the run's own seed: measurement errors are drawn from it
    trace = run.require_trace()
    instant = 0
    while instant < len(trace) - 1:
        asked = session.asked()
        if asked is session.plant:
            instant += 1
            session.move([float(v) for v in outside.states[instant]])
            continue
        assert session.record["header"]["ct"] == trace["header"]["ct"][instant]
        assert session.record["topics"]["motion"] == trace["topics"]["motion"][instant]
        for fact in ("mode", "ttf", "safer", "stale"):
            assert session.facts[fact] == trace["modules"][fact][instant, 0]
        motion = trace["topics"]["motion"][instant]
        goal = trace["topics"]["goal"][instant]
        wish = 4.0 * (float(goal) - float(motion["x"])) - 1.0 * float(motion["v"])
        session.act([min(max(wish, -3.0), 3.0)])
        session.asked()
        assert session.record["topics"]["accel"] == trace["topics"]["accel"][instant]
    assert session.record["modules"]["to_sc"][0] > 0, "a run in which something happens"


def test_equal_seeds_give_equal_episodes_and_others_do_not() -> None:
    env = Protected(CART, Cart())
    runs = []
    for seed in (7, 7, 8):
        env.reset(seed=seed)
        runs.append([tuple(env.step(FULL)[0]) for _ in range(900)])
    assert runs[0] == runs[1] != runs[2]


@pytest.mark.parametrize("action", [np.array([np.nan]), np.array([3.5]), np.array([-np.inf])])
def test_what_the_gate_refuses_never_reaches_the_environment(action: Any) -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    *_, before = env.step(np.array([0.5]))
    assert (before["mode"], before["gate_fault"], before["taken_by"]) == ("AC", False, "AC")
    *_, info = env.step(action)
    assert info["gate_fault"]
    assert info["action_taken"] == np.float32(0.5)
    for _ in range(6):
        *_, info = env.step(np.array([0.5]))
    assert (info["mode"], info["gate_fault"], info["violations"]) == ("SC", False, 0)


def test_publishing_nothing_keeps_the_last_value() -> None:
    env = Protected(CART, Cart(), act=lambda a: None if a is None else {"accel": float(a)})
    env.reset(seed=1)
    env.step(0.25)
    *_, info = env.step(None)
    assert (info["action_taken"], info["gate_fault"]) == (0.25, False)


def test_an_answer_of_the_wrong_shape_is_a_gate_fault() -> None:
    env = Protected(CART, Cart(), act=lambda a: {"accel": a})
    env.reset(seed=1)
    assert env.step("full")[-1]["gate_fault"]


def test_mappings_may_be_given() -> None:
    env = Protected(
        CART,
        Cart(),
        observe=lambda o: {"x": o[0]},  # v stays as the program has it: 0
        command=lambda accel: np.array([accel / 2.0]),
    )
    env.reset(seed=1)
    for _ in range(5):
        *_, info = env.step(np.array([1.0]))
    assert info["action_taken"] == 0.5
    assert env.session.states()[1] == 0.0


def test_switched_and_mode_tell_when_the_module_took_over() -> None:
    env = Protected(CART, Cart())
    _, info = env.reset(seed=1)
    assert (info["mode"], info["switched"]) == ("AC", True)
    modes, changes = ["AC"], 0
    for _ in range(1500):
        before = info["mode"]
        *_, info = env.step(FULL)
        assert info["taken_by"] == before
        assert info["switched"] == (info["mode"] != before)
        modes.append(info["mode"])
        changes += info["switched"]
    assert changes > 2
    assert {"AC", "SC"} == set(modes)


# ---------------------------------------------------------------- choices that are wrong


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"module": "Nobody"}, "has no module `Nobody`"),
        ({"plant": "d"}, "has no plant `d`"),
        ({"system": "Nowhere"}, "Nowhere"),
    ],
)
def test_wrong_names_are_said(options: dict[str, Any], words: str) -> None:
    with pytest.raises(soter.SoterError) as caught:
        Protected(CART, Cart(), **options)
    assert words in caught.value.diagnostics[0].message


def test_an_observation_of_another_size_is_said() -> None:
    env = Protected(CART, Replay(np.zeros((3, 4))))
    with pytest.raises(soter.SoterError, match="4 numbers"):
        env.reset(seed=1)


def test_a_step_before_reset_is_said() -> None:
    with pytest.raises(soter.SoterError, match="over"):
        Protected(CART, Cart()).step(FULL)


GEARS = """soter 1;
type Gear = enum { LOW, MIDDLE, HIGH };
topic speed: float max_age 20ms;
topic gear: Gear;
topic turbo: int in [-2, 3] = 0;
plant Engine period 10ms { reads gear; drives speed = s; state s: float; next s = s + 1.0; }
node Ac period 10ms { subscribes speed; publishes gear; step { publish gear = Gear.HIGH; } }
node Sc period 10ms { subscribes speed; publishes gear; step { publish gear = Gear.LOW; } }
rta Box { ac Ac; sc Sc; period 10ms; safe speed < 9.0; ttf speed > 3.0; safer speed < 2.0; }
system S default { e: Engine; module Box; until 1s; always e.truth.s < 9.0; }
"""
LINKED = GEARS.replace(
    "system S", 'extern node Log period 10ms from "c:log.c:note" { publishes noted; }\nsystem S'
).replace("module Box; until", "module Box; node Log; until")
LINKED = LINKED.replace("topic turbo: int in [-2, 3] = 0;", "topic noted: int in [0, 1000] = 0;")
LOG_C = """#include "gears.h"
int note(const gears_Log_in *in, gears_Log_out *out);
int note(const gears_Log_in *in, gears_Log_out *out) {
  static int calls = 0; /* a memory that no copy of the state has */
  (void)in;
  out->noted = ++calls;
  out->has_noted = 1;
  return 0;
}
"""


class Engine(Cart):  # type: ignore[misc]
    """One number up every step; the action is the gear."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_space = spaces.Box(-100.0, 100.0, (1,), np.float64)
        self.action_space = spaces.Discrete(3)
        self.speed = 0.0
        self.gears: list[Any] = []

    def reset(self, **_: Any) -> tuple[Any, dict[str, Any]]:
        self.speed = 0.0
        return np.array([0.0]), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.gears.append(action)
        self.speed += 1.0
        return np.array([self.speed]), 0.0, False, False, {}


def test_an_enum_is_a_discrete_action(tmp_path: Path) -> None:
    path = tmp_path / "gears.soter"
    path.write_text(GEARS)
    inner = Engine()
    env = Protected(path, inner)
    assert env.action_space == spaces.Discrete(3)
    env.reset(seed=1)
    for gear in (1, 2, 2, 1, 1):
        env.step(gear)
    assert inner.gears == [1, 2, 2, 1, 0], "SC shifts down when the speed is above 3"
    assert env.step(7)[-1]["gate_fault"]


def test_violations_include_the_state_that_was_just_reached(tmp_path: Path) -> None:
    path = tmp_path / "gears.soter"
    path.write_text(GEARS)
    env = Protected(path, Engine())
    env.reset(seed=1)
    counted = [env.step(2)[-1]["violations"] for _ in range(10)]
    assert counted == [0] * 8 + [1, 1], "the ninth state is the first at 9.0"


def test_linked_c_with_a_memory_steps_once_a_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gears.soter").write_text(LINKED)
    (tmp_path / "log.c").write_text(LOG_C)
    monkeypatch.chdir(tmp_path)
    env = Protected("gears.soter", Engine())
    env.reset(seed=1)
    for _ in range(5):
        env.step(1)
    noted = env.session.system.topic("noted").index
    assert env.session.topic(noted) == 5


# ---------------------------------------------------------------- spaces


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e6))
@example(-262144.4296875, 0.015625)
@example(0.1, 0.0)
def test_no_action_of_the_space_is_outside_the_set(low: float, width: float) -> None:
    topic = soter.load(CART).flat().topic("accel")
    high = low + width
    topic.bounds = (Bound(low, high),)
    least = np.float32(low)
    least = least if float(least) >= low else np.nextafter(least, np.float32(np.inf))
    if float(least) > high:
        with pytest.raises(soter.SoterError, match="no float32 lies in a set"):
            action_space([topic])
        return
    box = action_space([topic])
    assert isinstance(box, spaces.Box)
    assert low <= float(box.low[0]) <= float(box.high[0]) <= high
