"""Files that a program names: whatever they are, they end in a diagnostic, and soon."""

from __future__ import annotations

import io
import json
import os
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.diagnostics.render import render_all
from soter.language.front_end import CheckResult, check_file
from soter.language.load.loader import MAX_DATA_BYTES, MAX_FILE_BYTES
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

WINDOWS = sys.platform == "win32"


def codes(checked: CheckResult) -> list[str]:
    assert render_all(checked.diagnostics.items)
    return [d.code for d in checked.diagnostics.items]


def importing(folder: Path, name: str) -> CheckResult:
    return check_file(str(folder / "main.soter"), f'soter 1;\nimport "{name}" as other;\n')


def reading(folder: Path, name: str, t: str = "float[2]") -> CheckResult:
    text = f'soter 1;\nconst A: {t} = data "{name}";\n'
    return check_file(str(folder / "main.soter"), text)


# ---------------------------------------------------------------- the program itself


def test_a_program_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "robot.soter").write_text("soter 1;\n")
    checked = check_file(str(tmp_path / "robott.soter"))
    assert codes(checked) == ["D001"]
    assert "robot.soter" in checked.diagnostics.items[0].helps[0]
    assert checked.program is None
    assert not checked.ok


def test_a_program_that_is_a_folder(tmp_path: Path) -> None:
    assert codes(check_file(str(tmp_path))) == ["D005"]


def test_a_program_with_an_impossible_name() -> None:
    assert codes(check_file("a\0b.soter")) == ["D005"]
    assert codes(check_file("x" * 5000)) == ["D005"]


def test_a_program_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "large.soter"
    path.write_bytes(b" " * (MAX_FILE_BYTES + 1))
    assert codes(check_file(str(path))) == ["D005"]


def test_a_program_that_is_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "latin.soter"
    path.write_bytes(b"soter 1;\n\n// caf\xe9\n")
    checked = check_file(str(path))
    assert codes(checked) == ["D005"]
    assert "line 3" in checked.diagnostics.items[0].notes[0]


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "bom.soter"
    path.write_bytes(b"\xef\xbb\xbfsoter 1;\nconst A: float = 1.0;\n")
    assert check_file(str(path)).ok


@pytest.mark.skipif(WINDOWS or os.geteuid() == 0, reason="root may read everything")
def test_a_program_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "secret.soter"
    path.write_text("soter 1;\n")
    path.chmod(0)
    assert codes(check_file(str(path))) == ["D005"]


@pytest.mark.skipif(WINDOWS, reason="needs /dev")
def test_a_device_is_read_only_as_far_as_a_program_may_be_long() -> None:
    assert codes(check_file("/dev/zero")) == ["D005"]


# ---------------------------------------------------------------- imports


@pytest.mark.parametrize("name", ["", ".", "..", "nothing.soter", "a/b/c.soter", "main.soter/x"])
def test_an_import_that_is_no_file(tmp_path: Path, name: str) -> None:
    (tmp_path / "main.soter").write_text("soter 1;\n")
    assert set(codes(importing(tmp_path, name))) <= {"D001", "D005"}


@pytest.mark.skipif(WINDOWS, reason="needs symbolic links")
def test_symbolic_links_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "a.soter").symlink_to(tmp_path / "b.soter")
    (tmp_path / "b.soter").symlink_to(tmp_path / "a.soter")
    assert codes(importing(tmp_path, "a.soter")) == ["D005"]
    assert codes(check_file(str(tmp_path / "a.soter"))) == ["D005"]


@pytest.mark.skipif(WINDOWS, reason="needs symbolic links")
def test_what_is_like_a_missing_file_is_told_beside_links_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "table.json").write_text("[1.0, 2.0]")
    (tmp_path / "tables.json").symlink_to("tables.json")
    (told,) = reading(tmp_path, "tabel.json").diagnostics.items
    assert told.code == "D001"
    assert told.helps == (f"did you mean `{tmp_path / 'table.json'}`?",)


@pytest.mark.skipif(WINDOWS, reason="needs symbolic links")
def test_a_file_that_imports_itself_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "main.soter").write_text('soter 1;\nimport "link.soter" as me;\n')
    (tmp_path / "link.soter").symlink_to(tmp_path / "main.soter")
    assert codes(check_file(str(tmp_path / "main.soter"))) == ["D002"]


