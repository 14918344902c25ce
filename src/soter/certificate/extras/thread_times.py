"""Whether the trusted thread keeps the times that a module is held to, checked again: an extra.

Purpose: DM, SC and nodes of Soter code run in one thread. `thread_time_assumption` shows, from the
execution times and jitters that the flying system declares, that none of them begins or ends later
there than a `TimingSetting` says; processes of their own are compared with what they say
themselves. An induction, whose steps take no time, asks `first_delayed_in_thread` for a component
that is late.
Non-goals: the times themselves (`module_times.py`), how they are derived (`derived_times.py`).

Own derivation. The thread takes the releases of the calendar one after the other, those of one
instant in the deployed order. Let W(k) be the work of the first k of them. Release k cannot have
ended later than at the greatest, over i <= k, of r(i) + J(i) + W(k) - W(i - 1): the thread is not
idle from the begin of the last one i that it had to wait for. If the work of a hyperperiod T is at
most T, an i one hyperperiod earlier gives no more: r falls by T, and W(i - 1) by no more. So
release k depends on nothing before the last hyperperiod ahead of it. From the first hyperperiod in
which this holds for every release, all hyperperiods are alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import lcm
from typing import TYPE_CHECKING

from soter.certificate.reading.derived_times import RELEASES_MAX, Clock, TimingSetting
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.report import NotRecheckedError
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import Component, Module, System


@dataclass(frozen=True)
class ThreadRelease:
    """A release in the thread: its component, and its latest start and end in ns."""

    who: Component
    release: int
    begins: int
    ends: int


def thread_time_assumption(
    system: System, module: Module, setting: TimingSetting, in_step: Iterable[str]
) -> str:
    """Checks the thread's times and returns the assumption about them as text.

    It is "" if nothing in the thread declares an execution time or jitter. Undeclared times count
    as zero: a time that is exceeded even then is a miss. `in_step`: names of nodes behind SC in its
    instant. SC may begin while the DM's verdict is due, which `latest_start` counts. Raises
    DiffersError for a time that is exceeded, NotRecheckedError for too many releases.
    """
    clocks = {c.name: c for c in _clocks_of_nodes(setting)}
    _check_own_times(system, clocks, in_step)
    thread = [c for c in system.components if _is_in_thread(c)]
    if all(c.wcet_ns is None and not c.jitter_ns for c in thread):
        return ""
    releases = _releases_of_thread(thread)
    dm, sc = system.components[module.dm], system.components[module.sc]
    clocks[dm.name] = setting.dm
    for t in releases:
        if t.ends > t.release + t.who.period_ns:
            raise DiffersError(f"`{t.who.name}` may not be done when it is released again")
        if t.who.index == sc.index:
            _require_release_in_time(t, setting.latest_start(t.release), setting.sc.response)
        elif t.who.name in clocks:
            clock = clocks[t.who.name]
            _require_release_in_time(t, t.release + clock.late, clock.response)
    _require_end_behind_sc(sc, releases, map(system.component, in_step), setting.sc.response)
    absent = [c.name for c in thread if c.wcet_ns is None]
    if absent:
        return f"execution times are not declared of {', '.join(absent)}: lateness is assumed"
    return (
        "declared execution times and jitters hold, in one thread that works in order; "
        "externs are in no thread but their own unless declared inline"
    )


def first_delayed_in_thread(system: System, followed: Iterable[Component]) -> str:
    """The first component that may start or end after its release in the thread, or "".

    Raises DiffersError or NotRecheckedError if the thread is overloaded or has too many releases.
    """
    thread = [c for c in system.components if _is_in_thread(c)]
    ids = {c.index for c in followed}
    apart = [c.name for c in followed if c not in thread and (c.jitter_ns or c.wcet_ns)]
    late = [
        t.who.name for t in _releases_of_thread(thread) if t.who.index in ids and t.ends > t.release
    ]
    return next(iter([*apart, *late]), "")


def _is_in_thread(c: Component) -> bool:
    """Whether a component runs in the thread: as Soter code, or as an `inline` extern."""
    if c.node is None:
        return c.role == "dm"
    return c.inline or not c.extern


def _clocks_of_nodes(setting: TimingSetting) -> Iterable[Clock]:
    """The clocks of all nodes between the sensors, the module and the plants."""
    for read in (*setting.by_dm, *setting.by_sc):
        for path in read.paths:
            yield from path.clocks[1:]
    for effect in setting.effects:
        yield from effect.clocks


def _releases_of_thread(thread: list[Component]) -> list[ThreadRelease]:
    """All releases until each component has begun and two hyperperiods have passed."""
    hyper = lcm(*(c.period_ns for c in thread))
    work = sum(hyper // c.period_ns * (c.wcet_ns or 0) for c in thread)
    if work > hyper:
        raise DiffersError("the thread has more to do than there is time")
    end = max(c.phase_ns for c in thread) + 2 * hyper
    if sum(end // c.period_ns + 1 for c in thread) > RELEASES_MAX:
        raise NotRecheckedError("the thread has too many releases to go through")
    calendar = sorted(
        (at, place) for place, c in enumerate(thread) for at in range(c.phase_ns, end, c.period_ns)
    )
    releases: list[ThreadRelease] = []
    done = 0
    ahead = -(1 << 62)
    for at, place in calendar:
        c = thread[place]
        ahead = max(ahead, at + c.jitter_ns - done)
        done += c.wcet_ns or 0
        releases.append(ThreadRelease(c, at, ahead + done - (c.wcet_ns or 0), ahead + done))
    return releases


def _require_release_in_time(turn: ThreadRelease, start: int, response: int) -> None:
    """Raises DiffersError if a release starts after `start` or takes over `response` (ns)."""
    if turn.begins > start:
        late = show_ns(turn.begins - turn.release)
        raise DiffersError(f"`{turn.who.name}` may start {late} after a release in the thread")
    if turn.ends - turn.begins > response:
        took = show_ns(turn.ends - turn.begins)
        raise DiffersError(f"`{turn.who.name}` may take {took} in the thread")


def _check_own_times(system: System, clocks: dict[str, Clock], in_step: Iterable[str]) -> None:
    """Raises DiffersError if a node in a separate process declares longer times than assumed.

    A node that runs with SC is assumed to take no time.
    """
    times = {name: (clock.late, clock.response) for name, clock in clocks.items()}
    for name, (late, response) in (times | dict.fromkeys(in_step, (0, 0))).items():
        c = system.component(name)
        if not _is_in_thread(c) and (c.jitter_ns > late or (c.wcet_ns or 0) > response):
            raise DiffersError(f"`{name}` says itself that it may be later, or take longer")


def _require_end_behind_sc(
    sc: Component, releases: list[ThreadRelease], nodes: Iterable[Component], response: int
) -> None:
    """Raises DiffersError if a node in the thread may end over `response` ns after SC begins."""
    for node in nodes:
        if _is_in_thread(node) and _longest_ns_behind_sc(releases, sc, node) > response:
            raise DiffersError(f"`{node.name}` may end later behind SC than its response says")


def _longest_ns_behind_sc(releases: list[ThreadRelease], sc: Component, node: Component) -> int:
    """The longest time from SC's begin to a later node's end, both released at the same instant.

    In between, the thread may wait for one of their releases, no earlier than this instant.
    """
    worst, instant, between = 0, -1, list[ThreadRelease]()
    for t in releases:
        if t.who.index == sc.index:
            instant, between = t.release, [t]
        elif t.release == instant and between:
            between.append(t)
        if t.who.index == node.index and t.release == instant and between:
            for i, first in enumerate(between):
                waits = 0 if i == 0 else first.who.jitter_ns
                worst = max(worst, waits + sum(x.who.wcet_ns or 0 for x in between[i:]))
    return worst
