"""Ctrl-C and its like during a run: stop at the end of an instant and keep what was reached.

Purpose: while a run goes on, SIGINT (Ctrl-C), SIGTERM or SIGHUP asks it to stop; inside an
extern, which may never come back, it also breaks that call off. So a `KeyboardInterrupt` that an
extern raises by itself is told from a person's, and is the extern's fault.
Non-goals: threads other than the main one, which get no signals; C code that hangs (it never
lets Python's handlers run).
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
    from typing import NoReturn

INTERRUPT = (signal.SIGINT,)
ANY_END = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """`wanted` once a signal came, `signal` which; `in_extern` while an extern's code runs."""

    def __init__(self) -> None:
        self.wanted = False
        self.in_extern = False
        self.running = False
        self.signal = 0

    def on_signal(self, number: int, _frame: FrameType | None) -> None:
        """Note it; a run stops by itself, what is no run is broken off, once.

        Raises Stop in an extern's code, KeyboardInterrupt in what is no run.
        """
        again, self.wanted = self.wanted, True
        self.signal = self.signal or number
        if self.in_extern:
            raise Stop
        if not self.running and not again:
            raise KeyboardInterrupt


_listening: list[StopRequest] = []
"""The request that has the signals, if there is one."""


def stop_request() -> StopRequest:
    """The request that has the signals already, or a new one."""
    return _listening[-1] if _listening else StopRequest()


@contextmanager
def listening(
    request: StopRequest, numbers: tuple[signal.Signals, ...] = INTERRUPT
) -> Iterator[None]:
    """Let signals reach the request, while inside; whoever else handles one keeps doing so."""
    if threading.current_thread() is not threading.main_thread() or request in _listening:
        yield
        return
    before = {n: h for n in numbers if (h := signal.getsignal(n)) is _default(n)}
    _listening.append(request)
    for number in before:
        signal.signal(number, request.on_signal)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _listening.remove(request)


@contextmanager
def stoppable(
    request: StopRequest, numbers: tuple[signal.Signals, ...] = INTERRUPT
) -> Iterator[None]:
    """A run goes on inside: signals stop it at an instant."""
    with listening(request, numbers):
        request.running = True
        try:
            yield
        finally:
            request.running = False


def stopped_by(request: StopRequest) -> str:
    """The name of the signal that asked."""
    return signal.Signals(request.signal).name if request.signal else "interrupted"


def raise_again(request: StopRequest) -> NoReturn:
    """What the signal would have done without the run: end the process, or `KeyboardInterrupt`."""
    if request.signal not in (0, signal.SIGINT):
        signal.raise_signal(request.signal)
    raise KeyboardInterrupt


def _default(number: signal.Signals) -> object:
    return signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
