"""`ModuleStatus.msg` and the class that the bridge has of it are one message."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soter.targets.ros_sources import FIELDS, message_definition, message_files

NAME = "shuttle/msg/ModuleStatus"


def test_the_sum_is_the_one_that_ros_computes_of_the_file() -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(message_definition(), NAME))
    _, digest = store.generate_msgdef(NAME, ros_version=1)
    (file, code) = message_files("shuttle")
    assert file.text == message_definition()
    assert re.findall(r'return "([0-9a-f]{32})"', code.text) == [digest]


def test_every_field_is_streamed_in_the_order_of_the_file() -> None:
    (_, code) = message_files("shuttle")
    assert re.findall(r"stream\.next\(m\.(\w+)\)", code.text) == [name for _, name, _ in FIELDS]
    literals = re.findall(r'^ +"(.*)\\n"', code.text, re.MULTILINE)
    assert literals == message_definition().splitlines()
