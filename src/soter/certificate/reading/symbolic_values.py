"""The re-checker's values: numbers and truths where known, terms where not.

Purpose: the parts of a value: its leaves, its type, whether it is whole, known or decided.
Non-goals: operations on them (`symbolic_operations.py`).

A value is a bool, int or float, a `Linear` (float or int), a `Proposition` (bool), or a tuple of
values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.terms import TRUE, Linear, Proposition, negation
from soter.language.evaluate import arithmetic as arith
from soter.language.model.types import default_value

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.types import Type


Value: TypeAlias = Any
NOT_HERE = "is not rechecked yet"


@dataclass(eq=False)
class SymbolicInt(Linear):
    """An int that depends on inputs."""


@dataclass(eq=False)
class Rows:
    """A row of a table at an index that depends on inputs; the numbers are not read yet."""

    elements: Sequence[tuple[Value, ...]]
    index: Linear


def as_truth(x: bool | Proposition) -> Proposition:
    """A bool as a proposition. Raises NotRecheckedError for any other value."""
    if isinstance(x, Proposition):
        return x
    if not isinstance(x, bool):
        raise NotRecheckedError(f"such a bool {NOT_HERE}")
    return TRUE if x else negation(TRUE)


def as_bool(x: Proposition) -> bool | Proposition:
    """Converts a decided proposition to a bool; returns an undecided proposition unchanged."""
    return x.value if x.kind == "constant" else x


def is_known(x: Value) -> bool:
    """Whether all numbers and truths of a value are known."""
    return all(map(is_known, x)) if isinstance(x, tuple) else isinstance(x, (bool, int, float))


def is_identical(a: Value, b: Value) -> bool:
    """Whether two known numbers are the same, including the sign of zero and the type."""
    return bool(a == b) and repr(a) == repr(b)


def map_leaves(f: Callable[[Value], Value], x: Value) -> Value:
    """The value with `f` applied to every scalar leaf."""
    return tuple(map_leaves(f, v) for v in x) if isinstance(x, tuple) else f(x)


def zip_leaves(f: Callable[[Value, Value], Value], a: Value, b: Value) -> Value:
    """The results of `f` on each pair of scalar leaves of two values with the same shape."""
    if isinstance(a, tuple):
        return tuple(zip_leaves(f, x, y) for x, y in zip(a, b, strict=True))
    return f(a, b)


def scalar_leaves(x: Value) -> list[Value]:
    """The scalar leaves of a value without lists, in declared order."""
    return [leaf for v in x for leaf in scalar_leaves(v)] if isinstance(x, tuple) else [x]


def value_of_leaves(of: Type, values: Sequence[Value]) -> Value:
    """The value of a type without lists that is made of these scalar leaves.

    Raises NotRecheckedError if some leaves are left over.
    """
    left = list(values)

    def build(template: Value) -> Value:
        if isinstance(template, tuple):
            return tuple(build(x) for x in template)
        return left.pop(0)

    value = build(default_value(of))
    if left:
        raise NotRecheckedError(f"a list on a topic or in a state {NOT_HERE}")
    return value


def symbolic_int(x: Linear) -> Linear:
    """A term as an int; the term must be a whole number."""
    return SymbolicInt(x.const, x.terms, x.radius, x.low, x.high, x.nonnegative)


def index_in_range(index: int, size: int) -> int:
    """Returns the index if it is in range; raises StepFault otherwise."""
    if 0 <= index < size:
        return index
    raise arith.StepFault(arith.FaultKind.INDEX)
