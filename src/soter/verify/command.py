"""Does what `soter verify` does, without a terminal: proves modules, writes page and certificate.

Purpose: `verify` makes a `VerifyReport` of a checked program, with certificate and page on demand.
`write_certificate` makes the folder for `soter recheck` (docs/verification.md, section 4): it puts
program files, tables and the manifest there, and seals them.
Non-goals: the proofs (`verify_module.py`), printing (`cli/verify.py`); checking a certificate.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.folder import FORMAT, MANIFEST, SEAL, files_of_program
from soter.diagnostics.current_phase import between
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.front_end import system_of
from soter.native.compiler import end_compilers
from soter.verify.chosen_modules import chosen_problems, modules_of
from soter.verify.claims.results import UNDECIDED, ModuleResult, VerifyReport
from soter.verify.deploy.missing_predicates import store_computed_sets
from soter.verify.diagnosis.tried_remedies import enter_cost, mark_untried, remove_tried_advice
from soter.verify.grid.case import notes_on_interruption, verdicts_in_words
from soter.verify.proof_cache import store_verdicts
from soter.verify.scope import coverage_of
from soter.verify.verify_module import module_method

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value
    from soter.verify.claims.results import ProofSearch
    from soter.verify.induction.prove_or_refute import Search
    from soter.verify.problem.problem import Problem


LOOK_S = 0.05
"""Seconds between two looks, after an interruption, whether the compiler has ended."""


def verify(
    checked: CheckResult,
    *,
    module: str | None = None,
    system: str | None = None,
    params: Mapping[str, Value] | None = None,
    cert: Path | None = None,
    refute: bool = True,
    explain: bool | None = None,
    report: Path | None = None,
    written_params: Mapping[str, object] | None = None,
    search: Search | None = None,
    budget_s: float = 0.0,
) -> VerifyReport:
    """Verifies the modules of a checked program; `SoterError` if a problem is not determined.

    `explain`: find out why a claim is not proved, and try changes (None: like `refute`).
    `written_params`: the parameters as the user wrote them, for the report's command line.
    `search`: as for `verify_by_induction`. `budget_s`: the CPU seconds to search for hints for
    modules whose states the program does not bound; the program is then verified with these hints.
    """
    began = time.perf_counter()
    pick: Any = {"module": module, "system": system, "params": params or {}}
    read = checked
    checked, chosen, problems, searches = _problems_with_found_hints(checked, pick, budget_s)
    results = _verify_problems(problems, refute, explain, search, _results_of_proved(searches))
    if budget_s and (refute if explain is None else explain):
        checked, results, further = _results_with_hints(checked, pick, results, searches, budget_s)
        searches += further
        chosen, problems = chosen_problems(checked, **pick) if further else (chosen, problems)
    remove_tried_advice(results, searches)
    assert checked.program is not None
    whole = {flat.name: flat for flat, _ in modules_of(checked, **pick)}
    coverage = coverage_of(checked, chosen, problems, params or {})
    with notes_on_interruption(lambda: verdicts_in_words(*results)):
        for (flat, _), result in zip(chosen, results, strict=True):
            if result.problem.computed:
                store_computed_sets(result)
            enter_cost(result, partial(system_of, checked, flat.name, params, exact=False))
            if find_spec("flint") is not None:
                result.ask_rechecker = partial(_why_not_recheckable, whole[flat.name], result)
    store_verdicts([flat for flat, _ in chosen], results)
    names = list(dict.fromkeys(flat.name for flat, _ in chosen))
    verification = VerifyReport(
        checked.program.path,
        checked.program.sha256,
        ", ".join(names),
        tuple(results),
        time.perf_counter() - began,
        _command_line(checked.program.path, module, system, written_params or {}),
        coverage=coverage,
        places={} if read.program is None else {n: m.span for n, m in read.program.modules.items()},
        contents={} if read.loaded is None else read.loaded.contents,
        searches=searches,
    )
    if cert is not None:
        main = None if checked.loaded is None else checked.loaded.main.source.text
        systems = [flat.name for flat, _ in chosen]
        write_certificate(cert, checked.program, results, systems, main if searches else None)
    if report is not None:
        from soter.verify.proof_report import write_report  # noqa: PLC0415 - only then

        write_report(verification, report)
    verification.page = _page_of_report
    return verification


def _problems_with_found_hints(
    checked: CheckResult, pick: Mapping[str, Any], budget_s: float
) -> tuple[CheckResult, list[tuple[System, Module]], list[Problem], tuple[ProofSearch, ...]]:
    """The program, its modules and problems, and searches for hints where it bounds no states."""
    try:
        return checked, *chosen_problems(checked, **pick), ()
    except SoterError as error:
        if not budget_s or {d.code for d in error.diagnostics} != {"R008"}:
            raise
        from soter.verify.search.searched_program import with_found_hints  # noqa: PLC0415 - rarely

        checked, searches = with_found_hints(checked, pick, budget_s, error)
    return checked, *chosen_problems(checked, **pick), searches


def _results_with_hints(
    checked: CheckResult,
    pick: Mapping[str, Any],
    results: list[ModuleResult],
    searches: Sequence[ProofSearch],
    budget_s: float,
) -> tuple[CheckResult, list[ModuleResult], tuple[ProofSearch, ...]]:
    """The program and the results, with new hints for modules that its own leave undecided."""
    asked = {s.module for s in searches}
    others = [r for r in results if r.name not in asked and r.verdict == UNDECIDED]
    if not others:
        return checked, results, ()
    from soter.verify.search.searched_program import with_better_hints  # noqa: PLC0415 - rarely

    checked, further = with_better_hints(checked, pick, others, budget_s)
    proved = _results_of_proved(further)
    return checked, [proved.get(r.name, r) for r in results], further


def _results_of_proved(searches: Sequence[ProofSearch]) -> dict[str, ModuleResult]:
    """The results of the searches that proved their modules, by module name."""
    return {s.module: s.result for s in searches if s.proved and s.result is not None}


def _why_not_recheckable(flat: System, result: ModuleResult) -> str:
    """Why the re-checker cannot check a module of that system; "" if it can."""
    from soter.certificate.extras.trial import why_not_recheckable  # noqa: PLC0415 - an extra

    files: dict[str, bytes] = {}
    entry = module_method(result.problem).entry(result, flat.name, "sets/0", files)
    return why_not_recheckable(flat, entry, files)


def _verify_problems(
    problems: Sequence[Problem],
    refute: bool,
    explain: bool | None,
    search: Search | None,
    known: Mapping[str, ModuleResult],
) -> list[ModuleResult]:
    """Verifies one problem after the other, while the C of the next ones is compiled in order.

    Nothing in this process forks meanwhile, because refuting runs call no externs. `known`: results
    of modules that a search has already proved, by name.
    """
    results = []
    methods = [module_method(p) for p in problems]
    beside = ThreadPoolExecutor(1)
    needed = [
        None if m.compiled is None or p.name in known else beside.submit(m.compiled, p)
        for m, p in zip(methods, problems, strict=True)
    ]
    try:
        for i, (problem, job) in enumerate(zip(problems, needed, strict=True)):
            if (proved := known.get(problem.name)) is not None:
                results.append(proved)
                continue
            with between(i / len(problems), (i + 1) / len(problems)):
                attacked = refute and _may_be_attacked(problem)
                result = methods[i].verify(
                    problem,
                    refute=attacked,
                    explain=attacked if explain is None else explain,
                    search=search,
                    compiled=None if job is None else job.result(),
                )
            results.append(mark_untried(result))
    except KeyboardInterrupt as stopped:
        _note_settled_claims(stopped, results, problems[len(results) :])
        beside.shutdown(wait=False, cancel_futures=True)
        while not all(job is None or job.done() for job in needed):
            end_compilers()
            time.sleep(LOOK_S)
        raise
    finally:
        beside.shutdown(cancel_futures=True)
    return results


def _note_settled_claims(
    stopped: KeyboardInterrupt, results: Sequence[ModuleResult], open_: Sequence[Problem]
) -> None:
    """Adds the verdicts so far to an interruption's notes; a running case has added its own."""
    later = [f"{p.name}: no claim settled" for p in open_]
    vars(stopped)["__notes__"] = [
        *verdicts_in_words(*results),
        *getattr(stopped, "__notes__", later[:1]),
        *later[1:],
    ]


