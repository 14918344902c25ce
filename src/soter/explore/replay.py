"""Runs a trace again, step by step, in the reference interpreter.

Purpose: a violation counts only if `replay`, given the steps and choices of a trace and nothing
else, finds every step allowed by docs/testing.md and the property violated in the end. What every
step did is kept as plain records (`ReplayedStep`).
Non-goals: speed; finding traces; files (`trace.py`), showing them (`trace_view.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.explore.judge import (
    ExecutionCalendar,
    Judge,
    NotAllowedError,
    TraceDraws,
    fault_text,
    scheduled_actors,
    test_plan,
)
from soter.explore.trace import (
    BEGIN,
    CONTRACT,
    EFFECT,
    FAULT,
    LOST,
    PROPERTY,
    START,
    TIMED,
    ChoiceWords,
    Step,
    ViolationId,
)
from soter.language.model.types import ListType
from soter.language.model.values import to_json
from soter.semantics.configuration import DecisionVerdict, StepOutcome
from soter.semantics.interpreter import Interpreter
from soter.semantics.judgements import judging_fault
from soter.semantics.rules import environment_input

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.explore.judge import ScheduledActor
    from soter.explore.trace import Choice, Trace
    from soter.language.model.system import System
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration


MODES = ("SC", "AC")


@dataclass(frozen=True)
class DroppedMessage:
    """A value that a full queue lost: the oldest or the new one, as its policy says."""

    queue: str
    policy: str


@dataclass(frozen=True, kw_only=True)
class ReplayedStep:
    """One step and the configuration that it led to. Values are JSON; times are ns.

    `published`: topic name -> the value that reached the topic, or the list of values if a step may
    publish several messages. `gated`: its outputs were not enabled, so they reached no topic.
    `decided`: the facts that a DM saw, and its mode. `violated`: all properties that are violated
    after the step, that of the trace and others.
    """

    number: int
    actor: str
    kind: str
    release_ns: int
    time_ns: int
    choices: tuple[Choice, ...]
    published: Mapping[str, object]
    gated: bool
    decided: Mapping[str, object] | None
    switch: tuple[str, str, str] | None
    """(module, mode before, mode after) if a mode changed."""
    fault: str | None
    observable: bool
    violated: tuple[ViolationId, ...]
    topics: Mapping[str, object]
    modes: Mapping[str, str]
    truth: Mapping[str, object]
    """The states of the plants, by full name."""
    reasons: tuple[str, ...] = ()
    """For each of `violated` a clause on what failed; "" if its text says enough."""
    dropped: tuple[DroppedMessage, ...] = ()
    """The messages that full queues lost as this step published."""


@dataclass(frozen=True)
class Replayed:
    """The replay of a trace; `problem` says why the trace is no execution, or is None."""

    trace: Trace
    system: System
    actors: tuple[ScheduledActor, ...]
    start: Mapping[str, object]
    """The values of the topics before the first step."""
    steps: tuple[ReplayedStep, ...]
    problem: str | None

    @property
    def violated_at(self) -> int | None:
        """The number of the first step that violates the trace's property; None if no step does."""
        return next((s.number for s in self.steps if self.has_violation_of_trace(s.violated)), None)

    @property
    def reproduced(self) -> bool:
        """Whether the trace is an execution that ends in the violation that it names."""
        return (
            self.problem is None
            and bool(self.steps)
            and self.has_violation_of_trace(self.steps[-1].violated)
        )

    def has_violation_of_trace(self, violations: Iterable[ViolationId]) -> bool:
        """Whether `violations` contains the violation that the trace names."""
        wanted = (self.trace.broken.what, self.trace.broken.index)
        return wanted in [(b.what, b.index) for b in violations]

    @property
    def outcome(self) -> str:
        """A sentence that says whether the replay showed the violation, or why it did not."""
        if self.problem is not None:
            return self.problem
        if self.reproduced:
            return f"{self.trace.broken.text} is violated at step {self.steps[-1].number}"
        at = self.violated_at
        if at is not None:
            return f"it is violated at step {at} already, and no more in the end"
        return f"every step is allowed, and {self.trace.broken.text} is not violated"


