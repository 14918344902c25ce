"""Models when components run, and derives every time that a proof needs.

Purpose: a `Schedule` has the releases, phases, lateness, response and latencies of a module, and
the paths from sensors to it and from it to the plant. From these it derives A, A_sc, d, j, H*, h_0,
R011 and R015, each with its derivation; docs/proof.md, "The model of time", has a table of the
symbols. An exhaustive enumerator that knows the definitions only
(tests/generators/schedule_systems.py) checks that the figures hold and are reached.
Non-goals: where the numbers come from (`problem_times.py`), sets.

Throughout this file g is the gcd of two periods, and o the difference of the phases modulo g. The
differences between releases of the two components are the numbers o + k g, and each occurs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import gcd


@dataclass(frozen=True)
class Releases:
    """A sensor, a node, a DM or an SC, released at phase + k period for all k >= 0; times in ns.

    It starts at most `late` after its release and publishes at most `response` after its start. A
    sensor is never late and shows the state at the instant of its release.
    """

    period: int
    phase: int = 0
    late: int = 0
    response: int = 0

    @property
    def latest(self) -> int:
        """The longest time from a release to its publication."""
        return self.late + self.response

    def first_release_from(self, time: int, *, after: bool = False) -> int:
        """The first release at or after `time`, or with `after` the first later than `time`."""
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
    def last_station(self) -> Releases:
        """The node or sensor that publishes the topic at the end of the path."""
        return self.nodes[-1] if self.nodes else self.sensor

    def state_age(self, reader: Releases, late: int) -> int:
        """The greatest age of the state that a reader sees if it starts up to `late` ns late.

        The bound is summed hop by hop. A node publishes at p what it read at its start s <= p. If
        the reader starts at t, and the node's release is r, then t - state = (t - r) + (r - state).
        Had the node started right at r, it would have read no newer state, so r - state is bounded
        by the age at a start without lateness, and `_longest_hop` bounds t - r.
        """
        stations = (*self.nodes, reader)
        age = (
            _longest_age_of_sample(self.sensor, stations[0], late if not self.nodes else 0)
            + self.dropout
        )
        for sender, receiver in pairwise(stations):
            age += _longest_hop(sender, receiver, late if receiver is reader else 0)
        return age

    @property
    def published_age(self) -> int:
        """P: the greatest age of the published state, from the last node's start; 0 without nodes.

        The stamp shows how long a sensor that is read directly was silent. It does not show the
        silence of a sensor behind a node.
        """
        if not self.nodes:
            return 0
        before = SensorPath(self.sensor, self.nodes[:-1], dropout=self.dropout)
        return (
            before.state_age(self.last_station, self.last_station.late) + self.last_station.response
        )

    def stamp_age(self, reader: Releases, late: int) -> int:
        """The greatest age of the last publication at a reader's start, if no sensor is silent.

        Right behind a sensor this is the age of the state. A node publishes at its release r or
        later, and the reader's start t does not yet see the next publication. So t - r is a bound.
        """
        if not self.nodes:
            return _longest_age_of_sample(self.sensor, reader, late)
        return _longest_hop(self.last_station, reader, late)

    @cached_property
    def available_from(self) -> int:
        """F: the time in ns from which on the topic shows a state and not its default.

        A node that is released before F may still read the default; from F on no node does.
        """
        instant = self.sensor.phase + self.dropout
        for k, node in enumerate(self.nodes):
            instant = node.first_release_from(instant, after=k > 0) + node.latest
        return instant

    @property
    def early_node(self) -> int | None:
        """The number of the first node that may publish before it has read a state, or None."""
        path_to_node = SensorPath(self.sensor)
        for k, node in enumerate(self.nodes):
            seen = path_to_node.available_from
            if node.phase < seen or (k > 0 and node.phase == seen):
                return k
            path_to_node = SensorPath(self.sensor, self.nodes[: k + 1])
        return None


def _longest_age_of_sample(sensor: Releases, reader: Releases, late: int) -> int:
    """The greatest age of a sensor's last publication at a start of the reader.

    In one instant sensors publish first. The reader's release is o, o + g, ..., T - g + o after the
    sensor's last one, where T is the sensor's period; the reader starts up to `late` later.
    """
    g = gcd(sensor.period, reader.period)
    behind = sensor.period - g + (reader.phase - sensor.phase) % g
    return min(behind + late, sensor.period)


def _longest_hop(node: Releases, reader: Releases, late: int) -> int:
    """The longest time from a node's release until a reader starts that sees its publication.

    Let t be the start. The node's release r may still be unseen at t if and only if its publication
    may be at t or later, t - r <= J + R (in one instant either may come first). The oldest
    publication that may be the last one seen is the one before the first such r, of release r - T.
    So the bound is T + the greatest t - r <= J + R, where t - r = o + k g + l, 0 <= l <= late.
    """
    g = gcd(node.period, reader.period)
    over = (node.latest - (reader.phase - node.phase)) % g
    return node.period + node.latest - max(0, over - late)


@dataclass(frozen=True)
class ActuationPath:
    """A path from SC through `nodes` to the plant; the command acts after `least` to `most` ns."""

    least: int = 0
    most: int = 0
    nodes: tuple[Releases, ...] = ()

    def time_to_effect(self, sc: Releases, published: int) -> int:
        """The longest time from SC's release to the effect if SC publishes within `published` ns.

        A node that is released at r <= p may start before a publication at p (in one instant either
        may come first), and then reads it only after its next release. Let the publisher's release
        be at 0, p = l in [0, W], and the node's last release at or before p at p - v. Then v >= (o
        + l) mod g, where o is the difference of phases, and the next release is at p - v + T; l -
        (o + l) mod g = g floor((o + l) / g) - o grows with l.
        """
        before, within, delay = sc, published, 0
        for node in self.nodes:
            g = gcd(before.period, node.period)
            o = (before.phase - node.phase) % g
            delay += node.period - o + g * ((o + within) // g)
            before, within = node, node.latest
        return delay + within + self.most

    def time_from_output(self, late: int) -> int:
        """The longest time to the effect of a publication that comes `late` after some instant."""
        waits = sum(n.period + n.latest for n in self.nodes)
        return late + waits + self.most

    def least_time_to_effect(self, sc: Releases) -> int:
        """The shortest time from a release of SC to the effect of SC's output.

        SC may publish at its release, and the first node may start in the same instant if this is
        in one of the node's windows [r, r + J]. If not, the node starts at its next release.
        """
        if not self.nodes:
            return self.least
        node = self.nodes[0]
        g = gcd(sc.period, node.period)
        ahead = (node.phase - sc.phase) % g
        return self.least + (0 if (-ahead) % g <= node.late else ahead)

    def skipping_node(self, sc: Releases, published: int) -> int | None:
        """The number of the first node that may skip an output of SC; None if each output acts.

        Let w be the variation of the time until an output reaches the node. Two outputs reach it at
        least delta - w apart, and its starts are at most T + J apart. If T + J <= delta - w, it
        reads each output before the next one comes.
        """
        for k, node in enumerate(self.nodes):
            part = ActuationPath(nodes=self.nodes[:k])
            varies = part.time_to_effect(sc, published) - part.least_time_to_effect(sc)
            if node.period + node.late > sc.period - varies:
                return k
        return None


@dataclass(frozen=True)
class Schedule:
    """The schedule of one module between sensors and plant; every derived time is in ns."""

    dm: Releases
    sc: Releases
    read_by_dm: tuple[SensorPath, ...]
    read_by_sc: tuple[SensorPath, ...]
    outputs: tuple[ActuationPath, ...] = (ActuationPath(),)
    dropout: int = 0
    """How many ns longer than its period a sensor that SC reads may be silent."""

    @cached_property
    def age_dm(self) -> int:
        """A, the greatest age of the state that the DM sees when it decides for AC.

        With a `max_age` the time between publication and start is at most that, as an older stamp
        is stale; P may have passed before the publication. Otherwise the periods bound the age.
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
        """A_sc, the greatest age of the state that SC sees. For SC nothing enforces `max_age`."""
        ages = []
        for path in self._with_dropout(self.read_by_sc):
            by_periods = path.state_age(self.sc, self.latest_start_of_sc)
            stamped = 0
            if path.max_age is not None:
                silent = path.dropout if not path.nodes else 0
                stamped = path.max_age + silent + path.published_age
            ages.append(max(by_periods, stamped) if path.max_age is not None else by_periods)
        return max(ages, default=0)

    def _with_dropout(self, paths: tuple[SensorPath, ...]) -> tuple[SensorPath, ...]:
        return tuple(replace(p, dropout=p.dropout or self.dropout) for p in paths)

    def stamp_age_sc(self, path: SensorPath) -> int:
        """How old the stamp of a topic may be at a start of SC if no sensor is silent (R011)."""
        return path.stamp_age(self.sc, self.latest_start_of_sc)

    @cached_property
    def shortest_to_sc(self) -> int:
        """r: the shortest time from a release of the DM to a release of SC at or after it."""
        return (self.sc.phase - self.dm.phase) % gcd(self.dm.period, self.sc.period)

    @cached_property
    def longest_to_sc(self) -> int:
        """G: the longest time from a release of the DM to the next release of SC at or after it."""
        return self.sc.period - gcd(self.dm.period, self.sc.period) + self.shortest_to_sc

    @cached_property
    def latest_start_of_sc(self) -> int:
        """The longest time from SC's release to its start: SC is late, or waits for the DM.

        The DM's verdict is there J_dm + R_dm after a release that is at least r before SC's.
        """
        return max(self.sc.late, self.dm.latest - self.shortest_to_sc)

    @cached_property
    def latest_output(self) -> int:
        """The longest time from a release of SC to its publication."""
        return self.latest_start_of_sc + self.sc.response

    @cached_property
    def replaced_window(self) -> int:
        """The window W; a command replaced more than W before a release acts on no state read then.

        The state is A old at most, and a command acts up to L after the next one was published. Of
        the next one only the release is known. It was published before SC's next step began, as one
        thread runs instants in order. A node that runs behind SC in its instant may pass it on only
        when that step of SC has published.
        """
        untold = self.sc.period + self.latest_start_of_sc + self.sc.response
        return self.age_dm + max(o.most for o in self.outputs) + untold

    @cached_property
    def h_star(self) -> int:
        """H*: the longest time from the state of the last "AC" verdict to SC's first effect.

        The last "AC" verdict is of release t_0, on a state of t_0 - A or later. The next verdict is
        not "AC", and it is in force by t_1 + J_dm + R_dm, where t_1 = t_0 + Delta. SC's first
        release from t_1 on is at t_1 + o, o <= G. SC starts by o + J_sc, or when the verdict is
        there. R_sc later it has published; a publication before the verdict is dropped.
        """
        ready = self.longest_to_sc + self.sc.late + self.sc.response
        waited = self.dm.latest + self.sc.response
        if not any(o.nodes for o in self.outputs):
            acts = max(ready, waited) + max(o.most for o in self.outputs)
        else:
            from_start = self.sc.late + self.sc.response
            in_time = self.longest_to_sc + max(
                o.time_to_effect(self.sc, from_start) for o in self.outputs
            )
            acts = max(in_time, *(o.time_from_output(waited) for o in self.outputs))
        return self.age_dm + self.dm.period + acts

    @cached_property
    def delay(self) -> int:
        """d, the greatest age of the state that a command answers when the command begins to act.

        The state is A_sc old when SC starts and reads it; then the command goes to the plant.
        """
        if not any(o.nodes for o in self.outputs):
            return self.age_sc + self.sc.response + max(o.most for o in self.outputs)
        return self.age_sc + max(o.time_from_output(self.sc.response) for o in self.outputs)

    @cached_property
    def jitter(self) -> int:
        """j, the length of the window in which the effect of SC's k-th output begins, for any k."""
        latest = max(o.time_to_effect(self.sc, self.latest_output) for o in self.outputs)
        return latest - min(o.least_time_to_effect(self.sc) for o in self.outputs)

    @cached_property
    def are_windows_short(self) -> bool:
        """Whether the window of each output is at most half of SC's period long."""
        return 2 * self.jitter <= self.sc.period

    @cached_property
    def read_age(self) -> int:
        """D, the greatest age of the state that SC read for the command that acts at an instant.

        SC read a state for output k at its release - A_sc or later. Outputs act in order, so output
        k acts until output k + 1 does: at most delta plus the latest effect after its release.
        """
        latest = max(o.time_to_effect(self.sc, self.latest_output) for o in self.outputs)
        return self.age_sc + self.sc.period + latest

    @cached_property
    def lease(self) -> int:
        """The longest time from a release of SC to the end of the lease given by its step.

        The lease ends when the next output is due. The step of that output is released delta later,
        and it publishes at most Lambda + R_sc after its release, where Lambda bounds SC's start.
        """
        return self.sc.period + self.latest_output

    @cached_property
    def start(self) -> int:
        """h_0: the time by which a first command of SC acts for which SC read states, no defaults.

        It is the output of SC's first release at which all topics show a state. SC then starts J_sc
        late, or when the last DM that was released by then has given its verdict.
        """
        first = self.sc.phase
        for path in self._with_dropout(self.read_by_sc):
            behind = bool(path.nodes)
            first = max(first, self.sc.first_release_from(path.available_from, after=behind))
        starts = self.sc.late
        if self.dm.phase <= first:
            last = first - (first - self.dm.phase) % self.dm.period
            starts = max(starts, last + self.dm.latest - first)
        published = starts + self.sc.response
        return first + max(o.time_to_effect(self.sc, published) for o in self.outputs)

    @cached_property
    def steps_that_read_defaults(self) -> int:
        """The largest number of SC's steps that may read a topic's default value."""
        steps = 0
        for path in self._with_dropout(self.read_by_sc):
            first = self.sc.first_release_from(path.available_from, after=bool(path.nodes))
            steps = max(steps, (first - self.sc.phase) // self.sc.period)
        return steps

    @cached_property
    def least_horizon(self) -> int:
        """The least H, which is H*, or also h_0 if SC reads topics that the DM does not.

        An "AC" verdict shows that the DM's topics have a state. SC's other topics have one by h_0.
        """
        return max(self.h_star, self.start) if self.sc_reads_more else self.h_star

    @property
    def sc_reads_more(self) -> bool:
        """Whether SC reads a topic that the DM does not read, or reads a topic by another path."""
        known = {(p.topic, p.sensor, p.nodes) for p in self.read_by_dm}
        return any((p.topic, p.sensor, p.nodes) not in known for p in self.read_by_sc)

    @cached_property
    def longest_between_states(self) -> int:
        """The longest time from the state behind one verdict to the state behind the next.

        The first state is at most A older than a start of the DM at t_0 or later. The second state
        is no newer than the DM's next start, which comes by t_0 + Delta + J_dm.
        """
        return self.age_dm + self.dm.period + self.dm.late

    @cached_property
    def longest_to_decision(self) -> int:
        """The longest time from an instant until a verdict is in force on a state of then or later.

        The verdict before is on an older state, so it was released less than A after the instant.
        """
        return self.longest_between_states + self.dm.response
