"""Base classes of trees: dataclasses that Python defines quickly, as every command needs them all.

Purpose: `node` makes a dataclass whose objects never change; `Node` compares, hashes and shows its
objects by code written once, not compiled anew for each class; `Shown` only shows them.
Non-goals: what the trees are (`tree.py`, `core/core.py`, `codegen/c_tree.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable
    from dataclasses import field

    from typing_extensions import dataclass_transform

    T = TypeVar("T")

    @dataclass_transform(frozen_default=True, field_specifiers=(field,))
    def node(*, kw_only: bool = False) -> Callable[[type[T]], type[T]]:
        """Makes a subclass of `Node` a dataclass with slots whose objects never change."""

else:

    def node(*, kw_only: bool = False) -> Callable[[type], type]:
        """Makes a class a plain dataclass with slots; at run time its objects could be changed."""
        return dataclass(slots=True, eq=False, repr=False, kw_only=kw_only)


class Shown:
    """The base class that gives its subclasses the `repr` of a dataclass."""

    __slots__ = ()

    def __repr__(self) -> str:
        kind: Any = type(self)
        parts = (f"{name}={getattr(self, name)!r}" for name in _field_names(kind))
        return f"{kind.__qualname__}({', '.join(parts)})"


class Node(Shown):
    """The base class whose objects are equal if their classes and parts are, as dataclasses are."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if other.__class__ is not self.__class__:
            return NotImplemented
        return field_values(self) == field_values(other)

    def __hash__(self) -> int:
        return hash(field_values(self))


@cache
def _field_names(kind: Any) -> tuple[str, ...]:  # noqa: ANN401 - a dataclass
    return tuple([f.name for f in fields(kind)])


@cache
def _values_getter(kind: Any) -> Callable[[object], tuple[object, ...]]:  # noqa: ANN401 - the same
    names = _field_names(kind)
    if len(names) > 1:
        return attrgetter(*names)
    return lambda node: tuple([getattr(node, name) for name in names])


def field_values(node: object) -> tuple[object, ...]:
    """Gives the values of a node's fields, in declared order."""
    kind: Any = type(node)
    return _values_getter(kind)(node)
