"""Ages, delays and waiting of a module, derived again from the definitions alone.

Purpose: `derive_times` finds A, A_sc, d, j, H*, h_0 and what else the claims count on, by going
through the releases of a hyperperiod, with intervals for lateness, response and latency. `Ways`
finds the sensors of what DM and SC read, and how what SC publishes comes to the plant.
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
    """An activity that starts up to `late` after a release and publishes `response` later (ns)."""

    name: str
    period: int
    phase: int = 0
    late: int = 0
    response: int = 0

    @property
    def max_delay(self) -> int:
        """The longest time from a release to its publication, in ns."""
        return self.late + self.response

    def next_release(self, time: int) -> int:
        """The first release at or after a time; the release at `phase` is the first of all."""
        return max(self.phase, time + (self.phase - time) % self.period)

    def last_release(self, time: int) -> int:
        """The last release at or before a time, as if releases before `phase` existed."""
        return time - (time - self.phase) % self.period

    def times_at_phase(self, start: int, end: int, phase: int) -> range:
        """The times in [start, end) that lie `phase` after the beginning of a period."""
        return range(start + (phase - start) % self.period, end, self.period)


NOW = Clock("now", 1)
"""What shows the state of the very instant in which it is read."""


@dataclass(frozen=True)
class TopicPath:
    """The way of a topic directly from a sensor to the module; `node_paths.py` has longer ways."""

    sensor: Clock

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The clocks of the sensor and of any nodes after it."""
        return (self.sensor,)

    def oldest_stamp(self, time: int) -> int:
        """The oldest stamp, in ns, that a read at this time may show, long after the start.

        A sensor publishes at its release, before anybody reads: a read then sees the new stamp.
        """
        return self.sensor.last_release(time)

    def oldest_state(self, time: int) -> int:
        """The oldest time of a state that a read at this time may show, long after the start."""
        return self.oldest_stamp(time)

    def age_peaks(self, start: int, end: int) -> Iterator[int]:
        """The times in [start, end] at which a read may be oldest: just before its age falls."""
        yield from self.sensor.times_at_phase(start, end, self.sensor.phase - 1)
        yield end

    def longest_lag(self, silent: int) -> int:
        """The longest time from a state to its publication, if sensors are silent for `silent`."""
        del silent  # it publishes nothing, and its stamp gets older
        return 0

    def certain_since(self, silent: int = 0) -> int:
        """The time from which a read surely shows a state, if sensors are silent for `silent`."""
        return self.sensor.phase + silent

    def may_publish_nothing(self, silent: int = 0) -> bool:
        """Whether a new publication may show only a value that a node computes from a default."""
        del silent
        return False


@dataclass(frozen=True)
class Effect:
    """The delay of an output: it acts `least` to `most` after it is published."""

    least: int = 0
    most: int = 0

    @property
    def clocks(self) -> tuple[Clock, ...]:
        """The clocks of the nodes between the output and a plant."""
        return ()

    def earliest_action(self, published: int) -> int:
        """The earliest time at which an output published at `published` may act."""
        return published + self.least

    def latest_action(self, published: int, *, at_once: bool) -> int:
        """The latest time at which the output may act; `at_once`: nodes starting then see it."""
        del at_once
        return published + self.most


@dataclass(frozen=True)
class TopicReading:
    """A topic that DM or SC reads, with all ways from sensors to the topic and its `max_age`."""

    name: str
    paths: tuple[TopicPath, ...]
    max_age: int


@dataclass(frozen=True)
class TimingSetting:
    """The facts that a module's times depend on; `silent` is the longest allowed drop-out."""

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
        """The periods of the DM, of SC, and of every node and sensor on ways to and from SC."""
        ways: list[TopicPath | Effect] = [*self.effects]
        ways += [path for read in self.by_sc for path in read.paths]
        clocks = [self.dm, self.sc, *(c for way in ways for c in way.clocks)]
        return tuple(c.period for c in clocks)

    # ------------------------------------------------------------ SC

    def latest_start(self, release: int) -> int:
        """The latest start of SC at a release: after its lateness and after each DM due by then.

        Verdicts of earlier DMs are in force before the next DM is due.
        """
        due = self.dm.last_release(release)
        waited = due + self.dm.max_delay if due >= self.dm.phase else release
        return max(release + self.sc.late, waited)

    def latest_action(self, release: int) -> int:
        """The latest instant at which all components of the output of this release act."""
        return self.latest_effect(release, self.latest_start(release))

    def latest_effect(self, release: int, start: int) -> int:
        """The latest time at which the output of a step acts, if the step starts at `start`.

        At the instant of its release SC comes before other nodes. A late SC may come after them: a
        node that steps at the instant of publication may miss the output.
        """
        published = start + self.sc.response
        return max(e.latest_action(published, at_once=published == release) for e in self.effects)

    def settled_releases(self) -> Iterator[int]:
        """Yields the releases of SC in a hyperperiod, after all components have started."""
        return releases_in_hyperperiod(self.sc, self.periods, after=self.settled_at)

    @cached_property
    def clocks(self) -> list[Clock]:
        """The clocks that the times depend on; each is listed once for every way that it is on."""
        ways: list[TopicPath | Effect] = [*self.effects]
        ways += [path for read in (*self.by_sc, *self.by_dm) for path in read.paths]
        return [self.dm, self.sc, *(c for way in ways for c in way.clocks)]

    @cached_property
    def settled_at(self) -> int:
        """A time after which every release has a neighbour before and after it."""
        return sum(c.phase + 2 * c.period + c.max_delay for c in self.clocks)

    def release_with_state(self, after: int, reads: Sequence[TopicReading]) -> int:
        """SC's first release, at or after `after`, at which these reads surely show a state."""
        known = [p.certain_since(self.silent) for r in reads for p in r.paths]
        return self.sc.next_release(max([after, *known]))


