"""`soter test` on two threads beside one: how much sooner, and whether it finds the same.

    .venv/bin/python bench/testing/two_threads.py [--runs 5] [--reductions R ...]

Models of a million configurations and more under each reduction, on one thread and on two, turn by
turn. Efficiency is wall time on one thread over twice that on two, of the least of all runs and of
the medians: the machine must be free. CPU time is that of all threads, with what they spend in
waiting for each other awake. Both must store the same configurations (`same`); where something is
violated, both must find the same shortest execution.

Purpose: the figures of cores of issue 34. Non-goals: sizes (size.py), verdicts (tests/correct).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from soter.explore import methods
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.reduction_choice import explored
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from bench.testing.size import MEMORY, PROGRAM, TICK_NS  # noqa: E402 - found beside this file
from bench.testing.spin import MODELS  # noqa: E402

if TYPE_CHECKING:
    from soter.language.model.system import System

CHOSEN = "chosen"
"""As `soter test` does: it may end where configurations come again."""
EFFICIENCY = 0.8
SHARED = (
    ("five_moves", 1, "none"),
    ("five_moves", 1, "sleep"),
    ("five_moves", 1, "ample"),
    ("five_moves", 1, "symmetry"),
    ("crossing", 20, "instants"),
    ("One", 200, "groups"),
    ("alternating_bit", 20, "groups"),
    ("One", 200, "parts"),
    ("One", 200, "all"),
    ("Both", 3, "ample"),
    ("token_ring GoesRound", 1, CHOSEN),
    ("three_modules Battery", 1, CHOSEN),
)
"""Model, its horizon in ticks (of other files: how many times as long), reduction. `Both` has
configurations of two words, GoesRound of three, the others of one."""
VIOLATED = tuple(("Low", 20, how) for how in ("none", "sleep", "ample", "all"))


def system_of(name: str, ticks: int) -> System:
    """A test of `PROGRAM`, of an example, or a model of `spin.py`, `ticks` times as long."""
    model = next((m for m in MODELS if m.name == name), None)
    file, _, test = name.partition(" ")
    if test:
        (path,) = (ROOT / "examples").glob(f"*/{file}.soter")
        system = system_of_test(check_file(str(path)), test)
        assert system.test is not None
        horizon = system.test.horizon_ns
    elif model is None:
        system, horizon = system_of_test(check_file("robots.soter", PROGRAM), name), TICK_NS
    else:
        system = system_of_test(check_file(str(model.program)), model.test)
        assert system.test is not None
        horizon = system.test.horizon_ns
    assert system.test is not None
    return replace(system, test=replace(system.test, horizon_ns=ticks * horizon))


@dataclass(frozen=True)
class OnThreads:
    """CPU seconds and wall seconds of the searches on one thread and on two."""

    cpu: tuple[list[float], list[float]]
    wall: tuple[list[float], list[float]]
    states: tuple[int, int]
    status: tuple[str, str]
    layers: int

    @property
    def efficiency(self) -> tuple[float, float]:
        """By the least of all runs, and by medians."""
        one, two = self.wall
        return min(one) / (2.0 * min(two)), median(one) / (2.0 * median(two))


def on_threads(engine: Engine, reduction: str, runs: int) -> OnThreads:
    """Turn by turn; but where it is `CHOSEN` nobody looks for what comes again."""
    cpu: tuple[list[float], list[float]] = ([], [])
    wall: tuple[list[float], list[float]] = ([], [])
    last = {}
    for _ in range(runs):
        for threads in (1, 2):
            settings = EngineSettings(threads=threads, memory=MEMORY)
            before = time.process_time()
            if reduction == CHOSEN:
                outcome = explored(engine, replace(settings, closes=True))
            else:
                outcome = engine.explore(replace(settings, reduction=reduction))
            last[threads] = outcome
            cpu[threads - 1].append(time.process_time() - before)
            wall[threads - 1].append(outcome.seconds)
    states, status = (last[1].states, last[2].states), (last[1].status, last[2].status)
    return OnThreads(cpu, wall, states, status, last[2].depth)


def same_traces(engine: Engine, reduction: str) -> bool:
    """Whether one thread and two find the same violation, execution and least execution."""
    both = []
    for threads in (1, 2):
        settings = EngineSettings(reduction=reduction, threads=threads, memory=MEMORY)
        outcome = engine.explore(settings)
        if outcome.status != "violated" or outcome.broken is None or not outcome.steps:
            return False
        least = engine.least(settings, outcome.broken)
        both.append((outcome.broken, outcome.depth, outcome.steps, least.status, least.steps))
    return both[0] == both[1]


def two_threads(runs: int, only: list[str] | None) -> int:
    """Prints one thread beside two; returns how many rows miss their target."""
    cells, count = [], 0
    for name, ticks, reduction in SHARED:
        if only and reduction not in only:
            continue
        engine = Engine(system_of(name, ticks))
        row = on_threads(engine, reduction, runs)
        engine.close()
        same = row.states[0] == row.states[1] and row.status == ("exhausted", "exhausted")
        best, middle = row.efficiency
        count += not same or best < EFFICIENCY
        cells.append(
            (
                f"{name}, {ticks}",
                reduction,
                f"{row.states[0]:,}",
                f"{row.layers:,}",
                "yes" if same else "NO",
                *(f"{min(x):.3f} s" for x in (*row.cpu, *row.wall)),
                f"{best:.2f}",
                f"{middle:.2f}",
            )
        )
    heads = (
        "model",
        "reduction",
        "states",
        "steps",
        "same",
        "CPU, 1",
        "CPU, 2",
        "wall, 1",
        "wall, 2",
    )
    print(table((*heads, "efficiency", "by medians"), cells))
    for name, ticks, reduction in VIOLATED:
        if only and reduction not in only:
            continue
        engine = Engine(system_of(name, ticks))
        same = same_traces(engine, reduction)
        engine.close()
        count += not same
        print(f"{name}, {reduction}: {'the same execution' if same else 'ANOTHER EXECUTION'}")
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(f"least of {runs} runs; rows that miss {EFFICIENCY}, or are not the same: {count}")
    print(f"load of the machine at the end (1, 5, 15 minutes): {load}; {os.cpu_count()} cores")
    return count


def main() -> int:
    """Print the table; 1 where a row misses its target."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--reductions", nargs="+", choices=(*methods.REDUCTIONS, CHOSEN))
    arguments = parser.parse_args()
    return 1 if two_threads(arguments.runs, arguments.reductions) else 0


if __name__ == "__main__":
    sys.exit(main())
