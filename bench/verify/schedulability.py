"""The analysis of a thread against executions of it, on random sets of tasks.

    .venv/bin/python bench/verify/schedulability.py [--sets 10000] [--executions 6] [--blind]

Purpose: sets that keep the thread busy for 60 to 100 % of the time. Of a set that is accepted no
execution may miss a deadline: the one in which all is as late and as long as it may be, and random
ones, tick by tick over all first releases and two hyperperiods. Of a set that is refused the
instance that comes with it is replayed, and has to miss there. The simulator
(`tests/generators/simulated_thread.py`) knows the model only. Exit code 1 where a figure misses its
target. `--blind` hides something from the analysis, to show that the comparison sees it.
Non-goals: times of day; whether the model is that of a machine (docs/timing.md).
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from generators.simulated_thread import Job, at_worst, busy, drawn, simulate, turn  # noqa: E402 - as above
from soter.timing.trusted_thread import Analysis, Task, analyse_thread  # noqa: E402 - needs the path

LOW, HIGH = 0.6, 1.0
BANDS = ((0.6, 0.7), (0.7, 0.8), (0.8, 0.9), (0.9, 1.01))
HIDDEN = {
    "nothing": lambda t: t,
    "jitter": lambda t: replace(t, jitter=0),
    "one tick": lambda t: replace(t, wcet=max(0, t.wcet - 1)),
    "phases": lambda t: replace(t, phase=0),
    "deadlines": lambda t: replace(t, deadline=t.period),
}
"""What the analysis is not told of."""
Counts = Counter[tuple[str, str]]
"""What is counted, and the band of utilisation."""


def drawn_between(rng: random.Random) -> list[Job]:
    """A set whose utilisation, after rounding to ticks, is from 60 to 100 %."""
    while True:
        jobs = drawn(rng, rng.uniform(LOW, HIGH))
        if LOW <= busy(jobs) <= HIGH:
            return jobs


def analysed(jobs: list[Job], hidden: str) -> Analysis:
    """What Soter says of a set."""
    tasks = [Task(str(k), j.every, j.offset, j.cost, j.hold, j.due) for k, j in enumerate(jobs)]
    return analyse_thread([HIDDEN[hidden](t) for t in tasks])


def misses(rng: random.Random, jobs: list[Job], executions: int) -> bool:
    """Whether any execution that is tried misses a deadline."""
    ticks = max(j.offset for j in jobs) + 2 * turn(jobs)
    if at_worst(jobs, ticks):
        return True
    for _ in range(executions):
        share = rng.random()

        def held(k: int, _: int, share: float = share) -> int:
            return jobs[k].hold if rng.random() < share else rng.randint(0, jobs[k].hold)

        def lasts(k: int, _: int, share: float = share) -> int:
            return jobs[k].cost if rng.random() < share else rng.randint(0, jobs[k].cost)

        if simulate(jobs, ticks, held, lasts):
            return True
    return False


def run(sets: int, executions: int, hidden: str) -> Counts:
    """Counts: of sets, refused, accepted that miss, refused without an instance, by band."""
    rng = random.Random(20261122)  # noqa: S311 - schedules, not secrets
    counts: Counts = Counter()
    for _ in range(sets):
        jobs = drawn_between(rng)
        band = next(f"{lo:.1f}" for lo, hi in BANDS if lo <= busy(jobs) < hi)
        counts["sets", band] += 1
        said = analysed(jobs, hidden)
        if said.miss is None:
            wrong = misses(rng, jobs, executions)
            counts["accepted, missed", band] += wrong
            continue
        counts["refused", band] += 1
        s = said.miss.step
        late = at_worst(jobs, s.end + 1)
        replayed = (s.task, s.number, s.end) in late
        counts["instances replayed", band] += replayed
    return counts


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--sets", type=int, default=10_000)
    parser.add_argument("--executions", type=int, default=6)
    parser.add_argument("--blind", action="store_true", help="hide something from the analysis")
    args = parser.parse_args()
    began = time.process_time()
    if args.blind:
        return blind(args.sets, args.executions)
    counts = run(args.sets, args.executions, "nothing")
    words = ("sets", "refused", "accepted, missed", "instances replayed")
    print("| utilisation | sets | refused | accepted, and one misses | refused, instance misses |")
    print("|---|---|---|---|---|")
    total: Counter[str] = Counter()
    for low, high in BANDS:
        row = {w: counts[w, f"{low:.1f}"] for w in words}
        total.update(row)
        print(f"| {low:.1f} to {min(high, 1.0):.1f} | {_cells(row, words)} |")
    print(f"| all | {_cells(total, words)} |")
    share = 100 * total["refused"] / total["sets"]
    there = 100 * total["instances replayed"] / max(1, total["refused"])
    print(
        f"refused {share:.1f}% (target 20 to 80); accepted that miss {total[words[2]]} (target 0);"
    )
    print(f"refused with an instance that misses {there:.2f}% (target 99 or more)")
    print(f"{args.executions + 1} executions of each accepted set; ", end="")
    print(f"{time.process_time() - began:.0f} s of CPU time")
    good = 20 <= share <= 80 and total[words[2]] == 0 and there >= 99
    return 0 if good else 1


def _cells(row: dict[str, int] | Counter[str], words: tuple[str, ...]) -> str:
    return " | ".join(f"{row[w]:,}" for w in words)


def blind(sets: int, executions: int) -> int:
    """What each hidden thing does: sets accepted that miss, and instances that do not."""
    print("hidden from the analysis   accepted, and one misses   refused, instance does not")
    seen = True
    for hidden in HIDDEN:
        counts = run(sets, executions, hidden)
        bands = [f"{low:.1f}" for low, _ in BANDS]
        wrong = sum(counts["accepted, missed", b] for b in bands)
        gone = sum(counts["refused", b] - counts["instances replayed", b] for b in bands)
        print(f"{hidden:<26} {wrong:>24,} {gone:>28,}")
        seen &= (wrong + gone > 0) == (hidden != "nothing")
    return 0 if seen else 1


if __name__ == "__main__":
    sys.exit(main())
