"""What commands say where a person looks: with colours, and the same words as without."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.cli.terminal.console import Console

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    Soter = Callable[..., Any]

TANK = (Path(__file__).resolve().parents[3] / "docs" / "prove-your-module.md").read_text("utf-8")
ESCAPE = re.compile(r"\x1b\[[0-9;]*m")


@pytest.fixture
def tank(here: Path) -> str:
    blocks = r"^```soter prove=(?:tank.soter|verify)\n(.*?)^```"
    program, verify = re.findall(blocks, TANK, re.MULTILINE | re.DOTALL)[:2]
    behind = "safer level > 0.4 && level < 1.6;\n"
    assert behind in program
    (here / "tank.soter").write_text(program.replace(behind, behind + verify), "utf-8")
    return "tank.soter"


def steady(text: str) -> str:
    """Without colours, times, and the blanks that fill a column of them."""
    return re.sub(r"[0-9.]+ (m?s)\b|─+|  +", " ", ESCAPE.sub("", text))


@pytest.mark.long
def test_verify_recheck_and_advise_say_the_same_in_colour(
    soter: Soter, tank: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")  # where a line ends would depend on how long it took
    lines = (
        ("verify", tank, "--cert", "proof"),
        ("recheck", "proof"),
        ("advise", tank, "--factors", "1", "--levels", "3"),
    )
    for line in lines:
        plain = soter(*line)
        with monkeypatch.context() as patch:
            patch.setenv("FORCE_COLOR", "1")
            coloured = soter(*line)
        assert plain.exit == coloured.exit == 0, plain.out + plain.err
        assert "\x1b" not in plain.out
        assert "\x1b[" in coloured.out
        assert steady(coloured.out) == steady(plain.out)


def test_what_is_not_proved_is_said_in_colour(
    soter: Soter, here: Path, tank: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    text = (here / tank).read_text("utf-8")
    bold = text.replace("level < 0.25 || level > 1.75", "level < 0.2 || level > 1.8")
    assert bold != text
    (here / "bold.soter").write_text(bold, "utf-8")
    done = soter("verify", "bold.soter", "--no-refute", "--cert", "proof")
    assert done.exit == 4
    assert "not a proof of safety" in done.out
    checked = soter("recheck", "proof")
    assert checked.exit == 4
    assert "\x1b[1;33mACCEPTED IN PART\x1b[0m  proof: safety is not established" in checked.out


def test_a_style_that_is_not_known_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with Console(json=False) as console:
        assert console.paint("of no such name", "text") == "text"
        assert console.paint("bold", "text") == "\x1b[1mtext\x1b[0m"
