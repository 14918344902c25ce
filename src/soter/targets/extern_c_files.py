"""The C files of externs that a package takes along.

Purpose: what must be copied so that a package compiles without the folder it came from.
Non-goals: finding what a file includes (`native/includes.py`); files outside its own folder.
"""

from __future__ import annotations

from pathlib import Path

from soter.native.includes import included


def with_headers(source: str) -> dict[Path, str]:
    """Path and text of a C file and of all it includes that lies beside or below it."""
    root = Path(source).resolve().parent
    return {p: text for p, text in included(source).items() if p.is_relative_to(root)}
