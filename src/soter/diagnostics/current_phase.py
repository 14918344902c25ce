"""What is being done just now, for whoever waits for it.

Purpose: `phase("P2b of Cart")` where something that takes long begins; a progress line shows it.
`passing_phase`: what is done in between, after which the phase before it goes on; `within_phase`:
what else is done in one. `share_done`: how far it is, for whom `telling` names; `between` says
which part of a whole a block is. `announce`: a line about how long it will take, for whoever shows
one. `lasting`: such a time in words.
Non-goals: runs, searches and campaigns, whose options name who is told.
"""

from __future__ import annotations

from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

    Told = Callable[[float, str], None]

MINUTES_FROM_S = 90.0
"""Less is said in seconds."""

_listener: ContextVar[Callable[[str, bool], None] | None] = ContextVar("listener", default=None)
_current: ContextVar[str] = ContextVar("current", default="")
_told: ContextVar[Told | None] = ContextVar("told", default=None)
_announcer: ContextVar[Callable[[str], None] | None] = ContextVar("announcer", default=None)


class CancelledError(Exception):
    """Nobody wants the rest of what is done."""


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


def share_done(share: float, stage: str = "") -> None:
    """Say how far it is, 0 to 1: all of it, or only a stage of it. Whoever is told may raise."""
    told = _told.get()
    if told is not None:
        told(share, stage)


@contextmanager
def telling(told: Told | None) -> Iterator[None]:
    """In this block, and thread, `told(share, stage)` is who is told, or nobody (None)."""
    before = _told.set(told)
    try:
        yield
    finally:
        _told.reset(before)


def telling_shares(progress: Callable[[float], None] | None) -> AbstractContextManager[None]:
    """In this block `progress(share)` is told how far all of it is; None: who was told before."""
    if progress is None:
        return nullcontext()
    return telling(lambda share, stage: None if stage else progress(share))


def between(low: float, high: float, stages: Sequence[str] = ()) -> AbstractContextManager[None]:
    """All of this block is that part, 0 to 1, of the block around it, and its share never falls.

    `stages`: equal parts of it in their order; who is told of other stages is told by name.
    """
    told, furthest = _told.get(), 0.0
    if told is None:
        return telling(None)

    def listener(share: float, stage: str) -> None:
        nonlocal furthest
        if stage in stages:
            share, stage = (stages.index(stage) + share) / len(stages), ""
        if not stage:
            share = furthest = max(furthest, share)
            share = low + (high - low) * share
        told(share, stage)

    return telling(listener)


def cancelled_when(due: Callable[[], bool]) -> AbstractContextManager[None]:
    """In this block who says how far it is gets a `CancelledError` from when on `due()` is true."""
    told = _told.get()

    def listener(share: float, stage: str) -> None:
        if due():
            raise CancelledError
        if told is not None:
            told(share, stage)

    return telling(listener)


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
