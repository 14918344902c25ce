"""Policies of other algorithms, spaces and options: recorded answers, and what is refused."""

from __future__ import annotations

import json
import pickle
import shutil
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from gymnasium import spaces
from policy_files import FILES, change_pickle, changed, renamed  # type: ignore[import-not-found]

from soter.diagnostics.diagnostic import SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.types import ArrayType, FloatType, IntType, RecordType
from soter.policy.network import (
    Activation,
    Affine,
    Lstm,
    Network,
    Standardised,
    last_layer_numbers,
    prepare_network,
)
from soter.policy.policy_extern import load_policy, sha256_of_files
from soter.policy.sb3_file import read_sb3
from soter.policy.soter_source import error_bound, soter_source

if TYPE_CHECKING:
    from pathlib import Path

KINDS = json.loads((FILES / "kinds.json").read_text(encoding="utf-8"))
WHOLE, NUMBER = IntType(0, 9), FloatType()


def loaded(file: str, reads: Any, writes: Any, folder: Path = FILES) -> Any:
    binding = binding_of(f"sb3:{file}")
    assert binding is not None
    return load_policy(binding.in_folder(folder), reads, writes, None)


def shapes(row: dict[str, Any]) -> list[tuple[str, Any]]:
    """Topics of an observation, in another order than it has."""
    whole = all(isinstance(x, int) for values in row.values() for x in values)
    return [(n, ArrayType(WHOLE if whole else NUMBER, len(row[n]))) for n in sorted(row)[::-1]]


@pytest.mark.parametrize("name", KINDS)
def test_answers_are_those_of_predict(name: str) -> None:
    told = KINDS[name]
    rows, actions = told["observations"], told["actions"]
    element = WHOLE if told["whole"] else NUMBER
    policy = loaded(f"{name}.zip", shapes(rows[0]), [("u", ArrayType(element, len(actions[0])))])
    for step, (row, action) in enumerate(zip(rows, actions, strict=True)):
        if step % 8 == 0:
            policy.reset(0)
        given = {n: np.array(x) for n, x in row.items()}
        assert policy.step(SimpleNamespace(**given))[0] == pytest.approx(action, abs=3e-6)
    assert len({tuple(a) for a in actions}) > 1


def test_what_is_remembered_is_forgotten_at_the_start_of_an_episode() -> None:
    row = {n: np.array(x) for n, x in KINDS["recurrent"]["observations"][0].items()}
    policy = loaded("recurrent.zip", shapes(row), [("u", ArrayType(NUMBER, 2))])
    policy.reset(0)
    first, second = (policy.step(SimpleNamespace(**row)) for _ in range(2))
    policy.reset(0)
    assert policy.step(SimpleNamespace(**row)) == first != second


def test_observations_by_name_go_to_their_names_and_to_no_other() -> None:
    both = RecordType((("gear", WHOLE), ("speed", ArrayType(NUMBER, 2))), "Seen")
    writes = [("u", ArrayType(NUMBER, 2))]
    seen = SimpleNamespace(gear=2, speed=np.array([1.0, -1.0]))
    apart = loaded("recurrent.zip", [("speed", both.fields[1][1]), ("gear", WHOLE)], writes)
    together = loaded("recurrent.zip", [("seen", both)], writes)
    assert apart.step(seen) == together.step(SimpleNamespace(seen=seen))
    for reads, said in (
        ([("velocity", ArrayType(NUMBER, 2)), ("gear", WHOLE)], "it observes `gear` (1 number)"),
        ([("speed", ArrayType(NUMBER, 3)), ("gear", WHOLE)], "its `speed` is 2 numbers"),
        ([("x", ArrayType(NUMBER, 3))], "the node reads `x`"),
    ):
        with pytest.raises(SoterError) as caught:
            loaded("recurrent.zip", reads, writes)
        assert said in caught.value.diagnostics[0].message


def test_a_number_that_is_none_of_several_is_a_step_fault() -> None:
    policy = loaded("maskable.zip", [("seen", ArrayType(WHOLE, 2))], [("u", ArrayType(WHOLE, 2))])
    for bad in ([3, 0], [0, -1], [0.5, 0]):
        with pytest.raises(ValueError, match="takes a whole number below"):
            policy.step(SimpleNamespace(seen=np.array(bad)))


