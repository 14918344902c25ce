"""Reads a policy in an ONNX file: as bytes for onnxruntime, and as a small network.

Purpose: `onnx_content` gives the bytes, and puts weights from other files into them: a tensor may
name a file (`external_data` of the format), as `torch.onnx.export` writes it, which is looked for
in the folder of the ONNX file, wherever the command was started, and nowhere else. `read_onnx`
gives the file as layers: a chain of linear layers, ReLU, tanh, clips and operations with constants,
from the one input to the answer. A graph of another form, or with another operator, is X014 with
its name.
Non-goals: asking onnxruntime (`onnx_session.py`), which has far more operators; what the numbers
mean.
"""

from __future__ import annotations

import hashlib
import re
from math import prod
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.language.load.named_files import ReadError, path_beside, read_bytes
from soter.policy.network import (
    Affine,
    Clipped,
    Elementwise,
    Network,
    Policy,
    Relu,
    Tanh,
    network_problem,
    numbers_text,
)
from soter.policy.policy_errors import (
    FILE_MAX,
    bad_policy_error,
    missing_package_error,
    read_policy_bytes,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.policy.network import Floats, Layer, Operation

    Constants = Mapping[str, npt.NDArray[Any]]


DRAWN = "RandomNormal RandomNormalLike RandomUniform RandomUniformLike Multinomial Bernoulli"
DROPPED = "Dropout BiasDropout BitmaskDropout BitmaskBiasDropout"
REFUSED = {
    "Loop": ("which need not end", "export the policy for one step, without a loop"),
    **dict.fromkeys(
        [*DRAWN.split(), *DROPPED.split(), "Sampling"],
        (
            "which draws: two answers to one observation would differ",
            "export what it answers without chance, such as the mean (torch: after `model.eval()`)",
            "or draw in a class in Python by the seed that its `reset(seed)` is given",
        ),
    ),
}
"""The operators that are not run, as they loop or draw: why, and what to do instead.

A Dropout without a third input (`training_mode`) is run all the same: it changes nothing.
"""
REFUSED_BYTES = re.compile(b"Loop|Random|Multinomial|Bernoulli|Dropout|Sampling")
LOCATION = b"location"
"""The key that stands before another file's name in an ONNX file (`onnx.proto`)."""


class OnnxContent(NamedTuple):
    """An ONNX model in one piece; `beside`: the SHA-256, by name, of each other file in it."""

    data: bytes
    beside: dict[str, str]


def onnx_content(path: Path) -> OnnxContent:
    """The content of an ONNX file; raises X003, X014, or D007 if the package `onnx` is missing."""
    data = read_policy_bytes(path)
    if LOCATION not in data and REFUSED_BYTES.search(data) is None:
        return OnnxContent(data, {})
    model = parse_model(path, data)
    for node in _messages_of_kind(model, "NodeProto"):
        if node.op_type in REFUSED and (node.op_type != "Dropout" or any(node.input[2:3])):
            why, *helps = REFUSED[node.op_type]
            raise bad_policy_error(path, f"it has the operator {node.op_type}, {why}", *helps)
    files: dict[str, bytes] = {}
    room = FILE_MAX
    for tensor in _messages_of_kind(model, "TensorProto"):
        if tensor.data_location == tensor.EXTERNAL or tensor.external_data:
            _load_tensor(path, tensor, files, room)
            room -= len(tensor.raw_data)
    if not files:
        return OnnxContent(data, {})
    hashes = {name: hashlib.sha256(raw).hexdigest() for name, raw in sorted(files.items())}
    return OnnxContent(model.SerializeToString(), hashes)


def parse_model(path: Path, data: bytes) -> Any:  # noqa: ANN401 - no types
    """The ONNX model in these bytes; raises SoterError X014, D007."""
    try:
        import onnx  # noqa: PLC0415 - an extra
        from google.protobuf.message import DecodeError  # noqa: PLC0415 - a part of it
    except ImportError as error:
        raise missing_package_error("onnx", "what an ONNX file says") from error
    try:
        return onnx.load_model_from_string(data)
    except DecodeError as error:
        raise bad_policy_error(path, "it is no ONNX file") from error


def _messages_of_kind(message: Any, kind: str) -> Iterator[Any]:  # noqa: ANN401
    """Yields every message of a kind inside one: in graphs, their operators, functions."""
    if message.DESCRIPTOR.name == kind:
        yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in value if field.is_repeated else (value,):
                yield from _messages_of_kind(part, kind)


def _load_tensor(path: Path, tensor: Any, files: dict[str, bytes], room: int) -> None:  # noqa: ANN401
    """Copies the numbers of a tensor, at most `room` bytes, into it from the file that it names.

    `files` has the files that were already read.
    """
    entries = {entry.key: entry.value for entry in tensor.external_data}
    name = entries.get("location", "")
    if name not in files:
        files[name] = _read_file(path, tensor.name, name, FILE_MAX - sum(map(len, files.values())))
    raw = files[name]
    try:
        start = int(entries.get("offset", "0"))
        size = int(entries.get("length", str(len(raw) - start)))
    except ValueError:
        start = size = -1
    if start < 0 or size < 0 or start + size > len(raw):
        why = f"its constant `{tensor.name}` does not lie in `{name}`, which has {len(raw)} bytes"
        raise bad_policy_error(path, why)
    if size > room:
        raise bad_policy_error(path, f"its constants are larger than {FILE_MAX >> 20} MiB")
    tensor.raw_data = raw[start : start + size]
    tensor.data_location = tensor.DEFAULT
    del tensor.external_data[:]


def _read_file(path: Path, tensor: str, name: str, limit: int) -> bytes:
    """The bytes of a file in the ONNX file's folder; raises X014 if elsewhere or unreadable."""
    at = path_beside(path, name)
    if at is None:
        why = f"its constant `{tensor}` is said to lie in `{name[:80]}`"
        raise bad_policy_error(path, why, "only files in the folder of the ONNX file are read")
    try:
        return read_bytes(at, limit)
    except ReadError as error:
        why = f"its constant `{tensor}` lies in `{at}`: {error}"
        helps = ["keep the file beside the ONNX file that names it"]
        if path.is_symlink():
            helps.append(f"`{path.name}` is a link: bind `{path.resolve()}`, or link both")
        raise bad_policy_error(path, why, *helps) from error


NAMES = ("action", "actions")
"""Names of the output that is the answer, where there are several; else it is the first."""
READ = (
    "Gemm, MatMul, Add, Sub, Mul, Div, Relu, Tanh, Clip, Identity, Cast, Flatten, Reshape, "
    "Expand, ArgMax"
)
EXPANDED_MAX = 2**20
"""A constant that is broadcast has at most so many numbers."""
FLOAT = 1
"""Float32 in ONNX's TensorProto.DataType."""
ARITHMETIC: dict[str, Operation] = {"Add": "+", "Sub": "-", "Mul": "*", "Div": "/"}


class _UnreadError(Exception):
    """Reports that the graph has a part that this reader does not support."""


def read_onnx(path: Path) -> Policy:
    """The policy in an ONNX file; raises SoterError X003, X014, D007 without the package `onnx`."""
    content = onnx_content(path)
    model = parse_model(path, content.data)
    graph = model.graph
    try:
        observation, answered, network = _read_network(graph)
        why = network_problem(network)
    except (_UnreadError, ValueError, TypeError, LookupError) as error:
        ask = f'asked as it is by onnxruntime: `extern node ... from "onnx:{path}" {{ ... }}`'
        read = f"operators that are read as layers: {READ}"
        raise bad_policy_error(path, str(error)[:300], ask, read) from error
    if why:
        raise bad_policy_error(path, why)
    versions = ", ".join(str(x.version) for x in model.opset_import if not x.domain)
    facts = {
        "file": f"ONNX, operators of version {versions}",
        "observation": f"`{observation}`, {numbers_text(network.inputs)}",
        "answer": f"`{answered}`, "
        + ("the index of the largest" if network.choices else numbers_text(network.outputs)),
    }
    if content.beside:
        hashes = [f"`{name}`, sha256 {sha256}" for name, sha256 in content.beside.items()]
        facts["weights"] = "in " + "; ".join(hashes)
    others = [x.name for x in graph.output if x.name != answered]
    assumed = (f"of its outputs `{answered}` is the answer",) if others else ()
    return Policy(str(path), network, facts, assumed)


def _read_network(graph: Any) -> tuple[str, str, Network]:  # noqa: ANN401 - no types
    """The names of the observation and the answer, and the layers between them."""
    constants = _constants_by_name(graph)
    inputs = [x for x in graph.input if x.name not in constants]
    if len(inputs) != 1 or not graph.output:
        counts = f"{len(inputs)} inputs and {len(graph.output)} outputs"
        raise _UnreadError(f"it has {counts}, and a function of one observation is written")
    answered = ([x.name for x in graph.output if x.name in NAMES] or [graph.output[0].name])[0]
    size = _observation_size(inputs[0])
    chain = _operator_chain(graph, constants, inputs[0].name, answered)
    choice = chain[-1].op_type == "ArgMax"
    if choice:
        _require_argmax(chain.pop())
    layers: list[Layer] = []
    for node in chain:
        network = Network(size, tuple(layers))
        layers += _layer_maker(node)(node, constants, network.outputs)
    network = Network(size, tuple(layers))
    choices = (network.outputs,) if choice else ()
    return inputs[0].name, answered, Network(size, tuple(layers), choices)


def _constant_array(tensor: Any) -> npt.NDArray[Any]:  # noqa: ANN401
    """The numbers of a constant, which are in the file itself (`onnx_content`)."""
    from onnx import TensorProto, numpy_helper  # noqa: PLC0415 - as above

    if tensor.data_type not in {TensorProto.FLOAT, TensorProto.INT64}:
        kind = TensorProto.DataType.Name(tensor.data_type)
        raise _UnreadError(f"its constant `{tensor.name}` is a {kind}: float32 is read")
    array: npt.NDArray[Any] = numpy_helper.to_array(tensor)
    return array


def _constants_by_name(graph: Any) -> dict[str, npt.NDArray[Any]]:  # noqa: ANN401
    if graph.sparse_initializer:
        raise _UnreadError("it has sparse constants")
    constants = {x.name: _constant_array(x) for x in graph.initializer}
    for node in graph.node:
        if node.op_type == "Constant" and not node.domain:
            values = [a.t for a in node.attribute if a.name == "value"]
            if len(values) != 1 or len(node.output) != 1:
                raise _UnreadError("it has a Constant that is no tensor")
            constants[node.output[0]] = _constant_array(values[0])
        elif node.op_type == "Identity" and node.input[0] in constants:
            constants[node.output[0]] = constants[node.input[0]]  # a weight that is used twice
        elif node.op_type == "Expand" and {*node.input} <= constants.keys():
            constant, shape = (constants[name] for name in node.input)
            sizes = np.broadcast_shapes(constant.shape, shape.reshape(-1).tolist())
            if prod(sizes) > EXPANDED_MAX:
                raise _UnreadError(f"its Expand makes more than {EXPANDED_MAX:,} numbers")
            constants[node.output[0]] = np.broadcast_to(constant, sizes)
    return constants


def _observation_size(value: Any) -> int:  # noqa: ANN401
    """How many numbers an observation has, by the shape of the graph's input."""
    from onnx import TensorProto  # noqa: PLC0415 - as above

    tensor = value.type.tensor_type
    sizes = [axis.dim_value for axis in tensor.shape.dim]
    if tensor.elem_type != TensorProto.FLOAT or not sizes or sizes[-1] <= 0:
        raise _UnreadError(f"its input `{value.name}` is no float32 of a fixed last axis")
    if any(x not in (0, 1) for x in sizes[:-1]):
        raise _UnreadError(f"its input `{value.name}` has the shape {sizes}: one axis is read")
    return int(sizes[-1])


def _variable_input(node: Any, constants: Constants) -> str:  # noqa: ANN401
    moving: list[str] = [name for name in node.input if name and name not in constants]
    if len(moving) != 1:
        raise _UnreadError(f"its {node.op_type} is of {len(moving)} values that change")
    return moving[0]


def _operator_chain(graph: Any, constants: Constants, start: str, end: str) -> list[Any]:  # noqa: ANN401
    """The operators from the input to the answer, in order."""
    producers = {name: node for node in graph.node for name in node.output}
    chain: list[Any] = []
    at = end
    while at != start:
        node = producers.get(at)
        if node is None or len(chain) > len(graph.node):
            raise _UnreadError(f"nothing leads from its input to `{at}`")
        if node.domain or any(a.g.node or a.graphs for a in node.attribute):
            raise _UnreadError(f"it has the operator {node.domain or 'main'}.{node.op_type}")
        at = _variable_input(node, constants)
        if node.op_type == "ArgMax" and chain:
            raise _UnreadError("its ArgMax is not the last operator")
        chain.insert(0, node)
    if not chain:
        raise _UnreadError("its answer is its input")
    return chain


# ---------------------------------------------------------------- operators


def _attributes_by_name(node: Any) -> dict[str, Any]:  # noqa: ANN401
    from onnx import helper  # noqa: PLC0415 - as above

    return {a.name: helper.get_attribute_value(a) for a in node.attribute}


def _constant_vector(array: npt.NDArray[Any], size: int) -> Floats:
    """A constant as an array of `size` numbers."""
    if array.dtype != np.float32 or (array.size != 1 and array.shape[-1:] != (array.size,)):
        raise _UnreadError(f"a constant has the shape {array.shape}: one number each is read")
    return np.ascontiguousarray(np.broadcast_to(array.reshape(-1), (size,)))


def _gemm_layers(node: Any, constants: Constants, size: int) -> list[Layer]:  # noqa: ANN401
    how = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 0} | _attributes_by_name(node)
    if how["alpha"] != 1.0 or how["beta"] != 1.0 or how["transA"] or node.input[0] in constants:
        raise _UnreadError("its Gemm has factors, or an observation on another side")
    weight = _weight_matrix(constants.get(node.input[1]), size, transposed=bool(how["transB"]))
    bias = np.zeros(1, np.float32) if len(node.input) < 3 else constants[node.input[2]]
    return [Affine(weight, _constant_vector(bias, weight.shape[0]))]


