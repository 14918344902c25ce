"""Nothing a person wrote is overwritten by a log, a report or a package."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import processes

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
DIAGNOSTICS, USAGE = 1, 2


def soter(folder: Path, *arguments: str) -> int:
    command = [sys.executable, "-m", "soter.cli.main", *arguments]
    return processes.run(command, cwd=folder, capture_output=True, check=False).returncode


@pytest.mark.parametrize("option", ["--log", "--report"])
def test_a_log_or_report_never_replaces_something_else(tmp_path: Path, option: str) -> None:
    program = tmp_path / "cart.soter"
    program.write_text(CART.read_text(encoding="utf-8"))
    before = program.read_bytes()
    assert (
        soter(tmp_path, "run", "cart.soter", "--until", "1s", option, "cart.soter") == DIAGNOSTICS
    )
    assert program.read_bytes() == before


@pytest.mark.parametrize(("option", "name"), [("--log", "a.mcap"), ("--report", "a.html")])
def test_a_log_or_report_replaces_an_older_one(tmp_path: Path, option: str, name: str) -> None:
    for _ in range(2):
        assert soter(tmp_path, "run", str(CART), "--until", "1s", option, name) == 0


def test_log_and_report_are_two_files(tmp_path: Path) -> None:
    arguments = ("--log", "./x", "--report", "x")
    assert soter(tmp_path, "run", str(CART), "--until", "1s", *arguments) == USAGE


@pytest.mark.long
def test_build_keeps_what_a_person_wrote_or_changed(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("MY OWN soter NOTES\n")
    assert soter(tmp_path, "build", str(CART), "--target", "c", "-o", ".") == DIAGNOSTICS
    assert (tmp_path / "README.md").read_text() == "MY OWN soter NOTES\n"
    assert soter(tmp_path, "build", str(CART), "--target", "c", "-o", "out") == 0
    assert soter(tmp_path, "build", str(CART), "--target", "c", "-o", "out") == 0
    main = tmp_path / "out" / "main.c"
    main.write_text(main.read_text() + "/* mine */\n")
    assert soter(tmp_path, "build", str(CART), "--target", "c", "-o", "out") == DIAGNOSTICS
    assert main.read_text().endswith("/* mine */\n")
