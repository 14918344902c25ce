"""Steps of nodes in generated C.

Purpose: the step function of each node: its Soter code, or an extern that a linked C function or
the driver answers; and the function that publishes fail-safe values.
Non-goals: what an extern node sees (`externs.py`), plants (`plants_and_inputs.py`), queues
(`queues.py`), outputs of steps that take time (`held_outputs.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import BranchChoices
from soter.codegen.c_names import field_name
from soter.codegen.c_types import FAULT
from soter.codegen.externs import clean_answer, linked_name, move_to_ends
from soter.codegen.faults import disturb_outputs
from soter.codegen.held_outputs import hold_outputs
from soter.codegen.plants_and_inputs import declare_choices
from soter.codegen.queues import check_queues, clear_lost_queues, empty_queue
from soter.codegen.state_access import (
    CT,
    OK,
    STEP_PARAMETERS,
    S,
    flag_is_set,
    place_text,
    stamp_place,
)
from soter.core import core
from soter.language.model.system import queues_read_by
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.codegen.state_access import Frame
    from soter.codegen.storage_plan import PlannedBody
    from soter.language.model.system import Component
    from soter.language.model.typed import NodeSymbol
    from soter.language.model.types import Type


def node_step_function(
    frame: Frame, component: Component, step: core.NodeStep, name: str
) -> c.FunctionDef:
    """The C function of one step of a node."""
    certain = frozenset[int]() if component.extern else frame.sure_outputs(component, step)
    in_place = frozenset[str]() if component.extern else frame.locals_in_place(step.locals)
    with frame.body.plan_body(_body_to_plan(frame, component, step), certain, in_place):
        body = tuple(_step_statements(frame, component, step, name))
    assert component.node is not None
    doc = f"{component.role} {component.node.name}, {place_text(step.span)}"
    return c.FunctionDef("soter_fault", f"{name}_step", STEP_PARAMETERS, body, doc)


def _body_to_plan(frame: Frame, component: Component, step: core.NodeStep) -> PlannedBody | None:
    """The body of a step for the storage plan; None for an extern.

    It has no outputs if a fault may change them, one is a burst, or a shield moves commands.
    """
    if component.extern:
        return None
    disturbed = any(f.component == component.index for f in frame.system.faults)
    bursts = any(o.burst for o in step.outputs)
    first = core.If(step.span, core.Const(BOOL, True), step.takeover, ())
    shield = step.shield
    moves = shield is not None and shield.proposed is not None
    outputs = () if disturbed or bursts or moves else step.outputs
    if shield is None:
        return frame.body_to_plan((first, *step.body), step.locals, outputs)
    code = (first, *step.body, *shield.body)
    later = (shield.name,) if shield.proposed is None else (shield.name, shield.proposed[1])
    return frame.body_to_plan(code, step.locals, outputs, later)


def _step_statements(
    frame: Frame, component: Component, step: core.NodeStep, name: str
) -> list[c.CStmt]:
    """The statements of a step: first those that may fault, then those that change the state.

    The C loads the locals and checks that no queue lost a value. Next come a takeover, the body,
    the faults that the system injects, the checks of outputs, and the shield. If any of these
    faults, the step returns, and the locals are unchanged. Then the C stores the locals, empties
    the queues it read, and publishes the outputs, or holds them if the step takes time. An extern
    answers before its queues are checked, as in the interpreter.
    """
    foreign = component.extern
    frame.body.choices = BranchChoices(component.name, None if foreign else frame.branches)
    takeover: list[c.CStmt] = []
    if step.takeover:
        block = tuple(frame.body.translate_block(step.takeover, step.body))
        takeover.append(c.IfStmt(flag_is_set("SOTER_TAKEOVER"), block))
    body = frame.load_locals(step.locals, frame.body.names_used((step.takeover, step.body)))
    loss_checks = check_queues(frame, component)
    if foreign:
        body += _take_extern_answer(frame, component, step, name, takeover, loss_checks)
    else:
        body += frame.declare_outputs(step.outputs)
        body += loss_checks
        body += [
            *declare_choices(component, step.body),
            *takeover,
            *frame.body.translate_block(step.body),
        ]
    body += disturb_outputs(frame, component, step.outputs)
    body += frame.check_outputs(step.outputs)
    if step.shield is not None:
        body += frame.body.translate_block(step.shield.body)
    unused = [c.Unused(n) for n in ("s", "flags", "answer", "published")]
    failed = (*frame.restore_locals(step.locals), *clear_lost_queues(frame, component))
    body = [frame.state_pointer(), *unused, *frame.checked_code(body, failed)]
    if frame.is_linked(component):
        body += [s for copy in step.locals for s in _commit_linked_local(frame, copy)]
    else:
        body += frame.store_locals(step.locals)
    body += [empty_queue(frame, q) for q in queues_read_by(frame.system, component)]
    if component.held is None:
        body += frame.publish_outputs(step.outputs, gated=component.role != "node")
        body += _store_shield_memory(frame, step)
    else:
        body += hold_outputs(frame, component, step.outputs)
    body.append(c.Return(OK))
    frame.body.choices = None
    return body


def _take_extern_answer(
    frame: Frame,
    component: Component,
    step: core.NodeStep,
    name: str,
    takeover: list[c.CStmt],
    loss_checks: list[c.CStmt],
) -> list[c.CStmt]:
    """Takes an extern's answer; `takeover` runs before linked C that has locals, else after it."""
    if frame.is_linked(component):
        answers = _call_linked(frame, component, step, name)
    else:
        answers = _take_driver_answer(frame, component, step, name)
    if frame.is_linked(component) and step.locals:
        body = [*takeover, *answers, *loss_checks]
    else:
        body = [*answers, *loss_checks, *takeover]
    for k, o in enumerate(step.outputs):
        at_ends = move_to_ends(o.type, o.bounds, frame.body.output_place(k))
        body += frame.code_if_published(k, at_ends) if at_ends else []
    return body


