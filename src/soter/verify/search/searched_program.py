"""The program of a module of which hints were found, in the place of one that says none, or others.

Purpose: `with_found_hints` looks for hints of modules whose states nothing bounds; `searched_anew`
of those that their own hints leave undecided.
Non-goals: the search for one module (`proof_search.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.verify.chosen_modules import (
    in_every_view,
    module_named,
    modules_of,
    problems_of,
    without_faults,
)
from soter.verify.claims.results import UNDECIDED
from soter.verify.problem.extract import extract
from soter.verify.search.proof_search import find_hints, may_be_found

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.verify.claims.results import ModuleResult
    from soter.verify.problem.problem import Problem
    from soter.verify.search.proof_search import ProofSearch, Try


def with_found_hints(
    checked: CheckResult, what: Mapping[str, Any], budget_s: float, refused: SoterError
) -> tuple[CheckResult, tuple[ProofSearch, ...]]:
    """The program with hints that were found where it bounds no states.

    `what`: the modules to verify, as arguments of `modules_of`; `refused`: R008 of some of them,
    which is raised with what was tried in vain where none of it could be asked.
    """
    searches: list[ProofSearch] = []
    for name in [m.name for _, m in modules_of(checked, **what)]:
        if not _is_refused(*module_named(checked, name, what)):
            continue
        made = _searched(checked, name, what, budget_s, own=False)
        if made is None or made.checked is None:
            tries = () if made is None else made.tries
            raise SoterError(tuple(_told_tries(d, tries) for d in refused.diagnostics))
        searches.append(made)
        checked = made.checked
    return checked, tuple(searches)


def searched_anew(
    checked: CheckResult, what: Mapping[str, Any], results: Sequence[ModuleResult], budget_s: float
) -> tuple[CheckResult, tuple[ProofSearch, ...]]:
    """The program with other hints of modules that its own leave undecided, where these prove."""
    searches = []
    for result in results:
        symbol = result.problem.module.symbol
        if result.verdict != UNDECIDED or symbol.ttf or result.problem.kind == "nodes":
            continue
        made = _searched(checked, result.name, what, budget_s, own=True)
        if made is not None:
            searches.append(made)
            checked = made.checked if made.proved and made.checked is not None else checked
    return checked, tuple(searches)


def _searched(
    checked: CheckResult, name: str, what: Mapping[str, Any], budget_s: float, *, own: bool
) -> ProofSearch | None:
    """What a search for hints of a module gave; None where hints of it are not looked for."""

    def choose(other: CheckResult) -> tuple[System, Module, Problem]:
        assert other.program is not None
        flat, m = module_named(other, name, what)
        return flat, m, without_faults(other.program, flat, extract(flat, m))

    flat, module = module_named(checked, name, what)
    if not may_be_found(checked, module):
        return None
    return find_hints(checked, choose, flat, module, budget_s, own=own)


def _is_refused(flat: System, module: Module) -> bool:
    """Whether nothing bounds a state of the module."""
    try:
        problems_of(in_every_view([(flat, module)]))
    except SoterError:
        return True
    return False


def _told_tries(refused: Diagnostic, tries: Sequence[Try]) -> Diagnostic:
    """The diagnostic that nothing bounds states, with what was tried in vain."""
    tried = tuple(f"tried in vain: `{t.hints}` ({t.gave})" for t in tries if not t.untried)
    return replace(refused, notes=(*refused.notes, *tried))
