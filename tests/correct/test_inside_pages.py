"""The pages docs/inside-*.md: Python prints what they show, and functions stand where they say.

A function is written with its parentheses, `core()`, in a paragraph, or in a row of a table, that
names its file or a folder above it; a function in C likewise. Blocks ```` ```pycon ```` are run as
doctest runs them.
"""

from __future__ import annotations

import doctest
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs").glob("inside-*.md"))
BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SOTER = ROOT / "src" / "soter"
ROOTS = (SOTER, ROOT / "src", ROOT)


def _passages(page: str) -> Iterator[str]:
    """Paragraphs and items of a page; each row of a table together with its head."""
    for part in re.split(r"\n\n|\n(?=- |\d+\. )", page):
        head, *rows = part.splitlines() or [""]
        yield from (f"{head}\n{row}" for row in rows) if head.startswith("|") else (part,)


def _places(passage: str, room: Path) -> list[Path]:
    """The files and folders that a passage names: of the room, or below `src/soter` or the root."""
    named = re.findall(r"`((?:[\w.]+/)*(?:\w+\.(?:py|c|h|soter)|\w+/))`", passage)
    found = {
        name: [p for p in (f / name for f in (room, *ROOTS)) if p.exists()][:1]
        or ([] if "/" in name else sorted(room.rglob(name)))
        for name in named
    }
    assert [name for name, places in found.items() if not places] == [], "files that are not there"
    return [place for places in found.values() for place in places]


def _defines(place: Path, name: str) -> bool:
    files = sorted(p for p in place.rglob("*") if p.is_file()) if place.is_dir() else [place]
    definition = re.compile(
        rf"^\s*(?:def|class|fun) {name}\b|^[\w][\w\s*]*\b{name}\([^;]*?\) \{{$", re.MULTILINE
    )
    code = (f for f in files if f.suffix in {".py", ".c", ".h", ".soter"})
    return any(definition.search(f.read_text(encoding="utf-8")) for f in code)


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.stem)
def test_functions_that_an_inside_page_names_stand_in_the_files_beside_them(path: Path) -> None:
    page = BLOCK.sub("", path.read_text(encoding="utf-8"))
    room = re.search(r"`src/soter/(\w+)/`", page)
    assert room, "the page says which room it is about"
    wrong, asked = [], 0
    for passage in _passages(page):
        places = _places(passage, SOTER / room[1])
        for name in re.findall(r"`(?:\w+\.)?(\w+)\(\)`", passage):
            asked += 1
            if not any(_defines(place, name) for place in places):
                wrong.append(f"{name}() is not in {[p.name for p in places]}")
    assert wrong == []
    assert asked >= 10


@pytest.mark.pages
@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.stem)
def test_python_prints_what_an_inside_page_shows(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    blocks = [m[2] for m in BLOCK.finditer(path.read_text(encoding="utf-8")) if m[1] == "pycon"]
    assert blocks, "the page shows what one sees on the way"
    test = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, path.name, str(path), 0)
    told: list[str] = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    failed, tried = doctest.DocTestRunner(optionflags=flags).run(test, out=told.append)
    assert tried >= len(blocks)
    assert failed == 0, "".join(told)
