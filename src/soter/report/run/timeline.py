"""Signals over time, with who is in control above them.

Purpose: clearance and speed of a flight; any signals of a program without geometry. A band on
top shows the mode, the DM's decisions stand on it and can be read by pointing at them.
Non-goals: several arms in one drawing; each arm has its own time, so each has its own figure.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from soter.report.run.figure_parts import (
    AC_COLOUR,
    POINTS_MAX,
    SC_COLOUR,
    Curves,
    axis_style,
    decimals_drawn,
    decision_hover,
    density_title,
    dot_size,
    flight_indices,
    giveback_dot,
    givebacks,
    is_dense,
    labels_by_level,
    level_labels,
    levels_range,
    line_style,
    lowest_index,
    mode_edges,
    mode_stretches,
    nearest_indices,
    rows_flown_by,
    shared_layout,
    takeover_density,
    takeover_dot,
    takeovers,
    thinned_indices,
    unit_of,
    violation_cross,
    violation_hover,
    violations_title,
)
from soter.report.run.record import Chart, Decision, Figure, Flight, Json, Series, Violation
from soter.report.templates import rounded_numbers
from soter.report.wording import quantity

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray


BAND_PX, PANEL_PX, GAP_PX, MARGIN_PX, MARGIN_TOP_PX = 16, 132, 30, 62, 20
NUMBERS_MAX, POINTS_MIN = 20_000, 500
"""Numbers of all signals of a chart at most, and points of each at least: pages stay small."""
STEPS_SHARE = 0.1
"""Part of a chart's points that may go to the steps of one signal, to draw them exactly."""
MARKS_MAX = 80
"""With more decisions than that, which cover each other, their density is drawn."""
DENSITY_PX, BAND_OPACITY = 44, 0.3
FEW = 4
"""A panel of whole numbers that span no more than that has a tick for each."""
MINUS = "\N{MINUS SIGN}"
OVERLAYS = (("@ink", "solid"), ("@muted", "dash"), ("@muted", "dot"), ("@muted", "dashdot"))
DASH_NAMES = {"dash": "dashed", "dot": "dotted", "dashdot": "dash-dotted"}


class _Stack:
    """Rows of a figure from top to bottom; the y axes have the numbers that the library expects."""

    def __init__(self, heights_px: Sequence[int], shown_s: tuple[float, float]) -> None:
        self.height_px = sum(heights_px) + GAP_PX * (len(heights_px) - 1) + MARGIN_PX
        inner = self.height_px - MARGIN_PX
        tops = [sum(heights_px[:row]) + GAP_PX * row for row in range(len(heights_px))]
        self.domains = [
            (max(1 - (top + height) / inner, 0.0), min(1 - top / inner, 1.0))
            for top, height in zip(tops, heights_px, strict=True)
        ]
        self.axes: Json = {
            "xaxis": axis_style(
                "time / s",
                range=list(shown_s),
                anchor=self.axis_name(len(heights_px) - 1),
                showgrid=False,
            )
        }

    @staticmethod
    def axis_name(row: int) -> str:
        """The name of a row's y axis in traces and shapes."""
        return "y" if row == 0 else f"y{row + 1}"

    def add_axis(self, row: int, **more: object) -> None:
        """Adds the y axis of a row at the place of that row."""
        low, high = self.domains[row]
        key = "yaxis" if row == 0 else f"yaxis{row + 1}"
        self.axes[key] = {**axis_style(domain=[low, high], anchor="x"), **more}


