"""The model of time: who runs when, and every time that a proof needs, derived from it.

Purpose: a `Schedule` has the releases, phases, lateness, response and latencies of a module, and
the paths from sensors to it and from it to the plant. From these it derives A, A_sc, d, j, H*, h_0,
R011 and R015, each with its derivation; docs/proof.md, "The model of time", has a table of the
symbols. An exhaustive enumerator that knows the definitions only
(tests/generators/schedule_systems.py) checks that the figures hold and are reached.
Non-goals: where the numbers come from (`problem_times.py`), sets.

Throughout, g is the gcd of two periods: the differences between releases of one and of the other
are the numbers o + k g, o the difference of the phases modulo g, and each of them occurs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import gcd


@dataclass(frozen=True)
class Releases:
    """A sensor, a node, a DM or an SC: released at phase + k period; all in ns.

    It starts at most `late` after its release and publishes at most `response` after its start.
    A sensor is never late and shows its own instant.
    """

    period: int
    phase: int = 0
    late: int = 0
    response: int = 0

    @property
    def latest(self) -> int:
        """The longest time from a release to its publication."""
        return self.late + self.response

    def first_from(self, time: int, *, after: bool = False) -> int:
        """The first release at `time` or later; `after`: later."""
        ahead = time + 1 - self.phase if after else time - self.phase
        return self.phase + self.period * max(0, -(-ahead // self.period))


@dataclass(frozen=True)
class SensorPath:
    """A path from a sensor through nodes to a topic that the module reads."""

    sensor: Releases
    nodes: tuple[Releases, ...] = ()
    max_age: int | None = None
    """The topic's bound in ns on the time since its last publication (its *stamp age*)."""
    dropout: int = 0
    """How many ns longer than its period the sensor may be silent."""
    topic: str = ""
    publisher: str = ""

    @property
    def last(self) -> Releases:
        """The node or sensor that publishes the topic."""
        return self.nodes[-1] if self.nodes else self.sensor

    def state_age(self, reader: Releases, late: int) -> int:
        """How old the state is that a reader sees which starts up to `late` after its release.

        Hop by hop. What a node publishes at p it read at its start s <= p; if the reader starts at
        t, then t - state = (t - r) + (r - state), r the release of that node. Had it started right
        at r, what it read would have been no newer, so r - state is bounded by the age at a start
        without lateness, and `_hop` bounds t - r.
        """
        stations = (*self.nodes, reader)
        age = _sampled(self.sensor, stations[0], late if not self.nodes else 0) + self.dropout
        for here, there in pairwise(stations):
            age += _hop(here, there, late if there is reader else 0)
        return age

    @property
    def published_age(self) -> int:
        """P: how old the state is that is published: age at the start of the last node, and more.

        A drop-out of a sensor that is read directly shows in the stamp, behind a node it does not.
        """
        if not self.nodes:
            return 0
        before = SensorPath(self.sensor, self.nodes[:-1], dropout=self.dropout)
        return before.state_age(self.last, self.last.late) + self.last.response

    def stamp_age(self, reader: Releases, late: int) -> int:
        """How old the last publication is when the reader starts; no drop-outs.

        Behind a sensor this is the state's age. Behind a node: the publication that is read, of
        release r, is at r or later; the next one is not yet seen. So t - r bounds it.
        """
        if not self.nodes:
            return _sampled(self.sensor, reader, late)
        return _hop(self.last, reader, late)

    @cached_property
    def available(self) -> int:
        """F: from then on the topic shows a state.

        A node that starts right at a release before that may read the default; at the first
        release from then on it does not.
        """
        instant = self.sensor.phase + self.dropout
        for k, node in enumerate(self.nodes):
            instant = node.first_from(instant, after=k > 0) + node.latest
        return instant

    @property
    def speaks_early(self) -> int | None:
        """The first node that may publish before it has read a state; None: none does."""
        whole = SensorPath(self.sensor)
        for k, node in enumerate(self.nodes):
            seen = whole.available
            if node.phase < seen or (k > 0 and node.phase == seen):
                return k
            whole = SensorPath(self.sensor, self.nodes[: k + 1])
        return None


