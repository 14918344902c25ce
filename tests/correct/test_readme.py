"""What the README and the pages promise is so: its program is the example's, its commands work."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import pytest

import processes
from generators.file_listing import files_below
from soter.language.prelude.function_error_bounds import BOUNDS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^(soter [^\n#]*?)\s*(?:#.*)?$", README, re.MULTILINE)
VIOLATED = 3


def _words(text: str) -> str:
    return " ".join(re.sub(r"//[^\n]*", "", text).split())


def test_the_program_shown_is_the_one_that_is_shipped() -> None:
    shown = re.search(r"^```\n(node Fast.*?)^```", README, re.MULTILINE | re.DOTALL)
    assert shown
    shipped = _words((ROOT / "examples" / "wall" / "cart.soter").read_text(encoding="utf-8"))
    for declaration in re.split(r"\n(?=\w)", shown.group(1)):
        part = _words(declaration)
        core = re.sub(r" verify \{.*?\} \}", " }", shipped)
        assert part in core or part in shipped, part


def _done(command: str, folder: Path) -> processes.Done:
    return processes.run(
        [sys.executable, "-m", "soter.cli.main", *command.split()[1:]],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.pages
def test_a_command_of_the_readme_works(command: str, tmp_path: Path) -> None:
    for folder in ("wall", "drone", "testing"):
        shutil.copytree(ROOT / "examples" / folder, tmp_path / "examples" / folder)
    done = _done(command, tmp_path)
    expected = VIOLATED if command.endswith("late_sc.soter") else 0
    assert done.returncode == expected, done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.pages
def test_the_python_of_the_first_hour_works() -> None:
    page = (ROOT / "docs" / "first-hour.md").read_text(encoding="utf-8")
    code = re.search(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert code
    done = processes.run(
        [sys.executable, "-c", code.group(1)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0 0.")


def test_links_of_the_pages_lead_somewhere() -> None:
    for page in (ROOT / "README.md", *files_below(ROOT / "docs", "*.md")):
        for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
            if not target.startswith(("http", "mailto")):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_prelude_page_lists_every_bounded_function() -> None:
    page = (ROOT / "docs" / "prelude.md").read_text(encoding="utf-8")
    missing = [name for name in BOUNDS if not re.search(rf"`{name}\b", page)]
    assert missing == []
