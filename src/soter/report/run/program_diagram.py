"""The program on a page: its diagram, and a player that replays the run on it.

Purpose: strips of who was in control, the slider with its buttons, and the SVG, whose boxes the
page's script fills with values and lights up.
Non-goals: drawing the diagram (`soter.diagram`), what is shown of a run (`live_diagram.py`).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.report.run.led_picture import led_section
from soter.report.run.live_diagram import live_json
from soter.report.run.mode_bar import mode_bar
from soter.report.run.packed_json import script_json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.report.run.live_diagram import Control
    from soter.report.run.record import Picture

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
