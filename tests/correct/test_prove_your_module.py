"""What docs/prove-your-module.md says happens, happens."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

import processes

pytestmark = pytest.mark.pages
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "prove-your-module.md").read_text(encoding="utf-8")
PIECES = dict(re.findall(r"^```soter prove=(\S+)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL))
TANK = PIECES["tank.soter"].replace("}\nsystem", PIECES["verify"] + "}\nsystem")


def _soter(folder: Path, *arguments: str) -> processes.Done:
    command = [sys.executable, "-m", "soter.cli.main", *arguments]
    return processes.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture
def tank(tmp_path: Path) -> Path:
    (tmp_path / "tank.soter").write_text(TANK, encoding="utf-8")
    return tmp_path


def _changed(folder: Path, old: str, new: str) -> str:
    assert old in TANK
    (folder / "changed.soter").write_text(TANK.replace(old, new), encoding="utf-8")
    return "changed.soter"


def test_a_car_on_a_road_says_nothing_of_a_proof_and_is_proved(tmp_path: Path) -> None:
    (tmp_path / "lane.soter").write_text(PIECES["lane.soter"], encoding="utf-8")
    verified = _soter(tmp_path, "verify", "lane.soter", "--write")
    assert verified.returncode == 0, verified.stdout
    assert "PROVED under" in verified.stdout
    assert "where functions in its rate are defined: c.x" in verified.stdout
    shown = PAGE.partition("```\nSafeLane  the program says")[2].partition("```")[0].splitlines()
    untimed = [re.sub(r" +[\d.]+ m?s$", "", line) for line in verified.stdout.splitlines()]
    assert [x for x in shown[1:] if re.sub(r" +[\d.]+ m?s$", "", x) not in untimed] == []
    again = _soter(tmp_path, "verify", "lane.soter", "--cert", "proof")
    assert again.returncode == 0, again.stdout
    assert "what it gave" not in again.stdout
    checked = _soter(tmp_path, "recheck", "proof")
    assert checked.returncode == 0, checked.stdout


def test_a_car_whose_sc_reads_how_far_it_is_along_the_road_is_told_so(tmp_path: Path) -> None:
    lane = PIECES["lane.soter"]
    read = lane.replace("-0.25 * pose.y", "-0.25 * pose.y + 0.001 * pose.x")
    (tmp_path / "lane.soter").write_text(read, encoding="utf-8")
    refused = _soter(tmp_path, "verify", "lane.soter", "--budget", "0")
    assert refused.returncode == 1
    assert "`c.x` is read by SC" in refused.stderr


def test_the_tank_runs_before_anything_is_said_of_a_proof(tmp_path: Path) -> None:
    (tmp_path / "tank.soter").write_text(PIECES["tank.soter"], encoding="utf-8")
    ran = _soter(tmp_path, "run", "tank.soter")
    assert ran.returncode == 0, ran.stdout
    assert "the property holds" in ran.stdout


def test_the_tank_is_proved_and_its_certificate_accepted(tank: Path) -> None:
    verified = _soter(tank, "verify", "tank.soter", "--cert", "proof", "--report", "proof.html")
    assert verified.returncode == 0, verified.stdout
    assert "PROVED under" in verified.stdout
    assert "<svg" in (tank / "proof.html").read_text(encoding="utf-8")
    checked = _soter(tank, "recheck", "proof")
    assert checked.returncode == 0, checked.stdout


def test_a_look_ahead_of_nothing_is_refuted_by_a_run(tank: Path) -> None:
    bold = _changed(tank, "level < 0.25 || level > 1.75", "level < 0.2 || level > 1.8")
    verified = _soter(tank, "verify", bold)
    assert verified.returncode == 3, verified.stdout
    assert "a run leaves C" in verified.stdout


def test_predicates_that_are_left_out_are_computed(tank: Path) -> None:
    lines = [x for x in TANK.splitlines() if not x.startswith(("  ttf", "  safer"))]
    (tank / "short.soter").write_text("\n".join(lines) + "\n", encoding="utf-8")
    verified = _soter(tank, "verify", "short.soter")
    assert verified.returncode == 0, verified.stdout
    assert "computed from the sets" in verified.stdout


SIZES = re.findall(r"^\| (\d+) \| (computed|written)(.*?) \| (.*) \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize(("cells", "how", "bounds", "said"), SIZES)
def test_grids_of_other_sizes_say_what_the_table_says(
    cells: str, how: str, bounds: str, said: str, tmp_path: Path
) -> None:
    """Bounds of `ttf` are those of the sentence above the table where a row has none."""
    low, high = (
        re.findall(r"\d\.\d+", bounds)
        or re.findall(r"`ttf level < (\S+) \|\| level >\s+(\S+)`, on grids", PAGE)[0]
    )
    text = TANK.replace("/ 320", f"/ {cells}")
    text = text.replace("level < 0.25 || level > 1.75", f"level < {low} || level > {high}")
    written = [x for x in text.splitlines() if not x.startswith(("  ttf", "  safer"))]
    text = "\n".join(written) if how == "computed" else text
    (tmp_path / "sized.soter").write_text(text, encoding="utf-8")
    out = _soter(tmp_path, "verify", "sized.soter").stdout
    proved = re.search(r"^P2b +(\w+)", out, re.MULTILINE)
    verdict, back = (
        proved[1] if proved else "",
        re.search(r"control back within (.* s)$", out, re.MULTILINE),
    )
    refined = re.search(r"\((\d+) -> (\d+) cells\)", out)
    verdict = f"{verdict}, refined to {refined[2]}" if refined else verdict
    verdict = verdict if back else f"P2b {verdict}"
    shares = re.findall(r"(?:not ttf|safer) (\S+%)", out)
    assert " | ".join([verdict, *shares, back[1] if back else "\N{EN DASH}"]) == said


def test_the_sizes_of_the_table_are_found() -> None:
    assert len(SIZES) == 5


def test_the_declared_times_of_the_page_are_proved(tank: Path) -> None:
    block = re.findall(r"^```\n(verify \{.*?\n\})\n```", PAGE, re.MULTILINE | re.DOTALL)[0]
    timed = _changed(tank, "verify { grid level in [0.2, 1.8] / 320; }", block)
    verified = _soter(tank, "verify", timed)
    assert verified.returncode == 0, verified.stdout
    assert re.search(r"P1c +proved", verified.stdout), verified.stdout
