"""What pip is told to install: one name, few extras, and nobody sent to a stranger's package."""

from __future__ import annotations

import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import processes
from soter.version import DISTRIBUTION, VERSION, pip_command

ROOT = Path(__file__).resolve().parents[3]
TOML: Any = import_module("tomllib" if find_spec("tomllib") else "tomli")
PROJECT = TOML.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
OF_DEVELOPERS = {"docs", "test", "lint", "release"}
HISTORY = {"docs/decisions.md", "CHANGELOG.md", "tests/unit/release/test_distribution.py"}
"""What says how it was, and this file."""
WITH_EXTRAS = re.compile(r"""(?<![\w.])(?:(soter[\w-]*)\\?|['"]\.)\[([a-z]+(?:,[a-z]+)*)\\?\]""")
INSTALLED = re.compile(r"\b(?:pipx? install|pipx inject|uv tool install|uv add)\b[^\n`;|&#]*")
NAMED = re.compile(r"\bextra `(\w+)`")
OWN = re.compile(r"(?<![\w./-])soter(?![\w./-])")
KINDS = (".py", ".md", ".toml", ".j2", ".in", ".soter", ".json", ".js", ".txt", ".sh", "run")


def texts() -> list[tuple[str, str]]:
    """What people read and run, by name: whatever the repository keeps, or lies in its folders."""
    words = ["git", "ls-files"]
    listed = processes.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    names = listed.split("\n")[:-1] or [p.relative_to(ROOT).as_posix() for p in ROOT.rglob("*.*")]
    found = [n for n in names if n.endswith(KINDS) and not n.startswith(("docs/benchmarks/", "."))]
    paths = [(n, ROOT / n) for n in found if n not in HISTORY and (ROOT / n).is_file()]
    return [(n, path.read_text(encoding="utf-8", errors="replace")) for n, path in paths]


def test_the_line_that_installs_is_for_the_python_that_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In pipx and uv the `pip` of the shell installs elsewhere, or there is none."""
    monkeypatch.setattr("sys.executable", "/tools/a soter/bin/python")
    for found, line in (
        ("/tools/a soter/bin/pip", "pip install 'soter-rta[prove]'"),
        ("/usr/bin/pip", "'/tools/a soter/bin/python' -m pip install 'soter-rta[prove]'"),
        (None, "'/tools/a soter/bin/python' -m pip install 'soter-rta[prove]'"),
    ):
        monkeypatch.setattr("shutil.which", lambda _, found=found: found)
        assert pip_command("prove") == line
    monkeypatch.setattr("soter.version.find_spec", lambda _: None)
    python = "uv pip install --python '/tools/a soter/bin/python'"
    assert pip_command("prove") == f"{python} 'soter-rta[prove]'"


def wrong(text: str) -> list[str]:
    """What a text tells to install that is not Soter's, or an extra that it has not."""
    found = []
    for name, extras in WITH_EXTRAS.findall(text):
        unknown = set(extras.split(",")) - set(EXTRAS)
        if name not in ("", DISTRIBUTION) or unknown:
            found.append(f"{name}[{extras}]")
    found += [name for name in NAMED.findall(text) if name not in EXTRAS]
    return found + [line for line in INSTALLED.findall(text) if OWN.search(line)]


def test_the_name_and_the_version_stand_in_one_place_each() -> None:
    assert (PROJECT["name"], PROJECT["version"]) == (DISTRIBUTION, VERSION)
    assert PROJECT["entry-points"]["pipx.run"] == {DISTRIBUTION: PROJECT["scripts"]["soter"]}
    named = [
        p.relative_to(ROOT).as_posix()
        for p in sorted((ROOT / "src").rglob("*.py"))
        if DISTRIBUTION in p.read_text(encoding="utf-8")
    ]
    assert named == ["src/soter/version.py"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("pip install 'soter-rta[prove]'", 0),
        ("pip install -e '.[prove,logs]'", 0),
        ("pip install soter-rta && soter new rover", 0),
        ("pipx run --spec dist/x.whl soter", 0),
        ("pip install soter", 1),
        ("pipx install soter", 1),
        ("pip install 'soter[prove]'", 2),
        ("of `soter-rta[ros]`", 1),
        ("match='soter\\[log\\]'", 1),
        ("pip install -e '.[zig]'", 1),
        ("the extra `mavlink` is absent, not the extra `logs`", 1),
    ],
)
def test_what_would_be_found_of_a_wrong_name(text: str, found: int) -> None:
    assert len(wrong(text)) == found


def test_nothing_sends_anybody_to_another_package_or_extra() -> None:
    assert {name: bad for name, text in texts() if (bad := wrong(text))} == {}


def test_the_extras_are_few_and_all_has_those_of_people() -> None:
    (whole,) = EXTRAS["all"]
    people = set(EXTRAS) - OF_DEVELOPERS - {"all"}
    assert set(whole[len(DISTRIBUTION) + 1 : -1].split(",")) == people
    assert len(people) <= 12


def test_the_page_of_a_missing_package_names_every_extra_of_people() -> None:
    page = (ROOT / "src/soter/diagnostics/pages/D007.md").read_text(encoding="utf-8")
    assert [
        e
        for e in sorted(set(EXTRAS) - OF_DEVELOPERS)
        if f"pip install '{DISTRIBUTION}[{e}]'" not in page
    ] == []
