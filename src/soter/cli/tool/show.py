"""`soter show FILE`: the diagram of a system, and a log replayed on it.

Purpose: nodes, topics, modules and plants with their periods as an SVG, in a file or on standard
output; with `--log` a page on which the log moves.
Non-goals: time lines (`soter run --report`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soter.api import load
from soter.cli.terminal.command_line import (
    FINE,
    CommandOutcome,
    CommandParser,
    add_file,
    add_settings,
    exit_of,
)
from soter.cli.terminal.progress import LineOfProgress
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter show cart.soter                    into .soter/: open it in a browser
  soter show cart.soter -o cart.svg
  soter show drone.soter --system Protected --set d.PERIOD=20ms
  soter show cart.soter -o - > cart.svg    on standard output
  soter show cart.soter --log cart.mcap -o cart.html    replay a log of `soter run --log`
"""
STANDARD_OUTPUT = "-"


def parser() -> CommandParser:
    """The command line."""
    made = CommandParser("show", "Draw a system: nodes, topics, modules and plants.", EXAMPLES)
    add_file(made)
    made.add_argument("--system", metavar="S", help="by default the only one, or the `default`")
    add_settings(made)
    made.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="the SVG; by default .soter/PROGRAM-SYSTEM.svg; - is standard output",
    )
    made.add_argument(
        "--log", metavar="LOG", help="a page that replays it, in a file, instead of an SVG"
    )
    return made


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Show."""
    with LineOfProgress(console) as line:
        program = load(args.file, line)
    try:
        shown = program.diagram(args.system, dict(args.params))
        ending = "svg" if args.log is None else "html"
        default = str(Path(".soter") / f"{Path(args.file).stem}-{shown.system}.{ending}")
        path = args.output or default
        if args.log is not None:
            path = default if path == STANDARD_OUTPUT else path  # a page is a file
            shown.write_replay(args.log, path)
            console.say(f"page  {path}")
        elif path == STANDARD_OUTPUT:
            console.say(shown.svg.rstrip())
        else:
            shown.write(path)
            console.say(f"diagram  {path}")
    except SoterError as error:
        return CommandOutcome(exit_of(error.diagnostics), error.diagnostics, {"file": args.file})
    fields = {
        "file": args.file,
        "program_sha256": program.sha256,
        "system": shown.system,
        "diagram": None if path == STANDARD_OUTPUT or args.log is not None else path,
        "svg": shown.svg if path == STANDARD_OUTPUT else None,
        "page": None if args.log is None else path,
    }
    return CommandOutcome(FINE, program.diagnostics, fields)
