"""`soter run FILE`: runs a system in virtual time, or with `--real-time` against the clock.

Purpose: runs, summarises, writes log and report. Exit code 3: a property was violated; 4: none was,
but the trusted part missed more releases in real time than `--misses` allows, or the record of a
flight is not complete.
Non-goals: how a run is done (`simulate/`, `targets/posix/`).
"""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from soter import __version__
from soter.addons import load_module
from soter.api import Program, require_writers
from soter.cli.terminal.child_process import fork_into_child
from soter.cli.terminal.command_line import keyword_arguments
from soter.cli.terminal.command_outcome import (
    DIAGNOSTICS,
    FINE,
    INTERRUPTED,
    UNDECIDED,
    VIOLATED,
    CommandOutcome,
)
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import bound_program, opened_program
from soter.cli.terminal.shared_options import CAMPAIGN_FOLDER, file_option
from soter.diagnostics.diagnostic import Diagnostic, SoterError, mistake
from soter.simulate.run_options import RunOptions

if TYPE_CHECKING:
    import argparse

    from soter.language.model.system import System
    from soter.simulate.result import Run
    from soter.simulate.run_log import RunLog

EXAMPLES = f"""\
  soter run cart.soter
  soter run cart.soter --system Unprotected --until 10s --seed 7
  soter run cart.soter --log --report          into .soter/; open the report in a browser
  soter run cart.soter --report a.html --self-contained       one file, to send
  soter run cart.soter --log out.mcap          for Foxglove, PlotJuggler, the mcap tools
  soter run cart.soter --set GAIN=3 --bind Learned=python:policy.py:step
  soter run cart.soter --flight 48123 --report what `soter campaign` flew under that number
  soter run cart.soter --flight 7 --arm ac     the same flight by the rules of that arm
  soter run cart.soter --recorded flight.rec --log       what a program of `soter build` recorded
  soter run cart.soter --engine interp         the reference interpreter: slow, the same bytes

in the folder of logs and reports: FILE-SYSTEM-SEED.mcap, FILE-SYSTEM-SEED.html and the script that
reports share (soter-plotly-....js)

{CAMPAIGN_FOLDER}"""
NAME_MAX = 150
"""Most characters of a file name that `_default_file_name` makes; file systems allow 255 bytes."""
OWN_PLACE = ""
"""The value of --log and --report without a path."""


