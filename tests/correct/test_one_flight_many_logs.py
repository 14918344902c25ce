"""One flight in every kind of log: the same values to the bit, the same ages, the same verdict.

Non-goals: logs that do not fit (`tests/unit/monitor/test_logs_of_messages.py`).
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import CHANNEL, WRITERS, Recorded, odometry
from soter.api import load
from soter.mapping.read_mapping import make_log_map
from soter.monitor.log_files.read_columns import read_columns
from soter.monitor.typed_samples import read_samples

if TYPE_CHECKING:
    from soter.monitor.log_judgement import LogJudgement

CART = Path(__file__).resolve().parents[2] / "examples" / "wall" / "cart.soter"
EPOCH_NS = 1_700_000_000 * 10**9
MS = 10**6
FIELDS = {"x": "pose.pose.position.x", "v": "twist.twist.linear.x"}
MOTION = {
    "channel": CHANNEL,
    "type": "nav_msgs/Odometry",
    "frame_id": "odom",
    "fields": FIELDS,
}


def mapping(name: str, **motion: Any) -> dict[str, Any]:
    given: dict[str, Any] = {"system": "Protected", "topics": {"motion": {**MOTION, **motion}}}
    return {**given, "time": {"from": "t", "unit": "ns"}} if name.endswith(".csv") else given


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> list[Recorded]:
    """A run of the cart, as an estimator would have told it: late, twice stopped, once confused."""
    from mcap.reader import make_reader

    log = tmp_path_factory.mktemp("run") / "run.mcap"
    load(CART).simulate(system="Protected", seed=5, until="4s", log=log)
    recorded = []
    with log.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=["motion"]):
            at, said = EPOCH_NS + message.log_time, json.loads(message.data)
            late = 25 * MS if 1000 * MS < message.log_time < 1200 * MS else 3 * MS + 17
            frame = "map" if message.log_time % (100 * MS) == 0 else "odom"
            recorded.append(Recorded(at, odometry(at - late, said["x"], said["v"], frame)))
    assert len(recorded) > 300
    return recorded


def judged(flight: list[Recorded], folder: Path, name: str, **motion: Any) -> LogJudgement:
    WRITERS[name](folder / name, flight)
    return load(CART).judge_log(folder / name, mapping(name, **motion))


def bits(flight: list[Recorded], folder: Path, name: str) -> list[tuple[int, int, bytes]]:
    """Times, stamps and the bits of the values that a log gives."""
    WRITERS[name](folder / name, flight)
    system = load(CART).flat("Protected")
    log_map = make_log_map(mapping(name), system)
    (samples,) = read_samples(folder / name, log_map, read_columns(folder / name, log_map))
    values = [struct.pack("<dd", *value) for value in samples.values]
    return list(zip(samples.times_ns, samples.stamps_ns, values, strict=True))


@pytest.mark.parametrize("name", list(WRITERS)[1:])
def test_every_kind_of_log_gives_the_same_values_to_the_bit(
    flight: list[Recorded], tmp_path: Path, name: str
) -> None:
    assert bits(flight, tmp_path, name) == bits(flight, tmp_path, "flight.csv")


def test_the_values_of_a_log_are_those_that_were_written(
    flight: list[Recorded], tmp_path: Path
) -> None:
    said = [
        (m.content["pose"]["pose"]["position"]["x"], m.content["twist"]["twist"]["linear"]["x"])
        for m in flight
        if m.content["header"]["frame_id"] == "odom"
    ]
    read = [struct.unpack("<dd", values) for _, _, values in bits(flight, tmp_path, "plain.bag")]
    assert set(read) <= set(said)
    assert len(read) > 0.8 * len(said)


@pytest.mark.parametrize("name", list(WRITERS)[1:])
def test_every_kind_of_log_gives_the_same_verdict(
    flight: list[Recorded], tmp_path: Path, name: str
) -> None:
    one, other = judged(flight, tmp_path, "flight.csv"), judged(flight, tmp_path, name)
    assert one.modules == other.modules
    assert one.samples == other.samples
    assert one.left_out.keys() == other.left_out.keys() == {"motion"}
    assert one.left_out["motion"][0] == other.left_out["motion"][0]
    (module,) = one.modules
    assert module.stale, "late messages make no difference: the test says nothing of ages"
    assert module.switches, "a flight without a switch says little"


def test_ages_count_from_stamps_and_where_nobody_says_so_from_arrival(
    flight: list[Recorded], tmp_path: Path
) -> None:
    by_stamp = judged(flight, tmp_path, "cdr.mcap")
    by_arrival = judged(flight, tmp_path, "cdr.mcap", stamp="arrival")
    said = "ages count from stamps, in the clock of the log: `motion` (`header.stamp`)"
    assert said in by_stamp.assumptions
    assert said not in by_arrival.assumptions
    (stamped,), (arrived,) = by_stamp.modules, by_arrival.modules
    assert arrived.stale == 0
    assert stamped.stale >= 3  # for 200 ms, at 50 ms a step


def test_a_late_sample_is_visible_when_it_arrives_and_not_when_it_was_measured(
    tmp_path: Path,
) -> None:
    """It was measured before the step of the DM at 100 ms, and the cart is at the wall in it."""

    def takeovers(arrival_ms: int) -> int:
        told = [(0, -1, 0.0), (90, 89, 0.0), (arrival_ms, 98, 9.9), (145, 144, 9.9)]
        flight = [
            Recorded(EPOCH_NS + at * MS, odometry(EPOCH_NS + measured * MS, x, 0.0))
            for at, measured, x in told
        ]
        (module,) = judged(flight, tmp_path, "json.mcap").modules
        return module.ttf

    assert takeovers(99) == 1
    assert takeovers(104) == 0


def test_lines_go_on_from_when_samples_were_measured(tmp_path: Path) -> None:
    """x grows by 1 m/s and is told 30 ms late: a line through arrivals would lag."""
    flight = [
        Recorded(
            EPOCH_NS + k * 20 * MS, odometry(EPOCH_NS + (k * 20 - 30) * MS, 0.02 * k - 0.03, 1.0)
        )
        for k in range(60)
    ]
    WRITERS["ros2_plain"](tmp_path / "a", flight)
    log_map = make_log_map(mapping("a", between="linear"), load(CART).flat("Protected"))
    (samples,) = read_samples(tmp_path / "a", log_map, read_columns(tmp_path / "a", log_map))
    assert samples.value_at(500 * MS) == (pytest.approx(0.5, abs=1e-9), 1.0)
