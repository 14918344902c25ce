"""The sets of one case, and the claims that are read off them.

Purpose: for one combination of parameter values: C, K, R(H), the inclusions of `ttf` and `safer`,
the start (docs/verification.md, section 3). Each claim says where it fails. Polytope groups have
theirs in `polytope_claims.py`, called from here.
Non-goals: P2b (`recovery.py`), refinement and verdicts (`verify.py`).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from soter.reach import polytope_claims
from soter.reach.boxes import holding
from soter.reach.first_reads import fault_on_defaults
from soter.reach.forms import Forms
from soter.reach.grids import GridGroup
from soter.reach.products import law_stays_inside, parts, product_holds
from soter.reach.results import CaseSets, GroupSets, PolytopePart

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from soter.reach.native import ReachLibrary
    from soter.reach.problem import Group, Problem
    from soter.reach.results import Region

    Bools = NDArray[np.bool_]
    Tell = Callable[[str, float], None]


@dataclass
class Failure:
    """Where a claim could not be shown: cells of one group, or nowhere in particular."""

    claim: str
    text: str
    group: int | None = None
    cells: Bools | None = None
    hint: str = ""
    part: PolytopePart | None = None
    """The polytope group that fails."""
    where: Region | None = None
    """Where that is."""
    stuck: bool = False
    """P2b: the cells are those of K from which no way back was found."""
    cut: bool = False
    """It was not looked at to the end, as something else fails."""


@dataclass(eq=False)
class Case:
    """One combination of parameter values under way."""

    problem: Problem
    parameter: tuple[int, ...]
    groups: list[GridGroup]
    forms: Forms
    sets: CaseSets
    failures: list[Failure] = field(default_factory=list)
    spent: dict[str, float] = field(default_factory=dict)
    """Seconds per claim."""
    counts: dict[str, int] = field(default_factory=dict)
    fresh: list[bool] = field(default_factory=list)
    """Groups whose sets are still to be computed; the others are those of an earlier attempt."""
    first: Case | None = None
    """The attempt on the declared grid, where this one is on a finer one."""

    def failed(self, claim: str) -> list[Failure]:
        """What stands against a claim."""
        return [f for f in self.failures if f.claim == claim]

    def fail(
        self,
        claim: str,
        text: str,
        group: int | None = None,
        cells: Bools | None = None,
        hint: str = "",
        *,
        stuck: bool = False,
        cut: bool = False,
        part: PolytopePart | None = None,
    ) -> None:
        """Enter a failure."""
        made = Failure(claim, text, group, cells, hint, stuck=stuck, cut=cut, part=part)
        self.failures.append(made)

    def again(self, group: int) -> None:
        """A group keeps nothing of an earlier attempt."""
        self.fresh[group] = True
        self.failures = [f for f in self.failures if f.group != group]

    def todo(self) -> list[tuple[int, GridGroup, GroupSets]]:
        """The fresh groups: number, engine, sets."""
        both = zip(self.groups, self.sets.groups, strict=True)
        return [(i, e, s) for i, (e, s) in enumerate(both) if self.fresh[i]]


class Clock:
    """Adds the seconds of a `with` block to a claim."""

    def __init__(self, case: Case, claim: str) -> None:
        self.case, self.claim = case, claim
        self.began = 0.0

    def __enter__(self) -> None:
        self.began = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        spent = time.perf_counter() - self.began
        self.case.spent[self.claim] = self.case.spent.get(self.claim, 0.0) + spent


def open_case(
    problem: Problem,
    library: ReachLibrary,
    groups: Sequence[Group],
    parameter: tuple[int, ...],
    tell: Tell | None,
    before: Case | None = None,
) -> Case:
    """The engines of every group; UnboundedError where the dynamics have no enclosure.

    Of an earlier attempt `before`, groups on the same grid keep their sets and their failures: the
    analysis of a group looks at the ranges of the others only.
    """
    case = Case(problem, parameter, [], Forms(library, problem, parameter), CaseSets(parameter, []))
    _polytopes(case, groups, before)
    for i, group in enumerate(g for g in groups if g.representation == "grid"):
        if before is not None and before.sets.groups[i].group == group:
            case.groups.append(before.groups[i])
            case.sets.groups.append(before.sets.groups[i])
            case.fresh.append(False)
            case.failures += [f for f in before.failures if f.group == i and f.claim != "start"]
            continue
        engine = GridGroup.of(library, problem, group, parameter, progress=tell)
        allowed = np.zeros(engine.shape, dtype=np.bool_)
        core = np.zeros(engine.shape, dtype=np.uint8)
        case.groups.append(engine)
        case.sets.groups.append(GroupSets(group, allowed, core, solver=engine))
        case.fresh.append(True)
    if before is not None:
        case.spent.update(before.spent)
        case.counts.update(before.counts)
    return case


def _polytopes(case: Case, groups: Sequence[Group], before: Case | None) -> None:
    """The polytope groups; those of an earlier attempt stay as they are."""
    if before is None:
        found = [PolytopePart(g) for g in groups if g.representation != "grid"]
        case.sets.polytopes = found
        return
    case.sets.polytopes = before.sets.polytopes
    for part in case.sets.polytopes:
        part.fresh = False
    case.failures += [f for f in before.failures if f.part is not None and f.claim != "start"]


# ---------------------------------------------------------------- P2a


def constraint(case: Case) -> bool:
    """C_g for every group, the product check, and that SC stays inside its sets; False: no C."""
    ranges = polytope_claims.constrain(case)
    found = None if ranges is None else parts(case.problem, case.groups, "safe")
    if found is None or ranges is None:
        case.fail("P2a", "no state was found on which `safe` holds")
        return False
    forms = case.forms.within(ranges)
    if not product_holds(forms, case.groups, found, "safe"):
        case.fail(
            "P2a",
            "`safe` is no product over the groups",
            hint="put states that `safe` compares with each other into one line"
            + (", or give a `polytope` narrower ranges" if ranges else ""),
        )
        return False
    if case.problem.has_core_hint:
        hints = parts(case.problem, case.groups, "core")
        if hints is None:
            case.fail("P2a", "no state was found on which `core` holds")
            return False
        found = [a & b for a, b in zip(found, hints, strict=True)]
    for i, part in enumerate(case.sets.groups):
        if not case.fresh[i] and not np.array_equal(part.allowed, found[i]):
            case.again(i)  # it holds at another point than before, and so the product is another
    for i, _, part in case.todo():
        part.allowed = found[i]
    why = law_stays_inside(case.problem, forms, case.groups, found)
    if why:
        case.fail("P2a", why, hint="clamp what SC publishes to the topic's set")
    return True


def core(case: Case) -> bool:
    """K of every group; False where one is empty."""
    whole = True
    for i, engine, part in case.todo():
        found = engine.core(part.allowed)
        part.core = found.witness
        case.counts["rounds"] = max(case.counts.get("rounds", 0), found.rounds)
        case.counts["longest"] = max(case.counts.get("longest", 0), int(found.witness.max()))
        if not found.witness.any():
            whole = False
            case.fail(
                "P2a",
                "K is empty: no set was found that SC keeps",
                i,
                part.allowed,
                "a finer grid; a wider one; a stronger SC; smaller errors, delays or disturbances",
            )
    return polytope_claims.core(case) and whole


# ---------------------------------------------------------------- P3


def in_horizon(problem: Problem, ns: int) -> int:
    """A time as the engine takes it: a map's is a whole number of its periods."""
    if problem.kind == "map":
        return -(-ns // problem.plant_period_ns) * problem.plant_period_ns
    return ns


def free_phase(case: Case) -> None:
    """R(H) of every group."""
    horizon = in_horizon(case.problem, case.problem.times.horizon_ns)
    for _, engine, part in case.todo():
        part.free = engine.safe_for(horizon, part.core > 0)
    polytope_claims.free_phase(case)


def inclusion(case: Case, predicate: str) -> None:
    """`ttf` or `safer`: an estimate from which AC may have control comes from a state in R(H)."""
    polytope_claims.inclusion(case, predicate)
    for i, engine, part in case.todo():
        if part.possible is None:
            part.possible = engine.may_hold("safe")
        possible = part.possible
        if predicate == "ttf":
            lets = engine.may_fail("ttf")
            part.lets_ac = lets & possible
        else:
            lets = engine.may_hold("safer")
            part.gives_back = lets & possible
        assert part.free is not None
        wrong = lets & possible & ~part.free
        if wrong.any():
            says = "may be false" if predicate == "ttf" else "may be true"
            count = int(wrong.sum())
            case.fail(
                predicate,
                f"`{predicate}` {says} on {count} cells from which AC could leave K within H",
                i,
                wrong,
                f"a finer grid, or a `{predicate}` that is more careful there",
            )


# ---------------------------------------------------------------- start


def start(case: Case) -> None:
    """The declared initial states lie in R(h_0), h_0 the first instant SC's output acts."""
    h0 = in_horizon(case.problem, case.problem.times.start)
    if case.parameter != case.problem.parameter_start:
        return
    wrong_read = fault_on_defaults(case.problem)
    if wrong_read:
        hint = "let SC step only after what it reads was published: `phase`"
        case.fail("start", wrong_read, hint=hint)
    polytope_claims.start(case, h0)
    for i, (engine, part) in enumerate(zip(case.groups, case.sets.groups, strict=True)):
        reach = engine.safe_for(h0, part.core > 0)
        box = []
        for state, edges in zip(engine.axes, engine.edges, strict=True):
            initial = case.problem.initial[state]
            box.append(holding(edges, initial.low, initial.high))
        if any(b is None for b in box):
            case.fail("start", "an initial state lies outside the grid", i, None, "a wider grid")
            continue
        at = tuple(b for b in box if b is not None)
        if not reach[at].all():
            wrong = np.zeros_like(reach)
            wrong[at] = ~reach[at]
            case.fail(
                "start",
                "SC may come too late for an initial state",
                i,
                wrong,
                "start further inside, or closer to rest",
            )
