"""Files that mean harm in the words of their own format: what `hostile_files.py` puts last.

Purpose: `CRAFTED`, by format what is put in place, in a folder, of its good file: parts of a zip
that run or grow, graphs that never end, chunks that unpack to gigabytes, names that lead elsewhere.
Non-goals: what is the same for all formats (`hostile_files.py`).
"""

from __future__ import annotations

import base64
import bz2
import io
import json
import os
import pickle
import struct
import zipfile
from typing import TYPE_CHECKING, Any

from bench.hostile.bad_input_samples import LSP_URI, seal

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Craft = Callable[[Path, Path], object]

GIB = 2**30
RUNS = "touch ran"


class Runs:
    """What somebody executes who unpickles it."""

    def __reduce__(self) -> tuple[object, ...]:
        return os.system, (RUNS,)


def repacked(raw: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
    """A zip whose parts are changed."""
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(raw)) as packed,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made,
    ):
        for name in packed.namelist():
            made.writestr(name, change(name, packed.read(name)))
    return stream.getvalue()


# ---------------------------------------------------------------- policies


def _objects(name: str, data: bytes) -> bytes:
    """Every pickle in the JSON of a policy runs."""
    if name != "data":
        return data
    document = json.loads(data)
    packed = base64.b64encode(pickle.dumps(Runs())).decode()
    for value in document.values():
        if isinstance(value, dict):
            value[":serialized:"] = packed
    return json.dumps(document).encode()


def _weights(put: Callable[[str, bytes], bytes]) -> Callable[[str, bytes], bytes]:
    return lambda name, data: repacked(data, put) if name == "policy.pth" else data


def _zip(change: Callable[[str, bytes], bytes]) -> Craft:
    def put(folder: Path, _outside: Path) -> None:
        path = folder / "ppo.zip"
        path.write_bytes(repacked(path.read_bytes(), change))

    return put


def _growing_pickle() -> bytes:
    """A hundred pairs of pairs: 2^100 numbers for whoever follows each."""
    made: Any = 1.0
    for _ in range(100):
        made = (made, made)
    return pickle.dumps(made)


def _claimed_pickle() -> bytes:
    return b"\x80\x04\x8e" + struct.pack("<Q", 8 * GIB) + b"x" * 100 + b"."


def _onnx(name: str, nodes: Callable[[Any], list[Any]], outside: str = "") -> Craft:
    """A graph of these nodes from `obs`, (1, 2), to `u`; `outside`: where a constant lies."""

    def put(folder: Path, elsewhere: Path) -> None:
        import onnx  # noqa: PLC0415 - an extra

        helper, kind = onnx.helper, onnx.TensorProto.FLOAT
        constant = helper.make_tensor("W", kind, [1, 2], [1.0, 1.0])
        if outside:
            constant.ClearField("float_data")
            constant.data_location = onnx.TensorProto.EXTERNAL
            said = constant.external_data.add()
            said.key, said.value = "location", outside.format(outside=elsewhere)
        graph = helper.make_graph(
            nodes(onnx),
            "policy",
            [helper.make_tensor_value_info("obs", kind, ["batch", 2])],
            [helper.make_tensor_value_info("u", kind, None)],
            [constant],
        )
        opset = [helper.make_opsetid("", 17)]
        made = helper.make_model(graph, opset_imports=opset, ir_version=9)
        (folder / name).write_bytes(made.SerializeToString())

    return put


def _gemm(onnx: Any) -> list[Any]:  # noqa: ANN401 - no types
    return [onnx.helper.make_node("Gemm", ["obs", "W"], ["u"], transB=1)]


def _loop(onnx: Any) -> list[Any]:  # noqa: ANN401
    """A loop of 2^62 turns."""
    h, kinds = onnx.helper, onnx.TensorProto
    body = h.make_graph(
        [h.make_node("Identity", ["go"], ["on"]), h.make_node("Identity", ["x"], ["y"])],
        "body",
        [
            h.make_tensor_value_info("i", kinds.INT64, []),
            h.make_tensor_value_info("go", kinds.BOOL, []),
            h.make_tensor_value_info("x", kinds.FLOAT, None),
        ],
        [
            h.make_tensor_value_info("on", kinds.BOOL, []),
            h.make_tensor_value_info("y", kinds.FLOAT, None),
        ],
    )
    turns = h.make_tensor("n", kinds.INT64, [], [2**62])
    return [
        h.make_node("Constant", [], ["N"], value=turns),
        h.make_node("Gemm", ["obs", "W"], ["x0"], transB=1),
        h.make_node("Loop", ["N", "", "x0"], ["u"], body=body),
    ]


def _large(onnx: Any) -> list[Any]:  # noqa: ANN401
    """The sum of 8 GiB of zeros is added."""
    h = onnx.helper
    shape = h.make_tensor("n", onnx.TensorProto.INT64, [1], [2 * GIB])
    return [
        h.make_node("Constant", [], ["N"], value=shape),
        h.make_node("ConstantOfShape", ["N"], ["zeros"]),
        h.make_node("ReduceSum", ["zeros"], ["zero"], keepdims=0),
        h.make_node("Gemm", ["obs", "W"], ["x0"], transB=1),
        h.make_node("Add", ["x0", "zero"], ["u"]),
    ]


