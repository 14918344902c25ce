"""Bounds the time from a fault of an AC in another process to the first output of SC.

Purpose: `takeover_bounds` computes this time from releases and from the limits of lateness.
Non-goals: those limits (`late_limits.py`); who notices the fault (`runtime/posix/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lcm
from typing import TYPE_CHECKING

from soter.language.model.types import show_ns
from soter.targets.late_limits import late_limits

if TYPE_CHECKING:
    from soter.language.model.system import Component, System

RELEASES_MAX = 100_000
"""The most releases of an AC that are compared; for more, the sum of periods is the bound."""


@dataclass(frozen=True)
class Takeover:
    """The longest time in ns from a request that AC does not answer rightly to SC's output.

    A request is made at a release of AC and its budget is a period, so the driver sees a missing
    answer at the next release at the latest. The DM decides at its next release, and SC steps at
    its next one after that; both may be in the same instant (an instant looks at AC's answer, then
    runs DMs, then SCs). `turn`: the longest time from the request to that release of SC, over all
    releases of AC. `work`: how late SC's step and the decision before it may end.
    """

    module: str
    turn: int
    work: int

    @property
    def longest(self) -> int:
        """The bound in ns, valid if nothing in the trusted thread is later than `work`."""
        return self.turn + self.work

    @property
    def bound_text(self) -> str:
        """A phrase that states the bound."""
        return (
            f"{self.module}: the first output of SC comes at most {show_ns(self.longest)} after a "
            f"request that AC does not answer ({show_ns(self.turn)} until it is SC's turn, "
            f"{show_ns(self.work)} of work)"
        )


def takeover_bounds(system: System) -> list[Takeover]:
    """The takeover bounds of all modules whose AC is an extern node."""
    late, response = late_limits(system)
    bounds = []
    for m in system.modules:
        if not system.components[m.ac].extern:
            continue
        dm, sc, ac = (system.components[i] for i in (m.dm, m.sc, m.ac))
        work = max(late[sc.index], late[dm.index] + response[dm.index]) + response[sc.index]
        bounds.append(Takeover(m.name, longest_turn(ac, dm, sc), work))
    return bounds


def longest_turn(ac: Component, dm: Component, sc: Component) -> int:
    """The longest time in ns from a release of AC to the release of SC that replaces its answer."""
    hyper = lcm(ac.period_ns, dm.period_ns, sc.period_ns)
    if hyper // ac.period_ns > RELEASES_MAX:
        return ac.period_ns + dm.period_ns + sc.period_ns + max(dm.phase_ns, sc.phase_ns)
    end = max(ac.phase_ns, dm.phase_ns, sc.phase_ns) + 2 * hyper
    return max(
        _first_release_from(sc, _first_release_from(dm, release + ac.period_ns)) - release
        for release in range(ac.phase_ns, end, ac.period_ns)
    )


def _first_release_from(c: Component, time: int) -> int:
    """The first release of a component at `time` or later."""
    return max(c.phase_ns, time + (c.phase_ns - time) % c.period_ns)
