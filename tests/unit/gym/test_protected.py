"""`soter.gym`: the compiled module between an agent and its environment."""

from __future__ import annotations

import copy
import re
import sys
import tempfile
import types
import warnings
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from gym_cart import CART, WALL, Cart, Replay  # type: ignore[import-not-found]
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from hypothesis import example, given, settings
from hypothesis import strategies as st

import soter
from generators import stateful_externs
from soter.campaign import compiled_unit
from soter.gym import Protected, SafetyWarning, SafetyWrapper, make_vec
from soter.gym import compiled_system as compiled_module
from soter.gym import vector as vector_module
from soter.gym.array_mapping import action_space
from soter.language.model.system import Bound, Topic
from soter.native.loaded_program import RunStatus
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from soter.gym.session import Session
    from soter.language.model.system import Component

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


def run_to_due_component(session: Session) -> Component:
    """Runs until the plant or the agent has to answer, and gives that component."""
    while True:
        status, _, due = session.compiled.library.run_until(session.state, 2**62)
        assert status is RunStatus.EXTERN
        if due in (session.plant.index, session.agent.index):
            return session.system.components[due]
        session._answers.answer_step(session.state, due)


def test_a_run_of_the_program_is_the_same_run_with_agent_and_plant_outside() -> None:
    program = soter.load(CART)
    run = program.simulate(until="20s", seed=3)
    truth = run.truth("c")
    outside = Replay(np.stack([truth["x"], truth["v"]], axis=1))
    env = Protected(CART, outside, measured=True)
    env.reset(seed=0)
    session = env.session
    first = [float(v) for v in outside.states[0]]
    session.reset(3, first)  # the run's own seed: measurement errors are drawn from it
    trace = run.require_trace()
    instant = 0
    while instant < len(trace) - 1:
        asked = run_to_due_component(session)
        if asked is session.plant:
            instant += 1
            session.move_to_values([float(v) for v in outside.states[instant]])
            continue
        assert session.record["header"]["ct"] == trace["header"]["ct"][instant]
        assert session.record["topics"]["motion"] == trace["topics"]["motion"][instant]
        for fact in ("mode", "ttf", "safer", "stale"):
            assert session.facts[fact] == trace["modules"][fact][instant, 0]
        motion = trace["topics"]["motion"][instant]
        goal = trace["topics"]["goal"][instant]
        wish = 4.0 * (float(goal) - float(motion["x"])) - 1.0 * float(motion["v"])
        session.act_with_values([min(max(wish, -3.0), 3.0)])
        run_to_due_component(session)
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


def test_no_action_is_a_gate_fault_of_one_number_and_an_error_of_several() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    assert env.step(None)[4]["gate_fault"]
    env = Protected(written(TWO), Two())
    env.reset(seed=1)
    with pytest.raises(soter.SoterError, match="an action has 1 numbers"):
        env.step(None)


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


@pytest.mark.parametrize(
    ("answer", "words", "helps"),
    [
        ({"acel": 1.0}, "a `dict` with `acel`", ("did you mean `accel`?",)),
        ({"accel": [1.0, 2.0]}, "accel: expected a number, found a sequence of 2", ()),
        ([], "accel: expected a number, found a sequence of 0", ()),
    ],
)
def test_names_and_counts_that_no_output_has_are_an_error(
    answer: Any, words: str, helps: tuple[str, ...]
) -> None:
    env = Protected(CART, Cart(), act=lambda _: answer)
    env.reset(seed=1)
    with pytest.raises(soter.SoterError) as caught:
        env.step(np.zeros(1))
    (told,) = caught.value.diagnostics
    assert (told.code, told.helps) == ("U001", helps)
    assert words in told.message


@pytest.mark.parametrize("answer", [[0.5], [0.5] * 3, 0.5, {"push": 0.5}, {"push": [[0.5], 0.5]}])
def test_a_vector_of_another_length_is_an_error(answer: Any) -> None:
    vector = HALVES.replace("float in [0.0, 2.0] = 0.0;", "float[2] in [0.0, 2.0] = [0.0, 0.0];")
    vector = vector.replace("gear = 0.5", "gear = [0.5, 0.5]").replace("gear", "push")
    program = written(vector.replace("push = 0.0", "push = [0.0, 0.0]"))
    env = Protected(program, Engine(), act=lambda _: answer, command=lambda push: int(push[0]))
    env.reset(seed=1)
    with pytest.raises(soter.SoterError, match="push") as caught:
        env.step(0)
    assert caught.value.diagnostics[0].code == "U001"


def test_a_misspelt_name_among_several_is_an_error_on_both_sides() -> None:
    env = Protected(written(TWO), Two(), act=lambda _: {"gear": "LOW", "turbbo": 0})
    env.reset(seed=1)
    with pytest.raises(soter.SoterError, match="there is no `turbbo`") as caught:
        env.step(0)
    assert caught.value.diagnostics[0].helps == ("did you mean `turbo`?",)
    env = Protected(CART, Cart(), observe=lambda o: {"x": o[0], "V": o[1]})
    with pytest.raises(soter.SoterError, match="there is no `V`") as caught:
        env.reset(seed=1)
    assert caught.value.diagnostics[0].helps == ("did you mean `v`?",)


