"""Measures times of steps on this machine, or counts instructions on an emulated board.

Purpose: `measure` and `measure_on_board` do what `soter measure` does; `write_measurement` writes
the file.
Non-goals: the stopwatch (`soter.measure`), the analysis of times (`soter.timing`).
"""

from __future__ import annotations

import json
import os
import platform
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from soter.api.arguments import time_ns
from soter.api.measured_times import TIMES_FORMAT
from soter.diagnostics.command_records import JsonObject
from soter.diagnostics.diagnostic import mistake
from soter.measure import MARGIN, SAMPLES
from soter.measure.stopwatch import StepTimes, TimedUnit, step_times, time_steps, timed_components
from soter.native.extern_bindings import bind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.api.program import Program

NO_BOUND = (
    "a measurement is no bound: it has seen the states, the caches and the interrupts that it "
    "has seen, on this machine"
)
COUNTS = (
    "counts of instructions are no times, and the dearest step may not have been counted: what is "
    "proved with these times rests on the factor"
)
INSTRUCTION_MAX_NS = 10**6


@dataclass(frozen=True)
class Measured:
    """The times of a system's steps, the `margin` on the longest, and what is `assumed`."""

    system: str
    program_sha256: str
    machine: str
    margin: float
    steps: tuple[StepTimes, ...]
    assumed: str = ""


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
    """Measures single steps of each component of the trusted thread that is Soter code.

    `until`: the end of the run from whose states steps start, by default the end in the system;
    `samples`: about how many steps to measure for each component. Raises SoterError as
    `Program.simulate` does, and U001 if the margin is below 1.
    """
    _require_margin(margin)
    run = program.simulate(system, until, seed, params=params, sha256=False, apart=True)
    assert run.trace is not None
    trace = run.trace.view("u1").reshape(len(run.trace), run.layout.size)
    made = TimedUnit(run.system, bind(run.system, program.bound).core)
    steps = time_steps(made, trace, samples=samples, margin=margin, seed=seed, progress=progress)
    return Measured(run.system.name, run.system.program.sha256, machine_text(), margin, steps)


def measure_on_board(
    program: Program,
    board: str,
    instruction: float | str,
    system: str | None = None,
    params: Mapping[str, object] | None = None,
    *,
    margin: float = MARGIN,
) -> Measured:
    """Counts instructions of single steps on a board that QEMU emulates, and multiplies by a time.

    `instruction`: the longest time of an instruction on the board, set by the caller (`"20ns"`).
    Raises SoterError as `Program.build` and `built_image` do, U001 for a wrong factor, X004 if an
    image cannot be made or run here.
    """
    from soter.api.deploy.building import built_image, stack_bound  # noqa: PLC0415 - of this function alone
    from soter.targets.cortex_m_board import read_board  # noqa: PLC0415 - the same

    _require_margin(margin)
    instruction_ns = time_ns("instruction", instruction)
    if instruction_ns is None or not 0 < instruction_ns <= INSTRUCTION_MAX_NS:
        raise mistake("U001", f"no instruction takes `{instruction}`", "say a time: 20ns")
    with TemporaryDirectory() as folder:
        package = program.build("cortex-m", Path(folder) / "out", system, params, board=board)
        place = read_board(board)
        image = built_image(package, board, stack_bound(package, board))
    assert image is not None
    if not image.steps:
        help_ = 'docs/bare-metal.md, "What you need"'
        raise mistake("X004", f"no steps were counted on `{place.name}`: {image.why}", help_)
    flat = program.flat(system, params)
    counts = {s.name: s for s in image.steps}
    steps = []
    for c in timed_components(flat):
        counted = counts[c.name]
        times = step_times(flat, c, np.array([counted.most * instruction_ns]), margin=margin)
        steps.append(replace(times, samples=counted.number, percentiles=()))
    assumed = (
        f"an instruction takes {instruction_ns} ns at most on {place.name}: stated, not measured"
    )
    sha256, where = flat.program.sha256, f"{place.name} in QEMU"
    return Measured(flat.name, sha256, where, margin, tuple(steps), assumed)


def _require_margin(margin: float) -> None:
    if not 1.0 <= margin <= 1e6:
        raise mistake("U001", f"a margin of {margin:g} is none", "say a number from 1 on")


def machine_text() -> str:
    """A description of this machine by processor and system, without machine or user names."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"


def _measurement_note(measurement: Measured) -> str:
    return COUNTS if measurement.assumed else NO_BOUND


def _percentiles(step: StepTimes) -> dict[str, int]:
    return {f"{q:g}": ns for q, ns in step.percentiles}


DOCUMENT = JsonObject(
    Measured,
    "system program_sha256 machine margin note assumed steps",
    {"note": _measurement_note},
    beside={"file": str, "times": str},
    steps=JsonObject(
        StepTimes,
        "name samples percentiles_ns longest_ns faulted wcet_ns",
        {"percentiles_ns": _percentiles},
    ),
)
"""The measurement as the file's JSON object; times in ns."""


def write_measurement(measurement: Measured, path: str | Path) -> Path:
    """Writes the file and returns its path. Raises OSError if that fails."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        json.dumps({"schema": TIMES_FORMAT, **DOCUMENT.of(measurement)}, indent=2) + "\n",
        encoding="utf-8",
    )
    return path
