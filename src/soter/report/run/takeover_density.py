"""How many takeovers there were in each part of the time, as bars.

Purpose: what is drawn where so many decisions would stand that their marks cover each other.
Non-goals: the table of decisions, which lists every one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.report.run.packed_json import numbers
from soter.report.run.signal_thinning import givebacks, takeovers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.report.run.record import Decision, Json

BINS = 120


def takeover_density(decisions: Sequence[Decision], axis: str, end_s: float) -> Json:
    """Bars of the takeovers from 0 to `end_s` seconds, on the y axis of the name `axis`."""
    edges = np.linspace(0.0, end_s, BINS + 1)
    over, back = (
        np.histogram(np.clip([d.time_s for d in chosen], 0.0, end_s), edges)[0].tolist()
        for chosen in (takeovers(decisions), givebacks(decisions))
    )
    parts = zip(edges[:-1], edges[1:], over, back, strict=True)
    return {
        "type": "bar",
        "x": numbers((edges[:-1] + edges[1:]) / 2, 4),
        "y": over,
        "width": round(float(edges[1]), 4),
        "yaxis": axis,
        "text": [
            f"{a:.4g} s to {b:.4g} s<br>the DM took over: {n}, gave back: {m}"
            for a, b, n, m in parts
        ],
        "textposition": "none",
        "hovertemplate": "%{text}<extra></extra>",
        "marker": {"color": "@takeover", "line": {"width": 0}},
    }


def density_title(decisions: Sequence[Decision], end_s: float, module: str = "") -> str:
    """The title of the bars."""
    whose = f" of {module}" if module else ""
    each = f"{end_s / BINS:.3g} s"
    return f"takeovers{whose} in each {each}, {len(takeovers(decisions)):,} in all"
