"""Says which proofs a deployed system takes over from the system of its proofs or a certificate.

Purpose: `transferred_proofs` says module by module whether the proof holds for the deployed system,
and what is still assumed. `certified_sets` reads S_0 and S_(m-2) of every group and case from a
certificate, so that they need not be computed. `difference_from_certificate` compares the tables
and figures with which a DM is built with those of a certificate.
Non-goals: whether a certificate is right: the caller has had it checked (`soter.recheck`), and
`ttf` and `safer` of the module confirmed; that both systems are the same program
(`language/elaborate/wellformed.py`), what sensors have to give (`deployed_sensors.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from soter.certificate.report import RejectedError
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.derived_systems import faultless, without_held_topics
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.verify.claims.results import PROVED
from soter.verify.grid.claims import levels_in_certificate
from soter.verify.problem.extract import extract, parameter_cases
from soter.verify.problem.problem import assumption_texts
from soter.verify.proof_methods import built_entry
from soter.verify.tubes.problem import TubeProblem
from soter.verify.verify_module import module_method

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.certificate.reading.folder import Certificate
    from soter.language.model.system import Module, System
    from soter.verify.deploy.level_tables import Estimates, LevelTable, Pairs
    from soter.verify.problem.problem import Group, Problem


def certified_sets(
    certificate: Certificate, system: str, module: str, problem: Problem
) -> list[Pairs] | None:
    """The sets (S_0, S_(m-2)) of every group and case, read from a certificate.

    `system` and `module` are names in the certificate.

    None unless the certificate has exactly this problem's cases, groups and grids.
    """
    entries = [
        e
        for e in certificate.manifest["modules"]
        if (e.get("system"), e.get("module")) == (system, module) and "view" not in e
    ]
    if len(entries) != 1 or problem.module.shield is not None or "levels" in entries[0]:
        return None  # a certificate lacks what a shield permits for longer, and other level counts
    if not _wraps_the_same_axes(entries[0], problem):
        return None
    entry_cases, every = entries[0].get("cases", []), list(parameter_cases(problem))
    if [tuple(c["parameter"]) for c in entry_cases] != every:
        return None
    groups = problem.groups
    case_pairs = []
    for case in entry_cases:
        if len(case["groups"]) != len(groups):
            return None
        both_groups = zip(groups, case["groups"], strict=True)
        pairs = [
            _certified_sets_of_group(certificate, problem, group, entry)
            for group, entry in both_groups
        ]
        known = [pair for pair in pairs if pair is not None]
        if len(known) < len(pairs):
            return None
        case_pairs.append(known)
    return case_pairs


NAMED = {"state": ("state", "states", "wraps"), "control": ("command",)}
"""For each kind of input the keys at which an entry names it."""


def difference_from_certificate(
    certificate: Certificate,
    system: str,
    module: str,
    problem: Problem,
    built: Sequence[LevelTable] | None,
) -> str:
    """Describes the first part of a module's DM that differs from its certificate; "" if none does.

    `built`: its tables, or the check that follows SC; empty if it has neither, so that AC never
    gets control; None if the program has the predicates, so that only figures are compared.
    """
    entries = (
        (e, (e["system"], e["module"], e.get("view", ""))) for e in certificate.manifest["modules"]
    )
    entry = next((e for e, of in entries if of == (system, module, problem.view)), None)
    if entry is None or "induction" in entry:
        return "predicates" if built else ""
    if "plans" in entry:
        entry = {**entry, **entry["plans"].get(problem.module.symbol.sc.name, {})}
    if built is not None and not built:
        followed = "rest" in entry and entry["claims"].get("P2a") == PROVED
        return "predicates" if followed or entry.get("tables") else ""
    files: dict[str, bytes] = {}
    ours = _dm_parts_without_names(built_entry(problem, built or (), files), files)
    theirs = _dm_parts_without_names(entry, certificate.contents)
    # tables follow from the other figures, and are named before them
    every = sorted(ours.keys() | theirs.keys(), key=lambda k: (k != "tables", k))
    every = ["ranges", "times", "wraps"] if built is None else every
    differing = next((k for k in every if ours.get(k) != theirs.get(k)), "")
    return differing if differing in ("", "ranges", "tables", "times") else f"`{differing}`"


def _wraps_the_same_axes(entry: Mapping[str, Any], problem: Problem) -> bool:
    """Whether the axes that wrap around are the same as in the certificate's entry."""
    names = [i["name"] for i in entry["inputs"] if i["kind"] == "state"]
    wraps = entry.get("wraps", ())
    return {k for k, name in enumerate(names) if name in wraps} == problem.quantities.turning


def _dm_parts_without_names(
    entry: Mapping[str, Any], contents: Mapping[str, object]
) -> dict[str, Any]:
    """The DM's parts of an entry, with numbers for names, because imports may change names."""
    rest, inputs = entry.get("rest") or {}, entry["inputs"]
    parts = {key: entry[key] for key in ("times", "tables", "wraps", "levels") if key in entry}
    parts |= rest
    parts["reads"] = {of["state"]: of["within"] for of in rest.get("reads", {}).values()}
    parts["ranges"] = [(i["kind"], i["low"], i["high"]) for i in inputs]
    places = {kind: [i["name"] for i in inputs if i["kind"] == kind] for kind in NAMED}
    return {key: _resolve_names(of, contents, places, key) for key, of in parts.items()}


