"""The path of a run: which signals it is drawn of, who was in control, and where what happened."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.report.run.path_figure import path_figure
from soter.report.run.record import Chart, Decision, ModeBand, Series, Violation
from soter.report.run.timeline import chart_timeline

if TYPE_CHECKING:
    from soter.report.run.record import Figure

TIME_S = np.array([0.0, 1.0, 2.0, 3.0])


def chart(*names: str, unit: str = "") -> Chart:
    """A run of signals that go up by one, two, ... a second; SC has control from 2 s on."""
    series = [Series(n, unit, k * TIME_S) for k, n in enumerate(names, 1)]
    return Chart(
        name="Robot",
        title="Robot",
        time_s=TIME_S,
        series=tuple(series),
        modes=(
            ModeBand("Guard", TIME_S < 2.0),
            ModeBand("Other", TIME_S >= 0.0),
        ),
        decisions=(Decision(2.0, "Guard", "SC"),),
        violations=(Violation(3.0, "always near"),),
    )


def drawn(figure: Figure | None, colour: str) -> list[tuple[float, float]]:
    """The points of the one trace whose line or marker has this colour."""
    assert figure is not None
    traces: list[Any] = list(figure.data)
    [trace] = [t for t in traces if t.get("line", t.get("marker"))["color"] == colour]
    return list(zip(trace["x"], trace["y"], strict=True))


def test_a_path_is_that_of_x_and_y_and_shows_who_had_control_and_what_happened_where() -> None:
    figure = path_figure(chart("c.heading", "c.x", "c.y", "far.x", "far.y"), "path")
    assert drawn(figure, "@ac") == [(0, 0), (2, 3), (4, 6)]
    assert drawn(figure, "@sc") == [(4, 6), (6, 9)]
    assert drawn(figure, "@takeover") == [(4, 6)]
    assert drawn(figure, "@violation") == [(6, 9)]
    assert drawn(figure, "@ink") == [(0, 0)]


@pytest.mark.parametrize(
    "names", [("c.x",), ("c.x", "d.y"), ("q.w", "q.x", "q.y"), ("c.max", "c.may"), ()]
)
def test_what_is_no_place_has_no_path(names: tuple[str, ...]) -> None:
    assert path_figure(chart(*names), "path") is None


def test_speeds_have_no_path() -> None:
    assert path_figure(chart("v.x", "v.y", unit="m/s"), "path") is None


def test_what_was_never_published_has_no_path() -> None:
    made = chart("c.x", "c.y")
    silent = dataclasses.replace(made.series[1], values=np.full(4, np.nan))
    assert path_figure(dataclasses.replace(made, series=(made.series[0], silent)), "path") is None


@pytest.mark.parametrize("last", [(0.0, 0.0), (1e6, 1.0), (1.0, 1e6), (np.nan, np.nan)])
def test_a_path_is_seen_whole_however_long_or_short(last: tuple[float, float]) -> None:
    made = chart("c.x", "c.y")
    ends = [np.array([0.0, 0.0, 0.0, end]) for end in last]
    series = [dataclasses.replace(s, values=v) for s, v in zip(made.series, ends, strict=True)]
    figure = path_figure(dataclasses.replace(made, series=tuple(series)), "path")
    assert figure is not None
    layout: Any = figure.layout
    for axis, values in zip("xy", ends, strict=True):
        low, high = layout[f"{axis}axis"]["range"]
        assert low < np.nanmin(values)
        assert np.nanmax(values) < high


def test_a_state_has_the_unit_of_what_measures_it() -> None:
    made = chart("c.x", "c.y")
    measured = [Series(f"pose.{n}", "m", TIME_S, panel=f"c.{n}") for n in "xy"]
    both = dataclasses.replace(made, series=(*made.series, *measured))
    figure = path_figure(both, "path")
    assert figure is not None
    layout: Any = figure.layout
    assert layout["xaxis"]["title"]["text"] == "c.x / m"
    layout = chart_timeline(both, "chart", end_s=3.0).layout
    titles = [note["text"] for note in layout["annotations"]]
    assert any(t.startswith("c.y / m") for t in titles)
