"""Lets Ctrl-C and similar signals stop a run at the end of an instant; its result is kept.

Purpose: during a run SIGINT (Ctrl-C), SIGTERM or SIGHUP asks it to stop. In an extern's code, which
may never return, the signal also ends that call. So a `KeyboardInterrupt` that an extern raises
itself differs from a user's Ctrl-C, and is the extern's fault.
Non-goals: threads other than the main one, which get no signals; C code that hangs, during which
Python's handlers do not run.
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
    """A request to stop. `wanted`: signal number `signal` came; `in_extern`: an extern runs."""

    def __init__(self) -> None:
        self.wanted = False
        self.in_extern = False
        self.running = False
        self.signal = 0

    def note_signal(self, number: int, _frame: FrameType | None) -> None:
        """Notes a signal, so that the run stops at the end of an instant.

        It raises `Stop` in an extern's code. Outside a run it raises `KeyboardInterrupt`, once.
        """
        again, self.wanted = self.wanted, True
        self.signal = self.signal or number
        if self.in_extern:
            raise Stop
        if not self.running and not again:
            raise KeyboardInterrupt


_listening: list[StopRequest] = []
"""The request that receives the signals, if there is one."""


def current_stop_request() -> StopRequest:
    """The request that receives signals already, or a new request."""
    return _listening[-1] if _listening else StopRequest()


@contextmanager
def receiving_signals(
    request: StopRequest, numbers: tuple[signal.Signals, ...] = INTERRUPT
) -> Iterator[None]:
    """In its `with` block, signals reach the request, but handlers set by a caller stay."""
    if threading.current_thread() is not threading.main_thread() or request in _listening:
        yield
        return
    before = {n: h for n in numbers if (h := signal.getsignal(n)) is _default_handler(n)}
    _listening.append(request)
    for number in before:
        signal.signal(number, request.note_signal)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _listening.remove(request)


@contextmanager
def stoppable_run(
    request: StopRequest, numbers: tuple[signal.Signals, ...] = INTERRUPT
) -> Iterator[None]:
    """In its `with` block, signals stop a run at the end of an instant."""
    with receiving_signals(request, numbers):
        request.running = True
        try:
            yield
        finally:
            request.running = False


def signal_name(request: StopRequest) -> str:
    """The name of the signal that asked for the stop."""
    return signal.Signals(request.signal).name if request.signal else "interrupted"


def raise_signal_again(request: StopRequest) -> NoReturn:
    """Raises KeyboardInterrupt for Ctrl-C, and sends any other signal to this process again."""
    if request.signal not in (0, signal.SIGINT):
        signal.raise_signal(request.signal)
    raise KeyboardInterrupt


def _default_handler(number: signal.Signals) -> object:
    return signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
