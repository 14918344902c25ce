"""Derives the times of a problem (docs/verification.md, Times) and checks the thread against them.

Purpose: `times_of` derives the `Times` of a module in its verification system. Where a system
declares execution times, `check_deployed_times` compares the latest start and the longest step of
every component with the lateness J and the response R that the proof counts with (R033, R034), so
that P1c also holds of what is deployed.
Non-goals: measuring anything: lateness and response times are declared, and assumed; the analysis
of the thread (`soter.timing`).

A component of the thread keeps J and R when its latest start is at most J after its release, and
its `wcet` at most R. SC may wait longer, until each DM released at or before SC has given its
verdict (docs/proof.md). A node that runs behind SC in the same instant has no times of its own in a
proof. Its publication counts as SC's output, so it has to come at most R_sc after the start of SC.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import gcd
from typing import TYPE_CHECKING

from soter.language.check.constants_and_types import Calculator
from soter.language.model.system import name_of_subsystem
from soter.language.model.types import show_ns, write_ns
from soter.timing.trusted_thread import MISSES, report_miss, timing_of
from soter.verify.problem.cause_effect_chains import (
    CauseEffectChains,
    UnfollowedError,
    actuation_paths,
    cause_effect_chains_of,
)
from soter.verify.problem.one_instant import check_one_instant
from soter.verify.problem.problem import Times
from soter.verify.problem.schedule import Releases, Schedule
from soter.verify.problem.time_checks import check_times, times_without_delays
from soter.verify.problem.verification_system import read_by_dm, read_by_sc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System
    from soter.timing.trusted_thread import ScheduledStep, Timing
    from soter.verify.problem.problem import ProblemKind
    from soter.verify.problem.verification_system import VerificationSystem


Pair = tuple[int, int]
"""Lateness and response in ns."""


@dataclass(frozen=True)
class AssumedTimes:
    """The times that the proof of a module assumes.

    `nodes` has by full name the times of followed nodes in the thread; `in_step` has the names of
    nodes that run behind SC in the same instant; `elsewhere` has the times of followed nodes in
    other processes, zero for a node that runs behind SC in the same instant.
    """

    dm: Pair
    sc: Pair
    nodes: dict[str, Pair] = field(default_factory=dict)
    in_step: tuple[str, ...] = ()
    elsewhere: dict[str, Pair] = field(default_factory=dict)


@dataclass(frozen=True)
class DeployedTimes:
    """The least times that a proof must assume; without meaning if `timing` has a deadline miss."""

    timing: Timing
    dm: Pair
    sc: Pair
    nodes: dict[str, Pair]
    late_at: dict[str, int]
    """The release with the latest start, in ns, of "dm", of "sc" or of a node, by name."""
    handed_over: int | None
    """The longest time in ns from a release of the DM to SC's start at its next release, when SC
    has the verdict, as the thread works in order. None: it is not known."""


def deployed_times(flat: System, module: Module, assumed: AssumedTimes) -> DeployedTimes | None:
    """The least times that a proof must assume, by the declared execution times of a system.

    None if the thread declares none. J of SC leaves out how long SC waits for the DM's verdict,
    which SC has by the later of the times in `assumed` and in the calendar.
    """
    if not flat.timed:
        return None
    dm, sc = flat.components[module.dm], flat.components[module.sc]
    steps: list[ScheduledStep] = []
    timing = timing_of(flat, lambda c, step: steps.append(step) if c.index == sc.index else None)
    if timing is None:
        return None
    spoken = _times_in_thread(timing, dm)
    ready = max(sum(assumed.dm), sum(spoken))
    late, response = _times_in_thread(timing, sc)
    late_at = {"dm": _latest_release(timing, dm), "sc": _latest_release(timing, sc)}
    late_at |= {n: _latest_release(timing, flat.component(n)) for n in assumed.nodes}
    if timing.exact and steps:
        worst = max(steps, key=lambda s: _lateness_without_waiting(s, dm, ready))
        late, late_at["sc"] = _lateness_without_waiting(worst, dm, ready), worst.release
    response = max(
        [response, *(_time_from_sc_to_end_of(flat, sc, flat.component(n)) for n in assumed.in_step)]
    )
    nodes = {n: _times_in_thread(timing, flat.component(n)) for n in assumed.nodes}
    handed_over = max((_wait_for_dm(s, dm, sc) for s in steps), default=0) if timing.exact else None
    return DeployedTimes(timing, spoken, (late, response), nodes, late_at, handed_over)


def _wait_for_dm(step: ScheduledStep, dm: Component, sc: Component) -> int:
    """The ns from the DM's first release since SC's last release to SC's start; 0 if none."""
    after = step.release - sc.period_ns
    first = after + 1 + (dm.phase_ns - after - 1) % dm.period_ns
    return step.start - first if first <= step.release else 0


