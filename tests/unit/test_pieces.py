"""Benchmarks in pieces: what is done is not done again, and a line that was cut is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.pieces import Pieces

if TYPE_CHECKING:
    from pathlib import Path


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    calls = []

    def make() -> list[int]:
        calls.append(1)
        return [len(calls)]

    assert Pieces(kept, "a").piece("x", make) == [1]
    kept.write_text(kept.read_text() + '{"key": "a y", "val')
    again = Pieces(kept, "a")
    assert again.piece("x", make) == [1]
    assert again.piece("y", make) == [2]
    assert Pieces(kept, "another program").piece("x", make) == [3]
    assert len(calls) == 3


def test_without_a_file_nothing_is_kept() -> None:
    assert Pieces(None, "a").piece("x", lambda: (1, 2)) == [1, 2]
