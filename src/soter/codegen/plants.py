"""Steps of plants.

Purpose: what `soter_step_fn` of the kernel's tables is for a plant: disturbances, integration,
what is measured with which error.
Non-goals: integration itself (`core/plants.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.body import BranchChoices
from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.c.types import int_number
from soter.codegen.faults import disturb, leaf_of, scaled
from soter.codegen.function_context import CT, OK, STEP_PARAMETERS, enabled, where
from soter.codegen.random_draws import assemble, choosing, in_order, uniform
from soter.core import core
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from soter.codegen.function_context import Frame
    from soter.language.model.system import Component


def plant_step(
    frame: Frame, component: Component, step: core.PlantStep, name: str
) -> c.FunctionDef:
    """One release of a plant."""
    once = core.If(step.span, core.Const(BOOL, True), step.integrate, ())
    task = frame.task((*step.choose, once, *step.publish), step.states)
    with frame.body.planned(None if step.extern else task, frame.certain(component, step)):
        body = tuple(_step(frame, component, step, name))
    assert component.plant is not None
    doc = f"plant {component.plant.name}, {where(step.span)}"
    return c.FunctionDef("soter_fault", f"{name}_step", STEP_PARAMETERS, body, doc)


def _step(frame: Frame, component: Component, step: core.PlantStep, name: str) -> list[c.CStmt]:
    first = c.Name("first")
    is_first = c.Declare("bool", "first", enabled("SOTER_FIRST"), const=True)
    code = (*step.choose, *step.integrate, *step.publish)
    used = frame.body.used(code)
    frame.body.choices = BranchChoices(component.name, chance=step.extern)
    body = frame.load(step.states, used)
    body += _disturbances(frame, component, step, used)
    body += frame.declare_outputs(step.outputs)
    body += choosing(component, code)
    body += frame.body.block(step.choose, step.integrate, step.publish)
    if step.extern:
        body += _new_states(frame, step, name)
    elif step.integrate:
        inner = frame.body.block(step.integrate, step.publish)
        body.append(c.IfStmt(c.Unary("!", first), tuple(inner)))
    body += frame.body.block(step.publish)
    body += _noise(frame, component, step)
    body += disturb(frame, component, step.outputs)
    body += frame.check_outputs(step.outputs)
    unused = [c.Unused(n) for n in ("s", "flags", "answer", "published", "first")]
    body = [frame.state_pointer(), is_first, *unused, *frame.sticky(body)]
    body += frame.store(step.states)
    body += frame.publish(step.outputs, gated=False)
    body.append(c.Return(OK))
    frame.body.choices = None
    return body


def _disturbances(
    frame: Frame, component: Component, step: core.PlantStep, used: set[str]
) -> list[c.CStmt]:
    if not any(n in used for n, _, _ in step.disturbances):
        return []
    began = c.Ternary(
        c.Name("first"), c.Number("0"), c.Binary("-", CT, int_number(component.period_ns))
    )
    statements: list[c.CStmt] = [c.Declare("int64_t", "began", began, const=True)]
    for number, (name, t, draws) in enumerate(step.disturbances):
        if name in used:
            chance = [_draw(d, component, c.Name("began")) for d in draws]
            drawn = [scaled(frame, component, number, e) for e in chance]
            own = frame.body.local(name)
            before, values = in_order([("double", e) for e in drawn], f"drawn_{own}")
            value = assemble(frame.types, t, iter(values))
            statements += [*before, c.Declare(frame.types.work(t), own, value, const=True)]
    return statements


def _draw(draw: core.Draw, component: Component, at: c.CExpr) -> c.CExpr:
    """A disturbance: one that holds is drawn by chance, whoever answers."""
    hold = draw.hold_ns if draw.hold_ns > 0 else component.period_ns
    index = c.Binary("/", at, int_number(hold))
    chance = draw.hold_ns > 0 or component.extern
    return uniform(draw.stream, index, draw.low, draw.high, chance=chance)


def _new_states(frame: Frame, step: core.PlantStep, name: str) -> list[c.CStmt]:
    """An extern plant: the driver's answer holds the new states."""
    got = c.Name("got")
    statements: list[c.CStmt] = [c.Declare(f"const {name}_out *const ", "got", c.Name("answer"))]
    assigns = tuple(
        c.Assign(c.Name(frame.body.local(x.name)), c.Arrow(got, field_name(x.cell.name)))
        for x in step.states
    )
    statements.append(c.IfStmt(c.Binary("!=", got, c.Name("NULL")), assigns))
    return statements


def _noise(frame: Frame, component: Component, step: core.PlantStep) -> list[c.CStmt]:
    """Measurement errors, leaf by leaf."""
    statements: list[c.CStmt] = []
    index = c.Binary("/", CT, int_number(component.period_ns))
    for output, leaf, draw in step.noise:
        target = leaf_of(frame.body.out(output), step.outputs[output].type, leaf)
        error = uniform(draw.stream, index, draw.low, draw.high, chance=component.extern)
        statements.append(c.Assign(target, c.Binary("+", target, error)))
    return statements
