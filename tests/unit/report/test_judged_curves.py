"""What was judged, as a drawing over time: nothing that lay outside is lost, at any length."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.cli.main import main
from soter.report.judged_curves import COLUMNS, JudgedTimes, drawing_html

if TYPE_CHECKING:
    from pathlib import Path

X = ("seen.x", "m", "`seen.x < 1.0`")
BAND = (-np.inf, 1.0)


def of(values: list[float], alarms: bool = True) -> JudgedTimes:
    """A value each second, below 1 m unless it is an alarm."""
    times = JudgedTimes(0.0, float(len(values)), changes=[(0.0, "SC"), (2.0, "AC")])
    for at_s, value in enumerate(values):
        wrong = alarms and value > 1.0
        times.alarms[times.column_at(at_s)] += wrong
        times.note_value(X, at_s, value, BAND, alarm=wrong)
    return times


def test_one_value_of_a_long_log_that_lay_outside_is_drawn_and_counted() -> None:
    text = drawing_html(of([0.5] * 70_100 + [3.0] + [0.5] * 29_900), "alarms")
    assert "alarms: 1<" in text
    assert "<b>seen.x / m</b>" in text
    assert "outside 1 times, furthest at 70100.000 s, by 2 m" in text
    assert ">3</i>" in text  # the scale reaches it
    assert text.count("<rect") == 3  # SC, AC, and the alarm
    assert len(text) < 50 * COLUMNS


def test_thousands_of_alarms_are_columns_that_say_how_many_in_all() -> None:
    text = drawing_html(of([2.0] * 5_000), "alarms")
    assert "alarms: 5,000<" in text
    assert text.count("<rect") == COLUMNS + 2


def test_without_an_alarm_the_value_nearest_to_its_band_is_drawn() -> None:
    times = of([0.2, 0.9, 0.4])
    for k in range(5):
        times.note_value((f"far{k}", "", "`a`"), 1.0, 0.0, (-10.0, 10.0), alarm=False)
    text = drawing_html(times, "alarms")
    assert "alarms: none<" in text
    assert "nearest at 1.000 s, by 0.1 m" in text
    assert text.index("seen.x") < text.index("far0")
    assert "far4" not in text


def test_what_a_condition_allows_on_its_other_side_is_not_outside() -> None:
    assert "outside" not in drawing_html(of([2.0, 2.0], alarms=False), "alarms")


def test_a_curve_has_a_gap_where_nothing_was_heard() -> None:
    times = JudgedTimes(0.0, 100.0)
    for at_s in (*range(20), *range(80, 100)):
        times.note_value(X, at_s, 0.5, BAND, alarm=False)
    (curve,) = re.findall(r'class="line" d="([^"]*)"', drawing_html(times, "alarms"))
    assert curve.count("M") == 2


PROGRAM = """soter 1;
topic x: float unit "m";
topic bad: bool;
topic push: float in [-1.0, 1.0];
node Fast period 10ms { subscribes x; publishes push; step { publish push = 0.0; } }
node Slow period 10ms { subscribes x; publishes push; step { publish push = 0.0; } }
node Sensor period 10ms { publishes x, bad; step { publish x = 0.0; publish bad = false; } }
rta Keeper { ac Fast; sc Slow; period 10ms; SAFE ttf x > 5.0; safer x < 4.0; }
system S default { node Sensor; module Keeper; until 1s; }
"""


@pytest.mark.parametrize(
    ("safe", "name", "least"),
    [
        ("x < 1.0", "x / m", False),
        ("-1.0 < x", "x / m", True),
        ("!(x > 1.0)", "x / m", False),
        ("abs(x) <= 1.0", "abs(x)", False),
    ],
)
def test_a_page_of_a_log_shows_the_input_that_left_its_band(
    tmp_path: Path, safe: str, name: str, least: bool
) -> None:
    program = PROGRAM.replace("SAFE", f"safe {safe};")
    (tmp_path / "p.soter").write_text(program)
    (tmp_path / "map.json").write_text(
        '{"time": {"from": "t", "unit": "s"}, "topics": {"x": {"fields": {"value": "x"}}}}'
    )
    sign = -1.0 if least else 1.0
    rows = [f"{k / 100},{sign * (3.0 if 40 <= k < 60 else 0.5)}" for k in range(100)]
    (tmp_path / "log.csv").write_text("t,x\n" + "\n".join(rows) + "\n")
    page = tmp_path / "page.html"
    arguments = ["monitor", "p.soter", "log.csv", "--map", "map.json", "--report", "page.html"]
    at = [str(tmp_path / a) if "." in a else a for a in arguments]
    assert main(at) == 3
    text = page.read_text()
    assert "reads outside of <code>safe</code>: 20<" in text
    assert f"<b>{name}</b>" in text
    assert "outside 20 times, furthest at 0.410 s, by 2" in text
