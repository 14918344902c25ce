"""What docs/compose-proved-modules.md shows is what `soter verify` prints."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import processes
from soter.api import load

pytestmark = pytest.mark.pages
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "compose-proved-modules.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_table_of_the_page_is_printed() -> None:
    command = [sys.executable, "-m", "soter.cli.main", "verify"]
    convoy = "examples/generality/convoy.soter"
    done = processes.run([*command, convoy], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    shown = PAGE.split("Below the two verdicts:\n\n```\n")[1].split("```")[0]
    assert len(shown.splitlines()) == 13
    assert shown in done.stdout


@pytest.mark.long
def test_a_module_alone_shows_who_is_not_verified_here() -> None:
    command = [sys.executable, "-m", "soter.cli.main", "verify", "--module", "SafeGap"]
    convoy = "examples/generality/convoy.soter"
    done = processes.run([*command, convoy], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "`safe` of SafeLead: not verified here" in done.stdout
    assert "ASSUMED, where 1 is not proved here" in done.stdout
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


LANDING = ROOT / "examples" / "wall" / "landing.soter"


@pytest.mark.long
def test_the_module_that_waits_is_that_of_the_example_and_proved_as_the_page_says() -> None:
    shown = PAGE.split("its AC waits:\n\n```\n")[1].split("```")[0]
    assert len(shown.splitlines()) == 17
    node, module = shown.split("rta ")
    text = LANDING.read_text(encoding="utf-8")
    assert node in text
    assert "rta " + module in text
    report = load(LANDING).verify(refute=False)
    assert (report.verdict, report.together) == ("proved", "proved")
    back = report["SafeCart"].findings["P2b"]
    said = PAGE.split("which is the one claim that rests on the other module:\n\n```\n")[1]
    assert said.startswith(back.text + "\n```")
    assert back.verdict == "assumed"
    run = load(LANDING).simulate(until=60.0)
    assert not run.violations
    assert 0.2 < (run.mode("SafeCart") == 1).mean() < 0.9


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("NEAR + 0.5 || mode", "NEAR + 0.5 && mode", {"SafeCart": {"P3", "ttf"}}),
        ("NEAR && mode", "NEAR || mode", {"SafeCart": {"P3", "safer"}}),
        (
            "? 0.5 : 1.5",
            "? -0.5 : 1.5",
            {"SafeCart": {"P2a", "P2b", "P3", "ttf", "safer", "start"}},
        ),
        (
            "safer charge > 0.85",
            "safer charge > 0.85 && mode(SafeCart) == Mode.AC",
            {"SafeCart": {"P2b"}, "SafeBattery": {"P2b"}},
        ),
    ],
    ids=["and", "or", "negative", "a circle"],
)
@pytest.mark.long
def test_what_the_page_says_of_changes_is_so(
    tmp_path: Path, old: str, new: str, wrong: dict[str, set[str]]
) -> None:
    text = LANDING.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = tmp_path / "landing.soter"
    path.write_text(text.replace(old, new), encoding="utf-8")
    report = load(path).verify(refute=False)
    for module in report.modules:
        undecided_names = {n for n, f in module.findings.items() if f.verdict == "undecided"}
        assert undecided_names == wrong.get(module.name, set())
