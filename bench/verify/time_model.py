"""The model of time against every schedule of random small systems.

    .venv/bin/python bench/verify/time_model.py [--systems 5000] [--blind NAME|all]

Purpose: for each system of `tests/generators/schedule_systems.py` every quantity that a proof takes
from `soter.verify.problem.schedule` (ages, start of SC, j, d, H*, h_0, T_dec, the look ahead) is
compared with the largest value over all schedules on the grid of times. *Exceeded*: some schedule
does worse than the model says, the model is wrong, and the first such schedule is printed.
*Reached*: some schedule does exactly that, no smaller figure would be sound. *In the limit*: short
of it by units of the grid, however fine the grid is.
`--blind` shows that the comparison is no paper tiger: the model is told of less than there is, or
leaves a term out, and each time the quantities that depend on it must be seen to be exceeded.
Non-goals: whether the definitions are those of the generated programs.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable  # noqa: TC003 - a table is declared with it
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from generators.every_schedule import QUANTITIES  # noqa: E402 - needs the path
from generators.schedule_systems import (  # noqa: E402 - needs the path
    Compared,
    System,
    compare,
    in_the_limit,
    said,
    system,
)

if TYPE_CHECKING:
    from soter.verify.problem.schedule import ActuationPath, Releases, Schedule
    from soter.verify.problem.schedule import SensorPath as Way

SYMBOLS = {
    "age_dm": "A",
    "age_sc": "A_sc",
    "stamp_age_sc": "stamp at SC (R011)",
    "latest_start_of_sc": "start of SC",
    "h_star": "H*",
    "delay": "d",
    "jitter": "j",
    "start": "h_0",
    "longest_to_decision": "T_dec",
    "longest_between_states": "look ahead",
    "published_age": "P",
    "available_from": "F",
}
Told = dict[str, int | None]


@dataclass
class Row:
    """One quantity over all systems."""

    systems: int = 0
    exceeded: int = 0
    reached: int = 0
    in_the_limit: int = 0
    slacks: list[int] = field(default_factory=list)

    def add(self, comparison: Compared, *, in_the_limit: bool) -> None:
        """Count one system; what nothing can ever read or do there is left out."""
        if comparison.slack is None:
            return
        self.systems += 1
        self.exceeded += comparison.slack < 0
        self.reached += comparison.slack == 0
        self.in_the_limit += in_the_limit
        self.slacks.append(comparison.slack)

    def summary(self) -> dict[str, float]:
        """The row as figures."""
        return {
            "systems": self.systems,
            "exceeded": self.exceeded,
            "reached": self.reached,
            "in_the_limit": self.in_the_limit,
            "least_slack": min(self.slacks, default=0),
            "median_slack": statistics.median(self.slacks) if self.slacks else 0,
            "greatest_slack": max(self.slacks, default=0),
        }


def told_of(change: Callable[[Schedule], Schedule]) -> Callable[[Schedule], Told]:
    """What the model says about a system of which it is not told everything."""
    return lambda s: {q: said(change(s), q) for q in QUANTITIES}


def without(quantity: str, term: Callable[[Schedule], int]) -> Callable[[Schedule], Told]:
    """What the model says, one quantity without a term of it."""

    def tell(s: Schedule) -> Told:
        told = {q: said(s, q) for q in QUANTITIES}
        told[quantity] = (told[quantity] or 0) - term(s)
        return told

    return tell


def _prompt(x: Releases) -> Releases:
    return replace(x, late=0)


def _at_once(x: Releases) -> Releases:
    return replace(x, response=0)


def _from_zero(x: Releases) -> Releases:
    return replace(x, phase=0)


def _every(change: Callable[[Releases], Releases]) -> Callable[[Schedule], Schedule]:
    """The same change of everybody's releases."""

    def path(x: Way) -> Way:
        return replace(x, sensor=change(x.sensor), nodes=tuple(map(change, x.nodes)))

    def output(x: ActuationPath) -> ActuationPath:
        return replace(x, nodes=tuple(map(change, x.nodes)))

    return lambda s: replace(
        s,
        dm=change(s.dm),
        sc=change(s.sc),
        read_by_dm=tuple(map(path, s.read_by_dm)),
        read_by_sc=tuple(map(path, s.read_by_sc)),
        outputs=tuple(map(output, s.outputs)),
    )


def _no_path(s: Schedule) -> Schedule:
    return replace(
        s,
        read_by_dm=tuple(replace(p, nodes=()) for p in s.read_by_dm),
        read_by_sc=tuple(replace(p, nodes=()) for p in s.read_by_sc),
    )