@pytest.mark.filterwarnings("ignore:the environment did what plant")
def test_mappings_may_be_given() -> None:
    env = Protected(
        CART,
        Cart(),
        observe=lambda o: {"x": o[0]},  # v stays as the program has it: 0
        command=lambda accel: np.array([accel / 2.0]),
    )
    with pytest.warns(SafetyWarning, match="`observe` gives no `v`") as told_of:
        env.reset(seed=1)
    assert told_of[0].filename == __file__
    for _ in range(5):
        *_, info = env.step(np.array([1.0]))
    assert info["action_taken"] == 0.5
    assert env.session.plant_states()[1] == 0.0


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


def test_a_step_before_reset_is_said_and_one_after_the_end() -> None:
    env = Protected(CART, Cart(steps=1))
    with pytest.raises(soter.SoterError, match="no episode has begun"):
        env.step(FULL)
    env.reset(seed=1)
    env.step(FULL)
    with pytest.raises(soter.SoterError, match="the episode is over"):
        env.step(FULL)


@pytest.mark.parametrize("shape", [(1, 1), (1, 1, 1)])
def test_a_batch_of_one_action_is_none(shape: tuple[int, ...]) -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    assert env.action_space.shape == (1,)
    with pytest.raises(soter.SoterError) as caught:
        env.step(np.ones(shape))
    assert f"the shape {shape}, and those of the space (1,)" in caught.value.diagnostics[0].message
    assert "`actions[0]`" in caught.value.diagnostics[0].helps[0]
    assert env.step(np.ones(1))[4]["action_requested"].shape == (1,)
    env.step(1.0)  # a number stands for an array of one


def test_an_action_may_have_the_shape_of_a_space_that_was_given() -> None:
    square = spaces.Box(-3.0, 3.0, (1, 1), np.float32)
    env = Protected(CART, Cart(), action_space=square)
    env.reset(seed=1)
    env.step(np.ones((1, 1)))
    with pytest.raises(soter.SoterError, match="the shape"):
        env.step(np.ones((1, 1, 1)))


def test_a_batch_of_one_choice_is_none(tmp_path: Path) -> None:
    path = tmp_path / "gears.soter"
    path.write_text(GEARS)
    env = Protected(path, Engine())
    env.reset(seed=1)
    env.step(np.array([2]))
    with pytest.raises(soter.SoterError, match="the shape"):
        env.step(np.array([[2]]))


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
NO_GRID = GEARS.replace("ttf speed > 3.0; safer speed < 2.0;", "")
ALIVE = "always e.truth.s > 0.5"
LINKED = GEARS.replace(
    "system S", 'extern node Log period 10ms from "c:log.c:note" { publishes noted; }\nsystem S'
).replace("module Box; until", "module Box; node Log; until")
LINKED = LINKED.replace("topic turbo: int in [-2, 3] = 0;", "topic noted: int in [0, 1000] = 0;")
LOG_C = """#include "gears.h"
int note(const gears_Log_in *in, gears_Log_out *out);
int note(const gears_Log_in *in, gears_Log_out *out) {
  (void)in;
  out->noted = 1;
  out->has_noted = 1;
  return 0;
}
"""


