"""The files that Soter itself is made of.

Purpose: find what an engine is compiled from, or what a kept result depends on; a folder where
nothing is found was cut anew without its users being told, and that is a defect.
Non-goals: files of users.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

SOTER = Path(__file__).resolve().parents[1]


def files_below(folder: Path, *patterns: str) -> list[Path]:
    """All files of these patterns below a folder, in order; FileNotFoundError if there are none."""
    paths = sorted({p for pattern in patterns for p in folder.rglob(pattern)})
    if not paths:
        what = ", ".join(patterns)
        raise FileNotFoundError(f"soter is not whole: no {what} below {folder.name}/")
    return paths


@cache
def soter_sha256() -> str:
    """A hash of every file that Soter is made of, the prelude too."""
    told = hashlib.sha256()
    for path in files_below(SOTER, "*.py", "*.c", "*.h", "*.soter"):
        told.update(path.relative_to(SOTER).as_posix().encode())
        told.update(hashlib.sha256(path.read_bytes()).digest())
    return told.hexdigest()
