"""The C files that externs are bound to, and the headers beside them.

Purpose: what must be copied so that a package compiles without the folder it came from.
Non-goals: system headers, headers found through other include paths.
"""

from __future__ import annotations

import re
from pathlib import Path

from soter.diagnostics.diagnostic import Diagnostic, SoterError

INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"', re.MULTILINE)
FILES_MAX = 1000


def with_headers(source: str) -> dict[Path, str]:
    """Path and text of a C file and of all it includes that lies beside or below it."""
    root = Path(source).resolve().parent
    waiting, found = [Path(source).resolve()], dict[Path, str]()
    while waiting and len(found) < FILES_MAX:
        path = waiting.pop()
        if path in found:
            continue
        found[path] = _read(path)
        for name in INCLUDE.findall(found[path]):
            header = (path.parent / name).resolve()
            if header.is_file() and header.is_relative_to(root):
                waiting.append(header)
    return found


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        message = f"cannot read the extern's C file `{path}`: {why}"
        raise SoterError((Diagnostic("X003", message),)) from error
