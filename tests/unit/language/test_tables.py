"""Tables of data: packed, read in place, and otherwise like any constant, on both engines."""

from __future__ import annotations

import json
import random
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.core.layout import encode_into, image_of_table, size_of
from soter.diagnostics.diagnostic import Source, Span
from soter.language.check import constants_and_types
from soter.language.evaluate import expressions
from soter.language.front_end import check_file, system_of
from soter.language.model import values as data_table
from soter.language.model.typed import Literal
from soter.language.model.types import (
    BOOL,
    FLOAT,
    INT,
    MODE,
    ArrayType,
    IntType,
    ListType,
    RecordType,
    Type,
    Value,
)
from soter.language.model.values import VALUE_MAX, Table, is_table
from soter.native.compiler import WARNINGS
from soter.simulate.run import NativeProgram, run_interpreted
from soter.verify.deploy.level_tables import Writer
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

SCALARS: tuple[Type, ...] = (FLOAT, FLOAT, INT, BOOL, MODE, IntType(-5, 300))
FLOATS = (0.0, -0.0, 1.5, -2.25, 1e300, 5e-324, 0.1)


def a_type(rng: random.Random, depth: int = 2) -> Type:
    kind = rng.randrange(4) if depth else 0
    if kind == 1:
        return ArrayType(a_type(rng, depth - 1), rng.randint(1, 3))
    if kind == 2:
        return ListType(a_type(rng, depth - 1), rng.randint(1, 3))
    if kind == 3:
        fields = [(f"f{i}", a_type(rng, depth - 1)) for i in range(rng.randint(1, 3))]
        return RecordType(tuple(fields))
    return rng.choice(SCALARS)


def a_value(rng: random.Random, t: Type) -> Value:
    if isinstance(t, RecordType):
        return tuple(a_value(rng, f) for _, f in t.fields)
    if isinstance(t, (ArrayType, ListType)):
        count = t.size if isinstance(t, ArrayType) else rng.randint(0, t.capacity)
        return tuple(a_value(rng, t.element) for _ in range(count))
    if t == FLOAT:
        return rng.choice(FLOATS)
    if t == BOOL:
        return rng.random() < 0.5
    if t == MODE:
        return rng.randrange(2)
    assert isinstance(t, IntType)
    return rng.choice((t.low, t.high, 3, 0))


