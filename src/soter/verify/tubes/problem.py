"""The problem of a module with `rest`, whose DM encloses every run of SC from an estimate.

Purpose: `tube_problem_of` turns the problem of a flow into a `TubeProblem`, and refuses (R007) what
the theorem ("Decisions by tubes" in docs/proof-flight.md) does not cover.
Non-goals: the check in flight (`tube_check.py`), what is shown offline (`rest_claims.py`).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from fractions import Fraction
from math import inf, nextafter
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.evaluate.topic_ranges import truth_by_parts
from soter.language.model.typed import TypedBinary
from soter.language.model.types import BOOL, leaf_name, leaves, numbers_in
from soter.verify.problem.problem import TUBES, Interval, Problem
from soter.verify.problem.supported_constructs import topics_of_maps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.check.constants_and_types import Calculator
    from soter.language.model.system import Module
    from soter.language.model.typed import RestMove, RestSymbol, TypedExpr


FARTHEST = 1e100
"""The assumed bound of a state whose topic has no set; the DM refuses maps with larger numbers.
Forms can hold sums of such numbers, and products of two."""
AS_EXPRESSIONS = "a tube needs rates, the law, `safe` and `rest` as expressions of reals"


@dataclass(frozen=True)
class Drift:
    """The largest motion of a state down and up after `rest` first held; inf means no limit."""

    below: float
    above: float


@dataclass(eq=False, kw_only=True)
class TubeProblem(Problem):
    """The problem of a module that declares `rest e moves ... within T;`.

    `drifts` has the bounds that `moves` declares, by the number of the state. `map_leaves` has each
    number of the maps that `safe` reads, as (topic, leaf). If several plans exist, `plans` has the
    problem of each as the only SC, and this problem is that of the first.
    """

    rest: TypedExpr
    within_ns: int
    drifts: dict[int, Drift]
    map_leaves: tuple[tuple[int, int], ...]
    plans: tuple[TubeProblem, ...] = ()

    @property
    def plan(self) -> str:
        """The name of the node that is SC in this problem."""
        return self.module.symbol.sc.name

    @property
    def first_map(self) -> list[float]:
        """The default numbers of all map topics, by which the start is judged."""
        topics = [self.system.topics[t] for t in dict.fromkeys(t for t, _ in self.map_leaves)]
        return [x for t in topics for x in numbers_in(t.default)]

    def leaf_of_state(self, state: int) -> str:
        """The topic's leaf by which the DM reads a state, as `topic.field`."""
        topic, k = self.topic_leaf_of_state[state]
        declared = self.system.topics[topic]
        return leaf_name(declared.name, list(leaves(declared.type))[k][0])


