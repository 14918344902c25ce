"""Which of two reductions `all` is: what the first steps of a search show.

Purpose: where all windows are points a search may store ends of instants only, and combine what
groups of actors do that share nothing; or store what lies between, too, with ample sets, and look
at each middle once. Which is quicker depends on the program. Both are begun, for as many steps that
are run; the one that came further goes on, from the start. No clock is asked, so that a search is
the same wherever and on however many threads it runs.
Non-goals: verdicts, which are the same either way (docs/testing.md, "Reduction").
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.explore.engine.explorer_library import EngineSettings
from soter.explore.methods import STORAGES, STRATEGIES

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.explore.engine.explorer_library import Engine, Searched
    from soter.explore.engine.progress import EngineProgress

RUN = 2_000
"""Steps of each of the two beginnings: about as many as a thousand configurations take."""
PLACES = 6
"""Orders of equal instances from which on they change places: to put two into order takes longer
than to search both."""
SHORT_OF_MEMORY = ("memory", "no_memory")
CUT_SHORT = (*SHORT_OF_MEMORY, "states", "stopped")


def may_choose(s: EngineSettings) -> bool:
    """Whether a search leaves it open which of the two it is.

    Not where somebody asked for one, or for what depends on what is stored: a bound on
    configurations, all of them kept, what is noted of ends.
    """
    asked = s.reduction != "all" or s.strategy != STRATEGIES[0] or s.storage != STORAGES[0]
    stored = s.max_states or s.keep or s.go_on or s.known or s.noted is not None
    return not (asked or stored or s.plainly)


def explored(
    engine: Engine,
    s: EngineSettings,
    look: Callable[[EngineProgress], None] | None = None,
    left_s: float = math.inf,
) -> Searched:
    """`Engine.explore` by the quicker of the two, where that is left open; `seconds`: of all of it.

    What lies between takes more memory: where there is too little, only ends are stored after all.
    """
    began = time.perf_counter()

    def left() -> float:
        return max(left_s - (time.perf_counter() - began), 0.0)

    def ran(how: EngineSettings) -> Searched:
        return engine.explore(how, look, left())

    chosen = _chosen(engine, s, left_s) if may_choose(s) else s
    result = ran(chosen) if isinstance(chosen, EngineSettings) else chosen
    if result.status in SHORT_OF_MEMORY and chosen != s:
        ends = ran(s)
        if ends.status not in CUT_SHORT or ends.covered_ns >= result.covered_ns:
            result = ends  # what it found counts, however far the other one came
    return replace(result, seconds=time.perf_counter() - began)


def _chosen(engine: Engine, s: EngineSettings, left_s: float) -> EngineSettings | Searched:
    """What to do; where steps are remembered, to make one is quicker than to know who sleeps."""
    if _has_instants(engine):
        return _quicker(engine, s, left_s)
    return replace(s, between=True) if engine.model.brief else s


def _has_instants(engine: Engine) -> bool:
    """Whether all windows are points: only ends of instants may be observed."""
    late = any(a.window_ns or a.overrun_ns for a in engine.actors)
    return not engine.plan.timely and not late


def _quicker(engine: Engine, s: EngineSettings, left_s: float) -> EngineSettings | Searched:
    """The settings of the search that goes on; or what it found, where that took few steps."""
    ends = engine.explore(replace(s, max_ran=RUN, threads=1), None, left_s)
    if ends.status != "states" or ends.stopped:
        return ends
    apart = between(engine, s)
    middle = engine.explore(replace(apart, max_ran=RUN, threads=1), None, left_s)
    if middle.status != "states" or middle.stopped:
        return middle
    further = ends.covered_ns - middle.covered_ns
    combines = ends.combined * 2 > ends.transitions
    return s if further > 0 or (further == 0 and combines) else apart


def between(engine: Engine, s: EngineSettings) -> EngineSettings:
    """The search that stores what lies between ends of instants."""
    orders = math.prod(math.factorial(len(f.blocks)) for f in engine.families(s))
    reduction = s.reduction if orders >= PLACES else "parts"
    return replace(s, between=True, reduction=reduction)
