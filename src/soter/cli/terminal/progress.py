"""A line that says how far a run is.

Purpose: on a terminal, for anything over two seconds, one line on standard error that is
rewritten and gone at the end.
Non-goals: logs; nothing is written where nobody looks.
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING

from soter.cli.terminal.console import is_terminal

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.cli.terminal.console import Console

PATIENCE_S = 2.0
EVERY_S = 0.1
WIDTH = 30
CLEAR = "\r\x1b[K"


class LineOfProgress:
    """Called with a text that says how far it is; a context, which clears the line when left."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._began = self._next = time.perf_counter()
        self._next += PATIENCE_S
        self._shown = False

    def __enter__(self) -> Callable[[str], None] | None:
        return self._show if is_terminal(self._console.err) else None

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._write(CLEAR)

    def _show(self, text: str) -> None:
        if self._is_time():
            self._write(CLEAR + text)

    def _is_time(self) -> bool:
        """Whether to write now."""
        now = time.perf_counter()
        if now < self._next:
            return False
        self._next = now + EVERY_S
        self._shown = True
        return True

    def _write(self, text: str) -> None:
        assert self._console.err is not None
        with suppress(OSError, ValueError):
            self._console.err.write(text)
            self._console.err.flush()


class Progress(LineOfProgress):
    """Called with the share that is done: a bar, and how long it may still take."""

    def __enter__(self) -> Callable[[float], None] | None:  # type: ignore[override]
        return self._show_share if is_terminal(self._console.err) else None

    def _show_share(self, share: float) -> None:
        if self._is_time():
            spent_s = time.perf_counter() - self._began
            self._write(CLEAR + self._line(min(max(share, 0.0), 1.0), spent_s))

    def _line(self, share: float, spent_s: float) -> str:
        full = int(share * WIDTH)
        fill, rest = ("#", "-") if self._console.ascii_only else ("━", "╌")
        left = f"{spent_s / share - spent_s:.0f} s left" if share > 0.001 else ""
        parts = [f"{fill * full}{rest * (WIDTH - full)}", f"{share:4.0%}", left]
        return "  ".join(p for p in parts if p)
