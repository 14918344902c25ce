"""`soter completion`: real shells complete real command lines, where they are installed."""

from __future__ import annotations

import shlex
import shutil
from typing import TYPE_CHECKING

import pytest

from processes import run
from soter.cli.main import COMMANDS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]


@pytest.fixture
def completed(soter: Soter, here: Path) -> Callable[..., set[str]]:
    """What bash offers for the last of some words."""
    script = here / "soter.bash"
    script.write_text(soter("completion", "bash").out)

    def ask(*words: str) -> set[str]:
        line = " ".join(shlex.quote(w) for w in ("soter", *words))
        text = (
            f"set -u; source soter.bash; COMP_WORDS=({line}); COMP_CWORD={len(words)}; _soter; "
            'printf "%s\\n" "${COMPREPLY[@]}"'
        )
        command = ("bash", "--norc", "-c", text)
        done = run(command, cwd=here, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        return set(done.stdout.split())

    return ask


def test_bash_completes_commands(completed: Callable[..., set[str]]) -> None:
    assert completed("ve") == {"verify"}
    assert completed("") >= set(COMMANDS)
    assert completed("--ver") == {"--version"}


def test_bash_completes_the_options_of_a_command(completed: Callable[..., set[str]]) -> None:
    assert completed("run", "--se") == {"--seed", "--self-contained", "--set"}
    assert "--cert" in completed("verify", "cart.soter", "--")
    assert "--cert" not in completed("run", "cart.soter", "--")


def test_bash_completes_the_words_of_an_option(completed: Callable[..., set[str]]) -> None:
    assert completed("run", "cart.soter", "--engine", "") == {"native", "interp"}
    assert completed("completion", "f") == {"fish"}
    assert completed("cache", "c") == {"clear"}
    assert completed("help", "adv") == {"advise"}


def test_bash_completes_files_where_files_are_taken(completed: Callable[..., set[str]]) -> None:
    assert completed("check", "ca") == {"cart.soter"}
    assert completed("check", "cart.soter", "--times", "ca") == {"cart.soter"}
    assert completed("run", "cart.soter", "--until", "ca") == set(), "a time is no file"


@pytest.mark.parametrize(("shell", "check"), [("zsh", "-n"), ("fish", "--no-execute")])
def test_the_other_shells_take_their_scripts(
    soter: Soter, here: Path, shell: str, check: str
) -> None:
    text = soter("completion", shell).out
    for name in COMMANDS:
        assert name in text
    assert "--no-refute" in text or "-l no-refute" in text
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (here / "script").write_text(text)
    assert run((shell, check, "script"), cwd=here, capture_output=True).stderr == b""


def test_the_script_is_in_the_document(soter: Soter) -> None:
    document = soter("completion", "bash", "--json").document
    assert document["script"] + "\n" == soter("completion", "bash").out
