"""Plans in the authors' city: how many a corridor covers, how fast, and that no wrong one counts.

    .venv/bin/python bench/drone/plans.py [--plans 10000] [--seed 1]

Purpose: 10,000 plans by RRT* (the real OMPL), 10,000 by the roadmap and 10,000 by RRT* with bugs
put in. `CoverFor` of examples/drone/cover.soter is called as it is compiled; every corridor that
it accepts is judged by the exact referee of tests/generators/drone_corridors.py, on fractions, ends
of the request included.
Non-goals: flying them.

Starts and goals are drawn evenly from the inner room, where an aim may be, both in the same piece
of it: between pieces there is no corridor to be found.
"""

from __future__ import annotations

import argparse
import importlib
import random
import statistics
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
DRONE = ROOT / "examples" / "drone"
sys.path[:0] = [str(p) for p in (ROOT / "tests", DRONE) if str(p) not in sys.path]

from generators.drone_corridors import fault_of, room, written  # noqa: E402 - needs the path
from generators.drone_covering import Covered, Onboard  # noqa: E402 - the same
from soter.report.tables import table  # noqa: E402 - the same

if TYPE_CHECKING:
    from generators.drone_covering import Plan

    Point = tuple[float, float, float]
    Ends = tuple[Point, Point]

RRT: Any = importlib.import_module("rrt_star")
SLOWEST_MS = 50.0  # the target: a corridor in at most so long


@dataclass
class Tally:
    """What became of the plans of one kind."""

    name: str
    verdicts: Counter[str] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)
    boxes: list[int] = field(default_factory=list)
    planning: list[float] = field(default_factory=list)
    missing: int = 0
    wrong: Counter[str] = field(default_factory=Counter)

    @property
    def plans(self) -> int:
        """How many there were."""
        return sum(self.verdicts.values())

    @property
    def accepted(self) -> int:
        """Of those."""
        return self.verdicts["Covered"]

    def row(self) -> list[str]:
        """A line of the table."""
        share = 100.0 * self.accepted / max(self.plans, 1)
        middle = statistics.median(self.seconds) * 1e6 if self.seconds else 0.0
        most = max(self.seconds, default=0.0) * 1e6
        planning = statistics.median(self.planning) * 1e3 if self.planning else 0.0
        mean = statistics.mean(self.boxes) if self.boxes else 0.0
        return [
            self.name,
            f"{self.plans}",
            f"{self.missing}",
            f"{self.accepted}",
            f"{share:.2f} %",
            f"{self.wrong.total()}",
            f"{mean:.1f}",
            f"{max(self.boxes, default=0)}",
            f"{middle:.1f}",
            f"{most:.0f}",
            f"{planning:.2f}",
        ]


HEAD = [
    "plans",
    "made",
    "none found",
    "accepted",
    "",
    "wrong",
    "boxes",
    "most",
    "Cover, us",
    "most",
    "planner, ms",
]


def strayed(ends: Ends, answer: Covered) -> str:
    """Whether the ends that were asked for lie outside of the first or the last box."""
    for p, box in zip(ends, (answer.boxes[0], answer.boxes[-1]), strict=True):
        if any(not box[k] <= p[k] <= box[3 + k] for k in range(3)):
            return "the corridor is one for other ends"
    return ""


class City:
    """The city: where plans begin and end, and the two judges of them."""

    def __init__(self, work: Path, seed: int) -> None:
        self.onboard = Onboard(DRONE, work)
        known = self.onboard.constants
        x, y, z = known["CLEARANCE"]
        self.clearance: Point = (x, y, z)
        a, b, c = (written(m) for m in known["MARGIN"])
        self.margin = (a, b, c)
        self.exact = room(known["city.RADIUS"], known["city.CEILING"])
        self.inner = RRT.room(self.clearance)
        self.random = random.Random(seed)  # noqa: S311 - draws, not secrets

    def ends(self, count: int) -> list[Ends]:
        """Pairs of points that some corridor joins."""
        ends: list[Ends] = []
        while len(ends) < count:
            pairs = [(self._point(), self._point()) for _ in range(count)]
            ends += [
                e for e, r in zip(pairs, self.onboard.route(pairs), strict=True) if len(r.plan)
            ]
        return ends[:count]

    def _point(self) -> Point:
        low, high = self.inner.low, self.inner.high
        while True:
            x, y, z = (self.random.uniform(a, b) for a, b in zip(low, high, strict=True))
            if self.inner.free((x, y, z)):
                return (x, y, z)

    def judge(self, tally: Tally, asked: list[Ends], plans: list[Plan]) -> None:
        """Cover every plan, and hold what is accepted against the exact referee."""
        for ends, plan, answer in zip(asked, plans, self.onboard.cover(plans, asked), strict=True):
            tally.seconds.append(answer.seconds)
            tally.verdicts[answer.verdict] += 1
            if answer.verdict == "Covered":
                tally.boxes.append(len(answer.boxes))
                self._referee(tally, ends, plan, answer)

    def _referee(self, tally: Tally, ends: Ends, plan: Plan, answer: Covered) -> None:
        fault = fault_of(self.exact, self.margin, plan, answer.boxes) or strayed(ends, answer)
        if fault:
            tally.wrong[fault] += 1