@pytest.mark.skipif(WINDOWS, reason="needs named pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.soter")
    os.mkfifo(tmp_path / "pipe.json")
    assert codes(importing(tmp_path, "pipe.soter")) == ["D005"]
    assert codes(reading(tmp_path, "pipe.json")) == ["D005"]


@pytest.mark.skipif(WINDOWS, reason="needs /dev")
def test_devices_are_not_imported(tmp_path: Path) -> None:
    assert codes(importing(tmp_path, "/dev/zero")) == ["D005"]


def test_an_import_with_errors_is_reported_in_its_own_file(tmp_path: Path) -> None:
    (tmp_path / "lib.soter").write_text("soter 1;\nconst A: int = 1.5;\n")
    text = 'soter 1;\nimport "lib.soter" as lib;\nconst B: int = lib.A;\nconst C: int = 2.5;\n'
    checked = check_file(str(tmp_path / "main.soter"), text)
    assert codes(checked) == ["T001", "T001"]
    places = [d.primary.span.source.name for d in checked.diagnostics.items if d.primary]
    assert [p.rpartition(os.sep)[2] for p in places] == ["main.soter", "lib.soter"]


def test_one_file_imported_twice_is_read_once(tmp_path: Path) -> None:
    (tmp_path / "lib.soter").write_text("soter 1;\ntype T = enum { A, B };\n")
    text = (
        'soter 1;\nimport "lib.soter" as one;\nimport "./lib.soter" as two;\n'
        "fun f(t: one.T): bool { return t == two.T.A; }\n"
    )
    assert check_file(str(tmp_path / "main.soter"), text).ok


def test_a_long_chain_of_imports(tmp_path: Path) -> None:
    for i in range(1500):
        text = f'soter 1;\nimport "m{i + 1}.soter" as next_one;\nconst A: int = next_one.A + 1;\n'
        (tmp_path / f"m{i}.soter").write_text(text)
    (tmp_path / "m1500.soter").write_text("soter 1;\nconst A: int = 0;\n")
    checked = check_file(str(tmp_path / "m0.soter"))
    assert checked.ok
    assert checked.program is not None
    assert checked.program.consts["A"].value == 1500


def test_a_long_circle_of_imports(tmp_path: Path) -> None:
    for i in range(1500):
        text = f'soter 1;\nimport "m{(i + 1) % 1500}.soter" as other;\n'
        (tmp_path / f"m{i}.soter").write_text(text)
    checked = check_file(str(tmp_path / "m0.soter"))
    assert codes(checked) == ["D002"]
    assert len(checked.diagnostics.items[0].notes[0]) < 200


# ---------------------------------------------------------------- data

GIANT = "1" * 400
DEEP = "[" * 100_000


