"""The times of a problem (docs/verification.md, Times).

Purpose: `Times` of a module in its verification system; P1c in words.
Non-goals: measuring anything: lateness and response times are declared, and assumed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.program.check_const import Calculator
from soter.program.durations import show_ns
from soter.program.walk import topic_reads
from soter.reach.place import sc_reads
from soter.reach.problem import Times

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.program import typed
    from soter.reach.place import Place

DELAYS = ("late_dm", "late_sc", "response_dm", "response_sc", "acts")
WORDS = {
    "late_dm": "the DM starts on time",
    "late_sc": "SC starts on time",
    "response_dm": "the DM takes no time",
    "response_sc": "SC takes no time",
    "acts": "commands act at once",
}


def times_of(place: Place, kind: str, diagnostics: Diagnostics) -> Times:
    """Every time in ns; a diagnostic where an age has no bound."""
    module, verify = place.module, place.module.symbol.verify
    calculator = Calculator(diagnostics, module.scope.params)

    def ns(expr: typed.Expr | None) -> int:
        return 0 if expr is None else int(calculator.value(expr, "a time") or 0)

    found = {name: getattr(verify, name) for name in DELAYS}
    dm, sc = read_by_dm(place), read_by_sc(place)
    ages = {t: _age(place, t, diagnostics) for t in {**dm, **sc}}
    times = Times(
        module.period_ns,
        place.sc.period_ns,
        max((ages[t] for t in dm), default=0),
        max((ages[t] for t in sc), default=0),
        **{name: ns(expr) for name, expr in found.items()},
        phase_dm=place.system.components[module.dm].phase_ns,
        phase_sc=place.sc.phase_ns,
        horizon=None if verify.horizon is None else ns(verify.horizon),
        declared=frozenset(name for name, expr in found.items() if expr is not None),
    )
    if not place.abstract:
        _seen_in_time(place, sc, times, diagnostics)
        for who, topics in (("the DM", dm), ("SC", sc)):
            _of_one_instant(place, who, topics, diagnostics)
    if kind == "map":
        return _of_map(place, times, diagnostics)
    if 2 * times.jitter_sc > times.delta_sc:
        diagnostics.error(
            "R015",
            f"SC may act {show_ns(times.jitter_sc)} late, more than half of its period",
            verify.span or module.symbol.span,
            also=((place.sc.span, f"steps every {show_ns(times.delta_sc)}"),),
            notes=("lateness, response and the way to the plant together; outputs act in order",),
            helps=("a longer period of SC, or shorter times",),
        )
    return times


def read_by_dm(place: Place) -> dict[int, None]:
    """Driven topics behind a verdict of the DM: those of its predicates, or of the axes."""
    symbol, module = place.module.symbol, place.module
    predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
    topics = list(topic_reads(*predicates))
    if not predicates:
        topics = [a.topic for g in symbol.verify.groups for a in g.axes if a.topic is not None]
    scope = {**place.sc.scope.topics, **module.scope.topics}
    topics = topics or list(scope)  # computed predicates without a `grid` line read what they can
    return {scope[t]: None for t in topics if t in scope and scope[t] in place.driven}


def read_by_sc(place: Place) -> dict[int, None]:
    """Driven topics that SC reads."""
    assert place.sc.node is not None
    topics = [place.sc.scope.topics[t] for t in sc_reads(place.sc.node)]
    return {t: None for t in topics if t in place.driven}


def _age(place: Place, index: int, diagnostics: Diagnostics) -> int:
    topic = place.system.topics[index]
    if topic.max_age_ns is None:
        diagnostics.error(
            "R011",
            f"nothing bounds the age of `{topic.name}`",
            topic.symbol.span,
            notes=("a decision about a state that may be of any age is about no state",),
            helps=("declare it: `topic ... max_age 20ms;`",),
        )
        return 0
    return topic.max_age_ns


def _seen_in_time(
    place: Place, topics: dict[int, None], times: Times, diagnostics: Diagnostics
) -> None:
    """R011 where by the periods alone SC reads what is older than the `max_age` it relies on."""
    for index in topics:
        topic, plant = place.system.topics[index], place.driven[index]
        common = math.gcd(plant.period_ns, times.delta_sc)
        oldest = plant.period_ns - common + times.phase_sc % common
        oldest = min(oldest + times.late_sc, plant.period_ns)
        if topic.max_age_ns is not None and oldest > topic.max_age_ns:
            diagnostics.error(
                "R011",
                f"SC may read `{topic.name}` when it is {show_ns(oldest)} old, "
                f"longer than its `max_age` of {show_ns(topic.max_age_ns)}",
                topic.symbol.span,
                also=((plant.span, f"publishes every {show_ns(plant.period_ns)}"),),
                notes=("no runtime enforces the age of what SC reads: it must hold by itself",),
                helps=("a longer `max_age`, or a plant that publishes more often",),
            )


def _of_one_instant(
    place: Place, who: str, topics: dict[int, None], diagnostics: Diagnostics
) -> None:
    """R016 where plants publish at different instants what is read as one state.

    Plants start together: those with the same period publish at the same instants.
    """
    first, *others = topics or (None,)
    for index in others:
        assert first is not None
        plants = [place.driven[i] for i in (first, index)]
        if (plants[0].period_ns, plants[0].phase_ns) == (plants[1].period_ns, plants[1].phase_ns):
            continue
        names = [place.system.topics[i].name for i in (first, index)]
        every = [show_ns(c.period_ns) for c in plants]
        diagnostics.error(
            "R016",
            f"{who} reads `{names[0]}` and `{names[1]}`, which show the plants at different times",
            plants[1].span,
            f"publishes `{names[1]}` every {every[1]}",
            also=((plants[0].span, f"publishes `{names[0]}` every {every[0]}"),),
            notes=("an estimate is the state at one instant, plus an error",),
            helps=("give these plants one period",),
        )
        return


def _of_map(place: Place, times: Times, diagnostics: Diagnostics) -> Times:
    """A map is only defined at multiples of its period: everything is in whole steps."""
    step = place.plants[0].period_ns
    wrong = {
        "the plants": [c.period_ns for c in place.plants if c.period_ns != step],
        "the decision module": [times.delta_dm] if times.delta_dm % step else [],
        "the safe controller": [times.delta_sc] if times.delta_sc % step else [],
        "the phases": [times.phase_sc] if times.phase_sc % step else [],
    }
    for who, periods in wrong.items():
        if periods:
            diagnostics.error(
                "R012",
                f"{who} of module `{place.module.symbol.name}` cannot run every "
                f"{show_ns(periods[0])} beside a plant that moves every {show_ns(step)}",
                place.module.symbol.span,
                notes=("a plant with `next` has no state between the multiples of its period",),
                helps=("use multiples of the plant's period",),
            )
    hand_over = max(times.late_dm + times.response_dm, times.late_sc)
    late = {
        "`max_age`": max(times.age_dm, times.age_sc),
        "the sum of `late`, `response` and `acts`": hand_over + times.response_sc + times.acts,
    }
    for what, ns in late.items():
        if ns >= step:
            diagnostics.error(
                "R012",
                f"{what} of {show_ns(ns)} is no less than the plant's period, {show_ns(step)}",
                place.module.symbol.span,
                notes=("with `next`, what is read and what acts must be of the same instant",),
                helps=(f"make it shorter than {show_ns(step)}",),
            )
    return Times(
        times.delta_dm,
        times.delta_sc,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        times.phase_dm,
        times.phase_sc,
        times.horizon,
        times.declared,
    )


def terms(times: Times) -> dict[str, int]:
    """The summands of H*, in ns."""
    hand_over = max(times.late_dm + times.response_dm, times.wait + times.late_sc)
    return {
        "the age of what the DM reads": times.age_dm,
        "the period of the DM": times.delta_dm,
        "handing over to SC": hand_over,
        "SC's response": times.response_sc,
        "until a command acts": times.acts,
    }


def in_words(times: Times) -> str:
    """H and H* with the largest term, for people."""
    h, star = times.horizon_ns, times.h_star
    name, largest = max(terms(times).items(), key=lambda item: item[1])
    slack = f"{show_ns(abs(h - star))} {'spare' if h >= star else 'missing'}"
    return f"H = {show_ns(h)}, H* = {show_ns(star)} ({slack}; largest: {name}, {show_ns(largest)})"
