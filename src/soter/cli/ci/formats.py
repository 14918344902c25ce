"""An outcome in the format that `--format` names.

Purpose: the option, and what is printed in place of the text for people or the JSON document.
Non-goals: the formats (`sarif_junit_github.py`).
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from soter.cli.terminal.command_line import of_diagnostics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.cli.terminal.command_line import CommandOutcome

FORMATS = ("sarif", "junit", "github")
FORMAT = (
    f"--format {{{','.join(FORMATS)}}}",
    None,
    "for CI, on standard output (docs/commands.md)",
)
"""The option of those that print one."""
COMMANDS = ("check", "verify", "test", "monitor")


def format_of(name: str | None, options: Sequence[str]) -> str | None:
    """The format that a command line asks for; None for none, or a wrong one."""
    if name not in COMMANDS:
        return None
    asked = [b for a, b in pairwise(options) if a == "--format"]
    asked += [a.removeprefix("--format=") for a in options if a.startswith("--format=")]
    return asked[-1] if asked and asked[-1] in FORMATS else None


def written(format_: str, command: str, outcome: CommandOutcome) -> str:
    """The outcome as text; `github` has none where all is well."""
    from soter.cli.ci.sarif_junit_github import (  # noqa: PLC0415 - only then
        github,
        junit,
        sarif,
    )

    findings = [*of_diagnostics(outcome.diagnostics), *outcome.found]
    if format_ == "sarif":
        return sarif(command, findings, outcome.exit)
    if format_ == "github":
        return github(findings)
    return outcome.junit or junit(command, outcome.files, findings)
