"""The explorer against the brute-force enumerator, on one small program.

Purpose: the same verdict, the same shortest traces, the same configurations, or, under reductions
that leave configurations out, the same observations. What differs is said in words.
Non-goals: making programs (`small_test_programs.py`), deciding how many.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import count
from typing import TYPE_CHECKING

from generators.brute_force import BruteForce, TooLargeError
from generators.explorer_configurations import Decoder, replay, stored_configurations
from generators.small_test_programs import small_program
from soter.diagnostics.diagnostic import SoterError
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.reductions import ComposedSearch
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from generators.brute_force import Broken, Canonical, Found, World
    from soter.language.model.system import System

WHAT = ("property", "contract", "fault", "timed")
REDUCTIONS = ("none", "sleep", "ample", "instants", "groups", "all")
MOST = 6_000
"""Transitions of a small program, at most."""


@dataclass
class Small:
    """A small program and everything that it can do."""

    seed: int
    text: str
    system: System
    judge: BruteForce
    found: Found


@dataclass
class Compared:
    """What the comparison of one program found.

    `states` per reduction (breadth first); `twice`: configurations that the explorer stores more
    than once because it tells apart what makes no difference.
    """

    seed: int
    complaints: list[str] = field(default_factory=list)
    states: dict[str, int] = field(default_factory=dict)
    twice: int = 0
    ends: bool = False
    """Whether only ends of instants were stored where that was asked for."""
    joined: bool = False
    """Whether parts were explored alone that properties join."""


def small(seed: int, most: int = MOST, make: Callable[[int], str] = small_program) -> Small | None:
    """Program number `seed`, enumerated; None where it is refused, too large, or does nothing."""
    try:
        return enumerated(seed, make(seed), most)
    except (SoterError, TooLargeError):
        return None


def enumerated(seed: int, text: str, most: int = MOST) -> Small:
    """A program, its test `T` enumerated."""
    system = system_of_test(check_file(f"p{seed}.soter", text), "T")
    judge = BruteForce(system)
    return Small(seed, text, system, judge, judge.run(most))


def small_ones(first: int = 0, make: Callable[[int], str] = small_program) -> Iterator[Small]:
    """Small programs without end, in the order of their seeds."""
    for seed in count(first):
        made = small(seed, make=make)
        if made is not None:
            yield made


def compared(s: Small, extra: tuple[str, ...] = ()) -> Compared:
    """Everything that is compared on one program. `extra`: flags for the C compiler."""
    told = Compared(s.seed)
    engine = Engine(s.system, extra=extra)
    try:
        for reduction in REDUCTIONS:
            _one(s, engine, EngineSettings(reduction=reduction), told)
        _one(s, engine, EngineSettings(reduction="none", threads=2), told)
        _one(s, engine, EngineSettings(reduction="all", threads=2), told)
        _one(s, engine, EngineSettings(reduction="groups", threads=2), told)
        _one(s, engine, EngineSettings(reduction="instants", plainly=True), told)
        _one(s, engine, EngineSettings(reduction="none", plainly=True), told)
        _fingerprints(engine, told)
        _as_a_user(s, told)
        _joined(s, engine, told)
        _least(s, engine, told)
    finally:
        engine.close()
    return told


def _one(s: Small, engine: Engine, how: EngineSettings, told: Compared) -> None:
    """One search that stores what it reaches, and one that stops at a violation."""
    name = f"{how.strategy}/{how.reduction}"
    name += f" on {how.threads} threads" if how.threads > 1 else ""
    name += " plainly" if how.plainly else ""
    stopping = engine.explore(how)
    wanted = "violated" if s.found.least else "exhausted"
    if stopping.status != wanted:
        told.complaints.append(f"{name}: {stopping.status}, not {wanted}")
    _check_broken(s, name, stopping.broken, told)
    all_of_it = engine.explore(replace(how, keep=True, go_on=True))
    if all_of_it.status != wanted:
        told.complaints.append(f"{name}, going on: {all_of_it.status}, not {wanted}")
    decoder = Decoder(s.judge, engine.plan)
    worlds = [decoder.world(w.tobytes()) for w in stored_configurations(engine)]
    stored = [s.judge.canonical(w) for w in worlds]
    if how.threads == 1 and not how.plainly:
        told.states[how.reduction] = len(stored)
    if len(stored) != all_of_it.states:
        told.complaints.append(f"{name}: {all_of_it.states} states, {len(stored)} kept")
    _check_set(s, name, set(stored), how.reduction, told)
    _check_ends(s, name, how, worlds, told)
    seen = {s.judge.sees.projection(w) for w in worlds if s.judge.observable(w)}
    if not seen <= s.found.observed or (not s.found.least and seen != s.found.observed):
        told.complaints.append(
            f"{name}: {_difference(s.found.observed, seen)} observations of {len(s.found.observed)}"
        )
    told.twice = max(told.twice, len(stored) - len(set(stored)))


def _check_set(s: Small, name: str, stored: set[Canonical], reduction: str, told: Compared) -> None:
    """Equal where the reduction keeps every configuration.

    Sleep sets do as long as nothing is violated: they count on the same steps in another order,
    and what violates is not continued.
    """
    wanted = s.found.configurations
    whole = reduction == "none" or (reduction == "sleep" and not s.found.least)
    right = stored == wanted if whole else stored <= wanted
    if not right:
        told.complaints.append(
            f"{name}: {_difference(wanted, stored)} configurations of {len(wanted)}"
            f"{_example(wanted, stored)}"
        )


def _check_ends(
    s: Small, name: str, how: EngineSettings, worlds: list[World], told: Compared
) -> None:
    """Where all windows are points, what is stored is observable, but for the start.

    And all that is observable is stored; with ample and sleep sets as long as nothing is violated.
    """
    if how.reduction not in {"instants", "groups", "all"}:
        return
    plan = s.system.test
    assert plan is not None
    told.ends = not plan.skew_ns and all(f.kind == "skip" for f in plan.faults)
    middle = sum(w.c.ct >= 0 and not s.judge.observable(w) for w in worlds)
    if told.ends and middle:
        told.complaints.append(f"{name}: {middle} stored in the middle of an instant")
    stored = {s.judge.canonical(w) for w in worlds if w.c.ct >= 0}
    may_lack = how.reduction == "all" and s.found.least
    if told.ends and stored != s.found.ends and not (may_lack and stored <= s.found.ends):
        told.complaints.append(
            f"{name}: {_difference(s.found.ends, stored)} ends of {len(s.found.ends)}"
        )


def _difference(wanted: set[Canonical], actual: set[Canonical]) -> str:
    return f"{len(wanted - actual)} missing, {len(actual - wanted)} too many"


def _example(wanted: set[Canonical], actual: set[Canonical]) -> str:
    lines = []
    for name, some in (("missing", wanted - actual), ("too many", actual - wanted)):
        if some:
            lines.append(f"\n  {name}: {min(some, key=lambda c: (c[0], repr(c)))}")
    return "".join(lines)


def _check_broken(s: Small, name: str, broken: tuple[int, int] | None, told: Compared) -> None:
    if broken is not None and _named(broken) not in s.found.least:
        told.complaints.append(f"{name}: {_named(broken)} is not violated, {s.found.least} are")


def _named(broken: tuple[int, int]) -> Broken:
    return WHAT[broken[0]], broken[1]


def _as_a_user(s: Small, told: Compared) -> None:
    """What `soter test` runs by default: all reductions, parts of the system apart."""
    with Search(s.system, SearchOptions()) as search:
        outcome = search.run()
    wanted = "violated" if s.found.least else "exhausted"
    name = f"{search.parts} parts"
    if outcome.status != wanted:
        told.complaints.append(f"{name}: {outcome.status}, not {wanted}: {s.found.least}")
    _check_broken(s, name, outcome.broken, told)


def _joined(s: Small, engine: Engine, told: Compared) -> None:
    """Parts that properties join: the same verdict, and an execution that breaks what it says."""
    if not ComposedSearch.can_search(engine, EngineSettings()) or engine.is_violated_at_start():
        return
    outcomes = ComposedSearch(engine, EngineSettings(), None).search_parts(math.inf)
    if outcomes is None:
        return
    told.joined = True
    wanted = "violated" if s.found.least else "exhausted"
    if outcomes[-1].status != wanted:
        told.complaints.append(f"joined: {outcomes[-1].status}, not {wanted}: {s.found.least}")
    _check_broken(s, "joined", outcomes[-1].broken, told)
    if outcomes[-1].broken is not None:
        possible, breaks, _ = replay(engine, outcomes[-1].steps, outcomes[-1].broken)
        if not breaks or not possible:
            told.complaints.append(
                f"joined: {possible} of {len(outcomes[-1].steps)} steps, {breaks}"
            )


def _fingerprints(engine: Engine, told: Compared) -> None:
    """64 bits tell as many configurations apart as whole ones do, here."""
    exact = engine.explore(EngineSettings(storage="exact", reduction="none", go_on=True))
    short = engine.explore(EngineSettings(storage="fingerprint", reduction="none", go_on=True))
    if exact.states != short.states:
        told.complaints.append(f"fingerprints: {short.states} states, exact {exact.states}")


def _least(s: Small, engine: Engine, told: Compared) -> None:
    """The least trace to every violation is as long as the shortest that there is, and a trace."""
    for (what, index), moves in s.found.shortest_to().items():
        broken = (WHAT.index(what), index)
        least = engine.find_shortest_trace(EngineSettings(), broken)
        if least.status != "violated":
            told.complaints.append(f"least trace to {what} {index}: {least.status}")
            continue
        length = sum(step.actor >= 0 for step in least.steps)
        if length != moves:
            told.complaints.append(f"least trace to {what} {index}: {length} steps, not {moves}")
        possible, breaks, _ = replay(engine, least.steps, broken)
        if not breaks:
            told.complaints.append(
                f"least trace to {what} {index}: {possible} of {len(least.steps)} steps, {breaks}"
            )
