"""Files of policies that tests make: changed ones of Stable-Baselines3, small ones of ONNX."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

FILES = Path(__file__).parent / "files"


def unzipped(data: bytes) -> dict[str, bytes]:
    """The parts of a zip by name."""
    with zipfile.ZipFile(io.BytesIO(data)) as parts:
        return {name: parts.read(name) for name in parts.namelist()}


def zipped(parts: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """A zip of parts."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as made:
        for name, data in parts.items():
            made.writestr(name, data)
    return stream.getvalue()


def changed(
    name: str,
    settings: Callable[[dict[str, Any]], object] | None = None,
    tensors: Callable[[dict[str, bytes]], object] | None = None,
    parts: Callable[[dict[str, bytes]], object] | None = None,
) -> bytes:
    """A real file of Stable-Baselines3 with its settings, tensors or parts changed in place."""
    whole = unzipped((FILES / name).read_bytes())
    if settings is not None:
        said = json.loads(whole["data"])
        settings(said)
        whole["data"] = json.dumps(said).encode()
    if tensors is not None:
        inner = unzipped(whole["policy.pth"])
        tensors(inner)
        whole["policy.pth"] = zipped(inner)
    if parts is not None:
        parts(whole)
    return zipped(whole)


def renamed(pickled: bytes, old: str, new: str) -> bytes:
    """A pickle with a short text that stands in it replaced; it has to be there."""
    made = pickled
    for size in (lambda n: b"\x8c" + bytes([n]), lambda n: b"X" + n.to_bytes(4, "little")):
        before, after = (size(len(t)) + t.encode() for t in (old, new))
        made = made.replace(before, after)
    assert made != pickled, f"{old} does not stand in it"
    return made


def change_pickle(said: dict[str, Any], which: str, change: Callable[[bytes], bytes]) -> None:
    """Change the pickle of a setting."""
    old = base64.b64decode(said[which][":serialized:"])
    said[which][":serialized:"] = base64.b64encode(change(old)).decode()


def onnx_of(
    layers: Sequence[tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]],
    activation: str,
    ending: Sequence[tuple[str, dict[str, Any]]] = (),
) -> Any:
    """A network as ONNX: Gemm layers, an activation between them, operators at the end."""
    from onnx import TensorProto, helper, numpy_helper

    at, nodes, constants = "obs", [], []
    for number, (weight, bias) in enumerate(layers):
        if number:
            nodes.append(helper.make_node(activation, [at], [f"a{number}"]))
            at = f"a{number}"
        names = [f"W{number}", f"B{number}"]
        constants += [numpy_helper.from_array(a, n) for a, n in zip((weight, bias), names)]  # noqa: B905
        nodes.append(helper.make_node("Gemm", [at, *names], [f"z{number}"], transB=1))
        at = f"z{number}"
    kind = TensorProto.FLOAT
    for number, (operator, said) in enumerate(ending):
        nodes.append(helper.make_node(operator, [at], [f"e{number}"], **said))
        at = f"e{number}"
        kind = TensorProto.INT64 if operator == "ArgMax" else kind
    width = None if kind == TensorProto.INT64 else len(layers[-1][1])
    shape: list[str | int | None] = ["batch"] if width is None else ["batch", width]
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["batch", layers[0][0].shape[1]])],
        [helper.make_tensor_value_info(at, kind, shape)],
        constants,
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def random_layers(
    seed: int, *sizes: int
) -> list[tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]]:
    """Weights (out, in) and biases (out,) of layers of these sizes."""
    rng = np.random.default_rng(seed)
    return [
        (
            (rng.normal(size=(after, before)) / np.sqrt(before)).astype(np.float32),
            (0.3 * rng.normal(size=after)).astype(np.float32),
        )
        for before, after in pairwise(sizes)
    ]
