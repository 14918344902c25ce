"""`soter measure FILE`: how long single steps take on this machine.

Purpose: a table, a file of times, the `wcet` lines to paste; that this is no bound.
Non-goals: the stopwatch (`soter.measure`), what follows from the times (`soter check`).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from soter.cli.terminal.child_process import in_child_process
from soter.cli.terminal.command_line import (
    FINE,
    CommandOutcome,
    CommandParser,
    UsageError,
    add_file,
    add_settings,
    at_least_one,
    exit_of,
    seed,
)
from soter.cli.terminal.open_program import loaded
from soter.cli.terminal.progress import ProgressBar
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.durations import show_ns

if TYPE_CHECKING:
    from soter.api.measuring import Measured
    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter measure cart.soter                 writes .soter/cart-times.json
  soter measure cart.soter --system Protected --until 20s --samples 100000
  soter measure cart.soter --margin 3      wcet: three times the longest that was seen
  soter check cart.soter --times .soter/cart-times.json
  soter measure cart.soter --board my_board.c --instruction 20ns
                                           instructions in QEMU, times a factor that you state

The compiled steps of the trusted thread (decision modules, safe controllers, other nodes that
are Soter code) are timed one by one, from states of a run and from states with random reads,
with caches as they are and swept. The suggested `wcet` is the longest times the margin. That is
no bound: the longest that can happen may not have been seen, and another machine is another
matter.

exit codes: 0 measured, 1 diagnostics, 2 usage
"""


def parser() -> CommandParser:
    """The command line."""
    from soter.api.measuring import MARGIN, SAMPLES  # noqa: PLC0415 - needs NumPy

    made = CommandParser(
        "measure", "Time the steps of the trusted thread on this machine.", EXAMPLES
    )
    add_file(made)
    made.add_argument("--system", metavar="S", help="by default the only one, or the `default`")
    made.add_argument("--until", metavar="TIME", help="of the run; by default the system's own")
    made.add_argument("--seed", metavar="N", type=seed, default=1, help="by default 1")
    made.add_argument(
        "--samples",
        metavar="N",
        type=at_least_one,
        default=SAMPLES,
        help=f"steps that are timed of each ({SAMPLES:,})",
    )
    made.add_argument(
        "--margin",
        metavar="X",
        type=_factor,
        default=MARGIN,
        help=f"what the longest is multiplied with ({MARGIN:g})",
    )
    made.add_argument("--board", metavar="B", help="count instructions there (docs/bare-metal.md)")
    made.add_argument(
        "--instruction", metavar="TIME", help="how long one takes there at most: 20ns"
    )
    add_settings(made)
    made.add_argument("-o", dest="output", metavar="FILE", help="the file (.soter/...-times.json)")
    return made


def _factor(text: str) -> float:
    """A margin; ArgumentTypeError for other text."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}` is no number") from None


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Measure; UsageError for one of `--board` and `--instruction` alone."""
    from soter.api.measuring import document, measure, measure_on_board, written  # noqa: PLC0415 - needs NumPy

    if (args.board is None) != (args.instruction is None):
        message = "`--board` counts instructions, and `--instruction` makes times of them: say both"
        raise UsageError(message, parser().format_usage())
    program = loaded(args, console)
    if program.externs:
        in_child_process(console, lambda _: ())
    path = Path(args.output or Path(".soter") / f"{Path(args.file).stem}-times.json")
    try:
        with ProgressBar(console) as progress:
            if args.board is not None:
                measurement = measure_on_board(
                    program,
                    args.board,
                    args.instruction,
                    args.system,
                    dict(args.params),
                    margin=args.margin,
                )
            else:
                measurement = measure(
                    program,
                    args.system,
                    dict(args.params),
                    until=args.until,
                    samples=args.samples,
                    margin=args.margin,
                    seed=args.seed,
                    progress=progress,
                )
    except SoterError as error:
        return CommandOutcome(exit_of(error.diagnostics), error.diagnostics, {"file": args.file})
    written(measurement, path)
    _say(measurement, path, console)
    told = document(measurement)
    keys = ("system", "program_sha256", "machine", "margin", "assumed", "steps")
    fields = {k: told[k] for k in keys}
    return CommandOutcome(
        FINE, program.diagnostics, {"file": args.file, "times": str(path), **fields}
    )


def _say(measurement: Measured, path: Path, console: Console) -> None:
    from soter.api.measuring import COUNTS, NO_BOUND  # noqa: PLC0415 - as above

    if not measurement.steps:
        console.say(f"nothing of `{measurement.system}` runs in the trusted thread as Soter code")
        return
    shares = [f"{q:g}%" for q, _ in measurement.steps[0].percentiles]
    rows = [
        [s.name, *(show_ns(ns) for _, ns in s.percentiles), show_ns(s.longest_ns), f"{s.samples}"]
        for s in measurement.steps
    ]
    console.say(console.table(("step", *shares, "longest", "steps"), rows))
    console.say()
    for s in measurement.steps:
        where = f"rta {s.declared}" if s.role == "dm" else f"node {s.declared}"
        faulted = f", {s.faulted} of the steps faulted" if s.faulted else ""
        console.say(f"  {s.line:<14} // {where}: {measurement.margin:g} x the longest{faulted}")
    console.say()
    console.say(f"times   {path}")
    if measurement.assumed:
        console.say(f"assumed: {measurement.assumed}")
    console.say(f"{COUNTS if measurement.assumed else NO_BOUND} ({measurement.machine})")
