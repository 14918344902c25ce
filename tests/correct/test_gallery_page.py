"""What docs/gallery.md says happens, happens."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import pytest

import processes
from generators.file_listing import files_in

pytestmark = pytest.mark.pages
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
FOLDERS = ("gallery", "robots")
SPACES = re.compile(r"[ ─]+")
SESSIONS = re.findall(r"^```\n\$ soter (.*?)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def _plain(text: str) -> str:
    """One space for many, so that a page may cut what is to the right of a column."""
    return "\n".join(SPACES.sub(" ", line).strip() for line in text.splitlines())


def _here(folder: Path) -> Path:
    for part in FOLDERS:
        shutil.copytree(ROOT / "examples" / part, folder / "examples" / part)
    return folder


def _soter(folder: Path, *arguments: str) -> processes.Done:
    command = [sys.executable, "-m", "soter.cli.main", *arguments]
    return processes.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_the_page_has_a_session_of_every_file() -> None:
    files = {p.stem for f in FOLDERS for p in files_in(ROOT / "examples" / f, "*.soter")}
    assert {Path(command.split()[1]).stem for command, _ in SESSIONS} == files


LARGE = ("test examples/gallery/token_ring.soter", "verify examples/robots/lift.soter")
"""`test_gallery.py` holds the verdicts and figures of the first against the page."""


@pytest.mark.parametrize(
    ("command", "said"),
    [pytest.param(c, s, id=c, marks=[pytest.mark.long] if c in LARGE else []) for c, s in SESSIONS],
)
def test_a_command_says_what_the_page_says(command: str, said: str, tmp_path: Path) -> None:
    done = _soter(_here(tmp_path), *command.split())
    assert done.returncode in (0, 3), done.stderr
    there = _plain(done.stdout)
    lines = [x for x in said.splitlines() if x.strip() and x != "..."]
    assert lines
    for line in lines:
        for wanted in _columns(line):
            assert wanted in there, f"{wanted!r} is not, or not there, in\n{done.stdout}"
            there = there[there.index(wanted) + len(wanted) :]


def _columns(line: str) -> list[str]:
    """What stands apart: the page may leave out what is to the right of a column."""
    cells = re.split(r" {2,}", line.strip())
    return [_plain(cell) for cell in cells]
