"""Types and vector values in Core: leaves, parts, and values put together from them.

Purpose: what expressions and plants need to work on records and arrays leaf by leaf.
Non-goals: order of evaluation (`lower_expressions.py`), storage (`layout.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.language.model.types import INT, ArrayType, DurationType, FloatType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.types import Type


def core_type(t: Type) -> Type:
    """The type in Core: a duration is the int of its nanoseconds."""
    return INT if isinstance(t, DurationType) else t


def index_components(t: Type) -> list[tuple[tuple[int, ...], Type]]:
    """Leaf selections of a vector type, in order; array elements as indices."""
    if isinstance(t, FloatType):
        return [((), t)]
    selections: list[tuple[tuple[int, ...], Type]] = []
    parts = (
        [(i, f) for i, (_, f) in enumerate(t.fields)]
        if isinstance(t, RecordType)
        else [(i, t.element) for i in range(t.size)]
        if isinstance(t, ArrayType)
        else []
    )
    for i, part in parts:
        selections.extend(((i, *path), leaf) for path, leaf in index_components(part))
    return selections


def select(e: core.Expr, path: tuple[int, ...]) -> core.Expr:
    """Follow constant field and element indices."""
    for i in path:
        t = e.type
        if isinstance(e, core.Make):
            e = e.elements[i]
        elif isinstance(t, RecordType):
            e = core.Field(t.fields[i][1], e, i)
        else:
            assert isinstance(t, ArrayType)
            e = core.Element(t.element, e, core.Const(INT, i))
    return e


def rebuild(
    t: Type, leaf: Callable[[tuple[int, ...]], core.Expr], path: tuple[int, ...] = ()
) -> core.Expr:
    """A vector value from its leaves."""
    if isinstance(t, RecordType):
        parts = [rebuild(f, leaf, (*path, i)) for i, (_, f) in enumerate(t.fields)]
        return core.Make(t, tuple(parts))
    if isinstance(t, ArrayType):
        parts = [rebuild(t.element, leaf, (*path, i)) for i in range(t.size)]
        return core.Make(t, tuple(parts))
    return leaf(path)
