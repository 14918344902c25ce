"""The city from above.

Purpose: buildings shaded by height, the tubes of φ_safe, of the look-ahead and of φ_safer, the
trajectories coloured by who is in control, and what the DM decided where.
Non-goals: the legend, which stands in the page's own text (`html.py`).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np
from city_scene import TUBE_GROUP, plans_group
from city_shapes import box_outline, height_levels, join, tube_outline, window

from soter.report.run.figure_parts import (
    AC_COLOUR,
    SC_COLOUR,
    axis_style,
    decision_hover,
    event_place,
    flight_indices,
    giveback_dot,
    givebacks,
    group_of_arm,
    line_style,
    rows_flown_by,
    shared_layout,
    takeover_dot,
    takeovers,
    violation_cross,
    violation_hover,
)
from soter.report.run.record import Figure, Json
from soter.report.templates import rounded_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from city_scene import Scene
    from city_shapes import Window

    from soter.report.run.record import Decision, Flight, Vec3

DASHES = ("solid", "dash", "dot", "dashdot")
LABELLED_SIDE_MIN_M = 2.5
FLIGHT_HOVER = (
    "t = %{customdata[0]:.2f} s · <b>%{meta}</b> in control<br>"
    "x %{x:.2f}  y %{y:.2f}  z %{customdata[1]:.2f} m<br>"
    "clearance %{customdata[2]:.2f} m · %{customdata[3]:.1f} m/s<extra></extra>"
)


def city_map(scene: Scene, flights: Sequence[Flight]) -> Figure:
    """Draw the scene and the flights from above, x to the right and y upwards."""
    shown = window(scene, flights)
    data = [*_buildings(scene, shown), *_tubes(scene)]
    dashes = dash_of(flights)
    for flight in flights:
        data += _ways(flight)
    for flight in flights:
        data += _trajectory(flight, dashes[flight.name])
    for flight in flights:
        data += _events(flight)
    data += _goals(scene)
    return Figure(
        "map",
        "The city from above, with the trajectories coloured by who is in control",
        tuple(data),
        shared_layout(
            xaxis=axis_style("x / m", range=[shown.x_min, shown.x_max], constrain="domain"),
            yaxis=axis_style(
                "y / m",
                range=[shown.y_min, shown.y_max],
                scaleanchor="x",
                constrain="domain",
            ),
        ),
    )


def dash_of(flights: Sequence[Flight]) -> dict[str, str]:
    """Give each arm its line: solid for the first that both controllers flew, then the others."""
    mixed = [flight for flight in flights if flight.in_control.any() != flight.in_control.all()]
    order = mixed + [flight for flight in flights if flight not in mixed]
    return {flight.name: DASHES[index % len(DASHES)] for index, flight in enumerate(order)}


def _buildings(scene: Scene, shown: Window) -> list[Json]:
    """Draw each box, darker the higher, with its height where there is room to write it."""
    traces: list[Json] = []
    for box, level in zip(scene.boxes, height_levels(scene.boxes).tolist(), strict=True):
        outline = box_outline(box)
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": rounded_numbers(outline[:, 0]),
                "y": rounded_numbers(outline[:, 1]),
                "fill": "toself",
                "fillcolor": f"@box-{level}",
                "line": line_style("@box-line", 1),
                "hoveron": "fills",
                "hoverinfo": "text",
                "text": f"building, {box[1, 2]:g} m high",
            }
        )
    corners = np.asarray([[shown.x_min, shown.y_min], [shown.x_max, shown.y_max]])
    visible = np.clip(scene.boxes[:, :, :2], corners[0], corners[1])
    roomy = (visible[:, 1] - visible[:, 0]).min(axis=1) >= LABELLED_SIDE_MIN_M
    centres = visible[roomy].mean(axis=1)
    traces.append(
        {
            "type": "scatter",
            "mode": "text",
            "x": rounded_numbers(centres[:, 0]),
            "y": rounded_numbers(centres[:, 1]),
            "text": [f"{top:g} m" for top in scene.boxes[roomy, 1, 2].tolist()],
            "textfont": {"color": "@box-text", "size": 11},
            "hoverinfo": "skip",
        }
    )
    return traces


def _tubes(scene: Scene) -> list[Json]:
    """Draw the three nested regions, each as the union over all segments, and the centre lines."""
    if not scene.tubes:
        return []
    regions = (
        ("safe", [tube.half_width_m for tube in scene.tubes]),
        ("look", [tube.look_ahead_half_width_m for tube in scene.tubes]),
        ("safer", [tube.safer_half_width_m for tube in scene.tubes]),
    )
    traces: list[Json] = []
    for colour, widths in regions:
        outline = join(
            tube_outline(tube, width) for tube, width in zip(scene.tubes, widths, strict=True)
        )
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": rounded_numbers(outline[:, 0]),
                "y": rounded_numbers(outline[:, 1]),
                "fill": "toself",
                "fillcolor": f"@{colour}-fill",
                "line": line_style("rgba(0,0,0,0)", 0),
                "hoverinfo": "skip",
                "group": TUBE_GROUP,
            }
        )
    centre = join(np.asarray([tube.start, tube.end], dtype=np.float64) for tube in scene.tubes)
    traces.append(
        {
            "type": "scatter",
            "mode": "lines",
            "x": rounded_numbers(centre[:, 0]),
            "y": rounded_numbers(centre[:, 1]),
            "line": line_style("@muted", 1, "dot"),
            "hoverinfo": "skip",
            "group": TUBE_GROUP,
        }
    )
    return traces


def _ways(flight: Flight) -> list[Json]:
    """Draw the plans: dotted what was in force, dashed and red what was refused."""
    traces: list[Json] = []
    for refused, colour, dash in ((False, "@ink", "dot"), (True, "@takeover", "dash")):
        ways = [way for way in flight.ways if way.refused is refused]
        if not ways:
            continue
        rows = join(way.points for way in ways)
        texts = [escape(way.text) for way in ways for _ in range(len(way.points) + 1)][:-1]
        traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "x": rounded_numbers(rows[:, 0]),
                "y": rounded_numbers(rows[:, 1]),
                "text": texts,
                "hovertemplate": f"<b>{escape(flight.title)}</b><br>%{{text}}<extra></extra>",
                "line": line_style(colour, 1.4, dash),
                "marker": {"symbol": "circle", "size": 3, "color": colour},
                "group": plans_group(flight.name, refused=refused),
            }
        )
    return traces


def _trajectory(flight: Flight, dash: str) -> list[Json]:
    """Draw what AC flew and what SC flew, each in its colour."""
    chosen = flight_indices(flight)
    rows = np.column_stack(
        [
            flight.position[chosen],
            flight.time_s[chosen],
            flight.clearance_m[chosen],
            flight.speed[chosen],
        ]
    )
    traces: list[Json] = []
    for ac, who, colour in ((True, "AC", AC_COLOUR), (False, "SC", SC_COLOUR)):
        part = rows_flown_by(rows, flight.in_control[chosen], ac=ac)
        if len(part) == 0:
            continue
        details = [rounded_numbers(part[:, column]) for column in (3, 2, 4, 5)]
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": rounded_numbers(part[:, 0]),
                "y": rounded_numbers(part[:, 1]),
                "customdata": [list(row) for row in zip(*details, strict=True)],
                "meta": who,
                "hovertemplate": f"<b>{escape(flight.title)}</b><br>{FLIGHT_HOVER}",
                "line": line_style(colour, 2.4, dash),
                "group": group_of_arm(flight.name),
            }
        )
    return traces


def _events(flight: Flight) -> list[Json]:
    """Draw red dots, green dots and crosses, above every line."""
    group = group_of_arm(flight.name)
    traces = [
        _decision_marks(flight, givebacks(flight.decisions), giveback_dot(), group),
        _decision_marks(flight, takeovers(flight.decisions), takeover_dot(), group),
    ]
    places = [event_place(flight, v.time_s, v.position) for v in flight.violations]
    traces.append(
        _marks(places, [violation_hover(v) for v in flight.violations], violation_cross(), group)
    )
    return [trace for trace in traces if trace["x"]]


def _decision_marks(
    flight: Flight, decisions: Sequence[Decision], marker: Json, group: str
) -> Json:
    """Draw decisions where they were taken."""
    places = [event_place(flight, d.time_s, d.position) for d in decisions]
    return _marks(places, [decision_hover(d) for d in decisions], marker, group)


def _marks(places: Sequence[Vec3], texts: Sequence[str], marker: Json, group: str) -> Json:
    """Draw markers with hover texts."""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [round(x, 3) for x, _, _ in places],
        "y": [round(y, 3) for _, y, _ in places],
        "text": list(texts),
        "hovertemplate": "%{text}<extra></extra>",
        "marker": marker,
        "group": group,
        "cliponaxis": False,
    }


def _goals(scene: Scene) -> list[Json]:
    """Label the goals."""
    if not scene.goals:
        return []
    return [
        {
            "type": "scatter",
            "mode": "markers+text",
            "x": [round(x, 3) for _, (x, _, _) in scene.goals],
            "y": [round(y, 3) for _, (_, y, _) in scene.goals],
            "text": [f"<b>{escape(name)}</b>" for name, _ in scene.goals],
            "textposition": "top center",
            "textfont": {"color": "@ink", "size": 13},
            "marker": {
                "symbol": "diamond",
                "size": 9,
                "color": "@ink",
                "line": {"color": "@paper", "width": 1.5},
            },
            "customdata": [round(z, 2) for _, (_, _, z) in scene.goals],
            "hovertemplate": "%{text}<br>x %{x} y %{y} z %{customdata} m<extra></extra>",
        }
    ]
