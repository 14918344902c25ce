"""The methods of proof, in two tables: of groups of states, and of whole modules.

Purpose: `GROUPS`: by its kind, the `Group` that reads a group of a manifest, in the order in which
groups are asked. `MODULES`: by the key in a module's entry, what checks a module as a whole.
Non-goals: what a method is asked (`groups.py`).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.certificate.grid.grid_group import GridGroup
from soter.certificate.polytope.polytope_group import PolytopeGroup
from soter.certificate.tubes.check_rest import read_all, recheck_rest
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.version import pip_install

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from soter.certificate.groups import Group
    from soter.certificate.report import RecheckedModule
    from soter.certificate.scope import Covered
    from soter.language.model.system import System


class ModuleMethod(NamedTuple):
    """The functions that check the entry of a module that is proved as a whole."""

    check: Callable[[System, dict[str, Any]], tuple[Covered, RecheckedModule]]
    """RejectedError, NotRecheckedError where the entry is not confirmed."""
    read: Callable[[System, dict[str, Any]], object]
    """Reads the entry and shows nothing; raises the same where not all of it is understood."""


def _inductions() -> ModuleType:
    """The file that checks inductions; SoterError D007 where the solver is not installed."""
    if find_spec("z3") is None:
        what = "inductions are checked with `z3-solver`, which is not installed"
        helps = (f"install it: {pip_install('prove')}",)
        raise SoterError((Diagnostic("D007", what, helps=helps),))
    from soter.certificate.induction import check_claims  # noqa: PLC0415 - an extra

    return check_claims


GROUPS: dict[str, type[Group]] = {g.kind: g for g in (GridGroup, PolytopeGroup)}
MODULES = {
    "induction": ModuleMethod(
        lambda flat, entry: _inductions().recheck_induction(flat, entry),
        lambda flat, entry: _inductions().read_all(flat, entry),
    ),
    "rest": ModuleMethod(recheck_rest, read_all),
}
