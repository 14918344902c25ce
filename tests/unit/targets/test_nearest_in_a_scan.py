"""What is nearest in a LaserScan, by the C++ of a bridge: what NaN, infinities, 0 and gaps mean.

Non-goals: what lies between two rays (`tests/correct/test_ground_robot.py`), other fields
(`test_message_conversion.py`).
"""

from __future__ import annotations

import math
import shutil
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

import processes
from generators.message_headers import write_headers
from generators.robot_logs import as_bag1, flight
from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.read_mapping import make_log_map
from soter.mapping.topic_mapping import NearestSource
from soter.monitor.log_files.read_columns import read_columns
from soter.native.shared_library import RUNTIME
from soter.targets.message_conversion import CPP, MessageConverter

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

PROGRAM = """soter 1;
type Nearest = { distance: float, bearing: float };
topic nearest: Nearest;
topic count: int;
topic out: Nearest;
plant P period 10ms {
  drives nearest = { distance: x, bearing: x };
  drives out = { distance: x, bearing: x };
  drives count = 0;
  state x: float;
}
system S { p: P; until 1s; }
"""
SCAN: dict[str, Any] = {"channel": "/scan", "type": "sensor_msgs/LaserScan"}
LEAVES: dict[str, Any] = {
    "distance": {"nearest": "distance", "most": 2.0, "unseen": 2},
    "bearing": {"nearest": "bearing", "most": 2.0, "unseen": 2},
}
MAIN = """
#include <sensor_msgs/LaserScan.h>
#include "soter_scan.hpp"
#include <cstdio>
#include <cstdlib>
#include <iostream>
struct Nearest { double distance, bearing; };
static bool convert(const sensor_msgs::LaserScan& m, Nearest* to) {
  %s
}
int main() {
  std::string first, step, time, range;
  unsigned long n, sec, nsec;
  while (std::cin >> first >> step >> time >> sec >> nsec >> n) {
    sensor_msgs::LaserScan m;
    m.angle_min = std::strtof(first.c_str(), nullptr);
    m.angle_increment = std::strtof(step.c_str(), nullptr);
    m.time_increment = std::strtof(time.c_str(), nullptr);
    m.header.stamp.sec = static_cast<uint32_t>(sec);
    m.header.stamp.nsec = static_cast<uint32_t>(nsec);
    for (unsigned long i = 0; i < n; i++) {
      std::cin >> range;
      m.ranges.push_back(std::strtof(range.c_str(), nullptr));
    }
    Nearest to = {-1.0, -1.0};
    const bool taken = convert(m, &to);
    const int64_t stamp = static_cast<int64_t>(m.header.stamp.sec) * 1000000000 +
                          static_cast<int64_t>(m.header.stamp.nsec);
    const int64_t last = soter::last_ray_ns(m, stamp);
    std::printf("%%d %%.6f %%.6f %%lld %%lld\\n", taken, to.distance, to.bearing,
                static_cast<long long>(last / 1000000000),
                static_cast<long long>(last %% 1000000000));
  }
}
"""
STEP = 2.0 * math.pi / 8.0


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("program") / "p.soter"
    path.write_text(PROGRAM)
    return load(path).flat()


def mapped(system: Any, leaves: Any = None, topic: str = "nearest", **more: Any) -> Any:
    given = {**SCAN, "fields": LEAVES if leaves is None else leaves, **more}
    return make_log_map({"topics": {topic: given}}, system).topics[0]


@pytest.fixture(scope="module")
def seen(system: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A scan to what the generated conversion makes of it."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler here")
    folder = tmp_path_factory.mktemp("cpp")
    made = mapped(system)
    write_headers(made.message, folder)
    shutil.copy(RUNTIME / "bridge" / "soter_scan.hpp", folder)
    lines = "\n  ".join(MessageConverter(made, 1, CPP, "m").inward_statements())
    (folder / "main.cpp").write_text(MAIN % lines)
    words = [compiler, "-std=c++11", "-Wall", "-Wextra", "-Werror", "-I.", "-o", "see", "main.cpp"]
    done = processes.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr

    def run(
        ranges: Sequence[float],
        first: float = 0.0,
        step: float = STEP,
        time: float = 0.0,
        stamp: tuple[int, int] = (100, 0),
    ) -> tuple[bool, float, float, tuple[int, int]]:
        shown = " ".join(map(str, (first, step, time, *stamp, len(ranges), *ranges)))
        (folder / "scan.txt").write_text(shown)
        with (folder / "scan.txt").open() as given:
            said = processes.run(
                [str(folder / "see")], stdin=given, capture_output=True, text=True, check=True
            )
        taken, distance, bearing, sec, nsec = said.stdout.split()
        return taken == "1", float(distance), float(bearing), (int(sec), int(nsec))

    return run


INF, NAN = math.inf, math.nan


@pytest.mark.parametrize(
    ("ranges", "distance", "ray"),
    [
        ([1.0, 1.5, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0], 0.5, 2),
        ([1.0, 1.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.25], 0.25, 7),
        ([INF] * 8, 2.0, 0),  # an empty hall
        ([9.0] * 8, 2.0, 0),
        ([1.0, -INF, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], 0.0, 1),  # too near to be measured
        ([NAN, 0.0, 1.0, 1.0, 1.0, 0.5, 1.0, 1.0], 0.5, 5),  # two in a row may be unseen
        ([-1.0, 0.5, NAN, 1.0, 0.0, 1.0, NAN, 1.0], 0.5, 1),
    ],
)
def test_what_is_nearest(seen: Any, ranges: list[float], distance: float, ray: int) -> None:
    taken, told, bearing, _ = seen(ranges)
    assert taken
    assert told == pytest.approx(distance)
    assert math.cos(bearing - ray * STEP) == pytest.approx(1.0)
    assert -math.pi - 1e-6 <= bearing <= math.pi + 1e-6


