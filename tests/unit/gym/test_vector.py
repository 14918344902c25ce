"""`soter.gym.ProtectedVector`: thousands of worlds of a program in one call."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

import soter
from soter.campaign import compiled_unit
from soter.gym import ProtectedVector, make_vec
from soter.gym import compiled_system as compiled_module

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
CLIFF = ROOT / "examples" / "mountain_car" / "cliff.soter"
SEED = 11
WORLDS = 5


@pytest.fixture(scope="module")
def cliff() -> soter.Program:
    return soter.load(CLIFF)


@pytest.fixture(scope="module")
def cart() -> soter.Program:
    return soter.load(CART)


def bang_bang(seen: Any) -> Any:
    """The car's own AC, for all worlds."""
    return np.where(seen[:, 1:2] >= 0.0, 1.0, -1.0)


def pursuit(seen: Any) -> Any:
    """The cart's own AC, on motion and goal."""
    return np.clip(4.0 * (seen[:, 2:3] - seen[:, 0:1]) - 1.0 * seen[:, 1:2], -3.0, 3.0)


def finished(env: ProtectedVector, world: int, action: Any) -> bytes:
    """The state of a world as its instant ends in which the agent answers so."""
    made = env.compiled
    state = env.worlds.states[world].copy()
    agent = made.roles.agent
    answer = np.zeros(made.answers[agent].size, dtype=np.uint8)
    (value, has) = sorted(made.answers[agent].members, key=lambda m: m.index)
    answer[value.offset : value.offset + 8] = np.array([action], dtype=np.float64).view(np.uint8)
    answer[has.offset] = 1
    made.library.answer_extern(state, agent, 0, answer.tobytes())
    made.library.run_until(state, int(state.view(np.int64)[0]))
    return bytes(state.tobytes())


@pytest.mark.parametrize("engine", ["native", "interp"])
@pytest.mark.parametrize(
    ("name", "policy", "observe", "steps"),
    [("cliff", bang_bang, None, 150), ("cart", pursuit, ["motion", "goal"], 400)],
)
def test_every_world_is_the_run_of_its_seed_to_the_last_bit(
    engine: str, name: str, policy: Any, observe: Any, steps: int, request: Any
) -> None:
    program = request.getfixturevalue(name)
    env = make_vec(program, WORLDS, observe=observe)
    until = (steps + 1) * env.compiled.system.components[env.compiled.roles.agent].period_ns / 1e9
    traces = [
        program.simulate(until=until, seed=SEED + k, engine=engine).require_trace()
        for k in range(WORLDS)
    ]
    places = [{int(t): i for i, t in enumerate(x["header"]["ct"])} for x in traces]
    seen, info = env.reset(seed=SEED)
    switched = 0
    for _ in range(steps):
        actions = policy(seen)
        for k in range(WORLDS):
            at = places[k][int(info["time"][k])]
            assert finished(env, k, actions[k, 0]) == traces[k][at].tobytes()
            assert info["violations"][k] == traces[k]["header"]["violations"][at]
            assert info["mode"][k] == traces[k]["modules"]["mode"][at, 0]
        switched += int(info["switched"].sum())
        seen, _, _, _, info = env.step(actions)
    assert switched > WORLDS, "runs in which something happens"


FAULTS = """faults {
    nan SafeCart.Fast at 600 per 1min for 30ms;
    stuck SafeCart.Fast.accel at 60 per 1min for 100ms;
    silent c.motion at 120 per 1min for 30ms;
    bias c.motion.x by 0.5 at 60 per 1min for 50ms;
    scale c.wind by 1.5 at 60 per 1min for 1s;
    skip SafeCart.Fast at 300 per 1min;
    late SafeCart.dm by 3ms at 300 per 1min;
  }
  until 30s;"""


def test_faults_of_a_system_strike_every_world_as_they_strike_its_run(tmp_path: Path) -> None:
    path = tmp_path / "cart.soter"
    path.write_text(CART.read_text().replace("until 30s;", FAULTS, 1))
    program = soter.load(path)
    env = make_vec(program, WORLDS, observe=["motion", "goal"])
    assert env.compiled.view.plain == 0
    traces = [program.simulate(until=4.0, seed=SEED + k).require_trace() for k in range(WORLDS)]
    places = [{int(t): i for i, t in enumerate(x["header"]["ct"])} for x in traces]
    seen, info = env.reset(seed=SEED)
    refused = 0
    while info["time"].max() < 3.9e9:
        actions = pursuit(seen)
        for k in range(WORLDS):
            at = places[k][int(info["time"][k])]
            assert finished(env, k, actions[k, 0]) == traces[k][at].tobytes()
        seen, *_, info = env.step(actions)
        refused += int(info["gate_fault"].sum())
    assert refused > WORLDS


