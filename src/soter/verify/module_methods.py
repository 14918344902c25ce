"""How modules are proved, in one table: over sets of states, or by induction over nodes.

Purpose: for each kind of problem the verdicts, the entry in a certificate, and what of a proof the
world that a system is deployed in has to give.
Non-goals: the proofs; how groups of states are proved (`proof_methods.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.verify.deploy import deployed_sensors
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.induction import verify as induction
from soter.verify.induction.verify import verify_by_induction
from soter.verify.sets_certificate_entry import entry_over_sets
from soter.verify.tubes.verify import entry as tubes_entry
from soter.verify.tubes.verify import verify_by_tubes
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import System
    from soter.verify.claims.results import ModuleResult
    from soter.verify.problem.problem import Problem, ProblemKind


@dataclass(frozen=True)
class ModuleMethod:
    """What a method does with problems of its kind, and with its own results."""

    verify: Callable[..., ModuleResult]
    """(problem, refute=, explain=, search=, compiled=) -> verdicts of all properties."""
    entry: Callable[[Any, str, str, dict[str, bytes]], dict[str, object]]
    """(result, system, stem of its files, files) -> the module in a manifest."""
    covers: Callable[[System, System, Any, Diagnostics], tuple[list[str], list[str]]]
    """(deployed system, proved one, problem, diagnostics) -> what is covered, and assumed."""
    compiled: Callable[[Problem], object] | None = None
    """What `verify` needs as `compiled`, and makes itself where it is None."""


SETS = ModuleMethod(verify_module, entry_over_sets, deployed_sensors.covers, library_of)
METHODS: dict[ProblemKind, ModuleMethod] = {
    "flow": SETS,
    "map": SETS,
    "nodes": ModuleMethod(verify_by_induction, induction.entry, induction.covers),
    "tubes": ModuleMethod(verify_by_tubes, tubes_entry, deployed_sensors.covers),
}


def module_method(problem: Problem) -> ModuleMethod:
    """The method that proves the module of a problem."""
    return METHODS[problem.kind]
