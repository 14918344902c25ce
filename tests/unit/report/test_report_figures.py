"""Figures: what stands in them, and that script, style and figures agree."""

from __future__ import annotations

import dataclasses
import json
import random
import re
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from city_map import city_map, dash_of
from city_scene import TUBE_GROUP, Scene
from city_solid import city_solid

from soter.report.run.figure_parts import DENSE_STEPS, decision_hover, group_of_arm
from soter.report.run.page import page_body
from soter.report.run.record import Decision, ModeBand, Series, Threshold, Violation
from soter.report.run.timeline import BAND_OPACITY, chart_timeline, flight_timeline
from soter.report.templates import packed_numbers, rounded_numbers

if TYPE_CHECKING:
    from soter.report.run.record import Figure, Flight, ReportPage

CSS = (resources.files("soter.report") / "assets" / "report.css").read_text(encoding="utf-8")


def traces(figure: Figure, **wanted: object) -> list[dict[str, Any]]:
    """Return the traces whose entries are as wanted."""
    return [
        trace
        for trace in figure.data
        if all(trace.get(name) == value for name, value in wanted.items())
    ]


def marks(figure: Figure, words: str) -> list[str]:
    """Return the hover texts that hold these words."""
    texts: list[str] = []
    for trace in figure.data:
        labels = trace.get("text")
        texts += [text for text in labels if words in text] if isinstance(labels, list) else []
    return texts


def names_in(value: object) -> set[str]:
    """Return every `@name` in a figure."""
    if isinstance(value, str):
        return {value[1:]} if value.startswith("@") else set()
    if isinstance(value, dict):
        return set().union(*(names_in(item) for item in value.values()), set())
    if isinstance(value, (list, tuple)):
        return set().union(*(names_in(item) for item in value), set())
    return set()


@pytest.fixture(scope="module")
def everything(city_page: ReportPage, cart_page: ReportPage) -> list[Figure]:
    return [*page_body(city_page)[1], *page_body(cart_page)[1]]


def test_every_figure_is_json(everything: list[Figure]) -> None:
    for figure in everything:
        json.dumps(figure.to_json(), allow_nan=False)


def test_every_colour_has_a_value_in_the_style_sheet(everything: list[Figure]) -> None:
    used = set().union(*(names_in(figure.to_json()) for figure in everything))
    light = set(re.findall(r"--([\w-]+):", CSS.split("@media")[0]))
    assert used <= light, used - light


def test_dark_changes_every_colour_and_adds_none() -> None:
    blocks = r"^@media \(prefers-color-scheme: dark\) \{\n.*?^\}"
    dark = "".join(re.findall(blocks, CSS, re.MULTILINE | re.DOTALL))
    light = re.sub(blocks, "", CSS, flags=re.MULTILINE | re.DOTALL)
    fonts = {"font", "serif", "mono"}
    pattern = r"--([\w-]+):"
    assert set(re.findall(pattern, dark)) == set(re.findall(pattern, light)) - fonts


def test_the_map_marks_each_takeover_giveback_and_violation(
    scene: Scene, city_page: ReportPage
) -> None:
    for figure in (
        city_map(scene, city_page.flights),
        city_solid(scene, city_page.flights),
    ):
        decisions = [d for flight in city_page.flights for d in flight.decisions]
        violations = [v for flight in city_page.flights for v in flight.violations]
        assert len(decisions) > 5
        assert len(violations) > 0
        assert len(marks(figure, "took over")) == sum(d.to == "SC" for d in decisions)
        assert len(marks(figure, "gave back")) == sum(d.to == "AC" for d in decisions)
        assert len(marks(figure, "Violation")) == len(violations)


def test_each_arm_and_the_tubes_can_be_switched(scene: Scene, city_page: ReportPage) -> None:
    figure = city_map(scene, city_page.flights)
    groups = {trace.get("group") for trace in figure.data}
    assert groups == {None, TUBE_GROUP, *(group_of_arm(f.name) for f in city_page.flights)}


