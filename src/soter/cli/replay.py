"""`soter replay TRACE`: runs a trace again, in the reference interpreter.

Purpose: tells whether a trace of `soter test`, or a counterexample of `soter verify`, reproduces,
and prints its steps as text or JSON; on request it writes an MCAP log and a page.
Non-goals: running it (`explore/replay.py`, `verify/counterexample.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.api import ReplayReport, replay
from soter.api.rechecking import counterexample_table
from soter.cli.terminal.command_outcome import FINE, VIOLATED, CommandOutcome, exit_code
from soter.cli.terminal.shared_options import file_option, report_option, report_path
from soter.diagnostics.command_records import JsonObject, one_of, option
from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console

EXAMPLES = """\
  soter replay .soter/late_sc-Late.trace.json               every step, and whether it reproduces
  soter replay late.trace.json --report late.html           to look at: signals, modes, steps
  soter replay late.trace.json --mcap late.mcap             for log tools
  soter replay late.trace.json --json | jq '.steps[-1]'
  soter replay .soter/cart-SafeCart.counterexample.json     of `soter verify`: a table, no --mcap

exit codes: 0 reproduced, 3 not reproduced, 1 diagnostics, 2 usage
"""
ENDING = "-replay.html"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run a trace again, in the reference interpreter."""

    trace: str = file_option("TRACE", "a file of `soter test` or `soter verify`", json_name="trace")
    html: str | None = report_option(
        "the run with the instant that violates", ENDING, "--report --html"
    )
    mcap: str | None = option("--mcap PATH", None, "write the steps as an MCAP log")


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Replays the trace, prints its steps, and writes the files that options ask for."""
    if args.html is not None:
        args.html = str(report_path(args.html, args.trace, ENDING))
    report = replay(args.trace)
    _say_steps(report, console)
    written, problems = _write_files(report, args)
    for kind, path in written.items():
        console.say(f"{kind:<6} {path}")
    code = FINE if report.reproduced else VIOLATED
    if problems:
        code = exit_code(problems)
    return CommandOutcome(code, problems, {**_document_fields(report), **written})


def _write_files(
    report: ReplayReport, args: argparse.Namespace
) -> tuple[dict[str, str], tuple[Diagnostic, ...]]:
    """Paths of the written files by kind, and diagnostics for those that could not be written."""
    written: dict[str, str] = {}
    problems: list[Diagnostic] = []
    for kind, write in (("html", report.write_html), ("mcap", report.write_mcap)):
        path = getattr(args, kind)
        if path is None:
            continue
        try:
            write(path)
            written[kind] = path
        except SoterError as error:
            problems += error.diagnostics
    return written, tuple(problems)


# ---------------------------------------------------------------- for people


def _say_steps(report: ReplayReport, console: Console) -> None:
    if console.json:
        return
    from soter.report.wording import visible  # noqa: PLC0415 - only then

    title = f"{report.program}  {report.program_sha256[:12]}"
    if report.trace is not None:
        title += f"  {report.trace.trace.system}, test {report.trace.trace.test}"
    console.say(console.paint("muted", visible(title)))
    word = ("green", "REPRODUCED") if report.reproduced else ("red", "NOT REPRODUCED")
    console.say(f"{console.paint(*word)}  {visible(report.outcome)}")
    console.say("\n".join(("", *_step_lines(report, console))))


def _step_lines(report: ReplayReport, console: Console) -> list[str]:
    if report.trace is not None:
        from soter.report.sequence_view import table_text  # noqa: PLC0415 - needs NumPy
        from soter.report.wording import visible  # noqa: PLC0415 - the same

        view = report.view()
        lines = table_text(view, color=console.color_out, width=console.width)
        return [*lines, visible(view.remark)] if view.remark else lines
    if report.counterexample is None:
        return []
    same, head, rows = counterexample_table(report.counterexample)
    return [*([same, ""] if same else []), console.table(head, rows)]


# ---------------------------------------------------------------- as JSON


STEP = JsonObject(
    "soter.explore.replay.ReplayedStep",
    "step=number actor kind release_ns time_ns choices published gated decided fault dropped "
    "observable violated=violated.text reasons modes topics truth",
    kind=one_of("start", "step", "lost", "begin", "effect"),
    choices=JsonObject("soter.explore.trace.Choice", "stream pick of value", value={}),
    dropped=JsonObject(
        "soter.explore.replay.DroppedMessage",
        "queue policy",
        policy=one_of("drop_oldest", "drop_newest", "fault"),
    ),
)
STEPS = JsonObject(
    "soter.explore.replay.Replayed",
    "system=trace.system test=trace.test property=trace.broken.text minimal=trace.minimal "
    "not_shortest=trace.not_shortest? assumptions=trace.assumptions violated_at steps",
    steps=(STEP, {"$ref": "instant.json"}),
)
DOCUMENT = JsonObject(
    "soter.api.rechecking.ReplayReport",
    "kind program program_sha256 reproduced outcome",
    beside={"trace": str, "html?": str, "mcap?": str},
    also=STEPS,
    kind=one_of("trace", "counterexample"),
)


def _document_fields(report: ReplayReport) -> dict[str, object]:
    fields = DOCUMENT.of(report)
    if report.trace is not None:
        return fields | STEPS.of(report.trace)
    run = report.counterexample
    return fields if run is None else fields | {"steps": list(run.steps)}
