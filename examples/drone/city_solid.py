"""The city in three dimensions.

Purpose: the same scene and colours as the map, true to scale, to be turned by hand.
Non-goals: photographs; tubes show their outer edges and φ_safer only, or nothing would be seen.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np
from city_map import FLIGHT_HOVER
from city_scene import TUBE_GROUP, plans_group
from city_shapes import (
    HEIGHT_LEVELS,
    box_rings,
    height_levels,
    join,
    loft_edges,
    loft_mesh,
    tube_rings,
    window,
)

from soter.report.run.figure_parts import (
    AC_COLOUR,
    SC_COLOUR,
    decision_hover,
    event_place,
    flight_indices,
    givebacks,
    group_of_arm,
    rows_flown_by,
    shared_layout,
    takeovers,
    violation_hover,
)
from soter.report.run.record import Figure, Json
from soter.report.templates import rounded_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from city_scene import Scene
    from numpy.typing import NDArray

    from soter.report.run.record import Flight, Vec3

POINTS_MAX = 1500
CLIP_M = 0.3
"""What touches the end of an axis is clipped; roofs and ground stay this far inside."""
ZOOM = 1.9
"""Length of the longest side of the scene in the camera's units; the eye stands 2 away."""


def city_solid(scene: Scene, flights: Sequence[Flight]) -> Figure:
    """Draw the scene and the flights in three dimensions, true to scale."""
    data = [*_ground(scene), *_buildings(scene), *_tubes(scene)]
    for flight in flights:
        data += _ways(flight)
        data += _trajectory(flight)
        data += _events(flight)
    data += _goals(scene)
    return Figure(
        "solid",
        "The city in three dimensions, with the trajectories coloured by who is in control",
        tuple(data),
        shared_layout(margin={"l": 0, "r": 0, "t": 0, "b": 0}, scene=_stage(scene, flights)),
    )


def _stage(scene: Scene, flights: Sequence[Flight]) -> Json:
    """Return axes over the workspace and a camera that looks at the flights from the south."""
    low = np.minimum(scene.lo, scene.boxes[:, 0].min(axis=0) if len(scene.boxes) else scene.lo)
    high = np.maximum(scene.hi, scene.boxes[:, 1].max(axis=0) if len(scene.boxes) else scene.hi)
    tops = scene.boxes[:, 1, 2].max() if len(scene.boxes) else 0.0
    highest = max([float(flight.position[:, 2].max()) for flight in flights], default=0.0)
    high[2] = max(scene.ceiling_m, float(tops), highest) + CLIP_M
    low[2] -= CLIP_M
    span = high - low
    ratio = span / span[:2].max() * ZOOM
    shown = window(scene, flights)
    centre_x = ((shown.x_min + shown.x_max) / 2 - (low[0] + high[0]) / 2) / span[0] * ratio[0]
    centre_y = ((shown.y_min + shown.y_max) / 2 - (low[1] + high[1]) / 2) / span[1] * ratio[1]
    closeness = max(shown.width, shown.height) / float(span[:2].max())
    reach = 0.45 + 1.15 * min(closeness, 1.0)
    axes = {
        name: {
            "range": [float(low[index]), float(high[index])],
            "title": {"text": f"{name} / m", "font": {"size": 11}},
            "tickfont": {"size": 10},
            "gridcolor": "@grid",
            "linecolor": "@rule",
            "zeroline": False,
            "showbackground": False,
            "showspikes": False,
            "nticks": 6 if index < 2 else 3,
        }
        for index, name in enumerate("xyz")
    }
    return {
        **{f"{name}axis": axes[name] for name in "xyz"},
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", ratio.round(4).tolist(), strict=True)),
        "camera": {
            "up": {"x": 0, "y": 0, "z": 1},
            "center": {"x": centre_x, "y": centre_y, "z": -0.05},
            "eye": {"x": centre_x - 0.35 * reach, "y": centre_y - 0.95 * reach, "z": 0.85 * reach},
        },
        "dragmode": "turntable",
    }


def _ground(scene: Scene) -> list[Json]:
    """Draw the ground and the outline of the ceiling."""
    (x0, y0, z0), (x1, y1, _) = scene.lo, scene.hi
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
    return [
        {
            "type": "mesh3d",
            "x": [x0, x1, x1, x0],
            "y": [y0, y0, y1, y1],
            "z": [z0 - 0.02] * 4,
            "i": [0, 0],
            "j": [1, 2],
            "k": [2, 3],
            "color": "@ground",
            "hoverinfo": "skip",
            "lighting": {"ambient": 1, "diffuse": 0, "specular": 0},
        },
        {
            "type": "scatter3d",
            "mode": "lines",
            "x": [x for x, _ in corners],
            "y": [y for _, y in corners],
            "z": [scene.ceiling_m] * 5,
            "line": {"color": "@muted", "width": 1.5, "dash": "dot"},
            "hovertemplate": f"ceiling, {scene.ceiling_m:g} m<extra></extra>",
        },
    ]


