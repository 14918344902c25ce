"""Which claims rest on which parts of a group in a certificate.

Purpose: one list for whoever writes a certificate and whoever reads it: a part on which nothing
that is claimed rests does not stand there, and K is empty where nothing is claimed of it.
Non-goals: what a part has to show for a claim (`grid/`, `polytope/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.format.errors import RejectedError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

FREE = frozenset({"P3", "ttf", "safer"})
RETURN = frozenset({"P2b"})
OF_SETS = FREE | RETURN | {"P2a", "start"}
"""Claims that rest on K."""
OF_GRIDS = {"R": FREE, "Q": RETURN, "W": RETURN, "W_N": RETURN}
OF_POLYTOPES = {"Q": RETURN, "target": RETURN}
OF_MULTIPLIERS = {"K": OF_SETS, "R": FREE, "Q": RETURN, "S": FREE}


def unclaimed(group: Mapping[str, Any], claims: set[str], *, computed: bool) -> list[str]:
    """The parts of a group on which none of these claims rests.

    `computed`: whether predicates are, so that levels S are deployed.
    """
    rests = OF_GRIDS if group.get("kind") == "grid" else OF_POLYTOPES
    names = [name for name, of in rests.items() if name in group and not of & claims]
    if group.get("kind") == "grid" and "S" in group and not computed:
        names.append("S")
    return names


def unclaimed_multipliers(
    group: Mapping[str, Any], claims: set[str], *, computed: bool
) -> list[str]:
    """The same of the multipliers of a group of half-spaces."""
    needed = {name for name, of in OF_MULTIPLIERS.items() if of & claims}
    if not computed:
        needed.discard("S")
    return [name for name in group.get("multipliers", {}) if name not in needed]


def refuse_unclaimed(groups: Sequence[Any], claims: set[str], *, computed: bool) -> None:
    """`RejectedError` for a part of a group of a manifest on which none of these claims rests."""
    for group in groups:
        names = unclaimed(group, claims, computed=computed)
        for name in (*names, *unclaimed_multipliers(group, claims, computed=computed)):
            raise RejectedError(f"no claim rests on `{name}` of a group")


def refuse_cells(cores: Sequence[NDArray[Any]], claims: set[str], recover_ns: object) -> None:
    """`RejectedError` for cells of K of which nothing is claimed, or a time to return."""
    if not claims & OF_SETS and any(core.any() for core in cores):
        raise RejectedError("K holds cells, and nothing is claimed of them")
    if not claims & RETURN and recover_ns is not None:
        raise RejectedError("no claim rests on the time to return")
