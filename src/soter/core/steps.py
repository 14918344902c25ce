"""Lowers nodes, decision modules and properties.

Purpose: what each component does in one release, as Core with its footprint.
Non-goals: plants (`plants.py`), the kernel's part (gate, switching, calendars).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_check import broken_promises
from soter.core.core_walks import cells_of_publication, footprint_of, written_names
from soter.core.lower_expressions import positions_and_types, select
from soter.core.lower_statements import Builder, FunctionTable
from soter.core.plants import lower_plant
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.evaluate.predicates import maybe_nan, operands_compared_in
from soter.language.model import typed
from soter.language.model.read_together import permits_on_close_reads
from soter.language.model.system import queues_read_by
from soter.language.model.tree_walk import premise_of
from soter.language.model.types import BOOL, FLOAT, INT, ArrayType, RecordType

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import (
        Component,
        Module,
        Property,
        Scope,
        System,
        TimedProperty,
        Topic,
    )
    from soter.language.model.types import Type


def outputs_of(system: System, component: Component) -> tuple[core.Output, ...]:
    """Gives the outputs of a node with the bounds that the gate checks."""
    node, topics = component.node, component.scope.topics
    assert node is not None
    return tuple(
        core.Output(
            topics[t], node.answer_type(t), system.topics[topics[t]].bounds, t in node.bursts
        )
        for t in node.publishes
    )


def lower_node(functions: FunctionTable, system: System, component: Component) -> core.NodeStep:
    """Gives the step of a node in Core; the step of an extern node has no body."""
    node = component.node
    assert node is not None
    builder = Builder(functions, system, component.scope)
    builder.period_ns = component.period_ns
    builder.outputs = {t: i for i, t in enumerate(node.publishes)}
    names = [(v, builder.name_variable(v)) for v in node.locals]
    takeover: tuple[core.Stmt, ...] = ()
    if node.takeover is not None:
        builder.lower_block(node.takeover)
        takeover = builder.take_statements()
    builder.lower_block(node.step)
    body = builder.take_statements()
    written = written_names((*takeover, *body))
    copies = tuple(
        core.LocalCopy(core.Cell("local", component.index, v.name), name, v.type, name in written)
        for v, name in names
    )
    outputs = outputs_of(system, component)
    footprint = footprint_of((*takeover, *body))
    footprint.reads |= {copy.cell for copy in copies}
    footprint.writes |= {copy.cell for copy in copies if copy.written}
    if component.extern:
        footprint.reads |= {builder.topic_cell(s.topic) for s in node.subscribes}
    for q in queues_read_by(system, component):
        cell = core.Cell("topic", q, system.topics[q].name)
        footprint.reads.add(cell)
        footprint.writes.add(cell)
        if system.topics[q].policy == "fault":
            footprint.stamps.add(q)
    for o in outputs:
        footprint.writes.update(cells_of_publication(system, o.topic))
        footprint.stamps.add(o.topic)
    step = core.NodeStep(component.index, copies, takeover, body, outputs, footprint, node.span)
    step.shield = _lower_shield(builder, component, outputs)
    if step.shield is not None:
        seen = footprint_of(step.shield.body)
        footprint.reads |= seen.reads
        footprint.stamps |= {*seen.stamps, step.shield.cell.owner}
        footprint.writes.add(step.shield.cell)
        if step.shield.proposed is not None:
            footprint.stamps.add(step.shield.proposed[0].owner)
            footprint.writes.add(step.shield.proposed[0])
    assert not (found := broken_promises(system, functions.by_name, step)), found
    return step


def _lower_shield(
    builder: Builder, component: Component, outputs: tuple[core.Output, ...]
) -> core.ShieldStep | None:
    """Gives the step of the shield that judges a controller's commands; None without a shield."""
    system = builder.system
    module = None if component.module is None else system.modules[component.module]
    shield = None if module is None else module.shield
    if module is None or shield is None or shield.held is None or shield.permits is None:
        return None
    topic, span = system.topics[shield.topic], component.span
    builder.scope = module.scope
    builder.params = module.scope.params
    judges = component.role == "ac" and module.forced is None
    cell, name = _copy_of_topic(builder, topic, "shield", span)
    proposed = None
    if shield.proposed is not None:
        second = system.topics[shield.proposed]
        proposed = (*_copy_of_topic(builder, second, "proposed", span), second.type)
    held = builder.expr(shield.held)
    some: core.Expr = core.Fact(BOOL, "published", 0)
    for k in range(1, len(outputs)):
        some = core.Binary(BOOL, "||", some, core.Fact(BOOL, "published", k))

    def emit_judged_step() -> None:
        builder.emit(core.Set(span, name, topic.type, (), held))
        if judges:
            _read_output(builder, module, topic.index, (None, name))
        if proposed is not None:
            _emit_proposals(builder, component, proposed[1], outputs, moves=judges)
        if judges:
            _emit_permission_guard(builder, component, outputs)

    then, _ = builder.statements_of(emit_judged_step)
    builder.emit(core.If(span, some, then, ()))
    return core.ShieldStep(builder.take_statements(), cell, name, topic.type, proposed)


