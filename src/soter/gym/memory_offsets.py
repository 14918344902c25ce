"""Where the numbers of a program lie in memory, for the C that moves them.

Purpose: leaves of values in declared order as `soter_leaf` of `c/soter_gym.h`.
Non-goals: what an observation or an action is made of (`compiled_system.py`), spaces
(`array_mapping.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.core.layout import scalar, size_of, struct_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    has_list,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.language.model.types import Type

FLOAT, BOOL = 0, 1
KINDS = {"b": 2, "B": 3, "h": 4, "H": 5, "i": 6, "I": 7, "q": 8}


class MemoryLeaf(NamedTuple):
    """A number: its offset, `soter_leaf_kind`, and what an int or enum may be."""

    offset: int
    kind: int
    low: int = 0
    high: int = 0


def is_flat(types: Iterable[Type]) -> bool:
    """Whether values of these types have a fixed number of numbers: no lists."""
    return not any(has_list(t) for t in types)


def places(t: Type, offset: int) -> Iterator[MemoryLeaf]:
    """The leaves of a value that lies at `offset`, in declared order."""
    assert not isinstance(t, ListType), t
    if isinstance(t, RecordType):
        for member in sorted(struct_of(t).members, key=lambda m: m.index):
            yield from places(member.type, offset + member.offset)
    elif isinstance(t, ArrayType):
        for i in range(t.size):
            yield from places(t.element, offset + i * size_of(t.element))
    else:
        yield _leaf(t, offset)


def _leaf(t: Type, offset: int) -> MemoryLeaf:
    if isinstance(t, FloatType):
        return MemoryLeaf(offset, FLOAT)
    if isinstance(t, BoolType):
        return MemoryLeaf(offset, BOOL)
    storage = scalar(t)
    assert storage is not None, t
    if isinstance(t, EnumType):
        return MemoryLeaf(offset, KINDS[storage.format], 0, len(t.members) - 1)
    assert isinstance(t, IntType)
    return MemoryLeaf(offset, KINDS[storage.format], t.low, t.high)


@dataclass(frozen=True)
class ObservedPart:
    """A part of an observation: a topic, or the true states of a plant (index)."""

    index: int
    truth: bool = False


class LeafBuffer:
    """`soter_leaves` in C, and the memory that they lie in."""

    def __init__(self, ffi: Any, leaves: Sequence[MemoryLeaf], size: int = 0) -> None:  # noqa: ANN401 - cffi
        self.count = len(leaves)
        self.memory = ffi.new("soter_leaf[]", [tuple(leaf) for leaf in leaves] or 1)
        self.fields = {"at": self.memory, "count": len(leaves), "size": size}
