"""How a command ends: exit codes, and what its JSON document holds.

Purpose: the contract of DESIGN §5 in one place; docs/json.md documents the documents.
Non-goals: writing them (`console.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Severity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.cli.ci.findings import CiFinding, Kind
    from soter.diagnostics.diagnostic import Diagnostic

SCHEMA = 1
"""Version of the documents; a field that goes or changes its meaning raises it."""

FINE = 0
DIAGNOSTICS = 1
USAGE = 2
VIOLATED = 3
UNDECIDED = 4
NOT_RECHECKED = 5
"""A certificate of which nothing was found to be false, and that is beyond the re-checker."""
INTERNAL = 70
"""A defect of soter itself (EX_SOFTWARE of sysexits.h)."""
INTERRUPTED = 130


@dataclass
class CommandOutcome:
    """The exit code, every diagnostic, and the command's own fields of the document."""

    exit: int = FINE
    diagnostics: tuple[Diagnostic, ...] = ()
    fields: dict[str, object] = field(default_factory=dict)
    found: tuple[CiFinding, ...] = ()
    """Verdicts, for `--format`; diagnostics are added to them."""
    junit: str = ""
    """The XML of `--format junit`, where the command has its own."""

    @property
    def files(self) -> list[str]:
        """The programs that it is about."""
        several = self.fields.get("files")
        entries = several if isinstance(several, list) else [self.fields]
        return [str(e["file"]) for e in entries if isinstance(e, dict) and "file" in e]

    def document(self, command: str | None) -> dict[str, object]:
        """The JSON document."""
        from soter.diagnostics.render import to_json  # noqa: PLC0415 - only with --json

        return {
            "schema": SCHEMA,
            "command": command,
            "ok": self.exit == FINE,
            "exit": self.exit,
            "diagnostics": [to_json(d) for d in self.diagnostics],
            **self.fields,
        }


class UsageError(Exception):
    """A command line that cannot be understood; `usage` says how it is written."""

    def __init__(self, message: str, usage: str) -> None:
        super().__init__(message)
        self.usage = usage.removeprefix("usage: ").strip()


def exit_of_kinds(kinds: Iterable[Kind]) -> int:
    """The exit code of findings: the one rule of every command that JUnit tells of, too."""
    found = set(kinds)
    return VIOLATED if "fail" in found else UNDECIDED if "open" in found else FINE


def exit_of(diagnostics: Iterable[Diagnostic]) -> int:
    """0 without errors; 2 where every error is one of the command line (U...); else 1."""
    errors = [d.code for d in diagnostics if d.severity is Severity.ERROR]
    if not errors:
        return FINE
    return USAGE if all(code.startswith("U") for code in errors) else DIAGNOSTICS