def _copy_of_topic(builder: Builder, topic: Topic, base: str, span: Span) -> tuple[core.Cell, str]:
    """Copies a hidden topic into a new temporary; gives the topic's cell and that name."""
    cell = core.Cell("topic", topic.index, topic.name)
    name = builder.unused_name(base)
    builder.emit(core.Let(span, name, core.Get(topic.type, cell), mutable=True))
    return cell, name


def _emit_proposals(
    builder: Builder,
    component: Component,
    name: str,
    outputs: tuple[core.Output, ...],
    *,
    moves: bool,
) -> None:
    """Emits code that proposes the numbers a controller would publish; if `moves`, moves them."""
    assert component.module is not None
    system, span = builder.system, component.span
    module = system.modules[component.module]
    assert module.shield is not None
    assert module.shield.proposed is not None
    topic = system.topics[module.shield.proposed]
    number = {o.topic: k for k, o in enumerate(outputs)}
    places = [(i, p) for i in module.outputs for p, _ in positions_and_types(system.topics[i].type)]
    first = 0 if component.role == "ac" else len(places)
    for at, (i, place) in enumerate(places, first):
        if i not in number:
            continue
        value = select(core.Var(system.topics[i].type, core.output_name(number[i])), place)
        note = core.Set(span, name, topic.type, (core.Const(INT, at),), value)
        builder.emit(core.If(span, core.Fact(BOOL, "published", number[i]), (note,), ()))
    if not moves:
        return
    _read_output(builder, module, topic.index, (None, name))
    assert module.shield.moved is not None
    moved = builder.let(span, "moved", builder.expr(module.shield.moved))
    for at, (i, place) in enumerate(places):
        if i in number:
            value = select(moved, (at,))
            _emit_moved_output(builder, span, (number[i], place), system.topics[i].type, value)
    found = core.Binary(BOOL, "==", select(moved, (len(places),)), core.Const(FLOAT, 1.0))
    builder.emit(core.Guard(span, found, FaultKind.SHIELD))


def _emit_moved_output(
    builder: Builder, span: Span, where: tuple[int, tuple[int, ...]], t: Type, value: core.Expr
) -> None:
    """Emits code that replaces a number of an output, if the step publishes that output."""
    output, place = where
    path: list[int | core.Expr] = []
    inner = t
    for k in place:
        if isinstance(inner, RecordType):
            path.append(k)
            inner = inner.fields[k][1]
        else:
            assert isinstance(inner, ArrayType)
            path.append(core.Const(INT, k))
            inner = inner.element
    move = core.Set(span, core.output_name(output), t, tuple(path), value)
    builder.emit(core.If(span, core.Fact(BOOL, "published", output), (move,), ()))


def _read_output(builder: Builder, module: Module, topic: int, new: tuple[int | None, str]) -> None:
    """Makes later code of a module read the value that this step publishes on a topic."""
    for symbol, index in module.scope.topics.items():
        if index == topic:
            builder.published[symbol] = new


def _emit_permission_guard(
    builder: Builder, component: Component, outputs: tuple[core.Output, ...]
) -> None:
    """Emits a guard: AC's step faults unless the commands that may act then are permitted."""
    assert component.module is not None
    module = builder.system.modules[component.module]
    number = {o.topic: k for k, o in enumerate(outputs)}
    for index, k in number.items():
        published = None if len(outputs) == 1 else k
        _read_output(builder, module, index, (published, core.output_name(k)))
    permits = builder.expr(permits_on_close_reads(builder.system, module))
    builder.emit(core.Guard(component.span, permits, FaultKind.SHIELD))


