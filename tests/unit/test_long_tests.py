"""No test is left out in silence, and one scale and one seed are for all random ones."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

import pytest

import processes
from durations import (
    BUDGET_S,
    FIRST_S,
    SHARED,
    SHARED_S,
    TOTAL_S,
    Known,
    entered,
    quick_lines,
    read,
    text,
)
from generators.file_listing import files_below
from long_tests import COMMAND, SCALE, SEED, examples, seed_of, seeds

TESTS = Path(__file__).resolve().parents[1]
ROOT = TESTS.parent
TWO = """
import pytest

def test_quick():
    pass

@pytest.mark.long
def test_long():
    pass

@pytest.mark.pages
def test_page():
    pass

@pytest.mark.real_time
def test_real_time():
    pass
"""
MARKERS = """[pytest]
markers =
 long: takes long
 pages: of a page
 real_time: may fail
 whole: all lines
"""
BUSY = """
import time

import pytest

def busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

@pytest.fixture(scope="session")
def everybodys():
    busy(0.6)

@pytest.fixture(scope="module")
def shared(everybodys):
    busy(1.1)

@pytest.mark.parametrize("seconds", [0.0, 0.5, 0.7])
def test_table(shared, seconds):
    busy(seconds)

@pytest.mark.skip
def test_known():
    pass

@pytest.mark.skip
def test_unknown():
    pass

def test_cheap(shared):
    pass

@pytest.mark.pages
def test_page(shared):
    busy(0.4)
"""
DRAWN = """
import pytest
from long_tests import seed_of

@pytest.mark.random
def test_drawn():
    raise AssertionError(f"drew {seed_of(3)}")

def test_other():
    raise AssertionError
