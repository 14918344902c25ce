"""docs/recheck.md names every file of the re-checker once, with the lines of each step.

A certificate without an extra imports nothing but what is on the list.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from bench.recheck import core_mutants
from bench.recheck.small_modules import PROGRAMS

import processes
import soter
import soter.certificate
from unit.certificate import small_proofs

ROOM = Path(soter.certificate.__file__).parent
REPO = Path(__file__).parents[3]
PAGE = REPO / "docs" / "recheck.md"
FILES = re.compile(r"`((?:\w+/)?(?:\w+\.py)?)`")


def rows(text: str, heading: str) -> list[list[str]]:
    """The cells of the rows of the table below a heading."""
    part = text.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    table = [x for x in part.splitlines() if x.startswith("| ")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in table[1:]]


def files_of(heading: str, cell: int) -> list[list[str]]:
    """What the rows of a table name in one of their cells."""
    return [FILES.findall(row[cell]) for row in rows(PAGE.read_text(encoding="utf-8"), heading)]


VERDICT = """import sys
from pathlib import Path
from soter.certificate.rechecker import recheck
print(recheck(Path(sys.argv[1]), workers=1).verdict)
"""
CHILD = """import sys
from pathlib import Path
sys.modules.update(z3=None, cffi=None)  # what the extra `recheck` does not bring, and what compiles
def started(event, told):
    assert event not in ("subprocess.Popen", "os.exec", "os.posix_spawn", "os.system"), told
sys.addaudithook(started)
from soter.certificate.rechecker import recheck
report = recheck(Path(sys.argv[1]), workers=1)
assert report.accepted, report.reason
print(*(m for m in sys.modules if m.startswith("soter.certificate.")))
"""


def a_small_certificate(name: str, folder: Path) -> Path:
    (folder / "small.soter").write_text(PROGRAMS[name])
    facts = small_proofs.facts_of(folder / "small.soter", "S", "M")
    made = small_proofs.prove(facts, ((50,),))
    entry, program = made["entry"] | {"system": "S"}, {"small.soter": PROGRAMS[name]}
    recover = facts.symbol.verify.recover
    entry["recover_ns"] = None if recover is None else 30 * 10**9
    small_proofs.write(folder / "cert", program, "small.soter", [entry], made["sets"])
    return folder / "cert"


@pytest.mark.parametrize("name", ["written", "assumed", "examples/wall/cart.soter"])
def test_a_plain_certificate_starts_nothing_and_imports_only_what_is_on_the_list(
    name: str, tmp_path: Path
) -> None:
    if name in PROGRAMS:
        cert = a_small_certificate(name, tmp_path)
    else:
        cert = tmp_path / "cert"
        soter.load(REPO / name).verify(cert=cert, refute=False)
    run = [sys.executable, "-c", CHILD, str(cert)]
    said = processes.run(run, capture_output=True, text=True, env={"PATH": "/nowhere"})
    assert said.returncode == 0, said.stderr
    parts = [m.removeprefix("soter.certificate.").replace(".", "/") for m in said.stdout.split()]
    here = {f"{p}.py" for p in parts if not (ROOM / p).is_dir()}
    listed = {f for step in files_of("The order", 2) for f in step}
    beside = {f for row in files_of("Beside the verdict", 1) for f in row}
    assert here <= listed | beside
    assert {"rechecker.py", "grid/grid_group.py", "reading/derived_times.py"} <= here


@pytest.mark.parametrize(("words", "verdict"), [([], "accepted"), (["-O"], "not re-checked")])
def test_without_its_assertions_a_re_check_confirms_nothing(
    words: list[str], verdict: str, tmp_path: Path
) -> None:
    """Some of what the front end promises it asserts, which `python -O` would leave out."""
    run = [sys.executable, *words, "-c", VERDICT, str(a_small_certificate("written", tmp_path))]
    assert processes.run(run, capture_output=True, text=True).stdout.strip() == verdict


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


def test_what_judges_mutants_is_there_and_so_is_what_it_judges() -> None:
    assert all((ROOM / part).exists() for part in core_mutants.TESTED_BY)
    judges = {test for file in core_mutants.core() for test in core_mutants.judges(file)}
    assert all(Path(test).is_file() for test in judges)


def test_each_argument_for_a_harmless_mutant_is_of_one_that_there_is() -> None:
    mutants = {
        f"{m.file} {m.what}" for file in core_mutants.core() for m in core_mutants.mutants(file)
    }
    assert core_mutants.harmless().keys() <= mutants
