"""Ages, delays and waiting of a module, derived again from the definitions alone.

Purpose: `derive` finds A, A_sc, d, j, H*, h_0 and what else the claims count on, by going through
the releases of a hyperperiod, with intervals for lateness, response and latency. `Ways` finds the
sensors of what DM and SC read, and how what SC publishes comes to the plant.
Non-goals: nodes between plant and module (`node_paths.py`, which answers where there is one that
reads an output or publishes what is read); formulas in closed form, and anything that the prover
computes: this is written from the definitions so that no mistake is made twice.

All times are whole ns. A release k of X is at phase + k period. What is asked is always the worst
schedule: a start is late or not, a publication is seen or not seen where both may be, each
independently of the others: every node runs by itself, its runs neither overlap nor overtake.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import lcm
from typing import TYPE_CHECKING

from soter.certificate.report import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.language.model.system import Component, Module, System


RELEASES_MAX = 200_000
"""The most releases that are gone through; beyond, the times are not rechecked."""


@dataclass(frozen=True)
class Clock:
    """Something periodic: starts `late` after its release at most, publishes `response` later."""

    name: str
    period: int
    phase: int = 0
    late: int = 0
    response: int = 0

    @property
    def slow(self) -> int:
        """The longest time from a release to its publication."""
        return self.late + self.response

    def next_release(self, time: int) -> int:
        """The first release at or after a time; there is none before the first one."""
        return max(self.phase, time + (self.phase - time) % self.period)

    def last_release(self, time: int) -> int:
        """The last release at or before a time, releases before the first one included."""
        return time - (time - self.phase) % self.period

    def times_in(self, start: int, end: int, phase: int) -> range:
        """The times in [start, end) at which something of that phase occurs."""
        return range(start + (phase - start) % self.period, end, self.period)


NOW = Clock("now", 1)
"""What shows the state of the very instant in which it is read."""


@dataclass(frozen=True)
class TopicPath:
    """The way of a topic from a sensor straight to the module (else `node_paths.py`)."""

    sensor: Clock

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The sensor, and what follows it."""
        return (self.sensor,)

    def oldest_stamp(self, time: int) -> int:
        """The oldest stamp that a read at this time may show, long after the start.

        A sensor publishes at its release and first of all: what it publishes at `time` is seen.
        """
        return self.sensor.last_release(time)

    def oldest_state(self, time: int) -> int:
        """The oldest state time that a read at this time may show, long after the start."""
        return self.oldest_stamp(time)

    def age_peaks(self, start: int, end: int) -> Iterator[int]:
        """The times in [start, end] at which the age of a read is greatest: before it falls."""
        yield from self.sensor.times_in(start, end, self.sensor.phase - 1)
        yield end

    def longest_lag(self, silent: int) -> int:
        """P: from the state to its publication, at most, where the sensor may be `silent`."""
        del silent  # it publishes nothing, and its stamp gets older
        return 0

    def certain_since(self, silent: int = 0) -> int:
        """The first time at which a read certainly shows a state, `silent` added by the sensor."""
        return self.sensor.phase + silent

    def may_publish_nothing(self, silent: int = 0) -> bool:
        """Whether a fresh publication may show the default of a topic before: no state at all."""
        del silent
        return False


@dataclass(frozen=True)
class Effect:
    """The delay of an output of the module: it acts `least` to `most` after it is published."""

    least: int = 0
    most: int = 0

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The nodes on the way."""
        return ()

    def earliest(self, published: int) -> int:
        """The earliest time at which what is published then may act."""
        return published + self.least

    def latest(self, published: int, *, at_once: bool) -> int:
        """The latest time at which it may act. `at_once`: a node that starts then sees it."""
        del at_once
        return published + self.most


@dataclass(frozen=True)
class TopicReading:
    """A topic that DM or SC reads: all ways from a sensor to it, and its `max_age`."""

    name: str
    paths: tuple[TopicPath, ...]
    max_age: int


@dataclass(frozen=True)
class TimingSetting:
    """The facts on which a module's times depend. `silent`: the drop-out that is allowed for."""

    dm: Clock
    sc: Clock
    by_dm: tuple[TopicReading, ...]
    by_sc: tuple[TopicReading, ...]
    effects: tuple[Effect, ...] = (Effect(),)
    silent: int = 0
    instants: bool = False
    """A map: DM, SC and plant act in one instant, and what is read then has age 0."""

    @cached_property
    def periods(self) -> tuple[int, ...]:
        """The periods of everything that SC has to do with."""
        ways: list[TopicPath | Effect] = [*self.effects]
        ways += [path for read in self.by_sc for path in read.paths]
        clocks = [self.dm, self.sc, *(c for way in ways for c in way.clocks)]
        return tuple(c.period for c in clocks)

    # ------------------------------------------------------------ SC

    def starts_by(self, release: int) -> int:
        """The latest start of SC: late, or waiting for every DM due at or before its release.

        Verdicts of earlier DMs are in force before the next one is due.
        """
        due = self.dm.last_release(release)
        waited = due + self.dm.slow if due >= self.dm.phase else release
        return max(release + self.sc.late, waited)

    def acts_by(self, release: int) -> int:
        """The latest instant at which every component of this output acts."""
        return self.last_effect(release, self.starts_by(release))

    def last_effect(self, release: int, start: int) -> int:
        """The latest instant at which an output acts, of a step that starts at `start`.

        In the instant of its release SC comes before other nodes. Late, it is taken to be in no
        order with them: what it publishes in an instant may be missed by a step of that instant.
        """
        published = start + self.sc.response
        return max(e.latest(published, at_once=published == release) for e in self.effects)

    def steady_releases(self) -> Iterator[int]:
        """Releases of SC over a hyperperiod, after everything has started."""
        return releases(self.sc, self.periods, after=self.settled)

    @cached_property
    def clocks(self) -> list[Clock]:
        """Every clock that the times depend on, as often as it is met on a way."""
        ways: list[TopicPath | Effect] = [*self.effects]
        ways += [path for read in (*self.by_sc, *self.by_dm) for path in read.paths]
        return [self.dm, self.sc, *(c for way in ways for c in way.clocks)]

    @cached_property
    def settled(self) -> int:
        """A time from which on every release has its neighbours on both sides."""
        return sum(c.phase + 2 * c.period + c.slow for c in self.clocks)

    def first_available(self, after: int, reads: Sequence[TopicReading]) -> int:
        """SC's first release at or after a time at which these reads certainly show a state."""
        known = [p.certain_since(self.silent) for r in reads for p in r.paths]
        return self.sc.next_release(max([after, *known]))


