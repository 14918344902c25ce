"""Storage: how the state of a system lies in memory, and names of numpy's array types.

Purpose: sizes, alignments, offsets, the numpy dtype and the byte image of values; the one
definition behind the generated struct, the trace and `trace_sha256`. The array types (`Floats`,
...) have any shape and are for annotations only.
Non-goals: C text (`codegen/`).

Rules: fields are ordered by alignment, largest first, ties as declared; every struct is padded
to its alignment by explicit bytes that are always zero; groups are padded to 8. So there are no
implicit holes and a state is its bytes.
"""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from soter.language.model.system import System, Topic
    from soter.language.model.typed import Variable
    from soter.language.model.types import Type, Value
    from soter.language.model.values import Table

    Bools: TypeAlias = NDArray[np.bool_]
    Bytes: TypeAlias = NDArray[np.uint8]
    Floats: TypeAlias = NDArray[np.float64]
    Words: TypeAlias = NDArray[np.uint64]

INT_KINDS = (
    ("b", 1, -(2**7), 2**7 - 1, "int8_t", "<i1"),
    ("B", 1, 0, 2**8 - 1, "uint8_t", "<u1"),
    ("h", 2, -(2**15), 2**15 - 1, "int16_t", "<i2"),
    ("H", 2, 0, 2**16 - 1, "uint16_t", "<u2"),
    ("i", 4, -(2**31), 2**31 - 1, "int32_t", "<i4"),
    ("I", 4, 0, 2**32 - 1, "uint32_t", "<u4"),
    ("q", 8, -(2**63), 2**63 - 1, "int64_t", "<i8"),
)
CANONICAL_NAN = struct.pack("<Q", 0x7FF8000000000000)
NEVER = -(2**62)

FORMATS = {"<i8": "q", "<u8": "Q", "<u4": "I", "<u2": "H", "<u1": "B"}
RESERVED = "reserved"
"""The member of a fixed struct whose bytes are zero at the end of every instant."""


@dataclass(frozen=True)
class Fixed:
    """A struct of `runtime/soter.h` that every state has; fields: (name, numpy format, count)."""

    fields: tuple[tuple[str, str, int], ...]

    @cached_property
    def packer(self) -> struct.Struct:
        """Gives the Python struct that packs and unpacks the fields."""
        parts = [self._field_format(*f) for f in self.fields]
        return struct.Struct("<" + "".join(parts))

    def _field_format(self, name: str, numpy: str, count: int) -> str:
        one = FORMATS[numpy]
        return f"{struct.calcsize(one) * count}x" if name == RESERVED else one * count

    @property
    def size(self) -> int:
        """Gives the size of the struct in bytes."""
        return self.packer.size

    def dtype(self) -> Any:  # noqa: ANN401 - numpy's dtype constructor argument
        """Gives the list of fields from which numpy makes a dtype."""
        return [(n, t) if count == 1 else (n, t, (count,)) for n, t, count in self.fields]

    def pack_into(self, buffer: bytearray, offset: int, **values: int) -> None:
        """Writes the struct at an offset; `values` has all fields by name, except reserved ones."""
        assert len(values) == len(self._value_names), values.keys() ^ set(self._value_names)
        self.packer.pack_into(buffer, offset, *[values[name] for name in self._value_names])

    def unpack_from(self, buffer: bytes, offset: int) -> dict[str, int]:
        """Reads all fields except reserved ones at an offset, and gives their values by name."""
        return dict(zip(self._value_names, self.packer.unpack_from(buffer, offset), strict=True))

    @cached_property
    def _value_names(self) -> tuple[str, ...]:
        return tuple([name for name, _, _ in self.fields if name != RESERVED])


