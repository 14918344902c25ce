"""The phase of a long computation and its progress, for whoever waits for it.

Purpose: `phase("P2b of Cart")` where something slow begins; a progress line shows it.
`passing_phase` is one phase in the middle of another; `within_phase` mutes the phases of a block.
`share_done` tells the progress to the function that `telling` has set; `between` scales the shares
of a block to its part of the whole. `announce` gives an estimate of the time to who shows one, and
`lasting` puts it in words.
Non-goals: runs, searches and campaigns, whose options name who is told.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    Told = Callable[[float, str], None]

MINUTES_FROM_S = 90.0
"""Times from here on are said in minutes, shorter ones in seconds."""

_listener: ContextVar[Callable[[str, bool], None] | None] = ContextVar("listener", default=None)
_current: ContextVar[str] = ContextVar("current", default="")
_told: ContextVar[Told | None] = ContextVar("told", default=None)
_announcer: ContextVar[Callable[[str], None] | None] = ContextVar("announcer", default=None)


class CancelledError(Exception):
    """The computation is to stop here: nobody wants its result (`cancelled_when`)."""


def phase(name: str, *, anew: bool = False) -> None:
    """Tells the listener which phase begins; `anew`: the shares begin again from 0."""
    if (listener := _listener.get()) is not None:
        _current.set(name)
        listener(name, anew)


@contextmanager
def passing_phase(name: str) -> Iterator[None]:
    """Makes the block a phase of its own; afterwards the phase before goes on."""
    before = _current.get()
    phase(name)
    try:
        yield
    finally:
        phase(before)


@contextmanager
def within_phase() -> Iterator[None]:
    """Tells the listener no phases of this block, which are parts of the phase around it."""
    before = _listener.set(None)
    try:
        yield
    finally:
        _listener.reset(before)


def share_done(share: float, stage: str = "") -> None:
    """Tells the share that is done, 0 to 1, of the whole or of a stage. The listener may raise."""
    if (hears := _told.get()) is not None:
        hears(share, stage)


@contextmanager
def telling(hears: Told | None) -> Iterator[None]:
    """Sends the shares of this block, in this thread, to `hears(share, stage)`; None: to nobody."""
    before = _told.set(hears)
    try:
        yield
    finally:
        _told.reset(before)


def telling_shares(progress: Callable[[float], None] | None) -> AbstractContextManager[None]:
    """Sends the shares of the whole in this block to `progress(share)`; None changes nothing."""
    if progress is None:
        return nullcontext()
    return telling(lambda share, stage: None if stage else progress(share))


def between(low: float, high: float, stages: Sequence[str] = ()) -> AbstractContextManager[None]:
    """Scales the shares of this block to [low, high] of the block around it; they never fall.

    `stages`: names of equal parts of this block, in order; shares of other stages go on unscaled.
    """
    hears, furthest = _told.get(), 0.0
    if hears is None:
        return telling(None)

    def listener(share: float, stage: str) -> None:
        nonlocal furthest
        if stage in stages:
            share, stage = (stages.index(stage) + share) / len(stages), ""
        if not stage:
            share = furthest = max(furthest, share)
            share = low + (high - low) * share
        hears(share, stage)

    return telling(listener)


def cancelled_when(due: Callable[[], bool]) -> AbstractContextManager[None]:
    """Lets `share_done` raise `CancelledError` in this block once `due()` is true."""
    hears = _told.get()

    def listener(share: float, stage: str) -> None:
        if due():
            raise CancelledError
        if hears is not None:
            hears(share, stage)

    return telling(listener)


def announce(text: Callable[[], str]) -> None:
    """Tells the announcer a line, if there is one; it calls `text` only then, and omits ""."""
    announcer = _announcer.get()
    if announcer is not None and (line := text()):
        announcer(line)


def lasting(seconds: float, to_s: int = 1) -> str:
    """An estimated time in words: whole minutes, or seconds in multiples of `to_s`."""
    minutes = seconds >= MINUTES_FROM_S
    return f"{seconds / 60:.0f} min" if minutes else f"{to_s * round(seconds / to_s)} s"


@contextmanager
def listening_to_phases(
    listener: Callable[[str, bool], None], announcer: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Sends the phases of this block, in this thread, to `listener(name, anew)`.

    `announcer(line)` gets the lines of `announce`.
    """
    before = _listener.set(listener), _announcer.set(announcer), _current.set("")
    try:
        yield
    finally:
        _listener.reset(before[0])
        _announcer.reset(before[1])
        _current.reset(before[2])