WRONG = (np.nan, np.inf, -np.inf, 1.5, -7.0, 1.0000000000000002)


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_what_the_gate_refuses_is_refused_as_in_a_run(cliff: soter.Program, engine: str) -> None:
    rng = np.random.default_rng(5)
    actions = rng.uniform(-1.0, 1.0, (200, 1))
    wrong = rng.random(200) < 0.2
    actions[wrong, 0] = rng.choice(WRONG, int(wrong.sum()))
    told = iter(actions[:, 0])
    program = soter.load(CLIFF).bind("Learned", lambda _: {"force": next(told)})
    run = program.simulate("LearnedProtected", until=199.0, seed=SEED, engine=engine)
    trace = run.require_trace()
    env = make_vec(cliff, 1, system="LearnedProtected")
    _, info = env.reset(seed=SEED)
    for i in range(199):
        refused = trace["modules"]["gate_faults"][i, 0] - (
            trace["modules"]["gate_faults"][i - 1, 0] if i else 0
        )
        assert finished(env, 0, actions[i, 0]) == trace[i].tobytes()
        seen, _, _, _, info = env.step(actions[i : i + 1])
        assert info["gate_fault"][0] == bool(refused) == wrong[i]
        assert info["action_taken"][0, 0] == trace["topics"]["force"][i]
        assert (seen[0] == trace["topics"]["car"][i + 1].tolist()).all()
    assert trace["modules"]["to_sc"][-1, 0] > 5


def test_a_wrong_action_of_one_world_is_no_matter_of_the_others(cliff: soter.Program) -> None:
    env, alone = make_vec(cliff, 3), make_vec(cliff, 3)
    env.reset(seed=1)
    alone.reset(seed=1)
    for _ in range(20):
        seen, *_, info = env.step(np.array([[0.5], [np.nan], [0.5]]))
        other, *_ = alone.step(np.full((3, 1), 0.5))
        assert (seen[[0, 2]] == other[[0, 2]]).all()
        assert info["gate_fault"].tolist() == [False, True, False]
    assert info["cause"].tolist() == [0, 1, 0]


# ---------------------------------------------------------------- episodes


def episode(program: soter.Program, seed: int, steps: int) -> list[Any]:
    """What one world shows under that seed."""
    env = make_vec(program, 1, max_steps=0)
    seen, _ = env.reset(seed=seed)
    observations = [seen[0]]
    for _ in range(steps):
        seen, *_ = env.step(bang_bang(seen))
        observations.append(seen[0])
    return observations


def ends(before: Any, _: Any, seen: Any) -> Any:
    """An end that comes at other times in other worlds, and is still there a step later."""
    return (before[:, 1] > 0.004) | (seen[:, 1] > 0.004)


def applied(_: Any, action: Any, __: Any) -> Any:
    """A reward that shows which action was given, and is never 0."""
    return action[:, 0] + 10.0


def test_next_step_begins_the_next_episode_and_ignores_the_action(cliff: soter.Program) -> None:
    env = make_vec(cliff, 3, terminate=ends, max_steps=12, reward=applied)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seen, _ = env.reset(seed=SEED)
    number, at = [0] * 3, [0] * 3
    over = np.zeros(3, dtype=bool)
    expected = {(k, 0): episode(cliff, SEED + k, 12) for k in range(3)}
    ended_early = 0
    for _ in range(60):
        actions = np.where(over[:, None], np.nan, bang_bang(seen))
        seen, reward, ended, cut, info = env.step(actions)
        for k in range(3):
            if over[k]:
                number[k], at[k] = number[k] + 1, 0
                expected[k, number[k]] = episode(cliff, SEED + k + 3 * number[k], 12)
                assert (reward[k], ended[k], cut[k], info["steps"][k]) == (0.0, False, False, 0)
            else:
                at[k] += 1
                assert reward[k] == info["action_taken"][k, 0] + 10.0
            assert (seen[k] == expected[k, number[k]][at[k]]).all()
            assert cut[k] == (at[k] == 12)
            assert info["steps"][k] == at[k]
        over = ended | cut
        ended_early += int((ended & ~cut).sum())
    assert ended_early > 3
    assert min(number) >= 3


