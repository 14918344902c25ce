"""The C files that externs are bound to, and everything they include.

Purpose: what a compiled extern depends on: the cache keys on it, packages copy it.
Non-goals: system headers, include paths beyond a file's own folder, names made by macros.
"""

from __future__ import annotations

import re
from pathlib import Path

from soter.diagnostics.diagnostic import Diagnostic, SoterError

INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"', re.MULTILINE)
FILES_MAX = 1000


def included(source: str) -> dict[Path, str]:
    """Path and text of a C file and of all it includes in quotes; X003 where it cannot be read."""
    waiting, found = [Path(source).resolve()], dict[Path, str]()
    while waiting and len(found) < FILES_MAX:
        path = waiting.pop()
        if path in found:
            continue
        found[path] = _read(path)
        names = INCLUDE.findall(found[path])
        waiting += [p for n in names if (p := (path.parent / n).resolve()).is_file()]
    return found


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="surrogateescape")
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        message = f"cannot read the extern's C file `{path}`: {why}"
        raise SoterError((Diagnostic("X003", message),)) from error