def _matmul_layers(node: Any, constants: Constants, size: int) -> list[Layer]:  # noqa: ANN401
    weight = _weight_matrix(constants.get(node.input[1]), size, transposed=False)
    return [Affine(weight, np.zeros(weight.shape[0], np.float32))]


def _weight_matrix(array: npt.NDArray[Any] | None, size: int, *, transposed: bool) -> Floats:
    """A constant as a matrix (out, in)."""
    if array is None or array.ndim != 2 or array.dtype != np.float32:
        raise _UnreadError("it multiplies with what is no constant matrix on the right")
    weight = array if transposed else array.T
    if weight.shape[1] != size or not weight.size:
        raise _UnreadError(f"a matrix takes {numbers_text(weight.shape[1])}, and is given {size}")
    return np.ascontiguousarray(weight)


def _arithmetic_layers(node: Any, constants: Constants, size: int) -> list[Layer]:  # noqa: ANN401
    first = node.input[0] in constants
    operand = constants[node.input[0 if first else 1]]
    if first and node.op_type in {"Sub", "Div"}:
        raise _UnreadError(f"its {node.op_type} has the constant on the left")
    return [Elementwise(ARITHMETIC[node.op_type], _constant_vector(operand, size))]


def _clip_layers(node: Any, constants: Constants, size: int) -> list[Layer]:  # noqa: ANN401
    attributes = _attributes_by_name(node)
    bounds = [np.float32(attributes.get("min", -np.inf)), np.float32(attributes.get("max", np.inf))]
    for place, name in enumerate(node.input[1:3]):
        if name:
            bounds[place] = constants[name]
    low, high = (_constant_vector(np.asarray(b), size) for b in bounds)
    return [Clipped(low, high)]


