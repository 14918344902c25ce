"""How large a system `soter test` can exhaust: one robot, and two in one airspace.

    .venv/bin/python bench/testing/size.py [--runs 3] [--seconds 60] [--json FILE]
    .venv/bin/python bench/testing/size.py --two-threads [--runs 5] [--reductions R ...]

*One*: the surveillance of one robot (11 actors, 35 ticks of 10 ms): a body and a battery, a
mission, a planner, modules for the geofence and the battery, a lift. *Both*: two of them without
a mission, in one airspace (20 actors, 20 ticks), which must not be too far apart while their
batteries last. *Near* asks for more than they keep: it is violated, and the time is the one until
there is an execution of the whole. `apart` is what `soter test` does, parts of the system alone;
the other reductions search all of it: `before` is sleep and ample sets, `all` ends of instants by
groups, too. Times are medians. Bytes are those of table and frontier when most was taken, a state
(and of all that is kept); a search of a few thousand states has the first tables to bear.

`--two-threads`: models of a million configurations and more under each reduction on one thread and
on two, turn by turn. Efficiency is wall time on one thread over twice that on two, of the least of
all runs and of the medians: the machine must be free. CPU time is that of all threads, with what
they spend in waiting for each other awake. Both must store the same configurations (`same`); where
something is violated, both must find the same shortest execution.

Purpose: the figures of size of issue 11, and of cores of issue 34.
Non-goals: verdicts (tests/correct).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from soter.explore import methods
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.reduction_choice import explored
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))

from bench.testing.spin import MODELS  # noqa: E402 - found beside this file

if TYPE_CHECKING:
    from soter.explore.engine.explorer_library import Searched
    from soter.explore.engine.search import Found
    from soter.language.model.system import System

BEFORE = "before"
APART = "apart"
CHOSEN = "chosen"
"""As `soter test` does: it may end where configurations come again."""
MEMORY = 2 << 30
TICK_NS = 10_000_000
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
ROWS = (
    ("One", 35, BEFORE, "bfs"),
    ("One", 35, "instants", "bfs"),
    ("One", 35, "all", "bfs"),
    ("One", 35, "all", "dfs"),
    ("One", 35, BEFORE, "dfs"),
    ("One", 35, APART, "bfs"),
    ("Both", 3, BEFORE, "bfs"),
    ("Both", 3, "all", "bfs"),
    ("Both", 20, "all", "bfs"),
    ("Both", 20, APART, "bfs"),
    ("Near", 20, APART, "bfs"),
)
"""Test, ticks, reduction, strategy."""
ENDS = {"Near": "violated"}
TARGETS = {("One", 35): 2.0, ("Both", 20): 60.0, ("Near", 20): 60.0}
"""Seconds that a test may take, as `soter test` runs it; within 2 GiB."""
BYTES = 12.0
LARGE = 100_000
"""States, from which on bytes a state are asked for."""

PROGRAM = """soter 1;

const END: int = 5;
const NEAR: int = 0;
const FULL: int = 24;
const RESERVE: int = 9;

type Cell = int in [-6, 6];
type Move = int in [-1, 1];
type Charge = int in [0, FULL];
type Order = enum { Land, Fly };
type Place = enum { Base, North, South };

topic target: Place;
topic waypoint: Move in [-1, 1];
topic cell: Cell;
topic move: Move in [-1, 1];
topic charge: Charge = FULL;
topic order: Order;
topic climb: bool;

plant Body period 10ms {
  reads move;
  drives cell = at;
  state at: Cell = 0;
  next at = max(-6, min(at + move, 6));
}

plant Battery period 10ms {
  reads climb;
  drives charge = left;
  state left: Charge = FULL;
  next left = climb ? max(left - 1, 0) : min(left + 3, FULL);
}

node Mission period 50ms {
  publishes target;
  step { publish target = choose Place; }
}

node Planner period 20ms {
  subscribes target, cell;
  publishes waypoint;
  step {
    if target == Place.Base {
      publish waypoint = cell > 0 ? -1 : cell < 0 ? 1 : 0;
    } else {
      publish waypoint = target == Place.North ? 1 : -1;
    }
  }
}

node Roam period 20ms {
  publishes waypoint;
  step { publish waypoint = choose { 0, 1, -1 }; }
}

node Primitive period 10ms {
  subscribes waypoint;
  publishes move;
  step { publish move = waypoint; }
}

node Home period 20ms {
  subscribes cell;
  publishes move;
  step { publish move = cell > 0 ? -1 : cell < 0 ? 1 : 0; }
}

rta Geofence {
  ac Primitive;
  sc Home;
  period 20ms;
  safe abs(cell) <= END;
  ttf abs(cell) > NEAR;
  safer cell == 0;
}

node Application period 20ms {
  publishes order;
  step { publish order = choose { Order.Fly, Order.Land }; }
}

node Lander period 10ms {
  publishes order;
  step { publish order = Order.Land; }
}

rta SafeBattery {
  ac Application;
  sc Lander;
  period 30ms;
  safe charge > 0;
  ttf charge < RESERVE;
  safer charge == FULL;
}

