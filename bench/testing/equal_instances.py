"""What equal instances are worth: 2, 3 and 4 robots that share a passage, told apart or not.

    .venv/bin/python bench/testing/equal_instances.py [--runs 3] [--ticks 3] [--json FILE]

Each robot has a body, a battery, and a pilot that decides for itself whether to go on; a guard
reads all of them, between their steps, and closes the passage while two are in it. `apart` is
`soter test --reduction parts`: all reductions, but robots are told apart; `equal` is `soter test`.
Times are medians.

Purpose: the figure of issue 11 about symmetric instances. Non-goals: verdicts (tests/correct).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from math import factorial
from pathlib import Path
from statistics import median

from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.report.terminal_tables import table

MEMORY = 2 << 30
COUNTS = (2, 3, 4)
WAYS = {"apart": "parts", "equal": "all"}

PROGRAM = """soter 1;

type Cell = int in [0, 5];
type Charge = int in [0, 9];

topic cell: Cell;
topic move: bool;
topic charge: Charge = 9;
input topic shut: bool;
topic closed: bool;
{inputs}

plant Body period 10ms {{
  reads move;
  drives cell = at;
  state at: Cell;
  next at = move ? (at == 5 ? 0 : at + 1) : at;
}}

plant Battery period 10ms {{
  reads move;
  drives charge = left;
  state left: Charge = 9;
  next left = move ? max(left - 1, 0) : min(left + 1, 9);
}}

node Pilot period 10ms {{
  subscribes cell, charge, shut;
  publishes move;
  step {{ publish move = shut || charge < 2 ? false : choose bool; }}
}}

node Guard period 10ms phase 5ms {{
  subscribes {names};
  publishes closed;
  step {{ publish closed = {full}; }}
}}

system Robot {{ body: Body; battery: Battery; node Pilot; }}

system Fleet default {{
  guard: Guard {{ {wires} }};
  for i in 0..{count} {{
    r[i]: Robot {{ shut = closed }};
    always r[i].battery.truth.left > 0;
  }}
}}

test Passage {{ system Fleet; horizon {horizon}ms; }}
"""


@dataclass(frozen=True)
class Row:
    """Searches of one kind: `seconds` of each, the rest of the last."""

    robots: int
    actors: int
    how: str
    status: str
    states: int
    transitions: int
    seconds: tuple[float, ...]
    total: int
    equal: tuple[tuple[str, ...], ...]


def program(count: int, ticks: int) -> str:
    """So many robots for so long."""
    names = [f"in{k}" for k in range(count)]
    inside = [f"({n} >= 3 && {n} <= 4)" for n in names]
    pairs = [f"({a} && {b})" for k, a in enumerate(inside) for b in inside[k + 1 :]]
    return PROGRAM.format(
        inputs="\n".join(f"input topic {n}: Cell;" for n in names),
        names=", ".join(names),
        full=" || ".join(pairs),
        wires=", ".join(f"{n} = r[{k}].cell" for k, n in enumerate(names)),
        count=count,
        horizon=10 * ticks,
    )


def search(count: int, ticks: int, how: str, runs: int) -> Row:
    """Searches as `soter test` makes them."""
    system = system_of_test(check_file("fleet.soter", program(count, ticks)), "Passage")
    seconds = []
    for _ in range(runs):
        with Search(system, SearchOptions(reduction=WAYS[how], memory=MEMORY)) as own:
            outcome, equal = own.run(), own.equal
        seconds.append(outcome.seconds)
    return Row(
        count,
        len(system.components) + len(system.inputs),
        how,
        outcome.status,
        outcome.states,
        outcome.transitions,
        tuple(seconds),
        outcome.total_bytes,
        equal,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--ticks", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = [search(n, arguments.ticks, w, arguments.runs) for n in COUNTS for w in WAYS]
    cells, bad = [], 0
    for apart, equal in zip(rows[::2], rows[1::2], strict=True):
        same = apart.status == equal.status and len(equal.equal) == 1
        bad += not same or len(equal.equal[0]) != equal.robots
        for r in (apart, equal):
            fewer = f"{apart.states / r.states:.2f} of {factorial(r.robots)}"
            cells.append(
                (
                    f"{r.robots} robots, {r.actors} actors",
                    r.how,
                    r.status,
                    f"{r.states:,}",
                    f"{r.transitions:,}",
                    f"{median(r.seconds):.2f} s",
                    f"{r.total / 1e6:,.1f} MB",
                    "" if r is apart else fewer,
                    "" if r is apart else f"{median(apart.seconds) / median(r.seconds):.1f}",
                )
            )
    heads = ("program", "robots", "ended", "states", "moves", "time", "memory", "fewer", "faster")
    print(table(heads, cells))
    print(f"{arguments.ticks} ticks; verdicts that differ, or robots not seen as equal: {bad}")
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(r) for r in rows], indent=2) + "\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
