"""The report's HTML, section by section, in the order people read: result, evidence, grounds.

Purpose: records in, HTML text out of the templates beside. The program is shown by its diagram with
a player: strips of who was in control, a slider with its buttons, and the SVG, whose boxes the
page's script fills with values and lights up.
Non-goals: drawing (`timeline`, a `SceneView`, `soter.diagram`), what is shown of a run
(`live_diagram.py`), style and behaviour (`assets/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.report.run.figure_elements import (
    change_text,
    figure_place,
    predicates_text,
    signals_drawn,
)
from soter.report.run.live_diagram import led_json, live_json
from soter.report.run.packed_json import script_json
from soter.report.run.result_wording import (
    count_text,
    figures,
    headline,
    longest_s,
    value_text,
    violation_count,
)
from soter.report.run.signals_for_drawing import mode_bar, place
from soter.report.run.timeline import chart_timeline, flight_timeline
from soter.report.templates import filled

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.report.run.live_diagram import Control
    from soter.report.run.record import (
        Chart,
        Decision,
        Figure,
        Flight,
        ModeBand,
        Picture,
        ReportPage,
        Violation,
    )

    Bar = tuple[ModeBand | None, str]


def program_section(
    picture: Picture | None, drawn: Mapping[str, tuple[int, int]] | None = None
) -> str:
    """The section, empty without a picture; without anything live there is no player.

    `drawn`: signals whose numbers are in figures of the page, as (figure, trace).
    """
    if picture is None:
        return ""
    live = picture.live if picture.live and picture.live.end_s > 0 else None
    data = live_json(live, drawn) if live else {}
    return filled(
        "report/run/program.html.j2",
        picture=picture,
        live=live,
        data=data,
        kept=_kept(data, live.end_s, drawn) if live else "",
        bar=_bar,
        script_json=script_json,
        led_json=led_json,
    )


def _kept(
    data: Mapping[str, Any], end_s: float, drawn: Mapping[str, tuple[int, int]] | None
) -> str:
    """How exactly values are known here."""
    sparse = [r for r in data["values"] if "drawn" not in r and "t" not in r]
    told = "Numbers that a time line draws are those of its points" if drawn else ""
    if sparse:
        grid = data["grid"]
        count = len(grid["d"] if isinstance(grid, dict) else grid)
        often = f"every {end_s / max(count - 1, 1):.3g} s"
        rest = (
            f"others that change oftener are known {often}"
            if drawn
            else (f"Values that change oftener are known {often}")
        )
        told = f"{told}; {rest}" if drawn else rest
    return f"{told}; in between the one before stands." if told else ""


def _bar(control: Control, end_s: float) -> str:
    times = [t for t, _ in control.modes]
    modes = [ac for _, ac in control.modes]
    ends = np.array([*times, end_s]), np.array([*modes, *modes[-1:]], dtype=np.bool_)
    return mode_bar(*ends, end_s)


def body(page: ReportPage) -> tuple[str, list[Figure]]:
    """Return the inside of `<main>` and the figures it has places for."""
    arms: list[Flight | Chart] = [*page.flights, *page.charts]
    scene, drawn = ("", []) if page.scene is None else page.scene.sections(page.flights)
    flown = _flown(page.flights)
    end_s = longest_s(page.charts)
    charted = [chart_timeline(c, f"chart-{i}", end_s=end_s) for i, c in enumerate(page.charts)]
    drawn = [*drawn, *flown, *charted]
    main = filled(
        "report/run/page.html.j2",
        page=page,
        arms=arms,
        headline=headline(page),
        cards=_cards(page, longest_s(arms)),
        scene=scene,
        flown=[(f.title, figure) for f, figure in zip(page.flights, flown, strict=True)],
        charted=[(c.title, figure) for c, figure in zip(page.charts, charted, strict=True)],
        program=program_section(page.picture, signals_drawn(drawn)),
        where_text=_where,
        change_text=change_text,
        count_text=count_text,
        figure_place=figure_place,
        figures=figures,
        predicates_text=predicates_text,
        value_text=value_text,
        violation_count=violation_count,
    )
    return main.rstrip(), drawn


def _cards(page: ReportPage, end_s: float) -> list[tuple[Flight | Chart, str, list[Bar]]]:
    """The arms side by side: each with its map, and bars of who was in control of its modules."""
    cards: list[tuple[Flight | Chart, str, list[Bar]]] = []
    if page.scene is not None:
        for f in page.flights:
            bar = mode_bar(f.time_s, f.in_control, end_s)
            cards.append((f, page.scene.thumbnail(f, page.flights), [(None, bar)]))
    cards += [
        (c, "", [(b, mode_bar(c.time_s, b.in_control, end_s)) for b in c.modes])
        for c in page.charts
    ]
    return cards


def _flown(flights: Sequence[Flight]) -> list[Figure]:
    """Clearance and speed of each flight on equal axes."""
    if not flights:
        return []
    end_s = longest_s(flights)
    clearances = np.concatenate([flight.clearance_m for flight in flights])
    known = clearances[np.isfinite(clearances)]
    span = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return [
        flight_timeline(flight, f"time-{index}", end_s=end_s, clearance_range_m=span)
        for index, flight in enumerate(flights)
    ]


def _where(flight: Flight, event: Decision | Violation) -> str:
    """Where an event took place, negative numbers with a minus sign."""
    x, y, z = place(flight, event.time_s, event.position)
    return f"{x:.1f}, {y:.1f}, {z:.1f}".replace("-", "\N{MINUS SIGN}")
