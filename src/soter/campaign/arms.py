"""The arms of a campaign: the same seeds, flown by other rules.

Purpose: `find_arms` makes, of a system, those that it is compared with: AC alone, the paper's rules
under a measured lateness of releases, and sweeps of how long nodes are held up. `measure_lateness`
finds how late this machine releases an ordinary process while it is busy: it sleeps to periodic
releases, under the ordinary policy, beside twice as many computing processes as there are cores.
Non-goals: flying (`fly_campaign.py`); real-time policies; what a deployed program does.

In the paper's semantics the nodes of an instant step in any order; here DMs step before SCs. The
sweeps hold nodes up together, as a processor with other work does, and fly both rules under each
of them: no arm is built to crash.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import time
from dataclasses import asdict, astuple, dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

from soter.campaign.store import measured_lateness
from soter.campaign.tables import quoted_names
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.elaborate.derived_systems import with_faults, with_forced_mode
from soter.language.load.named_files import read_bytes
from soter.language.model.system import Fault
from soter.language.model.types import show_ns
from soter.native.compiler import python_child
from soter.report.atomic_write import own_place

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


def find_arms(system: System, names: Sequence[str], lateness: Sequence[int]) -> list[Arm]:
    """The arms of these names, `ours` first; SoterError U001 for an unknown name.

    `lateness`: quantiles of a measured release lateness, ns, for the paper's rules.
    """
    unknown = [n for n in names if n not in NAMES]
    if unknown:
        helps = (f"there are {quoted_names(NAMES)}",)
        raise SoterError((Diagnostic("U001", f"there is no arm `{unknown[0]}`", helps=helps),))
    arms = [Arm(OURS, system, "the system as it is declared")]
    if ALONE in names:
        arms.append(Arm(ALONE, _ac_alone(system), "every module forced to AC"))
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
    """The system by the rules of an arm, as the campaign flew it; unchanged for `ours`.

    SoterError U001 for an unknown name, D006 if `folder` has not the lateness that it needs.
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


def _ac_alone(system: System) -> System:
    for m in system.modules:
        system = with_forced_mode(system, m.index, "ac")
    return system


def _sweep_arms(system: System, group: str, burst_ns: int) -> list[Arm]:
    held = [_hold_fault(c, group, burst_ns) for c in _held_components(system, group)]
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


def _held_components(system: System, group: str) -> list[Component]:
    """The components that a sweep of this group holds up."""
    return [c for c in system.components if c.role in GROUPS[group]]


def _hold_fault(c: Component, group: str, burst_ns: int) -> Fault:
    share = BURSTS_PER_HOUR / 3600.0 * (burst_ns / 1e9)
    p = (1.0 - sqrt(1.0 - 4.0 * share)) / 2.0
    text = f"late {group} by {show_ns(burst_ns)} at {BURSTS_PER_HOUR:g} per 1h".replace(" ms", "ms")
    return _component_fault(
        c,
        Fault(
            "late", c.index, f"arm.late.{group}", p, burst_ns, (burst_ns,), apart=True, text=text
        ),
    )


def _lateness_faults(system: System, lateness: Sequence[int]) -> list[Fault]:
    """A fault for each component: every release is as late as measured, each drawn on its own."""
    times = tuple(lateness)
    return [
        _component_fault(
            c, Fault("late", c.index, f"arm.late.{c.name}", 1.0, 0, times, text="measured lateness")
        )
        for c in _held_components(system, "all")
    ]


def _component_fault(c: Component, fault: Fault) -> Fault:
    """The fault of a component; proofs allow that of an AC."""
    if c.role == "ac":
        return replace(fault, inside="AC may do anything")
    return fault


STRETCHES = 1000
"""In how many equal parts the quantiles divide the releases that were measured."""
PERIOD_NS = 10_000_000
BUSY = """
import ctypes, os
ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG, SIGKILL: whoever measures may be killed
os.write(1, b"!")
while os.getppid() == int(sys.argv[1]):
    while True: pass
"""
CLOCK_MONOTONIC, TIMER_ABSTIME = 1, 1


