"""The files that callers name for output: refused before the work, written after it.

Purpose: refuses before a run what could not be written after it; writes pages of traces and advice,
with every failure as a diagnostic.
Non-goals: what stands in a log or on a page (`report/`).
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import mistake
from soter.diagnostics.system_texts import utf8_text
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.explore.replay import Replayed
    from soter.explore.results import TestResult
    from soter.report.sequence_view import SequenceView
    from soter.report.templates import PageSection
    from soter.simulate.run_log import RunLog
    from soter.verify.period_advice import Advice


def require_utf8(*names: object) -> None:
    """Raises U003 if a path is not valid UTF-8; the current folder may be anything."""
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


def require_writers(log: str | Path | None, report: str | Path | None) -> None:
    """Raises SoterError before a run if the log or report could not be written after it."""
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
    """Opens the log of a run, or returns None without a log. Raises D007 if an extra is missing."""
    if not isinstance(log, (str, Path)):
        return log
    from soter.simulate.run_log import RunLog  # noqa: PLC0415 - an extra

    return RunLog(Path(log), VERSION)


def require_writable(path: Path) -> None:
    """Raises D006 if `path` is not writable or holds a file of another kind."""
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
    """Raises D006 if `path` lies in a certificate's folder or in the planned folder `cert`."""
    for folder in path.resolve().parents:
        sealed = (folder / "SEAL").is_file() and (folder / "manifest.json").is_file()
        if sealed or (cert is not None and folder == cert.resolve()):
            problem = f"cannot write `{path}`: a certificate with a file more is rejected"
            raise mistake("D006", problem)


def may_replace(path: Path, *beginnings: bytes) -> bool:
    """Whether a file is empty or begins as Soter's output does, and so may be overwritten."""
    with path.open("rb") as stream:
        start = stream.read(64).lstrip().lower()
    return not start or start.startswith(beginnings)


def write_advice(advice: Sequence[Advice], program: str, path: Path) -> None:
    """Writes a page with a plot for each module. Raises SoterError D006 if that fails."""
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
    """Writes a trace as a page like that of a run. Raises D006, or D007 without plotly."""
    from soter.explore.trace_page import trace_page  # noqa: PLC0415 - see `soter.api`
    from soter.report.html import write_html  # noqa: PLC0415 - see `soter.api`

    return write_html(trace_page(replay, view), path)
