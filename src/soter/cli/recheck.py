"""`soter recheck DIR`: checks a certificate, independently of the prover that made it.

Purpose: tells whether it is accepted, rejected or not re-checked, which claims were confirmed, and
what they rest on; on the terminal, as JSON and as a page.
Non-goals: the checks (`certificate/`), making certificates (`soter verify --cert`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api import recheck
from soter.api.output_files import write_sections
from soter.certificate import report as errors
from soter.certificate.report import (
    ACCEPTED,
    CONTRADICTED,
    REJECTED,
    UNCONFIRMED,
    VERDICTS,
    FlightReport,
    RecheckedModule,
    Report,
)
from soter.cli.terminal.command_outcome import (
    FINE,
    INTERRUPTED,
    NOT_RECHECKED,
    UNDECIDED,
    VIOLATED,
    CommandOutcome,
)
from soter.cli.terminal.console import Console, ProgressBar
from soter.cli.terminal.shared_options import (
    CERTIFICATE_FOLDER,
    file_option,
    report_option,
    report_path,
)
from soter.diagnostics.command_records import SEVERAL, JsonObject, one_of, option
from soter.diagnostics.diagnostic import mistake
from soter.report.templates import PageSection
from soter.report.wording import visible
from soter.version import VERSION

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Sequence


EXAMPLES = f"""\
  soter verify cart.soter --cert proof/
  soter recheck proof/
  soter recheck proof/ --json | jq .accepted
  soter recheck proof/ --report recheck.html       a page to file
  soter run train.soter --log flight.mcap
  soter recheck proof/ --log flight.mcap           every verdict of that flight once more

{CERTIFICATE_FOLDER}
Every byte of the folder counts: a changed, missing or additional file is rejected. Then the problem
is read off the program once more, by other code, and every claim is recomputed in ball arithmetic.
Times and assumptions are derived from the program, never read from the certificate. What is not
understood of a program is not re-checked: then nothing is known to be false, and nothing is shown.
With --log every verdict "AC" of a module with `rest` is done again, from the estimate that the log
says it read; those that are not confirmed are named, and so is each one that is missing.

exit codes: 0 accepted: safety and the return of AC (P2b) are established (with `recover never`:
            safety; with `rest`: all that what a DM decides in flight rests on),
            3 rejected: something in it is false, or a witness shows less than it has to,
            4 accepted in part: what is claimed holds, and it is not all of that,
            5 not re-checked: it may be right, but is beyond this checker,
            1 no certificate there or python-flint missing, 2 usage
with --log: 0 every verdict is confirmed as well, 3 a log contradicts itself or the program, 4 also
            a log has no verdict, 5 also a verdict is not confirmed, 1 also a log of another
            program, system or other parameters, 130 interrupted: what was asked until then is told
"""


ENDING = "-recheck.html"
SHOWN = 20
"""How many lines about a flight the terminal shows; the document has all."""
COARSE = (
    "a right proof may fail here, too: these bounds are coarser than those of `soter verify`, and"
    " smaller cells may help"
)
"""Added to a rejection for a witness that was not confirmed: it may be right nevertheless."""
IN_FLIGHT = (
    "decided in flight: P3, ttf and safer, by the check of its DM, which is tested; "
    "`soter recheck DIR --log LOG` asks single verdicts"
)
NO_LAW = "failsafe: nothing is said of what acts once the trusted part stops"


@dataclass(frozen=True, kw_only=True)
class Options:
    """Check a certificate of `soter verify --cert`."""

    folder: str = file_option("DIR", "the folder of the certificate", json_name="certificate")
    logs: Sequence[str] = option(
        "--log LOG",
        (),
        "a flight of its program, of `soter run --log`: confirm its verdicts (also several)",
        SEVERAL,
    )
    report: str | None = report_option("what was confirmed", ENDING)


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Checks the certificate, prints the verdict; SoterError U001 for a page inside its folder."""
    report_file = None
    if args.report is not None:
        report_file = report_path(args.report, args.folder, ENDING)
        if Path(args.folder).resolve() in report_file.resolve().parents:
            text = f"`{report_file}` lies in the certificate, every file of which counts"
            raise mistake("U001", text, "write the page elsewhere")
    with ProgressBar(console) as progress:
        report = recheck(args.folder, progress, args.logs)
    _say_result(report, args.folder, console)
    _say_flights(report, console)
    fields = DOCUMENT.of(report)
    if report_file is not None:
        colour, headline = _colour_and_verdict(report, args.folder)
        verdict = {"green": "good", "red": "bad"}.get(colour, "")
        title = f"soter recheck {Path(args.folder).resolve().name}"
        write_sections(report_file, title, headline, verdict, list(_page_sections(report)))
        console.say(f"\nreport  {report_file}")
        fields["report"] = str(report_file)
    return CommandOutcome(_exit_code(report), (), fields)


