"""Values drawn by chance, or as a driver answers.

Purpose: the draw of a float, draws in order, and a value put together from its leaves.
Non-goals: which draws there are (`plants.py`, `environment_inputs.py`, `initial_state.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.codegen.body import stream_key
from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.c.types import float_number, int_number
from soter.codegen.function_context import CT, HEADER
from soter.core import core
from soter.core.read_write_footprint import walk
from soter.language.model.types import ArrayType, RecordType

if TYPE_CHECKING:
    from soter.codegen.c.types import TypeTable
    from soter.language.model.system import Component
    from soter.language.model.types import Type

DRAW_PARAMETERS = (("void *", "state"), ("const void *", "answer"))


def whom(stream: str) -> tuple[c.CExpr, ...]:
    """The first arguments of a draw that a driver may answer."""
    return (HEADER, c.Name("answer"), stream_key(stream))


def uniform(
    stream: str, index: c.CExpr, low: float, high: float, *, chance: bool = False
) -> c.CExpr:
    """A float drawn from [low, high]; by `chance` whoever answers."""
    bounds = (float_number(low), float_number(high))
    if chance:
        return c.CallExpr("soter_draw", (HEADER, stream_key(stream), index, *bounds))
    return c.CallExpr("soter_drawn", (*whom(stream), index, *bounds))


def in_order(drawn: list[tuple[str, c.CExpr]], name: str) -> tuple[list[c.CStmt], list[c.CExpr]]:
    """Draws one after the other: C leaves the order inside an initializer open."""
    if len(drawn) == 1:
        return [], [drawn[0][1]]
    names = [f"{name}_{k}" for k in range(len(drawn))]
    before: list[c.CStmt] = [
        c.Declare(t, n, e, const=True) for n, (t, e) in zip(names, drawn, strict=True)
    ]
    return before, [c.Name(n) for n in names]


def assemble(types: TypeTable, t: Type, values: object) -> c.CExpr:
    """A value of type `t` from its leaves in order."""
    if isinstance(t, RecordType):
        return c.Initializer(
            tuple((field_name(n), assemble(types, f, values)) for n, f in t.fields),
            types.stored(t),
        )
    if isinstance(t, ArrayType):
        items = c.Initializer(
            tuple((None, assemble(types, t.element, values)) for _ in range(t.size))
        )
        return c.Initializer((("at", items),), types.stored(t))
    value = next(values)  # type: ignore[call-overload]
    assert isinstance(value, c.CExpr)
    return value


def choosing(component: Component, statements: tuple[core.Stmt, ...]) -> list[c.CStmt]:
    """What choices need: how many were made in this step, and which release it is."""
    if not any(isinstance(n, core.Choose) for n in walk(statements)):
        return []
    since = c.Binary("-", CT, int_number(component.phase_ns)) if component.phase_ns else CT
    release = c.Binary("/", since, int_number(component.period_ns))
    return [
        c.Declare("uint32_t", "made", c.Number("0U")),
        c.Declare("int64_t", "release", release, const=True),
    ]
