"""Runs the decision modules of a program on the reads of a log.

Purpose: `replay_log` steps the DMs, and the trusted nodes before them, at their periods, as the
reference interpreter does (`semantics/rules.py`), with topics of a log in place of plants,
controllers and inputs.
Non-goals: SC and AC (somebody else flew), C, what is noted of a step (`module_watch.py`), what a
judgement means (`log_judgement.py`).

A mapped topic is published where its driver stands in the order of an instant: a plant's before the
DMs, a node's after them. A DM, or a node, begins to step when all that reaches it of the log was
published once; all of them go on until the last record of the log, whatever that is of.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.language.evaluate.arithmetic import StepFault
from soter.monitor.decidable_modules import source_topics, topics_of_safe, writes_of_node
from soter.monitor.doubtful_topics import doubt_notes
from soter.monitor.log_files.log_columns import unusable_log_error
from soter.monitor.log_judgement import LogJudgement, ModuleOfLog
from soter.monitor.module_watch import ModuleWatch
from soter.monitor.topics_heard import TopicsHeard
from soter.report.judged_curves import JudgedTimes
from soter.semantics.configuration import NEVER, StepOutcome
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import ac_or_sc_step, dm_step, environment_input

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.model.system import Component, Module, System
    from soter.monitor.decidable_modules import ReplayPlan
    from soter.monitor.typed_samples import TopicSamples
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem

STEPS_MAX = 20_000_000
"""Decisions that are replayed of one log; a thousand take half a second."""


def replay_log(
    system: System,
    samples: list[TopicSamples],
    plan: ReplayPlan,
    log: str,
    progress: Callable[[float], None] | None = None,
) -> LogJudgement:
    """Steps all nodes and DMs of `plan` over the log; `progress` gets the finished share.

    Changes `system`: it no longer forces modes, so that all DMs decide, and no longer declares
    faults, since the log already contains the faults that happened.
    """
    forced = _clear_forced_modes_and_faults(system)
    interpreter = Interpreter(system, 0, _unused_externs(system))
    started = [s for s in samples if not s.is_constant]
    from_ns, (begin_ns, to_ns) = min(s.from_ns for s in started), samples[0].log_ns
    _require_bounded_steps(system, plan, to_ns - from_ns, log)
    judged = _empty_judgement(system, samples, plan, log)
    judged.from_s, judged.to_s, judged.forced = from_ns / 1e9, to_ns / 1e9, forced
    for of_module, m in zip(judged.modules, system.modules, strict=True):
        of_module.waiting = max(0, from_ns - begin_ns) // m.period_ns
    pairs = zip(system.modules, judged.modules, strict=True)
    for of_module in judged.modules:
        of_module.times = JudgedTimes(judged.from_s, judged.to_s)
    watches = {m.index: ModuleWatch(m, of_module) for m, of_module in pairs if of_module.decided}
    world = _LogState(system, interpreter, samples, plan, judged, from_ns)
    world.watches = watches
    for ct in _release_times(system, plan, to_ns - from_ns):
        world.replay_instant(ct)
        if progress is not None:
            progress(ct / max(1, to_ns - from_ns))
    world.take_remaining_samples(to_ns - from_ns)
    begun = [w.first_s for w in watches.values() if w.first_s is not None]
    judged.from_s = min(begun, default=judged.from_s)
    return judged


def _clear_forced_modes_and_faults(system: System) -> tuple[str, ...]:
    """Removes forced modes and declared faults; gives the names of modules that were forced."""
    forced = tuple(m.name for m in system.modules if m.forced)
    for m in system.modules:
        m.forced = None
    system.faults = ()
    return forced


def _empty_judgement(
    system: System, samples: list[TopicSamples], plan: ReplayPlan, log: str
) -> LogJudgement:
    """The judgement of a log before any step: facts on its samples, and modules without steps."""

    def fact_by_topic(fact: Callable[[TopicSamples], Any]) -> dict[str, Any]:
        return {s.topic.name: value for s in samples if (value := fact(s))}

    def of_module(m: Module) -> ModuleOfLog:
        lost, blind, unheard = (
            tuple(map(str, found.get(m.index, ())))
            for found in (plan.missing, plan.blind, plan.unheard)
        )
        return ModuleOfLog(m.name, m.period_ns, lost, blind, unheard, span=m.symbol.span)

    return LogJudgement(
        log=log,
        from_s=0.0,
        to_s=0.0,
        samples={s.topic.name: len(s.times_ns) for s in samples},
        nodes=tuple(system.components[n].name for n in plan.nodes),
        modules=[of_module(m) for m in system.modules],
        derived=[*chain.from_iterable(s.derived for s in samples)],
        constants=(*chain.from_iterable(s.constants for s in samples),),
        assumed_units=(*chain.from_iterable(s.assumed_units for s in samples),),
        sources=fact_by_topic(lambda s: s.sources),
        stamps=fact_by_topic(lambda s: s.stamp),
        left_out=fact_by_topic(lambda s: s.left_out and (s.left_out, s.first_left_out)),
        reasons=fact_by_topic(lambda s: tuple(s.reasons.values())),
        lost=[*chain.from_iterable(s.lost for s in samples), *doubt_notes(system, samples)],
        far_stamps=fact_by_topic(lambda s: s.far_stamps),
    )


def _unused_externs(system: System) -> dict[str, object]:
    """Maps the name of each extern of a system to a function that is never called."""

    def refuse(*_: object) -> object:
        raise AssertionError("a replay of a log asks no extern")

    functions = [f.name for f in system.program.funs.values() if f.extern]
    return dict.fromkeys([*(c.name for c in system.components if c.extern), *functions], refuse)


def _release_times(system: System, plan: ReplayPlan, length_ns: int) -> Iterator[int]:
    """The times at which a node or DM of the plan is released, from 0 to the end of the log."""
    parts = [system.components[n] for n in plan.nodes]
    parts += [system.components[system.modules[m].dm] for m in plan.modules]
    released = sorted({(c.phase_ns, c.period_ns) for c in parts})
    now = -1
    while released:
        later = [p if now < p else now + q - (now - p) % q for p, q in released]
        now = min(later)
        if now > length_ns:
            return
        yield now


def _require_bounded_steps(system: System, plan: ReplayPlan, length_ns: int, log: str) -> None:
    """Raises D016 for a log so long that its clock must have jumped, or its unit is wrong."""
    parts = [system.components[system.modules[m].dm] for m in plan.modules]
    steps = sum(length_ns // c.period_ns for c in parts)
    if steps > STEPS_MAX:
        raise unusable_log_error(
            Path(log),
            f"it spans {length_ns / 1e9:,.0f} s, {steps:,} decisions",
            "does its clock jump? is `unit` of `time` right?",
            f"at most {STEPS_MAX:,} decisions are replayed: choose a part with `--where`",
        )


class _LogState:
    """The state of a system during a log's replay; times `ct` count from the first judged time."""

    def __init__(
        self,
        system: System,
        interpreter: Interpreter,
        samples: list[TopicSamples],
        plan: ReplayPlan,
        judged: LogJudgement,
        from_ns: int,
    ) -> None:
        self.system, self.plan, self.judged = system, plan, judged
        self.machine: ExecutableSystem = interpreter.machine
        self.c: Configuration = interpreter.initial()
        self.from_ns = from_ns
        self.feeds_by_driver: dict[int, list[_Feed]] = {}
        for s in samples:
            self.feeds_by_driver.setdefault(
                _publishing_component(system, s.topic.index), []
            ).append(_Feed(s, from_ns))
        self.stepping = {*plan.nodes, *(system.modules[m].dm for m in plan.modules)}
        mapped = {s.topic.index for s in samples}
        written = mapped.union(*(writes_of_node(system.components[n]) for n in plan.nodes))
        self.needs: dict[int, set[int]] = {}
        """For each component the topics that must be published before it steps."""
        for n in plan.nodes:
            self.needs[n] = (
                source_topics(system, plan.nodes, writes_of_node(system.components[n])) & mapped
            )
        for m in (system.modules[i] for i in plan.modules):
            inputs = set(source_topics(system, (), m.inputs))
            behind = source_topics(system, plan.nodes, inputs) & mapped
            self.needs[m.dm] = behind | (inputs & written)
        self.aging = {s.topic.index for s in samples if not s.is_constant}
        self.safe_topics = {m.index: topics_of_safe(m) & written for m in system.modules}
        self.hearing = TopicsHeard.before_log(system, samples, plan)
        modules = [system.modules[i] for i in plan.modules]
        self.dm_rests = {m.index: self.hearing.dependencies_of_reads(m.inputs) for m in modules}
        self.safe_rests = {
            m.index: self.hearing.dependencies_of_reads(self.safe_topics[m.index]) for m in modules
        }
        self.watches: dict[int, ModuleWatch] = {}
        self.unread: set[tuple[int, int]] = set()
        """Pairs of a module and a topic of its `safe` that no step read since it was published."""

    def replay_instant(self, ct: int) -> None:
        """Publishes the samples before an instant, then steps everything in the deployed order."""
        due = [n for n in self.system.components if n.index in self.stepping and _is_due(n, ct)]
        self.c = replace(self.c, ct=ct, FN=tuple(n.index for n in due))
        for feeds in self.feeds_by_driver.values():
            for feed in feeds:
                self._publish_samples(feed, feed.samples_before(ct))
        self._feed_samples(-1, ct)
        released = {n.index for n in due}
        for n in self.system.components:
            self._feed_samples(n.index, ct)
            if n.index in released:
                self._step_component(n)

    def take_remaining_samples(self, ct: int) -> None:
        """Publishes the samples after the last step, which can only be refused or too late."""
        self.c = replace(self.c, ct=ct)
        for feeds in self.feeds_by_driver.values():
            for feed in feeds:
                self._publish_samples(feed, feed.samples_before(ct + 1))
        for m, watch in self.watches.items():
            for on in (self.dm_rests[m], self.safe_rests[m]):
                for name, then in self.hearing.stamps_of_silent_topics(self.c, on).items():
                    watch.module_log.last_heard[name] = max(0, then + self.from_ns) / 1e9
            if (
                self._are_published(self.safe_topics[m])
                and self._reads_of_safe(m) != watch.last_safe_reads
            ):
                env = self.machine.environment(self.c, self.system.components[watch.module.dm])
                watch.judge_late_sample(env, (ct + self.from_ns) / 1e9)

    def _are_published(self, topics: set[int]) -> bool:
        return all(self.c.stamps[i] != NEVER for i in topics)

    def _reads_of_safe(self, module: int) -> list[object]:
        return [(self.c.stamps[i], self.c.Topics[i]) for i in sorted(self.safe_topics[module])]

    def _feed_samples(self, driver: int, ct: int) -> None:
        for feed in self.feeds_by_driver.get(driver, ()):
            self._publish_samples(feed, feed.samples_until(ct))

    def _publish_samples(self, feed: _Feed, values: Iterator[tuple[int, object]]) -> None:
        topic = feed.samples.topic
        sampled = not (feed.samples.linear or feed.samples.is_constant)
        for time_ns, value in values:
            try:
                self.machine.checks[topic.index](value, topic.symbol.span)
            except StepFault as fault:
                count, first = self.judged.refused.get(topic.name, (0, ""))
                first = first or f"{(time_ns + self.from_ns) / 1e9:.3f} s: {fault.detail}"
                self.judged.refused[topic.name] = count + 1, first
                if sampled:
                    refused = environment_input(self.machine, self.c, topic.index, value, time_ns)
                    self._ask_safe_of_sample(refused, topic.index, set(self.watches))
                continue
            if sampled:
                lost = {m for m in self.watches if (m, topic.index) in self.unread}
                self._ask_safe_of_sample(self.c, topic.index, lost)
                self.unread |= {(m, topic.index) for m in self.watches}
            self.c = environment_input(self.machine, self.c, topic.index, value, time_ns)

    def _ask_safe_of_sample(self, c: Configuration, topic: int, modules: set[int]) -> None:
        """Asks `safe` of these modules about a sample that no step of their DMs reads."""
        for m in modules:
            if topic in self.safe_topics[m] and all(
                c.stamps[i] != NEVER for i in self.safe_topics[m]
            ):
                watch = self.watches[m]
                env = self.machine.environment(c, self.system.components[watch.module.dm])
                watch.judge_late_sample(env, (c.stamps[topic] + self.from_ns) / 1e9)

    def _step_component(self, n: Component) -> None:
        heard = self._are_published(self.needs[n.index])
        if n.role == "dm":
            assert n.module is not None
            if heard:
                self._step_dm(n, n.module, self.watches[n.module])
            else:
                self.watches[n.module].module_log.waiting += 1
            return
        if not heard:
            return  # the DM would read the program's initial values, not the log's
        self.hearing.note_node_step(self.c, n.index)
        self.c, outcome = ac_or_sc_step(self.machine, self.c, n.index)
        if isinstance(outcome, StepOutcome) and outcome.fault is not None:
            text = f"{(self.c.ct + self.from_ns) / 1e9:.3f} s: {outcome.fault.detail}"
            self.judged.faulted.setdefault(n.name, text)

    def _step_dm(self, n: Component, m: int, watch: ModuleWatch) -> None:
        env = self.machine.environment(self.c, n)
        self.c, verdict = dm_step(self.machine, self.c, n.index)
        time_s = (self.c.ct + self.from_ns) / 1e9
        watch.note_decision(verdict, env, time_s)
        rests = self.hearing.rests_on_young_topics(self.c, self.dm_rests[m])
        watch.module_log.silent += not (rests or verdict.stale)
        too_old = not self.hearing.rests_on_young_topics(self.c, self.safe_rests[m])
        for i in self.safe_topics[m] | self.needs[n.index]:
            topic, age = self.system.topics[i], self.c.ct - self.c.stamps[i]
            if topic.max_age_ns is not None:
                too_old = too_old or (i in self.safe_topics[m] and age > topic.max_age_ns)
            elif i in self.aging:
                self.judged.ageless[topic.name] = max(age, self.judged.ageless.get(topic.name, 0))
        self.unread = {each for each in self.unread if each[0] != m}
        if self._are_published(self.safe_topics[m]):
            watch.last_safe_reads = self._reads_of_safe(m)
            if too_old:
                watch.judge_late_sample(env, time_s)
            else:
                watch.judge_reads(env, time_s, fresh=rests and not verdict.stale)


