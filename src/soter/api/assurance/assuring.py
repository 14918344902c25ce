"""A safety case of a system: `soter assure`.

Purpose: goals in the paper's properties and in the words of ASTM F3269-21, leaves that are checked
here and now: the certificate by the re-checker, tests by exploring again, flights of a campaign by
flying again; everything else is told with its hash, and supports nothing.
Non-goals: the pages (`report/assurance/`); proving.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.rechecking import recheck
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.phase import phase
from soter.diagnostics.refused import reason
from soter.program.load.files import opened, read_json_text
from soter.report.assurance.case import Case, Node
from soter.report.errors import ReportError
from soter.version import VERSION

if TYPE_CHECKING:
    from soter.api.assurance.again import AssuredProgram
    from soter.api.given import Progress
    from soter.program.model.system import Module, System
    from soter.recheck.report import ModuleReport, Report

PROPERTIES = {
    "P1a": "both functions act at least as often as the RTA switch decides",
    "P1b": "the recovery function commands everything that the complex function commands",
    "P1c": "whatever the schedule, a switch takes effect within the horizon of the proof",
    "P2a": "under the recovery function the safety property is kept",
    "P3": "whatever the complex function does until the next switch, recovery stays possible",
    "ttf": "the safety monitor sees in time that recovery might be lost",
    "safer": "the switch gives control back only where recovery stays possible",
    "start": "every initial state is one from which recovery is possible",
}
"""What safety needs (Theorem 3.1 of the paper; docs/proof.md), as an assurance argument says it."""
FILES = ("index.html", "case.json", "case.sdoc")
FLOWN_AGAIN = 20


@dataclass(frozen=True)
class Assurance:
    """`refuted`: a certificate that is rejected, a test or a flight that violates a property."""

    case: Case
    files: tuple[Path, ...]
    refuted: tuple[str, ...]


def assure(
    program: AssuredProgram,
    output: str | Path,
    *,
    cert: str | Path | None = None,
    system: str | None = None,
    params: Any = None,  # noqa: ANN401 - as `Program.verify` takes them
    tests: bool = False,
    test_report: str | Path | None = None,
    campaign: str | Path | None = None,
    flights: int = FLOWN_AGAIN,
    progress: Progress | None = None,
) -> Assurance:
    """Make the case and write it to the folder `output`.

    `tests`: explore them now; `flights`: so many of a campaign are flown again. SoterError D009
    where there is no certificate, D005 for a report that is none, D006 where
    something cannot be read or written, and as of `Program.flat`.
    """
    from soter.recheck.coverage import parameters_of  # noqa: PLC0415 - needs NumPy

    flat = program.flat(system, params)
    sha256 = flat.program.sha256
    case = Case(
        f"Safety case of {flat.name} in {Path(program.path).name}",
        program.path,
        sha256,
        flat.name,
        parameters_of(flat),
    )
    refuted: list[str] = []
    top = case.add(Node("G1", "goal", _top(flat)))
    _argument(case, top, flat, cert, refuted, progress)
    if flat.faults:
        case.add(Node("C-faults", "context", "runs with the `faults` of the system"), beside=top)
    case.add(
        Node(
            "C-evidence",
            "context",
            "tests and campaigns are evidence beside the proof: "
            "goals of their own, on which the top goal does not rest",
        ),
        beside=top,
    )
    _tests(case, program, flat, params, test_report, refuted, tests=tests)
    if campaign is not None:
        _campaign(case, program, flat, params, Path(campaign), flights, refuted)
    return Assurance(case, _written(case, Path(output)), tuple(refuted))


def _top(flat: System) -> str:
    kept = " and ".join(f"`{_safe(m)}`" for m in flat.modules) or "nothing"
    return f"System {flat.name} keeps {kept} at all times, in every run that keeps the assumptions"


def _safe(m: Module) -> str:
    return " ".join(m.symbol.safe.span.text.split())


# ---------------------------------------------------------------- the proof


def _argument(
    case: Case,
    top: Node,
    flat: System,
    cert: str | Path | None,
    refuted: list[str],
    progress: Progress | None,
) -> None:
    """The goals of every module, with the certificate as their leaf."""
    strategy = case.add(
        Node("S1", "strategy", "argument over every RTA module (ASTM F3269-21; Theorem 4.1)"),
        under=top,
    )
    report, seal = None, ""
    if cert is not None:
        phase("checking the certificate again")
        report = recheck(cert, progress)
        seal = _file_hash(Path(cert) / "manifest.json")
        if not report.accepted:
            refuted.append(f"the certificate is rejected: {report.reason}")
    for k, module in enumerate(flat.modules, 1):
        _module(
            case, strategy, flat, module, number=k, report=report, seal=seal, path=str(cert or "")
        )
    if report is not None and report.accepted and report.program_sha256 == case.program_sha256:
        for k, said in enumerate(report.assumptions, 1):
            case.add(Node(f"A{k}", "assumption", said), beside=top)
        for k, other in enumerate(report.not_covered, 1):
            case.add(Node(f"C{k}", "context", f"not covered: {other.text}"), beside=top)


def _module(
    case: Case,
    strategy: Node,
    flat: System,
    module: Module,
    number: int,
    report: Report | None,
    seal: str,
    path: str,
) -> None:
    id_ = f"G1.{number}"
    ac = flat.components[module.ac].name if module.over is None else flat.modules[module.over].name
    sc = flat.components[module.sc].name
    text = f"RTA module {module.name} keeps `{_safe(module)}`: complex function {ac}, recovery "
    goal = case.add(Node(id_, "goal", f"{text}function {sc}"), under=strategy)
    found, why = _of_certificate(case, flat, module, report)
    for name, said in PROPERTIES.items():
        child = case.add(Node(f"{id_}.{name}", "goal", f"{name}: {said}"), under=goal)
        confirmed = bool(found) and all(name in m.confirmed for m in found)
        missing = why or f"the certificate does not confirm {name}: " + ", ".join(
            dict.fromkeys(m.claims.get(name, "not claimed") for m in found)
        )
        case.add(
            Node(
                f"Sn.{number}.{name}",
                "solution",
                "certificate, checked again just now by the independent re-checker"
                if confirmed
                else "no leaf",
                checked=confirmed,
                why="" if confirmed else missing,
                path=path if confirmed else "",
                sha256=seal if confirmed else "",
            ),
            under=child,
        )


def _of_certificate(
    case: Case, flat: System, module: Module, report: Report | None
) -> tuple[list[ModuleReport], str]:
    """What was confirmed of exactly this module, in every view; or why nothing is."""
    if module.forced is not None:
        return [], f"the module is forced to {module.forced.upper()}: its switch does not switch"
    if report is None:
        return [], "no certificate was given (--cert DIR)"
    if not report.accepted:
        return [], f"the certificate is rejected: {report.reason}"
    if report.program_sha256 != case.program_sha256:
        return [], "the certificate is of another program: the hashes differ"
    mine = [
        m
        for m in report.modules
        if m.system == flat.name and m.name.partition(" as ")[0] == module.name
    ]
    if not mine:
        return [], "the certificate is not about this module of this system"
    if any(m.parameters != case.params for m in mine):
        return [], "the certificate is about other values of the parameters"
    return mine, ""


# ---------------------------------------------------------------- evidence beside it


def _tests(
    case: Case,
    program: AssuredProgram,
    flat: System,
    params: Any,  # noqa: ANN401 - as given
    file: str | Path | None,
    refuted: list[str],
    *,
    tests: bool,
) -> None:
    """A goal a test: supported where it was explored now, and is clean."""
    told = _test_report(file)
    names = {**dict.fromkeys(told), **dict.fromkeys(_own_tests(flat) if tests else ())}
    if not names:
        return
    goal = case.add(Node("G2", "goal", "No execution of the tests violates a property"))
    report = None
    if tests:
        phase("exploring the tests again")
        report = program.explore(params=params, output=None)
    for k, name in enumerate(names, 1):
        child = case.add(
            Node(f"G2.{k}", "goal", f"test {name}: every execution within its bounds is clean"),
            under=goal,
        )
        verdict = next((t.verdict for t in report.tests if t.name == name), "") if report else ""
        why = "" if verdict == "exhausted" else f"explored just now: {verdict}"
        if not verdict:
            why = _as_told(told.get(name), case.program_sha256)
        case.add(
            Node(
                f"Sn.2.{k}",
                "solution",
                f"test {name}, explored again just now" if verdict else f"a report on test {name}",
                checked=verdict == "exhausted",
                why=why,
                path="" if verdict else str(file),
                sha256="" if verdict or file is None else _file_hash(Path(file)),
            ),
            under=child,
        )
        if verdict == "violated":
            refuted.append(f"test {name} is violated")


def _own_tests(flat: System) -> list[str]:
    """The tests of the main file."""
    return [n for n in flat.program.tests if "." not in n]


def _as_told(told: dict[str, Any] | None, sha256: str) -> str:
    if told is None:
        return "there is no such test any more"
    if told["program_sha256"] != sha256:
        return "the report is about another program: the hashes differ"
    return f"the report says {told['verdict']} of this program; it was not explored again (--tests)"


def _test_report(file: str | Path | None) -> dict[str, dict[str, Any]]:
    """Test -> what a document of `soter test --json` says; SoterError D005, D006."""
    if file is None:
        return {}
    path = Path(file)
    try:
        document = json.loads(read_json_text(path))
        sha256, tests = document["program_sha256"], document["tests"]
        return {str(t["name"]): {"verdict": t["verdict"], "program_sha256": sha256} for t in tests}
    except OSError as error:
        raise SoterError((Diagnostic("D006", f"cannot read `{path}`: {reason(error)}"),)) from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        help_ = f"soter test FILE --json > {path}"
        problem = Diagnostic(
            "D005", f"`{path}` is no report of `soter test --json`", helps=(help_,)
        )
        raise SoterError((problem,)) from error


def _campaign(
    case: Case,
    program: AssuredProgram,
    flat: System,
    params: Any,  # noqa: ANN401 - as given
    folder: Path,
    flights: int,
    refuted: list[str],
) -> None:
    """What was flown again: the seeds of the campaign, and the digests that it wrote down."""
    from soter.api.assurance.again import again  # noqa: PLC0415 - compiles

    phase("flying again")
    found = again(program, flat, params, folder, flights)
    goal = case.add(Node("G3", "goal", found.goal))
    case.add(
        Node(
            "Sn.3",
            "solution",
            found.text,
            checked=not found.why,
            why=found.why,
            path=str(folder / "flights.csv"),
            sha256=_file_hash(folder / "flights.csv"),
        ),
        under=goal,
    )
    if found.violated:
        refuted.append(found.violated)


# ---------------------------------------------------------------- files


def _file_hash(path: Path) -> str:
    """SHA-256 of a file; SoterError D006 where it cannot be read."""
    try:
        told = hashlib.sha256()
        with opened(path, pipes=False) as file:
            while part := file.read(2**20):
                told.update(part)
        return told.hexdigest()
    except OSError as error:
        message = f"cannot read `{path}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error


def _written(case: Case, folder: Path) -> tuple[Path, ...]:
    """The three files; SoterError D006 where one cannot be written."""
    from soter.report.assurance.page import write_case  # noqa: PLC0415 - only then
    from soter.report.assurance.strictdoc import sdoc  # noqa: PLC0415 - only then
    from soter.report.html import write_text  # noqa: PLC0415 - only then

    page, data, document = (folder / name for name in FILES)
    try:
        write_case(case, page)
        write_text(json.dumps(case.to_json(VERSION), indent=2, sort_keys=True) + "\n", data)
        write_text(sdoc(case), document)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error
    return page, data, document
