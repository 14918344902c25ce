"""The program on the page of a run: its diagram, and who was in control of each module when.

Purpose: the SVG with a slider for the time; the page's script lights up AC or SC.
Non-goals: drawing the diagram (`soter.diagram`); values of topics, which the time lines show.
"""

from __future__ import annotations

import json
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.report.run.record import Chart, Picture

CHANGES_MAX = 2000
"""Changes of mode of a module that the page knows; later ones are not shown."""


def program_section(picture: Picture | None, charts: Sequence[Chart]) -> str:
    """The section, empty without a picture; without modes there is no slider."""
    if picture is None:
        return ""
    known = _modes(picture, charts[0]) if charts else []
    slider = ""
    if known:
        end = float(charts[0].time_s[-1])
        data = escape(json.dumps(known), quote=True)
        slider = (
            '<p class="moment"><label>who is in control at <output>0.00 s</output>'
            f'<input type="range" id="moment" min="0" max="{end:.6g}" step="any" value="0" '
            f'data-modes="{data}"></label></p>'
        )
    return (
        f'<section><h2>The program</h2>{slider}<div class="scroll program">{picture.svg}</div>'
        "</section>"
    )


def _modes(picture: Picture, chart: Chart) -> list[dict[str, object]]:
    """Of each module its controllers, and since when AC (1) or SC (0) is in control."""
    found: list[dict[str, object]] = []
    bands = {band.module: band.in_control for band in chart.modes}
    for module, ac, sc in picture.modules:
        if module not in bands:
            continue
        held = bands[module].astype(np.int8)
        starts = [0, *(np.flatnonzero(np.diff(held)) + 1).tolist()][:CHANGES_MAX]
        changes = [[round(float(chart.time_s[i]), 4), int(held[i])] for i in starts]
        found.append({"module": module, "ac": ac, "sc": sc, "changes": changes})
    return found