BLIND: dict[str, tuple[Callable[[Schedule], Told], tuple[str, ...]]] = {
    "wait for DM": (
        told_of(lambda s: replace(s, dm=_at_once(_prompt(s.dm)))),
        ("latest_start_of_sc", "jitter", "delay", "start", "h_star"),
    ),
    "path": (
        told_of(_no_path),
        ("age_dm", "age_sc", "stamp_age_sc", "delay", "start", "h_star", "longest_to_decision"),
    ),
    "lateness": (told_of(_every(_prompt)), tuple(q for q in QUANTITIES if q != "stamp_age_sc")),
    "response": (
        told_of(_every(_at_once)),
        (
            "age_dm",
            "age_sc",
            "latest_start_of_sc",
            "h_star",
            "delay",
            "jitter",
            "start",
            "longest_to_decision",
        ),
    ),
    "phases": (told_of(_every(_from_zero)), ("age_dm", "delay", "jitter", "start", "h_star")),
    "latency": (
        told_of(lambda s: replace(s, outputs=tuple(replace(o, most=o.least) for o in s.outputs))),
        ("h_star", "delay", "jitter", "start"),
    ),
    "nodes after SC": (
        told_of(lambda s: replace(s, outputs=tuple(replace(o, nodes=()) for o in s.outputs))),
        ("h_star", "delay", "jitter", "start"),
    ),
    "other outputs": (
        told_of(lambda s: replace(s, outputs=s.outputs[:1])),
        ("h_star", "delay", "jitter", "start"),
    ),
    "other paths": (
        told_of(lambda s: replace(s, read_by_dm=s.read_by_dm[:1], read_by_sc=s.read_by_sc[:1])),
        ("age_dm", "age_sc", "stamp_age_sc", "delay", "start", "h_star"),
    ),
    "silence": (
        told_of(lambda s: replace(s, dropout=0)),
        ("age_dm", "age_sc", "delay", "start"),
    ),
    "next verdict in H*": (without("h_star", lambda s: s.dm.period), ("h_star",)),
    "start of SC in H*": (without("h_star", lambda s: s.latest_start_of_sc), ("h_star",)),
    "one unit": (
        lambda s: {q: (said(s, q) or 0) - 1 for q in QUANTITIES},
        tuple(q for q in QUANTITIES if q != "longest_to_decision"),
    ),
}
"""What is hidden from the model, and the quantities that must then be exceeded by some system."""


def timeline(comparison: Compared, drawn: System) -> str:
    """A counterexample: the system, the figures, and the schedule."""
    name = f"{SYMBOLS[comparison.quantity]} ({comparison.quantity})"
    lines = [
        f"system {drawn.number}: {drawn.schedule}",
        f"{name}: the model says {comparison.says}, this schedule reaches {comparison.reached}:",
    ]
    lines += [f"    {at:5}  {what}" for at, what in dict.fromkeys(comparison.why)]
    return "\n".join(lines)


def verify(numbers: range) -> tuple[dict[str, Row], list[str]]:
    """Compare all systems: a row for each quantity, and the first counterexample of each."""
    rows = {q: Row() for q in QUANTITIES}
    shown: dict[str, str] = {}
    for number in numbers:
        drawn = system(number)
        compared = compare(drawn.schedule)
        limit = in_the_limit(drawn.schedule, compared)
        for comparison in compared:
            rows[comparison.quantity].add(comparison, in_the_limit=comparison.quantity in limit)
            if (
                comparison.slack is not None
                and comparison.slack < 0
                and comparison.quantity not in shown
            ):
                shown[comparison.quantity] = timeline(comparison, drawn)
        if (number + 1 - numbers.start) % 500 == 0:
            print(f"{number + 1 - numbers.start} of {len(numbers)}", file=sys.stderr, flush=True)
    return rows, list(shown.values())


def blinded(numbers: range, names: list[str]) -> int:
    """Compare figures that are wrong on purpose; 1 if one of them is not seen."""
    missed = 0
    print(f"{'hidden from the model':24} quantity: systems in which it is exceeded")
    for name in names:
        tell, expected = BLIND[name]
        counts = dict.fromkeys(QUANTITIES, 0)
        first = ""
        for number in numbers:
            drawn = system(number)
            for comparison in compare(drawn.schedule, tell(drawn.schedule)):
                if comparison.slack is not None and comparison.slack < 0:
                    counts[comparison.quantity] += 1
                    first = first or timeline(comparison, drawn)
        seen = ", ".join(f"{SYMBOLS[q]} {n}" for q, n in counts.items() if n)
        unseen = [SYMBOLS[q] for q in expected if not counts[q]]
        print(f"{name:24} {seen}{'; NOT SEEN: ' + ', '.join(unseen) if unseen else ''}", flush=True)
        if len(names) == 1:
            print(first)
        missed += bool(unseen)
    return 1 if missed else 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", type=int, default=5000)
    parser.add_argument("--first", type=int, default=0, help="number of the first system")
    parser.add_argument("--blind", choices=[*BLIND, "all"], help="there must be counterexamples")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.systems)
    if arguments.blind:
        return blinded(numbers, list(BLIND) if arguments.blind == "all" else [arguments.blind])
    began = time.process_time()
    rows, shown = verify(numbers)
    print("| quantity | systems | exceeded | reached | in the limit | slack least, median, most |")
    print("|---|---|---|---|---|---|")
    summary = {q: row.summary() for q, row in rows.items()}
    for q, x in summary.items():
        slack = f"{x['least_slack']}, {x['median_slack']:g}, {x['greatest_slack']}"
        counts = f"{x['systems']} | {x['exceeded']} | {x['reached']} | {x['in_the_limit']}"
        print(f"| {SYMBOLS[q]} | {counts} | {slack} |")
    print(f"{len(numbers)} systems, {time.process_time() - began:.0f} s of CPU time")
    print(*shown, sep="\n\n")
    return 1 if shown else 0


if __name__ == "__main__":
    sys.exit(main())
