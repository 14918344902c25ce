"""Flies a campaign: its flights by threads or on a Ray cluster, stored as they come.

Purpose: `fly` flies all flights of a fleet and stores them; they are the same whatever flies them:
threads, or the workers that `join_cluster` gives, on Ray. The recipe is sent (the generated C and
how to read a state); each process compiles it once and keeps it. A batch whose worker dies is flown
again by another one.
Non-goals: what the flights say (`result.py`), keeping them (`store.py`), starting clusters of
several machines (Ray's own tools).
"""

from __future__ import annotations

import logging
import os
import pickle
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Protocol

from soter.campaign.batch_flights import BATCH, Flyer
from soter.campaign.recipe import unpacked_recipe
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.evaluate.arithmetic import require_default_float_rules
from soter.native.cache import digest, files_below
from soter.native.shared_library import NEVER_SHIPPED, RUNTIME
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.campaign.batch_flights import Fleet
    from soter.campaign.recipe import Recipe
    from soter.campaign.store import CampaignStore, FlightOutcome

    AskFlights = Callable[[Sequence[int], int], "PendingBatch"]
    """Asks for the flights of these numbers, from a first seed."""


AHEAD = 4
"""How many batches for each worker are asked for before the first of them is stored."""


class PendingBatch(Protocol):
    """A batch of flights that a worker was asked to fly."""

    def result(self) -> list[FlightOutcome]:
        """Waits for the flights and returns them; raises the worker's error."""

    def cancel(self) -> object:
        """Cancels the batch, as nobody needs its flights any more."""


def fly(
    fleet: Fleet,
    store: CampaignStore,
    count: int,
    workers: int | RayCluster,
    progress: Callable[[float], None],
) -> None:
    """Flies the flights below number `count` that the store lacks, and stores each batch."""
    todo = range(len(store.flights), count)
    for flights in fly_batches(fleet, todo, store.about.first_seed, workers):
        store.add_flights(flights)
        progress(len(store.flights) / count)


def fly_batches(
    fleet: Fleet, numbers: Sequence[int], first_seed: int, workers: int | RayCluster
) -> Iterator[list[FlightOutcome]]:
    """Yields the flights of these numbers, a batch at a time, in that order."""
    batches = deque(numbers[k : k + fleet.at_once] for k in range(0, len(numbers), fleet.at_once))
    waiting: deque[PendingBatch] = deque()
    cores = workers if isinstance(workers, int) else workers.cores
    pool = _thread_pool(fleet, workers) if isinstance(workers, int) else workers.pool(fleet.recipe)
    with pool as ask:
        try:
            while batches or waiting:
                while batches and len(waiting) < AHEAD * cores:
                    waiting.append(ask(batches.popleft(), first_seed))
                yield waiting.popleft().result()
        finally:
            for f in waiting:
                f.cancel()


@contextmanager
def _thread_pool(fleet: Fleet, workers: int) -> Iterator[AskFlights]:
    """Makes a `with` block with a function that flies batches in threads, without Python's lock."""
    with ThreadPoolExecutor(workers) as pool:
        yield lambda numbers, first: pool.submit(fleet.fly, numbers, first)


TRIES = 5
"""How often a batch is flown whose workers die."""
ONE_SOTER = "every machine of the cluster needs the same Soter, and a C compiler"
QUIET = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_IGNORE_UNHANDLED_ERRORS": "1"}
"""Ray sends no usage figures, and reports no errors of batches that are no longer wanted."""


@dataclass(frozen=True)
class WorkerReply:
    """The reply of a worker: the flights of a batch, or why it has none."""

    flights: list[FlightOutcome]
    wrong: tuple[Diagnostic, ...] = ()


def require_ray() -> None:
    """Raises SoterError D007 if Ray is not installed."""
    if find_spec("ray") is None:
        message = "a cluster is flown on with the package `ray`, which is not installed"
        helps = (f"install it: {pip_command('cluster')}; `--workers local` flies the same here",)
        raise SoterError((Diagnostic("D007", message, helps=helps),))


