"""The cache: made once, whole or not at all, ours alone, and not for ever."""

from __future__ import annotations

import os
import sys
import time
from typing import TYPE_CHECKING

import pytest

import processes
from soter.diagnostics.diagnostic import SoterError
from soter.native import cache
from soter.native.cache import cached_folder, find_cached
from soter.native.shared_library import objects

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

A, B = "a" * 64, "b" * 64
OLD_S = 2 * cache.YOUNG_S


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_ours", set())
    monkeypatch.setattr(cache, "LOOK_S", 0.0)
    return tmp_path / "cache"


def maker(text: str = "it") -> tuple[Callable[[Path], None], list[Path]]:
    calls: list[Path] = []

    def make(work: Path) -> None:
        calls.append(work)
        (work / "file").write_text(text)
        (work / "left over").write_text("not asked for")

    return make, calls


def get(content: str = A, text: str = "it") -> tuple[Path, bool]:
    """The entry, and whether it was made now."""
    make, calls = maker(text)
    return cached_folder("thing", content, ("file",), make), bool(calls)


def forget(entry: Path, seconds_ago: float = OLD_S) -> None:
    """As if another process had used it last, so long ago."""
    cache._ours.discard(entry)
    then = time.time() - seconds_ago
    os.utime(entry, (then, then))


def refusal() -> str:
    with pytest.raises(SoterError, match="X006") as caught:
        get()
    return caught.value.diagnostics[0].message


# ---------------------------------------------------------------- once and whole


def test_it_is_made_once_with_nothing_beside_what_was_asked_for() -> None:
    entry, made = get()
    assert made
    assert sorted(p.name for p in entry.iterdir()) == ["file", "seals"]
    assert get() == (entry, False)
    assert find_cached("thing", A, ("file",)) == entry


def test_other_content_is_made_anew() -> None:
    assert get(A)[0] != get(B)[0]
    assert find_cached("thing", "c" * 64, ("file",)) is None


@pytest.mark.parametrize("damaged", ["file", "seals"])
@pytest.mark.parametrize("damage", [b"", b"half", b"\xff\xfe", None])
def test_what_is_damaged_is_made_anew(damaged: str, damage: bytes | None) -> None:
    entry, _ = get()
    if damage is None:
        (entry / damaged).unlink()
    else:
        (entry / damaged).write_bytes(damage)
    assert get() == (entry, True)
    assert (entry / "file").read_text() == "it"


def test_an_entry_under_the_name_of_another_is_not_taken() -> None:
    entry, _ = get(A)
    other, _ = get(B, "something else")
    entry.rename(entry.with_name("aside"))
    other.rename(entry)
    assert get(A) == (entry, True)
    assert (entry / "file").read_text() == "it"


def test_what_cannot_be_made_leaves_nothing_behind(folder: Path) -> None:
    def make(work: Path) -> None:
        (work / "file").write_text("half")
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        cached_folder("thing", A, ("file",), make)
    assert list(folder.iterdir()) == []


def test_one_who_was_faster_is_left_alone(folder: Path) -> None:
    def make(work: Path) -> None:
        get(A, "the faster one")
        (work / "file").write_text("the slower one")

    entry = cached_folder("thing", A, ("file",), make)
    assert (entry / "file").read_text() == "the faster one"
    assert {p.name for p in folder.iterdir()} == {entry.name, cache.LOOKED_FILE}


# ---------------------------------------------------------------- ours alone


def test_only_we_may_enter_what_we_make(folder: Path) -> None:
    before = os.umask(0)
    try:
        entry, _ = get()
    finally:
        os.umask(before)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert entry.stat().st_mode & 0o777 == 0o700
    assert {p.stat().st_mode & 0o777 for p in entry.iterdir()} == {0o600}


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o1777])
def test_a_folder_that_others_may_write_to_is_refused(folder: Path, mode: int) -> None:
    get()
    folder.chmod(mode)
    assert refusal() == f"the cache folder `{folder}` is not used: others may write to it"
    folder.chmod(0o755)
    assert get()[1] is False, "others may read it"


def test_a_folder_of_another_user_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    get()
    if os.geteuid() == 0:
        os.chown(folder, 12345, 12345)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert refusal() == f"the cache folder `{folder}` is not used: it belongs to another user"


@pytest.mark.parametrize("name", ["", "file", "seals"])
def test_what_others_could_have_written_is_made_anew(name: str) -> None:
    entry, _ = get()
    (entry / name).chmod(0o777)
    assert get() == (entry, True)


@pytest.mark.parametrize("name", ["", "file", "seals"])
def test_what_belongs_to_another_user_is_made_anew(name: str) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root may give files away")
    entry, _ = get()
    os.chown(entry / name, 12345, 12345)
    assert get() == (entry, True)


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    entry, _ = get()
    (entry / "file").rename(tmp_path / "elsewhere")
    (entry / "file").symlink_to(tmp_path / "elsewhere")
    assert get() == (entry, True)


