"""The parts of a figure: signals prepared for drawing, and axes, markers and texts as plain JSON.

Purpose: keeps few points on the page, yet loses nothing a reader looks for: every change of mode,
every decision, every violation and every dip of the clearance stays. A bar shows who is in control;
labels of levels stand where no curve runs; where decisions are so many that their marks cover each
other, bars show how many takeovers there were. Colours are written as `@name`; the page's script
replaces them by the style sheet's `--name`, so one figure serves light, dark and paper. A trace may
belong to a `group` that the reader switches on and off, or to several, parted by spaces: it is
drawn while all of them are on.
Non-goals: filtering or smoothing: every point drawn is a point of the trace; the curves
(`timeline.py`); importing the drawing library: figures are tested, and built, without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from soter.report.templates import rounded_numbers
from soter.report.wording import prose

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.report.run.record import Decision, Figure, Flight, Json, Series, Vec3, Violation


AC_COLOUR, SC_COLOUR = "@ac", "@sc"


def decimals_drawn(values: NDArray[np.float64]) -> int:
    """How many decimals of (N,) values a drawing needs to show a 10,000th of their span."""
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if finite.size else 0.0
    span = span or (float(np.abs(finite).max()) if finite.size else 0.0)
    return 5 if span <= 0.0 else int(np.clip(4 - np.floor(np.log10(span)), 0, 12))


def group_of_arm(name: str) -> str:
    """The name of the group that holds all traces of one arm, without blanks."""
    return "arm:" + "_".join(name.split())


def figure_place(figure: Figure, kind: str) -> str:
    """The HTML element into which a figure will be drawn."""
    height = figure.layout.get("height")
    style = f' style="height:{height}px"' if height else ""
    return (
        f'<div class="plot {kind}" id="figure-{escape(figure.key)}" role="img" '
        f'aria-label="{escape(figure.label)}"{style}></div>'
    )


def legend(entries: Iterable[tuple[str, str]]) -> str:
    """A legend as HTML; each entry is a sign and its meaning."""
    items = "".join(f"<li>{sign}<span>{text}</span></li>" for sign, text in entries)
    return f'<ul class="key">{items}</ul>'


def line_style(colour: str, width: float = 2.0, dash: str = "solid") -> Json:
    """The style of a line, for the drawing library."""
    return {"color": colour, "width": width, "dash": dash}


def dot_size(count: int, size: float) -> float:
    """The size of dots, which gets smaller with their count, so that few cover each other."""
    return size if count <= 24 else max(size * 0.7, 4.0) if count <= 80 else size * 0.45


def takeover_dot(size: float = 10.0) -> Json:
    """The marker for a takeover by the DM (AC to SC), a filled red dot."""
    line = {"color": "@paper", "width": 1.5}
    return {"symbol": "circle", "size": size, "color": "@takeover", "line": line}


def giveback_dot(size: float = 10.0) -> Json:
    """The marker for a return to AC (SC to AC), a green ring."""
    line = {"color": "@giveback", "width": 2.75}
    return {"symbol": "circle", "size": size - 1.5, "color": "@paper", "line": line}


def violation_cross(size: float = 11.0) -> Json:
    """The marker for a violation: a cross."""
    return {
        "symbol": "x-thin",
        "size": size,
        "color": "@violation",
        "line": {"color": "@violation", "width": 3},
    }


def axis_style(title: str = "", **more: object) -> Json:
    """The style of a quiet axis: thin grid, ticks outside, no zero line."""
    return {
        "title": {"text": title, "font": {"size": 12}, "standoff": 8},
        "gridcolor": "@grid",
        "linecolor": "@rule",
        "tickcolor": "@rule",
        "zeroline": False,
        "ticks": "outside",
        "ticklen": 4,
        "tickfont": {"size": 11},
        "automargin": True,
        **more,
    }


def shared_layout(**more: object) -> Json:
    """The layout that all figures share: no background, the page's font, hover boxes."""
    return {
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "@font", "color": "@muted", "size": 12},
        "showlegend": False,
        "autosize": True,
        "hovermode": "closest",
        "hoverlabel": {
            "bgcolor": "@panel",
            "bordercolor": "@rule",
            "font": {"family": "@font", "color": "@ink", "size": 12},
            "align": "left",
        },
        "margin": {"l": 52, "r": 16, "t": 8, "b": 40},
        "modebar": {
            "bgcolor": "rgba(0,0,0,0)",
            "color": "@muted",
            "activecolor": "@ink",
            "orientation": "h",
        },
        "uirevision": "keep",
        **more,
    }


