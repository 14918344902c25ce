"""Writes a model monitor as a trusted Soter node, and says when such a file is of an old model.

Purpose: `write_monitor` (`soter monitor --emit`) writes, beside a program that it imports, a node
that checks in flight what `model_membership.py` checks in a log: one interval per state, bounded
work, no heap. It publishes whether its last step raised an alarm, and is to be the last instance of
a system, so that the command it sees acts until its next step. A line of the file says what it was
made of. `stale_monitors` (`soter check`) gives D022 for each such file of a program that the same
command would now write otherwise, and warns of systems whose `set` gives the module another model.
Non-goals: plants that are not affine; lateness (a step is one period after the last one); composing
it into a system, which the user does, who lets `ttf` read the alarm; edits of the emitted node.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from soter.diagnostics.diagnostic import (
    Diagnostic,
    Diagnostics,
    Label,
    Severity,
    SoterError,
    Source,
    Span,
)
from soter.diagnostics.system_texts import reason
from soter.language.front_end import check_file, system_of
from soter.language.model.types import leaf_name, show_ns
from soter.language.syntax.printer import format_source
from soter.monitor.linear_model import (
    discretised_step,
    driven_leaves,
    linear_model,
    parameter_leaves,
)
from soter.monitor.model_membership import ROUNDING, flying_topic_names, observation_map
from soter.simulate.run_options import param_values
from soter.verify.problem.extract import problem_of_sets

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from soter.core.layout import Floats
    from soter.language.front_end import CheckResult
    from soter.language.load.loader import LoadedFile
    from soter.language.model.system import Module, System
    from soter.language.model.typed import SystemSymbol
    from soter.verify.problem.problem import Problem


EMITTED = "made by `soter monitor --emit`"
"""Words at the head of a file by which it is known as an emitted monitor."""
RECORD = "// made of "
FORM = 2
"""The version of the text that is written: a new one makes all earlier files stale."""


def origin_line(
    system: System, module: str, problem: Problem, params: Mapping[str, object] | None
) -> str:
    """The line of an emitted file that says what its monitor was made of."""
    made_of = {
        "system": system.name,
        "module": module,
        "params": dict(params or {}),
        "model": model_fingerprint(problem),
    }
    return RECORD + json.dumps(made_of)


def model_fingerprint(problem: Problem) -> str:
    """The SHA-256 in hexadecimal of all that determines a monitor; raises U001 if not affine."""
    cases = []
    for parameter in product(*(p.values for p in problem.parameters)):
        m = linear_model(problem, parameter)
        arrays = (m.a, m.b, m.c, m.w, m.d_mid, m.d_max, m.drives, m.offset)
        cases.append([parameter, *((a + 0.0).tolist() for a in arrays)])  # -0.0 is 0.0
    q = problem.quantities

    def declared_name(index: int) -> str:  # without the names by which files import each other
        return problem.system.topics[index].name.rpartition(".")[2]

    made_of = [
        FORM,
        problem.kind,
        problem.plant_period_ns,
        cases,
        [leaf.name for leaf in q.states],
        [(declared_name(leaf.owner), leaf.path) for leaf in q.controls],
        [(declared_name(t), path) for t, path in driven_leaves(problem)],
        [(declared_name(t), path) for t, path in parameter_leaves(problem)],
        [
            (declared_name(leaf.owner), leaf.path, r.high)
            for leaf, r in zip(q.errors, problem.errors, strict=True)
        ],
    ]
    return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()


def stale_monitors(checked: CheckResult) -> list[Diagnostic]:
    """Gives D022 for each emitted monitor of a sound program whose model has changed since."""
    assert checked.loaded is not None
    stale = []
    for file in checked.loaded.files:
        if EMITTED in file.source.text:
            wrong = _staleness_diagnostic(checked, file)
            stale += [wrong] if wrong is not None else _other_system_warnings(checked, file)
    return stale


def _other_system_warnings(checked: CheckResult, file: LoadedFile) -> list[Diagnostic]:
    """Warnings for systems with this monitor whose `set` changes the model of the module."""
    text = file.source.text
    line = text[text.index(RECORD) + len(RECORD) :].split("\n", 1)[0]
    made_of = json.loads(line)
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
            m for m in flat.modules if m.name.split(".")[-1] == made_of["module"].split(".")[-1]
        ]
        try:
            other = any(
                model_fingerprint(problem_of_sets(flat, m)) != made_of["model"] for m in modules
            )
        except SoterError as error:  # this system's model allows no monitor
            others.append(_other_system_warning(symbol, error.diagnostics[0].message))
            continue
        if other:
            why = f"by its `set`; the monitor is of `{made_of['system']}`"
            others.append(_other_system_warning(symbol, why))
    return others


def _other_system_warning(symbol: SystemSymbol, why: str) -> Diagnostic:
    return Diagnostic(
        "D022",
        f"the model monitor of system `{symbol.name}` is not of the model that this system has",
        Label(symbol.span, why),
        notes=(
            "right where the vehicle is to be another one than was proved, else silent or false",
        ),
        severity=Severity.WARNING,
    )


def _staleness_diagnostic(checked: CheckResult, file: LoadedFile) -> Diagnostic | None:
    text = file.source.text
    at = text.find(RECORD)
    start = at if at >= 0 else text.index(EMITTED)
    end = text.find("\n", start)
    end = end if end >= 0 else len(text)
    where = Span(file.source, start, start + len(RECORD) - 1 if at >= 0 else end)
    watched = file.imports.get("watched")
    again = f"`soter monitor {watched.source.name if watched else 'FILE'} --emit {file.source.name}"
    try:
        made_of = json.loads(text[at + len(RECORD) : end]) if at >= 0 else {}
        system, module = str(made_of["system"]), str(made_of["module"])
        model, params = made_of["model"], dict(made_of["params"])
    except (KeyError, TypeError, ValueError):
        return _stale_diagnostic(where, "it does not say of which model it was made", again + "`")
    alarm = re.search(r"publishes watched\.([\w.]+)", text)
    again += f" --module {module} --system {system}"
    again += "".join(f" --set {name}={value}" for name, value in params.items())
    again += f" --alarm {alarm[1]}`" if alarm else "`"
    if watched is None:
        return _stale_diagnostic(where, "it imports no program as `watched`", again)
    try:
        now = _fingerprint_now(checked, watched, system, module, params)
    except SoterError as error:
        return _stale_diagnostic(where, error.diagnostics[0].message, again)
    if now == model:
        return None
    why = f"the plants of `{module}`, their bounds, errors or period changed since it was written"
    return _stale_diagnostic(where, why, again)


def _fingerprint_now(
    checked: CheckResult,
    watched: LoadedFile,
    system: str,
    module: str,
    params: Mapping[str, object],
) -> str:
    """The fingerprint of a module in the program as it is now; raises SoterError if it has none."""
    program = checked.program
    assert program is not None
    named = {n: s for n, s in program.systems.items() if n == watched.prefix + system}
    only = replace(checked, systems=named)
    values = param_values(program, {_full_name(watched, n): v for n, v in params.items()})
    flat = system_of(only, watched.prefix + system, values)
    problems = [problem_of_sets(flat, m) for m in flat.modules if m.name == module]
    if not problems:
        message = f"system `{system}` of `{watched.source.name}` has no module `{module}`"
        raise SoterError((Diagnostic("D022", message),))
    return model_fingerprint(problems[0])


def _full_name(file: LoadedFile, name: str) -> str:
    """The full name, in the whole program, of the declaration that a file calls `name`."""
    first, _, rest = name.partition(".")
    inner = file.imports.get(first) if rest else None
    return file.prefix + name if inner is None else _full_name(inner, rest)


def _stale_diagnostic(where: Span, why: str, again: str) -> Diagnostic:
    return Diagnostic(
        "D022",
        "this model monitor is not of the model that is proved",
        Label(where, why),
        notes=("it would stay silent, or alarm, by bounds that no proof assumes",),
        helps=(f"write it anew: {again}",),
    )


NODE = "ModelMonitor"


def monitor_source(
    problem: Problem, imported: str, names: dict[int, str], alarm: str | None, record: str
) -> str:
    """The text of a file with the monitor's node; raises SoterError U001 if it cannot be written.

    `imported` is the path of the program in `import`. `names` maps topic indices to names with the
    alias `watched.`. `alarm` is the program's bool topic to publish, or None for a new topic.
    `record` is the line of `origin_line`.
    """
    lines = [
        *_head_lines(problem, imported, alarm, record),
        *_node_lines(problem, names, alarm),
        "}",
        "",
    ]
    laid_out = format_source(Source("monitor", "\n".join(lines)), Diagnostics())
    assert laid_out is not None
    return laid_out


def _head_lines(problem: Problem, imported: str, alarm: str | None, record: str) -> list[str]:
    causes = ", ".join(["Nothing", *(_cause_name(leaf.name) for leaf in problem.quantities.states)])
    lines = [
        "soter 1;",
        f"// The model monitor of {problem.name}, {EMITTED}. It is to be",
        "// the last instance of a system. An alarm says that no disturbance and no error within",
        "// the declared bounds explains what is seen.",
        *_delay_comments(problem),
        record,
        "",
        f'import "{imported}" as watched;',
        "",
        f"type ModelCause = enum {{ {causes} }};",
        "topic modelCause: ModelCause;  // the first state that the last alarm was raised by",
    ]
    if alarm is None:
        lines.append("topic modelAlarm: bool;")
    return [*lines, ""]


def _delay_comments(problem: Problem) -> list[str]:
    """Comments with the longest time until a constant excess of a disturbance raises the alarm.

    For a state x' = -k x + known + w with |w| <= W, estimated within an error E: a disturbance W +
    d moves the true x from the end of the box, which is at most 2 E away, so far that every
    estimate lies outside the box: d / k (1 - e^-kT) > 2 E (1 + e^-kT). So the time T is at most 2 /
    k atanh(2 E k / d), or 4 E / d for k = 0.
    """
    if problem.kind != "flow" or problem.parameters:
        return []
    model = linear_model(problem, ())
    error = observation_map(problem, model).error
    lines = []
    for i, leaf in enumerate(problem.quantities.states):
        e, k = float(error[i]), -float(model.a[i, i])
        known = [error[j] == 0.0 for j in np.flatnonzero(model.a[i]) if j != i]
        if not (np.abs(model.w[i]) @ model.d_max > 0 and 0 < e < np.inf and all(known) and k >= 0):
            continue
        within = f"{2 / k:.4g} atanh({2 * e * k:.4g} / d)" if k else f"{4 * e:.4g} / d"
        never = f"; d of {2 * e * k:.4g} or less perhaps never" if k else ""
        lines.append(
            f"// {leaf.name}: a disturbance d beyond its bound is told in {within} s{never}"
        )
    return lines


def _cause_name(state: str) -> str:
    """The member of `ModelCause` for a state: `loop_v_x` for `loop.v.x`."""
    return re.sub(r"\W+", "_", state).strip("_")


def _node_lines(problem: Problem, names: dict[int, str], alarm: str | None) -> list[str]:
    q, n = problem.quantities, len(problem.states)
    driven = driven_leaves(problem)
    watched = [names[i] for i in dict.fromkeys([t for t, _ in driven])]
    acting = [names[i] for i in dict.fromkeys(c.owner for c in q.controls)]
    topic = alarm or "modelAlarm"
    cases = list(product(*(p.values for p in problem.parameters)))
    lines = [
        f"node {NODE} period {show_ns(problem.plant_period_ns).replace(' ', '')} {{",
        f"  subscribes {', '.join(dict.fromkeys(watched + acting))};",
        f"  publishes {topic}, modelCause;",
        f"  var low: float[{n}];",
        f"  var high: float[{n}];",
        f"  var acts: float[{max(1, len(q.controls))}];",
        "  var cause: ModelCause;",
        "  var begun: bool;",
        "  var followed: int = 0;",
        "  step {",
        "    var alarmed = false;",
        f"    let seen = {' && '.join(f'age({w}) <= 0.0' for w in watched)};",
    ]
    place = [leaf_name(names[index], path) for index, path in parameter_leaves(problem)]
    for k, parameter in enumerate(cases):
        tests = [f"{p} == {v}" for p, v in zip(place, parameter, strict=True)]
        word = "if" if k == 0 else "} elseif"
        if len(cases) > 1:
            lines.append(f"    {word} {' && '.join(tests)} {{")
        lines += _case_lines(problem, parameter, k, names)
    if len(cases) > 1:
        lines.append("    }")
    for i, c in enumerate(q.controls):
        lines.append(f"    acts[{i}] = {leaf_name(names[c.owner], c.path)};")
    lines += [f"    publish {topic} = alarmed;", "    publish modelCause = cause;", "  }"]
    return lines


def _case_lines(
    problem: Problem, parameter: Sequence[int], k: int, names: dict[int, str]
) -> list[str]:
    model = linear_model(problem, parameter)
    step = discretised_step(model, problem.plant_period_ns / 1e9)
    sight = observation_map(problem, model)
    y = [leaf_name(names[t], path) for t, path in driven_leaves(problem)]
    n = len(problem.states)
    lines = [f"      let known = begun && followed == {k};"]
    for i in range(n):
        lines += _state_lines(i, step.phi[i], step.gamma[i], float(step.c[i]), float(step.reach[i]))
        if np.isfinite(sight.error[i]):
            row = sight.inverse[i]
            centre = _sum_code([(row[j], y[j]) for j in range(len(y))], -float(row @ model.offset))
            error = float(sight.error[i]) * (1 + ROUNDING) + ROUNDING * (
                1 + abs(float(row @ model.offset))
            )
            lines += [
                f"      let at{i} = {centre};",
                f"      let least{i} = at{i} - {_number_code(error)};",
                f"      let most{i} = at{i} + {_number_code(error)};",
            ]
        else:
            lines += [f"      let least{i} = from{i};", f"      let most{i} = to{i};"]
    lines.append("      if known && seen {")
    for i, leaf in enumerate(problem.quantities.states):
        word = "if" if i == 0 else "} elseif"
        lines += [
            f"        {word} max(from{i}, least{i}) > min(to{i}, most{i}) {{",
            f"          cause = ModelCause.{_cause_name(leaf.name)};",
            "          alarmed = true;",
        ]
    lines += ["        }", "      }"]
    for i in range(n):
        lines += [
            f"      low[{i}] = {_interval_end_code(f'from{i}', f'least{i}', 'max')};",
            f"      high[{i}] = {_interval_end_code(f'to{i}', f'most{i}', 'min')};",
        ]
    lines += ["      begun = seen || known;", f"      followed = {k};"]
    return lines


def _interval_end_code(predicted: str, seen: str, meet: str) -> str:
    """The code of an end of an interval after a step: the tighter end, or `seen` after an alarm."""
    return f"!seen ? {predicted} : known && !alarmed ? {meet}({predicted}, {seen}) : {seen}"


def _state_lines(i: int, phi: Floats, gamma: Floats, c: float, reach: float) -> list[str]:
    """The code of `from` and `to`: the ends of a state's interval one period later."""

    def end_code(upper: bool) -> str:
        terms = []
        for j, f in enumerate(phi):
            terms.append((float(f), f"{'high' if (f > 0) == upper else 'low'}[{j}]"))
        terms += [(float(g), f"acts[{j}]") for j, g in enumerate(gamma)]
        margin = reach * (1 + ROUNDING) + ROUNDING * (1 + abs(c))
        return _sum_code(terms, c + (margin if upper else -margin))

    return [f"      let from{i} = {end_code(False)};", f"      let to{i} = {end_code(True)};"]