def _exit_code(report: Report) -> int:
    if any(f.interrupted for f in report.flights):
        return INTERRUPTED
    verdicts = {report.verdict, *(f.verdict for f in report.flights)}
    if verdicts != {ACCEPTED}:
        return VIOLATED if REJECTED in verdicts else NOT_RECHECKED
    returns = all(m.has_return or m.stays or m.lacks_flight_only for m in report.modules)
    asked = all(f.verdicts or f.others for f in report.flights)
    complete = report.is_safe_with_flight and returns and asked and not report.contradicted
    return FINE if complete else UNDECIDED


def _colour_and_verdict(report: Report, folder: str) -> tuple[str, str]:
    """The colour of the verdict, and a line of text with the verdict."""
    if not report.accepted:
        colour = "red" if report.verdict == REJECTED else "yellow"
        return colour, f"{report.verdict.upper()}  {folder}"
    if not report.is_safe_with_flight:
        several = len(report.modules) > 1
        missing = "; ".join(
            (f"{m.name}: " if several else "") + ", ".join(m.missing)
            for m in report.modules
            if m.missing
        )
        why = f"safety is not established ({visible(missing)} not claimed)"
        return "yellow", f"ACCEPTED IN PART  {folder}: {why}"
    if report.contradicted:
        return "yellow", f"ACCEPTED IN PART  {folder}: with other values than the program sets"
    if not report.safe:
        names = visible(", ".join(report.modules_decided_in_flight))
        why = f"P2a and start are confirmed of {names}, P3 is not proved of anything"
        return "yellow", f"ACCEPTED, decided in flight  {folder}: {why}"
    why = visible("; ".join(f"{name}: {text}" for name, text in report.why_vacuous.items()))
    says = ["without P2b"] * (not report.has_return) + ["of next to nothing"] * bool(why)
    colour = "yellow" if says else "green"
    return colour, f"{', '.join(['ACCEPTED', *says])}  {folder}{f': {why}' * bool(why)}"


def _headline(report: Report, folder: str, console: Console) -> str:
    colour, text = _colour_and_verdict(report, folder)
    word, rest = text.split(f"  {folder}", 1)
    return f"{console.paint(colour, word)}  {folder}{rest}"


def _page_sections(report: Report) -> Iterator[PageSection]:
    """Yields the sections of the page: modules, program, flights, assumptions, gaps."""
    yield from (_module_section(m, report) for m in report.modules)
    program = f"Program {visible(report.program)}, SHA-256 {report.program_sha256}."
    program_lines = (program, f"Rechecked by soter {VERSION} in {report.seconds:.1f} s.")
    reason = (visible(report.reason),) if report.reason else ()
    yield PageSection("What was checked", program_lines + reason)
    for flight in report.flights:
        yield PageSection(visible(f"Flight {flight.log}"), tuple(_flight_lines(flight)))
    texts = tuple(f"{number}: {visible(text)}" for number, text in _numbered_assumptions(report))
    yield PageSection("Under these assumptions, derived from the program", texts)
    yield PageSection("Not covered", tuple(visible(remark.text) for remark in report.not_covered))


