"""The claims that rest on each part of a group, and the methods that prove whole modules.

Purpose: `RESTS`: the claims that rest on each part of a group of a manifest. `parts_without_claim`
says which parts no claim rests on, for the prover, which leaves them out, and for
`refuse_parts_without_claim`. `MODULES`: by the key in a module's entry, what checks a module as a
whole. A method is imported where a certificate uses it.
Non-goals: reading and checking a group (`grid/grid_group.py`).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.certificate.reading.folder import FREE, RETURN
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.certificate.grid.grid_group import GridGroup
    from soter.certificate.report import RecheckedModule
    from soter.certificate.scope import Covered
    from soter.language.model.system import System


RESTS = {"R": FREE, "Q": RETURN, "Q_axes": RETURN, "W": RETURN, "W_N": RETURN}
"""Name of a part of a group -> the claims that rest on it."""
OF_LEVELS = "S"
"""The part that is only there where predicates are computed, so that levels are deployed."""


class ModuleMethod(NamedTuple):
    """The two functions of a method that proves a whole module at once."""

    check: Callable[[System, dict[str, Any]], tuple[Covered, RecheckedModule]]
    """RejectedError, NotRecheckedError where the entry is not confirmed."""
    read: Callable[[System, dict[str, Any]], object]
    """Reads the entry and shows nothing; raises the same where not all of it is understood."""


def import_grid_group() -> type[GridGroup]:
    """Imports the class that reads and checks a group of states on a grid."""
    from soter.certificate.grid.grid_group import GridGroup  # noqa: PLC0415 - see the head

    return GridGroup


def _import_induction_method() -> ModuleMethod:
    """Imports the induction check. Raises NotRecheckedError if the solver is not installed."""
    if find_spec("z3") is None:
        text = "inductions are checked with `z3-solver`, which is not installed"
        raise NotRecheckedError(f"{text}: {pip_command('prove')}")
    from soter.certificate.induction import check_claims  # noqa: PLC0415 - an extra

    return ModuleMethod(check_claims.recheck_induction, check_claims.read_entry)


def import_jump_check() -> Callable[..., tuple[str, str]]:
    """Imports the function that shows by the solver in which steps a node changes a view."""
    from soter.certificate.induction import handover_jumps  # noqa: PLC0415 - see the head

    return handover_jumps.why_jumps_not_shown


def _import_rest_method() -> ModuleMethod:
    from soter.certificate.tubes import check_rest  # noqa: PLC0415 - see the head

    return ModuleMethod(check_rest.recheck_rest, check_rest.read_entry)


def _import_plans_method() -> ModuleMethod:
    from soter.certificate.tubes import check_rest  # noqa: PLC0415 - see the head

    return ModuleMethod(check_rest.recheck_plans, check_rest.read_plans)


MODULES: dict[str, Callable[[], ModuleMethod]] = {
    "induction": _import_induction_method,
    "rest": _import_rest_method,
    "plans": _import_plans_method,
}


def parts_without_claim(group: Mapping[str, Any], claims: set[str], *, computed: bool) -> list[str]:
    """The parts of a group that no claim needs; `computed`: whether predicates are computed."""
    if group.get("kind") != "grid":
        return []
    parts = [n for n in group if n in RESTS and not RESTS[n] & claims]
    return [*parts, *[OF_LEVELS] * (OF_LEVELS in group and not computed)]


def refuse_parts_without_claim(groups: Sequence[Any], claims: set[str], *, computed: bool) -> None:
    """Raises RejectedError if a group has a part that no claim needs (`parts_without_claim`)."""
    for group in groups:
        for name in parts_without_claim(group, claims, computed=computed):
            raise RejectedError(f"no claim rests on `{name}` of a group")
