"""What a campaign has to say of a flight, from the whole trace of the run of its seed.

Purpose: `figures`: digest, trajectory and counts of a run, computed from every state of it; `alone`
calls something in a copy of this process, where no C was called before.
Non-goals: looks of measures, saves.
"""

from __future__ import annotations

import hashlib
import os
import pickle
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from soter.campaign.batch_flights import EVENT, LATCHED, TO_AC, TO_SC, VIOLATED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.campaign.store import FlightOutcome
    from soter.simulate.result import Run

T = TypeVar("T")
SAMPLES = 16
Figures = tuple[str, str, int, int, tuple[int, ...], tuple[int, ...]]


def figures(run: Run) -> Figures:
    """Digest, trajectory, seed, violations, disengagements and gate faults of each module."""
    trace = run.trace
    assert trace is not None
    said = np.array(list(_events(run, trace)), dtype=EVENT)
    until_ns = round(run.duration_s * 1e9)
    apart, due, trajectory = until_ns // SAMPLES + 1, 0, hashlib.sha256()
    for state in trace:
        ct = int(state["header"]["ct"])
        if ct >= due:
            trajectory.update(_seedless(state))
            due = (ct // apart + 1) * apart
    trajectory.update(_seedless(run.final))
    trajectory.update(said.tobytes())
    modules = run.modules.values()
    return (
        hashlib.sha256(said.tobytes() + run.final.tobytes()).hexdigest(),
        trajectory.hexdigest(),
        run.seed,
        run.violations,
        tuple(m.switches_to_sc for m in modules),
        tuple(m.gate_faults for m in modules),
    )


def figures_of(flight: FlightOutcome) -> Figures:
    """The same of a flight."""
    return (
        flight.digest,
        flight.trajectory,
        flight.seed,
        flight.violations,
        flight.disengagements,
        flight.gate_faults,
    )


def _events(run: Run, trace: Any) -> Iterator[tuple[int, int, int]]:
    parts = (("modules", "mode"), ("properties", "count"), ("components", "latched"))
    before = [np.zeros(len(trace[0][a][b]) if a in trace.dtype.names else 0) for a, b in parts]
    before[0] = np.array([m.forced == "ac" for m in run.system.modules], dtype=np.uint8)
    for state in trace:
        ct = int(state["header"]["ct"])
        for k, (a, b) in enumerate(parts):
            now = state[a][b] if a in trace.dtype.names else np.zeros(0)
            for i in np.flatnonzero(now != before[k]):
                kinds = (TO_AC if k == 0 and now[i] else TO_SC, VIOLATED, LATCHED)
                yield ct, kinds[k], int(i)
            before[k] = now.copy()


def _seedless(state: Any) -> bytes:
    said, header = bytearray(state.tobytes()), state.dtype["header"]
    for name in ("seed", "seed_key"):
        at = state.dtype.fields["header"][1] + header.fields[name][1]
        said[at : at + 8] = bytes(8)
    return bytes(said)


def alone(call: Callable[[], T]) -> T:
    """What `call` gives in a copy of this process; its answer can be pickled."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            with os.fdopen(write, "wb") as out:
                pickle.dump(call(), out)
            code = 0
        finally:
            os._exit(code)
    os.close(write)
    with os.fdopen(read, "rb") as told:
        answer = told.read()
    assert os.waitpid(child, 0)[1] == 0
    return pickle.loads(answer)  # type: ignore[no-any-return]  # noqa: S301 - of this process
