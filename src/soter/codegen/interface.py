"""What externs see of a generated program.

Purpose: structs of inputs and answers, and the prototypes of linked C functions.
Non-goals: how steps use them (`nodes.py`, `plants.py`), who answers (drivers).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.lower.layout import arrange
from soter.program.model.types import BOOL

if TYPE_CHECKING:
    from soter.codegen.frame import Frame
    from soter.lower.core import CoreSystem
    from soter.lower.layout import Struct
    from soter.program.model.system import Component, System
    from soter.program.model.types import Type


def answer_fields(component: Component) -> tuple[tuple[str, Type], ...]:
    """Fields of the struct in which a driver answers an extern step."""
    if component.plant is not None:
        return tuple((v.name, v.type) for v in component.plant.states)
    assert component.node is not None
    short = component.node.answers
    return (*short, *((f"has_{n}", BOOL) for n, _ in short))


def struct(
    frame: Frame, layout: Struct, name: str, comment: str, *, topics: bool = False
) -> c.StructDef:
    """A struct as it is laid out; `topics`: the one of all topics."""
    members = [
        c.StructMember(
            frame.types.stored(m.type),
            frame.topic_field(m.index) if topics else field_name(m.name),
        )
        for m in layout.members
    ]
    if layout.padding or not members:
        members.append(c.StructMember("uint8_t", "pad_", layout.padding or 8))
    return c.StructDef(name, tuple(members), comment)


def interface(frame: Frame, core: CoreSystem, names: dict[int, str]) -> list[c.CTop]:
    """What externs see: inputs, outputs, and the prototypes of linked functions."""
    found: list[c.CTop] = []
    for x in frame.system.components:
        if not x.extern:
            continue
        name = names[x.index]
        layout = arrange(answer_fields(x))
        found.append(struct(frame, layout, f"{name}_out", f"what {x.name} answers"))
        bound_to_c = (x.binding or "").startswith("c:")
        if x.node is not None and (bound_to_c or x.index in frame.apart):
            found.append(_inputs(frame, x, name))
        if x.node is not None and bound_to_c:
            found.append(_linked(x, name))
    for f in core.functions:
        if f.result is None and f.source and f.source.startswith("c:"):
            parameters = tuple(
                (frame.types.work(p.type), frame.body.local(p.name)) for p in f.parameters
            )
            symbol = f.source.rsplit(":", 1)[1]
            found.append(
                c.FunctionDef(
                    frame.types.work(f.result_type),
                    symbol,
                    parameters,
                    None,
                    f"extern fun {f.source_name}",
                    static=False,
                )
            )
    return [c.Section("externs"), *found] if found else []


def request_fields(system: System, component: Component) -> tuple[tuple[str, Type], ...]:
    """Members of the struct of what an extern node reads, in its order, with their types."""
    assert component.node is not None
    topics = component.scope.topics
    return tuple(
        (x.topic.name.rsplit(".", 1)[-1], system.topics[topics[x.topic]].type)
        for x in component.node.subscribes
    )


def _inputs(frame: Frame, x: Component, name: str) -> c.StructDef:
    members = tuple(
        c.StructMember(frame.types.stored(t), field_name(n))
        for n, t in request_fields(frame.system, x)
    ) or (c.StructMember("uint8_t", "pad_"),)
    return c.StructDef(f"{name}_in", members, f"what {x.name} reads")


def _linked(x: Component, name: str) -> c.FunctionDef:
    assert x.node is not None
    assert x.binding is not None
    symbol = x.binding.rsplit(":", 1)[1]
    parameters = [(f"const {name}_in *", "in")]
    if x.node.locals:
        parameters.append((f"{name}_local *", "local"))
    parameters.append((f"{name}_out *", "out"))
    return c.FunctionDef(
        "int",
        symbol,
        tuple(parameters),
        None,
        f"extern node {x.node.name}: 0 is success; set has_... for each output given",
        static=False,
    )
