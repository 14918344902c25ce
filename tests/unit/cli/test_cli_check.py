"""`soter check`: what was checked, what was not, and every mistake at once."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]
    Golden = Callable[[str, str], None]

WRONG = """
soter 1;
const A: int = true;
topic u: float in [1.0, 0.0];
node Fast period 10ms { publishes u; step { publish u = 0.5; } }
node Slow period 150ms { publishes u; step { publish u = 0.5; } }
rta M { ac Fast; sc Slow; period 100ms; safe true; ttf false; safer true; }
"""


def test_what_it_says_of_a_sound_program(soter: Soter, golden: Golden) -> None:
    out = soter("check", "cart.soter").out
    golden("cli/check.txt", re.sub(r"[0-9a-f]{12}\n", "HASH\n", out))


def test_all_mistakes_at_once(soter: Soter, here: Path) -> None:
    (here / "wrong.soter").write_text(WRONG)
    done = soter("check", "wrong.soter", "--json")
    assert done.exit == 1
    assert {"P1a", "V001"} <= set(done.codes)
    first = done.document["diagnostics"][0]
    assert (first["file"], first["line"]) == ("wrong.soter", 3)
    assert "\x1b" not in soter("check", "wrong.soter").err


def test_colour(soter: Soter, here: Path, monkeypatch: Any) -> None:
    (here / "wrong.soter").write_text(WRONG)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert soter("check", "wrong.soter").err.startswith("\x1b[1;31merror[")
    assert soter("check", "cart.soter").out.startswith("\x1b[1;32mok")


def test_what_is_proved_and_what_assumed(soter: Soter) -> None:
    module = soter("check", "cart.soter", "--json").document["modules"]["SafeCart"]
    verdicts = {name: p["verdict"] for name, p in module["properties"].items()}
    assert verdicts == {
        "P1a": "proved", "P1b": "proved", "P1c": "assumed", "P2a": "assumed", "P2b": "assumed",
        "P3": "assumed",
    }  # fmt: skip


def test_an_extern_that_is_trusted_is_named(soter: Soter, here: Path) -> None:
    (here / "t.soter").write_text(
        "soter 1;\ntopic u: float;\nextern node Trusted period 10ms { publishes u; }\n"
        "system S { node Trusted; until 1s; }\n"
    )
    assert "Trusted: extern and trusted" in soter("check", "t.soter").out


def test_bindings_are_checked_against_all_systems(soter: Soter, robot: Path) -> None:
    assert robot.exists()
    assert soter("check", "robot.soter", "--bind", "Learned=python:recovery.py:good").exit == 0
    wrong = soter("check", "robot.soter", "--bind", "Lerned=python:recovery.py:good", "--json")
    assert (wrong.exit, wrong.codes) == (2, ["U005"])


def test_a_program_without_modules(soter: Soter, here: Path) -> None:
    (here / "none.soter").write_text("soter 1;\n")
    done = soter("check", "none.soter")
    assert done.exit == 0
    assert done.out.startswith("ok  none.soter  0 systems, 0 modules  ")
