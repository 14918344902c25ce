"""`soter monitor FILE [LOG]`: whether the model that was proved explains what was recorded.

Purpose: judge a log, or a fresh run, module by module; or write the monitor as a Soter node.
Non-goals: the judgement (`monitor/membership.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.api import load
from soter.cli.terminal.apart import apart
from soter.cli.terminal.outcome import FINE, VIOLATED, Outcome, exit_of
from soter.cli.terminal.parser import Parser, add_file, add_settings, seed
from soter.cli.terminal.progress import LineOfProgress
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console
    from soter.monitor.membership import Judgement

EXAMPLES = """\
  soter run drone.soter --log flight.mcap
  soter monitor drone.soter flight.mcap            on the true states of a log
  soter monitor drone.soter --seed 7               on those of a fresh run
  soter monitor drone.soter flight.mcap --estimates     on what the DM saw
  soter monitor drone.soter --emit watch.soter     the monitor as a trusted node

exit codes: 0 every step is explained, 3 an alarm: the model is false, 1 diagnostics, 2 usage
"""


def parser() -> Parser:
    """The command line."""
    made = Parser("monitor", "Does the verified model explain a recorded run?", EXAMPLES)
    add_file(made)
    made.add_argument("log", nargs="?", metavar="LOG", help="an MCAP log; by default a fresh run")
    made.add_argument("--system", metavar="S", help="by default the only one, or the `default`")
    made.add_argument("--module", metavar="M", help="only this module; by default all")
    made.add_argument("--until", metavar="TIME", help="of a fresh run; by default the system's")
    made.add_argument("--seed", metavar="N", type=seed, default=1, help="by default 1")
    made.add_argument(
        "--estimates", action="store_true", help="judge what was measured, not the true states"
    )
    made.add_argument("--emit", metavar="PATH", help="write the monitor as a Soter node")
    made.add_argument("--alarm", metavar="TOPIC", help="with --emit: a bool topic of the program")
    add_settings(made)
    return made


def run(args: argparse.Namespace, console: Console) -> Outcome:
    """Judge, or write the node."""
    with LineOfProgress(console) as line:
        program = load(args.file, line)
    if program.externs and args.log is None and args.emit is None:
        apart(console, lambda _: ())
    for name, target in args.bindings:
        program.bind(name, target)
    warnings = program.diagnostics if program.ok else ()
    try:
        if args.emit is not None:
            program.emit_monitor(
                args.emit,
                args.module,
                system=args.system,
                params=dict(args.params),
                alarm=args.alarm,
            )
            console.say(f"wrote {args.emit}")
            fields = {"file": args.file, "emitted": args.emit, "modules": {}}
            return Outcome(FINE, warnings, fields)
        judged = program.monitor(
            args.log,
            args.module,
            system=args.system,
            until=args.until,
            seed=args.seed,
            params=dict(args.params),
            estimates=args.estimates,
        )
    except SoterError as error:
        items = (*warnings, *error.diagnostics)
        return Outcome(exit_of(items), items, {"file": args.file})
    _say(judged, args, console)
    alarms = sum(j.alarms for j in judged)
    fields = {"file": args.file, "emitted": None, "modules": {j.module: _fields(j) for j in judged}}
    return Outcome(VIOLATED if alarms else FINE, warnings, fields)


def _say(judged: list[Judgement], args: argparse.Namespace, console: Console) -> None:
    from soter.report.summary import table  # noqa: PLC0415 - not for --help

    rows = [
        (
            j.module,
            f"{j.steps:,}",
            f"{j.alarms:,}",
            "" if j.first_alarm_s is None else f"{j.first_alarm_s:.3f} s",
            "" if j.source == "estimates" else f"{j.share:.0%}",
            j.state,
        )
        for j in judged
    ]
    console.say(f"{args.log or args.file}  judged on {judged[0].source if judged else 'nothing'}\n")
    head = ("module", "steps", "alarms", "first alarm", "most of the disturbance used", "by")
    console.say(table(head, rows))
    if any(j.alarms for j in judged):
        console.say(
            "\nan alarm: no disturbance within its declared bounds explains the step. The model is "
            "false, and what was proved with it says nothing about this run."
        )


def _fields(j: Judgement) -> dict[str, object]:
    return {
        "source": j.source,
        "steps": j.steps,
        "alarms": j.alarms,
        "first_alarm_s": j.first_alarm_s,
        "largest_share": None if j.source == "estimates" else j.share,
        "state": j.state or None,
        "alarm_states": j.alarm_states,
    }
