"""Values that a test states of what stands in for a part: `guarantees t.x in { a, b };`.

Purpose: their numbers, where they belong, and the condition that the part is judged by in each test
in which it runs as it is. `assumes` states values of what may run as it is nowhere: they are no
clause of a contract, and told as an assumption where no test asks for them.
Non-goals: what a stand-in does with them (`contract_stand_ins.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.types import BOOL, INT, ArrayType, ListType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.diagnostics.span import Span
    from soter.language.elaborate.tests_and_faults.distinguishable_values import Path
    from soter.language.model.types import Type, Value


@dataclass(frozen=True)
class StatedValues:
    """Values of one part of a topic, whose index is `topic`; `first`: what that part has at first.

    `promised`: whether they are a clause of the contract; `first` is one of them then.
    """

    topic: int
    path: Path
    values: tuple[Value, ...]
    first: Value
    promised: bool
    text: str
    span: Span

    @property
    def tried(self) -> tuple[Value, ...]:
        """What a stand-in publishes: where the part is held to them, also what is there anyway."""
        every = (self.first, *self.values) if self.promised else self.values
        return tuple(dict.fromkeys(every))


def field_path(read: typed.TypedExpr) -> tuple[typed.TopicSymbol, Path]:
    """The topic that is read, and the field of it, from the whole inwards."""
    path: list[int] = []
    while isinstance(read, typed.TypedField):
        path.append(read.index)
        read = read.target
    assert isinstance(read, typed.TopicRead)
    return read.topic, tuple(reversed(path))


def part_of(value: Value, path: Path) -> Value:
    """The field of a value."""
    for index in path:
        value = value[index]
    return value


def with_part(value: Value, path: Path, part: Value) -> Value:
    """A value with another field."""
    if not path:
        return part
    inner = with_part(value[path[0]], path[1:], part)
    return (*value[: path[0]], inner, *value[path[0] + 1 :])


def is_one_of(read: typed.TypedExpr, values: Sequence[Value]) -> typed.TypedExpr:
    """That what is read is one of the values, number by number (0.0 and -0.0 are one)."""
    each = [_all([*_equal(read, v)], read.span) for v in values]
    condition = each[0]
    for other in each[1:]:
        condition = typed.TypedBinary(BOOL, read.span, "||", condition, other)
    return condition


def _all(conditions: list[typed.TypedExpr], span: Span) -> typed.TypedExpr:
    condition: typed.TypedExpr = typed.Literal(BOOL, span, True)
    for i, other in enumerate(conditions):
        condition = typed.TypedBinary(BOOL, span, "&&", condition, other) if i else other
    return condition


def _equal(read: typed.TypedExpr, value: Value) -> Iterator[typed.TypedExpr]:
    t, span = read.type, read.span
    if isinstance(t, RecordType):
        for index, ((_, part), v) in enumerate(zip(t.fields, value, strict=True)):
            yield from _equal(typed.TypedField(part, span, read, index), v)
    elif isinstance(t, (ArrayType, ListType)):
        if isinstance(t, ListType):
            yield _same(typed.TypedLength(INT, span, read), len(value))
        for index, v in enumerate(value):
            at = typed.Literal(INT, span, index)
            yield from _equal(typed.Index(t.element, span, read, at), v)
    else:
        yield _same(read, value)


def _same(read: typed.TypedExpr, value: Value) -> typed.TypedExpr:
    t: Type = read.type
    if t == BOOL:
        return read if value else typed.TypedUnary(BOOL, read.span, "!", read)
    literal = typed.Literal(t, read.span, value)
    return typed.TypedBinary(BOOL, read.span, "==", read, literal)
