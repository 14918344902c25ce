"""Times of steps, measured on this machine.

Purpose: `measure`, what `soter measure` does; `written` puts the times into a file.
Non-goals: the stopwatch (`soter.measure`), what the times come to (`soter.timing`).
"""

from __future__ import annotations

import json
import os
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import mistake
from soter.measure.stopwatch import StepTimes, TimedUnit, timed
from soter.simulate.externs.bindings import bind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.api.program import Program

SCHEMA = 1
SAMPLES = 20_000
MARGIN = 2.0
NO_BOUND = (
    "a measurement is no bound: it has seen the states, the caches and the interrupts that it "
    "has seen, on this machine"
)


@dataclass(frozen=True)
class Measured:
    """The times of the steps of one system; `margin`: what the longest was multiplied with."""

    system: str
    program_sha256: str
    machine: str
    margin: float
    steps: tuple[StepTimes, ...]


def measure(
    program: Program,
    system: str | None = None,
    params: Mapping[str, object] | None = None,
    *,
    until: float | str | None = None,
    samples: int = SAMPLES,
    margin: float = MARGIN,
    seed: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Measured:
    """Times of single steps of every component of the trusted thread that is Soter code.

    `until`: of the run whose states they begin from (the system's own end); `samples`: about so
    many steps of each.
    `SoterError` as `Program.simulate`, U001 where the margin is below 1.
    """
    if not margin >= 1.0 or not margin <= 1e6:
        raise mistake("U001", f"a margin of {margin:g} is none", "say a number from 1 on")
    run = program.simulate(system, until, seed, params=params, sha256=False, apart=True)
    assert run.trace is not None
    size = run.layout.size
    trace = run.trace.view("u1").reshape(len(run.trace), size)
    made = TimedUnit(run.system, bind(run.system, program.bound).core)
    steps = timed(made, trace, samples=samples, margin=margin, seed=seed, progress=progress)
    sha256 = program.sha256
    assert sha256 is not None
    return Measured(run.system.name, sha256, machine(), margin, steps)


def machine() -> str:
    """This machine, in words that name nobody."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"


def document(measurement: Measured) -> dict[str, Any]:
    """As the file has it; times in ns."""
    return {
        "schema": SCHEMA,
        "system": measurement.system,
        "program_sha256": measurement.program_sha256,
        "machine": measurement.machine,
        "margin": measurement.margin,
        "note": NO_BOUND,
        "steps": [
            {
                "name": s.name,
                "samples": s.samples,
                "percentiles_ns": {f"{q:g}": ns for q, ns in s.percentiles},
                "longest_ns": s.longest_ns,
                "faulted": s.faulted,
                "wcet_ns": s.wcet_ns,
            }
            for s in measurement.steps
        ],
    }


def written(measurement: Measured, path: str | Path) -> Path:
    """Writes the file; OSError where that fails."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document(measurement), indent=2) + "\n", encoding="utf-8")
    return path
