"""Steps of nodes, and their fail-safe values.

Purpose: what `soter_step_fn` of the kernel's tables is for a node: of Soter, a linked C function,
or answered by the driver.
Non-goals: what an extern node sees (`extern_interface.py`), plants (`plants.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.body import BranchChoices
from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.c.types import FAULT
from soter.codegen.delayed_publication import hold
from soter.codegen.extern_interface import linked_name
from soter.codegen.extern_results import received, to_ends
from soter.codegen.faults import disturb
from soter.codegen.function_context import CT, OK, STEP_PARAMETERS, S, enabled, where
from soter.codegen.queues import empty, forgive, must_not_lose
from soter.codegen.random_draws import choosing
from soter.core import core
from soter.language.model.system import queues_of
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.codegen.function_context import Frame
    from soter.codegen.storage.storage_plan import PlannedBody
    from soter.language.model.system import Component
    from soter.language.model.typed import NodeSymbol
    from soter.language.model.types import Type


def node_step(frame: Frame, component: Component, step: core.NodeStep, name: str) -> c.FunctionDef:
    """The step of a node."""
    certain = frozenset[int]() if component.extern else frame.certain(component, step)
    in_place = frozenset[str]() if component.extern else frame.in_place(step.locals)
    with frame.body.planned(_task(frame, component, step), certain, in_place):
        body = tuple(_step(frame, component, step, name))
    assert component.node is not None
    doc = f"{component.role} {component.node.name}, {where(step.span)}"
    return c.FunctionDef("soter_fault", f"{name}_step", STEP_PARAMETERS, body, doc)


def _task(frame: Frame, component: Component, step: core.NodeStep) -> PlannedBody | None:
    """What is to be planned; what an extern or a fault writes keeps its own place."""
    if component.extern:
        return None
    disturbed = any(f.component == component.index for f in frame.system.faults)
    bursts = any(o.burst for o in step.outputs)
    first = core.If(step.span, core.Const(BOOL, True), step.takeover, ())
    shield = step.shield
    moves = shield is not None and shield.proposed is not None
    outputs = () if disturbed or bursts or moves else step.outputs
    if shield is None:
        return frame.task((first, *step.body), step.locals, outputs)
    code = (first, *step.body, *shield.body)
    later = (shield.name,) if shield.proposed is None else (shield.name, shield.proposed[1])
    return frame.task(code, step.locals, outputs, later)


def _step(frame: Frame, component: Component, step: core.NodeStep, name: str) -> list[c.CStmt]:
    c_source = frame.linked(component)
    foreign = component.extern
    used = frame.body.used((step.takeover, step.body))
    branches = None if foreign else frame.branches
    frame.body.choices = BranchChoices(component.name, branches)
    takeover: list[c.CStmt] = []
    if step.takeover:
        block = tuple(frame.body.block(step.takeover, step.body))
        takeover.append(c.IfStmt(enabled("SOTER_TAKEOVER"), block))
    body = frame.load(step.locals, used)
    nothing_lost = must_not_lose(frame, component)
    if foreign and c_source and step.locals:
        body += [*takeover, *_linked(frame, component, step, name), *nothing_lost]
    elif foreign:
        outputs = _linked if c_source else _answered
        body += [*outputs(frame, component, step, name), *nothing_lost, *takeover]
    if foreign:
        for k, o in enumerate(step.outputs):
            at_ends = to_ends(o.type, o.bounds, frame.body.out(k))
            body += frame.if_published(k, at_ends) if at_ends else []
    else:
        body += frame.declare_outputs(step.outputs)
        body += nothing_lost
        body += [*choosing(component, step.body), *takeover, *frame.body.block(step.body)]
    body += disturb(frame, component, step.outputs)
    body += frame.check_outputs(step.outputs)
    if step.shield is not None:
        body += frame.body.block(step.shield.body)
    unused = [c.Unused(n) for n in ("s", "flags", "answer", "published")]
    failed = (*frame.restore(step.locals), *forgive(frame, component))
    body = [frame.state_pointer(), *unused, *frame.sticky(body, failed)]
    if foreign and c_source:
        body += [s for copy in step.locals for s in _keep(frame, copy)]
    else:
        body += frame.store(step.locals)
    body += [empty(frame, q) for q in queues_of(frame.system, component)]
    if component.held is None:
        body += frame.publish(step.outputs, gated=component.role != "node")
        body += _held(frame, step)
    else:
        body += hold(frame, component, step.outputs)
    body.append(c.Return(OK))
    frame.body.choices = None
    return body


def _held(frame: Frame, step: core.NodeStep) -> list[c.CStmt]:
    """What the shield remembers of the commands that were published (n1: only if OE).

    And of those that were proposed, whether or not they were.
    """
    shield = step.shield
    if shield is None:
        return []
    some: c.CExpr = c.Name("false")
    for k in range(len(step.outputs)):
        has = c.Name("true") if k in frame.body.certain else frame.body.has(k)
        some = has if k == 0 else c.Binary("||", some, has)
    kept = _kept(frame, shield.cell, shield.name, shield.type)
    stores: list[c.CStmt] = [c.IfStmt(c.Binary("&&", enabled("SOTER_ENABLED"), some), kept)]
    if shield.proposed is not None:
        stores.append(c.IfStmt(some, _kept(frame, *shield.proposed)))
    return stores


def _kept(frame: Frame, cell: core.Cell, name: str, t: Type) -> tuple[c.CStmt, ...]:
    """A topic takes the value of a temporary."""
    stamp = c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(cell.owner)))
    return (*frame.types.commit(frame.cell(cell), t, frame.body.place(name)), c.Assign(stamp, CT))


def _linked(frame: Frame, component: Component, step: core.NodeStep, name: str) -> list[c.CStmt]:
    """Outputs of an extern node from a linked C function, which also gets its locals."""
    node = component.node
    assert node is not None
    assert component.binding is not None
    in_fields = tuple(
        (
            field_name(x.topic.name.rsplit(".", 1)[-1]),
            frame.topic(component.scope.topics[x.topic]),
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
                frame.types.to_store(x.type, c.Name(frame.body.local(x.name))),
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
        statements += received(x.type, c.Member(c.Name("kept"), field_name(x.cell.name)))
    statements += _cleaned(node)
    return statements + _given(frame, node, lambda field: c.Member(c.Name("got"), field))


def _keep(frame: Frame, copy: core.LocalCopy) -> list[c.CStmt]:
    """Commit a local that a linked C function may have changed."""
    new = c.Member(c.Name("kept"), field_name(copy.cell.name))
    return frame.types.commit(frame.cell(copy.cell), copy.type, new)


def _answered(frame: Frame, component: Component, step: core.NodeStep, name: str) -> list[c.CStmt]:
    """Outputs of an extern node from the driver's answer."""
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
            *_cleaned(node),
            *_given(frame, node, lambda field: c.Member(got, field)),
        ]
    return [
        *frame.declare_outputs(step.outputs),
        c.Declare(f"const {name}_out *const ", "got", c.Name("answer")),
        c.IfStmt(c.Binary("==", got, c.Name("NULL")), nothing),
        *_given(frame, node, lambda field: c.Arrow(got, field)),
    ]


