"""What a call of somebody else's Python may change of the process, put back after it.

Purpose: the current folder and the depth of recursion that an extern sets are the externs' own:
they find them again in the next call, and soter keeps its own. How the processor rounds, which
loading a library may change, is put back. A copy of the process that an extern forks ends where
the call ends: there is one run.
Non-goals: threads, signals and files that an extern leaves behind; exceptions
(`python_extern.py`); isolation (`workers/`).
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from soter.language.evaluate.floating_point_mode import put_back

if TYPE_CHECKING:
    from collections.abc import Callable


class _ExternChanges:
    """What externs set: all of them share it, as all share the process."""

    folder = ""
    depth = 0


def outside(call: Callable[..., object], *arguments: object) -> object:
    """`call(*arguments)` in the externs' surroundings; raises what it raises."""
    home, depth, process = _folder(), sys.getrecursionlimit(), os.getpid()
    if _ExternChanges.folder:
        _go(_ExternChanges.folder)
    if _ExternChanges.depth > depth:
        sys.setrecursionlimit(_ExternChanges.depth)
    try:
        return call(*arguments)
    finally:
        end_copy(process)
        put_back()
        _ExternChanges.depth = sys.getrecursionlimit()
        sys.setrecursionlimit(depth)
        there = _folder()
        _ExternChanges.folder = there if there != home else ""
        if there != home:
            _go(home)


def end_copy(process: int) -> None:
    """End this process at once unless it is `process`: then it is a copy that an extern made."""
    if os.getpid() != process:
        with suppress(OSError):
            os.write(2, b"soter: an extern forked the process: the copy ends with the call\n")
        os._exit(1)


def _folder() -> str:
    """The current folder; empty where it is gone."""
    try:
        return os.getcwd()  # noqa: PTH109 - twice a step
    except OSError:
        return ""


def _go(folder: str) -> None:
    with suppress(OSError):
        os.chdir(folder)
