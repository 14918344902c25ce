"""An ONNX file with its weights beside it: read from its own folder, or refused."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from policy_files import onnx_of, random_layers  # type: ignore[import-not-found]

import processes
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError
from soter.policy import onnx_file as content
from soter.policy.network import last_layer_numbers

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(autouse=True)
def _extra() -> None:
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")


def moved(
    model: Any, name: str = "weights", offset: int | None = None, length: int | None = None
) -> bytes:
    """The bytes of all constants, which the model then has in a file of that name."""
    from onnx.external_data_helper import set_external_data

    raw = b""
    for tensor in model.graph.initializer:
        start = len(raw) if offset is None else offset
        size = len(tensor.raw_data) if length is None else length
        set_external_data(tensor, name, start, size)
        raw += tensor.raw_data
        tensor.ClearField("raw_data")
    return raw


def refusal(path: Path) -> list[str]:
    """What both readers say, which is the same."""
    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    told = []
    for what in (read_onnx, OnnxSession):
        with pytest.raises(SoterError) as caught:
            what(path)
        (problem,) = caught.value.diagnostics
        assert problem.code == "X014"
        told.append(problem.message)
    assert told[0] == told[1]
    return told


def test_weights_beside_are_the_weights_inside(tmp_path: Path) -> None:
    """As layers and in onnxruntime; one file may have several constants, or each its own."""
    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    layers = random_layers(3, 4, 8, 2)
    model = onnx_of(layers, "Tanh")
    inside, beside = tmp_path / "inside.onnx", tmp_path / "beside.onnx"
    inside.write_bytes(model.SerializeToString())
    (tmp_path / "weights").write_bytes(moved(model))
    beside.write_bytes(model.SerializeToString())
    x = np.linspace(-2.0, 2.0, 4, dtype=np.float32)
    mine = [last_layer_numbers(read_onnx(p).network, x) for p in (inside, beside)]
    assert (mine[0] == mine[1]).all()
    said = []
    for path in (inside, beside):
        session = OnnxSession(path)
        session.observation[:] = x
        said.append(session.run())
    assert said[0] == said[1]


def test_a_constant_of_an_operator_may_lie_beside(tmp_path: Path) -> None:
    from onnx import helper

    from soter.policy.onnx_session import OnnxSession

    model = onnx_of(random_layers(3, 2, 2), "Relu")
    raw = moved(model)
    tensors = list(model.graph.initializer)
    del model.graph.initializer[:]
    for tensor in reversed(tensors):
        made = helper.make_node("Constant", [], [tensor.name], value=tensor)
        model.graph.node.insert(0, made)
    (tmp_path / "weights").write_bytes(raw)
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    session = OnnxSession(tmp_path / "p.onnx")
    session.observation[:] = 1.0
    weight, bias = random_layers(3, 2, 2)[0]
    assert np.allclose(session.run(), weight.sum(axis=1) + bias)


def _link(folder: Path) -> None:
    (folder.parent / "outside").write_bytes((folder / "weights").read_bytes())
    (folder / "weights").unlink()
    (folder / "weights").symlink_to(folder.parent / "outside")


def _fifo(folder: Path) -> None:
    (folder / "weights").unlink()
    os.mkfifo(folder / "weights")


def _folder(folder: Path) -> None:
    (folder / "weights").unlink()
    (folder / "weights").mkdir()


def _cut(folder: Path) -> None:
    (folder / "weights").write_bytes((folder / "weights").read_bytes()[:-1])


SPOILT: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda f: (f / "weights").unlink(), "there is no such file"),
    "a link that leads out": (_link, "is said to lie in"),
    "a pipe": (_fifo, "it is no ordinary file"),
    "a folder": (_folder, "it is a folder"),
    "cut": (_cut, "does not lie in `weights`, which has "),
}
NAMES = {
    "absolute": "/etc/passwd",
    "above": "../outside",
    "round about": "nets/../../outside",
    "an address": "*/_ORT_MEM_ADDR_/*",
    "none": "",
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_file_beside_that_is_not_as_said_is_refused(tmp_path: Path, name: str) -> None:
    spoil, said = SPOILT[name]
    (tmp_path / "own").mkdir()
    model = onnx_of(random_layers(3, 2, 3), "Relu")
    (tmp_path / "own" / "weights").write_bytes(moved(model))
    (tmp_path / "own" / "p.onnx").write_bytes(model.SerializeToString())
    spoil(tmp_path / "own")
    assert said in refusal(tmp_path / "own" / "p.onnx")[0]


@pytest.mark.parametrize("name", NAMES)
def test_files_outside_of_the_folder_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "own" / "nets").mkdir(parents=True)
    model = onnx_of(random_layers(3, 2, 3), "Relu")
    (tmp_path / "outside").write_bytes(moved(model, NAMES[name]))
    (tmp_path / "own" / "p.onnx").write_bytes(model.SerializeToString())
    monkeypatch.chdir(tmp_path / "own" / "nets")
    told = refusal(tmp_path / "own" / "p.onnx")[0]
    assert ("no such file" if name == "an address" else "is said to lie in") in told


@pytest.mark.parametrize("place", [(-8, None), (None, -1), (2**40, None)])
def test_a_place_that_is_not_in_the_file_is_refused(
    tmp_path: Path, place: tuple[int | None, int | None]
) -> None:
    model = onnx_of(random_layers(3, 2, 3), "Relu")
    (tmp_path / "weights").write_bytes(moved(model, "weights", *place))
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    assert "does not lie in `weights`" in refusal(tmp_path / "p.onnx")[0]


def test_many_constants_of_one_file_are_counted_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small file may not become a large one."""
    model = onnx_of(random_layers(3, 8, 8, 8), "Relu")
    (tmp_path / "weights").write_bytes(moved(model))
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    size = (tmp_path / "weights").stat().st_size
    monkeypatch.setattr(content, "FILE_MAX", size)
    assert content.onnx_content(tmp_path / "p.onnx").beside
    model = onnx_of(random_layers(3, 8, 8, 8), "Relu")
    moved(model, offset=0, length=size)
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    assert "larger than" in refusal(tmp_path / "p.onnx")[0]


