"""The tables that a DM with computed predicates holds, derived once more.

Purpose: from the sets S of all cases the bytes that the DM reads (docs/verification.md, section 3),
compared with those that the certificate says are deployed.
Non-goals: the sets themselves, which are shown elsewhere (`case.py`); the code that reads a table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.format.errors import RejectedError
from soter.certificate.inclusions.shield import cells_of, tops_of
from soter.certificate.terms.terms import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.certificate.format.folder import Certificate
    from soter.certificate.inclusions.group_claims import GroupTables
    from soter.certificate.reading.problem import Facts

BITS = 2
"""A level: 0: ttf, 1: an estimate in S_0, 2: in S_(m-2); in every case."""
FULL = 2
CELLS_IN_A_BYTE = 4


def compare_tables(
    certificate: Certificate,
    facts: Facts,
    cases: Sequence[Sequence[GroupTables]],
    entries: Sequence[dict[str, Any]],
) -> None:
    """`RejectedError` where a DM would let AC keep or get control otherwise than by the sets."""
    first = cases[0]
    if len(entries) != len(first):
        raise RejectedError("the tables of the DM are not one for each group")
    for k, (group, entry) in enumerate(zip(first, entries, strict=True)):
        shield = {"command", "commands"} if facts.symbol.shield is not None else set()
        if entry.keys() != {"axes", "levels", *shield}:
            raise RejectedError("a table of the DM is not as it should be")
        same = [case[k] for case in cases]
        if any(g.states != group.states or g.grid.edges != group.grid.edges for g in same):
            raise RejectedError("the cases have other grids, and the DM has one table for all")
        names = [facts.states[i].name for i in group.states]
        looked_at = _looked_at(facts, group)
        if [a["state"] for a in entry["axes"]] != [names[k] for k in looked_at]:
            raise RejectedError("a table of the DM has other axes than its group")
        for axis, place in zip(entry["axes"], looked_at, strict=True):
            edges = group.grid.edges[place]
            if axis.keys() != {"state", "edges"} or certificate.edges(axis["edges"]) != edges:
                raise RejectedError(f"the DM cuts {axis['state']} elsewhere than its group")
        total = levels_of(same)
        if certificate.plain(entry["levels"]) != packed(total):
            raise RejectedError(f"the table of the DM over {', '.join(names)} is not that of S")
        for g in same:
            g.given_back = total == FULL
            if shield:
                _shield(certificate, facts, g, entry)


def _shield(
    certificate: Certificate, facts: Facts, group: GroupTables, entry: dict[str, Any]
) -> None:
    """What the DM holds of commands."""
    names = [c.name for c in facts.controls]
    if entry["command"] is not None and entry["command"] not in names:
        raise RejectedError("a table of the DM is about a command that there is not")
    group.command = None if entry["command"] is None else names.index(entry["command"])
    group.tops = tops_of(certificate.plain(entry["commands"]), group, cells_of(facts))


def _looked_at(facts: Facts, group: GroupTables) -> list[int]:
    """The axes of a group that the DM can see.

    A state that no topic of the DM shows may be anywhere on its axis (`predicates.around`),
    whatever the estimate of the others: NotRecheckedError where its axis has several cells.
    """
    axes = []
    for k, (state, cells) in enumerate(zip(group.states, group.grid.shape, strict=True)):
        if state in facts.leaves:
            axes.append(k)
        elif cells != 1:
            name = facts.states[state].name
            raise NotRecheckedError(f"no topic shows `{name}` to the DM, and its axis has cells")
    return axes


def levels_of(cases: Sequence[GroupTables]) -> NDArray[np.uint8]:
    """The level of each cell of one group, in the grid's shape: the least of all cases.

    RejectedError where a case has no tables S.
    """
    total = np.full(cases[0].grid.shape, FULL, dtype=np.uint8)
    for group in cases:
        if not group.levels:
            raise RejectedError("the tables S are not there")
        outer, inner = group.levels[0], group.levels[-1]
        total = np.minimum(total, np.where(outer, np.where(inner, FULL, 1), 0).astype(np.uint8))
    return total


def packed(levels: NDArray[np.uint8]) -> bytes:
    """Two bits a cell, the first cell in the lowest. `levels`: in the grid's shape."""
    cells = levels.reshape(-1).tolist()
    data = bytearray(-(-len(cells) // CELLS_IN_A_BYTE))
    for k, level in enumerate(cells):
        data[k // CELLS_IN_A_BYTE] |= level << (BITS * (k % CELLS_IN_A_BYTE))
    return bytes(data)
