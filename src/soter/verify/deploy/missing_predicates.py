"""Computes `ttf` and `safer` of modules that declare neither, and puts them into the system.

Purpose: `complete` gives every such module of a flat system predicates that read tables, so that
interpreter, lowering and C all see them; the sets are kept in the cache folder.
Non-goals: computing sets (`verify/claims/`), tables (`level_tables.py`), verdicts.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
from dataclasses import replace
from functools import partial
from math import prod
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from soter.diagnostics.current_phase import between, phase, share_done
from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless
from soter.language.model.system import LEVELS_DEFAULT
from soter.language.model.tree_walk import joined, topic_reads
from soter.language.model.typed import Literal, TypedUnary
from soter.language.model.types import BOOL
from soter.native.cache import SOTER, digest, files_below, find_cached, new_entry
from soter.verify.claims import claims
from soter.verify.claims.choose_cells_and_levels import cases_with_way_back, choose_cells_and_levels
from soter.verify.claims.claims import compute_levels
from soter.verify.deploy.level_tables import (
    GroupTable,
    grid_ends,
    pairs_of,
    predicates_of_tables,
    tables_of_groups,
)
from soter.verify.deploy.shield_tables import ShieldWriter, shield_expressions
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.grid.claims import arrays_of_levels, levels_from_arrays
from soter.verify.grid.grid_refinement import announce_work, cell_count
from soter.verify.grid.group_model import UnboundedError
from soter.verify.problem.extract import extract, parameter_cases
from soter.verify.problem.inputs import topics_seen_by_dm
from soter.verify.tubes.compiled_calls import is_compiler_found
from soter.verify.tubes.generated_functions import TooLongError
from soter.verify.tubes.kinks import kinks_of
from soter.verify.tubes.noise_estimate import moves_quickly
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.rest_claims import RestClaims, rest_entry, show_rest_claims, too_long_error
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.tube_levels import TubeLevels
from soter.verify.tubes.tube_precision import FINE, MOST, PLAIN, PRECISIONS
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.language.model.system import Module, Shield, System
    from soter.language.model.typed import Cost, TopicSymbol, TypedExpr
    from soter.verify.claims.results import ModuleResult
    from soter.verify.deploy.level_tables import Estimates, LevelTable, Pairs
    from soter.verify.enclose.compiled_enclosures import ReachLibrary
    from soter.verify.grid.case import Case
    from soter.verify.problem.problem import Group, Problem

    Found = Sequence[LevelTable]
    Sets = tuple[Problem, list[Pairs]]
    """A problem with the chosen cells and number of levels, and the pairs of sets of every case."""

ENGINE_ROOMS = ("codegen", "core", "language", "runtime", "semantics", "verify")
"""The packages whose files a set depends on: a change in them makes cached sets useless."""
FILE, REST, LEVELS, EDGES = "sets.npz", "rest", "levels", "edges"
OF_SETS = ("P2a", "ttf", "safer")
"""The claims that have to hold so that the sets of a proof may be kept for flying."""
NEVER = "ttf and safer are not computed, its AC never gets control"


class Known(Protocol):
    """A source of sets that need no computation; it also learns which tables are built."""

    def sets(self, problem: Problem) -> list[Pairs] | None:
        """The pairs (S_0, S_(m-2)) of every case; None if the source does not have them."""

    def check_build(self, problem: Problem, level_tables: Found) -> None:
        """Is told the tables of a module's DM (none: no predicates); may raise to refuse them."""


def modules_to_complete(flat: System) -> list[Module]:
    """The modules whose predicates are to be computed."""
    return [m for m in flat.modules if m.symbol.ttf is None and m.symbol.safer is None]


