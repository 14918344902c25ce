"""More formats than `bad_input_samples.py` has: what names other files, and what others wrote.

Purpose: `more_samples` adds to the folder of samples a dialect of MAVLink and a message definition
with mappings that name them, policies, bags of ROS, a package, a program that imports and others,
each with the command that reads it. `CALLS` are what is read without a command.
Non-goals: making them wrong (`hostile_files.py`).
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from bench.hostile.bad_input_samples import ROOT, Format, soter_says

from soter.mapping.mavlink_dialects import dialect_path

MAVLINK = ROOT / "examples" / "mavlink"
POLICIES = ROOT / "tests" / "unit" / "policy" / "files"
LEARNED = """soter 1;
input topic a: float = 0.0;
input topic b: float = 0.0;
topic u: float in [-1.0, 1.0] = 0.0;
extern node Learned period 10ms { subscribes a, b; publishes u; }
system S default { node Learned; until 50ms; }
"""
POINT = """[topics.position]
type = "{type}"
channel = "/place"
stamp = "arrival"
[topics.position.fields]
value = "x"
[topics.goal.fields]
value = {{ constant = 12.0 }}
"""
LIBRARY = """soter 1;
const HALF: float = 0.5;
topic u: float in [-1.0, 1.0] = 0.0;
node Steady period 10ms { publishes u; step { publish u = HALF; } }
"""
USES = """soter 1;
import "lib.soter" as lib;
system S default { node lib.Steady; until 50ms; always lib.u < 0.9; }
"""
DIALECT = """<?xml version="1.0"?>
<mavlink>
<include>common.xml</include>
<version>3</version>
<enums><enum name="KIND"><description>kinds</description>
<entry name="KIND_A" value="1"><description>the first</description></entry></enum></enums>
<messages><message id="54000" name="PLACE"><description>where it is</description>
<field type="float" name="x" units="m" enum="KIND">forward</field>
<field type="uint32_t" name="time_boot_ms" units="ms">since power-up</field>
</message></messages></mavlink>
"""
TYPED = "float64 x\nfloat64 y\nuint8 KIND=1\nstring<=10 name\n"


READ, MAPPED = "monitor track.soter", "--map message.toml"


def _format(name: str, file: str, *lines: str) -> Format:
    return Format(name, tuple(file.split()), tuple(tuple(line.split()) for line in lines))


MORE = (
    _format(
        "dialect",
        "own.xml",
        "build geofence.soter --system Companion --target mavlink -o out --map geofence.toml",
    ),
    _format("message", "Place.msg", "monitor track.soter place.mcap --map message.toml"),
    _format(
        "policy_sb3",
        "ppo.zip",
        "policy ppo.zip",
        "run learned.soter --bind Learned=sb3:ppo.zip --until 20ms",
    ),
    _format(
        "policy_onnx",
        "a.onnx",
        "policy a.onnx",
        "run learned.soter --bind Learned=onnx:a.onnx --until 20ms",
    ),
    _format(
        "onnx_beside",
        "weights b.onnx",
        "policy b.onnx",
        "run learned.soter --bind Learned=onnx:b.onnx --until 20ms",
    ),
    _format(
        "imported",
        "lib.soter",
        "check uses.soter",
        "run --until 20ms uses.soter",
        "show uses.soter",
        "build uses.soter -o out",
        "fmt uses.soter",
    ),
    _format("mcap_ros", "place.mcap", "monitor track.soter place.mcap --map plain.toml"),
    _format("mcap_loose", "loose.mcap", "monitor track.soter loose.mcap --map plain.toml"),
    _format("bag_mcap", "packed/packed.mcap packed/metadata.yaml", f"{READ} packed {MAPPED}"),
    _format("bag_zstd", "squeezed/squeezed.db3.zstd", f"{READ} squeezed {MAPPED}"),
    _format("bag_ros1", "place.bag", f"{READ} place.bag {MAPPED}"),
    _format("bag_alone", "bag/bag.db3", f"{READ} bag/bag.db3 {MAPPED}"),
    _format(
        "package", "pack/.soter-files.json pack/track.h pack/Makefile", "build track.soter -o pack"
    ),
    _format("channels", "channels.json", "channels channels.json"),
    _format("playground", "violated.soter", "playground violated.soter"),
    _format("vecnormalize", "norm.pkl", "policy ppo.zip --statistics norm.pkl"),
    _format("bag", "bag/bag.db3 bag/metadata.yaml", "monitor track.soter bag --map message.toml"),
    _format(
        "lateness",
        "late-lateness.json",
        "campaign track.soter --flights 1 --until 20ms --arms paper -o late",
    ),
)


def _channels(file: str) -> int:
    """What `soter.remote` reads of a package, so that a policy may write to its channels."""
    from soter.remote.channels_json import find_topics  # noqa: PLC0415 - only then

    return len(find_topics(file, None).all) and 0


def _played(file: str) -> int:
    """What a page asks of the playground about a text that somebody sent."""
    from soter.language.load.named_files import read_bytes  # noqa: PLC0415 - only then
    from soter.playground import session  # noqa: PLC0415 - the same

    text = read_bytes(Path(file), 2**22).decode("utf-8", "replace")
    session.layout(file, text)
    if json.loads(session.check(file, text))["ok"]:
        session.PlaygroundSession(file, text).about()
    return 0


CALLS = {"channels": _channels, "playground": _played}
"""Words that are no command -> what reads the file; SoterError and OSError are refusals."""


def more_samples(folder: Path) -> None:
    """Add them."""
    (folder / "lib.soter").write_text(LIBRARY)
    (folder / "uses.soter").write_text(USES)
    (folder / "plain.toml").write_text(POINT.replace('type = "{type}"\n', "").format())
    (folder / "channels.json").write_text(json.dumps(_document()))
    soter_says(folder, "build track.soter -o pack")
    (folder / "learned.soter").write_text(LEARNED)
    shutil.copy(POLICIES / "ppo.zip", folder / "ppo.zip")
    shutil.copy(POLICIES / "ppo_vecnormalize.pkl", folder / "norm.pkl")
    (folder / "own.xml").write_text(DIALECT)
    (folder / "Place.msg").write_text(TYPED)
    shutil.copy(MAVLINK / "geofence.soter", folder)
    mapping = (MAVLINK / "geofence.toml").read_text(encoding="utf-8")
    (folder / "geofence.toml").write_text(
        mapping.replace("[mavlink]\n", '[mavlink]\ndialect = "own.xml"\n', 1)
    )
    for name in ("common", "standard", "minimal"):
        shutil.copy(dialect_path(name, folder), folder)
    named = '[messages]\n"own/Place" = "Place.msg"\n'
    (folder / "message.toml").write_text(named + POINT.format(type="own/Place"))
    numbers = {"quantiles_ns": [0, 1000], "releases": 2, "period_ns": 10_000_000}
    (folder / "late-lateness.json").write_text(
        json.dumps({**numbers, "busy_processes": 4, "cores": 2}) + "\n"
    )
    _logs(folder)


def _logs(folder: Path) -> None:
    """A bag with places, the same as MCAP, and a small network as ONNX."""
    import numpy as np  # noqa: PLC0415 - only here
    from onnx import TensorProto, helper, numpy_helper  # noqa: PLC0415 - extras
    from onnx.external_data_helper import set_external_data  # noqa: PLC0415 - the same
    from rosbags.rosbag1 import Writer as Writer1  # noqa: PLC0415 - the same
    from rosbags.rosbag2 import (  # noqa: PLC0415 - the same
        CompressionFormat,
        CompressionMode,
        StoragePlugin,
        Writer,
    )
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(TYPED, "own/msg/Place"))
    place = store.types["own/msg/Place"]
    plugins = {"bag": StoragePlugin.SQLITE3, "packed": StoragePlugin.MCAP}
    for name in ("bag", "packed", "squeezed"):
        plugin = plugins.get(name, StoragePlugin.SQLITE3)
        writer = Writer(folder / name, version=9, storage_plugin=plugin)
        if name == "squeezed":
            writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
        with writer:
            channel = writer.add_connection("/place", "own/msg/Place", typestore=store)
            for k in range(60):
                message = place(x=k * 0.01, y=0.0, name="here")
                raw = store.serialize_cdr(message, "own/msg/Place")
                writer.write(channel, 10**18 + k * 10**7, raw)
    shutil.copy(folder / "packed" / "packed.mcap", folder / "place.mcap")
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(TYPED.replace("string<=10", "string"), "own/msg/Place"))
    place = store.types["own/msg/Place"]
    with Writer1(folder / "place.bag") as bag:
        channel1 = bag.add_connection("/place", "own/msg/Place", typestore=store)
        for k in range(60):
            raw = store.serialize_ros1(place(x=k * 0.01, y=0.0, name="here"), "own/msg/Place")
            bag.write(channel1, 10**18 + k * 10**7, raw)
    _loose(folder / "loose.mcap")
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["obs", "W", "B"], ["u"], transB=1)],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["batch", 2])],
        [helper.make_tensor_value_info("u", TensorProto.FLOAT, ["batch", 1])],
        [numpy_helper.from_array(np.ones(size, np.float32), name) for size, name in SIZES],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    (folder / "a.onnx").write_bytes(model.SerializeToString())
    weights = b""
    for tensor in model.graph.initializer:
        set_external_data(tensor, "weights", len(weights), len(tensor.raw_data))
        weights += tensor.raw_data
        tensor.ClearField("raw_data")
    (folder / "weights").write_bytes(weights)
    (folder / "b.onnx").write_bytes(model.SerializeToString())


def _loose(path: Path) -> None:
    """An MCAP of JSON without chunks."""
    from mcap.writer import Writer  # noqa: PLC0415 - an extra

    with path.open("wb") as file:
        writer: Any = Writer(file, use_chunking=False)
        writer.start()
        schema = writer.register_schema("place", "jsonschema", b"{}")
        channel = writer.register_channel("/place", "json", schema)
        for k in range(60):
            at = 10**18 + k * 10**7
            writer.add_message(channel, at, json.dumps({"x": k * 0.01}).encode(), at)
        writer.finish()


def _document() -> dict[str, object]:
    """A document as packages have it."""
    from soter.language.front_end import check_file, system_of  # noqa: PLC0415 - only then
    from soter.targets.world_interface import channel_document  # noqa: PLC0415 - the same

    program = ROOT / "examples" / "ros" / "shuttle_ros.soter"
    return channel_document(system_of(check_file(str(program)), None))


SIZES = (((1, 2), "W"), ((1,), "B"))
