"""The report's HTML, section by section, in the order people read: result, evidence, grounds.

Purpose: records in, HTML text out; every text from outside is escaped here. The program is shown by
its diagram with a player: strips of who was in control, a slider with its buttons, and the SVG,
whose boxes the page's script fills with values and lights up.
Non-goals: drawing (`timeline`, a `SceneView`, `soter.diagram`), what is shown of a run
(`live_diagram.py`), style and behaviour (`assets/`).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.report.plain_page import data_head
from soter.report.run.figure_elements import (
    change_text,
    figure_place,
    legend,
    predicates_text,
    signals_drawn,
)
from soter.report.run.live_diagram import led_section, live_json
from soter.report.run.packed_json import script_json
from soter.report.run.record import Flight
from soter.report.run.result_wording import (
    count_text,
    figures,
    headline,
    longest_s,
    prose,
    value_text,
    violation_count,
)
from soter.report.run.signals_for_drawing import mode_bar, place
from soter.report.run.timeline import chart_timeline, flight_timeline

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.report.run.live_diagram import Control
    from soter.report.run.record import (
        Cell,
        Chart,
        Comparison,
        Decision,
        Figure,
        ModeBand,
        Picture,
        ReportPage,
        Violation,
    )


TIMES = "\N{MULTIPLICATION SIGN}"
SPEEDS = ("0.01", "0.1", "1", "10")
NOTE = (
    "A box holds what was there at this moment; boxes of nodes, plants and decision modules light "
    "up when they step; of the two controllers the filled one is in control. ◂ and ▸ go from "
    "one step to the next."
)


def program_section(
    picture: Picture | None, drawn: Mapping[str, tuple[int, int]] | None = None
) -> str:
    """The section, empty without a picture; without anything live there is no player.

    `drawn`: signals whose numbers are in figures of the page, as (figure, trace).
    """
    if picture is None:
        return ""
    return (
        f'<section class="program"><h2>The program</h2>{_player(picture, drawn)}{_led(picture)}'
        f'<div class="scroll">{picture.svg}</div></section>'
    )


def _led(picture: Picture) -> str:
    """Where SC would lead, at the moment of the player."""
    return led_section(picture.led) if picture.live is not None and picture.live.end_s > 0 else ""


def _player(picture: Picture, drawn: Mapping[str, tuple[int, int]] | None) -> str:
    live = picture.live
    if live is None or live.end_s <= 0:
        return ""
    data = live_json(live, drawn)
    several = len(live.control) > 1
    strips = "".join(
        (f'<p class="bar-name">{escape(c.module)}</p>' if several else "")
        + f'<div class="strip">{_bar(c, live.end_s)}</div>'
        for c in live.control
    )
    speeds = "".join(
        f'<option value="{s}"{" selected" * (s == "1")}>{s} {TIMES}</option>' for s in SPEEDS
    )
    return (
        f'<p class="note lead">{NOTE} {escape(_kept(data, live.end_s, drawn))}</p>'
        '<div class="player">'
        f'{strips}<input type="range" id="moment" min="0" max="{live.end_s:.6g}" step="any" '
        'value="0" aria-label="time"><p><button type="button" class="back" aria-label="the step '
        'before">◂</button><button type="button" class="play" aria-label="play">▶</button>'
        '<button type="button" class="next" aria-label="the next step">▸</button>'
        f"<output>0.000 s</output><label>speed <select>{speeds}</select></label>"
        "</p></div>"
        f'<script type="application/json" id="live">{script_json(data)}</script>'
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
    drawn: list[Figure] = []
    sections = [
        _header(page),
        _arms(page),
        _comparison(page.comparison),
        _scene(page, drawn),
        _timelines(page, drawn),
        _charts(page, drawn),
        program_section(page.picture, signals_drawn(drawn)),
        _violations([*page.flights, *page.charts]),
        _decisions([*page.flights, *page.charts]),
        _listed("Notes", page.notes),
        _listed("What this rests on", page.assumptions),
        _provenance(page),
    ]
    return "\n".join(section for section in sections if section), drawn


def _header(page: ReportPage) -> str:
    """Open with the result."""
    result = headline(page)
    sentences = " ".join(f"<span>{prose(sentence)}</span>" for sentence in result)
    kicker = "" if result == [page.title] else f'<p class="kicker">{escape(page.title)}</p>'
    subtitle = f'<p class="subtitle">{prose(page.subtitle)}</p>' if page.subtitle else ""
    return f'<header class="top">{kicker}<h1>{sentences}</h1>{subtitle}</header>'


def _arms(page: ReportPage) -> str:
    """Put the arms side by side: map, bar of control, figures."""
    arms: list[Flight | Chart] = [*page.flights, *page.charts]
    if not arms:
        return ""
    end_s = longest_s(arms)
    cards = [
        _card(
            flight,
            page.scene.thumbnail(flight, page.flights),
            mode_bar(flight.time_s, flight.in_control, end_s),
        )
        for flight in page.flights
        if page.scene is not None
    ]
    cards += [_card(chart, "", _chart_bars(chart, end_s)) for chart in page.charts]
    return f'<section class="arms">{"".join(cards)}</section>{_key_of_bars(arms)}'


def _card(arm: Flight | Chart, picture: str, bars: str) -> str:
    """Show one arm."""
    violations = violation_count(arm)
    verdict = "bad" if violations else "good"
    sign = "✕" if violations else "✓"
    lap = arm.summary.get("lap_s")
    lap_text = (
        f'<p class="lap">{escape(value_text("lap_s", lap))} <span>a lap</span></p>'
        if lap is not None
        else ""
    )
    items = "".join(
        f"<div><dt>{escape(caption)}</dt><dd>{escape(value)}</dd></div>"
        for caption, value in figures(arm.summary)
    )
    name = f"<code>{escape(arm.name)}</code>" if arm.name != arm.title else ""
    return (
        f'<article class="arm"><header><h2>{escape(arm.title)}</h2>{name}</header>{picture}{bars}'
        f'<div class="result">{lap_text}<p class="verdict {verdict}"><span>{sign}</span> '
        f"{escape(count_text(violations, 'violation'))}</p></div>{_watched(arm)}"
        f"<dl>{items}</dl></article>"
    )


def _watched(arm: Flight | Chart) -> str:
    """Name each property with its verdict: a count of violations says nothing of what was asked."""
    if isinstance(arm, Flight) or arm.properties is None:
        return ""
    if not arm.properties:
        return '<p class="note">The system states no property: nothing was asked.</p>'
    failed = {violation.text for violation in arm.violations}
    items = "".join(
        f'<li class="{"bad" if text in failed else "good"}"><span>'
        f"{'✕ violated' if text in failed else '✓ held'}</span> <code>{escape(text)}</code></li>"
        for text in arm.properties
    )
    return f'<ul class="watched">{items}</ul>'


def _chart_bars(chart: Chart, end_s: float) -> str:
    """Show who was in control of each module, named where there are several."""
    several = len(chart.modes) > 1
    return "".join(
        (f'<p class="bar-name">{escape(band.module)}{_told(band)}</p>' if several else "")
        + mode_bar(chart.time_s, band.in_control, end_s)
        for band in chart.modes
    )


def _told(band: ModeBand) -> str:
    return f": {escape(band.told)}" if band.told else ""


def _key_of_bars(arms: Sequence[Flight | Chart]) -> str:
    """Explain the marks, once."""
    entries: list[tuple[str, str]] = [
        ('<i class="stroke ac"></i>', "AC, the advanced controller, in control"),
        ('<i class="stroke sc"></i>', "SC, the safe controller, in control"),
    ]
    if any(arm.decisions for arm in arms):
        entries += [
            ('<i class="mark takeover"></i>', "the DM took over, AC → SC"),
            ('<i class="mark giveback"></i>', "the DM gave back, SC → AC"),
        ]
    if any(arm.violations for arm in arms):
        entries.append(('<i class="mark cross"></i>', "violation of a system property"))
    return legend(entries)


def _comparison(comparison: Comparison | None) -> str:
    """Set our figures beside the paper's."""
    if comparison is None:
        return ""
    head = "".join(f'<th scope="col">{escape(title)}</th>' for title in comparison.columns)
    rows = "".join(
        f'<tr><th scope="row">{prose(quantity)}</th>{"".join(_cell(cell) for cell in cells)}</tr>'
        for quantity, cells in comparison.rows
    )
    note = f'<p class="note">{prose(comparison.note)}</p>' if comparison.note else ""
    return (
        '<section><h2>Beside the paper</h2><div class="scroll"><table class="comparison">'
        f"<thead><tr><td></td>{head}</tr></thead><tbody>{rows}</tbody></table></div>{note}</section>"
    )