def _may_be_attacked(problem: Problem) -> bool:
    """Whether a run of the problem's system that leaves C would also be a run of the vehicle.

    It would not in a view, nor where others may move the plant by any value.
    """
    return not (problem.view or problem.influences)


def _page_of_report(report: VerifyReport) -> str:
    from soter.verify.proof_report import page_text  # noqa: PLC0415 - only then

    return page_text(report)


def _command_line(
    path: str, module: str | None, system: str | None, parameters: Mapping[str, object]
) -> str:
    words = ["soter", "verify", path]
    words += ["--module", module] if module else []
    words += ["--system", system] if system else []
    for name, value in parameters.items():
        words += ["--set", f"{name}={str(value).lower() if isinstance(value, bool) else value}"]
    return shlex.join(words)


def write_certificate(
    folder: Path,
    program: TypedProgram,
    results: Sequence[ModuleResult],
    systems: Sequence[str],
    main_text: str | None = None,
) -> None:
    """Writes the certificate of `results`, each of a module in the system of that name.

    `main_text`: the text of the main file, if it differs from the file. An old certificate in the
    folder is replaced. Raises `SoterError` D008 if the folder has other files, D006 if writing
    fails.
    """
    files = dict(_program_files(program))
    main = _main_file(program, files)
    if main_text is not None:
        files[f"program/{main}"] = main_text.encode()
    modules, assumed = [], [a for result in results for a in result.assumptions]
    for k, (result, system) in enumerate(zip(results, systems, strict=True)):
        entry = module_method(result.problem).entry
        modules.append(entry(result, system, f"sets/{k}", files))
    manifest = {
        "schema": FORMAT,
        "files": {name: hashlib.sha256(data).hexdigest() for name, data in files.items()},
        "main": main,
        "params": _parameter_entries(results),
        "program_sha256": program.sha256,
        "modules": modules,
        "assumptions": list({a.text: (a.key, a.text) for a in assumed}.values()),
    }
    text = json.dumps(manifest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    raw = (text + "\n").encode()
    files[MANIFEST] = raw
    files[SEAL] = (hashlib.sha256(raw).hexdigest() + "\n").encode()
    _replace_folder(folder, files)


def _program_files(program: TypedProgram) -> Iterator[tuple[str, bytes]]:
    """Yields the program's files, with paths relative to the deepest folder that holds them all."""
    paths = list(dict.fromkeys(p.resolve() for p in files_of_program(program.path)))
    root = Path(os.path.commonpath([p.parent for p in paths]))
    for path in paths:
        yield f"program/{path.relative_to(root).as_posix()}", path.read_bytes()


def _main_file(program: TypedProgram, files: dict[str, bytes]) -> str:
    """The path of the program's main file, which is the first of `files`."""
    name = next(iter(files)).removeprefix("program/")
    assert name.endswith(Path(program.path).name)
    return name


def _parameter_entries(results: Sequence[ModuleResult]) -> dict[str, object]:
    """The values of the parameters by name, with floats as C99 hexadecimal texts.

    Parameters that differ between systems are left out, because each system sets them (`set`).
    """
    values: dict[str, Value] = {}
    differ: set[str] = set()
    for result in results:
        for name, value in result.problem.system.params.items():
            if repr(values.setdefault(name, value)) != repr(value):
                differ.add(name)
    for name in differ:
        del values[name]
    return {n: v.hex() if isinstance(v, float) else v for n, v in values.items()}


def _replace_folder(folder: Path, files: dict[str, bytes]) -> None:
    """Replaces an old certificate in the folder, but never removes other files."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        old = [p for p in folder.rglob("*") if not p.is_dir() or p.is_symlink()]
        names = {p.relative_to(folder).as_posix() for p in old}
        strange = {n for n in names if n.split("/")[0] not in ("program", "sets", MANIFEST, SEAL)}
        if strange or (names and MANIFEST not in names):
            message = (
                f"`{folder}` holds `{min(strange or names)}`, which is no part of a certificate"
            )
            helps = ("name a new or empty folder",)
            raise SoterError((Diagnostic("D008", message, helps=helps),))
        for path in old:
            path.unlink()
        for path in sorted(folder.rglob("*"), reverse=True):
            path.rmdir()
        for name, data in files.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
    except OSError as error:
        why = reason(error)
        problem = Diagnostic("D006", f"cannot write the certificate `{folder}`: {why}")
        raise SoterError((problem,)) from None
