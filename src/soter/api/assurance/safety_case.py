"""Makes the safety case of a system (`soter assure`): goals, evidence, pages.

Purpose: `assure` makes goals from the paper's properties in the words of ASTM F3269-21, and checks
their evidence now: the certificate by the re-checker, tests by exploring and flights by flying
again; any other file is listed with its hash, and supports nothing. `add_argument` adds the top
goal and the properties below it; beside it, as goals of their own, that control comes back (P2b),
that a fail-safe law holds once the trusted part has stopped, and that the compiled decision module
(DM) is the one that was proved. `check_compiled` repeats the check of `soter verify`, row DM;
for computed `ttf` and `safer` with the certificate's tables, which the re-checker has confirmed.
Non-goals: the pages (`report/safety_case_page.py`); proving; the certificate
(`certificate_check.py`); the check of the DM (`verify/deploy/dm_check.py`): what it does not try
supports nothing.
"""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.assurance.certificate_check import (
    CertifiedProof,
    case_provenance,
    certified_proof,
    command_line,
    compiler_used,
)
from soter.api.assurance.condition_tracing import trace_conditions
from soter.api.assurance.evidence import Evidence
from soter.api.assurance.hazard_traceability import NUMBER, Tracing
from soter.api.assurance.predicate_inlining import expanded_predicates
from soter.api.exploring import chosen_tests
from soter.api.output_files import require_no_certificate
from soter.api.rechecking import require_flint
from soter.codegen.conditions import watching
from soter.diagnostics.command_records import refuse_needless
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.elaborate.derived_systems import faultless
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.report.atomic_write import path_without_links
from soter.report.safety_case import (
    LAWS,
    RETURNS,
    SUPPORTED,
    Assurance,
    CaseNode,
    SafetyCase,
    strictdoc,
)
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.api.arguments import Progress, Tell
    from soter.api.program import Program
    from soter.certificate.reading.folder import Certificate
    from soter.certificate.report import RecheckAssumption, RecheckedModule, Report
    from soter.language.model.system import Module, System
    from soter.language.model.typed import PlantSymbol
    from soter.verify.deploy.level_tables import GroupTable
    from soter.verify.problem.problem import Problem


UNTRIED = (typed.AgeRead, typed.ModeRead)
"""Expressions for which the check of the DM tries no values."""


def check_compiled(
    flat: System, module: Module, entries: Sequence[dict[str, Any]], certificate: Certificate
) -> tuple[str, str, bool]:
    """Compares a DM's C with the model: a summary, why it is not enough, and whether they differ.

    `flat`: as declared; `entries`: the certificate's, one a view; the second text: "" if enough.
    """
    from soter.verify.deploy.dm_check import check_problem  # noqa: PLC0415 - compiles
    from soter.verify.problem.extract import extract  # noqa: PLC0415 - needs NumPy

    symbol = module.symbol
    read = nodes([e for e in (symbol.ttf, symbol.safer) if e is not None])
    if any(isinstance(n, UNTRIED) for n in read):
        return "", "not tried: `ttf` or `safer` reads an age, or a mode", False
    tried = ""
    try:
        for system, seen in systems_by_view(faultless(flat), module):
            problem = extract(system, seen)
            tables = _group_tables(problem, entries, certificate) if problem.computed else []
            if problem.computed and not tables:
                return "", "not tried: its predicates are no tables of cells", False
            check = check_problem(problem, tables)
            if check.failures:
                return "", check.summary, True
            tried = check.summary
    except (SoterError, NotImplementedError) as error:
        return "", f"not tried: {error}", False
    return tried, "", False


def _group_tables(
    problem: Problem, entries: Sequence[dict[str, Any]], certificate: Certificate
) -> list[GroupTable]:
    """The confirmed tables of the DM; [] if the view is missing or a table is not of cells."""
    import numpy as np  # noqa: PLC0415 - only then

    from soter.verify.deploy.level_tables import PER_BYTE, GroupTable  # noqa: PLC0415 - needs NumPy

    entry = next((e for e in entries if e.get("view", "") == problem.view), None)
    if entry is None:
        return []
    numbers = {s.name: i for i, s in enumerate(problem.quantities.states)}
    tables = []
    for each in entry.get("tables", ()):
        if each.keys() != {"axes", "levels"}:
            return []
        edges = [certificate.breakpoints(a["edges"]) for a in each["axes"]]
        shape = tuple(len(e) - 1 for e in edges)
        packed = np.frombuffer(certificate.table_bytes(each["levels"]), dtype=np.uint8)
        four = (packed[:, None] >> (2 * np.arange(PER_BYTE, dtype=np.uint8))) & 3
        cells = four.ravel()[: int(np.prod(shape))].reshape(shape)
        states = tuple(numbers[a["state"]] for a in each["axes"])
        tables.append(GroupTable(states, tuple(edges), np.ascontiguousarray(cells)))
    return tables


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
"""Property that safety needs (Theorem 3.1 of the paper; docs/proof.md) -> its text as a goal."""
NO_LAW = (
    "no fail-safe law is declared: that the plant stays safe once the trusted part has stopped "
    "(`failsafe` of `soter verify`) is assumed"
)
NOT_ASKED = "P2b of {name} is not asked: the program says `{clause}`"
MODULES = (
    "argument over every RTA module (ASTM F3269-21; Theorem 4.1: where each keeps its own "
    "property, all of them together are kept)"
)
RECHECKED = "certificate, checked again just now by the independent re-checker"
COMPILED = "G6"
"""The id of the goal about compiled switches."""


