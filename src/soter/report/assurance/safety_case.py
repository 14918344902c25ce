"""A safety case as plain data, in the words of the Goal Structuring Notation.

Purpose: `SafetyCase`: nodes by their id; which goals are supported, from the leaves up.
Non-goals: checking a leaf (`api/assurance/evidence.py`); pages (`page.py`, `strictdoc.py`).
Source: GSN Community Standard, version 3: goals, strategies, solutions, contexts, assumptions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from soter.report.assurance.traceability import Traceability

if TYPE_CHECKING:
    from soter.report.assurance.expanded_predicate import ExpandedPredicate

Kind = Literal["goal", "strategy", "solution", "context", "assumption"]
SUPPORTED, UNDEVELOPED = "supported", "undeveloped"


@dataclass
class CaseNode:
    """One element. `supported_by`, `in_context_of`: ids of others.

    A solution is `checked` where it was checked while the case was made, and then holds what its
    goal needs; `why` says what is missing otherwise. `sha256`: of what it points to. `property`: of
    a goal, the name by which a hazard traces to it. `key`: of an assumption, the same for the same
    thing in every case; who owns it, how it is validated and where that is seen, as people say it.
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
    owner: str = ""
    validation: str = ""
    evidence: str = ""


@dataclass
class SafetyCase:
    """Nodes in the order in which they are read; the first is the top goal.

    `provenance`: with what it was made, by what people call it.
    """

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
    """Of each plant of the system: its equations as the program writes them, by its instances."""
    refuted: list[str] = field(default_factory=list)
    """What was found to be false while the case was made, as a certificate that is rejected."""

    def add(
        self, node: CaseNode, *, under: CaseNode | None = None, beside: CaseNode | None = None
    ) -> CaseNode:
        """Take in a node that supports `under`, or is in the context of `beside`."""
        assert all(n.id != node.id for n in self.nodes), node.id
        self.nodes.append(node)
        if under is not None:
            under.supported_by.append(node.id)
        if beside is not None:
            beside.in_context_of.append(node.id)
        return node

    def node(self, id_: str) -> CaseNode:
        """A node by its id; KeyError where there is none."""
        for n in self.nodes:
            if n.id == id_:
                return n
        raise KeyError(id_)

    def status(self, node: CaseNode) -> str:
        """Supported: every solution below was checked now, and every branch ends in one."""
        if node.kind == "solution":
            return SUPPORTED if node.checked else UNDEVELOPED
        below = [self.status(self.node(i)) for i in node.supported_by]
        return SUPPORTED if below and set(below) == {SUPPORTED} else UNDEVELOPED

    @property
    def supported(self) -> bool:
        """Whether the top goal is."""
        return self.status(self.nodes[0]) == SUPPORTED

    @property
    def goals(self) -> list[CaseNode]:
        """All goals, as they are read."""
        return [n for n in self.nodes if n.kind == "goal"]

    def to_json(self, version: str) -> dict[str, object]:
        """The machine-readable case (docs/json.md)."""
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
            "nodes": [self._node(n) for n in self.nodes],
            "provenance": self.provenance,
            "predicates": [p.to_json() for p in self.predicates],
            "traceability": self.traceability.to_json(),
        }

    def _node(self, n: CaseNode) -> dict[str, object]:
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
            "owner": n.owner,
            "validation": n.validation,
            "evidence": n.evidence,
        }