"""


@pytest.mark.parametrize(
    ("arguments", "ran"),
    [
        (("test_two.py",), 1),
        (("test_two.py", "-n", "2"), 1),
        (("test_two.py", "--all"), 3),
        (("test_two.py", "--rest"), 2),
        (("test_two.py", "-m", "pages"), 1),
        (("test_two.py", "-m", "long"), 1),
        (("test_two.py", "-m", "real_time"), 1),
        (("test_two.py::test_long",), 1),
        (("test_two.py::test_real_time",), 1),
    ],
)
def test_what_is_left_out_is_told(tmp_path: Path, arguments: tuple[str, ...], ran: int) -> None:
    (tmp_path / "test_two.py").write_text(TWO, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text(MARKERS, encoding="utf-8")
    done = processes.run(
        [sys.executable, "-m", "pytest", "-p", "long_tests", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(TESTS)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{ran} passed" in done.stdout
    left_out = {"long", "pages", "real_time"} if arguments[0] == "test_two.py" else set()
    left_out -= {*arguments, *(["long", "pages"] if {"--all", "--rest"} & {*arguments} else [])}
    assert ("long tests left out: 1; " in done.stdout) == ("long" in left_out)
    assert ("tests of pages left out: 1; " in done.stdout) == ("pages" in left_out)
    assert ("real-time tests left out: 1; " in done.stdout) == ("real_time" in left_out)
    assert (COMMAND in done.stdout) == bool(left_out & {"long", "pages"})


@pytest.mark.parametrize(
    ("lines", "count", "taken"),
    [
        ((), 7, 7),
        ((BUDGET_S, 0.1), 2, 1),
        ((BUDGET_S - 0.1, 0.1, 0.1), 3, 2),
        ((FIRST_S,), 1, 1),
        ((FIRST_S + 0.1,), 1, 0),
        ((FIRST_S, 0.0, 0.0, 0.1, 0.0), 5, 3),
        ((0.1, 0.1, None), 9, 2),
        ((0.1, 0.1), 3, 3),
        ((None,), 1, 1),
    ],
)
def test_a_quick_run_takes_a_first_line_and_what_fits(
    lines: tuple[float | None, ...], count: int, taken: int
) -> None:
    for shared, told in ((0.0, taken), (SHARED_S, taken), (SHARED_S + 0.1, 0)):
        assert quick_lines({"table": [*lines], SHARED: [shared]}, "table", count) == told


def test_a_table_has_as_many_lines_in_a_quick_run_as_were_measured_to_fit() -> None:
    name = "unit/monitor/test_hostile_logs.py"
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", f"tests/{name}"]
    done = [
        processes.run([*command, *more], cwd=ROOT, capture_output=True, text=True).stdout
        for more in ((), ("--all",))
    ]
    counts = {t: [out.count(f"::test_{t}[") for out in done] for t in read()[name] if t != SHARED}
    assert any(quick < every for quick, every in counts.values())
    for test, (quick, every) in counts.items():
        assert quick == quick_lines(read()[name], test, every), test


def test_every_test_that_was_measured_is_there() -> None:
    for file, tests in read().items():
        source = (TESTS / file).read_text(encoding="utf-8")
        for name in set(tests) - {SHARED}:
            assert f"\ndef test_{name}(" in source, f"{file}: {name}; `make durations`"


def test_what_was_measured_fits_into_a_quick_run() -> None:
    """Of a test that is too dear for it, mark what is `long`, or make it cheaper."""
    kept = [
        (sum(x or 0.0 for x in lines[: quick_lines(tests, test, len(lines))]), file, test)
        for file, tests in read().items()
        for test, lines in tests.items()
    ]
    dearest = sorted(kept, reverse=True)[:10]
    assert sum(seconds for seconds, _, _ in kept) <= TOTAL_S, dearest


def test_what_is_measured_is_entered_and_nothing_else_is_lost() -> None:
    known: Known = {
        "a.py": {"table": [1.0, 1.0, None], "gone": [9.0], "cheaper": [2.0]},
        "b.py": {"other": [4.0]},
    }
    measured = {"a.py": {"table": {0: 0.51}, "cheaper": {0: 0.01}, "new": {0: 1.0, 1: 0.26}}}
    counts = {"a.py": {"table": 4, "cheaper": 1, "new": 2, "unknown": 3}}
    found = entered(known, measured, counts)
    assert found == {
        "a.py": {"table": [0.5, 1.0, None], "new": [1.0, 0.3]},
        "b.py": {"other": [4.0]},
    }
    assert json.loads(text(found)) == found


@pytest.mark.parametrize("more", [("-n", "2", "--dist", "loadfile"), ()])
def test_a_run_writes_down_what_its_tests_take(tmp_path: Path, more: tuple[str, ...]) -> None:
    shutil.copy(TESTS / "durations.py", tmp_path)
    shutil.copy(TESTS / "long_tests.py", tmp_path)
    known = '{"test_busy.py": {"known": [9.0], "gone": [9.0]}}'
    (tmp_path / "durations.json").write_text(known, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text(MARKERS, encoding="utf-8")
    (tmp_path / "test_busy.py").write_text(BUSY, encoding="utf-8")
    done = processes.run(
        [sys.executable, "-m", "pytest", "-p", "long_tests", "--write-durations", "--all", *more],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    tests = json.loads((tmp_path / "durations.json").read_text())["test_busy.py"]
    assert set(tests) == {SHARED, "table", "known"}
    assert tests["known"] == [9.0], "another machine measured what is skipped here"
    assert 1.1 <= tests[SHARED][0] < 1.6
    assert len(tests["table"]) == 3
    assert tests["table"][0] < 0.5 <= tests["table"][1] <= tests["table"][2]


@pytest.mark.parametrize(("scale", "count"), [(None, 3), ("7", 21), ("0", 1)])
def test_one_scale_is_for_all_counts(
    monkeypatch: pytest.MonkeyPatch, scale: str | None, count: int
) -> None:
    monkeypatch.delenv(SCALE, raising=False)
    if scale is not None:
        monkeypatch.setenv(SCALE, scale)
    assert examples(3) == count


def test_one_seed_is_for_all_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(SEED, raising=False)
    assert (seed_of(7), seeds(1, 9, 3)) == (7, range(1, 9, 3))
    monkeypatch.setenv(SEED, "100")
    assert (seed_of(7), [*seeds(1, 9, 3)]) == (107, [101, 104, 107])


def test_what_a_soak_finds_is_told_with_its_seed(tmp_path: Path) -> None:
    file = tmp_path / "test_drawn.py"
    file.write_text(DRAWN, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text(f"{MARKERS} random: draws\n", encoding="utf-8")
    done = processes.run(
        [sys.executable, TESTS / "soak.py", "--jobs", "1", file],
        env={**os.environ, "PYTHONPATH": str(TESTS)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert done.stdout.endswith("0 files passed, 1 failed\n")
    again = next(x for x in done.stdout.splitlines() if x.startswith("again: "))
    assert again.endswith("test_drawn.py::test_drawn'")
    seed = again.partition("=")[2].split()[0]
    assert f"drew {int(seed) + 3}" in done.stdout


def test_no_test_has_a_variable_of_its_own() -> None:
    own = re.compile(r"environ(?:\.get\(|\[)\s*\"SOTER_(?!CACHE|CC|PYODIDE|CODE_SERVER|AUTOPILOT)")
    paths = [p for p in files_below(TESTS, "*.py") if p != Path(__file__)]
    assert [p.name for p in paths if own.search(p.read_text(encoding="utf-8"))] == []


def test_the_command_for_everything_asks_for_it_and_ci_runs_it_too() -> None:
    recipes = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target, option in ((COMMAND.split()[1], "--all"), ("test-rest", "--rest")):
        assert re.search(rf"^{target}:.*\n\t.*pytest.* {option} .*$", recipes, re.MULTILINE)
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert {"make lint", "make test", "make test-rest BUT=long"} <= set(run)


@pytest.mark.parametrize("more", [("-n", "1"), ()])
def test_bytecode_is_kept_whatever_the_environment_says(
    tmp_path: Path, more: tuple[str, ...]
) -> None:
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = processes.run(
        [sys.executable, "-m", "pytest", "--collect-only", "tests/unit/test_pieces.py", *more],
        cwd=ROOT,
        env={**environment, "PYTHONPYCACHEPREFIX": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert [*tmp_path.rglob("test_pieces.*-pytest-*.pyc")]


def test_a_folder_that_is_named_for_bytecode_loses_nothing(tmp_path: Path) -> None:
    kept = tmp_path.joinpath("mine", *Path(tempfile.gettempdir()).resolve().parts[1:], "kept")
    kept.parent.mkdir(parents=True)
    kept.touch()
    done = processes.run(
        [sys.executable, "-m", "pytest", "--collect-only", "tests/unit/test_pieces.py"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPYCACHEPREFIX": str(tmp_path / "mine")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert kept.exists()


def test_a_module_that_is_written_anew_within_a_second_is_read_anew(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "import it; print(it.IT)"]
    path = tmp_path / "it.py"
    for said in ("one", "two"):
        path.write_text(f"IT = '{said}'\n", encoding="utf-8")
        os.utime(path, (1e9, 1e9))
        done = processes.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
        assert done.stdout == f"{said}\n"
