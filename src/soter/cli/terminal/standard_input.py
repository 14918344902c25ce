"""A program on standard input: what `-` means where a file is asked for.

Purpose: the text, or a diagnostic where it is none.
Non-goals: files (`language/load/`).
"""

from __future__ import annotations

import sys

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.load.loader import MAX_FILE_BYTES

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
        raise SoterError((Diagnostic("D005", message),))
    try:
        return data if isinstance(data, str) else data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"standard input is not UTF-8: byte {error.start} is wrong"
        raise SoterError((Diagnostic("D005", message),)) from error