@dataclass(frozen=True, kw_only=True)
class Options(RunOptions):
    """Run a system in virtual time."""

    file: str = file_option()


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Runs the system, prints the summary and writes log and report."""
    program = opened_program(args, console)
    if program.externs:
        fork_into_child(console, lambda process: _repair_logs(args, process))
    first_seed = args.seed
    if args.flight is not None:
        args.seed = (args.seed + args.flight) % 2**64
    console.listen_to_signals()
    args.home = Path.cwd()  # an extern may change the current folder
    bound_program(program, args)
    if args.arm == "paper" and args.campaign is None:
        args.campaign = _campaign_folder(program, args, first_seed)
    _require_writable_outputs(args)
    log = _new_run_log(args)
    return _tell_run(program, _simulate(program, args, console, log), args, console, log)


def _simulate(
    program: Program, args: argparse.Namespace, console: Console, log: RunLog | None
) -> Run:
    with ProgressBar(console) as progress:
        how = {**keyword_arguments(args, Options), "log": log, "report": None, "progress": progress}
        apart, trace = console.own_process, args.report is not None
        result = program.simulate(**how, trace=trace, partial=True, apart=apart)
    if result.timing is not None:
        result.timing["misses_allowed"] = args.misses
    return result


def _campaign_folder(program: Program, args: argparse.Namespace, first_seed: int) -> Path:
    """The default folder of the campaign that has the flight to repeat."""
    flat = program.flat(args.system, dict(args.params))
    own_folder = load_module("soter.api.campaigning").own_folder
    return cast("Path", own_folder(flat, program.path, args.until, first_seed))


def _tell_run(
    program: Program, result: Run, args: argparse.Namespace, console: Console, log: RunLog | None
) -> CommandOutcome:
    """Prints the summary and then writes files, so that a failed write cannot hide the result."""
    from soter.cli.terminal.run_summary import run_summary  # noqa: PLC0415 - needs NumPy
    from soter.simulate.run_fields import DOCUMENT  # noqa: PLC0415 - needs NumPy

    console.say(run_summary(result, args.file, console, why=args.why))
    written, problems = _write_files(program, result, args, log, console)
    lines = [f"{kind:<7} {path}" for kind, path in written.items()]
    if result.trace_sha256:
        lines.append(console.paint("muted", f"trace   {result.trace_sha256}"))
    console.say("\n" + "\n".join(lines))
    violated = result.violations or (result.timing or {}).get("violations", 0)  # after a gap, too
    code = VIOLATED if violated else UNDECIDED if result.late or result.cut else FINE
    code = INTERRUPTED if result.interrupted else DIAGNOSTICS if problems else code
    return CommandOutcome(code, problems, {**DOCUMENT.of(result), **written})


def _require_writable_outputs(args: argparse.Namespace) -> None:
    """Raises SoterError before the run if its log or report could not be written later."""
    probe = Path(args.output) / "probe"
    log, report = (probe if p == OWN_PLACE else p for p in (args.log, args.report))
    require_writers(log, report)
    if args.log and args.report and _are_one_file(args.log, args.report):
        raise mistake("U001", f"log and report cannot both be `{args.log}`")


def _are_one_file(log: str, report: str) -> bool:
    return log not in {OWN_PLACE, os.devnull} and Path(log).resolve() == Path(report).resolve()


def _default_file_name(args: argparse.Namespace, system: System) -> str:
    """A file name made of program, system, seed, arm and parameters, so that runs differ in it."""
    parts = [Path(args.file).stem, system.name, str(args.seed)]
    parts[2:] = [Path(args.recorded).stem] if args.recorded is not None else parts[2:]
    parts += [args.arm] if args.arm else []
    parts += [f"{name}={value}" for name, value in args.params]
    name = "-".join(re.sub(r"[^A-Za-z0-9_.=+-]", "_", part) for part in parts)
    if len(name) > NAME_MAX:
        return f"{name[:NAME_MAX]}-{hashlib.sha256(name.encode()).hexdigest()[:12]}"
    return name


def _path_of_output(args: argparse.Namespace, system: System, kind: str, ending: str) -> str:
    """The path of the log or report (`kind`): as given, else the default name in the folder."""
    path: str = getattr(args, kind)
    if path == OWN_PLACE:
        return str(Path(args.output) / f"{_default_file_name(args, system)}{ending}")
    return path


def _new_run_log(args: argparse.Namespace) -> RunLog | None:
    """The writer that fills the log during the run; None without `--log`."""
    if args.log is None:
        return None
    from soter.simulate.run_log import RunLog  # noqa: PLC0415 - an extra

    return RunLog(lambda system: Path(_path_of_output(args, system, "log", ".mcap")), __version__)


def _repair_logs(args: argparse.Namespace, process: int) -> tuple[str, ...]:
    """Repairs logs that the dead process `process` left unfinished; gives a sentence for each."""
    if args.log is None:
        return ()
    from soter.report.atomic_write import files_left_by  # noqa: PLC0415 - only after a crash
    from soter.report.mcap_log import mend_log  # noqa: PLC0415 - only after a crash

    folder = Path(args.output) if args.log == OWN_PLACE else Path(args.log).resolve().parent
    saved = []
    for part, path in files_left_by(folder, process):
        if mend_log(part):
            part.replace(path)
            where = os.path.relpath(path) if args.log == OWN_PLACE else args.log
            saved.append(f"the log until then is `{where}`")
    return tuple(saved)


def _write_files(
    program: Program, result: Run, args: argparse.Namespace, log: RunLog | None, console: Console
) -> tuple[dict[str, str], tuple[Diagnostic, ...]]:
    """Paths of the written files by kind, and diagnostics for those that could not be written."""
    written: dict[str, str] = {}
    problems: list[Diagnostic] = []
    if log is not None:
        for part in log.unfinished:
            where = os.path.relpath(part, args.home)
            console.note(
                f"an unfinished log of an earlier run: `{where}` (`mcap recover` reads it)"
            )
        if log.problem is None:
            written["log"] = _path_of_output(args, result.system, "log", ".mcap")
        else:
            problems += log.problem.diagnostics
    if args.report is not None:
        path = _path_of_output(args, result.system, "report", ".html")
        try:
            place = Path(args.home, path)
            program.write_report(result, place, self_contained=args.self_contained)
            written["report"] = path
        except SoterError as error:
            problems += error.diagnostics
    return written, tuple(problems)