@contextmanager
def join_cluster() -> Iterator[RayCluster]:
    """Opens a `with` block with the cluster of $RAY_ADDRESS, or else a cluster on this machine.

    It leaves a cluster that this call joined or started at the end of the block. Raises D007
    without Ray, D018 if it cannot be joined.
    """
    require_ray()
    os.environ.update({k: v for k, v in QUIET.items() if k not in os.environ})
    ray: Any = import_module("ray")  # an extra
    joined = ray.is_initialized()
    try:
        if not joined:
            ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
        cores = int(ray.cluster_resources().get("CPU", 0))
    except (ray.exceptions.RayError, OSError, RuntimeError, ValueError) as error:
        raise _trouble("the cluster cannot be joined", str(error)) from error
    try:
        if cores < 1:
            raise _trouble("the cluster has no core", "a batch asks for one")
        yield RayCluster(ray, cores)
    finally:
        if not joined:
            ray.shutdown()


@dataclass(frozen=True)
class RayCluster:
    """A cluster that this process joined; `ray` is the Python module."""

    ray: Any
    cores: int

    @contextmanager
    def pool(self, recipe: Recipe) -> Iterator[AskFlights]:
        """Makes a `with` block with a function that sends batches of a recipe to the cluster."""
        ray = self.ray
        packed = pickle.dumps(recipe)
        sent = ray.put(packed)
        task = ray.remote(num_cpus=1, max_retries=0)(fly_batch)
        key, soter = digest([packed.hex()]), soter_digest()
        yield lambda numbers, first: _Batch(
            ray, lambda: task.remote(key, sent, soter, list(numbers), first), numbers
        )


class _Batch:
    """A batch of flights that the cluster was asked to fly."""

    def __init__(self, ray: Any, ask: Any, numbers: Sequence[int]) -> None:  # noqa: ANN401 - Ray's
        self.ray, self.ask, self.numbers = ray, ask, numbers
        self.asked = ask()

    def result(self) -> list[FlightOutcome]:
        """Waits for the flights. Raises D018 if workers die repeatedly, or a worker's error."""
        wrong = self.ray.exceptions
        last = ""
        for _ in range(TRIES):
            try:
                reply: WorkerReply = self.ray.get(self.asked)
            except wrong.RayTaskError as error:
                raise _trouble("a worker cannot fly", _last_line(error), ONE_SOTER) from error
            except wrong.RayError as error:  # it died, its machine did, the network did
                last = _first_line(error)
                self.asked = self.ask()
            else:
                if reply.wrong:
                    raise SoterError(reply.wrong)
                return reply.flights
        self.cancel()
        which = f"flights {self.numbers[0]} to {self.numbers[-1]}"
        raise _trouble(f"{TRIES} workers died over {which}; those before are kept", last)

    def cancel(self) -> None:
        """Cancels the batch's task."""
        self.ray.cancel(self.asked, force=True)


# ---------------------------------------------------------------- in the worker

_flyers: dict[str, Flyer] = {}
"""The recipes that this process has compiled, by their digests."""


def fly_batch(key: str, packed: bytes, soter: str, numbers: list[int], first: int) -> WorkerReply:
    """Flies a batch in a process of the cluster; `soter` is the sender's `soter_digest`."""
    try:
        require_default_float_rules()
        if soter != soter_digest():
            raise _trouble("a worker has another Soter", "its flights might be others", ONE_SOTER)
        if key not in _flyers:
            _flyers[key] = Flyer(unpacked_recipe(pickle.loads(packed)))  # noqa: S301 - of the same user
        return WorkerReply(_flyers[key].fly(numbers, first))
    except SoterError as error:
        return WorkerReply([], error.diagnostics)


@cache
def soter_digest() -> str:
    """The digest of Soter's files that flights depend on besides the recipe."""
    folders = (RUNTIME, NEVER_SHIPPED, BATCH.parents[1])
    files = [p for folder in folders for p in files_below(folder, "*.py", "*.c", "*.h")]
    return digest([x for p in files for x in (p.name, p.read_text(encoding="utf-8"))])


def _trouble(message: str, why: str, *helps: str) -> SoterError:
    return SoterError((Diagnostic("D018", message, notes=(why,) if why else (), helps=helps),))


def _first_line(error: Exception) -> str:
    return next((line for line in str(error).splitlines() if line.strip()), "").strip()


def _last_line(error: Exception) -> str:
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1].strip() if lines else ""