def _cell(cell: Cell) -> str:
    """Show our figure and the paper's."""
    paper = f'<span class="paper">paper {escape(cell.paper)}</span>' if cell.paper else ""
    return f"<td><strong>{escape(cell.ours)}</strong>{paper}</td>"


def _scene(page: ReportPage, drawn: list[Figure]) -> str:
    """Show the flights where they took place."""
    if page.scene is None:
        return ""
    sections, figures = page.scene.sections(page.flights)
    drawn += figures
    return sections


def _timelines(page: ReportPage, drawn: list[Figure]) -> str:
    """Show clearance and speed of each flight on equal axes."""
    if not page.flights:
        return ""
    end_s = longest_s(page.flights)
    clearances = np.concatenate([flight.clearance_m for flight in page.flights])
    known = clearances[np.isfinite(clearances)]
    span = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    parts: list[str] = []
    for index, flight in enumerate(page.flights):
        key = f"time-{index}"
        figure = flight_timeline(flight, key, end_s=end_s, clearance_range_m=span)
        drawn.append(figure)
        parts.append(f"<h3>{escape(flight.title)}</h3>{figure_place(figure, 'time')}")
    return f"<section><h2>Clearance, speed and who is in control</h2>{''.join(parts)}</section>"


def _charts(page: ReportPage, drawn: list[Figure]) -> str:
    """Show the signals of each arm of a program without geometry."""
    if not page.charts:
        return ""
    end_s = longest_s(page.charts)
    parts: list[str] = []
    for index, chart in enumerate(page.charts):
        figure = chart_timeline(chart, f"chart-{index}", end_s=end_s)
        drawn.append(figure)
        parts.append(f"<h3>{escape(chart.title)}</h3>{figure_place(figure, 'time')}")
    return f"<section><h2>Signals and who is in control</h2>{''.join(parts)}</section>"


