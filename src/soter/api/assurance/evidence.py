"""Tests and flights of a safety case: evidence beside the proof.

Purpose: `Evidence`: what was given is read, and its hashes compared, before anything that takes
long; then tests are explored and flights flown again. A goal is supported by what was done now.
Non-goals: the certificate (`proof_goals.py`), flying (`reproduced_flights.py`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.assurance.certificate_check import file_hash
from soter.api.assurance.reproduced_flights import FlightFolder, read_flights, replay_flights
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import read_json_text
from soter.report.assurance.safety_case import CaseNode

if TYPE_CHECKING:
    from soter.api.assurance.reproduced_flights import AssuredProgram
    from soter.explore.results import ExploreReport, TestResult
    from soter.language.model.system import System
    from soter.report.assurance.safety_case import SafetyCase


@dataclass(frozen=True)
class Evidence:
    """What was given beside a certificate; `told`: test -> what a report says of it."""

    program: AssuredProgram
    flat: System
    params: Any
    told: dict[str, dict[str, Any]]
    report: Path | None
    report_sha256: str
    flights: FlightFolder | None

    @staticmethod
    def read(
        program: AssuredProgram,
        flat: System,
        params: Any,  # noqa: ANN401 - as given
        test_report: str | Path | None,
        campaign: str | Path | None,
    ) -> Evidence:
        """Read it; SoterError D005, D006 for what is none."""
        report = None if test_report is None else Path(test_report)
        return Evidence(
            program,
            flat,
            params,
            {} if report is None else _told(report),
            report,
            "" if report is None else file_hash(report),
            None if campaign is None else read_flights(Path(campaign)),
        )

    def tests(self, case: SafetyCase, refuted: list[str], *, explored: bool) -> None:
        """A goal a test: supported where it was explored now, and is clean."""
        own = _own_tests(self.flat) if explored else []
        names = list(dict.fromkeys([*self.told, *own]))
        if not names:
            return
        goal = case.add(CaseNode("G2", "goal", "No execution of the tests violates a property"))
        report = None
        if explored:
            phase("exploring the tests again")
            report = self.program.explore(params=self.params, output=None)
        for k, name in enumerate(names, 1):
            result = None if report is None else _of(report, name)
            self._test(case, goal, k, name, result, report)
            if result is not None and result.verdict == "violated":
                refuted.append(f"test {name} is violated")

    def _test(
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
            leaf.why = _as_told(self.told.get(name), case.program_sha256)
            leaf.path, leaf.sha256 = str(self.report or ""), self.report_sha256
        else:
            leaf.text = f"test {name}, explored again just now"
            leaf.why = _why_not(result, report)
            leaf.checked = not leaf.why
            for k, said in enumerate(result.assumptions, 1):
                said = f"test {name}: {said}"  # noqa: PLW2901 - whose it is
                node = CaseNode(f"A2.{number}.{k}", "assumption", said, key=said)
                case.add(node, beside=child)
        case.add(leaf, under=child)

    def campaign(self, case: SafetyCase, refuted: list[str], most: int) -> None:
        """What was flown again: the seeds of the campaign, and the digests that it wrote down."""
        if self.flights is None:
            return
        phase("flying again")
        flown = replay_flights(self.program, self.flat, self.params, self.flights, most)
        goal = case.add(CaseNode("G3", "goal", flown.goal))
        leaf = CaseNode("Sn.3", "solution", flown.text, checked=not flown.why, why=flown.why)
        leaf.path, leaf.sha256 = str(self.flights.file), self.flights.sha256
        case.add(leaf, under=goal)
        if flown.violated:
            refuted.append(flown.violated)


def _of(report: ExploreReport, name: str) -> TestResult | None:
    return next((t for t in report.tests if t.name == name), None)


def _why_not(result: TestResult, report: ExploreReport) -> str:
    """Why a test that was explored now supports nothing; "": every execution is clean."""
    if result.verdict != "exhausted":
        return f"explored just now: {result.verdict}" + f", {result.why}" * bool(result.why)
    for name, tests in result.contracts.items():
        if not tests:
            return f"it rests on the contract of {name}, of which no test asks"
    return report.unsettled(result)


def _own_tests(flat: System) -> list[str]:
    """The tests of the main file."""
    return [n for n in flat.program.tests if "." not in n]


def _as_told(told: dict[str, Any] | None, sha256: str) -> str:
    if told is None:
        return "there is no such test any more"
    if told["program_sha256"] != sha256:
        return "the report is about another program: the hashes differ"
    return f"the report says {told['verdict']} of this program; it was not explored again (--tests)"


def _told(path: Path) -> dict[str, dict[str, Any]]:
    """Test -> what a document of `soter test --json` says; SoterError D005, D006."""
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
