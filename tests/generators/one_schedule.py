"""One schedule of a system, run from the beginning of time the plain way.

Purpose: keep the enumeration honest. Everybody's releases are drawn and run in order of time, what
is read is looked up in what was published, and the quantities are measured on that run: none may
be greater than the enumeration's (which must not miss schedules), and on small systems some run
must get there (it must not invent any).
Non-goals: finding the worst.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

from generators.every_schedule import Step

if TYPE_CHECKING:
    import random

    from soter.verify.problem.schedule import ActuationPath, Releases, Schedule, SensorPath


class Value(NamedTuple):
    """What was published: when, and the instant of the state behind it; None: a default."""

    published: int
    state: int | None
    seen_then: Literal["always", "by nodes", "perhaps"]
    """Whether a read at the very instant of the publication finds it."""


BEYOND = 60
"""DM and SC stop that much earlier: what they read and what they cause goes on."""

NOTHING = Value(-1, None, "always")


@dataclass
class OneSchedule:
    """A run of a system until a given instant, with choices drawn by `draw`."""

    system: Schedule
    draw: random.Random
    until: int
    found: dict[str, int] = field(default_factory=dict)

    def run(self) -> dict[str, int]:
        """The largest value of each quantity in this run; ages of DM as if nothing was enforced."""
        self.dm = self.steps(self.system.dm, self.until)
        self.sc = [self.wait_for_verdicts(step) for step in self.steps(self.system.sc, self.until)]
        self.judge_dm([self.topic(p) for p in self.system.read_by_dm])
        self.judge_sc([self.topic(p) for p in self.system.read_by_sc])
        return self.found

    def note(self, quantity: str, value: int) -> None:
        self.found[quantity] = max(value, self.found.get(quantity, value))

    def steps(self, x: Releases, until: int) -> list[Step]:
        """One node's releases: each of them as early, as late or as it happens, in phases."""
        drawn = []
        mood = "any"
        for release in range(x.phase, until, x.period):
            if self.draw.random() < 0.2:
                mood = self.draw.choice(("any", "early", "late", "quick", "slow"))
            late = self.draw.randint(0, x.late)
            response = self.draw.randint(0, x.response)
            late = {"early": 0, "quick": x.late, "late": x.late}.get(mood, late)
            response = {"early": 0, "quick": 0, "late": x.response, "slow": x.response}.get(
                mood, response
            )
            drawn.append(Step(release, release + late, release + late + response))
        return drawn

    def wait_for_verdicts(self, step: Step) -> Step:
        """SC starts when it is ready and all verdicts due by then are in force."""
        verdicts = [d.published for d in self.dm if d.release <= step.release]
        wait = max([0, *(v - step.start for v in verdicts)])
        return Step(step.release, step.start + wait, step.published + wait)

    def topic(self, path: SensorPath) -> list[Value]:
        """What is published at the end of a path."""
        sensor, last = path.sensor, path.sensor.phase - path.sensor.period
        topic = []
        for at in range(sensor.phase, self.until + BEYOND, sensor.period):
            if at - last > self.system.dropout or self.draw.random() < 0.5:
                topic.append(Value(at, at, "always"))
                last = at
        for node in path.nodes:
            following = []
            for step in self.steps(node, self.until + BEYOND):
                state = self.read(topic, step.start, by_module=False).state
                at_once = step.start == step.published
                seen: Literal["by nodes", "perhaps"] = "by nodes" if at_once else "perhaps"
                following.append(Value(step.published, state, seen))
            topic = following
        return topic

    def read(self, topic: list[Value], at: int, *, by_module: bool) -> Value:
        """The last value before an instant, or one of that instant if the order is such."""
        now = self.draw.random() < 0.5
        latest_value = NOTHING
        for value in topic:
            then = value.seen_then == "always" or (
                now and not (by_module and value.seen_then == "by nodes")
            )
            if value.published < at or (value.published == at and then):
                latest_value = value
        return latest_value

    def judge_dm(self, topics: list[list[Value]]) -> None:
        """A, T_dec, and how far the next look may be ahead."""
        before = None
        for step in self.dm:
            reads = [self.read(t, step.start, by_module=True) for t in topics]
            for read in reads:
                if read.state is not None:
                    self.note("age_dm", step.start - read.state)
            states = [r.state for r in reads if r.state is not None]
            if len(states) < len(reads):
                continue
            oldest = min(states)
            if before is not None:
                self.note("longest_between_states", oldest - before)
                if oldest > before:
                    self.note("longest_to_decision", step.published - (before + 1))
            before = oldest

    def judge_sc(self, topics: list[list[Value]]) -> None:
        """Ages that SC reads, its starts, and when what it publishes acts."""
        acts = [self.acts(o) for o in self.system.outputs]
        answered = False
        for k, step in enumerate(self.sc):
            self.note("latest_start_of_sc", step.start - step.release)
            reads = [self.read(t, step.start, by_module=True) for t in topics]
            done = [a[k] for a in acts]
            for read in reads:
                if read.state is None:
                    continue
                if not self.system.dropout:
                    self.note("age_sc", step.start - read.state)
                    self.note("stamp_age_sc", step.start - read.published)
                for own, _ in done:
                    if own is not None:
                        self.note("delay", own - read.state)
            for own, _ in done:
                if own is not None:
                    self.note("first", step.release - own)
                    self.note("last", own - step.release)
            everything = all(r.state is not None for r in reads)
            acted = [by for _, by in done if by is not None]
            if everything and not answered and len(acted) == len(done):
                self.note("start", max(acted))
                answered = True
        self.note("jitter", self.found["first"] + self.found["last"])
        self.judge_switches(acts)

    def judge_switches(self, acts: list[list[tuple[int | None, int | None]]]) -> None:
        """From each step of DM on, as if it said AC and none after it: until SC has acted."""
        for ac, no in pairwise(self.dm):
            if no.release > self.until // 2:
                return
            k = next(k for k, step in enumerate(self.sc) if step.published >= no.published)
            acted = [a[k][1] for a in acts]
            self.note("switch", max(a for a in acted if a is not None) - ac.start)

    def acts(self, output: ActuationPath) -> list[tuple[int | None, int | None]]:
        """When each publication of SC acts (None: a later one did), and when it or a later one."""
        held = [Value(s.published, k, "perhaps") for k, s in enumerate(self.sc)]
        for node in output.nodes:
            following = []
            for step in self.steps(node, self.until + BEYOND):
                state = self.read(held, step.start, by_module=False).state
                following.append(Value(step.published, state, "perhaps"))
            held = following
        acted: dict[int, int] = {}
        last = 0
        for value in held:
            if value.state is not None and value.state not in acted:
                latency = self.draw.choice((output.least, output.most))
                last = max(last, value.published + latency)
                acted[value.state] = last
        return [
            (acted.get(k), min((a for n, a in acted.items() if n >= k), default=None))
            for k in range(len(self.sc))
        ]
