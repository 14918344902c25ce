"""`soter diff OLD NEW`: what a change of a program leaves standing.

Purpose: prints the declarations that differ, in the program's words, and what hangs on them:
proofs, times, flights, tests, requirements; as JSON and as a page.
Non-goals: the comparison (`api/comparing.py`); proving anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.api.comparing import AGAIN, GONE, NEW, OPEN, RULE, STANDS, compare
from soter.cli.terminal.command_outcome import FINE, UNDECIDED, CommandOutcome
from soter.cli.terminal.shared_options import file_option, report_option, report_path
from soter.diagnostics.command_records import JsonObject, option

if TYPE_CHECKING:
    import argparse

    from soter.cli.terminal.console import Console
    from soter.report.tables import Entry, Tone

EXAMPLES = """\
  soter diff cart.soter cart-new.soter
  soter diff proof/ cart.soter               a certificate against the program of today
  soter diff cart.soter cart-new.soter --hazards hazards.csv --report change.html
  soter diff cart.soter cart-new.soter --json | jq '.consequences[] | select(.status == "again")'

A proof stands where its problem is the same to the byte: code of an advanced controller, comments
and layout are not in it. `soter build` and `soter assure` ask for a proof of the new text all the
same: `soter verify NEW --cert DIR` makes it, with the verdicts of the old one.

exit codes: 0 nothing has to be made again, 4 something has, 1 diagnostics, 2 usage
"""
LINES_MAX = 12
TONES: dict[str, Tone] = {STANDS: "good", AGAIN: "bad", GONE: "muted", NEW: "bad", OPEN: "muted"}


@dataclass(frozen=True, kw_only=True)
class Options:
    """What a change leaves standing: proofs, times, flights, tests, requirements."""

    old: str = file_option("OLD", "a program, or the folder of a certificate", "old")
    new: str = file_option("NEW", "the changed one", "new")
    hazards: str | None = option("--hazards FILE", None, "CSV of `soter assure --hazards`")
    report: str | None = report_option("what differs, and what hangs on it", "-diff.html")


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Compares two versions, prints how they differ, and writes the page."""
    found = compare(args.old, args.new, args.hazards)
    console.say(f"{console.paint('bold', found.headline)}\n")
    for d in found.declarations:
        console.say(f"{d.how:8}{d.kind} {console.paint('bold', d.name)}")
        for line in d.lines[:LINES_MAX]:
            console.say(console.paint("red" if line[0] == "-" else "green", f"        {line}"))
        if len(d.lines) > LINES_MAX:
            console.say(f"        and {len(d.lines) - LINES_MAX} lines more")
    from soter.report.tables import Styled  # noqa: PLC0415 - needs NumPy

    rows: list[list[Entry]] = [
        [c.what, c.name, Styled(c.status, TONES[c.status]), ", ".join(c.because)]
        for c in found.consequences
    ]
    if rows:
        console.say("\n" + console.table(("what", "of", "status", "because of"), rows))
    console.say(f"\n{RULE}")
    fields = DOCUMENT.of(found)
    if args.report is not None:
        page = report_path(args.report, args.new, "-diff.html")
        found.write_page(page)
        console.say(f"report  {page}")
        fields["report"] = str(page)
    return CommandOutcome(UNDECIDED if found.again else FINE, fields=fields)


DOCUMENT = JsonObject(
    "soter.api.comparing.Comparison",
    "old new headline declarations consequences",
    declarations=JsonObject("soter.api.comparing.DeclarationChange", "kind name how lines"),
    consequences=JsonObject("soter.api.comparing.Consequence", "what name status because"),
    beside={"report?": str},
)