def predicate_text(value: bool | float) -> str:
    """The value of a predicate as text."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    return f"{float(value):.4g}"


def predicates_text(predicates: Mapping[str, bool | float]) -> list[str]:
    """The text `name = value` for each predicate."""
    return [f"{name} = {predicate_text(value)}" for name, value in predicates.items()]


def change_text(decision: Decision) -> str:
    """A change of mode as text with an arrow."""
    return "AC → SC" if decision.to == "SC" else "SC → AC"


def decision_hover(decision: Decision) -> str:
    """The hover text of a decision: when, in which direction, why, by which predicates."""
    verb = "DM took over" if decision.to == "SC" else "DM gave back"
    lines = [
        f"<b>{verb}, {change_text(decision)}</b>",
        escape(f"t = {decision.time_s:.2f} s · {decision.module}"),
    ]
    if decision.reason:
        lines.append(_hover_text(decision.reason))
    lines += [escape(text) for text in decision.why]
    lines += [escape(text) for text in predicates_text(decision.predicates)]
    return "<br>".join(lines)


def _hover_text(text: str) -> str:
    """A text as HTML without code marks, because hover boxes support only few tags."""
    return prose(text.replace("`", ""))


def violation_hover(violation: Violation) -> str:
    """The hover text of a violation."""
    return f"<b>Violation</b><br>t = {violation.time_s:.2f} s<br>{_hover_text(violation.text)}"


DENSE_STEPS = 300
"""More steps of a signal than that touch each other in a drawing."""
POINTS_MAX = 2500
"""Points of one trajectory on the page; four screens' worth of pixels."""


def mode_stretches(in_control: NDArray[np.bool_]) -> list[tuple[int, int, bool]]:
    """The stretches `(first, last, is_ac)` of equal mode in (N,) modes.

    A mode holds until the next sample, so `last` is the first sample of the next stretch (N-1 for
    the last one): lines drawn from `first` to `last` inclusive join without gaps.
    """
    changes = np.flatnonzero(np.diff(in_control.astype(np.int8))) + 1
    firsts = [0, *changes.tolist()]
    lasts = [*changes.tolist(), len(in_control) - 1]
    return [
        (first, last, bool(in_control[first])) for first, last in zip(firsts, lasts, strict=True)
    ]


def is_dense(series: Series) -> bool:
    """Whether a series has so many steps that they would fill its panel."""
    return series.held and int(np.count_nonzero(np.diff(series.values))) > DENSE_STEPS


def unit_of(series: Series, others: Iterable[Series]) -> str:
    """The unit of a series; if the series has none, the unit of another series on its panel."""
    sharing = [x for x in others if (x.panel or x.name) == (series.panel or series.name)]
    return next((x.unit for x in (series, *sharing) if x.unit), "")


def rows_flown_by(
    rows: NDArray[np.float64], in_control: NDArray[np.bool_], *, ac: bool
) -> NDArray[np.float64]:
    """The rows (N, k) in which AC (or SC) was in control, with a NaN row between stretches."""
    gap = np.full((1, rows.shape[1]), np.nan)
    parts: list[NDArray[np.float64]] = []
    for first, last, is_ac in mode_stretches(in_control):
        if is_ac is ac and last > first:
            parts += [rows[first : last + 1], gap]
    return np.concatenate(parts[:-1]) if parts else np.empty((0, rows.shape[1]))


