"""How far apart in time what a decision module reads together may be.

Purpose: `allowed_stamp_differences` gives the pairs of topics whose stamps say whether they show
one instant, and how far apart these stamps may be. A decision module calls reads that are further
apart stale; `permits_on_close_reads` makes its shield permit nothing on them.
Non-goals: how old each may be by itself (`Topic.max_age_ns`); what a node makes of several reads.

Plants of one period and phase publish all that they drive in the same instants, so the stamps of
what they drive are equal, unless one of these topics fell silent. In a system that deploys another
one, sensors speak one by one: one that publishes at least every e, at most l after it measured,
shows a state of the last e + l, so that two are as far apart as the longer of these times at most.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import BOOL, FLOAT

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Module, System


def allowed_stamp_differences(system: System, topics: Iterable[int]) -> list[tuple[int, int, int]]:
    """Gives (topic, topic, ns) for pairs of `topics`: how far apart their stamps may be."""
    limited = [i for i in topics if system.topics[i].max_age_ns is not None]
    instants = {
        index: (c.period_ns, c.phase_ns)
        for c in system.components
        if c.plant is not None
        for index in c.writes
    }
    oldest = {
        e.topic: e.every_ns + (e.delay_ns or 0)
        for e in system.externals
        if system.proved is not None and e.every_ns is not None
    }
    pairs = []
    for i, j in combinations(limited, 2):
        if i in oldest and j in oldest:
            pairs.append((i, j, max(oldest[i], oldest[j])))
        elif i in instants and instants[i] == instants.get(j):
            pairs.append((i, j, 0))
    return pairs


def permits_on_close_reads(system: System, module: Module) -> typed.TypedExpr:
    """Gives `permits` of a shield together with the demand that its reads are close in time."""
    assert module.shield is not None
    assert module.shield.permits is not None
    span, permits = module.symbol.span, module.shield.permits
    names = {index: symbol for symbol, index in module.scope.topics.items()}
    read = [module.scope.topics[symbol] for symbol in topic_reads(permits)]
    for i, j, most in allowed_stamp_differences(system, read):
        ages = [typed.AgeRead(FLOAT, span, names[k]) for k in (i, j)]
        for one, other in (ages, ages[::-1]):
            apart = typed.TypedBinary(FLOAT, span, "-", one, other)
            limit = typed.Literal(FLOAT, span, most / 1e9)
            near = typed.TypedBinary(BOOL, span, "<=", apart, limit)
            permits = typed.TypedBinary(BOOL, span, "&&", near, permits)
    return permits
