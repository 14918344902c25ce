"""A replayed trace as the sequence view that the page, the log and the table show.

Purpose: lanes, topics, modes, and what every step did, in words (`report/sequence.py`).
Non-goals: drawing; running anything.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Literal, cast

from soter.explore.choices import ChoiceWords
from soter.explore.trace import BEGIN, EFFECT, START
from soter.report.sequence import (
    Lane,
    ModuleModes,
    Pick,
    Published,
    SequenceStep,
    SequenceView,
    Switch,
    TopicFlow,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.explore.replay import Replayed, Stepped
    from soter.explore.schedule import Actor
    from soter.explore.trace import Choice
    from soter.program.system import Component, System
    from soter.report.sequence import Kind, Mode, Role

KINDS = {BEGIN: "overrun"}
"""Kinds of steps that the view calls otherwise."""


def view_of(
    found: Replayed,
    tool_version: str,
    assumptions: Iterable[str] = (),
    provenance: Mapping[str, str] | None = None,
) -> SequenceView:
    """The view of a replayed trace; the violating step is the last, where it reproduces."""
    trace, system = found.trace, found.system
    words = ChoiceWords(system)
    steps = [_step(s, found, words) for s in found.steps]
    if not steps or steps[0].kind != "start":
        steps.insert(0, _start(found))
    return SequenceView(
        program=trace.program,
        system=trace.system,
        test=trace.test,
        property_text=property_text(trace.broken.text),
        verdict=_sentence(found),
        lanes=tuple([_lane(system, a) for a in found.actors]),
        steps=tuple(steps),
        topics=tuple(_topics(system)),
        modes=tuple([_modes(found, i, steps[0].number) for i in range(len(system.modules))]),
        assumptions=tuple(assumptions),
        program_sha256=trace.sha256,
        seed=trace.seed,
        tool_version=tool_version,
        provenance=dict(provenance or {}),
    )


def property_text(text: str) -> str:
    """`always x < 1`, with what is code in backquotes."""
    kind, _, rest = text.partition(" ")
    return f"{kind} `{rest}`" if kind in ("always", "never", "eventually") and rest else text


def _sentence(found: Replayed) -> str:
    said = property_text(found.trace.broken.text)
    if not found.reproduced:
        return f"The trace does not reproduce: {found.outcome}."
    last = found.steps[-1]
    steps = len([s for s in found.steps if s.kind != START])
    return f"Violated after {steps} steps, at {last.time_ns / 1e9:.9g} s: {said}."


def _start(found: Replayed) -> SequenceStep:
    published = tuple([Published(n, shown(v)) for n, v in found.start.items()])
    return SequenceStep(number=0, time_ns=0, kind="start", published=published)


def _step(s: Stepped, found: Replayed, words: ChoiceWords) -> SequenceStep:
    switch = None
    if s.switch is not None:
        module, before, after = s.switch
        switch = Switch(module, cast("Mode", before), cast("Mode", after))
    published = found.start if s.kind == START else s.published
    return SequenceStep(
        number=s.number,
        time_ns=max(s.time_ns, 0),
        lane=s.actor,
        kind=cast("Kind", KINDS.get(s.kind, s.kind)),
        release_ns=None if s.kind in (START, EFFECT) else s.release_ns,
        choices=tuple([_pick(c, words) for c in s.choices]),
        published=tuple([Published(n, shown(v)) for n, v in published.items()]),
        gated=s.gated,
        switch=switch,
        fault=s.fault,
        observable=s.observable,
        violates=found.names(s.violated),
        note=_note(s, found),
    )


def _pick(c: Choice, words: ChoiceWords) -> Pick:
    value = f"alternative {c.pick} of {c.of}" if c.value is None else shown(c.value)
    return Pick(words.what(c), value, c.pick == 0)


def shown(value: object) -> str:
    """A JSON value for people: records as `x = 1, y = 2`, floats with at most 9 digits."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{n}: {shown(v)}" for n, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(shown(v) for v in value) + "]"
    if isinstance(value, float):
        return f"{value:.9g}"
    return value if isinstance(value, str) else json.dumps(value)


def _note(s: Stepped, found: Replayed) -> str:
    """What else is to be said of a step, one sentence."""
    others = [b.text for b in s.violated if not found.names([b])]
    if others:
        return f"also violated: {', '.join(others)}"
    if s.decided is not None and s.switch is None:
        seen = [n for n in ("ttf", "safer", "stale", "gate_fault") if s.decided[n]]
        mode = s.decided["mode"]
        return f"stays in {mode}" + (f" ({', '.join(seen)})" if seen else "")
    return ""


# ---------------------------------------------------------------- who is there


def _lane(system: System, actor: Actor) -> Lane:
    module = None
    if actor.component is not None:
        index = system.components[actor.component].module
        module = None if index is None else system.modules[index].name
    return Lane(actor.name, cast("Role", actor.role), module)


def _topics(system: System) -> Iterable[TopicFlow]:
    writers: dict[int, list[str]] = {t.index: [] for t in system.topics}
    readers: dict[int, list[str]] = {t.index: [] for t in system.topics}
    for c in system.components:
        reads, writes = _flows(system, c)
        for t in reads:
            readers[t].append(c.name)
        for t in writes:
            writers[t].append(c.name)
    for drive in system.inputs:
        writers[drive.topic].append(f"input.{system.topics[drive.topic].name}")
    for topic in system.topics:
        yield TopicFlow(topic.name, tuple(writers[topic.index]), tuple(readers[topic.index]))


def _flows(system: System, c: Component) -> tuple[list[int], list[int]]:
    """Topics that a component reads and writes."""
    named = c.scope.topics
    if c.plant is not None:
        return [named[t] for t in c.plant.reads], [named[t] for t, _ in c.plant.drives]
    if c.node is not None:
        reads = [named[s.topic] for s in c.node.subscribes]
        return reads, [named[t] for t in c.node.publishes]
    assert c.module is not None, c.name
    return list(system.modules[c.module].inputs), []


def _modes(found: Replayed, module: int, first: int) -> ModuleModes:
    m = found.system.modules[module]
    start: Literal["AC", "SC"] = "AC" if m.forced == "ac" else "SC"
    changes = [
        (s.number, cast("Mode", s.switch[2]))
        for s in found.steps
        if s.switch is not None and s.switch[0] == m.name
    ]
    return ModuleModes(m.name, ((first, start), *changes))