def _sampled(sensor: Releases, reader: Releases, late: int) -> int:
    """Age of a sensor's last publication at a start: sensors come first in an instant.

    A release of the reader is o, o + g, ..., T - g + o after the last of the sensor, and a start up
    to `late` more; T after it the next has come.
    """
    g = gcd(sensor.period, reader.period)
    behind = sensor.period - g + (reader.phase - sensor.phase) % g
    return min(behind + late, sensor.period)


def _hop(node: Releases, reader: Releases, late: int) -> int:
    """The longest time from the release of the node that published to the start that reads.

    Let t be the start. Release r of the node may still be unseen at t iff its publication may be at
    t or later, t - r <= J + R (in one instant either may come first). The oldest publication
    that may be the last one seen is the one before the first such r, of release r - T. So the
    bound is T + the greatest t - r <= J + R, where t - r = o + k g + l with 0 <= l <= late.
    """
    g = gcd(node.period, reader.period)
    over = (node.latest - (reader.phase - node.phase)) % g
    return node.period + node.latest - max(0, over - late)


@dataclass(frozen=True)
class ActuationPath:
    """A path from SC to the plant: `nodes`, then between `least` and `most` ns until it acts."""

    least: int = 0
    most: int = 0
    nodes: tuple[Releases, ...] = ()

    def acts(self, sc: Releases, published: int) -> int:
        """The longest time from SC's release to the effect, if published up to `published` later.

        A node that is released at r <= p may start then, and in one instant either may come first,
        so what is published at p may be read as late as the next release's start. Let the release
        of who publishes be at 0, p = l in [0, W], the last release of the node at or before p at
        p - v: then v = (o + l) mod g at least, o the difference of phases, and the next release
        is at p - v + T; l - (o + l) mod g = g floor((o + l) / g) - o grows with l.
        """
        before, within, delay = sc, published, 0
        for node in self.nodes:
            g = gcd(before.period, node.period)
            o = (before.phase - node.phase) % g
            delay += node.period - o + g * ((o + within) // g)
            before, within = node, node.latest
        return delay + within + self.most

    def acts_after(self, late: int) -> int:
        """The longest time from any instant of publication to its effect, whatever the phases."""
        waits = sum(n.period + n.latest for n in self.nodes)
        return late + waits + self.most

    def earliest(self, sc: Releases) -> int:
        """The shortest time from a release of SC to its output's effect.

        Published at the release itself; a node starts there or later: at 0 if some window
        [r, r + J] of its holds it, else at the next release, (phase difference) mod g later.
        """
        if not self.nodes:
            return self.least
        node = self.nodes[0]
        g = gcd(sc.period, node.period)
        ahead = (node.phase - sc.phase) % g
        return self.least + (0 if (-ahead) % g <= node.late else ahead)

    def loses(self, sc: Releases, published: int) -> int | None:
        """The first node that may skip an output of SC; None: each output acts.

        Publications of two outputs are at least delta - w apart, w how much they vary; starts of
        a node at most T + J. No output is overwritten before it is read if T + J <= delta - w.
        """
        for k, node in enumerate(self.nodes):
            part = ActuationPath(nodes=self.nodes[:k])
            varies = part.acts(sc, published) - part.earliest(sc)
            if node.period + node.late > sc.period - varies:
                return k
        return None


@dataclass(frozen=True)
class Schedule:
    """One module between its sensors and its plant; every derived time is in ns."""

    dm: Releases
    sc: Releases
    read_by_dm: tuple[SensorPath, ...]
    read_by_sc: tuple[SensorPath, ...]
    outputs: tuple[ActuationPath, ...] = (ActuationPath(),)
    dropout: int = 0
    """How many ns longer than its period a sensor that SC reads may be silent."""

    # ------------------------------------------------------------ ages

    @cached_property
    def age_dm(self) -> int:
        """A: the greatest age of the state that the DM sees when it says "AC".

        A stamp older than `max_age` is stale: that much between publication and start is enforced,
        and P may have gone by before. Without a `max_age`, what the periods make of it.
        """
        ages = []
        for path in self._with_dropout(self.read_by_dm):
            if path.max_age is None:
                ages.append(path.state_age(self.dm, self.dm.late))
            else:
                ages.append(path.max_age + path.published_age)
        return max(ages, default=0)

    @cached_property
    def age_sc(self) -> int:
        """A_sc: the greatest age of the state that SC sees; `max_age` must hold by itself."""
        ages = []
        for path in self._with_dropout(self.read_by_sc):
            by_periods = path.state_age(self.sc, self.start_of_sc)
            stamped = 0
            if path.max_age is not None:
                silent = path.dropout if not path.nodes else 0
                stamped = path.max_age + silent + path.published_age
            ages.append(max(by_periods, stamped) if path.max_age is not None else by_periods)
        return max(ages, default=0)

    def _with_dropout(self, paths: tuple[SensorPath, ...]) -> tuple[SensorPath, ...]:
        return tuple(replace(p, dropout=p.dropout or self.dropout) for p in paths)

    def stamp_age_sc(self, path: SensorPath) -> int:
        """R011: how old the stamp of a topic may be at a start of SC, no drop-outs."""
        return path.stamp_age(self.sc, self.start_of_sc)

    # ------------------------------------------------------------ waiting

    @cached_property
    def nearest(self) -> int:
        """r: from a release of the DM to one of SC at or after it, at least."""
        return (self.sc.phase - self.dm.phase) % gcd(self.dm.period, self.sc.period)

    @cached_property
    def farthest(self) -> int:
        """G: from a release of the DM to the next of SC at or after it, at most."""
        return self.sc.period - gcd(self.dm.period, self.sc.period) + self.nearest

    @cached_property
    def start_of_sc(self) -> int:
        """The longest time from SC's release to its start: it is late, or waits for the DM.

        The verdict of the DM released r before or more is there J_dm + R_dm after that release.
        """
        return max(self.sc.late, self.dm.latest - self.nearest)

    @cached_property
    def published(self) -> int:
        """The longest time from a release of SC to its publication."""
        return self.start_of_sc + self.sc.response

    # ------------------------------------------------------------ what may still act

    @cached_property
    def acted(self) -> int:
        """W: a command that was replaced longer before a release acts on no state read there.

        The state is A old at most, and a command acts up to L after the next one was published.
        When that was is known by its release alone: it may have been published later, but before
        the next step of SC began, as one thread runs instants in order. A node behind the module
        that runs in SC's instant may pass it on only when that step of SC has published.
        """
        untold = self.sc.period + self.start_of_sc + self.sc.response
        return self.age_dm + max(o.most for o in self.outputs) + untold

    # ------------------------------------------------------------ from verdict to actuator

    @cached_property
    def h_star(self) -> int:
        """H*: from the state behind the last "AC" verdict to the effect of SC's first output.

        The last "AC" verdict is of release t_0, on a state of t_0 - A or later. The next verdict is
        not "AC" and in force by t_1 + J_dm + R_dm, t_1 = t_0 + Delta. The first release of SC from
        t_1 on is at t_1 + o, o <= G; it starts when it is due, o + J_sc, and when the verdict is
        there. R_sc later it has published, and what was published before the verdict is dropped.
        """
        ready = self.farthest + self.sc.late + self.sc.response
        waited = self.dm.latest + self.sc.response
        if not any(o.nodes for o in self.outputs):
            acts = max(ready, waited) + max(o.most for o in self.outputs)
        else:
            from_start = self.sc.late + self.sc.response
            in_time = self.farthest + max(o.acts(self.sc, from_start) for o in self.outputs)
            acts = max(in_time, *(o.acts_after(waited) for o in self.outputs))
        return self.age_dm + self.dm.period + acts

    @cached_property
    def delay(self) -> int:
        """d: how old the state is that a command answers when the command begins to act.

        A_sc at the start, then to the effect: at most the way from a publication at any instant.
        """
        if not any(o.nodes for o in self.outputs):
            return self.age_sc + self.sc.response + max(o.most for o in self.outputs)
        return self.age_sc + max(o.acts_after(self.sc.response) for o in self.outputs)

    @cached_property
    def jitter(self) -> int:
        """j: the effects of SC's k-th output lie in a window of this length, every delta."""
        latest = max(o.acts(self.sc, self.published) for o in self.outputs)
        return latest - min(o.earliest(self.sc) for o in self.outputs)

    @cached_property
    def ordered(self) -> bool:
        """Whether the windows of two outputs of SC do not touch each other's middle."""
        return 2 * self.jitter <= self.sc.period

    @cached_property
    def read_age(self) -> int:
        """D: how old the read may be that is answered by what acts, at any instant.

        Output k was read at its release - A_sc or later. It acts until k + 1 does, as outputs act
        in order: at most delta and the latest effect after that release.
        """
        latest = max(o.acts(self.sc, self.published) for o in self.outputs)
        return self.age_sc + self.sc.period + latest

    # ------------------------------------------------------------ leases

    def due(self, release: int) -> int:
        """The instant by which the output of SC's release at `release` is published.

        It starts J_sc late at most, or with the verdict of the last DM released until then; R_sc
        later it has published. A lease that the step before gave ends here (docs/proof.md, "When
        the trusted part stops").
        """
        starts = release + self.sc.late
        if self.dm.phase <= release:
            last = release - (release - self.dm.phase) % self.dm.period
            starts = max(starts, last + self.dm.latest)
        return starts + self.sc.response

    @cached_property
    def lease(self) -> int:
        """The longest time from a release of SC to the end of the lease that its step gives.

        That is when the next output is due: delta later it is released, and Lambda + R_sc after
        that it is out, as `due` is at most r = `nearest` short of a verdict's worst case.
        """
        return self.sc.period + self.published

    # ------------------------------------------------------------ first reads

    @cached_property
    def start(self) -> int:
        """h_0: by then an output of SC has acted all of whose reads show a state.

        The first release of SC at which everything is available; it starts J_sc late or when the
        DM that is due at or before it has spoken.
        """
        first = self.sc.phase
        for path in self._with_dropout(self.read_by_sc):
            behind = bool(path.nodes)
            first = max(first, self.sc.first_from(path.available, after=behind))
        starts = self.sc.late
        if self.dm.phase <= first:
            last = first - (first - self.dm.phase) % self.dm.period
            starts = max(starts, last + self.dm.latest - first)
        published = starts + self.sc.response
        return first + max(o.acts(self.sc, published) for o in self.outputs)

    @cached_property
    def defaults_read(self) -> int:
        """How many steps of SC may read a default."""
        steps = 0
        for path in self._with_dropout(self.read_by_sc):
            first = self.sc.first_from(path.available, after=bool(path.nodes))
            steps = max(steps, (first - self.sc.phase) // self.sc.period)
        return steps

    @cached_property
    def needed(self) -> int:
        """The least H: H*, and at least h_0 where SC reads what the DM does not.

        An "AC" verdict shows that what the DM reads is there. SC's other topics are by h_0.
        """
        return max(self.h_star, self.start) if self.reads_more else self.h_star

    @property
    def reads_more(self) -> bool:
        """Whether SC reads what the DM does not."""
        known = {(p.topic, p.sensor, p.nodes) for p in self.read_by_dm}
        return any((p.topic, p.sensor, p.nodes) not in known for p in self.read_by_sc)

    # ------------------------------------------------------------ decisions

    @cached_property
    def look(self) -> int:
        """The longest time from the state behind one verdict to the one behind the next.

        The first is at most A older than a start at t_0 or later, the second at most as new as the
        start of the next, t_0 + Delta + J_dm.
        """
        return self.age_dm + self.dm.period + self.dm.late

    @cached_property
    def decision(self) -> int:
        """From an instant to the first verdict in force on a state that is at least as new.

        The verdict before is on an older state, so it was released less than A after the instant.
        """
        return self.look + self.dm.response
