"""The phase of a long computation and its progress, for whoever waits for it.

Purpose: `phase("P2b of Cart")` where something slow begins; a progress line shows it.
`passing_phase` is one phase in the middle of another; `within_phase` mutes the phases of a block.
`share_done` tells the progress to the function that `shares_to` has set; `between` scales the
shares of a block to its part of the whole. `announce` tells an estimate of the time,
`lasting` puts one in words.
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
_share_hearer: ContextVar[Told | None] = ContextVar("told", default=None)
_announcer: ContextVar[Callable[[str], None] | None] = ContextVar("announcer", default=None)


class CancelledError(Exception):
    """Raised to stop a computation whose result is no longer wanted (`cancelled_when`)."""


def phase(name: str, *, anew: bool = False) -> None:
    """Tells the listener that a phase begins; `anew`: shares begin again from 0."""
    if (listener := _listener.get()) is not None:
        _current.set(name)
        listener(name, anew)


@contextmanager
def passing_phase(name: str) -> Iterator[None]:
    """Makes the block a separate phase; after the block, the earlier phase continues."""
    before = _current.get()
    phase(name)
    try:
        yield
    finally:
        phase(before)


@contextmanager
def within_phase() -> Iterator[None]:
    """Hides the phases of this block from the listener, which sees only the phase around it."""
    before = _listener.set(None)
    try:
        yield
    finally:
        _listener.reset(before)


def share_done(share: float, stage: str = "") -> None:
    """Reports the share done, 0 to 1, of all work or of a stage; the listener may raise."""
    if (hears := _share_hearer.get()) is not None:
        hears(share, stage)


@contextmanager
def shares_to(hears: Told | None) -> Iterator[None]:
    """Sends the shares of this block, in this thread, to `hears(share, stage)`; None hides them."""
    before = _share_hearer.set(hears)
    try:
        yield
    finally:
        _share_hearer.reset(before)


def whole_shares_to(progress: Callable[[float], None] | None) -> AbstractContextManager[None]:
    """Sends shares of all work, not of stages, to `progress(share)`; None changes nothing."""
    if progress is None:
        return nullcontext()
    return shares_to(lambda share, stage: None if stage else progress(share))


def between(low: float, high: float, stages: Sequence[str] = ()) -> AbstractContextManager[None]:
    """Scales the shares of this block to [low, high] of the outer block; they never fall.

    `stages`: names of equal parts of this block, in order; shares of other stages stay unscaled.
    """
    hears, furthest = _share_hearer.get(), 0.0
    if hears is None:
        return shares_to(None)

    def listener(share: float, stage: str) -> None:
        nonlocal furthest
        if stage in stages:
            share, stage = (stages.index(stage) + share) / len(stages), ""
        if not stage:
            share = furthest = max(furthest, share)
            share = low + (high - low) * share
        hears(share, stage)

    return shares_to(listener)


def cancelled_when(due: Callable[[], bool]) -> AbstractContextManager[None]:
    """Makes `share_done` raise `CancelledError` in this block once `due()` is true."""
    hears = _share_hearer.get()

    def listener(share: float, stage: str) -> None:
        if due():
            raise CancelledError
        if hears is not None:
            hears(share, stage)

    return shares_to(listener)


def announce(text: Callable[[], str]) -> None:
    """Passes the line `text()` to the announcer, if one is set and the line is not ""."""
    announcer = _announcer.get()
    if announcer is not None and (line := text()):
        announcer(line)


def lasting(seconds: float, to_s: int = 1) -> str:
    """An estimated time in words: whole minutes, or a multiple of `to_s` seconds."""
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
