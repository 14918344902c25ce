"""A replayed trace in words: the phrases of its steps, and a table for a terminal.

Purpose: page and terminal share the phrases, in which texts from outside are made harmless to look
at. The table has a line a step; the time stands where it changes, so instants are seen as groups.
Non-goals: HTML, the drawing (`drawing.py`), deciding whether colour is wanted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.report.printable_text import visible
from soter.report.sequence.view import duration_text, late_ns, matter_text, violating
from soter.report.terminal_tables import Styled, display_width, table

if TYPE_CHECKING:
    from soter.report.sequence.view import Pick, Published, SequenceStep, SequenceView
    from soter.report.terminal_tables import Tone


ARROW = "\N{RIGHTWARDS ARROW}"
KINDS = {
    "start": "start",
    "step": "",
    "lost": "release lost",
    "overrun": "overruns",
    "effect": "takes effect",
}
SAID = {
    "start": "at the start",
    "step": "after the step of {lane}",
    "lost": "when a release of {lane} is lost",
    "overrun": "when a step of {lane} starts that will overrun",
    "effect": "when the step of {lane} takes effect",
}


def clipped(text: str, width: int) -> str:
    """Return a text of at most `width` columns; what is left out shows as an ellipsis."""
    if display_width(text) <= width:
        return text
    kept, used = [], 0
    for char in text:
        used += display_width(char)
        if used > width - 1:
            break
        kept.append(char)
    return "".join(kept).rstrip() + "\N{HORIZONTAL ELLIPSIS}"


def published_text(value: Published) -> str:
    """Write one publication: `command = 1`."""
    return f"{visible(value.topic)} = {visible(value.value)}"


def pick_text(pick: Pick) -> str:
    """Write one choice: `choose { -1, 0, 1 }: 1`."""
    return f"{visible(pick.what)}: {visible(pick.value)}"


def late_text(step: SequenceStep) -> str:
    """Write the lateness of a step: `5 ms late`; empty where it is in time."""
    late = late_ns(step)
    return f"{duration_text(late)} late" if late else ""


def does(step: SequenceStep) -> list[str]:
    """Return what a step does beside publishing, a phrase each."""
    phrases = [_kind(step)]
    if step.switch is not None:
        change = f"{step.switch.before} {ARROW} {step.switch.after}"
        phrases.append(f"{visible(step.switch.module)}: {change}")
    phrases += [visible(text) for text in step.dropped]
    phrases += [pick_text(pick) for pick in step.choices]
    if step.fault is not None:
        phrases.append(f"fault in {visible(step.lane)}: {visible(step.fault)}")
    if step.gated:
        phrases.append("outputs not enabled")
    return [phrase for phrase in phrases if phrase]


def _kind(step: SequenceStep) -> str:
    """The kind, of a step that overruns with how long it took."""
    if step.lasts_ns is None:
        return KINDS[step.kind]
    if step.lasts_ns == 0:
        return "starts" if step.kind == "overrun" else f"{KINDS[step.kind]}, 0 ms later"
    if step.kind == "overrun":
        return f"starts, takes effect {duration_text(step.lasts_ns)} later"
    return f"{KINDS[step.kind]} {duration_text(step.lasts_ns)} after its start"


def explanation(view: SequenceView) -> str:
    """Say in one sentence where the property fails; empty where it does not."""
    step = violating(view)
    if step is None:
        return ""
    when = SAID[step.kind].format(lane=f"`{visible(step.lane)}`")
    late = late_text(step)
    sentence = f"The property fails in step {step.number}, at {duration_text(step.time_ns)}, {when}"
    sentence += f" ({late})" if late else ""
    if step.switch is not None:
        sentence += f", which switches from {step.switch.before} to {step.switch.after}"
    note = visible(step.note).strip().rstrip(".")
    return f"{sentence}: {note}." if note else f"{sentence}."


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
