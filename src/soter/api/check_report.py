"""What `Program.check` reports, as plain data.

Purpose: `CheckReport` and its parts, and a flat system told as one.
Non-goals: checking (`soter.language`), printing (`cli/`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.api.timing import TimingReport, timing_reports, with_times
from soter.diagnostics.diagnostic import Severity

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.language.front_end import CheckResult
    from soter.language.model.system import System
    from soter.language.model.typed import TypedProgram


@dataclass(frozen=True)
class ModuleReport:
    """A module as checked: `verdicts` maps P1a ... P3 to `proved` or `assumed`."""

    name: str
    period_s: float
    ac: str
    sc: str
    forced: str | None
    verdicts: dict[str, str]


@dataclass(frozen=True, kw_only=True)
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
class StepReport:
    """What the step of a node, or a decision of a module, takes at worst.

    `externs`: functions it may call, whose own code is not counted.
    """

    name: str
    kind: str
    """node or module"""
    operations: int
    stack_bytes: int
    externs: tuple[str, ...]


@dataclass(frozen=True)
class CheckReport:
    """What a successful check found: every system, the hash, the warnings, what steps take."""

    path: str
    program_sha256: str
    systems: tuple[SystemReport, ...]
    warnings: tuple[Diagnostic, ...]
    steps: tuple[StepReport, ...]
    """Of every node and module of the program that has code of its own."""
    timings: tuple[TimingReport, ...] = ()
    """Of every system whose thread declares execution times."""
    untimely: tuple[Diagnostic, ...] = ()
    """What does not hold of them, as errors: deadlines, the times of a proof, P1c."""

    def _repr_html_(self) -> str:
        from soter.report.notebook import shown  # noqa: PLC0415 - in notebooks only

        rows = [(s.name, m.name, m.ac, m.sc) for s in self.systems for m in s.modules]
        said = [f"{d.code}: {d.message}" for d in (*self.warnings, *self.untimely)]
        return shown(f"{self.path}: sound", ("system", "module", "AC", "SC"), rows, said)


def check_report(
    path: str,
    checked: CheckResult,
    flat: Mapping[str, System],
    bound: Mapping[str, object],
    times: str | Path | None = None,
) -> CheckReport:
    """The report on a sound program; `SoterError` U005 where `bound` names no extern of `flat`."""
    program = checked.program
    assert program is not None
    if bound:
        from soter.simulate.externs.bindings import bind_somewhere  # noqa: PLC0415 - see `soter.api`

        bind_somewhere(list(flat.values()), bound)
    systems = tuple(
        system_report(flat[name], default=symbol.default)
        for name, symbol in checked.systems.items()
    )
    from soter.simulate.externs.binding_warnings import warnings_of  # noqa: PLC0415 - see `soter.api`

    warnings = (*checked.diagnostics.items, *warnings_of(program, bound))
    assumed = {} if times is None else with_times(flat, times, program.sha256)
    steps, refused = step_reports(program, flat)
    warnings += tuple(dict.fromkeys(refused))
    timings, untimely = timing_reports(list(flat.values()), assumed)
    return CheckReport(path, program.sha256, systems, warnings, steps, timings, untimely)


def step_reports(
    program: TypedProgram, flat: Mapping[str, System]
) -> tuple[tuple[StepReport, ...], list[Diagnostic]]:
    """What all steps take, nodes first, in the order they were declared; then what follows SC.

    And of what `verify` and all that flies will refuse to follow, a warning each.
    """
    costs = {s.name: cost for s, cost in program.costs.items()}
    warned: list[Diagnostic] = []
    for system in flat.values():
        if any(m.symbol.rest is not None for m in system.modules):
            from soter.verify.deploy.missing_predicates import followed_costs  # noqa: PLC0415 - needs NumPy

            followed, refused = followed_costs(system)
            costs |= followed
            warned += [replace(d, severity=Severity.WARNING) for d in refused]
    steps = tuple(
        StepReport(name, "node" if name in program.nodes else "module", *cost)
        for name, cost in costs.items()
    )
    return steps, warned


def system_report(system: System, *, default: bool) -> SystemReport:
    """A flat system, and what a run of it rests on, as a report."""
    from soter.simulate.outputs import result_assumptions  # noqa: PLC0415 - see `soter.api`

    return SystemReport(
        name=system.name,
        default=default,
        until_s=None if system.until_ns is None else system.until_ns / 1e9,
        hyperperiod_s=system.hyperperiod_ns / 1e9,
        components=len(system.components),
        topics=sum(not t.held for t in system.topics),
        properties=tuple(f"{p.kind} {p.text}" for p in system.properties),
        externs=tuple(x.name for x in system.components if x.extern),
        modules=tuple(
            ModuleReport(
                m.name,
                m.period_ns / 1e9,
                system.components[m.ac].name if m.over is None else system.modules[m.over].name,
                system.components[m.sc].name,
                m.forced,
                result_assumptions.verdicts(m),
            )
            for m in system.modules
        ),
        unproved=tuple(result_assumptions.unproved(system)),
        assumptions=tuple(result_assumptions.of_run(system)),
    )
