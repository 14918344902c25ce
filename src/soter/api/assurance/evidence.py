"""Tests and flights of a safety case, as evidence beside the proof.

Purpose: `Evidence` reads the given files and compares their hashes before anything that takes long;
then it explores tests and flies flights of a campaign again, with the same program, system,
parameters and seeds, and compares their digests. Only what it repeated itself supports a goal.
Non-goals: the certificate (`certificate_check.py`), campaigns (`campaigning.py`); flights of an
arm, or with C of externs that is not surely the same: it flies none of them.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.assurance.certificate_check import file_hash
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_bytes, read_json_text
from soter.report.safety_case import CaseNode, SafetyCase
from soter.version import why_format_is_unreadable

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.api.arguments import Tell
    from soter.api.program import Program
    from soter.campaign.store import FlightOutcome
    from soter.explore.results import ExploreReport, TestResult
    from soter.language.model.system import System


OTHER_REPORT = "the report is about another program: the hashes differ"
FLIGHTS_MAX = 2**32
"""Most bytes of a campaign's table of flights."""
NUMBERS = 2**31
"""Numbers of flights are below this."""


@dataclass(frozen=True)
class ReplayedFlights:
    """Flights flown again. `why` says what is missing, or is "" if each equals its record."""

    goal: str
    text: str
    why: str = ""
    violated: str = ""


@dataclass(frozen=True)
class FlightFolder:
    """A campaign's folder. `about`: what was flown; `rows`: a row for each flight, from `file`."""

    file: Path
    sha256: str
    about: dict[str, Any]
    rows: list[dict[str, str]]


def replay_flights(
    program: Program,
    flat: System,
    params: Any,  # noqa: ANN401 - as given
    record: FlightFolder,
    most: int,
) -> ReplayedFlights:
    """Flies up to `most` flights again: first those with violations, then some evenly spaced."""
    about, rows = record.about, record.rows
    total = f"{len(rows):,} flights of {about['until_ns'] / 1e9:g} s as recorded, "
    total += f"{sum(int(r['violations']) for r in rows)} violations"
    folder = record.file.parent
    goal = f"No property is violated in the flights of campaign {folder} that were flown again"
    if why := _why_not_flown(flat, about):
        return ReplayedFlights(goal, total, why)
    chosen = _chosen_flights(rows, most)
    if not chosen:
        return ReplayedFlights(goal, total, "no flight was flown again")
    if not program.flat(flat.name, params).properties:
        return ReplayedFlights(
            goal, total, "the system has no property: its flights are judged by nothing"
        )
    from soter.campaign.batch_flights import Fleet  # noqa: PLC0415 - compiles

    first, until_ns = int(about["first_seed"]), int(about["until_ns"])
    fleet = Fleet(program.flat(flat.name, params), until_ns)
    code = fleet.code_fields()
    if code["unknown"] or about.get("linked", {}) != code["linked"]:
        why = f"cannot be known ({code['unknown']})" if code["unknown"] else "is another now"
        return ReplayedFlights(goal, total, f"the C of externs that the campaign flew {why}")
    flown = {f.number: f for f in fleet.fly([int(r["number"]) for r in chosen], first)}
    return _replayed_flights(goal, total, rows, chosen, flown)


def _replayed_flights(
    goal: str,
    total: str,
    rows: Sequence[Mapping[str, Any]],
    chosen: Sequence[Mapping[str, Any]],
    flown: Mapping[int, FlightOutcome],
) -> ReplayedFlights:
    other = [r["number"] for r in chosen if flown[int(r["number"])].digest != r["digest"]]
    broken = [f.number for f in flown.values() if f.violations]
    text = f"{len(flown)} flights flown again just now, bit for bit; {total}"
    if other:
        return ReplayedFlights(goal, text, f"flight {other[0]} is another one than the folder says")
    if broken:
        violation = f"flight {broken[0]} of the campaign violates a property"
        return ReplayedFlights(goal, text, violation, violation)
    if any(int(r["violations"]) for r in rows):
        return ReplayedFlights(
            goal, text, "flights that violate a property as recorded were not flown again"
        )
    return ReplayedFlights(goal, text)