def complete(flat: System, known: Known | None = None) -> list[str]:
    """Computes missing `ttf` and `safer` of the modules of `flat`, and stores them in the modules.

    A module stays as it is if it determines no verification problem or if no sets are found; its AC
    then never gets control. `known`: sets that need no computation. Returns a note about each
    module. A listener to the progress may raise `CancelledError`.
    """
    if flat.proved is not None:  # of a deployed system: what was computed where it was proved
        notes = complete(flat.proved, known)
        _copy_predicates(flat, flat.proved)
        return notes
    todo = modules_to_complete(flat)
    notes = []
    for i, module in enumerate(todo):
        try:
            problem = extract(faultless(flat), module)
        except SoterError as error:
            notes.append(f"{module.name}: {error.diagnostics[0].message}: {NEVER}")
            continue
        if isinstance(problem, TubeProblem):
            with between(i / len(todo), (i + 1) / len(todo)):
                notes.append(_install_tube_predicates(flat, module, problem, known))
            continue
        sets = None if known is None else known.sets(problem)
        if sets is None:
            with between(i / len(todo), (i + 1) / len(todo)):
                problem, sets = find_sets(problem)
        level_tables = None if sets is None else tables_of_groups(problem, sets)
        if known is not None:
            known.check_build(problem, level_tables or [])
        if level_tables is None:
            notes.append(f"{module.name}: SC keeps no set that could be found: {NEVER}")
            continue
        install_predicates(flat, module, problem, level_tables)
        every = zip(problem.groups, level_tables, strict=True)
        share = prod(table.share_of_volume(group) for group, table in every)
        text = f"AC may have control on {share:.1%} of the estimates (S_0)"
        if problem.levels_open and problem.levels != LEVELS_DEFAULT:
            text += f"; with {problem.levels} levels, as less is shown with {LEVELS_DEFAULT}"
        if problem.declared_groups:
            text += (
                f"; on {cell_count(problem):,} cells, as less is shown on those that are declared"
            )
        notes.append(f"{module.name}: ttf and safer computed, {text}")
    return notes


def _install_tube_predicates(
    flat: System, module: Module, problem: TubeProblem, known: Known | None
) -> str:
    """Gives a module with `rest` its predicates, unless rest is not shown; returns a note."""
    phase(f"{problem.name}: whether SC keeps where it rests", anew=True)
    checks = [TubeCheck(p) for p in problem.plans or (problem,)]
    claims = [rest_claims(check) for check in checks]
    plans = [f"{p.plan}: " for p in problem.plans] or [""]
    kept = next((plan + c.kept for plan, c in zip(plans, claims, strict=True) if c.kept), "")
    levels: list[LevelTable] = []
    for check, of in zip(checks, claims, strict=True):
        tables = [] if kept else [TubeLevels.of_check(check, of.ways, rest_entry(check, of))]
        if known is not None:
            known.check_build(check.problem, tables)
        levels += tables
    if kept:
        return f"{module.name}: {kept}: {NEVER}"
    install_predicates(flat, module, problem, levels)
    module.unshown = _unshown_in_words(claims)
    missing = f"; not shown: {module.unshown}" if module.unshown else ""
    at_start = any(c.ac_has_control for c in claims)
    where = "SC, followed from there, comes to rest" + ", not at the start" * (not at_start)
    return f"{module.name}: AC may have control where {where}{missing}"


def _unshown_in_words(claims: Sequence[RestClaims]) -> str:
    """Describes the claims about a module's plans that are not shown; "" if all are shown."""
    return "; ".join(filter(None, dict.fromkeys([*(c.moves for c in claims), claims[0].start])))


def decision_costs(flat: System) -> tuple[dict[str, Cost], list[Diagnostic]]:
    """The worst cost of a decision of each module with `rest`; the errors of refused modules."""
    found: dict[str, Cost] = {}
    refused: list[Diagnostic] = []
    for module in flat.modules:
        if module.symbol.rest is None:
            continue
        try:
            problem = extract(faultless(flat), module)
            assert isinstance(problem, TubeProblem)
            every = [_decision_cost(TubeCheck(p)) for p in problem.plans or (problem,)]
            operations, most = sum(c.operations for c in every), max(c.bytes for c in every)
            found[module.symbol.name] = every[0]._replace(operations=operations, bytes=most)
        except SoterError as error:
            refused += error.diagnostics
    return found, refused


def _decision_cost(check: TubeCheck) -> Cost:
    try:
        cost = check.decision_cost()
    except TooLongError:
        raise too_long_error(check) from None
    fine = range(FINE, len(PRECISIONS)) if moves_quickly(check) else ()
    for precision in (MOST, *fine) if check.answers_vary else (PLAIN,):
        check.precision = precision
        with contextlib.suppress(TooLongError):  # what fits stays
            cost = check.decision_cost()
            check.kink = next(kinks_of(check.law), None)
            cost = check.decision_cost()
    return cost


