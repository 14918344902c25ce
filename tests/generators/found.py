"""Files that tests go over.

Purpose: a test over all files of a kind must not pass because it found none.
Non-goals: which programs engines can run (`shipped.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def files_in(folder: Path, pattern: str) -> list[Path]:
    """Files of a pattern in a folder, in order; never none. Folders in it are another kind."""
    found = sorted(folder.glob(pattern))
    assert found, f"nothing like {pattern} in {folder}"
    return found


def files_below(folder: Path, *patterns: str) -> list[Path]:
    """All files of these patterns below a folder, in order; never none."""
    found = sorted({p for pattern in patterns for p in folder.rglob(pattern)})
    assert found, f"nothing like {', '.join(patterns)} below {folder}"
    return found
