"""Searches that are ended again and again, and gone on with from what they wrote.

Purpose: one search in one piece, and the same one in many, through the files that a person has.
Non-goals: programs, and how many of them.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, replace
from random import Random
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.api.exploring import CheckpointOptions, checkpoints
from soter.explore.checkpoints import read_checkpoint
from soter.explore.engine import explorer_library
from soter.explore.engine.search import Search

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from soter.explore.engine.search import Found
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import System

ANYWHERE = ("-DSOTER_AHEAD=1U", "-DSOTER_BATCH=1U", "-DSOTER_TELL=1U", "-O0")
"""Flags with which a search looks at its bounds after every world: it can be ended anywhere."""
TABLES = 7
"""Which of its first numbers says that tables follow (`soter_explore_checkpoint.c`)."""
ENDED = ("states", "memory", "stopped", "no_memory")
"""How a piece ends that is not the last one."""
NEVER_S = 10.0**6


@dataclass(frozen=True)
class Said:
    """What a search says; `pieces`: how many it took. Less is said where something is violated."""

    status: str
    broken: tuple[int, int] | None
    steps: int
    states: int
    depth: int
    covered_ns: int
    closed_ns: int
    coverage: Any
    pieces: int = 1
    middles: int = 0
    """Pieces that ended in the middle of a layer."""

    def __eq__(self, other: object) -> bool:
        assert isinstance(other, Said)
        return self.told() == other.told()

    __hash__ = None  # type: ignore[assignment]

    def told(self) -> tuple[Any, ...]:
        """What has to be equal."""
        if self.broken is not None:
            return self.status, self.broken, self.steps, self.depth
        return (
            *(self.status, self.states, self.depth, self.covered_ns, self.closed_ns),
            self.coverage,
        )


@contextmanager
def anywhere() -> Iterator[None]:
    """Inside, explorers are compiled with ANYWHERE."""
    before = explorer_library.FLAGS
    explorer_library.FLAGS = (*before, *ANYWHERE)  # type: ignore[assignment]
    try:
        yield
    finally:
        explorer_library.FLAGS = before


def once(system: System, options: SearchOptions, wanted: CheckpointOptions | None = None) -> Said:
    """One search, which writes itself down if that is wanted."""
    (place,) = checkpoints(wanted, [system], options, {})
    with Search(system, options, checkpoint=place) as search:
        outcome = search.run()
        return _said(outcome, search)


def chance(seed: int) -> Random:
    """The same every time."""
    return Random(seed)  # noqa: S311 - the same pieces every time are wanted


def in_one_piece(system: System, options: SearchOptions, folder: Path) -> Said:
    """The same with one checkpoint, at its end: parts that only properties join are one part.

    Its verdict is that of the search without checkpoints.
    """
    said = once(system, options, CheckpointOptions(folder, NEVER_S, resume=False))
    free = once(system, options)
    assert said.status == free.status, f"{said}\n{free}"
    return said


def in_pieces(
    system: System,
    options: SearchOptions,
    folder: Path,
    random: Random,
    ends: Sequence[Mapping[str, Any]],
) -> Said:
    """The same in pieces, each on as many threads as chance says; the last one has no bound.

    `ends`: what is different in the options of each.
    """
    pieces = middles = 0
    for bound in (*ends, {}):
        said = once(
            system,
            replace(options, threads=random.choice((1, options.threads, 3)), **bound),
            CheckpointOptions(folder, NEVER_S, resume=any(folder.glob("*.checkpoint"))),
        )
        pieces += 1
        if said.status not in ENDED and (said.broken is None or said.steps > 0):
            break  # else time was over before a way to the violation was had
        middles += any(map(_in_the_middle, folder.glob("*.checkpoint")))
    return replace(said, pieces=pieces, middles=middles)


def bounds(random: Random, states: int, most: int = 5) -> list[dict[str, int]]:
    """At most so many numbers of configurations, each at least the one before."""
    count = random.randint(1, most)
    return [
        {"max_states": n} for n in sorted(random.randint(1, max(states, 2)) for _ in range(count))
    ]


def _in_the_middle(path: Path) -> bool:
    numbers = np.frombuffer(read_checkpoint(path).payload[: 8 * 16], dtype=np.uint64)
    return bool(numbers[TABLES])


def _said(outcome: Found, search: Search) -> Said:
    return Said(
        outcome.status,
        outcome.broken,
        len(outcome.steps),
        outcome.states,
        outcome.depth,
        outcome.covered_ns,
        outcome.closed_ns,
        search.coverage(),
    )
