"""The methods of proof, in two tables: of groups of states, and of whole modules.

Purpose: `GROUPS`: by its kind, how a group of a manifest is read, in the order in which groups are
asked, and the claims that its parts rest on. `unclaimed` says which parts no claim rests on, for
the prover, which leaves them out, and for `refuse_unclaimed`. `MODULES`: by the key in a module's
entry, what checks a module as a whole. A method is imported where a certificate uses it.
Non-goals: what a method is asked (`groups.py`).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.certificate.folder import FREE, OF_SETS, RETURN
from soter.certificate.report import RejectedError
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.version import pip_install

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.certificate.groups import Group
    from soter.certificate.report import RecheckedModule
    from soter.certificate.scope import Covered
    from soter.language.model.system import System


class GroupMethod(NamedTuple):
    """A method that proves groups of states: what reads a group, and what claims rest on."""

    group: Callable[[], type[Group]]
    """Imports what reads and checks a group."""
    rests: Mapping[str, frozenset[str]]
    """Name of a part of a group -> the claims that rest on it; `whole.part` for one of an entry
    that is made of parts."""
    of_levels: tuple[str, ...]
    """Parts that are only there where predicates are computed, so that levels S are deployed."""


class ModuleMethod(NamedTuple):
    """The functions that check the entry of a module that is proved as a whole."""

    check: Callable[[System, dict[str, Any]], tuple[Covered, RecheckedModule]]
    """RejectedError, NotRecheckedError where the entry is not confirmed."""
    read: Callable[[System, dict[str, Any]], object]
    """Reads the entry and shows nothing; raises the same where not all of it is understood."""


def _cells() -> type[Group]:
    from soter.certificate.grid.grid_group import GridGroup  # noqa: PLC0415 - see the head

    return GridGroup


def _half_spaces() -> type[Group]:
    from soter.certificate.polytope.polytope_group import PolytopeGroup  # noqa: PLC0415 - the same

    return PolytopeGroup


def _inductions() -> ModuleMethod:
    """What checks inductions; SoterError D007 where the solver is not installed."""
    if find_spec("z3") is None:
        what = "inductions are checked with `z3-solver`, which is not installed"
        helps = (f"install it: {pip_install('prove')}",)
        raise SoterError((Diagnostic("D007", what, helps=helps),))
    from soter.certificate.induction import check_claims  # noqa: PLC0415 - an extra

    return ModuleMethod(check_claims.recheck_induction, check_claims.read_entry)


def _rest() -> ModuleMethod:
    from soter.certificate.tubes import check_rest  # noqa: PLC0415 - see the head

    return ModuleMethod(check_rest.recheck_rest, check_rest.read_entry)


GROUPS = {
    "grid": GroupMethod(
        _cells, {"R": FREE, "Q": RETURN, "Q_axes": RETURN, "W": RETURN, "W_N": RETURN}, ("S",)
    ),
    "polytope": GroupMethod(
        _half_spaces,
        {
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
        ("multipliers.S", "instants.window"),
    ),
}
MODULES: dict[str, Callable[[], ModuleMethod]] = {"induction": _inductions, "rest": _rest}
NESTED = dict.fromkeys(n.partition(".")[0] for m in GROUPS.values() for n in m.rests if "." in n)
"""Entries of a group that are made of parts; claims rest on each part by itself."""


def unclaimed(group: Mapping[str, Any], claims: set[str], *, computed: bool) -> list[str]:
    """The parts of a group on which none of these claims rests; `computed`: predicates are."""
    method = GROUPS.get(str(group.get("kind")))
    rests = {} if method is None else method.rests
    levels = () if method is None or computed else method.of_levels
    parts = [*group, *(f"{whole}.{name}" for whole in NESTED for name in group.get(whole, {}))]
    known = [name for name in parts if name in rests or "." in name or name in levels]
    return [n for n in known if n in levels or not rests.get(n, frozenset()) & claims]


def refuse_unclaimed(groups: Sequence[Any], claims: set[str], *, computed: bool) -> None:
    """`RejectedError` for a part of a group of a manifest on which none of these claims rests."""
    for group in groups:
        for name in unclaimed(group, claims, computed=computed):
            raise RejectedError(f"no claim rests on `{name}` of a group")