def replay(trace: Trace, system: System) -> Replayed:
    """Replays a trace; `system` is its test, flattened with the trace's parameters and times."""
    actors = scheduled_actors(system)
    if find_violation_id(system, trace.broken.what, trace.broken.index) != trace.broken:
        problem = f"the test has no such property: {trace.broken.text}"
        return Replayed(trace, system, actors, {}, (), problem)
    try:
        run = _TraceRun(trace, system)
    except NotAllowedError as error:
        return Replayed(trace, system, actors, {}, (), f"the start: {error}")
    return Replayed(trace, system, actors, run.start, *_follow_trace(run, trace))


def _follow_trace(run: _TraceRun, trace: Trace) -> tuple[tuple[ReplayedStep, ...], str | None]:
    """The steps up to the first step that is not allowed, and the reason, or None if all are."""
    problem: str | None = None
    for number, step in enumerate(trace.steps, run.first_number):
        try:
            run.make_step(number, step)
        except NotAllowedError as error:
            problem = f"step {number} ({step.kind} of `{step.actor}`): {error}"
            break
        if run.ended and number < run.first_number + len(trace.steps) - 1:
            problem = f"step {number}: no execution goes on after a violation"
            break
    return tuple(run.steps), problem


@dataclass
class _Event:
    """The effects of a step, from which its record is made."""

    published: dict[str, object] = field(default_factory=dict)
    gated: bool = False
    decided: dict[str, object] | None = None
    switch: tuple[str, str, str] | None = None
    fault: str | None = None
    broken: list[ViolationId] = field(default_factory=list)
    reasons: dict[ViolationId, str] = field(default_factory=dict)
    dropped: list[DroppedMessage] = field(default_factory=list)


