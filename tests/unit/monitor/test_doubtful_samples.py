"""Samples that may be none, or at another pace than they say: read as they stand, and named.

Non-goals: silence (`test_silent_topics.py`), stamps of another clock (`test_logs_of_messages.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import CART, MS, Recorded, flight, judge, odometry, refused, written
from soter.api import load
from soter.api.monitoring import log_explained
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.monitor.log_judgement import LogJudgement

KINDS = ["cdr.mcap", "plain.bag", "ros2_plain", "json.mcap"]


def moving(x_of: Callable[[int], float], v_of: Callable[[int], float] = lambda _: 0.1) -> Any:
    return [
        Recorded(m.arrival_ns, odometry(m.arrival_ns - MS, x_of(k), v_of(k)))
        for k, m in enumerate(flight(100))
    ]


def table(folder: Path, every: float, unit: str, **motion: Any) -> LogJudgement:
    """A CSV of 40 rows, so much apart in a unit."""
    log = folder / "log.csv"
    log.write_text("t,x,v\n" + "".join(f"{every * k},{0.001 * k},0.1\n" for k in range(40)))
    topics = {"motion": {"fields": {"x": "x", "v": "v"}, **motion}}
    return load(CART).judge_log(
        log, {"time": {"from": "t", "unit": unit}, "topics": topics}, system="Protected"
    )


@all_rows("name", KINDS)
@all_rows(("since", "count"), [(0, 100), (41, 59), (80, 20)])
def test_a_value_that_repeats_to_the_end_is_told(
    tmp_path: Path, name: str, since: int, count: int
) -> None:
    log = written(tmp_path, name, moving(lambda k: 0.001 * min(k, since)))
    (told,) = judge(log).lost
    assert told.startswith(f"the last {count} of 100 samples of `motion` are one value, from ")
    assert "it stood still, or what measured it was stuck" in told


@pytest.mark.parametrize("x_of", [lambda k: 0.001 * min(k, 85), lambda k: 0.001 * (k // 10)])
def test_a_short_rest_is_no_word(tmp_path: Path, x_of: Callable[[int], float]) -> None:
    assert judge(written(tmp_path, "cdr.mcap", moving(x_of))).lost == []


def test_one_part_that_moves_is_enough(tmp_path: Path) -> None:
    log = written(tmp_path, "cdr.mcap", moving(lambda _: 0.1, lambda k: 0.001 * k))
    assert judge(log).lost == []


@pytest.mark.parametrize(
    ("every", "unit", "pace"),
    [(10.0, "s", "10 s"), (0.01, "ms", "10 us"), (0.01, "us", "10 ns"), (10000.0, "ms", "10 s")],
)
@pytest.mark.parametrize("between", ["hold", "linear"])
def test_a_time_in_another_unit_is_told(
    tmp_path: Path, every: float, unit: str, pace: str, between: str
) -> None:
    (told,) = table(tmp_path, every, unit, between=between).lost
    assert told == (
        f"samples of `motion` come every {pace}, those of the program every 5 ms: is `unit` of "
        "`time` right?"
    )


@pytest.mark.parametrize(("every", "unit"), [(0.01, "s"), (10.0, "ms"), (1.0, "s"), (100.0, "us")])
def test_a_log_that_was_thinned_out_is_no_word(tmp_path: Path, every: float, unit: str) -> None:
    assert table(tmp_path, every, unit).lost == []


def test_stamps_that_nobody_set_are_told_with_what_to_do(tmp_path: Path) -> None:
    unset = [Recorded(m.arrival_ns, odometry(0, 0.001 * k, 0.1)) for k, m in enumerate(flight())]
    told = refused(written(tmp_path, "cdr.mcap", unset))
    assert "its stamp is 0" in told
    assert 'stamp = "arrival" counts from when messages came' in told
    (tmp_path / "b").mkdir()
    assert judge(written(tmp_path / "b", "cdr.mcap", unset), stamp="arrival").samples == {
        "motion": 40
    }


def test_a_nan_in_one_part_of_a_sample_leaves_it_out(tmp_path: Path) -> None:
    log = written(
        tmp_path, "cdr.mcap", moving(lambda k: 0.001 * k, lambda k: [0.1, math.nan][k > 49])
    )
    found = judge(log)
    assert found.left_out["motion"][0] == 50
    assert found.modules[0].last_heard == {"motion": pytest.approx(0.489)}


def test_a_clock_that_jumps_at_the_very_end_leaves_most_unjudged(tmp_path: Path) -> None:
    for later_s in (10, 3600):
        whole = flight(100)
        at = whole[-1].arrival_ns + later_s * 1000 * MS
        (tmp_path / str(later_s)).mkdir()
        log = written(
            tmp_path / str(later_s),
            "cdr.mcap",
            [*whole[:-1], Recorded(at, odometry(at - MS, 1, 0))],
        )
        (module,) = judge(log).modules
        assert (module.judged, module.judged_share < 0.1) == (True, True)
        assert [c.to for c in module.changes][:2] == ["AC", "SC"]


def test_estimates_are_told_the_same(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,x,v,a\n" + "".join(f"{0.01 * k},0.1,0.0,0.0\n" for k in range(100)))
    topics = {
        "motion": {"fields": {"x": "x", "v": "v"}},
        "accel": {"fields": {"value": "a"}},
    }
    given = {"time": {"from": "t"}, "topics": topics}
    (found,) = log_explained(load(CART).flat, log, given, system="Protected")
    assert any("the last 100 of 100 samples of `motion`" in n for n in found.notes)