def lower_predicate(
    functions: FunctionTable,
    system: System,
    scope: Scope,
    condition: typed.TypedExpr,
    span: Span,
    period_ns: int = 0,
    nan_checks: frozenset[typed.TypedExpr] = frozenset(),
) -> core.Predicate:
    """Gives a boolean over topics and truths; `period_ns`: the period of a contract's node.

    `nan_checks`: operands of comparisons for which a NaN is a fault.
    """
    builder = Builder(functions, system, scope)
    builder.period_ns = period_ns
    builder.maybe_nan = nan_checks
    value = builder.expr(condition)
    body = builder.take_statements()
    probe = core.Let(span, "value", value)
    footprint = footprint_of((*body, probe))
    predicate = core.Predicate(body, value, footprint, span, maybe_nan=bool(nan_checks))
    assert not (found := broken_promises(system, functions.by_name, predicate)), found
    return predicate


def lower_dm_predicate(
    functions: FunctionTable, system: System, module: Module, predicate: typed.TypedExpr
) -> core.Predicate:
    """Gives a predicate of the DM, or a part of it, in Core; comparing a NaN is a fault in it."""
    nan_checks = maybe_nan(system, module, predicate) & operands_compared_in(predicate)
    span = predicate.span
    return lower_predicate(functions, system, module.scope, predicate, span, nan_checks=nan_checks)


def lower_decision(functions: FunctionTable, system: System, module: int) -> core.Decision:
    """Gives a DM's predicates in Core; a missing `ttf` is true, and a missing `safer` is false."""
    m = system.modules[module]
    span = m.symbol.span
    ttf = m.symbol.ttf or typed.Literal(BOOL, span, True)
    safer = m.symbol.safer or typed.Literal(BOOL, span, False)
    return core.Decision(
        module,
        lower_dm_predicate(functions, system, m, ttf),
        lower_dm_predicate(functions, system, m, safer),
        tuple(lower_dm_predicate(functions, system, m, good) for good in m.goods),
    )


def lower_property(functions: FunctionTable, system: System, p: Property) -> core.Predicate:
    """Gives the condition of a property or a contract in Core."""
    if p.kind == "progress":  # of an induction, which asks it of `safer`
        module = next(m for m in system.modules if m.scope is p.scope)
        return lower_dm_predicate(functions, system, module, p.condition)
    period_ns = 0 if p.component is None else system.components[p.component].period_ns
    return lower_predicate(functions, system, p.scope, p.condition, p.span, period_ns)


def lower_timed(functions: FunctionTable, system: System, timed: TimedProperty) -> core.Timed:
    """Gives the premise and the condition of a timed property in Core."""
    scope, condition = timed.scope, timed.condition
    if timed.module is not None:
        module = system.modules[timed.module]
        scope, condition = module.scope, module.symbol.safe
    assert condition is not None
    asked = timed.premise
    premise = (
        None if asked is None else lower_predicate(functions, system, scope, asked, asked.span)
    )
    return core.Timed(premise, lower_predicate(functions, system, scope, condition, condition.span))


def lower_premise(functions: FunctionTable, system: System, p: Property) -> core.Predicate | None:
    """Gives the premise of an `always` property that is an implication; None for others."""
    premise = premise_of(p.condition) if p.kind == "always" else None
    if premise is None:
        return None
    return lower_predicate(functions, system, p.scope, premise, p.span)


def lower(system: System) -> core.CoreSystem:
    """Gives the Core of a whole system."""
    functions = FunctionTable(system)
    nodes: dict[int, core.NodeStep] = {}
    plants: dict[int, core.PlantStep] = {}
    for c in system.components:
        if c.node is not None:
            nodes[c.index] = lower_node(functions, system, c)
        elif c.plant is not None:
            plants[c.index] = step = lower_plant(functions, system, c)
            assert not (found := broken_promises(system, functions.by_name, step)), found
    decisions = tuple(lower_decision(functions, system, m.index) for m in system.modules)
    properties = tuple(lower_property(functions, system, p) for p in system.properties)
    asked = system.test.timed if system.test else ()
    timed = tuple(lower_timed(functions, system, t) for t in asked)
    premises = tuple(lower_premise(functions, system, p) for p in system.properties if system.test)
    measures = tuple(
        lower_predicate(functions, system, m.scope, m.value, m.span) for m in system.measures
    )
    used = tuple(functions.by_name.values())
    return core.CoreSystem(
        used, nodes, plants, decisions, properties, timed, premises=premises, measures=measures
    )