@pytest.mark.parametrize(
    ("first", "step", "bearing"),
    [
        (-math.pi, STEP, -math.pi / 2.0),
        (-math.pi / 2.0, STEP, 0.0),
        (0.0, -STEP, -math.pi / 2.0),
        (math.pi, STEP, -math.pi / 2.0),
        (20.0 * math.pi, STEP, math.pi / 2.0),
    ],
)
def test_bearings_begin_where_the_scan_says(
    seen: Any, first: float, step: float, bearing: float
) -> None:
    ranges = [1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert seen(ranges, first, step)[2] == pytest.approx(bearing, abs=1e-4)


@pytest.mark.parametrize(
    "ranges",
    [
        [NAN] * 8,
        [0.0] * 8,
        [1.0, NAN, 0.0, -1.0, 1.0, 1.0, 1.0, 1.0],
        [NAN, 1.0, 1.0, 1.0, 1.0, 1.0, NAN, NAN],  # the first ray follows the last
        [NAN, NAN, 1.0, 1.0, 1.0, 1.0, 1.0, NAN],
        [],
    ],
)
def test_a_scan_with_a_sector_unseen_is_not_taken(seen: Any, ranges: list[float]) -> None:
    assert not seen(ranges)[0]


@pytest.mark.parametrize(
    ("n", "first", "step", "taken"),
    [
        (8, 0.0, STEP, True),
        (8, -math.pi, STEP, True),
        (8, 0.0, -STEP, True),  # clockwise
        (9, -math.pi, STEP, True),  # the last ray looks where the first one does
        (7, 0.0, STEP, True),  # no ray at the seam, which is within one step
        (6, 0.0, STEP, False),
        (10, 0.0, STEP, False),
        (4, -math.pi / 2.0, STEP, False),  # half of the world
        (8, 0.0, NAN, False),
        (8, 0.0, 0.0, False),
        (8, INF, STEP, False),
    ],
)
def test_rays_go_round_once(seen: Any, n: int, first: float, step: float, *, taken: bool) -> None:
    assert seen([1.0] * n, first, step)[0] == taken


@pytest.mark.parametrize(
    ("time", "stamp", "measured"),
    [
        (0.01, (100, 0), (100, 70_000_000)),  # seven rays after the first one
        (0.01, (100, 950_000_000), (101, 20_000_000)),
        (0.0, (100, 0), (100, 0)),
        (-0.01, (100, 0), (100, 0)),
        (NAN, (100, 0), (100, 0)),
        (1.0, (100, 0), (100, 0)),  # seven seconds are no sweep
        (0.01, (0, 0), (0, 0)),  # no stamp stays none
    ],
)
def test_a_scan_is_as_old_as_its_last_ray(
    seen: Any, time: float, stamp: tuple[int, int], measured: tuple[int, int]
) -> None:
    sec, nsec = seen([1.0] * 8, time=time, stamp=stamp)[3]
    assert sec == measured[0]
    assert abs(nsec - measured[1]) < 100  # a float32 of a time


# ---------------------------------------------------------------- what a mapping may say


def test_the_leaf_is_read(system: Any) -> None:
    leaves = mapped(system).leaves
    assert leaves["distance",] == NearestSource("distance", 2.0, 2)
    assert leaves["bearing",] == NearestSource("bearing", 2.0, 2)


@pytest.mark.parametrize(
    ("leaf", "told"),
    [
        ({"nearest": "range", "most": 2.0}, "is distance or bearing, not 'range'"),
        ({"nearest": "distance"}, "needs `most`"),
        ({"nearest": "distance", "most": 0.0}, "needs `most`"),
        ({"nearest": "distance", "most": math.inf}, "needs `most`"),
        ({"nearest": "distance", "most": True}, "needs `most`"),
        ({"nearest": "distance", "most": 2.0, "unseen": -1}, "no number of rays"),
        ({"nearest": "distance", "most": 2.0, "unseen": True}, "no number of rays"),
        ({"nearest": "distance", "most": 2.0, "unseen": 1.5}, "no number of rays"),
        ({"nearest": "distance", "most": 2.0, "scale": 2.0}, "says `scale`"),
        ({"nearest": "distance", "most": 2.0, "from": "ranges.0"}, "needs one of"),
    ],
)
def test_a_wrong_leaf_is_told(system: Any, leaf: Any, told: str) -> None:
    with pytest.raises(SoterError, match=told) as error:
        mapped(system, {**LEAVES, "distance": leaf})
    assert {d.code for d in error.value.diagnostics} == {"D015"}


def test_only_a_scan_has_something_nearest(system: Any) -> None:
    with pytest.raises(SoterError, match="its `type` is sensor_msgs/LaserScan"):
        mapped(system, type="sensor_msgs/PointCloud2")
    with pytest.raises(SoterError, match="a float"):
        mapped(system, {"value": LEAVES["distance"]}, topic="count")


def test_no_scan_is_made_of_what_goes_out(system: Any) -> None:
    with pytest.raises(SoterError, match="no scan is made of it") as error:
        MessageConverter(mapped(system, topic="out"), 1, CPP, "m").outward_statements()
    assert error.value.diagnostics[0].code == "D015"


def test_a_log_cannot_give_it_and_says_so(system: Any, tmp_path: Path) -> None:
    wanted = make_log_map({"topics": {"nearest": {**SCAN, "fields": LEAVES}}}, system)
    as_bag1(tmp_path / "drive.bag", flight())
    with pytest.raises(SoterError, match="is what is nearest in a scan") as told:
        read_columns(tmp_path / "drive.bag", wanted)
    assert told.value.diagnostics[0].code == "D016"