def thinned_indices(
    count: int,
    keep: Iterable[int],
    dips: NDArray[np.float64] | None = None,
    points_max: int = POINTS_MAX,
) -> NDArray[np.intp]:
    """Sorted indices (M,) of the samples to draw: at most `points_max` of `count`.

    Both ends and every index in `keep` are chosen, even beyond `points_max`. Half of the remaining
    points are evenly spaced; the other half marks the least value of `dips` (N,) in each stretch of
    equal length, so that no close approach disappears between two points.
    """
    chosen = {0, count - 1, *(index for index in keep if 0 <= index < count)}
    if count <= points_max:
        return np.arange(count)
    budget = max(points_max - len(chosen), 0)
    if dips is None:
        even = np.linspace(0, count - 1, budget).round().astype(np.intp)
        return np.union1d(np.fromiter(chosen, dtype=np.intp), even)
    even = np.linspace(0, count - 1, budget // 2).round().astype(np.intp)
    values = np.where(np.isnan(dips), np.inf, dips)
    bins = np.linspace(0, count, budget // 2 + 1).astype(np.intp)
    lows = [
        first + int(np.argmin(values[first:last]))
        for first, last in zip(bins[:-1].tolist(), bins[1:].tolist(), strict=True)
        if last > first
    ]
    indices = np.union1d(even, np.asarray(lows, dtype=np.intp))
    return np.union1d(np.fromiter(chosen, dtype=np.intp), indices)


def mode_edges(in_control: NDArray[np.bool_]) -> list[int]:
    """The indices before and after every change of mode in (N,) samples."""
    changes = np.flatnonzero(np.diff(in_control.astype(np.int8)))
    return [*changes.tolist(), *(changes + 1).tolist()]


def nearest_indices(time_s: NDArray[np.float64], at_s: Iterable[float]) -> list[int]:
    """For each time in s, the index of the last sample (N,) not after it, or 0."""
    indices = np.searchsorted(time_s, np.asarray(list(at_s), dtype=np.float64), side="right") - 1
    return [int(index) for index in np.clip(indices, 0, len(time_s) - 1)]


def lowest_index(values: NDArray[np.float64]) -> int | None:
    """The index of the least finite value in (N,); None if none is finite."""
    known = np.where(np.isfinite(values), values, np.inf)
    index = int(np.argmin(known))
    return index if np.isfinite(known[index]) else None


def flight_indices(flight: Flight, points_max: int = POINTS_MAX) -> NDArray[np.intp]:
    """Sorted indices (M,) of the samples of a flight that the figures draw."""
    events = [decision.time_s for decision in flight.decisions]
    events += [violation.time_s for violation in flight.violations]
    keep = mode_edges(flight.in_control) + nearest_indices(flight.time_s, events)
    return thinned_indices(len(flight.time_s), keep, flight.clearance_m, points_max)


def event_place(flight: Flight, time_s: float, position: Vec3 | None) -> Vec3:
    """The position of an event in m: `position`, or if None the flight's position at `time_s`."""
    if position is not None:
        return position
    x, y, z = flight.position[nearest_indices(flight.time_s, [time_s])[0]].tolist()
    return (x, y, z)


def takeovers(decisions: Iterable[Decision]) -> list[Decision]:
    """The decisions from AC to SC, which the paper draws as red dots."""
    return [decision for decision in decisions if decision.to == "SC"]


def givebacks(decisions: Iterable[Decision]) -> list[Decision]:
    """The decisions from SC to AC, which the paper draws as green dots."""
    return [decision for decision in decisions if decision.to == "AC"]


BAR_WIDTH = 1000


def mode_bar(time_s: NDArray[np.float64], in_control: NDArray[np.bool_], end_s: float) -> str:
    """Return an SVG bar, `end_s` seconds wide, of who is in control; times and modes are (N,)."""
    scale = BAR_WIDTH / end_s if end_s > 0 else 0.0
    view = f'viewBox="0 0 {BAR_WIDTH} 10" preserveAspectRatio="none"'
    parts = [f'<svg class="bar" {view} role="img" aria-label="who is in control over time">']
    for first, last, is_ac in mode_stretches(in_control):
        left = (time_s[first] - time_s[0]) * scale
        width = (time_s[last] - time_s[first]) * scale
        controller = "ac" if is_ac else "sc"
        parts.append(
            f'<rect class="{controller}" x="{left:.1f}" y="0" width="{width:.1f}" height="10"/>'
        )
    return "".join([*parts, "</svg>"])


LABEL_SHARE = 0.2
"""Part of a panel's values that the label of a level needs beside it."""
LABEL_CHAR_PX, PHONE_PX = 6.3, 330
"""Width of a letter of a label, and of a panel on a phone, where a label takes most of it."""


def labels_by_level(series: Sequence[Series]) -> dict[float, str]:
    """Maps each level of a panel to the labels of all series with that level, joined by commas."""
    labels_by_value: dict[float, list[str]] = {}
    for each in series:
        for threshold in each.thresholds:
            labels = labels_by_value.setdefault(threshold.value, [])
            labels += [s for s in threshold.label.split(", ") if s not in labels]
    return {value: ", ".join(labels) for value, labels in labels_by_value.items()}


def levels_range(series: Sequence[Series]) -> tuple[float, float] | None:
    """The range of an axis that has room for levels and labels; None without levels."""
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
    """The curves of a panel, which labels must avoid; the panel is `end_s` s wide, `span` high."""

    time_s: NDArray[np.float64]
    series: Sequence[Series]
    end_s: float
    span: tuple[float, float]

    def crosses(self, window: tuple[float, float], low: float, high: float) -> bool:
        """Whether a curve has a value from `low` to `high` in this part (0 to 1) of the time."""
        first, last = np.searchsorted(self.time_s, np.array(window) * self.end_s)
        first, last = max(int(first) - 1, 0), int(last) + 1
        for each in self.series:
            part = each.values[first:last]
            part = part[np.isfinite(part)]
            if part.size and part.min() <= high and part.max() >= low:
                return True
        return False


def level_labels(axis: str, levels: dict[float, str], curves: Curves) -> list[Json]:
    """The labels of a panel's levels; each is placed away from the curves if there is space."""
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
        notes.append(_level_label(axis, label, value, (side, place)))
    return notes


def _level_label(axis: str, label: str, value: float, place: tuple[str, str]) -> Json:
    """The label of a level at `place`: the side of its line and the end of the line."""
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


BINS = 120


def takeover_density(decisions: Sequence[Decision], axis: str, end_s: float) -> Json:
    """Bars on the y axis `axis` that count takeovers between 0 and `end_s` seconds."""
    edges = np.linspace(0.0, end_s, BINS + 1)
    over, back = (
        np.histogram(np.clip([d.time_s for d in chosen], 0.0, end_s), edges)[0].tolist()
        for chosen in (takeovers(decisions), givebacks(decisions))
    )
    return {
        "type": "bar",
        "x": rounded_numbers((edges[:-1] + edges[1:]) / 2, 4),
        "y": over,
        "width": round(float(edges[1]), 4),
        "yaxis": axis,
        "text": [
            f"{a:.4g} s to {b:.4g} s<br>the DM took over: {n}, gave back: {m}"
            for a, b, n, m in zip(edges[:-1], edges[1:], over, back, strict=True)
        ],
        "textposition": "none",
        "hovertemplate": "%{text}<extra></extra>",
        "marker": {"color": "@takeover", "line": {"width": 0}},
    }


def density_title(decisions: Sequence[Decision], end_s: float, module: str = "") -> str:
    """The title above the bars of `takeover_density`."""
    whose = f" of {module}" if module else ""
    each = f"{end_s / BINS:.3g} s"
    return f"takeovers{whose} in each {each}, {len(takeovers(decisions)):,} in all"


def violations_title(violations: Sequence[Violation]) -> str:
    """The title above the row of violations, which shows the first violation of each property."""
    again = any(violation.times > 1 for violation in violations)
    return "violations, the first of each property" if again else "violations"