def test_same_step_begins_it_at_once_and_tells_how_the_last_one_ended(cliff: soter.Program) -> None:
    env = make_vec(cliff, 3, terminate=ends, max_steps=12, autoreset="SameStep")
    seen, _ = env.reset(seed=SEED)
    number, at = [0] * 3, [0] * 3
    expected = {(k, 0): episode(cliff, SEED + k, 12) for k in range(3)}
    for _ in range(60):
        seen, _, ended, cut, info = env.step(bang_bang(seen))
        over = ended | cut
        assert ("final_obs" in info) == bool(over.any())
        for k in range(3):
            at[k] += 1
            if over[k]:
                assert (info["final_obs"][k] == expected[k, number[k]][at[k]]).all()
                assert info["final_info"]["steps"][k] == at[k]
                assert info["_final_obs"][k]
                number[k], at[k] = number[k] + 1, 0
                expected[k, number[k]] = episode(cliff, SEED + k + 3 * number[k], 12)
            assert (seen[k] == expected[k, number[k]][at[k]]).all()
    assert min(number) >= 4


def test_disabled_wants_a_mask(cliff: soter.Program) -> None:
    env = make_vec(cliff, 2, max_steps=3, autoreset=AutoresetMode.DISABLED)
    seen, _ = env.reset(seed=SEED)
    for _ in range(3):
        seen, _, _, cut, _ = env.step(bang_bang(seen))
    assert cut.all()
    with pytest.raises(soter.SoterError, match="over"):
        env.step(bang_bang(seen))
    env.reset(options={"reset_mask": np.array([True, True])})
    begun, _ = env.reset(seed=SEED, options={"reset_mask": np.array([False, True])})
    assert (begun[1] == episode(cliff, SEED + 1, 0)[0]).all()
    assert (begun[0] == episode(cliff, SEED + 2, 0)[0]).all()


@pytest.mark.parametrize(("how", "which"), [("terminate", 0), ("truncate", 1)])
def test_an_episode_may_end_with_a_violation(cliff: soter.Program, how: str, which: int) -> None:
    env = make_vec(cliff, 4, system="LearnedAdvanced", on_violation=how)
    seen, _ = env.reset(seed=SEED)
    falls, again = 0, np.zeros(4, dtype=bool)
    for _ in range(400):
        seen, _, *over, info = env.step(bang_bang(seen))
        fell = seen[:, 0] <= -1.2
        assert (over[which] == fell).all(), "at once, although the instant is not over"
        assert not over[1 - which].any()
        assert (info["cost"] == fell).all()
        assert (info["violations"] == fell).all()
        assert not (fell & again).any()
        falls, again = falls + int(fell.sum()), fell
    assert falls > 4


def test_equal_seeds_give_equal_episodes_and_a_list_names_each(cliff: soter.Program) -> None:
    env = make_vec(cliff, 3)
    first, _ = env.reset(seed=4)
    again, _ = env.reset(seed=[4, 5, 6])
    other, _ = env.reset()
    assert (first == again).all()
    assert (first[:, 0] != other[:, 0]).all()
    assert (other[0] == episode(cliff, 7, 0)[0]).all()


# ---------------------------------------------------------------- arrays


class Tensor:
    """What a tensor of torch looks like to us."""

    def __init__(self, data: Any) -> None:
        self.data = data

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> Any:
        return self.data


def test_actions_of_any_kind_of_array_are_the_same_actions(cliff: soter.Program) -> None:
    observations = []
    for action in (
        np.full((2, 1), 0.5),
        np.full(2, 0.5),
        np.full((2, 1), 0.5, dtype=np.float32),
        [[0.5], [0.5]],
        Tensor(np.full((2, 1), 0.5)),
        np.asfortranarray(np.full((4, 1), 0.5)[::2]),
    ):
        env = make_vec(cliff, 2)
        env.reset(seed=1)
        observations.append(env.step(action)[0])
    assert all((x == observations[0]).all() for x in observations)


