"""A trusted part in virtual time with one node that is delayed, and its actuators with a lease.

Purpose: `fly`: releases, starts and outputs of DM, SC and the nodes on the way by the definitions
of docs/proof.md ("The model of time"), told to the C of `soter_grant.c` and `soter_lease.c`; what
the actuators obeyed, when the law began, and how that lies to the deadline of the proof.
Non-goals: which modules (`delays.py`), how the C works.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isinf
from typing import TYPE_CHECKING

from bench.real_time.lease_code import Grant, Lease

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

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
