"""Every schedule of a module: DM, SC that waits for it, the gate, and what acts in the end.

Purpose: the quantities of a system, each the largest value that some schedule reaches, from the
definitions and the sets of `every_schedule.py`; see there for how they are enumerated.
Non-goals: making systems and comparing (`schedule_systems.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from math import lcm
from typing import TYPE_CHECKING

from generators.every_schedule import QUANTITIES, Event, Reads, Seen, Step, Worst, releases, steps

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.verify.problem.schedule import ActuationPath, Releases, Schedule

Line = tuple[int, str]


def timeline(at: int, event: Event | None) -> list[Line]:
    """The linked events as instants; `at` is where the last of them leads to."""
    lines = []
    while event is not None:
        at -= event.before
        lines.append((at, event.what))
        event = event.cause
    return lines


@dataclass
class Acts:
    """When one component of what SC publishes acts."""

    output: ActuationPath
    name: str
    multiple: int = 1
    _after: dict[int, tuple[tuple[int, tuple[Line, ...]], ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.multiple = lcm(1, *(n.period for n in self.output.nodes))

    def after(self, published: int) -> list[tuple[int, tuple[Line, ...]]]:
        """All instants at which it can act, each with one timeline of the nodes between."""
        turn = published % self.multiple
        if turn not in self._after:
            lines_by_instant: dict[int, tuple[Line, ...]] = {}
            for at, lines in self._through(0, turn):
                lines_by_instant.setdefault(at, lines)
            self._after[turn] = tuple(lines_by_instant.items())
        by = published - turn
        return [
            (at + by, tuple((x + by, what) for x, what in lines)) for at, lines in self._after[turn]
        ]

    def _through(self, level: int, published: int) -> Iterator[tuple[int, tuple[Line, ...]]]:
        """From a publication after so many nodes on: the first step that finds it, and so on."""
        if level == len(self.output.nodes):
            for latency in range(self.output.least, self.output.most + 1):
                yield published + latency, ()
            return
        node = self.output.nodes[level]
        start_by_instant: dict[int, int] = {}
        for start in finding(node, published):
            for again in range(start, start + node.response + 1):
                start_by_instant.setdefault(again, start)
        name = f"{self.name}: node {level + 1}"
        for again, start in start_by_instant.items():
            own = (start, f"{name} starts"), (again, f"{name} publishes")
            for at, lines in self._through(level + 1, again):
                yield at, (*own, *lines)


def finding(node: Releases, published: int) -> set[int]:
    """When the first step of a node can start that finds a publication.

    A step that starts at that very instant finds it or does not; the step before has not.
    """
    return {
        step.start
        for release in releases(node, published - node.late, published + node.period)
        for step in steps(node, release)
        if step.start >= published
        and any(before.start <= published for before in steps(node, release - node.period))
    }


@dataclass
class EverySchedule:
    """All quantities of one system; `worst` has the largest values and how they come about."""

    system: Schedule
    worst: dict[str, Worst] = field(default_factory=lambda: {q: Worst() for q in QUANTITIES})

    def __post_init__(self) -> None:
        self.dm, self.sc = self.system.dm, self.system.sc
        silence = self.system.dropout
        self.dm_reads = [
            Reads(p, silence, f"DM path {k}") for k, p in enumerate(self.system.read_by_dm, 1)
        ]
        self.sc_reads = [
            Reads(p, silence, f"SC path {k}") for k, p in enumerate(self.system.read_by_sc, 1)
        ]
        self.sc_reads_prompt = [Reads(r.path, 0, r.name) for r in self.sc_reads]
        self.outputs = [Acts(o, f"output {k}") for k, o in enumerate(self.system.outputs, 1)]
        self.thread = lcm(self.dm.period, self.sc.period)
        self.acting = lcm(self.thread, *(o.multiple for o in self.outputs))

    def enumerate(self) -> dict[str, int | None]:
        """The largest value of each quantity; None where nothing can ever be read or act."""
        self.ages_of_dm()
        self.starts_of_sc()
        self.ages_of_sc()
        self.ages_of_sc()
        self.windows_and_delays()
        self.switch_to_sc()
        self.first_act()
        self.publications()
        self.decisions()
        return {q: w.value for q, w in self.worst.items()}

    # what DM and SC read

    def ages_of_dm(self) -> None:
        """A: how old a state is that DM reads and finds fresh; lost publications age it further."""
        for reads in self.dm_reads:
            if reads.path.max_age is not None:
                oldest = reads.age_of_publication() + reads.path.max_age
                if self.worst["age_dm"].below(oldest):
                    self.worst["age_dm"].keep([(0, "DM reads the oldest stamp that is enforced")])
                continue
            for release in releases(self.dm, 0, lcm(self.dm.period, reads.multiple) - 1):
                for start in range(release, release + self.dm.late + 1):
                    for seen in reads.at(start):
                        if self.worst["age_dm"].below(seen.age):
                            run = (release, "DM is due"), (start, f"DM reads age {seen.age}")
                            self.worst["age_dm"].keep([*run, *timeline(start, seen.why)])

    def waits(self, due: int) -> list[tuple[int, tuple[Line, ...]]]:
        """When the last verdict comes of all DM releases up to an instant: SC waits for that.

        Releases two periods back have their verdicts: late + response <= period.
        """
        turns = releases(self.dm, due - 2 * self.dm.period, due)
        each = [[s.published for s in steps(self.dm, r)] for r in turns]
        lines_by_instant: dict[int, tuple[Line, ...]] = {}
        for verdicts in product(*(sorted(set(e)) for e in each)):
            lines = tuple((v, "a verdict is in force") for v in verdicts)
            lines_by_instant.setdefault(max(verdicts, default=due), lines)
        return list(lines_by_instant.items())

    def starts(self, due: int) -> list[tuple[int, tuple[Line, ...]]]:
        """When a release of SC can start."""
        lines_by_instant: dict[int, tuple[Line, ...]] = {}
        for wait, lines in self.waits(due):
            for ready in range(due, due + self.sc.late + 1):
                own = (due, "SC is due"), (ready, "SC is ready")
                lines_by_instant.setdefault(max(ready, wait), (*lines, *own))
        return list(lines_by_instant.items())

    def starts_of_sc(self) -> None:
        """Lambda: how long after its release SC starts at the latest."""
        for due in releases(self.sc, 0, self.thread - 1):
            for start, lines in self.starts(due):
                if self.worst["latest_start_of_sc"].below(start - due):
                    self.worst["latest_start_of_sc"].keep([*lines, (start, "SC starts")])

    def ages_of_sc(self) -> None:
        """A_sc, sensors silent at times, and the age of the stamps that SC reads, never silent."""
        for reads in self.sc_reads:
            for start, lines, seen in self.reads_of_sc(reads):
                if self.worst["age_sc"].below(seen.age):
                    why = [*lines, (start, "SC starts"), *timeline(start, seen.why)]
                    self.worst["age_sc"].keep(why)
        for reads in self.sc_reads_prompt:
            for start, lines, seen in self.reads_of_sc(reads):
                if self.worst["stamp_age_sc"].below(seen.stamp):
                    why = [*lines, (start, "SC starts"), *timeline(start, seen.why)]
                    self.worst["stamp_age_sc"].keep(why)

    def reads_of_sc(self, reads: Reads) -> Iterator[tuple[int, tuple[Line, ...], Seen]]:
        """When SC can start, and what it can read there."""
        for due in releases(self.sc, 0, lcm(self.thread, reads.multiple) - 1):
            for start, lines in self.starts(due):
                for seen in reads.at(start):
                    yield start, lines, seen

    # what SC does

    def windows_and_delays(self) -> None:
        """j: all acting instants after their release; d: from the states read until they act."""
        first, last, delay = Worst(), Worst(), self.worst["delay"]
        for output in self.outputs:
            turns = lcm(self.thread, output.multiple, *(r.multiple for r in self.sc_reads))
            for due in releases(self.sc, 0, turns - 1):
                for start, lines in self.starts(due):
                    acts = self.acts_of_step(output, start)
                    for at, more in acts:
                        if first.below(due - at):
                            first.keep([*lines, *more])
                        if last.below(at - due):
                            last.keep([*lines, *more])
                    at, more = max(acts, key=lambda x: x[0])
                    for reads in self.sc_reads:
                        seen = max(reads.at(start), key=lambda x: x.age)
                        if delay.below(at - start + seen.age):
                            delay.keep([*lines, *more, *timeline(start, seen.why)])
        if first.value is not None and last.value is not None:
            self.worst["jitter"].below(last.value + first.value)
            self.worst["jitter"].keep([*first.why, *last.why])

    def acts_of_step(self, output: Acts, start: int) -> list[tuple[int, tuple[Line, ...]]]:
        """When the output of a step of SC can act that starts there, whenever it publishes."""
        lines_by_instant: dict[int, tuple[Line, ...]] = {}
        for published in range(start, start + self.sc.response + 1):
            own = (start, "SC starts"), (published, "SC publishes")
            for at, lines in output.after(published):
                act = (at, f"{output.name} acts")
                if at not in lines_by_instant:
                    lines_by_instant[at] = (*own, *lines, act)
        return list(lines_by_instant.items())

    def last_act(self, published: int) -> tuple[int, tuple[Line, ...]]:
        """The latest that every component of a publication of SC has acted."""
        every = [
            (at, (*lines, (at, f"{output.name} acts")))
            for output in self.outputs
            for at, lines in output.after(published)
        ]
        return max(every, key=lambda x: x[0])

    def switch_to_sc(self) -> None:
        """H*: DM says AC once more, about a state as old as may be; then SC's first output acts.

        Steps of SC that were due before that step of DM have published by then.
        """
        age = self.worst["age_dm"].value
        if age is None:
            return
        for due in releases(self.dm, 0, self.acting - 1):
            then = due + self.dm.period
            last_no = sorted({s.published for s in steps(self.dm, then)})
            for ac, no in product(steps(self.dm, due), last_no):
                said = (
                    (ac.start, f"DM starts, reads age {age}"),
                    (ac.published, "AC is in force"),
                    (no, "not AC is in force"),
                )
                known = {then: no}
                turns = releases(self.sc, due, then + 2 * (self.dm.period + self.sc.period))
                first = self._first_step(turns, due, ac.published, known, passes_from=no)
                for publication, lines in first:
                    at, acts = self.last_act(publication)
                    if self.worst["h_star"].below(at - ac.start + age):
                        self.worst["h_star"].keep([*said, *lines, *acts])

    def _first_step(
        self,
        turns: range,
        since: int,
        wait: int,
        known: dict[int, int],
        *,
        passes_from: int | None = None,
        reads_from: int | None = None,
    ) -> Iterator[tuple[int, tuple[Line, ...]]]:
        """When the first of these steps of SC publishes that passes the gate, or reads everything.

        All that one step leaves to the next is the instant of the last verdict so far: `wait`, at
        first, of the releases of DM until `since`. `known`: verdicts given, by their release.
        """
        waiting: dict[int, tuple[Line, ...]] = {wait: ()}
        for due in turns:
            lines_by_instant: dict[int, tuple[Line, ...]] = {}
            following: dict[int, tuple[Line, ...]] = {}
            for last, lines in waiting.items():
                for verdict, start, published in self._runs(due, since, last, known):
                    ran = (
                        (verdict, "the last verdict that SC waits for"),
                        (due, "SC is due"),
                        (start, "SC starts"),
                        (published, "SC publishes"),
                    )
                    early = passes_from is not None and published < passes_from
                    blind = reads_from is not None and start < reads_from
                    into, key = (
                        (following, verdict) if early or blind else (lines_by_instant, published)
                    )
                    if key not in into:
                        into[key] = (*lines, *ran)
            yield from lines_by_instant.items()
            if not following:
                return
            waiting, since = following, max(since, due)
        message = "SC never gets to act"
        raise AssertionError(message)

    def _runs(
        self, due: int, since: int, wait: int, known: dict[int, int]
    ) -> set[tuple[int, int, int]]:
        """A step of SC: the last verdict, its start, its publication."""
        verdicts = [
            {known[r]} if r in known else {s.published for s in steps(self.dm, r)}
            for r in releases(self.dm, since + 1, due)
        ]
        return {
            (last, max(ready, last), published)
            for last in {max((wait, *v)) for v in product(*verdicts)}
            for ready in range(due, due + self.sc.late + 1)
            for published in range(max(ready, last), max(ready, last) + self.sc.response + 1)
        }

    # from the beginning of time

    def first_act(self) -> None:
        """h_0: SC's first output that answers states and no defaults has acted; all pass."""
        ready: dict[int, tuple[Line, ...]] = {self.sc.phase: ()}
        for reads in self.sc_reads:
            both: dict[int, tuple[Line, ...]] = {}
            for (at, lines), (other, more) in product(ready.items(), available(reads).items()):
                both.setdefault(max(at, other), (*lines, *more))
            ready = both
        for at, lines in ready.items():
            latest = at + 2 * self.sc.period
            turns = range(self.sc.phase, latest + 1, self.sc.period)
            never = self.dm.phase - 1
            for published, more in self._first_step(turns, never, 0, {}, reads_from=at):
                acted, acts = self.last_act(published)
                if self.worst["start"].below(acted):
                    self.worst["start"].keep([*lines, *more, *acts])

    def publications(self) -> None:
        """P and F: how old a state is when it is published, and when the first one is."""
        for reads in (*self.dm_reads, *self.sc_reads):
            self.worst["published_age"].below(reads.age_of_publication())
            for at, lines in available(reads).items():
                if self.worst["available_from"].below(at - bool(reads.path.nodes)):
                    self.worst["available_from"].keep(list(lines))

    # DM's decisions

    def decisions(self) -> None:
        """T_dec and the look ahead: what two steps of DM in a row read, and when it is in force.

        A decision is about the oldest state that it has read. One that was reached just after the
        state behind the first verdict waits for the second, if that has read a later one.
        """
        turns = lcm(self.dm.period, *(r.multiple for r in self.dm_reads))
        for due in releases(self.dm, 0, turns - 1):
            first = range(due, due + self.dm.late + 1)
            for at, second in product(first, steps(self.dm, due + self.dm.period)):
                both = [
                    [(at - age, at - age + newer) for age, newer in r.pairs(at, second.start)]
                    for r in self.dm_reads
                ]
                for state, newest in oldest_states(both):
                    lines = [
                        (state, "the state behind a verdict"),
                        (at, "DM starts, reads it"),
                        (newest, "the newest state that can be behind the next one"),
                        (second.start, "DM starts, reads that"),
                        (second.published, "the next verdict is in force"),
                    ]
                    if self.worst["longest_between_states"].below(newest - state):
                        self.worst["longest_between_states"].keep(lines)
                    waited = second.published - state - 1
                    if newest > state and self.worst["longest_to_decision"].below(waited):
                        self.worst["longest_to_decision"].keep(lines)