def _resolve_names(
    entry: Any,  # noqa: ANN401 - any part of a manifest
    contents: Mapping[str, object],
    places: Mapping[str, list[str]],
    key: str,
) -> Any:  # noqa: ANN401 - the same
    """A copy of a part of an entry, found under `key`, with numbers or bytes in place of names."""
    if isinstance(entry, dict):
        return {k: _resolve_names(of, contents, places, k) for k, of in entry.items()}
    if isinstance(entry, list):
        return [_resolve_names(of, contents, places, key) for of in entry]
    kind = next((kind for kind, keys in NAMED.items() if key in keys), "")
    if isinstance(entry, str) and entry in places.get(kind, ()):
        return places[kind].index(entry)
    return contents.get(entry, entry) if isinstance(entry, str) else entry


def _certified_sets_of_group(
    certificate: Certificate, problem: Problem, group: Group, entry: dict[str, Any]
) -> Estimates | None:
    """The sets S_0 and S_(m-2) of a group; None if the entry lacks them or has another group."""
    names = [problem.quantities.states[a.state].name for a in group.axes]
    if entry["kind"] != "grid" or [a["state"] for a in entry["axes"]] != names:
        return None
    try:
        edges = [certificate.breakpoints(a["edges"]) for a in entry["axes"]]
        if edges != [tuple(a.edges) for a in group.axes]:
            return None
        return levels_in_certificate(certificate, group, entry)
    except (RejectedError, ValueError):
        return None


IN_TIME = "the loop runs every instant no later than `late` says (SOTER_LATE tells)"


@dataclass(eq=False)
class TransferredProof:
    """The proof that a module of a deployed system takes over, or a reason (`why_not`) if none."""

    module: str
    why_not: str = ""
    covered: list[str] = field(default_factory=list)
    """The inputs from outside that are covered, with the bounds that the proof allows."""
    assumptions: list[str] = field(default_factory=list)
    """The assumptions of the proof, and further ones about the world and the loop."""
    problem: Problem | None = None


def transferred_proofs(deployed: System, proof_system: System) -> tuple[TransferredProof, ...]:
    """The proof that each module of `deployed` takes over from `proof_system`.

    No predicates have been computed for `proof_system` yet.

    Raises `SoterError` D019 if an input from outside is not covered.
    """
    diagnostics = Diagnostics()
    proved = faultless(without_held_topics(proof_system))
    _require_all_sensed(deployed, proof_system, diagnostics)
    transfers = [_transferred_proof(deployed, m, proved, diagnostics) for m in deployed.modules]
    diagnostics.raise_errors()
    return tuple(transfers)


def advice_to_deploy(deployed: System, cert: str) -> tuple[str, str]:
    """Advice for a user who builds a system with plants and passes a certificate."""
    outside = {i for c in deployed.components if c.plant for i in (*c.writes, *c.reads)}
    outside |= {t.index for t in deployed.topics if t.driver == "input"}
    met = " ".join(f"external topic {t.name};" for t in deployed.topics if t.index in outside)
    copy = f"`system NAME deploys {deployed.name} {{ ... }}` with `{met}` in place of plants and "
    copy += "inputs"
    return (
        f"leave `--cert` out: `soter recheck {cert}` says what is proved of it",
        f"or build a copy of it that meets the world: {copy}",
    )


def _require_all_sensed(deployed: System, proof_system: System, diagnostics: Diagnostics) -> None:
    """Reports D019 if a plant reads a topic that is not external in the deployed system."""
    sensed, system = {deployed.topics[e.topic].name for e in deployed.externals}, deployed.name
    for c in proof_system.components:
        for topic in c.plant.reads if c.plant is not None else ():
            name = proof_system.topics[c.scope.topics[topic]].name
            if name not in sensed and proof_system.topics[c.scope.topics[topic]].driver != "input":
                diagnostics.error(
                    "D019",
                    f"plant `{c.name}` reads `{name}`, and nobody takes it out of `{system}`",
                    deployed.program.systems[system].span,
                    also=((topic.span, "the topic"),),
                    helps=(f"add `external topic {name};`",),
                )


def _transferred_proof(
    deployed: System, m: Module, proof_system: System, diagnostics: Diagnostics
) -> TransferredProof:
    transfer = TransferredProof(m.name)
    proved = next(x for x in proof_system.modules if x.name == m.name)
    try:
        problems = [extract(*seen) for seen in systems_by_view(proof_system, proved)]
    except SoterError as error:
        transfer.why_not = f"nothing can be proved of it: {error.diagnostics[0].message}"
        return transfer
    for problem in problems:
        transfer.why_not = transfer.why_not or _why_not_carried(problem, proved)
    if transfer.why_not:
        return transfer
    for problem in problems:
        transfer.assumptions += [
            text
            for text in assumption_texts(problem.assumptions)
            if text not in transfer.assumptions
        ]
    (problem,) = problems
    if isinstance(problem, TubeProblem) and problem.plans:
        transfer.why_not = "SC has several plans, and what each reads is not carried over yet"
        return transfer
    transfer.problem = problem
    covers = module_method(problem).covers
    transfer.covered, assumed = covers(deployed, proof_system, problem, diagnostics)
    transfer.assumptions += [*assumed, IN_TIME]
    return transfer


def _why_not_carried(problem: Problem, module: Module) -> str:
    """The reason why such a proof does not hold for a deployed system; "" if it may hold."""
    if module.symbol.verify.abstracts or problem.view:
        return (
            "it was proved on verification plants (`abstracts`), and how old a state is behind the "
            "nodes that show it is not carried over yet"
        )
    return ""
