"""`make demo` flies three arms and leaves a report."""

from __future__ import annotations

import sys
from pathlib import Path

import processes

ROOT = Path(__file__).resolve().parents[2]


def test_the_demo_prints_a_table_and_writes_a_self_contained_report(tmp_path: Path) -> None:
    report = tmp_path / "drone.html"
    done = processes.run(
        [sys.executable, "examples/drone/demo.py", "--laps", "12", "-o", str(report)],
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
