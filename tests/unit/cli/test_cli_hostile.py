"""Files and words that no careful person gives a command, and what they get."""

from __future__ import annotations

import os
import re
import shutil
from typing import TYPE_CHECKING

import pytest

from soter import load
from soter.cli.main import COMMANDS as ALL
from soter.cli.main import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]

COMMANDS = [("check",), ("run",), ("build", "-o", "out"), ("fmt",)]
CODE = re.compile(r"error\[[A-Z]\d{3}\]")


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c[0])
@pytest.mark.parametrize(
    "name",
    ["missing.soter", "folder", "binary.soter", "huge.soter", "cart.soter/x", "\n", "", "a" * 5000],
    ids=["missing", "folder", "binary", "huge", "below a file", "newline", "empty", "long"],
)
def test_what_cannot_be_read_is_a_diagnostic(
    soter: Soter, here: Path, command: tuple[str, ...], name: str
) -> None:
    (here / "folder").mkdir()
    (here / "binary.soter").write_bytes(bytes(range(256)) * 40)
    with (here / "huge.soter").open("wb") as stream:
        stream.truncate(5 * 1024 * 1024)
    done = soter(*command, name)
    assert done.exit == 1
    assert CODE.match(done.err)
    assert soter(*command, name, "--json").document["diagnostics"]


def test_a_file_without_permission(soter: Soter, here: Path) -> None:
    (here / "cart.soter").chmod(0)
    if os.access(here / "cart.soter", os.R_OK):
        pytest.skip("root may read anything")
    assert soter("check", "cart.soter").exit == 1


def test_control_characters_never_reach_the_terminal(soter: Soter, here: Path) -> None:
    (here / "esc.soter").write_text("soter 1;\nconst \x1b[31mA: int = 3;\n")
    for done in (soter("check", "esc.soter"), soter("check", "\x1b[31mno.soter")):
        assert done.exit == 1
        assert "\x1b" not in done.err


@pytest.mark.parametrize("command", [("check",), ("run", "--until", "20ms")], ids=lambda c: c[0])
@pytest.mark.parametrize("between", ["\n", "\r", "\x1b[2J"], ids=["newline", "return", "escape"])
def test_no_name_of_a_file_is_a_verdict_of_another_one(
    soter: Soter, here: Path, command: tuple[str, ...], between: str
) -> None:
    name = f"a{between}ok  other.soter  1 system.soter"
    shutil.copy(here / "cart.soter", here / name)
    done = soter(command[0], name, *command[1:])
    assert done.exit == 0
    assert "\x1b" not in done.out
    assert not any(line.startswith("ok  other") for line in re.split("[\n\r]", done.out))


@pytest.mark.parametrize(
    "seed", ["-1", "1.5", "", "99999999999999999999", "0x10", "²", "\u0663", "1_0"]
)
def test_seeds_that_are_none(soter: Soter, seed: str) -> None:
    assert soter("run", "cart.soter", "--seed", seed).exit == 2


@pytest.mark.parametrize("option", ["--threads", "--runs", "--max-states", "--minimise"])
@pytest.mark.parametrize("number", ["1_0", "\u0663", "\uff12", "x"])
def test_numbers_are_written_in_plain_digits(soter: Soter, option: str, number: str) -> None:
    done = soter("test", "cart.soter", option, number)
    assert done.exit == 2
    assert f"argument {option}: " in done.err


def test_the_largest_seed(soter: Soter) -> None:
    for engine in ("native", "interp"):
        done = soter(
            "run",
            "cart.soter",
            "--until",
            "10ms",
            "--seed",
            str(2**64 - 1),
            "--engine",
            engine,
            "--json",
        )
        assert done.document["seed"] == 2**64 - 1


@pytest.mark.parametrize(
    "until",
    [
        *("30", "s", "0s", "1e999s", "1 fortnight", "nan s", "0.1ns", "200000h" * 9, "5m"),
        *("1e99999999s", "9" * 400 + "s", "9" * 5000 + "s", "0." + "1" * 5000 + "s"),
    ],
    ids=lambda until: until[:12],
)
def test_lengths_of_time_that_are_none(soter: Soter, until: str) -> None:
    done = soter("run", "cart.soter", "--until", until)
    assert done.exit == 2
    assert "such as 30s" in done.err or "until" in done.err


def test_no_length_of_time_anywhere(soter: Soter, here: Path) -> None:
    text = (here / "cart.soter").read_text().replace("until 30s;", "")
    (here / "endless.soter").write_text(text)
    done = soter("run", "endless.soter")
    assert done.exit == 2
    assert "--until 30s" in done.err


def test_a_program_without_anything_to_run(soter: Soter, here: Path) -> None:
    (here / "empty.soter").write_text("soter 1;\n")
    assert soter("check", "empty.soter").exit == 0
    assert soter("run", "empty.soter").exit == 2


def test_standard_output_that_is_gone(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert here.exists()
    monkeypatch.setattr("sys.stdout", None)
    assert main(["check", "cart.soter"]) == 0
    assert main(["check", "cart.soter", "--json"]) == 0
    monkeypatch.setattr("sys.stderr", None)
    assert main(["check", "nowhere.soter"]) == 1


def test_a_cache_folder_that_cannot_be_written(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "file").write_text("")
    monkeypatch.setenv("SOTER_CACHE", str(here / "file" / "cache"))
    done = soter("run", "cart.soter", "--json")
    assert (done.exit, done.codes) == (1, ["X006"])


@pytest.mark.parametrize("name", ["header", "header_", "topics", "stamps", "main"])
def test_instances_called_like_parts_of_the_state(soter: Soter, here: Path, name: str) -> None:
    text = (here / "cart.soter").read_text()
    text = text.replace("  c: Cart;", f"  {name}: Cart;").replace("c.truth", f"{name}.truth")
    (here / "named.soter").write_text(text)
    runs = {
        soter("run", "named.soter", "--until", "1s", "--engine", e, "--json", "--report").document[
            "trace_sha256"
        ]
        for e in ("native", "interp")
    }
    assert len(runs) == 1


@pytest.mark.parametrize("command", sorted(ALL))
@pytest.mark.parametrize(
    "words", [("caf\udce9.soter",), ("cart.soter", "-o", "o\udce9"), ("a", "--x=\udcff", "--json")]
)
def test_a_name_that_is_not_utf8_is_said_before_any_work(
    soter: Soter, here: Path, command: str, words: tuple[str, ...]
) -> None:
    for name in ("caf\udce9.soter", "a"):
        (here / name).write_text("soter 1;\n")
    before = sorted(here.iterdir())
    done = soter(command, *words)
    assert done.exit == 2
    assert "is not UTF-8" in (done.out if "--json" in words else done.err)
    assert "\\xe9" in done.err or "\\xff" in done.out
    assert sorted(here.iterdir()) == before


def test_a_program_whose_name_is_not_utf8_is_not_read(here: Path) -> None:
    (here / "caf\udce9.soter").write_text("soter 1;\n")
    (problem,) = load(here / "caf\udce9.soter").diagnostics
    assert (problem.code, "caf\\xe9.soter" in problem.message) == ("D005", True)


def test_a_program_in_a_folder_whose_name_is_not_utf8_is_run(soter: Soter, here: Path) -> None:
    folder = here / "d\udce9"
    folder.mkdir()
    shutil.copy(here / "cart.soter", folder)
    os.chdir(folder)
    words = ("--until", "1s", "--report", "--log", "l.mcap", "--json")
    assert soter("run", "cart.soter", *words).exit == 0
    assert soter("monitor", "cart.soter", "l.mcap", "--report").exit == 0
