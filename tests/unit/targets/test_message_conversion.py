"""Messages as values of topics, in C++: the bits of `monitor`, and what cannot be is refused.

Non-goals: how messages come (`tests/correct/test_ros_nodes.py`), what a mapping may say
(`tests/unit/mapping/`).
"""

from __future__ import annotations

import math
import random
import shutil
import struct
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

import processes
from generators.message_headers import write_headers
from generators.robot_logs import Recorded, as_bag1, stamped
from soter.api import load
from soter.codegen.unit import generate
from soter.core.steps import lower
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.read_mapping import make_log_map
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples
from soter.native.compiler import MEANING
from soter.targets.message_conversion import CPP, MessageConverter, text_literal

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Gear = enum { LOW, HIGH, BACK };
type Motion = {
  x: float unit "m", v: float unit "cm/s", c: float, n: int in [0, 200], gear: Gear, still: float
};
topic motion: Motion;
topic ranges: float[2];
topic out: Motion;
topic big: int;
plant P period 10ms {
  drives motion = { x: x, v: x, c: x, n: 0, gear: Gear.LOW, still: 0.0 };
  drives out = { x: x, v: x, c: x, n: 0, gear: Gear.LOW, still: 0.0 };
  drives ranges = [x, x];
  drives big = 0;
  state x: float;
}
system S { p: P; until 1s; }
"""
ODOMETRY = {"channel": "/odom", "type": "nav_msgs/Odometry"}
FIELDS: dict[str, Any] = {
    "x": {"from": "pose.pose.position.x", "scale": 0.3, "offset": -1.25},
    "v": "twist.twist.linear.x",
    "c": "pose.covariance.7",
    "n": "header.seq",
    "gear": "child_frame_id",
    "still": {"constant": 0.1},
}
MAIN = """
#include "p.h"
#include <nav_msgs/Odometry.h>
#include <sensor_msgs/LaserScan.h>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
struct Motion {
  typedef nav_msgs::Odometry Message;
  typedef %(type)s Value;
  static bool convert(const Message& m, Value* to) {
    %(motion)s
  }
};
static bool ranges(const sensor_msgs::LaserScan& m, %(pair)s* to) {
  %(ranges)s
}
int main() {
  std::string x, v, c, gear;
  unsigned long n, elements;
  while (std::cin >> x >> v >> c >> n >> gear >> elements) {
    nav_msgs::Odometry m;
    m.pose.pose.position.x = std::strtod(x.c_str(), nullptr);
    m.twist.twist.linear.x = std::strtod(v.c_str(), nullptr);
    m.pose.covariance[7] = std::strtod(c.c_str(), nullptr);
    m.header.seq = static_cast<uint32_t>(n);
    m.child_frame_id = gear;
    Motion::Value value;
    std::memset(&value, 0, sizeof value);
    sensor_msgs::LaserScan scan;
    scan.ranges.resize(elements, 1.5F);
    %(pair)s two;
    std::memset(&two, 0, sizeof two);
    const bool fine = Motion::convert(m, &value), seen = ranges(scan, &two);
    std::printf("%%d %%a %%a %%a %%u %%u %%a %%d %%a\\n", fine, value.x, value.v, value.c,
                unsigned(value.n), unsigned(value.gear), value.still, seen, two.at[1]);
  }
}
"""


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("program") / "p.soter"
    path.write_text(PROGRAM)
    program = load(path)
    assert program.ok, program.diagnostics
    return program.flat()


def mapped(system: Any, topic: str, given: Any) -> Any:
    return make_log_map({"topics": {topic: given}}, system).topics[0]


@pytest.fixture(scope="module")
def convert(system: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Lines of messages to lines of values, by the C++ that is generated."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("cpp")
    motion = mapped(system, "motion", {**ODOMETRY, "fields": FIELDS})
    scan = mapped(system, "ranges", {
        "channel": "/scan", "type": "sensor_msgs/LaserScan", "stamp": "arrival",
        "fields": {"[0]": "ranges.0", "[1]": "ranges.4"},
    })  # fmt: skip
    for m in (motion, scan):
        write_headers(m.message, folder)
    unit = generate(system, lower(system))
    (folder / "p.h").write_text(unit.header)
    for name in ("soter.h", "soter_check.h"):
        shutil.copy(_runtime() / name, folder / name)
    text = MAIN % {
        "type": unit.topics[motion.topic.index][0],
        "pair": unit.topics[scan.topic.index][0],
        "motion": "\n    ".join(MessageConverter(motion, 1, CPP, "m").inward_statements()),
        "ranges": "\n  ".join(MessageConverter(scan, 1, CPP, "m").inward_statements()),
    }
    (folder / "main.cpp").write_text(text)
    words = [compiler, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O2", *MEANING, "-I."]
    done = processes.run(
        [*words, "-o", "convert", "main.cpp"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr

    def run(lines: list[str]) -> list[list[str]]:
        (folder / "lines.txt").write_text("\n".join(lines))
        with (folder / "lines.txt").open() as given:
            said = processes.run(
                [str(folder / "convert")], stdin=given, capture_output=True, text=True, check=True
            )
        return [line.split() for line in said.stdout.splitlines()]

    return run


def _runtime() -> Path:
    from soter.native.shared_library import RUNTIME

    return RUNTIME


def bits(x: float | str) -> bytes:
    return struct.pack("<d", float.fromhex(x) if isinstance(x, str) else x)


def test_generated_code_and_monitor_give_the_same_bits(
    system: Any, convert: Any, tmp_path: Path
) -> None:
    draw = random.Random(7)  # noqa: S311 - values
    flight, lines = [], []
    for k in range(400):
        x, v, c = (draw.choice((1.0, 1e-3, 1e150, 5e-324)) * draw.uniform(-9, 9) for _ in range(3))
        n, gear = draw.randrange(201), draw.choice(("LOW", "HIGH", "BACK"))
        content = {
            "header": {**stamped(10**18 + k * 10**6), "seq": n},
            "child_frame_id": gear,
            "pose": {
                "pose": {"position": {"x": x}},
                "covariance": [c if i == 7 else 0.0 for i in range(36)],
            },
            "twist": {"twist": {"linear": {"x": v}}},
        }
        flight.append(Recorded(10**18 + k * 10**6, content))
        lines.append(f"{x.hex()} {v.hex()} {c.hex()} {n} {gear} 5")
    as_bag1(tmp_path / "flight.bag", flight)
    log_map = make_log_map({"topics": {"motion": {**ODOMETRY, "fields": FIELDS}}}, system)
    columns = read_columns(tmp_path / "flight.bag", log_map)
    (samples,) = read_samples(tmp_path / "flight.bag", log_map, columns)
    told = convert(lines)
    assert len(samples.values) == len(told) == 400
    for (x, v, c, n, gear, still), row in zip(samples.values, told, strict=True):
        assert row[0] == "1"
        assert [bits(x), bits(v), bits(c)] == [bits(r) for r in row[1:4]]
        assert [str(n), str(gear)] == row[4:6]
        assert bits(still) == bits(row[6])


@pytest.mark.parametrize(
    ("line", "taken"),
    [
        ("1.0 1.0 1.0 200 LOW 5", ("1", "1")),
        ("1.0 1.0 1.0 256 LOW 5", ("0", "1")),  # the storage of the topic cannot hold it
        ("1.0 1.0 1.0 4294967295 LOW 5", ("0", "1")),
        ("1.0 1.0 1.0 0 low 5", ("0", "1")),
        ("1.0 1.0 1.0 0 LOW 4", ("1", "0")),  # no fifth range
        ("1.0 1.0 1.0 0 LOW 0", ("1", "0")),
        ("nan inf 1.0 0 LOW 5", ("1", "1")),  # judged by the trusted part
    ],
)
def test_what_a_topic_cannot_hold_is_not_taken(
    convert: Any, line: str, taken: tuple[str, str]
) -> None:
    (row,) = convert([line])
    assert (row[0], row[7]) == taken


def test_a_nan_stays_one_for_whoever_judges(convert: Any) -> None:
    (row,) = convert(["nan 1.0 1.0 0 LOW 5"])
    assert math.isnan(float.fromhex(row[1]))


def test_the_way_out_is_the_way_in_backwards(system: Any) -> None:
    out = mapped(system, "out", {**ODOMETRY, "fields": FIELDS, "set": {"header.frame_id": 'a"b\\'}})
    lines = MessageConverter(out, 1, CPP, "m").outward_statements()
    assert "m.pose.pose.position.x = (((*from).x - -1.25) / 0.3);" in lines
    assert any("child_frame_id" in x and '"BACK"' in x for x in lines)
    assert 'm.header.frame_id = "a\\042b\\134";' in lines
    assert not any("still" in x for x in lines)


@pytest.mark.parametrize(
    ("topic", "fields", "what"),
    [
        ("motion", {**FIELDS, "still": {"slope": "x", "window": "1s"}}, "is a slope"),
        ("out", {**FIELDS, "c": "pose.covariance.1"}, ""),
    ],
)
def test_what_no_code_can_do_is_said(system: Any, topic: str, fields: Any, what: str) -> None:
    made = MessageConverter(mapped(system, topic, {**ODOMETRY, "fields": fields}), 1, CPP, "m")
    if not what:
        assert made.outward_statements()
        return
    with pytest.raises(SoterError, match=what) as error:
        made.inward_statements()
    assert error.value.diagnostics[0].code == "D015"


def test_an_int_that_the_field_cannot_hold_does_not_go_out(system: Any) -> None:
    given = {"channel": "/n", "type": "std_msgs/Int32", "fields": {"value": "data"}}
    with pytest.raises(SoterError, match="which a `int32` cannot hold"):
        MessageConverter(mapped(system, "big", given), 1, CPP, "m").outward_statements()


@pytest.mark.parametrize("text", ['"; system("x"); //', "a\nb", "\\", "\x1b[2J", "ä"])
def test_a_text_of_a_mapping_stays_a_text(text: str) -> None:
    literal = text_literal(text)
    assert literal.isascii()
    assert '"' not in literal[1:-1]
    assert "\n" not in literal