@dataclass(frozen=True)
class _ConfirmedModule:
    """A module with its number and the re-checker's reports, or `why` it has no reports."""

    number: int
    module: Module
    reports: list[RecheckedModule]
    why: str

    def why_unconfirmed(self, claim: str) -> str:
        """Why a claim about the module is unconfirmed, or "" if every view confirms it."""
        if self.reports and all(claim in m.confirmed for m in self.reports):
            return ""
        answers = dict.fromkeys(m.claims.get(claim, "not claimed") for m in self.reports)
        return self.why or f"the certificate does not confirm {claim}: {', '.join(answers)}"


def add_argument(case: SafetyCase, flat: System, proof: CertifiedProof) -> CaseNode:
    """Adds the goals about the certificate, notes refutations, and returns the top goal."""
    if proof.rejected:
        case.refuted.append(f"the certificate is rejected: {proof.rejected}")
    shown = [
        _ConfirmedModule(k, m, *proof.confirmed_reports(flat, m, case.params))
        for k, m in enumerate(flat.modules, 1)
    ]
    top = case.add(CaseNode("G1", "goal", _top_goal_text(flat)))
    strategy = case.add(CaseNode("S1", "strategy", MODULES), under=top)
    for each in shown:
        _add_module_goals(case, strategy, flat, each, proof)
    _add_return_goals(case, top, shown, proof)
    _add_law_goals(case, flat, shown, proof)
    compiled = _add_compiled_goals(case, flat, shown, proof)
    used = [m for each in shown for m in each.reports]
    if proof.report is not None and used:
        rest = [s for s in proof.report.not_covered if s.key != "compiled" or not compiled]
        _add_assumptions(case, top, used, rest, proof.report)
    return top


def _add_assumptions(
    case: SafetyCase,
    top: CaseNode,
    used: Sequence[RecheckedModule],
    rest: Sequence[RecheckAssumption],
    report: Report,
) -> None:
    """Adds the assumptions of proof and re-check, warnings of empty proofs, and uncovered `rest`.

    An assumption that only the manifest states gets the key `stated ...` if a derived one has it.
    """
    derived = {a.text: a.key for m in used for a in m.assumptions}
    taken = {NUMBER.sub("", key) for key in derived.values()}
    keys = {
        a.text: f"stated {a.key}" if NUMBER.sub("", a.key) in taken else a.key
        for a in report.stated
    }
    for text, number in report.assumption_numbers.items():
        by = " and ".join(["verify"] * (text in keys) + ["recheck"] * (text in derived))
        if by:
            key = derived.get(text) or keys[text]
            case.add(CaseNode(number, "assumption", text, key=key, stated_by=by), beside=top)
    for k, text in enumerate(_vacuous_sentences(used), 1):
        case.add(CaseNode(f"V{k}", "context", f"what is proved of {text}"), beside=top)
    for k, other in enumerate(rest, 1):
        case.add(CaseNode(f"C{k}", "context", f"not covered: {other.text}"), beside=top)


def _vacuous_sentences(used: Sequence[RecheckedModule]) -> list[str]:
    """Sentences on modules whose proof covers almost no state, or whose AC was not examined."""
    unseen = "it was not looked at whether AC ever has control"
    return [f"{m.name}: {m.vacuous}" for m in used if m.vacuous] + [
        f"{m.name}: {unseen} ({m.unseen})" for m in used if m.unseen
    ]


def _top_goal_text(flat: System) -> str:
    """The text of the top goal: safe while the trusted part runs (a later law has its own goal)."""
    kept = " and ".join(f"`{_safe(m)}`" for m in flat.modules) or "nothing"
    return (
        f"System {flat.name} keeps {kept} for as long as its trusted part runs, in every run that "
        "keeps the assumptions"
    )


def _safe(m: Module) -> str:
    return m.symbol.safe.span.text_on_one_line


