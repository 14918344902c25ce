"""A safety case as plain data, in the words of the Goal Structuring Notation, and as StrictDoc.

Purpose: `SafetyCase` holds nodes by id, and finds which goals are supported, from the leaves up;
`Assurance` is such a case with its files and what refutes it.
`Traceability` holds hazards and requirements with the properties they lead to, and open items.
`ExpandedPredicate` holds a module's predicate for people who do not read the program.
`strictdoc` writes a document for trace matrices of a larger project: a requirement for every goal,
strategy and solution, whose parent it supports; contexts and assumptions as text before them.
Non-goals: checking a leaf, expanding predicates, following the rows of hazards (`api/assurance/`);
the page (`safety_case_page.py`); grammars of StrictDoc of one's own. Sources: GSN Community
Standard, version 3; StrictDoc's user guide, "SDoc syntax".
"""

from __future__ import annotations

import csv
from dataclasses import asdict, dataclass, field, fields
from io import StringIO
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


MEANINGS = {
    "safe": "What is to hold: the safety property of the module",
    "ttf": "Where it is true the RTA switch takes control from the complex function",
    "safer": "Where it is true the RTA switch may give control back to the complex function",
}


@dataclass(frozen=True)
class Definition:
    """A name in an expanded predicate, with its expression or value, and its unit if it has one."""

    name: str
    text: str
    unit: str = ""


@dataclass(frozen=True)
class ExpandedPredicate:
    """`safe`, `ttf` or `safer` of a module, with its functions inlined.

    `written`: the predicate in the program's text, "" if it is computed. `where`: named parts of
    `expanded`, each after those that it reads. `read`: the topic values that it reads. `functions`:
    the text of each function that stays a call, because it has a loop or assignment or is extern.
    """

    module: str
    name: str
    written: str
    expanded: str = ""
    where: tuple[Definition, ...] = ()
    constants: tuple[Definition, ...] = ()
    read: tuple[Definition, ...] = ()
    functions: tuple[Definition, ...] = ()

    def to_json(self) -> dict[str, object]:
        """The predicate as a JSON object, which docs/json.md describes."""
        return asdict(self)


@dataclass(frozen=True)
class TracedProperty:
    """A property that a hazard may trace to.

    `how`: "proof", "exploration" or "flights". `status`: that of its goal in the case, if any:
    "supported" or "undeveloped". Flights without a violation give "sampled", as they prove nothing
    about other flights; a property without flights is "not flown". `wanted`: a hazard should trace
    to it. `hazards`: the hazards that trace to it.
    """

    name: str
    how: str
    status: str
    goal: str = ""
    wanted: bool = True
    hazards: tuple[str, ...] = ()


@dataclass(frozen=True)
class TracedItem:
    """A hazard or a requirement; `properties` are those it leads to, also through requirements.

    `status`: "supported" if it has evidence other than flights, all such evidence holds, and all
    requirements that it traces to are supported; else "open".
    """

    kind: str
    id: str
    text: str
    traces_to: tuple[str, ...]
    properties: tuple[str, ...]
    status: str


@dataclass(frozen=True)
class OpenItem:
    """A "hazard", "requirement", "property" or "assumption" that is still open, and why."""

    kind: str
    id: str
    why: str


@dataclass(frozen=True)
class Traceability:
    """The traces of a case; `path`, `sha256`: of the given file, or ""; `open`: open items."""

    path: str = ""
    sha256: str = ""
    items: tuple[TracedItem, ...] = ()
    properties: tuple[TracedProperty, ...] = ()
    open: tuple[OpenItem, ...] = ()

    @property
    def covered(self) -> bool:
        """Whether every hazard and every requirement is supported."""
        return all(item.status == "supported" for item in self.items)

    def to_json(self) -> dict[str, object]:
        """The traces as a JSON object, which docs/json.md describes."""
        return asdict(self) | {"path": self.path or None, "sha256": self.sha256 or None}


@dataclass(frozen=True)
class TracedCondition:
    """A condition of the generated C, with the rows of hazards and the property that lead to it.

    `core`: the source construct of its C function. `source`: the place in the program, "" for code
    that every program has. `line`: the line in the C. `covered_by`: the evidence that the condition
    decides by itself (MC/DC); if that is "", `not_covered` says what is missing.
    """

    reached_by: tuple[tuple[str, str], ...]
    core: str
    source: str
    function: str
    line: int
    decision: str
    condition: str
    covered_by: str
    not_covered: str


