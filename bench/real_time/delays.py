"""Delays at every trusted node of every shipped module, in virtual time: in time, or the law.

Each node of the trusted part (DM, SC, the nodes between sensors and module) takes 0.5 to 10 times
what its module declares for it (`late` and `response`; where that is nothing, a nanosecond more is
too late), or stops, from some release on; all others take what they may. Starts and outputs follow
the definitions of docs/proof.md, "The model of time"; who gives leases and who obeys them is the C
that ships (`soter_grant.c`, `soter_lease.c`). Allowed are two outcomes: every output of SC is in
time and no lease ends, or the fail-safe law acts before H runs out, counted from the state behind
the last "AC" verdict, and nothing is obeyed afterwards. The same runs with a watchdog (whatever
comes is obeyed, and feeds it) show what that is good for.

Purpose: target: within budget always the first, beyond it always the second, no third outcome.
Non-goals: wall-clock times; whether a module's law keeps `safe` (`soter verify`).
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field
from math import inf, isinf
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.real_time.delays_model import AC, Delay, Flown, Node, Timing, fly  # noqa: E402

from soter.diagnostics.diagnostic import SoterError  # noqa: E402
from soter.language.elaborate.views_for_proofs import systems_by_view  # noqa: E402
from soter.language.front_end import check_file  # noqa: E402
from soter.report.tables import table  # noqa: E402
from soter.targets.leases_and_lateness import lease_times  # noqa: E402
from soter.verify.command import modules_of, verify  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402
from soter.verify.problem.problem import NODES  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Module, System

FACTORS = (0.5, 0.9, 0.99, 1.01, 1.1, 2.0, 10.0, inf)
"""Infinity: the node stops for good, as where the trusted part is killed."""
PERIODS = 12
"""A run is so many periods of the DM, and the delay begins in the first half of them."""
STOP = "stop: Guard"
"""The module of which states are flown, too: x' = u, so a run is a sum."""


@dataclass
class Row:
    """What was counted of one module; `watchdog`: third outcomes of the same runs with one."""

    name: str
    budgets: int
    lease: int
    kept: int = 0
    lawful: int = 0
    third: int = 0
    margin: int | None = None
    watchdog: int = 0
    wrong: list[str] = field(default_factory=list)


def timing_of(flat: System, module: Module) -> Timing | str:
    """Times of a module as its proof has them, or why it has none."""
    try:
        problem = extract(flat, module)
    except SoterError as error:
        return error.diagnostics[0].message
    if problem.kind == NODES:
        return "proved by induction: no H"
    times, leases = problem.times, lease_times(flat, module)
    nodes = tuple(Node(b.name, b.period, b.phase, b.late, b.response) for b in leases.budgets)
    acts = max(o.most for o in times.schedule.outputs)
    return Timing(nodes, times.age_dm, times.horizon_ns, acts, leases.longest, times.start)


def shipped() -> Iterator[tuple[str, Timing | str]]:
    """Every module of every example, in a system that holds it; the first view has the times."""
    for path in sorted((ROOT / "examples").glob("*/*.soter")):
        checked = check_file(str(path))
        if not checked.ok or checked.program is None:
            continue
        try:
            chosen = modules_of(checked, None, None, {})
        except SoterError:
            continue
        for flat, module in chosen:
            if Path(module.symbol.span.source.name).name == path.name:
                try:
                    seen = systems_by_view(flat, module)[0]
                except SoterError as error:
                    yield f"{path.stem}: {module.name}", error.diagnostics[0].message
                    continue
                yield f"{path.stem}: {module.name}", timing_of(*seen)