@pytest.mark.parametrize(
    "place",
    ["ppo_vecnormalize.pkl", "ppo/vecnormalize.pkl", "vecnormalize.pkl", "vec_normalize.pkl"],
)
def test_statistics_beside_a_policy_are_found_and_said(tmp_path: Path, place: str) -> None:
    shutil.copy(FILES / "ppo.zip", tmp_path)
    statistics = tmp_path / place
    statistics.parent.mkdir(exist_ok=True)
    shutil.copy(FILES / "ppo_vecnormalize.pkl", statistics)
    read = read_sb3(tmp_path / "ppo.zip")
    assert isinstance(read.network.layers[0], Standardised)
    assert read.assumed == (f"observations are normalised by `{place}`, found beside it",)
    binding = binding_of("sb3:ppo.zip")
    assert binding is not None
    assert str(statistics) in sha256_of_files(binding.in_folder(tmp_path))
    without = binding_of("sb3:ppo.zip:none")
    assert without is not None
    assert set(sha256_of_files(without.in_folder(tmp_path))) == {str(tmp_path / "ppo.zip")}


def test_statistics_of_a_checkpoint_go_before_those_of_the_folder(tmp_path: Path) -> None:
    shutil.copy(FILES / "ppo.zip", tmp_path / "rl_model_800_steps.zip")
    own = tmp_path / "rl_model_vecnormalize_800_steps.pkl"
    for path in (own, tmp_path / "vecnormalize.pkl"):
        shutil.copy(FILES / "ppo_vecnormalize.pkl", path)
    assert read_sb3(tmp_path / "rl_model_800_steps.zip").beside == own
    own.unlink()
    shutil.copy(FILES / "ppo_vecnormalize.pkl", tmp_path / "vec_normalize.pkl")
    with pytest.raises(SoterError) as caught:
        read_sb3(tmp_path / "rl_model_800_steps.zip")
    (problem,) = caught.value.diagnostics
    assert "`vecnormalize.pkl` and `vec_normalize.pkl` lie beside it" in problem.message
    assert any(":none" in text for text in problem.helps)


REFUSED: dict[str, Any] = {
    "images": (
        lambda s: change_pickle(
            s, "observation_space", lambda _: pickle.dumps(spaces.Box(0, 255, (3, 8, 8), np.uint8))
        ),
        "images of shape (3, 8, 8)",
    ),
    "a CNN": (
        lambda s: change_pickle(
            s, "policy_class", lambda p: renamed(p, "ActorCriticPolicy", "ActorCriticCnnPolicy")
        ),
        "its policy class is `stable_baselines3.common.policies.ActorCriticCnnPolicy`",
    ),
    "an activation": (
        lambda s: change_pickle(s, "policy_kwargs", lambda p: renamed(p, "ReLU", "PReLU")),
        "its activation is `torch.nn.modules.activation.PReLU`",
    ),
    "a start": (
        lambda s: change_pickle(
            s, "action_space", lambda _: pickle.dumps(spaces.Discrete(1, start=1))
        ),
        "does not begin at 0",
    ),
    "a truth that is a number": (
        lambda s: change_pickle(
            s, "policy_kwargs", lambda _: pickle.dumps({"net_arch": [8], "squash_output": 1})
        ),
        "its `squash_output` is neither True nor False",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_refused_with_a_way_out(tmp_path: Path, name: str) -> None:
    change, said = REFUSED[name]
    (tmp_path / "p.zip").write_bytes(changed("ppo.zip", change))
    with pytest.raises(SoterError) as caught:
        read_sb3(tmp_path / "p.zip")
    (problem,) = caught.value.diagnostics
    assert (problem.code, said in problem.message) == ("X014", True)
    assert any("export it as ONNX" in text for text in problem.helps)


@pytest.mark.parametrize("name", ["recurrent", "maskable", "ppo_sde"])
def test_what_is_not_written_as_a_function_says_what_to_do(name: str) -> None:
    policy = read_sb3(FILES / f"{name}.zip")
    with pytest.raises(SoterError) as caught:
        soter_source(policy, [])
    assert "`extern` in the program" in caught.value.diagnostics[0].helps[0]
    zeros = np.zeros(policy.network.inputs)
    assert np.isinf(error_bound(policy.network, zeros, zeros)).all()


def test_activations_are_their_formulas() -> None:
    """At numbers that people can work out; torch's own are in decision 368."""
    at = np.array([-2.0, 0.0, 3.0], np.float32)
    wanted = {
        "ELU": [np.expm1(-2.0), 0.0, 3.0],
        "LeakyReLU": [-0.02, 0.0, 3.0],
        "ReLU6": [0.0, 0.0, 3.0],
        "Sigmoid": [1.0 / (1.0 + np.exp(2.0)), 0.5, 1.0 / (1.0 + np.exp(-3.0))],
        "SiLU": [-2.0 / (1.0 + np.exp(2.0)), 0.0, 3.0 / (1.0 + np.exp(-3.0))],
        "Softplus": [np.log1p(np.exp(-2.0)), np.log(2.0), np.log1p(np.exp(3.0))],
        "Softsign": [-2.0 / 3.0, 0.0, 0.75],
        "GELU": [-0.0455003, 0.0, 2.9959502],
    }
    for name, numbers in wanted.items():
        network = Network(3, (Activation(name),))
        assert last_layer_numbers(network, at).tolist() == pytest.approx(numbers, abs=1e-6)


def test_a_cell_keeps_what_it_is_told_to() -> None:
    """Gates that are open or shut: what is new is added to what is kept."""
    open_, shut = 50.0, -50.0
    weight = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], np.float32)
    for forget, wanted in ((open_, [np.tanh(0.5), 2.0 * np.tanh(0.5)]), (shut, [np.tanh(0.5)] * 2)):
        bias = np.array([open_, forget, 0.0, open_], np.float32)
        one = Affine(np.ones((1, 1), np.float32), np.zeros(1, np.float32))
        given, run, reset = prepare_network(Network(1, (Lstm(weight, bias), one)))
        for _ in range(2):
            reset()
            given[:] = 0.5
            told = [float(run()[0]) for _ in range(2)]
            assert told == pytest.approx(np.tanh(wanted).tolist(), abs=1e-6)


