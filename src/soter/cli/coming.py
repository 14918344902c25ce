"""Commands of the contract that this version does not have.

Purpose: a clear answer instead of an unknown command; exit code 2.
Non-goals: pretending.
"""

from __future__ import annotations

from soter import __version__
from soter.cli.terminal.outcome import USAGE, Outcome
from soter.cli.terminal.parser import HelpWantedError
from soter.diagnostics.diagnostic import Diagnostic


def run(name: str, about: str, rest: list[str]) -> Outcome:
    """Say that it is to come, and with what; HelpWantedError where help is asked for."""
    if {"-h", "--help"} & set(rest):
        text = f"soter {name}: {about}\n\nNot in soter {__version__}: it is to come."
        raise HelpWantedError(text)
    note = f"{about}: it is to come"
    problem = Diagnostic("U006", f"`soter {name}` is not in soter {__version__}", notes=(note,))
    return Outcome(USAGE, (problem,))