@dataclass(frozen=True)
class ConditionTrace:
    """The conditions in the file `c`, what ran them; `empty`: (row, property) that reach none."""

    c: str
    ran: tuple[str, ...]
    conditions: tuple[TracedCondition, ...]
    empty: tuple[tuple[str, str], ...]

    @property
    def reached(self) -> list[TracedCondition]:
        """The conditions that some row of hazards reaches."""
        return [x for x in self.conditions if x.reached_by]

    @property
    def summary(self) -> str:
        """A sentence on how many conditions are reached, and how many of these are covered."""
        reached = self.reached
        covered, all_ = sum(bool(x.covered_by) for x in reached), len(self.conditions)
        return (
            f"hazards and requirements reach {len(reached)} of the {all_} conditions of {self.c}: "
            f"{covered} are covered, {len(reached) - covered} are not"
        )

    def as_csv(self) -> str:
        """The conditions as CSV in the order of the C; each property that reaches one has a row."""
        text = StringIO()
        table = csv.writer(text, lineterminator="\n")
        names = [f.name for f in fields(TracedCondition)][1:]
        table.writerow(("reached_by", "property", *names))
        for x in self.conditions:
            for row in x.reached_by or (("", ""),):
                table.writerow((*row, *(getattr(x, name) for name in names)))
        for row in self.empty:
            table.writerow((*row, *[""] * (len(names) - 1), "it reaches no condition"))
        return text.getvalue()


Kind = Literal["goal", "strategy", "solution", "context", "assumption"]
SUPPORTED, UNDEVELOPED = "supported", "undeveloped"
RETURNS, LAWS = "G4", "G5"
"""Ids of the goals about P2b and fail-safe laws."""


@dataclass
class CaseNode:
    """One element. `supported_by`, `in_context_of`: ids of others.

    A solution is `checked` where it was checked while the case was made, and then holds what its
    goal needs; `why` says what is missing otherwise. `sha256`: of what it points to. `property`: of
    a goal, the name by which a hazard traces to it. `key`: of an assumption, the same for the same
    thing in every case; `stated_by`: the commands that state it; who owns it, how it is validated
    and where that is seen, as people say it.
    """

    id: str
    kind: Kind
    text: str
    supported_by: list[str] = field(default_factory=list)
    in_context_of: list[str] = field(default_factory=list)
    checked: bool = False
    why: str = ""
    path: str = ""
    sha256: str = ""
    property: str = ""
    key: str = ""
    stated_by: str = ""
    owner: str = ""
    validation: str = ""
    evidence: str = ""


@dataclass
class SafetyCase:
    """All nodes in reading order, the top goal first; `provenance` names the tools that made it."""

    title: str
    program: str
    program_sha256: str
    system: str
    params: dict[str, str]
    nodes: list[CaseNode] = field(default_factory=list)
    provenance: dict[str, str] = field(default_factory=dict)
    predicates: tuple[ExpandedPredicate, ...] = ()
    traceability: Traceability = field(default_factory=Traceability)
    plants: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Instances of a plant, as text -> the plant's equations as the program writes them."""
    conditions: ConditionTrace | None = None
    refuted: list[str] = field(default_factory=list)
    """What was found to be false while the case was made, such as a rejected certificate."""

    def add(
        self, node: CaseNode, *, under: CaseNode | None = None, beside: CaseNode | None = None
    ) -> CaseNode:
        """Adds a node that supports `under`, or is context of `beside`, and gives it back."""
        assert all(n.id != node.id for n in self.nodes), node.id
        self.nodes.append(node)
        if under is not None:
            under.supported_by.append(node.id)
        if beside is not None:
            beside.in_context_of.append(node.id)
        return node

    def node(self, id_: str) -> CaseNode:
        """The node with this id; raises KeyError if no node has it."""
        for n in self.nodes:
            if n.id == id_:
                return n
        raise KeyError(id_)

    def status(self, node: CaseNode) -> str:
        """Gives "supported" if every branch below ends in a checked solution, or "undeveloped"."""
        if node.kind == "solution":
            return SUPPORTED if node.checked else UNDEVELOPED
        below = [self.status(self.node(i)) for i in node.supported_by]
        return SUPPORTED if below and set(below) == {SUPPORTED} else UNDEVELOPED

    @property
    def supported(self) -> bool:
        """Whether the top goal is supported."""
        return self.status(self.nodes[0]) == SUPPORTED

    @property
    def goals(self) -> list[CaseNode]:
        """All goals, in reading order."""
        return [n for n in self.nodes if n.kind == "goal"]

    def to_json(self, version: str) -> dict[str, object]:
        """The case as JSON, which docs/json.md describes."""
        return {
            "schema": 1,
            "soter": version,
            "title": self.title,
            "program": self.program,
            "program_sha256": self.program_sha256,
            "system": self.system,
            "params": self.params,
            "top": self.nodes[0].id,
            "supported": self.supported,
            "nodes": [self._node_json(n) for n in self.nodes],
            "provenance": self.provenance,
            "predicates": [p.to_json() for p in self.predicates],
            "traceability": self.traceability.to_json(),
            "conditions": None if self.conditions is None else asdict(self.conditions),
        }

    def _node_json(self, n: CaseNode) -> dict[str, object]:
        judged = n.kind in ("goal", "strategy", "solution")
        return {
            "id": n.id,
            "kind": n.kind,
            "text": n.text,
            "status": self.status(n) if judged else None,
            "why": n.why,
            "supported_by": n.supported_by,
            "in_context_of": n.in_context_of,
            "path": n.path or None,
            "sha256": n.sha256 or None,
            "key": n.key or None,
            "stated_by": n.stated_by or None,
            "owner": n.owner,
            "validation": n.validation,
            "evidence": n.evidence,
        }


