"""What each module of a program poses to its proof, as a text, and which declarations stand in it.

Purpose: `posed_problems` gives a text for each module of each system; where two programs have the
same one, the proof of the one is a proof of the other, but for its certificate's hash. `soter diff`
compares them.
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
    """A text that is equal where the problem is; the full names of declarations that are in it."""

    text: str
    names: frozenset[str]


def posed_problems(
    checked: CheckResult, params: Mapping[str, Value]
) -> dict[tuple[str, str], PosedProblem]:
    """The problem of each module, by system and module, as a text.

    A module that is forced, inherits its proof, or poses no problem is left out.
    """
    posed: dict[tuple[str, str], PosedProblem] = {}
    for name in checked.systems or [""]:
        if name and checked.systems[name].deploys is not None:
            continue
        flat = system_to_prove(checked, name, params, exact=False)
        posed |= {(flat.name, m): problem for m, problem in posed_in(flat).items()}
    return posed


def posed_in(flat: System) -> dict[str, PosedProblem]:
    """The problem of each module of a flat system, as a text; forced modules are left out."""
    posed = {m.name: _posed_problem(flat, m) for m in flat.modules if m.forced is None}
    return {name: problem for name, problem in posed.items() if problem is not None}


def step_text(flat: System, component: Component) -> PosedProblem:
    """The text of a node's step: its code, the functions that it calls, and its numbers."""
    return text_with_names(component_key(flat, component))


def text_with_names(
    of: object, untrusted: frozenset[typed.NodeSymbol] = frozenset()
) -> PosedProblem:
    """The text of any part of a program, and the names of the declarations in it.

    `untrusted`: nodes whose code is left out, as no proof reads it; if there are any, contracts are
    left out, too, which are judged in runs and tests, and so is how long simulated disturbances are
    held.
    """
    names: set[str] = set()

    def instead(part: object) -> object:
        if isinstance(part, (typed.Symbol, typed.Literal)) and part.name is not None:
            names.add(part.name)
        if isinstance(part, typed.NodeSymbol) and part in untrusted:
            return part.node_that_does(())
        if isinstance(part, typed.ModuleSymbol) and untrusted:
            return replace(part, contract=())
        if isinstance(part, typed.DisturbanceSymbol) and untrusted:
            return replace(part, hold=None)
        return part

    return PosedProblem(canonical_text(of, instead), frozenset(names))


def _posed_problem(flat: System, module: Module) -> PosedProblem | None:
    """The problem of a module as a text; None where no problem can be made of it."""
    verify = module.symbol.verify
    around = flying_key(flat, module) if verify.abstracts or verify.views else ()
    try:
        keys = [problem_key(extract(*seen)) for seen in systems_by_view(flat, module)]
    except SoterError:
        return None
    untrusted = frozenset(m.symbol.ac for m in flat.modules)
    return text_with_names((keys, module.symbol, around), untrusted)
