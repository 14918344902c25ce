"""What `Program.check` reports, as plain data: systems, modules, execution times, costs of steps.

Purpose: `check_report` makes a `CheckReport` of a checked program; `timing_reports` makes a
`TimingReport` for each system with execution times: its trusted thread, and P1c of its modules.
Non-goals: checking (`soter.language`), files of times (`measured_times.py`), the analysis of times
(`soter.timing`, `soter.verify.problem`), printing (`cli/`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.addons import load_module
from soter.api.measured_times import enter_times
from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Severity

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedProgram
    from soter.timing.trusted_thread import Timing
    from soter.verify.problem.switch_latency import SwitchLatency


@dataclass(frozen=True)
class ThreadRow:
    """A component of the trusted thread; all times are in ns after its release.

    `start`, `response`: latest start and end in any execution; None if no bound is known.
    """

    name: str
    period_ns: int
    wcet_ns: int | None
    jitter_ns: int
    start_ns: int | None
    response_ns: int | None
    deadline_ns: int
    slack_ns: int | None


@dataclass(frozen=True)
class SwitchReport:
    """P1c of a module with declared times: `holds`, `fails` or `undecided`; None: not known."""

    module: str
    verdict: str
    horizon_ns: int | None
    needed_ns: int | None
    slack_ns: int | None
    largest: str | None
    largest_ns: int | None
    text: str


@dataclass(frozen=True)
class TimingReport:
    """The timing of the trusted part's thread in one system (docs/timing.md).

    `verdict`: `fits`, `misses` or `undecided`; the thread is busy for at most `busy_ns` of every
    `hyperperiod_ns`; `exact`: whether an execution reaches these numbers; `schedule`: the steps
    before a miss; `elsewhere`: components that run in other processes; `missing`: components
    without `wcet`; `assumed`: how instruction counts became times, or "".
    """

    system: str
    verdict: str
    busy_ns: int
    hyperperiod_ns: int
    exact: bool
    rows: tuple[ThreadRow, ...]
    elsewhere: tuple[str, ...]
    missing: tuple[str, ...]
    schedule: tuple[str, ...]
    switches: tuple[SwitchReport, ...]
    assumed: str = ""


def timing_reports(
    systems: list[System], assumed: Mapping[str, str] | None = None
) -> tuple[tuple[TimingReport, ...], tuple[Diagnostic, ...]]:
    """Timing reports of systems with execution times, and the errors; `assumed`: by system."""
    timed = [s for s in systems if s.timed]
    if not timed:
        return (), ()
    from soter.timing.trusted_thread import report_miss, timing_of  # noqa: PLC0415 - see `soter.api`

    reports: list[TimingReport] = []
    diagnostics = Diagnostics()
    for system in timed:
        timing = timing_of(system)
        if timing is None:
            continue
        report_miss(timing, diagnostics)
        switches = _switch_reports(system, diagnostics)
        rests_on = (assumed or {}).get(system.name, "")
        reports.append(replace(_timing_report(timing, switches), assumed=rests_on))
    return tuple(reports), diagnostics.items


def _switch_reports(system: System, diagnostics: Diagnostics) -> tuple[SwitchReport, ...]:
    if not system.modules:
        return ()
    from soter.verify.problem.switch_latency import switch_latency_of  # noqa: PLC0415 - see `soter.api`

    switches = []
    if system.proved is not None:
        _enter_times_of_deployed(system, system.proved)
    for at, module in _modules_with_plants(system):
        switch = switch_latency_of(at, module)
        for d in switch.diagnostics:
            diagnostics.add(d)
        if switch.verdict == "fails":
            verify = module.symbol.verify
            diagnostics.error(
                "P1c",
                f"a switch of `{module.name}` may take longer than its horizon "
                f"in system `{system.name}`",
                verify.span or module.symbol.span,
                notes=(switch.in_words(),),
                helps=("a longer `horizon`, which `ttf` has to look ahead, or shorter times",),
            )
        switches.append(_switch_report(switch))
    return tuple(switches)


def _enter_times_of_deployed(system: System, proved: System) -> None:
    """Copies the times of the deployed components to the same components of the proved system."""
    known = {c.name: c for c in system.components}
    for c in proved.components:
        if c.name in known:
            c.wcet_ns, c.jitter_ns = known[c.name].wcet_ns, known[c.name].jitter_ns


def _modules_with_plants(system: System) -> list[tuple[System, Module]]:
    """Pairs of each module and the system with its plants: its system, or the proved one."""
    proved = system.proved
    if proved is None:
        return [(system, m) for m in system.modules]
    modules = {m.name: m for m in proved.modules}
    return [(proved, modules[m.name]) for m in system.modules if m.name in modules]


def _switch_report(switch: SwitchLatency) -> SwitchReport:
    largest, ns = switch.largest or (None, None)
    return SwitchReport(
        module=switch.module,
        verdict=switch.verdict,
        horizon_ns=switch.horizon,
        needed_ns=switch.needed,
        slack_ns=switch.slack,
        largest=largest,
        largest_ns=ns,
        text=switch.in_words(),
    )


def _timing_report(timing: Timing, switches: tuple[SwitchReport, ...]) -> TimingReport:
    from soter.timing.trusted_thread import schedule_lines  # noqa: PLC0415 - see `soter.api`

    return TimingReport(
        system=timing.system,
        verdict=timing.verdict,
        busy_ns=timing.work,
        hyperperiod_ns=timing.hyperperiod,
        exact=timing.exact,
        rows=tuple(
            ThreadRow(
                name=r.component.name,
                period_ns=r.task.period,
                wcet_ns=r.component.wcet_ns,
                jitter_ns=r.task.jitter,
                start_ns=None if r.worst is None else r.worst.start,
                response_ns=None if r.worst is None else r.worst.end,
                deadline_ns=r.task.deadline,
                slack_ns=r.slack,
            )
            for r in timing.rows
        ),
        elsewhere=tuple(c.name for c in timing.elsewhere),
        missing=tuple(c.name for c in timing.missing),
        schedule=tuple(schedule_lines(timing)),
        switches=switches,
    )


@dataclass(frozen=True)
class ModuleReport:
    """The check result of a module; `verdicts`: for P1a to P3, `proved` or `assumed`."""

    name: str
    period_s: float
    ac: str
    sc: str
    forced: str | None
    verdicts: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class SystemReport:
    """The check result of a system."""

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
    """What a check assumes about the modules, in words."""
    assumptions: tuple[str, ...]
    """Everything a run of the system rests on, in words."""


@dataclass(frozen=True)
class StepReport:
    """The highest cost of a step or decision, without the code of the functions in `externs`."""

    name: str
    kind: str
    """node or module"""
    operations: int
    stack_bytes: int
    externs: tuple[str, ...]


@dataclass(frozen=True)
class CheckReport:
    """What a successful check found: systems, hash, warnings, and the costs of steps."""

    path: str
    program_sha256: str
    systems: tuple[SystemReport, ...]
    warnings: tuple[Diagnostic, ...]
    steps: tuple[StepReport, ...]
    """Costs for every node and module of the program that has code of its own."""
    timings: tuple[TimingReport, ...] = ()
    """Reports on every system whose trusted thread declares execution times."""
    untimely: tuple[Diagnostic, ...] = ()
    """Errors of these times: missed deadlines, times of a proof, or P1c that do not hold."""

    def _repr_html_(self) -> str:
        from soter.report.tables import notebook_table  # noqa: PLC0415 - in notebooks only

        rows = [(s.name, m.name, m.ac, m.sc) for s in self.systems for m in s.modules]
        lines = [f"{d.code}: {d.message}" for d in (*self.warnings, *self.untimely)]
        return notebook_table(f"{self.path}: sound", ("system", "module", "AC", "SC"), rows, lines)


def check_report(
    path: str,
    checked: CheckResult,
    flat: Mapping[str, System],
    bound: Mapping[str, object],
    times: str | Path | None = None,
) -> CheckReport:
    """The report on a sound program. Raises U005 if `bound` names an unknown extern."""
    program = checked.program
    assert program is not None
    if bound:
        from soter.native.extern_bindings import require_bindable  # noqa: PLC0415 - see `soter.api`

        require_bindable(list(flat.values()), bound)
    systems = tuple(
        system_report(flat[name], default=symbol.default)
        for name, symbol in checked.systems.items()
    )
    warnings = checked.diagnostics.items
    if bound or program.externs:
        from soter.simulate.externs import binding_warnings  # noqa: PLC0415 - see `soter.api`

        warnings += binding_warnings.binding_warnings(program, bound)
        warnings += binding_warnings.action_warnings(flat.values(), bound)
    assumed = {} if times is None else enter_times(flat, times, program.sha256)
    steps, refused = step_reports(program, flat)
    warnings += tuple(dict.fromkeys(refused))
    timings, untimely = timing_reports(list(flat.values()), assumed)
    return CheckReport(path, program.sha256, systems, warnings, steps, timings, untimely)


def add_stale_monitors(checked: CheckResult) -> None:
    """Adds D022 for each model monitor in a sound program that belongs to another model."""
    if not checked.ok or checked.loaded is None:
        return
    if any("soter monitor --emit" in file.source.text for file in checked.loaded.files):
        for wrong in load_module("soter.monitor.emitted_monitors").stale_monitors(checked):
            checked.diagnostics.add(wrong)


def step_reports(
    program: TypedProgram, flat: Mapping[str, System]
) -> tuple[tuple[StepReport, ...], list[Diagnostic]]:
    """Costs of all steps, nodes first, and warnings for code that proofs cannot follow."""
    costs = {s.name: cost for s, cost in program.costs.items()}
    warned: list[Diagnostic] = []
    for system in flat.values():
        if system.proved is None and any(m.symbol.rest is not None for m in system.modules):
            from soter.verify.deploy.missing_predicates import decision_costs  # noqa: PLC0415 - needs NumPy

            followed, refused = decision_costs(system)
            costs |= followed
            warned += [replace(d, severity=Severity.WARNING) for d in refused]
    steps = tuple(
        StepReport(name, "node" if name in program.nodes else "module", *cost)
        for name, cost in costs.items()
    )
    return steps, warned


def system_report(system: System, *, default: bool) -> SystemReport:
    """A report on a flat system and on what a run of it assumes."""
    from soter.simulate import result_assumptions  # noqa: PLC0415 - see `soter.api`

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
                system.components[m.ac].name,
                system.components[m.sc].name,
                m.forced,
                result_assumptions.verdict_by_property(m),
            )
            for m in system.modules
        ),
        unproved=tuple(result_assumptions.code_assumptions(system)),
        assumptions=tuple(result_assumptions.run_assumptions(system)),
    )
