"""How a state lies in memory: as `soter.h` says, without holes, and back."""

from __future__ import annotations

import math
import random
import struct
from typing import TYPE_CHECKING

import numpy as np
import pytest

import processes
from generators.engine_comparison import call_compiler
from generators.outside_input_driver import some_value
from soter.core import layout
from soter.core.layout import (
    COMPONENT,
    HEADER,
    MODULE,
    PROPERTY,
    Fixed,
    decode_from,
    encode_into,
    field_name_of_group,
    lay_out,
    numpy_dtype,
    scalar,
    size_of,
    state_dtype,
    state_layout,
    storage_range,
    struct_of,
)
from soter.language.model.types import (
    BOOL,
    FLOAT,
    ArrayType,
    EnumType,
    IntType,
    ListType,
    RecordType,
    leaves,
)
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.language.model.types import Type

    Lowered = Callable[[str], tuple[System, CoreSystem]]

BYTE, WORD = IntType(0, 255), IntType(-(2**31), 2**31 - 1)
MIXED = RecordType((("a", BYTE), ("b", FLOAT), ("c", WORD), ("d", BOOL), ("e", FLOAT)), "Mixed")


# ---------------------------------------------------------------- the fixed part

C_NAMES = {
    "soter_header": HEADER,
    "soter_component": COMPONENT,
    "soter_module": MODULE,
    "soter_property": PROPERTY,
}


def test_the_fixed_part_is_that_of_the_c_header(tmp_path: Path) -> None:
    lines, expected = [], []
    for name, fixed in C_NAMES.items():
        lines.append(f'printf("{name} %zu\\n", sizeof({name}));')
        expected.append(f"{name} {fixed.size}")
        offset = 0
        for field, numpy, count in fixed.fields:
            own = "firing" if (name, field) == ("soter_header", "reserved") else field
            lines.append(
                f'printf("{own} %zu %zu\\n", offsetof({name}, {own}), sizeof(x_{name}.{own}));'
            )
            size = np.dtype(numpy).itemsize * count
            expected.append(f"{own} {offset} {size}")
            offset += size
    declared = "\n".join(f"  static const {name} x_{name};" for name in C_NAMES)
    body = "\n".join(f"  (void){line}" for line in lines)
    text = f"int main(void) {{\n{declared}\n{body}\n  return 0;\n}}\n"
    includes = '#include "soter.h"\n#include <stdio.h>\n'
    (tmp_path / "told.c").write_text(includes + text, encoding="utf-8")
    call_compiler(tmp_path, "-o", "told", "told.c")
    told = processes.run([str(tmp_path / "told")], capture_output=True, text=True, check=True)
    assert told.stdout.splitlines() == expected


def test_a_fixed_struct_is_packed_by_name_and_reserves_zeros() -> None:
    fixed = Fixed((("low", "<u1", 1), ("reserved", "<u1", 3), ("high", "<i8", 1)))
    out = bytearray(b"\xff" * 14)
    fixed.pack_into(out, 1, high=-2, low=7)
    assert bytes(out) == b"\xff\x07\0\0\0" + struct.pack("<q", -2) + b"\xff"
    with pytest.raises(KeyError):
        fixed.pack_into(out, 1, low=7, hi=1)
    with pytest.raises(AssertionError):
        fixed.pack_into(out, 1, low=7)


# ---------------------------------------------------------------- types


@all_rows(
    ("low", "high", "c_type"),
    [
        (0, 255, "uint8_t"),
        (0, 256, "int16_t"),
        (0, 2**15, "uint16_t"),
        (-1, 127, "int8_t"),
        (-1, 128, "int16_t"),
        (-128, 0, "int8_t"),
        (-129, 0, "int16_t"),
        (0, 65535, "uint16_t"),
        (0, 65536, "int32_t"),
        (0, 2**31, "uint32_t"),
        (-1, 2**31, "int64_t"),
        (0, 2**32, "int64_t"),
        (-(2**63), 2**63 - 1, "int64_t"),
    ],
)
def test_an_int_takes_the_least_storage_that_holds_it(low: int, high: int, c_type: str) -> None:
    storage = scalar(IntType(low, high))
    assert storage is not None
    assert storage.c_type == c_type
    least, most = storage_range(storage)
    assert least <= low <= high <= most
    assert storage.size == struct.calcsize("<" + storage.format) == np.dtype(storage.numpy).itemsize


@pytest.mark.parametrize(("members", "size"), [(1, 1), (256, 1), (257, 2)])
def test_an_enum_takes_a_second_byte_after_256_members(members: int, size: int) -> None:
    t = EnumType("E", tuple(f"m{i}" for i in range(members)))
    assert size_of(t) == size
    raw = bytearray(size)
    encode_into(raw, 0, t, members - 1)
    assert decode_from(raw, 0, t) == members - 1


