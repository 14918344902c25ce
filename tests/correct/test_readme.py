"""What the README and the pages promise is so: its program is the example's, its commands work."""

from __future__ import annotations

import os
import re
import shutil
import sys
import sysconfig
from pathlib import Path

import pytest

import processes
from generators.file_listing import files_below
from soter.language.prelude.function_error_bounds import BOUNDS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^(soter [^\n#]*?)\s*(?:#.*)?$", README, re.MULTILINE)
DOORS = sorted((ROOT / "docs").glob("for-*.md"))
OF_A_CLONE = re.compile(r"\b(?:examples|bench)/|^make (?!-C)|pip install -e", re.MULTILINE)
"""What somebody has not who installed the wheel."""
SCREEN = 60
"""Lines of the README that somebody sees before scrolling, with the picture."""


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
    shutil.copytree(ROOT / "examples" / "wall", tmp_path / "examples" / "wall")
    done = _done(command, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.pages
def test_the_lines_that_install_soter_give_a_command_that_works(tmp_path: Path) -> None:
    """Run as it stands, in a copy: what Soter needs of others comes from this environment.

    What builds it comes from a package index.
    """
    (lines,) = re.findall(r"^```sh\n(python3 -m venv.*?)```", README, re.MULTILINE | re.DOTALL)
    for part in ("src", "examples/wall"):
        shutil.copytree(ROOT / part, tmp_path / part)
    for name in ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "python3").symlink_to(sys.executable)
    environment = {
        **{k: v for k, v in os.environ.items() if k != "VIRTUAL_ENV"},
        "PATH": f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": sysconfig.get_path("purelib"),
        "PIP_NO_DEPS": "1",
    }
    check = "command -v soter && soter check examples/wall/cart.soter"
    done = processes.run(
        ["bash", "-ec", f"{lines}{check}"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if "No matching distribution found for setuptools" in done.stderr:
        pytest.skip("no package index can be reached from here")
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{tmp_path / '.venv' / 'bin' / 'soter'}\nok  " in done.stdout
    extras = re.search(r"\[(.*?)\]'", lines)
    declared = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert extras
    assert all(f"\n{extra} = [" in declared for extra in extras[1].split(","))


def test_the_first_screen_of_the_readme_has_few_links_and_its_version_is_this_one() -> None:
    screen = "\n".join(README.splitlines()[:SCREEN])
    assert "PROVED" in screen
    assert "VIOLATED" in screen
    assert "pip install" in screen
    assert len(re.findall(r"(?<!!)\[[^\]]*\]\(", screen)) <= 6
    declared = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    version = re.search(r'^version = "(.*)"', declared, re.MULTILINE)
    assert version
    assert f"Version {version[1]}, " in README


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


@pytest.mark.parametrize("path", DOORS, ids=lambda p: p.stem)
@pytest.mark.pages
def test_commands_of_a_door_work_in_an_empty_folder(path: Path, tmp_path: Path) -> None:
    """One after the other, each with the exit code that stands beside it."""
    page = path.read_text(encoding="utf-8")
    _, _, section = page.partition("\n## Try it in an empty folder\n")
    block = section.split("```sh\n")[1].split("```")[0]
    lines = block.replace("\\\n", " ").splitlines()
    assert len(lines) >= 5
    for line in lines:
        words = line.partition("#")[0].split()
        soter = [sys.executable, "-m", "soter.cli.main"] if words[0] == "soter" else [words[0]]
        done = processes.run(
            [*soter, *words[1:]], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        told = re.search(r"#.*\bexit (\d+)", line)
        assert done.returncode == (int(told[1]) if told else 0), done.stdout + done.stderr


@pytest.mark.parametrize("path", [*DOORS, ROOT / "README.md"], ids=lambda p: p.stem)
def test_a_door_says_which_commands_want_a_clone(path: Path) -> None:
    """In the section of the commands; of the README in one that says what the wheel has not."""
    page = path.read_text(encoding="utf-8")
    sections = [page] if path.stem == "README" else re.split(r"^## ", page, flags=re.MULTILINE)
    for section in sections:
        code = "\n".join(re.findall(r"^```sh\n(.*?)^```", section, re.MULTILINE | re.DOTALL))
        said = re.search(r"want a clone|The wheel\s+has no `examples/`", section)
        assert said or not OF_A_CLONE.search(code), section


def test_links_of_the_pages_lead_somewhere() -> None:
    for page in (ROOT / "README.md", *files_below(ROOT / "docs", "*.md")):
        for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
            if not target.startswith(("http", "mailto")):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_prelude_page_lists_every_bounded_function() -> None:
    page = (ROOT / "docs" / "prelude.md").read_text(encoding="utf-8")
    missing = [name for name in BOUNDS if not re.search(rf"`{name}\b", page)]
    assert missing == []
