"""ONNX files that remember, take several observations, or are to be clipped."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from policy_files import onnx_of, random_layers  # type: ignore[import-not-found]
from test_policy_nodes import loaded  # type: ignore[import-not-found]

from soter.diagnostics.diagnostic import SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.types import ArrayType, FloatType
from soter.policy.policy_extern import load_policy

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")

NUMBER = FloatType()


def sums(states: Sequence[tuple[str, str]], size: int = 2) -> bytes:
    """Answers the observation plus all states; each state becomes itself plus 1, 2, ... times it.

    `states`: names of an input and of the output that is its next value.
    """
    from onnx import TensorProto, helper, numpy_helper

    def value(name: str) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size])

    nodes, constants, at = [], [], "obs"
    for k, (before, after) in enumerate(states, 1):
        constants.append(numpy_helper.from_array(np.array([[k]], np.float32), f"k{k}"))
        nodes += [
            helper.make_node("Mul", ["obs", f"k{k}"], [f"m{k}"]),
            helper.make_node("Add", [f"m{k}", before], [after]),
            helper.make_node("Add", [at, before], [f"a{k}"]),
        ]
        at = f"a{k}"
    nodes.append(helper.make_node("Identity", [at], ["act"]))
    ends = [value(after) for _, after in states]
    inputs = [value("obs"), *(value(before) for before, _ in states)]
    graph = helper.make_graph(nodes, "g", inputs, [value("act"), *ends[::-1]], constants)
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    return bytes(made.SerializeToString())


def policy(folder: Path, data: bytes, said: str = "", reads: Any = None, writes: Any = None) -> Any:
    (folder / "p.onnx").write_bytes(data)
    binding = binding_of(f"onnx:p.onnx{said}")
    assert binding is not None
    two = ArrayType(NUMBER, 2)
    return load_policy(
        binding.in_folder(folder), reads or [("x", two)], writes or [("u", two)], None
    )


FOUND = [
    [("h_in", "h_out")],
    [("h_in", "h_out"), ("c_in", "c_out")],
    [("h0", "hn"), ("c0", "cn")],
    [("h_0", "h_n")],
    [("state_in_0", "state_out_0"), ("state_in_1", "state_out_1")],
    [("hidden", "next_hidden")],
    [("lstm.h", "lstm.h.new"), ("lstm.c", "lstm.c.new")],
    [("recurrent_in", "recurrent_out")],
]
NOT_FOUND = [
    [("a", "b")],
    [("h_in", "h_out"), ("h_prev", "h_next")],
    [("h_in", "next_state")],
    [("h", "c_out"), ("c", "x_out")],
]


def answers(made: Any, states: int) -> None:
    """Two episodes: what is added up, and begins with zeros."""
    factor = sum(range(1, states + 1))
    for _ in range(2):
        made.reset(0)
        total = np.zeros(2)
        for x in ([1.0, -2.0], [0.5, 3.0], [2.0, 0.25]):
            told = made.step(SimpleNamespace(x=np.array(x)))[0]
            assert list(told) == (np.array(x) + factor * total).tolist()
            total += x


@pytest.mark.parametrize("states", FOUND, ids=lambda s: s[0][0])
def test_what_is_remembered_is_found_by_names_and_said(tmp_path: Path, states: Any) -> None:
    made = policy(tmp_path, sums(states))
    answers(made, len(states))
    told = ", ".join(f"`{before}` is what `{after}` was" for before, after in states)
    assert any(told in text for text in made.assumed)


def test_what_is_no_function_names_the_way_in_which_it_runs(tmp_path: Path) -> None:
    """`soter policy` writes functions; a policy that remembers is bound as it is."""
    from soter.policy.onnx_file import read_onnx

    (tmp_path / "p.onnx").write_bytes(sums([("h_in", "h_out")]))
    with pytest.raises(SoterError) as caught:
        read_onnx(tmp_path / "p.onnx")
    (problem,) = caught.value.diagnostics
    found = re.search(r'from "([^"]+)"', problem.helps[0])
    assert (problem.code, found is not None) == ("X014", True)
    assert found is not None
    run = loaded(tmp_path, found[1], "topic push: float[2];", "push", reads="goal").simulate()
    assert len(set(map(tuple, run.array("push").tolist()))) > 5


@pytest.mark.parametrize("states", NOT_FOUND, ids=lambda s: s[0][0])
def test_other_names_are_said_by_the_program(tmp_path: Path, states: Any) -> None:
    with pytest.raises(SoterError) as caught:
        policy(tmp_path, sums(states))
    (problem,) = caught.value.diagnostics
    assert (problem.code, any("h0=hn" in text for text in problem.helps)) == ("X014", True)
    pairs = ",".join(f"{before}={after}" for before, after in states)
    answers(policy(tmp_path, sums(states), f":{pairs}"), len(states))
    with pytest.raises(SoterError, match="is no input and output of it"):
        policy(tmp_path, sums(states), ":gone=b")


def test_the_answer_before_may_be_an_input(tmp_path: Path) -> None:
    """`action` stays the answer; what is fed back is said, as an input of that name may be read."""
    from onnx import TensorProto, helper

    values = [
        helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 2])
        for n in ("obs", "last_action", "action")
    ]
    node = helper.make_node("Add", ["obs", "last_action"], ["action"])
    graph = helper.make_graph([node], "g", values[:2], values[2:])
    opset = [helper.make_opsetid("", 17)]
    data = helper.make_model(graph, opset_imports=opset, ir_version=9).SerializeToString()
    with pytest.raises(SoterError, match=r"it observes `obs` .*, `last_action` .* by name"):
        policy(tmp_path, data)
    made = policy(tmp_path, data, ":last_action=action")
    made.reset(0)
    row = SimpleNamespace(x=np.array([1.0, 2.0]))
    assert [made.step(row)[0] for _ in range(3)] == [(1.0, 2.0), (2.0, 4.0), (3.0, 6.0)]


def test_observations_by_name_are_topics_in_any_order(tmp_path: Path) -> None:
    from onnx import TensorProto, helper

    parts = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 1]) for n in ("pose", "goal")]
    answer = helper.make_tensor_value_info("u", TensorProto.FLOAT, [1, 2])
    node = helper.make_node("Concat", ["pose", "goal"], ["u"], axis=1)
    graph = helper.make_graph([node], "g", parts, [answer])
    opset = [helper.make_opsetid("", 17)]
    data = helper.make_model(graph, opset_imports=opset, ir_version=9).SerializeToString()
    for reads in ([("pose", NUMBER), ("goal", NUMBER)], [("goal", NUMBER), ("pose", NUMBER)]):
        made = policy(tmp_path, data, reads=reads)
        assert made.step(SimpleNamespace(pose=1.0, goal=2.0)) == ((1.0, 2.0),)
    with pytest.raises(SoterError, match=r"it observes `pose` \(1 number\), `goal` \(1 number\)"):
        policy(tmp_path, data, reads=[("x", ArrayType(NUMBER, 2))])


@pytest.mark.parametrize("apart", [False, True])
def test_an_answer_is_clipped_where_the_program_says_so(tmp_path: Path, *, apart: bool) -> None:
    (tmp_path / "p.onnx").write_bytes(
        onnx_of(random_layers(1, 5, 16, 1), "Tanh").SerializeToString()
    )
    topics = "topic push: float in [-0.1, 0.1];"
    runs = {
        said: loaded(tmp_path, f"onnx:p.onnx{said}", topics).simulate(apart=apart)
        for said in ("", ":clip")
    }
    assert runs[""].violations > 0
    assert runs[":clip"].violations == 0
    push = runs[":clip"].array("push")
    assert (push.min(), push.max()) == (-0.1, 0.1)


def test_what_is_too_large_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SoterError, match="it observes 2000000 numbers, more than are read"):
        policy(tmp_path, sums([("h_in", "h_out")], 2_000_000), reads=[("x", ArrayType(NUMBER, 2))])
