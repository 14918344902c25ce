"""Counterexamples of a verification as files, and a file run again.

Purpose: `.soter/<program>-<module>.counterexample.json` for every refutation of a report
(docs/json.md), and from such a file back to the verification system and the interpreter.
Non-goals: what a counterexample is (`counterexample.py`); choices of order (`explore/`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.front_end import check_file, system_to_prove
from soter.verify.attack.counterexample import (
    LEAVES,
    Counterexample,
    read_counterexample,
    replay,
    write_counterexample,
)
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from soter.verify.attack.counterexample import Replay
    from soter.verify.claims.results import ModuleResult, VerifyReport

FOLDER = Path(".soter")


class AnotherVersionError(ValueError):
    """A counterexample of a program that has changed since."""


def save_runs(report: VerifyReport, folder: Path = FOLDER) -> None:
    """Write every counterexample; its finding says where. SoterError D006."""
    for module in report.modules:
        for name, finding in module.findings.items():
            run = finding.counterexample
            if isinstance(run, Counterexample):
                kind = "" if run.shows == LEAVES else f"-{name}"
                stem = f"{Path(report.path).stem}-{module.name}{kind}"
                path = folder / f"{stem}.counterexample.json"
                _write(replace(run, facts=_facts(report, module)), path)
                finding.saved = path


def _facts(report: VerifyReport, module: ModuleResult) -> dict[str, object]:
    params = module.problem.system.params
    return {
        "program": report.path,
        "program_sha256": report.program_sha256,
        "system": report.system,
        "instance": module.name,
        "params": dict(params),
    }


def _write(run: Counterexample, path: Path) -> None:
    try:
        write_counterexample(run, path)
    except OSError as error:
        message = f"cannot write `{path}`: {reason(error)}"
        raise SoterError((Diagnostic("D006", message),)) from error


def replay_file(path: Path) -> Replay | None:
    """Run a counterexample again in the interpreter; None where it does not show what it says.

    ValueError where the file is none, AnotherVersionError where it belongs to another text of the
    program. SoterError where the program cannot be read or has no such module any more.
    """
    run = read_counterexample(path)
    facts = run.facts
    named = _program(path, str(facts.get("program", "")))
    checked = check_file(named)
    if not checked.begins:
        raise AnotherVersionError(f"`{path}` belongs to another version of `{named}`")
    if not checked.ok or checked.program is None:
        raise SoterError(checked.diagnostics.items)
    if checked.program.sha256 != facts.get("program_sha256"):
        raise AnotherVersionError(
            f"`{path}` belongs to another version of `{checked.program.path}`"
        )
    for name in str(facts.get("system", "")).split(", "):
        flat = system_to_prove(checked, name or None, facts.get("params") or {})
        for module in flat.modules:
            if module.name == facts.get("instance"):
                return replay(run, extract(flat, module).system)
    return None


def _program(path: Path, named: str) -> str:
    """Where the program of a counterexample lies: as it was named, or beside the file's folder."""
    if not Path(named).is_file():
        for folder in (path.resolve().parent.parent, path.resolve().parent):
            if (folder / named).is_file():
                return str(folder / named)
    return named
