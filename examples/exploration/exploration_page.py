"""An exploration as a page on which the map grows, and as a still picture.

Purpose: `page`: one self-contained file, replayed by `replay.js`; without JavaScript and on paper
it shows the end of the run. `picture`: that still alone, as an SVG file.
Non-goals: flying and reading (`exploration_record.py`).
"""

from __future__ import annotations

import base64
import re
import sys
from html import escape
from importlib import resources
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from exploration_record import HERE, NEVER, Exploration

import soter
from soter.report.html import document
from soter.report.run.figure_parts import (
    POINTS_MAX,
    dot_size,
    givebacks,
    legend,
    mode_bar,
    mode_edges,
    takeovers,
    thinned_indices,
)
from soter.report.templates import packed_numbers, rounded_numbers, script_json
from soter.report.wording import prose
from soter.simulate.result_assumptions import run_assumptions

sys.path.insert(0, str(HERE.parent / "drone"))
from sketch import (
    DOTTED,
    EDGE,
    Panel,
    shaded,
    ticks,
    two_tone,
    where,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.report.run.record import Decision

AGES = 5
"""Shades of known cells, by when they became known."""
AT_ONCE_MS = 1000
"""The first shade: what the first scans say. The others have a quarter of what comes later each."""
DOT_PX = 4.0
"""Radius of a mark where few are drawn."""
CONTROL = (("ac", "AC in control"), ("sc", "SC in control"))
HATCH = (
    '<pattern id="hidden" width="6" height="6" patternUnits="userSpaceOnUse" '
    'patternTransform="rotate(45)"><path d="M0 0V6" style="stroke:var(--hidden);'
    'stroke-width:3"/></pattern>'
)


def age_limits_ms(known_ms: NDArray[np.uint32]) -> list[int]:
    """Until when, in ms, the cells of each shade became known; ascending, at most `AGES`."""
    later = known_ms[(known_ms != NEVER) & (known_ms > AT_ONCE_MS)]
    shares = np.arange(1, AGES) / (AGES - 1)
    quarters = np.quantile(later, shares, method="higher").tolist() if len(later) else []
    return sorted({AT_ONCE_MS, *(int(t) for t in quarters)})


# ---------------------------------------------------------------- the still picture


def still(e: Exploration) -> str:
    """The map at the end of the run, as an SVG element."""
    g = e.grid
    panel = Panel((g.x0, g.x0 + g.side), (g.y0, g.y0 + g.side), width_px=720)
    panel.box((g.x0, g.y0), (g.x0 + g.side, g.y0 + g.side), "fill:var(--unknown)")
    _cells(panel, e)
    panel.parts.append(HATCH)
    for wall in e.walls():
        panel.area(wall, "fill:url(#hidden);stroke:var(--hidden);stroke-dasharray:5 3")
    for x0, y0, x1, y1 in e.corridors[-1].corners:
        panel.box((x0, y0), (x1, y1), f"fill:none;{DOTTED}")
    x0, y0, x1, y1 = e.flown[-1].corners[0]
    panel.box((x0, y0), (x1, y1), "fill:none;stroke:var(--ink);stroke-width:2")
    _home(panel, e)
    chosen = _chosen(e)
    two_tone(panel, e.position[chosen], e.in_control[chosen])
    _marks(panel, e)
    return panel.svg(f"The map after {e.run.duration_s:g} s")


def _cells(panel: Panel, e: Exploration) -> None:
    """What is known, a path for each shade; cells of a column that are alike are one stretch."""
    g, limits = e.grid, age_limits_ms(e.known_ms)
    age = np.searchsorted(limits, e.known_ms).reshape(g.count, g.count)
    paths = [""] * len(limits)
    size = g.cell * panel.scale_x
    wide = size + 0.3  # px: no gaps between columns
    for i, column in enumerate(age):
        edges = [0, *(np.flatnonzero(np.diff(column)) + 1).tolist(), g.count]
        for j, end in pairwise(edges):
            if column[j] < len(limits):
                x, y = panel.place(g.x0 + i * g.cell, g.y0 + end * g.cell)
                high = (end - j) * size
                paths[column[j]] += f"M{x:.1f} {y:.1f}h{wide:.1f}v{high:.1f}h{-wide:.1f}z"
    for k, d in enumerate(paths):
        style = f"fill:var(--known-{k});shape-rendering:crispEdges"
        panel.parts.append(f'<path class="known" d="{d}" style="{style}"/>')


def _home(panel: Panel, e: Exploration) -> None:
    """A green square where it was switched on."""
    x, y = panel.place(*e.grid.home)
    style = "fill:var(--giveback);stroke:var(--paper);stroke-width:1.2"
    panel.parts.append(
        f'<rect x="{x - 6:.1f}" y="{y - 6:.1f}" width="12" height="12" style="{style}"/>'
    )


def _marks(panel: Panel, e: Exploration) -> None:
    """Changes of mode, violations, goals, and the vehicle."""
    decided = e.decisions()
    for chosen, inside, around in (
        (givebacks(decided), "--paper", "--giveback"),
        (takeovers(decided), "--takeover", "--paper"),
    ):
        _dots(panel, [_place(e, d) for d in chosen], inside, around)
    for v in e.run.violation_list:
        if v.time_s is not None:
            panel.cross(where(e.time_s, e.position, v.time_s).tolist(), "stroke:var(--bad)", 7)
    for k, goal in enumerate(e.tour.goals if e.tour else ()):
        panel.cross(goal, "stroke:var(--ink)")
        panel.text(goal, f"{k + 1}", up=9)
    panel.dot(e.position[-1], "fill:var(--ink);stroke:var(--paper);stroke-width:1.5", 6.0)


def _dots(panel: Panel, at: list[list[float]], inside: str, around: str) -> None:
    """Round marks, (k, 2), as two paths of points: where there are many, they are one outline."""
    spots = dict.fromkeys("M{:.0f} {:.0f}h0".format(*panel.place(*p)) for p in at)
    width = 2.0 * dot_size(len(at), DOT_PX)
    for colour, px in ((around, width + 2.4), (inside, width - 1.0)):
        style = f"stroke:var({colour});stroke-width:{px:.1f};stroke-linecap:round"
        panel.parts.append(f'<path d="{"".join(spots)}" style="{style}"/>')


def _place(e: Exploration, d: Decision) -> list[float]:
    place: list[float] = where(e.time_s, e.position, d.time_s).tolist()
    return place


def _chosen(e: Exploration) -> NDArray[np.intp]:
    """The samples that are drawn: sorted indices."""
    edges = mode_edges(e.in_control)
    return thinned_indices(len(e.time_s), edges, points_max=POINTS_MAX + len(edges))


def picture(e: Exploration) -> str:
    """The still picture as a file of its own, with the report's colours."""
    head, drawing = still(e).split(">", 1)
    head = head.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    return f"{head}><style>{_report_colours()}{_colours()}</style>{drawing}\n"


def _of_reports(asset: str) -> str:
    """What the pages of reports are made with, too."""
    return (resources.files("soter.report") / "assets" / asset).read_text(encoding="utf-8")


def _report_colours() -> str:
    """The variables of the report's style sheet, light and dark."""
    text = _of_reports("report.css")
    return text[text.index(":root") : text.index("\n* {")]


def _style() -> str:
    return (HERE / "replay.css").read_text(encoding="utf-8")


def _colours() -> str:
    """The first rule of the page's own style sheet."""
    text = _style()
    return text[text.index(":root") : text.index("}") + 1]


# ---------------------------------------------------------------- over time


def strips(e: Exploration) -> str:
    """What is known and how fast it flies, over time; blue ground: SC in control."""
    end_s = float(e.time_s[-1])
    chosen = _chosen(e)
    drawn = []
    for words, unit, values in (
        ("known", "%", 100 * e.share_known(e.time_s)),
        ("speed", "m/s", e.speed),
    ):
        most = 1.15 * max(float(values.max()), 0.1)
        panel = Panel(
            (0.0, end_s),
            (0.0, most),
            width_px=440,
            height_px=200,
            names=("time / s", f"{words} / {unit}"),
        )
        shaded(panel, e.time_s, e.in_control)
        for level in ticks(0.0, most):
            panel.line(np.array([[0.0, level], [end_s, level]]), "stroke:var(--grid)")
        line = np.stack([e.time_s, values], axis=-1)[chosen]
        panel.line(line, "stroke:var(--ink);stroke-width:1.6")
        panel.parts.append(
            f'<line class="now" y1="0" y2="{panel.height:.0f}" data-left="{EDGE}" '
            f'data-scale="{panel.scale_x}"/>'
        )
        label = f"{words} over time, at the end {values[-1]:.2f} {unit}"
        drawn.append(f'<div class="seek">{panel.svg(label)}</div>')
    return "".join(drawn)


# ---------------------------------------------------------------- words


def quantities(e: Exploration) -> dict[str, str]:
    """What happened, as text."""
    known = int((e.known_ms != NEVER).sum())
    steps = np.linalg.norm(np.diff(e.position, axis=0), axis=1)
    text_by_quantity = {
        "flown": f"{e.run.duration_s:g} s, {steps.sum():.0f} m",
        "known at the end": f"{known} of {len(e.known_ms)} cells, "
        f"{100 * known / len(e.known_ms):.1f} %",
        "AC in control": f"{100 * e.module.ac_share:.1f} %",
        "takeovers by SC": f"{e.module.switches_to_sc}",
        "hand-backs to AC": f"{e.module.switches_to_ac}",
        "fastest": f"{e.speed.max():.1f} m/s",
        "violations": f"{e.run.violations}",
    }
    if "survey" in e.topics:
        survey = e.last("survey")
        counts = f"{int(survey['adopted'])}, {int(survey['refused'])}"
        text_by_quantity["corridors let through, refused"] = counts
    if "doubt" in e.topics:
        doubt = "a scan contradicts it" if e.last("doubt") else "none"
        text_by_quantity["doubt of the map"] = doubt
    if e.tour is not None:
        text_by_quantity["goals reached"] = _reached(e.tour.reached)
    return text_by_quantity


def _reached(reached: tuple[bool, ...]) -> str:
    missing = [str(k + 1) for k, done in enumerate(reached) if not done]
    without = f"; not {', '.join(missing)}" if missing else ""
    return f"{sum(reached)} of {len(reached)}{without}"


def assumed_of_map() -> str:
    """What the mapper says at its head that it assumes."""
    text = (HERE / "mapper.soter").read_text(encoding="utf-8")
    match = re.search(r"^// Assumed[^:]*: (.*?\.)\n// [A-Z]", text, re.DOTALL | re.MULTILINE)
    assert match is not None, "mapper.soter says at its head what it assumes"
    text = match[1].replace("\n// ", " ")
    return text[0].upper() + text[1:]


def _silence(e: Exploration) -> list[str]:
    """What SILENCE adds to that."""
    silent = any(value for name, value in e.run.params.items() if name.endswith("SILENCE"))
    return (
        ["A ray that does not come back has met nothing within RANGE (SILENCE)."] if silent else []
    )


def _shown(e: Exploration) -> str:
    """A paragraph: what is seen."""
    goals = "Numbered crosses are its goals, in their order. " if e.tour is not None else ""
    return (
        "Seen from above: a drone in a space that it does not know. Its lidar makes cells known to "
        f"be free; they only become more. Boxes of such cells are what it may fly in. {goals}"
        f"Hatched walls are the truth: no node is told of them. {_decided(e)} {_ended(e)}"
    )


def _decided(e: Exploration) -> str:
    """Who was in control."""
    forced = e.run.system.modules[0].forced
    if forced is not None:
        return f"In this system {forced.upper()} alone is in control."
    return (
        "Before AC can leave the box in force, the decision module gives control to SC: in this "
        f"run of {e.run.duration_s:g} s it {_times_taken(e.module.switches_to_sc)}."
    )


def _ended(e: Exploration) -> str:
    """Whether it went well."""
    broken = [v for v in e.run.violation_list if v.time_s is not None]
    if not e.run.violations:
        return "Nothing that has to hold was violated."
    first = min(broken, key=lambda v: v.time_s or 0.0, default=None)
    when = f", at first after {first.time_s:.2f} s: {first.what}" if first is not None else ""
    return f"What has to hold was violated{when}."


def _times_taken(takeovers_by_sc: int) -> str:
    often = {0: "never did", 1: "did so once"}
    return often.get(takeovers_by_sc, f"did so {takeovers_by_sc} times")


def _legend(e: Exploration) -> str:
    limits = [f"{t / 1000:.1f}" for t in age_limits_ms(e.known_ms)]
    ages = "".join(f'<i class="area known-{k}"></i>' for k in range(len(limits)))
    entries = [
        *((f'<i class="stroke {kind}"></i>', words) for kind, words in CONTROL),
        ('<i class="mark takeover"></i>', "the DM took over, AC → SC"),
        ('<i class="mark giveback"></i>', "the DM gave back, SC → AC"),
        ('<i class="area unknown"></i>', "unknown"),
        (f'<b class="ages">{ages}</b>', f"known free by {', '.join(limits)} s"),
        ('<i class="area hidden"></i>', "wall, hidden from the vehicle"),
        ('<i class="area force"></i>', "box in force"),
        ('<i class="area corridor"></i>', "corridor let through last"),
        ('<i class="area home"></i>', "home"),
        ('<i class="mark vehicle"></i>', "the vehicle"),
    ]
    if e.tour is not None:
        entries.append(('<i class="mark cross"></i>', "goal"))
    if e.run.violation_list:
        entries.append(('<i class="mark cross bad"></i>', "violation"))
    return legend(entries)


# ---------------------------------------------------------------- the page


def data(e: Exploration) -> dict[str, object]:
    """What the page's script is given; times in s, places in m, cells as base64 of uint32 ms."""
    chosen = _chosen(e)
    rows = {
        "t": rounded_numbers(e.time_s[chosen], 3),
        "x": rounded_numbers(e.position[chosen, 0], 2),
        "y": rounded_numbers(e.position[chosen, 1], 2),
        "v": rounded_numbers(e.speed[chosen], 2),
        "ac": [int(a) for a in e.in_control[chosen]],
    }
    g = e.grid
    return {
        "grid": {"n": g.count, "cell": g.cell, "x0": g.x0, "y0": g.y0, "home": g.home},
        "end": float(e.time_s[-1]),
        "known": base64.b64encode(e.known_ms.astype("<u4").tobytes()).decode("ascii"),
        "never": int(NEVER),
        "ages": age_limits_ms(e.known_ms),
        "walls": np.round(e.walls(), 3).tolist(),
        "path": {name: packed_numbers(values) for name, values in rows.items()},
        "flown": [[b.time_s, np.round(b.corners, 2).tolist()] for b in e.flown],
        "corridors": [[b.time_s, np.round(b.corners, 2).tolist()] for b in e.corridors],
        "decisions": [[d.time_s, d.to, *np.round(_place(e, d), 2).tolist()] for d in e.decisions()],
        "violations": [
            [v.time_s, *np.round(where(e.time_s, e.position, v.time_s), 2).tolist()]
            for v in e.run.violation_list
            if v.time_s is not None
        ],
        "goals": np.round(e.tour.goals, 2).tolist() if e.tour else [],
        "next": [list(n) for n in e.tour.next_goal] if e.tour else [],
    }


def _player(e: Exploration) -> str:
    """The canvas, and what moves it."""
    end_s = float(e.time_s[-1])
    bar = mode_bar(e.time_s, e.in_control, end_s)
    paces = "".join(
        f'<option value="{k}"{" selected" if k == 5 else ""}>{k} &times;</option>'
        for k in (1, 2, 5, 10, 20)
    )
    return (
        '<div class="live"><canvas id="map" role="img" aria-describedby="reading" '
        'aria-label="The map at the time that is chosen below"></canvas><div class="player">'
        f'<div class="strip">{bar}</div><input id="when" type="range" min="0" max="{end_s}" '
        f'step="0.05" value="{end_s}" aria-label="time of the run in seconds">'
        '<p><button type="button" class="play" aria-label="play">▶</button>'
        f'<label>speed <select aria-label="speed">{paces}</select></label>'
        '<output id="reading" for="when"></output></p></div></div>'
    )


def page(e: Exploration, command: str) -> str:
    """The whole file as text; `command` made it."""
    rows = "".join(
        f'<tr><th scope="row">{escape(what)}</th><td><strong>{escape(text)}</strong></td></tr>'
        for what, text in quantities(e).items()
    )
    grounds = [assumed_of_map(), *_silence(e), *e.run.notes, *run_assumptions(e.run.system)]
    items = "".join(f"<li>{prose(text)}</li>" for text in grounds)
    own = [(HERE / name).read_text(encoding="utf-8") for name in ("player.js", "replay.js")]
    scripts = "".join([_of_reports("packed.js"), *own])
    main = (
        f"<style>{_style()}</style>"
        '<header class="top"><h1>Safe exploration: what was known when</h1>'
        f'<p class="subtitle">{escape(_shown(e))}</p></header>'
        f'<section class="explored"><div><div class="still">{still(e)}</div>{_player(e)}'
        '<noscript><p class="note">JavaScript replays the run; it is switched off. This is how it '
        f"ended.</p></noscript>{_legend(e)}</div>"
        f'<div><div class="strips">{strips(e)}</div>'
        '<p class="note">Blue ground: SC in control.</p>'
        f'<div class="scroll"><table class="comparison"><tbody>{rows}</tbody></table></div></div>'
        f'</section><section class="grounds"><h2>What this rests on</h2><ul>{items}</ul>'
        f'<p class="note">Made by <code>{escape(command)}</code>, soter '
        f"{escape(soter.__version__)}; program {escape(str(e.program.sha256)[:16])}.</p></section>"
        f'<script type="application/json" id="explored">{script_json(data(e))}</script>'
        f"<script>\n{scripts}</script>"
    )
    return document("Safe exploration: what was known when", main)
