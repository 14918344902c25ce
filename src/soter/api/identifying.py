"""Fits open parameters of a program to logs: `identify` does what `soter identify` does.

Purpose: reads logs as `soter monitor` does, cuts them into episodes, says which parameters are
open, and has them fitted (`monitor/identification.py`); writes the fit as a data file of programs,
and as a page, with the lines that a program reads it by.
Non-goals: the fit; judging logs (`api/monitoring.py`).
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.api.arguments import chosen_modules, read_params, time_ns
from soter.api.monitoring import mapped_record
from soter.api.output_files import may_replace, require_utf8, require_writable, write_sections
from soter.diagnostics.diagnostic import mistake
from soter.language.load.identified_data import IDENTIFIED
from soter.language.model.typed import Literal
from soter.language.model.types import FloatType
from soter.mapping.read_mapping import read_mapping, system_name
from soter.monitor.identification import (
    Episode,
    Identification,
    OpenParameter,
    identified_parameters,
    open_parameters,
)
from soter.report.html import write_text
from soter.report.templates import PageSection
from soter.simulate.run_log import RecordedRun, read_log
from soter.verify.problem.extract import problem_of_sets

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.api import Program
    from soter.language.model.system import System
    from soter.monitor.identification import Posed

BEGINS = '{\n  "$comment": "soter identify'
ALIKE = (
    "That new episodes are drawn as the held-out ones were is an assumption: another place, season "
    "or load is another draw. `soter monitor` watches it, and its node does so in flight."
)
NOT_EXPLAINED = (
    "No values in the declared ranges do. Look first at the rate of the state that is named: its "
    "terms, signs and units. Then at the ranges in the program: widen those of which you would "
    "believe more."
)
TOGETHER = (
    "Pieces of one log hang together: what is one draw here is less than a flight of its own, and "
    "the rate is that of pieces of these logs."
)


def identify(
    program: Program,
    logs: Sequence[str | Path],
    mapping: str | Path | Mapping[str, Any] | None = None,
    *,
    opened: Sequence[str] = (),
    episode: float | str | None = None,
    module: str | None = None,
    system: str | None = None,
    estimates: bool = False,
    params: Mapping[str, object] | None = None,
) -> Identification:
    """Fits parameters to logs of `soter run --log`, or by a mapping to those of another system.

    `opened`: names of parameters; by default all in the main file that the plants of a proof or
    their bounds or errors depend on. `episode`: the length in s into which each log is cut; uncut
    by default. `estimates` and errors are as in `Program.monitor` and `log_explained`. Raises
    SoterError U001 or U004 if something cannot be fitted, D007 without SciPy.
    """
    require_utf8(mapping, *logs)
    fixed = params or {}
    if mapping is not None and system is None:
        content = read_mapping(Path(mapping)) if isinstance(mapping, (str, Path)) else mapping
        system = system_name(content)

    def pose(values: Mapping[str, float]) -> Posed:
        flat = program.declared(system, {**fixed, **values})
        return [(flat, m, problem_of_sets(flat, m)) for m in chosen_modules(flat, module)]

    flat = program.declared(system, fixed)
    declared = _asked_parameters(flat, opened, fixed)
    parameters = open_parameters(pose, declared, named=bool(opened))
    how: dict[str, Any] = {"module": module, "system": system, "params": fixed}
    records = [
        read_log(Path(log), flat) if mapping is None else _mapped_run(program, log, mapping, how)
        for log in logs
    ]
    hashes = {str(log): _log_sha256(Path(log)) for log in logs}
    if len({*hashes.values()}) < len(logs):
        raise mistake("U001", "a log is given twice: one half of it would hold out the other")
    cut_ns = time_ns("episode", episode)
    episodes = [
        e for log, r in zip(logs, records, strict=True) for e in cut_episodes(str(log), r, cut_ns)
    ]
    if len(episodes) < 2:
        text = f"{len(episodes)} episode is too few: every second one is held out"
        raise mistake("U001", text, "give more logs, or cut this one: --episode 10s")
    found = identified_parameters(
        pose,
        parameters,
        episodes,
        estimates=estimates or mapping is not None,
        truths=mapping is None,
    )
    return replace(
        found,
        cut_s=None if cut_ns is None else cut_ns / 1e9,
        logs=hashes,
        program_sha256=program.sha256 or "",
    )


def _mapped_run(
    program: Program, log: str | Path, mapping: str | Path | Mapping[str, Any], how: dict[str, Any]
) -> RecordedRun:
    found = mapped_record(program.declared, log, mapping, **how)
    for m, p in found.problems:
        for name, at_s in found.commands_outside(m, p):
            text = f"{log}: {name} is outside of its set at {at_s:.3f} s, which no bound explains"
            raise mistake("U001", text, "declare what the log has, or say `clip` in the mapping")
    return found.record


def _asked_parameters(
    flat: System, opened: Sequence[str], fixed: Mapping[str, object]
) -> list[OpenParameter]:
    """The requested parameters, or each float of the main file that has no fixed value."""
    declared = flat.program.params
    floats = [n for n, p in declared.items() if "." not in n and isinstance(p.type, FloatType)]
    read_params(flat.program, {n: flat.params.get(n, 0.0) for n in opened})  # U004
    wrong = next((n for n in opened if n not in floats), None)
    if wrong is not None:
        raise mistake("U001", f"`{wrong}` is no parameter of type float of the main file")
    found = []
    for name in opened or [n for n in floats if n not in fixed]:
        low, high = declared[name].low, declared[name].high
        ends = [float(e.value) for e in (low, high) if isinstance(e, Literal)]
        least, most = ends if len(ends) == 2 else (-inf, inf)
        found.append(OpenParameter(name, float(flat.params[name]), least, most))
    return found


def cut_episodes(name: str, record: RecordedRun, cut_ns: int | None) -> list[Episode]:
    """A record cut into episodes; neighbours share an instant so that no step is lost."""
    if cut_ns is None:
        return [Episode(name, record)]
    times, first, episodes = record.times_ns, 0, list[Episode]()
    for last in range(len(times)):
        if times[last] - times[first] < cut_ns:
            continue
        part = slice(first, last + 1)
        piece = RecordedRun(
            times[part],
            record.topics[part],
            record.truths[part],
            record.published[part],
            record.topics[first - 1] if first else None,
        )
        at_s = (times[first] - times[0]) / 1e9
        episodes.append(Episode(f"{name} from {at_s:g} s", piece))
        first = last
    return episodes


def _log_sha256(log: Path) -> str:
    files = sorted(p for p in log.rglob("*") if p.is_file()) if log.is_dir() else [log]
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while chunk := stream.read(1 << 20):
                digest.update(chunk)
    return digest.hexdigest()


# ---------------------------------------------------------------- what is written


def require_replaceable(path: Path) -> None:
    """Raises SoterError D006 if a fit would replace a file that is not an older fit."""
    require_utf8(path)
    if path.is_file() and not may_replace(path, BEGINS.encode()):
        text = f"cannot write `{path}`: it holds something else, which would be lost"
        raise mistake("D006", text)


def write_fit(found: Identification, path: Path) -> None:
    """Writes the fitted values as a data file for programs. Raises SoterError D006."""
    require_replaceable(path)
    facts = {
        "held_out": found.held_out,
        "rate": found.rate,
        "episodes": found.episodes,
        "cut_s": found.cut_s,
        "factor": found.factor,
        "kept": found.kept,
        "never_excited": found.never_excited,
        "logs": found.logs,
        "program_sha256": found.program_sha256,
    }
    comment = "soter identify wrote this: values that explain logs, nothing that is proved"
    document = {"$comment": comment, IDENTIFIED: facts, **found.values}
    write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", path)


def fit_headline(found: Identification) -> str:
    """A sentence that says how the fit ended."""
    if found.alarm is not None:
        a, n = found.alarm, found.alarms
        return (
            f"Nothing that the program permits explains {n} of {found.episodes} episodes: in "
            f"{a.episode} {', '.join(a.states)} of {a.module} at {a.at_s:.3f} s first"
        )
    return (
        f"Every step of {found.episodes} episodes is explained; of {found.held_out} held-out ones "
        f"a new one drawn alike leaves with at most 1/{found.held_out + 1} ({found.rate:.2%})"
    )


def fit_sections(found: Identification, name: str) -> list[PageSection]:
    """The sections about a fit for a page or terminal; `name` is the path of the data file."""
    explained = found.alarm is None
    texts = [ALIKE] + [TOGETHER] * (found.cut_s is not None) if explained else [NOT_EXPLAINED]
    if found.never_excited:
        texts.append(f"never excited: {', '.join(found.never_excited)}")
    if found.kept and explained:
        texts.append(f"not shown by these logs, so they stay as declared: {', '.join(found.kept)}")
    if found.judged_share < 1:
        texts.append(f"of one episode only {found.judged_share:.1%} of the time is judged")
    values = {n: f"{v:.6g}" for n, v in found.values.items()}
    kinds = {n: "bound" if n in found.bounds else "model" for n in found.declared}
    rows = [
        (n, kinds[n], f"{was:.6g}", values.get(n, "not shown" if explained else "not fitted"))
        for n, was in found.declared.items()
    ]
    inputs = [(n, f"{share:.1%}") for n, share in found.excitation.items()]
    fields = ", ".join(f"{n}: float" for n in values)
    lines = [f"type Fit = {{ {fields} }};", f'const FIT: Fit = data "{name}";']
    lines += [
        f"param {n}: float = FIT.{n}{_range_text(found, n)};  // {v}" for n, v in values.items()
    ]
    return [
        PageSection("Values", tuple(texts), ("parameter", "", "declared", "fitted"), tuple(rows)),
        PageSection("Inputs", (), ("input", "share of its set that was seen"), tuple(inputs)),
        PageSection("Lines for the program", tuple(lines) if explained else ()),
    ]


def _range_text(found: Identification, name: str) -> str:
    ends = found.ranges.get(name, (-inf, inf))
    return f" in [{ends[0]}, {ends[1]}]" if max(map(abs, ends)) < inf else ""


def data_path(program: str | Path, output: str | Path) -> str:
    """The path of the data file as the program names it, relative to the program's folder."""
    return Path(os.path.relpath(output, Path(program).parent)).as_posix()


def write_page(found: Identification, title: str, name: str, path: Path) -> None:
    """Writes the page about a fit. Raises SoterError D006 if that fails."""
    require_writable(path)
    logs = PageSection("Logs", (), ("log", "SHA-256"), tuple(found.logs.items()))
    verdict = "bad" if found.alarm is not None else "good"
    write_sections(path, title, fit_headline(found), verdict, [*fit_sections(found, name), logs])