def _add_module_goals(
    case: SafetyCase,
    strategy: CaseNode,
    flat: System,
    each: _ConfirmedModule,
    proof: CertifiedProof,
) -> None:
    """Adds the goal of one module, and below it the properties that safety needs."""
    module, id_ = each.module, f"G1.{each.number}"
    ac, sc = flat.components[module.ac].name, flat.components[module.sc].name
    text = f"RTA module {module.name} keeps `{_safe(module)}`: complex function {ac}, recovery "
    goal = case.add(
        CaseNode(id_, "goal", f"{text}function {sc}", property=f"{module.name}.safe"),
        under=strategy,
    )
    for name, meaning in PROPERTIES.items():
        child = case.add(CaseNode(f"{id_}.{name}", "goal", f"{name}: {meaning}"), under=goal)
        _add_evidence_leaf(
            case, child, f"Sn.{each.number}.{name}", each.why_unconfirmed(name), proof
        )


def _add_evidence_leaf(
    case: SafetyCase, goal: CaseNode, id_: str, why: str, proof: CertifiedProof
) -> None:
    """Adds evidence from the certificate below a goal, or records `why` evidence is missing."""
    leaf = CaseNode(id_, "solution", "no evidence" if why else RECHECKED, checked=not why, why=why)
    if not why:
        leaf.path, leaf.sha256 = proof.path, proof.sha256
    case.add(leaf, under=goal)


def _add_return_goals(
    case: SafetyCase, top: CaseNode, shown: list[_ConfirmedModule], proof: CertifiedProof
) -> None:
    """Adds the goal that AC regains control (P2b), for modules whose program demands it."""
    asked = [each for each in shown if not each.module.symbol.stay_clause]
    for each in shown:
        if each not in asked:
            text = NOT_ASKED.format(name=each.module.name, clause=each.module.symbol.stay_clause)
            case.add(CaseNode(f"C-P2b-{each.number}", "context", text), beside=top)
    if not asked:
        return
    goal = case.add(
        CaseNode(RETURNS, "goal", "Where a recovery function has control it gives it back")
    )
    for each in asked:
        text = f"P2b: the complex function of {each.module.name} gets control back"
        name = f"{each.module.name}.P2b"
        child = case.add(
            CaseNode(f"{RETURNS}.{each.number}", "goal", text, property=name), under=goal
        )
        _add_evidence_leaf(case, child, f"Sn.4.{each.number}", each.why_unconfirmed("P2b"), proof)


def _add_law_goals(
    case: SafetyCase, flat: System, shown: list[_ConfirmedModule], proof: CertifiedProof
) -> None:
    """Adds the goal that a fail-safe law takes over when the trusted part has stopped."""
    if not shown:
        return
    text = f"System {flat.name} keeps it, too, once its trusted part has stopped"
    goal = case.add(CaseNode(LAWS, "goal", text))
    for each in shown:
        text = f"the fail-safe law of {each.module.name} keeps `{_safe(each.module)}` from then on"
        name = f"{each.module.name}.failsafe"
        child = case.add(CaseNode(f"{LAWS}.{each.number}", "goal", text, property=name), under=goal)
        why = each.why_unconfirmed("failsafe")
        if not each.module.law:
            why = NO_LAW
        # it begins where the module has kept the state until then
        why = why or next(filter(None, map(each.why_unconfirmed, PROPERTIES)), "")
        _add_evidence_leaf(case, child, f"Sn.5.{each.number}", why, proof)


def _add_compiled_goals(
    case: SafetyCase, flat: System, shown: list[_ConfirmedModule], proof: CertifiedProof
) -> bool:
    """Adds the goal that the C of each DM switches as proved; compiles and runs the C now."""
    if not shown:
        return False
    text = "Every compiled RTA switch is the one that the argument is about"
    goal = case.add(CaseNode(COMPILED, "goal", text))
    for each in shown:
        tried, why, name = "", each.why, each.module.name
        if not why:
            assert proof.certificate is not None
            entries = proof.entries[name]
            tried, why, differs = check_compiled(flat, each.module, entries, proof.certificate)
            if tried or differs:
                case.provenance["C compiler"] = compiler_used()
            if differs:
                case.refuted.append(f"{name}: {why}")
        text = f"the generated C of the decision module of {name} switches as proved"
        child = case.add(CaseNode(f"{COMPILED}.{each.number}", "goal", text), under=goal)
        text = "no evidence" if why else f"{tried}, just now"
        leaf = CaseNode(f"Sn.6.{each.number}", "solution", text, checked=not why, why=why)
        case.add(leaf, under=child)
    return case.status(goal) == SUPPORTED


FILES = ("index.html", "case.json", "case.sdoc", "trace.csv")
FLOWN_AGAIN = 20


