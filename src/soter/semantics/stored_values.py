"""What becomes of values when they are stored as locals or plant states.

Purpose: every NaN is stored as the one canonical NaN, so that states can be compared as bytes.
Non-goals: topics, which never hold a NaN: the gate refuses it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import canonical
from soter.language.model.types import ArrayType, FloatType, ListType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from soter.language.model.types import Type, Value

    Store = Callable[[Value], Value]


def storer(types: Iterable[Type]) -> Store:
    """`tuple of values -> the same, NaNs canonical`, for values of these types."""
    parts = [_storer(t) for t in types]
    if not any(parts):
        return _same
    complete = [part or _same for part in parts]
    return lambda values: tuple([f(v) for f, v in zip(complete, values, strict=True)])


def _storer(t: Type) -> Store | None:
    """The function for one type; None where it holds no float."""
    if isinstance(t, FloatType):
        return canonical
    if isinstance(t, RecordType):
        fields = [f for _, f in t.fields]
        return storer(fields) if any(_storer(f) for f in fields) else None
    if isinstance(t, (ArrayType, ListType)):
        element = _storer(t.element)
        return None if element is None else lambda values: tuple(map(element, values))
    return None


def _same(value: Value) -> Value:
    return value