def _times_in_thread(timing: Timing, c: Component) -> Pair:
    """The greatest lateness of a component of the thread and its `wcet`, both in ns."""
    row = timing.row(c)
    assert row is not None
    return (0 if row.worst is None else row.worst.start), row.task.wcet


def _latest_release(timing: Timing, c: Component) -> int:
    """The release, in ns, that is followed by the component's latest start."""
    row = timing.row(c)
    assert row is not None
    return 0 if row.worst is None else row.worst.at


def _lateness_without_waiting(step: ScheduledStep, dm: Component, ready: int) -> int:
    """The lateness of SC in ns in a step that does not wait for the DM's verdict, else 0."""
    due = step.release - (step.release - dm.phase_ns) % dm.period_ns
    waits = due >= dm.phase_ns and step.start <= due + ready
    return 0 if waits else step.start - step.release


def _time_from_sc_to_end_of(flat: System, sc: Component, node: Component) -> int:
    """The longest time in ns from SC's start to the end of a node that runs behind SC.

    Each component between the two counts if it may be released with SC; steps of earlier releases
    do not count, because they are over when SC starts.
    """
    between = [
        c
        for c in flat.components
        if sc.index <= c.index <= node.index
        and c.in_thread
        and (c.phase_ns - sc.phase_ns) % gcd(c.period_ns, sc.period_ns) == 0
    ]
    longest = remaining = 0
    for c in reversed(between):
        remaining += c.wcet_ns or 0
        longest = max(longest, remaining + (0 if c is sc else c.jitter_ns))
    return longest


def check_deployed_times(
    flat: System, module: Module, assumed: AssumedTimes, diagnostics: Diagnostics
) -> list[str]:
    """Checks the thread against the times of a proof; returns the assumptions, in words.

    Without declared execution times it returns none. It reports R034 if the thread's steps do not
    fit, R033 if the thread does not keep the times of the proof.
    """
    _check_other_processes(flat, module, assumed, diagnostics)
    deployment = deployed_times(flat, module, assumed)
    if deployment is None:
        return []
    timing = deployment.timing
    if timing.verdict == MISSES:
        report_miss(timing, diagnostics)
        return []
    if not timing.exact and any(r.worst is None for r in timing.rows):
        return _refuse_unknown_calendar(flat, module, diagnostics)
    pairs = {"dm": (assumed.dm, deployment.dm), "sc": (assumed.sc, deployment.sc)}
    pairs |= {n: (pair, deployment.nodes[n]) for n, pair in assumed.nodes.items()}
    release_by_name = deployment.late_at if timing.exact else {}
    if exceeded := list(_exceeded_times(pairs, release_by_name)):
        diagnostics.error(
            "R033",
            f"the thread of system `{flat.name}` does not keep the times of the proof of "
            f"`{module.name}`",
            _span_of_times(module),
            notes=(*exceeded, *([] if timing.exact else ["these are bounds: docs/timing.md"])),
            helps=(f"write `{' '.join(_time_lines(flat, module, pairs))}`",),
        )
    missing = ", ".join(c.name for c in timing.missing)
    if missing:
        return [f"no `wcet` is said of {missing}: that the thread keeps these times is assumed"]
    assumption = "`wcet` and `jitter` hold, and one thread works in the deployed order"
    others = "extern nodes run elsewhere, unless they are `inline`"
    return [f"{assumption}; {others} (docs/timing.md)"]


def _span_of_times(module: Module) -> Span:
    """The place in the program that declares the times of a module, including all of its views."""
    symbol = module.whole or module.symbol
    return symbol.verify.span or symbol.span


def _refuse_unknown_calendar(flat: System, module: Module, diagnostics: Diagnostics) -> list[str]:
    diagnostics.error(
        "R033",
        f"whether the thread of system `{flat.name}` keeps the times of the proof of "
        f"`{module.name}` is not known",
        _span_of_times(module),
        notes=("its calendar has too many steps before it comes again, and is too full",),
        helps=("periods that are multiples of one another",),
    )
    return []