def assure(
    program: Program,
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
    trace: bool = False,
    progress: Progress | None = None,
    tell: Tell = lambda _: None,
) -> Assurance:
    """Makes the safety case and writes it to the folder `output`.

    `tests`: explore them now; `flights`: how many flights of the campaign to fly again; `hazards`:
    a CSV file of hazards, requirements and owners of assumptions (docs/assure.md); `trace`: also
    write `trace.csv`, which leads from these rows to conditions of the generated C and to the runs
    that cover them; `tell` is called first with what does not fit the program. Raises SoterError
    D009 without a certificate, D005 for a wrong report, D021 for wrong hazards, D006 if a file
    cannot be read or written, D007 without the extra `prove`, and all errors of `Program.flat`.
    """
    require_flint()
    from soter.certificate.scope import param_values  # noqa: PLC0415 - needs NumPy

    for name in FILES:
        require_no_certificate(Path(output) / name, None if cert is None else Path(cert))
    if campaign is None:
        refuse_needless("without `campaign`", flights=flights != FLOWN_AGAIN)
    refuse_needless("without `hazards`", trace=trace and hazards is None)
    flat = program.declared(system, params)
    if tests:  # U010 where there is none
        own_tests = {n: t for n, t in flat.program.tests.items() if "." not in n}
        chosen_tests(own_tests, program.path, None)
    title, sha256 = f"Safety case of {flat.name} in {Path(program.path).name}", flat.program.sha256
    case = SafetyCase(title, program.path, sha256, flat.name, param_values(flat))
    case.plants = _plant_equations(flat)
    evidence = Evidence.read_files(program, flat, params, test_report, campaign, tell)
    tracing = Tracing.read_tracing(None if hazards is None else Path(hazards), flat)
    case.predicates = tuple(p for m in flat.modules for p in expanded_predicates(flat, m))
    proof = certified_proof(cert, flat, case.params, progress, tell)
    options = {
        "--system": system,
        "--cert": cert,
        "--tests": tests,
        "--test-report": test_report,
        "--campaign": campaign,
        "--flights": flights if campaign is not None else None,
        "--hazards": hazards,
        "--trace": trace,
        "-o": output,
    }
    case.provenance = case_provenance(proof, command_line(program.path, options, params or {}))
    top = add_argument(case, flat, proof)
    _add_top_contexts(case, flat, top)
    tested = _add_test_goals(case, evidence, explored=tests, counted=trace)
    evidence.add_campaign(case, flights)
    tracing.enter_traces(case)
    if trace:
        trace_conditions(case, flat, program.flat(system, params), tested)
    files = _write_files(case, Path(output))
    return Assurance(case, files, tuple(case.refuted), proof.not_rechecked)


def _add_test_goals(
    case: SafetyCase, evidence: Evidence, *, explored: bool, counted: bool
) -> list[tuple[str, Any]]:
    """Adds the goals of tests; if `counted`, returns the conditions that the tests show."""
    with watching() if counted else nullcontext() as seen:
        evidence.add_tests(case, explored=explored)
        return [("the tests of the program", seen())] if seen and explored else []


def _add_top_contexts(case: SafetyCase, flat: System, top: CaseNode) -> None:
    """Adds the contexts of the top goal: faults in runs, and on which evidence it does not rest."""
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


def _plant_equations(flat: System) -> dict[str, tuple[str, ...]]:
    """Maps the name of each plant, with its instances, to its equations in the program."""
    names: dict[PlantSymbol, list[str]] = {}
    for c in flat.components:
        if c.plant is not None:
            names.setdefault(c.plant, []).append(c.name)
    return {
        f"{', '.join(instances)}: {plant.name}": _equation_texts(plant)
        for plant, instances in names.items()
    }


def _equation_texts(plant: PlantSymbol) -> tuple[str, ...]:
    """The source texts of a plant's equations; empty for an extern plant."""
    equations = [("let", v, e) for v, e in plant.lets]
    equations += [("der", v, e) for v, e in plant.der.items()]
    equations += [("next", v, e) for v, e in plant.next.items()]
    return tuple(f"{word} {v.name} = {e.span.text_on_one_line}" for word, v, e in equations)


# ---------------------------------------------------------------- files


def _write_files(case: SafetyCase, folder: Path) -> tuple[Path, ...]:
    """Writes the files and returns their paths. Raises D006 if a file cannot be written."""
    from soter.report.html import write_text  # noqa: PLC0415 - only then
    from soter.report.safety_case_page import write_case  # noqa: PLC0415 - only then

    try:
        page, data, document, table = (path_without_links(folder, name) for name in FILES)
    except OSError as error:
        raise mistake("D006", str(error)) from error
    write_case(case, page)
    write_text(json.dumps(case.to_json(VERSION), indent=2, sort_keys=True) + "\n", data)
    write_text(strictdoc(case), document)
    if case.conditions is None:
        return page, data, document
    write_text(case.conditions.as_csv(), table)
    return page, data, document, table