@all_rows("seed", range(60))
def test_a_table_holds_what_it_was_made_of(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 - no secret
    element = a_type(rng)
    values = [a_value(rng, element) for _ in range(rng.randint(0, 6))]
    made = Table.of_values(element, values)
    assert len(made) == len(values)
    assert repr(list(made)) == repr(values), "0.0 is not -0.0, nor 1 true"
    assert [made[i] for i in range(len(made))] == values
    assert made == Table.of_values(element, list(values))
    assert hash(made) == hash(Table.of_values(element, list(values)))
    assert made[1:3] == tuple(values[1:3])
    with pytest.raises(IndexError):
        made[len(values)]
    if values:
        assert made != Table.of_values(element, values[1:])


@all_rows("seed", range(60))
def test_the_image_of_a_table_is_that_of_the_value(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 - no secret
    element = rng.choice((a_type(rng), FLOAT, ArrayType(FLOAT, 3)))
    values = tuple(a_value(rng, element) for _ in range(rng.randint(1, 6)))
    for t in (ArrayType(element, len(values)), ListType(element, len(values) + rng.randrange(3))):
        expected = bytearray(size_of(t))
        encode_into(expected, 0, t, values)
        assert image_of_table(t, Table.of_values(element, values)) == expected


def test_ints_of_every_width_lie_in_an_image_as_values_do() -> None:
    rng = random.Random(0)  # noqa: S311 - no secret
    for low, high in ((0, 255), (-128, 127), (-3, 300), (0, 2**31), (-(2**40), 2**62)):
        element = IntType(low, high)
        values = (low, high, *(rng.randint(low, high) for _ in range(50)))
        t, expected = ArrayType(element, len(values)), bytearray(size_of(ArrayType(element, 52)))
        encode_into(expected, 0, t, values)
        assert image_of_table(t, Table.of_values(element, values)) == expected


def test_a_table_of_a_dm_is_data_where_it_is_large() -> None:
    source = Source("a", "x")
    writer = Writer(Span(source, 0, 1))
    few, many = bytes(range(256)), bytes(k % 256 for k in range(VALUE_MAX + 1))
    small, large = (writer.table_of_bytes("T", values) for values in (few, many))
    assert isinstance(small, Literal)
    assert isinstance(large, Literal)
    assert small.value == tuple(few)
    assert isinstance(large.value, Table)
    assert large.type == ArrayType(IntType(0, 255), len(many))
    assert bytes(large.value) == many


# ---------------------------------------------------------------- the same program with tables

TEXT = """
soter 1;
type Way = { points: Vec3[<=3], cost: float, on: bool, kind: enum_, n: int in [0, 9] };
const WAYS: Way[<=9] = data "ways.json";
const GRID: float[3][5] = data "grid.npy";
const ROWS: int[6] = data "rows.csv";
fun total(): float {
  var all = 0.0;
  for w in WAYS {
    for p in w.points { all = all + p.x - p.z; }
    if w.on && w.kind == Kind.Far { return all; }
  }
  return all;
}
const TOTAL: float = total() + GRID[4][2];
topic way: Way = { points: [], cost: 0.0, on: false, kind: Kind.Near, n: 0 };
topic sum: float = 0.0;
topic at: int = 0;
node Look period 10ms {
  publishes way, sum, at;
  var i: int = 0;
  step {
    i = i + 1;
    var all = TOTAL + total();
    for row in GRID { all = all + row[i % 3]; }
    publish sum = all + GRID[(i * 7) % 5][i % row_size()];
    publish at = ROWS[i % ROWS.len] + WAYS.len;
    publish way = WAYS[i % 5];
  }
}
fun row_size(): int { return GRID[0].len; }
system S { node Look; until 200ms; }
"""
TEXT = TEXT.replace("enum_", "Kind").replace(
    "type Way", "type Kind = enum { Near, Far };\ntype Way"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    ways = [
        {
            "points": [{"x": 1.0 * i, "y": -0.0, "z": 0.1 * k} for k in range(i % 4)],
            "cost": 1e-3 * i,
            "on": i == 3,
            "kind": ("Near", "Far")[i % 2],
            "n": i,
        }
        for i in range(4)
    ]
    (tmp_path / "ways.json").write_text(json.dumps(ways))
    np.save(tmp_path / "grid.npy", np.arange(15.0).reshape(5, 3) / 7)
    (tmp_path / "rows.csv").write_text("1,2,3\n-4,5,9007199254740993\n")
    (tmp_path / "look.soter").write_text(TEXT)
    return tmp_path


@pytest.mark.parametrize("optimise", ["-O0", "-O2"])
def test_a_table_is_read_as_the_same_bits_by_both_engines(
    folder: Path, monkeypatch: pytest.MonkeyPatch, optimise: str
) -> None:
    def hashes() -> list[str | None]:
        checked = check_file(str(folder / "look.soter"))
        assert checked.ok, [d.message for d in checked.diagnostics.items]
        system = system_of(checked, "S")
        native = NativeProgram(system, optimise, WARNINGS).run(10**9, 1, hash_trace=True)
        assert native.violations == 1, "WAYS[4] is none: the node latches"
        return [native.trace_sha256, run_interpreted(system, 10**9, 1).trace_sha256]

    values = hashes()
    monkeypatch.setattr(data_table, "VALUE_MAX", 2)
    assert is_table(ArrayType(INT, 6))
    tables = hashes()
    assert values[0] == values[1] == tables[0] == tables[1]


@pytest.mark.parametrize("kind", ["npy", "json", "csv"])
def test_many_numbers_come_from_any_file(tmp_path: Path, kind: str) -> None:
    numbers = np.random.default_rng(3).normal(size=(30_000, 4))
    numbers[7, 2] = -0.0
    file = tmp_path / f"numbers.{kind}"
    if kind == "npy":
        np.save(file, np.asfortranarray(numbers))
    elif kind == "json":
        file.write_text(json.dumps(numbers.tolist()))
    else:
        file.write_text("\n".join(",".join(map(repr, r)) for r in numbers.tolist()))
    main = tmp_path / "main.soter"
    main.write_text(
        f'soter 1;\nconst N: float[4][30000] = data "numbers.{kind}";\n'
        "fun at(i: int): float { return N[i][2]; }\ntopic t: float = 0.0;\n"
        "node L period 1ms { publishes t; var i: int = 0;\n"
        "step { publish t = at(i); i = i + 7; } }\n"
        "system S { node L; until 4s; }\n"
    )
    program = soter.load(main)
    assert program.constant("N").tobytes() == numbers.tobytes()
    assert program.function("at")(7).hex() == (-0.0).hex()
    run = program.simulate()
    assert run.topic("t")[:-1].tobytes() == numbers[: 7 * 4000 : 7, 2].copy().tobytes()
    assert run.trace_sha256 == program.simulate(engine="interp").trace_sha256


def reading(tmp_path: Path, array: Any, t: str) -> Any:
    np.save(tmp_path / "a.npy", array)
    return check_file(str(tmp_path / "m.soter"), f'soter 1;\nconst A: {t} = data "a.npy";\n')


@pytest.mark.parametrize("dtype", ["f8", "f4", ">f8", "i4", "u8"])
def test_numbers_of_any_width_become_the_nearest_doubles(tmp_path: Path, dtype: str) -> None:
    array = np.arange(200_000).reshape(-1, 2).astype(dtype)
    checked = reading(tmp_path, array, "float[2][100000]")
    assert checked.ok
    number_table = checked.program.consts["A"].value
    assert isinstance(number_table, Table)
    assert number_table[77_777] == (155_554.0, 155_555.0)


@pytest.mark.parametrize(
    ("array", "t", "text"),
    [
        (np.full(200_000, np.nan), "float[200000]", "[0]: nan is no number"),
        (np.append(np.zeros(199_999), np.inf), "float[200000]", "[199999]: inf is no number"),
        (np.zeros(100_000), "float[200000]", "expected 200000 elements"),
        (np.zeros(200_001), "float[<=200000]", "at most 200000 elements"),
        (np.zeros((100_000, 3)), "float[2][100000]", "[0]: expected 2 elements"),
        (np.zeros(200_000), "int[200000]", "[0]: expected an int"),
        (np.zeros((200_000, 1), dtype=bool), "float[200000]", "[0]: expected a number"),
    ],
)
def test_a_table_that_is_not_what_it_should_be(
    tmp_path: Path, array: Any, t: str, text: str
) -> None:
    (diagnostic,) = reading(tmp_path, array, t).diagnostics.items
    assert diagnostic.code == "D004"
    assert text in diagnostic.primary.text


def test_a_table_is_part_of_the_hash_of_the_program(tmp_path: Path) -> None:
    array = np.zeros(200_000)
    before = reading(tmp_path, array, "float[200000]").program.sha256
    assert reading(tmp_path, array, "float[200000]").program.sha256 == before
    array[199_999] = struct.unpack("<d", struct.pack("<Q", 1))[0]
    assert reading(tmp_path, array, "float[200000]").program.sha256 != before


# ---------------------------------------------------------------- what takes long

LOOP = """
soter 1;
fun f(n: int): int { var s = n; for i in 0..800 { for j in 0..80 { s = s + 1; } } return s; }
"""


def test_a_constant_that_takes_long_says_so_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expressions, "SLICE", 10_000)
    monkeypatch.setattr(constants_and_types, "MILLION", 1)
    told: list[str] = []
    assert check_file("m.soter", LOOP + "const A: int = f(1);\n", tell=told.append).ok
    assert len(told) > 8
    amounts = [int(t.removeprefix("constant `A`: ").split()[0]) for t in told]
    assert amounts == sorted(set(amounts))


@pytest.mark.parametrize(
    ("most", "together", "failing"), [(1000, 10**9, 3), (10**9, 150_000, 1), (10**6, 10**6, 0)]
)
def test_constants_may_take_only_so_much(
    monkeypatch: pytest.MonkeyPatch, most: int, together: int, failing: int
) -> None:
    monkeypatch.setattr(constants_and_types, "CONSTANT_BUDGET", most)
    monkeypatch.setattr(constants_and_types, "PROGRAM_BUDGET", together)
    text = LOOP + "".join(f"const A{i}: int = f({i});\n" for i in range(3))
    diagnostics = check_file("m.soter", text).diagnostics.items
    assert [d.code for d in diagnostics] == ["T020"] * failing
    assert all("takes too long to compute" in d.message for d in diagnostics)


def test_who_looked_at_a_check_is_told_nothing_after_it(tmp_path: Path) -> None:
    (tmp_path / "m.soter").write_text(LOOP + "const A: int = f(1);\n")
    told: list[str] = []
    program = soter.load(tmp_path / "m.soter", told.append)
    before = len(told)
    program._checked.diagnostics.tell("again")
    assert len(told) == before


def test_reading_a_table_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps([[1.0, 2.0]] * 60_000))
    told: list[str] = []
    text = 'soter 1;\nconst A: float[2][60000] = data "a.json";\n'
    assert check_file(str(tmp_path / "m.soter"), text, tell=told.append).ok
    assert told[0] == "reading `a.json`"
    assert "reading `a.json`: 57344 elements" in told