@dataclass(frozen=True, kw_only=True)
class DerivedTimes:
    """The times A, A_sc, d, j, H*, h_0 (docs/proof.md), in ns: each the greatest of all schedules.

    `start`: h_0 with drop-outs, and with every "AC" that is said on no state at all; `stamps`: the
    greatest stamp age of what SC reads, by topic; `in_force`: how old the state that SC read may be
    at any instant at which the command for it still acts.
    """

    age: int
    age_sc: int
    delay: int
    jitter: int
    h_star: int
    h_0: int
    start: int
    stamps: dict[str, int]
    in_force: int


def releases(of: Clock, periods: Sequence[int], after: int = 0) -> Iterator[int]:
    """The releases in one hyperperiod; NotRecheckedError beyond `RELEASES_MAX`."""
    count = lcm(of.period, *periods) // of.period
    if count > RELEASES_MAX:
        raise NotRecheckedError(f"`{of.name}` meets the others in a new way for {count:,} releases")
    first = of.next_release(after)
    return (first + k * of.period for k in range(count))


def derive(setting: TimingSetting) -> DerivedTimes:
    """Derive all times; `NotRecheckedError` where the definitions do not apply."""
    check_runs(setting)
    age = age_sc = delay = jitter = 0
    stamps: dict[str, int] = {}
    if not setting.instants:
        age = max((_enforced_age(setting, r) for r in setting.by_dm), default=0)
        age_sc, delay, stamps = _answered_ages(setting)
        jitter = _jitter(setting)
    # SC's release whose reads are all there, whatever is late, if the DM never says "AC"
    plain = [p.certain_since() for r in setting.by_sc for p in r.paths]
    h_0 = setting.acts_by(setting.sc.next_release(max([0, *plain])))
    return DerivedTimes(
        age=age,
        age_sc=age_sc,
        delay=delay,
        jitter=jitter,
        h_star=age + _handover_time(setting),
        h_0=h_0,
        start=max(h_0, _time_without_state(setting)),
        stamps=stamps,
        in_force=0 if setting.instants else _age_in_force(setting),
    )


def check_runs(setting: TimingSetting) -> None:
    """Runs of one node neither overlap nor overtake; NotRecheckedError where they may."""
    for c in sorted(setting.clocks, key=lambda c: c.name):
        if c.slow > c.period:
            raise NotRecheckedError(f"a run of `{c.name}` may not be over when the next one is due")
    if setting.sc.period > setting.dm.period:
        raise NotRecheckedError("SC is slower than its DM")
    for t in () if setting.instants else setting.steady_releases():
        if setting.starts_by(t) + setting.sc.response > t + setting.sc.period:
            raise NotRecheckedError("SC may not be done when its next step is due")


def _enforced_age(setting: TimingSetting, read: TopicReading) -> int:
    """The greatest age of a state on which the DM may still say "AC".

    The stamp is no older than `max_age`, and that is enforced; what was published then is as old
    as its path makes it, and as a silent sensor makes what a node goes on publishing.
    """
    return read.max_age + max(path.longest_lag(setting.silent) for path in read.paths)


def _answered_ages(setting: TimingSetting) -> tuple[int, int, dict[str, int]]:
    """Greatest age of a state that SC reads, and how old it is when the command for it acts.

    Both with drop-outs; and greatest age of stamps, without.
    """
    age, delay, stamps = 0, 0, dict.fromkeys((r.name for r in setting.by_sc), 0)
    for t in setting.steady_releases():
        end = setting.starts_by(t)
        delay = max(delay, setting.last_effect(t, end) - end)  # an SC that reads no state
        for name, path in ((r.name, path) for r in setting.by_sc for path in r.paths):
            for s in path.age_peaks(t, end):
                state = path.oldest_state(s) - setting.silent
                age, delay = max(age, s - state), max(delay, setting.last_effect(t, s) - state)
                stamps[name] = max(stamps[name], s - path.oldest_stamp(s))
    return age, delay, stamps


