"""Times that go back, that are equal, and other times than the recorder's: of every kind of log.

Non-goals: stamps (`test_logs_of_messages.py`), slopes and lines.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import CART, MS, T0, TYPED, WRITERS, Recorded, flight, odometry, written
from long_tests import some
from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

    from soter.monitor.log_judgement import LogJudgement

ALL = list(WRITERS)
FIRST = sorted(
    ALL, key=lambda n: n not in ("flight.csv", "cdr.mcap", "plain.bag", "ros2_plain", "ros2_mcap")
)
"""One of each kind first: the others in a long run."""


def judged(log: Path, motion: Any = None, **time: Any) -> LogJudgement:
    """The cart's module on a log of any kind; `time`: keys of the table of that name."""
    if log.suffix == ".csv":
        time = {"from": "t", "unit": "ns", **time}
    given: dict[str, Any] = {"topics": {"motion": {**TYPED, **(motion or {})}}, "time": time}
    return load(CART).judge_log(log, given, system="Protected")


def told(log: Path, motion: Any = None, **time: Any) -> str:
    with pytest.raises(SoterError) as error:
        judged(log, motion, **time)
    (problem,) = error.value.diagnostics
    return " ".join((problem.code, problem.message, *problem.helps))


def beside(folder: Path) -> Path:
    """Another folder in it, for a second log of the same name."""
    (folder / "b").mkdir(exist_ok=True)
    return folder / "b"


def arrivals(*times_ms: int) -> list[Recorded]:
    """A message each at these times, measured every 10 ms."""
    return [
        Recorded(T0 + at * MS, odometry(T0 + (k + 1) * 10 * MS, 0.01 * k, 0.1))
        for k, at in enumerate(times_ms)
    ]


STEP = [20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 75, 85, 95, 105, 115, 125]


@all_rows("name", ALL)
def test_a_clock_that_was_set_back_is_told_with_where_and_how_much(
    tmp_path: Path, name: str
) -> None:
    text = told(written(tmp_path, name, arrivals(*STEP)))
    place = "line 12" if name == "flight.csv" else "message 11 of `/odom`"
    assert f"time goes back in {place}, from 1700000000.110000000 s" in text
    assert "to 1700000000.075000000 s, by 0.035 s (0.045 s, had it come as soon as" in text


@pytest.mark.parametrize("name", ["cdr.mcap", "plain.bag", "ros2_plain", "flight.csv"])
@pytest.mark.parametrize("back_ms", [1, 3_600_000])
def test_it_is_told_at_the_end_too(tmp_path: Path, name: str, back_ms: int) -> None:
    times = [*range(20, 120, 10), 110 - back_ms]
    assert "time goes back in " in told(written(tmp_path, name, arrivals(*times)))


def test_it_is_told_from_one_part_of_a_bag_to_the_next(tmp_path: Path) -> None:
    """As any clock does between two parts; each alone is in order."""
    from unit.monitor.test_damaged_bags import halves

    (tmp_path / "other").mkdir()
    bag = halves(tmp_path, "ros2_plain")
    metadata = bag / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(
        text.replace("bag_0", "x").replace("bag_1", "bag_0").replace("x", "bag_1", 1)
    )
    assert "time goes back in message 21 of `/odom`" in told(bag)


