"""What is violated in a configuration of a test (docs/testing.md, Configurations).

Purpose: properties, deadlines and invariants along one execution of the reference interpreter.
Non-goals: contracts and step faults, which the step itself tells
(`verify/attack/counterexample.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.explore.trace.allowed_steps import plan_of
from soter.explore.trace.trace import PROPERTY, TIMED, ViolationId
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.statements import Evaluator
from soter.language.model.durations import show_ns
from soter.semantics.observer_records import AC, SC, DecisionVerdict, StepOutcome
from soter.semantics.properties import fault_of, violated

if TYPE_CHECKING:
    from soter.language.evaluate.expressions import Compiled
    from soter.language.model.system import Module, System, TimedProperty
    from soter.language.model.typed import TypedExpr
    from soter.semantics.configuration import Configuration
    from soter.semantics.executable_system import ExecutableSystem


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
                "it failed before this step already, but is judged where time passes, "
                "after the last step of an instant"
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
