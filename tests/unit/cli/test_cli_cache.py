"""`soter cache`: what is there, gone when asked, below what was said."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

import pytest

from soter.native import cache

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]


@pytest.fixture
def folder(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SOTER_CACHE", str(here / "cache"))
    monkeypatch.delenv("SOTER_CACHE_MB", raising=False)
    monkeypatch.setattr(cache, "LOOK_S", 0.0)  # each entry is another process's
    return here / "cache"


def made(name: str, size: int, age_s: float) -> Path:
    """An entry of another process, `size` bytes large, used `age_s` ago."""
    with cache.new_entry(name, "0" * 32, ("data",)) as entry:
        (entry / "data").write_bytes(bytes(size))
    path = cache.cache_dir().absolute() / f"{name}-{'0' * 32}"
    cache._ours.discard(path)
    then = time.time() - age_s
    os.utime(path, (then, then))
    return path


@pytest.mark.usefixtures("folder")
def test_an_empty_cache(soter: Soter) -> None:
    document = soter("cache", "--json").document
    assert (document["entries"], document["bytes"], document["removed"]) == (0, 0, None)
    assert document["limit_bytes"] == 2_048_000_000
    assert soter("cache", "clear").exit == 0


def test_what_it_holds(soter: Soter, folder: Path) -> None:
    made("a", 3_000_000, 7200)
    (folder / "notes.txt").write_text("not ours")
    done = soter("cache")
    assert f"folder   {folder}\n" in done.out
    assert "holds    3 MB in 1 entry\n" in done.out
    assert "limit    2.05 GB (by default)\n" in done.out
    assert "oldest   used 2 hours ago" in done.out


def test_clear_removes_all_entries_and_nothing_else(soter: Soter, folder: Path) -> None:
    entry = made("a", 1000, 0)
    (folder / "notes.txt").write_text("not ours")
    document = soter("cache", "clear", "--json").document
    assert document["removed"]["entries"] == 1
    assert document["entries"] == 0
    assert not entry.exists()
    assert (folder / "notes.txt").exists()


def test_a_limit_is_kept_at_once_and_from_then_on(soter: Soter, folder: Path) -> None:
    old, newer, young = (
        made("old", 900_000, 9000),
        made("new", 900_000, 8000),
        made("y", 900_000, 1),
    )
    assert soter("cache", "limit", "2MB").exit == 0
    assert [p.exists() for p in (old, newer, young)] == [False, True, True]
    document = soter("cache", "--json").document
    assert document["limit_bytes"] == 2_000_000
    assert document["limit_from"] == str(folder / "limit")
    assert document["bytes"] < 2_000_000
    again = made("again", 900_000, 7000)
    assert (newer.exists(), again.exists()) == (False, True), "a new entry makes room for itself"
    soter("cache", "limit", "1GB")
    assert soter("cache", "--json").document["limit_bytes"] == 10**9


def test_the_environment_goes_before_the_file(
    soter: Soter, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    soter("cache", "limit", "7")
    assert folder.exists()
    monkeypatch.setenv("SOTER_CACHE_MB", "9")
    document = soter("cache", "--json").document
    assert (document["limit_bytes"], document["limit_from"]) == (9_000_000, "SOTER_CACHE_MB")
    monkeypatch.setenv("SOTER_CACHE_MB", "much")
    assert soter("cache", "--json").codes == ["X006"]


def test_a_spoilt_limit_says_how_to_mend_it(soter: Soter, folder: Path) -> None:
    soter("cache", "limit", "7")
    (folder / "limit").write_text("seven")
    done = soter("cache")
    assert done.exit == 1
    assert "soter cache limit 2048" in done.err
    assert soter("cache", "limit", "2048").exit == 0


@pytest.mark.usefixtures("folder")
def test_what_makes_no_sense(soter: Soter) -> None:
    for arguments in (("limit",), ("clear", "5"), ("limit", "-3"), ("polish",)):
        assert soter("cache", *arguments).exit == 2


def test_a_folder_that_cannot_be_used_is_told_in_words(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "file").write_text("in the way")
    monkeypatch.setenv("SOTER_CACHE", str(here / "file"))
    assert soter("cache", "limit", "5", "--json").codes == ["X006"]
    assert soter("cache", "--json").codes == ["X006"]