@dataclass(frozen=True)
class Assurance:
    """A safety case and the files that were written.

    `refuted`: a rejected certificate, a compiled decision module that differs, or a test or flight
    that violates a property. `not_rechecked`: why the re-checker neither accepts nor rejects the
    certificate; "" if it does either, or if the case has no certificate.
    """

    case: SafetyCase
    files: tuple[Path, ...]
    refuted: tuple[str, ...]
    not_rechecked: str = ""

    @property
    def lawful(self) -> bool:
        """Whether the case supports the goal that every module has a fail-safe law."""
        return any(g.id == LAWS and self.case.status(g) == SUPPORTED for g in self.case.goals)

    @property
    def returns(self) -> bool:
        """Whether P2b is supported for every module for which the program demands it."""
        return all(self.case.status(g) == SUPPORTED for g in self.case.goals if g.id == RETURNS)


def strictdoc(case: SafetyCase) -> str:
    """The case as the text of a StrictDoc document."""
    return "\n".join(_document_lines(case))


def _document_lines(case: SafetyCase) -> Iterator[str]:
    yield from ("[DOCUMENT]", f"TITLE: {_one_line(case.title)}", "")
    for n in case.nodes:
        if n.kind in ("context", "assumption"):
            yield from ("[TEXT]", "STATEMENT: >>>", *_text_lines(f"{n.id} ({n.kind}): {n.text}"))
            yield from ("<<<", "")
    parents: dict[str, list[str]] = {}
    for n in case.nodes:
        for child in n.supported_by:
            parents.setdefault(child, []).append(n.id)
    for n in case.nodes:
        if n.kind not in ("context", "assumption"):
            yield from _requirement_lines(case, n, parents.get(n.id, []))


def _requirement_lines(case: SafetyCase, n: CaseNode, parents: list[str]) -> Iterator[str]:
    yield from ("[REQUIREMENT]", f"UID: {n.id}", f"STATUS: {case.status(n)}")
    yield f"TITLE: {_one_line(f'{n.kind}: {n.text}')[:120]}"
    yield from ("STATEMENT: >>>", *_text_lines(n.text), "<<<")
    texts = [n.why] if n.why else []
    texts += [f"sha256 {n.sha256} {n.path}".rstrip()] if n.sha256 else []
    texts += [f"in the context of {', '.join(n.in_context_of)}"] if n.in_context_of else []
    if texts:
        yield from ("COMMENT: >>>", *_text_lines("\n\n".join(texts)), "<<<")
    if parents:
        yield "RELATIONS:"
        for parent in parents:
            yield from ("- TYPE: Parent", f"  VALUE: {parent}")
    yield ""


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _text_lines(text: str) -> list[str]:
    """The non-empty lines of a text, or one "-"; none of them can end a field of StrictDoc."""
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    return [f" {x}" if x.startswith(("<<<", ">>>", "[")) else x for x in lines] or ["-"]
