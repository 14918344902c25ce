"""The programs that lie in the repository and that both engines can run by themselves.

Purpose: examples, and the small programs of the tests, as subjects of the comparing tests.
Non-goals: programs with externs: somebody has to answer those.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from generators.engine_comparison import subject_of
from generators.file_listing import files_below
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from generators.engine_comparison import Subject

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("examples", "tests/correct", "tests/dynamic_error", "tests/corners")


def files(*folders: str) -> list[Path]:
    """All programs below some folders of the repository."""
    return sorted(p for f in (folders or FOLDERS) for p in files_below(ROOT / f, "*.soter"))


def subjects_of(path: Path, instants: int) -> list[Subject]:
    """Every system of a program that needs nobody's answers, for so many instants."""
    text = path.read_text(encoding="utf-8")
    checked = check_file(str(path), text)
    if not checked.ok:
        return []
    subjects: list[Subject] = []
    for number, system in enumerate(checked.systems):
        name = f"{path.stem}_{number}_of_{path.parent.name}"
        try:
            s = subject_of(checked, name, text, 7, until=instants, system=system)
        except SoterError:
            continue  # a library: its nodes wait for a system that somebody else writes
        externs = any(x.extern for x in s.system.components)
        if not externs and not any(f.extern for f in s.system.program.funs.values()):
            subjects.append(s)
    return subjects
