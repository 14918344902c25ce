"""The methods of proof, in two tables: of groups of states, and of whole modules.

Purpose: which `Group` reads an entry of which kind, in the order in which groups are asked; and
what checks a module that is proved without sets of states, by what stands in its entry for it.
Non-goals: what a method is asked (`groups.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.grid.grid_group import GridGroup
from soter.certificate.induction.check_claims import recheck_induction
from soter.certificate.polytope.polytope_group import PolytopeGroup

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.certificate.groups import Group
    from soter.certificate.report import RecheckedModule
    from soter.certificate.scope import Covered
    from soter.language.model.system import System

GROUPS: dict[str, type[Group]] = {g.kind: g for g in (GridGroup, PolytopeGroup)}
MODULES: dict[str, Callable[[System, dict[str, Any]], tuple[Covered, RecheckedModule]]] = {
    "induction": recheck_induction
}
"""RejectedError, NotRecheckedError where the entry of a module is not confirmed."""