def test_what_is_written_of_a_policy_names_the_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One bit of the file beside is another function, and another hash in its first lines."""
    model = onnx_of(random_layers(3, 2, 3), "Relu")
    raw = moved(model)
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    texts = []
    for data in (raw, raw[:-4] + np.float32(1.5).tobytes()):
        (tmp_path / "weights").write_bytes(data)
        assert main(["policy", "../p.onnx", "-o", "learned.soter"]) == 0
        texts.append((tmp_path / "elsewhere" / "learned.soter").read_text().splitlines())
    heads = [[x for x in text if x.startswith("// weights: in `weights`")] for text in texts]
    assert len(heads[0]) == len(heads[1]) == 1
    assert heads[0] != heads[1]


def layouts(folder: Path) -> dict[str, tuple[Path, float | None]]:
    """Files that are links, and the bias that they have: 1 beside the link, 2 beside its target.

    None: refused.
    """
    kept, blobs = folder / "kept", folder / "blobs"
    model = onnx_of([(np.zeros((1, 2), np.float32), np.zeros(1, np.float32))], "Relu")
    raw = moved(model)
    given = [raw[:-4] + np.float32(x).tobytes() for x in (1.0, 2.0)]
    for name in ("beside", "target", "both", "all", "blobs", "out", "kept"):
        (folder / name).mkdir()
    (kept / "p.onnx").write_bytes(model.SerializeToString())
    (blobs / "3f").write_bytes(model.SerializeToString())
    (blobs / "a7").write_bytes(given[0])
    for name in ("beside", "both", "all", "out", "target"):
        (folder / name / "p.onnx").symlink_to(kept / "p.onnx")
    for name in ("beside", "both"):
        (folder / name / "weights").write_bytes(given[0])
    (kept / "weights").write_bytes(given[1])
    (folder / "all" / "weights").symlink_to(kept / "weights")
    (folder / "elsewhere").write_bytes(given[0])
    (folder / "out" / "weights").symlink_to(folder / "elsewhere")
    (folder / "stored").mkdir()
    (folder / "stored" / "p.onnx").symlink_to("../blobs/3f")
    (folder / "stored" / "weights").symlink_to("../blobs/a7")
    (folder / "linked").symlink_to(kept)
    said = {"beside": 1.0, "both": 1.0, "all": 2.0, "stored": 1.0, "linked": 2.0}
    return {n: (folder / n / "p.onnx", said.get(n)) for n in (*said, "target", "out")}


LAYOUTS = ("beside", "both", "all", "stored", "linked", "target", "out")


@pytest.mark.parametrize("name", LAYOUTS)
def test_weights_of_a_link_are_those_beside_the_link(tmp_path: Path, name: str) -> None:
    """As named, and never those of another folder: what lies only beside the target is told."""
    from soter.policy.onnx_session import OnnxSession

    path, bias = layouts(tmp_path)[name]
    if bias is not None:
        assert OnnxSession(path).run() == [bias]
        return
    with pytest.raises(SoterError) as caught:
        OnnxSession(path)
    (problem,) = caught.value.diagnostics
    assert problem.code == "X014"
    told = f"bind `{(tmp_path / 'kept' / 'p.onnx').resolve()}`" in " ".join(problem.helps)
    assert told is (name == "target")


@pytest.mark.parametrize("where", ["beside the link", "beside the target"])
def test_a_program_that_is_a_link_names_what_lies_beside_the_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], where: str
) -> None:
    text = (
        "soter 1;\ninput topic a: float[2] = [0.0, 0.0];\ntopic u: float = 0.0;\n"
        'extern node N period 10ms from "onnx:p.onnx" { subscribes a; publishes u; }\n'
        "system S default { node N; until 20ms; }\n"
    )
    (tmp_path / "kept").mkdir()
    (tmp_path / "used").mkdir()
    (tmp_path / "kept" / "p.soter").write_text(text)
    (tmp_path / "used" / "p.soter").symlink_to(tmp_path / "kept" / "p.soter")
    folder = tmp_path / ("used" if where == "beside the link" else "kept")
    model = onnx_of(random_layers(3, 2, 1), "Relu")
    (folder / "weights").write_bytes(moved(model))
    (folder / "p.onnx").write_bytes(model.SerializeToString())
    monkeypatch.chdir(tmp_path)
    done = main(["run", "used/p.soter"])
    assert done == (0 if folder.name == "used" else 1)
    assert ("X003" in capfd.readouterr().err) is (folder.name == "kept")


def test_a_run_and_its_log_say_which_weights_flew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program's hash is the same; statistics of a zip and what C includes are of the kind."""
    from soter import load
    from soter.report.mcap_reading import log_metadata

    pytest.importorskip("mcap", reason="the extra is absent: soter-rta[logs]")
    monkeypatch.chdir(tmp_path)
    model = onnx_of(random_layers(3, 2, 1), "Relu")
    raw = moved(model)
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    (tmp_path / "p.soter").write_text(
        "soter 1;\ninput topic a: float[2] = [0.0, 0.0];\ntopic u: float = 0.0;\n"
        'extern node N period 10ms from "onnx:p.onnx" { subscribes a; publishes u; }\n'
        "system S default { node N; until 20ms; }\n"
    )
    said = []
    for k, data in enumerate((raw, raw[:-4] + np.float32(1.5).tobytes(), raw)):
        (tmp_path / "weights").write_bytes(data)
        assert main(["run", "p.soter", "--log", f"{k}.mcap"]) == 0
        run = load("p.soter").simulate()
        (files,) = run.extern_files.values()
        assert set(files) == {"p.onnx", "weights"}
        log = log_metadata(tmp_path / f"{k}.mcap")
        assert all(log[f"extern N sha256 {name}"] == sha for name, sha in files.items())
        said.append((files["p.onnx"], files["weights"], log["program_sha256"]))
    assert said[0] == said[2]
    assert [a == b for a, b in zip(said[0], said[1], strict=True)] == [True, False, True]