class Engine(Cart):  # type: ignore[misc]
    """One number up every step; the action is the gear."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_space = spaces.Box(-100.0, 100.0, (1,), np.float64)
        self.action_space: Any = spaces.Discrete(3)
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


def test_where_the_plant_has_not_moved_yet_nothing_is_counted() -> None:
    text = GEARS.replace("plant Engine period 10ms", "plant Engine period 5ms")
    text = text.replace("s: float;", "s: float = 1.0;").replace("always e.truth.s < 9.0", ALIVE)

    class Short(Engine):
        def reset(self, **_: Any) -> tuple[Any, dict[str, Any]]:
            return np.array([1.0]), {}

        def step(self, _: Any) -> Any:
            return np.array([2.0]), 0.0, True, False, {}

    env = Protected(written(text), Short())
    env.reset(seed=1)
    *_, ended, _, info = env.step(1)
    assert (ended, info["violations"]) == (True, 0)


@pytest.mark.parametrize("storage", ["static", "static _Thread_local"])
def test_linked_c_with_a_memory_is_refused(
    storage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Environments of a process would share it, and no `reset` begins it anew."""
    (tmp_path / "gears.soter").write_text(LINKED)
    text = LOG_C.replace("(void)in;", f"(void)in;\n  {storage} int calls;\n  calls++;")
    (tmp_path / "log.c").write_text(text.replace("noted = 1", "noted = calls"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(soter.SoterError, match="C that may keep something") as caught:
        Protected("gears.soter", Engine())
    assert caught.value.diagnostics[0].code == "X008"
    (tmp_path / "log.c").write_text(LOG_C)
    Protected("gears.soter", Engine()).reset(seed=1)


def counts(program: str, log: Callable[[], object] | None = None) -> list[int]:
    """What `noted` says after three steps of each of three episodes, two worlds by turns."""
    worlds = []
    for _ in range(2):
        made = soter.load(program)
        worlds.append(Protected(made if log is None else made.bind("Log", log()), Engine()))
    found = []
    for _ in range(3):
        for env in worlds:
            env.reset(seed=1)
        for _ in range(3):
            seen = [env.step(2)[-1] for env in worlds]
        assert "violations" in seen[0]
        found += [e.session.topic_value(e.session.system.topic("noted").index) for e in worlds]
    return found


def test_what_the_refusal_of_such_c_says_to_do_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A `var` of the node, or Python that has a `reset`: each begins anew."""
    text = LINKED.replace("{ publishes noted; }", "{ publishes noted; var calls: int = 0; }")
    (tmp_path / "gears.soter").write_text(text)
    own = "gears_Log_local *local, gears_Log_out *out"
    code = LOG_C.replace("gears_Log_out *out", own).replace(">noted = 1", ">noted = ++local->calls")
    (tmp_path / "log.c").write_text(code)
    monkeypatch.chdir(tmp_path)
    kept = counts("gears.soter")
    assert len(set(kept)) == 1
    assert kept[0] > 1

    class Log:
        def reset(self, _: int) -> None:
            self.calls = 0

        def step(self, _: Any) -> dict[str, Any]:
            self.calls += 1
            return {"noted": self.calls}

    (tmp_path / "gears.soter").write_text(LINKED)
    assert counts("gears.soter", Log) == kept


def test_worlds_of_a_vector_share_no_memory_of_c(tmp_path: Path) -> None:
    for kind in ("nothing", "heap"):
        program = stateful_externs.write(tmp_path / kind, kind, 0)
        body = program.with_name("body.c")
        said = body.read_text(encoding="utf-8")
        body.write_text(said[: said.index("int learned")], encoding="utf-8")  # the agent is outside
    make_vec(tmp_path / "nothing" / "stateful.soter", 3).reset(seed=1)
    with pytest.raises(soter.SoterError, match="C that may keep something"):
        make_vec(tmp_path / "heap" / "stateful.soter", 3)


# ---------------------------------------------------------------- spaces


@cache
def accel() -> Topic:
    """The cart's command, whose set the test below changes."""
    return soter.load(CART).flat().topic("accel")


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e6))
@example(-262144.4296875, 0.015625)
@example(0.1, 0.0)
def test_no_action_of_the_space_is_outside_the_set(low: float, width: float) -> None:
    topic = accel()
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


# ---------------------------------------------------------------- numbers, straight to C

ODD = (np.nan, np.inf, -np.inf, 3.0, -3.0, 3.0000000000000004, 0.0, -0.0, 5e-324)


def both_ways(numbers: Protected, functions: Protected, actions: Any, seed: int) -> None:
    """The same episode on both: what is seen, told and left in memory."""
    first, second = (env.reset(seed=seed) for env in (numbers, functions))
    assert (first[0] == second[0]).all()
    assert first[1] == second[1]
    for action in actions:
        a, b = (env.step(action) for env in (numbers, functions))
        assert (a[0] == b[0]).all()
        assert a[1:4] == b[1:4]
        assert told(a[4]) == told(b[4])
        assert numbers.session.state.tobytes() == functions.session.state.tobytes()
        if a[2] or a[3]:
            return


def told(info: dict[str, Any]) -> dict[str, Any]:
    """`info` with what NaN would make different from itself as text."""
    return {
        k: repr(v) if k.startswith("action_") else v for k, v in info.items() if k != "off_model"
    }


@given(
    st.lists(st.one_of(st.sampled_from(ODD), st.floats(-4.0, 4.0)), max_size=60),
    st.integers(0, 2**31),
    st.sampled_from(["Protected", "Unprotected"]),
)
@settings(max_examples=60, deadline=None)
@pytest.mark.long
def test_numbers_go_to_c_as_they_go_through_python(
    wishes: list[float], seed: int, system: str
) -> None:
    program = soter.load(CART)
    env = Protected(program, Cart(), system=system, measured=True)
    other = Protected(
        program,
        Cart(),
        system=system,
        measured=True,
        observe=lambda o: {"x": o[0], "v": o[1]},
        act=lambda a: {"accel": a[0]},
        command=lambda accel: np.array([accel]),
    )
    both_ways(env, other, [np.array([w]) for w in wishes], seed)


MIXED = """soter 1;
type Gear = enum { LOW, MIDDLE, HIGH };
type Wish = { gear: Gear, n: int in [-2, 300], on: bool, f: float, big: int };
topic speed: float max_age 20ms;
topic wish: Wish in { n in [-2, 200], f in [-1.0, 2.5],
  big in [-9007199254740993, 9007199254740993] };
plant Engine period 10ms { reads wish; drives speed = s; state s: float; state n: int in [0, 9];
  state on: bool; next s = s + 1.0; }
extern node Ac period 10ms { subscribes speed; publishes wish; }
node Sc period 10ms { subscribes speed; publishes wish;
  step { publish wish = { gear: Gear.LOW, n: 0, on: false, f: 0.0, big: 1 }; } }
rta Box { ac Ac; sc Sc; period 10ms; safe speed < 9.0; ttf speed > 6.0; safer speed < 2.0; }
system S default { e: Engine; module Box; until 1s; always e.truth.s < 9.0; }
"""
LEAVES = (
    0.0,
    1.0,
    2.0,
    3.0,
    -1.0,
    0.5,
    -2.0,
    300.0,
    301.0,
    7.0,
    np.nan,
    np.inf,
    -0.0,
    1e300,
    2.0**63,
)


