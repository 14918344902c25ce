"""More formats than `bad_input_samples.py` has: what names other files, and what others wrote.

Purpose: `more_samples` adds to the folder of samples a dialect of MAVLink and a message definition
with mappings that name them, policies, a bag of ROS 2 and a lateness, each with the command that
reads it.
Non-goals: making them wrong (`hostile_files.py`).
"""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

from bench.hostile.bad_input_samples import ROOT, Format

from soter.mapping.mavlink_types import dialect_path

if TYPE_CHECKING:
    from pathlib import Path

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
    _format("policy_onnx", "a.onnx", "policy a.onnx"),
    _format("vecnormalize", "norm.pkl", "policy ppo.zip --statistics norm.pkl"),
    _format("bag", "bag/bag.db3 bag/metadata.yaml", "monitor track.soter bag --map message.toml"),
    _format(
        "lateness",
        "late-lateness.json",
        "campaign track.soter --flights 1 --until 20ms --arms paper -o late",
    ),
)


def more_samples(folder: Path) -> None:
    """Add them."""
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
    from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415 - the same
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(TYPED, "own/msg/Place"))
    place = store.types["own/msg/Place"]
    for name, plugin in (("bag", StoragePlugin.SQLITE3), ("packed", StoragePlugin.MCAP)):
        with Writer(folder / name, version=9, storage_plugin=plugin) as writer:
            channel = writer.add_connection("/place", "own/msg/Place", typestore=store)
            for k in range(60):
                message = place(x=k * 0.01, y=0.0, name="here")
                raw = store.serialize_cdr(message, "own/msg/Place")
                writer.write(channel, 10**18 + k * 10**7, raw)
    shutil.copy(folder / "packed" / "packed.mcap", folder / "place.mcap")
    shutil.rmtree(folder / "packed")
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["obs", "W", "B"], ["u"], transB=1)],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["batch", 2])],
        [helper.make_tensor_value_info("u", TensorProto.FLOAT, ["batch", 1])],
        [numpy_helper.from_array(np.ones(size, np.float32), name) for size, name in SIZES],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    (folder / "a.onnx").write_bytes(made.SerializeToString())


SIZES = (((1, 2), "W"), ((1,), "B"))
