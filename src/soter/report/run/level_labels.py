"""Labels of the levels of a panel, placed where no curve runs.

Purpose: which levels a panel has, the range in which they and their labels have room, and for each
label the side of its level and the end of the panel that the curves leave free.
Non-goals: the levels' lines, the curves (`timeline.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.report.run.record import Json, Series

LABEL_SHARE = 0.2
"""Part of a panel's values that the label of a level needs beside it."""
LABEL_CHAR_PX, PHONE_PX = 6.3, 330
"""Width of a letter of a label, and of a panel on a phone, where a label takes most of it."""


def levels_of(series: Sequence[Series]) -> dict[float, str]:
    """The levels of a panel, each once, with everybody's label for it."""
    labels_by_value: dict[float, list[str]] = {}
    for each in series:
        for threshold in each.thresholds:
            labels = labels_by_value.setdefault(threshold.value, [])
            labels += [s for s in threshold.label.split(", ") if s not in labels]
    return {value: ", ".join(labels) for value, labels in labels_by_value.items()}


def levels_range(series: Sequence[Series]) -> tuple[float, float] | None:
    """Return an axis range in which levels and their labels have room; none without levels."""
    levels = [threshold.value for each in series for threshold in each.thresholds]
    if not levels:
        return None
    finite = [each.values[np.isfinite(each.values)] for each in series]
    values = np.concatenate([np.asarray(levels), *finite])
    least, greatest = float(values.min()), float(values.max())
    room = LABEL_SHARE * ((greatest - least) or 1.0)
    return least - room, greatest + room


@dataclass(frozen=True)
class Curves:
    """The curves of a panel of `end_s` seconds and of the range `span`: where they leave room."""

    time_s: NDArray[np.float64]
    series: Sequence[Series]
    end_s: float
    span: tuple[float, float]

    def crosses(self, window: tuple[float, float], low: float, high: float) -> bool:
        """Whether a curve has a value from `low` to `high` in a part (0..1) of the time."""
        first, last = np.searchsorted(self.time_s, np.array(window) * self.end_s)
        first, last = max(int(first) - 1, 0), int(last) + 1
        for each in self.series:
            part = each.values[first:last]
            part = part[np.isfinite(part)]
            if part.size and part.min() <= high and part.max() >= low:
                return True
        return False


def level_names(axis: str, levels: dict[float, str], curves: Curves) -> list[Json]:
    """The labels of a panel's levels, each where no curve runs, as far as there is such a place."""
    room = LABEL_SHARE * (curves.span[1] - curves.span[0]) / (1 + 2 * LABEL_SHARE)
    middle = sum(curves.span) / 2
    notes: list[Json] = []
    taken: list[tuple[float, float, str]] = []
    for value, label in sorted(levels.items()):
        width = min(len(label) * LABEL_CHAR_PX / PHONE_PX, 1.0)
        windows = {"right": (1 - width, 1.0), "left": (0.0, width)}
        windows["center"] = (0.5 - width / 2, 0.5 + width / 2)
        sides = ("bottom", "top") if value >= middle else ("top", "bottom")
        places = [
            (side, place, value if side == "bottom" else value - room)
            for side in sides
            for place in windows
        ]
        free = (
            (side, place, low)
            for side, place, low in places
            if curves.span[0] <= low
            and low + room <= curves.span[1]
            and not curves.crosses(windows[place], low, low + room)
            and not any(p == place and abs(low - at) < room for at, _, p in taken)
        )
        side, place, low = next(free, places[0])
        taken.append((low, low + room, place))
        notes.append(_level_name(axis, label, value, (side, place)))
    return notes


def _level_name(axis: str, label: str, value: float, place: tuple[str, str]) -> Json:
    """Return the label of a level: its edge (`bottom`: it stands above) and end."""
    side, end = place
    return {
        "text": escape(label),
        "xref": "paper",
        "yref": axis,
        "x": {"left": 0, "center": 0.5, "right": 1}[end],
        "y": value,
        "xanchor": end,
        "yanchor": side,
        "yshift": 2 if side == "bottom" else -2,
        "showarrow": False,
        "borderpad": 0,
        "bgcolor": "@look-fill",
        "font": {"size": 11, "color": "@takeover"},
    }
