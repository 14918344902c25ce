"""docs/recheck.md names every file of the re-checker once, with the lines of each step."""

from __future__ import annotations

import re
from pathlib import Path

import soter.certificate

ROOM = Path(soter.certificate.__file__).parent
PAGE = Path(__file__).parents[3] / "docs" / "recheck.md"
FILES = re.compile(r"`((?:\w+/)?(?:\w+\.py)?)`")


def rows(text: str, heading: str) -> list[list[str]]:
    """The cells of the rows of the table below a heading."""
    part = text.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    table = [x for x in part.splitlines() if x.startswith("| ")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table[1:]]


def test_every_file_is_on_the_list_once_and_each_step_has_its_lines() -> None:
    text = PAGE.read_text(encoding="utf-8")
    steps = [FILES.findall(row[2]) for row in rows(text, "The order")]
    lines = [int(row[3]) for row in rows(text, "The order")]
    made = [sum(len((ROOM / f).read_text().splitlines()) for f in step) for step in steps]
    assert all(abs(a - b) <= 0.02 * b for a, b in zip(lines, made, strict=True)), made
    extras = [f for row in rows(text, "Extras") for f in FILES.findall(row[1])]
    named = [f for step in steps for f in step]
    for extra in extras:
        folder = sorted(p.relative_to(ROOM).as_posix() for p in (ROOM / extra).glob("*.py"))
        named += folder if extra.endswith("/") else [extra]
    there = {p.relative_to(ROOM).as_posix() for p in ROOM.rglob("*.py")}
    told = {f for f in named if not f.endswith("__init__.py")}
    assert told == {f for f in there if not f.endswith("__init__.py")}
    assert len(named) == len(set(named))