def test_a_policy_of_torch_drives(cliff: soter.Program) -> None:
    torch = pytest.importorskip("torch", reason="the extra is absent: pip install torch")
    env = make_vec(cliff, 4, dtype=np.float32)
    policy = torch.nn.Linear(2, 1)
    seen, _ = env.reset(seed=1)
    for _ in range(3):
        seen, *_ = env.step(torch.tanh(policy(torch.from_numpy(seen))))
    assert seen.dtype == np.float32


def test_arrays_are_the_callers_unless_it_does_not_want_copies(cliff: soter.Program) -> None:
    for copy in (True, False):
        env = make_vec(cliff, 2, copy=copy)
        first, info = env.reset(seed=1)
        kept, mode = first.copy(), info["time"].copy()
        second, *_ = env.step(np.zeros((2, 1)))
        assert (first == kept).all(), "a step does not touch what was there before it"
        env.step(np.ones((2, 1)))
        assert (first == kept).all() == copy
        assert (info["time"] == mode).all() == copy
        assert second is not first


@pytest.mark.parametrize(("mode", "at"), [("NextStep", [4, 10, 16]), ("SameStep", [4, 9, 14])])
def test_wrappers_of_gymnasiums_count_its_episodes(
    cliff: soter.Program, mode: str, at: list[int]
) -> None:
    env = make_vec(cliff, 3, max_steps=5, autoreset=mode, reward=lambda o, *_: np.ones(len(o)))
    counted = gymnasium.wrappers.vector.RecordEpisodeStatistics(env)
    counted.reset(seed=1)
    told = {i: counted.step(np.zeros((3, 1)))[-1] for i in range(17)}
    assert [i for i, info in told.items() if "episode" in info] == at
    assert all(told[i]["episode"]["r"].tolist() == [5.0] * 3 for i in at)


def test_partial_observations_are_named(cliff: soter.Program) -> None:
    env = make_vec(cliff, 2, observe=["force", "car.truth"])
    seen, _ = env.reset(seed=1)
    assert seen.shape == (2, 3)
    assert env.single_observation_space.low.tolist() == [-1.0, -np.inf, -np.inf]  # type: ignore[attr-defined]
    seen, *_ = env.step(np.full((2, 1), 0.25))
    assert (seen[:, 0] == 0.25).all()


GEARS = """soter 1;
type Gear = enum { LOW, MIDDLE, HIGH };
topic speed: float max_age 20ms;
topic gear: Gear;
topic turbo: int in [-2, 3] = 0;
topic lamp: bool;
plant Engine period 10ms { reads gear, turbo; drives speed = s; state s: float; next s = s + 1.0; }
extern node Ac period 10ms { subscribes speed; publishes gear, turbo, lamp; }
node Sc period 10ms { subscribes speed; publishes gear, turbo, lamp;
  step { publish gear = Gear.LOW; publish turbo = 0; publish lamp = false; } }
rta Box { ac Ac; sc Sc; period 10ms; safe speed < 9.0; ttf speed > 6.0; safer speed < 2.0; }
system S default { e: Engine; module Box; until 1s; always e.truth.s < 9.0; }
"""


def test_ints_bools_and_enums_are_multi_discrete(tmp_path: Path) -> None:
    path = tmp_path / "gears.soter"
    path.write_text(GEARS)
    env = make_vec(path, 4)
    assert env.single_action_space == spaces.MultiDiscrete([3, 6, 2], start=np.array([0, -2, 0]))
    env.reset(seed=1)
    given = np.array([[2, 3, 1], [0, -2, 0], [3, 0, 0], [1, 4, 0]])
    *_, info = env.step(given)
    assert info["gate_fault"].tolist() == [False, False, True, True]
    assert info["action_taken"][:2].tolist() == given[:2].tolist()
    env.reset(seed=1)
    *_, info = env.step(given + np.array([0.5, 0.0, 0.0]))
    assert info["gate_fault"].all(), "a half is no member"


# ---------------------------------------------------------------- construction and mistakes