def _foreign(onnx: Any) -> list[Any]:  # noqa: ANN401
    return [onnx.helper.make_node("Run", ["obs"], ["u"], domain="com.own", command=RUNS)]


def _onnx_kinds(name: str) -> tuple[tuple[str, Craft], ...]:
    return (
        ("a loop that never ends", _onnx(name, _loop)),
        ("8 GiB of zeros", _onnx(name, _large)),
        ("an operator of nobody", _onnx(name, _foreign)),
        ("weights above", _onnx(name, _gemm, "../outside/secret")),
        ("weights elsewhere", _onnx(name, _gemm, "{outside}/secret")),
        ("weights that never end", _onnx(name, _gemm, "/dev/zero")),
    )


# ---------------------------------------------------------------- logs


def _chunk(name: str, packing: str) -> Craft:
    """A chunk of 4 GiB of zeros in a few kilobytes, which says so, or says 8 bytes."""

    def put(folder: Path, _outside: Path) -> None:
        from bench.hostile import log_records as r  # noqa: PLC0415 - needs extras

        packed = _packed(packing)
        records = r.mcap_records(folder / name)
        at = r.place_of(records, 6)
        kind = packing.encode()
        head = struct.pack("<QQQII", 0, 2**62, 4 * GIB, 0, len(kind)) + kind
        records[at] = (6, head + struct.pack("<Q", len(packed)) + packed)
        r.as_mcap(folder / name, records)

    return put


def _packed(packing: str) -> bytes:
    """4 GiB of zeros."""
    if packing == "zstd":
        return _zstd(4 * GIB)
    import lz4.frame  # noqa: PLC0415 - an extra

    with lz4.frame.LZ4FrameCompressor() as frame:
        parts = [frame.begin(), *(frame.compress(bytes(2**24)) for _ in range(256)), frame.flush()]
    return b"".join(parts)


def _zstd(size: int) -> bytes:
    import zstandard  # noqa: PLC0415 - an extra

    packer = zstandard.ZstdCompressor(level=1).compressobj()
    parts = [packer.compress(bytes(2**24)) for _ in range(size >> 24)]
    return b"".join([*parts, packer.flush()])


def _packed_bag(folder: Path, _outside: Path) -> None:
    (folder / "squeezed" / "squeezed.db3.zstd").write_bytes(_zstd(6 * GIB))


def _bag1(folder: Path, _outside: Path) -> None:
    """A chunk of a bag of ROS 1 that unpacks to 4 GiB."""
    from bench.hostile import log_records as r  # noqa: PLC0415 - needs extras

    small = bz2.compress(bytes(2**26)) * 64

    def change(records: list[r.Record1]) -> None:
        at = next(i for i, (kind, _, _) in enumerate(records) if kind == r.CHUNK1)
        kind, header, _ = records[at]
        records[at] = (kind, {**header, "compression": b"bz2"}, small)

    r.rewritten(folder / "place.bag", change)


def _metadata(*names: str) -> Craft:
    """The metadata of a bag name other files."""

    def put(folder: Path, outside: Path) -> None:
        path = folder / "bag" / "metadata.yaml"
        told = "".join(f"\n  - {n.format(outside=outside)}" for n in names)
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("\n  - bag.db3", told))

    return put


def _definition(text: str) -> Craft:
    return lambda folder, _: (folder / "Place.msg").write_text(text)


# ---------------------------------------------------------------- documents that name files


def _text(name: str, before: str, after: str) -> Craft:
    """Words of a file are others."""

    def put(folder: Path, outside: Path) -> None:
        path = folder / name
        text = path.read_text(encoding="utf-8")
        assert before in text, (name, before)
        path.write_text(text.replace(before, after.replace("{outside}", str(outside)), 1))

    return put


def _json(name: str, **changes: object) -> Craft:
    """Members of a document are others."""

    def put(folder: Path, outside: Path) -> None:
        document = json.loads((folder / name).read_text(encoding="utf-8"))
        told = json.dumps(changes).replace("{outside}", str(outside))
        (folder / name).write_text(json.dumps(document | json.loads(told)))

    return put


def _sealed(folder: Path, outside: Path) -> None:
    """A certificate that counts a file of elsewhere among its own, and says its hash."""
    manifest = folder / "proof" / "manifest.json"
    document = json.loads(manifest.read_text(encoding="utf-8"))
    for name in (
        "../../outside/secret",
        str(outside / "secret"),
        "program/../../../outside/secret",
    ):
        document["files"][name] = "0"
    manifest.write_text(json.dumps(document))
    seal(folder)


