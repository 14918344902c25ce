"""Picks the modules of a program that are verified, with their systems, views and problems.

Purpose: `modules_of` picks the modules, each in a flat system that has it; `chosen_problems` gives
the problem of each in every view. `module_named` gives one of them by its full name.
Non-goals: the problems themselves (`problem/extract.py`), proofs (`command.py`).
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, SoterError
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Assumption

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value
    from soter.verify.problem.problem import Problem


NO_FAULTS = "nothing goes wrong of what the `faults` of system {} say"


def refuse_forced_modules(chosen: list[tuple[System, Module]]) -> None:
    """Raises `SoterError` R019 for a forced module, as the theorem needs a DM that switches."""
    diagnostics = Diagnostics()
    for flat, m in chosen:
        if m.forced is not None:
            diagnostics.error(
                "R019",
                f"module `{m.name}` is forced to {m.forced.upper()} in system `{flat.name}`",
                m.symbol.span,
                notes=("its DM does not switch there: nothing can be proved of it",),
                helps=(
                    "verify it in a system that does not force it: `--system NAME`",
                    "or the other modules of this one: `--module NAME`",
                ),
            )
    diagnostics.raise_errors()


def _systems_by_preference(checked: CheckResult, params: Mapping[str, Value]) -> list[str]:
    preferred = checked.default_system()
    names = [n for n, s in checked.systems.items() if s.deploys is None]
    if preferred is not None:
        names.sort(key=lambda n: n != preferred.name and 1 + _forces_a_module(checked, n, params))
    return names


def modules_of(
    checked: CheckResult, module: str | None, system: str | None, params: Mapping[str, Value]
) -> list[tuple[System, Module]]:
    """The modules to verify, each in a flat system with it; `SoterError` U008 if none matches."""
    _refuse_deployed_system(checked, system)
    names = [system] if system else _systems_by_preference(checked, params)
    modules: list[tuple[System, Module]] = []
    known: list[str] = []
    seen: set[object] = set()
    for name in names or [""]:
        flat = system_to_prove(checked, name, params, exact=system is not None)
        here: set[object] = set()
        for m in flat.modules:
            known.append(m.name)
            here.add(m.symbol)
            if m.symbol not in seen and (module is None or module in (m.name, m.symbol.name)):
                modules.append((flat, m))
        seen |= here
    if module is not None and not modules:
        raise SoterError((_no_module_diagnostic(module, list(dict.fromkeys(known))),))
    return modules


def _forces_a_module(checked: CheckResult, system: str, params: Mapping[str, Value]) -> bool:
    """Whether a system forces a module; the default system counts as one that does not."""
    return any(m.forced for m in system_to_prove(checked, system, params, exact=False).modules)


def _refuse_deployed_system(checked: CheckResult, system: str | None) -> None:
    """Raises U008 for a deployed system: a proof is about the system that it deploys."""
    every = list(checked.systems.values())
    meant = [s for s in every if s.name == system or system is None]
    if not meant or any(s.deploys is None for s in meant):
        return
    symbol = meant[0]
    assert symbol.deploys is not None
    text = f"system `{symbol.name}` has no plants: it deploys `{symbol.deploys.name}`"
    proved = symbol.deploys
    name = proved.name.rpartition(".")[2]
    how = f"soter verify {shlex.quote(proved.span.source.name)} --system {name} --cert DIR"
    helps = (f"verify that one: `{how}`", "and build this one with `--cert DIR`")
    raise SoterError((Diagnostic("U008", text, helps=helps),))


def _no_module_diagnostic(module: str, known: list[str]) -> Diagnostic:
    names = ", ".join(f"`{n}`" for n in known) or "none"
    return Diagnostic("U008", f"there is no module `{module}`", notes=(f"there are: {names}",))


def modules_in_every_view(chosen: list[tuple[System, Module]]) -> list[tuple[System, Module]]:
    """Every module once for each of its views; a single `SoterError` has all diagnostics."""
    views: list[tuple[System, Module]] = []
    diagnostics = Diagnostics()
    for flat, m in chosen:
        try:
            views += systems_by_view(flat, m)
        except SoterError as error:
            for d in error.diagnostics:
                diagnostics.add(d)
    diagnostics.raise_errors()
    return views


def problems_of(chosen: list[tuple[System, Module]]) -> list[Problem]:
    """The verification problem of every module; a single `SoterError` has all diagnostics."""
    problems: list[Problem] = []
    refused: list[Diagnostic] = []
    names = dict.fromkeys(m.name for _, m in chosen)
    for flat, m in chosen:
        try:
            problems.append(extract(flat, m))
        except SoterError as error:
            refused += error.diagnostics
            names.pop(m.name, None)
    diagnostics = Diagnostics()
    others = (f"`--module` takes one by itself: {', '.join(names)}",) if names else ()
    for d in refused:
        diagnostics.add(replace(d, helps=(*d.helps, *others)))
    diagnostics.raise_errors()
    return problems


def chosen_problems(
    checked: CheckResult, module: str | None, system: str | None, params: Mapping[str, Value]
) -> tuple[list[tuple[System, Module]], list[Problem]]:
    """The modules to verify, in every view, and their problems; `SoterError` as `problems_of`."""
    assert checked.program is not None
    chosen = modules_of(checked, module, system, params)
    refuse_forced_modules(chosen)
    chosen = modules_in_every_view(chosen)
    pairs = zip(problems_of(chosen), chosen, strict=True)
    return chosen, [without_faults(checked.program, flat, p) for p, (flat, _) in pairs]


def module_named(checked: CheckResult, name: str, pick: Mapping[str, Any]) -> tuple[System, Module]:
    """The module with this full name, and its flat system."""
    every = modules_of(checked, **{**pick, "module": name})
    return next((flat, m) for flat, m in every if m.name == name)


def without_faults(program: TypedProgram, flat: System, problem: Problem) -> Problem:
    """The problem with the added assumption that no declared fault of the system happens."""
    declared = program.systems.get(flat.name)
    if declared is None or not declared.faults:
        return problem
    without = Assumption("no faults", NO_FAULTS.format(flat.name))
    return replace(problem, assumptions=(*problem.assumptions, without))