class Mixed(Cart):  # type: ignore[misc]
    """Speed, gear counter and a lamp; what it is told is five numbers."""

    def __init__(self) -> None:
        super().__init__()
        self.observation_space = spaces.Box(-100.0, 100.0, (3,), np.float64)
        self.action_space = spaces.Box(-np.inf, np.inf, (5,), np.float64)

    def reset(self, **_: Any) -> tuple[Any, dict[str, Any]]:
        self.done = 0
        return np.zeros(3), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.done += 1
        return (
            np.array([self.done / 4.0, self.done % 10, self.done % 2]),
            action[3],
            False,
            False,
            {},
        )


def values_by_hand(action: Any) -> dict[str, Any]:
    """What `mapping.assembled` makes of five numbers, for `act`."""
    names = ("LOW", "MIDDLE", "HIGH")
    gear, n, on, f, big = (float(x) for x in action)

    def whole(x: float) -> Any:
        return int(x) if np.isfinite(x) and x == int(x) else x

    known = whole(gear)
    lamp = whole(on)
    return {
        "wish": {
            "gear": names[known] if isinstance(known, int) and 0 <= known < 3 else gear,
            "n": whole(n),
            "on": bool(lamp) if isinstance(lamp, int) else lamp,
            "f": f,
            "big": whole(big),
        }
    }


@pytest.mark.filterwarnings("ignore:the environment did what plant")
@given(
    st.lists(st.tuples(*[st.sampled_from(LEAVES)] * 5), max_size=30),
    st.lists(st.tuples(st.sampled_from((0.0, 1.0, 2.0)), *[st.sampled_from((0.0, 1.0))] * 4)),
)
@settings(max_examples=60, deadline=None)
def test_ints_bools_and_enums_go_to_c_as_they_go_through_python(
    wild: list[Any], tame: list[Any]
) -> None:
    path = written(MIXED)
    space = spaces.Box(-np.inf, np.inf, (5,))
    env = Protected(path, Mixed(), action_space=space)
    other = Protected(
        path,
        Mixed(),
        action_space=space,
        observe=lambda o: {"s": o[0], "n": int(o[1]), "on": bool(o[2])},
        act=values_by_hand,
        command=lambda wish: np.array(
            [("LOW", "MIDDLE", "HIGH").index(wish.gear), wish.n, wish.on, wish.f, wish.big], float
        ),
    )
    both_ways(env, other, [np.array(a) for pair in zip(wild, tame, strict=False) for a in pair], 1)