def _publishing_component(system: System, topic: int) -> int:
    """The component that publishes a mapped topic in flight; -1 for an input, which comes first."""
    for c in system.components:
        if topic in c.writes:
            return c.index
    return -1


def _is_due(n: Component, ct: int) -> bool:
    return ct >= n.phase_ns and (ct - n.phase_ns) % n.period_ns == 0


class _Feed:
    """Gives a topic's samples in order of arrival; times count from the first judged time."""

    def __init__(self, samples: TopicSamples, from_ns: int) -> None:
        self.samples, self.from_ns = samples, from_ns
        self.next = max(0, bisect_right(samples.times_ns, from_ns) - 1)

    def samples_before(self, ct: int) -> Iterator[tuple[int, object]]:
        """Gives the next samples that arrived before `ct`."""
        if not self.samples.linear:
            yield from self._samples_up_to(bisect_left(self.samples.times_ns, ct + self.from_ns))

    def samples_until(self, ct: int) -> Iterator[tuple[int, object]]:
        """Gives the next samples up to `ct`; for lines and constants, only the value at `ct`."""
        if self.samples.is_constant:
            yield ct, self.samples.values[0]
        elif self.samples.linear:
            value = self.samples.value_at(ct + self.from_ns)
            if value is not None:
                yield ct, value
        else:
            yield from self._samples_up_to(bisect_right(self.samples.times_ns, ct + self.from_ns))

    def _samples_up_to(self, end: int) -> Iterator[tuple[int, object]]:
        for i in range(self.next, end):
            yield self.samples.stamps_ns[i] - self.from_ns, self.samples.values[i]
        self.next = max(self.next, end)
