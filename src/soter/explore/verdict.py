"""What a search of a test comes to.

Purpose: the verdict, the bound that was reached, what a search that ended leaves out.
Non-goals: searching, traces of violations (`command.py`); what bounds mean (`results.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.explore import assumptions, vacuous_tests
from soter.explore.allowed_steps import plan_of
from soter.explore.results import (
    BOUND,
    CHOICES,
    DRAWN,
    EXHAUSTED,
    GRID,
    INTERRUPTED,
    LENGTH,
    MEMORY,
    PICKED,
    RUNS,
    SAMPLED,
    STATES,
    TIME,
    UNDRIVEN,
    UNJUDGED,
    VIOLATED,
    WIDTH,
)
from soter.explore.search_options import SAMPLING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.explore.engine.coverage import Coverage
    from soter.explore.engine.search import Found, Search
    from soter.explore.search_options import SearchOptions
    from soter.explore.vacuous_tests import VacuousPart
    from soter.language.model.system import System

ENDS = {
    "memory": MEMORY,
    "states": STATES,
    "runs": RUNS,
    "stopped": INTERRUPTED,
    "no_memory": MEMORY,
    "choices": CHOICES,
    "width": WIDTH,
    "length": LENGTH,
}
"""How a search ends, and the bound that is."""


def vacuous_parts(
    system: System,
    search: Search,
    coverage: Coverage,
    search_result: Found,
    replaced: Sequence[tuple[str, str]],
) -> tuple[VacuousPart, ...]:
    """What of a test says nothing; what was not met counts where the search came to its end."""
    ended = search_result.status == "exhausted" and search.options.strategy not in SAMPLING
    never = coverage.modes.unreached
    return vacuous_tests.of_test(system, search.met(), never, replaced, ended=ended)


def short_of_test(system: System, search: Search, coverage: Coverage) -> str | None:
    """What an exhaustive search of a test does not cover; None where it is every execution."""
    if not coverage.properties.reached:
        return UNJUDGED
    if assumptions.undriven(system):
        return UNDRIVEN
    if assumptions.picked(system):
        return PICKED
    if assumptions.held(system):
        return DRAWN
    if search.times is not None and (search.times.open or search.times.crowded):
        return GRID
    return SAMPLED if search.sampled else None


def verdict_of(
    search_result: Found, options: SearchOptions, short_of: str | None
) -> tuple[str, str | None]:
    """The verdict, and which bound was reached; `short_of`: the bound of a search that ended."""
    if search_result.status == "violated":
        return VIOLATED, None
    if search_result.status == "exhausted":
        if options.strategy in SAMPLING:
            return BOUND, RUNS
        return (EXHAUSTED, None) if short_of is None else (BOUND, short_of)
    return BOUND, TIME if search_result.stopped == TIME else ENDS[search_result.status]


def covered_before(search_result: Found, system: System, options: SearchOptions) -> int | None:
    """Before which time everything was judged; None where executions are drawn by chance."""
    if options.strategy in SAMPLING:
        return None
    return min(search_result.covered_ns, plan_of(system).horizon_ns)
