"""Tables: arrays and lists of data that are too large to be tuples of tuples.

Purpose: a constant that was read from a file, its elements packed one after the other, 8 bytes a
number; an element is unpacked where it is read, and is then a value like any other.
Non-goals: reading files (`language/load/`), images of states (`core/layout.py`).
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Sequence
from itertools import islice
from typing import TYPE_CHECKING, overload

from soter.language.model.types import (
    ArrayType,
    BoolType,
    FloatType,
    ListType,
    RecordType,
    Type,
    Value,
    is_vector_part,
    leaf_count,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

VALUE_MAX = 100_000
"""Numbers in a value that steps, states and messages may hold: they copy it whole."""
TABLE_MAX = 4_000_000
"""Numbers in a table."""


def is_table(t: Type) -> bool:
    """Whether values of the type are too large to be copied."""
    return isinstance(t, (ArrayType, ListType)) and leaf_count(t) > VALUE_MAX


class Table(Sequence[Value]):
    """The elements of an array or list, never changed; equal where all bits are equal.

    `packed`: the leaves of all elements, little-endian: floats as binary64, all else as 64-bit
    ints or one byte a bool, of a list its length and its whole capacity.
    """

    __slots__ = ("_read", "_row", "_sha256", "_size", "element", "packed")

    def __init__(self, element: Type, packed: bytes) -> None:
        self.element = element
        self.packed = packed
        self._row = struct.Struct("<" + _format(element))
        self._read = _reader(element)
        self._size = len(packed) // self._row.size
        self._sha256 = ""

    @classmethod
    def of(cls, element: Type, values: Iterable[Value]) -> Table:
        """The table of these values."""
        row, flat = struct.Struct("<" + _format(element)), _flattener(element)
        return cls(element, b"".join([row.pack(*flat(v)) for v in values]))

    @property
    def of_floats(self) -> bool:
        """Whether every leaf is a float: then `packed` is an array of doubles."""
        return is_vector_part(self.element)

    def first_not_finite(self) -> int | None:
        """The first element with a NaN or an infinity; None where there is none."""
        rows = enumerate(self._row.iter_unpack(self.packed))
        return next((at for at, leaves in rows if not all(map(math.isfinite, leaves))), None)

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, index: int) -> Value: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Value, ...]: ...

    def __getitem__(self, index: int | slice) -> Value | tuple[Value, ...]:
        if isinstance(index, slice):
            return tuple([self[i] for i in range(*index.indices(self._size))])
        at = index + self._size if index < 0 else index
        if not 0 <= at < self._size:
            raise IndexError(index)
        return self._read(iter(self._row.unpack_from(self.packed, at * self._row.size)))

    def __iter__(self) -> Iterator[Value]:
        read = self._read
        return (read(iter(leaves)) for leaves in self._row.iter_unpack(self.packed))

    @property
    def sha256(self) -> str:
        """What it is kept and told apart by."""
        if not self._sha256:
            self._sha256 = hashlib.sha256(self.packed).hexdigest()
        return self._sha256

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Table):
            return NotImplemented
        return self.element == other.element and self.packed == other.packed

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __repr__(self) -> str:
        return f"<table of {self._size} {self.element} {self.sha256}>"


def _format(t: Type) -> str:
    """How `struct` packs the leaves of a value."""
    if isinstance(t, RecordType):
        return "".join(_format(f) for _, f in t.fields)
    if isinstance(t, ArrayType):
        inner = _format(t.element)
        return f"{t.size}{inner}" if len(inner) == 1 else inner * t.size
    if isinstance(t, ListType):
        return "q" + _format(t.element) * t.capacity
    return "d" if isinstance(t, FloatType) else "?" if isinstance(t, BoolType) else "q"


def _reader(t: Type) -> Callable[[Iterator[Value]], Value]:
    """From the leaves of a value, in order, to the value."""
    if isinstance(t, RecordType):
        readers = [_reader(f) for _, f in t.fields]
        return lambda leaves: tuple([read(leaves) for read in readers])
    if isinstance(t, ArrayType):
        size, element = t.size, _reader(t.element)
        if leaf_count(t.element) == 1 and not isinstance(t.element, (RecordType, ArrayType)):
            return lambda leaves: tuple(islice(leaves, size))
        return lambda leaves: tuple([element(leaves) for _ in range(size)])
    if isinstance(t, ListType):
        capacity, element = t.capacity, _reader(t.element)

        def read_list(leaves: Iterator[Value]) -> Value:
            length = next(leaves)
            return tuple([element(leaves) for _ in range(capacity)])[:length]

        return read_list
    return next


def _flattener(t: Type) -> Callable[[Value], list[Value]]:
    """From a value to its leaves, in order."""
    if isinstance(t, RecordType):
        parts = [_flattener(f) for _, f in t.fields]
        return lambda v: [x for part, each in zip(parts, v, strict=True) for x in part(each)]
    if isinstance(t, ArrayType):
        element = _flattener(t.element)
        if isinstance(t.element, FloatType):
            return list
        return lambda v: [x for each in v for x in element(each)]
    if isinstance(t, ListType):
        inner, width, capacity = _flattener(t.element), len(_leaves(t.element)), t.capacity
        padding = _leaves(t.element)

        def flat_list(v: Value) -> list[Value]:
            elements = [x for each in v for x in inner(each)]
            assert len(elements) <= width * capacity
            return [len(v), *elements, *(padding * (capacity - len(v)))]

        return flat_list
    return lambda v: [v]


def _leaves(t: Type) -> list[Value]:
    """As many zeros as a value has leaves here."""
    if isinstance(t, RecordType):
        return [x for _, f in t.fields for x in _leaves(f)]
    if isinstance(t, ArrayType):
        return _leaves(t.element) * t.size
    if isinstance(t, ListType):
        return [0, *(_leaves(t.element) * t.capacity)]
    return [0.0 if isinstance(t, FloatType) else False if isinstance(t, BoolType) else 0]
