"""A replayed trace as plain data, and in words: who stepped when, what was chosen and published.

Purpose: `SequenceView` is the record that the log of a trace and its tables, in a terminal and on a
page, are made from; they share the phrases, in which texts from outside are made harmless.
`table_text` has a line a step; the time stands where it changes, so instants are seen as groups.
Non-goals: running or judging anything: the caller replays the trace and fills the records; HTML;
deciding whether colour is wanted.

Times are virtual, in nanoseconds. Values are texts, as the caller writes them for people.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from soter.report.tables import Styled, Tone, display_width, table
from soter.report.wording import visible

if TYPE_CHECKING:
    from collections.abc import Mapping


Role = Literal["plant", "dm", "ac", "sc", "node", "input"]
Mode = Literal["AC", "SC"]
Kind = Literal["start", "step", "lost", "overrun", "effect"]
"""What happens in a step: the start of the system (in no lane); a step of a lane; a release that
is lost; a step that overruns, so that its publications come later; these publications."""


@dataclass(frozen=True)
class Lane:
    """An actor of the trace; `name` is its full dotted name, `module` its RTA module or None."""

    name: str
    role: Role
    module: str | None = None


@dataclass(frozen=True)
class ModuleModes:
    """All modes of a module from the start on, each with the number of the step that set it."""

    module: str
    modes: tuple[tuple[int, Mode], ...]


@dataclass(frozen=True)
class Pick:
    """An alternative that was chosen; `what` is the choice as the source writes it."""

    what: str
    value: str
    default: bool = True


@dataclass(frozen=True)
class Published:
    """Records that a topic got this value."""

    topic: str
    value: str


@dataclass(frozen=True)
class ModeSwitch:
    """Records that the DM of `module` changed the mode."""

    module: str
    before: Mode
    after: Mode


@dataclass(frozen=True)
class SequenceStep:
    """One row of the view. `lane` is empty for the start, which belongs to the system as a whole.

    `number` rises along the trace. `release_ns` is at most `time_ns`; it is None for the start and
    for publications that take effect. `gated`: the step ran, but its outputs were disabled, so
    `published` reached nobody. The output of an overrunning step stands at the later step at which
    it takes effect; at both, `lasts_ns` is the time between them, if known. `fault`: the error in
    the step. `dropped`: a clause for each message that was lost. `observable`: time may pass after
    the step, so properties are checked. `violates`: the property is violated here. `note`: a
    sentence for the reader.
    """

    number: int
    time_ns: int
    lane: str = ""
    kind: Kind = "step"
    release_ns: int | None = None
    choices: tuple[Pick, ...] = ()
    published: tuple[Published, ...] = ()
    gated: bool = False
    switch: ModeSwitch | None = None
    fault: str | None = None
    dropped: tuple[str, ...] = ()
    lasts_ns: int | None = None
    observable: bool = False
    violates: bool = False
    note: str = ""


@dataclass(frozen=True)
class SequenceView:
    """A trace to look at. `property_text` and `verdict` may hold code in backquotes.

    `verdict`: one sentence; `remark`: another, whether the trace is the shortest. `steps` stand in
    the order they happened; `topics`: their names. `program_sha256`, `seed` and `tool_version` say
    what was replayed and by what; `provenance` adds names and values of one's own, such as the
    command.
    """

    program: str
    system: str
    test: str
    property_text: str
    verdict: str
    lanes: tuple[Lane, ...]
    steps: tuple[SequenceStep, ...]
    topics: tuple[str, ...] = ()
    modes: tuple[ModuleModes, ...] = ()
    assumptions: tuple[str, ...] = ()
    program_sha256: str = ""
    seed: int = 0
    tool_version: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    remark: str = ""


def first_violation(view: SequenceView) -> SequenceStep | None:
    """The first step that violates the property; None if no step does."""
    return next((step for step in view.steps if step.violates), None)


def reaching_values(step: SequenceStep) -> tuple[Published, ...]:
    """The values of a step that reached other actors; () if its outputs were disabled."""
    return () if step.gated or step.kind in ("lost", "overrun") else step.published


def late_ns(step: SequenceStep) -> int:
    """By how many ns a step is later than its release; 0 if it has no release time."""
    return 0 if step.release_ns is None else max(step.time_ns - step.release_ns, 0)


def duration_text(time_ns: int) -> str:
    """A time in its largest exact unit, so that different times look different: `1.5 ms`."""
    for unit, size in (("s", 10**9), ("ms", 10**6), ("µs", 10**3)):
        if abs(time_ns) >= size:
            return f"{_exact_decimal(time_ns, size)} {unit}"
    return f"{time_ns} ns" if time_ns else "0"


def _exact_decimal(time_ns: int, size: int) -> str:
    whole, rest = divmod(abs(time_ns), size)
    digits = f"{rest:0{len(str(size)) - 1}d}".rstrip("0")
    return f"{'-' if time_ns < 0 else ''}{whole}{'.' if digits else ''}{digits}"


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


def clipped_to_width(text: str, width: int) -> str:
    """A text of at most `width` columns; an ellipsis replaces the rest."""
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
    """A published value as text: `command = 1`."""
    return f"{visible(value.topic)} = {visible(value.value)}"


def pick_text(pick: Pick) -> str:
    """A choice as text: `choose { -1, 0, 1 }: 1`."""
    return f"{visible(pick.what)}: {visible(pick.value)}"


def late_text(step: SequenceStep) -> str:
    """The lateness of a step as text: `5 ms late`; "" if it is in time."""
    late = late_ns(step)
    return f"{duration_text(late)} late" if late else ""


def action_phrases(step: SequenceStep) -> list[str]:
    """Phrases for everything that a step does except publishing."""
    phrases = [_kind_text(step)]
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


def _kind_text(step: SequenceStep) -> str:
    """The kind of a step as text; with its duration if the step overruns."""
    if step.lasts_ns is None:
        return KINDS[step.kind]
    if step.lasts_ns == 0:
        return "starts" if step.kind == "overrun" else f"{KINDS[step.kind]}, 0 ms later"
    if step.kind == "overrun":
        return f"starts, takes effect {duration_text(step.lasts_ns)} later"
    return f"{KINDS[step.kind]} {duration_text(step.lasts_ns)} after its start"


def explanation(view: SequenceView) -> str:
    """A sentence on where the property fails; "" if it does not fail."""
    step = first_violation(view)
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
"""The mark of a step that the violation depends on, where others do not."""
HEADERS = ("step", "time", "actor", "does", "publishes", "")
CELL_MAX = 64
"""Columns of a terminal that one cell takes at most; the page and the log show it whole."""


def table_text(
    view: SequenceView,
    *,
    color: bool = False,
    cell_max: int = CELL_MAX,
    most: int = 0,
    width: int | None = None,
) -> list[str]:
    """The lines to print: a table with a row for each step, then why the property fails.

    If there are more than `most` steps (0: no limit), it shows only the first and the last of them.
    `width`: columns of the terminal, if known.
    """
    made = table_rows(view, cell_max=cell_max)
    left_out = len(made) - most if 0 < most < len(made) else 0
    if left_out:
        first = most // 4
        gap = Styled(f"... {left_out:,} steps left out", "muted")
        made[first : first + left_out] = [[_NOTHING, _NOTHING, _NOTHING, gap, _NOTHING, _NOTHING]]
    lines = table(HEADERS, made, color=color, width=width).splitlines()
    text = explanation(view)
    return [*lines, "", text] if text else lines


def table_rows(view: SequenceView, *, cell_max: int = CELL_MAX) -> list[list[Styled]]:
    """The table cells of each step, in the order of `HEADERS`, cut to `cell_max` columns."""
    made: list[list[Styled]] = []
    time_ns: int | None = None
    for step in view.steps:
        made.append(_step_row(step, cell_max, same_time=step.time_ns == time_ns))
        time_ns = step.time_ns
    return made


def _step_row(step: SequenceStep, cell_max: int, *, same_time: bool) -> list[Styled]:
    tone: Tone = "bad" if step.violates else "muted" if step.kind == "lost" else "plain"
    return [
        Styled(str(step.number), "muted"),
        Styled("" if same_time else duration_text(step.time_ns), "plain"),
        Styled(clipped_to_width(visible(step.lane), cell_max), tone),
        Styled(
            clipped_to_width(
                ", ".join(filter(None, (late_text(step), *action_phrases(step)))), cell_max
            ),
            _action_tone(step),
        ),
        Styled(
            clipped_to_width(", ".join(map(published_text, step.published)), cell_max),
            "muted" if step.gated else "plain",
        ),
        Styled("✕ violated", "bad") if step.violates else Styled("", "plain"),
    ]


def _action_tone(step: SequenceStep) -> Tone:
    if step.fault is not None:
        return "bad"
    if step.switch is not None:
        return "strong" if step.switch.after == "SC" else "good"
    if any(not pick.default for pick in step.choices):
        return "strong"
    return "muted" if step.kind == "lost" else "plain"
