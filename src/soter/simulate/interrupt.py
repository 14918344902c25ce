"""Ctrl-C during a run: stop at the end of an instant and keep what was reached.

Purpose: while a run goes on, the first Ctrl-C asks it to stop; inside an extern, which may never
come back, it also breaks that call off. So a `KeyboardInterrupt` that an extern raises by itself
is told from a person's, and is the extern's fault.
Non-goals: other signals; threads other than the main one, which get no signals; C code that
hangs (it never lets Python's handlers run).
"""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

from soter.semantics.externs import Stop

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType


class StopRequest:
    """`wanted` once Ctrl-C was pressed; `in_extern` while an extern's code runs."""

    def __init__(self) -> None:
        self.wanted = False
        self.in_extern = False

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.wanted = True
        if self.in_extern:
            raise Stop


@contextmanager
def stoppable(request: StopRequest) -> Iterator[None]:
    """Let Ctrl-C set the request, while inside; whoever handles Ctrl-C otherwise keeps doing so."""
    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if not ours:
        yield
        return
    signal.signal(signal.SIGINT, request._on_signal)  # noqa: SLF001 - its own
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
