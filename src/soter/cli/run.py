"""`soter run FILE`: a system in virtual time.

Purpose: run, summarise, write log and report; exit 3 where a property was violated.
Non-goals: real time. `--real-time` only paces the virtual-time driver.
"""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api import ENGINES, Program, load, require_writers
from soter.cli.outcome import DIAGNOSTICS, FINE, INTERRUPTED, VIOLATED, Outcome, exit_of
from soter.cli.parser import Parser, add_file, add_settings, seed
from soter.cli.progress import Progress
from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    import argparse

    from soter.cli.console import Console
    from soter.simulate.run import Run

EXAMPLES = """\
  soter run cart.soter
  soter run cart.soter --system Unprotected --until 10s --seed 7
  soter run cart.soter --log --report          into .soter/; open the report in a browser
  soter run cart.soter --log out.mcap          for Foxglove, PlotJuggler, the mcap tools
  soter run cart.soter --set GAIN=3 --bind Learned=python:policy.py:step
  soter run cart.soter --engine interp         the reference interpreter: slow, the same bytes
"""
NAME_MAX = 150
"""Characters of a file's own name; file systems allow 255 bytes."""
OWN_PLACE = ""
"""The value of --log and --report without a path."""


def parser() -> Parser:
    """The command line."""
    made = Parser("run", "Run a system in virtual time.", EXAMPLES)
    add_file(made)
    made.add_argument("--system", metavar="S", help="by default the only one, or the `default`")
    made.add_argument("--until", metavar="TIME", help="such as 30s; by default the system's own")
    made.add_argument("--seed", metavar="N", type=seed, default=1, help="by default 1")
    made.add_argument(
        "--engine", choices=ENGINES, default="native", help="native C, or the reference interpreter"
    )
    add_settings(made)
    made.add_argument("--log", nargs="?", const=OWN_PLACE, metavar="PATH", help="write an MCAP log")
    made.add_argument(
        "--report", nargs="?", const=OWN_PLACE, metavar="PATH", help="write an HTML report"
    )
    made.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        default=".soter",
        help="folder of logs and reports without a path; by default .soter",
    )
    made.add_argument(
        "--real-time",
        action="store_true",
        help="pace the run against the clock (best effort, not the real-time runtime)",
    )
    return made


def run(args: argparse.Namespace, console: Console) -> Outcome:
    """Run."""
    program = load(args.file)
    for name, target in args.bindings:
        program.bind(name, target)
    warnings = program.diagnostics if program.ok else ()
    try:
        _look_ahead(args)
        result = _simulate(program, args, console)
    except SoterError as error:
        items = (*warnings, *error.diagnostics)
        return Outcome(exit_of(items), items, {"file": args.file})
    return _finish(program, result, args, console, warnings)


def _simulate(program: Program, args: argparse.Namespace, console: Console) -> Run:
    with Progress(console) as progress:
        return program.simulate(
            args.system,
            args.until,
            args.seed,
            args.engine,
            dict(args.params),
            trace=args.log is not None or args.report is not None,
            progress=progress,
            real_time=args.real_time,
            partial=True,
        )


def _finish(
    program: Program,
    result: Run,
    args: argparse.Namespace,
    console: Console,
    warnings: tuple[Diagnostic, ...],
) -> Outcome:
    """Summary, files, exit code: files that cannot be written do not hide the result."""
    from soter.cli.run_summary import summary  # noqa: PLC0415 - needs NumPy
    from soter.simulate.figures import run_figures  # noqa: PLC0415 - needs NumPy

    console.say(summary(result, args.file, console))
    written, problems = _files(program, result, args)
    lines = [f"{kind:<7} {path}" for kind, path in written.items()]
    if result.trace_sha256:
        lines.append(console.paint("muted", f"trace   {result.trace_sha256}"))
    console.say("\n" + "\n".join(lines))
    code = VIOLATED if result.violations else FINE
    if problems:
        code = DIAGNOSTICS
    if result.interrupted:
        code = INTERRUPTED
    fields = {"file": args.file, **run_figures(result), **written}
    return Outcome(code, (*warnings, *problems), fields)


def _look_ahead(args: argparse.Namespace) -> None:
    """Say before a run, not after it, that its log or report cannot be written."""
    probe = Path(args.output) / "probe"
    log, report = (probe if p == OWN_PLACE else p for p in (args.log, args.report))
    require_writers(log, report)
    if args.log and args.report and _same(args.log, args.report):
        problem = Diagnostic("U001", f"log and report cannot both be `{args.log}`")
        raise SoterError((problem,))


def _same(log: str, report: str) -> bool:
    return log not in {OWN_PLACE, os.devnull} and Path(log).resolve() == Path(report).resolve()


def _own_name(args: argparse.Namespace, result: Run) -> str:
    """Program, system, seed and what was set on the command line: no sweep overwrites itself."""
    parts = [Path(args.file).stem, result.system.name, str(result.seed)]
    parts += [f"{name}={value}" for name, value in args.params]
    name = "-".join(re.sub(r"[^A-Za-z0-9_.=+-]", "_", part) for part in parts)
    if len(name) > NAME_MAX:
        digest = hashlib.sha256(name.encode()).hexdigest()[:12]
        return f"{name[:NAME_MAX]}-{digest}"
    return name


def _files(
    program: Program, result: Run, args: argparse.Namespace
) -> tuple[dict[str, str], tuple[Diagnostic, ...]]:
    """Paths of what was written, by kind, and what could not be."""
    written: dict[str, str] = {}
    problems: list[Diagnostic] = []
    writers = (("log", ".mcap", program.write_log), ("report", ".html", program.write_report))
    for kind, ending, write in writers:
        path = getattr(args, kind)
        if path is None:
            continue
        if path == OWN_PLACE:
            path = str(Path(args.output) / f"{_own_name(args, result)}{ending}")
        try:
            write(result, path)
            written[kind] = path
        except SoterError as error:
            problems += error.diagnostics
    return written, tuple(problems)