def flight_timeline(
    flight: Flight, key: str, *, end_s: float, clearance_range_m: tuple[float, float]
) -> Figure:
    """Draws mode, clearance (on the scale that all arms share) and speed over `end_s` seconds."""
    dense = [DENSITY_PX] if len(flight.decisions) > MARKS_MAX else []
    stack = _Stack([BAND_PX, PANEL_PX, PANEL_PX * 2 // 3, *dense], (0, end_s))
    data: list[Json] = []
    shapes = _band_shapes(stack, 0, flight.time_s, flight.in_control)
    stack.add_axis(0, visible=False, range=[0, 1], fixedrange=True)
    chosen = flight_indices(flight)
    time_s, modes = flight.time_s[chosen], flight.in_control[chosen]
    data += _two_tone_traces(stack, 1, time_s, flight.clearance_m[chosen], modes, "m")
    data += _two_tone_traces(stack, 2, time_s, flight.speed[chosen], modes, "m/s")
    least, greatest = clearance_range_m
    room = 0.22 * (greatest - min(least, 0.0))
    stack.add_axis(1, range=[min(least, 0.0) - room, greatest + 0.3 * room], nticks=5)
    stack.add_axis(2, rangemode="tozero", nticks=4)
    notes = [_panel_label(stack, 1, "clearance / m"), _panel_label(stack, 2, "speed / (m/s)")]
    shapes.append(_level_line(stack, 1, 0.0))
    if (index := lowest_index(flight.clearance_m)) is not None:
        mark, note = _lowest_mark(stack, flight, index)
        data.append(mark)
        notes.append(note)
    if dense:
        data.append(takeover_density(flight.decisions, stack.axis_name(3), end_s))
        stack.add_axis(3, nticks=3, rangemode="tozero", fixedrange=True)
        notes.append(_panel_label(stack, 3, density_title(flight.decisions, end_s)))
    else:
        data += _decision_marks(stack, 0, flight.decisions)
    if flight.violations:
        at = nearest_indices(flight.time_s, [violation.time_s for violation in flight.violations])
        y = rounded_numbers(flight.clearance_m[at], 4)
        data.append({**_violation_crosses(stack, 1, flight.violations), "y": y})
    return Figure(
        key,
        f"{flight.title}: mode, clearance and speed over time",
        tuple(data),
        shared_layout(
            height=stack.height_px, shapes=shapes, annotations=notes, **_axes_and_margins(stack)
        ),
    )


def chart_timeline(chart: Chart, key: str, *, end_s: float) -> Figure:
    """Draws a band for each module and a panel for each group of signals."""
    panels = _titled_panels(chart.series)
    bands = len(chart.modes)
    mine = [  # where there is one band, all
        [d for d in chart.decisions if bands == 1 or d.module == m.module] for m in chart.modes
    ]
    dense = [k for k, decisions in enumerate(mine) if len(decisions) > MARKS_MAX]
    marked = bool(chart.violations)
    first = bands + len(dense) + marked
    heights = [BAND_PX] * bands + [DENSITY_PX] * len(dense) + [BAND_PX] * marked
    stack = _Stack([*heights, *[PANEL_PX] * len(panels)], chart.opens or (0, end_s))
    chosen = _chart_indices(chart)
    data: list[Json] = []
    shapes: list[Json] = []
    notes: list[Json] = []
    for row, band in enumerate(chart.modes):
        shapes += _band_shapes(stack, row, chart.time_s, band.in_control)
        stack.add_axis(row, visible=False, range=[0, 1], fixedrange=True)
        if row not in dense:
            data += _decision_marks(stack, row, mine[row])
        if bands > 1:
            notes.append(_panel_label(stack, row, band.module))
    for row, k in enumerate(dense, bands):
        data.append(takeover_density(mine[k], stack.axis_name(row), end_s))
        stack.add_axis(row, nticks=3, rangemode="tozero", fixedrange=True)
        notes.append(_panel_label(stack, row, density_title(mine[k], end_s, chart.modes[k].module)))
    if chart.violations:
        row = first - 1
        data.append(_violation_crosses(stack, row, chart.violations))
        stack.add_axis(row, visible=False, range=[0, 1], fixedrange=True)
        shapes += [_instant_line(violation.time_s) for violation in chart.violations]
        first_s = chart.violations[0].time_s
        title = (
            f"violated at {first_s:.6g} s" if chart.opens else violations_title(chart.violations)
        )
        notes.append(_panel_label(stack, row, title))
    for row, (title, series) in enumerate(panels, first):
        if bands == 1:
            shapes += _shade_shapes(stack, row, chart.time_s, chart.modes[0].in_control)
        data += _panel_traces(stack, row, chart, series, chosen)
        span, levels = levels_range(series), labels_by_level(series)
        ticks: Json = {"dtick": 1} if _has_few_values(series) else {"nticks": 5}
        notes.append(_panel_label(stack, row, title))
        if chart.opens and chart.violations:
            data.append(_violation_value_marks(stack, row, chart, series))
        shapes += [_level_line(stack, row, value) for value in levels]
        if span:
            ticks["range"] = list(span)
            curves = Curves(chart.time_s, series, end_s, span)
            notes += level_labels(stack.axis_name(row), levels, curves)
        stack.add_axis(row, **ticks)
    return Figure(
        key,
        f"{chart.title}: mode and signals over time",
        tuple(data),
        shared_layout(
            height=stack.height_px, shapes=shapes, annotations=notes, **_axes_and_margins(stack)
        ),
    )


def _axes_and_margins(stack: _Stack) -> Json:
    """The layout entries for the axes and the margins of a figure of stacked rows."""
    return {
        **stack.axes,
        "margin": {"l": 40, "r": 16, "t": MARGIN_TOP_PX, "b": MARGIN_PX - MARGIN_TOP_PX},
    }


def _titled_panels(series: Iterable[Series]) -> list[tuple[str, list[Series]]]:
    """The panels in order of appearance: a title with unit and overlays, and the series."""
    groups: dict[str, list[Series]] = {}
    for each in series:
        groups.setdefault(each.panel or each.name, []).append(each)
    return [(_panel_title(name, members), members) for name, members in groups.items()]


def _panel_title(name: str, members: Sequence[Series]) -> str:
    """A panel's name and unit, and the names of the lines drawn over the first one."""
    title = quantity(name, unit_of(members[0], members))
    title += ", steps too dense to tell apart" if is_dense(members[0]) else ""
    overlays = [
        f"{DASH_NAMES[dash]}: {each.name}"
        for (_, dash), each in zip(OVERLAYS[1:], members[1:], strict=False)
    ]
    return f"{title}  ({', '.join(overlays)})" if overlays else title


def _has_few_values(series: Sequence[Series]) -> bool:
    """Whether all series of a panel take only few whole numbers, as modes and booleans do."""
    return all(
        each.held
        and bool(np.all(each.values == np.rint(each.values)))
        and float(np.ptp(each.values)) <= FEW
        and not each.unit
        and not each.thresholds
        for each in series
        if each.values.size
    )


def _chart_indices(chart: Chart) -> NDArray[np.intp]:
    """Sorted indices (M,) of the samples of a chart that the figures draw."""
    events = [decision.time_s for decision in chart.decisions]
    events += [violation.time_s for violation in chart.violations]
    keep = nearest_indices(chart.time_s, events)
    for band in chart.modes:
        keep += mode_edges(band.in_control)
    for series in chart.series:
        extremes = (lowest_index(series.values), lowest_index(-series.values))
        keep += [index for index in extremes if index is not None]
    points_max = min(POINTS_MAX, max(NUMBERS_MAX // max(len(chart.series), 1), POINTS_MIN))
    for series in chart.series:
        changes = np.flatnonzero(np.diff(series.values)) + 1
        if series.held and len(changes) <= points_max * STEPS_SHARE:
            keep += changes.tolist()
    return thinned_indices(len(chart.time_s), keep, points_max=points_max)


def _panel_traces(
    stack: _Stack, row: int, chart: Chart, series: Sequence[Series], chosen: NDArray[np.intp]
) -> list[Json]:
    """The traces of one panel: the first in ink, others dashed and named at their ends."""
    traces: list[Json] = []
    for (colour, dash), each in zip(OVERLAYS * len(series), series, strict=False):
        unit = f" {each.unit}" if each.unit else ""
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": each.name,
                "x": rounded_numbers(chart.time_s[chosen], 4),
                "y": rounded_numbers(each.values[chosen], decimals_drawn(each.values)),
                "yaxis": stack.axis_name(row),
                "opacity": BAND_OPACITY if is_dense(each) else 1.0,
                "line": {
                    **line_style(colour, 1.8 if dash == "solid" else 1.3, dash),
                    "shape": "hv" if each.held else "linear",
                },
                "hovertemplate": f"{escape(each.name)} = %{{y:.4g}}{escape(unit)}"
                "<br>t = %{x:.3f} s<extra></extra>",
            }
        )
    return traces


def _two_tone_traces(
    stack: _Stack,
    row: int,
    time_s: NDArray[np.float64],
    values: NDArray[np.float64],
    in_control: NDArray[np.bool_],
    unit: str,
) -> list[Json]:
    """The traces of one signal, which change colour with the controller in control."""
    traces: list[Json] = []
    rows = np.column_stack([time_s, values])
    for ac, who, colour in ((True, "AC", AC_COLOUR), (False, "SC", SC_COLOUR)):
        part = rows_flown_by(rows, in_control, ac=ac)
        if len(part):
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": rounded_numbers(part[:, 0]),
                    "y": rounded_numbers(part[:, 1]),
                    "yaxis": stack.axis_name(row),
                    "line": line_style(colour, 1.8),
                    "hovertemplate": f"%{{y:.2f}} {unit} at %{{x:.2f}} s, {who}<extra></extra>",
                }
            )
    return traces


