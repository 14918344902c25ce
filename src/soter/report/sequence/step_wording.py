"""Say the steps of a trace in words.

Purpose: the phrases that page and terminal share; texts from outside made harmless to look at.
Non-goals: HTML, colours, drawing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.report.printable_text import visible
from soter.report.sequence.view import duration_text, late_ns, violating
from soter.report.terminal_tables import display_width

if TYPE_CHECKING:
    from soter.report.sequence.view import Pick, Published, SequenceStep, SequenceView

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
