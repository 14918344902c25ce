"""The search, within a budget, for hints with which a module is proved.

Purpose: `find_hints` makes hints (`grid_hints.py`, `rest_hints.py`), writes one after the other
into the text of the program, as a person would, checks the text, and tries to prove the module,
with cheap hints first. The result is a text, so certificates, builds and flights are of a complete
program. Runs of the model only guide the search; each proof is an ordinary one.
Non-goals: modules with views, abstractions, proofs by induction, or an SC that is to be found.
"""

from __future__ import annotations

import resource
from itertools import chain
from math import inf
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import CancelledError, cancelled_when, phase, within_phase
from soter.diagnostics.diagnostic import Diagnostics, SoterError, Source
from soter.language.front_end import check_file
from soter.language.model.types import leaf_name
from soter.language.syntax.printer import format_source
from soter.verify.claims.results import ASSUMED, PROVED, UNDECIDED, ProofSearch, Try
from soter.verify.diagnosis.model_runs import StepFaultError
from soter.verify.diagnosis.vacuity import NEVER, NOT_SHOWN
from soter.verify.enclose.enclosure_emitter import EnclosureError
from soter.verify.grid.group_model import UnboundedError
from soter.verify.problem.inputs import inputs_of
from soter.verify.problem.verification_system import verification_system_of
from soter.verify.search.grid_hints import grid_hints
from soter.verify.search.hint_text import COMMENT, Hints, with_hints
from soter.verify.search.model_states import ModelStates
from soter.verify.search.rest_hints import hints_with_box, rest_hints
from soter.verify.tubes.rest_claims import HOW_FAR, TOO_MANY
from soter.verify.tubes.verify import TubeResult
from soter.verify.verify_module import module_method

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.verify.claims.results import ModuleResult
    from soter.verify.problem.problem import Problem

    Choose = Callable[[CheckResult], tuple[System, Module, Problem]]
    """A function that selects the flat system, the module and the problem in a program."""

WIDE = 1e9
"""Half the width of the only cell of each axis for simulated runs; beyond it a run ends."""
GROWTH = 1.15
"""The time of a try is assumed to grow as the number of cells to this power."""
WEIGHTS = {"P2a": 32, "start": 16, "P3": 8, "ttf": 4, "safer": 2, "P2b": 1}
"""How much each shown claim counts in the rank of a try."""
OF_A_TRY = 0.4
"""The share of the remaining budget that one try may take; a try that was cut short is repeated at
the end, with all that is left then."""
OF_RESTS = 0.25
"""The share of the budget that all clauses `rest` together may take."""
IN_VAIN, HELD = 100.0, 200.0
"""The ranks of proofs where AC never gets control, and where it is not known to get it."""
CUT_SHORT, ENDED = "cut short, so that others may be tried", "the budget ended"


