"""The sets of a module as its certificate has them, for the tables of its decision module.

Purpose: S_0 and S_(m-2) of every group and case, read in place of being computed once more; and
whether the tables that are built are those of the certificate, whoever computed them.
Non-goals: whether they are right: whoever asks has had the certificate checked (`soter.recheck`),
and `ttf` and `safer` of the module confirmed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.format.errors import RejectedError
from soter.verify.problem.extract import cases
from soter.verify.proof_methods import in_order, method_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.certificate.format.folder import Certificate
    from soter.verify.problem.problem import Group, Problem
    from soter.verify.proof_methods import Pairs
    from soter.verify.tables.level_table import LevelTable


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
    if len(entries) != 1 or problem.module.shield is not None or "levels" in entries[0]:
        return None  # what a shield permits for longer, and whether others would do, is not there
    if not _wraps_alike(entries[0], problem):
        return None
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


def same_tables(
    certificate: Certificate,
    system: str,
    module: str,
    problem: Problem,
    built: Sequence[LevelTable],
) -> bool:
    """Whether a module's DM is given just the tables that a certificate has of it, in every byte.

    A certificate that has none says nothing of them.
    """
    entries = [
        e
        for e in certificate.manifest["modules"]
        if (e.get("system"), e.get("module"), e.get("view", "")) == (system, module, problem.view)
    ]
    q, files = problem.quantities, dict[str, bytes]()
    names = [s.name for s in q.states]
    own = [table.entry(names, f"sets/{k}", files) for k, table in enumerate(built)]
    told = _read(own, {**files, **_numbered([*names, *(c.name for c in q.controls)])})
    return all(
        not e.get("tables") or (_told(certificate, e) == told and _wraps_alike(e, problem))
        for e in entries
    )


def _wraps_alike(entry: Mapping[str, Any], problem: Problem) -> bool:
    """Whether the same axes wrap around, by the places of their states."""
    names = [i["name"] for i in entry["inputs"] if i["kind"] == "state"]
    wraps = entry.get("wraps", ())
    return {k for k, name in enumerate(names) if name in wraps} == problem.quantities.turning


def _told(certificate: Certificate, entry: dict[str, Any]) -> Any:  # noqa: ANN401 - see `_read`
    """The tables of a module in a certificate."""
    inputs = [i["name"] for i in entry["inputs"] if i["kind"] in ("state", "control")]
    return _read(entry["tables"], {**certificate.contents, **_numbered(inputs)})


def _numbered(names: Sequence[str]) -> dict[str, object]:
    """States and controls by their places: a file that is imported calls them otherwise."""
    return {name: place for place, name in enumerate(names)}


def _read(entry: Any, said: Mapping[str, object]) -> Any:  # noqa: ANN401 - a part of a manifest
    """An entry with what its names stand for: bytes of files, places of states."""
    if isinstance(entry, dict):
        return {name: _read(part, said) for name, part in entry.items()}
    if isinstance(entry, list):
        return [_read(part, said) for part in entry]
    return said.get(entry, entry) if isinstance(entry, str) else entry


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
