"""Straight code over several worlds at once, a world a lane.

Purpose: of a step or predicate a second C function that runs it for as many states as a vector
holds (`soter_lanes.h`); the operations of a lane are those of the step. Where anything would fault
in any world, or a branch be taken whose code has no lanes, nothing is changed: the caller lets each
step alone.
Non-goals: who calls it, and when (`campaign/c/soter_lockstep.c`); what ships, which has no lanes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.lanes.lane_code import LaneCode
from soter.codegen.lanes.lane_steps import LaneStep, LaneVerdict
from soter.codegen.lanes.lane_values import BOOL, LaneValues, NotStraight, inline
from soter.core import core
from soter.core.operation_counts import operations_of
from soter.language.model.system import queues_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.codegen.function_context import Frame
    from soter.language.model.system import Component

STATES, OF_WORLD = "given_states", "const uint32_t *"
STEP = (("void *const *", STATES), (OF_WORLD, "flags"), ("uint32_t *", "published"))
VERDICT = (("const void *const *", STATES), ("bool *", "given_verdicts"))


class Lanes(LaneValues):
    """The lanes of one system; NotStraight for a function that has none."""

    def __init__(self, frame: Frame, functions: tuple[core.Function, ...]) -> None:
        super().__init__(frame)
        self.functions = {f.name: f for f in functions}
        self.operations = operations_of(functions)
        self._made: dict[str, str | None] = {}

    # ------------------------------------------------------------ what has lanes

    def step(
        self, component: Component, step: core.NodeStep | core.PlantStep, name: str
    ) -> str | None:
        """The name of the step of a component over lanes; None where it has none."""
        if not self._may(component, step):
            return None
        body = self._tried(lambda: LaneStep(self, component, step).statements())
        if body is None:
            return None
        made = f"{name}_lanes"
        self.definitions.append(c.FunctionDef("bool", made, STEP, body, f"{name}_step"))
        return made

    def verdict(self, p: core.Predicate, name: str, *, negate: bool = False) -> str | None:
        """The name of a predicate over lanes; None where it has none."""
        body = self._tried(lambda: LaneVerdict(self).statements(p, negate=negate))
        if body is None:
            return None
        made = f"{name}_lanes"
        self.definitions.append(c.FunctionDef("bool", made, VERDICT, body, name))
        return made

    def _tried(self, make: Callable[[], list[c.CStmt]]) -> tuple[c.CStmt, ...] | None:
        """What is made; None, and nothing is left of it, where the code is not straight."""
        count = len(self.definitions)
        before = dict(self._types), dict(self._choices), dict(self._made)
        try:
            return tuple(make())
        except NotStraight:
            del self.definitions[count:]
            self._types, self._choices, self._made = before
            return None

    def _may(self, component: Component, step: core.NodeStep | core.PlantStep) -> bool:
        system = self.frame.system
        if component.extern or component.held is not None or queues_of(system, component):
            return False
        if any(f.component == component.index and not f.of_time for f in system.faults):
            return False
        if isinstance(step, core.NodeStep) and step.shield is not None:
            return False
        return not any(o.burst or system.topics[o.topic].queues for o in step.outputs)

    # ------------------------------------------------------------ functions

    def function(self, name: str) -> str:
        """The function of this name over lanes."""
        if name not in self._made:
            self._made[name] = None
            f = self.functions[name]
            if f.result is None:
                raise NotStraight
            made = f"{self.frame.body.functions[name][0]}_lanes"
            body = LaneCode(self)
            parameters = tuple((self.type(p.type), body.local(p.name)) for p in f.parameters)
            body.varying |= {p.name for p in f.parameters}
            statements = (*body.block(f.body), c.Return(body.lane(f.result)))
            if body.loads:
                raise NotStraight
            parameters = (*parameters, (BOOL, "given_mask"), (f"{BOOL} *const ", "outer"))
            inner = body.framed(statements, c.Unary("*", c.Name("outer")))
            made_of = c.FunctionDef(self.type(f.result_type), made, parameters, inner)
            self.definitions.append(inline(made_of))
            self._made[name] = made
        found = self._made[name]
        if found is None:
            raise NotStraight
        return found
