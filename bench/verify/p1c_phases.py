"""P1c of a deployed module against all executions of its thread, on random small cases.

    .venv/bin/python bench/verify/p1c_phases.py [--cases 20000] [--blind]

Purpose: for each case a program is written, checked and flattened, and what H must be as `soter
check` says it is compared with the longest switch: from the state behind the last "AC" to the
effect of SC's first output, over all delays of releases, lengths of steps, ages of what is read and
every release of the DM, for the case's phases (`tests/generators/switch_threads.py`, which has no
formula in it). *Exceeded*: an execution takes longer than Soter says. *Slack*: what Soter says less
the longest. *Undecided* are threads with more work than time: Soter knows that they miss, and the
executions, four hyperperiods of them, do not see it yet. Exit code 1 where a figure misses its
target. `--blind` adds something to the case that the program does not say, to show that the
comparison sees it.
Non-goals: nodes before and behind the module (`bench/verify/time_model.py`).
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from generators.switch_threads import TICK_NS, Case, drawn, longest, program  # noqa: E402 - as above
from soter.language.front_end import check_file, system_to_prove  # noqa: E402 - needs the path
from soter.verify.problem.switch_latency import switch_latency_of  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from collections.abc import Callable


def _longer(place: int) -> Callable[[Case], Case]:
    """The step at a place takes a tick more than the program says."""

    def change(case: Case) -> Case:
        thread = list(case.thread)
        if place < len(thread):
            thread[place] = replace(thread[place], cost=thread[place].cost + 1)
        return replace(case, thread=tuple(thread))

    return change


BLIND: dict[str, Callable[[Case], Case]] = {
    "nothing": lambda case: case,
    "a longer decision": _longer(0),
    "a longer step of SC": _longer(1),
    "a longer step of another": _longer(2),
    "a late release of the DM": lambda case: replace(
        case,
        thread=(replace(case.thread[0], hold=case.thread[0].hold + 1), *case.thread[1:]),
    ),
    "an older read": lambda case: replace(case, age=case.age + case.sensor),
    "a slower actuator": lambda case: replace(case, acts=case.acts + 1),
}


def needed(case: Case) -> int | None:
    """What Soter says that H must be, in ticks; None where it says nothing."""
    checked = check_file("case.soter", program(case))
    if not checked.ok:
        raise SystemExit(f"{checked.diagnostics.items}\n{program(case)}")
    flat = system_to_prove(checked, "S")
    horizon_ns = switch_latency_of(flat, flat.modules[0]).needed
    assert horizon_ns is None or horizon_ns % TICK_NS == 0
    return None if horizon_ns is None else horizon_ns // TICK_NS


def slacks(cases: int, change: Callable[[Case], Case]) -> tuple[list[int], Counter[str]]:
    """Of each case the slack in ticks, and of how many there is none, by reason."""
    rng = random.Random(20261122)  # noqa: S311 - schedules, not secrets
    slack_ticks: list[int] = []
    without: Counter[str] = Counter()
    while len(slack_ticks) < cases:
        case = drawn(rng)
        worst = longest(change(case))
        if worst is None:
            without["misses a deadline"] += 1
            continue
        said = needed(case)
        if said is None:
            without["undecided"] += 1
            continue
        slack_ticks.append(said - worst)
    return slack_ticks, without


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--blind", action="store_true", help="change what the program does not say")
    args = parser.parse_args()
    began = time.process_time()
    if args.blind:
        return blind(args.cases)
    slack_ticks, without = slacks(args.cases, BLIND["nothing"])
    exceeded = sum(s < 0 for s in slack_ticks)
    print(f"{len(slack_ticks):,} cases, {exceeded} exceeded (target 0)")
    print(
        f"slack in ticks: least {min(slack_ticks)} (target 0), median "
        f"{statistics.median(slack_ticks):g}, "
    )
    print(
        f"most {max(slack_ticks)}; none in "
        f"{100 * slack_ticks.count(0) / len(slack_ticks):.1f}% of the cases"
    )
    left_out = ", ".join(f"{n:,} {why}" for why, n in without.items())
    print(f"drawn beside these: {left_out}")
    print(f"{time.process_time() - began:.0f} s of CPU time")
    return 0 if exceeded == 0 and min(slack_ticks) == 0 else 1


def blind(cases: int) -> int:
    """In how many cases each change is seen as a switch that takes too long."""
    seen = True
    print("in the executions only      exceeded")
    for name, change in BLIND.items():
        slack_ticks, _ = slacks(cases, change)
        exceeded = sum(s < 0 for s in slack_ticks)
        print(f"{name:<27} {exceeded:,} of {len(slack_ticks):,}")
        seen &= (exceeded > 0) == (name != "nothing")
    return 0 if seen else 1


if __name__ == "__main__":
    sys.exit(main())