def hostile_space(made: Any) -> Any:
    return lambda s: change_pickle(s, "observation_space", lambda _: pickle.dumps(made))


def bits_of(count: int) -> spaces.MultiBinary:
    space = spaces.MultiBinary(2)
    space.n = count
    return space


HOSTILE: dict[str, tuple[Any, str]] = {
    "bits without end": (hostile_space(bits_of(10**12)), "or too many"),
    "no bits": (hostile_space(bits_of(-1)), "or too many"),
    "a name of control characters": (
        hostile_space(spaces.Dict({"a\x1b[2J": spaces.Discrete(2)})),
        "is no name",
    ),
    "names in names": (
        hostile_space(spaces.Dict({"a": spaces.Dict({"b": spaces.Discrete(2)})})),
        "`a` is by name again",
    ),
    "another count": (hostile_space(spaces.MultiDiscrete([3, 4])), "takes 2 numbers, and is given"),
    "a tuple": (hostile_space(spaces.Tuple([spaces.Discrete(2)])), "its observation space is a"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_spaces_say_is_not_believed(tmp_path: Path, name: str) -> None:
    change, said = HOSTILE[name]
    (tmp_path / "p.zip").write_bytes(changed("ppo.zip", change))
    with pytest.raises(SoterError) as caught:
        read_sb3(tmp_path / "p.zip")
    (problem,) = caught.value.diagnostics
    assert (problem.code, said in problem.message) == ("X014", True)


def renamed_tensor(old: str, new: str) -> Any:
    """In the names of all tensors of a file; of one length, as pickles say it."""

    def change(parts: dict[str, bytes]) -> None:
        (name,) = [n for n in parts if n.endswith("data.pkl")]
        assert old.encode() in parts[name]
        assert len(old) == len(new)
        parts[name] = parts[name].replace(old.encode(), new.encode())

    return change


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("lstm_actor.bias_hh_l0", "lstm_actor.bias_xx_l0", "no numbers `lstm_actor.bias_hh_l0`"),
        ("lstm_actor.weight_ih_l1", "lstm_actor.weight_ii_l1", "other numbers than read here"),
        ("lstm_actor.weight_hh_l0", "lstm_actor.bias_ih_l000", "no numbers `lstm_actor.weight_hh"),
        ("value_net.bias", "value_net.xxxx", ""),
        ("mlp_extractor.value_net.0", "pi_features_extractor.x.0", "layers of their own"),
    ],
)
def test_tensors_that_are_not_those_of_the_class_are_refused(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    data = changed("recurrent.zip", tensors=renamed_tensor(old, new))
    (tmp_path / "p.zip").write_bytes(data)
    if not said:
        read_sb3(tmp_path / "p.zip", FILES / "recurrent_vecnormalize.pkl")  # of the critic alone
        return
    with pytest.raises(SoterError) as caught:
        read_sb3(tmp_path / "p.zip")
    assert said in caught.value.diagnostics[0].message
