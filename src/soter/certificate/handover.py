"""Hand-overs: whether the state of a view jumps only into R(H).

Purpose: `jumps_of`: for every topic that the map of a view reads, whether what `enters` says of it
is confirmed: of the node that publishes it, and of R(H) (docs/proof.md, "Hand-over").
Non-goals: rejecting: what is not confirmed is an assumption, and the report says why.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from soter.certificate.assumptions import Jump
from soter.certificate.inclusions.handover_claim import not_entered
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.view_predicates import entered
from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.module_times import read_by
from soter.language.model.tree_walk import topic_reads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.inclusions.group_claims import GroupTables
    from soter.certificate.polytope.certificate_tables import PolytopeTables
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model import typed

    Groups = Sequence[tuple[Sequence[GroupTables], Sequence[PolytopeTables]]]

FREE = {"P3", "ttf", "safer"}
"""Claims with which R(H) is shown to be what it says."""


def jumps_of(
    facts: Facts,
    groups: Groups,
    extents: tuple[tuple[float, float], ...],
    claims: set[str],
) -> dict[str, list[Jump]]:
    """By the name of what abstracts; `groups`: of every case, when their claims were confirmed.

    Nothing where a module has no views, or no `enters`.
    """
    if not facts.view or facts.whole is None or facts.whole.verify.enters is None:
        return {}
    jumps_by_link = {
        link.name: [_published(facts, link, topic) for topic in topic_reads(link.value)]
        for link in facts.symbol.verify.abstracts
    }
    if any(not jump.why for of in jumps_by_link.values() for jump in of):
        why = _of_sets(facts, groups, extents, claims)
        jumps_by_link = {
            name: [Jump(j.topic, j.node, j.why or why) for j in of]
            for name, of in jumps_by_link.items()
        }
    return jumps_by_link


def _published(facts: Facts, link: typed.AbstractionLink, topic: typed.TopicSymbol) -> Jump:
    """The node part of one topic."""
    if find_spec("z3") is None:
        return Jump(topic.name, "", "`z3-solver` is not installed")
    from soter.certificate.induction.handover_jumps import why_not  # noqa: PLC0415 - an extra

    try:
        node, why = why_not(facts, link, topic)
    except Exception as error:  # noqa: BLE001 - whatever it is, nothing is confirmed
        return Jump(topic.name, "", _said(error))
    return Jump(topic.name, node, why)


def _of_sets(
    facts: Facts, groups: Groups, extents: tuple[tuple[float, float], ...], claims: set[str]
) -> str:
    """Why it is not confirmed that the state lies in R(H) wherever `enters` holds."""
    if not claims & FREE:
        return "nothing is claimed with which R(H) is confirmed"
    if any(polytopes for _, polytopes in groups):
        return "half-spaces are not looked at"
    try:
        assert facts.whole is not None
        expr = entered(facts.whole, facts.symbol.verify)
        assert expr is not None
        scope = facts.module.scope.topics
        known = {i for of in read_by(facts) for i in of}
        if not {scope.get(t, -1) for t in topic_reads(expr)} <= known:
            return "it reads what neither DM nor SC reads"
        for values, (grids, _) in zip(facts.cases(), groups, strict=True):
            why = not_entered(CaseModel(facts, values, extents), grids, expr)
            if why:
                return why
    except Exception as error:  # noqa: BLE001 - whatever it is, nothing is confirmed
        return _said(error)
    return ""


def _said(error: Exception) -> str:
    if isinstance(error, NotRecheckedError):
        return f"not rechecked: {error}"
    return f"the re-checker itself failed ({type(error).__name__}: {error})"
