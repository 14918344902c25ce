"""The files that callers name: programs as text, logs, reports and pages.

Purpose: read and lay out a source file; say before a run what could not be written after it; write
sequences and advice, with every failure as a diagnostic.
Non-goals: what stands in a log or on a page (`report/`).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.arguments import require_utf8
from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, SoterError
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.explore.results import TestResult
    from soter.report.plain_page import PageSection
    from soter.report.sequence.view import SequenceView
    from soter.simulate.outputs.to_log import RunLog
    from soter.verify.period_sweep import Advice


def read_text(path: str) -> str:
    """The text of a source file; `SoterError` D001, D005 where there is none."""
    from soter.language.load.loader import read_text as read  # noqa: PLC0415 - shadows this one

    diagnostics = Diagnostics()
    text = read(Path(path), path, diagnostics)
    if text is None:
        raise SoterError(diagnostics.items)
    return text


def format_text(name: str, text: str) -> str:
    """A program's text, well laid out; `SoterError` where it does not parse."""
    from soter.diagnostics.source import Source  # noqa: PLC0415 - see `soter.api`
    from soter.language.syntax.printer import format_source  # noqa: PLC0415 - see `soter.api`

    diagnostics = Diagnostics()
    formatted = format_source(Source(name, text), diagnostics)
    if formatted is None:
        raise SoterError(diagnostics.items)
    return formatted


def require_writers(log: str | Path | None, report: str | Path | None) -> None:
    """Say before a run, not after it, that its log cannot be written."""
    if log is not None:
        from soter.report.run_log import require_log_package  # noqa: PLC0415 - an extra

        require_log_package()
    if report is not None:
        from soter.simulate.outputs.to_report import require_report_package  # noqa: PLC0415 - an extra

        require_report_package()
    for path in (log, report):
        if path is not None:
            require_writable(Path(path))


def run_log(log: str | Path | RunLog | None) -> RunLog | None:
    """What writes the log of a run while it goes on; `SoterError` D007."""
    if not isinstance(log, (str, Path)):
        return log
    from soter.simulate.outputs.to_log import RunLog  # noqa: PLC0415 - an extra

    return RunLog(Path(log), VERSION)


def require_writable(path: Path) -> None:
    """D006 where a log or a report cannot be written there or replaces something else; U003."""
    require_utf8(path)
    require_no_certificate(path)
    reason = ""
    if path.is_dir():
        reason = "it is a folder"
    else:
        folder = path.absolute().parent
        while not folder.exists():
            folder = folder.parent
        if not folder.is_dir():
            reason = f"`{folder}` is no folder"
        elif not os.access(path if path.exists() else folder, os.W_OK):
            reason = "permission denied"
        elif path.is_file() and not _made_by_a_run(path):
            reason = "it holds something else, which would be lost"
    if reason:
        raise SoterError((Diagnostic("D006", f"cannot write `{path}`: {reason}"),))


def require_no_certificate(path: Path, cert: Path | None = None) -> None:
    """D006 where a file would lie in a certificate, or in what is to be `cert`: it breaks it."""
    for folder in path.resolve().parents:
        sealed = (folder / "SEAL").is_file() and (folder / "manifest.json").is_file()
        if sealed or (cert is not None and folder == cert.resolve()):
            problem = f"cannot write `{path}`: a certificate with a file more is rejected"
            raise SoterError((Diagnostic("D006", problem),))


def _made_by_a_run(path: Path) -> bool:
    """Whether a file is a log or a report, so that a new one may take its place."""
    with path.open("rb") as stream:
        start = stream.read(64).lstrip().lower()
    return not start or start.startswith((b"\x89mcap", b"<!doctype html"))


def write_advice(advice: Sequence[Advice], program: str, path: Path) -> None:
    """The figure of every module of a program; `SoterError` D006 where it cannot be written."""
    from soter.report.errors import ReportError  # noqa: PLC0415 - the same
    from soter.report.html import write_document  # noqa: PLC0415 - the same
    from soter.report.proof.advice import advice_main  # noqa: PLC0415 - only then

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_document("soter advise", advice_main([a.page(program) for a in advice]), path)
    except (OSError, ReportError) as error:
        raise SoterError((Diagnostic("D006", f"cannot write `{path}`: {error}"),)) from error


def write_sections(
    path: Path, title: str, headline: str, verdict: str, sections: Sequence[PageSection]
) -> None:
    """A page of sentences and tables, as `sections_main` takes them; `SoterError` D006."""
    from soter.report.errors import ReportError  # noqa: PLC0415 - the same
    from soter.report.html import write_document  # noqa: PLC0415 - the same
    from soter.report.plain_page import sections_main  # noqa: PLC0415 - only then

    try:
        write_document(title, "\n".join(sections_main(title, headline, verdict, sections)), path)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error


def write_test_page(result: TestResult) -> Path:
    """The sequence page of a violated test, beside its trace."""
    from soter.explore.trace_view import view_of  # noqa: PLC0415 - see `soter.api`

    assert result.replayed is not None
    assert result.trace is not None
    provenance = {"trace": str(result.trace)}
    view = view_of(result.replayed, VERSION, provenance)
    path = result.trace.with_name(result.trace.name.removesuffix(".trace.json") + ".html")
    result.page = write_sequence(view, path, "html")
    return result.page


def write_sequence(view: SequenceView, path: Path, kind: str) -> Path:
    """`SoterError` D006 where it cannot be written, D007 where a package is missing."""
    from soter.report.errors import LogError, LogUnavailableError, ReportError  # noqa: PLC0415 - see `soter.api`

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if kind == "html":
            from soter.report.sequence.page import write_page  # noqa: PLC0415 - only then

            return write_page(view, path)
        from soter.report.sequence.trace_to_mcap import write_log  # noqa: PLC0415 - an extra

        return write_log(view, path)
    except LogUnavailableError as error:
        raise SoterError((Diagnostic("D007", str(error)),)) from error
    except (OSError, ReportError, LogError) as error:
        raise SoterError((Diagnostic("D006", f"cannot write `{path}`: {error}"),)) from error
