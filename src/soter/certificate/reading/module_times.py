"""The times of one module, read again off the program, and whether the trusted thread keeps them.

Purpose: `read_times` makes a `TimingSetting` of the declared delays, what DM and SC read with its
`max_age`, and the nodes on the way, and has all times derived; `compare_times` compares those of a
manifest with them. `check_thread`, an extra, shows, from the execution times that the flying system
declares, that nobody in the thread starts or ends later than the `TimingSetting` says.
Non-goals: the derivation (`derived_times.py`), the nodes on the way (`node_paths.py`).

Own derivation of what the thread keeps. The thread takes the releases of the calendar one after the
other, those of one instant in the deployed order. Let W(k) be the work of the first k of them.
Release k cannot have ended later than at the greatest, over i <= k, of r(i) + J(i) + W(k) - W(i -
1): the thread is not idle from the begin of the last one i that it had to wait for. If the work of
a hyperperiod T is at most T, an i one hyperperiod earlier gives no more: r falls by T, and W(i - 1)
by no more. So all that matters of release k lies in the hyperperiod before it, and what is true of
one hyperperiod in which that is over for all releases, and of those before, is true of all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import lcm
from typing import TYPE_CHECKING, Any

from soter.certificate.folder import only_keys
from soter.certificate.reading.derived_times import (
    RELEASES_MAX,
    Clock,
    DerivedTimes,
    TimingSetting,
    TopicReading,
    Ways,
    derive,
    nodes_between,
)
from soter.certificate.reading.module_facts import (
    DiffersError,
    Facts,
    driven_topics,
    number_of,
    read_by,
)
from soter.certificate.reading.node_paths import NodeWays
from soter.certificate.reading.verification_system import seen_from_what_is_abstracted
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Component, Module, System


@dataclass(frozen=True)
class ThreadRelease:
    """One release: who, when, and when it begins and ends at the latest; times in ns."""

    who: Component
    release: int
    begins: int
    ends: int


def _check_behind_sc(
    sc: Component, turns: list[ThreadRelease], nodes: Iterable[Component], response: int
) -> None:
    for node in nodes:
        if node.in_thread and _behind_sc(turns, sc, node) > response:
            raise DiffersError(f"`{node.name}` may end later behind SC than its response says")


def check_thread(
    system: System, module: Module, setting: TimingSetting, in_step: Iterable[str]
) -> str:
    """DiffersError where a time of the setting does not hold in the thread; else what is assumed.

    Nothing is assumed where nobody in the thread says an execution time, or how late its release
    may be. A time that is not said is counted as nothing: what does not hold even then is a miss.
    `in_step`: nodes behind SC in its instant, by name. SC may begin when the DM's verdict may still
    be due, which `starts_by` counts. NotRecheckedError where there are too many releases.
    """
    clocks = {c.name: c for c in _way_clocks(setting)}
    _check_processes(system, clocks, in_step)
    thread = [c for c in system.components if c.in_thread]
    if all(c.wcet_ns is None and not c.jitter_ns for c in thread):
        return ""
    turns = _releases(thread)
    dm, sc = system.components[module.dm], system.components[module.sc]
    clocks[dm.name] = setting.dm
    for t in turns:
        if t.ends > t.release + t.who.period_ns:
            raise DiffersError(f"`{t.who.name}` may not be done when it is released again")
        if t.who.index == sc.index:
            _check_release(t, setting.starts_by(t.release), setting.sc.response)
        elif t.who.name in clocks:
            clock = clocks[t.who.name]
            _check_release(t, t.release + clock.late, clock.response)
    _check_behind_sc(sc, turns, map(system.component, in_step), setting.sc.response)
    absent = [c.name for c in thread if c.wcet_ns is None]
    if absent:
        return f"execution times are not declared of {', '.join(absent)}: lateness is assumed"
    return (
        "declared execution times and jitters hold, in one thread that works in order; "
        "externs are in no thread but their own unless declared inline"
    )


def _check_processes(system: System, clocks: dict[str, Clock], in_step: Iterable[str]) -> None:
    """DiffersError where a node in a process of its own says longer times than are counted with.

    Of a node that is taken to run with SC none are.
    """
    times = {name: (clock.late, clock.response) for name, clock in clocks.items()}
    for name, (late, response) in (times | dict.fromkeys(in_step, (0, 0))).items():
        c = system.component(name)
        if not c.in_thread and (c.jitter_ns > late or (c.wcet_ns or 0) > response):
            raise DiffersError(f"`{name}` says itself that it may be later, or take longer")


def delayed(system: System, followed: Iterable[Component]) -> str:
    """One of the components that may start or end after its release in the thread; "" if none may.

    DiffersError, NotRecheckedError where the thread has too much to do, or too many releases.
    """
    thread = [c for c in system.components if c.in_thread]
    own = {c.index for c in followed}
    apart = [c.name for c in followed if c not in thread and (c.jitter_ns or c.wcet_ns)]
    late = [t.who.name for t in _releases(thread) if t.who.index in own and t.ends > t.release]
    return next(iter([*apart, *late]), "")


def _way_clocks(setting: TimingSetting) -> Iterable[Clock]:
    for read in (*setting.by_dm, *setting.by_sc):
        for path in read.paths:
            yield from path.clocks[1:]
    for effect in setting.effects:
        yield from effect.clocks


def _releases(thread: list[Component]) -> list[ThreadRelease]:
    """Every release until all have begun and two hyperperiods have gone by."""
    hyper = lcm(*(c.period_ns for c in thread))
    work = sum(hyper // c.period_ns * (c.wcet_ns or 0) for c in thread)
    if work > hyper:
        raise DiffersError("the thread has more to do than there is time")
    end = max(c.phase_ns for c in thread) + 2 * hyper
    if sum(end // c.period_ns + 1 for c in thread) > RELEASES_MAX:
        raise NotRecheckedError("the thread has too many releases to go through")
    releases = [
        (at, place) for place, c in enumerate(thread) for at in range(c.phase_ns, end, c.period_ns)
    ]
    releases.sort()
    turns: list[ThreadRelease] = []
    done = 0
    ahead = -(1 << 62)
    for at, place in releases:
        c = thread[place]
        ahead = max(ahead, at + c.jitter_ns - done)
        done += c.wcet_ns or 0
        turns.append(ThreadRelease(c, at, ahead + done - (c.wcet_ns or 0), ahead + done))
    return turns


def _check_release(turn: ThreadRelease, start: int, response: int) -> None:
    if turn.begins > start:
        late = show_ns(turn.begins - turn.release)
        raise DiffersError(f"`{turn.who.name}` may start {late} after a release in the thread")
    if turn.ends - turn.begins > response:
        took = show_ns(turn.ends - turn.begins)
        raise DiffersError(f"`{turn.who.name}` may take {took} in the thread")


def _behind_sc(turns: list[ThreadRelease], sc: Component, node: Component) -> int:
    """From the begin of SC to the end of a node behind it in the same instant, at most.

    The thread may wait in between for the release of one of them, no earlier than the instant.
    """
    worst, instant, between = 0, -1, list[ThreadRelease]()
    for t in turns:
        if t.who.index == sc.index:
            instant, between = t.release, [t]
        elif t.release == instant and between:
            between.append(t)
        if t.who.index == node.index and t.release == instant and between:
            for i, first in enumerate(between):
                waits = 0 if i == 0 else first.who.jitter_ns
                worst = max(worst, waits + sum(x.who.wcet_ns or 0 for x in between[i:]))
    return worst


DELAYS = {
    "J_dm_ns": ("late dm", "late_dm"),
    "J_sc_ns": ("late sc", "late_sc"),
    "R_dm_ns": ("response dm", "response_dm"),
    "R_sc_ns": ("response sc", "response_sc"),
    "L_ns": ("acts within", "acts"),
}
"""Name in the manifest -> how the program says it, and where the `verify` block has it."""


def _check_instants(facts: Facts, reads: tuple[list[int], list[int]]) -> None:
    driven = driven_topics(facts)
    for together in reads:
        if len({(driven[t][0].period_ns, driven[t][0].phase_ns) for t in together}) > 1:
            raise DiffersError("what is read together is published at different times")


def _check_max_ages(setting: TimingSetting, own: DerivedTimes) -> None:
    for read in setting.by_sc:
        oldest = own.stamps.get(read.name, 0)
        if oldest > read.max_age:
            raise DiffersError(
                f"R011: what SC reads of `{read.name}` may be {show_ns(oldest)} old, "
                f"and `max_age` says {show_ns(read.max_age)}"
            )


def read_times(facts: Facts) -> None:
    """Enters into `facts` every time in ns, by its name in the manifest: declared or derived.

    DiffersError where what is declared contradicts the program, NotRecheckedError where times are
    none that are read here.
    """
    verify = facts.symbol.verify
    time_by_name = {"Delta_ns": facts.module.period_ns, "delta_ns": facts.sc.period_ns}
    for key, (_, name) in DELAYS.items():
        time_by_name[key] = number_of(facts, getattr(verify, name))
    by_dm, by_sc = read_by(facts)
    if not verify.abstracts:
        _check_instants(facts, (by_dm, by_sc))
    running = {facts.running[i] for i in (*by_dm, *by_sc)}
    if verify.abstracts or nodes_between(facts.flying, facts.flying_module, running):
        number = partial(number_of, facts)
        facts.ways = NodeWays(facts.flying, facts.flying_module, number)
    else:
        facts.ways = Ways(facts.flying, facts.flying_module)
    setting = _timing(facts, by_dm, by_sc, time_by_name)
    if verify.abstracts:
        seen_from_what_is_abstracted(facts, {*by_dm, *by_sc})
    if facts.kind == "map":
        _check_map(facts, setting)
    own = derive(setting)
    # With nodes R015 holds; and so none of them skips an output (R018): let one step before it sees
    # output k, and next when k + 1 is there. Then k may not act before k + 1 may, by the same step
    # and the same nodes behind it, so that j would be delta or more.
    if 2 * own.jitter > setting.sc.period:
        _check_late_commands(facts, setting)
    _check_max_ages(setting, own)
    time_by_name |= {"A_ns": own.age, "A_sc_ns": own.age_sc, "d_ns": own.delay, "j_ns": own.jitter}
    time_by_name |= {"h0_ns": own.h_0, "H_star_ns": own.h_star, "H_ns": own.h_star}
    if verify.horizon is not None:
        time_by_name["H_ns"] = int(number_of(facts, verify.horizon))
    in_step = [name for kind, name in facts.ways.notes if kind == "in step"]
    if facts.flying.timed:
        facts.thread = check_thread(facts.flying, facts.flying_module, setting, in_step)
    facts.times, facts.own, facts.setting = time_by_name, own, setting


def _timing(
    facts: Facts, by_dm: list[int], by_sc: list[int], times: dict[str, int]
) -> TimingSetting:
    """Everything that the times depend on; topics are those of the system that runs."""
    system, module = facts.flying, facts.flying_module
    dm, sc = system.components[module.dm], system.components[module.sc]

    def reads(topics: list[int]) -> tuple[TopicReading, ...]:
        found = []
        for index in topics:
            age, running = facts.system.topics[index].max_age_ns, facts.running[index]
            if age is None:
                raise NotRecheckedError("a topic that the module reads has no `max_age`")
            name = system.topics[running].name
            found.append(TopicReading(name, facts.ways.to(running), age))
        return tuple(found)

    found_dm, found_sc = reads(by_dm), reads(by_sc)  # before effects: they say what is vehicle
    return TimingSetting(
        Clock("the DM", module.period_ns, dm.phase_ns, times["J_dm_ns"], times["R_dm_ns"]),
        Clock("SC", sc.period_ns, sc.phase_ns, times["J_sc_ns"], times["R_sc_ns"]),
        found_dm,
        found_sc,
        facts.ways.effects(number_of(facts, facts.symbol.verify.acts_least), times["L_ns"]),
        number_of(facts, facts.symbol.verify.dropout),
        facts.kind == "map",
    )


def _check_late_commands(facts: Facts, setting: TimingSetting) -> None:
    """NotRecheckedError where no argument is known of an SC whose jitter exceeds half its period.

    Chains of grids have one (`flow_chains.py`).
    """
    symbol = facts.symbol
    beside = {
        "nodes behind it": any(e.clocks for e in setting.effects),
        "an abstraction": bool(symbol.verify.abstracts),
        "`rest`": symbol.rest is not None,
        "`failsafe`": bool(symbol.failsafe),
        "`shield`": symbol.shield is not None,
        "half-spaces": any(g.kind != "grid" for g in symbol.verify.groups),
        "views": bool(facts.view or symbol.verify.views),
        "modules above or below": len(facts.tower) > 1,
    }
    for what, is_there in beside.items():
        if is_there:
            raise NotRecheckedError(f"an SC whose jitter exceeds half its period, with {what}")


def _check_map(facts: Facts, setting: TimingSetting) -> None:
    """Check that all that is read and all that acts is of one instant, in which the map steps.

    Else `NotRecheckedError`: ages and delays are not counted beside a map.
    """
    step, dm, sc = facts.plants[0].period_ns, setting.dm, setting.sc
    paths = [(r, p) for r in (*setting.by_dm, *setting.by_sc) for p in r.paths]
    late = [dm.slow, sc.slow, *(e.least | e.most for e in setting.effects)]
    between = [*(p.clocks[1:] for _, p in paths), *(e.clocks for e in setting.effects)]
    together = (dm.period, sc.period, dm.phase, sc.phase)
    beside = {
        "maps with different periods": {c.period_ns for c in facts.plants} != {step},
        "a module that does not step together with its map": any(ns % step for ns in together),
        "delays beside a map": any(late),
        "`dropout` beside a map": setting.silent,
        "nodes between a map and its module": any(between),
    }
    for what in (what for what, is_there in beside.items() if is_there):
        raise NotRecheckedError(what)
    for read, path in paths:
        sensor = path.sensor
        if sensor.phase or step % sensor.period:
            raise NotRecheckedError(f"`{sensor.name}` does not publish whenever the map steps")
        if read.max_age >= sensor.period:
            raise NotRecheckedError("beside a map `max_age` must be shorter than its period")


DECLARED_KEYS = ("Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")
"""Times that the program declares: a manifest has them unchanged."""
DERIVED_KEYS = ("A_ns", "A_sc_ns", "H_star_ns", "d_ns", "j_ns", "h0_ns")
"""Times that follow: a manifest may claim more schedules than there are, never fewer."""
TIME_KEYS = (*DECLARED_KEYS, *DERIVED_KEYS, "H_ns")
BEYOND, BEYOND_NS = 4, 1_000_000_000
"""A time beyond this multiple of ours, plus all times and so many ns, would only cost work."""


def compare_times(facts: Facts, given: dict[str, Any]) -> None:
    """Declared times are those of the program, derived ones no shorter; the longer ones count.

    Older reads, wider windows, a longer horizon: a claim about more schedules implies ours.
    RejectedError where they are shorter, NotRecheckedError where nobody needs such long ones.
    """
    only_keys(given, " ".join(TIME_KEYS), "`times`")
    ages = [r.max_age for r in (*facts.setting.by_dm, *facts.setting.by_sc)]
    own_jitter = facts.times["j_ns"]
    together = sum(facts.times[k] for k in TIME_KEYS) + sum(ages)
    for key in TIME_KEYS:
        value, own = given[key], facts.times[key]
        if not isinstance(value, int) or isinstance(value, bool):
            raise RejectedError(f"{key} is no time in the manifest")
        fixed = key in DECLARED_KEYS or (key == "H_ns" and facts.symbol.verify.horizon is not None)
        if value < own or (fixed and value != own):
            raise RejectedError(f"{key} is {value} in the manifest, {own} by the program")
        if value > BEYOND * own + together + BEYOND_NS:
            raise NotRecheckedError(f"{key} is {value} in the manifest, which no program needs")
        facts.times[key] = value
    if 2 * own_jitter <= facts.times["delta_ns"] < 2 * facts.times["j_ns"]:
        raise NotRecheckedError("a j in the manifest of more than half a period, and less is there")