def test_the_arm_both_controllers_flew_is_solid(city_page: ReportPage) -> None:
    assert dash_of(city_page.flights) == {
        "Protected": "solid",
        "AdvancedOnly": "dash",
        "SafeOnly": "dot",
    }


def test_every_building_tells_its_height(scene: Scene) -> None:
    figure = city_map(scene, ())
    told = [t["text"] for t in figure.data if "m high" in str(t.get("text"))]
    assert len(told) == len(scene.boxes)


def test_an_empty_scene_is_drawn(protected: Flight) -> None:
    empty = Scene(lo=(0, 0, 0), hi=(9, 9, 3), boxes=np.empty((0, 2, 3)), ceiling_m=3)
    for flights in ((), (protected,)):
        json.dumps(city_map(empty, flights).to_json(), allow_nan=False)
        json.dumps(city_solid(empty, flights).to_json(), allow_nan=False)


def test_a_decision_tells_when_why_and_on_what() -> None:
    text = decision_hover(
        Decision(1.25, "d.Safe<M>", "SC", "x < y", {"ttf": True, "margin / m": -0.125})
    )
    assert "DM took over, AC → SC" in text
    assert "t = 1.25 s · d.Safe&lt;M&gt;" in text
    assert "x &lt; y" in text
    assert "ttf = true<br>margin / m = -0.125" in text


def test_what_is_not_finite_is_a_gap() -> None:
    assert rounded_numbers(np.asarray([1.23456, np.nan, np.inf, -0.0])) == [1.235, None, None, 0.0]


def test_a_flight_timeline_has_band_clearance_and_speed(protected: Flight) -> None:
    figure = flight_timeline(protected, "t", end_s=30.0, clearance_range_m=(-1.0, 4.0))
    bands = [shape for shape in _list(figure, "shapes") if shape["type"] == "rect"]
    assert len(bands) == len(protected.decisions)
    assert {trace.get("yaxis") for trace in figure.data} == {"y", "y2", "y3"}
    assert len(marks(figure, "DM ")) == len(protected.decisions)
    assert "0.36 m" in {note["text"] for note in _list(figure, "annotations")}


def test_clearance_that_is_unknown_is_not_marked(protected: Flight) -> None:
    blind = dataclasses.replace(protected, clearance_m=np.full(len(protected.time_s), np.nan))
    figure = flight_timeline(blind, "t", end_s=30.0, clearance_range_m=(0.0, 1.0))
    json.dumps(figure.to_json(), allow_nan=False)
    assert traces(figure, hovertemplate="closest approach: %{y:.3f} m at %{x:.2f} s") == []


def test_a_chart_stacks_its_panels_and_names_levels(cart_page: ReportPage) -> None:
    figure = chart_timeline(cart_page.charts[0], "c", end_s=15.0)
    names = [note["text"] for note in _list(figure, "annotations")]
    assert names == [
        "position / m  (dashed: goal)",
        "wall",
        "speed / (m/s)",
        "acceleration / (m/s²)",
    ]
    assert figure.layout["height"] > 3 * 130  # type: ignore[operator]


def test_each_module_of_a_chart_has_its_own_band(cart_page: ReportPage) -> None:
    chart = cart_page.charts[0]
    second = ModeBand("Battery", ~chart.modes[0].in_control)
    figure = chart_timeline(
        dataclasses.replace(chart, modes=(*chart.modes, second)), "c", end_s=15.0
    )
    names = [note["text"] for note in _list(figure, "annotations")]
    assert names[:2] == ["SafeCart", "Battery"]
    assert len(traces(figure, yaxis="y")) == 2
    assert traces(figure, yaxis="y2") == []