def oldest_states(both: list[list[tuple[int, int]]]) -> Iterator[tuple[int, int]]:
    """What is the oldest of several reads, and the newest that it can be the next time.

    Paths choose for themselves: one of them read the oldest state, the others one at least as new.
    """
    for k, own in enumerate(both):
        others = both[:k] + both[k + 1 :]
        for state in {x for x, _ in own}:
            newest = [max(y for x, y in own if x == state)]
            newest += [max((y for x, y in o if x >= state), default=state - 1) for o in others]
            if min(newest) >= state:
                yield state, min(newest)


def available(reads: Reads) -> dict[int, tuple[Line, ...]]:
    """From when on a read by SC can first find a state at the end of a path, time beginning at 0.

    What has read a default publishes a default.
    """
    sensor, level = reads.path.sensor, len(reads.path.nodes)
    lines_by_instant: dict[int, tuple[Line, ...]] = {
        x: ((x, f"{reads.name}: sensor publishes"),)
        for x in range(sensor.phase, sensor.phase + reads.silence + 1, sensor.period)
    }
    for k, node in enumerate(reads.path.nodes, 1):
        following: dict[int, tuple[Line, ...]] = {}
        for at, lines in lines_by_instant.items():
            for step in first_steps(node, at):
                what = (step.published, f"{reads.name}: node {k} publishes, started {step.start}")
                following.setdefault(step.published + 1, (*lines, what))
                if k < level or step.start < step.published:
                    following.setdefault(step.published, (*lines, what))
        lines_by_instant = following
    return lines_by_instant


def first_steps(node: Releases, at: int) -> set[Step]:
    """The steps of a node that can be the first to start at an instant or later."""
    return {
        step
        for release in range(node.phase, max(node.phase, at) + node.period, node.period)
        if release == node.phase or release - node.period < at
        for step in steps(node, release)
        if step.start >= at
    }
