"""The arms of a campaign: the same seeds, flown by other rules.

Purpose: `find_arms` makes, of a system, those that it is compared with: AC alone, the paper's rules
under a measured lateness of releases, and sweeps of how long nodes are held up.
Non-goals: flying (`fly_campaign.py`); the measurement (`release_lateness.py`).

In the paper's semantics the nodes of an instant step in any order; here DMs step before SCs. The
sweeps hold nodes up together, as a processor with other work does, and fly both rules under each
of them: no arm is built to crash.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

from soter.campaign.store import measured_lateness
from soter.campaign.tables import quoted_names
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.elaborate.derived_systems import with_faults, with_forced_mode
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
    """A variant of a system that is flown; `text` describes the difference for people."""

    name: str
    system: System
    text: str


def find_arms(system: System, names: Sequence[str], lateness: Sequence[int]) -> list[Arm]:
    """The arms of these names, `ours` first. Raises SoterError U001 for an unknown name.

    `lateness`: quantiles of a measured release lateness in ns, for the paper's rules.
    """
    unknown = [n for n in names if n not in NAMES]
    if unknown:
        helps = (f"there are {quoted_names(NAMES)}",)
        raise SoterError((Diagnostic("U001", f"there is no arm `{unknown[0]}`", helps=helps),))
    arms = [Arm(OURS, system, "the system as it is declared")]
    if ALONE in names:
        arms.append(Arm(ALONE, _with_ac_alone(system), "every module forced to AC"))
    if PAPER in names:
        most = f"{lateness[-1] / 1e6:.1f} ms" if lateness else "so"
        text = f"nodes in any order, each release up to {most} late, as measured"
        late = with_faults(system, _lateness_faults(system, lateness), shuffled=True)
        arms.append(Arm(PAPER, late, text))
    if SWEPT in names:
        for group in GROUPS:
            for burst in BURSTS_NS:
                arms += _sweep_arms(system, group, burst)
    return arms


def system_of_arm(system: System, name: str, folder: Path) -> System:
    """The system under the rules of an arm, as the campaign flew it; unchanged for `ours`.

    Raises U001 for an unknown name, D006 if `folder` lacks a lateness that the arm needs.
    """
    if name == OURS:
        return system
    times: tuple[int, ...] = (0, 0)
    if name == PAPER:
        times = measured_lateness(folder, system.program.sha256, system.name)
    arm_by_name = {a.name: a for a in find_arms(system, [ALONE, PAPER, SWEPT], times)}
    if name not in arm_by_name:
        helps = (f"there are {quoted_names(list(arm_by_name))}",)
        raise SoterError((Diagnostic("U001", f"there is no arm `{name}`", helps=helps),))
    return arm_by_name[name].system


def _with_ac_alone(system: System) -> System:
    for m in system.modules:
        system = with_forced_mode(system, m.index, "ac")
    return system


def _sweep_arms(system: System, group: str, burst_ns: int) -> list[Arm]:
    held = [_late_burst_fault(c, group, burst_ns) for c in _components_of_group(system, group)]
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


def _components_of_group(system: System, group: str) -> list[Component]:
    return [c for c in system.components if c.role in GROUPS[group]]


def _late_burst_fault(c: Component, group: str, burst_ns: int) -> Fault:
    """The fault that delays a component in a `share` of all slots; a slot lasts as long as a burst.

    Each slot is drawn with probability p, and is a burst only if the slot before it was not drawn
    (`apart`), so that the share is p (1 - p).
    """
    share = BURSTS_PER_HOUR / 3600.0 * (burst_ns / 1e9)
    p = (1.0 - sqrt(1.0 - 4.0 * share)) / 2.0
    text = f"late {group} by {show_ns(burst_ns)} at {BURSTS_PER_HOUR:g} per 1h".replace(" ms", "ms")
    return _with_mark_for_ac(
        c,
        Fault(
            "late", c.index, f"arm.late.{group}", p, burst_ns, (burst_ns,), apart=True, text=text
        ),
    )


def _lateness_faults(system: System, lateness: Sequence[int]) -> list[Fault]:
    """A fault for each component, which delays every release by one of the measured times."""
    times = tuple(lateness)
    return [
        _with_mark_for_ac(
            c, Fault("late", c.index, f"arm.late.{c.name}", 1.0, 0, times, text="measured lateness")
        )
        for c in _components_of_group(system, "all")
    ]


def _with_mark_for_ac(c: Component, fault: Fault) -> Fault:
    """The fault, marked as inside the assumptions of proofs if the component is an AC."""
    if c.role == "ac":
        return replace(fault, inside="AC may do anything")
    return fault
