"""Fields of protobuf that nobody set are no sample: their defaults were never measured.

Non-goals: fields without presence, of which nobody can tell whether they were set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap_protobuf.writer import Writer

from generators.robot_logs import CART, MS, T0
from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.monitor.log_files.read_columns import NoPartError, message_part

if TYPE_CHECKING:
    from pathlib import Path

DOUBLE, MESSAGE, ONE, MANY = 1, 11, 1, 3


def odometry_class() -> Any:
    """A message with a sub-message, an `optional` scalar, a oneof and a plain scalar."""
    file = descriptor_pb2.FileDescriptorProto(name="o.proto", package="o", syntax="proto3")
    pose = file.message_type.add(name="Pose")
    pose.field.add(name="x", number=1, type=DOUBLE, label=ONE)
    pose.field.add(name="all", number=2, type=DOUBLE, label=MANY)
    odom = file.message_type.add(name="Odom")
    odom.field.add(name="pose", number=1, type=MESSAGE, type_name=".o.Pose", label=ONE)
    odom.field.add(name="plain", number=2, type=DOUBLE, label=ONE)
    odom.oneof_decl.add(name="either")
    for number, name in enumerate(("fast", "slow"), 3):
        odom.field.add(name=name, number=number, type=DOUBLE, label=ONE, oneof_index=0)
    odom.oneof_decl.add(name="_maybe")
    maybe = odom.field.add(name="maybe", number=5, type=DOUBLE, label=ONE, oneof_index=1)
    maybe.proto3_optional = True
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("o.Odom"))


PATHS = ["pose.x", "pose.all.0", "maybe", "fast"]


@pytest.mark.parametrize("path", PATHS)
def test_what_nobody_set_has_no_value(path: str) -> None:
    message = odometry_class()(slow=1.0)
    assert message_part(message, path) is None
    message = odometry_class()(pose={"x": 0.0, "all": [0.0]}, maybe=0.0, fast=0.0)
    assert message_part(message, path) == 0.0
    assert message_part(message, "plain") == 0.0
    with pytest.raises(NoPartError):
        message_part(odometry_class()(), "pose.y")


def log_of(path: Path, names: tuple[str, str], messages: list[Any]) -> tuple[Path, Any]:
    with path.open("wb") as file, Writer(file) as writer:
        for k, message in enumerate(messages):
            now = T0 + k * 10 * MS
            writer.write_message("/odom", message, now, now)
    fields = dict(zip("xv", names, strict=True))
    return path, {"topics": {"motion": {"channel": "/odom", "fields": fields}}}


@pytest.mark.parametrize("path", PATHS)
def test_a_message_without_a_field_that_is_mapped_gives_no_sample(
    tmp_path: Path, path: str
) -> None:
    set_ = odometry_class()(pose={"x": 0.0, "all": [0.0]}, maybe=0.0, fast=0.0)
    unset = odometry_class()(plain=1.0, slow=1.0)
    log, mapping = log_of(tmp_path / "a.mcap", (path, "plain"), [set_] * 20 + [unset] * 20)
    judged = load(CART).judge_log(log, mapping, system="Protected")
    assert judged.samples["motion"] == 20
    count, first = judged.left_out["motion"]
    assert (count, first) == (20, "message 21 of `/odom`: no finite number for `motion.x`")
    log, mapping = log_of(tmp_path / "b.mcap", (path, "plain"), [unset] * 20)
    with pytest.raises(SoterError, match="no row of it has all of `motion`"):
        load(CART).judge_log(log, mapping, system="Protected")
