"""What is being done just now, for whoever waits for it.

Purpose: `phase("P2b of Cart")` where something that takes long begins; a progress line shows it.
`announce`: a line about how long it will take, for whoever shows one.
Non-goals: how far it is: those who know call their `progress`.
"""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_listener: ContextVar[Callable[[str, bool], None] | None] = ContextVar("listener", default=None)
_announcer: ContextVar[Callable[[str], None] | None] = ContextVar("announcer", default=None)


def phase(name: str, *, anew: bool = False) -> None:
    """Say what begins; `anew`: shares that are told from here on begin at nothing."""
    listener = _listener.get()
    if listener is not None:
        listener(name, anew)


def announce(text: Callable[[], str]) -> None:
    """Say a line once; `text` is asked only where somebody listens, and "" is not said."""
    announcer = _announcer.get()
    if announcer is not None and (line := text()):
        announcer(line)


@contextmanager
def listening_to_phases(
    listener: Callable[[str, bool], None], announcer: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Let `listener(name, anew)` know of the phases of this block, in this thread.

    `announcer(line)` is told what is announced.
    """
    before = _listener.set(listener), _announcer.set(announcer)
    try:
        yield
    finally:
        _listener.reset(before[0])
        _announcer.reset(before[1])
