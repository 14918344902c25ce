"""ONNX files as layers answer what onnxruntime answers; what they hold else is refused."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from policy_files import onnx_of, random_layers  # type: ignore[import-not-found]

from soter.diagnostics.diagnostic import SoterError
from soter.policy.network import last_layer_numbers
from soter.policy.soter_source import error_bound
from soter.version import pip_command

if TYPE_CHECKING:
    from pathlib import Path

ENDINGS: dict[str, list[tuple[str, dict[str, Any]]]] = {
    "numbers": [],
    "shapes": [("Flatten", {"axis": 1}), ("Identity", {}), ("Cast", {"to": 1})],
    "activation": [("Tanh", {}), ("Relu", {})],
    "choice": [("ArgMax", {"axis": -1, "keepdims": 1})],
}
REFUSED: dict[str, tuple[tuple[str, dict[str, Any]], str]] = {
    "rows": (("Flatten", {"axis": 2}), "makes several rows"),
    "whole numbers": (("Cast", {"to": 7}), "its Cast is not to float32"),
    "other axis": (("ArgMax", {"axis": 0}), "is not of the last axis"),
    "last of equals": (("ArgMax", {"axis": 1, "select_last_index": 1}), "the last of equal"),
    "unread": (("Softplus", {}), "it has the operator Softplus"),
}


@pytest.fixture(autouse=True)
def _extra() -> None:
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")


def file_of(folder: Path, model: Any) -> Path:
    path = folder / "policy.onnx"
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("activation", ["Tanh", "Relu"])
def test_layers_are_what_onnxruntime_runs(tmp_path: Path, activation: str, ending: str) -> None:
    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    model = onnx_of(random_layers(4, 3, 16, 5), activation, ENDINGS[ending])
    path = file_of(tmp_path, model)
    network, session = read_onnx(path).network, OnnxSession(path)
    assert bool(network.choices) == session.is_whole == (ending == "choice")
    rng = np.random.default_rng(1)
    for _ in range(100):
        x = rng.uniform(-4.0, 4.0, 3)
        session.observation[:] = x
        mine = last_layer_numbers(network, x.astype(np.float32))
        if network.choices:
            assert session.run() == [int(mine.argmax())]
        else:
            assert (np.abs(session.run() - mine) <= 2.0 * error_bound(network, x, x)).all()


def test_arithmetic_with_constants_is_read_and_run(tmp_path: Path) -> None:
    from onnx import TensorProto, helper, numpy_helper

    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    rng = np.random.default_rng(2)
    arrays = {
        "mean": rng.normal(size=4),
        "scale": rng.uniform(0.5, 2.0, (1, 4)),
        "W": rng.normal(size=(4, 3)),
        "b": rng.normal(size=3),
        "two": np.array(2.0),
        "low": np.array(-1.5),
        "high": np.array(1.25),
    }
    said = [
        ("Sub", "obs mean"), ("Div", "- scale"), ("MatMul", "- W"), ("Add", "b -"),
        ("Mul", "- two"), ("Clip", "- low high"),
    ]  # fmt: skip
    nodes, at = [], "obs"
    for k, (operator, names) in enumerate(said):
        nodes.append(helper.make_node(operator, names.replace("-", at).split(), [f"h{k}"]))
        at = f"h{k}"
    constants = [numpy_helper.from_array(a.astype(np.float32), n) for n, a in arrays.items()]
    values = [
        helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, size])
        for n, size in (("obs", 4), (at, 3))
    ]
    graph = helper.make_graph(nodes, "p", values[:1], values[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path = file_of(tmp_path, model)
    network, session = read_onnx(path).network, OnnxSession(path)
    for _ in range(100):
        x = rng.uniform(-4.0, 4.0, 4)
        session.observation[:] = x
        distance = np.abs(session.run() - last_layer_numbers(network, x.astype(np.float32)))
        assert (distance <= 2.0 * error_bound(network, x, x)).all()


def expanded(shape: list[int], of: list[int]) -> Any:
    """As torch traces a policy: the mean is broadcast, and a constant of `of` to 2 numbers."""
    from onnx import TensorProto, helper, numpy_helper

    sizes = {"shape": np.array(shape, np.int64), "of": np.array(of, np.int64)}
    arrays: dict[str, Any] = {
        **sizes,
        "W": np.array([[1.0, -2.0]], np.float32),
        "k": np.array([0.5], np.float32),
    }
    nodes = [
        helper.make_node("MatMul", ["obs", "W"], ["mean"]),
        helper.make_node("Expand", ["mean", "shape"], ["loc"]),
        helper.make_node("Expand", ["k", "of"], ["scale"]),
        helper.make_node("Mul", ["loc", "scale"], ["act"]),
    ]
    constants = [numpy_helper.from_array(a, n) for n, a in arrays.items()]
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, None) for n in ("obs", "act")]
    ends[0] = helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, 1])
    graph = helper.make_graph(nodes, "p", ends[:1], ends[1:], constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def test_a_broadcast_by_constants_is_read(tmp_path: Path) -> None:
    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    for shape, of in (([1, 2], [1, 2]), ([1], [2]), ([1, 1], [1])):
        path = file_of(tmp_path, expanded(shape, of))
        network, session = read_onnx(path).network, OnnxSession(path)
        for x in (-3.0, 0.25, 7.0):
            session.observation[:] = x
            assert session.run() == last_layer_numbers(network, np.array([x], np.float32)).tolist()


@pytest.mark.parametrize(
    ("shape", "of", "said"),
    [
        ([3, 2], [1, 2], "its Expand makes more numbers of one observation"),
        ([1, 2], [4, 2], "one number each is read"),
        ([1, 2], [2**40, 2], "its Expand makes more than 1,048,576 numbers"),
        ([1, 2], [-1, 2], ""),
    ],
)
def test_other_broadcasts_are_refused(
    tmp_path: Path, shape: list[int], of: list[int], said: str
) -> None:
    from soter.policy.onnx_file import read_onnx

    with pytest.raises(SoterError) as caught:
        read_onnx(file_of(tmp_path, expanded(shape, of)))
    (problem,) = caught.value.diagnostics
    assert (problem.code, said in problem.message) == ("X014", True)


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_chain_of_layers_is_refused_with_its_operator(tmp_path: Path, name: str) -> None:
    from soter.policy.onnx_file import read_onnx

    ending, said = REFUSED[name]
    with pytest.raises(SoterError) as caught:
        read_onnx(file_of(tmp_path, onnx_of(random_layers(1, 2, 3), "Relu", [ending])))
    (problem,) = caught.value.diagnostics
    assert problem.code == "X014"
    assert said in problem.message


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_a_package_that_is_absent_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str
) -> None:
    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    path = file_of(tmp_path, onnx_of(random_layers(1, 2, 3), "Relu"))
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(SoterError) as caught:
        (read_onnx if package == "onnx" else OnnxSession)(path)
    (problem,) = caught.value.diagnostics
    assert (problem.code, f"`{package}`" in problem.message) == ("D007", True)
    assert problem.helps == (f"install it: {pip_command('learn')}",)