def _band_shapes(
    stack: _Stack, row: int, time_s: NDArray[np.float64], in_control: NDArray[np.bool_]
) -> list[Json]:
    """The rectangles of the mode band."""
    return [
        _rectangle(stack, row, time_s, (first, last), AC_COLOUR if is_ac else SC_COLOUR)
        for first, last, is_ac in mode_stretches(in_control)
        if last > first
    ]


def _shade_shapes(
    stack: _Stack, row: int, time_s: NDArray[np.float64], in_control: NDArray[np.bool_]
) -> list[Json]:
    """The rectangles that shade a panel while SC is in control."""
    return [
        _rectangle(stack, row, time_s, (first, last), "@sc-shade")
        for first, last, is_ac in mode_stretches(in_control)
        if last > first and not is_ac
    ]


def _rectangle(
    stack: _Stack, row: int, time_s: NDArray[np.float64], stretch: tuple[int, int], colour: str
) -> Json:
    """A rectangle over the full height of a row."""
    low, high = stack.domains[row]
    return {
        "type": "rect",
        "xref": "x",
        "yref": "paper",
        "x0": round(float(time_s[stretch[0]]), 4),
        "x1": round(float(time_s[stretch[1]]), 4),
        "y0": low,
        "y1": high,
        "fillcolor": colour,
        "line": {"width": 0},
        "layer": "below",
    }


