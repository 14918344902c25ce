"""Judges a replayed execution by docs/testing.md: which step may be next, and what is violated.

Purpose: for `replay.py`. An `ExecutionCalendar` follows a replay step by step and checks releases,
windows, times, lost releases and overruns. `TraceDraws` gives the reference interpreter the picks
of a trace, one step at a time: each question of a step is answered from its own list, in order, and
kept with its answer for people. A `Judge` follows properties, deadlines and invariants. This was
written from that page alone, and shares nothing with the engine whose traces it judges.
Non-goals: contracts and step faults, which the step itself reports (`replay.py`); what the
alternatives of a question are; enumerating executions.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.trace import BEGIN, EFFECT, LOST, PROPERTY, START, TIMED, Choice, ViolationId
from soter.language.elaborate.time_grid import quantum_of
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.statements import Evaluator
from soter.language.model.types import FloatType, show_ns
from soter.language.model.values import to_json
from soter.semantics.answered_draws import AnsweredDraws
from soter.semantics.configuration import AC, SC, DecisionVerdict, StepOutcome
from soter.semantics.judgements import judging_fault, violated_properties

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.explore.trace import Step
    from soter.language.evaluate.expressions import Compiled
    from soter.language.model.system import Bound, Module, System, TestPlan, TimedProperty
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


INPUT = "input."


class NotAllowedError(Exception):
    """Raised for a step, or a choice in it, that no execution has here; the message says why."""


@dataclass(frozen=True, kw_only=True)
class ScheduledActor:
    """A component or an input of a test, released at phase + k * period up to the horizon.

    For a release r the step happens in [r, r + window]; up to `skips` releases in a row may be
    lost. Publications take effect between `least` and `overrun` after the step began; `least` > 0
    means that every step lasts, and `overrun` 0 means at once. Times in ns.
    """

    name: str
    role: str
    component: int | None
    drive: int | None
    period_ns: int
    phase_ns: int
    window_ns: int = 0
    skips: int = 0
    overrun_ns: int = 0
    least_ns: int = 0


def scheduled_actors(system: System) -> tuple[ScheduledActor, ...]:
    """The actors of a test: its components in their order, then its inputs."""
    plan = test_plan(system)
    actors = []
    for component in system.components:
        faults = [f for f in plan.faults if f.component == component.index]
        late = sum(f.by_ns for f in faults if f.kind == "late")
        actors.append(
            ScheduledActor(
                name=component.name,
                role=component.role,
                component=component.index,
                drive=None,
                period_ns=component.period_ns,
                phase_ns=component.phase_ns,
                window_ns=0 if component.role == "plant" else plan.skew_ns + late,
                skips=max((f.at_most for f in faults if f.kind == "skip"), default=0),
                overrun_ns=sum(f.by_ns for f in faults if f.kind == "overrun"),
                least_ns=sum(f.least_ns for f in faults if f.kind == "overrun"),
            )
        )
    for i, drive in enumerate(system.inputs):
        name = INPUT + system.topics[drive.topic].name
        actors.append(
            ScheduledActor(
                name=name,
                role="input",
                component=None,
                drive=i,
                period_ns=drive.every_ns,
                phase_ns=0,
            )
        )
    return tuple(actors)


def test_plan(system: System) -> TestPlan:
    """The plan of the test for which the system was flattened."""
    assert system.test is not None, f"{system.name} is no test"
    return system.test


class ExecutionCalendar:
    """The place of one execution in its calendar; `take_step` checks a step and moves on."""

    def __init__(self, system: System) -> None:
        self.actors = scheduled_actors(system)
        self.number = {a.name: i for i, a in enumerate(self.actors)}
        self.horizon_ns = test_plan(system).horizon_ns
        self.quantum_ns = quantum_of(system)
        self.ordered = test_plan(system).ordered
        self.now = -1
        self._started = False
        self.done = [0] * len(self.actors)
        self._lost = [0] * len(self.actors)
        self._running: dict[int, int] = {}
        """By actor, the time at which its step that still overruns began."""

    # ------------------------------------------------------------ what is to come

    def next_window(self, index: int) -> tuple[int, int] | None:
        """The times [lo, hi] at which an actor's next step may happen; None if it has no step left.

        While an actor still runs, its next step is the effect of its publications.
        """
        actor = self.actors[index]
        if index in self._running:
            return self._running[index] + actor.least_ns, self._running[index] + actor.overrun_ns
        release = self.actors[index].phase_ns + self.done[index] * self.actors[index].period_ns
        return None if release > self.horizon_ns else (release, release + actor.window_ns)

    @property
    def is_observable(self) -> bool:
        """Whether time may pass here, as all steps that are due have happened."""
        return all(hi > self.now for _, hi in self._open_windows())

    @property
    def is_over(self) -> bool:
        """Whether every step has happened."""
        return not self._open_windows()

    def _open_windows(self) -> list[tuple[int, int]]:
        windows = (self.next_window(i) for i in range(len(self.actors)))
        return [w for w in windows if w is not None]

    # ------------------------------------------------------------ moving on

    def take_step(self, step: Step) -> int | None:
        """Checks a step and moves on; returns the number of the actor, or None for the start.

        Raises NotAllowedError if the schedule does not allow the step here.
        """
        if step.kind == START:
            if self._started or self.now != -1 or any(self.done):
                raise NotAllowedError("the start comes first, and once")
            self._started = True
            return None
        index = self.number.get(step.actor)
        if index is None:
            raise NotAllowedError(f"there is no actor `{step.actor}`")
        window = self.next_window(index)
        if window is None:
            raise NotAllowedError(f"`{step.actor}` has no release left up to the horizon")
        self._check_kind(step, index, window)
        self._check_time(step, index, window)
        self._advance_calendar(step, index)
        return index

    def _check_kind(self, step: Step, index: int, window: tuple[int, int]) -> None:
        actor, runs = self.actors[index], index in self._running
        if step.kind == EFFECT:
            if not runs:
                raise NotAllowedError(f"`{actor.name}` does not run: nothing can take effect")
            return
        if runs:
            raise NotAllowedError(f"`{actor.name}` still runs")
        if step.release_ns != window[0]:
            message = f"the next release of `{actor.name}` is at {show_ns(window[0])}"
            raise NotAllowedError(f"{message}, not {show_ns(step.release_ns)}")
        if step.kind == BEGIN and not actor.overrun_ns:
            raise NotAllowedError(f"the test does not let `{actor.name}` overrun")
        if step.kind == LOST and self._lost[index] >= actor.skips:
            many = f"more than {actor.skips} in a row" if actor.skips else "any"
            raise NotAllowedError(f"the test does not let `{actor.name}` skip {many}")

    def _deployed_place(self, index: int) -> tuple[bool, int]:
        """A sort key for the deployed order of actors: inputs come before components."""
        return self.actors[index].drive is None, index

    def _check_time(self, step: Step, index: int, window: tuple[int, int]) -> None:
        earliest, latest = window
        soonest = max(earliest, self.now)
        if not soonest <= step.time_ns <= latest:
            message = f"it can happen from {show_ns(soonest)} to {show_ns(latest)}"
            message += f", not at {show_ns(step.time_ns)}"
            raise NotAllowedError(message)
        if step.time_ns != soonest and step.time_ns % self.quantum_ns:
            message = f"{show_ns(step.time_ns)} is not on the grid of {show_ns(self.quantum_ns)}"
            raise NotAllowedError(message)
        if step.kind == LOST and step.time_ns != soonest:
            raise NotAllowedError("a lost release has its place as early as possible")
        for other_index, actor in enumerate(self.actors):
            other_window = self.next_window(other_index)
            if other_window is None:
                continue
            if (
                self.ordered
                and other_window[0] <= step.time_ns
                and self._deployed_place(other_index) < self._deployed_place(index)
            ):
                message = f"`{actor.name}` steps before it in the deployed order"
                raise NotAllowedError(message)
            if other_window[1] < step.time_ns:
                by = show_ns(other_window[1])
                raise NotAllowedError(f"`{actor.name}` has to step before, by {by}")

    def _advance_calendar(self, step: Step, index: int) -> None:
        self.now = step.time_ns
        if step.kind == EFFECT:
            del self._running[index]
            actor = self.actors[index]
            busy = self.now - (1 if actor.least_ns else 0)  # who says so may step again at once
            released = (busy - actor.phase_ns) // actor.period_ns + 1
            self.done[index] = max(self.done[index], released)  # it still ran: these are lost
            return
        self.done[index] += 1
        self._lost[index] = self._lost[index] + 1 if step.kind == LOST else 0
        if step.kind == BEGIN:
            self._running[index] = step.time_ns


class TraceDraws(AnsweredDraws):
    """Draws with answers from a trace; a question without an answer gets the first alternative."""

    def __init__(self, system: System, seed: int) -> None:
        super().__init__(system, self._next_pick, seed)
        self._choices_by_stream: dict[str, list[Choice]] = {}
        self._values: list[object] = []
        """For each of `questions` the value taken, as JSON; None if the value is not known."""

    def begin_step(self, choices: Iterable[Choice]) -> None:
        """Begins a step whose questions these choices answer."""
        self.questions.clear()
        self._values = []
        self._choices_by_stream = {}
        for choice in choices:
            self._choices_by_stream.setdefault(choice.stream, []).append(choice)

    def end_step(self) -> tuple[Choice, ...]:
        """Ends the step, and returns the choices it asked for; NotAllowedError if any is left."""
        for stream, left in self._choices_by_stream.items():
            if left:
                raise NotAllowedError(f"nothing asks for a choice from `{stream}`")
        pairs = zip(self.questions, self._values, strict=True)
        return tuple([Choice(a.stream, a.pick, a.count, value) for a, value in pairs])

    def note_value(self, value: object) -> None:
        """Notes, as JSON, the value that belongs to the last answer."""
        if self._values:
            self._values[-1] = value

    def _next_pick(self, stream: str, count: int) -> int:
        left = self._choices_by_stream.get(stream)
        if not left:
            return 0
        choice = left.pop(0)
        if choice.of != count:
            message = f"`{stream}` has {count} alternatives here, not {choice.of}"
            raise NotAllowedError(message)
        return choice.pick

    # ------------------------------------------------------------ Draws

    def choice(self, stream: str, index: int, count: int) -> int:
        """The number of one of `count` alternatives; its value is not known here."""
        pick = super().choice(stream, index, count)
        self._keep_value(None)
        return pick

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]."""
        value = super().uniform(stream, index, low, high)
        self._keep_value(value)
        return value

    def leaf_value(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type within its bound."""
        value = super().leaf_value(t, bound, stream, index)
        if not isinstance(t, FloatType):  # which `uniform` has kept
            self._keep_value(to_json(t, value))
        return value

    def _keep_value(self, value: object) -> None:
        """Notes the value for the last question, if that question has no value yet."""
        if len(self.questions) > len(self._values):
            self._values.append(value)


@dataclass
class _ControlHistory:
    """When a module's DM last gave the verdict AC (0: the start), and whether SC acted since."""

    last_ac_ns: int = 0
    sc_acted: bool = False
    has_said_ac: bool = False


class Judge:
    """Follows one execution; `violations_at` gives the properties that the execution violates."""

    def __init__(self, machine: ExecutableSystem) -> None:
        self._machine = machine
        self._system: System = machine.system
        plan = test_plan(self._system)
        self._timed = plan.timed
        self._horizon_ns = plan.horizon_ns
        self._premise = {p.index: self._compile(p, p.premise) for p in plan.timed}
        self._condition = {p.index: self._compile(p, p.condition) for p in plan.timed}
        self._safe = {
            p.module: self._compile_safe(self._system.modules[p.module])
            for p in plan.timed
            if p.module is not None
        }
        self._histories = [_ControlHistory() for _ in self._system.modules]
        self._due: dict[int, int] = {
            p.index: p.within_ns for p in plan.timed if p.kind == "eventually"
        }
        self._since: dict[int, int] = {}
        """For each open deadline the time at which its premise held."""
        self._faulted: dict[int, str] = {}
        """For each open deadline the first fault in judging its condition, in words."""
        self._drop_beyond_horizon()

    def _compile(self, prop: TimedProperty, expr: TypedExpr | None) -> Compiled | None:
        return None if expr is None else Evaluator.for_scope(prop.scope, {}).compiled(expr)

    def _compile_safe(self, module: Module) -> Compiled:
        return Evaluator.for_scope(module.scope, {}).compiled(module.symbol.safe)

    # ------------------------------------------------------------ what happened

    def note_event(self, event: DecisionVerdict | StepOutcome, c: Configuration) -> None:
        """Notes the verdict of a DM, or the outcome of a step, that led to `c`."""
        if isinstance(event, DecisionVerdict):
            if event.after == AC:
                self._histories[event.module] = _ControlHistory(c.ct, has_said_ac=True)
        elif event.published:
            self.note_published(event.component, c)

    def note_published(self, component: int, c: Configuration) -> None:
        """Notes that a component's publication has reached the topics of `c`."""
        publisher = self._system.components[component]
        if publisher.role == "sc" and publisher.module is not None:
            module = self._system.modules[publisher.module]
            if c.L[module.dm] == SC:
                self._histories[publisher.module].sc_acted = True

    # ------------------------------------------------------------ what is violated

    def violations_at(self, c: Configuration, *, observable: bool, over: bool) -> list[ViolationId]:
        """The properties that are violated in `c`; `over`: whether all steps have happened."""
        violations: list[ViolationId] = []
        if observable:
            self._update_deadlines(c)
            violations += self._violated_properties(c)
        for prop in self._timed:
            if prop.kind == "invariant":
                fails = observable and not self._invariant_holds(prop, c)
            else:
                due = self._due.get(prop.index)
                fails = due is not None and (due < c.ct or over)
            if fails:
                violations.append(ViolationId(TIMED, prop.index, prop.text))
        return violations

    def _violated_properties(self, c: Configuration) -> list[ViolationId]:
        props = [p for p in self._system.properties if p.component is None]
        values = violated_properties(self._machine, c)
        return [
            ViolationId(PROPERTY, p.index, f"{p.kind} {p.text}") for p in props if values[p.index]
        ]

    def _update_deadlines(self, c: Configuration) -> None:
        """Drops the deadlines that `c` meets, and adds those of premises that hold in `c`."""
        for prop in self._timed:
            due = self._due.get(prop.index)
            if prop.kind == "invariant" or (due is not None and due < c.ct):
                continue  # a missed deadline stays missed
            if self._deadline_is_met(prop, c):
                self._due.pop(prop.index, None)
                self._faulted.pop(prop.index, None)
            elif (
                prop.kind == "leadsto" and due is None and self._holds(self._premise[prop.index], c)
            ):
                self._due[prop.index] = c.ct + prop.within_ns
                self._since[prop.index] = c.ct
        self._drop_beyond_horizon()

    def _drop_beyond_horizon(self) -> None:
        """Drops deadlines beyond the horizon, which are not judged."""
        self._due = {i: due for i, due in self._due.items() if due <= self._horizon_ns}

    def _deadline_is_met(self, p: TimedProperty, c: Configuration) -> bool:
        """Whether a deadline's condition holds; a fault counts as false, and is noted."""
        fault = self._evaluation_fault(self._condition[p.index], c)
        if fault is not None and p.index in self._due:
            self._faulted.setdefault(p.index, f"{_time_text(c.ct)}: {fault_text(fault)}")
        return fault is None and self._holds(self._condition[p.index], c)

    def _holds(self, code: Compiled | None, c: Configuration) -> bool:
        """Whether a condition holds in `c`; a condition that faults does not hold."""
        assert code is not None
        try:
            return bool(code(self._machine.environment(c)))
        except StepFault:
            return False

    def _evaluation_fault(self, code: Compiled | None, c: Configuration) -> StepFault | None:
        assert code is not None
        try:
            code(self._machine.environment(c))
        except StepFault as fault:
            return fault
        return None

    def _invariant_holds(self, p: TimedProperty, c: Configuration) -> bool:
        """Whether `safe` holds, and the last AC verdict is recent or SC has taken control."""
        assert p.module is not None
        module, history = self._system.modules[p.module], self._histories[p.module]
        if not self._holds(self._safe[p.module], c):
            return False
        acts = history.sc_acted and c.L[module.dm] == SC
        return acts or c.ct <= history.last_ac_ns + 2 * module.period_ns

    # ------------------------------------------------------------ why

    def violation_reason(self, broken: ViolationId, c: Configuration, before: Configuration) -> str:
        """Why a property is violated in `c`, in words; "" if the text of the property says it.

        `before`: the configuration from which the last step led to `c`.
        """
        if broken.what != TIMED:
            return self._property_reason(broken.index, c, before)
        prop = self._timed[broken.index]
        if prop.kind == "invariant":
            return self._invariant_reason(prop, c)
        due_ns = self._due[prop.index]
        missed = f"`{prop.promises}` did not hold in any observable configuration"
        fault = self._faulted.get(prop.index)
        faulted = "" if fault is None else f" (judging it faulted at {fault})"
        if prop.premise is None:
            return f"{missed} up to {_time_text(due_ns)}{faulted}"
        held = f"`{prop.asks}` held at {_time_text(self._since[prop.index])}"
        return f"{held}, and {missed} from then on up to {_time_text(due_ns)}{faulted}"

    def _property_reason(self, index: int, c: Configuration, before: Configuration) -> str:
        """Words on a fault while judging an `always` or `never`, or on an earlier violation."""
        fault = judging_fault(self._machine, c, index)
        clauses = [] if fault is None else [f"judging it faults ({fault_text(fault)})"]
        if violated_properties(self._machine, before)[index]:
            clauses.append(
                "it was false earlier in this instant already; a property is judged after the "
                "last step of an instant, which this is"
            )
        return "; ".join(clauses)

    def _invariant_reason(self, prop: TimedProperty, c: Configuration) -> str:
        assert prop.module is not None
        module, history = self._system.modules[prop.module], self._histories[prop.module]
        fault = self._evaluation_fault(self._safe[prop.module], c)
        if fault is not None:
            return f"judging `safe` of `{module.name}` faults ({fault_text(fault)})"
        if not self._holds(self._safe[prop.module], c):
            text = module.symbol.safe.span.text_on_one_line
            return f"`{text}`, `safe` of `{module.name}`, fails"
        verdict = f"the DM last said AC at {_time_text(history.last_ac_ns)}"
        if not history.has_said_ac:
            verdict = "the DM has not said AC since the start"
        period = _time_text(module.period_ns)
        acted = "and SC has not acted" if c.L[module.dm] == SC else "and has not handed over to SC"
        return f"{verdict}, {acted} by {_time_text(c.ct)}, more than two periods of {period} later"


def fault_text(fault: StepFault) -> str:
    """The fault and its place in the source: `divide, cart.soter:7`."""
    if fault.span is None:
        return str(fault)
    return f"{fault}, {Path(fault.span.source.name).name}:{fault.span.line}"


def _time_text(time_ns: int) -> str:
    return show_ns(time_ns) if time_ns else "0 ms"
