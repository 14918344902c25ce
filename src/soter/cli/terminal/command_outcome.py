"""How a command ends: what every command returns.

Purpose: `CommandOutcome` has the exit code, diagnostics, and the fields of the JSON document
(docs/json.md); `exit_code` and the like are the rules that give an exit code.
Non-goals: writing documents (`console.py`); an outcome that is kept (`stored_outcome.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Severity, SoterError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.cli.terminal.ci_findings import CiFinding, Kind


SCHEMA = 1
"""Version of the JSON documents; it rises when a field goes or changes its meaning."""

FINE = 0
DIAGNOSTICS = 1
USAGE = 2
VIOLATED = 3
UNDECIDED = 4
NOT_RECHECKED = 5
"""Nothing in a certificate was found to be false, but the re-checker cannot check all of it."""
INTERNAL = 70
"""A defect of soter itself (EX_SOFTWARE of sysexits.h)."""
INTERRUPTED = 130


@dataclass
class CommandOutcome:
    """The exit code, all diagnostics, and the command's fields of the JSON document."""

    exit: int = FINE
    diagnostics: tuple[Diagnostic, ...] = ()
    fields: dict[str, object] = field(default_factory=dict)
    found: tuple[CiFinding, ...] = ()
    """Verdicts, for `--format`; diagnostics are added to them."""
    junit: str = ""
    """The XML of `--format junit`, where the command has its own."""

    @property
    def files(self) -> list[str]:
        """The paths of the programs that the command was about."""
        several = self.fields.get("files")
        entries = several if isinstance(several, list) else [self.fields]
        return [str(e["file"]) for e in entries if isinstance(e, dict) and "file" in e]

    def json_document(self, command: str | None) -> dict[str, object]:
        """The JSON document of the outcome, as a dict."""
        from soter.diagnostics.render import to_json  # noqa: PLC0415 - only with --json

        return {
            "schema": SCHEMA,
            "command": command,
            "ok": self.exit == FINE,
            "exit": self.exit,
            "diagnostics": [to_json(d) for d in self.diagnostics],
            **self.fields,
        }


def exit_of_kinds(kinds: Iterable[Kind]) -> int:
    """The exit code of `verify`, `test` and `monitor` for findings of these kinds."""
    found = set(kinds)
    return VIOLATED if "fail" in found else UNDECIDED if "open" in found else FINE


def exit_code(diagnostics: Iterable[Diagnostic]) -> int:
    """The exit code: 0 without errors, 2 if all errors are of the command line (U...), else 1."""
    errors = [d.code for d in diagnostics if d.severity is Severity.ERROR]
    if not errors:
        return FINE
    return USAGE if all(code.startswith("U") for code in errors) else DIAGNOSTICS


def failure(error: SoterError) -> CommandOutcome:
    """The outcome of a command that ended with this error."""
    return CommandOutcome(exit_code(error.diagnostics) or DIAGNOSTICS, error.diagnostics)
