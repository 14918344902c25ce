"""The program that a command is about: a file, or what stands on standard input.

Purpose: it is loaded with a line that says how far it is, and `--bind` is carried out; for `-` the
text of standard input, or a diagnostic where it is none.
Non-goals: `--set`: values are given to what is done with the program; files (`language/load/`).
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from soter.api import load
from soter.cli.terminal.progress import LineOfProgress
from soter.diagnostics.diagnostic import mistake
from soter.language.load.loader import MAX_FILE_BYTES

if TYPE_CHECKING:
    import argparse

    from soter.api import Program
    from soter.cli.terminal.console import Console


def opened(args: argparse.Namespace, console: Console) -> Program:
    """The program of `args.file`; its warnings are told with whatever comes of the command."""
    with LineOfProgress(console) as line:
        program = load(args.file, line)
    console.of_program = program.diagnostics if program.ok else ()
    return program


def bound(program: Program, args: argparse.Namespace) -> Program:
    """The same with `args.bindings`; `SoterError` where it is none."""
    for name, target in args.bindings:
        program.bind(name, target)
    return program


def warned_of_files(program: Program, console: Console) -> Program:
    """The same program; what is wrong with files of its externs (W007, W037) is told at once.

    It is for what does not ask them itself: a proof, or a package that leaves them out.
    """
    warnings = program.check().warnings if program.externs else ()
    missing = tuple(w for w in warnings if w.code in ("W007", "W037"))
    if console.json:
        console.of_program += missing
    console.diagnostics(missing)
    return program


def loaded(args: argparse.Namespace, console: Console) -> Program:
    """The program that the arguments name, with their bindings."""
    return bound(opened(args, console), args)


STDIN = "<stdin>"
"""What it is called; imports are read from the current folder."""


def standard_input() -> str:
    """The whole of it, 4 MiB at most; SoterError D005 where it is larger or not UTF-8."""
    stream = sys.stdin
    if stream is None:
        return ""
    most = MAX_FILE_BYTES
    data = stream.buffer.read(most + 1) if hasattr(stream, "buffer") else stream.read(most + 1)
    if len(data) > most:
        message = f"cannot read standard input: it is larger than {most >> 20} MiB"
        raise mistake("D005", message)
    try:
        return data if isinstance(data, str) else data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"standard input is not UTF-8: byte {error.start} is wrong"
        raise mistake("D005", message) from error