HEADER = Fixed(
    (
        ("ct", "<i8", 1),
        ("seed", "<u8", 1),
        ("seed_key", "<u8", 1),
        ("violations", "<u4", 1),
        ("reserved", "<u4", 1),
    )
)
COMPONENT = Fixed(
    (
        ("next", "<i8", 1),
        ("faults", "<u4", 1),
        ("last_fault", "<u1", 1),
        ("oe", "<u1", 1),
        ("latched", "<u1", 1),
        ("had_control", "<u1", 1),
        ("pending", "<u1", 1),
        ("reserved", "<u1", 7),
    )
)
MODULE = Fixed(
    (
        ("ac_ns", "<i8", 1),
        ("mode_since", "<i8", 1),
        ("to_sc", "<u4", 1),
        ("to_ac", "<u4", 1),
        ("gate_faults", "<u4", 1),
        ("clean_needed", "<u4", 1),
        ("mode", "<u1", 1),
        ("gate_fault", "<u1", 1),
        ("ttf", "<u1", 1),
        ("safer", "<u1", 1),
        ("stale", "<u1", 1),
        ("saw_gate_fault", "<u1", 1),
        ("nan_looks", "<u2", 1),
    )
)
PROPERTY = Fixed(
    (("first_ns", "<i8", 1), ("count", "<u4", 1), ("active", "<u1", 1), ("reserved", "<u1", 3))
)


@dataclass(frozen=True)
class Scalar:
    """How a scalar is stored: struct format, size, C type and numpy format."""

    format: str
    size: int
    c_type: str
    numpy: str


@cache
def scalar(t: Type) -> Scalar | None:
    """Gives the storage of a scalar type; None for records, arrays and lists."""
    if isinstance(t, FloatType):
        return Scalar("d", 8, "double", "<f8")
    if isinstance(t, BoolType):
        return Scalar("B", 1, "uint8_t", "<u1")
    if isinstance(t, EnumType):
        return (
            Scalar("B", 1, "uint8_t", "<u1")
            if len(t.members) <= 256
            else Scalar("H", 2, "uint16_t", "<u2")
        )
    if isinstance(t, IntType):
        for fmt, size, low, high, c_type, numpy in INT_KINDS:
            if low <= t.low and t.high <= high:
                return Scalar(fmt, size, c_type, numpy)
    return None


def storage_range(s: Scalar) -> tuple[int, int]:
    """Gives the smallest and largest int that the storage can hold."""
    return next((low, high) for fmt, _, low, high, _, _ in INT_KINDS if fmt == s.format)


@dataclass(frozen=True)
class LayoutMember:
    """A member of a struct: its source name, its type (None for raw bytes) and its offset."""

    name: str
    type: Type
    offset: int
    index: int
    """Position in declared order."""


@dataclass(frozen=True)
class Struct:
    """The layout of a struct: members in storage order, followed by `padding` zero bytes."""

    members: tuple[LayoutMember, ...]
    size: int
    align: int
    padding: int


