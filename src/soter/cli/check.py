"""`soter check FILE`: everything that can be known without running the program.

Purpose: renders all diagnostics; on success tells what was checked and what was not, and what
declared execution times amount to, on the terminal and in documents (`say_timing`, `TIMING`).
Non-goals: proofs (`soter verify`); the figures themselves (`api/check_report.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.api import CheckReport, ModuleReport, StepReport, SystemReport, load
from soter.api.check_report import SwitchReport, ThreadRow, TimingReport
from soter.cli.terminal.command_line import Pairs, UsageError
from soter.cli.terminal.command_outcome import DIAGNOSTICS, FINE, CommandOutcome, exit_code, failure
from soter.cli.terminal.console import Console, LineOfProgress
from soter.cli.terminal.program_loading import STDIN, bound_program, standard_input
from soter.cli.terminal.shared_options import FORMAT, SET, file_option
from soter.diagnostics.command_records import JsonObject, one_of, option
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.types import show_ns
from soter.report.wording import visible

if TYPE_CHECKING:
    import argparse


HEAD = ("thread", "every", "wcet", "jitter", "starts by", "ends by", "slack")


def say_timing(report: TimingReport, console: Console) -> None:
    """Prints the steps of the trusted thread as a table, its load, and P1c of every module."""
    console.say("\n" + console.table(HEAD, [_thread_row(r) for r in report.rows]))
    share = 100 * report.busy_ns / report.hyperperiod_ns
    bound = "" if report.exact else ", bounds only"
    lines = [f"the thread of `{report.system}` {_WORDS[report.verdict]}: {share:.1f}% busy{bound}"]
    if report.missing:
        lines.append(f"no `wcet` is said of {', '.join(report.missing)}, counted as nothing")
    if report.elsewhere:
        lines.append(f"in processes of their own: {', '.join(report.elsewhere)}")
    lines += [f"{s.module}: {s.text}" for s in report.switches]
    if report.assumed:
        lines.append(f"assumed: {report.assumed}")
    console.say("\n".join(f"    {line}" for line in lines))


_WORDS = {
    "fits": "keeps its calendar",
    "misses": "does not keep its calendar",
    "undecided": "is undecided",
}


def _thread_row(r: ThreadRow) -> list[str]:
    times = (r.wcet_ns, r.jitter_ns, r.start_ns, r.response_ns, r.slack_ns)
    return [
        r.name,
        show_ns(r.period_ns),
        *("?" if t is None else show_ns(t) for t in times),
    ]


TIMING = JsonObject(
    TimingReport,
    "system verdict busy_ns hyperperiod_ns exact thread=rows elsewhere missing schedule switches "
    "assumed",
    verdict=one_of(*_WORDS),
    thread=JsonObject(
        ThreadRow, "name period_ns wcet_ns jitter_ns start_ns response_ns deadline_ns slack_ns"
    ),
    switches=JsonObject(
        SwitchReport,
        "module verdict horizon_ns needed_ns slack_ns largest largest_ns text",
        verdict=one_of("holds", "fails", "undecided"),
    ),
)
"""The timing report as a JSON object (docs/json.md)."""


EXAMPLES = """\
  soter check drone.soter
  soter check *.soter                      several: each is a program of its own
  soter check - < drone.soter              standard input; imports from the current folder
  soter check drone.soter --set GAIN=3     with another value of a parameter
  soter check drone.soter --json | jq .modules
  soter check timed.soter                  where nodes say `wcet`: the thread, and P1c
  soter check drone.soter --times .soter/drone-times.json
