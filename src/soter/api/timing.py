"""What declared execution times come to, as plain data.

Purpose: `TimingReport` of a system: its thread, what is missing, P1c of its modules.
Non-goals: the analysis (`soter.timing`, `soter.verify.time`), printing (`cli/`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, SoterError
from soter.language.elaborate.numeric_values import MAX_PERIOD_NS
from soter.language.load.bounded_read import read_json_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import Component, Module, System
    from soter.timing.trusted_thread import Timing
    from soter.verify.time.switch_latency import SwitchLatency


@dataclass(frozen=True)
class ThreadRow:
    """A component of the thread; all times in ns, from its release.

    `start`, `response`: at the latest, over all executions; None where no bound is known.
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
    """P1c of a module with these times: `holds`, `fails` or `undecided`; None: not known."""

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
    """The thread of the trusted part of one system (docs/timing.md).

    `verdict`: `fits`, `misses` or `undecided`; `busy_ns` of every `hyperperiod_ns` at most;
    `exact`: whether the figures are reached; `schedule`: the steps before a miss; `elsewhere`: who
    runs in a process of its own; `missing`: who has no `wcet`; `assumed`: how counts of
    instructions became times, where they did.
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


def times_in(path: str | Path) -> tuple[str, str, dict[str, int], str]:
    """The program (its hash) and the system of a file of times, `wcet_ns` by component, `assumed`.

    `SoterError` U011 where it is no such file; OSError where it cannot be read.
    """
    try:
        given = json.loads(read_json_text(Path(path)))
        wcet_by_component = {s["name"]: s["wcet_ns"] for s in given["steps"]}
        sound = given["schema"] == 1 and all(
            isinstance(n, str) and type(ns) is int and 0 < ns <= MAX_PERIOD_NS
            for n, ns in wcet_by_component.items()
        )
        program, system = str(given["program_sha256"]), str(given["system"])
        assumed = str(given.get("assumed", ""))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        sound = False
    if not sound:
        problem = Diagnostic(
            "U011",
            f"`{path}` is no file of times",
            notes=("`soter measure` writes one",),
        )
        raise SoterError((problem,))
    return program, system, wcet_by_component, assumed


def with_times(systems: Mapping[str, System], path: str | Path, sha256: str) -> dict[str, str]:
    """Gives components that say no `wcet` the one of a file; `SoterError` U011 as `times_in`.

    Gives what these times assume, by the name of their system. U011 also where they are those of
    something else: of another program than that of this hash, of a system or of components that it
    does not have.
    """
    program, name, times, assumed = times_in(path)
    components = systems[name].components if name in systems else ()
    unknown = [n for n in times if n not in {c.name for c in components}]
    note = ""
    if program != sha256:
        note = f"it has those of program {program[:12]}, and this one is {sha256[:12]}"
    elif name not in systems:
        note = f"it has those of system `{name}`"
    elif unknown:
        note = f"it has those of `{unknown[0]}`, which is no part of system `{name}`"
    if note:
        what = f"`{path}` has no times of this program"
        helps = ("measure what is there now: `soter measure`",)
        raise SoterError((Diagnostic("U011", what, notes=(note,), helps=helps),))
    for c in components:
        c.wcet_ns = times.get(c.name) if c.wcet_ns is None else c.wcet_ns
    return {name: assumed}


def timing_reports(
    systems: list[System], assumed: Mapping[str, str] | None = None
) -> tuple[tuple[TimingReport, ...], tuple[Diagnostic, ...]]:
    """Of every system whose thread declares execution times, and what does not hold of them.

    `assumed`: what the times of a system assume, by its name.
    """
    from soter.timing.trusted_thread import report_miss, timing_of  # noqa: PLC0415 - see `soter.api`

    reports: list[TimingReport] = []
    diagnostics = Diagnostics()
    for system in systems:
        timing = timing_of(system)
        if timing is None:
            continue
        report_miss(timing, diagnostics)
        switches = _switches(system, diagnostics)
        rests_on = (assumed or {}).get(system.name, "")
        reports.append(replace(_report(timing, switches), assumed=rests_on))
    return tuple(reports), diagnostics.items


def _switches(system: System, diagnostics: Diagnostics) -> tuple[SwitchReport, ...]:
    if not system.modules:
        return ()
    from soter.verify.time.switch_latency import switch_of  # noqa: PLC0415 - see `soter.api`

    switches = []
    for at, module in _where_proved(system):
        switch = switch_of(at, module)
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
        switches.append(_switch(switch))
    return tuple(switches)


def _where_proved(system: System) -> list[tuple[System, Module]]:
    """Each module where its plants are: of a deployed system, in the one that it deploys.

    Both have the same thread (M025), here with the times that are known of the deployed one.
    """
    there = system.proved
    if there is None:
        return [(system, m) for m in system.modules]
    known = {c.name: c for c in system.components}
    for c in there.components:
        if c.name in known:
            c.wcet_ns, c.jitter_ns = known[c.name].wcet_ns, known[c.name].jitter_ns
    modules = {m.name: m for m in there.modules}
    return [(there, modules[m.name]) for m in system.modules if m.name in modules]


def _switch(switch: SwitchLatency) -> SwitchReport:
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


def _report(timing: Timing, switches: tuple[SwitchReport, ...]) -> TimingReport:
    from soter.timing.trusted_thread import schedule_lines  # noqa: PLC0415 - see `soter.api`

    def names(components: tuple[Component, ...]) -> tuple[str, ...]:
        return tuple(c.name for c in components)

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
        elsewhere=names(timing.elsewhere),
        missing=names(timing.missing),
        schedule=tuple(schedule_lines(timing)),
        switches=switches,
    )