def _no_layer(node: Any, constants: Constants, size: int) -> list[Layer]:  # noqa: ANN401
    """No layers, for an operator that leaves the numbers of an observation as they are."""
    if node.op_type == "Flatten" and _attributes_by_name(node).get("axis", 1) not in (0, 1):
        raise _UnreadError("its Flatten makes several rows of one observation")
    if node.op_type == "Cast" and _attributes_by_name(node).get("to") != FLOAT:
        raise _UnreadError("its Cast is not to float32")
    if node.op_type == "Expand":
        *axes, last = constants[node.input[1]].reshape(-1).tolist()
        if last not in (1, size) or any(x != 1 for x in axes):
            raise _UnreadError("its Expand makes more numbers of one observation")
    if node.op_type == "Reshape":
        *axes, last = constants[node.input[1]].reshape(-1).tolist()
        axes[:1] = [1 if x == 0 else x for x in axes[:1]]  # 0 is that of the input
        if last not in (-1, size) or any(x not in (-1, 1) for x in axes):
            raise _UnreadError("its Reshape makes several rows of one observation")
    return []


def _require_argmax(node: Any) -> None:  # noqa: ANN401
    attributes = {"axis": 0, "select_last_index": 0} | _attributes_by_name(node)
    if attributes["axis"] not in (-1, 1) or attributes["select_last_index"]:
        raise _UnreadError("its ArgMax is not of the last axis, or takes the last of equal numbers")


def _layer_maker(node: Any) -> Callable[[Any, Constants, int], list[Layer]]:  # noqa: ANN401
    name = node.op_type
    if name in ARITHMETIC:
        return _arithmetic_layers
    simple: dict[str, Layer] = {"Relu": Relu(), "Tanh": Tanh()}
    if name in simple:
        return lambda *_: [simple[name]]
    known = {"Gemm": _gemm_layers, "MatMul": _matmul_layers, "Clip": _clip_layers}
    known |= dict.fromkeys(("Identity", "Cast", "Flatten", "Reshape", "Expand"), _no_layer)
    if name not in known:
        raise _UnreadError(f"it has the operator {name[:40]}")
    return known[name]
