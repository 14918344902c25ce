"""What externs see of a generated program.

Purpose: structs of inputs and answers, the prototypes of linked C functions, and what calls them.
Non-goals: how steps use them (`nodes.py`, `plants.py`), who answers (drivers).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.core.layout import arrange
from soter.language.model.types import BOOL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.function_context import Frame
    from soter.core.core import CoreSystem, Function
    from soter.core.layout import Struct
    from soter.diagnostics.span import Span
    from soter.language.model.system import Component, System
    from soter.language.model.types import Type

LINKED = "_linked"
"""How the name of a function ends that calls a linked one."""


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
    declarations: list[c.CTop] = []
    for x in frame.system.components:
        if not x.extern:
            continue
        name = names[x.index]
        layout = arrange(answer_fields(x))
        declarations.append(struct(frame, layout, f"{name}_out", f"what {x.name} answers"))
        bound_to_c = (x.binding or "").startswith("c:")
        if x.node is not None and (bound_to_c or x.index in frame.apart):
            declarations.append(_inputs(frame, x, name))
        if x.node is not None and bound_to_c:
            declarations.append(_linked(x, name))
    declarations += [_prototype(frame, f) for f in core.functions if is_linked(f)]
    return [c.Section("externs"), *declarations] if declarations else []


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
    return c.FunctionDef(
        "int",
        symbol_of(x.binding),
        _parameters(x, name),
        None,
        f"extern node {x.node.name}: 0 is success; set has_... for each output given",
        static=False,
    )


def _parameters(x: Component, name: str) -> tuple[tuple[str, str], ...]:
    assert x.node is not None
    kept = ((f"{name}_local *", "local"),) if x.node.locals else ()
    return ((f"const {name}_in *", "in"), *kept, (f"{name}_out *", "out"))


def symbol_of(binding: str) -> str:
    """The function that `c:file.c:function` names."""
    return binding.rsplit(":", 1)[1]


def linked_name(name: str) -> str:
    """What generated code calls in the place of the linked function of `name`."""
    return name + LINKED


def call_of_node(x: Component, name: str) -> c.FunctionDef:
    """Calls the linked function of an extern node."""
    assert x.binding is not None
    return call_linked("int", name, symbol_of(x.binding), _parameters(x, name))


def _prototype(frame: Frame, f: Function) -> c.FunctionDef:
    """Of the linked function of an extern function."""
    return c.FunctionDef(
        frame.types.work(f.result_type),
        symbol_of(f.source or ""),
        _parameters_of(frame, f),
        None,
        f"extern fun {f.source_name}",
        static=False,
    )


def is_linked(f: Function) -> bool:
    """Whether a function is a linked one."""
    return f.result is None and (f.source or "").startswith("c:")


def linked_functions(frame: Frame, core: CoreSystem) -> Iterator[tuple[str, Span, bool]]:
    """Every binding to C whose function is called, where it is declared, whether it is a node."""
    for x in frame.system.components:
        if x.extern and x.node is not None and (x.binding or "").startswith("c:"):
            assert x.binding is not None
            yield x.binding, x.node.span, True
    for f in core.functions:
        if is_linked(f):
            assert f.source is not None
            yield f.source, f.span, False


def call_of_function(frame: Frame, f: Function, name: str) -> c.FunctionDef:
    """Calls the linked function of an extern function."""
    result, parameters = frame.types.work(f.result_type), _parameters_of(frame, f)
    return call_linked(result, name, symbol_of(f.source or ""), parameters)


def _parameters_of(frame: Frame, f: Function) -> tuple[tuple[str, str], ...]:
    return tuple((frame.types.work(p.type), frame.body.local(p.name)) for p in f.parameters)


def call_linked(
    result: str, name: str, symbol: str, parameters: tuple[tuple[str, str], ...]
) -> c.FunctionDef:
    """Calls a linked function where no other name is in scope that could hide its own.

    Its own name is the user's: `answer`, say, which steps have a parameter of.
    """
    given = tuple((t, f"{n}_" if n == symbol else n) for t, n in parameters)
    call = c.CallExpr(symbol, tuple(c.Name(n) for _, n in given))
    return c.FunctionDef(result, linked_name(name), given, (c.Return(call),), inline=True)
