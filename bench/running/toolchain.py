"""Times of the tool chain on the drone program: check, compile and load, virtual-time speed.

    .venv/bin/python bench/running/toolchain.py [--json FILE]

Measures, each as the median (and best) of several runs on this machine:
- process time of `soter check`, warm (second run on), interpreter start included;
- from source text to a loaded program, cold (empty cache) and cached, imports excluded;
- virtual time per wall time of system Protected on one core, without a trace, and the same on the
  reference interpreter, in one run.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted

ROOT = Path(__file__).resolve().parents[2]
DRONE = "examples/drone/motion_primitive.soter"
NATIVE_S = 200.0
INTERPRETED_S = 10.0


def check_times(repeats: int) -> list[float]:
    """CPU seconds (user and system) of `soter check`, one a run."""
    command = [sys.executable, "-m", "soter.cli.main", "check", DRONE]
    times = []
    for i in range(repeats + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if i:  # the first one warms the file cache and the byte code
            times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return times


LOAD = """
import sys, time
import soter.language.front_end, soter.simulate.run
from soter.native.library import kernel_interface
kernel_interface()
began = time.perf_counter()
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram
NativeProgram(system_of(check_file(sys.argv[1]), "Protected"))
print(time.perf_counter() - began)
"""


def load_times(repeats: int) -> tuple[list[float], list[float]]:
    """Wall seconds from text to loaded program: cold, cached."""
    cold: list[float] = []
    cached: list[float] = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "SOTER_CACHE": cache}
            for times in (cold, cached):
                done = subprocess.run(
                    [sys.executable, "-c", LOAD, DRONE],
                    cwd=ROOT,
                    env=environment,
                    check=True,
                    capture_output=True,
                    text=True,
                )
                times.append(float(done.stdout))
    return cold, cached


def speeds(repeats: int) -> tuple[list[float], float]:
    """Virtual seconds per wall second: native runs, and the interpreter once."""
    system = system_of(check_file(str(ROOT / DRONE)), "Protected")
    program = NativeProgram(system)
    native = []
    for seed in range(repeats):
        run = program.run(int(NATIVE_S * 1e9), seed)
        native.append(NATIVE_S / run.wall_s)
    interpreted = run_interpreted(system, int(INTERPRETED_S * 1e9), 0)
    return native, INTERPRETED_S / interpreted.wall_s


def lap_speed(repeats: int) -> list[float]:
    """The same for the 14 s of a lap only, where most of the control happens."""
    program = NativeProgram(system_of(check_file(str(ROOT / DRONE)), "Protected"))
    lap_speeds = []
    for seed in range(repeats):
        began = time.perf_counter()
        for k in range(20):
            program.run(14_000_000_000, 1000 * seed + k)
        lap_speeds.append(20 * 14.0 / (time.perf_counter() - began))
    return lap_speeds


def main() -> None:
    """Measure and print; `--json` also writes the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    check = check_times(11)
    cold, cached = load_times(5)
    native, interpreted = speeds(9)
    laps = lap_speed(9)
    figures = {
        "check_process_s": statistics.median(check),
        "load_cold_s": statistics.median(cold),
        "load_cached_s": statistics.median(cached),
        "native_x_real_time": statistics.median(native),
        "native_lap_x_real_time": statistics.median(laps),
        "interpreter_x_real_time": interpreted,
        "native_over_interpreter": statistics.median(native) / interpreted,
    }
    rows = [
        ("soter check, warm, process time", figures["check_process_s"], min(check), "s", "<= 0.4"),
        ("compile and load, cold", figures["load_cold_s"], min(cold), "s", "<= 2"),
        ("compile and load, cached", figures["load_cached_s"], min(cached), "s", "<= 0.15"),
        (
            "virtual time, 200 s run",
            figures["native_x_real_time"],
            max(native),
            "x real time",
            ">= 5000",
        ),
        (
            "virtual time, 14 s laps",
            figures["native_lap_x_real_time"],
            max(laps),
            "x real time",
            ">= 5000",
        ),
        ("reference interpreter", interpreted, interpreted, "x real time", ""),
        ("native / interpreter", figures["native_over_interpreter"], 0.0, "", ""),
    ]
    print(f"{'figure':36} {'median':>10} {'best':>10}  unit         target")
    for name, median, best, unit, target in rows:
        shown = f"{best:10.3g}" if best else " " * 10
        print(f"{name:36} {median:10.4g} {shown}  {unit:12} {target}")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
