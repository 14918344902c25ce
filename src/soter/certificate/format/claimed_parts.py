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
RESTS: dict[str, dict[str, frozenset[str]]] = {
    "grid": {"R": FREE, "Q": RETURN, "Q_axes": RETURN, "W": RETURN, "W_N": RETURN},
    "polytope": {
        "Q": RETURN,
        "target": RETURN,
        "multipliers.K": OF_SETS,
        "multipliers.R": FREE,
        "multipliers.Q": RETURN,
        "multipliers.S": FREE,
        "instants.hold": OF_SETS,
        "instants.R": FREE,
        "instants.window": FREE,
        "instants.start": frozenset({"start"}),
        "rates.K": OF_SETS,
        "rates.Q": RETURN,
    },
}
"""By the kind of a group and the name of a part: the claims that rest on it."""
NESTED = ("multipliers", "instants", "rates")
"""What is made of parts, on each of which some claim rests."""
OF_LEVELS = {"grid": ("S",), "polytope": ("multipliers.S", "instants.window")}
"""What is there where predicates are computed alone, so that levels S are deployed."""


def unclaimed(group: Mapping[str, Any], claims: set[str], *, computed: bool) -> list[str]:
    """The parts of a group on which none of these claims rests; `computed`: predicates are."""
    kind = str(group.get("kind"))
    rests, levels = RESTS.get(kind, {}), () if computed else OF_LEVELS.get(kind, ())
    parts = [*group, *(f"{whole}.{name}" for whole in NESTED for name in group.get(whole, {}))]
    known = [name for name in parts if name in rests or "." in name or name in levels]
    return [n for n in known if n in levels or not rests.get(n, frozenset()) & claims]


def refuse_unclaimed(groups: Sequence[Any], claims: set[str], *, computed: bool) -> None:
    """`RejectedError` for a part of a group of a manifest on which none of these claims rests."""
    for group in groups:
        for name in unclaimed(group, claims, computed=computed):
            raise RejectedError(f"no claim rests on `{name}` of a group")


def refuse_cells(cores: Sequence[NDArray[Any]], claims: set[str], recover_ns: object) -> None:
    """`RejectedError` for cells of K of which nothing is claimed, or a time to return.

    `cores`: K, one a group, of any shape.
    """
    if not claims & OF_SETS and any(core.any() for core in cores):
        raise RejectedError("K holds cells, and nothing is claimed of them")
    if not claims & RETURN and recover_ns is not None:
        raise RejectedError("no claim rests on the time to return")


def only_keys(entry: object, names: str, what: str, optional: str = "") -> None:
    """`RejectedError` unless an entry has these keys, some of the optional ones, and no other."""
    if not isinstance(entry, dict):
        raise RejectedError(f"{what} is not as it should be")
    allowed = {*names.split(), *(name for name in optional.split() if name in entry)}
    for name in sorted(entry.keys() ^ allowed):
        raise RejectedError(f"{what} has {'no' if name in allowed else 'an unknown'} `{name}`")