@cache
def written(text: str) -> soter.Program:
    """A program that was written somewhere and loaded once."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mixed.soter"
        path.write_text(text)
        return soter.load(path)


@pytest.mark.parametrize(("observed", "words"), [(0.5, "no state of the plant"), (10.0, "outside")])
def test_an_observation_that_is_no_state_is_said(observed: float, words: str) -> None:
    class Broken(Mixed):
        def step(self, action: Any) -> Any:
            state, *rest = super().step(action)
            return np.array([state[0], observed, 0.0]), *rest

    env = Protected(written(MIXED), Broken(), action_space=spaces.Box(-1.0, 1.0, (5,)))
    env.reset(seed=1)
    with pytest.raises(soter.SoterError, match=words) as caught:
        env.step(np.zeros(5))
    assert caught.value.diagnostics[0].code == "U001"


def test_a_step_costs_little_more_than_the_environments_own() -> None:
    """Not a time: how often Python is called a step, which no load of the machine changes."""
    env = Protected(CART, Cart())
    env.reset(seed=1)
    env.step(FULL)
    calls = 0

    def count(_: Any, event: str, __: Any) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(count)
    try:
        for _ in range(100):
            env.step(FULL)
    finally:
        sys.setprofile(None)
    assert calls <= 100 * 30


@pytest.mark.long
def test_many_environments_are_compiled_once_until_linked_c_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def counted(*arguments: Any, **options: Any) -> Any:
        made.append(arguments)
        return compiled_unit.generate_measured(*arguments, **options)

    monkeypatch.setattr(compiled_module, "generate_measured", counted)
    monkeypatch.chdir(tmp_path)
    Path("gears.soter").write_text(LINKED)
    Path("log.c").write_text(LOG_C)
    program = soter.load("gears.soter")
    for source in [program] * 8 + ["gears.soter"] * 2:
        env = Protected(source, Engine())
    assert len(made) == 1
    Path("log.c").write_text(LOG_C.replace("noted = 1", "noted = 101"))
    env = Protected(program, Engine())
    assert len(made) == 2
    env.reset(seed=1)
    env.step(1)
    assert env.session.topic_value(env.session.system.topic("noted").index) == 101


# ---------------------------------------------------------------- whole numbers


HALVES = GEARS.replace("topic gear: Gear;", "topic gear: float in [0.0, 2.0] = 0.0;")
HALVES = HALVES.replace("Gear.HIGH", "0.5").replace("Gear.LOW", "0.0")


def test_a_half_is_no_action_of_a_discrete_environment() -> None:
    env = Protected(written(HALVES), Engine())
    env.reset(seed=1)
    with pytest.raises(soter.SoterError, match=r"0\.5 is no whole number") as caught:
        env.step(np.array([0.5]))
    assert caught.value.diagnostics[0].code == "U001"
    env.reset(seed=1)
    env.step(np.array([2.0]))
    assert env.env.unwrapped.gears[-1] == 2  # type: ignore[attr-defined]


FLOATING = """soter 1;
topic at: float max_age 1s;
topic go: float in [-1.0, 1.0] = 0.0;
plant P period 10ms { reads go; drives at = a; state a: float; next a = a + 1.0; }
node Ac period 10ms { subscribes at; publishes go; step { publish go = 1.0; } }
node Sc period 10ms { publishes go; step { publish go = -1.0; } }
rta M { ac Ac; sc Sc; period 10ms; safe at < 9.0; ttf at > 3.0; safer at < 2.0; }
system S default { p: P; module M; until 10s; }
"""


def test_a_float_of_three_values_is_discrete_on_both_sides() -> None:
    inner = Engine()
    env = Protected(
        written(FLOATING),
        inner,
        action_space=spaces.Discrete(3),
        act=lambda a: {"go": a - 1.0},
        command=lambda go: round(go) + 1,
    )
    env.reset(seed=1)
    for choice in (2, 0, np.int64(1), 2):
        *_, info = env.step(choice)
        assert (info["gate_fault"], info["taken_by"]) == (False, "AC")
    env.step(2)
    assert inner.gears == [2, 0, 1, 2, 0], "SC has -1"
    assert all(inner.action_space.contains(a) for a in inner.gears)


class Two(Engine):
    """Two actions at once."""

    def __init__(self) -> None:
        super().__init__()
        self.action_space: Any = spaces.MultiDiscrete([3, 6], start=np.array([0, -2]))


TWO = GEARS.replace("publishes gear;", "publishes gear, turbo;").replace(
    "reads gear;", "reads gear, turbo;"
)
TWO = TWO.replace("publish gear = Gear.HIGH;", "publish gear = Gear.HIGH; publish turbo = 3;")
TWO = TWO.replace("publish gear = Gear.LOW;", "publish gear = Gear.LOW; publish turbo = 0;")


def test_several_whole_numbers_are_multi_discrete_on_both_sides() -> None:
    inner = Two()
    env = Protected(written(TWO), inner)
    assert env.action_space == inner.action_space
    env.reset(seed=1)
    env.step(np.array([2, -2]))
    env.step(np.array([1, 3]))
    assert [a.tolist() for a in inner.gears] == [[2, -2], [1, 3]]
    assert env.step(np.array([1, 4]))[-1]["gate_fault"]


@pytest.mark.parametrize(
    ("space", "words"),
    [
        (spaces.Discrete(2), "2 is no action"),
        (spaces.MultiDiscrete([3, 3]), "has 2"),
        (spaces.Box(-1.0, 1.0, (2, 2)), "has 4"),
        (spaces.Text(3), "no default"),
    ],
)
def test_an_action_space_that_does_not_fit_is_said(space: Any, words: str) -> None:
    inner = Engine()
    inner.action_space = space

    def stepped() -> None:
        env = Protected(written(GEARS), inner)
        env.reset(seed=1)
        env.step(2)

    with pytest.raises(soter.SoterError, match=words):
        stepped()


# ---------------------------------------------------------------- what is no number


@pytest.mark.filterwarnings("ignore:the environment did what plant")
@all_rows("number", [np.nan, np.inf, -np.inf])
@all_rows("at", [3, 4])
@all_rows("options", [{}, {"alarm": False}, {"observe": lambda o: {"x": o[0], "v": o[1]}}])
def test_an_episode_is_cut_where_the_environment_shows_no_number(
    number: float, at: int, options: dict[str, Any]
) -> None:
    rows = np.zeros((9, 2))
    rows[at, 1] = number
    env = Protected(CART, Replay(rows), **options)
    env.reset(seed=1)
    *_, ended, cut, info = env.step(np.zeros(1))
    assert (ended, cut, "not_finite" in info) == (False, False, False)
    *_, ended, cut, info = env.step(np.zeros(1))
    assert (ended, cut, info["off_model"], info["not_finite"]) == (False, True, True, ["v"])
    with pytest.raises(soter.SoterError, match="the episode is over"):
        env.step(np.zeros(1))
    env.reset(seed=1)
    assert not env.step(np.zeros(1))[3]


def test_no_episode_starts_where_nothing_is_a_number() -> None:
    for options in ({}, {"observe": lambda o: {"x": o[0], "v": o[1]}}):
        env = Protected(CART, Replay(np.array([[np.inf, 0.0]] * 3)), **options)
        with pytest.raises(soter.SoterError, match="`x` is NaN or infinite") as caught:
            env.reset(seed=1)
        assert caught.value.diagnostics[0].code == "U001"


# ---------------------------------------------------------------- errors of measurement


def test_the_programs_errors_are_added_only_where_that_is_asked_for() -> None:
    program = soter.load(CART)
    for measured, exact in ((False, True), ((), True), (True, False), (["motion"], False)):
        env = Protected(program, Cart(), measured=measured)
        observation, _ = env.reset(seed=4)
        heard = env.session.record["topics"]["motion"]
        assert ((heard["x"], heard["v"]) == tuple(observation)) == exact
        assert abs(heard["x"] - observation[0]) <= 0.02
    with pytest.raises(soter.SoterError, match="no `measured` topic `goal`"):
        Protected(program, Cart(), measured=["goal"])


# ---------------------------------------------------------------- what the module did, and why


def test_info_says_what_was_asked_for_what_was_done_and_why() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    causes = set()
    for _ in range(1500):
        *_, info = env.step(FULL)
        assert info["action_requested"] is FULL
        assert info["intervened"] == (info["taken_by"] == "SC")
        assert (info["cause"] is not None) == info["intervened"]
        causes.add(info["cause"])
    assert causes == {None, "ttf", "recovering"}
    env.reset(seed=1)
    *_, info = env.step(np.array([np.nan]))
    assert (info["intervened"], info["cause"]) == (True, "gate")


def shielded(folder: Path, shield: str) -> Path:
    """The cart with such a clause in the place of its predicates."""
    text = Path(CART).read_text("utf-8")
    lines = [x for x in text.splitlines() if not x.startswith(("  ttf ", "  safer "))]
    path = folder / "shielded.soter"
    path.write_text("\n".join(lines).replace("  verify {", f"  {shield}\n  verify {{", 1), "utf-8")
    return path


def test_info_says_when_it_was_the_shield(tmp_path: Path) -> None:
    """Full throttle is refused before the module takes over; NaN is refused by the gate alone."""
    env = Protected(shielded(tmp_path, "shield 8;"), Cart())
    env.reset(seed=1)
    refused = []
    for _ in range(1500):
        *_, info = env.step(FULL)
        if info["cause"] == "shield":
            refused.append(info)
    assert refused
    assert (refused[0]["gate_fault"], refused[0]["taken_by"]) == (True, "AC")
    assert all(i["intervened"] and i["action_requested"] is FULL for i in refused)
    env.reset(seed=1)
    *_, info = env.step(np.array([np.nan]))
    assert info["cause"] == "gate"


@pytest.mark.parametrize("numbers", [True, False])
def test_info_says_which_actions_the_shield_moved(tmp_path: Path, numbers: bool) -> None:
    """Full throttle at the wall never loses control; what the environment received says why."""
    act = {} if numbers else {"act": lambda a: {"accel": float(a[0])}}
    env = Protected(shielded(tmp_path, "shield 8 toward sc;"), Cart(), **act)
    env.reset(seed=1)
    moved = 0
    for _ in range(1500):
        *_, info = env.step(FULL)
        assert info["taken_by"] == "AC"
        same = info["action_taken"] == FULL
        assert info["intervened"] == (not same)
        assert info["cause"] == (None if same else "toward sc")
        assert info["action_requested"] is FULL
        moved += not same
    assert 100 < moved < 1400
    env.reset(seed=1)
    *_, info = env.step(np.array([np.nan]))
    assert info["cause"] == "gate"


THROTTLES = np.linspace(-3.0, 3.0, 7)


@pytest.mark.parametrize("shield", ["shield 8;", "shield 8 toward sc;"])
def test_a_mask_says_which_actions_would_be_published_as_they_are(
    shield: str, tmp_path: Path
) -> None:
    """Each is tried in a copy of the environment, where the agent has control."""
    env = Protected(
        shielded(tmp_path, shield),
        Cart(),
        action_space=spaces.Discrete(7, start=-3),
        act=lambda a: {"accel": THROTTLES[a + 3]},
    )
    _, info = env.reset(seed=1)
    seen = set()
    for k in range(400):
        mask = info["action_mask"]
        assert (mask.dtype, mask.shape) == (np.int8, (7,))
        assert (env.action_masks() == mask.astype(bool)).all()
        if info["mode"] == "AC" and k % 20 == 0:
            for a in range(7):
                *_, tried = copy.deepcopy(env).step(a - 3)
                assert bool(mask[a]) == (not tried["intervened"]), (k, a)
        seen.add(tuple(mask.tolist()))
        *_, info = env.step(3)
    assert len(seen) > 2
    env.reset(seed=1)
    for _ in range(400):
        choices = np.flatnonzero(env.action_masks())
        *_, info = env.step(int(choices[-1]) - 3 if len(choices) else 0)
        assert not info["gate_fault"] or not len(choices)


def test_only_discrete_actions_have_masks() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    with pytest.raises(soter.SoterError, match="`Discrete`"):
        env.action_masks()
    env = Protected(written(GEARS), Engine())
    _, info = env.reset(seed=1)
    assert env.action_masks().all()
    assert "action_mask" not in info


def test_an_episode_may_be_cut_at_a_violation() -> None:
    plain = Protected(CART, Cart(), system="Unprotected")
    cut = Protected(CART, Cart(), system="Unprotected", truncate_on_violation=True)
    costs = []
    for env in (plain, cut):
        env.reset(seed=5)
        ended = False
        cost = 0.0
        while not ended:
            *_, over, truncated, info = env.step(FULL)
            ended, cost = over or truncated, cost + info["cost"]
        costs.append((cost, truncated))
    assert costs == [(1.0, False), (1.0, True)]


@pytest.mark.parametrize("class_", [Protected, SafetyWrapper, make_vec])
def test_an_agent_that_never_gets_control_is_told_so_whenever_one_is_made(class_: Any) -> None:
    program = written(NO_GRID)
    options = {
        Protected: (program, Engine()),
        SafetyWrapper: (Engine(), program),
        make_vec: (program, 2),
    }[class_]
    for _ in range(2):
        with pytest.warns(SafetyWarning, match="never gets control") as told_of:
            env = class_(*options)
    assert told_of[0].filename == (vector_module.__file__ if class_ is make_vec else __file__)
    assert "Box: " in str(told_of[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the start
        env.reset(seed=1)


@pytest.mark.parametrize(
    ("high", "told"), [(3.0, False), (3.1, False), (1.5, True), (np.nextafter(3.0, 0.0), True)]
)
@pytest.mark.parametrize("class_", [Protected, SafetyWrapper])
def test_an_environment_that_takes_less_than_the_program_commands_is_told(
    class_: Any, high: float, told: bool
) -> None:
    inner = Cart()
    inner.action_space = spaces.Box(-3.0, high, (1,), np.float64)
    made = (CART, inner) if class_ is Protected else (inner, CART)
    with warnings.catch_warnings(record=True) as told_of:
        warnings.simplefilter("always")
        class_(*made)
        class_(*made, command=lambda accel: np.array([accel]))
    assert len(told_of) == told
    if told:
        message = str(told_of[0].message)
        assert f"`accel` in [-3.0, 3.0] but [-3.0, {high!s}]" in message
        assert (told_of[0].category, told_of[0].filename) == (SafetyWarning, __file__)


def test_sets_are_compared_in_the_precision_of_the_space() -> None:
    inner = Engine()
    inner.action_space = spaces.Box(np.float32(0.0), np.float32(2.1), (1,), np.float32)
    assert float(inner.action_space.high[0]) < 2.1
    Protected(written(HALVES.replace("[0.0, 2.0]", "[0.0, 2.1]")), inner)


def test_a_start_that_the_module_does_not_vouch_for_is_told() -> None:
    inner = Replay(np.array([[9.9, 0.0]] * 4))
    env = Protected(CART, inner)
    with pytest.warns(SafetyWarning, match="starts where `ttf`"):
        env.reset(seed=1)


def test_a_learner_may_see_less_than_the_module() -> None:
    class Blind(Cart):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.observation_space = spaces.Box(-1.0, 1.0, (0,), np.float64)

        def reset(self, **how: Any) -> Any:
            return super().reset(**how)[0][:0], {}

        def step(self, action: Any) -> Any:
            state, *rest = super().step(action)
            return state[:0], *rest

    inner = Blind()
    env = Protected(CART, inner, observe=lambda _: {"x": inner.state[0], "v": inner.state[1]})
    _, info, ended = rammed(env, 2000)
    assert inner.state[0] < WALL
    assert not ended
    assert info["violations"] == 0


def test_the_margin_is_that_of_the_run() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    told = {env.step(FULL)[-1]["margin"] for _ in range(40)}
    assert max(told) == 0.049, "right after a look: a period of 50 ms, less `late dm 1ms`"
    assert min(told) < 0.02


def margin_of(env: Protected) -> float:
    """docs/proof-sets.md, Margin, from the record of the state."""
    session = env.session
    module, record, facts = session.module, session.record, session.facts
    if not facts["mode"]:
        return 0.0
    dm, period_ns = record["components"][module.dm], module.period_ns
    waits = 2 if dm["pending"] else 1
    late_ns = (int(dm["next"]) - session.system.components[module.dm].phase_ns) % period_ns
    looked = int(dm["next"]) - late_ns - waits * period_ns
    unsafe = bool(facts["ttf"] or facts["stale"] or facts["saw_gate_fault"])
    looks = module.periods_left(unsafe=unsafe, safer=bool(facts["safer"]))
    return module.margin_ns(looks, int(record["header"]["ct"]) - looked) / 1e9


def test_the_margin_is_what_is_left_of_the_looks_that_keep_ac(tmp_path: Path) -> None:
    computed = tmp_path / "cart.soter"
    computed.write_text(re.sub(r"\n  (ttf|safer) [^;]*;", "", CART.read_text()))
    rng, margins = np.random.default_rng(3), set()
    for program in (CART, computed):
        for steps in range(1, 60):  # episodes end at every moment between two looks
            env = Protected(program, Cart(steps))
            env.reset(seed=steps)
            ended = cut = False
            while not (ended or cut):
                size = 6.0 if rng.random() < 0.02 else 3.0  # now and then the gate refuses
                _, _, ended, cut, info = env.step(size * np.sign(rng.normal(0.3, 1.0, (1,))))
                assert info["margin"] == margin_of(env)
                margins.add((program, info["margin"]))
    period_s = 0.05
    assert (CART, 0.0) in margins
    assert max(m for p, m in margins if p == CART) < period_s
    assert max(m for p, m in margins if p == computed) > period_s, "several looks"


def test_a_step_in_arrays_runs_little_python() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    env.step(FULL)
    ran: list[str] = []

    def listen(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and "/soter/gym/" in frame.f_code.co_filename:
            ran.append(frame.f_code.co_name)

    sys.setprofile(listen)
    env.step(FULL)
    sys.setprofile(None)
    assert ran == ["step", "step"]


# ---------------------------------------------------------------- steps that change nothing


class Talker(Engine):
    """Says something of its own, under our names, too."""

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        *told, _ = super().step(action)
        return (*told, {"own": self.speed, "mode": "mine", "cost": 77.0})


def test_every_episode_counts_its_own_violations() -> None:
    text = GEARS.replace("always e.truth.s < 9.0", "always e.truth.s < 0.5")
    text = text.replace("speed > 3.0", "speed > 30.0").replace("speed < 2.0", "speed < 20.0")
    env = Protected(written(text), Talker())
    for _ in range(3):
        env.reset(seed=1)
        told = [env.step(1)[-1] for _ in range(3)]
        assert [(info["violations"], info["cost"]) for info in told] == [
            (1, 1.0),
            (1, 0.0),
            (1, 0.0),
        ]
        assert [(info["own"], info["mode"]) for info in told] == [
            (n, "AC") for n in (1.0, 2.0, 3.0)
        ]


def test_what_a_caller_does_with_info_is_its_own_matter() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    for _ in range(3):
        *_, before = env.step(FULL)
    kept = dict(before)
    taken = before["action_taken"].copy()
    before.clear()
    *_, after = env.step(FULL / 2)
    assert after.keys() == kept.keys()
    assert (kept["action_taken"] == taken).all(), "no array is given twice"
    assert (after["action_taken"] != taken).all()


def test_a_command_in_single_precision_is_the_rounded_one() -> None:
    inner = Cart()
    inner.action_space = spaces.Box(-3.0, 3.0, (1,), np.float32)
    env = Protected(CART, inner)
    env.reset(seed=1)
    for action in np.random.default_rng(4).uniform(-3.0, 3.0, (50, 1)):
        taken = env.step(action)[-1]["action_taken"]
        assert taken.dtype == np.float32
        assert taken == np.float32(action)


def test_without_functions_of_pythons_own_steps_are_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def told() -> list[Any]:
        env = Protected(CART, Cart())
        env.reset(seed=2)
        steps = [env.step(a) for a in np.random.default_rng(1).uniform(-3.1, 3.1, (400, 1))]
        return [
            (*o, r, *(v for k, v in sorted(info.items()) if "action" not in k))
            for o, r, _, _, info in steps
        ]

    expected = told()
    other = types.SimpleNamespace(**{**vars(sys.implementation), "name": "another"})
    monkeypatch.setattr(sys, "implementation", other)
    assert told() == expected
    assert len({str(x[2:]) for x in expected}) > 5


def test_info_has_the_keys_of_the_module_that_were_asked_for_and_all_of_the_environment() -> None:
    keys = ("cost", "margin", "off_model", "action_taken")
    whole, some = Protected(CART, Cart()), Protected(CART, Cart(), info_keys=keys)
    pairs = [(whole.reset(seed=5)[1], some.reset(seed=5)[1])]
    pairs += [(whole.step(FULL)[-1], some.step(FULL)[-1]) for _ in range(400)]
    assert {full["mode"] for full, _ in pairs} == {"AC", "SC"}
    for full, few in pairs:
        assert set(few) == {"own", *keys} & set(full)
        assert all(few[key] == full[key] for key in few)


def test_without_keys_of_the_module_episodes_end_where_they_did_before() -> None:
    cut: dict[str, Any] = {"system": "Unprotected", "truncate_on_violation": True}
    ends = []
    for keys in (None, ()):
        env = Protected(CART, Cart(), info_keys=keys, **cut)
        _, info = env.reset(seed=5)
        steps, truncated = 0, False
        while not truncated:
            *_, truncated, info = env.step(FULL)
            steps += 1
        ends.append((steps, info["own"]))
    assert set(info) == {"own"}
    assert ends[0] == ends[1]


def test_a_key_that_info_does_not_have_is_named() -> None:
    with pytest.raises(soter.SoterError, match="says nothing of `margins`") as caught:
        Protected(CART, Cart(), info_keys=("margins", "cost"))
    assert caught.value.diagnostics[0].code == "U001"
