"""The arms of a campaign: the same seeds, flown by other rules.

Purpose: from a system to the systems that it is compared with: AC alone, the paper's rules under a
lateness that was measured, and sweeps of how long nodes are held up.
Non-goals: measuring (`release_lateness.py`), flying.

In the paper's semantics the nodes of an instant step in any order; here DMs step before SCs. The
sweeps hold nodes up together, as a processor does that has other things to do, and both rules are
flown under each of them: no crash is made to happen, what is found is told.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

from soter.campaign.store import measured_lateness
from soter.campaign.tables import listed
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.elaborate.derived_systems import forced, with_faults
from soter.language.model.system import Fault
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from soter.language.model.system import Component, System

OURS, ALONE, PAPER, SWEPT = "ours", "ac", "paper", "swept"
NAMES = (OURS, ALONE, PAPER, SWEPT)
BURSTS_NS = (120_000_000, 360_000_000, 1_200_000_000)
BURSTS_PER_HOUR = 60.0
MODULE_ROLES = ("dm", "sc", "ac")
GROUPS = {"modules": MODULE_ROLES, "all": (*MODULE_ROLES, "node")}


@dataclass(frozen=True)
class Arm:
    """A system that is flown; `text`: what is different about it, for people."""

    name: str
    system: System
    text: str


def arms_of(system: System, names: Sequence[str], lateness: Sequence[int]) -> list[Arm]:
    """The arms of these names, `ours` first; SoterError U001 for a name that is none.

    `lateness`: quantiles of a measured release lateness, ns, for the paper's rules.
    """
    unknown = [n for n in names if n not in NAMES]
    if unknown:
        helps = (f"there are {listed(NAMES)}",)
        raise SoterError((Diagnostic("U001", f"there is no arm `{unknown[0]}`", helps=helps),))
    arms = [Arm(OURS, system, "the system as it is declared")]
    if ALONE in names:
        arms.append(Arm(ALONE, _alone(system), "every module forced to AC"))
    if PAPER in names:
        most = f"{lateness[-1] / 1e6:.1f} ms" if lateness else "so"
        text = f"nodes in any order, each release up to {most} late, as measured"
        arms.append(Arm(PAPER, with_faults(system, _late(system, lateness), shuffled=True), text))
    if SWEPT in names:
        for group in GROUPS:
            for burst in BURSTS_NS:
                arms += _swept(system, group, burst)
    return arms


def system_of_arm(system: System, name: str, folder: Path) -> System:
    """The system by the rules of an arm of a campaign, as it was flown; itself for `ours`.

    SoterError U001 for a name that is none, D006 where `folder` has no lateness that it needs.
    """
    if name == OURS:
        return system
    times: tuple[int, ...] = (0, 0)
    if name == PAPER:
        times = measured_lateness(folder, system.program.sha256, system.name)
    arm_by_name = {a.name: a for a in arms_of(system, [ALONE, PAPER, SWEPT], times)}
    if name not in arm_by_name:
        helps = (f"there are {listed(list(arm_by_name))}",)
        raise SoterError((Diagnostic("U001", f"there is no arm `{name}`", helps=helps),))
    return arm_by_name[name].system


def _alone(system: System) -> System:
    for m in system.modules:
        system = forced(system, m.index, "ac")
    return system


def _swept(system: System, group: str, burst_ns: int) -> list[Arm]:
    held = [_held(c, group, burst_ns) for c in _nodes(system, group)]
    ms = burst_ns // 1_000_000
    often = f"{BURSTS_PER_HOUR:g} times an hour {group} held up for at most {show_ns(burst_ns)}"
    return [
        Arm(f"ours-{group}-{ms}ms", with_faults(system, held), f"in order; {often}"),
        Arm(
            f"paper-{group}-{ms}ms",
            with_faults(system, held, shuffled=True),
            f"nodes in any order; {often}",
        ),
    ]


def _nodes(system: System, group: str) -> list[Component]:
    """Who can be late."""
    return [c for c in system.components if c.role in GROUPS[group]]


def _held(c: Component, group: str, burst_ns: int) -> Fault:
    share = BURSTS_PER_HOUR / 3600.0 * (burst_ns / 1e9)
    p = (1.0 - sqrt(1.0 - 4.0 * share)) / 2.0
    text = f"late {group} by {show_ns(burst_ns)} at {BURSTS_PER_HOUR:g} per 1h".replace(" ms", "ms")
    return _of_arm(
        c,
        Fault(
            "late", c.index, f"arm.late.{group}", p, burst_ns, (burst_ns,), apart=True, text=text
        ),
    )


def _late(system: System, lateness: Sequence[int]) -> list[Fault]:
    """Every release as late as was measured, each on its own."""
    times = tuple(lateness)
    return [
        _of_arm(
            c, Fault("late", c.index, f"arm.late.{c.name}", 1.0, 0, times, text="measured lateness")
        )
        for c in _nodes(system, "all")
    ]


def _of_arm(c: Component, fault: Fault) -> Fault:
    """An AC may be late; of others nothing is said to permit it."""
    if c.role == "ac":
        return replace(fault, inside="AC may do anything")
    return fault