def test_a_folder_that_cannot_be_made_is_said(folder: Path) -> None:
    folder.write_text("a file")
    assert refusal().startswith(f"cannot write to the cache folder `{folder}`")


# ---------------------------------------------------------------- room


def test_the_least_recently_used_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [get(c * 64, "x" * 400_000)[0] for c in "abc"]
    for entry, ago in zip(entries, (3, 2, 4), strict=True):
        forget(entry, ago * OLD_S)
    monkeypatch.setenv("SOTER_CACHE_MB", "1")
    last = get("d" * 64, "x" * 400_000)[0]
    assert [e.exists() for e in entries] == [False, True, False]
    assert last.exists()


def test_using_one_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    used, unused = get("a" * 64, "x" * 400_000)[0], get("b" * 64, "x" * 400_000)[0]
    forget(used, 3 * OLD_S)
    forget(unused)
    assert get("a" * 64)[1] is False
    monkeypatch.setattr(cache, "_ours", set())
    monkeypatch.setenv("SOTER_CACHE_MB", "1")
    get("c" * 64, "x" * 400_000)
    assert (used.exists(), unused.exists()) == (True, False)


def test_what_this_process_made_or_another_may_be_loading_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SOTER_CACHE_MB", "0")
    mine, others = get(A)[0], get(B)[0]
    forget(others, cache.YOUNG_S / 2)
    os.utime(mine, (0, 0))
    get("c" * 64)
    assert (mine.exists(), others.exists()) == (True, True)


def test_processes_look_for_room_once_a_minute_but_for_another_limit_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cache, "LOOK_S", 60.0)
    monkeypatch.setenv("SOTER_CACHE_MB", "1")
    old = [get(c * 64, "x" * 400_000)[0] for c in "abc"]
    for entry in old:
        forget(entry)
    get("d" * 64)
    assert all(entry.exists() for entry in old)
    monkeypatch.setenv("SOTER_CACHE_MB", "0")
    get("e" * 64)
    assert not any(entry.exists() for entry in old)


@pytest.mark.parametrize(("seconds_ago", "looks"), [(1.0, False), (61.0, True), (-3600.0, True)])
def test_one_process_looks_for_room_and_another_does_not_at_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch, seconds_ago: float, looks: bool
) -> None:
    monkeypatch.setattr(cache, "LOOK_S", 60.0)
    get(A)
    then = time.time() - seconds_ago
    os.utime(folder / cache.LOOKED_FILE, (then, then))
    text = (
        "from soter.native import cache\n"
        "cache._entries_in = lambda folder: print('looks') or []\n"
        "cache.cached_folder('thing', 'b' * 64, ('file',), lambda at: (at / 'file').touch())\n"
    )
    done = processes.run((sys.executable, "-c", text), capture_output=True, check=True)
    assert done.stdout == (b"looks\n" if looks else b"")


def test_files_of_a_person_in_that_folder_are_never_removed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOTER_CACHE_MB", "0")
    (folder / "thesis").mkdir(parents=True, mode=0o700)
    (folder / "thesis" / "chapter").write_text("long")
    for path in (folder / "thesis" / "chapter", folder / "thesis"):
        os.utime(path, (0, 0))
    get()
    assert (folder / "thesis" / "chapter").exists()


def test_a_limit_that_is_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOTER_CACHE_MB", "1 GB")
    assert refusal() == "SOTER_CACHE_MB is `1 GB`"


# ---------------------------------------------------------------- objects


@pytest.fixture
def sources(tmp_path: Path) -> tuple[Path, ...]:
    for name in ("one", "two"):
        text = f'#include "both.h"\nint {name}(void);\nint {name}(void) {{ return BOTH; }}\n'
        (tmp_path / f"{name}.c").write_text(text)
    (tmp_path / "both.h").write_text("#define BOTH 1\n")
    return tmp_path / "one.c", tmp_path / "two.c"


def test_objects_are_compiled_once(sources: tuple[Path, ...]) -> None:
    first = objects(sources, ())
    assert [path.name for path in first] == ["one.o", "two.o"]
    made = [path.stat().st_mtime_ns for path in first]
    assert objects(sources, ()) == first
    assert [path.stat().st_mtime_ns for path in first] == made


def test_objects_depend_on_flags_and_on_what_is_included(
    sources: tuple[Path, ...], tmp_path: Path
) -> None:
    first = objects(sources, ())
    assert objects(sources, ("-O1",)) != first
    (tmp_path / "both.h").write_text("#define BOTH 2\n")
    assert objects(sources, ()) != first


def test_what_does_not_compile_is_said_in_the_compilers_words(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.c"
    wrong.write_text("int wrong(void) { return missing; }\n")
    with pytest.raises(SoterError, match="X004") as caught:
        objects((wrong,), ())
    assert any("missing" in note for note in caught.value.diagnostics[0].notes)
