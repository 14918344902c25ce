"""A line that says how far a run is.

Purpose: on a terminal, for anything over two seconds, one line on standard error that is
rewritten and gone at the end.
Non-goals: logs; nothing is written where nobody looks.
"""

from __future__ import annotations

import shutil
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from soter.cli.terminal.console import is_terminal
from soter.diagnostics.current_phase import listening_to_phases

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.cli.terminal.console import Console

PATIENCE_S = 2.0
EVERY_S = 0.1
WIDTH = 30
CLEAR = "\r\x1b[K"


def clipped(text: str) -> str:
    """What fits on one line: a longer one could not be taken back."""
    most = max(shutil.get_terminal_size((80, 24)).columns - 1, 20)
    return text if len(text) <= most else f"{text[: most - 3]}..."


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
            self._write(CLEAR + clipped(text))

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


class ProgressBar(LineOfProgress):
    """Called with the share that is done: a bar, what is being done, how long it may still take.

    The bar never runs backwards, unless a phase that begins anew has another name.
    """

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._phase = ""
        self._furthest = 0.0
        self._phase_began = self._began
        self._during = ExitStack()

    def __enter__(self) -> Callable[[float], None] | None:  # type: ignore[override]
        if not is_terminal(self._console.err):
            return None
        self._during.enter_context(listening_to_phases(self._enter_phase))
        return self._show_share

    def __exit__(self, *_: object) -> None:
        self._during.close()
        super().__exit__()

    def _enter_phase(self, name: str, anew: bool) -> None:
        if anew and name != self._phase:
            self._furthest, self._phase_began = 0.0, time.perf_counter()
        self._phase = name
        self._show_share(self._furthest)

    def _show_share(self, share: float) -> None:
        self._furthest = max(self._furthest, min(share, 1.0))
        if self._is_time():
            spent_s = time.perf_counter() - self._phase_began
            self._write(CLEAR + self._line(self._furthest, spent_s))

    def _line(self, share: float, spent_s: float) -> str:
        full = int(share * WIDTH)
        fill, rest = ("#", "-") if self._console.ascii_only else ("━", "╌")
        left = f"{spent_s / share - spent_s:.0f} s left" if 0.001 < share < 1.0 else ""
        parts = [f"{fill * full}{rest * (WIDTH - full)}", f"{share:4.0%}", left, self._phase]
        return clipped("  ".join(p for p in parts if p))