def _store_shield_memory(frame: Frame, step: core.NodeStep) -> list[c.CStmt]:
    """Stores the commands of a step for its shield.

    It stores proposed commands always, published ones only if outputs are enabled (OE; rule n1).
    """
    shield = step.shield
    if shield is None:
        return []
    some: c.CExpr = c.Name("false")
    for k in range(len(step.outputs)):
        has = c.Name("true") if k in frame.body.certain else frame.body.flag_of(k)
        some = has if k == 0 else c.Binary("||", some, has)
    kept = _store_hidden_topic(frame, shield.cell, shield.name, shield.type)
    stores: list[c.CStmt] = [c.IfStmt(c.Binary("&&", flag_is_set("SOTER_ENABLED"), some), kept)]
    if shield.proposed is not None:
        stores.append(c.IfStmt(some, _store_hidden_topic(frame, *shield.proposed)))
    return stores


def _store_hidden_topic(frame: Frame, cell: core.Cell, name: str, t: Type) -> tuple[c.CStmt, ...]:
    """Stores the value of the temporary `name` in a hidden topic, with the time of this step."""
    stored = frame.types.commit_value(frame.cell_place(cell), t, frame.body.place_of(name))
    return (*stored, c.Assign(stamp_place(cell.owner), CT))


def _call_linked(
    frame: Frame, component: Component, step: core.NodeStep, name: str
) -> list[c.CStmt]:
    """Calls the linked C function of an extern node, with its locals, and takes its outputs."""
    node = component.node
    assert node is not None
    assert component.binding is not None
    in_fields = tuple(
        (
            field_name(x.topic.name.rsplit(".", 1)[-1]),
            frame.topic_place(component.scope.topics[x.topic]),
        )
        for x in node.subscribes
    )
    inputs = c.Initializer(in_fields or ((None, c.Number("0")),))
    statements = frame.declare_outputs(step.outputs)
    statements.append(c.Declare(f"{name}_in", "in", inputs, const=True))
    statements.append(c.Declare(f"{name}_out", "got", c.Initializer(())))
    arguments: list[c.CExpr] = [c.Unary("&", c.Name("in"))]
    if step.locals:
        group = c.Arrow(S, frame.groups[component.index])
        statements.append(c.Declare(f"{name}_local", "kept", group))
        statements += [
            c.Assign(
                c.Member(c.Name("kept"), field_name(x.cell.name)),
                frame.types.as_stored(x.type, c.Name(frame.body.c_name(x.name))),
            )
            for x in step.locals
            if x.written
        ]
        failed = c.Binary("!=", c.Name("status"), OK)
        if step.takeover:
            statements.append(c.IfStmt(failed, (c.Return(c.Name("status")),)))
        arguments.append(c.Unary("&", c.Name("kept")))
    arguments.append(c.Unary("&", c.Name("got")))
    call = c.CallExpr(linked_name(name), tuple(arguments))
    fine = c.Binary("==", call, c.Number("0"))
    statements.append(c.Do(c.CallExpr("soter_guard", (fine, c.Name("SOTER_EXTERN_FAULT"), FAULT))))
    for x in step.locals:
        statements += clean_answer(x.type, c.Member(c.Name("kept"), field_name(x.cell.name)))
    statements += _clean_outputs(node)
    return statements + _copy_outputs(frame, node, lambda field: c.Member(c.Name("got"), field))


