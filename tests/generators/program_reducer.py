"""Make a failing program smaller by leaving out lines.

Purpose: what a person reads after a failure: as long as the program still checks and still fails,
lines go, whole blocks first, then single ones.
Non-goals: smaller expressions; knowing what failed.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def reduced(text: str, fails: Callable[[str], bool], seconds: float = 60.0) -> str:
    """A smaller text that fails too; `fails` must be False for what does not check."""
    end = time.monotonic() + seconds
    lines = text.splitlines()
    size = len(lines) // 2
    while size >= 1:
        before = len(lines)
        lines = _without_blocks(lines, fails, end)
        lines = _without_chunks(lines, size, fails, end)
        if time.monotonic() > end:
            break
        size = size // 2 if len(lines) == before or size > 1 else size
    return "\n".join(lines) + "\n"


def _without_blocks(lines: list[str], fails: Callable[[str], bool], end: float) -> list[str]:
    """Leave out `... { ... }` blocks, each as a whole."""
    at = 1
    while at < len(lines) and time.monotonic() < end:
        stop = _end_of_block(lines, at)
        shorter = lines[:at] + lines[stop:]
        if stop > at + 1 and fails("\n".join(shorter) + "\n"):
            lines = shorter
        else:
            at += 1
    return lines


def _end_of_block(lines: list[str], at: int) -> int:
    """The line after the block that opens in line `at`, or simply the next one."""
    depth = 0
    for n in range(at, len(lines)):
        depth += lines[n].count("{") - lines[n].count("}")
        if depth <= 0:
            return n + 1
    return at + 1


def _without_chunks(
    lines: list[str], size: int, fails: Callable[[str], bool], end: float
) -> list[str]:
    at = 1
    while at < len(lines) and time.monotonic() < end:
        shorter = lines[:at] + lines[at + size :]
        if fails("\n".join(shorter) + "\n"):
            lines = shorter
        else:
            at += size
    return lines
