"""What is violated in a configuration of a test (docs/testing.md, Configurations).

Purpose: properties, deadlines and invariants along one execution of the reference interpreter. The
picks of a trace are handed to it one step at a time: whatever a step asks is answered from its own
list, in order, and every question is kept with its answer as a person reads it.
Non-goals: contracts and step faults, which the step itself tells (`explore/replay.py`); what the
alternatives of a question are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.allowed_steps import plan_of
from soter.explore.trace import PROPERTY, TIMED, Choice, ViolationId
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.statements import Evaluator
from soter.language.model.types import FloatType, show_ns
from soter.language.model.values import to_json
from soter.semantics.configuration import AC, SC, DecisionVerdict, StepOutcome
from soter.semantics.draws import AnsweredDraws
from soter.semantics.rules import fault_of, violated

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.evaluate.expressions import Compiled
    from soter.language.model.system import Bound, Module, System, TimedProperty
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type, Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


class WrongChoiceError(Exception):
    """A pick that answers nothing that the step asks; the message says why."""


class TraceDraws(AnsweredDraws):
    """Draws that the steps of a trace answer; the first alternative where a step says nothing."""

    def __init__(self, system: System, seed: int) -> None:
        super().__init__(system, self._pick, seed)
        self._given: dict[str, list[Choice]] = {}
        self._values: list[object] = []
        """What was taken, as JSON, in the order of `asked`; None where the stream does not tell."""

    def begin(self, choices: Iterable[Choice]) -> None:
        """A step begins, which has these picks."""
        self.asked.clear()
        self._values = []
        self._given = {}
        for choice in choices:
            self._given.setdefault(choice.stream, []).append(choice)

    def end(self) -> tuple[Choice, ...]:
        """The step is over: everything it asked. `WrongChoiceError` where picks are left over."""
        for stream, left in self._given.items():
            if left:
                raise WrongChoiceError(f"nothing asks for a choice from `{stream}`")
        pairs = zip(self.asked, self._values, strict=True)
        return tuple([Choice(a.stream, a.pick, a.count, value) for a, value in pairs])

    def tell(self, value: object) -> None:
        """The value, as JSON, that the last answer to `choice` stood for."""
        if self._values:
            self._values[-1] = value

    def _pick(self, stream: str, count: int) -> int:
        left = self._given.get(stream)
        if not left:
            return 0
        choice = left.pop(0)
        if choice.of != count:
            message = f"`{stream}` has {count} alternatives here, not {choice.of}"
            raise WrongChoiceError(message)
        return choice.pick

    # ------------------------------------------------------------ Draws

    def choice(self, stream: str, index: int, count: int) -> int:
        """One of `count` alternatives; what they stand for is not known here."""
        pick = super().choice(stream, index, count)
        self._keep(None)
        return pick

    def uniform(self, stream: str, index: int, low: float, high: float) -> float:
        """A float of [low, high]."""
        value = super().uniform(stream, index, low, high)
        self._keep(value)
        return value

    def leaf(self, t: Type, bound: Bound | None, stream: str, index: int) -> Value:
        """A value of a scalar type within its bound."""
        value = super().leaf(t, bound, stream, index)
        if not isinstance(t, FloatType):  # which `uniform` has kept
            self._keep(to_json(t, value))
        return value

    def _keep(self, value: object) -> None:
        """Beside the question that was asked last, if one was."""
        if len(self.asked) > len(self._values):
            self._values.append(value)


@dataclass
class _ControlHistory:
    """Of one module: when the DM last said AC (0: the start), and whether SC has acted since."""

    verdict_ns: int = 0
    acted: bool = False
    said: bool = False
    """Whether it has said AC at all."""


class Judge:
    """Follows one execution; `at` says what is violated where it has come to."""

    def __init__(self, machine: ExecutableSystem) -> None:
        self._machine = machine
        self._system: System = machine.system
        plan = plan_of(self._system)
        self._timed = plan.timed
        self._horizon_ns = plan.horizon_ns
        self._premise = {p.index: self._code(p, p.premise) for p in plan.timed}
        self._condition = {p.index: self._code(p, p.condition) for p in plan.timed}
        self._safe = {
            p.module: self._of_module(self._system.modules[p.module])
            for p in plan.timed
            if p.module is not None
        }
        self._clocks = [_ControlHistory() for _ in self._system.modules]
        self._due: dict[int, int] = {
            p.index: p.within_ns for p in plan.timed if p.kind == "eventually"
        }
        self._since: dict[int, int] = {}
        """When the premise held that a deadline waits for."""
        self._faulted: dict[int, str] = {}
        """What went wrong, and when, as the condition of a deadline was judged."""
        self._drop_beyond_horizon()

    def _code(self, prop: TimedProperty, expr: TypedExpr | None) -> Compiled | None:
        return None if expr is None else Evaluator.of(prop.scope, {}).expression(expr)

    def _of_module(self, module: Module) -> Compiled:
        return Evaluator.of(module.scope, {}).expression(module.symbol.safe)

    # ------------------------------------------------------------ what happened

    def note(self, event: DecisionVerdict | StepOutcome, c: Configuration) -> None:
        """A step at `c.ct` that led to `c`."""
        if isinstance(event, DecisionVerdict):
            if event.after == AC:
                self._clocks[event.module] = _ControlHistory(c.ct, said=True)
        elif event.published:
            self.note_published(event.component, c)

    def note_published(self, component: int, c: Configuration) -> None:
        """What a component published has reached the topics."""
        publisher = self._system.components[component]
        if publisher.role == "sc" and publisher.module is not None:
            module = self._system.modules[publisher.module]
            if c.L[module.dm] == SC:
                self._clocks[publisher.module].acted = True

    # ------------------------------------------------------------ what is violated

    def at(self, c: Configuration, *, observable: bool, over: bool) -> list[ViolationId]:
        """Everything that is violated in `c`; `over`: no step is left."""
        violations: list[ViolationId] = []
        if observable:
            self._meet_deadlines(c)
            violations += self._properties(c)
        for p in self._timed:
            if p.kind == "invariant":
                fails = observable and not self._invariant(p, c)
            else:
                due = self._due.get(p.index)
                fails = due is not None and (due < c.ct or over)
            if fails:
                violations.append(ViolationId(TIMED, p.index, p.text))
        return violations

    def _properties(self, c: Configuration) -> list[ViolationId]:
        own = [p for p in self._system.properties if p.component is None]
        values = violated(self._machine, c)
        return [
            ViolationId(PROPERTY, p.index, f"{p.kind} {p.text}") for p in own if values[p.index]
        ]

    def _meet_deadlines(self, c: Configuration) -> None:
        """Every deadline that is met by what holds now goes; premises that hold make new ones."""
        for p in self._timed:
            due = self._due.get(p.index)
            if p.kind == "invariant" or (due is not None and due < c.ct):
                continue  # a missed deadline stays missed
            if self._met(p, c):
                self._due.pop(p.index, None)
                self._faulted.pop(p.index, None)
            elif p.kind == "leadsto" and due is None and self._holds(self._premise[p.index], c):
                self._due[p.index] = c.ct + p.within_ns
                self._since[p.index] = c.ct
        self._drop_beyond_horizon()

    def _drop_beyond_horizon(self) -> None:
        """Deadlines beyond the horizon are not judged."""
        self._due = {i: due for i, due in self._due.items() if due <= self._horizon_ns}

    def _met(self, p: TimedProperty, c: Configuration) -> bool:
        """Whether what a deadline waits for holds; false where that faults, which is noted."""
        fault = self._fault(self._condition[p.index], c)
        if fault is not None and p.index in self._due:
            self._faulted.setdefault(p.index, f"{_at(c.ct)}: {fault_text(fault)}")
        return fault is None and self._holds(self._condition[p.index], c)

    def _holds(self, code: Compiled | None, c: Configuration) -> bool:
        """A condition, false where it faults."""
        assert code is not None
        try:
            return bool(code(self._machine.environment(c)))
        except StepFault:
            return False

    def _fault(self, code: Compiled | None, c: Configuration) -> StepFault | None:
        assert code is not None
        try:
            code(self._machine.environment(c))
        except StepFault as fault:
            return fault
        return None

    def _invariant(self, p: TimedProperty, c: Configuration) -> bool:
        """(F) safe and an AC verdict is recent enough, or (S) safe and SC has the plant."""
        assert p.module is not None
        module, clock = self._system.modules[p.module], self._clocks[p.module]
        if not self._holds(self._safe[p.module], c):
            return False
        acts = clock.acted and c.L[module.dm] == SC
        return acts or c.ct <= clock.verdict_ns + 2 * module.period_ns

    # ------------------------------------------------------------ why

    def reason(self, broken: ViolationId, c: Configuration, before: Configuration) -> str:
        """What failed where `at` found a violation in `c`, a clause; empty where it says itself.

        `before`: where the step was made that led to `c`.
        """
        if broken.what != TIMED:
            return self._property_reason(broken.index, c, before)
        p = self._timed[broken.index]
        if p.kind == "invariant":
            return self._invariant_reason(p, c)
        due_ns = self._due[p.index]
        missed = f"`{p.promises}` did not hold in any observable configuration"
        fault = self._faulted.get(p.index)
        faulted = "" if fault is None else f" (judging it faulted at {fault})"
        if p.premise is None:
            return f"{missed} up to {_at(due_ns)}{faulted}"
        held = f"`{p.asks}` held at {_at(self._since[p.index])}"
        return f"{held}, and {missed} from then on up to {_at(due_ns)}{faulted}"

    def _property_reason(self, index: int, c: Configuration, before: Configuration) -> str:
        """Of an `always` or `never`: that judging it faults, and that another step is to blame."""
        fault = fault_of(self._machine, c, index)
        said = [] if fault is None else [f"judging it faults ({fault_text(fault)})"]
        if violated(self._machine, before)[index]:
            said.append(
                "it was false earlier in this instant already; a property is judged after the "
                "last step of an instant, which this is"
            )
        return "; ".join(said)

    def _invariant_reason(self, p: TimedProperty, c: Configuration) -> str:
        assert p.module is not None
        module, clock = self._system.modules[p.module], self._clocks[p.module]
        fault = self._fault(self._safe[p.module], c)
        if fault is not None:
            return f"judging `safe` of `{module.name}` faults ({fault_text(fault)})"
        if not self._holds(self._safe[p.module], c):
            return f"`{_source(module.symbol.safe)}`, `safe` of `{module.name}`, fails"
        said = f"the DM last said AC at {_at(clock.verdict_ns)}"
        if not clock.said:
            said = "the DM has not said AC since the start"
        period = _at(module.period_ns)
        acted = "and SC has not acted" if c.L[module.dm] == SC else "and has not handed over to SC"
        return f"{said}, {acted} by {_at(c.ct)}, more than two periods of {period} later"


def fault_text(fault: StepFault) -> str:
    """What went wrong, and where in the source: `divide, cart.soter:7`."""
    if fault.span is None:
        return str(fault)
    return f"{fault}, {Path(fault.span.source.name).name}:{fault.span.line}"


def _source(e: TypedExpr) -> str:
    return " ".join(e.span.text.split())


def _at(time_ns: int) -> str:
    return show_ns(time_ns) if time_ns else "0 ms"
