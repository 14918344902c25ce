"""Modules without `ttf` and `safer`: their sets are computed and put into the system.

Purpose: `complete` gives every such module of a flat system predicates that read tables, so that
interpreter, lowering and C all see them; tables are kept in the cache folder.
Non-goals: the sets (`claims.py`, `levels.py`), reading a table (`tables.py`), verdicts.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.diagnostic import SoterError
from soter.native.build import RUNTIME, cache_dir
from soter.program.walk import topic_reads
from soter.reach import claims
from soter.reach.estimates import seen
from soter.reach.extract import cases, extract
from soter.reach.forms import library_of
from soter.reach.grids import UnboundedError
from soter.reach.levels import levels
from soter.reach.polytope_sets import Polytope
from soter.reach.tables import in_order, predicates, tables

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from soter.program.system import Module, System
    from soter.reach.facets import Facets
    from soter.reach.native import ReachLibrary
    from soter.reach.problem import Group, Problem
    from soter.reach.tables import Pair, Table

    Bools = NDArray[np.bool_]
    Found = list[Table | Facets]
    Progress = Callable[[float], None]


PARTS = ("low", "high", "rows", "bounds")
NEVER = "ttf and safer are not computed, its AC never gets control"


def open_modules(flat: System) -> list[Module]:
    """Modules whose predicates are to be computed."""
    return [m for m in flat.modules if m.symbol.ttf is None and m.symbol.safer is None]


def complete(flat: System, progress: Progress | None = None) -> list[str]:
    """Give the modules of `flat` that have neither `ttf` nor `safer` computed ones, in place.

    A module that determines no verification problem, or whose problem has no solution, stays as it
    is: its AC never gets control. Gives a note about each module; `soter verify` says more.
    """
    todo = open_modules(flat)
    notes = []
    for i, module in enumerate(todo):
        try:
            problem = extract(flat, module)
        except SoterError as error:
            notes.append(f"{module.name}: {error.diagnostics[0].message}: {NEVER}")
            continue
        found = _tables(problem, _part(progress, i, len(todo)))
        if found is None:
            notes.append(f"{module.name}: SC keeps no set that could be found: {NEVER}")
            continue
        put(flat, module, problem, found)
        share = min(x.share for x in found)
        notes.append(f"{module.name}: ttf and safer computed, S_0 is {share:.1%} of the grid")
    return notes


def put(flat: System, module: Module, problem: Problem, found: Found) -> None:
    """The predicates of these tables as the module's own."""
    ttf, safer = predicates(problem, found)
    reads = tuple(topic_reads(ttf, safer))
    scope = {**flat.components[module.sc].scope.topics, **module.scope.topics}
    for topic in reads:
        module.scope.topics.setdefault(topic, scope[topic])
        flat.components[module.dm].scope.topics.setdefault(topic, scope[topic])
    module.symbol = replace(module.symbol, ttf=ttf, safer=safer, topics_read=reads)
    module.inputs = tuple(scope[topic] for topic in reads)


# ---------------------------------------------------------------- computing


def _tables(problem: Problem, progress: Progress | None) -> Found | None:
    """From the cache, or computed; None where the engine has no answer."""
    library, _ = library_of(problem)
    path = cache_dir() / "sets" / f"{_key(problem, library)}.npz"
    sets = _kept(path, problem)
    if sets is None:
        sets = _computed(problem, library, progress)
        if sets is None:
            return None
        _keep(path, sets)
    return tables(problem, sets)


def _computed(
    problem: Problem, library: ReachLibrary, progress: Progress | None
) -> list[list[Pair]] | None:
    every = list(cases(problem))
    found = []
    for i, parameter in enumerate(every):
        tell = _part(progress, i, len(every))
        try:
            case = claims.open_case(problem, library, problem.groups, parameter, _telling(tell))
            if not (claims.constraint(case) and claims.core(case)):
                return None
            claims.free_phase(case)
            levels(case)
        except UnboundedError:
            return None
        if any(f.part is not None for f in case.failures):
            return None  # what was not proved of a polytope is not used
        pairs: list[Pair] = [(part.levels[0], part.levels[-1]) for part in case.sets.groups]
        for polytope in case.sets.polytopes:
            assert polytope.sets is not None
            pairs.append((polytope.sets.allowed[0], polytope.sets.safer))
        found.append(pairs)
    return found


def _telling(progress: Progress | None) -> Callable[[str, float], None] | None:
    """As the engine tells it: K first, the tubes after it."""
    if progress is None:
        return None
    return lambda what, share: progress(0.9 * share if what == "core" else 0.9 + 0.1 * share)


def _part(progress: Progress | None, index: int, count: int) -> Progress | None:
    if progress is None:
        return None
    return lambda share: progress((index + share) / count)


# ---------------------------------------------------------------- the cache


def _key(problem: Problem, library: ReachLibrary) -> str:
    """A hash of everything the sets depend on: the enclosures' C, all numbers, the engine."""
    told = hashlib.sha256()
    for part in (
        version("soter"),
        np.__version__,
        library.path.name,
        problem.kind,
        problem.plant_period_ns,
        problem.scheme_step_ns,
        problem.states,
        problem.controls,
        problem.disturbances,
        problem.errors,
        problem.others,
        problem.parameters,
        [(g.representation, g.axes) for g in problem.groups],
        replace(problem.times, declared=frozenset()),
        sorted(problem.times.declared),
        problem.levels,
        problem.has_core_hint,
        sorted(problem.topic_leaf_of_state.items()),
        sorted(seen(problem)),
    ):
        told.update(repr(part).encode() + b"\0")
    own = sorted(Path(__file__).parent.glob("*.py")) + sorted(RUNTIME.glob("soter_*.[ch]"))
    for file in own:
        told.update(file.read_bytes())
    return told.hexdigest()


def _keep(path: Path, sets: list[list[Pair]]) -> None:
    """Write the sets; a cache that cannot be written is no error."""
    arrays: dict[str, NDArray[np.uint8] | NDArray[np.float64]] = {}
    for i, case in enumerate(sets):
        for j, pair in enumerate(case):
            for k, part in enumerate(pair):
                if isinstance(part, Polytope):
                    for name in PARTS:
                        arrays[f"{i}_{j}_{k}_{name}"] = getattr(part, name)
                else:
                    arrays[f"{i}_{j}_{k}"] = np.packbits(np.asarray(part))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".npz")
        with os.fdopen(handle, "wb") as stream:
            np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
        Path(name).replace(path)
    except OSError:
        return


def _kept(path: Path, problem: Problem) -> list[list[Pair]] | None:
    """The sets of an earlier run; None where there are none."""
    if not path.is_file():
        return None
    groups = in_order(problem)
    try:
        with np.load(path) as data:
            return [
                [_pair(data, f"{i}_{j}", group) for j, group in enumerate(groups)]
                for i, _ in enumerate(cases(problem))
            ]
    except (OSError, ValueError, KeyError):
        return None


def _pair(data: Any, name: str, group: Group) -> Pair:  # noqa: ANN401 - an open archive
    if group.representation != "grid":
        outer, inner = (Polytope(*(data[f"{name}_{k}_{part}"] for part in PARTS)) for k in range(2))
        return outer, inner
    shape = tuple(len(a.edges) - 1 for a in group.axes)
    return _unpacked(data[f"{name}_0"], shape), _unpacked(data[f"{name}_1"], shape)


def _unpacked(bits: NDArray[np.uint8], shape: tuple[int, ...]) -> Bools:
    count = int(np.prod(shape))
    return np.unpackbits(bits, count=count).astype(np.bool_).reshape(shape)
