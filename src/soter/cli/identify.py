"""`soter identify LOG... --program FILE`: values of parameters that explain logs.

Purpose: fits what a program leaves open to logs, prints what that says and what it does not, and
writes the values as a file that the program reads.
Non-goals: the fit (`monitor/identification.py`), reading logs (`api/identifying.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.cli.terminal.command_outcome import FINE, VIOLATED, CommandOutcome
from soter.cli.terminal.console import ProgressBar
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.shared_options import MODULE, SET, SYSTEM, report_option, report_path
from soter.diagnostics.command_records import SEVERAL, SWITCH, JsonObject, option
from soter.diagnostics.render import safe

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from soter.cli.terminal.command_line import Pairs
    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter identify flight*.mcap --program cart.soter             logs of `soter run --log`
  soter identify leg*.csv --program drone.soter --map px4.toml     logs of somebody else
  soter identify flight.ulg --program drone.soter --map px4.toml --episode 10s     one, in pieces
  soter identify flight*.mcap --program cart.soter --open DRAG --open WIND

Every second episode is held out. Parameters of the model are fitted to the others, bounds are the
least that explain them, and are scaled until the held-out ones are explained, too. What was fitted
is never proved: `soter verify` lists it among what a proof takes for granted.

exit codes: 0 every step is explained, 3 nothing that the program permits explains one,
1 diagnostics, 2 usage
"""
ENDING = "-identify.html"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Fits open parameters to logs: model, bounds of disturbances, errors of measurements."""

    logs: Sequence[str] = option("LOG...", (), "each is an episode; what `soter monitor` reads")
    file: str = option("--program FILE", ..., "whose `param`s are open", json_name="file")
    open: Sequence[str] = option(
        "--open NAME", (), "a parameter to fit; by default all that plants and bounds need", SEVERAL
    )
    episode: str | None = option("--episode TIME", None, "cut each log into pieces that long")
    output: str = option("-o --output FILE", "fit.json", "the values, as data; {default}")
    map: str | None = option("--map FILE", None, "TOML or JSON: which topic is what in a LOG")
    estimates: bool = option(
        "--estimates", False, "fit what was measured, not the true states", SWITCH
    )
    system: str | None = option(*SYSTEM)
    module: str | None = option(*MODULE)
    report: str | None = report_option("the fit", ENDING)
    params: Pairs = option(*SET)
    NEEDS = (("!map", "estimates"),)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Fits, prints, and writes the values if they explain every step; may raise SoterError U001."""
    from soter.api import identifying  # noqa: PLC0415 - needs NumPy

    identifying.require_replaceable(Path(args.output))
    program = loaded_program(args, console)
    with ProgressBar(console, timed=False):
        found = identifying.identify(
            program,
            args.logs,
            args.map,
            opened=args.open,
            episode=args.episode,
            module=args.module,
            system=args.system,
            estimates=args.estimates,
            params=dict(args.params),
        )
    data = identifying.data_path(args.file, args.output)
    console.say(f"{console.paint('bold', safe(identifying.fit_headline(found)))}\n")
    values, inputs, lines = identifying.fit_sections(found, data)
    for part in (values, inputs):
        console.say(console.table(part.head, part.rows) + "\n")
        for text in part.says:
            console.say(f"{text}\n")
    fields = DOCUMENT.of(found)
    if found.alarm is None:
        identifying.write_fit(found, Path(args.output))
        console.say(f"wrote {args.output}; {args.file} reads it by\n")
        console.say("\n".join(f"  {line}" for line in lines.says))
        fields["output"] = args.output
    if args.report is not None:
        page = report_path(args.report, args.file, ENDING)
        identifying.write_page(found, args.file, data, page)
        console.say(f"\nreport  {page}")
        fields["report"] = str(page)
    return CommandOutcome(FINE if found.alarm is None else VIOLATED, fields=fields)


RECORD = "soter.monitor.identification"
DOCUMENT = JsonObject(
    f"{RECORD}.Identification",
    "values declared bounds kept episodes held_out rate factor steps judged_share cut_s "
    "never_excited excitation alarm alarms logs program_sha256",
    alarm=JsonObject(f"{RECORD}.EpisodeAlarm", "module episode at_s states"),
    beside={"output?": str, "report?": str},
)
