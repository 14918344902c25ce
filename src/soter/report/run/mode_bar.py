"""A bar of who is in control over time.

Purpose: the arms side by side at a glance, in the text of the page, sharp on paper.
Non-goals: pointing at decisions (`timeline.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.report.run.signal_thinning import runs

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

BAR_WIDTH = 1000


def mode_bar(time_s: NDArray[np.float64], in_control: NDArray[np.bool_], end_s: float) -> str:
    """Return an SVG bar of who is in control; its full width is `end_s` seconds.

    Times and modes are (N,).
    """
    scale = BAR_WIDTH / end_s if end_s > 0 else 0.0
    view = f'viewBox="0 0 {BAR_WIDTH} 10" preserveAspectRatio="none"'
    parts = [f'<svg class="bar" {view} role="img" aria-label="who is in control over time">']
    for first, last, is_ac in runs(in_control):
        left = (time_s[first] - time_s[0]) * scale
        width = (time_s[last] - time_s[first]) * scale
        controller = "ac" if is_ac else "sc"
        parts.append(
            f'<rect class="{controller}" x="{left:.1f}" y="0" width="{width:.1f}" height="10"/>'
        )
    return "".join([*parts, "</svg>"])
