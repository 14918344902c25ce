"""What code outside of the program answered, made into values before anything reads them.

Purpose: an enum, int or length that its type does not have is the step fault `extern`; bools
become 0 or 1, unused tails and padding become zero, so that a state is still its bytes. The
float32 of an end of a topic's set becomes that end.
Non-goals: value sets of topics (`types.py`): they come after.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import field_name
from soter.codegen.c.types import FAULT, float_number, int_number
from soter.core.layout import INT_KINDS, scalar, struct_of
from soter.language.model.float32_ends import singles
from soter.language.model.types import (
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
    from collections.abc import Sequence

    from soter.language.model.system import Bound
    from soter.language.model.types import Type

EXTERN = c.Name("SOTER_EXTERN_FAULT")
ZERO = c.Number("0")


def received(t: Type, e: c.CExpr, depth: int = 0) -> list[c.CStmt]:
    """Statements that make the stored value `e` one of type `t`; they may raise `extern`."""
    if isinstance(t, BoolType):
        return [c.Assign(e, c.Ternary(c.Binary("!=", e, ZERO), c.Number("1"), ZERO))]
    if isinstance(t, EnumType):
        return _within(e, 0, len(t.members) - 1, unsigned=True)
    if isinstance(t, IntType):
        return _int(t, e)
    if isinstance(t, RecordType):
        statements: list[c.CStmt] = []
        for name, field in t.fields:
            statements += received(field, c.Member(e, field_name(name)), depth)
        return [*statements, *_padding(t, e, depth)]
    counter = f"k{depth}"
    if isinstance(t, ArrayType):
        inner = received(t.element, c.IndexExpr(c.Member(e, "at"), c.Name(counter)), depth + 1)
        return [c.For(counter, ZERO, c.Number(str(t.size)), tuple(inner))] if inner else []
    if isinstance(t, ListType):
        return [*_list(t, e, counter, depth), *_padding(t, e, depth)]
    return []


def to_ends(t: Type, bounds: Sequence[Bound | None], e: c.CExpr, depth: int = 0) -> list[c.CStmt]:
    """Statements that make a float of `e` an end of its set where it is the float32 of that end.

    `bounds`: of all leaves of `t`. None of an end that is a float32, or has its own inside.
    """
    if isinstance(t, FloatType):
        return [] if bounds[0] is None else _to_ends_of(bounds[0], e)
    if isinstance(t, RecordType):
        statements: list[c.CStmt] = []
        rest = iter(bounds)
        for name, field in t.fields:
            part = list(islice(rest, sum(1 for _ in leaves(field))))
            statements += to_ends(field, part, c.Member(e, field_name(name)), depth)
        return statements
    counter = c.Name(f"k{depth}")
    if isinstance(t, ListType):
        item = c.IndexExpr(c.Member(e, "items"), counter)
        inner = to_ends(t.element, bounds, item, depth + 1)
        return [c.For(counter.text, ZERO, c.Member(e, "len"), tuple(inner))] if inner else []
    if not isinstance(t, ArrayType):
        return []
    size = sum(1 for _ in leaves(t.element))
    groups = [tuple(bounds[k * size : (k + 1) * size]) for k in range(t.size)]
    at = c.Member(e, "at")
    if len(set(groups)) == 1:
        inner = to_ends(t.element, groups[0], c.IndexExpr(at, counter), depth + 1)
        return [c.For(counter.text, ZERO, c.Number(str(t.size)), tuple(inner))] if inner else []
    each = [c.IndexExpr(at, c.Number(str(k))) for k in range(t.size)]
    return [x for g, part in zip(groups, each, strict=True) for x in to_ends(t.element, g, part)]


def _to_ends_of(bound: Bound, e: c.CExpr) -> list[c.CStmt]:
    statements: list[c.CStmt] = []
    for end, single in zip((bound.low, bound.high), singles(bound), strict=True):
        if single != end:
            least, most = sorted((end, single))
            from_ = c.Binary(">=", e, float_number(least))
            to = c.Binary("<=", e, float_number(most))
            own = c.Assign(e, float_number(end))
            statements.append(c.IfStmt(c.Binary("&&", from_, to), (own,)))
    return statements


def _within(e: c.CExpr, low: int, high: int, *, unsigned: bool) -> list[c.CStmt]:
    fits = c.Binary("<=", e, int_number(high))
    if not unsigned or low > 0:
        fits = c.Binary("&&", c.Binary(">=", e, int_number(low)), fits)
    return [c.Do(c.CallExpr("soter_guard", (fits, EXTERN, FAULT)))]


def _int(t: IntType, e: c.CExpr) -> list[c.CStmt]:
    """Nothing where the storage holds no other values than the type."""
    storage = scalar(t)
    assert storage is not None
    low, high = next((k[2], k[3]) for k in INT_KINDS if k[4] == storage.c_type)
    if (t.low, t.high) == (low, high):
        return []
    if t.high == high:
        fits: c.CExpr = c.Binary(">=", e, int_number(t.low))
        return [c.Do(c.CallExpr("soter_guard", (fits, EXTERN, FAULT)))]
    return _within(e, t.low, t.high, unsigned=t.low == low)


def _list(t: ListType, e: c.CExpr, counter: str, depth: int) -> list[c.CStmt]:
    length = c.Member(e, "len")
    element = c.IndexExpr(c.Member(e, "items"), c.Name(counter))
    capacity = c.Number(str(t.capacity))
    outside = c.Binary("||", c.Binary("<", length, ZERO), c.Binary(">", length, capacity))
    inner = received(t.element, element, depth + 1)
    statements: list[c.CStmt] = [
        c.IfStmt(
            outside,
            (c.Do(c.CallExpr("soter_raise", (FAULT, EXTERN))), c.Assign(length, ZERO)),
        )
    ]
    if inner:
        statements.append(c.For(counter, ZERO, length, tuple(inner)))
    size = c.CallExpr("sizeof", (element,))
    zero = c.Do(c.Cast("void", c.CallExpr("memset", (c.Unary("&", element), ZERO, size))))
    return [*statements, c.For(counter, length, capacity, (zero,))]


def _padding(t: RecordType | ListType, e: c.CExpr, depth: int) -> list[c.CStmt]:
    padding = struct_of(t).padding
    if not padding:
        return []
    counter = f"k{depth}"
    byte = c.IndexExpr(c.Member(e, "pad_"), c.Name(counter))
    return [c.For(counter, ZERO, c.Number(str(padding)), (c.Assign(byte, ZERO),))]
