"""What is being done just now, for whoever waits for it.

Purpose: `phase("P2b of Cart")` where something that takes long begins; a progress line shows it.
`passing_phase`: what is done in between, after which the phase before it goes on; `within_phase`:
what else is done in one. `announce`: a
line about how long it will take, for whoever shows one. `lasting`: such a time in words.
Non-goals: how far it is: those who know call their `progress`.
"""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MINUTES_FROM_S = 90.0
"""Less is said in seconds."""

_listener: ContextVar[Callable[[str, bool], None] | None] = ContextVar("listener", default=None)
_current: ContextVar[str] = ContextVar("current", default="")
_announcer: ContextVar[Callable[[str], None] | None] = ContextVar("announcer", default=None)


def phase(name: str, *, anew: bool = False) -> None:
    """Say what begins; `anew`: shares that are told from here on begin at nothing."""
    listener = _listener.get()
    if listener is not None:
        _current.set(name)
        listener(name, anew)


@contextmanager
def passing_phase(name: str) -> Iterator[None]:
    """A phase as long as the block takes; the one before it goes on afterwards."""
    before = _current.get()
    phase(name)
    try:
        yield
    finally:
        phase(before)


@contextmanager
def within_phase() -> Iterator[None]:
    """Phases in this block are parts of the one that goes on, and not told."""
    before = _listener.set(None)
    try:
        yield
    finally:
        _listener.reset(before)


def announce(text: Callable[[], str]) -> None:
    """Say a line once; `text` is asked only where somebody listens, and "" is not said."""
    announcer = _announcer.get()
    if announcer is not None and (line := text()):
        announcer(line)


def lasting(seconds: float, to_s: int = 1) -> str:
    """A time that is estimated, in one style of units: `to_s` seconds are told apart."""
    minutes = seconds >= MINUTES_FROM_S
    return f"{seconds / 60:.0f} min" if minutes else f"{to_s * round(seconds / to_s)} s"


@contextmanager
def listening_to_phases(
    listener: Callable[[str, bool], None], announcer: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Let `listener(name, anew)` know of the phases of this block, in this thread.

    `announcer(line)` is told what is announced.
    """
    before = _listener.set(listener), _announcer.set(announcer), _current.set("")
    try:
        yield
    finally:
        _listener.reset(before[0])
        _announcer.reset(before[1])
        _current.reset(before[2])
