"""Fly a campaign: so many flights on so many threads, kept as they come.

Purpose: `fly`, from a fleet and a folder to all flights; the same flights whatever flies them.
Non-goals: what they say (`result.py`).
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.campaign.fleet import Fleet
    from soter.campaign.flight import Flight
    from soter.campaign.store import Store

AHEAD = 4
"""Batches a thread that are asked for before the first of them is kept."""


def fly(
    fleet: Fleet,
    store: Store,
    count: int,
    workers: int,
    progress: Callable[[float], None],
) -> None:
    """Fly what is not there yet of `count` flights, in order; what is done stands in the store.

    C runs without Python's lock, so threads are enough.
    """
    first = store.about.first_seed
    todo = range(len(store.flights), count)
    batches = deque(
        range(k, min(k + fleet.at_once, count)) for k in range(todo.start, count, fleet.at_once)
    )
    waiting: deque[Future[list[Flight]]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            while batches or waiting:
                while batches and len(waiting) < AHEAD * workers:
                    waiting.append(pool.submit(fleet.fly, batches.popleft(), first))
                store.add(waiting.popleft().result())
                progress(len(store.flights) / count)
        finally:
            for f in waiting:
                f.cancel()
