"""The bytes of an ONNX file, with the weights that lie in files beside it put into it.

Purpose: what both readers of ONNX files are given. A tensor may name a file (`external_data` of
the format), as `torch.onnx.export` writes it; that is looked for in the folder of the ONNX file as
that is named, wherever the command was started, and nowhere else.
Non-goals: what the bytes mean (`onnx_session.py`, `onnx_graph.py`).
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.language.load.bounded_read import ReadError, beside, read_bytes
from soter.policy.policy_errors import FILE_MAX, bad_policy, content_of, missing_package

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LOOP = b"Loop"
"""The name of the one operator whose turns the graph itself counts."""
LOCATION = b"location"
"""The key that names another file stands in every ONNX file that has one (`onnx.proto`)."""


class OnnxContent(NamedTuple):
    """One file's worth of ONNX; `beside`: SHA-256 of each other file that went into it, by name."""

    data: bytes
    beside: dict[str, str]


def onnx_content(path: Path) -> OnnxContent:
    """The content of an ONNX file. SoterError X003, X014; D007 where only `onnx` can tell."""
    data = content_of(path)
    endless = LOOP in data
    if LOCATION not in data and not endless:
        return OnnxContent(data, {})
    model = parsed(path, data)
    if endless and any(node.op_type == "Loop" for node in _messages(model, "NodeProto")):
        help_ = "export the policy for one step, without a loop"
        raise bad_policy(path, "it has the operator Loop, which need not end", help_)
    files: dict[str, bytes] = {}
    room = FILE_MAX
    for tensor in _messages(model, "TensorProto"):
        if tensor.data_location == tensor.EXTERNAL or tensor.external_data:
            _put_in(path, tensor, files, room)
            room -= len(tensor.raw_data)
    if not files:
        return OnnxContent(data, {})
    told = {name: hashlib.sha256(raw).hexdigest() for name, raw in sorted(files.items())}
    return OnnxContent(model.SerializeToString(), told)


def parsed(path: Path, data: bytes) -> Any:  # noqa: ANN401 - no types
    """The model that bytes are; SoterError X014, D007."""
    try:
        import onnx  # noqa: PLC0415 - an extra
        from google.protobuf.message import DecodeError  # noqa: PLC0415 - a part of it
    except ImportError as error:
        raise missing_package("onnx", "what an ONNX file says") from error
    try:
        return onnx.load_model_from_string(data)
    except DecodeError as error:
        raise bad_policy(path, "it is no ONNX file") from error


def _messages(message: Any, kind: str) -> Iterator[Any]:  # noqa: ANN401
    """Every message of a kind in one: of graphs, of operators in them, of functions."""
    if message.DESCRIPTOR.name == kind:
        yield message
    for field, value in message.ListFields():
        if field.message_type is not None:
            for part in value if field.is_repeated else (value,):
                yield from _messages(part, kind)


def _put_in(path: Path, tensor: Any, files: dict[str, bytes], room: int) -> None:  # noqa: ANN401
    """The tensor's numbers from the file that it names; `files`: those that were read so far.

    At most `room` bytes.
    """
    said = {entry.key: entry.value for entry in tensor.external_data}
    name = said.get("location", "")
    if name not in files:
        files[name] = _beside(path, tensor.name, name, FILE_MAX - sum(map(len, files.values())))
    raw = files[name]
    try:
        start = int(said.get("offset", "0"))
        size = int(said.get("length", str(len(raw) - start)))
    except ValueError:
        start = size = -1
    if start < 0 or size < 0 or start + size > len(raw):
        why = f"its constant `{tensor.name}` does not lie in `{name}`, which has {len(raw)} bytes"
        raise bad_policy(path, why)
    if size > room:
        raise bad_policy(path, f"its constants are larger than {FILE_MAX >> 20} MiB")
    tensor.raw_data = raw[start : start + size]
    tensor.data_location = tensor.DEFAULT
    del tensor.external_data[:]


def _beside(path: Path, tensor: str, name: str, limit: int) -> bytes:
    """A file in the folder of the ONNX file; X014 for any other, and where it is not read."""
    at = beside(path, name)
    if at is None:
        why = f"its constant `{tensor}` is said to lie in `{name[:80]}`"
        raise bad_policy(path, why, "only files in the folder of the ONNX file are read")
    try:
        return read_bytes(at, limit)
    except ReadError as error:
        why = f"its constant `{tensor}` lies in `{at}`: {error}"
        helps = ["keep the file beside the ONNX file that names it"]
        if path.is_symlink():
            helps.append(f"`{path.name}` is a link: bind `{path.resolve()}`, or link both")
        raise bad_policy(path, why, *helps) from error