def _module_section(m: RecheckedModule, report: Report) -> PageSection:
    """The page section of a module: what it guarantees, and which claims are confirmed or not."""
    title = visible(f"{m.name} of system {m.system}")
    if m.not_rechecked:
        return PageSection(title, (visible(f"Not re-checked: {m.not_rechecked}."),))
    safe = report.verdict != REJECTED and not m.missing
    keeps = "Keeps" if safe else "Not shown: that it keeps"
    values = ", ".join(_parameter_text(m, name) for name in m.parameters)
    says = [f"{keeps} `{m.safe}`."]
    says += [f"{IN_FLIGHT[0].upper()}{IN_FLIGHT[1:]}."] if m.in_flight else []
    says += [f"Confirmed: {' '.join(m.confirmed) or 'nothing'}."]
    says += [f"With {values}."] if values else []
    says += [f"Not confirmed: {', '.join(m.unconfirmed_claims)}."] if m.unconfirmed_claims else []
    says += [f"Not claimed: {NO_LAW}."] if m.says_nothing_of_law else []
    says += [f"Vacuous: {m.vacuous}."] if m.vacuous else []
    says += [f"Not looked at: whether AC ever has control ({m.unseen})."] if m.unseen else []
    says += [f"Confirmed: {claim.text}" for claim in m.shown]
    return PageSection(title, tuple(map(visible, says)))


def _flight_lines(flight: FlightReport) -> Iterator[str]:
    """Lines about a flight: how many verdicts were confirmed, then each that was not."""
    each = f" ({flight.seconds / flight.asked:.2f} s of CPU each)" if flight.asked else ""
    asked = f"{flight.asked:,} that were asked of " if flight.interrupted else ""
    yield (
        f'{flight.confirmed:,} of {asked}{flight.verdicts:,} verdicts "AC" confirmed{each}, up to '
        f"{flight.to_ns / 1e9:.9g} s; {flight.others:,} said SC"
    )
    if flight.cut:
        yield visible(f"read up to there, and no further: {flight.cut}")
    if flight.unlogged:
        names = ", ".join(flight.unlogged)
        yield visible(f"the log has no message of {names}: what was read is as the log says")
    for d in flight.doubts:
        of = ", ".join(f"{name} = {value!r}" for name, value in d.estimate.items())
        text = f"{d.time_ns / 1e9:.9g} s  {d.module}  {d.kind}: {d.reason}"
        yield visible(f"{text}  ({of})" if of else text)


def _say_flights(report: Report, console: Console) -> None:
    """Prints a line for each flight, and below it up to SHOWN verdicts that were not confirmed."""
    for flight in report.flights:
        first, *others = _flight_lines(flight)
        colour = {ACCEPTED: "green", REJECTED: "red"}.get(flight.verdict, "yellow")
        word = {ACCEPTED: "CONFIRMED", REJECTED: "CONTRADICTED"}.get(flight.verdict)
        word = word or ("INTERRUPTED" if flight.interrupted else "NOT CONFIRMED")
        console.say(f"\n{console.paint(colour, word)}  {visible(flight.log)}: {first}")
        for line in others[:SHOWN]:
            console.say(f"  {line}")
        if len(others) > SHOWN:
            console.say(f"  and {len(others) - SHOWN:,} more (--json has all)")


def _say_result(report: Report, folder: str, console: Console) -> None:
    """Prints the result; `visible` stops texts of the certificate from moving the cursor."""
    folder = visible(folder)
    hash_ = report.program_sha256[:12]
    if not report.accepted:
        console.say(f"{_headline(report, folder, console)}  {hash_}".rstrip())
        if report.verdict == REJECTED or not report.modules:
            console.say(f"  {visible(report.reason)}")
            if "certainly" in report.reason:  # intervals did not confirm a witness
                console.say(console.paint("muted", f"  {COARSE}"))
            return
        for module in report.modules:
            where = f"{module.name} of system {module.system}: {module.verdict}"
            why = module.not_rechecked or " ".join(module.confirmed)
            console.say(f"  {visible(where)}: {visible(why)}")
        return
    console.say(f"{_headline(report, folder, console)}  {hash_}  {report.seconds:.1f} s")
    for module in report.modules:
        where = f"{module.name} of system {module.system} in {report.program}"
        console.say(f"  {visible(where)}: {' '.join(module.confirmed)}, {_set_size_text(module)}")
        for colour, text in _remark_lines(module):
            console.say(console.paint(colour, f"    {visible(text)}"))
    console.say("\nunder these assumptions, derived from the program")
    for number, text in _numbered_assumptions(report):
        console.say(console.paint("muted", f"  {number:<3} {visible(text)}"))
    console.say("\nnot covered")
    for remark in report.not_covered:
        console.say(console.paint("muted", f"  {visible(remark.text)}"))


