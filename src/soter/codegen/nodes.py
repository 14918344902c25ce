"""Steps of nodes in generated C: fail-safe values, steps that take time, queues behind topics.

Purpose: the step function of each node: its Soter code, or an extern that a linked C function or
the driver answers. The outputs of a step that takes time are held in a topic of their own until
they take effect; a value is put into the queues behind its topic, and a lost one is a step fault.
Non-goals: what an extern node sees (`externs.py`), plants (`plants_and_inputs.py`), when a held
publication takes effect (the kernel), what queues hold in memory (`core/layout.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import BranchChoices
from soter.codegen.c_names import field_name
from soter.codegen.c_types import FAULT
from soter.codegen.externs import clean_answer, linked_name, to_ends
from soter.codegen.faults import disturb
from soter.codegen.plants_and_inputs import declare_choices
from soter.codegen.state_access import CT, OK, STEP_PARAMETERS, S, flag_is_set, place_text
from soter.core import core
from soter.language.model.system import queues_of
from soter.language.model.types import BOOL, ListType

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.codegen.state_access import Frame
    from soter.codegen.storage_plan import PlannedBody
    from soter.language.model.system import Component, Topic
    from soter.language.model.typed import NodeSymbol
    from soter.language.model.types import Type


def push_function(frame: Frame, topic: Topic) -> c.FunctionDef:
    """The C function that puts a topic's value into its queues; a full queue follows its policy."""
    body: list[c.CStmt] = [frame.state_pointer()]
    for index in topic.queues:
        queue = frame.system.topics[index]
        assert isinstance(queue.type, ListType)
        items = c.Member(frame.topic_place(index), "items")
        length = c.Member(frame.topic_place(index), "len")
        capacity = queue.type.capacity
        append = (
            c.Assign(c.IndexExpr(items, length), frame.topic_place(topic.index)),
            c.Assign(length, c.Binary("+", length, c.Number("1"))),
        )
        room = c.Binary("<", length, c.Number(str(capacity)))
        if queue.policy == "drop_oldest":
            k = c.Name("k")
            after = c.IndexExpr(items, c.Binary("+", k, c.Number("1")))
            move = (c.Assign(c.IndexExpr(items, k), after),)
            last = c.Number(str(capacity - 1))
            shift = (c.For("k", c.Number("0"), last, move),) if capacity > 1 else ()
            body += [c.IfStmt(c.Unary("!", room), (*shift, c.Assign(length, last))), *append]
        elif queue.policy == "fault":
            lost = c.Assign(_stamp_place(index), c.Name("SOTER_LOST"))
            body.append(c.IfStmt(room, append, (lost,)))
        else:
            body.append(c.IfStmt(room, append))
    doc = f"the queues behind {topic.name}"
    return c.FunctionDef(
        "void", frame.push_name(topic.index), (("void *", "state"),), tuple(body), doc
    )


def _lost_condition(queue: int) -> c.CExpr:
    """The C condition that a queue has lost a value that it may not lose (SOTER_LOST)."""
    return c.Binary("!=", _stamp_place(queue), c.Name("SOTER_NEVER"))


def check_queues(frame: Frame, component: Component) -> list[c.CStmt]:
    """Raises a capacity fault if a queue of the node has lost a value that it may not lose."""
    return [
        c.Do(
            c.CallExpr(
                "soter_guard", (c.Unary("!", _lost_condition(q)), c.Name("SOTER_CAPACITY"), FAULT)
            )
        )
        for q in queues_of(frame.system, component)
        if frame.system.topics[q].policy == "fault"
    ]


def empty_queue(frame: Frame, queue: int) -> c.CStmt:
    """The C that empties a queue."""
    default = frame.types.default_constant(frame.system.topics[queue].type)
    return c.Assign(frame.topic_place(queue), default)


def clear_lost_queues(frame: Frame, component: Component) -> list[c.CStmt]:
    """After a capacity fault, empties the queues that lost a value and clears their mark."""
    overflowed = c.Binary("==", c.Name("status"), c.Name("SOTER_CAPACITY"))
    return [
        c.IfStmt(
            c.Binary("&&", overflowed, _lost_condition(q)),
            (empty_queue(frame, q), c.Assign(_stamp_place(q), c.Name("SOTER_NEVER"))),
        )
        for q in queues_of(frame.system, component)
        if frame.system.topics[q].policy == "fault"
    ]


PARAMETERS = (("void *", "state"),)


def hold(frame: Frame, component: Component, outputs: tuple[core.Output, ...]) -> list[c.CStmt]:
    """Keeps a step's outputs in `held`; the kernel draws how long until they take effect."""
    statements: list[c.CStmt] = [_empty_held(frame, component)]
    published = c.Unary("*", c.Name("published"))
    for k, output in enumerate(outputs):
        note = c.Assign(published, c.Binary("|", published, c.Number(f"{1 << k}U")))
        keep = (
            c.Assign(_held_part(frame, component, "has", k), c.Number("1")),
            c.Assign(_held_part(frame, component, "at", k), CT),
            c.Assign(
                _held_part(frame, component, "out", k),
                frame.types.to_store(output.type, frame.body.out_place(k)),
            ),
        )
        stores = c.IfStmt(flag_is_set("SOTER_ENABLED"), keep)
        statements += frame.if_published(k, [note, stores])
    return statements