def test_the_program_is_compiled_once_for_all_environments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def counted(*arguments: Any, **options: Any) -> Any:
        made.append(arguments)
        return compiled_unit.generate_measured(*arguments, **options)

    monkeypatch.setattr(compiled_module, "generate_measured", counted)
    path = tmp_path / "cart.soter"
    path.write_text(CART.read_text())
    program = soter.load(path)
    for source in [program] * 32 + [path] * 4:
        make_vec(source, 2)
    assert len(made) == 1
    make_vec(program, 2, params={}, system="Protected")
    assert len(made) == 2, "another choice"
    path.write_text(CART.read_text().replace("0.12", "0.13"))
    make_vec(path, 2)
    assert len(made) == 3, "another program"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"num_envs": 0}, "cannot be 0 worlds"),
        ({"num_envs": True}, "cannot be True worlds"),
        ({"observe": ["nothing"]}, "nothing to observe called `nothing`"),
        ({"observe": []}, "an observation of nothing"),
        ({"on_violation": "explode"}, "explode"),
        ({"module": "Nobody"}, "no module `Nobody`"),
        ({"autoreset": "Sometimes"}, "Sometimes"),
        ({"max_steps": -1}, "last -1 steps"),
        ({"dtype": "int32"}, "int32"),
    ],
)
def test_wrong_choices_are_said(cliff: soter.Program, options: dict[str, Any], words: str) -> None:
    with pytest.raises(soter.SoterError, match=words) as caught:
        make_vec(cliff, **{"num_envs": 2, **options})
    assert caught.value.diagnostics[0].code == "U001"


def test_mistakes_while_stepping_are_said(cliff: soter.Program) -> None:
    env = make_vec(cliff, 2, reward=lambda *_: 1.0)
    for mistake, words in (
        (lambda: env.step(np.zeros((2, 1))), "no episode has begun"),
        (lambda: env.reset(seed=[1, 2, 3]), "3 seeds for 2 worlds"),
        (lambda: env.reset(seed=-1), "-1"),
        (lambda: env.reset(options={"reset_mask": [1]}), "reset_mask"),
    ):
        with pytest.raises(soter.SoterError, match=words):
            mistake()
    env.reset(seed=1)
    for actions in (np.zeros((2, 2)), np.zeros(3), 0.5):
        with pytest.raises(soter.SoterError, match="actions have the shape"):
            env.step(actions)
    with pytest.raises(soter.SoterError, match="`reward` gave the shape"):
        env.step(np.zeros((2, 1)))


def test_a_plant_in_python_is_refused_in_words() -> None:
    program = soter.load(ROOT / "examples" / "mountain_car" / "gymnasium.soter")
    with pytest.raises(soter.SoterError, match="is extern") as caught:
        make_vec(program, 2)
    assert caught.value.diagnostics[0].code == "U003"


def test_a_function_in_python_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "gears.soter"
    text = GEARS.replace("next s = s + 1.0", "next s = Faster(s)")
    path.write_text(
        text.replace("plant Engine", "extern fun Faster(s: float): float;\nplant Engine")
    )
    program = soter.load(path).bind("Faster", lambda s: s + 1.0)
    with pytest.raises(soter.SoterError) as caught:
        make_vec(program, 2)
    assert caught.value.diagnostics[0].code == "X007"


def test_the_drone_flies_as_in_a_run_when_its_own_acs_answers_are_given() -> None:
    program = soter.load(ROOT / "examples" / "drone" / "motion_primitive.soter")
    env = make_vec(program, 2, observe=["d.truth"])
    system, roles = env.compiled.system, env.compiled.roles
    agent = system.components[roles.agent]
    (topic,) = (system.topics[agent.scope.topics[t]].name for t in agent.node.publishes)  # type: ignore[union-attr]
    runs = [program.simulate(until=4.0, seed=SEED + k).require_trace() for k in range(2)]
    places = [{int(t): i for i, t in enumerate(x["header"]["ct"])} for x in runs]
    seen, info = env.reset(seed=SEED)
    for _ in range(int(3.9e9) // agent.period_ns):
        at = [places[k][int(info["time"][k])] for k in range(2)]
        for k in range(2):
            truth = runs[k][at[k]]["d"]
            assert [x for n in names(env) for x in numbers(truth[n])] == list(seen[k])
            assert info["mode"][k] == runs[k]["modules"]["mode"][at[k], 0]
        wishes = [numbers(runs[k]["topics"][topic][at[k]]) for k in range(2)]
        seen, *_, info = env.step(np.array(wishes))


def numbers(value: Any) -> list[float]:
    """The numbers of a record of floats."""
    if value.dtype.names is None:
        return [float(x) for x in np.ravel(value)]
    return [x for n in value.dtype.names for x in numbers(value[n])]


def names(env: ProtectedVector) -> list[str]:
    """The states of the drone, in declared order."""
    plant = env.compiled.system.component("d").plant
    assert plant is not None
    return [v.name for v in plant.states]