class _TraceRun:
    """One execution of the interpreter, which follows a trace step by step."""

    def __init__(self, trace: Trace, system: System) -> None:
        self.system = system
        self.schedule = ExecutionCalendar(system)
        self.draws = TraceDraws(system, trace.seed)
        self.interpreter = Interpreter(system, trace.seed, draws=self.draws)
        self.machine = self.interpreter.machine
        self.judge = Judge(self.machine)
        self.words = ChoiceWords(system)
        first = trace.steps[0] if trace.steps else None
        born = first is not None and first.kind == START
        self.first_number = 0 if born else 1
        """The number of the trace's first step: the start is 0, whether the trace has it or not."""
        self.draws.begin_step(first.choices if first is not None and born else ())
        self.c: Configuration = self.interpreter.initial()
        self._before = self.c
        """The configuration in which the last step was made."""
        self.ended = False
        """Whether something is violated, so that the execution ends."""
        self.steps: list[ReplayedStep] = []
        self.start = self._topic_values()
        self._waiting: dict[int, dict[int, Value]] = {}
        """The values that overrunning steps will publish, by component."""

    def make_step(self, number: int, step: Step) -> None:
        """Makes one step; raises NotAllowedError if this execution cannot make the step."""
        index = self.schedule.take_step(step)
        if index is None:
            self._record_step(number, step, self.draws.end_step(), _Event())
            return
        actor = self.schedule.actors[index]
        self._before = self.c
        self.c = replace(self.c, ct=step.time_ns)
        self.draws.begin_step(step.choices)
        event = self._perform_step(actor, step)
        self._record_step(number, step, self.draws.end_step(), event)

    # ------------------------------------------------------------ what a step does

    def _perform_step(self, actor: ScheduledActor, step: Step) -> _Event:
        if step.kind == LOST:
            return _Event()
        if actor.component is None:
            return self._publish_input(actor)
        if step.kind == EFFECT:
            return self._publish_held_outputs(actor.component)
        return self._fire_component(actor.component, held_back=step.kind == BEGIN)

    def _publish_input(self, actor: ScheduledActor) -> _Event:
        assert actor.drive is not None
        drive = self.system.inputs[actor.drive]
        value = self.interpreter.drawn_input(drive, self.c.ct)
        if drive.values:
            self.draws.note_value(to_json(self.system.topics[drive.topic].type, value))
        dropped = self._dropped_messages(self.c, {drive.topic: value})
        self.c = environment_input(self.machine, self.c, drive.topic, value)
        return _Event(published=self._values_by_topic({drive.topic: value}), dropped=dropped)

    def _fire_component(self, number: int, *, held_back: bool) -> _Event:
        before = self.c
        after, event = self.interpreter.fire(replace(before, FN=(number,)), number)
        self.c = after
        if isinstance(event, DecisionVerdict):
            self.judge.note_event(event, after)
            return self._decision_event(event)
        done = _Event(broken=self._step_violations(number, event))
        self.ended = bool(done.broken)
        if event.fault is not None:
            done.fault = fault_text(event.fault)
            done.reasons = self._fault_reasons(number, done)
        done.reasons |= self._contract_reasons(number, done, before)
        done.gated = not before.OE[number]
        if held_back:
            self._hold_back_outputs(before, number, event)
        else:
            self.judge.note_event(event, after)
            done.published = self._values_by_topic(event.published, event.bursts)
            done.dropped = self._dropped_messages(before, event.published, event.bursts)
        return done

    def _dropped_messages(
        self,
        c: Configuration,
        published: Mapping[int, Value],
        bursts: Mapping[int, tuple[Value, ...]] | None = None,
    ) -> list[DroppedMessage]:
        """The messages that full queues lose when these values reach the topics of `c`."""
        topics, losses = self.system.topics, []
        for topic in published:
            arriving = len((bursts or {}).get(topic, (None,)))
            for queue in [topics[i] for i in topics[topic].queues]:
                assert isinstance(queue.type, ListType), queue.name
                lost = len(c.Topics[queue.index]) + arriving - queue.type.capacity
                losses += [DroppedMessage(queue.name.removesuffix(".queue"), queue.policy)] * min(
                    max(lost, 0), arriving
                )
        return losses

    def _fault_reasons(self, n: int, done: _Event) -> dict[ViolationId, str]:
        name = self.system.components[n].name
        return {b: f"`{name}` faults ({done.fault})" for b in done.broken if b.what == FAULT}

    def _contract_reasons(
        self, n: int, done: _Event, before: Configuration
    ) -> dict[ViolationId, str]:
        """For each broken contract whose judgement faults, words on that fault."""
        component, reasons = self.system.components[n], {}
        for b in done.broken:
            if b.what == CONTRACT:
                assumed = self.system.properties[b.index].kind == "assumes"
                c = before if assumed else self.c
                fault = judging_fault(self.machine, c, b.index, component)
                if fault is not None:
                    reasons[b] = f"judging it faults ({fault_text(fault)})"
        return reasons

    def _decision_event(self, verdict: DecisionVerdict) -> _Event:
        name = self.system.modules[verdict.module].name
        facts = {
            "module": name,
            "ttf": verdict.ttf,
            "safer": verdict.safer,
            "stale": verdict.stale,
            "gate_fault": verdict.gate_fault,
            "mode": MODES[verdict.after],
        }
        changed = verdict.before != verdict.after
        switch = (name, MODES[verdict.before], MODES[verdict.after]) if changed else None
        return _Event(decided=facts, switch=switch)

    def _step_violations(self, n: int, event: StepOutcome) -> list[ViolationId]:
        """The contracts that a step breaks, and the fault of a trusted component if it latched."""
        named = [find_violation_id(self.system, CONTRACT, i) for i in event.violated]
        if event.latched:
            named.append(find_violation_id(self.system, FAULT, n))
        return [b for b in named if b is not None]

    def _hold_back_outputs(self, before: Configuration, n: int, event: StepOutcome) -> None:
        """Takes back the outputs of an overrunning step, to publish them when the step ends."""
        self._waiting[n] = dict(event.published)
        own_queues = [
            t.index for t in self.system.topics if self._is_queue_of_component(t.index, n)
        ]
        topics, stamps = list(before.Topics), list(before.stamps)
        for i in own_queues:  # emptied by the step, whatever it published itself
            topics[i], stamps[i] = self.system.topics[i].default, self.c.stamps[i]
        self.c = replace(self.c, Topics=tuple(topics), stamps=tuple(stamps))

    def _is_queue_of_component(self, topic: int, n: int) -> bool:
        candidate = self.system.topics[topic]
        name = self.system.components[n].name
        return candidate.queue_of is not None and candidate.name.startswith(f"{name}.")

    def _publish_held_outputs(self, n: int) -> _Event:
        waiting = self._waiting.pop(n)
        if not self.c.OE[n]:
            return _Event(gated=bool(waiting))
        dropped = self._dropped_messages(self.c, waiting)
        for topic, value in waiting.items():
            self.c = environment_input(self.machine, self.c, topic, value)
        if waiting:
            self.judge.note_published(n, self.c)
        return _Event(published=self._values_by_topic(waiting), dropped=dropped)

    # ------------------------------------------------------------ records

    def _record_step(
        self, number: int, step: Step, choices: tuple[Choice, ...], event: _Event
    ) -> None:
        observable = step.kind != START and self.schedule.is_observable
        broken = event.broken
        if not self.ended and step.kind != START:
            over = self.schedule.is_over
            violations = self.judge.violations_at(self.c, observable=observable, over=over)
            why = self.judge.violation_reason
            event.reasons |= {b: why(b, self.c, self._before) for b in violations}
            broken = [*broken, *violations]
            self.ended = bool(broken)
        self.steps.append(
            ReplayedStep(
                number=number,
                actor=step.actor,
                kind=step.kind,
                release_ns=step.release_ns,
                time_ns=step.time_ns,
                choices=tuple([self.words.with_value(c) for c in choices]),
                published=event.published,
                gated=event.gated,
                decided=event.decided,
                switch=event.switch,
                fault=event.fault,
                observable=observable,
                violated=tuple(broken),
                topics=self._topic_values(),
                modes={m.name: MODES[self.c.L[m.dm]] for m in self.system.modules},
                truth=self._plant_states(),
                reasons=tuple([event.reasons.get(b, "") for b in broken]),
                dropped=tuple(event.dropped),
            )
        )

    def _values_by_topic(
        self, values: Mapping[int, Value], bursts: Mapping[int, tuple[Value, ...]] | None = None
    ) -> dict[str, object]:
        topics, several = self.system.topics, bursts or {}
        return {
            topics[i].name: [to_json(topics[i].type, m) for m in several[i]]
            if i in several
            else to_json(topics[i].type, v)
            for i, v in values.items()
        }

    def _topic_values(self) -> dict[str, object]:
        return {t.name: to_json(t.type, self.c.Topics[t.index]) for t in self.system.topics}

    def _plant_states(self) -> dict[str, object]:
        return {
            x.name: {
                s.name: to_json(s.type, v)
                for s, v in zip(x.plant.states, self.c.L[x.index], strict=True)
            }
            for x in self.system.components
            if x.plant is not None
        }


def find_violation_id(system: System, kind: str, index: int) -> ViolationId | None:
    """The violation of this kind and number; None if the system has no such violation."""
    plan = test_plan(system)
    if kind == FAULT and index < len(system.components):
        component = system.components[index]
        if component.stands_for is not None:
            text = f"what the contract of {component.stands_for.of} permits can be judged"
            return ViolationId(FAULT, index, text)
        return ViolationId(FAULT, index, f"no step of {component.name} faults")
    if kind == TIMED and index < len(plan.timed):
        return ViolationId(TIMED, index, plan.timed[index].text)
    if kind not in (PROPERTY, CONTRACT) or index >= len(system.properties):
        return None
    prop = system.properties[index]
    if (prop.component is None) != (kind == PROPERTY):
        return None
    return ViolationId(kind, index, f"{prop.kind} {prop.text}")


def with_chosen_values(replay_result: Replayed) -> Replayed:
    """A copy of the replay whose trace has the values that the interpreter chose."""
    steps = tuple(
        replace(step, choices=done.choices)
        for step, done in zip(replay_result.trace.steps, replay_result.steps, strict=True)
    )
    return replace(replay_result, trace=replace(replay_result.trace, steps=steps))
