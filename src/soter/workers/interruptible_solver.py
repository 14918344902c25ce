"""Lets Ctrl-C interrupt z3 while it works.

Purpose: `ask_solver` asks z3 in a thread, so that the main one gets Ctrl-C and interrupts the
solver. Elsewhere `ctrl_c_waits` holds Ctrl-C back to the next question or `raise_if_interrupted`: a
`KeyboardInterrupt` in a `__del__` or a conversion of ctypes is lost, and z3's own handler swallows
the signal.
Non-goals: what is asked; runs (`simulate/interrupt.py`); threads other than the main one, which get
no signals.
"""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType


LOOK_S = 0.1
"""Seconds between two looks whether Ctrl-C was noted, while the solver works."""

_noted: list[int] = []


def _note_interrupt(number: int, _frame: FrameType | None) -> None:
    """Handles SIGINT: notes the first Ctrl-C, and raises KeyboardInterrupt at the second."""
    if _noted:
        _noted.clear()
        raise KeyboardInterrupt
    _noted.append(number)


def raise_if_interrupted() -> None:
    """Raises KeyboardInterrupt if a Ctrl-C was noted."""
    if _noted:
        _noted.clear()
        raise KeyboardInterrupt


@contextmanager
def ctrl_c_waits() -> Iterator[None]:
    """Delays a Ctrl-C in a `with` block until the block ends; a handler set by others stays."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _note_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        raise_if_interrupted()


@ctrl_c_waits()
def ask_solver(solver: Any) -> Any:  # noqa: ANN401 - z3 has no types
    """The result of `solver.check()`; after a Ctrl-C it soon raises KeyboardInterrupt instead."""
    raise_if_interrupted()
    if threading.current_thread() is not threading.main_thread():
        return solver.check()
    solver.set("ctrl_c", False)
    found: list[Any] = []
    asker = threading.Thread(target=_check, args=(solver, found), name="soter solver", daemon=True)
    asker.start()
    try:
        while asker.is_alive():
            asker.join(LOOK_S)
            raise_if_interrupted()
    except KeyboardInterrupt:
        while asker.is_alive():
            solver.interrupt()
            asker.join(LOOK_S)
        raise
    (answer,) = found
    if isinstance(answer, BaseException):
        raise answer
    return answer


def _check(solver: Any, found: list[Any]) -> None:  # noqa: ANN401 - z3 has no types
    try:
        found.append(solver.check())
    except BaseException as error:  # noqa: BLE001 - the calling thread raises it again
        found.append(error)