def effect_function(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...], name: str
) -> c.FunctionDef:
    """The C function that publishes held outputs, if OE is set, and empties `held`."""
    assert component.held is not None
    component_state = c.IndexExpr(c.Arrow(S, "components"), c.Number(str(component.index)))
    stores = [
        c.IfStmt(
            _held_condition(frame, component, k),
            (
                c.Assign(frame.topic_place(output.topic), _held_part(frame, component, "out", k)),
                c.Assign(_stamp_place(output.topic), CT),
                *frame.push_to_queues(output.topic),
            ),
        )
        for k, output in enumerate(outputs)
    ]
    body = (
        frame.state_pointer(),
        c.IfStmt(c.Binary("!=", c.Member(component_state, "oe"), c.Number("0U")), tuple(stores)),
        _empty_held(frame, component),
        c.Assign(_stamp_place(component.held), c.Name("SOTER_NEVER")),
    )
    doc = f"what {component.name} held takes effect"
    return c.FunctionDef("void", f"{name}_effect", PARAMETERS, body, doc)


def exchange_function(
    frame: Frame, component: Component, outputs: tuple[core.Output, ...], name: str
) -> c.FunctionDef:
    """The C function that exchanges held values and stamps for those of the topics."""
    body: list[c.CStmt] = [frame.state_pointer()]
    for k, output in enumerate(outputs):
        pairs = (
            (frame.types.stored_type(output.type), "value", frame.topic_place(output.topic), "out"),
            ("int64_t", "stamp", _stamp_place(output.topic), "at"),
        )
        swaps: list[c.CStmt] = []
        for type_, kept, topic, part in pairs:
            held = _held_part(frame, component, part, k)
            swaps.append(c.Declare(type_, kept, topic, const=True))
            swaps += [c.Assign(topic, held), c.Assign(held, c.Name(kept))]
        body.append(c.IfStmt(_held_condition(frame, component, k), tuple(swaps)))
    doc = f"what {component.name} holds and what the topics have change places"
    return c.FunctionDef("void", f"{name}_exchange", PARAMETERS, tuple(body), doc)


def _empty_held(frame: Frame, component: Component) -> c.CStmt:
    assert component.held is not None
    t = frame.system.topics[component.held].type
    return c.Assign(frame.topic_place(component.held), frame.types.default_constant(t))


def _held_part(frame: Frame, component: Component, purpose: str, k: int) -> c.CExpr:
    assert component.held is not None
    return c.Member(frame.topic_place(component.held), field_name(f"{purpose}_{k}"))


def _held_condition(frame: Frame, component: Component, k: int) -> c.CExpr:
    return c.Binary("!=", _held_part(frame, component, "has", k), c.Number("0U"))


def _stamp_place(topic: int) -> c.CExpr:
    return c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(topic)))


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
    """The body whose storage is planned; None for an extern.

    Outputs that a fault may change are not planned.
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
    foreign = component.extern
    frame.body.choices = BranchChoices(component.name, None if foreign else frame.branches)
    takeover: list[c.CStmt] = []
    if step.takeover:
        block = tuple(frame.body.translate_block(step.takeover, step.body))
        takeover.append(c.IfStmt(flag_is_set("SOTER_TAKEOVER"), block))
    body = frame.load_locals(step.locals, frame.body.names_used((step.takeover, step.body)))
    nothing_lost = check_queues(frame, component)
    if foreign:
        body += _take_extern_answer(frame, component, step, name, takeover, nothing_lost)
    else:
        body += frame.declare_outputs(step.outputs)
        body += nothing_lost
        body += [
            *declare_choices(component, step.body),
            *takeover,
            *frame.body.translate_block(step.body),
        ]
    body += disturb(frame, component, step.outputs)
    body += frame.check_outputs(step.outputs)
    if step.shield is not None:
        body += frame.body.translate_block(step.shield.body)
    unused = [c.Unused(n) for n in ("s", "flags", "answer", "published")]
    failed = (*frame.restore_locals(step.locals), *clear_lost_queues(frame, component))
    body = [frame.state_pointer(), *unused, *frame.sticky_fault(body, failed)]
    if frame.is_linked(component):
        body += [s for copy in step.locals for s in _commit_linked_local(frame, copy)]
    else:
        body += frame.store_locals(step.locals)
    body += [empty_queue(frame, q) for q in queues_of(frame.system, component)]
    if component.held is None:
        body += frame.publish_outputs(step.outputs, gated=component.role != "node")
        body += _store_shield_memory(frame, step)
    else:
        body += hold(frame, component, step.outputs)
    body.append(c.Return(OK))
    frame.body.choices = None
    return body


def _take_extern_answer(
    frame: Frame,
    component: Component,
    step: core.NodeStep,
    name: str,
    takeover: list[c.CStmt],
    nothing_lost: list[c.CStmt],
) -> list[c.CStmt]:
    """Takes an extern's answer; `takeover` runs before C that keeps locals, else behind it."""
    if frame.is_linked(component):
        answers = _call_linked(frame, component, step, name)
    else:
        answers = _take_answer(frame, component, step, name)
    if frame.is_linked(component) and step.locals:
        body = [*takeover, *answers, *nothing_lost]
    else:
        body = [*answers, *nothing_lost, *takeover]
    for k, o in enumerate(step.outputs):
        at_ends = to_ends(o.type, o.bounds, frame.body.out_place(k))
        body += frame.if_published(k, at_ends) if at_ends else []
    return body


