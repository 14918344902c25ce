"""Sensors that speak one by one: what they show, taken for one state.

Purpose: how far a leaf of a topic moves in a time, from the plant's own equations; which pairs of
topics are too far apart in time for what the proof allows as errors.
Non-goals: single topics (`deployed_sensors.py`).

Why it suffices (docs/deploy.md, "Several sensors"). A read takes topic i as it was at s_i, with
t - s_i in [0, a_i]. Leaf k of it is off by e_k there, moves by V_k a second at most, and E_k is
allowed: it is within E_k of the state of any s with |s - s_i| <= sigma_i, the least (E_k - e_k) /
V_k. Intervals of a line have a point in common if each two of them have, and each two have if |s_i
- s_j| <= max(a_i, a_j) <= sigma_i + sigma_j. Of the s that are in all, s = max(max_i (s_i -
sigma_i), min_i s_i) lies between the oldest and the newest s_i, so it is no older than the oldest
and not in the future, and it does not go back where no s_i does. V_k is taken over all of C, all
commands, disturbances and influences: the state is in C as long as reads were so, and the first
read that is not would be one of a state that has been in C until then.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations
from math import inf, isfinite
from typing import TYPE_CHECKING

from soter.language.model.types import FloatType, leaves
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.problem.extract import cases

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Topic
    from soter.verify.problem.problem import Problem

NS = 10**9


@dataclass(frozen=True, eq=False)
class SensedTopic:
    """A topic as it comes: at most `age` ns old, leaf k `errors[k]` off where `allowed[k]` may be.

    `errors[k]` is None for a leaf that is no float.
    """

    topic: Topic
    age: int
    errors: tuple[float | None, ...]
    allowed: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class TopicSkew:
    """Two topics that may show states `apart` ns from each other; `covered`: what is allowed."""

    one: Topic
    other: Topic
    apart: int
    covered: int


def too_far(problem: Problem, heard: Sequence[SensedTopic]) -> list[TopicSkew]:
    """Pairs whose errors leave too little for the time between them; none for a single topic.

    `SoterError` R007, X004, X006 as of `library_of`.
    """
    if len(heard) < 2:
        return []
    rates = rates_of(problem)
    slacks = [_slack(problem, h, rates) for h in heard]
    return [
        TopicSkew(heard[i].topic, heard[j].topic, apart, int(covered))
        for i, j, apart, covered in _pairs([h.age for h in heard], slacks)
    ]


def _pairs(
    ages: Sequence[int], slacks: Sequence[Fraction | float]
) -> list[tuple[int, int, int, Fraction | float]]:
    """(i, j, max(a_i, a_j), sigma_i + sigma_j) where that is less; in ns."""
    every = combinations(range(len(ages)), 2)
    told = [(i, j, max(ages[i], ages[j]), slacks[i] + slacks[j]) for i, j in every]
    return [x for x in told if x[2] > x[3]]


def rates_of(problem: Problem) -> list[float]:
    """How fast each state of a flow moves at most, a second, wherever C is; inf: not known."""
    assert problem.kind == "flow"
    library, _ = library_of(problem)
    rates = [0.0 for _ in problem.states]
    for parameter in cases(problem):
        forms = CompiledEnclosures(library, problem, parameter)
        bounds = forms.numbers("derivative", forms.whole, len(problem.states))
        for k in range(len(rates)):
            most = inf if bounds is None else float(abs(bounds[k]).max())
            rates[k] = max(rates[k], most) if isfinite(most) else inf
    return rates


def _slack(problem: Problem, heard: SensedTopic, rates: Sequence[float]) -> Fraction | float:
    """Sigma in ns: for how long the topic stays within what is allowed; inf where it is for ever.

    0 where a leaf is no float, or not a state as it is: how fast that moves is not known.
    """
    slack: Fraction | float = inf
    index = next(t.index for t in problem.system.topics if t.name == heard.topic.name)
    for k, (_, t) in enumerate(leaves(heard.topic.type)):
        state = problem.state_of_leaf.get((index, k))
        error = heard.errors[k]
        if not isinstance(t, FloatType) or error is None or state is None:
            return Fraction(0)
        rate = rates[state]
        if rate == 0.0:
            continue
        if not isfinite(rate):
            return Fraction(0)
        slack = min(slack, (Fraction(heard.allowed[k]) - Fraction(error)) * NS / Fraction(rate))
    return slack
