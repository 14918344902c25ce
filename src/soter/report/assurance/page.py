"""The page of a safety case: verdict first, then the argument as a picture, then every goal.

Purpose: one HTML file without scripts, to be handed to an assessor, in the order in which one asks:
is it supported, by which argument, resting on what, on which evidence, and what is not covered; and
what a board asks beside it: what is open, hazards and requirements, predicates in full, assumptions
with who answers for them; versions, hashes and flags, which stand on every printed page.
Non-goals: deciding what is supported (`safety_case.py`) or open
(`api/assurance/hazard_traceability.py`), the picture (`gsn_diagram.py`).
"""

from __future__ import annotations

import re
from collections import Counter
from html import escape
from typing import TYPE_CHECKING

from soter.report.assurance.gsn_diagram import pictures
from soter.report.assurance.safety_case import MEANINGS, SUPPORTED
from soter.report.html import asset_text, write_document
from soter.report.templates import filled

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    from soter.report.assurance.safety_case import CaseNode, SafetyCase, TracedItem, TracedProperty

ON_EVERY_PAGE = ("Soter", "re-checker", "certificate", "C compiler")
"""Of what a case was made with, beside its program."""
KINDS = {
    "hazard": "Hazards",
    "requirement": "Requirements",
    "property": "Properties that no hazard traces to",
    "assumption": "Assumptions",
}
PLURALS = {kind: kind.replace("property", "propertie") + "s" for kind in KINDS}
HOW = {
    "proof": "by proof",
    "exploration": "by exploring its test",
    "flights": "by flights, a sample",
}


def write_case(case: SafetyCase, path: str | os.PathLike[str]) -> Path:
    """Write the page; raises `ReportError` where that cannot be."""
    return write_document(case.title, body(case), path)


def body(case: SafetyCase) -> str:
    """The main part of the page."""
    said = [f"program SHA-256 {case.program_sha256}"]
    said += [f"{name} {case.provenance[name]}" for name in ON_EVERY_PAGE if name in case.provenance]
    open_goals = [g for g in case.goals if case.status(g) != SUPPORTED]
    below = {i for n in case.nodes for i in n.supported_by}
    count = Counter(item.kind for item in case.traceability.open)
    return filled(
        "report/assurance/page.html.j2",
        case=case,
        css=asset_text("assurance.css"),
        facts=_facts(case),
        pictures=pictures(case),
        open_goals=open_goals,
        beside=[g for g in open_goals if g is not case.goals[0] and g.id not in below],
        counted=[f"{n} {PLURALS[kind] if n > 1 else kind}" for kind, n in count.items()],
        near=lambda n: [case.node(i) for i in n.supported_by],
        open_items=_open_items(case),
        names={p.name for p in case.traceability.properties},
        traced=_traced(case),
        provided=lambda behind: _provided(case, behind),
        how=HOW,
        evidence=_evidence(case),
        meanings=MEANINGS,
        formula=_formula,
        identified=said,
    )


def _facts(case: SafetyCase) -> dict[str, str]:
    return {
        "program": case.program,
        "SHA-256": case.program_sha256,
        "system": case.system,
        "parameters": ", ".join(f"{n} = {v}" for n, v in case.params.items()) or "none",
        **case.provenance,
        "notation": "GSN Community Standard, version 3",
        "terms": "ASTM F3269-21; the last table says what they are called in the program",
    }


def _open_items(case: SafetyCase) -> list[tuple[str, int, dict[tuple[str, str], list[str]]]]:
    """Everything that nobody has closed, by what it is of; of each reason the ids."""
    listed = []
    for kind, title in KINDS.items():
        mine = [item for item in case.traceability.open if item.kind == kind]
        ids_by_why: dict[tuple[str, str], list[str]] = {}
        for item in mine:
            ids_by_why.setdefault((kind, item.why), []).append(item.id)
        if mine:
            listed.append((title, len(mine), ids_by_why))
    return listed


def _traced(case: SafetyCase) -> list[tuple[str, list[tuple[TracedItem, list[TracedProperty]]]]]:
    """Hazards and requirements as given, and what stands behind each."""
    properties = {p.name: p for p in case.traceability.properties}
    sections = []
    for kind in ("hazard", "requirement"):
        items = [i for i in case.traceability.items if i.kind == kind]
        if items:
            rows = [(i, [properties[name] for name in i.properties]) for i in items]
            sections.append((KINDS[kind], rows))
    return sections


def _provided(case: SafetyCase, behind: Sequence[TracedProperty]) -> str:
    """What is open although a row is supported: assumptions of the proofs, flights."""
    count = sum(item.kind == "assumption" for item in case.traceability.open)
    said = [f"with {count} assumption{'s' if count > 1 else ''} open"] if count else []
    if any(p.status == "not flown" for p in behind):
        said.append("flights are missing")
    return "; ".join(said)


def _evidence(case: SafetyCase) -> list[tuple[list[CaseNode], list[CaseNode]]]:
    """Each piece of evidence once, with everything that it supports."""
    nodes_by_evidence: dict[tuple[str, str, str, str, bool], list[CaseNode]] = {}
    for n in case.nodes:
        if n.kind == "solution":
            nodes_by_evidence.setdefault((n.text, n.why, n.path, n.sha256, n.checked), []).append(n)
    return [
        (nodes, [g for g in case.nodes if any(m.id in g.supported_by for m in nodes)])
        for nodes in nodes_by_evidence.values()
    ]


def _formula(text: str) -> str:
    """As HTML in which no line ends between a sign and what it is of."""
    return re.sub(r"-\w", r'<span class="whole">\g<0></span>', escape(text))
