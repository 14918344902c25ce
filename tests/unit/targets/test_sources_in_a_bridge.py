"""Several sources of one topic in the C++ of a bridge: the samples of `soter monitor`, to the bit.

The traits that are generated, the core of the bridge and a channel, without ROS.
Non-goals: how old the topic gets (`tests/unit/mapping/test_topic_sources.py`), nodes
(`tests/correct/test_ros_two_sensors.py`).
"""

from __future__ import annotations

import math
import random
import shutil
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

import processes
from generators.message_headers import write_headers
from generators.robot_logs import WRITERS, Recorded, odometry
from soter.api import load
from soter.mapping.read_mapping import make_log_map
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples
from soter.native.shared_library import CHECK_FAILED

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "ros"
SHUTTLE = EXAMPLES / "shuttle_ros.soter"
T0 = 1_700_000_000 * 10**9
MS = 10**6
FIELDS = {"value": {"from": "pose.pose.position.x", "scale": 0.3, "offset": -1.25}}
SOURCE = {"type": "nav_msgs/Odometry", "frame_id": "odom", "fields": FIELDS, "every": "10ms"}
MAPPING: dict[str, Any] = {
    "topics": {
        "position": {
            "sources": [
                {**SOURCE, "channel": "/odom", "measured": {"value": 0.05}},
                {**SOURCE, "channel": "/camera", "after": "20ms", "measured": {"value": 0.02}},
                {**SOURCE, "channel": "/laser", "after": "30ms", "measured": {"value": 0.03}},
            ]
        },
        "wish": {"channel": "/wish", "type": "std_msgs/Float64", "fields": {"value": "data"}},
    }
}
CHANNELS = ("/odom", "/camera", "/laser")
MAIN = """
#include "soter_bridge_core.hpp"
#include "shuttle_ros_topics.hpp"
#include <cstdio>
#include <cstdlib>
#include <iostream>
static nav_msgs::Odometry message(long long stamp, const std::string& x, const std::string& frame) {
  nav_msgs::Odometry m;
  m.header.stamp.sec = static_cast<uint32_t>(stamp / 1000000000);
  m.header.stamp.nsec = static_cast<uint32_t>(stamp % 1000000000);
  m.header.frame_id = frame;
  m.pose.pose.position.x = std::strtod(x.c_str(), nullptr);
  return m;
}
static void show(const soter::Status& status) {
  std::printf("status %s|%d|%s", status.name.c_str(), status.level, status.message.c_str());
  for (const auto& value : status.values) {
    std::printf("|%s=%s", value.first.c_str(), value.second.c_str());
  }
  std::printf("\\n");
}
int main(int, char** words) {
  soter::Inward<PositionIn1> first(0);
  soter::Inward<PositionIn2> second(0);
  soter::Inward<PositionIn3> third(0);
  soter_outside channel = soter_outside();
  const char* wrong = first.open(words[1]);
  const void* const place = soter::shared_channel<PositionSources>()->place[0];
  for (const char* next : {second.open(words[1]), third.open(words[1]),
                           soter_outside_open(&channel, words[1], PositionIn1::channel(),
                                              PositionIn1::hash(), sizeof(double), false)}) {
    wrong = wrong != nullptr ? wrong : next;
  }
  if (wrong != nullptr || place != soter::shared_channel<PositionSources>()->place[0]) {
    std::puts(wrong != nullptr ? wrong : "a source opened the channel of another anew");
    return 1;
  }
  std::string x, frame, who;
  long long now, stamp;
  int rank;
  while (std::cin >> rank >> now >> stamp >> x >> frame >> who) {
    const nav_msgs::Odometry m = message(stamp, x, frame);
    if (rank == 0) {
      first.take(m, who, soter::monotonic_ns(), now);
    } else if (rank == 1) {
      second.take(m, who, soter::monotonic_ns(), now);
    } else {
      third.take(m, who, soter::monotonic_ns(), now);
    }
    double value = 0.0;
    int64_t measured = 0;
    if (soter_outside_read(&channel, &measured, &value, nullptr)) {
      std::printf("%lld %lld %a\\n", now, stamp, value);
    }
  }
  show(first.status());
  show(second.status());
  show(third.status());
}
"""


@pytest.fixture(scope="module")
def system() -> Any:
    return load(SHUTTLE).flat("Vehicle")


