"""`make demo` flies three arms and the whole mission and leaves two reports."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

import processes

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.pages
def test_the_demo_prints_tables_and_writes_self_contained_reports(tmp_path: Path) -> None:
    report = tmp_path / "drone.html"
    done = processes.run(
        [
            *(sys.executable, "examples/drone/demo.py", "--laps", "12", "--seconds", "60"),
            *("-o", str(report)),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "RTA-protected" in done.stdout
    assert "0 of 12" in done.stdout
    page = report.read_text(encoding="utf-8")
    assert "Drona project" in page
    assert "rests on" in page.lower()
    assert 'src="http' not in page
    mission = (tmp_path / "mission.html").read_text(encoding="utf-8")
    assert 'src="http' not in mission
    for shown in (
        *("SafeBattery", "SafePlanner", "SafeMotionPrimitive"),  # who was in control
        *("plans in force", "plans refused", "landings", "charge", "figure-solid", "figure-map"),
    ):
        assert shown in mission
    turned_down = re.search(r"turned down by the DM +(\d+) +(\d+)", done.stdout)
    assert turned_down is not None
    assert f"{sum(map(int, turned_down.groups()))} plans were turned down" in mission