def _level_line(stack: _Stack, row: int, value: float) -> Json:
    """A horizontal line across a row."""
    return {
        "type": "line",
        "xref": "paper",
        "yref": stack.axis_name(row),
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": {"color": "@takeover", "width": 1},
    }


def _panel_label(stack: _Stack, row: int, name: str) -> Json:
    """The label with the name of a row, placed above the row's left end."""
    return {
        "text": escape(name),
        "xref": "paper",
        "yref": "paper",
        "x": 0,
        "y": stack.domains[row][1],
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 12, "color": "@muted"},
    }


def _lowest_mark(stack: _Stack, flight: Flight, index: int) -> tuple[Json, Json]:
    """A trace that marks the closest approach, and an annotation with its value."""
    value = float(flight.clearance_m[index])
    time_s = round(float(flight.time_s[index]), 3)
    mark: Json = {
        "type": "scatter",
        "mode": "markers",
        "x": [time_s],
        "y": [round(value, 3)],
        "yaxis": stack.axis_name(1),
        "marker": {"symbol": "circle", "size": 5, "color": "@ink"},
        "hovertemplate": "closest approach: %{y:.3f} m at %{x:.2f} s<extra></extra>",
    }
    note: Json = {
        "text": f"{value:.2f} m".replace("-", MINUS),
        "x": time_s,
        "y": round(value, 3),
        "yref": stack.axis_name(1),
        "yanchor": "top",
        "yshift": -5,
        "borderpad": 0,
        "showarrow": False,
        "bgcolor": "@paper",
        "font": {"size": 11, "color": "@ink"},
    }
    return mark, note


def _decision_marks(stack: _Stack, row: int, decisions: Sequence[Decision]) -> list[Json]:
    """The marks of decisions on the mode band, with takeovers drawn on top of returns."""
    size = dot_size(len(decisions), 9)
    kinds = ((givebacks(decisions), giveback_dot(size)), (takeovers(decisions), takeover_dot(size)))
    return [
        _marker_trace(stack, row, marker, [(d.time_s, decision_hover(d)) for d in chosen])
        for chosen, marker in kinds
        if chosen
    ]


def _instant_line(time_s: float) -> Json:
    """A vertical line through all rows."""
    return {
        "type": "line",
        "xref": "x",
        "yref": "paper",
        "x0": round(time_s, 4),
        "x1": round(time_s, 4),
        "y0": 0,
        "y1": 1,
        "line": {"color": "@violation", "width": 1, "dash": "dot"},
    }


def _violation_crosses(stack: _Stack, row: int, violations: Sequence[Violation]) -> Json:
    """Crosses for violations in a separate row, because a property belongs to no single signal."""
    marks = [(violation.time_s, violation_hover(violation)) for violation in violations]
    return _marker_trace(stack, row, violation_cross(10), marks)


def _violation_value_marks(stack: _Stack, row: int, chart: Chart, series: Sequence[Series]) -> Json:
    """Crosses on the curves of a panel at the time of the violation, with the values there."""
    at_s = chart.violations[0].time_s
    [index] = nearest_indices(chart.time_s, [at_s])
    values = [float(each.values[index]) for each in series]
    texts = [
        f"{violation_hover(chart.violations[0])}<br>{escape(each.name)} = {value:.4g}"
        for each, value in zip(series, values, strict=True)
    ]
    marks = _marker_trace(stack, row, violation_cross(9), [(at_s, text) for text in texts])
    return {**marks, "y": rounded_numbers(np.array(values), decimals_drawn(np.array(values)))}


def _marker_trace(
    stack: _Stack, row: int, marker: Json, marks: Sequence[tuple[float, str]]
) -> Json:
    """A trace of marks in the middle of a row; `marks` holds times in s and hover texts."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [round(time_s, 4) for time_s, _ in marks],
        "y": [0.5] * len(marks),
        "yaxis": stack.axis_name(row),
        "text": [text for _, text in marks],
        "hovertemplate": "%{text}<extra></extra>",
        "marker": marker,
        "cliponaxis": False,
    }
