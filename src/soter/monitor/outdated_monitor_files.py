"""Whether a model monitor that `soter monitor --emit` wrote is still of the model it was made of.

Purpose: the line of an emitted file that says what it was made of, and D022 for each file of a
program of which the same command would now write another monitor; as a warning for each system
whose `set` gives its module another model than that of the monitor in it.
Non-goals: edits of the emitted node: only what it was made of is compared. `--set` of a command.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Label, Severity, SoterError
from soter.diagnostics.source import Span
from soter.language.front_end import system_of
from soter.monitor.linear_model import driven_leaves, linear_model, parameter_leaves
from soter.simulate.run_settings import param_values
from soter.verify.problem.extract import extract_sets

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.front_end import CheckResult
    from soter.language.load.loader import LoadedFile
    from soter.language.model.system import System
    from soter.language.model.typed import SystemSymbol
    from soter.verify.problem.problem import Problem

EMITTED = "made by `soter monitor --emit`"
"""What an emitted file says of itself."""
RECORD = "// made of "
FORM = 2
"""Of the node that is written; another one makes all earlier files stale."""


def record_of(
    system: System, module: str, problem: Problem, params: Mapping[str, object] | None
) -> str:
    """The line of an emitted file that says what the monitor was made of."""
    made = {
        "system": system.name,
        "module": module,
        "params": dict(params or {}),
        "model": fingerprint(problem),
    }
    return RECORD + json.dumps(made)


def fingerprint(problem: Problem) -> str:
    """SHA-256 of all that the text of a monitor follows from, in hexadecimal.

    SoterError U001 where a plant is not affine.
    """
    cases = []
    for parameter in product(*(p.values for p in problem.parameters)):
        m = linear_model(problem, parameter)
        arrays = (m.a, m.b, m.c, m.w, m.d_mid, m.d_max, m.drives, m.offset)
        cases.append([parameter, *((a + 0.0).tolist() for a in arrays)])  # -0.0 is 0.0
    q = problem.quantities

    def topic(index: int) -> str:  # as it is declared, whoever imports it by whatever name
        return problem.system.topics[index].name.rpartition(".")[2]

    made = [
        FORM,
        problem.kind,
        problem.plant_period_ns,
        cases,
        [leaf.name for leaf in q.states],
        [(topic(leaf.owner), leaf.path) for leaf in q.controls],
        [(topic(t), path) for t, path in driven_leaves(problem)],
        [(topic(t), path) for t, path in parameter_leaves(problem)],
        [
            (topic(leaf.owner), leaf.path, r.high)
            for leaf, r in zip(q.errors, problem.errors, strict=True)
        ],
    ]
    return hashlib.sha256(json.dumps(made).encode()).hexdigest()


def stale_monitors(checked: CheckResult) -> list[Diagnostic]:
    """D022 for each emitted monitor in a sound program that is not of the model as it is now."""
    assert checked.loaded is not None
    stale = []
    for file in checked.loaded.files:
        if EMITTED in file.source.text:
            wrong = _stale(checked, file)
            stale += [wrong] if wrong is not None else _of_other_systems(checked, file)
    return stale


def _of_other_systems(checked: CheckResult, file: LoadedFile) -> list[Diagnostic]:
    """Warnings for systems with this monitor whose `set` gives its module another model."""
    text = file.source.text
    line = text[text.index(RECORD) + len(RECORD) :].split("\n", 1)[0]
    made = json.loads(line)
    others = []
    for name, symbol in checked.systems.items():
        if not symbol.sets:
            continue
        flat = system_of(checked, name)
        if not any(
            c.node is not None and c.node.span.source is file.source for c in flat.components
        ):
            continue
        modules = [
            m for m in flat.modules if m.name.split(".")[-1] == made["module"].split(".")[-1]
        ]
        try:
            other = any(fingerprint(extract_sets(flat, m)) != made["model"] for m in modules)
        except SoterError as error:  # no monitor can be made of it, and this one was
            others.append(_of_another_system(symbol, error.diagnostics[0].message))
            continue
        if other:
            why = f"by its `set`; the monitor is of `{made['system']}`"
            others.append(_of_another_system(symbol, why))
    return others


def _of_another_system(symbol: SystemSymbol, why: str) -> Diagnostic:
    return Diagnostic(
        "D022",
        f"the model monitor of system `{symbol.name}` is not of the model that this system has",
        Label(symbol.span, why),
        notes=(
            "right where the vehicle is to be another one than was proved, else silent or false",
        ),
        severity=Severity.WARNING,
    )


def _stale(checked: CheckResult, file: LoadedFile) -> Diagnostic | None:
    text = file.source.text
    at = text.find(RECORD)
    start = at if at >= 0 else text.index(EMITTED)
    end = text.find("\n", start)
    end = end if end >= 0 else len(text)
    where = Span(file.source, start, start + len(RECORD) - 1 if at >= 0 else end)
    watched = file.imports.get("watched")
    again = f"`soter monitor {watched.source.name if watched else 'FILE'} --emit {file.source.name}"
    try:
        made = json.loads(text[at + len(RECORD) : end]) if at >= 0 else {}
        system, module = str(made["system"]), str(made["module"])
        model, params = made["model"], dict(made["params"])
    except (KeyError, TypeError, ValueError):
        return _diagnostic(where, "it does not say of which model it was made", again + "`")
    alarm = re.search(r"publishes watched\.([\w.]+)", text)
    again += f" --module {module} --system {system}"
    again += "".join(f" --set {name}={value}" for name, value in params.items())
    again += f" --alarm {alarm[1]}`" if alarm else "`"
    if watched is None:
        return _diagnostic(where, "it imports no program as `watched`", again)
    try:
        now = _fingerprint_now(checked, watched, system, module, params)
    except SoterError as error:
        return _diagnostic(where, error.diagnostics[0].message, again)
    if now == model:
        return None
    why = f"the plants of `{module}`, their bounds, errors or period changed since it was written"
    return _diagnostic(where, why, again)


def _fingerprint_now(
    checked: CheckResult,
    watched: LoadedFile,
    system: str,
    module: str,
    params: Mapping[str, object],
) -> str:
    """Of the module as it stands in the program that a monitor watches; SoterError."""
    program = checked.program
    assert program is not None
    named = {n: s for n, s in program.systems.items() if n == watched.prefix + system}
    only = replace(checked, systems=named)
    values = param_values(program, {_full_name(watched, n): v for n, v in params.items()})
    flat = system_of(only, watched.prefix + system, values)
    problems = [extract_sets(flat, m) for m in flat.modules if m.name == module]
    if not problems:
        message = f"system `{system}` of `{watched.source.name}` has no module `{module}`"
        raise SoterError((Diagnostic("D022", message),))
    return fingerprint(problems[0])


def _full_name(file: LoadedFile, name: str) -> str:
    """What a name of a file's own is called in the whole program."""
    first, _, rest = name.partition(".")
    inner = file.imports.get(first) if rest else None
    return file.prefix + name if inner is None else _full_name(inner, rest)


def _diagnostic(where: Span, why: str, again: str) -> Diagnostic:
    return Diagnostic(
        "D022",
        "this model monitor is not of the model that is proved",
        Label(where, why),
        notes=("it would stay silent, or alarm, by bounds that no proof assumes",),
        helps=(f"write it anew: {again}",),
    )