def _check_other_processes(
    flat: System, module: Module, assumed: AssumedTimes, diagnostics: Diagnostics
) -> None:
    """Reports R033 if a node of another process declares longer times than the proof assumes."""
    parts = {n: flat.component(n) for n in assumed.elsewhere}
    pairs = {n: (assumed.elsewhere[n], (c.jitter_ns, c.wcet_ns or 0)) for n, c in parts.items()}
    if wrong := list(_exceeded_times(pairs, {})):
        diagnostics.error(
            "R033",
            f"nodes of system `{flat.name}` do not keep the times of the proof of `{module.name}`",
            _span_of_times(module),
            notes=(*wrong, "they run in processes of their own, and say these times themselves"),
            helps=(f"write `{' '.join(_time_lines(flat, module, pairs))}`",),
        )


def _exceeded_times(pairs: dict[str, tuple[Pair, Pair]], late_at: dict[str, int]) -> Iterator[str]:
    """A sentence for each time that exceeds the proof's time, with its release if known."""
    for name, (assumed, needed) in pairs.items():
        who = {"dm": "the DM", "sc": "SC"}.get(name, f"`{name}`")
        if needed[0] > assumed[0]:
            when = f" at {show_ns(late_at[name])}" if name in late_at else ""
            yield (
                f"{who} may start {show_ns(needed[0])} after its release{when}, "
                f"the proof counts with {show_ns(assumed[0])}"
            )
        if needed[1] > assumed[1]:
            yield (
                f"{who} may take {show_ns(needed[1])} from its start, "
                f"the proof counts with {show_ns(assumed[1])}"
            )


def _time_lines(flat: System, module: Module, pairs: dict[str, tuple[Pair, Pair]]) -> list[str]:
    """The lines `late` and `response` of a `verify` block with times that are long enough."""
    home = name_of_subsystem(module)
    lines = []
    for k, word in enumerate(("late", "response")):
        texts = [
            f"{n.removeprefix(f'{home}.')} {write_ns(max(a[k], b[k]))}"
            for n, (a, b) in pairs.items()
            if max(a[k], b[k])
            and not (word == "response" and n not in ("dm", "sc") and flat.component(n).takes_ns)
        ]
        lines += [f"{word} {', '.join(texts)};"] if texts else []
    return lines


DELAYS = ("late_dm", "late_sc", "response_dm", "response_sc", "acts")


def times_of(
    place: VerificationSystem, kind: ProblemKind, diagnostics: Diagnostics
) -> tuple[Times, CauseEffectChains]:
    """Every time of a proof in ns, and the data paths behind it; reports times not covered."""
    module, verify = place.module, place.module.symbol.verify
    calculator = Calculator(diagnostics, module.scope.params)

    def ns(expr: typed.TypedExpr | None) -> int:
        return 0 if expr is None else int(calculator.value(expr, "a time") or 0)

    delays = {name: ns(getattr(verify, name)) for name in DELAYS}
    dm, sc = read_by_dm(place), read_by_sc(place)
    for topic in {**dm, **sc}:
        _check_max_age(place, topic, diagnostics)
    try:
        chains = cause_effect_chains_of(place, list(dm), list(sc), ns)
    except UnfollowedError as error:
        _refuse_unfollowed(place, error, diagnostics)
        chains = CauseEffectChains()
    if verify.age is not None:
        chains = _chains_with_age_of_sc(chains, ns(verify.age))
    outputs = actuation_paths(chains, ns(verify.acts_least), delays["acts"])
    dm_component = place.system.components[module.dm]
    schedule = Schedule(
        Releases(module.period_ns, dm_component.phase_ns, delays["late_dm"], delays["response_dm"]),
        Releases(place.sc.period_ns, place.sc.phase_ns, delays["late_sc"], delays["response_sc"]),
        tuple(r.path for r in chains.by_dm),
        tuple(r.path for r in chains.by_sc),
        outputs,
        ns(verify.dropout),
    )
    rests: list[str] = []
    if not diagnostics.has_errors:
        assumed = assumed_times_of(schedule, chains)
        rests = check_deployed_times(place.flat, place.home, assumed, diagnostics)
    declared = [name for name in DELAYS if getattr(verify, name) is not None]
    declared += [] if nodes_without_times(place, chains) else ["nodes"]
    horizon = None if verify.horizon is None else ns(verify.horizon)
    times = Times(schedule, horizon, frozenset(declared), tuple(rests))
    if not diagnostics.has_errors:
        check_times(place, kind, times, chains, diagnostics)
        check_one_instant(place, chains, schedule.dropout, diagnostics)
    return (times_without_delays(times) if kind == "map" else times), chains


