"""`soter measure FILE`: how long single steps take on this machine.

Purpose: prints a table and `wcet` lines to paste, writes a file of times; it shows no bound.
Non-goals: the stopwatch (`soter.measure`), what follows from the times (`soter check`).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.cli.terminal.child_process import fork_into_child
from soter.cli.terminal.command_outcome import CommandOutcome
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.shared_options import SET, SYSTEM, file_option
from soter.diagnostics.command_records import Kind, option, read_by
from soter.language.model.types import show_ns
from soter.measure import MARGIN, SAMPLES

if TYPE_CHECKING:
    from soter.api.measuring import Measured
    from soter.cli.terminal.command_line import Pairs

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


def _margin_factor(text: str) -> float:
    """The factor that `--margin` gives; ArgumentTypeError for other text."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}` is no number") from None


@dataclass(frozen=True, kw_only=True)
class Options:
    """Time the steps of the trusted thread on this machine."""

    file: str = file_option()
    system: str | None = option(*SYSTEM)
    until: str | None = option("--until TIME", None, "of the run; by default the system's own")
    seed: int = option("--seed N", 1, "by default 1", Kind("seed"))
    samples: int = option(
        "--samples N", SAMPLES, f"steps that are timed of each ({SAMPLES:,})", Kind("bound")
    )
    margin: float = option(
        "--margin X",
        MARGIN,
        f"what the longest is multiplied with ({MARGIN:g})",
        read_by(_margin_factor),
    )
    board: str | None = option("--board B", None, "count instructions there (docs/bare-metal.md)")
    instruction: str | None = option(
        "--instruction TIME", None, "how long one takes there at most: 20ns"
    )
    params: Pairs = option(*SET)
    output: str | None = option("-o FILE", None, "the file (.soter/...-times.json)")
    NEEDS = (("!board", "until seed samples"), ("board", "instruction"), ("instruction", "board"))


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Measures the steps, prints their times and writes the file of times."""
    from soter.api.measuring import DOCUMENT, measure, measure_on_board, write_measurement  # noqa: PLC0415 - needs NumPy

    program = loaded_program(args, console)
    if program.externs:
        fork_into_child(console, lambda _: ())
    path = Path(args.output or Path(".soter") / f"{Path(args.file).stem}-times.json")
    choices: dict[str, Any] = {"system": args.system, "params": dict(args.params)}
    choices["margin"] = args.margin
    with ProgressBar(console) as progress:
        if args.board is not None:
            measurement = measure_on_board(program, args.board, args.instruction, **choices)
        else:
            choices |= {"until": args.until, "samples": args.samples, "seed": args.seed}
            measurement = measure(program, progress=progress, **choices)
    write_measurement(measurement, path)
    _say_measurement(measurement, path, console)
    return CommandOutcome(fields={"times": str(path), **DOCUMENT.of(measurement)})


def _say_measurement(measurement: Measured, path: Path, console: Console) -> None:
    from soter.api.measuring import COUNTS, NO_BOUND  # noqa: PLC0415 - as above

    if not measurement.steps:
        console.say(f"nothing of `{measurement.system}` runs in the trusted thread as Soter code")
        return
    shares = [f"{q:g}%" for q, _ in measurement.steps[0].percentiles]
    rows = [
        [
            s.name,
            *(show_ns(ns) for _, ns in s.percentiles),
            show_ns(s.longest_ns),
            f"{s.samples}",
        ]
        for s in measurement.steps
    ]
    console.say(console.table(("step", *shares, "longest", "steps"), rows) + "\n")
    for s in measurement.steps:
        where = f"rta {s.declared}" if s.role == "dm" else f"node {s.declared}"
        faulted = f", {s.faulted} of the steps faulted" if s.faulted else ""
        console.say(f"  {s.line:<14} // {where}: {measurement.margin:g} x the longest{faulted}")
    console.say(f"\ntimes   {path}")
    if measurement.assumed:
        console.say(f"assumed: {measurement.assumed}")
    console.say(f"{COUNTS if measurement.assumed else NO_BOUND} ({measurement.machine})")
