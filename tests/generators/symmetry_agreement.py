"""The explorer with equal instances taken as one, against the enumerator, on one small program.

Purpose: the same verdict, least traces of the same length, one configuration stored for every
orbit of what is reachable, where orbits are counted over the enumerator's configurations with
instances swapped by their names; and what is reachable is closed under the swaps that the explorer
believes in. What differs is said in words.
Non-goals: making programs (`equal_instance_programs.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING

from generators.equal_instance_programs import swapped
from generators.explorer_agreement import WHAT, Small
from generators.explorer_configurations import Decoder
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions

if TYPE_CHECKING:
    from generators.brute_force import Canonical, World

HOW = (
    EngineSettings(reduction="symmetry"),
    EngineSettings(reduction="symmetry", threads=2),
    EngineSettings(reduction="symmetry", plainly=True),
    EngineSettings(reduction="symmetry", storage="fingerprint"),
    EngineSettings(reduction="all"),
    EngineSettings(reduction="all", threads=2),
)
SEEN = ("branches", "classes", "modes", "switches", "fired", "judged")


@dataclass
class Told:
    """Of one program: `equal` says which instances are taken as equal; sizes of two searches."""

    complaints: list[str] = field(default_factory=list)
    equal: tuple[tuple[str, ...], ...] = ()
    whole: int = 0
    stored: int = 0
    orbits: int = 0


def compared_as_equals(s: Small, extra: tuple[str, ...] = ()) -> Told:
    """Everything that is compared. `extra`: flags for the C compiler."""
    told = Told()
    engine = Engine(s.system, extra=extra)
    try:
        told.equal = tuple([f.names for f in engine.equal.families])
        worlds, seen = _all_of_it(s, engine, told)
        orbit = _orbits(s, engine, worlds, told)
        for how in HOW:
            _one(s, engine, how, orbit, told)
        _coverage(s, seen, told, extra)
    finally:
        engine.close()
    _as_a_user(s, told)
    return told


def _wanted(s: Small) -> str:
    return "violated" if s.found.least else "exhausted"


def _all_of_it(s: Small, engine: Engine, told: Told) -> tuple[list[World], dict[str, bytes]]:
    """What is stored without reduction, and what was seen then."""
    engine.explore(EngineSettings(reduction="none", keep=True, go_on=True))
    decoder = Decoder(s.judge, engine.plan)
    worlds = [decoder.world(w.tobytes()) for w in engine.configurations()]
    if {s.judge.canonical(w) for w in worlds} != s.found.configurations:
        told.complaints.append("without reduction: not the enumerator's configurations")
    told.whole = len(worlds)
    return worlds, {name: getattr(engine.seen, name).tobytes() for name in SEEN}


def _orbits(
    s: Small, engine: Engine, worlds: list[World], told: Told
) -> dict[Canonical, Canonical] | None:
    """One of each orbit; None where what is equal is not what the names say."""
    families = engine.equal.families
    count = sum(x.name.startswith("r[") and x.name.count(".") == 1 for x in s.system.components)
    numbers = sorted({int(x.name[2]) for x in s.system.components if x.name.startswith("r[")})
    whole = tuple(f"r[{k}]" for k in numbers)
    if not families or families[-1].names != whole or len(families) > 1 or not count:
        return None
    first = {s.judge.canonical(w): s.judge.canonical(w) for w in worlds}

    def root(x: Canonical) -> Canonical:
        while first[x] != x:
            x = first[x]
        return x

    for i, j in combinations(numbers, 2):
        swap = swapped(s.judge, i, j)
        for w in worlds:
            here, there = s.judge.canonical(w), s.judge.canonical(swap(w))
            if there not in first:
                told.complaints.append(
                    f"swapping {i} and {j} leads out of what is reachable: {there}"
                )
                return None
            first[root(here)] = root(there)
    root_by_world = {x: root(x) for x in first}
    told.orbits = len(set(root_by_world.values()))
    return root_by_world


def _one(
    s: Small,
    engine: Engine,
    how: EngineSettings,
    orbit: dict[Canonical, Canonical] | None,
    told: Told,
) -> None:
    name = f"{how.strategy}/{how.reduction}/{how.storage} on {how.threads}"
    name += " plainly" if how.plainly else ""
    exploration = engine.explore(how)
    if exploration.status != _wanted(s):
        told.complaints.append(f"{name}: {exploration.status}, not {_wanted(s)}")
        return
    if (
        exploration.broken is not None
        and (WHAT[exploration.broken[0]], exploration.broken[1]) not in s.found.least
    ):
        told.complaints.append(f"{name}: {exploration.broken} is not violated, {s.found.least} are")
    if exploration.steps:
        _check_trace(s, engine, name, how, exploration.steps, told)
    all_of_it = engine.explore(replace(how, keep=True, go_on=True))
    if how.storage == "fingerprint":
        finer = told.whole != len(s.found.configurations)
        if told.orbits and not finer and all_of_it.states != told.orbits:
            told.complaints.append(f"{name}: {all_of_it.states} states, {told.orbits} orbits")
        return
    decoder = Decoder(s.judge, engine.plan)
    worlds = [decoder.world(w.tobytes()) for w in engine.configurations()]
    stored = [s.judge.canonical(w) for w in worlds]
    if not set(stored) <= s.found.configurations:
        told.complaints.append(f"{name}: stored what is not reachable")
    if orbit is None or told.whole != len(s.found.configurations):  # it tells more apart
        return
    if how.reduction == "symmetry":
        told.stored = len(stored)
        _check_orbits(name, stored, set(s.found.configurations), orbit, told)
    elif _by_instants(s) and not s.found.least:
        ends = [s.judge.canonical(w) for w in worlds if w.c.ct >= 0]
        _check_orbits(name, ends, s.found.ends, orbit, told)


def _check_trace(
    s: Small, engine: Engine, name: str, how: EngineSettings, steps: object, told: Told
) -> None:
    """It is an execution; without leaving orders out: a shortest."""
    possible, broken, _ = engine.replay(steps)  # type: ignore[arg-type]
    length = sum(step.actor >= 0 for step in steps)  # type: ignore[attr-defined]
    if possible != len(steps) or broken is None:  # type: ignore[arg-type]
        told.complaints.append(f"{name}: {possible} of {length} steps are possible, {broken}")
    overruns = any(a.overrun for a in s.judge.actors)
    if how.reduction == "symmetry" and not overruns and length != s.found.shortest:
        told.complaints.append(f"{name}: {length} steps, not {s.found.shortest}")


def _check_orbits(
    name: str,
    stored: list[Canonical],
    reached: set[Canonical],
    orbit: dict[Canonical, Canonical],
    told: Told,
) -> None:
    """One of each orbit, and of no other."""
    wanted = {orbit[x] for x in reached}
    orbits = [orbit[x] for x in stored]
    if len(orbits) != len(set(orbits)) or set(orbits) != wanted:
        told.complaints.append(
            f"{name}: {len(orbits)} stored of {len(set(orbits))} orbits, there are {len(wanted)}"
        )


def _by_instants(s: Small) -> bool:
    plan = s.system.test
    assert plan is not None
    return not plan.skew_ns and all(f.kind == "skip" for f in plan.faults)


def _coverage(s: Small, seen: dict[str, bytes], told: Told, extra: tuple[str, ...]) -> None:
    """What was reached by one instance counts for each: as much as without taking them as one."""
    if s.found.least:  # what is judged besides what is violated depends on which comes first
        return
    other = Engine(s.system, extra=extra)
    other.explore(EngineSettings(reduction="symmetry", keep=True, go_on=True))
    for name in SEEN:
        if getattr(other.seen, name).tobytes() != seen[name]:
            told.complaints.append(f"coverage: not the same {name}")
    other.close()


def _as_a_user(s: Small, told: Told) -> None:
    """What `soter test` runs by default."""
    with Search(s.system, SearchOptions()) as search:
        outcome = search.run()
    if outcome.status != _wanted(s):
        told.complaints.append(f"as a user: {outcome.status}, not {_wanted(s)}")
