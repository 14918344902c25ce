"""Every exit code of the contract, and the top-level command line."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

import soter as package
from processes import run
from soter.cli import main
from soter.native import compiler

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]


def test_0_a_sound_program(soter: Soter) -> None:
    done = soter("check", "cart.soter")
    assert done.exit == 0
    assert done.err == ""


def test_0_with_warnings(soter: Soter, here: Path) -> None:
    (here / "w.soter").write_text((here / "cart.soter").read_text() + "\nconst UNUSED: int = 3;\n")
    done = soter("check", "w.soter")
    assert done.exit == 0
    assert "warning[" in done.err


def test_1_a_program_with_mistakes(soter: Soter, here: Path) -> None:
    (here / "bad.soter").write_text("soter 1;\nconst A: int = true;\n")
    done = soter("check", "bad.soter")
    assert done.exit == 1
    assert "error[" in done.err
    assert done.out == ""


@pytest.mark.parametrize(
    "arguments",
    [
        ("check",),
        ("run", "cart.soter", "another"),
        ("check", "-", "-"),
        ("help", "chekc"),
        ("help", "check", "more"),
        ("completion", "tcsh"),
        ("cache", "limit", "much"),
        ("check", "cart.soter", "--wrong"),
        ("run", "cart.soter", "--seed", "x"),
        ("run", "cart.soter", "--system", "Nobody"),
        ("run", "cart.soter", "--until", "soon"),
        ("run", "cart.soter", "--set", "K=3"),
        ("run", "cart.soter", "--engine", "steam"),
        ("run", "cart.soter", "--bind", "Fast"),
        ("build", "cart.soter"),
        ("chekc", "cart.soter"),
        ("--wrong",),
    ],
)
def test_2_a_wrong_command_line(soter: Soter, arguments: tuple[str, ...]) -> None:
    done = soter(*arguments)
    assert done.exit == 2
    assert done.err.startswith("error[U")
    assert soter(*arguments, "--json").document["exit"] == 2


def test_2_without_anything_gives_the_help(soter: Soter) -> None:
    done = soter()
    assert done.exit == 2
    assert "usage: soter COMMAND" in done.err


def test_3_a_violated_property(soter: Soter) -> None:
    done = soter("run", "cart.soter", "--system", "Unprotected")
    assert done.exit == 3
    assert done.out.splitlines()[1] == "VIOLATED  2 violations"


def test_70_a_defect_of_soter(soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise AssertionError("a defect")

    monkeypatch.setattr("soter.cli.check.load", broken)
    done = soter("check", "cart.soter")
    assert done.exit == 70
    assert "sorry" in done.err
    (crash,) = (here / ".soter").glob("crash-*.txt")
    assert "a defect" in crash.read_text()
    assert soter("check", "cart.soter", "--json").codes == ["I001"]


def test_70_where_no_crash_file_can_be_written(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / ".soter").write_text("in the way")
    monkeypatch.setattr("soter.cli.check.load", lambda *_: 1 // 0)
    done = soter("check", "cart.soter")
    assert done.exit == 70
    assert "ZeroDivisionError in test_cli_exits.py" in done.err


def test_without_a_compiler_the_ways_out_are_named(
    soter: Soter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOTER_CC", "nowhere-cc")
    compiler.find_compiler.cache_clear()
    try:
        done = soter("run", "cart.soter", "--until", "1s")
        assert (done.exit, soter("run", "cart.soter", "--until", "1s", "--json").codes) == (
            1,
            ["X005"],
        )
        for way in (
            "unset SOTER_CC",
            "pip install 'soter-rta[compiler]'",
            "soter run FILE --engine interp",
        ):
            assert way in done.err
        assert soter("run", "cart.soter", "--until", "1s", "--engine", "interp").exit == 0
    finally:
        compiler.find_compiler.cache_clear()


def test_130_an_interrupt(soter: Soter, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("soter.cli.check.load", pressed)
    assert soter("check", "cart.soter").exit == 130
    assert soter("check", "cart.soter", "--json").document["exit"] == 130


# ---------------------------------------------------------------- the top level


COMMANDS = tuple(name for name in main.COMMANDS if name != "help")
CONTRACT = {
    *("check", "run", "verify", "recheck", "test", "replay", "campaign", "build", "explain"),
    *("new", "fmt", "advise", "measure", "monitor"),
}


def test_the_help_lists_every_command_of_the_contract(soter: Soter) -> None:
    done = soter("--help")
    assert done.exit == 0
    assert set(COMMANDS) >= CONTRACT
    for name in COMMANDS:
        assert f"\n  {name} " in done.out
    assert max(map(len, done.out.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_examples(soter: Soter, name: str) -> None:
    done = soter(name, "--help")
    assert done.exit == 0
    assert f"usage: soter {name}" in done.out
    assert "examples:\n" in done.out
    assert soter(name, "--help", "--json").document["help"].startswith("usage:")


def test_a_mistyped_command_is_guessed(soter: Soter) -> None:
    assert "did you mean `check`?" in soter("chekc").err


def test_the_version(soter: Soter) -> None:
    assert soter("--version").out == f"soter {package.__version__}\n"
    assert soter("--version", "--json").document["version"] == package.__version__


def test_v_is_the_version(soter: Soter) -> None:
    assert soter("-V").out == soter("--version").out
    assert soter("-V", "--json").document["version"] == package.__version__


def test_help_is_a_word_too(soter: Soter) -> None:
    assert soter("help").out == soter("--help").out
    assert soter("help", "check").out == soter("check", "--help").out
    assert soter("help", "check", "--json").document["help"].startswith("usage: soter check")
    assert soter("help", "--json").document["exit"] == 0


def test_the_package_is_a_command(here: Path) -> None:
    done = run((sys.executable, "-m", "soter", "-V"), cwd=here, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"soter {package.__version__}\n")


def test_json_may_stand_before_the_command(soter: Soter) -> None:
    assert soter("--json", "check", "cart.soter").document["command"] == "check"


def test_without_the_arithmetic_of_the_re_checker_the_extra_is_named(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a plain install has it: the parameters of a case are read by code of the re-checker."""
    monkeypatch.setattr("soter.api.rechecking.find_spec", lambda _: None)
    done = soter("assure", "cart.soter", "-o", "case", "--json")
    assert done.exit == 1
    (error,) = done.document["diagnostics"]
    assert error["code"] == "D007"
    assert "soter-rta[recheck]" in str(error)
    assert not (here / "case").exists()
