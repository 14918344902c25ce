"""The path of a run seen from above.

Purpose: `path_figure` draws the first two signals of a chart that are called x and y in one place,
such as `c.x` and `c.y`, over each other at one scale: in the colour of AC where all modules have AC
in control, else in that of SC.
Non-goals: what stands beside the path: a program says no walls that a page could draw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.run.figure_parts import (
    AC_COLOUR,
    SC_COLOUR,
    axis_style,
    decision_hover,
    dot_size,
    giveback_dot,
    givebacks,
    line_style,
    mode_edges,
    nearest_indices,
    rows_flown_by,
    shared_layout,
    takeover_dot,
    takeovers,
    thinned_indices,
    unit_of,
    violation_cross,
    violation_hover,
)
from soter.report.run.record import Figure
from soter.report.templates import rounded_numbers
from soter.report.wording import quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.report.run.record import Chart, Json, Series

SHARES_MIN = (1.25, 0.3)
"""What is seen is at least so wide as a part of its height, and so high as a part of its width."""


def path_figure(chart: Chart, key: str) -> Figure | None:
    """Draws the path of a chart; None if no two signals are x and y of one position."""
    if (found := _position_signals(chart.series)) is None:
        return None
    rows = np.column_stack([s.values for s in found])
    if np.isnan(rows).all(axis=0).any():  # never published
        return None
    all_ac = np.all([band.in_control for band in chart.modes], axis=0)
    in_control = np.broadcast_to(all_ac, chart.time_s.shape)
    at_s = [d.time_s for d in chart.decisions] + [v.time_s for v in chart.violations]
    keep = mode_edges(in_control) + nearest_indices(chart.time_s, at_s)
    drawn = thinned_indices(len(rows), keep)
    data: list[Json] = []
    for ac, who, colour in ((True, "AC", AC_COLOUR), (False, "SC", SC_COLOUR)):
        part = rows_flown_by(rows[drawn], in_control[drawn], ac=ac)
        if len(part):
            data.append(
                _path_trace(
                    part, "lines", line=line_style(colour, 2.2), hovertemplate=_hover_template(who)
                )
            )
    size = dot_size(len(chart.decisions), 9)
    events = [
        (giveback_dot(size), [(d.time_s, decision_hover(d)) for d in givebacks(chart.decisions)]),
        (takeover_dot(size), [(d.time_s, decision_hover(d)) for d in takeovers(chart.decisions)]),
        (violation_cross(10), [(v.time_s, violation_hover(v)) for v in chart.violations]),
        ({"symbol": "square", "size": 8, "color": "@ink"}, [(chart.time_s[0], "the start")]),
    ]
    for marker, texts in events:
        at = rows[nearest_indices(chart.time_s, [t for t, _ in texts])]
        text, template = [t for _, t in texts], "%{text}<extra></extra>"
        data.append(_path_trace(at, "markers", marker=marker, text=text, hovertemplate=template))
    low, high = np.nanmin(rows, axis=0), np.nanmax(rows, axis=0)
    half = np.maximum(high - low, np.max(high - low) * np.array(SHARES_MIN)) * 0.55 + 1e-3
    ends = np.transpose([(low + high) / 2 - half, (low + high) / 2 + half]).round(4).tolist()
    x, y = (
        axis_style(quantity(s.name, unit_of(s, chart.series)), range=shown, constrain="domain")
        for s, shown in zip(found, ends, strict=True)
    )
    label = f"{chart.title}: the path in {found[0].name} and {found[1].name}"
    return Figure(key, label, tuple(data), shared_layout(xaxis=x, yaxis={**y, "scaleanchor": "x"}))


def _position_signals(series: Sequence[Series]) -> tuple[Series, Series] | None:
    """The first two signals that are x and y of one position, quaternions excepted; else None."""
    by_name = {s.name: s for s in series}
    for name, x in by_name.items():
        place, _, last = name.rpartition(".")
        y = by_name.get(f"{place}.y")
        in_space = f"{place}.w" not in by_name and unit_of(x, series) in {"", "m"}
        if last == "x" and y is not None and in_space:
            return x, y
    return None


def _path_trace(rows: NDArray[np.float64], mode: str, **more: object) -> Json:
    x, y = (rounded_numbers(column, 4) for column in rows.T)
    return {"type": "scatter", "mode": mode, "x": x, "y": y, **more}


def _hover_template(who: str) -> str:
    return f"%{{x:.2f}}, %{{y:.2f}}, {who}<extra></extra>"
