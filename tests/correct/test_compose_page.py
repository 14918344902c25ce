"""What docs/compose-proved-modules.md shows is what `soter verify` prints."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import processes

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "compose-proved-modules.md").read_text(encoding="utf-8")


def test_the_table_of_the_page_is_printed() -> None:
    command = [sys.executable, "-m", "soter.cli.main", "verify"]
    convoy = "examples/generality/convoy.soter"
    done = processes.run([*command, convoy], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    shown = PAGE.split("Below the two verdicts:\n\n```\n")[1].split("```")[0]
    assert len(shown.splitlines()) == 9
    assert shown in done.stdout


@pytest.mark.long
def test_a_module_alone_shows_who_is_not_verified_here() -> None:
    command = [sys.executable, "-m", "soter.cli.main", "verify", "--module", "SafeGap"]
    convoy = "examples/generality/convoy.soter"
    done = processes.run([*command, convoy], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "`safe` of SafeLead: not verified here" in done.stdout
    assert "ASSUMED, where 1 of these is assumed" in done.stdout
    lead = [*command[:-1], "SafeLead", convoy]
    done = processes.run(lead, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "takes for granted" not in done.stdout


def test_the_code_of_the_page_is_that_of_the_example() -> None:
    text = (ROOT / "examples" / "generality" / "convoy.soter").read_text(encoding="utf-8")
    for line in (
        "topic lead: float in [SLOW, FAST] = 6.0;",
        "safe speed > SLOW && speed < FAST && lead >= SLOW && lead <= FAST;",
        "der gap = lead - v;",
    ):
        assert line in text
        assert line in PAGE