node Lift period 10ms {
  subscribes order;
  publishes climb;
  step { publish climb = order == Order.Fly; }
}

system Robot {
  body: Body;
  battery: Battery;
  node Roam;
  module Geofence;
  module SafeBattery;
  node Lift;
  always abs(body.truth.at) <= END;
  always battery.truth.left > 0;
}

system Surveillance default {
  body: Body;
  battery: Battery;
  node Mission;
  node Planner;
  module Geofence;
  module SafeBattery;
  node Lift;
  always abs(body.truth.at) <= END && battery.truth.left > 0;
}

system Two {
  a: Robot;
  b: Robot;
  always a.body.truth.at - b.body.truth.at < 11
    || a.battery.truth.left == 0 || b.battery.truth.left == 0;
}

test One {
  system Surveillance;
  horizon 350ms;
}

test Both {
  system Two;
  horizon 200ms;
}

test Low {
  system Surveillance;
  horizon 200ms;
  always battery.truth.left > FULL - 4;
}

test Near {
  system Two;
  horizon 200ms;
  always a.body.truth.at - b.body.truth.at < 6;
}
"""


@dataclass(frozen=True)
class Row:
    """Searches of one kind: `seconds` of each, the rest of the last; `ticks`: the horizon."""

    test: str
    ticks: int
    reduction: str
    strategy: str
    status: str
    states: int
    transitions: int
    seconds: tuple[float, ...]
    table: int
    frontier: int
    total: int
    steps: int

    @property
    def bytes_a_state(self) -> float:
        """Of table and frontier together."""
        return (self.table + self.frontier) / max(self.states, 1)


def search(test: str, ticks: int, how: str, strategy: str, runs: int, most: float) -> Row:
    """Searches that end at a limit of memory, or of time: `most` seconds."""
    system = system_of_test(check_file("robots.soter", PROGRAM), test)
    assert system.test is not None
    system = replace(system, test=replace(system.test, horizon_ns=ticks * TICK_NS))
    seconds = []
    outcome: Found | Searched
    for _ in range(runs):
        if how == APART:
            with Search(system, SearchOptions(memory=MEMORY, time=most)) as own:
                outcome = own.run()
        else:
            engine = Engine(system)
            settings = EngineSettings(reduction=how, strategy=strategy, memory=MEMORY)
            outcome = engine.explore(settings, None, most)
            engine.close()
        seconds.append(outcome.seconds)
        if outcome.stopped:
            break
    status = outcome.stopped or outcome.status
    return Row(
        test,
        ticks,
        how,
        strategy,
        status,
        outcome.states,
        outcome.transitions,
        tuple(seconds),
        outcome.table_bytes,
        outcome.frontier_bytes,
        outcome.total_bytes,
        len(outcome.steps),
    )


def missed(rows: list[Row]) -> int:
    """Prints the targets, and returns how many are missed."""
    count = 0
    for (test, ticks), most in TARGETS.items():
        own = next(r for r in rows if (r.test, r.ticks, r.reduction) == (test, ticks, APART))
        wanted = ENDS.get(test, "exhausted")
        shown = wanted == "exhausted" or own.steps > 0
        met = own.status == wanted and shown and median(own.seconds) <= most
        met = met and own.total <= MEMORY
        count += not met
        print(
            f"{test}, {ticks} ticks: {'met' if met else 'missed'} ({wanted}, <= {most:g} s, 2 GiB)"
        )
    large = [r for r in rows if r.states >= LARGE and r.strategy == "bfs"]
    worst = max(large, key=lambda r: r.bytes_a_state)
    met = worst.bytes_a_state <= BYTES
    print(
        f"bytes a state, breadth first, from {LARGE:,} states on: {'met' if met else 'missed'} "
        f"(at most {worst.bytes_a_state:.1f}, <= {BYTES:g})"
    )
    return count + (not met)


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
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="that a search may take")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--two-threads", action="store_true", help="beside one, and nothing else")
    parser.add_argument("--reductions", nargs="+", choices=methods.REDUCTIONS)
    arguments = parser.parse_args()
    if arguments.two_threads:
        return 1 if two_threads(arguments.runs, arguments.reductions) else 0
    methods.REDUCTIONS[BEFORE] = methods.REDUCTIONS["sleep"] | methods.REDUCTIONS["ample"]
    rows = [search(*asked, arguments.runs, arguments.seconds) for asked in ROWS]
    cells = [
        (
            f"{r.test}, {r.ticks} ticks",
            f"{r.strategy}, {r.reduction}",
            r.status,
            f"{r.states:,}",
            f"{r.transitions:,}",
            f"{median(r.seconds):.2f} s",
            f"{r.total / 1e6:,.1f} MB",
            f"{r.bytes_a_state:.1f} ({r.total / max(r.states, 1):.1f})",
            str(r.steps or ""),
        )
        for r in rows
    ]
    heads = (
        "program",
        "how",
        "ended",
        "states",
        "moves",
        "time",
        "memory",
        "B/state (all)",
        "steps",
    )
    print(table(heads, cells))
    count = missed(rows)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(r) for r in rows], indent=2) + "\n")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
