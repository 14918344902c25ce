"""Checks and converts what callers give: times, parameters, modules, and paths of files.

Purpose: turns times, parameters of traces and names of modules into the values that other packages
take, with a diagnostic for wrong ones; computes `ttf` and `safer` of modules that have neither. It
reads and formats sources, refuses before a run what could not be written after it, and writes
traces and advice, with every failure as a diagnostic.
Non-goals: bindings and `params` of runs (`simulate/`), options of searches
(`explore/search_options.py`); what stands in a log or on a page (`report/`).
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from soter.addons import by_name
from soter.diagnostics.diagnostic import Diagnostics, SoterError, Source, mistake
from soter.diagnostics.system_texts import utf8_text
from soter.language.load.loader import read_text as read_source
from soter.language.model.types import WrongTextError, duration_ns
from soter.language.model.values import ValueShapeError, from_json, to_json
from soter.language.syntax.printer import format_source
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from soter.explore.replay import Replayed
    from soter.explore.results import TestResult
    from soter.language.front_end import CheckResult
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedProgram
    from soter.language.model.types import Value
    from soter.report.sequence_view import SequenceView
    from soter.report.templates import PageSection
    from soter.simulate.run_log import RunLog
    from soter.verify.deploy.missing_predicates import Known
    from soter.verify.period_advice import Advice

    Progress = Callable[[float], None]
    Tell = Callable[[str], None]


def require_utf8(*names: object) -> None:
    """Raises `SoterError` U003 for a path that is not UTF-8, the current folder apart."""
    here = ""
    with suppress(OSError):
        here = str(Path.cwd() / "_")[:-1]
    for name in names:
        if not isinstance(name, (str, Path)):
            continue
        path = str(name).removeprefix(here)
        if (shown := utf8_text(path)) != path:
            text = f"`{shown}` is not UTF-8, which everything that soter writes is"
            raise mistake("U003", text, "rename it")


def time_ns(name: str, time: float | str | None) -> int | None:
    """The time that a caller gave as `name`, in ns; None if none; `SoterError` U001."""
    if time is None:
        return None
    try:
        return duration_ns(time)
    except WrongTextError as error:
        raise mistake("U001", f"`{name}` cannot be `{str(time)[:40]}`: {error}") from error


def end_ns(system: System, until: float | str | None) -> int:
    """The end of a run in ns, by `until` or by the system; `SoterError` U001 if neither says it."""
    from soter.simulate.run_options import until_ns  # noqa: PLC0415 - see `soter.api`

    if until is not None:
        return until_ns(until)
    if system.until_ns is None:
        raise mistake(
            "U001",
            f"system `{system.name}` does not say how long it runs",
            "say it: --until 30s, or `until 30s;` in the system",
        )
    return system.until_ns


def chosen_modules(flat: System, module: str | None) -> list[Module]:
    """The modules with this full or declared name, or all; `SoterError` U001 if there are none."""
    modules = [m for m in flat.modules if module is None or module in (m.name, m.symbol.name)]
    if not modules:
        names = ", ".join(f"`{m.name}`" for m in flat.modules) or "none"
        message = f"system `{flat.name}` has no module" + f" `{module}`" * bool(module)
        raise mistake("U001", message, notes=(f"there are: {names}",))
    return modules


def add_stale_monitors(checked: CheckResult) -> None:
    """Adds D022 for each model monitor in a sound program that is made for another model."""
    if not checked.ok or checked.loaded is None:
        return
    if any("soter monitor --emit" in file.source.text for file in checked.loaded.files):
        for wrong in by_name("soter.monitor.emitted_monitors").stale_monitors(checked):
            checked.diagnostics.add(wrong)


def given_params(program: TypedProgram, params: Mapping[str, object] | None) -> dict[str, Value]:
    """The values of parameters that a caller gave, by full name; `SoterError` U001, U004."""
    if not params:
        return {}
    from soter.simulate.run_options import param_values  # noqa: PLC0415 - see `soter.api`

    return param_values(program, params)


def params_as_json(program: TypedProgram, values: Mapping[str, Value]) -> dict[str, object]:
    """Parameter values as JSON for a trace, durations in ns."""
    params: dict[str, object] = {}
    for name, value in values.items():
        param = program.param(name)
        assert param is not None
        params[name] = to_json(param.type, value)
    return params


def params_from_json(
    program: TypedProgram, values: Mapping[str, object], file: Path
) -> dict[str, Value]:
    """Parameter values from the JSON of a trace; `SoterError` D010."""
    from soter.explore.trace import no_trace_error  # noqa: PLC0415 - see `soter.api`

    params: dict[str, Value] = {}
    for name, value in values.items():
        param = program.param(name)
        if param is None:
            raise no_trace_error(file, f"its program has no parameter `{name}`")
        try:
            params[name] = from_json(param.type, value, name)
        except ValueShapeError as error:
            raise no_trace_error(file, f"a parameter: {error}") from error
    return params


def compute_ttf(
    system: System, known: Known | None = None, bound: Mapping[str, object] | None = None
) -> list[str]:
    """Computes `ttf` and `safer` for modules that have neither; returns a note on each.

    `known`: as `soter.verify.deploy.missing_predicates.complete` takes it. `bound`: what externs
    are bound to, if all of them will be called; missing files are reported before the work.
    """
    if all(m.symbol.ttf is not None for m in system.modules):
        return []
    if bound is not None:
        from soter.native.extern_bindings import bind  # noqa: PLC0415 - see `soter.api`
        from soter.simulate.externs.callables import require_files  # noqa: PLC0415 - the same

        require_files(bind(system, bound))
    from soter.verify.deploy.missing_predicates import complete as compute  # noqa: PLC0415 - needs NumPy

    return compute(system, known)


def read_text(path: str) -> str:
    """The text of a source file; `SoterError` D001, D005 if it cannot be read."""
    diagnostics = Diagnostics()
    text = read_source(Path(path), path, diagnostics)
    if text is None:
        raise SoterError(diagnostics.items)
    return text


def format_text(name: str, text: str) -> str:
    """A program's text in the standard layout; `SoterError` if it does not parse."""
    diagnostics = Diagnostics()
    formatted = format_source(Source(name, text), diagnostics)
    if formatted is None:
        raise SoterError(diagnostics.items)
    return formatted


