"""The sections of a report in which the drone's flights are seen in their city.

Purpose: the `SceneView` of demo and mission: small maps for the arms, a map and a view in three
dimensions with switches and legends. Every text from outside is escaped here.
Non-goals: the figures themselves (`city_map.py`, `city_solid.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from city_map import city_map, dash_of
from city_scene import PLAN_GROUP, REFUSED_GROUP, TUBE_GROUP
from city_solid import city_solid
from city_thumbnail import flight_thumbnail

from soter.report.run.figure_parts import figure_place, group_of_arm, legend
from soter.report.wording import prose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from city_scene import Scene

    from soter.report.run.record import Figure, Flight


@dataclass(frozen=True, eq=False)
class CityView:
    """How a report shows a city and the flights through it."""

    scene: Scene

    def thumbnail(self, flight: Flight, flights: Sequence[Flight]) -> str:
        """Return an SVG of one flight from above."""
        return flight_thumbnail(self.scene, flight, flights)

    def sections(self, flights: Sequence[Flight]) -> tuple[str, list[Figure]]:
        """Show the city from above and in three dimensions."""
        scene = self.scene
        above, solid = city_map(scene, flights), city_solid(scene, flights)
        note = f'<p class="note">{prose(scene.note)}</p>' if scene.note else ""
        credit = f'<p class="note">{escape(scene.credit)}</p>' if scene.credit else ""
        switches = _switches(scene, flights)
        return (
            f"<section><h2>The city from above</h2>{switches}"
            f"{figure_place(above, 'map')}{_legend_of(scene)}{note}</section>"
            f"<section><h2>In three dimensions</h2>{switches}"
            f"{figure_place(solid, 'solid')}{credit}</section>"
        ), [above, solid]


def _switches(scene: Scene, flights: Sequence[Flight]) -> str:
    """Let the reader choose arms and regions; both city figures obey.

    At first only arms flown by both controllers are on: the others are in the small maps above.
    Of arms with plans it is the first: two of them with all their plans fill the city.
    """
    mixed = [f for f in flights if f.in_control.any() != f.in_control.all()]
    on = mixed or list(flights)
    if any(flight.ways for flight in flights):
        on = on[:1]
    dashes = dash_of(flights)
    buttons = [
        f'<button type="button" data-group="{escape(group_of_arm(flight.name))}" '
        f'aria-pressed="{str(flight in on).lower()}">'
        f'<i class="sample {dashes[flight.name]}"></i>{escape(flight.title)}</button>'
        for flight in flights
    ]
    if scene.tubes:
        buttons.append(
            f'<button type="button" data-group="{TUBE_GROUP}" aria-pressed="true">'
            '<i class="sample region"></i>tubes</button>'
        )
    ways = [way for flight in flights for way in flight.ways]
    for group, text in ((PLAN_GROUP, "plans in force"), (REFUSED_GROUP, "plans refused")):
        if any(way.refused is (group == REFUSED_GROUP) for way in ways):
            buttons.append(
                f'<button type="button" data-group="{group}" aria-pressed="true">'
                f'<i class="sample {group}"></i>{text}</button>'
            )
    return f'<div class="switches" role="group" aria-label="what is shown">{"".join(buttons)}</div>'


def _legend_of(scene: Scene) -> str:
    """Explain the regions and the shades of the buildings."""
    entries: list[tuple[str, str]] = []
    if scene.tubes:
        entries += [
            ('<i class="area safer"></i>', prose("φ_safer: the DM gives back to AC")),
            ('<i class="area look"></i>', "between: whoever is in control keeps it"),
            (
                '<i class="area safe"></i>',
                prose(
                    "look-ahead ttf_2Δ: AC could leave φ_safe, the outer edge, within 2Δ; "
                    "the DM switches to SC"
                ),
            ),
        ]
    if len(scene.boxes):
        tops = scene.boxes[:, 1, 2]
        low, high = float(tops.min()), float(tops.max())
        entries.append(
            ('<i class="ramp"></i>', f"buildings, {low:g} to {high:g} m high")
            if high > low
            else ('<i class="area box"></i>', f"buildings, {high:g} m high")
        )
    return legend(entries)