@pytest.fixture(scope="module")
def bridge(system: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Lines of messages to what stands in the channel after each that was taken; statuses."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("cpp")
    (folder / "probe.cpp").write_text("#include <ros/datatypes.h>\n")
    probe = [compiler, "-fsyntax-only", "probe.cpp"]
    if processes.run(probe, cwd=folder, capture_output=True, check=False).returncode != 0:
        pytest.skip("no headers of ROS 1 here (libroscpp-dev)")
    mapped = make_log_map(MAPPING, system)
    for m in mapped.topics:
        assert m.message is not None
        write_headers(m.message, folder)
    load(SHUTTLE).build("ros1", folder / "out", "Vehicle", mapping=MAPPING)
    (folder / "main.cpp").write_text(MAIN)
    trusted = folder / "out" / "trusted"
    cc = shutil.which("gcc") or shutil.which("clang") or "cc"
    names = ["soter_outside.c", "soter_channel.c"]
    sources = [*(str(trusted / n) for n in names), str(CHECK_FAILED)]
    flags = [f"-I{trusted}", f"-I{folder / 'out' / 'src'}", "-I."]
    compile_c = [cc, "-std=c11", "-O1", "-c", *flags, *sources]
    processes.run(compile_c, cwd=folder, check=True, capture_output=True)
    words = [compiler, "-std=c++11", "-Wall", "-Wextra", "-Werror", "-O1", *flags]
    objects = sorted(p.name for p in folder.glob("*.o"))
    done = processes.run(
        [*words, "-o", "bridge", "main.cpp", *objects],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr

    def run(lines: list[str], channels: Path) -> tuple[list[list[str]], list[dict[str, str]]]:
        channels.mkdir()
        (folder / "lines.txt").write_text("\n".join(lines))
        with (folder / "lines.txt").open() as given:
            said = processes.run(
                [str(folder / "bridge"), str(channels)],
                stdin=given, capture_output=True, text=True, check=True,
            )  # fmt: skip
        told = said.stdout.splitlines()
        taken = [line.split() for line in told if not line.startswith("status")]
        return taken, [_status(line) for line in told if line.startswith("status")]

    return run


def _status(line: str) -> dict[str, str]:
    name, level, message, *values = line.removeprefix("status ").split("|")
    pairs = dict(value.split("=") for value in values)
    return {"name": name, "level": level, "message": message, **pairs}


def drive(
    draw: random.Random, wrong: float, speaks: Callable[[int, int], bool]
) -> list[tuple[int, Recorded]]:
    """Messages of three sources, by arrival, some of them wrong; a source speaks or is silent."""
    flight = []
    for rank in range(3):
        at = T0 + 100 * MS
        while at < T0 + 3000 * MS:
            at += draw.randint(5, 10) * MS + draw.randint(0, 999)
            if not speaks(rank, (at - T0) // MS):
                continue
            stamp = at - draw.randint(0, 9) * MS
            x, frame = draw.uniform(-9.0, 9.0), "odom"
            if draw.random() < wrong:
                stamp, x, frame = draw.choice([
                    (0, x, frame), (at + 5 * MS, x, frame), (stamp, x, "map"),
                    (stamp, math.nan, frame), (stamp, -math.inf, frame), (stamp, 500.0, frame),
                    (stamp - 60 * MS, x, frame),
                ])  # fmt: skip
            flight.append((rank, Recorded(at, odometry(stamp, x, 0.0, frame), CHANNELS[rank])))
    return sorted(flight, key=lambda m: (m[1].arrival_ns, m[0]))


def lines_of(flight: list[tuple[int, Recorded]]) -> list[str]:
    return [_line(rank, m) for rank, m in flight]


def _line(rank: int, m: Recorded, who: str = "/node") -> str:
    header = m.content["header"]
    stamp = header["stamp"]["sec"] * 10**9 + header["stamp"]["nanosec"]
    x = m.content["pose"]["pose"]["position"]["x"]
    shown = x.hex() if math.isfinite(x) else str(x)
    return f"{rank} {m.arrival_ns} {stamp} {shown} {header['frame_id']} {who}"


def by_turns(rank: int, ms: int) -> bool:
    """The first speaks half of the time, the second three quarters, the third always."""
    return (rank == 2) or (rank == 1 and ms % 800 < 600) or (rank == 0 and ms % 500 < 250)


@pytest.mark.parametrize("name", ["plain.bag", "cdr.mcap"])
@pytest.mark.parametrize("wrong", [0.0, 0.4])
def test_a_bridge_takes_the_samples_that_a_log_gives(
    system: Any, bridge: Any, tmp_path: Path, name: str, wrong: float
) -> None:
    flight = drive(random.Random(11), wrong, by_turns)  # noqa: S311 - values
    WRITERS[name](tmp_path / name, [m for _, m in flight])
    log_map = make_log_map({"topics": {"position": MAPPING["topics"]["position"]}}, system)
    (samples,) = read_samples(tmp_path / name, log_map, read_columns(tmp_path / name, log_map))
    first = min(m.arrival_ns for _, m in flight)
    of_log = [
        (now + first, stamp + first, struct.pack("<d", x))
        for now, stamp, x in zip(samples.times_ns, samples.stamps_ns, samples.values, strict=True)
    ]
    taken, told = bridge(lines_of(flight), tmp_path / "channels")
    assert [
        (int(now), int(stamp), struct.pack("<d", float.fromhex(x))) for now, stamp, x in taken
    ] == of_log
    assert len(of_log) > 150
    assert all(int(status["took over"]) > 2 for status in told), "no source took over"
    assert samples.sources.endswith(
        f"{sum(int(status['took over']) for status in told)} changes from one to the other"
    )
    assert [int(status["taken"]) for status in told] == [
        int(part.partition("(")[2].rstrip(")")) for part in samples.sources.split(", ")[:3]
    ]


def test_what_is_no_sample_blocks_no_other_source(bridge: Any, tmp_path: Path) -> None:
    """The first says NaN, another frame, a far future: the second is read all the time."""

    lines = []
    for k in range(1, 40):
        at = T0 + k * 10 * MS
        bad = (
            odometry(at, math.nan, 0.0), odometry(at, 1.0, 0.0, "map"),
            odometry(at + 3600 * 1000 * MS, 1.0, 0.0), odometry(at, 500.0, 0.0),
        )  # fmt: skip
        lines += [_line(0, Recorded(at, content)) for content in bad]
        lines.append(_line(1, Recorded(at, odometry(at, 2.0, 0.0))))
    taken, told = bridge(lines, tmp_path / "channels")
    assert len(taken) == 39
    first, second, _ = told
    assert (first["read"], first["level"]) == ("no", "2")
    assert first["not finite, or outside the set"] == "78"
    assert (second["read"], second["took over"], second["message"]) == ("yes", "0", "it is read")


def test_nothing_is_read_before_somebody_spoke(bridge: Any, tmp_path: Path) -> None:
    taken, told = bridge([], tmp_path / "channels")
    assert taken == []
    assert {status["read"] for status in told} == {"no"}


def test_each_source_has_a_publisher_of_its_own(bridge: Any, tmp_path: Path) -> None:
    at = [T0 + k * 100 * MS for k in range(1, 5)]
    lines = [
        _line(0, Recorded(at[0], odometry(at[0], 1.0, 0.0)), "/wheels"),
        _line(1, Recorded(at[1], odometry(at[1], 2.0, 0.0)), "/camera"),
        _line(0, Recorded(at[2], odometry(at[2], 3.0, 0.0)), "/camera"),
        _line(1, Recorded(at[3], odometry(at[3], 4.0, 0.0)), "/wheels"),
    ]
    taken, (first, second, _) = bridge(lines, tmp_path / "channels")
    assert [int(stamp) for _, stamp, _ in taken] == at[:2]
    assert (first["of another publisher"], second["of another publisher"]) == ("1", "1")


def test_a_source_that_stands_by_is_not_called_silent(bridge: Any, tmp_path: Path) -> None:
    at = [T0 + k * 10 * MS for k in range(1, 20)]
    lines = [_line(k, Recorded(t, odometry(t, 1.0, 0.0))) for t in at for k in (0, 1)]
    taken, (first, second, third) = bridge(lines, tmp_path / "channels")
    assert len(taken) == len(at)
    assert (first["message"], first["level"], first["taken"]) == ("it is read", "0", "19")
    assert (second["message"], second["level"]) == ("it stands by", "0")
    assert (second["not its turn"], second["taken"]) == ("19", "0")
    assert (third["message"], third["level"]) == ("silent", "1")
    assert first["longest between stamps taken, us"] == "10000"
