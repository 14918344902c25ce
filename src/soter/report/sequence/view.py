"""A replayed trace as plain data: who stepped when, what was chosen, what was published.

Purpose: the record that the sequence page, its log and its terminal table are made from.
Non-goals: running or judging anything; the caller replays the trace and fills the records.

Times are virtual, in nanoseconds. Values are texts, as the caller writes them for people.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

Role = Literal["plant", "dm", "ac", "sc", "node", "input"]
Mode = Literal["AC", "SC"]
Kind = Literal["start", "step", "lost", "overrun", "effect"]
"""What happens in a step: the start of the system (of no lane), a step of a lane, a release that
is lost, a step that starts and whose publications come later, these taking effect."""


NAMED = 12
"""Steps that matter are named where they are no more."""


@dataclass(frozen=True)
class Lane:
    """An actor. `name`: its full dotted name. `module`: the RTA module it belongs to, if any."""

    name: str
    role: Role
    module: str | None = None


@dataclass(frozen=True)
class TopicFlow:
    """A topic with the names of the lanes that write it and of those that read it."""

    name: str
    writers: tuple[str, ...] = ()
    readers: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModuleModes:
    """The modes of one module: `(number of a step, mode from then on)`, the first from the start.

    A change holds from the step that made it on, which is the step of that number.
    """

    module: str
    modes: tuple[tuple[int, Mode], ...]


@dataclass(frozen=True)
class Pick:
    """An alternative that was taken. `what`: the source's words for the choice."""

    what: str
    value: str
    default: bool = True


@dataclass(frozen=True)
class Published:
    """A topic got this value."""

    topic: str
    value: str


@dataclass(frozen=True)
class ModeSwitch:
    """The DM of `module` changed its mode."""

    module: str
    before: Mode
    after: Mode


@dataclass(frozen=True)
class SequenceStep:
    """One row. `lane` is empty for the start, which is of the whole system.

    `number`: rising along the trace. `release_ns` is None where there was none: the start, and
    publications that take effect; it is at most `time_ns`. `gated`: computed, but its outputs
    were not enabled, so `published` reached nobody. What an overrunning step publishes stands at
    the step where it takes effect; `lasts_ns` is the time from its start to there, at both of them,
    where it is known. `fault`: what went wrong in the step. `dropped`: what was lost as it
    published, a clause each.
    `observable`: time may pass after it, so properties are checked. `violates`: the property is
    violated here. `note`: one sentence for the reader, free. `matters`: whether the violation
    depends on it; of steps that do not, the view makes little.
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
    matters: bool = True


@dataclass(frozen=True)
class SequenceView:
    """A trace to look at. `property_text` and `verdict` may hold code in backquotes.

    `verdict`: one sentence; `remark`: another, whether the trace is the shortest. `lanes` stand in
    this order, `steps` in the order they happened.
    `program_sha256`, `seed` and `tool_version` say what was replayed and by what; `provenance`
    adds names and values of one's own, such as the command.
    """

    program: str
    system: str
    test: str
    property_text: str
    verdict: str
    lanes: tuple[Lane, ...]
    steps: tuple[SequenceStep, ...]
    topics: tuple[TopicFlow, ...] = ()
    modes: tuple[ModuleModes, ...] = ()
    assumptions: tuple[str, ...] = ()
    program_sha256: str = ""
    seed: int = 0
    tool_version: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)
    remark: str = ""


def violating(view: SequenceView) -> SequenceStep | None:
    """Return the first step that violates the property."""
    return next((step for step in view.steps if step.violates), None)


def matter_text(view: SequenceView) -> str:
    """Write how many steps matter, and which if they are few; empty where all do."""
    steps = [step for step in view.steps if step.kind != "start"]
    those = [str(step.number) for step in steps if step.matters]
    if not those or len(those) == len(steps):
        return ""
    named = f" ({', '.join(those)})" if len(those) <= NAMED else ""
    verb = "matters" if len(those) == 1 else "matter"
    return (
        f"{len(those):,} of {len(steps):,} steps {verb}{named}: "
        "whatever the others choose, it is violated all the same."
    )


def reached(step: SequenceStep) -> tuple[Published, ...]:
    """Return what a step published to others: nothing where its outputs were not enabled."""
    return () if step.gated or step.kind in ("lost", "overrun") else step.published


def late_ns(step: SequenceStep) -> int:
    """Return by how much a step is late in ns: its time after its release, else 0."""
    return 0 if step.release_ns is None else max(step.time_ns - step.release_ns, 0)


def duration_text(time_ns: int) -> str:
    """Write a time in its largest exact unit, so that no two times look alike: `1.5 ms`."""
    for unit, size in (("s", 10**9), ("ms", 10**6), ("µs", 10**3)):
        if abs(time_ns) >= size:
            return f"{_exact(time_ns, size)} {unit}"
    return f"{time_ns} ns" if time_ns else "0"


def _exact(time_ns: int, size: int) -> str:
    whole, rest = divmod(abs(time_ns), size)
    digits = f"{rest:0{len(str(size)) - 1}d}".rstrip("0")
    return f"{'-' if time_ns < 0 else ''}{whole}{'.' if digits else ''}{digits}"