def _why_not_flown(flat: System, about: dict[str, Any]) -> str:
    """Why no flight can be flown again; "" if flights can."""
    if about["program_sha256"] != flat.program.sha256 or about["system"] != flat.name:
        return "the campaign is of another program or system: hashes differ"
    if about["arm"] or about["lateness"] or about["horizon_ns"]:
        return "flights of an arm, or with saves, are not flown again here"
    if not flat.properties:
        return f"system {flat.name} has no property that a flight could violate"
    return ""


def _chosen_flights(rows: list[dict[str, str]], most: int) -> list[dict[str, str]]:
    """At most `most` rows, each once: first those with violations, then some evenly."""
    if most <= 0:
        return []
    each = list({int(r["number"]): r for r in rows}.values())
    first = [r for r in each if int(r["violations"])][:most]
    rest = [r for r in each if r not in first]
    left = most - len(first)
    return [*first, *(rest[:: max(1, -(-len(rest) // left))] if left else [])]


def read_flights(folder: Path) -> FlightFolder:
    """Reads the folder of a campaign. Raises D006 if it is no such folder, or unreadable."""
    file = folder / "flights.csv"
    try:
        about = json.loads(read_json_text(folder / "campaign.json"))
        text = read_bytes(file, FLIGHTS_MAX).decode("utf-8")
        rows = list(csv.DictReader(StringIO(text, newline="")))
        _require_sound_campaign(about, rows)
    except (
        OSError,
        ValueError,
        OverflowError,
        KeyError,
        TypeError,
        RecursionError,
        csv.Error,
    ) as error:
        message = f"`{folder}` is no folder of `soter campaign`: {error}"
        raise mistake("D006", message) from error
    return FlightFolder(file, file_hash(file), about, rows)


def _require_sound_campaign(about: dict[str, Any], rows: list[dict[str, str]]) -> None:
    """Raises ValueError, KeyError or TypeError if the files of a campaign are wrong."""
    from soter.campaign.store import SCHEMA  # noqa: PLC0415 - then only

    if other := why_format_is_unreadable(about["schema"], SCHEMA):
        raise ValueError(other)
    for name in ("program_sha256", "system", "arm", "lateness", "horizon_ns"):
        about[name]
    if int(about["until_ns"]) <= 0 or int(about["first_seed"]) < 0:
        raise ValueError("`until_ns` or `first_seed` is out of range")
    for r in rows:
        if not 0 <= int(r["number"]) < NUMBERS or int(r["violations"]) < 0 or not r["digest"]:
            raise ValueError(f"flight {r['number']} is out of range")


@dataclass(frozen=True)
class Evidence:
    """The files beside a certificate; `report_by_test`: by test, what its report says."""

    program: Program
    flat: System
    params: Any
    report_by_test: dict[str, dict[str, Any]]
    report: Path | None
    report_sha256: str
    flights: FlightFolder | None

    @staticmethod
    def read_files(
        program: Program,
        flat: System,
        params: Any,  # noqa: ANN401 - as given
        test_report: str | Path | None,
        campaign: str | Path | None,
        tell: Tell,
    ) -> Evidence:
        """Reads the files, and calls `tell` for each that does not fit. Raises D005 or D006."""
        report = None if test_report is None else Path(test_report)
        read = Evidence(
            program,
            flat,
            params,
            {} if report is None else _tests_in_report(report),
            report,
            "" if report is None else file_hash(report),
            None if campaign is None else read_flights(Path(campaign)),
        )
        if any(of["program_sha256"] != flat.program.sha256 for of in read.report_by_test.values()):
            tell(OTHER_REPORT)
        if read.flights is not None and (why := _why_not_flown(flat, read.flights.about)):
            tell(why)
        return read

    def add_tests(self, case: SafetyCase, *, explored: bool) -> None:
        """Adds a goal for each test: supported if it was explored now and is clean."""
        present = [n for n in self.flat.program.tests if "." not in n] if explored else []
        names = list(dict.fromkeys([*self.report_by_test, *present]))
        if not names:
            return
        goal = case.add(CaseNode("G2", "goal", "No execution of the tests violates a property"))
        report = None
        if explored:
            phase("exploring the tests again")
            report = self.program.explore(params=self.params, output=None)
        results = {} if report is None else {t.name: t for t in report.tests}
        for k, name in enumerate(names, 1):
            result = results.get(name)
            self._add_test(case, goal, k, name, result, report)
            if result is not None and result.verdict == "violated":
                case.refuted.append(f"test {name} is violated")

    def _add_test(
        self,
        case: SafetyCase,
        goal: CaseNode,
        number: int,
        name: str,
        result: TestResult | None,
        report: ExploreReport | None,
    ) -> None:
        test = self.flat.program.tests.get(name)
        of = "" if test is None else f" of system {test.system.name}"
        text = f"test {name}{of}: every execution within its bounds is clean"
        child = case.add(CaseNode(f"G2.{number}", "goal", text, property=name), under=goal)
        leaf = CaseNode(f"Sn.2.{number}", "solution", f"a report on test {name}")
        if result is None or report is None:
            leaf.why = _report_fault(self.report_by_test.get(name), case.program_sha256)
            leaf.path, leaf.sha256 = str(self.report or ""), self.report_sha256
        else:
            leaf.text = f"test {name}, explored again just now"
            leaf.why = _why_no_support(result, report)
            leaf.checked = not leaf.why
            before = [int(n.id[1:]) for n in case.nodes if n.kind == "assumption"]
            for k, assumption in enumerate(result.assumptions, 1 + max(before, default=0)):
                key = f"test {name}: {assumption}"
                node = CaseNode(f"A{k}", "assumption", key, key=key, stated_by="test")
                case.add(node, beside=child)
        case.add(leaf, under=child)

    def add_campaign(self, case: SafetyCase, most: int) -> None:
        """Adds the goal of the campaign: flies flights again and compares their digests."""
        if self.flights is None:
            return
        phase("flying again")
        flown = replay_flights(self.program, self.flat, self.params, self.flights, most)
        goal = case.add(CaseNode("G3", "goal", flown.goal))
        leaf = CaseNode("Sn.3", "solution", flown.text, checked=not flown.why, why=flown.why)
        leaf.path, leaf.sha256 = str(self.flights.file), self.flights.sha256
        case.add(leaf, under=goal)
        if flown.violated:
            case.refuted.append(flown.violated)


def _why_no_support(result: TestResult, report: ExploreReport) -> str:
    """Why a test that was explored now supports no goal; "" if all executions are clean."""
    if result.verdict != "exhausted":
        return f"explored just now: {result.verdict}" + f", {result.why}" * bool(result.why)
    for name, tests in result.contracts.items():
        if not tests:
            return f"it rests on the contract of {name}, of which no test asks"
    return report.unclean_contracts_note(result)


def _report_fault(test: dict[str, Any] | None, sha256: str) -> str:
    if test is None:
        return "there is no such test any more"
    if test["program_sha256"] != sha256:
        return OTHER_REPORT
    return f"the report says {test['verdict']} of this program; it was not explored again (--tests)"


def _tests_in_report(path: Path) -> dict[str, dict[str, Any]]:
    """Maps each test to its entry in a file of `soter test --json`. Raises D005 or D006."""
    try:
        document = json.loads(read_json_text(path))
        sha256, tests = document["program_sha256"], document["tests"]
        return {str(t["name"]): {"verdict": t["verdict"], "program_sha256": sha256} for t in tests}
    except OSError as error:
        raise mistake("D006", f"cannot read `{path}`: {reason(error)}") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        problem = f"`{path}` is no report of `soter test --json`"
        raise mistake("D005", problem, f"soter test FILE --json > {path}") from error