def require_writers(log: str | Path | None, report: str | Path | None) -> None:
    """Raises SoterError before a run if its log or report could not be written after it."""
    if log is not None:
        from soter.report.mcap_reading import require_log_package  # noqa: PLC0415 - an extra

        require_log_package()
    if report is not None:
        from soter.report.html import require_report_package  # noqa: PLC0415 - an extra

        require_report_package()
    for path in (log, report):
        if path is not None:
            require_writable(Path(path))


def opened_run_log(log: str | Path | RunLog | None) -> RunLog | None:
    """Opens the writer of a run's log; None without a log; `SoterError` D007."""
    if not isinstance(log, (str, Path)):
        return log
    from soter.simulate.run_log import RunLog  # noqa: PLC0415 - an extra

    return RunLog(Path(log), VERSION)


def require_writable(path: Path) -> None:
    """Raises D006 if no log or report can be written at `path` or it would replace another file."""
    require_utf8(path)
    require_no_certificate(path)
    reason, folder = "", next((p for p in path.absolute().parents if p.exists()), path)
    if path.is_dir():
        reason = "it is a folder"
    elif not folder.is_dir():
        reason = f"`{folder}` is no folder"
    elif not os.access(path if path.exists() else folder, os.W_OK):
        reason = "permission denied"
    elif path.is_file() and not may_replace(path, b"\x89mcap", b"<!doctype html"):
        reason = "it holds something else, which would be lost"
    if reason:
        raise mistake("D006", f"cannot write `{path}`: {reason}")


def require_no_certificate(path: Path, cert: Path | None = None) -> None:
    """Raises D006 if a file would lie in a certificate, or in `cert` to come, and break it."""
    for folder in path.resolve().parents:
        sealed = (folder / "SEAL").is_file() and (folder / "manifest.json").is_file()
        if sealed or (cert is not None and folder == cert.resolve()):
            problem = f"cannot write `{path}`: a certificate with a file more is rejected"
            raise mistake("D006", problem)


def may_replace(path: Path, *beginnings: bytes) -> bool:
    """Whether a file is empty or begins as what soter writes there, so that it may be replaced."""
    with path.open("rb") as stream:
        start = stream.read(64).lstrip().lower()
    return not start or start.startswith(beginnings)


def write_advice(advice: Sequence[Advice], program: str, path: Path) -> None:
    """Writes a page with the figure of each module; `SoterError` D006 if it cannot be written."""
    from soter.report.html import write_document  # noqa: PLC0415 - see `soter.api`
    from soter.report.proof_page import advice_main  # noqa: PLC0415 - only then

    write_document("soter advise", advice_main([a.page(program) for a in advice]), path)


def write_sections(
    path: Path, title: str, headline: str, verdict: str, sections: Sequence[PageSection]
) -> None:
    """Writes a page of sentences and tables, as `sections_main` takes them; `SoterError` D006."""
    from soter.report.html import write_document  # noqa: PLC0415 - see `soter.api`
    from soter.report.templates import sections_main  # noqa: PLC0415 - only then

    write_document(title, sections_main(title, headline, verdict, sections), path)


def write_test_page(result: TestResult) -> Path:
    """Writes the page of a violated test beside its trace, and returns its path."""
    from soter.explore.trace_view import make_sequence_view  # noqa: PLC0415 - see `soter.api`

    assert result.replayed is not None
    assert result.trace is not None
    view = make_sequence_view(result.replayed, VERSION, {"trace": str(result.trace)})
    path = result.trace.with_name(result.trace.name.removesuffix(".trace.json") + ".html")
    result.page = write_trace_page(result.replayed, view, path)
    return result.page


def write_trace_page(replay: Replayed, view: SequenceView, path: Path) -> Path:
    """Writes a trace as a page of runs; `SoterError` D006, and D007 without its package."""
    from soter.explore.trace_page import trace_page  # noqa: PLC0415 - see `soter.api`
    from soter.report.html import write_html  # noqa: PLC0415 - see `soter.api`

    return write_html(trace_page(replay, view), path)
