"""C files and everything that they include.

Purpose: what a compiled file depends on: the cache keys on it, packages copy it.
`computes_names`: that macros put a name together, which nobody here follows.
Non-goals: headers in angle brackets; which names those are (`extern_memory.py` sees them).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.load.bounded_read import read_bytes

if TYPE_CHECKING:
    from collections.abc import Collection

INCLUDE = re.compile(
    r'^[ \t]*(?:#|%:)[ \t]*(?:include(?:_next)?|import|embed|define|if|elif)\b[^"\n]*"([^"\n]+)"',
    re.MULTILINE,
)
"""A name in quotes of a directive that includes, or defines: there may be an `#include NAME`. Or
one that asks whether a file is there (`__has_include`)."""
INCBIN = re.compile(r'\.incbin[ \t]*\\?"([^"\\\n]+)')
"""A file that assembler in the C puts into the object."""
OF_A_MACRO = re.compile(
    r"^[ \t]*(?:#|%:)[ \t]*(?:include(?:_next)?|import|embed)[ \t]*([A-Za-z_]\w*)(.*)$",
    re.MULTILINE,
)
"""An include of a macro, and what stands behind its name."""
FILES_MAX = 1000


def included(*sources: str | Path, folders: tuple[Path, ...] = ()) -> dict[Path, str]:
    """Path and text of C files and of all they include in quotes; X003 where one cannot be read.

    `folders`: where headers are looked for besides the folder of the file that includes them.
    """
    waiting, text_by_path = [Path(s).resolve() for s in sources], dict[Path, str]()
    while waiting and len(text_by_path) < FILES_MAX:
        path = waiting.pop()
        if path in text_by_path:
            continue
        text_by_path[path] = _read(path)
        text = text_by_path[path].replace("\\\n", "")
        for name in (*INCLUDE.findall(text), *INCBIN.findall(text)):
            places = ((place / name).resolve() for place in (path.parent, *folders))
            waiting += [p for p in places if p.is_file()][:1]
    return text_by_path


def computes_names(texts: Collection[str]) -> bool:
    """Whether C includes what a macro makes a name of, other than one that a definition quotes."""
    joined = [t.replace("\\\n", "") for t in texts]
    for name, rest in (found for t in joined for found in OF_A_MACRO.findall(t)):
        defined = re.compile(rf"^[ \t]*(?:#|%:)[ \t]*define[ \t]+{name}\b(?!\()(.*)$", re.MULTILINE)
        given = [d.strip() for t in joined for d in defined.findall(t)]
        if rest.lstrip().startswith("(") or not given or any(d[:1] not in '"<' for d in given):
            return True
    return False


def _read(path: Path) -> str:
    try:
        return read_bytes(path).decode("utf-8", "surrogateescape")
    except OSError as error:
        why = reason(error)
        message = f"cannot read the extern's C file `{path}`: {why}"
        raise SoterError((Diagnostic("X003", message),)) from error