def _number_code(x: float) -> str:
    text = repr(float(x))
    return f"({text})" if x < 0 else text


def _sum_code(terms: list[tuple[float, str]], constant: float) -> str:
    parts = [name if f == 1.0 else f"{_number_code(float(f))} * {name}" for f, name in terms if f]
    parts.append(_number_code(constant))
    return " + ".join(parts)


# ---------------------------------------------------------------- parameters


def write_monitor(
    system: System,
    module: Module,
    program: str,
    target: Path,
    *,
    alarm: str | None,
    params: Mapping[str, object] | None,
) -> Path:
    """Writes the monitor as a trusted node that imports `program`; gives the path `target`.

    `alarm` is a bool topic of the program; `params` are the parameters of the system.

    Raises SoterError U001 if such a monitor cannot be written, R... if the program does not
    determine the problem, D006 if the file cannot be written, N001 or T... for a wrong `alarm`.
    """
    problem = problem_of_sets(system, module)
    names = {
        i: n if "." in n else f"watched.{n}"
        for i, n in flying_topic_names(system, module, problem).items()
    }
    imported = os.path.relpath(program, target.parent or ".")
    topic = None if alarm is None else f"watched.{alarm}"
    record = origin_line(system, module.name, problem, params)
    text = monitor_source(problem, imported, names, topic, record)
    found = check_file(str(target), text).diagnostics.items  # M005: its topics lack a driver
    if wrong := [d for d in found if d.severity is Severity.ERROR and d.code != "M005"]:
        raise SoterError(tuple(wrong))
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        message = f"cannot write `{target}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error
    return target
