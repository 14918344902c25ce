"""The rows of numbers that a diagram has room for: what a topic or a plant holds at a moment.

Purpose: from a type to rows, and the key under which a page finds the text of each.
Non-goals: the numbers themselves (`simulate/outputs/run_on_diagram.py`, which reads them off a run
or a log).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.model.types import ArrayType, BoolType, EnumType, FloatType, IntType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.types import Type

ROWS_MAX = 6
"""So many rows of a topic or plant are shown; that there are more is said by the last."""
TOGETHER_MAX = 3
"""So many numbers of one unit stand in a row."""
LETTERS = 8
"""Of a number, as pages write it."""


@dataclass(frozen=True)
class ValueRow:
    """`label`, then the values at `paths` (indices of fields and elements), then the `unit`.

    `names`: of the signals, as reports call them. `words`: what 0, 1, ... stand for, where the
    values are no numbers. Without paths it is a text, that of `label` or what a page says.
    """

    key: str
    label: str
    paths: tuple[tuple[int, ...], ...] = ()
    names: tuple[str, ...] = ()
    unit: str = ""
    words: tuple[str, ...] = ()

    @property
    def letters(self) -> int:
        """How long its text can get."""
        one = max((len(w) for w in self.words), default=LETTERS)
        many = len(self.paths) or min(len(self.words), 1)
        parts = [len(self.label), (one + 2) * many, len(self.unit)]
        return sum(parts)


def rows_of(name: str, t: Type) -> tuple[ValueRow, ...]:
    """The rows of a topic or a plant of this full name and type; lists have none."""
    rows = list(_rows(name, "", t, ()))
    if len(rows) > ROWS_MAX:
        left = len(rows) - ROWS_MAX + 1
        rows = [*rows[: ROWS_MAX - 1], ValueRow(f"{name} …", f"… and {left} more")]
    return tuple(rows)


def _rows(name: str, label: str, t: Type, path: tuple[int, ...]) -> Iterator[ValueRow]:
    if isinstance(t, (FloatType, IntType)):
        yield ValueRow(name, label, (path,), (name,), t.unit)
    elif isinstance(t, BoolType):
        yield ValueRow(name, label, (path,), (name,), words=("false", "true"))
    elif isinstance(t, EnumType):
        yield ValueRow(name, label, (path,), (name,), words=t.members)
    elif isinstance(t, RecordType):
        numbers = [f for _, f in t.fields if isinstance(f, (FloatType, IntType))]
        if path and 1 < len(numbers) == len(t.fields) <= TOGETHER_MAX and _one_unit(numbers):
            paths = tuple((*path, i) for i in range(len(numbers)))
            names = tuple(f"{name}.{n}" for n, _ in t.fields)
            yield ValueRow(name, label, paths, names, numbers[0].unit)
            return
        for i, (n, f) in enumerate(t.fields):
            yield from _rows(f"{name}.{n}", f"{label}.{n}" if label else n, f, (*path, i))
    elif isinstance(t, ArrayType):
        for i in range(t.size):
            yield from _rows(f"{name}[{i}]", f"{label}[{i}]", t.element, (*path, i))


def _one_unit(numbers: list[FloatType | IntType]) -> bool:
    return len({t.unit for t in numbers}) == 1
