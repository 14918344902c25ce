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

from bench.real_time.lease_code import Grant, Lease  # noqa: E402 - needs the path

from soter.diagnostics.diagnostic import SoterError  # noqa: E402
from soter.language.elaborate.views_for_proofs import systems_by_view  # noqa: E402
from soter.language.front_end import check_file  # noqa: E402
from soter.report.tables import table  # noqa: E402
from soter.targets.leases import lease_times  # noqa: E402
from soter.verify.chosen_modules import modules_of  # noqa: E402
from soter.verify.command import verify  # noqa: E402
from soter.verify.problem.extract import extract  # noqa: E402
from soter.verify.problem.problem import NODES  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.model.system import Module, System

LAW, AC, SC = -1.0, 1.0, 2.0
"""What the actuators hold, as numbers that tell it apart."""


@dataclass(frozen=True)
class Node:
    """Times of a node, any unit: releases at phase + k period."""

    name: str
    period: int
    phase: int
    late: int
    response: int


@dataclass(frozen=True)
class Timing:
    """A module: its DM, its SC, then the nodes on the way; A, H, L and the longest lease."""

    nodes: tuple[Node, ...]
    age: int
    horizon: int
    acts: int
    longest: int
    start: int


@dataclass(frozen=True)
class Delay:
    """From release number `since` on a node takes factor times what it may; infinity: it stops."""

    node: int
    factor: float
    since: int

    def of(self, budget: int) -> int:
        """The delay, beyond the budget wherever the factor is."""
        exact = budget * self.factor
        return int(exact) if self.factor <= 1.0 else max(int(exact), budget + 1)


@dataclass
class Flown:
    """What happened. `law_ns`: when the law began to act at the latest, None: never.

    `deadline`: until when it had to (s + H while AC may act, else when SC's next output may act);
    `broken`: when a release was first seen not to be done in time; `late_outputs` of SC, after they
    were due; `taken_after`: what was obeyed although the law had begun; `changes`: of what is held.
    """

    law: int | None = None
    deadline: int = 0
    broken: int | None = None
    late_outputs: int = 0
    taken_after: int = 0
    changes: list[tuple[int, float]] = field(default_factory=list)

    @property
    def kept(self) -> bool:
        """Whether the lease held all the time and every output of SC was in time."""
        return self.law is None and self.late_outputs == 0

    @property
    def safe(self) -> bool:
        """Whether the law began before H ran out, and nothing was obeyed afterwards."""
        return self.law is not None and self.law <= self.deadline and not self.taken_after


def releases(
    timing: Timing, k: int, until: int, delay: Delay | None, chance: Random, verdicts: list[int]
) -> list[tuple[int, int, int]]:
    """(release, start, output) of every step of node k; `verdicts`: outputs of the DM, for SC."""
    node, dm = timing.nodes[k], timing.nodes[0]
    steps: list[tuple[int, int, int]] = []
    number, free = 0, 0
    while (release := node.phase + number * node.period) <= until:
        late = chance.choice((0, node.late, chance.randint(0, node.late)))
        response = chance.choice((0, node.response, chance.randint(0, node.response)))
        if delay is not None and delay.node == k and number >= delay.since:
            if isinf(delay.factor):
                break
            late, response = delay.of(node.late), delay.of(node.response)
        start = max(release + late, free)
        if k == 1 and release >= dm.phase:
            awaited = (release - dm.phase) // dm.period
            if awaited >= len(verdicts):
                break  # it waits for ever
            start = max(start, verdicts[awaited])
        free = start + response
        steps.append((release, start, free))
        number += 1
    return steps


def fly(
    timing: Timing,
    until: int,
    delay: Delay | None,
    says_ac: Callable[[Flown, int], bool],
    chance: Random,
    *,
    watchdog: bool = False,
) -> Flown:
    """One run of `until`. `says_ac`: whether a DM that starts then says "AC", by what was held.

    `watchdog`: what is often done instead of a lease: actuators that obey whatever comes, and hold
    the law when nothing has come for as long as a lease lasts (to see what leases are good for).
    """
    events = _events(timing, until, delay, chance)
    run = _Run(timing, says_ac, watchdog=watchdog)
    for now, _, k, release, start in events:
        if now > until:
            break
        run.look(now)
        if k < 0:
            run.ac(now)
        else:
            run.step(now, k, release, start)
    run.look(until)
    if run.lease.until < 0:
        run.found.law = 0  # no lease was ever given: the law has been there from the beginning
    return run.found


def _events(
    timing: Timing, until: int, delay: Delay | None, chance: Random
) -> list[tuple[int, int, int, int, int]]:
    """(time, order in its instant, node or -1 for AC, release, start) of all outputs, in order."""
    verdicts: list[int] = []
    events: list[tuple[int, int, int, int, int]] = []
    for k in range(len(timing.nodes)):
        steps = releases(timing, k, until, delay, chance, verdicts)
        if k == 0:
            verdicts = [out for _, _, out in steps]
        order = (1, 2)[k] if k < 2 else 0
        events += [(out, order, k, release, start) for release, start, out in steps]
    events += [(t, 3, -1, t, t) for t in range(0, until, timing.nodes[1].period)]
    return sorted(events)


class _Run:
    """Trusted part and actuators of one run, told what is out, in order of time."""

    def __init__(
        self, timing: Timing, says_ac: Callable[[Flown, int], bool], *, watchdog: bool
    ) -> None:
        self.timing, self.says_ac, self.watchdog = timing, says_ac, watchdog
        self.grant = Grant([(n.period, n.phase, n.late, n.response) for n in timing.nodes])
        self.lease = Lease(LAW, timing.longest)
        self.found = Flown(deadline=timing.start)
        self.mode_ac, self.command, self.missed = False, SC, False

    def look(self, now: int) -> None:
        """Whether the lease has ended before `now`."""
        flight, lease = self.found, self.lease
        if flight.law is None and 0 <= lease.until < now:
            assert lease.read(now) == (False, LAW)
            flight.law = lease.until + self.timing.acts
            flight.changes.append((lease.until, LAW))

    def _pass_on(self, now: int, value: float) -> bool:
        given = (now, now + self.timing.longest) if self.watchdog else self.grant.lease(now)
        if given is None or not self.lease.take(now, value, *given):
            return False
        if self.found.law is not None:
            self.found.taken_after += 1
        self.found.changes.append((now, value))
        return True

    def ac(self, now: int) -> None:
        """AC publishes; the gate lets it pass where it has control."""
        if self.mode_ac:
            self.command = AC
            self._pass_on(now, AC)

    def step(self, now: int, k: int, release: int, start: int) -> None:
        """A node of the trusted part is done."""
        flight, grant, timing = self.found, self.grant, self.timing
        due = grant.due(k)
        if not grant.done(k, start, now):
            self.missed = True
            flight.broken = now if flight.broken is None else flight.broken
        if k == 0:
            self.mode_ac = self.says_ac(flight, start)
            if self.mode_ac and not self.missed:
                flight.deadline = release - timing.age + timing.horizon
        elif k == 1:
            flight.late_outputs += now > due
            if self.mode_ac:
                self._pass_on(now, self.command)
            elif self._pass_on(now, SC) and not self.missed:
                flight.deadline = grant.due(1) + timing.acts


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