def _buildings(scene: Scene) -> list[Json]:
    """Draw the boxes of each shade as one mesh, and all their edges."""
    levels = height_levels(scene.boxes)
    traces: list[Json] = []
    for level in range(HEIGHT_LEVELS):
        lofts = [box_rings(box) for box in scene.boxes[levels == level]]
        if lofts:
            traces.append(_mesh(lofts, f"@box-{level}", 1.0))
    if len(scene.boxes):
        traces.append(_lines(loft_edges(box_rings(box) for box in scene.boxes), "@box-line", 1.5))
    return traces


def _tubes(scene: Scene) -> list[Json]:
    """Draw the edges of φ_safe and the body of φ_safer."""
    if not scene.tubes:
        return []
    edges = loft_edges(tube_rings(tube, tube.half_width_m) for tube in scene.tubes)
    bodies = [tube_rings(tube, tube.safer_half_width_m) for tube in scene.tubes]
    return [
        {**_lines(edges, "@tube-line", 1.2), "group": TUBE_GROUP},
        {**_mesh(bodies, "@giveback", 0.1), "group": TUBE_GROUP},
    ]


def _ways(flight: Flight) -> list[Json]:
    """Draw the plans: thin what was in force, red what was refused."""
    traces: list[Json] = []
    for refused, colour in ((False, "@muted"), (True, "@takeover")):
        ways = [way.points for way in flight.ways if way.refused is refused]
        if ways:
            group = plans_group(flight.name, refused=refused)
            traces.append({**_lines(join(ways), colour, 2.0), "group": group})
    return traces


def _trajectory(flight: Flight) -> list[Json]:
    """Draw what AC flew and what SC flew, each in its colour."""
    chosen = flight_indices(flight, POINTS_MAX)
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
                **_lines(part[:, :3], colour, 7.0),
                "customdata": [list(row) for row in zip(*details, strict=True)],
                "meta": who,
                "hovertemplate": f"<b>{escape(flight.title)}</b><br>{FLIGHT_HOVER}",
                "hoverinfo": "all",
                "group": group_of_arm(flight.name),
            }
        )
    return traces


def _events(flight: Flight) -> list[Json]:
    """Draw red dots, green dots and crosses."""
    red, green = takeovers(flight.decisions), givebacks(flight.decisions)
    kinds = (
        (
            [event_place(flight, d.time_s, d.position) for d in red],
            [decision_hover(d) for d in red],
            {"symbol": "circle", "size": 7, "color": "@takeover"},
        ),
        (
            [event_place(flight, d.time_s, d.position) for d in green],
            [decision_hover(d) for d in green],
            {"symbol": "circle", "size": 7, "color": "@giveback"},
        ),
        (
            [event_place(flight, v.time_s, v.position) for v in flight.violations],
            [violation_hover(v) for v in flight.violations],
            {"symbol": "x", "size": 6, "color": "@violation"},
        ),
    )
    group = group_of_arm(flight.name)
    return [_marks(places, texts, marker, group) for places, texts, marker in kinds if places]


def _marks(places: Sequence[Vec3], texts: Sequence[str], marker: Json, group: str) -> Json:
    """Draw markers with hover texts."""
    return {
        "type": "scatter3d",
        "mode": "markers",
        "x": [round(x, 3) for x, _, _ in places],
        "y": [round(y, 3) for _, y, _ in places],
        "z": [round(z, 3) for _, _, z in places],
        "text": list(texts),
        "hovertemplate": "%{text}<extra></extra>",
        "marker": marker,
        "group": group,
    }


def _goals(scene: Scene) -> list[Json]:
    """Label the goals."""
    if not scene.goals:
        return []
    return [
        {
            "type": "scatter3d",
            "mode": "markers+text",
            "x": [x for _, (x, _, _) in scene.goals],
            "y": [y for _, (_, y, _) in scene.goals],
            "z": [z for _, (_, _, z) in scene.goals],
            "text": [escape(name) for name, _ in scene.goals],
            "textposition": "top center",
            "textfont": {"color": "@ink", "size": 13},
            "marker": {"symbol": "diamond", "size": 4, "color": "@ink"},
            "hoverinfo": "text",
        }
    ]


def _mesh(lofts: Sequence[NDArray[np.float64]], colour: str, opacity: float) -> Json:
    """Return lofts as one solid with soft light."""
    vertices, triangles = loft_mesh(lofts)
    return {
        "type": "mesh3d",
        "x": rounded_numbers(vertices[:, 0]),
        "y": rounded_numbers(vertices[:, 1]),
        "z": rounded_numbers(vertices[:, 2]),
        "i": triangles[:, 0].tolist(),
        "j": triangles[:, 1].tolist(),
        "k": triangles[:, 2].tolist(),
        "color": colour,
        "opacity": opacity,
        "flatshading": True,
        "lighting": {"ambient": 0.72, "diffuse": 0.45, "specular": 0.02, "roughness": 1},
        "lightposition": {"x": -2000, "y": -6000, "z": 9000},
        "hoverinfo": "skip",
    }


def _lines(points: NDArray[np.float64], colour: str, width: float) -> Json:
    """Return polylines (m, 3), parted by rows of NaN."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": rounded_numbers(points[:, 0]),
        "y": rounded_numbers(points[:, 1]),
        "z": rounded_numbers(points[:, 2]),
        "line": {"color": colour, "width": width},
        "hoverinfo": "skip",
    }
