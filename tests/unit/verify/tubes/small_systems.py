"""Small modules that decide by fall-back runs, drawn at random, and checks that are a tick off.

Purpose: `drawn` makes one of a number: times that keep condition 1 of proof-flight.md, "Decisions
by tubes", a law of SC, a constraint and the states at rest that the law keeps; `off` makes one time
of its check wrong.
Non-goals: the definitions (`fallback_runs.py`), executions (`executions.py`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from random import Random

from unit.verify.tubes.executions import Executions
from unit.verify.tubes.fallback_runs import Check, Times

KINDS = (
    ((-1, 1), (0,)),
    ((0,), (1,)),
    ((0, 1), (1,)),
    ((-1, 0), (1,)),
    ((0, 1), (0,)),
    ((-1, 0, 1), (0,)),
    ((1, 2), (-1,)),
    ((-2, 1), (0,)),
    ((0, 1), (-1, 0)),
)
"""Of one component: commands and disturbances."""
PAIRS = (
    ((-1, 1), (0, 1)),
    ((0, 1), (-1, 0)),
    ((-1, 1), (-1, 1)),
    ((0, 2), (-1, 0)),
    ((0, 1), (-2, 0)),
)
"""Commands of two components."""
MOST_HORIZON, MOST_DELAY = 5, 2
"""Larger ones have too many runs."""


def times(draw: Random, parts: int) -> Times:
    def some(most: int) -> int:
        return draw.choice((0, 0, 1, draw.randrange(most + 1)))

    while True:
        delta = draw.choice((2, 3, 4))
        period = draw.choice([b for b in (2, 3, 4, 5, 6, 8) if b >= delta])
        dm = (period, draw.randrange(period), some(2), some(2))
        sc, least = (delta, draw.randrange(delta), some(2), some(2)), draw.choice((0, 0, 1))
        most = least + max(some(2), parts - 1)  # two that begin apart have L > L_min
        t = Times(dm, sc, least, most, some(3), some(3))
        d = t.derived()
        out = d["jitter"] - t.most + t.least  # of SC, at most, after its release
        kept = 2 * d["jitter"] <= delta and out <= delta and dm[2] + dm[3] < period
        small = d["horizon"] <= MOST_HORIZON and d["delay"] <= MOST_DELAY
        if kept and small:
            return t


def drawn(number: int, maps: int = 1, parts: int = 1) -> tuple[Executions, set[int]] | None:
    """A module and its starts; None: SC keeps nothing, or a map has no good estimate.

    `parts`: components of its command, 1 or 2.
    """
    draw = Random(number)  # noqa: S311
    t = times(draw, parts)
    kinds = [((u,), w) for u, w in KINDS] if parts == 1 else [(us, (0,)) for us in PAIRS]
    each, wind = draw.choice(kinds)
    commands = tuple(product(*each))
    width = draw.choice((7, 10, 14))
    constraints = [frozenset(x for x in range(width) if draw.random() < 0.9) for _ in range(maps)]
    law = {y: (draw.choice(commands),) for y in range(-9, width + 9)}
    errors = draw.choice(((0,), (0,), (0,), (-1, 0, 1)))
    holds = draw.choice((1, 2, 4, 8))
    checks = []
    for safe in constraints:
        c = Check(law.__getitem__, safe, frozenset(), commands, wind, errors, holds, **t.derived())
        checks.append(replace(c, rest=frozenset(x for x in safe if c.keeps(x))))
    if not all(c.rest for c in checks):
        return None
    starts = {x for x in checks[0].safe if checks[0].starts_well(x)}
    usable = starts and all(any(map(c.good, c.safe)) for c in checks)
    return (Executions(t, tuple(checks)), starts) if usable else None


def off(module: Executions, time: str, by: int) -> Executions | None:
    """The same, but that its checks go by a wrong time; None: such a time has no meaning."""
    wrong = tuple(replace(c, **{time: getattr(c, time) + by}) for c in module.checks)
    if min(wrong[0].delay, wrong[0].jitter) < 0 or wrong[0].alpha > wrong[0].horizon:
        return None
    return replace(module, checks=wrong)