@dataclass(frozen=True)
class Lateness:
    """A measurement: quantiles in ns, from the least to the most."""

    quantiles_ns: tuple[int, ...]
    releases: int
    period_ns: int
    busy_processes: int
    cores: int

    def text(self) -> str:
        """The measurement in words."""
        q = self.quantiles_ns
        half, last = q[len(q) // 2] / 1e6, q[-1] / 1e6
        late = q[int(0.99 * (len(q) - 1))] / 1e6
        return (
            f"{self.releases} releases every {self.period_ns / 1e6:g} ms, ordinary policy, "
            f"{self.busy_processes} busy processes on {self.cores} cores: median {half:.3f} ms, "
            f"99 % {late:.3f} ms, at most {last:.3f} ms"
        )


def measure_lateness(seconds: float = 20.0, period_ns: int = PERIOD_NS) -> Lateness:
    """Measures for `seconds`; OSError, or SoterError D006 if a busy process has ended."""
    cores = os.cpu_count() or 1
    busy: list[subprocess.Popen[bytes]] = []
    try:
        busy.extend(_start_busy_process() for _ in range(2 * cores))
        _require_busy(busy, [p.stdout.read(1) for p in busy if p.stdout is not None])
        late = _measure_releases(seconds, period_ns)
        _require_busy(busy, [b"" if p.poll() is not None else b"!" for p in busy])
    finally:
        for process in busy:
            process.kill()
            process.communicate()
    late.sort()
    last = len(late) - 1
    quantiles = tuple(late[round(k * last / STRETCHES)] for k in range(STRETCHES + 1))
    return Lateness(quantiles, len(late), period_ns, len(busy), cores)


def _start_busy_process() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        python_child(BUSY, str(os.getpid())),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _require_busy(busy: list[subprocess.Popen[bytes]], alive: list[bytes]) -> None:
    """Raises SoterError D006 if one of the processes that keep the machine busy has ended."""
    ended = alive.count(b"")
    if ended:
        message = "how late releases are beside busy processes cannot be measured"
        note = f"{ended} of the {len(busy)} processes that are to keep the machine busy have ended"
        raise SoterError((Diagnostic("D006", message, notes=(note,)),))


class _Timespec(ctypes.Structure):
    _fields_ = (("s", ctypes.c_long), ("ns", ctypes.c_long))


def _measure_releases(seconds: float, period_ns: int) -> list[int]:
    """Sleeps until each release; returns how late each one was, in ns."""
    libc = ctypes.CDLL(None, use_errno=True)
    late, at = [], time.monotonic_ns()
    for _ in range(max(1, int(seconds * 1e9 / period_ns))):
        at += period_ns
        when = _Timespec(at // 10**9, at % 10**9)
        libc.clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, ctypes.byref(when), None)
        late.append(max(0, time.monotonic_ns() - at))
    return late


def _read_lateness(path: Path) -> Lateness:
    """The measurement in a file; SoterError D006 unless it is as `stored_lateness` writes it."""
    try:
        fields = json.loads(read_bytes(path))
        made = Lateness(**{**fields, "quantiles_ns": tuple(fields["quantiles_ns"])})
        numbers = (*made.quantiles_ns, *astuple(made)[1:])
        if len(made.quantiles_ns) > 1 and all(type(n) is int and 0 <= n < 2**63 for n in numbers):
            return made
    except (ValueError, TypeError, KeyError, RecursionError):
        pass
    help_ = "take it away to have it measured again"
    raise SoterError((Diagnostic("D006", f"`{path}`: it is no lateness", helps=(help_,)),))


def stored_lateness(path: Path, seconds: float) -> Lateness:
    """The measurement in a file; without the file, measures now and writes it."""
    if path.exists():
        return _read_lateness(path)
    made = measure_lateness(seconds)
    own_place(path.parent, path.name).write_text(json.dumps(asdict(made)) + "\n", encoding="utf-8")
    return made
