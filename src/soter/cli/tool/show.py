"""`soter show FILE`: draws a system, and replays a log on the diagram.

Purpose: writes nodes, topics, modules and plants with their periods as an SVG to a file or to
standard output; with `--log` a page that animates the log.
Non-goals: time lines (`soter run --report`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.cli.terminal.command_line import SET, SYSTEM, CommandOutcome, Pairs, file_option, loaded
from soter.diagnostics.command_records import option

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


@dataclass(frozen=True, kw_only=True)
class Options:
    """Draw a system: nodes, topics, modules and plants."""

    file: str = file_option()
    system: str | None = option(*SYSTEM)
    params: Pairs = option(*SET)
    output: str | None = option(
        "-o --output FILE",
        None,
        "the SVG; by default .soter/PROGRAM-SYSTEM.svg; - is standard output",
    )
    log: str | None = option(
        "--log LOG", None, "a page that replays it, in a file, instead of an SVG"
    )
    NEEDS = (("!output=-", "log"),)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Draws the system, and writes the SVG or the page."""
    program = loaded(args, console)
    shown = program.diagram(args.system, dict(args.params))
    ending = "svg" if args.log is None else "html"
    default = str(Path(".soter") / f"{Path(args.file).stem}-{shown.system}.{ending}")
    path = args.output or default
    if args.log is not None:
        shown.write_replay(args.log, path)
        console.say(f"page  {path}")
    elif path == STANDARD_OUTPUT:
        console.say(shown.svg.rstrip())
    else:
        shown.write(path)
        console.say(f"diagram  {path}")
    fields = {
        "program_sha256": program.sha256,
        "system": shown.system,
        "diagram": None if path == STANDARD_OUTPUT or args.log is not None else path,
        "svg": shown.svg if path == STANDARD_OUTPUT else None,
        "page": None if args.log is None else path,
    }
    return CommandOutcome(fields=fields)
