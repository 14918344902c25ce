"""No test is left out in silence, and the page says how many examples the random ones draw."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

import processes
from generators.file_listing import files_below
from long_tests import COMMAND, examples
from quick_lines import QUICK

TESTS = Path(__file__).resolve().parents[1]
ROOT = TESTS.parent
TWO = """
import pytest

def test_quick():
    pass

@pytest.mark.long
def test_long():
    pass

@pytest.mark.real_time
def test_real_time():
    pass
"""
CALL = re.compile(r'examples\(\s*"(\w+)",\s*quick=([\d_]+),\s*long=([\d_]+)\s*\)')


@pytest.mark.parametrize(
    ("arguments", "ran"),
    [
        (("test_two.py",), 1),
        (("test_two.py", "-n", "2"), 1),
        (("test_two.py", "--long"), 2),
        (("test_two.py", "-m", "long"), 1),
        (("test_two.py", "-m", "real_time"), 1),
        (("test_two.py::test_long",), 1),
        (("test_two.py::test_real_time",), 1),
    ],
)
def test_what_is_left_out_is_told(tmp_path: Path, arguments: tuple[str, ...], ran: int) -> None:
    (tmp_path / "test_two.py").write_text(TWO, encoding="utf-8")
    markers = "[pytest]\nmarkers =\n long: takes long\n real_time: may fail\n"
    (tmp_path / "pytest.ini").write_text(markers, encoding="utf-8")
    done = processes.run(
        [sys.executable, "-m", "pytest", "-p", "long_tests", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(TESTS)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{ran} passed" in done.stdout
    left_out = {"long", "real_time"} if arguments[0] == "test_two.py" else set()
    left_out -= {*arguments, *(["long"] if "--long" in arguments else [])}
    assert ("long tests left out: 1, and" in done.stdout) == ("long" in left_out)
    assert ("real-time tests left out: 1; " in done.stdout) == ("real_time" in left_out)
    assert (COMMAND in done.stdout) == ("--long" not in arguments)


def test_a_table_has_as_many_lines_as_it_is_said_in_a_quick_run() -> None:
    (test, count), *_ = QUICK["correct/test_corner_programs.py"].items()
    file = "tests/correct/test_corner_programs.py"
    counts = []
    for more in ((), ("--long",)):
        command = [sys.executable, "-m", "pytest", "--collect-only", "-q", file, *more]
        done = processes.run(command, cwd=ROOT, capture_output=True, text=True)
        counts.append(done.stdout.count(f"::test_{test}["))
    assert 0 < counts[0] <= count < counts[1]


def test_every_table_that_is_cut_is_there() -> None:
    for file, tables in QUICK.items():
        text = (TESTS / file).read_text(encoding="utf-8")
        for name in tables:
            assert f"\ndef test_{name}(" in text, f"{file}: {name}"


def test_the_environment_decides_how_many_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("long_tests._asked", {"long": True})
    assert examples("SOTER_OF_THIS_TEST", quick=3, long=40) == 40
    monkeypatch.setattr("long_tests._asked", {"long": False})
    assert examples("SOTER_OF_THIS_TEST", quick=3, long=40) == 3
    monkeypatch.setenv("SOTER_OF_THIS_TEST", "7")
    assert examples("SOTER_OF_THIS_TEST", quick=3, long=40) == 7


def test_the_page_says_how_many_examples_are_tried() -> None:
    drawn = {
        variable: (int(quick), int(long))
        for path in files_below(TESTS, "test_*.py")
        if path != Path(__file__)
        for variable, quick, long in CALL.findall(path.read_text(encoding="utf-8"))
    }
    page = (ROOT / "docs" / "testing.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| .* \| `(SOTER_\w+)` \| ([\d,]+) \| ([\d,]+) \|$", page, re.MULTILINE)
    told = {v: (int(q.replace(",", "")), int(n.replace(",", ""))) for v, q, n in rows}
    assert told == drawn
    assert len(drawn) > 20


def test_the_command_for_everything_asks_for_it() -> None:
    recipes = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{COMMAND.split()[1]}:.*\n\t.*pytest.* --long$", recipes, re.MULTILINE)
