"""Seeded bugs in float programs: which strategies that sample find them, how soon, how short.

    .venv/bin/python bench/testing/falsify.py [--budget SECONDS] [--quick] [--only TEXT]
        [--strategies NAMES] [--seeds NUMBERS] [--shrink SECONDS] [--correct] [--json FILE]
    .venv/bin/python bench/testing/falsify.py --of FILE...

Per bug of `falsify_models.py` (whose sizes were fixed by directed schedules before any of
this was run), strategy and seed: the changed program is written beside copies of what it imports
and searched until something is violated or the budget is over. `unguided` is `falsify` with its
guide switched off: the same plans, all of them drawn anew. What is found is shrunk, for at most
`--shrink` seconds as `soter test` does, and replayed by the reference interpreter.

`seconds`: of CPU time of the search alone, as several searches may share a machine; the C is
compiled before. `steps`: of the trace as found, `shrunk`: after shrinking, the start aside; both
are compared with `known`, the shortest execution that is known: of the directed ones, or of all
that any strategy found here. `--correct`: the programs with bugs of size 0, in which nothing may
be found. `--of`: the table of what earlier calls wrote with `--json`, together.
Purpose: the figure of issue 11. Non-goals: bugs in programs that can be exhausted
(`mutants.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT,) if str(p) not in sys.path]

from bench.testing.falsify_directed import SIZES, written  # noqa: E402 - needs the path
from bench.testing.falsify_models import BUGS, Bug  # noqa: E402 - the same

import soter  # noqa: E402 - after the path
from soter.explore.engine.search import Search  # noqa: E402 - the same
from soter.explore.judge.replay import replay, violation_id_of  # noqa: E402 - the same
from soter.explore.methods import SAMPLING  # noqa: E402 - the same
from soter.explore.search_options import SearchOptions  # noqa: E402 - the same
from soter.explore.trace.allowed_steps import plan_of  # noqa: E402 - the same
from soter.explore.trace.trace import VIOLATION_KINDS, Trace  # noqa: E402 - the same
from soter.language.front_end import system_of_test  # noqa: E402 - the same

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.explore.engine.search import Found
    from soter.explore.search_options import SearchProgress
    from soter.language.model.system import System

UNGUIDED = "unguided"
STRATEGIES = ("falsify", UNGUIDED, *(s for s in SAMPLING if s != "falsify"))
SEEDS = "1,2,3"
BUDGET_S = 60.0
QUICK_S = 10.0
SHRINK_S = 15.0
TIMES_KNOWN = 3.0
MEMORY = 2**28
"""For counting configurations only."""


@dataclass
class Row:
    """One bug under one strategy from one seed. `steps` 0: it was not found."""

    bug: str
    strategy: str
    seed: int
    budget_s: float
    seconds: float = 0.0
    runs: int = 0
    steps: int = 0
    shrunk: int = 0


class _Clock:
    """Ends a search when its CPU time is over, as Ctrl-C does."""

    def __init__(self, budget_s: float) -> None:
        self._until = time.process_time() + budget_s
        self.searching = True

    def __call__(self, looked: SearchProgress) -> None:
        del looked
        if self.searching and time.process_time() > self._until:
            self.searching = False
            raise KeyboardInterrupt


def examine(system: System, name: str, row: Row, shrink_s: float) -> Row:
    """One search, entered in `row`."""
    guided = row.strategy != UNGUIDED
    options = SearchOptions(
        strategy=row.strategy if guided else "falsify",
        runs=2**62,
        memory=MEMORY,
        seed=row.seed,
        unguided=not guided,
    )
    began = time.process_time()
    clock = _Clock(row.budget_s)
    with Search(system, options, clock) as search:
        began = time.process_time()
        outcome = search.run()
        clock.searching = False
        row.seconds, row.runs = time.process_time() - began, outcome.runs
        if outcome.status != "violated":
            return row
        row.steps = len(outcome.steps) - 1
        smaller = search.shrunk(outcome, shrink_s) if shrink_s > 0 else outcome
        assert smaller is not None, f"{name}: what was found violates nothing"
        row.shrunk = len(smaller.steps) - 1
        assert replay(_trace(system, smaller, row.seed), system).reproduced, name
    return row


def _trace(system: System, outcome: Found, seed: int) -> Trace:
    assert outcome.broken is not None
    what, index = outcome.broken
    broken = violation_id_of(system, VIOLATION_KINDS[what], index)
    assert broken is not None
    plan = plan_of(system)
    return Trace(
        program="bug.soter",
        sha256=system.program.sha256,
        system=system.name,
        test=plan.name,
        params={},
        seed=seed,
        skew_ns=plan.skew_ns,
        horizon_ns=plan.horizon_ns,
        broken=broken,
        steps=outcome.steps,
        minimal=False,
    )


def system_of(bug: Bug, size: float) -> System:
    """The flattened test of a bug of some size."""
    with tempfile.TemporaryDirectory() as folder:
        program = soter.load(written(bug, size, Path(folder)))
        return system_of_test(program._checked, "Bug", {})  # noqa: SLF001 - without its report


def rows_of(args: argparse.Namespace) -> Iterator[Row]:
    """What was asked for, one search after the other."""
    sizes = json.loads(SIZES.read_text(encoding="utf-8"))
    for bug in BUGS:
        if args.only not in bug.name:
            continue
        if bug.name not in sizes:
            print(f"{bug.name:<42} has no size yet: bench/testing/falsify_directed.py")
            continue
        system = system_of(bug, 0.0 if args.correct else sizes[bug.name]["size"])
        for strategy in args.strategies.split(","):
            for seed in args.seeds.split(","):
                row = Row(bug.name, strategy, int(seed), args.budget)
                yield examine(system, bug.name, row, args.shrink)


def shortest_known(rows: Sequence[Row]) -> dict[str, int]:
    """Per bug, steps of the shortest execution: directed, or found by anybody."""
    sizes = json.loads(SIZES.read_text(encoding="utf-8"))
    return {
        name: min(
            [s["directed_steps"]] + [r.shrunk or r.steps for r in rows if r.bug == name and r.steps]
        )
        for name, s in sizes.items()
    }


def table(rows: Sequence[Row]) -> list[str]:
    """Per strategy and seed: how many were found, in which time, how many of them short enough."""
    known, lines = shortest_known(rows), []
    for strategy in dict.fromkeys(r.strategy for r in rows):
        for seed in sorted({r.seed for r in rows if r.strategy == strategy}):
            own = [r for r in rows if (r.strategy, r.seed) == (strategy, seed)]
            hits = [r for r in own if r.steps]
            short = [r for r in hits if r.shrunk <= TIMES_KNOWN * known[r.bug]]
            times = [r.shrunk / known[r.bug] for r in hits]
            seconds = [r.seconds for r in hits]
            said = f"{strategy:<9} seed {seed}  found {len(hits):>2} of {len(own)}"
            if hits:
                said += (
                    f"  median {median(seconds):5.1f} s, at most {max(seconds):5.1f} s"
                    f"  {len(short)} within {TIMES_KNOWN:g} x known, at most {max(times):.2f} x"
                )
            missed = [r.bug for r in own if not r.steps]
            lines.append(said)
            if missed and len(hits) * 2 > len(own):
                lines.append(f"          not {'; '.join(missed)}")
    return lines


def main(argv: list[str] | None = None) -> int:
    """Print the table; 0 if `falsify` found 18 of 20, or nothing where nothing is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--budget", type=float, default=BUDGET_S, help="CPU seconds of a search")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_S:g} s each")
    parser.add_argument("--only", default="", help="programs and kinds of bugs with this text")
    parser.add_argument("--strategies", default=",".join(STRATEGIES))
    parser.add_argument("--seeds", default=SEEDS)
    parser.add_argument("--shrink", type=float, default=SHRINK_S, help="seconds; 0: do not")
    parser.add_argument("--correct", action="store_true", help="bugs of size 0")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--of", type=Path, nargs="+", help="only the table of these")
    args = parser.parse_args(argv)
    args.budget = QUICK_S if args.quick else args.budget
    began = time.perf_counter()
    rows: list[Row] = []
    for path in args.of or ():
        rows += [Row(**r) for r in json.loads(path.read_text(encoding="utf-8"))]
    for row in () if args.of else rows_of(args):
        rows.append(row)
        told = f"{row.steps:>6,} steps, shrunk {row.shrunk:>6,}" if row.steps else "not found"
        print(
            f"{row.bug:<42} {row.strategy:<9} {row.seed} {row.seconds:6.1f} s "
            f"{row.runs:>9,} runs  {told}",
            flush=True,
        )
        if args.json:
            text = json.dumps([asdict(r) for r in rows], indent=1)
            args.json.write_text(text + "\n", encoding="utf-8")
    print("\n".join(table(rows)))
    print(f"{time.perf_counter() - began:.0f} s")
    hits = [r.steps > 0 for r in rows if r.strategy == "falsify"]
    return int(any(hits) if args.correct else 10 * sum(hits) < 9 * len(hits))


if __name__ == "__main__":
    sys.exit(main())
