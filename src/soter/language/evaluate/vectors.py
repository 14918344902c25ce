"""Componentwise work on vectors: records and arrays of only floats, nested as they may be.

Purpose: given a vector type once, build the functions that zip, map and flatten its values, so
that nothing looks at types while a program runs.
Non-goals: deciding what is a vector (`types.is_vector`), which operation is meant
(`statements.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.types import ArrayType, FloatType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.types import Type, Value

    Unary = Callable[[float], float]
    Binary = Callable[[float, float], float]


def _components(t: Type) -> tuple[Type, ...]:
    if isinstance(t, RecordType):
        return tuple(f for _, f in t.fields)
    assert isinstance(t, ArrayType), t
    return (t.element,) * t.size


def _is_flat(t: Type) -> bool:
    return all(isinstance(c, FloatType) for c in _components(t))


def zipper(t: Type) -> Callable[[Binary, Value, Value], Value]:
    """`(op, a, b) -> value`: `op` on each pair of components of two values of type `t`."""
    if isinstance(t, FloatType):
        return lambda op, a, b: op(a, b)
    if _is_flat(t):
        return lambda op, a, b: tuple(map(op, a, b))
    parts = [zipper(c) for c in _components(t)]
    return lambda op, a, b: tuple([z(op, x, y) for z, x, y in zip(parts, a, b, strict=True)])


def mapper(t: Type) -> Callable[[Unary, Value], Value]:
    """`(op, a) -> value`: `op` on each component of a value of type `t`."""
    if isinstance(t, FloatType):
        return lambda op, a: op(a)
    if _is_flat(t):
        return lambda op, a: tuple(map(op, a))
    parts = [mapper(c) for c in _components(t)]
    return lambda op, a: tuple([m(op, x) for m, x in zip(parts, a, strict=True)])


def flattener(t: Type) -> Callable[[Value], tuple[float, ...]]:
    """`value -> leaves` of a value of type `t`, in declared order."""
    if isinstance(t, FloatType):
        return lambda a: (a,)
    if _is_flat(t):
        return lambda a: a
    parts = [flattener(c) for c in _components(t)]
    return lambda a: tuple([leaf for f, x in zip(parts, a, strict=True) for leaf in f(x)])


def dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """`((a0*b0 + a1*b1) + a2*b2) + ...` of two flat vectors, at least one component long."""
    total = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        total += x * y
    return total
