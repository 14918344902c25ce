"""What `Program.check` reports, as plain data.

Purpose: `CheckReport` and its parts, and a flat system told as one.
Non-goals: checking (`soter.program`), printing (`cli/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostic
    from soter.program.system import System


@dataclass(frozen=True)
class ModuleReport:
    """A module as checked: `verdicts` maps P1a ... P3 to `proved` or `assumed`."""

    name: str
    period_s: float
    ac: str
    sc: str
    forced: str | None
    verdicts: dict[str, str]


@dataclass(frozen=True)
class SystemReport:
    """A system as checked."""

    name: str
    default: bool
    until_s: float | None
    hyperperiod_s: float
    components: int
    topics: int
    properties: tuple[str, ...]
    externs: tuple[str, ...]
    modules: tuple[ModuleReport, ...]
    unproved: tuple[str, ...]
    """What is taken for granted about the modules, in words."""
    assumptions: tuple[str, ...]
    """Everything a run of the system rests on, in words."""


@dataclass(frozen=True)
class CheckReport:
    """What a successful check found: every system, the hash, and the warnings."""

    path: str
    program_sha256: str
    systems: tuple[SystemReport, ...]
    warnings: tuple[Diagnostic, ...]


def system_report(system: System, *, default: bool) -> SystemReport:
    """A flat system, and what a run of it rests on, as a report."""
    from soter.simulate import assumptions  # noqa: PLC0415 - see `soter.api`

    return SystemReport(
        system.name,
        default,
        None if system.until_ns is None else system.until_ns / 1e9,
        system.hyperperiod_ns / 1e9,
        len(system.components),
        len(system.topics),
        tuple(f"{p.kind} {p.text}" for p in system.properties),
        tuple(x.name for x in system.components if x.extern),
        tuple(
            ModuleReport(
                m.name,
                m.period_ns / 1e9,
                system.components[m.ac].name,
                system.components[m.sc].name,
                m.forced,
                assumptions.verdicts(m),
            )
            for m in system.modules
        ),
        tuple(assumptions.unproved(system)),
        tuple(assumptions.of_run(system)),
    )
