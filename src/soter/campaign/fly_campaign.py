"""Fly a campaign: so many flights by threads or by others, kept as they come.

Purpose: `fly`, from a fleet and a folder to all flights; the same flights whatever flies them.
Non-goals: what they say (`result.py`), who else flies (`ray_cluster.py`).
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager

    from soter.campaign.batch_flights import Fleet
    from soter.campaign.compiled_unit import Recipe
    from soter.campaign.flight_outcome import FlightOutcome
    from soter.campaign.store import CampaignStore

AHEAD = 4
"""Batches a worker that are asked for before the first of them is kept."""


class PendingBatch(Protocol):
    """A batch that was asked for."""

    def result(self) -> list[FlightOutcome]:
        """Its flights, waiting for them; raises what went wrong."""

    def cancel(self) -> object:
        """Nobody wants it any more."""


class FlightWorkers(Protocol):
    """Those that fly one recipe."""

    def __call__(self, numbers: Sequence[int], first_seed: int, /) -> PendingBatch:
        """Ask for the flights of these numbers."""


class Workers(Protocol):
    """Who flies instead of threads of this process."""

    @property
    def cores(self) -> int:
        """So many batches are flown at once."""

    def crew(self, recipe: Recipe) -> AbstractContextManager[FlightWorkers]:
        """Those that fly this recipe."""


def fly(
    fleet: Fleet,
    store: CampaignStore,
    count: int,
    workers: int | Workers,
    progress: Callable[[float], None],
) -> None:
    """Fly what is not there yet of `count` flights, in order; what is done stands in the store."""
    todo = range(len(store.flights), count)
    for flights in flights_of(fleet, todo, store.about.first_seed, workers):
        store.add(flights)
        progress(len(store.flights) / count)


def flights_of(
    fleet: Fleet, numbers: Sequence[int], first_seed: int, workers: int | Workers
) -> Iterator[list[FlightOutcome]]:
    """The flights of these numbers, a batch at a time, in that order."""
    batches = deque(numbers[k : k + fleet.at_once] for k in range(0, len(numbers), fleet.at_once))
    waiting: deque[PendingBatch] = deque()
    cores = workers if isinstance(workers, int) else workers.cores
    crew = _threads(fleet, workers) if isinstance(workers, int) else workers.crew(fleet.recipe)
    with crew as ask:
        try:
            while batches or waiting:
                while batches and len(waiting) < AHEAD * cores:
                    waiting.append(ask(batches.popleft(), first_seed))
                yield waiting.popleft().result()
        finally:
            for f in waiting:
                f.cancel()


@contextmanager
def _threads(fleet: Fleet, workers: int) -> Iterator[FlightWorkers]:
    """C runs without Python's lock, so threads are enough."""
    with ThreadPoolExecutor(workers) as pool:
        yield lambda numbers, first: pool.submit(fleet.fly, numbers, first)