def assumed_times_of(schedule: Schedule, chains: CauseEffectChains) -> AssumedTimes:
    """The times that the proof counts with, for DM, SC and all nodes on the paths."""
    on_chains = [
        pair
        for chain in (*chains.by_dm, *chains.by_sc)
        for pair in zip(chain.stations, chain.path.nodes, strict=True)
    ]
    releases = dict(on_chains)
    releases.update((n, chains.releases[n]) for n in chains.behind)
    in_step = dict.fromkeys(n for w in chains.ways for n in w.in_step)
    elsewhere = {n.name: (0, 0) for n in in_step if not n.in_thread}
    elsewhere |= {n.name: (r.late, r.response) for n, r in releases.items() if not n.in_thread}
    return AssumedTimes(
        dm=(schedule.dm.late, schedule.dm.response),
        sc=(schedule.sc.late, schedule.sc.response),
        nodes={n.name: (r.late, r.response) for n, r in releases.items() if n.in_thread},
        in_step=tuple(n.name for n in in_step if n.in_thread),
        elsewhere=elsewhere,
    )


def nodes_without_times(place: VerificationSystem, chains: CauseEffectChains) -> list[str]:
    """The names of nodes on the data paths for which `late` or `response` is not declared."""
    nodes = dict.fromkeys([*chains.nodes, *chains.behind])
    return [
        n.name for n in nodes if None in (place.declared_time(n, w) for w in ("late", "response"))
    ]


def _check_max_age(place: VerificationSystem, index: int, diagnostics: Diagnostics) -> None:
    topic = place.system.topics[index]
    if topic.max_age_ns is None:
        diagnostics.error(
            "R011",
            f"nothing bounds the age of `{topic.name}`",
            topic.symbol.span,
            notes=("a decision about a state that may be of any age is about no state",),
            helps=("declare it: `topic ... max_age 20ms;`",),
        )


def _chains_with_age_of_sc(chains: CauseEffectChains, most_ns: int) -> CauseEffectChains:
    """A copy of the paths in which SC reads no state older than `most_ns`."""
    younger = [
        replace(c, path=replace(c.path, max_age=min(c.path.max_age or most_ns, most_ns)))
        for c in chains.by_sc
    ]
    return replace(chains, by_sc=younger)


def _refuse_unfollowed(
    place: VerificationSystem, error: UnfollowedError, diagnostics: Diagnostics
) -> None:
    diagnostics.error(
        "R017",
        f"the way through `{error.node.name}` cannot be followed: {error}",
        error.node.span,
        also=((place.module.symbol.span, "on the way to this module"),),
        notes=("how old the state is that a module sees depends on everybody on the way to it",),
    )


def summands_of_h_star(times: Times) -> dict[str, int]:
    """The summands of H* in ns, by their names in words."""
    schedule = times.schedule
    summands = {
        "the age of what the DM reads": times.age_dm,
        "the period of the DM": times.delta_dm,
        "handing over to SC": max(schedule.dm.latest, schedule.longest_to_sc + times.late_sc),
        "SC's response": times.response_sc,
        "until a command acts": times.acts,
    }
    on_the_way = schedule.h_star - sum(summands.values())
    return {**summands, "nodes behind SC": on_the_way} if on_the_way else summands


def horizon_in_words(times: Times) -> str:
    """H and H* in words, with the largest summand of H*."""
    h, star = times.horizon_ns, times.h_star
    name, largest = max(summands_of_h_star(times).items(), key=lambda item: item[1])
    if times.horizon is None:
        return (
            f"H = H* = {show_ns(h)}: what is needed (no `horizon` declared; "
            f"largest: {name}, {show_ns(largest)})"
        )
    slack = f"{show_ns(abs(h - star))} {'spare' if h >= star else 'missing'}"
    return f"H = {show_ns(h)}, H* = {show_ns(star)} ({slack}; largest: {name}, {show_ns(largest)})"


def look_ahead_advice(times: Times, predicate: str) -> str:
    """Advice to make a `ttf` or `safer` look ahead by H, with the parts of H."""
    parts = ", ".join(
        f"{name} {show_ns(ns)}" for name, ns in summands_of_h_star(times).items() if ns
    )
    ahead = f"a `{predicate}` that looks ahead there by H = {show_ns(times.horizon_ns)} ({parts})"
    return f"{ahead}, by the errors, and by what SC needs after that"