def _numbered_assumptions(report: Report) -> list[tuple[str, str]]:
    """Pairs (number, text) of the derived assumptions, in order of their numbers."""
    derived = set(report.assumptions)
    return [(n, text) for text, n in report.assumption_numbers.items() if text in derived]


def _set_size_text(module: RecheckedModule) -> str:
    """The number of cells in the checked sets of a module, as text."""
    return "no sets" if module.in_flight else f"{module.cells:,} cells"


def _remark_lines(module: RecheckedModule) -> Iterator[tuple[str, str]]:
    """Yields (colour, line) for every remark on a module other than its confirmed claims."""
    if values := ", ".join(_parameter_text(module, name) for name in module.parameters):
        yield "muted", f"with {values}"
    if module.in_flight:
        yield "yellow", IN_FLIGHT
    yield from (("muted", f"not confirmed: {name}") for name in module.unconfirmed_claims)
    if module.says_nothing_of_law:
        yield "muted", f"not claimed: {NO_LAW}"
    if module.vacuous:
        yield "yellow", f"vacuous: {module.vacuous}"
    if module.unseen:
        yield "muted", f"not looked at: whether AC ever has control ({module.unseen})"
    yield from (("muted", f"confirmed: {claim.text}") for claim in module.shown)


def _parameter_text(module: RecheckedModule, name: str) -> str:
    """A parameter's checked value as text, with the program's own value if that differs."""
    default = module.otherwise.get(name)
    note = "" if default is None else f" ({default} by the program)"
    return f"{name} = {module.parameters[name]}{note}"


def _module_name(module: RecheckedModule, report: Report) -> str:
    """The name of a module; "system.name" if another module has the same name."""
    several = sum(m.name == module.name for m in report.modules) > 1
    return f"{module.system}.{module.name}" if several else module.name


def _modules_by_name(report: Report) -> dict[str, RecheckedModule]:
    return {_module_name(m, report): m for m in report.modules}


ASSUMPTION = JsonObject("soter.certificate.report.RecheckAssumption", "key text")
DOCUMENT = JsonObject(
    "soter.certificate.report.Report",
    "accepted verdict safe returns=has_return reason program_sha256 seconds program modules "
    "assumptions assumption_keys=all_assumptions.key not_covered flights",
    {"modules": _modules_by_name},
    beside={"certificate": str, "report?": str},
    verdict=one_of(*VERDICTS),
    modules=JsonObject(
        "soter.certificate.report.RecheckedModule",
        "system verdict reason=not_rechecked parameters otherwise times_ns=times confirmed "
        "not_confirmed=unconfirmed_claims missing in_flight=lacks_flight_only cells shown vacuous "
        "vacuity_unseen=unseen",
        shown=ASSUMPTION,
        verdict=one_of(ACCEPTED, errors.NOT_RECHECKED),
    ),
    not_covered=ASSUMPTION,
    flights=JsonObject(
        "soter.certificate.report.FlightReport",
        "log system modules verdict verdicts asked interrupted confirmed said_sc=others to_ns cut "
        "unlogged seconds doubts",
        verdict=one_of(*VERDICTS),
        doubts=JsonObject(
            "soter.certificate.report.Doubt",
            "time_ns module kind reason estimate",
            kind=one_of(CONTRADICTED, UNCONFIRMED),
        ),
    ),
)
