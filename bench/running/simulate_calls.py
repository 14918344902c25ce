"""What a call of `Program.simulate` costs: the first one, later ones, and what they spend it on.

    .venv/bin/python bench/running/simulate_calls.py [--repeats N]

For a small example and for the drone, with parameters and system as before: the first call (it
elaborates, lowers and compiles, or finds what was compiled), a call on a program that was loaded
anew, and the median of later calls, with the trace and its hash, with a part of the trace, and
without both. `run` is what the run itself took of the last one. Every later run has to have the
hash, or the last state, of the first one with its seed. Exit code 1 where one has not, or where the
small example misses its target.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import soter

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[2]
TARGET_MS = 3.0


class Case(NamedTuple):
    """A system, how long it runs, and what a campaign would look at."""

    name: str
    file: str
    until: str
    topics: list[str]
    target_ms: float | None = None


CASES = (
    Case("mountain car", "mountain_car/cliff.soter", "200s", ["car.truth"], TARGET_MS),
    Case("cart", "wall/cart.soter", "10s", ["c.truth"]),
    Case("drone, a lap", "drone/motion_primitive.soter", "14s", ["d.truth"]),
    Case("drone, planner in Python", "drone/surveillance.soter", "10s", ["d.truth"]),
)
WAYS: dict[str, dict[str, Any]] = {
    "whole trace, hash": {},
    "no trace, hash": {"trace": False},
    "a truth, no hash": {"sha256": False},
    "no trace, no hash": {"trace": False, "sha256": False},
}


def timed(call: Callable[[], soter.Run]) -> tuple[float, soter.Run]:
    """Wall time of a call in ms, and its run."""
    began = time.perf_counter()
    run = call()
    return (time.perf_counter() - began) * 1e3, run


def measure(case: Case, repeats: int) -> bool:
    """Print the lines of a case; whether every run was the right one, in time."""
    path = ROOT / "examples" / case.file
    program = soter.load(path)

    def simulate(of: soter.Program, seed: int, way: dict[str, Any]) -> soter.Run:
        return of.simulate("Protected", case.until, seed=seed, **way)

    first_ms, first = timed(lambda: simulate(program, 0, {}))
    again_ms, again = timed(lambda: simulate(soter.load(path), 0, {}))
    right = again.trace_sha256 == first.trace_sha256
    instants = f"{first.instants} instants of {first.final.nbytes} bytes"
    print(f"{case.name}: {instants}; first call {first_ms:.1f} ms, load and call {again_ms:.1f} ms")
    expected = [simulate(program, seed, {}) for seed in range(repeats)]
    for name, way in WAYS.items():
        how = dict(way, trace=case.topics) if "truth" in name else way
        calls = [timed(partial(simulate, program, seed, how)) for seed in range(repeats)]
        for (_, run), whole in zip(calls, expected, strict=True):
            right &= run.final.tobytes() == whole.final.tobytes()
            right &= run.trace_sha256 in (None, whole.trace_sha256)
        median_ms = statistics.median(ms for ms, _ in calls)
        run_ms = statistics.median(run.wall_s for _, run in calls) * 1e3
        target = ""
        if case.target_ms is not None:
            right &= median_ms <= case.target_ms
            target = f"  target <= {case.target_ms:g}"
        print(f"  {name:20s} {median_ms:9.2f} ms a call, run {run_ms:9.2f} ms{target}")
    return right


def main() -> int:
    """Measure all; 1 where a run was another one, or too slow."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=15)
    repeats = parser.parse_args().repeats
    right = [measure(case, repeats) for case in CASES]
    print("every run was that of its seed" if all(right) else "MISSED: a run, or the target")
    return 0 if all(right) else 1


if __name__ == "__main__":
    sys.exit(main())
