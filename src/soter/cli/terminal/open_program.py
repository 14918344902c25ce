"""The program that a command is about.

Purpose: it is loaded with a line that says how far it is, and `--bind` is carried out.
Non-goals: `--set`: values are given to what is done with the program.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.api import load
from soter.cli.terminal.progress import LineOfProgress

if TYPE_CHECKING:
    import argparse

    from soter.api import Program
    from soter.cli.terminal.console import Console


def loaded(args: argparse.Namespace, console: Console) -> Program:
    """The program of `args.file` with `args.bindings`; `SoterError` where it is none."""
    with LineOfProgress(console) as line:
        program = load(args.file, line)
    for name, target in args.bindings:
        program.bind(name, target)
    return program