def used_cpu_s() -> float:
    """The CPU seconds used by this process and by its child processes that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def may_search_hints(checked: CheckResult, module: Module) -> bool:
    """Whether hints of a module may be searched: it is in the main file, without views, ..."""
    symbol, verify = module.symbol, module.symbol.verify
    other = verify.views or verify.abstracts or verify.induction or verify.enters or module.view
    main = checked.loaded is not None and symbol.span.source is checked.loaded.main.source
    return bool(main and not (other or symbol.synthesized))


def find_hints(
    checked: CheckResult,
    choose: Choose,
    flat: System,
    module: Module,
    budget_s: float,
    *,
    hinted: bool,
    surely: bool = False,
    only_rest: bool = False,
) -> ProofSearch:
    """Searches for hints that prove all of a module; keeps the first that do, or the best.

    `choose` picks the module from a checked program; `flat` and `module` belong to `checked`. With
    `hinted` the program has hints, and others are tried in their place. With `surely` others are
    taken only if AC surely gets control. With `only_rest` no grids are tried, and clauses `rest`
    may take the whole budget.
    """
    for_rests_s = budget_s if only_rest else OF_RESTS * budget_s
    search = _HintSearch(
        checked, choose, module, budget_s, for_rests_s, hinted=hinted, surely=surely
    )
    phase(f"{module.name}: which states its plants reach")
    try:
        found = search.reached_states(flat)
        named = set[int]() if hinted else _states_with_axes(found, module)
        for cells, hints in _hints_in_order(found, named, module, only_rest=only_rest):
            if search.made.proved or not search.has_time_left():
                break
            search.try_hints(hints, cells, OF_A_TRY)
        for cells, hints in search.cut_short:
            if not search.made.proved and search.has_time_left():
                search.try_hints(hints, cells)
    except SoterError as error:
        search.made.refused = error.diagnostics[0]
    except (CancelledError, StepFaultError, UnboundedError, EnclosureError):
        pass
    except KeyboardInterrupt as stopped:
        vars(stopped)["__notes__"] = search.tries_in_words()
        raise
    search.made.ended = not search.has_time_left()
    return search.made


def _states_with_axes(found: ModelStates, module: Module) -> set[int]:
    """The numbers of the states with an axis in a `grid` line of the program."""
    axes = [a for g in module.symbol.verify.groups for a in g.axes]
    leaves = {leaf_name(a.instance if a.topic is None else a.topic.name, a.path) for a in axes}
    plain = (leaf.name for leaf in found.problem.quantities.states)
    return {s for s, names in enumerate(zip(found.names, plain, strict=True)) if leaves & {*names}}


def _hints_in_order(
    found: ModelStates, named: set[int], module: Module, *, only_rest: bool
) -> Iterator[tuple[int, Hints]]:
    """Hints to try, cheap ones first, each with its number of cells, which is 0 without a grid."""
    grids_alone = not only_rest and (named or module.symbol.ttf or module.symbol.safer)
    rests = [] if grids_alone else _rests_to_try(found)
    grids, quick = ([], 0) if only_rest else grid_hints(found, named)
    return chain(grids[:quick], rests, grids[quick:])


def _rests_to_try(found: ModelStates) -> Iterator[tuple[int, Hints]]:
    """The clauses `rest` to try, each with 0 as its number of cells."""
    if found.problem.kind == "flow" and found.rescued:
        yield from ((0, h) for h in rest_hints(found))


class _HintSearch:
    """A search for hints of one module, with its budget and the record of what it tried."""

    def __init__(
        self,
        checked: CheckResult,
        choose: Choose,
        module: Module,
        budget_s: float,
        for_rests_s: float,
        *,
        hinted: bool,
        surely: bool,
    ) -> None:
        assert checked.loaded is not None
        self.made = ProofSearch(module.name, hinted)
        self._enough = inf if surely else HELD
        self._checked, self._choose, self._module = checked, choose, module
        self._source = checked.loaded.main.source
        self._until, self._for_rests = used_cpu_s() + budget_s, for_rests_s
        self._best = -1.0
        self._cell_s = 0.0, 0
        self._no_rest = False
        self.cut_short: list[tuple[int, Hints]] = []

    def has_time_left(self) -> bool:
        """Whether the search has not yet used up its CPU time."""
        return used_cpu_s() < self._until

    def tries_in_words(self) -> list[str]:
        """Lines on the hints that were tried before an interruption."""
        name, tries = self.made.module, [t for t in self.made.tries if not t.untried]
        if not tries:
            return [f"{name}: no hint was tried yet, no claim settled"]
        return [f"{name}: tried `{t.hints}`: {t.gave}" for t in tries]

    def reached_states(self, flat: System) -> ModelStates:
        """The states of the module's model that its runs reach."""
        at = verification_system_of(flat, self._module)
        diagnostics = Diagnostics()
        inputs = inputs_of(at, diagnostics)
        diagnostics.raise_errors()
        names = [x.name.removeprefix(at.prefix) for x in inputs.states]
        lines = tuple(f"grid {name} in [{-WIDE!r}, {WIDE!r}] / 1;" for name in names)
        checked = check_file(self._source.name, self._text_with(Hints(items=lines)))
        _, _, problem = self._choose(checked)
        return ModelStates.of_problem(problem, self.has_time_left)

    def _text_with(self, hints: Hints, comment: str = "") -> str:
        return with_hints(self._source, self._module.symbol, hints, comment)

    def try_hints(self, hints: Hints, cells: int, share: float = 1.0) -> None:
        """Tries to prove the module with these hints, and keeps them if they are the best.

        `share` is the part of the remaining budget that the try may take.
        """
        if hints.clauses and (self._no_rest or self._for_rests <= 0.0):
            return
        spent, before = self._cell_s
        expected = spent * (cells / before) ** GROWTH if cells and before else 0.0
        began = used_cpu_s()
        if expected > self._until - began:
            self.made.tries.append(Try(str(hints), "not tried", expected, untried=True))
            return
        phase(f"{self.made.module}: trying {hints}")
        until = began + share * (self._until - began)
        gave, result, checked = self._prove_with(hints, until)
        if gave == CUT_SHORT and share < 1.0:
            self.cut_short.append((cells, hints))
        shown = ENDED if gave == CUT_SHORT and share == 1.0 else gave
        took = used_cpu_s() - began
        self._for_rests -= took if hints.clauses else 0.0
        if cells and result is not None:
            self._cell_s = took, cells
        self.made.tries.append(Try(str(hints), shown, took, cut=gave == CUT_SHORT))
        # where a `rest` takes too many operations, a larger one may take fewer
        refused = result is None and gave != CUT_SHORT and TOO_MANY not in gave
        self._no_rest |= bool(hints.clauses) and refused
        if result is None:
            return
        if (rank := _rank_of_result(result)) > self._best:
            self._best = rank
            self.made.found, self.made.result, self.made.checked = hints, result, checked
            self.made.proved = rank >= self._enough
        if hints.clauses and rank < inf:
            self._try_further_hints(hints, result)

    def _try_further_hints(self, hints: Hints, result: ModuleResult) -> None:
        """Tries variants of a `rest`: larger moves, another box, a longer time, or a shield."""
        open_ = [n for n, f in result.findings.items() if not f.holds]
        why = result.findings["P2a"].text
        if hints.farther is not None and HOW_FAR in why:
            self.try_hints(hints.farther, 0)
        elif isinstance(result, TubeResult) and (other := result.claims.other):
            leaf = result.problem.leaf_of_state
            further = hints_with_box(hints, {leaf(s): r for s, r in other.items()})
            if str(further) not in {t.hints for t in self.made.tries}:
                self._for_rests = inf  # P2a is shown there, so it may take what is left
                self.try_hints(further, 0)
        elif open_ == ["start"] and hints.longer:
            self.try_hints(Hints(clauses=(hints.longer, *hints.clauses[1:])), 0)
        elif not open_ and "shield;" not in hints.clauses:
            self.try_hints(Hints(clauses=(*hints.clauses, "shield;"), longer=hints.longer), 0)

    def _prove_with(
        self, hints: Hints, until: float
    ) -> tuple[str, ModuleResult | None, CheckResult | None]:
        """The outcome in words, the result and the program; without a result the two are None."""
        try:
            checked = _checked_program(self._source.name, self._laid_out_text_with(hints))
            _, _, problem = self._choose(checked)
            problem.cells_open = False
            with within_phase(), cancelled_when(lambda: used_cpu_s() > until):
                result = module_method(problem).verify(
                    problem, refute=False, explain=False, search=None, compiled=None
                )
        except SoterError as error:
            first = error.diagnostics[0]
            return f"{first.code}: {first.message}", None, None
        except (UnboundedError, EnclosureError) as error:
            return str(error), None, None
        except CancelledError:
            return CUT_SHORT, None, None
        return _result_in_words(result), result, checked

    def _laid_out_text_with(self, hints: Hints) -> str:
        """The text with the hints; it is formatted if the program's text was formatted."""
        text, source = self._text_with(hints, COMMENT), self._source
        if format_source(source, Diagnostics()) != source.text:
            return text
        return format_source(Source(source.name, text), Diagnostics()) or text


def _checked_program(name: str, text: str) -> CheckResult:
    """The checked program with this text; raises `SoterError` if it has errors."""
    checked = check_file(name, text)
    if not checked.ok:
        raise SoterError(checked.diagnostics.items)
    return checked


def _rank_of_result(result: ModuleResult) -> float:
    """The rank of a result, where higher is better; inf if all is proved and AC gets control."""
    often = "" if result.vacuity is None else result.vacuity.how_often
    if result.verdict in (PROVED, ASSUMED):
        return {NEVER: IN_VAIN, NOT_SHOWN: HELD}.get(often, inf)
    shown = [n for n, f in result.findings.items() if f.verdict != UNDECIDED]
    return float(sum(WEIGHTS.get(n, 0) for n in shown))


def _result_in_words(result: ModuleResult) -> str:
    """The outcome of a try in words."""
    if result.verdict in (PROVED, ASSUMED):
        but = f", but {result.vacuity.text}" if result.vacuity is not None else ""
        return f"{PROVED}{result.verdict_note}{but}"
    open_ = {n: f for n, f in result.findings.items() if not f.holds}
    first = next(iter(open_.values()))
    return f"{', '.join(open_)} {result.verdict}: {first.text}"
