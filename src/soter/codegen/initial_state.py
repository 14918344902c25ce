"""The state before the first instant.

Purpose: what `init` of the kernel's tables is.
Non-goals: the first step of plants (`plants.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.random_draws import DRAW_PARAMETERS, assemble, in_order, uniform
from soter.language.model.types import (
    ArrayType,
    FloatType,
    ListType,
    RecordType,
    default_value,
    leaves,
)

if TYPE_CHECKING:
    from soter.codegen.function_context import Frame
    from soter.language.model.types import Type, Value


def init(frame: Frame, name: str) -> c.FunctionDef:
    """Defaults of topics, locals and plant states."""
    body: list[c.CStmt] = [frame.state_pointer(), c.Unused("s"), c.Unused("answer")]
    for topic in frame.system.topics:
        body += _initial(frame, frame.topic(topic.index), topic.type, topic.default)
    for component in frame.system.components:
        variables = (
            component.node.locals
            if component.node
            else component.plant.states
            if component.plant
            else ()
        )
        for i, v in enumerate(variables):
            target = frame.member(component.index, v.name)
            interval = component.initial_range[i] if component.initial_range else None
            if interval is None:
                body += _initial(frame, target, v.type, component.initial[i])
                continue
            base = f"{component.name}.{v.name}.start"
            draws = [
                uniform(".".join((base, *path)), c.Number("0"), *interval)
                for path, _ in leaves(v.type)
            ]
            own = f"drawn_{component.index}_{i}"
            before, values = in_order([("double", e) for e in draws], own)
            body += [*before, c.Assign(target, assemble(frame.types, v.type, iter(values)))]
    return c.FunctionDef("void", name, DRAW_PARAMETERS, tuple(body), "initial values")


def _initial(frame: Frame, target: c.CExpr, t: Type, value: Value) -> list[c.CStmt]:
    if value == default_value(t) and _is_zero(t, value):
        return []
    constant = frame.types.constant(t, value, "initial")
    return frame.types.commit(target, t, constant)


def _is_zero(t: Type, value: Value) -> bool:
    """Whether a default value is all zero bytes."""
    if isinstance(t, FloatType):
        return str(value) == "0.0"
    if isinstance(t, RecordType):
        return all(_is_zero(f, v) for (_, f), v in zip(t.fields, value, strict=True))
    if isinstance(t, ArrayType):
        return all(_is_zero(t.element, v) for v in value)
    if isinstance(t, ListType):
        return not value
    return not value
