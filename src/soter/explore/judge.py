"""What is violated in a configuration of a test (docs/testing.md, Configurations).

Purpose: properties, deadlines and invariants along one execution of the reference interpreter.
Non-goals: contracts and step faults, which the step itself tells (`replay.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore.schedule import plan_of
from soter.explore.trace import PROPERTY, TIMED, Broken
from soter.program.arith import StepFault
from soter.program.evaluate import Evaluator
from soter.semantics.properties import violated
from soter.semantics.record import AC, SC, Outcome, Verdict

if TYPE_CHECKING:
    from soter.program.evaluate_expr import Compiled
    from soter.program.system import Module, System, TimedProperty
    from soter.program.typed import Expr
    from soter.semantics.configuration import Configuration
    from soter.semantics.machine import Machine


@dataclass
class _Clock:
    """Of one module: when the DM last said AC (0: the start), and whether SC has acted since."""

    verdict_ns: int = 0
    acted: bool = False


class Judge:
    """Follows one execution; `at` says what is violated where it has come to."""

    def __init__(self, machine: Machine) -> None:
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
        self._clocks = [_Clock() for _ in self._system.modules]
        self._due: dict[int, int] = {
            p.index: p.within_ns for p in plan.timed if p.kind == "eventually"
        }
        self._drop_beyond_horizon()

    def _code(self, prop: TimedProperty, expr: Expr | None) -> Compiled | None:
        return None if expr is None else Evaluator.of(prop.scope, {}).expression(expr)

    def _of_module(self, module: Module) -> Compiled:
        return Evaluator.of(module.scope, {}).expression(module.symbol.safe)

    # ------------------------------------------------------------ what happened

    def note(self, event: Verdict | Outcome, c: Configuration) -> None:
        """A step at `c.ct` that led to `c`."""
        if isinstance(event, Verdict):
            if event.after == AC:
                self._clocks[event.module] = _Clock(c.ct)
        elif event.published:
            self.note_published(event.component, c)

    def note_published(self, component: int, c: Configuration) -> None:
        """What a component published has reached the topics."""
        found = self._system.components[component]
        if found.role == "sc" and found.module is not None:
            module = self._system.modules[found.module]
            if c.L[module.dm] == SC:
                self._clocks[found.module].acted = True

    # ------------------------------------------------------------ what is violated

    def at(self, c: Configuration, *, observable: bool, over: bool) -> list[Broken]:
        """Everything that is violated in `c`; `over`: no step is left."""
        found: list[Broken] = []
        if observable:
            self._meet_deadlines(c)
            found += self._properties(c)
        for p in self._timed:
            if p.kind == "invariant":
                fails = observable and not self._invariant(p, c)
            else:
                due = self._due.get(p.index)
                fails = due is not None and (due < c.ct or over)
            if fails:
                found.append(Broken(TIMED, p.index, p.text))
        return found

    def _properties(self, c: Configuration) -> list[Broken]:
        own = [p for p in self._system.properties if p.component is None]
        values = violated(self._machine, c)
        return [Broken(PROPERTY, p.index, f"{p.kind} {p.text}") for p in own if values[p.index]]

    def _meet_deadlines(self, c: Configuration) -> None:
        """Every deadline that is met by what holds now goes; premises that hold make new ones."""
        for p in self._timed:
            due = self._due.get(p.index)
            if p.kind == "invariant" or (due is not None and due < c.ct):
                continue  # a missed deadline stays missed
            if self._holds(self._condition[p.index], c):
                self._due.pop(p.index, None)
            elif p.kind == "leadsto" and due is None and self._holds(self._premise[p.index], c):
                self._due[p.index] = c.ct + p.within_ns
        self._drop_beyond_horizon()

    def _drop_beyond_horizon(self) -> None:
        """Deadlines beyond the horizon are not judged."""
        self._due = {i: due for i, due in self._due.items() if due <= self._horizon_ns}

    def _holds(self, code: Compiled | None, c: Configuration) -> bool:
        """A condition, false where it faults."""
        assert code is not None
        try:
            return bool(code(self._machine.environment(c)))
        except StepFault:
            return False

    def _invariant(self, p: TimedProperty, c: Configuration) -> bool:
        """(F) safe and an AC verdict is recent enough, or (S) safe and SC has the plant."""
        assert p.module is not None
        module, clock = self._system.modules[p.module], self._clocks[p.module]
        if not self._holds(self._safe[p.module], c):
            return False
        acts = clock.acted and c.L[module.dm] == SC
        return acts or c.ct <= clock.verdict_ns + 2 * module.period_ns
