"""How large a system `soter test` can exhaust: one robot, and two in one airspace.

    .venv/bin/python bench/testing/size.py [--runs 3] [--seconds 60] [--json FILE]

*One*: the surveillance of one robot (11 actors, 35 ticks of 10 ms): a body and a battery, a
mission, a planner, modules for the geofence and the battery, a lift. *Both*: two of them without
a mission, in one airspace (20 actors, 20 ticks), which must not be too far apart while their
batteries last. *Near* asks for more than they keep: it is violated, and the time is the one until
there is an execution of the whole. `apart` is what `soter test` does, parts of the system alone;
the other reductions search all of it: `before` is sleep and ample sets, `all` ends of instants by
groups, too. Times are medians. Bytes are those of table and frontier when most was taken, a state
(and of all that is kept); a search of a few thousand states has the first tables to bear.

Purpose: the figures of size of issue 11.
Non-goals: verdicts (tests/correct), threads (two_threads.py).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from soter.explore import methods
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

if TYPE_CHECKING:
    from soter.explore.engine.explorer_library import Searched
    from soter.explore.engine.search import Found

BEFORE = "before"
APART = "apart"
MEMORY = 2 << 30
TICK_NS = 10_000_000
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


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="that a search may take")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
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
