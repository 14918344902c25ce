"""The files that Soter itself is made of.

Purpose: find what an engine is compiled from, or what a kept result depends on; a folder where
nothing is found was cut anew without its users being told, and that is a defect.
Non-goals: files of users.
"""

from __future__ import annotations

from pathlib import Path

SOTER = Path(__file__).resolve().parents[1]


def files_below(folder: Path, *patterns: str) -> list[Path]:
    """All files of these patterns below a folder, in order; FileNotFoundError if there are none."""
    found = sorted({p for pattern in patterns for p in folder.rglob(pattern)})
    if not found:
        what = ", ".join(patterns)
        raise FileNotFoundError(f"soter is not whole: no {what} below {folder.name}/")
    return found