def by_roadmap(city: City, asked: list[Ends]) -> Tally:
    """Ways of the safe planner."""
    tally = Tally("roadmap")
    routes = city.onboard.route(asked)
    tally.planning = [r.seconds for r in routes]
    city.judge(tally, asked, [r.plan.tolist() for r in routes])
    return tally


def by_rrt_star(city: City, count: int, bug: str, first: int) -> Tally:
    """So many plans of RRT* with a bug, or `Unbroken`; requests without a plan are counted."""
    tally = Tally(f"RRT*, {bug}" if bug != "Unbroken" else "RRT*")
    planner = RRT.RRTStar()
    kept: list[Ends] = []
    plans: list[Plan] = []
    number = first
    while len(plans) < count:
        for ends in city.ends(min(count - len(plans), 1000)):
            planner.answered = number
            number += 1
            started = time.thread_time()
            plan = planner.plan(*ends, city.clearance, bug)
            tally.planning.append(time.thread_time() - started)
            if plan is None or len(plan) > city.onboard.points:
                tally.missing += 1
            else:
                kept.append(ends)
                plans.append(plan)
    city.judge(tally, kept, plans)
    return tally


def figures(tallies: list[Tally]) -> list[list[str]]:
    """The targets beside what was measured."""
    good, bad = tallies[:2], tallies[2:]
    shares = [t.accepted / max(t.plans, 1) for t in good]
    slowest = max((s for t in tallies for s in t.seconds), default=0.0) * 1e3
    wrong = sum(t.wrong.total() for t in tallies)
    invalid = sum(t.wrong.total() for t in bad)
    made = sum(t.plans for t in bad)
    return [
        [
            "plans covered, RRT* and roadmap",
            f"{100 * min(shares):.2f} %",
            ">= 95 %",
            ok(min(shares) >= 0.95),
        ],
        [
            "plans of the unbroken planner refused",
            f"{100 * (1 - shares[0]):.2f} %",
            "<= 1 %",
            ok(shares[0] >= 0.99),
        ],
        ["corridors accepted, and wrong", f"{wrong}", "0", ok(wrong == 0)],
        [f"of {made} plans with bugs: invalid in force", f"{invalid}", "0", ok(invalid == 0)],
        [
            "Cover, slowest",
            f"{slowest:.3f} ms",
            f"<= {SLOWEST_MS:.0f} ms",
            ok(slowest <= SLOWEST_MS),
        ],
    ]


def ok(good: bool) -> str:
    """A verdict for the table."""
    return "ok" if good else "MISSED"


def main() -> None:
    """Plan, cover, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if RRT.base is None:
        sys.exit(RRT.ABSENT)
    bugs = RRT.BUGS[1:]
    with tempfile.TemporaryDirectory() as folder:
        city = City(Path(folder), given.seed)
        tallies = [
            by_rrt_star(city, given.plans, "Unbroken", 0),
            by_roadmap(city, city.ends(given.plans)),
        ]
        each = -(-given.plans // len(bugs))
        for i, bug in enumerate(bugs, 1):
            tallies.append(by_rrt_star(city, each, bug, 2 * i * given.plans))
    margins = " x ".join(f"{float(m)} m" for m in city.margin)
    print(f"margins {margins}")
    print(table(HEAD, [t.row() for t in tallies]))
    reasons = sorted({v for t in tallies for v in t.verdicts if v != "Covered"})
    print()
    print(
        table(
            ["refused, by reason", *reasons],
            [[t.name, *(f"{t.verdicts[r] or '-'}" for r in reasons)] for t in tallies],
        )
    )
    print()
    print(table(["figure", "measured", "target", ""], figures(tallies)))
    for t in tallies:
        for fault, count in t.wrong.most_common(3):
            print(f"{t.name}: {count} x {fault}")


if __name__ == "__main__":
    main()