def rest_claims(check: TubeCheck) -> RestClaims:
    """The shown claims of a module's `rest`, from the cache or computed now."""
    p = check.problem
    names = [s.name for s in p.quantities.states]
    ranges = (p.drifts, p.states, p.initial, p.disturbances, check.read_sets, names)
    parts = [VERSION, check.offline_text({}), repr((ranges, is_compiler_found()))]
    key = digest([*parts, *(f.read_text(encoding="utf-8") for f in engine_files())])
    folder = find_cached(REST, key, (REST,))
    if folder is None:
        claims = show_rest_claims(check)
        with contextlib.suppress(SoterError), new_entry(REST, key, (REST,)) as entry:
            claims.write(entry / REST)
        return claims
    claims = RestClaims.read(folder / REST)
    check.precision, check.kink = claims.precision, claims.kink
    return claims


def _copy_predicates(deployed: System, proof_system: System) -> None:
    """Copies to the modules of `deployed` the predicates computed for `proof_system`.

    Their margins reach only to the next look (`Module.looks` stays 1): whether AC keeps control for
    more looks depends on the sensors, which may not be covered.
    """
    for m in deployed.modules:
        proved = next(x for x in proof_system.modules if x.name == m.name)
        if m.symbol.ttf is not None or proved.symbol.ttf is None:
            continue
        dm, sc = deployed.components[m.dm], deployed.components[m.sc]
        scope = {**sc.scope.topics, **m.scope.topics}
        m.symbol, m.computed, m.unshown = proved.symbol, proved.computed, proved.unshown
        m.goods = proved.goods
        for topic in (*proved.symbol.topics_read, *_copy_shield(m, proved, proof_system, scope)):
            m.scope.topics.setdefault(topic, scope[topic])
            dm.scope.topics.setdefault(topic, scope[topic])
        m.inputs = tuple(scope[topic] for topic in proved.symbol.topics_read)


def _copy_shield(
    m: Module, proved: Module, proof_system: System, scope: dict[TopicSymbol, int]
) -> list[TopicSymbol]:
    """Copies the shield's expressions from the proved module; returns the topics that they read.

    Adds the index of the shield's topic in this system to `scope`.
    """
    if m.shield is None or proved.shield is None or proved.shield.held is None:
        return []
    m.shield.held, m.shield.permits = proved.shield.held, proved.shield.permits
    m.shield.moved = proved.shield.moved
    scope[proof_system.topics[proved.shield.topic].symbol] = m.shield.topic
    if m.shield.proposed is not None and proved.shield.proposed is not None:
        scope[proof_system.topics[proved.shield.proposed].symbol] = m.shield.proposed
    return list(topic_reads(*m.shield.expressions))


def install_predicates(flat: System, module: Module, problem: Problem, level_tables: Found) -> None:
    """Sets the `ttf` and `safer` of a module, in place, to predicates that read these tables."""
    if isinstance(problem, TubeProblem) and problem.plans:
        every = zip(problem.plans, level_tables, strict=True)
        module.goods = tuple(predicates_of_tables(p, [table])[1] for p, table in every)
        safer = joined("||", module.goods, module.symbol.span)
        ttf: TypedExpr = TypedUnary(BOOL, module.symbol.span, "!", safer)
    else:
        ttf, safer = predicates_of_tables(problem, level_tables)
    reads = tuple(topic_reads(ttf, safer))
    scope = {**flat.components[module.sc].scope.topics, **module.scope.topics}
    if module.shield is not None:
        ttf = _shield_ttf(flat, module, problem, level_tables, scope)
    for topic in reads:
        module.scope.topics.setdefault(topic, scope[topic])
        flat.components[module.dm].scope.topics.setdefault(topic, scope[topic])
    module.symbol = replace(module.symbol, ttf=ttf, safer=safer, topics_read=reads)
    module.inputs = tuple(scope[topic] for topic in reads)
    module.computed, module.grid_ends = True, grid_ends(problem, level_tables)
    module.looks = looks_with_control(problem, level_tables)


def _shield_ttf(
    flat: System, module: Module, problem: Problem, level_tables: Found, scope: dict[Any, int]
) -> TypedExpr:
    """The `ttf` of a module with a shield, true if the held command is not permitted.

    It is always true if some group has no table of commands. Also fills in the module's shield.
    """
    shield, span = module.shield, module.symbol.span
    assert shield is not None
    tubes = [x for x in level_tables if isinstance(x, TubeLevels)]
    if tubes:
        w = ShieldWriter(problem, flat, shield)
        judged = tubes[0].judged_command(w)
        shield.held = w.times_after_command()
        shield.permits = w.chain("&&", [*w.freshness_conditions(), judged])
        if shield.proposed is not None:
            shield.moved = tubes[0].moved_command(w, flat.topics[shield.proposed])
            if len(module.outputs) == 1:  # of several a step may publish some, and hold the rest
                shield.permits = w.chain("&&", w.freshness_conditions())
        return _add_read_topics(flat, module, shield, scope, TypedUnary(BOOL, span, "!", judged))
    grids = [x for x in level_tables if isinstance(x, GroupTable) and x.commands is not None]
    if len(grids) < len(level_tables):
        return Literal(BOOL, span, True)
    shield.held, shield.permits, ttf = shield_expressions(problem, flat, shield, grids)
    return _add_read_topics(flat, module, shield, scope, ttf)


