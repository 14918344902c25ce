"""A path in a file is relative to that file: the current folder has others of the same names.

Each format that names files is made twice, in `a` and with other numbers in `b`. What `a` says
when the command is started in `b` is what it says in `a`, and not what `b` says.
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.mapping.read_mapping import make_log_map, read_mapping
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

FILES = Path(__file__).resolve().parents[1] / "policy" / "files"

RUNS = """soter 1;
{before}
topic x: float;
topic u: float;
plant P period 100ms {{ reads u; drives x = p; state p: float = 1.0; der p = {rate}; }}
{node}
system S default {{ p: P; node L; until 1s; }}
"""
CODE = "node L period 100ms { subscribes x; publishes u; step { publish u = x; } }"
EXTERN = 'extern node L period 100ms from "%s" { subscribes x; publishes u; }'
EXTERN_C = """
extern fun gain(x: float): float from "c:gain.c:gain";
node L period 100ms { subscribes x; publishes u; step { publish u = gain(x); } }
"""
GAIN_C = """#include "gain.h"
double gain(double x) { return GAIN * x; }
"""


def _program(
    folder: Path, *, before: str = "", rate: str = "u", node: str = CODE, name: str = "p.soter"
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = RUNS.format(before=before, rate=rate, node=node)
    (folder / name).write_text(text, encoding="utf-8")


def _import(folder: Path, gain: float) -> None:
    _program(folder, before='import "lib/one.soter" as one;', rate="one.two.GAIN * u")
    (folder / "lib").mkdir()
    (folder / "lib" / "one.soter").write_text('soter 1;\nimport "two.soter" as two;\n')
    (folder / "lib" / "two.soter").write_text(f"soter 1;\nconst GAIN: float = {gain};\n")
    _program(folder, before='import "lib/two.soter" as two;', rate="two.GAIN * u")


def _data(end: str, content: Callable[[float], bytes]) -> Callable[[Path, float], None]:
    def make(folder: Path, gain: float) -> None:
        given = f'const GAINS: float[1] = data "gains.{end}";'
        _program(folder, before=given, rate="GAINS[0] * u")
        (folder / f"gains.{end}").write_bytes(content(gain))

    return make


def _npy(gain: float) -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array([gain]))
    return stream.getvalue()


def _imported_data(folder: Path, gain: float) -> None:
    """A file that an imported file names lies beside the imported one."""
    _program(folder, before='import "lib/lib.soter" as lib;', rate="lib.GAINS[0] * u")
    (folder / "lib").mkdir()
    text = 'soter 1;\nconst GAINS: float[1] = data "gains.json";\n'
    (folder / "lib" / "lib.soter").write_text(text)
    (folder / "lib" / "gains.json").write_text(f"[{gain}]")


def _python(folder: Path, gain: float) -> None:
    _program(folder, node=EXTERN % "python:l.py:L")
    text = "from gain_of_l import GAIN\n\ndef L(inputs):\n    return GAIN * inputs.x\n"
    (folder / "l.py").write_text(text)
    (folder / "gain_of_l.py").write_text(f"GAIN = {gain}\n")


def _c(folder: Path, gain: float) -> None:
    _program(folder, node=EXTERN_C)
    (folder / "gain.c").write_text(GAIN_C)
    (folder / "gain.h").write_text(f"#define GAIN {gain}\n")


def _model(gain: float) -> Any:
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")
    from onnx import TensorProto, helper, numpy_helper

    weight = numpy_helper.from_array(np.full((1, 1), gain, np.float32), "W")
    node = helper.make_node("MatMul", ["obs", "W"], ["action"])
    ends = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 1]) for n in ("obs", "action")]
    graph = helper.make_graph([node], "policy", ends[:1], ends[1:], [weight])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def _onnx(folder: Path, gain: float) -> None:
    _program(folder, node=EXTERN % "onnx:policy.onnx")
    (folder / "policy.onnx").write_bytes(_model(gain).SerializeToString())


def _onnx_beside(folder: Path, gain: float) -> None:
    """The ONNX file in another folder than the program, its weights in a third one."""
    import onnx

    _program(folder, node=EXTERN % "onnx:nets/policy.onnx")
    (folder / "nets" / "weights").mkdir(parents=True)
    model = _model(gain)
    (folder / "nets" / "weights" / "W.bin").write_bytes(
        b"\0" * 8 + model.graph.initializer[0].raw_data
    )
    onnx.external_data_helper.set_external_data(
        model.graph.initializer[0], "weights/W.bin", offset=8, length=4
    )
    model.graph.initializer[0].ClearField("raw_data")
    (folder / "nets" / "policy.onnx").write_bytes(model.SerializeToString())


def _sb3(folder: Path, gain: float) -> None:
    """One number is read, three frames of it are stacked."""
    _program(folder, node=EXTERN % "sb3:policy.zip")
    shutil.copy(FILES / ("sac.zip" if gain == 1.0 else "td3.zip"), folder / "policy.zip")


def _statistics(folder: Path, gain: float) -> None:
    """The same zip, other statistics of observations."""
    from soter.policy.sb3_statistics import _statistics_layer, _vecnormalize_state

    _program(folder, node=EXTERN % "sb3:policy.zip:norm.pkl")
    shutil.copy(FILES / "ppo.zip", folder / "policy.zip")
    pickled_file = FILES / "ppo_vecnormalize.pkl"
    known = _statistics_layer(pickled_file, _vecnormalize_state(pickled_file), ())
    mean = known.mean.tobytes()
    pickled = pickled_file.read_bytes()
    assert pickled.count(mean) == 1
    pickled = pickled.replace(mean, (known.mean + gain).tobytes())
    (folder / "norm.pkl").write_bytes(pickled)


RUN: dict[str, Callable[[Path, float], None]] = {
    "import": _import,
    "json": _data("json", lambda gain: f"[{gain}]".encode()),
    "csv": _data("csv", lambda gain: f"{gain}\n".encode()),
    "npy": _data("npy", _npy),
    "data of an import": _imported_data,
    "python": _python,
    "c": _c,
    "onnx": _onnx,
    "onnx beside": _onnx_beside,
    "sb3": _sb3,
    "statistics": _statistics,
}


@all_rows("engine", ["native", "interp"])
@all_rows("name", RUN)
def test_files_of_a_program_are_those_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, engine: str
) -> None:
    for folder, gain in (("a", 1.0), ("b", 2.0)):
        RUN[name](tmp_path / folder, gain)

    def flown(start: str, program: str) -> str | None:
        monkeypatch.chdir(tmp_path / start)
        return soter.load(program).simulate(engine=engine).trace_sha256

    own = flown("a", "p.soter")
    assert flown("b", "../a/p.soter") == own == flown(".", "a/p.soter")
    assert flown("b", "p.soter") != own
    for away in (tmp_path / "b").iterdir():
        shutil.rmtree(away) if away.is_dir() else away.unlink()
    assert flown("b", "../a/p.soter") == own


def test_definitions_of_messages_are_those_beside_the_mapping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder, kind in (("a", "float32"), ("b", "string")):
        _program(tmp_path / folder)
        (tmp_path / folder / "msg").mkdir()
        (tmp_path / folder / "msg" / "Foo.msg").write_text(f"{kind} gust\n")
        (tmp_path / folder / "map.toml").write_text(
            '[messages]\n"my_msgs/Foo" = "msg/Foo.msg"\n'
            '[topics.x]\ntype = "my_msgs/Foo"\nfields = { value = "gust" }\n'
        )
    monkeypatch.chdir(tmp_path / "b")
    flat = soter.load("p.soter").flat("S", None)
    for folder in ("a", "b"):
        file = Path("..") / folder / "map.toml"
        if folder == "a":
            make_log_map(read_mapping(file), flat, file=file)
        else:
            with pytest.raises(soter.SoterError, match="string"):
                make_log_map(read_mapping(file), flat, file=file)