def test_what_a_c_file_includes_and_what_a_zip_is_normalised_by_are_said(tmp_path: Path) -> None:
    from soter.native.extern_bindings import file_hashes

    (tmp_path / "a.c").write_text('#include "gain.h"\n')
    told = []
    for gain in (1, 2):
        for name in ("gain.h", "a.zip", "a.pkl", "a.py"):
            (tmp_path / name).write_text(f"#define GAIN {gain}\n")
        at = str(tmp_path / "a")
        bound = (f"c:{at}.c:f", f"sb3:{at}.zip:{at}.pkl", f"python:{at}.py:f")
        told.append([file_hashes(text) for text in bound])
    assert [len(files) for files in told[0]] == [2, 2, 1]
    assert all(a != b for a, b in zip(*told, strict=True))
    assert file_hashes(None) == file_hashes(len) == {}


@pytest.mark.parametrize("inside", [False, True])
def test_a_loop_is_refused_as_it_need_not_end(tmp_path: Path, inside: bool) -> None:
    """2^62 turns: a run waits for what answers it. Also where it stands in a branch."""
    from onnx import TensorProto, helper

    from soter.policy.onnx_session import OnnxSession

    def info(name: str, kind: int, shape: list[Any] | None) -> Any:
        return helper.make_tensor_value_info(name, kind, shape)

    number, truth, whole = TensorProto.FLOAT, TensorProto.BOOL, TensorProto.INT64
    again = [helper.make_node("Identity", [a], [b]) for a, b in (("go", "on"), ("x", "y"))]
    inputs = [info("i", whole, []), info("go", truth, []), info("x", number, None)]
    body = helper.make_graph(
        again, "body", inputs, [info("on", truth, []), info("y", number, None)]
    )
    turns = helper.make_node(
        "Constant", [], ["N"], value=helper.make_tensor("n", whole, [], [2**62])
    )
    nodes = [turns, helper.make_node("Loop", ["N", "", "obs"], ["u"], body=body)]
    if inside:
        branch = helper.make_graph(nodes, "branch", [], [info("u", number, None)])
        yes = helper.make_tensor("c", truth, [], [True])
        nodes = [
            helper.make_node("Constant", [], ["C"], value=yes),
            helper.make_node("If", ["C"], ["u"], then_branch=branch, else_branch=branch),
        ]
    graph = helper.make_graph(
        nodes, "policy", [info("obs", number, ["batch", 2])], [info("u", number, None)]
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(SoterError) as caught:
        OnnxSession(tmp_path / "p.onnx")
    assert "the operator Loop" in caught.value.diagnostics[0].message


@pytest.mark.skipif(sys.platform != "linux", reason="of /proc")
def test_a_graph_that_asks_for_gigabytes_is_refused(
    tmp_path: Path,
) -> None:
    """The file has a few hundred bytes; what it computes has 3 GiB on the way."""
    from onnx import TensorProto, helper

    shape = helper.make_tensor("n", TensorProto.INT64, [1], [3 * 2**28])
    graph = helper.make_graph(
        [
            helper.make_node("Constant", [], ["N"], value=shape),
            helper.make_node("ConstantOfShape", ["N"], ["zeros"]),
            helper.make_node("ReduceSum", ["zeros"], ["zero"], keepdims=0),
            helper.make_node("Add", ["obs", "zero"], ["u"]),
        ],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["batch", 1])],
        [helper.make_tensor_value_info("u", TensorProto.FLOAT, None)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    (tmp_path / "p.onnx").write_bytes(model.SerializeToString())
    (tmp_path / "p.soter").write_text(
        "soter 1;\ninput topic a: float = 0.0;\ntopic u: float = 0.0;\n"
        'extern node N period 10ms from "onnx:p.onnx" { subscribes a; publishes u; }\n'
        "system S default { node N; until 20ms; }\n"
    )
    command = [sys.executable, "-m", "soter.cli.main", "run", "p.soter"]
    done = processes.run(command, cwd=tmp_path, capture_output=True)
    assert (done.returncode, b"X014" in done.stderr) == (1, True), done.stderr
