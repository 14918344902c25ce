"""The program with hints that were found, in the place of a program without them, or with others.

Purpose: `with_found_hints` searches hints for modules whose states nothing bounds;
`with_better_hints` for modules that their hints leave undecided; `searches_for_rest` searches only
clauses `rest`.
Non-goals: the search for one module (`proof_search.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.verify.chosen_modules import (
    module_named,
    modules_in_every_view,
    modules_of,
    problems_of,
    without_faults,
)
from soter.verify.claims.results import UNDECIDED
from soter.verify.problem.axes import FINDS
from soter.verify.problem.extract import extract
from soter.verify.search.proof_search import find_hints, may_search_hints

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.verify.claims.results import ModuleResult, ProofSearch
    from soter.verify.problem.problem import Problem

NOT_LOOKED_FOR = (
    "hints are looked for of modules that stand in the file that is verified, without views, "
    "`abstracts`, `enters` and an SC that is to be found"
)
NO_RUNS = "no hint was tried: runs of the model under SC, of which hints are made, gave none"
NO_MODEL = "no hint was tried, as with any of them the module is refused: "
NO_TIME = (
    "no hint was tried: `--budget` ended while runs of the model, of which hints are made, went on"
)


def with_found_hints(
    checked: CheckResult, pick: Mapping[str, Any], budget_s: float, refused: SoterError
) -> tuple[CheckResult, tuple[ProofSearch, ...]]:
    """The program with hints for the modules that have none, and the searches for these hints.

    `pick` has the arguments of `modules_of`. `refused` is the error R008 for some of the modules;
    it is raised again for a module without hints to try, and for the modules after it.
    """
    searches: list[ProofSearch] = []
    places = {
        name: _error_place(module_named(checked, name, pick)[1])
        for name in _module_names(checked, pick)
    }
    for name, place in places.items():
        if not _poses_no_problem(*module_named(checked, name, pick)):
            continue
        made = _search_hints(checked, name, pick, budget_s, hinted=False)
        if made is None or made.checked is None:
            found = {places[s.module] for s in searches}
            raise SoterError(
                tuple(
                    _with_tries(d, made) if _place_of_error(d) == place else d
                    for d in refused.diagnostics
                    if _place_of_error(d) not in found
                )
            )
        searches.append(made)
        checked = made.checked
    return checked, tuple(searches)


def with_better_hints(
    checked: CheckResult, pick: Mapping[str, Any], results: Sequence[ModuleResult], budget_s: float
) -> tuple[CheckResult, tuple[ProofSearch, ...]]:
    """The program with new hints for undecided modules that these prove, and the searches."""
    searches = []
    for result in results:
        symbol = result.problem.module.symbol
        if result.verdict != UNDECIDED or symbol.ttf or result.problem.kind == "nodes":
            continue
        surely = result.findings["P2a"].holds
        made = _search_hints(checked, result.name, pick, budget_s, hinted=True, surely=surely)
        if made is not None:
            searches.append(made)
            checked = made.checked if made.proved and made.checked is not None else checked
    return checked, tuple(searches)


def searches_for_rest(
    checked: CheckResult, pick: Mapping[str, Any], budget_s: float
) -> tuple[ProofSearch, ...]:
    """Searches for a clause `rest` for each module whose hints may be searched."""
    made = (
        _search_hints(checked, n, pick, budget_s, hinted=False, only_rest=True)
        for n in _module_names(checked, pick)
    )
    return tuple(m for m in made if m is not None)


def _search_hints(
    checked: CheckResult,
    name: str,
    pick: Mapping[str, Any],
    budget_s: float,
    *,
    hinted: bool,
    surely: bool = False,
    only_rest: bool = False,
) -> ProofSearch | None:
    """The search for hints of a module; None if its hints may not be searched."""

    def choose(other: CheckResult) -> tuple[System, Module, Problem]:
        assert other.program is not None
        flat, m = module_named(other, name, pick)
        return flat, m, without_faults(other.program, flat, extract(flat, m))

    flat, module = module_named(checked, name, pick)
    if not may_search_hints(checked, module):
        return None
    return find_hints(
        checked, choose, flat, module, budget_s, hinted=hinted, surely=surely, only_rest=only_rest
    )


def _poses_no_problem(flat: System, module: Module) -> bool:
    """Whether the module poses no problem, for example because nothing bounds a state."""
    try:
        problems_of(modules_in_every_view([(flat, module)]))
    except SoterError:
        return True
    return False


def _module_names(checked: CheckResult, pick: Mapping[str, Any]) -> list[str]:
    return [m.name for _, m in modules_of(checked, **pick)]


def _error_place(module: Module) -> tuple[str, int]:
    """The file and the offset at which R008 of a module is reported."""
    span = module.symbol.verify.span or module.symbol.span
    return span.source.name, span.start


def _place_of_error(refused: Diagnostic) -> tuple[str, int]:
    assert refused.primary is not None  # R008 is reported at a module
    return refused.primary.span.source.name, refused.primary.span.start


def _with_tries(refused: Diagnostic, search: ProofSearch | None) -> Diagnostic:
    """The error R008 with notes on the hints tried in vain; `search` None: none were tried."""
    helps = tuple(h for h in refused.helps if h != FINDS)
    if search is None:
        return replace(refused, notes=(*refused.notes, NOT_LOOKED_FOR), helps=helps)
    tried = tuple(f"tried in vain: `{t.hints}` ({t.gave})" for t in search.tries if not t.untried)
    none = NO_TIME if search.ended else NO_RUNS
    why = search.refused
    if why is not None and not tried:
        notes = (*refused.notes, f"{NO_MODEL}{why.code}: {why.message}", *why.notes)
        return replace(refused, notes=notes, helps=(*why.helps, *helps))
    return replace(refused, notes=(*refused.notes, *(tried or (none,))), helps=helps)
