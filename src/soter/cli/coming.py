"""Commands of the contract that this version does not have.

Purpose: a clear answer instead of an unknown command; exit code 2.
Non-goals: pretending.
"""

from __future__ import annotations

from soter import __version__
from soter.cli.outcome import USAGE, Outcome
from soter.cli.parser import HelpWantedError
from soter.diagnostics.diagnostic import Diagnostic

ISSUES = {"test": 4, "replay": 4}
"""The issue that brings a command, where it is decided."""


def run(name: str, about: str, rest: list[str]) -> Outcome:
    """Say that it is to come, and with what."""
    when = f"it comes with issue {ISSUES[name]}" if name in ISSUES else "it comes later"
    if {"-h", "--help"} & set(rest):
        raise HelpWantedError(f"soter {name}: {about}\n\nNot in soter {__version__}: {when}.")
    problem = Diagnostic(
        "U006", f"`soter {name}` is not in soter {__version__}", notes=(f"{about}: {when}",)
    )
    return Outcome(USAGE, (problem,))
