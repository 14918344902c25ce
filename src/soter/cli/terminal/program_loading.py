"""Loads the program of a command, from a file or from standard input.

Purpose: `loaded_program` shows progress in a line and binds externs as `--bind` says;
`warn_of_extern_files` tells early of wrong files of externs; `standard_input` reads the text for
`-`.
Non-goals: parameters (`--set`), which each command hands on.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from soter.cli.terminal.console import Console, LineOfProgress
from soter.diagnostics.diagnostic import mistake

if TYPE_CHECKING:
    import argparse

    from soter.api import Program


def opened_program(args: argparse.Namespace, console: Console) -> Program:
    """Loads `args.file`; a correct program's warnings are printed with the outcome."""
    from soter.api import load  # noqa: PLC0415 - commands about the tool itself open none

    with LineOfProgress(console) as line:
        program = load(args.file, line)
    console.of_program = program.diagnostics if program.ok else ()
    return program


def bound_program(program: Program, args: argparse.Namespace) -> Program:
    """Binds externs as `args.bindings` says and gives `program`; `SoterError` if that fails."""
    for name, target in args.bindings:
        program.bind(name, target)
    return program


def warn_of_extern_files(program: Program, console: Console) -> Program:
    """Warns early of wrong files of externs (W007, W037) if no extern will be called."""
    warnings = program.check().warnings if program.externs else ()
    missing = tuple(w for w in warnings if w.code in ("W007", "W037"))
    if console.json:
        console.of_program += missing
    console.write_diagnostics(missing)
    return program


def loaded_program(args: argparse.Namespace, console: Console) -> Program:
    """Loads the program that the arguments name, and binds its externs; may raise `SoterError`."""
    return bound_program(opened_program(args, console), args)


STDIN = "<stdin>"
"""The path of a program from standard input; its imports are read from the current folder."""


def standard_input() -> str:
    """The text of standard input; SoterError D005 if over MAX_FILE_BYTES or not UTF-8."""
    from soter.language.load.loader import MAX_FILE_BYTES  # noqa: PLC0415 - for `-`

    stream = sys.stdin
    if stream is None:
        return ""
    data = getattr(stream, "buffer", stream).read(MAX_FILE_BYTES + 1)
    if len(data) > MAX_FILE_BYTES:
        why = f"it is larger than {MAX_FILE_BYTES >> 20} MiB"
        raise mistake("D005", f"cannot read standard input: {why}")
    try:
        return data if isinstance(data, str) else data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        why = f"standard input is not UTF-8: byte {error.start} is wrong"
        raise mistake("D005", why) from error
