"""The file of `soter test --junit`: verdicts, or why there are none.

Purpose: whatever ends a command that was understood, the file says it; nothing old stays there.
Non-goals: the XML (`explore/junit.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from soter.cli.terminal.console import Console
    from soter.explore.results import ExploreReport


def report_as_junit(report: ExploreReport, path: str, console: Console) -> None:
    """Write the verdicts; `SoterError` D006."""
    from soter.explore.junit import write  # noqa: PLC0415 - only then
    from soter.report.errors import ReportError  # noqa: PLC0415 - the same

    try:
        written = write(report, path)
    except ReportError as error:
        raise SoterError((Diagnostic("D006", str(error)),)) from error
    console.say()
    console.say(f"junit  {written}")


def problems_as_junit(
    file: str, items: tuple[Diagnostic, ...], path: str
) -> tuple[Diagnostic, ...]:
    """Write why no test was explored. The diagnostics, with a D006 where that could not be."""
    from soter.explore.junit import write_problems  # noqa: PLC0415 - only then
    from soter.report.errors import ReportError  # noqa: PLC0415 - the same

    try:
        write_problems(file, items, path)
    except ReportError as error:
        return (*items, Diagnostic("D006", str(error)))
    return items
