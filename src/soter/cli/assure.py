"""`soter assure FILE`: a safety case whose leaves were checked while it was made.

Purpose: prints the goals, what supports them and what is missing; writes page, JSON and StrictDoc.
Non-goals: making proofs, tests and campaigns; the case itself (`api/assurance/`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING

from soter.cli.terminal.command_line import Pairs, keyword_arguments
from soter.cli.terminal.command_outcome import (
    FINE,
    NOT_RECHECKED,
    UNDECIDED,
    VIOLATED,
    CommandOutcome,
)
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.program_loading import loaded_program
from soter.cli.terminal.shared_options import (
    CAMPAIGN_FOLDER,
    CERTIFICATE_FOLDER,
    SET,
    SYSTEM,
    file_option,
)
from soter.diagnostics.command_records import SWITCH, Kind, option
from soter.report.wording import visible

if TYPE_CHECKING:
    import argparse

    from soter.report.safety_case import Assurance

EXAMPLES = f"""\
  soter verify cart.soter --cert proof/
  soter assure cart.soter --cert proof/ -o case/         open case/index.html
  soter assure cart.soter --cert proof/ --tests -o case/       explores every test again
  soter test cart.soter --json > tests.json
  soter assure cart.soter --cert proof/ --test-report tests.json -o case/
  soter assure cart.soter --cert proof/ --campaign flights/ --flights 100 -o case/
  soter assure cart.soter --cert proof/ --hazards hazards.csv -o case/

in the folder that is written: index.html (to read), case.json (the same), case.sdoc (StrictDoc);
with --trace trace.csv (from requirements to conditions of the generated C)

{CERTIFICATE_FOLDER}
{CAMPAIGN_FOLDER}
A goal is supported only where its leaf was checked just now: the certificate by the independent
re-checker, tests by exploring them again (--tests), flights by flying them again (--flights).
Everything else is told with its hash, and the goal stays undeveloped (docs/assure.md).

exit codes: 0 the top goal is supported, and P2b where the program asks for it, and every hazard
              and requirement of --hazards,
            3 a certificate is rejected, a compiled DM differs, a test or a flight violated,
            5 a certificate was not re-checked: it may be right, but is beyond the re-checker,
            4 one of these is not supported, 1 diagnostics, 2 usage
"""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Make a safety case: GSN, ASTM F3269, with hashes."""

    file: str = file_option()
    system: str | None = option(*SYSTEM)
    cert: str | None = option("--cert DIR", None, "certificate of it; checked again")
    tests: bool = option("--tests", False, "explore every test of the file again", SWITCH)
    test_report: str | None = option("--test-report FILE", None, "what `soter test --json` printed")
    campaign: str | None = option("--campaign DIR", None, "the folder of a campaign")
    flights: int = option("--flights N", 20, "so many of it are flown again (20)", Kind("whole"))
    hazards: str | None = option(
        "--hazards FILE", None, "CSV: hazards, requirements, owners of assumptions"
    )
    trace: bool = option(
        "--trace", False, "follow hazards to conditions of the C, and what covers them", SWITCH
    )
    params: Pairs = option(*SET)
    output: str = option("-o DIR", ..., "folder to write", keyword=False)
    NEEDS = (("campaign", "flights"), ("hazards", "trace"))


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Makes the safety case, prints its goals and writes its files."""
    program = loaded_program(args, console)
    with ProgressBar(console) as progress:
        how = {
            **keyword_arguments(args, Options),
            "progress": progress,
            "tell": partial(_print_missing_evidence, console),
        }
        assurance = program.assure(args.output, **how)
    _say_case(assurance, console)
    code = (
        VIOLATED
        if assurance.refuted
        else NOT_RECHECKED
        if assurance.not_rechecked
        else FINE
        if assurance.case.supported and assurance.returns and assurance.case.traceability.covered
        else UNDECIDED
    )
    return CommandOutcome(code, fields=_document_fields(assurance))


def _print_missing_evidence(console: Console, why: str) -> None:
    """Prints at once why some goals will have no evidence, as the rest may take minutes."""
    console.note(f"soter: {visible(why)}; its goals stay undeveloped")


def _say_case(assurance: Assurance, console: Console) -> None:
    from soter.report.tables import Entry, Styled  # noqa: PLC0415 - needs NumPy

    case = assurance.case
    word = _verdict_line(assurance, console)
    console.say(
        console.paint("muted", f"{case.program}  {case.system}  {case.program_sha256[:12]}")
    )
    console.say(f"{word}  {case.nodes[0].text}\n")
    rows: list[list[Entry]] = []
    for goal in case.goals:
        status = case.status(goal)
        rows.append(
            [goal.id, Styled(status, "good" if status == "supported" else "bad"), goal.text]
        )
    console.say(console.table(("goal", "status", "what"), rows))
    missing = dict.fromkeys(n.why for n in case.nodes if n.why)
    if missing:
        console.say("\nmissing")
    for why in missing:
        console.say(f"  {why}")
    for text in assurance.refuted:
        console.say(f"\n{console.paint('red', 'REFUTED')}  {text}")
    if assurance.not_rechecked:
        word = console.paint("yellow", "NOT RE-CHECKED")
        console.say(f"\n{word}  the certificate: {visible(assurance.not_rechecked)}")
    top = [case.node(i).kind for i in case.nodes[0].in_context_of]
    if "assumption" in top:
        console.say(f"\nrests on {top.count('assumption')} assumptions, which the page lists")
    else:
        console.say("\nno certificate was accepted: what a proof would rest on is not known")
    _print_open_items(assurance, console)
    if case.conditions is not None:
        console.say(f"{case.conditions.summary}\n")
    console.say("\n".join(f"written  {path}" for path in assurance.files))


def _verdict_line(assurance: Assurance, console: Console) -> str:
    case = assurance.case
    word = console.paint("green", "SUPPORTED")
    if not case.supported:
        word = console.paint("yellow", "UNDEVELOPED")
    elif not assurance.returns:
        word = console.paint("yellow", "SUPPORTED, without P2b")
    if case.supported and not assurance.lawful:
        word += ", without a fail-safe law"
    return word if case.traceability.covered else f"{word}, with open hazards or requirements"


def _print_open_items(assurance: Assurance, console: Console) -> None:
    """Prints the open hazards and requirements; for open assumptions, prints only their number."""
    open_ = assurance.case.traceability.open
    assumptions = sum(item.kind == "assumption" for item in open_)
    others = [item for item in open_ if item.kind != "assumption"]
    if not open_:
        return
    console.say("\nopen")
    for item in others:
        console.say(f"  {item.kind} {visible(item.id)}: {visible(item.why)}")
    if assumptions:
        console.say(
            f"  {assumptions} assumptions (owner, validation, evidence), which the page lists"
        )
    if not assurance.case.traceability.path:
        console.say("  no file of hazards, requirements and owners was given (--hazards FILE)")
    console.say()


def _document_fields(assurance: Assurance) -> dict[str, object]:
    case = assurance.case
    return {
        "program_sha256": case.program_sha256,
        "system": case.system,
        "params": case.params,
        "supported": case.supported,
        "goals": {g.id: case.status(g) for g in case.goals},
        "refuted": list(assurance.refuted),
        "not_rechecked": assurance.not_rechecked,
        "covered": case.traceability.covered,
        "open": [asdict(item) for item in case.traceability.open],
        "files": [str(path) for path in assurance.files],
    }
