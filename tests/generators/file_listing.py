"""Files that tests go over.

Purpose: a test over all files of a kind must not pass because it found none.
Non-goals: which programs engines can run (`shipped_programs.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def files_in(folder: Path, pattern: str) -> list[Path]:
    """Files of a pattern in a folder, in order; never none. Folders in it are another kind."""
    files = sorted(folder.glob(pattern))
    assert files, f"nothing like {pattern} in {folder}"
    return files


def files_below(folder: Path, *patterns: str) -> list[Path]:
    """All files of these patterns below a folder, in order; never none."""
    files = sorted({p for pattern in patterns for p in folder.rglob(pattern)})
    assert files, f"nothing like {', '.join(patterns)} below {folder}"
    return files
