"""One run that violates a property, for whoever cannot prove that there is none.

Purpose: a short, quiet search of a system with a test plan; a run counts when the reference
interpreter has replayed it.
Non-goals: reports, files, verdicts of tests (`command.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError
from soter.explore.command import TraceHeader, UnreproducedError, explore_test
from soter.explore.results import VIOLATED
from soter.explore.search_options import SearchOptions

if TYPE_CHECKING:
    from soter.language.model.system import System

SEARCH_S = 30.0
SHORTEN_S = 5.0
MEMORY = 2**29


@dataclass(frozen=True)
class ViolatingRun:
    """What a run violates: `property` or `fault` and the like, in words, when; its steps."""

    what: str
    text: str
    time_ns: int
    lines: tuple[str, ...]


def violation_of(system: System) -> ViolatingRun | None:
    """A run of a flat system with a test plan that violates one of its properties.

    None where none was found, or the system cannot be explored.
    """
    options = SearchOptions(time=SEARCH_S, minimise=SHORTEN_S, memory=MEMORY)
    try:
        result = explore_test(system, options, TraceHeader(system.program.path, {}))
    except (SoterError, UnreproducedError):
        return None
    if result.verdict != VIOLATED or result.replayed is None or not result.replayed.reproduced:
        return None
    assert result.broken is not None
    lines = []
    steps = result.replayed.trace.steps
    for step in steps:
        if step.matters is not False:
            chosen = ", ".join(str(c.value) for c in step.choices if c.value is not None)
            what = f" chooses {chosen}" if chosen else ""
            lines.append(f"{step.time_ns / 1e6:g} ms  {step.actor or 'start'}{what}")
    time_ns = steps[-1].time_ns
    lines.append(f"{time_ns / 1e6:g} ms  violated: {result.broken.text}")
    return ViolatingRun(result.broken.what, result.broken.text, time_ns, tuple(lines))