def test_a_violation_of_a_chart_is_marked_on_no_signal(cart_page: ReportPage) -> None:
    chart = dataclasses.replace(cart_page.charts[0], violations=(Violation(2.5, "always p"),))
    figure = chart_timeline(chart, "c", end_s=15.0)
    (cross,) = [t for t in figure.data if "Violation" in str(t.get("text"))]
    assert (cross["x"], cross["y"]) == ([2.5], [0.5])
    own_row = cross["yaxis"]
    assert len(traces(figure, yaxis=own_row)) == 1
    (line,) = [s for s in _list(figure, "shapes") if s["type"] == "line" and s["x0"] == 2.5]
    assert (line["yref"], line["y0"], line["y1"]) == ("paper", 0, 1)


def test_levels_and_their_labels_have_room(cart_page: ReportPage) -> None:
    series = dataclasses.replace(
        cart_page.charts[0].series[0],
        thresholds=(Threshold("least", -50.0), Threshold("greatest", 50.0)),
    )
    chart = dataclasses.replace(cart_page.charts[0], series=(series,))
    figure = chart_timeline(chart, "c", end_s=15.0)
    low, high = figure.layout["yaxis2"]["range"]  # type: ignore[index]
    assert low < -50.0
    assert high > 60.0


def label_of(figure: Figure, text: str) -> dict[str, Any]:
    """The label of a level."""
    (note,) = [n for n in _list(figure, "annotations") if n["text"] == text]
    return note


@pytest.mark.parametrize(
    ("late", "early", "side", "end"),
    [
        (0.0, 0.0, "bottom", "right"),  # nothing near: above its line, at the end
        (60.0, 0.0, "bottom", "left"),  # the curve passes the limit at the end
        (60.0, 60.0, "top", "right"),  # all along: below
    ],
)
def test_a_levels_label_stands_where_no_curve_runs(
    cart_page: ReportPage, late: float, early: float, side: str, end: str
) -> None:
    chart = cart_page.charts[0]
    values = np.where(chart.time_s > chart.time_s[-1] * 0.4, late, early)
    values[0] = -60.0
    series = dataclasses.replace(
        chart.series[0], values=values, thresholds=(Threshold("wall", 50.0),)
    )
    drawn = chart_timeline(dataclasses.replace(chart, series=(series,)), "c", end_s=15.0)
    label = label_of(drawn, "wall")
    assert (label["yanchor"], label["xanchor"]) == (side, end)
    assert label["bgcolor"].startswith("@")  # legible where it has to stand over a curve


def test_labels_of_a_least_and_a_greatest_value_stand_outside_of_both(
    cart_page: ReportPage,
) -> None:
    levels = (Threshold("least", -50.0), Threshold("greatest", 50.0))
    series = dataclasses.replace(cart_page.charts[0].series[0], thresholds=levels)
    chart = dataclasses.replace(cart_page.charts[0], series=(series,))
    figure = chart_timeline(chart, "c", end_s=15.0)
    assert label_of(figure, "greatest")["yanchor"] == "bottom"
    assert label_of(figure, "least")["yanchor"] == "top"
    assert figure.layout["yaxis2"]["range"][0] < -60.0  # type: ignore[index]


def test_a_held_signal_is_drawn_as_steps_that_stand_where_they_were(cart_page: ReportPage) -> None:
    time_s = np.linspace(0.0, 100.0, 40_001)
    gear = np.zeros(len(time_s))
    gear[12_347:12_349] = 3.0
    moving = Series("v", "m/s", np.sin(time_s))
    chart = dataclasses.replace(
        cart_page.charts[0],
        time_s=time_s,
        series=(Series("gear", "", gear, held=True), moving),
        modes=(),
        decisions=(),
        violations=(),
    )
    figure = chart_timeline(chart, "c", end_s=100.0)
    steps, curve = traces(figure, name="gear")[0], traces(figure, name="v")[0]
    assert (steps["line"]["shape"], curve["line"]["shape"]) == ("hv", "linear")
    x, y = np.array(steps["x"]), np.array(steps["y"])
    assert len(x) < 5000
    edges = x[np.flatnonzero(np.diff(y)) + 1]
    np.testing.assert_allclose(edges, time_s[[12_347, 12_349]], atol=1e-3)