@all_rows(
    "text",
    [
        "",
        "{}",
        "[1.0]",
        "[1.0, 2.0, 3.0]",
        "[1.0, null]",
        '[1.0, "two"]',
        "[1.0, true]",
        "[1.0, [2.0]]",
        "[1.0, NaN]",
        "[1.0, Infinity]",
        '[1.0, "NaN"]',
        "[1.0, 1e999]",
        f"[1.0, {GIANT}]",
        f"[1.0, {'1' * 10_000}]",
        DEEP,
        "[1.0, 2.0",
        "\x00\x01",
        '{"$comment": "nothing else"}',
        "[1_000, 2.0]",
        "[1.0, \u0663]",
    ],
)
def test_bad_json(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    assert codes(reading(tmp_path, "a.json")) == ["D004"]


def test_a_name_that_stands_twice_in_json(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"x": 1.0, "x": 2.0}')
    checked = reading(tmp_path, "a.json", "{ x: float }")
    assert codes(checked) == ["D004"]
    label = checked.diagnostics.items[0].primary
    assert label is not None
    assert "`x` is given twice" in label.text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1.0\n",
        "1.0,2.0,3.0\n",
        "1.0,nan\n",
        "1.0,inf\n",
        "1.0,\n",
        '1.0,"2\n',
        "1.0,\x002\n",
        "1.0,1_000\n",
        "1.0,\u0663\n",
        "1.0,\uff12\n",
    ],
)
def test_bad_csv(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    assert codes(reading(tmp_path, "a.csv")) == ["D004"]


def test_a_csv_cell_that_is_very_long(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1.0," + "x" * 1_000_000 + "\n")
    checked = reading(tmp_path, "a.csv")
    assert codes(checked) == ["D004"]
    assert len(render_all(checked.diagnostics.items)) < 1000


def npy(array: object) -> bytes:
    out = io.BytesIO()
    np.save(out, np.asarray(array))
    return out.getvalue()


WITH_A_HUGE_SHAPE = npy([1.0, 2.0]).replace(b"(2,), }" + b" " * 8, b"(999999999,), }", 1)
OF_LISTS_IN_LISTS = npy(np.zeros((10**6, *[1] * 30), dtype=bool))


@all_rows(
    "content",
    [
        b"",
        b"\x93NUMPY",
        npy([1.0, 2.0])[:-1],
        npy([1.0, 2.0, 3.0]),
        npy([[1.0, 2.0]]),
        npy(1.0),
        npy([1.0, float("nan")]),
        npy([1.0 + 2.0j, 2.0]),
        OF_LISTS_IN_LISTS,
        npy(["a", "b"]),
        npy(np.array([(1.0, 2)], dtype=[("x", "f8"), ("n", "i4")])),
        npy(np.array(["2020-01-01", "2020-01-02"], dtype="datetime64[D]")),
        WITH_A_HUGE_SHAPE,
        b"PK\x03\x04 a zip archive",
        b"\x93NUMPY\x01\x00\x10\x00{'descr': __import__('os')}",
        b"\x93NUMPY\x09\x00\xff\xff\xff\xff",
    ],
)
def test_bad_npy(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    assert codes(reading(tmp_path, "a.npy")) == ["D004"]


@pytest.mark.parametrize("count", [10**6, 10**9])
def test_an_npy_of_too_many_empty_lists(tmp_path: Path, count: int) -> None:
    np.save(tmp_path / "a.npy", np.zeros((count, 0)))
    checked = reading(tmp_path, "a.npy", "float[<=2][3]")
    assert codes(checked) == ["D004"]
    label = checked.diagnostics.items[0].primary
    assert label is not None
    assert ("too large" in label.text) == (count > 10**6)


def test_an_npy_of_empty_lists_is_one(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((3, 0)))
    assert reading(tmp_path, "a.npy", "float[<=2][3]").ok


def test_objects_are_never_unpickled(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([1.0, None], dtype=object), allow_pickle=True)
    assert codes(reading(tmp_path, "a.npy")) == ["D004"]


@pytest.mark.parametrize("dtype", ["f8", "f4", ">f8", "i4", "u1"])
def test_good_npy(tmp_path: Path, dtype: str) -> None:
    np.save(tmp_path / "a.npy", np.array([1, 2], dtype=dtype))
    wanted = "float" if dtype.lstrip(">")[0] == "f" else "int"
    assert reading(tmp_path, "a.npy", f"{wanted}[2]").ok


def test_data_that_is_too_large(tmp_path: Path) -> None:
    with (tmp_path / "a.json").open("wb") as file:
        file.truncate(MAX_DATA_BYTES + 1)
    assert codes(reading(tmp_path, "a.json")) == ["D005"]


@pytest.mark.parametrize("name", ["", ".", "a", "a.txt", "a.json/b.json", "\x07.json"])
def test_a_data_path_that_is_no_data_file(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.json").write_text("[1.0, 2.0]")
    assert set(codes(reading(tmp_path, name))) <= {"D001", "D004", "D005", "L002", "L003", "L004"}


def test_the_data_belongs_to_the_hash_of_the_program(tmp_path: Path) -> None:
    hashes = set()
    for number in (1.0, 2.0):
        (tmp_path / "a.json").write_text(json.dumps([number, number]))
        checked = reading(tmp_path, "a.json")
        assert checked.program is not None
        hashes.add(checked.program.sha256)
    assert len(hashes) == 2
