"""The report's HTML, section by section, in the order people read: result, evidence, grounds.

Purpose: turns records into HTML through the templates in this folder, with headline, verdict and
figures in words.
Non-goals: judging: the counts come from the caller; drawing (`timeline.py`, a `SceneView`,
`soter.diagram`), style and behaviour (`assets/`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from soter.report.run.figure_parts import (
    change_text,
    event_place,
    figure_place,
    mode_bar,
    predicates_text,
)
from soter.report.run.path_figure import path_figure
from soter.report.run.timeline import chart_timeline, flight_timeline
from soter.report.run.where_sc_leads import led_json
from soter.report.templates import filled, script_json
from soter.report.wording import count_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.report.run.record import (
        Chart,
        Decision,
        Figure,
        Flight,
        ModeBand,
        Picture,
        ReportPage,
        Summary,
        Violation,
    )

    Bar = tuple[ModeBand | None, str]


PANELS = 4
"""Panels of a chart that are not folded."""
KNOWN = ("lap_s", "violations", "ac_share", "switches_to_sc", "switches_to_ac", "min_clearance_m")
CAPTIONS = {
    "lap_s": "a lap",
    "ac_share": "AC in control",
    "switches_to_sc": "SC took over",
    "switches_to_ac": "AC was given control",
    "min_clearance_m": "closest approach",
}
UNITS = {"_s": "s", "_m": "m", "_km": "km", "_ns": "ns"}


def violation_count(arm: Flight | Chart) -> int:
    """How often properties failed, taken from the summary or else counted in `violations`."""
    count = arm.summary.get("violations")
    return int(count) if isinstance(count, (int, float)) else len(arm.violations)


def page_headline(page: ReportPage) -> list[str]:
    """The result in a few sentences: on the protected arm first, then on other arms that failed."""
    if page.headline:
        return [page.headline]
    arms: list[Flight | Chart] = [*page.flights, *page.charts]
    if not arms:
        return [page.title]
    protected = [arm for arm in arms if _had_both_controllers(arm.summary)]
    subject = protected[0] if protected else arms[0]
    rest = [arm for arm in arms if arm is not subject and violation_count(arm) > 0]
    return [_arm_sentence(arm) for arm in (subject, *rest)]


def figure_texts(summary: Summary) -> list[tuple[str, str]]:
    """The caption and value of each summary entry except lap and violations, known ones first."""
    known = [key for key in KNOWN if key in summary and key not in ("lap_s", "violations")]
    others = [key for key in summary if key not in KNOWN]
    return [(_figure_caption(key), value_text(key, summary[key])) for key in (*known, *others)]


def value_text(key: str, value: float | str) -> str:
    """A figure of a summary as text; the end of its key gives the unit."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if key.endswith("share"):
        return f"{100 * value:.1f} %"
    if key.startswith("switches"):
        return f"{int(value)} \N{MULTIPLICATION SIGN}"
    unit = next((text for suffix, text in UNITS.items() if key.endswith(suffix)), "")
    number = f"{value:d}" if isinstance(value, int) else f"{value:.3g}"
    if key.endswith("_s") and not isinstance(value, int):
        number = f"{value:.1f}"
    if key == "min_clearance_m":
        number = f"{value:.2f}"
    return f"{number} {unit}".rstrip().replace("-", "\N{MINUS SIGN}")


def _figure_caption(key: str) -> str:
    """The caption for a summary key; an unknown key becomes the caption without its unit suffix."""
    unit = next((suffix for suffix in UNITS if key.endswith(suffix)), "")
    return CAPTIONS.get(key) or key.removesuffix(unit).replace("_", " ")


def _had_both_controllers(summary: Summary) -> bool:
    """Whether AC and SC were both in control at some time during the run."""
    share = summary.get("ac_share")
    return isinstance(share, (int, float)) and 0 < share < 1


def _arm_sentence(arm: Flight | Chart) -> str:
    """A sentence that states the lap time and the violations of an arm."""
    violations = count_text(violation_count(arm), "violation")
    lap = arm.summary.get("lap_s")
    if lap is None:
        return f"{arm.title}: {violations}."
    return f"{arm.title}: {violations}, {value_text('lap_s', lap)} a lap."


def longest_s(arms: Sequence[Flight | Chart]) -> float:
    """The end of the longest time axis of all arms, in s."""
    return max((float(arm.time_s[-1]) for arm in arms), default=0.0)


def _program_section(picture: Picture | None) -> str:
    """The page section with the program's diagram and where SC would lead; "" without a picture."""
    if picture is None:
        return ""
    return filled(
        "report/run/program.html.j2", picture=picture, script_json=script_json, led_json=led_json
    )


def page_body(page: ReportPage) -> tuple[str, list[Figure]]:
    """The HTML inside `<main>`, and the figures that the script draws into it."""
    arms: list[Flight | Chart] = [*page.flights, *page.charts]
    scene, drawn = ("", []) if page.scene is None else page.scene.sections(page.flights)
    flown = _flight_figures(page.flights)
    end_s = longest_s(page.charts)
    charted = [_chart_figures(c, f"chart-{i}", end_s) for i, c in enumerate(page.charts)]
    paths = [path_figure(c, f"path-{i}") for i, c in enumerate(page.charts)]
    drawn = [*drawn, *flown, *(p for p in paths if p), *chain(*charted)]
    main = filled(
        "report/run/page.html.j2",
        page=page,
        arms=arms,
        headline=page_headline(page),
        cards=_arm_cards(page, longest_s(arms)),
        scene=scene,
        flown=[(f.title, None, False, [x]) for f, x in zip(page.flights, flown, strict=True)],
        charted=[
            (c.title, path, len(c.modes) > 1, figures)
            for c, path, figures in zip(page.charts, paths, charted, strict=True)
        ],
        program=_program_section(page.picture),
        where_text=_place_text,
        change_text=change_text,
        count_text=count_text,
        figure_place=figure_place,
        figures=figure_texts,
        predicates_text=predicates_text,
        value_text=value_text,
        violation_count=violation_count,
    )
    return main.rstrip(), drawn


def _arm_cards(page: ReportPage, end_s: float) -> list[tuple[Flight | Chart, str, list[Bar]]]:
    """Each arm with the SVG of its map and, for each module, a bar that shows who had control."""
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


def _chart_figures(chart: Chart, key: str, end_s: float) -> list[Figure]:
    """The figures of a chart: one with its first panels, and a folded one with the others."""
    panels = list(dict.fromkeys(s.panel or s.name for s in chart.series))
    parts = [part for part in (panels[:PANELS], panels[PANELS:]) if part]
    series = [tuple(s for s in chart.series if (s.panel or s.name) in part) for part in parts]
    return [
        chart_timeline(replace(chart, series=each), f"{key}{'-more' * k}", end_s=end_s)
        for k, each in enumerate(series or [()])
    ]


def _flight_figures(flights: Sequence[Flight]) -> list[Figure]:
    """The figures of clearance and speed, one for each flight, with equal axes."""
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


def _place_text(flight: Flight, event: Decision | Violation) -> str:
    """The position of an event as text, with proper minus signs."""
    x, y, z = event_place(flight, event.time_s, event.position)
    return f"{x:.1f}, {y:.1f}, {z:.1f}".replace("-", "\N{MINUS SIGN}")
