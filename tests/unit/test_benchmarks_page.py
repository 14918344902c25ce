"""The page of benchmarks is made of data: nothing is lost on the way, and old figures say so."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import processes

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from bench import run_all

if TYPE_CHECKING:
    import pytest

HEAD = "# Benchmarks\n\nof some day\n\n"
FIRST, SECOND = run_all.BENCHMARKS[:2]


def git(folder: Path, *words: str, day: str = "2026-01-01") -> None:
    """A command of git, as of noon of a day."""
    when = f"{day}T12:00:00 +0000"
    processes.run(
        ["git", "-c", "user.name=a", "-c", "user.email=a@b", *words],
        cwd=folder,
        env={"GIT_AUTHOR_DATE": when, "GIT_COMMITTER_DATE": when, "PATH": "/usr/bin:/bin"},
        check=True,
        capture_output=True,
    )


def page(*outputs: str) -> str:
    """A page by hand: the first sections, with these outputs."""
    parts = [
        f"## {b.name}\n\n`python {' '.join(b.arguments)}`\n\n{b.about}\n\n```\n{output}\n```\n"
        for b, output in zip((FIRST, SECOND), outputs, strict=True)
    ]
    return HEAD + "\n".join(parts)


def test_a_page_that_was_edited_becomes_data_with_the_days_of_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, data = tmp_path / "page.md", tmp_path / "results.json"
    monkeypatch.setattr(run_all, "ROOT", tmp_path)
    monkeypatch.setattr(run_all, "PAGE", path)
    monkeypatch.setattr(run_all, "RESULTS", data)
    git(tmp_path, "init")
    path.write_text(page("1 s", "2 s\n\n3 s"))
    git(tmp_path, "add", "page.md")
    git(tmp_path, "commit", "-m", "both", day="2026-01-02")
    path.write_text(page("1 s", "2 s\n\n4 s"))
    git(tmp_path, "commit", "-am", "the second", day="2026-01-09")

    run_all.write(run_all.adopted(), "a machine")
    made = run_all.results()
    assert [made[b.name].made for b in (FIRST, SECOND)] == ["2026-01-02", "2026-01-09"]
    assert made[SECOND.name].text == "```\n2 s\n\n4 s\n```"
    written = path.read_text()
    assert f"after {made[FIRST.name].commit}; **old**: 7 days before the newest" in written
    assert f"after {made[SECOND.name].commit}.\n" in written
    assert run_all.last_machine() == "a machine"

    run_all.write(run_all.adopted(), run_all.last_machine())
    assert (path.read_text(), run_all.results()) == (written, made), "again changes nothing"
    assert "Made" not in run_all.sections()[FIRST.name]


def test_the_data_are_of_sections_that_there_are() -> None:
    kept = json.loads(run_all.RESULTS.read_text(encoding="utf-8"))
    assert set(kept) <= {b.name for b in run_all.BENCHMARKS}
    assert all(fields["text"].count("```") % 2 == 0 for fields in kept.values())
