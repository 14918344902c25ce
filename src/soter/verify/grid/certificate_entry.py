"""A grid in a certificate.

Purpose: the sets of a group as tables, one entry a cell.
Non-goals: checking them (`soter recheck`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.verify.claims.certificate_entries import axes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from soter.verify.claims.results import GroupSets
    from soter.verify.problem.problem import Problem


def entry(
    problem: Problem, group: GroupSets, stem: str, files: dict[str, bytes]
) -> dict[str, object]:
    """Witnesses as bytes, sets as bits, ranks as pairs of bytes."""
    group_entry = axes(problem, group.group, stem, files)
    rank, holds = group.rank, group.rank_holds
    if rank is not None and holds is not None and group.home is not None:
        rank = np.where(group.home > 0, 1, rank)
        holds = np.where(rank > 1, holds, 0)
    tables = {
        "K": _whole(group.core, "<u1"),
        "R": _bits(group.free),
        "Q": _whole(group.home, "<u1"),
        "W": _whole(rank, "<u2"),
        "W_N": _whole(holds, "<u1"),
    }
    if group.finer is not None:
        own = axes(problem, group.finer[1], f"{stem}_Q", files)
        group_entry["Q_axes"] = [axis["edges"] for axis in own["axes"]]
    for key, data in tables.items():
        if data is not None:
            files[f"{stem}_{key}.bin"] = data
            group_entry[key] = f"{stem}_{key}.bin"
    if group.levels:
        group_entry["S"] = []
    for k, level in enumerate(group.levels):
        name = f"{stem}_S{k}.bin"
        files[name] = _bits(level) or b""
        group_entry["S"].append(name)
    return group_entry


def _whole(table: NDArray[Any] | None, kind: str) -> bytes | None:
    return None if table is None else np.ascontiguousarray(table).astype(kind).tobytes()


def _bits(table: NDArray[Any] | None) -> bytes | None:
    if table is None:
        return None
    return np.packbits(np.ascontiguousarray(table).reshape(-1), bitorder="little").tobytes()