@dataclass(frozen=True, kw_only=True)
class DerivedTimes:
    """The times A, A_sc, d, j, H*, h_0 (docs/proof.md) in ns, the greatest over all schedules.

    `start`: h_0 with drop-outs, and with every "AC" based on a default; `stamps`: the greatest age
    of a stamp that SC reads, by topic; `in_force`: the greatest age of the state behind a command
    that still acts.
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


def releases_in_hyperperiod(of: Clock, periods: Sequence[int], after: int = 0) -> Iterator[int]:
    """The releases of a clock in one hyperperiod; NotRecheckedError beyond `RELEASES_MAX`."""
    count = lcm(of.period, *periods) // of.period
    if count > RELEASES_MAX:
        raise NotRecheckedError(f"`{of.name}` meets the others in a new way for {count:,} releases")
    first = of.next_release(after)
    return (first + k * of.period for k in range(count))


def derive_times(setting: TimingSetting) -> DerivedTimes:
    """Derives all times. Raises NotRecheckedError if their definitions do not apply."""
    check_runs_do_not_overlap(setting)
    age = age_sc = delay = jitter = 0
    stamps: dict[str, int] = {}
    if not setting.instants:
        age = max((_greatest_age_for_ac(setting, r) for r in setting.by_dm), default=0)
        age_sc, delay, stamps = _greatest_ages_of_sc_reads(setting)
        jitter = _action_window_ns(setting)
    # SC's release whose reads are all there, whatever is late, if the DM never says "AC"
    plain = [p.certain_since() for r in setting.by_sc for p in r.paths]
    h_0 = setting.latest_action(setting.sc.next_release(max([0, *plain])))
    return DerivedTimes(
        age=age,
        age_sc=age_sc,
        delay=delay,
        jitter=jitter,
        h_star=age + _longest_handover_ns(setting),
        h_0=h_0,
        start=max(h_0, _ns_until_outputs_last(setting)),
        stamps=stamps,
        in_force=0 if setting.instants else _greatest_age_in_force(setting),
    )


def check_runs_do_not_overlap(setting: TimingSetting) -> None:
    """Raises NotRecheckedError if runs of the same node may overlap or overtake each other."""
    for c in sorted(setting.clocks, key=lambda c: c.name):
        if c.max_delay > c.period:
            raise NotRecheckedError(f"a run of `{c.name}` may not be over when the next one is due")
    if setting.sc.period > setting.dm.period:
        raise NotRecheckedError("SC is slower than its DM")
    for t in () if setting.instants else setting.settled_releases():
        if setting.latest_start(t) + setting.sc.response > t + setting.sc.period:
            raise NotRecheckedError("SC may not be done when its next step is due")


def _greatest_age_for_ac(setting: TimingSetting, read: TopicReading) -> int:
    """The greatest age of a state on which the DM may still decide "AC".

    The stamp is at most `max_age` old, which is enforced. A state is older than its stamp by the
    time that its path takes, and by what a silent sensor adds.
    """
    return read.max_age + max(path.longest_lag(setting.silent) for path in read.paths)


def _greatest_ages_of_sc_reads(setting: TimingSetting) -> tuple[int, int, dict[str, int]]:
    """Greatest age of a state that SC reads, its age when the command for it acts, ages of stamps.

    Ages of states count drop-outs; those of stamps, by topic, do not.
    """
    age, delay, stamps = 0, 0, dict.fromkeys((r.name for r in setting.by_sc), 0)
    for t in setting.settled_releases():
        end = setting.latest_start(t)
        delay = max(delay, setting.latest_effect(t, end) - end)  # an SC that reads no state
        for name, path in ((r.name, path) for r in setting.by_sc for path in r.paths):
            for s in path.age_peaks(t, end):
                state = path.oldest_state(s) - setting.silent
                age, delay = (max(age, s - state), max(delay, setting.latest_effect(t, s) - state))
                stamps[name] = max(stamps[name], s - path.oldest_stamp(s))
    return age, delay, stamps


def _greatest_age_in_force(setting: TimingSetting) -> int:
    """The greatest age of a state behind a command of SC when the next command replaces it.

    Effects come in order: what SC published at a release no longer acts once the output of the next
    release acts in every component.
    """
    worst = 0
    for t in setting.settled_releases():
        replaced = setting.latest_action(t + setting.sc.period)
        worst = max(worst, replaced - t)  # an SC that reads no state
        for path in (path for read in setting.by_sc for path in read.paths):
            for s in path.age_peaks(t, setting.latest_start(t)):
                worst = max(worst, replaced - path.oldest_state(s) + setting.silent)
    return worst


def _action_window_ns(setting: TimingSetting) -> int:
    """The length of the window in which outputs act; it is at the same place after each release."""
    steady = list(setting.settled_releases())
    early = min(e.earliest_action(t) - t for e in setting.effects for t in steady)
    return max(setting.latest_action(t) - t for t in steady) - early


def _longest_handover_ns(setting: TimingSetting) -> int:
    """The longest time from the release of a DM's last "AC" to the first effective output of SC.

    Output of SC is dropped until the next verdict is in force. The first output that surely passes
    is that of SC's first release at or after the next DM's release, as that step waits for the
    verdict. SC reads a state if the DM has read the same topic.
    """
    known = {r.name for r in setting.by_dm}
    others = [r for r in setting.by_sc if r.name not in known]
    count = lcm(*setting.periods) // setting.dm.period
    count += (setting.release_with_state(0, others) + setting.settled_at) // setting.dm.period + 1
    if count > 2 * RELEASES_MAX:
        raise NotRecheckedError("the DM has too many releases to go through")
    worst = 0
    for k in range(count):
        t = setting.dm.phase + k * setting.dm.period
        taken = setting.release_with_state(t + setting.dm.period, others)
        worst = max(worst, setting.latest_action(taken) - t)
    return worst


def _ns_until_outputs_last(setting: TimingSetting) -> int:
    """The time after which outputs of SC act for good, despite drop-outs and "AC" on defaults.

    A node that has read nothing publishes what it computes from a default, with a new stamp: the DM
    may decide "AC" on it. After its last release that may see this, every release sees a state.
    """
    start = setting.release_with_state(0, setting.by_sc)
    for path in (path for read in setting.by_dm for path in read.paths):
        last = path.certain_since(setting.silent) - 1
        if path.may_publish_nothing(setting.silent) and last >= setting.dm.phase:
            after = setting.dm.last_release(last) + setting.dm.period
            start = max(start, setting.release_with_state(after, setting.by_sc))
    return setting.latest_action(start)


@dataclass
class Ways:
    """The ways between plants and a module without nodes between them (else `node_paths.py`)."""

    system: System
    module: Module
    notes: dict[tuple[str, str], None] = field(default_factory=dict, kw_only=True)
    """The assumptions on nodes on these ways, by kind and name."""
    undeclared: dict[str, None] = field(default_factory=dict, kw_only=True)
    """Nodes on them whose times are not declared."""

    def ways_to(self, index: int) -> tuple[TopicPath, ...]:
        """All ways from sensors to a topic. Raises NotRecheckedError if it has no way."""
        paths = self._paths_to(index, ())
        if not paths:
            name = self.system.topics[index].name
            raise NotRecheckedError(f"no plant stands behind `{name}` in `{self.system.name}`")
        return tuple(dict.fromkeys(paths))

    def _paths_to(self, index: int, behind: tuple[int, ...]) -> list[TopicPath]:
        """The ways to a topic; `behind` lists the nodes that were already followed, none here."""
        del behind
        return [path_of_plant(c) for c in self.system.components if index in c.writes]

    def find_effects(self, least: int, most: int) -> tuple[Effect, ...]:
        """The ways from outputs to plants; raises NotRecheckedError if an output has none."""
        felt = {i for c in self.system.components if c.plant is not None for i in c.reads}
        for index in self.module.outputs:
            if index not in felt:
                name = self.system.topics[index].name
                raise NotRecheckedError(f"no plant feels `{name}` in `{self.system.name}`")
        return (Effect(least, most),)


def path_of_plant(c: Component) -> TopicPath:
    """The path of a topic that this plant publishes."""
    return TopicPath(Clock(c.name, c.period_ns, c.phase_ns))


def has_nodes_between(system: System, module: Module, topics: Iterable[int]) -> bool:
    """Whether a node publishes one of these topics or reads what the module publishes.

    A node with a queue always counts, as the queue may show an output.
    """
    felt = {*module.outputs, *(t.index for t in system.topics if t.queue_of is not None)}
    for c in system.components:
        queues = c.node is not None and any(s.queue is not None for s in c.node.subscribes)
        if c.role == "node" and (queues or felt & {*c.reads}):
            return True
        if c.plant is None and {*c.writes} & {*topics}:
            return True
    return False
