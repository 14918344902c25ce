"""docs/recheck.md names every file of the re-checker once, with the lines of each step.

A certificate without an extra runs nothing but what is on the list.
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

import soter.certificate
from soter.certificate.rechecker import recheck
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from types import FrameType

ROOM = Path(soter.certificate.__file__).parent
PAGE = Path(__file__).parents[3] / "docs" / "recheck.md"
FILES = re.compile(r"`((?:\w+/)?(?:\w+\.py)?)`")


def rows(text: str, heading: str) -> list[list[str]]:
    """The cells of the rows of the table below a heading."""
    part = text.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    table = [x for x in part.splitlines() if x.startswith("| ")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table[1:]]


def files_of(heading: str, cell: int) -> list[list[str]]:
    """What the rows of a table name in one of their cells."""
    return [FILES.findall(row[cell]) for row in rows(PAGE.read_text(encoding="utf-8"), heading)]


@pytest.mark.parametrize("name", ["written", "assumed", "steps"])
def test_a_plain_certificate_runs_nothing_but_what_is_on_the_list(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "small.soter").write_text(PROGRAMS[name])
    facts = small_proofs.facts_of(tmp_path / "small.soter", "S", "M")
    made = small_proofs.prove(facts, ((50,),))
    entry, program = made["entry"] | {"system": "S"}, {"small.soter": PROGRAMS[name]}
    recover = facts.symbol.verify.recover
    entry["recover_ns"] = None if recover is None else 30 * 10**9
    small_proofs.write(tmp_path / "cert", program, "small.soter", [entry], made["sets"])
    ran: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED:  # no class's body
            ran.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        report = recheck(tmp_path / "cert", workers=1)
    finally:
        sys.setprofile(None)
    assert report.accepted, report.reason
    inside = [p for p in map(Path, ran) if p.is_relative_to(ROOM)]
    here = {p.relative_to(ROOM).as_posix() for p in inside}
    listed = {f for step in files_of("The order", 2) for f in step}
    beside = {f for row in files_of("Beside the verdict", 1) for f in row}
    assert here - beside <= listed
    assert {"rechecker.py", "grid/grid_group.py", "reading/derived_times.py"} <= here


def test_every_file_is_on_the_list_once_and_each_step_has_its_lines() -> None:
    text = PAGE.read_text(encoding="utf-8")
    steps = files_of("The order", 2)
    lines = [int(row[3]) for row in rows(text, "The order")]
    made = [sum(len((ROOM / f).read_text().splitlines()) for f in step) for step in steps]
    assert all(abs(a - b) <= 0.02 * b for a, b in zip(lines, made, strict=True)), made
    tables = (*files_of("Extras", 1), *files_of("Beside the verdict", 1))
    extras = [f for row in tables for f in row]
    named = [f for step in steps for f in step]
    for extra in extras:
        folder = sorted(p.relative_to(ROOM).as_posix() for p in (ROOM / extra).glob("*.py"))
        named += folder if extra.endswith("/") else [extra]
    there = {p.relative_to(ROOM).as_posix() for p in ROOM.rglob("*.py")}
    told = {f for f in named if not f.endswith("__init__.py")}
    assert told == {f for f in there if not f.endswith("__init__.py")}
    assert len(named) == len(set(named))
