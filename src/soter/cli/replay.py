"""`soter replay TRACE`: run a trace again, in the reference interpreter.

Purpose: whether a trace of `soter test`, or a counterexample of `soter verify`, reproduces; the
steps as text or JSON, as an MCAP log and as a page.
Non-goals: running it (`explore/judge/replay.py`, `reach/attack/counterexample.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.api import replay
from soter.cli.terminal.outcome import FINE, VIOLATED, Outcome, exit_of
from soter.cli.terminal.parser import Parser
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    import argparse

    from soter.api import ReplayReport
    from soter.cli.terminal.console import Console
    from soter.diagnostics.diagnostic import Diagnostic
    from soter.explore.judge.replay import Stepped

EXAMPLES = """\
  soter replay .soter/late_sc-Late.trace.json               every step, and whether it reproduces
  soter replay late.trace.json --html late.html             to look at: lanes, topics, modes
  soter replay late.trace.json --mcap late.mcap             for log tools
  soter replay late.trace.json --json | jq '.steps[-1]'
  soter replay .soter/cart-SafeCart.counterexample.json     of `soter verify`

exit codes: 0 reproduced, 3 not reproduced, 1 diagnostics, 2 usage
"""


def parser() -> Parser:
    """The command line."""
    made = Parser("replay", "Run a trace again, in the reference interpreter.", EXAMPLES)
    made.add_argument("trace", metavar="TRACE", help="a file of `soter test` or `soter verify`")
    made.add_argument("--text", action="store_true", help="print every step (the default)")
    made.add_argument("--html", metavar="PATH", help="write the sequence as one HTML page")
    made.add_argument("--mcap", metavar="PATH", help="write the steps as an MCAP log")
    return made


def run(args: argparse.Namespace, console: Console) -> Outcome:
    """Replay."""
    try:
        found = replay(args.trace)
    except SoterError as error:
        return Outcome(exit_of(error.diagnostics), error.diagnostics, {"trace": args.trace})
    _say(found, console)
    written, problems = _files(found, args)
    for kind, path in written.items():
        console.say(f"{kind:<6} {path}")
    code = FINE if found.reproduced else VIOLATED
    if problems:
        code = exit_of(problems)
    return Outcome(code, problems, {**_fields(found), **written})


def _files(
    found: ReplayReport, args: argparse.Namespace
) -> tuple[dict[str, str], tuple[Diagnostic, ...]]:
    """Paths of what was written, by kind, and what could not be."""
    written: dict[str, str] = {}
    problems: list[Diagnostic] = []
    for kind, write in (("html", found.write_html), ("mcap", found.write_mcap)):
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


def _say(found: ReplayReport, console: Console) -> None:
    if console.json:
        return
    from soter.report.visible import visible  # noqa: PLC0415 - only then

    what = f"{found.program}  {found.program_sha256[:12]}"
    if found.trace is not None:
        what += f"  {found.trace.trace.system}, test {found.trace.trace.test}"
    console.say(console.paint("muted", visible(what)))
    word = ("green", "REPRODUCED") if found.reproduced else ("red", "NOT REPRODUCED")
    console.say(f"{console.paint(*word)}  {visible(found.outcome)}")
    console.say()
    for line in _steps(found, console):
        console.say(line)


def _steps(found: ReplayReport, console: Console) -> list[str]:
    if found.trace is not None:
        from soter.report.sequence.text import text  # noqa: PLC0415 - needs NumPy
        from soter.report.visible import visible  # noqa: PLC0415 - the same

        view = found.view()
        lines = text(view, color=console.color_out, width=console.width)
        return [*lines, visible(view.remark)] if view.remark else lines
    if found.counterexample is None:
        return []
    steps = found.counterexample.steps
    return [_instant(s) for s in steps]


def _instant(step: dict[str, object]) -> str:
    """One of the last instants of a counterexample."""
    from soter.explore.to_report import shown  # noqa: PLC0415 - only then

    rest = "  ".join(f"{k} {shown(step[k])}" for k in ("modes", "truth") if k in step)
    return f"{step['time_s']} s  {rest}"


# ---------------------------------------------------------------- as JSON


def _fields(found: ReplayReport) -> dict[str, object]:
    fields: dict[str, object] = {
        "trace": found.path,
        "kind": found.kind,
        "program": found.program,
        "program_sha256": found.program_sha256,
        "reproduced": found.reproduced,
        "outcome": found.outcome,
    }
    if found.trace is not None:
        trace = found.trace.trace
        fields |= {
            "system": trace.system,
            "test": trace.test,
            "property": trace.broken.text,
            "minimal": trace.minimal,
            "not_shortest": trace.not_shortest or None,
            "assumptions": list(trace.assumptions),
            "violated_at": found.trace.violated_at,
            "steps": [_step(s) for s in found.trace.steps],
        }
    elif found.counterexample is not None:
        fields["steps"] = list(found.counterexample.steps)
    return fields


def _step(s: Stepped) -> dict[str, object]:
    return {
        "step": s.number,
        "actor": s.actor,
        "kind": s.kind,
        "release_ns": s.release_ns,
        "time_ns": s.time_ns,
        "choices": [
            {"stream": c.stream, "pick": c.pick, "of": c.of, "value": c.value} for c in s.choices
        ],
        "published": dict(s.published),
        "gated": s.gated,
        "decided": None if s.decided is None else dict(s.decided),
        "fault": s.fault,
        "dropped": [{"queue": d.queue, "policy": d.policy} for d in s.dropped],
        "observable": s.observable,
        "violated": [b.text for b in s.violated],
        "reasons": list(s.reasons),
        "modes": dict(s.modes),
        "topics": dict(s.topics),
        "truth": dict(s.truth),
        "matters": s.matters,
    }