def test_fields_are_ordered_by_alignment_then_as_declared_and_padded_at_the_end() -> None:
    struct_layout = struct_of(MIXED)
    assert [(m.name, m.offset) for m in struct_layout.members] == [
        ("b", 0), ("e", 8), ("c", 16), ("a", 20), ("d", 21),
    ]  # fmt: skip
    assert (struct_layout.size, struct_layout.align, struct_layout.padding) == (24, 8, 2)
    assert [MIXED.fields[m.index][0] for m in struct_layout.members] == [
        m.name for m in struct_layout.members
    ]


def test_a_struct_may_ask_for_more_alignment() -> None:
    assert lay_out((("a", BYTE),)).size == 1
    aligned = lay_out((("a", BYTE),), minimum_align=8)
    assert (aligned.size, aligned.align, aligned.padding) == (8, 8, 7)
    assert lay_out((), minimum_align=8).size == 0


TYPES: list[Type] = [
    MIXED,
    ArrayType(MIXED, 3),
    ListType(MIXED, 3),
    RecordType((("flag", BOOL), ("many", ListType(BYTE, 5)), ("grid", ArrayType(FLOAT, 2))), "R"),
]


@pytest.mark.parametrize("t", TYPES, ids=str)
def test_values_come_back_from_their_images_and_numpy_reads_the_same(t: Type) -> None:
    chance = random.Random(5)  # noqa: S311 - not for secrets
    dtype = np.dtype(numpy_dtype(t))
    assert dtype.itemsize == size_of(t)
    for _ in range(30):
        value = some_value(t, [None] * len(list(leaves(t))), chance)
        raw = bytearray(size_of(t) + 3)
        encode_into(raw, 3, t, value)
        assert decode_from(raw, 3, t) == value
        again = bytearray(size_of(t) + 3)
        encode_into(again, 3, t, decode_from(raw, 3, t))
        assert again == raw


def test_nan_has_one_image_and_minus_zero_its_own() -> None:
    raw = bytearray(16)
    (odd,) = struct.unpack("<d", struct.pack("<Q", 0xFFF8000000000001))
    assert math.isnan(odd)
    encode_into(raw, 0, ArrayType(FLOAT, 2), (odd, -0.0))
    assert bytes(raw) == layout.CANONICAL_NAN + struct.pack("<d", -0.0)


@pytest.mark.parametrize("length", [-1, 4])
def test_a_length_that_no_list_has_is_refused(length: int) -> None:
    t = ListType(BYTE, 3)
    raw = bytearray(size_of(t))
    place = next(m for m in struct_of(t).members if m.name == "len")
    struct.pack_into("<i", raw, place.offset, length)
    with pytest.raises(ValueError, match="a length of"):
        decode_from(raw, 0, t)


# ---------------------------------------------------------------- a state

PROGRAM = """
input topic small: bool; topic wide: { x: float, on: bool }; topic high: float;
node header period 10ms {
  subscribes small queue 2; publishes wide, high; var on: bool; var n: int; step { }
}
plant P period 10ms { drives level = x; state x: float; state kept: float; der x = 1.0; }
topic level: float;
node Silent period 10ms { subscribes level; step { } }
system S { node header; p: P; node Silent; until 1s; always level < 9.0; }
"""


def test_a_state_has_no_holes_and_every_member_a_place(lowered: Lowered) -> None:
    system, _ = lowered(PROGRAM)
    program_layout = state_layout(system)
    at = HEADER.size
    assert program_layout.component_offset == at
    at += COMPONENT.size * len(system.components)
    assert program_layout.module_offset == at
    at += MODULE.size * len(system.modules)
    assert program_layout.property_offset == at
    at += PROPERTY.size * len(system.properties)
    assert program_layout.stamp_offset == at
    at += 8 * len(system.topics)
    for group in program_layout.groups:
        assert group.offset == at
        sizes = [size_of(m.type) for m in group.struct.members]
        assert sum(sizes) + group.struct.padding == group.struct.size
        at += group.struct.size
    assert program_layout.size == at
    assert [(g.name, g.owner) for g in program_layout.groups] == [
        ("topics", -1),
        ("p", 0),
        ("header", 1),
    ]
    taken = {program_layout.topic_offset(t.index) for t in system.topics}
    taken |= {program_layout.member(0, i)[0] for i in range(2)} | {
        program_layout.member(1, i)[0] for i in range(2)
    }
    assert len(taken) == len(system.topics) + 4


def test_numpy_sees_the_state_by_the_names_of_the_program(lowered: Lowered) -> None:
    system, _ = lowered(PROGRAM)
    program_layout = state_layout(system)
    dtype = state_dtype(program_layout)
    assert dtype.itemsize == program_layout.size
    assert [field_name_of_group(g) for g in program_layout.groups] == ["topics", "p", "header_"]
    raw = np.zeros(program_layout.size, dtype=np.uint8)
    offset, t = program_layout.member(1, 1)
    image = bytearray(size_of(t))
    encode_into(image, 0, t, -5)
    raw[offset : offset + len(image)] = np.frombuffer(bytes(image), dtype=np.uint8)
    assert raw.view(dtype)[0]["header_"]["n"] == -5