def _age_in_force(setting: TimingSetting) -> int:
    """Greatest age of the state that is answered by a command of SC when the next one replaces it.

    Effects come in order: what was published for one release is gone for good when what was
    published for the next one acts in every component.
    """
    worst = 0
    for t in setting.steady_releases():
        replaced = setting.acts_by(t + setting.sc.period)
        worst = max(worst, replaced - t)  # an SC that reads no state
        for path in (path for read in setting.by_sc for path in read.paths):
            for s in path.age_peaks(t, setting.starts_by(t)):
                worst = max(worst, replaced - path.oldest_state(s) + setting.silent)
    return worst


def _jitter(setting: TimingSetting) -> int:
    """The window around k delta that holds every instant at which output k acts."""
    steady = list(setting.steady_releases())
    early = min(e.earliest(t) - t for e in setting.effects for t in steady)
    return max(setting.acts_by(t) - t for t in steady) - early


def _handover_time(setting: TimingSetting) -> int:
    """From the release of a DM that says "AC", and then not again, to the first output of SC.

    What SC publishes before the next verdict is in force is dropped; an output of a step released
    before that DM may come before it. The first one that certainly passes is that of SC's first
    release at or after it, since this waits. The DM read a state; SC does where it reads the same.
    """
    known = {r.name for r in setting.by_dm}
    others = [r for r in setting.by_sc if r.name not in known]
    count = lcm(*setting.periods) // setting.dm.period
    count += (setting.first_available(0, others) + setting.settled) // setting.dm.period + 1
    if count > 2 * RELEASES_MAX:
        raise NotRecheckedError("the DM has too many releases to go through")
    worst = 0
    for k in range(count):
        t = setting.dm.phase + k * setting.dm.period
        taken = setting.first_available(t + setting.dm.period, others)
        worst = max(worst, setting.acts_by(taken) - t)
    return worst


def _time_without_state(setting: TimingSetting) -> int:
    """The time from which an output of SC acts for good, drop-outs and "AC" on defaults included.

    A node that has read nothing publishes what it makes of a default, with a fresh stamp: the DM
    may say "AC" on it. Its last release that may see this is followed by one that does not.
    """
    start = setting.first_available(0, setting.by_sc)
    for path in (path for read in setting.by_dm for path in read.paths):
        last = path.certain_since(setting.silent) - 1
        if path.may_publish_nothing(setting.silent) and last >= setting.dm.phase:
            after = setting.dm.last_release(last) + setting.dm.period
            start = max(start, setting.first_available(after, setting.by_sc))
    return setting.acts_by(start)


@dataclass
class Ways:
    """The ways between plants and a module, here of one without nodes on them (`node_paths.py`)."""

    system: System
    module: Module
    notes: dict[tuple[str, str], None] = field(default_factory=dict, kw_only=True)
    """The assumptions on nodes on these ways, by kind and name."""
    undeclared: dict[str, None] = field(default_factory=dict, kw_only=True)
    """Nodes on them whose times are not declared."""

    def ways_to(self, index: int) -> tuple[TopicPath, ...]:
        """All ways from a sensor to a topic; `NotRecheckedError` where there is none."""
        paths = self._paths_to(index, ())
        if not paths:
            name = self.system.topics[index].name
            raise NotRecheckedError(f"no plant stands behind `{name}` in `{self.system.name}`")
        return tuple(dict.fromkeys(paths))

    def _paths_to(self, index: int, behind: tuple[int, ...]) -> list[TopicPath]:
        """The ways to a topic; `behind`: the nodes that were followed already, none here."""
        del behind
        return [straight_path(c) for c in self.system.components if index in c.writes]

    def effects(self, least: int, most: int) -> tuple[Effect, ...]:
        """All ways from an output to the plants; NotRecheckedError where one has none."""
        felt = {i for c in self.system.components if c.plant is not None for i in c.reads}
        for index in self.module.outputs:
            if index not in felt:
                name = self.system.topics[index].name
                raise NotRecheckedError(f"no plant feels `{name}` in `{self.system.name}`")
        return (Effect(least, most),)


def straight_path(c: Component) -> TopicPath:
    """The path of a topic that a plant publishes itself."""
    return TopicPath(Clock(c.name, c.period_ns, c.phase_ns))


def nodes_between(system: System, module: Module, topics: Iterable[int]) -> bool:
    """Whether a node publishes one of these topics, or reads what the module publishes.

    What a queue shows a node may be that, too.
    """
    felt = {*module.outputs, *(t.index for t in system.topics if t.queue_of is not None)}
    for c in system.components:
        queues = c.node is not None and any(s.queue is not None for s in c.node.subscribes)
        if c.role == "node" and (queues or felt & {*c.reads}):
            return True
        if c.plant is None and {*c.writes} & {*topics}:
            return True
    return False
