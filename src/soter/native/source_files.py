"""The files that compiled code depends on: C files with what they include, and Soter's own.

Purpose: the cache keys on them, and packages copy them. A folder where nothing is found was cut
anew without its users being told, and that is a defect. `computes_names` says that macros put a
name together, which nobody here follows.
Non-goals: headers in angle brackets; which names those are (`extern_memory.py` sees them).
"""

from __future__ import annotations

import fnmatch
import hashlib
import os
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError, reason
from soter.language.load.named_files import read_bytes

if TYPE_CHECKING:
    from collections.abc import Collection


SOTER = Path(__file__).resolve().parents[1]


def files_below(folder: Path, *patterns: str) -> list[Path]:
    """All files of these patterns below a folder, in order; FileNotFoundError if there are none."""
    wanted = re.compile("|".join(map(fnmatch.translate, patterns))).match
    names = [f"{at}{os.sep}{n}" for at, _, files in os.walk(folder) for n in files if wanted(n)]
    paths = [Path(name) for name in sorted(names, key=lambda name: name.replace(os.sep, "\0"))]
    if not paths:
        what = ", ".join(patterns)
        raise FileNotFoundError(f"soter is not whole: no {what} below {folder.name}/")
    return paths


@cache
def soter_sha256() -> str:
    """A hash of every file that Soter is made of, the prelude too."""
    told = hashlib.sha256()
    below = len(SOTER.as_posix()) + 1
    for path in files_below(SOTER, "*.py", "*.c", "*.h", "*.soter"):
        told.update(path.as_posix()[below:].encode())
        told.update(hashlib.sha256(path.read_bytes()).digest())
    return told.hexdigest()


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
