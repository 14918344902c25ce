"""`soter show FILE`: draws a system, or prints its Core.

Purpose: writes nodes, topics, modules and plants with their periods as an SVG to a file or to
standard output; with `--core` prints what the system is lowered to.
Non-goals: time lines (`soter run --report`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.shared_options import SET, SYSTEM, file_option
from soter.diagnostics.command_records import option

if TYPE_CHECKING:
    import argparse

    from soter.api.program import Program
    from soter.cli.terminal.command_line import Pairs
    from soter.cli.terminal.console import Console
    from soter.language.model.system import System

EXAMPLES = """\
  soter show cart.soter                    into .soter/: open it in a browser
  soter show cart.soter -o cart.svg
  soter show drone.soter --system Protected --set d.PERIOD=20ms
  soter show cart.soter -o - > cart.svg    on standard output
  soter show cart.soter --core             functions, steps, predicates as they are lowered
"""
STANDARD_OUTPUT = "-"
NO_REPLAY = (
    "logs are not replayed on the diagram any more: `soter run --report` draws a run over time, "
    "and log tools open what `soter run --log` writes"
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Draw a system: nodes, topics, modules and plants; or print what is compiled of it."""

    file: str = file_option()
    system: str | None = option(*SYSTEM)
    params: Pairs = option(*SET)
    output: str | None = option(
        "-o --output FILE",
        None,
        "the SVG; by default .soter/PROGRAM-SYSTEM.svg; - is standard output",
    )
    core: bool = option(
        "--core", False, "print Core, which is compiled and proved, in place of a drawing"
    )
    NEEDS = (("!core", "output"),)
    GONE = (("--log", NO_REPLAY),)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Draws the system, and writes the SVG or prints Core."""
    program = loaded_program(args, console)
    if args.core:
        return _print_core(program.declared(args.system, dict(args.params)), program, console)
    shown = program.diagram(args.system, dict(args.params))
    path = args.output or str(Path(".soter") / f"{Path(args.file).stem}-{shown.system}.svg")
    if path == STANDARD_OUTPUT:
        console.say(shown.svg.rstrip())
    else:
        shown.write(path)
        console.say(f"diagram  {path}")
    fields = {
        "program_sha256": program.sha256,
        "system": shown.system,
        "diagram": None if path == STANDARD_OUTPUT else path,
        "svg": shown.svg if path == STANDARD_OUTPUT else None,
        "core": None,
    }
    return CommandOutcome(fields=fields)


def _print_core(system: System, program: Program, console: Console) -> CommandOutcome:
    from soter.core.core_text import core_text  # noqa: PLC0415 - only then
    from soter.core.steps import lower  # noqa: PLC0415 - the same

    text = core_text(system, lower(system))
    console.say(text.rstrip())
    fields = {"program_sha256": program.sha256, "system": system.name, "diagram": None, "svg": None}
    return CommandOutcome(fields={**fields, "core": text})