@pytest.mark.parametrize("name", ["json.mcap", "plain.bag", "ros2_mcap"])
def test_a_part_may_be_chosen_by_the_time_of_the_log(tmp_path: Path, name: str) -> None:
    """An hour back: what was recorded before and after is told apart by the recorder's time."""
    times = [*range(20, 120, 10), *(t - 3_600_000 for t in range(120, 200, 10))]
    log = written(tmp_path, name, arrivals(*times))
    assert judged(log, {"stamp": "arrival"}, until="1699999999").samples["motion"] == 8
    assert judged(log, {"stamp": "arrival"}, since=T0 // 10**9).samples["motion"] == 10
    two = judged(log, {"stamp": "arrival"}, since="1700000000.05", until="1700000000.06")
    assert two.samples["motion"] == 2
    assert "no message that counts" in told(log, since="1700000001")


def test_rows_of_a_table_may_be_chosen_by_time(tmp_path: Path) -> None:
    log = written(tmp_path, "flight.csv", arrivals(*range(20, 220, 10)))
    assert judged(log, since="1700000000.1").samples["motion"] == 12
    assert "it has no rows" in told(log, until="1699999999")


@pytest.mark.parametrize("name", some(FIRST, 5))
def test_the_time_of_the_messages_themselves_may_count(tmp_path: Path, name: str) -> None:
    """However the recorder's clock went."""
    log = written(tmp_path, name, arrivals(*STEP))
    time = {"from": "header.stamp"}
    if name == "flight.csv":
        time["unit"] = "s"
    assert (j := judged(log, **time)).samples["motion"] == len(STEP)
    assert (j.from_s, j.to_s) == (0.0, 0.15)
    back = [*arrivals(*STEP), Recorded(T0 + 200 * MS, odometry(T0 + 5 * MS, 0.0, 0.0))]
    assert "time goes back in " in told(written(beside(tmp_path), name, back), **time)


def test_messages_without_such_a_time_are_told(tmp_path: Path) -> None:
    poses = [Recorded(T0 + k * MS, {}, "/odom", "geometry_msgs/msg/Pose") for k in range(9)]
    fields = {"x": "position.x", "v": {"constant": 0.0}}
    topic = {"type": "geometry_msgs/Pose", "fields": fields}
    for name in ("cdr.mcap", "plain.bag", "ros2_plain", "protobuf.mcap"):
        log = written(tmp_path, name, poses)
        text = told(log, topic, **{"from": "header.stamp"})
        assert "D016" in text
        assert "message 1 of `/odom` has no `header.stamp`" in text
        assert "of every channel that is mapped" in text
        assert "is no time" in told(log, topic, **{"from": "position"})
    log = written(tmp_path, "json.mcap")
    assert "has no `unit`" in told(log, **{"from": "header.stamp", "unit": "us"})


def test_the_time_of_publishing_is_one_that_an_mcap_has(tmp_path: Path) -> None:
    log = written(tmp_path, "cdr.mcap", arrivals(*range(20, 120, 10)))
    same = judged(log, **{"from": "publish_time"})
    assert same.modules == judged(log).modules == judged(log, **{"from": "log_time"}).modules
    told_of = told(written(tmp_path, "ros2_plain"), **{"from": "publish_time"})
    assert "`time` is `publish_time`, which a bag has not" in told_of


@pytest.mark.parametrize(
    ("time", "text"),
    [
        ({"since": "soon"}, "`since` of `time` is no number of seconds: soon"),
        ({"until": True}, "`until` of `time` is no number of seconds"),
        ({"until": float("nan")}, "`until` of `time` is no number of seconds"),
        ({"until": [1]}, "`until` of `time` is no number of seconds"),
        ({"since": 2, "until": 1.5}, "`since` of `time` lies after `until`"),
    ],
)
def test_a_choice_that_is_none_is_told(tmp_path: Path, time: dict[str, Any], text: str) -> None:
    log = written(tmp_path, "json.mcap")
    assert text in told(log, **time)


# ---------------------------------------------------------------- equal times

PAIRS = [t for t in range(20, 220, 20) for _ in range(2)]


@pytest.mark.parametrize("name", some(FIRST, 5))
def test_equal_times_count_in_the_order_of_the_file(tmp_path: Path, name: str) -> None:
    """As under a clock of a simulator that ticks seldom: the later one is what a DM reads."""
    log = written(tmp_path, name, arrivals(*PAIRS))
    j = judged(log, {"stamp": "arrival"})
    place = "line 3" if name == "flight.csv" else "message 2 of `/odom`"
    assert j.samples["motion"] == 20
    counted = "10 of 20 have the time of the one before them and count in the order of the file"
    assert f"{counted}; the first: {place}" in j.notes
    last_of_each = written(beside(tmp_path), name, arrivals(*PAIRS)[1::2])
    one, other = j.modules[0], judged(last_of_each, {"stamp": "arrival"}).modules[0]
    assert (one.margin, one.ac, one.ttf) == (other.margin, other.ac, other.ttf)


@pytest.mark.parametrize("between", ["linear", "hold"])
def test_no_line_and_no_slope_goes_through_two_values_at_one_time(
    tmp_path: Path, between: str
) -> None:
    topic = {
        "stamp": "arrival",
        "between": between,
        "fields": {"x": TYPED["fields"]["x"], "v": {"slope": "x", "window": "0.1s"}},
    }
    both = judged(written(tmp_path, "cdr.mcap", arrivals(*PAIRS)), topic)
    later = judged(written(beside(tmp_path), "cdr.mcap", arrivals(*PAIRS)[1::2]), topic)
    assert both.modules == later.modules
    assert both.derived == later.derived


def test_channels_that_are_out_of_order_among_themselves_are_told(tmp_path: Path) -> None:
    """A recorder with several threads, or a clock set back between two slow channels."""
    other = [Recorded(T0 + at * MS, odometry(T0 + at * MS, 0.0, 0.0), "/slow") for at in (55, 95)]
    whole = flight(12)
    log = written(tmp_path, "cdr.mcap", [*whole[:9], other[0], *whole[9:], other[1]])
    sources = [
        {**TYPED, "channel": c, "every": "1s", "after": "1s", "measured": {"x": 0.1, "v": 0.1}}
        for c in ("/odom", "/slow")
    ]
    del sources[0]["after"]
    given = {"topics": {"motion": {"sources": sources}}}
    j = load(CART).judge_log(log, given, system="Protected")
    said = "in the order of the file time goes back 2 times between channels, by at most 0.025 s"
    assert f"{said}, at message 1 of `/slow`" in j.notes


def test_a_table_whose_last_line_has_no_end_may_be_cut_there(tmp_path: Path) -> None:
    log = written(tmp_path, "flight.csv")
    assert judged(log).notes == ()
    log.write_text(log.read_text().rstrip())
    assert judged(log).notes == ("its last line has no end: the file may be cut there",)


@pytest.mark.parametrize("name", some(FIRST, 5))
def test_who_has_no_checksums_says_so(tmp_path: Path, name: str) -> None:
    said = any("no checksum covers" in text for text in judged(written(tmp_path, name)).assumptions)
    covered = ("json.mcap", "cdr.mcap", "ros1.mcap", "protobuf.mcap")  # rosbags writes none
    assert said == (name not in covered)


NO_PARTS = (("1", "1200000000"), ("1", "-180000000"), ("1.3", "20"), ("1", "1e9"))
"""Seconds and nanoseconds that no time of ROS has: a digit more, a sign, a point."""


@all_rows("clock", NO_PARTS)
def test_nanoseconds_of_a_table_are_less_than_a_second(
    tmp_path: Path, clock: tuple[str, str]
) -> None:
    log = tmp_path / "flight.csv"
    rows = ["n,t.sec,t.nanosec,x,v", "3,1,0,0.1,0.1", f"4,{','.join(clock)},0.2,0.1", ""]
    log.write_text("\n".join(rows), encoding="utf-8")
    for time, stamp in (("t", "arrival"), ("n", "t")):
        motion = {"stamp": stamp, "fields": {"x": "x", "v": "v"}}
        given = {"topics": {"motion": motion}, "time": {"from": time}}
        with pytest.raises(SoterError, match="in line 3 is no time"):
            load(CART).judge_log(log, given, system="Protected")
