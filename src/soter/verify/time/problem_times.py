"""The times of a problem (docs/verification.md, Times).

Purpose: `Times` of a module in its verification system; P1c in words.
Non-goals: measuring anything: lateness and response times are declared, and assumed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.constants import Calculator
from soter.language.model.durations import show_ns
from soter.language.model.tree_walk import topic_reads
from soter.timing.trusted_thread import in_thread
from soter.verify.problem.problem import Times
from soter.verify.problem.verification_system import sc_reads
from soter.verify.time.always_publishes import UnfollowedError
from soter.verify.time.cause_effect_chains import CauseEffectChains, chains_of, outputs_of
from soter.verify.time.deployed_times import AssumedTimes, check_deployed
from soter.verify.time.schedule import Releases, Schedule
from soter.verify.time.time_checks import check_times, of_map

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model import typed
    from soter.language.model.system import Component
    from soter.verify.problem.problem import ProblemKind
    from soter.verify.problem.verification_system import VerificationSystem
    from soter.verify.time.cause_effect_chains import CauseEffectChain

DELAYS = ("late_dm", "late_sc", "response_dm", "response_sc", "acts")
WORDS = {
    "late_dm": "the DM starts on time",
    "late_sc": "SC starts on time",
    "response_dm": "the DM takes no time",
    "response_sc": "SC takes no time",
    "acts": "commands act at once",
}


def times_of(
    place: VerificationSystem, kind: ProblemKind, diagnostics: Diagnostics
) -> tuple[Times, CauseEffectChains]:
    """Every time in ns, and the ways they come from; a diagnostic where an age has no bound."""
    module, verify = place.module, place.module.symbol.verify
    calculator = Calculator(diagnostics, module.scope.params)

    def ns(expr: typed.TypedExpr | None) -> int:
        return 0 if expr is None else int(calculator.value(expr, "a time") or 0)

    given = {name: getattr(verify, name) for name in DELAYS}
    delays = {name: ns(expr) for name, expr in given.items()}
    dm, sc = read_by_dm(place), read_by_sc(place)
    for topic in {**dm, **sc}:
        _aged(place, topic, diagnostics)
    try:
        chains = chains_of(place, list(dm), list(sc), ns)
    except UnfollowedError as error:
        _unfollowed(place, error, diagnostics)
        chains = CauseEffectChains()
    outputs = outputs_of(chains, ns(verify.acts_least), delays["acts"])
    at = place.system.components[module.dm]
    schedule = Schedule(
        Releases(module.period_ns, at.phase_ns, delays["late_dm"], delays["response_dm"]),
        Releases(place.sc.period_ns, place.sc.phase_ns, delays["late_sc"], delays["response_sc"]),
        tuple(r.path for r in chains.by_dm),
        tuple(r.path for r in chains.by_sc),
        outputs,
        ns(verify.dropout),
    )
    rests: list[str] = []
    if not diagnostics.has_errors:
        assumed = assumed_of(schedule, chains)
        rests = check_deployed(place.flat, place.home, assumed, diagnostics)
    times = Times(
        schedule,
        rests=tuple(rests),
        horizon=None if verify.horizon is None else ns(verify.horizon),
        declared=frozenset(
            [name for name, expr in given.items() if expr is not None]
            + ([] if undeclared(place, chains) else ["nodes"])
        ),
    )
    if not diagnostics.has_errors:
        check_times(place, kind, times, chains, diagnostics)
        if not place.abstract:
            for who, topics in (("the DM", dm), ("SC", sc)):
                _of_one_instant(place, who, topics, diagnostics)
    return (of_map(times) if kind == "map" else times), chains


def assumed_of(schedule: Schedule, chains: CauseEffectChains) -> AssumedTimes:
    """What the proof counts with, of everybody on the way."""
    at = {n: r for q in (*chains.by_dm, *chains.by_sc) for n, r in _stations(q)}
    at.update((n, chains.releases[n]) for n in chains.behind)
    in_step = dict.fromkeys(n for w in chains.ways for n in w.in_step)
    elsewhere = {n.name: (0, 0) for n in in_step if not in_thread(n)}
    elsewhere |= {n.name: (r.late, r.response) for n, r in at.items() if not in_thread(n)}
    return AssumedTimes(
        dm=(schedule.dm.late, schedule.dm.response),
        sc=(schedule.sc.late, schedule.sc.response),
        nodes={n.name: (r.late, r.response) for n, r in at.items() if in_thread(n)},
        in_step=tuple(n.name for n in in_step if in_thread(n)),
        elsewhere=elsewhere,
    )


def _stations(chain: CauseEffectChain) -> Iterator[tuple[Component, Releases]]:
    return zip(chain.stations, chain.path.nodes, strict=True)


def undeclared(place: VerificationSystem, chains: CauseEffectChains) -> list[str]:
    """Nodes on the way of which not both times are declared."""
    nodes = dict.fromkeys([*chains.nodes, *chains.behind])
    return [n.name for n in nodes if None in (place.declared(n, w) for w in ("late", "response"))]


def read_by_dm(place: VerificationSystem) -> dict[int, None]:
    """Driven topics behind a verdict of the DM: those of its predicates, or of the axes."""
    symbol, module = place.module.symbol, place.module
    predicates = [e for e in (symbol.ttf, symbol.safer) if e is not None]
    topics = list(topic_reads(*predicates))
    if not predicates:
        topics = [a.topic for g in symbol.verify.groups for a in g.axes if a.topic is not None]
    scope = {**place.sc.scope.topics, **module.scope.topics}
    topics = topics or list(scope)  # computed predicates without a `grid` line read what they can
    return {scope[t]: None for t in topics if t in scope and scope[t] in place.driven}


def read_by_sc(place: VerificationSystem) -> dict[int, None]:
    """Driven topics that SC reads."""
    assert place.sc.node is not None
    topics = [place.sc.scope.topics[t] for t in sc_reads(place.sc.node)]
    return {t: None for t in topics if t in place.driven}


def _aged(place: VerificationSystem, index: int, diagnostics: Diagnostics) -> None:
    topic = place.system.topics[index]
    if topic.max_age_ns is None:
        diagnostics.error(
            "R011",
            f"nothing bounds the age of `{topic.name}`",
            topic.symbol.span,
            notes=("a decision about a state that may be of any age is about no state",),
            helps=("declare it: `topic ... max_age 20ms;`",),
        )


def _unfollowed(
    place: VerificationSystem, error: UnfollowedError, diagnostics: Diagnostics
) -> None:
    diagnostics.error(
        "R017",
        f"the way through `{error.node.name}` cannot be followed: {error}",
        error.node.span,
        also=((place.module.symbol.span, "on the way to this module"),),
        notes=("how old the state is that a module sees depends on everybody on the way to it",),
    )


def _of_one_instant(
    place: VerificationSystem, who: str, topics: dict[int, None], diagnostics: Diagnostics
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


def terms(times: Times) -> dict[str, int]:
    """The summands of H*, in ns."""
    schedule = times.schedule
    summands = {
        "the age of what the DM reads": times.age_dm,
        "the period of the DM": times.delta_dm,
        "handing over to SC": max(schedule.dm.latest, schedule.farthest + times.late_sc),
        "SC's response": times.response_sc,
        "until a command acts": times.acts,
    }
    on_the_way = schedule.h_star - sum(summands.values())
    return {**summands, "nodes behind SC": on_the_way} if on_the_way else summands


def in_words(times: Times) -> str:
    """H and H* with the largest term, for people."""
    h, star = times.horizon_ns, times.h_star
    name, largest = max(terms(times).items(), key=lambda item: item[1])
    if times.schedule.handed_back == star:
        name, largest = "a hand-back of the module above", star
    if times.horizon is None:
        return (
            f"H = H* = {show_ns(h)}: what is needed (no `horizon` declared; "
            f"largest: {name}, {show_ns(largest)})"
        )
    slack = f"{show_ns(abs(h - star))} {'spare' if h >= star else 'missing'}"
    return f"H = {show_ns(h)}, H* = {show_ns(star)} ({slack}; largest: {name}, {show_ns(largest)})"