def _commit_linked_local(frame: Frame, copy: core.LocalCopy) -> list[c.CStmt]:
    """Commits a local that a linked C function may have changed."""
    new = c.Member(c.Name("kept"), field_name(copy.cell.name))
    return frame.types.commit_value(frame.cell_place(copy.cell), copy.type, new)


def _take_driver_answer(
    frame: Frame, component: Component, step: core.NodeStep, name: str
) -> list[c.CStmt]:
    """Takes an extern node's outputs from the driver's answer; raises a fault without an answer."""
    node = component.node
    assert node is not None
    got = c.Name("got")
    nothing = (c.Return(c.Name("SOTER_EXTERN_FAULT")),)
    if component.index in frame.apart:
        return [
            *frame.declare_outputs(step.outputs),
            c.IfStmt(c.Binary("==", c.Name("answer"), c.Name("NULL")), nothing),
            c.Declare(f"const {name}_out *const ", "sent", c.Name("answer")),
            c.Declare(f"{name}_out", "got", c.Unary("*", c.Name("sent"))),
            *_clean_outputs(node),
            *_copy_outputs(frame, node, lambda field: c.Member(got, field)),
        ]
    return [
        *frame.declare_outputs(step.outputs),
        c.Declare(f"const {name}_out *const ", "got", c.Name("answer")),
        c.IfStmt(c.Binary("==", got, c.Name("NULL")), nothing),
        *_copy_outputs(frame, node, lambda field: c.Arrow(got, field)),
    ]


def _clean_outputs(node: NodeSymbol) -> list[c.CStmt]:
    """Turns the outputs in `got` into values of their types, or raises the fault `extern`."""
    statements: list[c.CStmt] = []
    for topic in node.publishes:
        short = topic.name.rsplit(".", 1)[-1]
        cleaned = clean_answer(node.answer_type(topic), c.Member(c.Name("got"), field_name(short)))
        has = c.Member(c.Name("got"), field_name(f"has_{short}"))
        if cleaned:
            statements.append(c.IfStmt(c.Binary("!=", has, c.Number("0")), tuple(cleaned)))
    return statements


def _copy_outputs(frame: Frame, node: NodeSymbol, part: Callable[[str], c.CExpr]) -> list[c.CStmt]:
    """Copies the outputs of an extern's answer; `part` gives the C of a field of the answer."""
    statements: list[c.CStmt] = []
    for k, topic in enumerate(node.publishes):
        short = topic.name.rsplit(".", 1)[-1]
        taken = (
            c.Assign(frame.body.output_place(k), part(field_name(short))),
            c.Assign(frame.body.flag_of(k), c.Name("true")),
        )
        has: c.CExpr = c.Binary("!=", part(field_name(f"has_{short}")), c.Number("0"))
        if topic in node.bursts:  # no message is no publication
            some = c.Binary(">", c.Member(part(field_name(short)), "len"), c.Number("0"))
            has = c.Binary("&&", has, some)
        statements.append(c.IfStmt(has, taken))
    return statements


def failsafe_function(frame: Frame, component: Component, name: str) -> c.FunctionDef | None:
    """The C function that publishes a component's fail-safe values; None if it has none."""
    if not component.failsafe:
        return None
    body: list[c.CStmt] = [frame.state_pointer()]
    for index, value in component.failsafe.items():
        t = frame.system.topics[index].type
        constant = frame.types.constant(t, value, "failsafe")
        body.append(c.Assign(frame.topic_place(index), frame.types.as_stored(t, constant)))
        body.append(c.Assign(stamp_place(index), CT))
        body += frame.push_to_queues(index)
    return c.FunctionDef("void", f"{name}_failsafe", (("void *", "state"),), tuple(body))