@pytest.mark.parametrize(
    ("times", "title"), [(1, "violations"), (2, "violations, the first of each property")]
)
def test_marks_of_violations_are_said_to_be_the_first_where_there_were_more(
    cart_page: ReportPage, times: int, title: str
) -> None:
    failed = (Violation(1.0, "always A", times=times), Violation(2.0, "always B"))
    chart = dataclasses.replace(cart_page.charts[0], violations=failed)
    names = [n["text"] for n in _list(chart_timeline(chart, "c", end_s=15.0), "annotations")]
    assert [n for n in names if n.startswith("violations")] == [title]


def many(count: int) -> tuple[Decision, ...]:
    """Takeovers and returns in turn over 15 s, most of them in the last third."""
    times = 15.0 * (np.arange(count) / count) ** 0.3
    return tuple(
        Decision(float(t), "SafeCart", "SC" if k % 2 else "AC") for k, t in enumerate(times)
    )


def test_hundreds_of_takeovers_are_a_density(cart_page: ReportPage) -> None:
    chart = dataclasses.replace(cart_page.charts[0], decisions=many(600))
    figure = chart_timeline(chart, "c", end_s=15.0)
    (bars,) = traces(figure, type="bar")
    assert sum(bars["y"]) == 300
    assert sum(bars["y"][80:]) > 200
    assert traces(figure, yaxis="y") == []  # no marks on the band
    title = "takeovers of SafeCart in each 0.125 s, 300 in all"
    assert title in [note["text"] for note in _list(figure, "annotations")]
    assert sum(bool(traces(figure, yaxis=f"y{k}")) for k in (3, 4, 5)) == 3  # the panels, below


def test_hundreds_of_takeovers_of_a_flight_are_a_density(protected: Flight) -> None:
    flight = dataclasses.replace(protected, decisions=many(200))
    figure = flight_timeline(flight, "t", end_s=15.0, clearance_range_m=(-1.0, 4.0))
    (bars,) = traces(figure, type="bar")
    assert (sum(bars["y"]), bars["yaxis"]) == (100, "y4")
    assert len(marks(figure, "DM took over, ")) == 0


def _list(figure: Figure, name: str) -> list[dict[str, Any]]:
    """Return a list of the layout."""
    items = figure.layout[name]
    assert isinstance(items, list)
    return items


def test_steps_too_dense_to_tell_apart_are_a_pale_band(cart_page: ReportPage) -> None:
    chart = cart_page.charts[0]
    count = len(chart.time_s)
    steps = (np.arange(count) % 2).astype(np.float64)
    few = np.where(np.arange(count) < count // 2, 0.0, 1.0)
    held = (Series("valve", "", steps, held=True), Series("door", "", few, held=True))
    series = (*held, Series("speed", "", steps))
    figure = chart_timeline(dataclasses.replace(chart, series=series), "c", end_s=15.0)
    opacity = {t["name"]: t["opacity"] for t in figure.data if "name" in t}
    assert opacity == {"valve": BAND_OPACITY, "door": 1.0, "speed": 1.0}
    assert count > DENSE_STEPS


def unpacked(value: Any) -> list[float | None]:
    """As `assets/packed.js` does it."""
    if not isinstance(value, dict):
        return list(value)
    total, values = 0, []
    for step in value["d"]:
        total += step or 0
        values.append(None if step is None else total / 10 ** value["e"])
    return values


def test_packed_lists_are_the_same_doubles() -> None:
    rng = random.Random(5)  # noqa: S311 - which lists
    for _ in range(200):
        digits, size = rng.randrange(7), 10 ** rng.randrange(6)
        given = [
            None if rng.random() < 0.05 else round(rng.uniform(-size, size), digits) + 0.0
            for _ in range(60)
        ]
        short = packed_numbers(given)
        assert isinstance(short, dict)
        assert unpacked(short) == given
    for whole in ([1.0] * 50, ["a"] * 60, [True] * 60, [1e-20, 1.0] * 30, [float("inf")] * 60):
        assert packed_numbers(whole) is whole
