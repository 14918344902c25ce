"""A replayed trace as the sequence view that the log and the tables show.

Purpose: `make_sequence_view` puts lanes, topics, modes and every step into the words and records of
`report/sequence_view.py`.
Non-goals: the page (`trace_page.py`); running anything (`replay.py`).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Literal, cast

from soter.explore.trace import BEGIN, EFFECT, START, ChoiceWords
from soter.report.sequence_view import (
    Lane,
    ModeSwitch,
    ModuleModes,
    Pick,
    Published,
    SequenceStep,
    SequenceView,
    duration_text,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.explore.judge import ScheduledActor
    from soter.explore.replay import Replayed, ReplayedStep
    from soter.explore.trace import Choice
    from soter.language.model.system import System
    from soter.report.sequence_view import Kind, Mode, Role

KINDS = {BEGIN: "overrun"}
"""The view's words for kinds of steps, where they differ from the trace's."""
UNTOLD = "the file of the trace does not say; the output of `soter test` does"
DROPS = {
    "drop_oldest": "the oldest is dropped",
    "drop_newest": "the new one is dropped",
    "fault": "the new one is lost, a fault of its reader",
}


def make_sequence_view(
    replay: Replayed,
    tool_version: str,
    provenance: Mapping[str, str] | None = None,
    program: str | None = None,
) -> SequenceView:
    """The view of a replayed trace; if it reproduces, the last step is the violating one.

    `program`: its path as a reader would type it; by default the path in the trace.
    """
    trace, system = replay.trace, replay.system
    words = ChoiceWords(system)
    durations = _overrun_durations(replay)
    steps = [_sequence_step(s, replay, words, durations) for s in replay.steps]
    if not steps or steps[0].kind != "start":
        steps.insert(0, _start_step(replay))
    return SequenceView(
        program=program or trace.program,
        system=trace.system,
        test=trace.test,
        property_text=property_text(trace.broken.text),
        verdict=_verdict_sentence(replay),
        remark=_minimality_remark(replay),
        lanes=tuple([_actor_lane(system, a) for a in replay.actors]),
        steps=tuple(steps),
        topics=tuple([t.name for t in system.topics if t.queue_of is None]),
        modes=tuple(
            [_module_modes(replay, i, steps[0].number) for i in range(len(system.modules))]
        ),
        assumptions=trace.assumptions or (UNTOLD,),
        program_sha256=trace.sha256,
        seed=trace.seed,
        tool_version=tool_version,
        provenance=dict(provenance or {}),
    )


def property_text(text: str) -> str:
    """The text of a property with its code in backquotes, for example `always x < 1`."""
    kind, _, rest = text.partition(" ")
    return f"{kind} `{rest}`" if kind in ("always", "never", "eventually") and rest else text


def _verdict_sentence(replay: Replayed) -> str:
    if not replay.reproduced:
        return f"The trace does not reproduce: {replay.outcome}."
    last = replay.steps[-1]
    steps = len([s for s in replay.steps if s.kind != START])
    many = "" if steps == 1 else "s"
    return f"Violated after {steps} step{many}, at {duration_text(max(last.time_ns, 0))}."


def _minimality_remark(replay: Replayed) -> str:
    """A remark that says whether the trace is the shortest, and if not, why."""
    if not replay.reproduced:
        return ""
    if replay.trace.minimal:
        return "No execution violates it in fewer steps; the interpreter has replayed it."
    why = replay.trace.not_shortest or "the file of the trace does not say why"
    perhaps = f"erhaps not the shortest execution: {why}; the interpreter has replayed it."
    before, after = replay.trace.shrunk_from, len(replay.trace.steps)
    if not before:
        return f"P{perhaps}"
    born = len([s for s in replay.trace.steps if s.kind == START])
    return f"Shrunk from {before - born:,} steps to {after - born:,}; p{perhaps}"


def _overrun_durations(replay: Replayed) -> dict[int, int]:
    """The number of a step -> the duration in ns of the overrun that it begins or ends."""
    begun: dict[str, ReplayedStep] = {}
    durations: dict[int, int] = {}
    for step in replay.steps:
        if step.kind == BEGIN:
            begun[step.actor] = step
        elif step.kind == EFFECT and step.actor in begun:
            start = begun.pop(step.actor)
            durations[start.number] = durations[step.number] = step.time_ns - start.time_ns
    return durations


def _start_step(replay: Replayed) -> SequenceStep:
    return SequenceStep(number=0, time_ns=0, kind="start", published=_initial_values(replay))


def _initial_values(replay: Replayed) -> tuple[Published, ...]:
    """The values of topics before the first step, without the queues, which are empty then."""
    queues = {t.name for t in replay.system.topics if t.queue_of is not None}
    return tuple([Published(n, value_text(v)) for n, v in replay.start.items() if n not in queues])


def _sequence_step(
    step: ReplayedStep, replay: Replayed, words: ChoiceWords, durations: Mapping[int, int]
) -> SequenceStep:
    switch = None
    if step.switch is not None:
        module, before, after = step.switch
        switch = ModeSwitch(module, cast("Mode", before), cast("Mode", after))
    published = tuple([Published(n, value_text(value)) for n, value in step.published.items()])
    return SequenceStep(
        number=step.number,
        time_ns=max(step.time_ns, 0),
        lane=step.actor,
        kind=cast("Kind", KINDS.get(step.kind, step.kind)),
        release_ns=None if step.kind in (START, EFFECT) else step.release_ns,
        choices=tuple([_pick_in_words(c, words) for c in step.choices]),
        published=_initial_values(replay) if step.kind == START else published,
        gated=step.gated,
        switch=switch,
        fault=step.fault,
        dropped=tuple([f"queue `{d.queue}` is full: {DROPS[d.policy]}" for d in step.dropped]),
        lasts_ns=durations.get(step.number),
        observable=step.observable,
        violates=replay.has_violation_of_trace(step.violated),
        note=_step_note(step, replay),
    )


def _pick_in_words(choice: Choice, words: ChoiceWords) -> Pick:
    value = (
        f"alternative {choice.pick} of {choice.of}"
        if choice.value is None
        else value_text(choice.value)
    )
    return Pick(words.question_text(choice), value, choice.pick == 0)


def value_text(value: object) -> str:
    """A JSON value for people: records as `x = 1, y = 2`, floats with at most 9 digits."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{n}: {value_text(v)}" for n, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(value_text(v) for v in value) + "]"
    if isinstance(value, float):
        return f"{value:.9g}"
    return value if isinstance(value, str) else json.dumps(value)


