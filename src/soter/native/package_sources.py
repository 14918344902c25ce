"""The files that Soter itself is made of.

Purpose: find what an engine is compiled from, or what a kept result depends on; a folder where
nothing is found was cut anew without its users being told, and that is a defect.
Non-goals: files of users.
"""

from __future__ import annotations

import fnmatch
import hashlib
import os
import re
from functools import cache
from pathlib import Path

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
