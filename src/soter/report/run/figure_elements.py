"""A figure as plain JSON for the drawing library, with named colours.

Purpose: what every figure of the report shares: axes, markers, hover texts, colour names.
Colours are written as `@name`; the page's script replaces them by the style sheet's
`--name`, so one figure serves light, dark and paper. A trace may belong to a `group` that the
reader switches on and off, or to several, parted by spaces: it is drawn while all of them are on.
Non-goals: importing the drawing library. Figures are tested, and built, without it.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from soter.report.run.result_wording import prose

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.report.run.record import Decision, Figure, Json, Violation

AC_COLOUR, SC_COLOUR = "@ac", "@sc"


def signals_drawn(figures: Sequence[Figure]) -> dict[str, tuple[int, int]]:
    """Signal -> (figure, trace) of the first time line that draws it: its trace has the name."""
    trace_by_signal: dict[str, tuple[int, int]] = {}
    for i, figure in enumerate(figures):
        for k, trace in enumerate(figure.data):
            if "name" in trace:
                trace_by_signal.setdefault(str(trace["name"]), (i, k))
    return trace_by_signal


def digits_of(values: NDArray[np.float64]) -> int:
    """How many digits behind the point a drawing of (N,) values needs: a 10,000th of its span."""
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if finite.size else 0.0
    span = span or (float(np.abs(finite).max()) if finite.size else 0.0)
    return 5 if span <= 0.0 else int(np.clip(4 - np.floor(np.log10(span)), 0, 12))


def arm_group(name: str) -> str:
    """Return the group of one arm's traces, a word."""
    return "arm:" + "_".join(name.split())


def figure_place(figure: Figure, kind: str) -> str:
    """Return the place in the page, as HTML, that a figure is drawn into."""
    height = figure.layout.get("height")
    style = f' style="height:{height}px"' if height else ""
    return (
        f'<div class="plot {kind}" id="figure-{escape(figure.key)}" role="img" '
        f'aria-label="{escape(figure.label)}"{style}></div>'
    )


def legend(entries: Iterable[tuple[str, str]]) -> str:
    """Return a legend in the page's text: each entry a sign and what it means, as HTML."""
    items = "".join(f"<li>{sign}<span>{text}</span></li>" for sign, text in entries)
    return f'<ul class="key">{items}</ul>'


def line(colour: str, width: float = 2.0, dash: str = "solid") -> Json:
    """Return the style of a line."""
    return {"color": colour, "width": width, "dash": dash}


def dot(colour: str, *, filled: bool, size: float = 10.0) -> Json:
    """Return the style of a decision's dot: filled where SC takes over, a ring where AC returns.

    Shape says what colour says, for readers who do not tell red from green.
    """
    if filled:
        return {
            "symbol": "circle",
            "size": size,
            "color": colour,
            "line": {"color": "@paper", "width": 1.5},
        }
    return {
        "symbol": "circle",
        "size": size - 1.5,
        "color": "@paper",
        "line": {"color": colour, "width": 2.75},
    }


def crowded(count: int, size: float) -> float:
    """Return a smaller size for dots that would cover each other."""
    return size if count <= 24 else max(size * 0.7, 4.0) if count <= 80 else size * 0.45


def takeover_dot(size: float = 10.0) -> Json:
    """Return the red dot: the DM took over, AC→SC."""
    return dot("@takeover", filled=True, size=size)


def giveback_dot(size: float = 10.0) -> Json:
    """Return the green dot: the DM gave back, SC→AC."""
    return dot("@giveback", filled=False, size=size)


def violation_cross(size: float = 11.0) -> Json:
    """Return the cross of a violation."""
    return {
        "symbol": "x-thin",
        "size": size,
        "color": "@violation",
        "line": {"color": "@violation", "width": 3},
    }


def axis(title: str = "", **more: object) -> Json:
    """Return a quiet axis: thin grid, outside ticks, no zero line."""
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


def layout(**more: object) -> Json:
    """Return what all figures share: transparent ground, the page's font and hover boxes."""
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
    """Write a predicate's value as people read it."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    return f"{float(value):.4g}"


def predicates_text(predicates: Mapping[str, bool | float]) -> list[str]:
    """Write each predicate as `name = value`."""
    return [f"{name} = {predicate_text(value)}" for name, value in predicates.items()]


def change_text(decision: Decision) -> str:
    """Write a change of mode as an arrow."""
    return "AC → SC" if decision.to == "SC" else "SC → AC"


def decision_hover(decision: Decision) -> str:
    """Return the hover text of a decision: when, which way, why, on which predicates."""
    verb = "DM took over" if decision.to == "SC" else "DM gave back"
    lines = [
        f"<b>{verb}, {change_text(decision)}</b>",
        escape(f"t = {decision.time_s:.2f} s · {decision.module}"),
    ]
    if decision.reason:
        lines.append(_hover(decision.reason))
    lines += [escape(text) for text in decision.why]
    lines += [escape(text) for text in predicates_text(decision.predicates)]
    return "<br>".join(lines)


def _hover(text: str) -> str:
    """Without code: a figure knows few tags."""
    return prose(text.replace("`", ""))


def violation_hover(violation: Violation) -> str:
    """Return the hover text of a violation."""
    return f"<b>Violation</b><br>t = {violation.time_s:.2f} s<br>{_hover(violation.text)}"
