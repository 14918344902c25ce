"""Writes the problem that each module of a program poses to its proof as a text.

Purpose: `posed_problems` gives a text for each module of each system. Where two programs have the
same text, a proof for the one also holds for the other (only its certificate has another hash).
`soter diff` compares them.
Non-goals: what the text is made of (`problem_key` of `scope.py`), proofs, how long they take.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import system_to_prove
from soter.language.model import typed
from soter.language.model.canonical_text import canonical_text
from soter.verify.problem.extract import extract
from soter.verify.scope import component_key, flying_key, problem_key

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Value


@dataclass(frozen=True)
class PosedProblem:
    """A problem as a text, equal for equal problems, and the full names of declarations in it."""

    text: str
    names: frozenset[str]


def posed_problems(
    checked: CheckResult, params: Mapping[str, Value]
) -> dict[tuple[str, str], PosedProblem]:
    """The problem of each module as a text, by the names of the system and the module.

    The result leaves out a module that is forced, inherits its proof, or poses no problem.
    """
    posed: dict[tuple[str, str], PosedProblem] = {}
    for name in checked.systems or [""]:
        if name and checked.systems[name].deploys is not None:
            continue
        flat = system_to_prove(checked, name, params, exact=False)
        posed |= {(flat.name, m): problem for m, problem in posed_problems_in(flat).items()}
    return posed


def posed_problems_in(flat: System) -> dict[str, PosedProblem]:
    """The problem of each module of a flat system as a text, except forced modules."""
    posed = {m.name: _posed_problem(flat, m) for m in flat.modules if m.forced is None}
    return {name: problem for name, problem in posed.items() if problem is not None}


def step_text(flat: System, component: Component) -> PosedProblem:
    """The text of a node's step, with its code, the functions that it calls, and its numbers."""
    return text_with_names(component_key(flat, component))


def text_with_names(
    of: object, untrusted: frozenset[typed.NodeSymbol] = frozenset()
) -> PosedProblem:
    """The text of any part of a program, and the names of the declarations in it.

    `untrusted`: nodes whose code is left out, as no proof reads it. If there are any, contracts,
    which only runs and tests judge, and the hold times of simulated disturbances are left out, too.
    """
    names: set[str] = set()

    def counted_part(part: object) -> object:
        if isinstance(part, (typed.Symbol, typed.Literal)) and part.name is not None:
            names.add(part.name)
        if isinstance(part, typed.NodeSymbol) and part in untrusted:
            return part.node_with_step(())
        if isinstance(part, typed.ModuleSymbol) and untrusted:
            return replace(part, contract=())
        if isinstance(part, typed.DisturbanceSymbol) and untrusted:
            return replace(part, hold=None)
        return part

    return PosedProblem(canonical_text(of, counted_part), frozenset(names))


def _posed_problem(flat: System, module: Module) -> PosedProblem | None:
    """The problem of a module as a text; None if no problem can be made of the module."""
    verify = module.symbol.verify
    flying = flying_key(flat, module) if verify.abstracts or verify.views else ()
    try:
        keys = [problem_key(extract(*seen)) for seen in systems_by_view(flat, module)]
    except SoterError:
        return None
    untrusted = frozenset(m.symbol.ac for m in flat.modules)
    return text_with_names((keys, module.symbol, flying), untrusted)