@dataclass(frozen=True)
class TubeTimes:
    """The times of a tube in ns, counted from the estimate (docs/proof-flight.md)."""

    earliest: int
    """alpha: before this time no output of SC is complete."""
    latest: int
    """H, the look-ahead: by this time an output of SC is complete."""
    start: int
    """h_0: by this time after the start of a run an output of SC is complete."""
    delay: int
    """d: the largest age of the state that SC read for a command, when that begins to act."""
    jitter: int
    """j: the length of the window in which an output of SC acts."""
    period: int
    """delta: the period of SC."""
    switches: int
    """N_T: after this many outputs of SC beyond the first one the plant has to be at rest."""
    any_command: int = 0
    """W: where commands are judged, any command may act this long before an output of SC acts."""

    @property
    def depth(self) -> int:
        """How many commands may act while a read ages: SC's periods in d + 2 j, at least 1."""
        return max(1, -(-(self.delay + 2 * self.jitter) // self.period))

    def earlier_command_ns(self, p: int) -> int:
        """The longest time in ns for which the p-th command before the last acted since a read."""
        since = self.delay + 2 * self.jitter - p * self.period
        return max(0, min(self.period + 2 * self.jitter, since))

    @staticmethod
    def of_problem(problem: TubeProblem) -> TubeTimes:
        """The times of a module's tube, from its schedule and its clause `within`."""
        t = problem.times
        h, j, period = t.horizon_ns, t.jitter_sc, t.delta_sc
        earliest = max(t.delta_dm - t.late_dm + t.acts_least, h - period - j, 0)
        switches = (problem.within_ns - j) // period
        any_command = t.schedule.h_star - t.age_dm - t.delta_dm - t.acts_least
        times = min(earliest, h), h, t.start, t.delay_sc, j, period, switches
        return TubeTimes(*times, min(any_command, h))


def tube_problem_of(problem: Problem, rest: RestSymbol, calculator: Calculator) -> TubeProblem:
    """The problem of a module with `rest`; raises R009 or R007 if tubes do not cover it."""
    diagnostics = Diagnostics()
    _refuse_uncovered(problem, rest, diagnostics)
    drifts = {}
    for move in rest.moves:
        state = _moved_state(problem, move)
        if state is None:
            diagnostics.error(
                "R009",
                f"`{leaf_name(move.topic.name, move.path)}` is no state of a verification plant",
                move.span,
                notes=("what moves is a leaf of a topic that equals a state",),
            )
            continue
        by = float(calculator.value(move.by, "how far it moves") or 0.0)
        drifts[state] = Drift(inf if move.way == "up" else by, inf if move.way == "down" else by)
    within = int(calculator.value(rest.within, "the time of `rest`") or 0)
    diagnostics.raise_errors()
    read, by_sc = topics_read(problem), topics_read_by_sc(problem)
    leaves_of = sorted(problem.state_of_leaf, key=lambda at: (at[0] in read) + (at[0] in by_sc))
    shown = {problem.state_of_leaf[at]: at for at in leaves_of}  # the last one counts: SC's
    fields = vars(problem) | {"kind": TUBES, "topic_leaf_of_state": shown}
    maps = topics_of_maps(problem.system, problem.module).values()
    numbers = [(t, k) for t in maps for k, _ in enumerate(leaves(problem.system.topics[t].type))]
    return TubeProblem(
        **fields, rest=rest.condition, within_ns=within, drifts=drifts, map_leaves=tuple(numbers)
    )


def problem_of_plans(module: Module, plans: Sequence[Problem]) -> TubeProblem:
    """The problem of a module, joined from the problems of its plans; may raise R007."""
    first, *_ = every = [p for p in plans if isinstance(p, TubeProblem)]
    if module.symbol.shield is not None:
        why = (
            "with several plans no command is judged (`shield;`): SC follows the plan of the last "
            "look, and the last command may be good for another one"
        )
        helps = ("leave `shield` out, or all plans but one",)
        raise refusal(first, why, helps)
    of_all = copy(first)
    of_all.plans = tuple(every)
    return of_all


def nearest_seconds(ns: int, parts: int = 1) -> float:
    """The double nearest to `ns / parts`, in seconds; `flow` allows for the rounding."""
    return float(Fraction(ns, 10**9 * parts))


def rounded_up(x: Fraction) -> float:
    """The least double that is at least `x`."""
    value = float(x)
    return value if Fraction(value) >= x else nextafter(value, inf)


def cut_to_farthest(r: Interval) -> Interval:
    """The range `r` of a state, cut to ±`FARTHEST`."""
    return Interval(max(r.low, -FARTHEST), min(r.high, FARTHEST))


def is_far(r: Interval) -> bool:
    """Whether the range `r` of a state reaches beyond ±`FARTHEST`."""
    return cut_to_farthest(r) != r


def topics_read(problem: Problem) -> set[int]:
    """The topics that SC or a condition of the module reads; a DM with `rest` reads them all."""
    return {*problem.module.scope.topics.values(), *topics_read_by_sc(problem)}


def topics_read_by_sc(problem: Problem) -> set[int]:
    """The topics that SC reads."""
    return set(problem.system.components[problem.module.sc].scope.topics.values())


def _moved_state(problem: Problem, move: RestMove) -> int | None:
    topic = problem.module.scope.topics[move.topic]
    paths = [p for p, _ in leaves(move.topic.type)]
    return problem.state_of_leaf.get((topic, paths.index(move.path)))


def _refuse_uncovered(problem: Problem, rest: RestSymbol, diagnostics: Diagnostics) -> None:
    seen = set(problem.topic_leaf_of_state)
    unseen = [leaf.name for s, leaf in enumerate(problem.quantities.states) if s not in seen]
    wrong = {
        "plants that move in steps (`next`)": problem.kind != "flow",
        "parameters of the plants": bool(problem.parameters),
        "a fail-safe law": bool(problem.module.law),
        "views": bool(problem.view),
        "modes of other modules": problem.modes is not None,
        f"a state that no topic shows: {', '.join(unseen)}": bool(unseen),
    }
    for reason in (reason for reason, holds in wrong.items() if holds):
        diagnostics.error(
            "R007",
            f"`rest` beside {reason}",
            rest.span,
            "is not followed",
            helps=("`ttf` and `safer`, or a `grid`, in the place of `rest`",),
        )

    safe, scope = problem.module.symbol.safe, problem.module.scope
    both = TypedBinary(BOOL, rest.span, "&&", safe, rest.condition)
    asked = (truth_by_parts(e, problem.system, scope) for e in (rest.condition, safe, both))
    if False in asked:
        diagnostics.error(
            "R007",
            "`rest` holds nowhere in the sets of its topics, or nowhere where `safe` does",
            rest.span,
            "no state is one of rest",
            also=((safe.span, "`safe`"),),
            notes=("whatever is said of no state is true, and says nothing",),
            helps=("a condition that holds where SC ends",),
        )


def refusal(problem: TubeProblem, why: str, helps: tuple[str, ...] = ()) -> SoterError:
    """The error R007 with the reason `why`; it has a note on expressions if `helps` is empty."""
    diagnostics = Diagnostics()
    diagnostics.error(
        "R007",
        f"module `{problem.name}` is followed by tubes, and {why}",
        (problem.module.symbol.rest or problem.module.symbol).span,
        notes=() if helps else (AS_EXPRESSIONS,),
        helps=helps,
    )
    return SoterError(diagnostics.items)
