"""A topic that a log has from several sources: bags, and the columns of a CSV.

Non-goals: the rule (`tests/unit/mapping/test_topic_sources.py`), that a bridge takes the same
samples (`tests/unit/targets/test_sources_in_a_bridge.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import CART, FIELDS, MS, T0, TYPED, Recorded, odometry, written
from soter.api import load
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from pathlib import Path

    from soter.monitor.log_judgement import LogJudgement

PROMISE = {"every": "10ms", "delayed": "5ms"}
SOURCES: list[dict[str, Any]] = [
    {**TYPED, **PROMISE},
    {**TYPED, **PROMISE, "channel": "/camera", "after": "15ms"},
]


def judged(log: Path, sources: list[dict[str, Any]], **more: Any) -> LogJudgement:
    topics = {"motion": {"sources": sources}}
    return load(CART).judge_log(log, {"system": "Protected", "topics": topics, **more})


def two_channels(silent: range) -> list[Recorded]:
    """Every 10 ms both say where it is, the first but for the instants of `silent`."""
    flight = []
    for k in range(100):
        at = T0 + k * 10 * MS
        if k not in silent:
            flight.append(Recorded(at, odometry(at - MS, 1.0, 0.0)))
        flight.append(Recorded(at + MS, odometry(at, 2.0, 0.0), "/camera"))
    return flight


@pytest.mark.parametrize("name", ["plain.bag", "cdr.mcap", "json.mcap", "ros2_plain"])
def test_the_second_source_fills_the_silence_of_the_first(tmp_path: Path, name: str) -> None:
    log = written(tmp_path, name, two_channels(range(40, 60)))
    told = judged(log, SOURCES)
    # the camera at 410 ms is the first that was measured more than 15 ms after 389 ms
    said = "`motion` is read from the source whose turn it is, as a bridge reads it: "
    assert f"{said}/odom (80), /camera (19), 2 changes from one to the other" in told.assumptions
    assert told.samples == {"motion": 99}
    assert not told.left_out


def test_what_one_source_says_wrong_is_counted_and_the_other_is_read(tmp_path: Path) -> None:
    flight = two_channels(range(0))
    bad = [
        Recorded(m.arrival_ns, odometry(m.arrival_ns, 1.0, 0.0, "map"))
        if m.channel == "/odom"
        else m
        for m in flight
    ]
    told = judged(
        written(tmp_path, "plain.bag", bad), [{**SOURCES[0], "frame_id": "odom"}, SOURCES[1]]
    )
    assert told.samples == {"motion": 100}
    count, first = told.left_out["motion"]
    assert count == 100
    assert "its frame is `map`, not `odom`" in first


def test_a_source_that_the_log_has_not_is_told(tmp_path: Path) -> None:
    flight = [m for m in two_channels(range(0)) if m.channel == "/odom"]
    with pytest.raises(SoterError, match="no message that counts stands on `/camera`"):
        judged(written(tmp_path, "plain.bag", flight), SOURCES)


def test_columns_of_one_row_may_be_several_sources(tmp_path: Path) -> None:
    """At 30 and 40 ms the first has no cells; the second has to be 15 ms younger than 19 ms."""
    rows = ["t,xa,va,sa,xb,vb,sb"]
    for k in range(1, 8):
        t = 10 * k
        a = f"1.0,0.0,{t - 1}" if k not in (3, 4) else ",,"
        rows.append(f"{t},{a},2.0,0.0,{t}")
    log = tmp_path / "log.csv"
    log.write_text("\n".join(rows) + "\n")
    sources = [
        {"fields": {x: x + n for x in FIELDS}, "stamp": {"from": f"s{n}", "unit": "ms"}, **PROMISE}
        for n in "ab"
    ]
    sources[1]["after"] = "15ms"
    told = judged(log, sources, time={"from": "t", "unit": "ms"})
    assert told.samples == {"motion": 6}
    assert any("1 (5), 2 (1), 2 changes" in line for line in told.assumptions)
