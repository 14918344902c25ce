"""The sets of a module as its certificate has them, for the tables of its decision module.

Purpose: S_0 and S_(m-2) of every group and case, read in place of being computed once more.
Non-goals: whether they are right: whoever asks has had the certificate checked (`soter.recheck`),
and `ttf` and `safer` of the module confirmed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.format.errors import RejectedError
from soter.verify.problem.extract import cases
from soter.verify.proof_methods import in_order, method_of

if TYPE_CHECKING:
    from soter.certificate.format.folder import Certificate
    from soter.verify.problem.problem import Group, Problem
    from soter.verify.proof_methods import Pairs


def certified_sets(
    certificate: Certificate, system: str, module: str, problem: Problem
) -> list[Pairs] | None:
    """The pairs of every case of a module of a system, both as the certificate calls them.

    None where it does not have them of just this problem's cases, groups and grids.
    """
    entries = [
        e
        for e in certificate.manifest["modules"]
        if (e.get("system"), e.get("module")) == (system, module) and "view" not in e
    ]
    if len(entries) != 1 or problem.module.shield is not None:
        return None  # what a shield permits for longer stands in no certificate
    given, every = entries[0].get("cases", []), list(cases(problem))
    if [tuple(c["parameter"]) for c in given] != every:
        return None
    groups = in_order(problem.groups)
    case_pairs = []
    for case in given:
        if len(case["groups"]) != len(groups):
            return None
        both = zip(groups, case["groups"], strict=True)
        pairs = [_pair(certificate, problem, group, entry) for group, entry in both]
        if any(pair is None for pair in pairs):
            return None
        case_pairs.append(pairs)
    return case_pairs


def _pair(
    certificate: Certificate, problem: Problem, group: Group, entry: dict[str, Any]
) -> object | None:
    """(S_0, S_(m-2)) of a group; None where its entry is one of another group, or has none."""
    names = [problem.quantities.states[a.state].name for a in group.axes]
    if entry["kind"] != group.representation or [a["state"] for a in entry["axes"]] != names:
        return None
    try:
        edges = [certificate.edges(a["edges"]) for a in entry["axes"]]
        if edges != [tuple(a.edges) for a in group.axes]:
            return None
        return method_of(group).certified(certificate, group, entry)
    except (RejectedError, ValueError):
        return None
