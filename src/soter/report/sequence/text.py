"""A replayed trace as a table for a terminal.

Purpose: a line a step; the time stands where it changes, so instants are seen as groups.
Non-goals: deciding whether colour is wanted; the drawing (`sequence_page`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.report.printable_text import visible
from soter.report.sequence.step_wording import (
    clipped,
    does,
    explanation,
    late_text,
    published_text,
)
from soter.report.sequence.view import duration_text, matter_text
from soter.report.terminal_tables import Styled, table

if TYPE_CHECKING:
    from soter.report.sequence.view import SequenceStep, SequenceView
    from soter.report.terminal_tables import Tone

_NOTHING = Styled("", "plain")
MATTERS = "•"
"""Stands beside a step that the violation depends on, where there are others."""
HEADERS = ("step", "time", "actor", "does", "publishes", "")
CELL_MAX = 64
"""Columns of a terminal that one cell takes at most; the page and the log show all of it."""


def text(
    view: SequenceView,
    *,
    color: bool = False,
    cell_max: int = CELL_MAX,
    most: int = 0,
    width: int | None = None,
) -> list[str]:
    """Return the lines to print: a table with a row a step, then why the property fails.

    Of more than `most` steps (0: any number) the first and the last ones. `width`: columns of the
    terminal, where they are known.
    """
    made = rows(view, cell_max=cell_max)
    left_out = len(made) - most if 0 < most < len(made) else 0
    if left_out:
        first = most // 4
        gap = Styled(f"... {left_out:,} steps left out", "muted")
        made[first : first + left_out] = [[_NOTHING, _NOTHING, _NOTHING, gap, _NOTHING, _NOTHING]]
    lines = table(HEADERS, made, color=color, width=width).splitlines()
    matter = matter_text(view).replace(" matter:", f" matter ({MATTERS}):")
    said = [line for line in (explanation(view), matter) if line]
    return [*lines, "", *said] if said else lines


def rows(view: SequenceView, *, cell_max: int = CELL_MAX) -> list[list[Styled]]:
    """Return the cells of each step under `HEADERS`, clipped to `cell_max` columns."""
    made: list[list[Styled]] = []
    time_ns: int | None = None
    sliced = any(not step.matters for step in view.steps)
    for step in view.steps:
        row = _row(step, cell_max, same_time=step.time_ns == time_ns)
        if sliced and step.matters and not step.violates and step.kind != "start":
            row[-1] = Styled(MATTERS, "plain")
        made.append(row if step.matters else [Styled(cell.text, "muted") for cell in row])
        time_ns = step.time_ns
    return made


def _row(step: SequenceStep, cell_max: int, *, same_time: bool) -> list[Styled]:
    tone = _tone(step)
    return [
        Styled(str(step.number), "muted"),
        Styled("" if same_time else duration_text(step.time_ns), "plain"),
        Styled(clipped(visible(step.lane), cell_max), tone),
        Styled(clipped(", ".join([*_late(step), *does(step)]), cell_max), _tone_of_deed(step)),
        Styled(
            clipped(", ".join(map(published_text, step.published)), cell_max),
            "muted" if step.gated else "plain",
        ),
        Styled("✕ violated", "bad") if step.violates else Styled("", "plain"),
    ]


def _late(step: SequenceStep) -> list[str]:
    late = late_text(step)
    return [late] if late else []


def _tone(step: SequenceStep) -> Tone:
    return "bad" if step.violates else "muted" if step.kind == "lost" else "plain"


def _tone_of_deed(step: SequenceStep) -> Tone:
    if step.fault is not None:
        return "bad"
    if step.switch is not None:
        return "strong" if step.switch.after == "SC" else "good"
    if any(not pick.default for pick in step.choices):
        return "strong"
    return "muted" if step.kind == "lost" else "plain"