def lay_out(fields: tuple[tuple[str, Type], ...], minimum_align: int = 1) -> Struct:
    """Gives a struct with the fields in order of alignment, without holes."""
    order = sorted(range(len(fields)), key=lambda i: -align_of(fields[i][1]))
    offset = 0
    members = []
    for i in order:
        name, t = fields[i]
        members.append(LayoutMember(name, t, offset, i))
        offset += size_of(t)
    align = max([minimum_align, *(align_of(t) for _, t in fields)])
    size = -(-offset // align) * align
    return Struct(tuple(members), size, align, size - offset)


LENGTH = IntType(0, 2**31 - 1)


@cache
def struct_of(t: Type) -> Struct:
    """Gives the struct behind a record or a bounded list (members `items` and `len`)."""
    if isinstance(t, RecordType):
        return lay_out(t.fields)
    assert isinstance(t, ListType)
    return lay_out((("items", ArrayType(t.element, t.capacity)), ("len", LENGTH)))


@cache
def size_of(t: Type) -> int:
    """Gives how many bytes a stored value of the type has."""
    s = scalar(t)
    if s is not None:
        return s.size
    if isinstance(t, ArrayType):
        return t.size * size_of(t.element)
    return struct_of(t).size


@cache
def align_of(t: Type) -> int:
    """Gives the alignment of a stored value in bytes."""
    s = scalar(t)
    if s is not None:
        return s.size
    if isinstance(t, ArrayType):
        return align_of(t.element)
    return struct_of(t).align


def placed_leaves(t: Type, offset: int = 0) -> Iterator[tuple[tuple[str, ...], Type, int]]:
    """Yields path, type and offset of each scalar of a value at `offset`, in declared order.

    Paths are those of `leaves`; lists are left out, as some of their places may be unused.
    """
    if isinstance(t, RecordType):
        at = {m.index: m.offset for m in struct_of(t).members}
        for i, (n, f) in enumerate(t.fields):
            yield from (((n, *p), k, o) for p, k, o in placed_leaves(f, offset + at[i]))
    elif isinstance(t, ArrayType):
        step = size_of(t.element)
        for i in range(t.size):
            inner = placed_leaves(t.element, offset + i * step)
            yield from (((f"[{i}]", *p), k, o) for p, k, o in inner)
    elif not isinstance(t, ListType):
        yield (), t, offset


def _offsets_in_list(t: ListType) -> tuple[int, int]:
    """Gives the offsets of a list's items and of its length."""
    at = {m.name: m.offset for m in struct_of(t).members}
    return at["items"], at["len"]


def encode_into(buffer: bytearray, offset: int, t: Type, value: Value) -> None:
    """Writes the bytes of a value into a buffer, which is zero there."""
    s = scalar(t)
    if s is not None:
        if isinstance(t, FloatType) and value != value:  # noqa: PLR0124 - NaN is stored canonically
            buffer[offset : offset + 8] = CANONICAL_NAN
        else:
            struct.pack_into("<" + s.format, buffer, offset, value)
    elif isinstance(t, RecordType):
        for m in struct_of(t).members:
            encode_into(buffer, offset + m.offset, m.type, value[m.index])
    elif isinstance(t, ArrayType):
        step = size_of(t.element)
        for i, element in enumerate(value):
            encode_into(buffer, offset + i * step, t.element, element)
    else:
        assert isinstance(t, ListType)
        items, length = _offsets_in_list(t)
        encode_into(buffer, offset + items, ArrayType(t.element, t.capacity), value)
        struct.pack_into("<i", buffer, offset + length, len(value))


def image_of_members(layout: Struct, values: Mapping[str, Value]) -> bytes:
    """Gives the bytes of a struct with these values, at least one byte; other members are 0."""
    image = bytearray(max(layout.size, 1))
    for member in layout.members:
        if member.name in values:
            encode_into(image, member.offset, member.type, values[member.name])
    return bytes(image)


def image_of_table(t: ArrayType | ListType, value: Table) -> bytes:
    """Gives the bytes in which a table is stored."""
    if isinstance(t, ArrayType) and isinstance(t.element, IntType) and sys.byteorder == "little":
        stored = scalar(t.element)
        assert stored is not None
        return struct.pack(f"<{t.size}{stored.format}", *memoryview(value.packed).cast("q"))
    if not value.has_only_floats or len(value) * size_of(t.element) != len(value.packed):
        whole = bytearray(size_of(t))
        encode_into(whole, 0, t, value)
        return bytes(whole)
    if isinstance(t, ArrayType):
        return value.packed
    whole = bytearray(size_of(t))
    items, length = _offsets_in_list(t)
    struct.pack_into("<i", whole, length, len(value))
    whole[items : items + len(value.packed)] = value.packed
    return bytes(whole)


def decode_from(buffer: Any, offset: int, t: Type) -> Value:  # noqa: ANN401 - any buffer
    """Gives the value stored at an offset; ValueError if a list is longer than its type."""
    s = scalar(t)
    if s is not None:
        value = struct.unpack_from("<" + s.format, buffer, offset)[0]
        return bool(value) if isinstance(t, BoolType) else value
    if isinstance(t, RecordType):
        fields: list[Value] = [None] * len(t.fields)
        for m in struct_of(t).members:
            fields[m.index] = decode_from(buffer, offset + m.offset, m.type)
        return tuple(fields)
    if isinstance(t, ArrayType):
        step = size_of(t.element)
        return tuple(decode_from(buffer, offset + i * step, t.element) for i in range(t.size))
    assert isinstance(t, ListType)
    items, length = _offsets_in_list(t)
    n = struct.unpack_from("<i", buffer, offset + length)[0]
    if not 0 <= n <= t.capacity:
        raise ValueError(f"a length of {n} in `{t}`")
    return decode_from(buffer, offset + items, ArrayType(t.element, n))


def numpy_dtype(t: Type) -> Any:  # noqa: ANN401 - numpy's dtype constructor argument
    """Gives the numpy dtype of values of a type as they are stored."""
    import numpy as np  # noqa: PLC0415 - only traces need numpy

    s = scalar(t)
    if s is not None:
        return np.dtype(s.numpy)
    if isinstance(t, ArrayType):
        return np.dtype((numpy_dtype(t.element), (t.size,)))
    return _struct_dtype(struct_of(t))


def _struct_dtype(layout: Struct) -> np.dtype[Any]:
    import numpy as np  # noqa: PLC0415 - only traces need numpy

    return np.dtype(
        {
            "names": [m.name for m in layout.members],
            "formats": [numpy_dtype(m.type) for m in layout.members],
            "offsets": [m.offset for m in layout.members],
            "itemsize": layout.size,
        }
    )


@dataclass(frozen=True)
class StructGroup:
    """A named struct inside the state: all topics, or one component's locals."""

    name: str
    owner: int
    """Component index, -1 for the topics."""
    struct: Struct
    offset: int


@dataclass(frozen=True, kw_only=True)
class StateLayout:
    """The state struct of a system."""

    components: int
    modules: int
    properties: int
    topics: int
    component_offset: int
    module_offset: int
    property_offset: int
    stamp_offset: int
    groups: tuple[StructGroup, ...]
    size: int

    def topic_offset(self, index: int) -> int:
        """Gives the byte offset of a topic's value."""
        group = self.groups[0]
        return group.offset + next(m.offset for m in group.struct.members if m.index == index)

    def member(self, owner: int, index: int) -> tuple[int, Type]:
        """Gives the offset and the type of a component's local (or plant state) number `index`."""
        group = next(g for g in self.groups if g.owner == owner)
        m = next(m for m in group.struct.members if m.index == index)
        return group.offset + m.offset, m.type


def state_layout(system: System) -> StateLayout:
    """Gives the layout of a system's state."""
    component_offset = HEADER.size
    module_offset = component_offset + len(system.components) * COMPONENT.size
    property_offset = module_offset + len(system.modules) * MODULE.size
    stamp_offset = property_offset + len(system.properties) * PROPERTY.size
    offset = stamp_offset + 8 * len(system.topics)
    groups: list[StructGroup] = []
    of: list[tuple[str, int, Sequence[Topic | Variable]]] = [
        ("topics", -1, system.topics),
        *((c.name, c.index, c.variables) for c in system.components),
    ]
    for name, owner, variables in of:
        if variables or owner < 0:
            layout = lay_out(tuple((v.name, v.type) for v in variables), minimum_align=8)
            groups.append(StructGroup(name, owner, layout, offset))
            offset += layout.size
    return StateLayout(
        components=len(system.components),
        modules=len(system.modules),
        properties=len(system.properties),
        topics=len(system.topics),
        component_offset=component_offset,
        module_offset=module_offset,
        property_offset=property_offset,
        stamp_offset=stamp_offset,
        groups=tuple(groups),
        size=offset,
    )


FIXED_FIELDS = ("header", "components", "modules", "properties", "stamps", "topics")


def field_name_of_group(group: StructGroup) -> str:
    """Gives the name of a group in the dtype: its own, or `header_` if it is called `header`."""
    taken = group.owner >= 0 and group.name.rstrip("_") in FIXED_FIELDS
    return f"{group.name}_" if taken else group.name


def ac_share(state: Any, module: int) -> float:  # noqa: ANN401 - a record of `state_dtype`
    """Gives the share, 0 to 1, of the time up to the last instant in which a module was in AC."""
    row, end = state["modules"][module], int(state["header"]["ct"])
    ac_ns = int(row["ac_ns"]) + (end - int(row["mode_since"]) if row["mode"] else 0)
    return ac_ns / end if end > 0 else 0.0


def state_dtype(layout: StateLayout) -> np.dtype[Any]:
    """Gives the state's numpy dtype: header, components, modules, properties, stamps, groups."""
    import numpy as np  # noqa: PLC0415 - only traces need numpy

    groups = [g for g in layout.groups if g.struct.members]
    return np.dtype(
        {
            "names": [*FIXED_FIELDS[:5], *map(field_name_of_group, groups)],
            "formats": [
                np.dtype(HEADER.dtype()),
                np.dtype((np.dtype(COMPONENT.dtype()), (layout.components,))),
                np.dtype((np.dtype(MODULE.dtype()), (layout.modules,))),
                np.dtype((np.dtype(PROPERTY.dtype()), (layout.properties,))),
                np.dtype(("<i8", (layout.topics,))),
                *(_struct_dtype(g.struct) for g in groups),
            ],
            "offsets": [
                0,
                layout.component_offset,
                layout.module_offset,
                layout.property_offset,
                layout.stamp_offset,
                *(g.offset for g in groups),
            ],
            "itemsize": layout.size,
        }
    )