def row_of(name: str, timing: Timing, runs: int, chance: Random) -> Row:
    """All nodes and factors of one module, `runs` each."""
    row = Row(name, sum(n.late + n.response > 0 for n in timing.nodes), timing.longest)
    until = PERIODS * timing.nodes[0].period
    for k, node in enumerate(timing.nodes):
        for factor in FACTORS:
            for _ in range(runs):
                since = chance.randint(0, until // node.period // 2)
                switch = chance.randint(0, until)
                run = until, Delay(k, factor, since), switch, chance.getrandbits(64)
                _judge(row, timing, run, node.name)
    return row


def _judge(row: Row, timing: Timing, run: tuple[int, Delay, int, int], name: str) -> None:
    until, delay, switch, seed = run

    def outcome(*, watchdog: bool) -> tuple[bool, Flown]:
        def says_ac(_: Flown, start: int) -> bool:
            return start < switch

        flight = fly(timing, until, delay, says_ac, Random(seed), watchdog=watchdog)  # noqa: S311
        return (flight.kept if delay.factor <= 1.0 else flight.safe), flight

    ok, flight = outcome(watchdog=False)
    row.kept += ok and delay.factor <= 1.0
    row.lawful += ok and delay.factor > 1.0
    row.third += not ok
    if not ok:
        row.wrong.append(f"{name} x {delay.factor}: {flight}")
    if flight.law:
        left = flight.deadline - flight.law
        row.margin = left if row.margin is None else min(row.margin, left)
    row.watchdog += not outcome(watchdog=True)[0]


# ---------------------------------------------------------------- states


def stop_flights(timing: Timing, runs: int, chance: Random, *, watchdog: bool) -> tuple[int, int]:
    """(flights, flights that left |x| < 10) of `stop.soter`, AC at full speed outwards.

    The DM goes by the S_0 and S_1 that `soter verify` computes, on reads as old as they may be.
    """
    path = ROOT / "examples" / "wall" / "stop.soter"
    (result,) = verify(check_file(str(path)), system="Track", refute=False).modules
    assert result.findings["failsafe"].verdict == "proved"
    (group,) = result.cases[0].groups
    edges = group.edges[0]
    inner, outer = (np.flatnonzero(group.levels[k]) for k in (-1, 0))
    back = (edges[inner[0]], edges[inner[-1] + 1])
    keep = (edges[outer[0]], edges[outer[-1] + 1])
    left = flights = 0
    for k, node in enumerate(timing.nodes):
        for factor in (*(f for f in FACTORS if f > 1.0), 1.0):
            for _ in range(runs):
                flights += 1
                sign, error = chance.choice((-1.0, 1.0)), chance.choice((-0.02, 0.0, 0.02))
                at = sign * chance.uniform(9.0, 9.6)
                until = PERIODS * timing.nodes[0].period
                motion = Motion(at, sign, timing.acts)
                mode = [False]

                def says_ac(flight: Flown, start: int) -> bool:
                    read = motion.at(flight, max(0, start - timing.age)) + error  # noqa: B023
                    inside = keep if mode[0] else back  # noqa: B023
                    mode[0] = inside[0] <= read <= inside[1]  # noqa: B023
                    return mode[0]  # noqa: B023

                delay = Delay(k, factor, chance.randint(0, until // node.period // 2))
                seed = Random(chance.getrandbits(64))  # noqa: S311
                flight = fly(timing, until, delay, says_ac, seed, watchdog=watchdog)
                times = [when for when, _ in flight.changes] + [until]
                if flight.law is not None or isinf(factor):  # what is held now is held for good
                    times.append(until + 20 * 10**9)
                left += any(abs(motion.at(flight, t)) >= 10.0 for t in times)
    return flights, left


@dataclass(frozen=True)
class Motion:
    """x' = u from `start`: u is `sign` under AC and 0 under SC and the law, `acts` ns later."""

    start: float
    sign: float
    acts: int

    def at(self, flight: Flown, time: int) -> float:
        """X at a time in ns, of what was held until then."""
        x, since, u = self.start, 0, 0.0
        for when, held in flight.changes:
            now = min(when + self.acts, time)
            x += u * (now - since) / 1e9
            since, u = now, self.sign if held == AC else 0.0
        return x + u * (time - since) / 1e9


def main() -> int:
    """Count, print; 1 where there was a third outcome."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=40, help="of each node and factor")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    chance = Random(given.seed)  # noqa: S311
    rows, left, stop = [], [], None
    for name, timing in shipped():
        if isinstance(timing, str):
            left.append((name, timing))
            continue
        rows.append(row_of(name, timing, given.runs, chance))
        stop = timing if name == STOP else stop
    assert stop is not None
    head = ["module", "budgets", "lease, ms", "in time", "law in time", "third", "least left, us"]
    head.append("third, watchdog")
    lines = [
        [
            r.name,
            str(r.budgets),
            f"{r.lease / 1e6:g}",
            f"{r.kept:,}",
            f"{r.lawful:,}",
            str(r.third),
            "-" if r.margin is None else f"{r.margin / 1e3:g}",
            f"{r.watchdog:,}",
        ]
        for r in rows
    ]
    print(
        f"factors {', '.join(f'{f:g}' for f in FACTORS)}; "
        f"{given.runs} runs of each, seed {given.seed}"
    )
    print(table(head, lines))
    third = sum(r.third for r in rows)
    print(
        f"third outcomes: {third} of {sum(r.kept + r.lawful + r.third for r in rows):,} (target 0)"
    )
    for r in rows:
        for text in r.wrong[:3]:
            print(f"  {r.name}: {text}")
    print(f"\nstates of {STOP}, AC at full speed outwards, one node late or dead:")
    outside = []
    for name, watchdog in (("lease", False), ("watchdog", True)):
        flights, out = stop_flights(stop, given.runs, chance, watchdog=watchdog)
        outside.append(out)
        print(f"  {name}: {out:,} of {flights:,} flights leave |x| < 10")
    print("\nnot counted, as there is no H (no sets, or a system that is not to be proved):")
    for name, why in left:
        print(f"  {name}: {why}")
    third += outside[0]
    return 1 if third else 0


if __name__ == "__main__":
    sys.exit(main())
