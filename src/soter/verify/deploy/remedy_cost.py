"""What a remedy costs that proves a module: one run of its system before, one after.

Purpose: takeovers a minute, AC's share of the time and the bytes of the DM's tables, of the figures
that `soter run` would tell of the program as it is, and as it would be with what was tried.
Non-goals: which remedies help (`verify/diagnosis/tried_remedies.py`); systems with externs, which
`soter verify` never runs.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.codegen.unit import generate
from soter.core.layout import ac_share, state_dtype
from soter.core.steps import lower
from soter.diagnostics.current_phase import phase
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless, with_changed_topics
from soter.language.model.system import LEVELS_DEFAULT
from soter.native.build import library
from soter.native.library import Library
from soter.verify.claims.results import ASSUMED, PROVED, FlownFigures, RemedyCost
from soter.verify.deploy.missing_predicates import complete, open_modules, put, sets_of
from soter.verify.enclose.c_emitter import EnclosureError
from soter.verify.grid.sets import CancelledError
from soter.verify.problem.extract import extract
from soter.verify.proof_methods import tables

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import Module, System
    from soter.verify.claims.results import ModuleResult
    from soter.verify.problem.problem import Problem

    Tell = Callable[[str, float], None]

SEED = 1
UNTIL_NS, PERIODS = 60_000_000_000, 200
"""A run that lasts longer ends here, or after so many periods of the DM, if that is later."""
SLICE_NS, SLICES = 1_000_000_000, 1000
"""After so long it is asked whether there is CPU time left, so often at most."""
CPU_S = 5.0
"""So many CPU seconds of this process both runs get, with the tables that they need."""


def enter_cost(result: ModuleResult, fresh: Callable[[], System]) -> None:
    """Enter what the changes cost that prove every claim, beside their advice.

    And what was chosen for a module that is proved: smaller cells, fewer levels. `fresh`: gives the
    system that it was proved in, as it flies.
    """
    held = result.verdict in (PROVED, ASSUMED)
    if held and result.cells_why and result.problem.computed:
        phase(f"{result.problem.name}: measuring what smaller cells cost")
        declared = replace(result.problem, groups=result.problem.declared_groups, cells_open=False)
        before = None if result.cells_why == "P2a" else replace(declared, declared_groups=())
        result.notes += (f"smaller cells: {_cost(before, result.problem, fresh)}",)
    if held and result.levels_why:
        phase(f"{result.problem.name}: measuring what fewer levels cost")
        default = replace(result.problem, levels=LEVELS_DEFAULT, levels_open=False)
        result.levels_cost = _cost(default, result.problem, fresh)
        result.notes += (f"fewer levels: {result.levels_cost}",)
    for finding in result.findings.values():
        if finding.remedied is not None:
            phase(f"{result.problem.name}: measuring what that costs")
            finding.cost = _cost(result.problem, finding.remedied, fresh)


def _cost(problem: Problem | None, remedied: Problem, fresh: Callable[[], System]) -> RemedyCost:
    """`problem`: as it is; None: without tables."""
    flat, ends = fresh(), time.process_time() + CPU_S
    if problem is not None and remedied.module.sc != problem.module.sc:
        return RemedyCost(flat.name, not_measured="it is a module with other controllers")

    def tell(what: str, share: float) -> None:
        del what, share
        if time.process_time() > ends:
            raise CancelledError

    why = _why_not(flat, remedied)
    if why or not flat.until_ns:
        return RemedyCost(flat.name, not_measured=why)
    until_ns = min(flat.until_ns, max(UNTIL_NS, PERIODS * remedied.times.delta_dm))
    try:
        before = None if problem is None else _flown(flat, problem, until_ns, tell)
        changed = _changed(fresh(), problem or remedied, remedied)
        after = _flown(changed, remedied, until_ns, tell)
    except CancelledError:
        why = f"its runs, and the tables that they need, take more than {CPU_S:g} s of CPU time"
    except SoterError as error:
        why = error.diagnostics[0].message
    except EnclosureError as error:
        why = str(error)
    if why or after is None:
        return RemedyCost(flat.name, not_measured=why or "no tables were found on the whole grid")
    return RemedyCost(flat.name, until_ns / 1e9, before, after)


def _why_not(flat: System, problem: Problem) -> str:
    """Why the system is not run; "" where it is."""
    asked = [x.name for x in flat.components if x.extern]
    asked += [f.source_name for f in lower(flat).functions if f.result is None]
    if asked:
        return f"`verify` asks no externs, and system `{flat.name}` has `{asked[0]}`"
    if not flat.until_ns:
        return f"system `{flat.name}` says no `until`"
    count = len(_instances(flat, problem))
    if count != 1:
        return f"the module stands {count} times in system `{flat.name}`, and one was tried"
    return "the module has views" if problem.view else ""


def _instances(flat: System, problem: Problem) -> list[Module]:
    """The modules that what is written of this one is written of."""
    declared = problem.module.symbol.span
    return [m for m in flat.modules if m.symbol.span == declared]


def _changed(flat: System, problem: Problem, remedied: Problem) -> System:
    """A fresh system with the ages that were tried, and without predicates that were left out."""
    ages = {
        now.symbol: now.max_age_ns
        for now, was in zip(remedied.system.topics, problem.system.topics, strict=True)
        if now.max_age_ns != was.max_age_ns
    }
    if remedied.computed and not problem.computed:
        (module,) = _instances(flat, problem)
        module.symbol = replace(module.symbol, ttf=None, safer=None, topics_read=())
    younger = [
        replace(t, max_age_ns=ages[t.symbol])
        for t in flat.topics
        if t.symbol in ages and t.max_age_ns is not None
    ]
    return with_changed_topics(flat, younger)


def _flown(flat: System, tried: Problem, until_ns: int, tell: Tell) -> FlownFigures | None:
    """A run, with predicates computed on the cells and levels of `tried`; None: there are none."""
    (module,) = _instances(flat, tried)
    count = 0
    if module in open_modules(flat):
        own = extract(faultless(flat), module)
        problem = replace(own, groups=tried.groups, states=tried.states, levels=tried.levels)
        problem = replace(problem, declared_groups=tried.declared_groups)
        problem = replace(problem, levels_open=tried.levels_open, cells_open=tried.cells_open)
        problem, sets = sets_of(problem, tell=tell)
        level_tables = None if sets is None else tables(problem, sets)
        if level_tables is None:
            return None
        put(flat, module, problem, level_tables)
        files: dict[str, bytes] = {}
        for k, table in enumerate(level_tables):
            table.entry([""] * len(problem.states), str(k), files)
        count = sum(map(len, files.values()))
    complete(flat, tell=tell)
    unit = generate(flat)
    program = Library(library(unit), unit.prefix, unit.layout.size)
    state = program.new_state(SEED)
    for until in (*range(0, until_ns, max(SLICE_NS, until_ns // SLICES)), until_ns):
        program.run(state, until)
        tell("", until / until_ns)
    last = state.view(state_dtype(flat, unit.layout))[0]
    often = int(last["modules"][module.index]["to_sc"]) / (until_ns / 60e9)
    return FlownFigures(often, ac_share(last, module.index), count)
