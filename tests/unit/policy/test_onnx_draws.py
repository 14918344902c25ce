"""An ONNX file whose answer is drawn is refused wherever in it the draw stands."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.named_files import binding_of
from soter.language.model.types import ArrayType, FloatType
from soter.policy.onnx_file import REFUSED, REFUSED_BYTES, read_onnx
from soter.policy.policy_extern import load_policy

if TYPE_CHECKING:
    from pathlib import Path

onnx = pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")

HEAD = '<ir_version: 8, opset_import: ["": 15, "own": 1]>\n'
DRAWS = {
    "RandomNormal": "n = RandomNormal <shape = [1, 2]> ()",
    "RandomNormal of a seed": "n = RandomNormal <shape = [1, 2], seed = 1.0> ()",
    "RandomNormalLike": "n = RandomNormalLike (x)",
    "RandomUniform": "n = RandomUniform <shape = [1, 2]> ()",
    "RandomUniformLike": "n = RandomUniformLike (x)",
    "Multinomial": "m = Multinomial <sample_size = 2> (x) n = Cast <to = 1> (m)",
    "Bernoulli": "p = Sigmoid (x) n = Bernoulli (p)",
    "Dropout": "r = Constant <value = float {0.5}> () "
    "t = Constant <value = bool {1}> () n = Dropout (x, r, t)",
}
"""Operators by name: each makes `n`, two numbers, of `x`."""
PLACES = {
    "graph": "g (float[1, 2] x) => (float[1, 2] y) {{ {draw} y = Add (x, n) }}",
    "branch": "g (float[1, 2] x) => (float[1, 2] y) {{ c = Constant <value = bool {{1}}> () "
    "y = If (c) <then_branch = a () => (float[1, 2] n) {{ {draw} }}, "
    "else_branch = b () => (float[1, 2] z) {{ z = Identity (x) }}> }}",
    "body": "g (float[1, 2] x) => (float[1, 2] y) {{ "
    "y = Scan <num_scan_inputs = 1, body = b (float[2] q) => (float[2] s) {{ "
    "{draw} o = ReduceSum <keepdims = 0> (n) s = Add (q, o) }}> (x) }}",
    "function": "g (float[1, 2] x) => (float[1, 2] y) {{ y = own.f (x) }}\n"
    '<domain: "own", opset_import: ["": 15]>\nf (x) => (n) {{ {draw} }}',
}


def saved(folder: Path, text: str) -> Path:
    (folder / "p.onnx").write_bytes(onnx.parser.parse_model(HEAD + text).SerializeToString())
    return folder / "p.onnx"


def loaded(file: Path) -> Any:
    binding = binding_of(f"onnx:{file.name}")
    assert binding is not None
    two = ArrayType(FloatType(), 2)
    return load_policy(binding.in_folder(file.parent), [("x", two)], [("u", two)], None)


def refused(file: Path, how: Any) -> Diagnostic:
    with pytest.raises(SoterError) as caught:
        how(file)
    (problem,) = caught.value.diagnostics
    return problem


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", DRAWS)
def test_what_draws_is_refused_with_two_ways_out(tmp_path: Path, name: str, place: str) -> None:
    file = saved(tmp_path, PLACES[place].format(draw=DRAWS[name]))
    for how in (loaded, read_onnx):
        problem = refused(file, how)
        assert problem.code == "X014"
        assert f"it has the operator {name.partition(' ')[0]}, which draws" in problem.message
        assert [("without chance" in h, "reset(seed)" in h) for h in problem.helps] == [
            (True, False),
            (False, True),
        ]


def test_a_dropout_that_is_not_in_training_and_a_mere_name_are_taken(tmp_path: Path) -> None:
    file = saved(
        tmp_path,
        "g (float[1, 2] x) => (float[1, 2] y) { r = Constant <value = float {0.5}> () "
        "RandomNormalLike = Dropout (x, r) y = Add (RandomNormalLike, x) }",
    )
    policy = loaded(file)
    seen = SimpleNamespace(x=np.array([1.0, -3.0]))
    assert [policy.step(seen)[0] for _ in range(3)] == [(2.0, -6.0)] * 3


def test_every_operator_that_has_a_seed_is_refused() -> None:
    """Of ONNX in all its versions and of onnxruntime; the seed of a hash draws nothing."""
    from onnxruntime.capi.onnxruntime_pybind11_state import get_all_operator_schema

    known = [*onnx.defs.get_all_schemas_with_history(), *get_all_operator_schema()]
    seeded = {s.name for s in known if "seed" in {*s.attributes, *(i.name for i in s.inputs)}}
    seeded -= {"MurmurHash3"}
    assert seeded >= {"Dropout", "Bernoulli", "Sampling"}
    assert seeded - set(REFUSED) == set()
    assert [name for name in REFUSED if REFUSED_BYTES.search(name.encode()) is None] == []