def _add_read_topics(
    flat: System, module: Module, shield: Shield, scope: dict[Any, int], ttf: TypedExpr
) -> TypedExpr:
    """Adds the topics that a shield reads to the scopes of the module and DM; returns `ttf`."""
    hidden = [i for i in (shield.topic, shield.proposed) if i is not None]
    scope = {**scope, **{flat.topics[i].symbol: i for i in hidden}}
    for symbol in topic_reads(*shield.expressions):
        module.scope.topics.setdefault(symbol, scope[symbol])
        flat.components[module.dm].scope.topics.setdefault(symbol, scope[symbol])
    return ttf


def looks_with_control(problem: Problem, level_tables: Found) -> int:
    """For how many looks of the DM AC keeps control once `safer` holds: m - 1, or only 1.

    An estimate in S_(m-2) leaves ttf false at the next m - 2 looks (docs/proof-sets.md, Margin).
    The number is 1, which promises nothing beyond the next look, in three cases: a table of several
    parameter cases, because levels are nested only within each; a map, because a state may come to
    lie on the border of a cell; a check in flight, which has no levels.
    """
    alone = sum(1 for _ in parameter_cases(problem)) == 1
    inside = problem.kind == "flow" and all(isinstance(x, GroupTable) for x in level_tables)
    return max(problem.levels, 2) - 1 if alone and inside else 1


def find_sets(problem: Problem) -> tuple[Problem, list[Pairs] | None]:
    """The problem with its chosen cells and levels, and the sets (S_0, S_(m-2)) of every case.

    The sets are read from the cache or computed; they are None if the engine has no answer.
    """
    phase(f"{problem.name}: computing ttf and safer", anew=True)
    library, _ = library_of(problem)
    key = _cache_key(problem, library)
    sets = _cached_sets(key, problem)
    if sets is None:
        sets = _compute_sets(problem, library)
        if sets is not None:
            _store_sets(key, *sets)
    return sets or (problem, None)


def store_computed_sets(result: ModuleResult) -> None:
    """Stores the sets of a proof with computed predicates in the cache for later builds or runs."""
    problem = result.problem
    if problem.groups and all(result.findings[c].holds for c in OF_SETS):
        pairs = [pairs_of(case) for case in result.cases]
        _store_sets(_cache_key(problem, library_of(problem)[0]), problem, pairs)


def _compute_sets(problem: Problem, library: ReachLibrary) -> Sets | None:
    announce_work(problem, partial(_case_with_levels, library))
    chosen = choose_cells_and_levels(problem, partial(_cases_with_levels, library))
    problem = chosen.problem
    pairs = [pairs_of(case.sets) for case in chosen.done or ()]
    if not pairs or any(len(of_case) != len(problem.groups) for of_case in pairs):
        return None
    return problem, pairs


def _cases_with_levels(library: ReachLibrary, problem: Problem) -> list[Case] | None:
    """All cases with their levels, after P2b, for which K may lose cells.

    None if the dynamics have no enclosure. The cases have no levels if one of them has no K.
    """
    every = list(parameter_cases(problem))
    done = []
    for i, parameter in enumerate(every):
        share_done(i / len(every))  # the rounds of a case are not known before
        try:
            case = _case_with_levels(library, problem, parameter)
        except UnboundedError:
            return None
        done.append(case)
    return done if any(case.failures_of("P2a") for case in done) else cases_with_way_back(done)


def _case_with_levels(library: ReachLibrary, problem: Problem, parameter: tuple[int, ...]) -> Case:
    """Computes one case, with its levels if it has a K."""
    case = claims.open_case(problem, library, problem.groups, parameter)
    within = claims.compute_constraint(case)
    phase(f"{problem.name}: what SC keeps")
    kept = within and claims.compute_core(case)
    phase(f"{problem.name}: where AC may have control")
    if kept:
        claims.compute_free_states(case)
        compute_levels(case)
    return case


