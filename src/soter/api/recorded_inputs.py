"""What comes from outside in a run of an image: recorded in the world of the proof.

Purpose: of a system that deploys another, the values that its topics from outside have in a run of
that one, plants included, and the trace of the deployed system under them, here.
Non-goals: reading the recording (`runtime/cortex_m/soter_recording.c`); worlds that nobody wrote.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

from soter.core.layout import size_of
from soter.language.model.system import environment_topics

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.simulate.run import NativeProgram

    Recording = list[tuple[int, int, bytes]]
    """When it was measured (ns), the topic's number, and the value as it lies in memory."""


def recorded_inputs(system: System, until_ns: int, seed: int) -> Recording:
    """In order of time; nothing where no other system is deployed, or one with externs.

    SoterError as of `NativeProgram`.
    """
    there = system.proved
    if there is None or any(x.extern and x.binding is None for x in there.components):
        return []
    from soter.simulate.run import NativeProgram  # noqa: PLC0415 - needs a compiler

    native = NativeProgram(there)
    run = native.run(until_ns, seed, keep_trace=True)
    assert run.trace is not None
    drawn = {d.topic for d in system.inputs}
    topics = [system.topics[i] for i in environment_topics(system) if i not in drawn]
    numbers = {t.name: t.index for t in there.topics}
    recording: Recording = []
    last = dict.fromkeys((t.index for t in topics), -1)
    rows = run.trace.view("u1").reshape(len(run.trace), native.layout.size)
    for state, raw in zip(run.trace, rows, strict=True):
        for t in topics:
            index = numbers.get(t.name)
            if index is None:
                continue
            stamp, at = int(state["stamps"][index]), native.layout.topic_offset(index)
            if stamp > last[t.index]:
                last[t.index] = stamp
                recording.append((stamp, t.index, raw[at : at + size_of(t.type)].tobytes()))
    return sorted(recording, key=lambda r: r[0])


def recording_text(recording: Recording) -> str:
    """As `soter_recording.h` says."""
    return "".join(f"{time} {topic} {value.hex()}\n" for time, topic, value in recording)


def replayed_sha256(native: NativeProgram, recording: Recording, until_ns: int, seed: int) -> str:
    """The hash of the trace of a run that reads what was recorded; no extern may be due in it."""
    library, digest, given = native.loaded().library, hashlib.sha256(), iter(recording)
    state = library.new_state(seed)
    waiting = next(given, None)
    while (at := library.next_instant(state)) <= until_ns:
        while waiting is not None and waiting[0] <= at:
            library.publish(state, waiting[1], waiting[2], waiting[0])
            waiting = next(given, None)
        library.run(state, at)
        digest.update(state.tobytes())
    return digest.hexdigest()