def _link(name: str) -> Craft:
    """A file that a command writes leads to one of elsewhere."""

    def put(folder: Path, outside: Path) -> None:
        path = folder / name
        path.unlink(missing_ok=True)
        path.symlink_to(outside / "secret")

    return put


def _npy(header: str) -> Craft:
    raw = header.encode().ljust(118) + b"\n"
    data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(raw)) + raw
    return lambda folder, _: (folder / "array.npy").write_bytes(data)


def _lsp(uri: str, text: str) -> Craft:
    """An editor that opens something else."""

    def put(folder: Path, outside: Path) -> None:
        raw = (folder / "session.lsp").read_bytes()
        parts = [p.split(b"\r\n\r\n", 1)[1] for p in raw.split(b"Content-Length: ")[1:]]
        said = b""
        for part in parts:
            body = part.replace(LSP_URI.encode(), uri.format(outside=outside).encode())
            words = json.dumps(text.replace("{outside}", str(outside)))[1:-1]
            body = body.replace(b"soter 1;\\nconst A: int = 3;\\n", words.encode())
            said += b"Content-Length: %d\r\n\r\n" % len(body) + body
        (folder / "session.lsp").write_bytes(said)

    return put


PLACES = ("../outside/secret", "{outside}/secret", "/proc/self/environ", "/dev/zero")
"""Where names lead that stand in a file."""


def _elsewhere(put: Callable[[str], Craft]) -> tuple[tuple[str, Craft], ...]:
    return tuple((f"it names {place}", put(place)) for place in PLACES)


IMPORTS = 'import "{}" as other;\nconst OWN: float = data "{}";\n'
SQUEEZED = "".join(f"float64[1000000] x{k}\n" for k in range(1000))
CRAFTED: dict[str, tuple[tuple[str, Craft], ...]] = {
    "policy_sb3": (
        ("objects that run", _zip(_objects)),
        ("weights that run", _zip(_weights(lambda *_: pickle.dumps(Runs())))),
        ("weights that grow", _zip(_weights(lambda *_: bytes(GIB // 2)))),
        ("data that grows", _zip(lambda n, raw: raw + b" " * (GIB // 2 if n == "data" else 0))),
    ),
    "vecnormalize": (
        ("2^100 numbers", lambda f, _: (f / "norm.pkl").write_bytes(_growing_pickle())),
        ("a text of 8 GiB", lambda f, _: (f / "norm.pkl").write_bytes(_claimed_pickle())),
    ),
    "policy_onnx": _onnx_kinds("a.onnx"),
    "onnx_beside": _onnx_kinds("b.onnx"),
    "data_npy": (
        ("a header that runs", _npy(f"__import__('os').system('{RUNS}')")),
        ("8 TiB", _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776,)}")),
        ("objects", _npy("{'descr': '|O', 'fortran_order': False, 'shape': (2, 2)}")),
    ),
    "log_mcap": (("4 GiB of zstd", _chunk("log.mcap", "zstd")), ("lz4", _chunk("log.mcap", "lz4"))),
    "mcap_ros": (("4 GiB of zstd", _chunk("place.mcap", "zstd")),),
    "bag": _elsewhere(_metadata),
    "bag_zstd": (("6 GiB", _packed_bag),),
    "bag_ros1": (("4 GiB of bz2", _bag1),),
    "message": (
        ("a type in itself", _definition("own/Place inner\nfloat64 x\n")),
        ("10^9 numbers", _definition(SQUEEZED + "float64 x\n")),
    ),
    "imported": _elsewhere(lambda p: _text("lib.soter", "\n", "\n" + IMPORTS.replace("{}", p))),
    "program": _elsewhere(lambda p: _text("track.soter", "\n", "\n" + IMPORTS.replace("{}", p))),
    "map_toml": _elsewhere(
        lambda p: _text("map.toml", "[time]", f'[messages]\n"a/B"="{p}"\n[time]')
    ),
    "dialect": _elsewhere(lambda p: _text("own.xml", "common.xml", p)),
    "trace": _elsewhere(lambda p: _json("traces/T.trace.json", program=p)),
    "counterexample": _elsewhere(lambda p: _json("traces/Guard.counterexample.json", program=p)),
    "test_report": _elsewhere(lambda p: _json("report.json", file=p, path=p)),
    "certificate": (("it counts files of elsewhere", _sealed),),
    "campaign": tuple(
        (f"{name} leads elsewhere", _link(f"camp/{name}"))
        for name in ("campaign.lock", "flights.csv", "campaign.part", "campaign.json")
    ),
    "package": tuple(
        (f"{name} leads elsewhere", _link(f"pack/{name}"))
        for name in ("track.c", "main.c", ".soter-files.json")
    ),
    "lsp": tuple(
        (f"it opens {uri}", _lsp(uri, text))
        for uri in ("file:///{outside}/secret", "file:///dev/zero", LSP_URI)
        for text in ("soter 1;\n", 'soter 1;\nimport "{outside}/secret" as o;\n')
    ),
}
"""By format: what it is, and who puts it into a folder (with the place of what lies outside)."""