def _cache_key(problem: Problem, library: ReachLibrary) -> str:
    """The hash of everything the sets depend on: the enclosures' code, all numbers, the engine."""
    hashed = hashlib.sha256()
    for part in (
        VERSION,
        np.__version__,
        library.path.name,
        problem.kind,
        problem.plant_period_ns,
        problem.schemes,
        problem.states,
        problem.initial,  # K is not made smaller where the start would be lost
        problem.controls,
        problem.disturbances,
        problem.errors,
        problem.others,
        problem.parameters,
        [g.axes for g in problem.declared_groups or problem.groups],
        replace(problem.times, declared=frozenset()),
        sorted(problem.times.declared),
        "chosen" if problem.levels_open else problem.levels,
        problem.cells_open,
        (problem.recover_ns, problem.stays),
        None if problem.module.shield is None else problem.module.shield.cells,
        problem.module.symbol.toward_sc,
        problem.has_core_hint,
        sorted(problem.topic_leaf_of_state.items()),
        sorted(topics_seen_by_dm(problem)),
        problem.law_unread,
        *_key_parts_of_law(problem),
    ):
        hashed.update(repr(part).encode() + b"\0")
    for file in engine_files():
        hashed.update(file.read_bytes())
    return hashed.hexdigest()


def _key_parts_of_law(problem: Problem) -> tuple[object, ...]:
    """The parts of the cache key for a fail-safe law, because SC also has to keep its core K_fs."""
    law = problem.law
    if law is None:
        return ()
    times = replace(law.times, declared=frozenset())
    return library_of(law)[0].path.name, law.states, law.controls, law.disturbances, times


def engine_files() -> list[Path]:
    """Every file of `ENGINE_ROOMS`, on which the sets depend."""
    files = [f for room in ENGINE_ROOMS for f in files_below(SOTER / room, "*.py", "*.[ch]")]
    texts = [f for room in ("language", "verify") for f in files_below(SOTER / room, "*.soter")]
    return [*files, *texts]


def _store_sets(key: str, problem: Problem, pairs: list[Pairs]) -> None:
    """Writes the sets into the cache; a failed write is no error."""
    arrays: dict[str, NDArray[np.generic]] = {LEVELS: np.array(problem.levels)}
    for k, axis in enumerate(a for group in problem.groups for a in group.axes):
        arrays[f"{EDGES}{k}"] = np.array(axis.edges)
    for i, case in enumerate(pairs):
        for j, pair in enumerate(case):
            for name, array in arrays_of_levels(pair).items():
                arrays[f"{i}_{j}_{name}"] = array
    with contextlib.suppress(SoterError), new_entry("sets", key, (FILE,)) as entry:
        np.savez_compressed(entry / FILE, **arrays)  # type: ignore[arg-type]


def _cached_sets(key: str, problem: Problem) -> Sets | None:
    """The sets that an earlier run cached; None if the cache does not have them."""
    folder = find_cached("sets", key, (FILE,))
    if folder is None:
        return None
    try:
        with np.load(folder / FILE) as data:
            problem = replace(_problem_with_cells(data, problem), levels=int(data[LEVELS]))
            groups = problem.groups
            return problem, [
                [_read_stored_pair(data, f"{i}_{j}_", group) for j, group in enumerate(groups)]
                for i, _ in enumerate(parameter_cases(problem))
            ]
    except (OSError, ValueError, KeyError):
        return None


def _problem_with_cells(data: Any, problem: Problem) -> Problem:  # noqa: ANN401 - an open archive
    """The problem on the cells that an earlier run chose and stored in `data`."""
    count, groups = itertools.count(), []
    for group in problem.groups:
        edges = [tuple(data[f"{EDGES}{next(count)}"].tolist()) for _ in group.axes]
        axes = (replace(a, edges=e) for a, e in zip(group.axes, edges, strict=True))
        groups.append(replace(group, axes=tuple(axes)))
    if tuple(groups) == problem.groups:
        return problem
    declared = problem.declared_groups or problem.groups
    return replace(problem, groups=tuple(groups), declared_groups=declared)


def _read_stored_pair(data: Any, name: str, group: Group) -> Estimates:  # noqa: ANN401 - an open archive
    arrays = {key.removeprefix(name): data[key] for key in data.files if key.startswith(name)}
    return levels_from_arrays(group, arrays)