def _cleaned(node: NodeSymbol) -> list[c.CStmt]:
    """Make `got` values of their types, or raise the fault `extern`."""
    statements: list[c.CStmt] = []
    for topic in node.publishes:
        short = topic.name.rsplit(".", 1)[-1]
        cleaned = received(node.given(topic), c.Member(c.Name("got"), field_name(short)))
        has = c.Member(c.Name("got"), field_name(f"has_{short}"))
        if cleaned:
            statements.append(c.IfStmt(c.Binary("!=", has, c.Number("0")), tuple(cleaned)))
    return statements


def _given(frame: Frame, node: NodeSymbol, part: Callable[[str], c.CExpr]) -> list[c.CStmt]:
    """Take over the outputs that an extern gave."""
    statements: list[c.CStmt] = []
    for k, topic in enumerate(node.publishes):
        short = topic.name.rsplit(".", 1)[-1]
        taken = (
            c.Assign(frame.body.out(k), part(field_name(short))),
            c.Assign(frame.body.has(k), c.Name("true")),
        )
        has: c.CExpr = c.Binary("!=", part(field_name(f"has_{short}")), c.Number("0"))
        if topic in node.bursts:  # no message is no publication
            some = c.Binary(">", c.Member(part(field_name(short)), "len"), c.Number("0"))
            has = c.Binary("&&", has, some)
        statements.append(c.IfStmt(has, taken))
    return statements


def failsafe(frame: Frame, component: Component, name: str) -> c.FunctionDef | None:
    """Publishes the declared fail-safe values of a node."""
    if not component.failsafe:
        return None
    body: list[c.CStmt] = [frame.state_pointer()]
    for index, value in component.failsafe.items():
        t = frame.system.topics[index].type
        constant = frame.types.constant(t, value, "failsafe")
        body.append(c.Assign(frame.topic(index), frame.types.to_store(t, constant)))
        body.append(c.Assign(c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(index))), CT))
        body += frame.push_on(index)
    return c.FunctionDef("void", f"{name}_failsafe", (("void *", "state"),), tuple(body))