def _store_shield_memory(frame: Frame, step: core.NodeStep) -> list[c.CStmt]:
    """Stores the commands of a step for its shield.

    Published ones only if outputs are enabled (OE; rule n1), proposed ones always.
    """
    shield = step.shield
    if shield is None:
        return []
    some: c.CExpr = c.Name("false")
    for k in range(len(step.outputs)):
        has = c.Name("true") if k in frame.body.certain else frame.body.has_flag(k)
        some = has if k == 0 else c.Binary("||", some, has)
    kept = _store_hidden_topic(frame, shield.cell, shield.name, shield.type)
    stores: list[c.CStmt] = [c.IfStmt(c.Binary("&&", flag_is_set("SOTER_ENABLED"), some), kept)]
    if shield.proposed is not None:
        stores.append(c.IfStmt(some, _store_hidden_topic(frame, *shield.proposed)))
    return stores


def _store_hidden_topic(frame: Frame, cell: core.Cell, name: str, t: Type) -> tuple[c.CStmt, ...]:
    """Stores the value of temporary `name` in a hidden topic, with the time of this step."""
    stored = frame.types.commit_value(frame.cell_place(cell), t, frame.body.place(name))
    return (*stored, c.Assign(_stamp_place(cell.owner), CT))


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
                frame.types.to_store(x.type, c.Name(frame.body.c_name(x.name))),
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
    statements += _clean_got(node)
    return statements + _copy_outputs(frame, node, lambda field: c.Member(c.Name("got"), field))


def _commit_linked_local(frame: Frame, copy: core.LocalCopy) -> list[c.CStmt]:
    """Commits a local that a linked C function may have changed."""
    new = c.Member(c.Name("kept"), field_name(copy.cell.name))
    return frame.types.commit_value(frame.cell_place(copy.cell), copy.type, new)


def _take_answer(
    frame: Frame, component: Component, step: core.NodeStep, name: str
) -> list[c.CStmt]:
    """Takes an extern node's outputs from the driver's answer; without an answer it faults."""
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
            *_clean_got(node),
            *_copy_outputs(frame, node, lambda field: c.Member(got, field)),
        ]
    return [
        *frame.declare_outputs(step.outputs),
        c.Declare(f"const {name}_out *const ", "got", c.Name("answer")),
        c.IfStmt(c.Binary("==", got, c.Name("NULL")), nothing),
        *_copy_outputs(frame, node, lambda field: c.Arrow(got, field)),
    ]


def _clean_got(node: NodeSymbol) -> list[c.CStmt]:
    """Turns the parts of `got` into values of their types, or raises the fault `extern`."""
    statements: list[c.CStmt] = []
    for topic in node.publishes:
        short = topic.name.rsplit(".", 1)[-1]
        cleaned = clean_answer(node.given(topic), c.Member(c.Name("got"), field_name(short)))
        has = c.Member(c.Name("got"), field_name(f"has_{short}"))
        if cleaned:
            statements.append(c.IfStmt(c.Binary("!=", has, c.Number("0")), tuple(cleaned)))
    return statements


def _copy_outputs(frame: Frame, node: NodeSymbol, part: Callable[[str], c.CExpr]) -> list[c.CStmt]:
    """Copies the outputs that an extern gave; `part` gives the C of a field of its answer."""
    statements: list[c.CStmt] = []
    for k, topic in enumerate(node.publishes):
        short = topic.name.rsplit(".", 1)[-1]
        taken = (
            c.Assign(frame.body.out_place(k), part(field_name(short))),
            c.Assign(frame.body.has_flag(k), c.Name("true")),
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
        body.append(c.Assign(frame.topic_place(index), frame.types.to_store(t, constant)))
        body.append(c.Assign(_stamp_place(index), CT))
        body += frame.push_to_queues(index)
    return c.FunctionDef("void", f"{name}_failsafe", (("void *", "state"),), tuple(body))