def _violations(arms: Sequence[Flight | Chart]) -> str:
    """List every violation with the property that failed."""
    rows = "".join(
        f'<tr><td class="number"{data_head("t / s")}>{violation.time_s:.3f}</td>'
        f"<td{data_head('arm')}>{escape(arm.title)}</td>"
        f"<td>{prose(violation.text)}{_often(violation)}</td>{_where(arm, violation)}</tr>"
        for arm in arms
        for violation in arm.violations
    )
    if not rows:
        return ""
    placed = any(isinstance(arm, Flight) for arm in arms)
    where = '<th scope="col">where / m</th>' if placed else ""
    return (
        '<section><h2>Violations</h2><div class="scroll tall"><table class="events stacked">'
        '<thead><tr><th scope="col" class="number">t / s</th><th scope="col">arm</th>'
        f'<th scope="col">what failed</th>{where}</tr></thead><tbody>{rows}</tbody></table></div>'
        "</section>"
    )


def _often(violation: Violation) -> str:
    return f", the first of {violation.times} times" if violation.times > 1 else ""


def _where(arm: Flight | Chart, event: Decision | Violation) -> str:
    """Return the cell that says where an event took place, if the arm moves through a scene."""
    if not isinstance(arm, Flight):
        return ""
    x, y, z = place(arm, event.time_s, event.position)
    return f'<td class="where"{data_head("where / m")}>{_minus(f"{x:.1f}, {y:.1f}, {z:.1f}")}</td>'


def _minus(number: str) -> str:
    """Set negative numbers with a minus sign."""
    return number.replace("-", "\N{MINUS SIGN}")


def _decisions(arms: Sequence[Flight | Chart]) -> str:
    """List every decision with its reason."""
    tables = [_decision_table(arm, several=len(arms) > 1) for arm in arms if arm.decisions]
    if not tables:
        return ""
    count = count_text(sum(len(arm.decisions) for arm in arms), "step")
    return (
        "<section><h2>Decisions of the DM</h2>"
        f'<p class="note lead">Each step of a decision module that changed who is in control: '
        f"{count} in all.</p>"
        f"{''.join(tables)}</section>"
    )


def _decision_table(arm: Flight | Chart, *, several: bool) -> str:
    """List one arm's decisions."""
    count = count_text(len(arm.decisions), "decision")
    title = f"<h3>{escape(arm.title)} <small>{count}</small></h3>" if several else ""
    modules = {decision.module for decision in arm.decisions}
    where = '<th scope="col">where / m</th>' if isinstance(arm, Flight) else ""
    module = '<th scope="col">module</th>' if len(modules) > 1 else ""
    rows = "".join(
        _decision_row(arm, decision, with_module=len(modules) > 1) for decision in arm.decisions
    )
    return (
        f'{title}<div class="scroll tall"><table class="events stacked"><thead><tr>'
        '<th scope="col" class="number">t / s</th><th scope="col">change</th>'
        f'<th scope="col">why</th><th scope="col">what the DM saw</th>{where}{module}'
        f"</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _decision_row(arm: Flight | Chart, decision: Decision, *, with_module: bool) -> str:
    """Show one decision."""
    module = (
        f"<td{data_head('module')}><code>{escape(decision.module)}</code></td>"
        if with_module
        else ""
    )
    kind = "takeover" if decision.to == "SC" else "giveback"
    seen = "<br>".join(escape(text) for text in predicates_text(decision.predicates))
    values = "".join(f"<br><code>{escape(text)}</code>" for text in decision.why)
    return (
        f'<tr><td class="number"{data_head("t / s")}>{decision.time_s:.3f}</td>'
        f'<td class="change"><i class="mark {kind}"></i>{change_text(decision)}</td>'
        f'<td class="why">{prose(decision.reason)}{values}</td><td class="seen">{seen}</td>'
        f"{_where(arm, decision)}{module}</tr>"
    )


def _listed(title: str, texts: Sequence[str]) -> str:
    """Say what the result rests on, or what is worth knowing of it."""
    if not texts:
        return ""
    items = "".join(f"<li>{prose(text)}</li>" for text in texts)
    return f'<section class="grounds"><h2>{title}</h2><ul>{items}</ul></section>'


def _provenance(page: ReportPage) -> str:
    """Say what was run, so that it can be run again."""
    if not page.provenance:
        return ""
    items = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
        for name, value in page.provenance.items()
    )
    return f'<section class="provenance"><h2>Provenance</h2><dl>{items}</dl></section>'
