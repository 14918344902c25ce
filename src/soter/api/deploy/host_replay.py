"""The run that an image repeats, done on this machine.

Purpose: `replay_on_host` makes it with its trace; `recorded_inputs` records for it the values of
topics from outside in a run of the system that was proved, with its plants.
Non-goals: reading a recording (`runtime/cortex_m/soter_recording.c`).
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

from soter.core.layout import size_of
from soter.language.model.system import System, environment_topics
from soter.targets.cortex_m_board import Replay
from soter.targets.cortex_m_package import replay_end_ns

if TYPE_CHECKING:
    from soter.native.extern_bindings import Bindings
    from soter.simulate.run import NativeProgram

    Recording = list[tuple[int, int, bytes]]
    """When it was measured (ns), the topic's number, and the value as it lies in memory."""


def recorded_inputs(system: System, until_ns: int, seed: int) -> Recording:
    """Records the values of topics from outside in a run of the proved system, in order of time.

    [] if no other system was proved or it has unbound externs. Raises as `NativeProgram` does.
    """
    proved = system.proved
    if proved is None or any(x.extern and x.binding is None for x in proved.components):
        return []
    from soter.simulate.run import NativeProgram  # noqa: PLC0415 - needs a compiler

    native = NativeProgram(proved)
    run = native.run(until_ns, seed, keep_trace=True)
    assert run.trace is not None
    drawn = {d.topic for d in system.inputs}
    topics = [system.topics[i] for i in environment_topics(system) if i not in drawn]
    numbers = {t.name: t.index for t in proved.topics}
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
    """The recording as text, in the format of `runtime/cortex_m/soter_recording.h`."""
    return "".join(f"{time} {topic} {value.hex()}\n" for time, topic, value in recording)


def sha256_of_replay(native: NativeProgram, recording: Recording, until_ns: int, seed: int) -> str:
    """The SHA-256 hash of the trace of a run fed by the recording; the run may ask no extern."""
    library, digest, inputs = native.load().library, hashlib.sha256(), iter(recording)
    state = library.new_state(seed)
    waiting = next(inputs, None)
    while (at := library.next_instant_ns(state)) <= until_ns:
        while waiting is not None and waiting[0] <= at:
            library.publish(state, waiting[1], waiting[2], waiting[0])
            waiting = next(inputs, None)
        library.run_until(state, at)
        digest.update(state.tobytes())
    return digest.hexdigest()


def replay_on_host(bindings: Bindings) -> Replay:
    """Makes the run here that an image repeats; it has no trace if the run asks an extern."""
    system = bindings.system
    until, seed = replay_end_ns(system), 1
    if any(x.extern and not (x.binding or "").startswith("c:") for x in system.components):
        return Replay(until, seed)
    recording = recorded_inputs(system, until, seed)
    if system.externals and not recording:
        return Replay(until, seed)
    from soter.simulate.run import NativeProgram  # noqa: PLC0415 - needs a compiler

    native = NativeProgram(system, core=bindings.core)
    if recording:
        trace = sha256_of_replay(native, recording, until, seed)
        return Replay(until, seed, trace, recording_text(recording))
    run = native.run(until, seed, hash_trace=True)
    return Replay(until, seed, run.trace_sha256 or "")