"""

STEPS_SHOWN = 8
"""How many steps the terminal shows, those with the most operations first."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Parse a program, check types, well-formedness (P1a, P1b) and composition."""

    files: list[str] = file_option("FILE...", "a program; - for standard input", json_name="")
    params: Pairs = option(*SET)
    times: str | None = option(
        "--times FILE", None, "what `soter measure` wrote, for nodes without a `wcet`"
    )
    format: str | None = option(*FORMAT)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Checks every file, even if others have errors; UsageError for more than one `-`."""
    if args.files.count("-") > 1:
        raise UsageError("standard input can be read once")
    if len(args.files) == 1:
        return _check_file(args.files[0], args, console)
    outcomes = []
    for name in args.files:
        try:
            outcomes.append(_check_file(name, args, console))
        except SoterError as error:
            outcomes.append(failure(error))
            outcomes[-1].fields["file"] = name
    together = tuple(dict.fromkeys(d for outcome in outcomes for d in outcome.diagnostics))
    files = [{"exit": o.exit, "ok": o.exit == FINE, **o.fields} for o in outcomes]
    codes = {o.exit for o in outcomes}
    return CommandOutcome(
        DIAGNOSTICS if DIAGNOSTICS in codes else max(codes), together, {"files": files}
    )


def _check_file(file: str, args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Checks one file and prints the report; raises SoterError if it cannot read the file."""
    text = standard_input() if file == "-" else None
    with LineOfProgress(console) as line:
        program = load(file, line) if text is None else load(STDIN, line, text)
    bound_program(program, args)
    if not program.ok:
        fields: dict[str, object] = {"file": program.path, "program_sha256": program.sha256}
        return CommandOutcome(exit_code(program.diagnostics), program.diagnostics, fields)
    report = program.check(dict(args.params), times=args.times)
    _say_report(report, console)
    diagnostics = (*report.warnings, *report.untimely)
    return CommandOutcome(exit_code(diagnostics), diagnostics, DOCUMENT.of(report))


def _say_report(report: CheckReport, console: Console) -> None:
    modules = _modules_by_name(report)
    ok = console.paint(*(("red", "late") if exit_code(report.untimely) else ("green", "ok")))
    counted = (
        f"{_counted_noun(len(report.systems), 'system')}, {_counted_noun(len(modules), 'module')}"
    )
    proved = ""
    if modules:
        names = [p for p, v in next(iter(modules.values())).verdicts.items() if v == "proved"]
        proved = f": {' '.join(names)} hold"
    console.say(f"{ok}  {visible(report.path)}  {counted}{proved}  {report.program_sha256[:12]}")
    timed = {s.module for t in report.timings for s in t.switches if s.verdict == "holds"}
    unproved = dict.fromkeys(_without_p1c(x, timed) for s in report.systems for x in s.unproved)
    for line in (*unproved, *_step_lines(report)):
        console.say(console.paint("muted", f"    {line}"))
    for timing in report.timings:
        say_timing(timing, console)


def _without_p1c(line: str, timed: set[str]) -> str:
    """A line about assumptions, without P1c if the times of all its modules prove P1c."""
    return line.replace(" P1c", "", 1) if {*line.partition(": ")[0].split(", ")} <= timed else line


def _step_lines(report: CheckReport) -> list[str]:
    """Lines on the most costly steps, with the most operations and bytes of locals each takes."""
    ordered = sorted(report.steps, key=lambda s: -s.operations)
    lines = []
    for s in ordered[:STEPS_SHOWN]:
        kind = "a step" if s.kind == "node" else "a decision"
        beside = f", beside {', '.join(s.externs)}" if s.externs else ""
        size = f"{s.operations:,} operations and {s.stack_bytes:,} bytes of locals"
        lines.append(f"{s.name}: {kind} takes at most {size}{beside}")
    if len(ordered) > STEPS_SHOWN:
        lines.append(f"and {len(ordered) - STEPS_SHOWN} cheaper ones: `--json` has them all")
    return lines


def _counted_noun(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _modules_by_name(report: CheckReport) -> dict[str, ModuleReport]:
    return {m.name: m for s in report.systems for m in s.modules}


def _assumed_verdict(_: ModuleReport) -> str:
    return "assumed"


def _same_verdict(verdict: str) -> str:
    return verdict


VERDICT = one_of("proved", "assumed")
DOCUMENT = JsonObject(
    CheckReport,
    "file=path program_sha256 systems steps timings modules",
    {"modules": _modules_by_name},
    program_sha256={"type": ["string", "null"]},
    systems=JsonObject(
        SystemReport,
        "name default until_s hyperperiod_s components topics properties externs modules "
        "assumptions",
        modules=JsonObject(
            ModuleReport, "name period_s ac sc forced", forced=one_of("ac", "sc", None)
        ),
    ),
    steps=JsonObject(
        StepReport, "name kind operations stack_bytes externs", kind=one_of("node", "module")
    ),
    timings=TIMING,
    modules=JsonObject(
        ModuleReport,
        "verdict properties=verdicts",
        {"verdict": _assumed_verdict},
        verdict=VERDICT,
        properties=JsonObject(str, "verdict", {"verdict": _same_verdict}, verdict=VERDICT),
    ),
)
