"""A table that is one test tries all its rows, names those that fail, and starts each afresh."""

from __future__ import annotations

import inspect
import os
import re
import shutil
import sys
from typing import TYPE_CHECKING

import pytest

import processes
import tables
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path


def test_every_row_that_fails_is_named_and_no_other() -> None:
    tried = []

    @all_rows(("one", "other"), [(1, 1), (2, 3), (4, 4), ("five", 6)])
    def equal(one: object, other: object) -> None:
        tried.append(one)
        if one == "five":
            pytest.fail("not this one")
        assert one == other

    with pytest.raises(AssertionError) as caught:
        equal()
    assert tried == [1, 2, 4, "five"]
    first, *rows = str(caught.value).splitlines()
    assert first == "2 of 4 rows"
    assert [row.partition(":")[0] for row in rows] == ["2, 3", "five, 6"]
    assert "not this one" in rows[1]
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize("ids", [["a", "b"], lambda number: "ab"[number]])
def test_rows_have_the_names_they_are_given(ids: object) -> None:
    @all_rows("number", range(2), ids=ids)  # type: ignore[arg-type]
    def none(number: int) -> None:
        assert number == 0

    with pytest.raises(AssertionError, match=r"^1 of 2 rows\nb: "):
        none()


def test_tables_over_each_other_are_all_their_pairs() -> None:
    tried = []

    @all_rows("one", "ab")
    @all_rows("other", "xyz")
    def pair(one: str, other: str, shared: list[str]) -> None:
        tried.append(one + other)
        assert shared == ["the same"]

    assert list(inspect.signature(pair).parameters) == ["shared"]
    pair(shared=["the same"])
    assert sorted(tried) == ["ax", "ay", "az", "bx", "by", "bz"]
    with pytest.raises(AssertionError, match=r"^6 of 6 rows\nx, a: "):
        pair(shared=[])


def test_a_row_is_not_touched_by_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("OF_THE_TABLE", "1")

    @all_rows("number", range(3))
    def alone(
        number: int,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        assert list(tmp_path.iterdir()) == []
        (tmp_path / "file").touch()
        assert "OF_A_ROW" not in os.environ
        assert "OF_THE_TABLE" in os.environ
        monkeypatch.setenv("OF_A_ROW", "1")
        print(number)
        assert capsys.readouterr().out == f"{number}\n"
        print("left behind")

    alone(tmp_path=tmp_path, monkeypatch=monkeypatch, capsys=capsys)
    assert "OF_A_ROW" not in os.environ


def test_a_row_that_skips_hides_neither_what_passes_nor_what_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @all_rows("number", range(3))
    def skips(number: int, worst: int, some: tuple[int, ...]) -> None:
        if number in some:
            pytest.skip("no tool")
        assert number < worst

    told: list[str] = []
    monkeypatch.setattr("tables._left_out", told)
    skips(worst=3, some=(1,))
    assert told == ["1 of 3 rows\n1: no tool"]
    with pytest.raises(AssertionError, match=r"^1 of 3 rows\n2: "):
        skips(worst=2, some=(1,))
    with pytest.raises(pytest.skip.Exception, match=r"^3 of 3 rows\n0: no tool"):
        skips(worst=2, some=(0, 1, 2))
    told.clear()  # of this test itself all rows were tried


TOLD = """
import pytest
from tables import all_rows

@all_rows("number", range(3))
def test_table(number):
    if number == 1:
        pytest.skip("no tool")

def test_loop():
    for name, values in {"first": [1, 2], "second": [3, -4]}.items():
        for value in values:
            assert value > 0

def test_raises():
    left = 3
    while left > 0:
        left -= 1
        if left < 2:
            with pytest.raises(ValueError):
                int("2")

def test_behind():
    for name in "ab":
        pass
    assert name == "c"
"""


@pytest.mark.parametrize("workers", [(), ("-p", "xdist", "-n", "1")], ids=["here", "elsewhere"])
def test_what_is_told_of_rows_at_the_end(tmp_path: Path, workers: tuple[str, ...]) -> None:
    """In a folder of tests of its own, where `tables.py` lies."""
    shutil.copy(tables.__file__, tmp_path)
    (tmp_path / "test_rows.py").write_text(TOLD, encoding="utf-8")
    words = [sys.executable, "-m", "pytest", "-p", "tables", *workers, "test_rows.py"]
    alone = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = processes.run(words, capture_output=True, text=True, cwd=tmp_path, env=alone)
    assert "3 failed, 1 passed" in done.stdout
    assert "ROWS LEFT OUT test_rows.py::test_table: 1 of 3 rows\n1: no tool" in done.stdout
    rows = re.findall(r"- row of the loop -+\n(.*)", done.stdout)
    assert sorted(rows) == ["left = 1", "name = 'second', values = [3, -4], value = -4"]


def test_rows_are_chosen_by_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    @all_rows("word", ["one", "two", "three"])
    def chosen(word: str) -> None:
        tried.append(word)

    monkeypatch.setattr("tables._asked", {"row": "t"})
    chosen()
    assert tried == ["two", "three"]
    monkeypatch.setattr("tables._asked", {"row": "none of them"})
    with pytest.raises(pytest.skip.Exception):
        chosen()


def test_rows_that_are_dear_are_made_when_they_are_tried() -> None:
    made = []

    def rows() -> list[int]:
        made.append("now")
        return [1, 2]

    @all_rows("number", rows)
    def small(number: int) -> None:
        assert number < 2

    assert made == []
    with pytest.raises(AssertionError, match=r"^1 of 2 rows\n2: "):
        small()
    assert made == ["now"]


def test_a_table_without_rows_does_not_pass() -> None:
    @all_rows("word", [])
    def empty(word: str) -> None:
        assert word

    with pytest.raises(pytest.skip.Exception):
        empty()
