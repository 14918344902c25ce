"""A safety case of a system: `soter assure`.

Purpose: goals in the paper's properties and in the words of ASTM F3269-21, leaves that are checked
here and now: the certificate by the re-checker, tests by exploring again, flights of a campaign by
flying again; everything else is told with its hash, and supports nothing.
Non-goals: the pages (`report/assurance/`); proving.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import require_no_certificate
from soter.api.assurance.certificate_check import command_line, proof_of, provenance_of
from soter.api.assurance.evidence import Evidence
from soter.api.assurance.hazard_traceability import Tracing
from soter.api.assurance.predicate_expansion import expanded
from soter.api.assurance.proof_goals import LAWS, RETURNS, argue
from soter.api.rechecking import require_flint
from soter.diagnostics.diagnostic import mistake
from soter.report.assurance.safety_case import SUPPORTED, CaseNode, SafetyCase
from soter.report.atomic_write import ReportError, own_place
from soter.version import VERSION

if TYPE_CHECKING:
    from soter.api.arguments import Progress, Tell
    from soter.api.assurance.evidence import AssuredProgram
    from soter.language.model.system import System
    from soter.language.model.typed import PlantSymbol

FILES = ("index.html", "case.json", "case.sdoc")
FLOWN_AGAIN = 20


@dataclass(frozen=True)
class Assurance:
    """A case and its files.

    `refuted`: a certificate that is rejected, a compiled decision module that differs, a test or a
    flight that violates a property. `not_rechecked`: why the re-checker neither accepts nor rejects
    the certificate; "": it does, or there is none.
    """

    case: SafetyCase
    files: tuple[Path, ...]
    refuted: tuple[str, ...]
    not_rechecked: str = ""

    @property
    def lawful(self) -> bool:
        """Whether a fail-safe law is supported, of every module."""
        return any(g.id == LAWS and self.case.status(g) == SUPPORTED for g in self.case.goals)

    @property
    def returns(self) -> bool:
        """Whether P2b is supported, wherever the program asks for it."""
        return all(self.case.status(g) == SUPPORTED for g in self.case.goals if g.id == RETURNS)


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
    hazards: str | Path | None = None,
    progress: Progress | None = None,
    tell: Tell = lambda _: None,
) -> Assurance:
    """Make the case and write it to the folder `output`.

    `tests`: explore them now; `flights`: so many of a campaign are flown again; `hazards`: a CSV
    file of hazards, requirements and who answers for assumptions (docs/assure.md); `tell` is told
    first what does not fit the program. SoterError D009 where there is no certificate, D005 for a
    report that is none, D021 for hazards that are none, D006 where something cannot be read or
    written, D007 without `prove`, and as of `Program.flat`.
    """
    require_flint()
    from soter.certificate.scope import parameters_of  # noqa: PLC0415 - needs NumPy

    for name in FILES:
        require_no_certificate(Path(output) / name, None if cert is None else Path(cert))
    flat = program.declared(system, params)
    case = SafetyCase(
        f"Safety case of {flat.name} in {Path(program.path).name}",
        program.path,
        flat.program.sha256,
        flat.name,
        parameters_of(flat),
    )
    case.plants = _plants(flat)
    refuted = case.refuted
    evidence = Evidence.read(program, flat, params, test_report, campaign, tell)
    tracing = Tracing.read(None if hazards is None else Path(hazards), flat)
    case.predicates = tuple(p for m in flat.modules for p in expanded(flat, m))
    proof = proof_of(cert, flat, case.params, progress, tell)
    options = {
        "--system": system,
        "--cert": cert,
        "--tests": tests,
        "--test-report": test_report,
        "--campaign": campaign,
        "--flights": flights if campaign is not None else None,
        "--hazards": hazards,
        "-o": output,
    }
    case.provenance = provenance_of(proof, command_line(program.path, options, params or {}))
    top = argue(case, flat, proof, refuted)
    if flat.faults:
        faulty = CaseNode("C-faults", "context", "runs with the `faults` of the system")
        case.add(faulty, beside=top)
    case.add(
        CaseNode(
            "C-evidence",
            "context",
            "tests and campaigns are evidence beside the proof: "
            "goals of their own, on which the top goal does not rest",
        ),
        beside=top,
    )
    evidence.tests(case, refuted, explored=tests)
    evidence.campaign(case, refuted, flights)
    tracing.enter(case)
    return Assurance(case, _written(case, Path(output)), tuple(refuted), proof.not_rechecked)


def _plants(flat: System) -> dict[str, tuple[str, ...]]:
    """The equations of each plant as they are written, by its instances."""
    names: dict[PlantSymbol, list[str]] = {}
    for c in flat.components:
        if c.plant is not None:
            names.setdefault(c.plant, []).append(c.name)
    return {
        f"{', '.join(instances)}: {plant.name}": _equations(plant)
        for plant, instances in names.items()
    }


def _equations(plant: PlantSymbol) -> tuple[str, ...]:
    """Of an extern plant: none."""
    told = [("let", v, e) for v, e in plant.lets]
    told += [("der", v, e) for v, e in plant.der.items()]
    told += [("next", v, e) for v, e in plant.next.items()]
    return tuple(f"{word} {v.name} = {' '.join(e.span.text.split())}" for word, v, e in told)


# ---------------------------------------------------------------- files


def _written(case: SafetyCase, folder: Path) -> tuple[Path, ...]:
    """The three files; SoterError D006 where one cannot be written."""
    from soter.report.assurance.safety_case_page import write_case  # noqa: PLC0415 - only then
    from soter.report.assurance.strictdoc import sdoc  # noqa: PLC0415 - only then
    from soter.report.html import write_text  # noqa: PLC0415 - only then

    try:
        page, data, document = (own_place(folder, name) for name in FILES)
        write_case(case, page)
        write_text(json.dumps(case.to_json(VERSION), indent=2, sort_keys=True) + "\n", data)
        write_text(sdoc(case), document)
    except (ReportError, OSError) as error:
        raise mistake("D006", str(error)) from error
    return page, data, document
