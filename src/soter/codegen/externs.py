"""The C interface of externs: the data that they read, and how their answers are cleaned.

Purpose: structs of inputs and answers, prototypes of linked C functions, and functions that call
them. An enum, int or length outside its type raises the step fault `extern`; bools become 0 or 1,
unused list items and padding become zero, so that equal states have equal bytes; the float32 that
is nearest to an end of a topic's set becomes that end.
Non-goals: how steps use them (`nodes.py`, `plants_and_inputs.py`), who answers (drivers), the check
against a topic's set, which comes after (`c_types.py`).
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import field_name
from soter.codegen.c_types import FAULT, float_number, int_number
from soter.core.layout import INT_KINDS, lay_out, scalar, struct_of
from soter.language.model.types import (
    BOOL,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.codegen.state_access import Frame
    from soter.core.core import CoreSystem, Function
    from soter.core.layout import Struct
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Bound, Component, System
    from soter.language.model.types import Type


LINKED = "_linked"
"""The end of the name of a generated function that calls a linked C function."""


def answer_fields(component: Component) -> tuple[tuple[str, Type], ...]:
    """Names and types of the fields in which a driver answers an extern step."""
    if component.plant is not None:
        return tuple((v.name, v.type) for v in component.plant.states)
    assert component.node is not None
    short = component.node.answers
    return (*short, *((f"has_{n}", BOOL) for n, _ in short))


def struct_def(
    frame: Frame, layout: Struct, name: str, comment: str, *, topics: bool = False
) -> c.StructDef:
    """A C struct with the members of `layout`; `topics`: whether it is the struct of all topics."""
    members = [
        c.StructMember(
            frame.types.stored_type(m.type),
            frame.topic_field(m.index) if topics else field_name(m.name),
        )
        for m in layout.members
    ]
    if layout.padding or not members:
        members.append(c.StructMember("uint8_t", "pad_", layout.padding or 8))
    return c.StructDef(name, tuple(members), comment)


def extern_declarations(frame: Frame, core: CoreSystem, names: dict[int, str]) -> list[c.CTop]:
    """The C structs that externs read and that they answer, and prototypes of linked functions."""
    declarations: list[c.CTop] = []
    for x in frame.system.components:
        if not x.extern:
            continue
        name = names[x.index]
        layout = lay_out(answer_fields(x))
        declarations.append(struct_def(frame, layout, f"{name}_out", f"what {x.name} answers"))
        bound_to_c = (x.binding or "").startswith("c:")
        if x.node is not None and (bound_to_c or x.index in frame.apart):
            declarations.append(_request_struct(frame, x, name))
        if x.node is not None and bound_to_c:
            declarations.append(_node_prototype(x, name))
    declarations += [_function_prototype(frame, f) for f in core.functions if is_linked(f)]
    return [c.Section("externs"), *declarations] if declarations else []


def request_fields(system: System, component: Component) -> tuple[tuple[str, Type], ...]:
    """Names and types of the fields that an extern node reads, in order."""
    assert component.node is not None
    topics = component.scope.topics
    return tuple(
        (x.topic.name.rsplit(".", 1)[-1], system.topics[topics[x.topic]].type)
        for x in component.node.subscribes
    )


def _request_struct(frame: Frame, x: Component, name: str) -> c.StructDef:
    members = tuple(
        c.StructMember(frame.types.stored_type(t), field_name(n))
        for n, t in request_fields(frame.system, x)
    ) or (c.StructMember("uint8_t", "pad_"),)
    return c.StructDef(f"{name}_in", members, f"what {x.name} reads")


def _node_prototype(x: Component, name: str) -> c.FunctionDef:
    assert x.node is not None
    assert x.binding is not None
    return c.FunctionDef(
        "int",
        linked_symbol(x.binding),
        _node_parameters(x, name),
        None,
        f"extern node {x.node.name}: 0 is success; set has_... for each output given",
        static=False,
    )


def _node_parameters(x: Component, name: str) -> tuple[tuple[str, str], ...]:
    assert x.node is not None
    kept = ((f"{name}_local *", "local"),) if x.node.locals else ()
    return ((f"const {name}_in *", "in"), *kept, (f"{name}_out *", "out"))


def linked_symbol(binding: str) -> str:
    """The name of the C function in a binding `c:file.c:function`."""
    return binding.rsplit(":", 1)[1]


def linked_name(name: str) -> str:
    """The name of the generated function that calls the linked C function."""
    return name + LINKED


def node_caller(x: Component, name: str) -> c.FunctionDef:
    """The generated function that calls the linked C function of an extern node."""
    assert x.binding is not None
    return caller_of_symbol("int", name, linked_symbol(x.binding), _node_parameters(x, name))


def _function_prototype(frame: Frame, f: Function) -> c.FunctionDef:
    return c.FunctionDef(
        frame.types.work_type(f.result_type),
        linked_symbol(f.source or ""),
        _function_parameters(frame, f),
        None,
        f"extern fun {f.source_name}",
        static=False,
    )


def is_linked(f: Function) -> bool:
    """Whether a function of Core is bound to a C function, which is linked."""
    return f.result is None and (f.source or "").startswith("c:")


def linked_bindings(frame: Frame, core: CoreSystem) -> Iterator[tuple[str, Span, bool]]:
    """Yields each binding to C, its place in the source, and whether it belongs to a node."""
    for x in frame.system.components:
        if x.extern and x.node is not None and (x.binding or "").startswith("c:"):
            assert x.binding is not None
            yield x.binding, x.node.span, True
    for f in core.functions:
        if is_linked(f):
            assert f.source is not None
            yield f.source, f.span, False


def function_caller(frame: Frame, f: Function, name: str) -> c.FunctionDef:
    """The generated function that calls the linked C function of an extern function."""
    result, parameters = frame.types.work_type(f.result_type), _function_parameters(frame, f)
    return caller_of_symbol(result, name, linked_symbol(f.source or ""), parameters)


def _function_parameters(frame: Frame, f: Function) -> tuple[tuple[str, str], ...]:
    return tuple((frame.types.work_type(p.type), frame.body.c_name(p.name)) for p in f.parameters)


def caller_of_symbol(
    result: str, name: str, symbol: str, parameters: tuple[tuple[str, str], ...]
) -> c.FunctionDef:
    """A function that only calls `symbol`, so that no name in its scope hides `symbol`.

    The user chose the name `symbol`, which may be `answer`, a parameter of steps.
    """
    renamed = tuple((t, f"{n}_" if n == symbol else n) for t, n in parameters)
    call = c.CallExpr(symbol, tuple(c.Name(n) for _, n in renamed))
    return c.FunctionDef(result, linked_name(name), renamed, (c.Return(call),), inline=True)


EXTERN = c.Name("SOTER_EXTERN_FAULT")
ZERO = c.Number("0")


def clean_answer(t: Type, e: c.CExpr, depth: int = 0) -> list[c.CStmt]:
    """Statements that make stored bytes `e` a value of type `t`, or raise the fault `extern`."""
    if isinstance(t, BoolType):
        return [c.Assign(e, c.Ternary(c.Binary("!=", e, ZERO), c.Number("1"), ZERO))]
    if isinstance(t, EnumType):
        return _check_within(e, 0, len(t.members) - 1, unsigned=True)
    if isinstance(t, IntType):
        return _check_int(t, e)
    if isinstance(t, RecordType):
        parts = [(field, c.Member(e, field_name(name))) for name, field in t.fields]
        inside = [made for field, part in parts for made in clean_answer(field, part, depth)]
        return [*inside, *_zero_padding(t, e, depth)]
    counter = f"k{depth}"
    if isinstance(t, ArrayType):
        inner = clean_answer(t.element, c.IndexExpr(c.Member(e, "at"), c.Name(counter)), depth + 1)
        return [c.For(counter, ZERO, c.Number(str(t.size)), tuple(inner))] if inner else []
    if isinstance(t, ListType):
        return [*_clean_list(t, e, counter, depth), *_zero_padding(t, e, depth)]
    return []


def move_to_ends(
    t: Type, bounds: Sequence[Bound | None], e: c.CExpr, depth: int = 0
) -> list[c.CStmt]:
    """Statements that move a float back to the end of its set if float32 rounded it beyond the end.

    `bounds` has one for each leaf of `t`. An end that float32 keeps or rounds inward needs nothing.
    """
    if isinstance(t, FloatType):
        return [] if bounds[0] is None else _move_float_to_ends(bounds[0], e)
    if isinstance(t, RecordType):
        statements: list[c.CStmt] = []
        rest = iter(bounds)
        for name, field in t.fields:
            part = list(islice(rest, sum(1 for _ in leaves(field))))
            statements += move_to_ends(field, part, c.Member(e, field_name(name)), depth)
        return statements
    counter = c.Name(f"k{depth}")
    if isinstance(t, ListType):
        item = c.IndexExpr(c.Member(e, "items"), counter)
        inner = move_to_ends(t.element, bounds, item, depth + 1)
        return [c.For(counter.text, ZERO, c.Member(e, "len"), tuple(inner))] if inner else []
    return _move_array_to_ends(t, bounds, e, depth) if isinstance(t, ArrayType) else []


def _move_array_to_ends(
    t: ArrayType, bounds: Sequence[Bound | None], e: c.CExpr, depth: int
) -> list[c.CStmt]:
    """`move_to_ends` for an array: a loop if all elements have the same bounds, else one by one."""
    size = sum(1 for _ in leaves(t.element))
    groups = [tuple(bounds[k * size : (k + 1) * size]) for k in range(t.size)]
    at = c.Member(e, "at")
    if len(set(groups)) == 1:
        counter = c.Name(f"k{depth}")
        inner = move_to_ends(t.element, groups[0], c.IndexExpr(at, counter), depth + 1)
        return [c.For(counter.text, ZERO, c.Number(str(t.size)), tuple(inner))] if inner else []
    each = [c.IndexExpr(at, c.Number(str(k))) for k in range(t.size)]
    pairs = zip(groups, each, strict=True)
    return [x for g, part in pairs for x in move_to_ends(t.element, g, part)]


def _move_float_to_ends(bound: Bound, e: c.CExpr) -> list[c.CStmt]:
    statements: list[c.CStmt] = []
    for end, single in zip((bound.low, bound.high), bound.float32_ends, strict=True):
        if single != end:
            least, most = sorted((end, single))
            from_ = c.Binary(">=", e, float_number(least))
            to = c.Binary("<=", e, float_number(most))
            at_end = c.Assign(e, float_number(end))
            statements.append(c.IfStmt(c.Binary("&&", from_, to), (at_end,)))
    return statements


def _check_within(e: c.CExpr, low: int, high: int, *, unsigned: bool) -> list[c.CStmt]:
    fits = c.Binary("<=", e, int_number(high))
    if not unsigned or low > 0:
        fits = c.Binary("&&", c.Binary(">=", e, int_number(low)), fits)
    return [c.Do(c.CallExpr("soter_guard", (fits, EXTERN, FAULT)))]


def _check_int(t: IntType, e: c.CExpr) -> list[c.CStmt]:
    """Checks that an int is in its type, unless its storage allows no other values."""
    storage = scalar(t)
    assert storage is not None
    low, high = next((k[2], k[3]) for k in INT_KINDS if k[4] == storage.c_type)
    if (t.low, t.high) == (low, high):
        return []
    if t.high == high:
        fits: c.CExpr = c.Binary(">=", e, int_number(t.low))
        return [c.Do(c.CallExpr("soter_guard", (fits, EXTERN, FAULT)))]
    return _check_within(e, t.low, t.high, unsigned=t.low == low)


def _clean_list(t: ListType, e: c.CExpr, counter: str, depth: int) -> list[c.CStmt]:
    length = c.Member(e, "len")
    element = c.IndexExpr(c.Member(e, "items"), c.Name(counter))
    capacity = c.Number(str(t.capacity))
    outside = c.Binary("||", c.Binary("<", length, ZERO), c.Binary(">", length, capacity))
    inner = clean_answer(t.element, element, depth + 1)
    statements: list[c.CStmt] = [
        c.IfStmt(
            outside, (c.Do(c.CallExpr("soter_raise", (FAULT, EXTERN))), c.Assign(length, ZERO))
        )
    ]
    if inner:
        statements.append(c.For(counter, ZERO, length, tuple(inner)))
    size = c.CallExpr("sizeof", (element,))
    zero = c.Do(c.Cast("void", c.CallExpr("memset", (c.Unary("&", element), ZERO, size))))
    return [*statements, c.For(counter, length, capacity, (zero,))]


def _zero_padding(t: RecordType | ListType, e: c.CExpr, depth: int) -> list[c.CStmt]:
    padding = struct_of(t).padding
    if not padding:
        return []
    counter = f"k{depth}"
    byte = c.IndexExpr(c.Member(e, "pad_"), c.Name(counter))
    return [c.For(counter, ZERO, c.Number(str(padding)), (c.Assign(byte, ZERO),))]