def _step_note(step: ReplayedStep, replay: Replayed) -> str:
    """A sentence with further remarks on a step; "" without any remark."""
    clauses = [
        r
        for b, r in zip(step.violated, step.reasons, strict=False)
        if r and replay.has_violation_of_trace([b])
    ]
    others = [f"`{b.text}`" for b in step.violated if not replay.has_violation_of_trace([b])]
    if others:
        clauses.append(
            f"{', '.join(others)} {'is' if len(others) == 1 else 'are'} violated as well"
        )
    if clauses:
        return "; ".join(clauses)
    if step.decided is not None and step.switch is None:
        seen = [n for n in ("ttf", "safer", "stale", "gate_fault") if step.decided[n]]
        mode = step.decided["mode"]
        return f"stays in {mode}" + (f" ({', '.join(seen)})" if seen else "")
    return ""


# ---------------------------------------------------------------- lanes and modes


def _actor_lane(system: System, actor: ScheduledActor) -> Lane:
    module = None
    if actor.component is not None:
        index = system.components[actor.component].module
        module = None if index is None else system.modules[index].name
    return Lane(actor.name, cast("Role", actor.role), module)


def _module_modes(replay: Replayed, module: int, first: int) -> ModuleModes:
    flown_module = replay.system.modules[module]
    start: Literal["AC", "SC"] = "AC" if flown_module.forced == "ac" else "SC"
    changes = [
        (s.number, cast("Mode", s.switch[2]))
        for s in replay.steps
        if s.switch is not None and s.switch[0] == flown_module.name
    ]
    return ModuleModes(flown_module.name, ((first, start), *changes))
