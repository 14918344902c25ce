"""Tests of what has changed: `pytest --changed-since REVISION`, `make test-changed`.

Purpose: of all files of tests those are collected that have changed since a revision of git, or
use a file that has, directly or through others. A Python file uses what it imports, wherever it
does, and modules that it names in a string (`python -m soter`, tables of commands). A file that is
not Python is used by whoever names it, or a folder that it is in.
Non-goals: which of a file's tests use the change; what a program builds a name for.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import TYPE_CHECKING

import processes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    import pytest

ROOT = Path(__file__).resolve().parents[1]
ROOTS = (".", "src", "tests", "bench", "docs/site", "examples")
"""Where imports of Python begin."""
NAME = re.compile(r"\w[\w./-]*")
STRING = ":"
"""Behind a name that stands in a string: `python -m` and tables of commands name modules so."""
SRC = ROOT / "src"
EVERYBODYS = {"src", "soter", "tests"}
"""Folders that too many name for it to mean their files."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--changed-since",
        default="",
        metavar="REVISION",
        help="files of tests that use what has changed since a revision of git, and no others",
    )


def pytest_configure(config: pytest.Config) -> None:
    revision = config.getoption("--changed-since")
    if revision:
        since = changed_since(revision)
        config.pluginmanager.register(Selected(since, tests_of(since)), "changed-tests")


class Selected:
    """A plugin that leaves out other files."""

    def __init__(self, since: list[Path], tests: set[Path]) -> None:
        self.since, self.tests = since, tests

    def pytest_report_header(self) -> str:
        return f"{len(self.since)} changed files are used by {len(self.tests)} files of tests"

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        other = collection_path.suffix == ".py" and collection_path not in self.tests
        return True if other else None


def changed_since(revision: str) -> list[Path]:
    """What git says has changed, been added or removed; files that it ignores are not looked at."""
    listed = ["git", "ls-files", "--others", "--exclude-standard"]
    names: list[str] = []
    for command in (["git", "diff", "--name-only", "--no-renames", revision], listed):
        names += processes.run(
            command, cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.splitlines()
    return sorted({ROOT / name for name in names})


def tests_of(changed: Iterable[Path]) -> set[Path]:
    """The files of tests that use one of the `changed` files."""
    files = {path for root in ROOTS[1:] for path in (ROOT / root).rglob("*.py")}
    words = {path: set(_words(path)) for path in files}
    stems = {path.stem for path in files} | {path.parent.name for path in files}
    users: dict[Path, set[Path]] = {}
    for path, said in words.items():
        for used in _used(
            path, {w for w in said if w.removesuffix(STRING).rpartition(".")[2] in stems}, files
        ):
            users.setdefault(used, set()).add(path)
    reached: set[Path] = set()
    todo = list(changed)
    while todo:
        path = todo.pop()
        reached.add(path)
        found = users.get(path, set())
        if path.suffix != ".py":
            parts = {path.name, *path.relative_to(ROOT).parts[:-1]} - EVERYBODYS
            said_as = {f"{part}{STRING}" for part in parts}
            found = {user for user, said in words.items() if said & said_as}
        todo += found - reached
    return {path for path in reached if path.name.startswith("test_") and path.exists()}


def _used(path: Path, words: Iterable[str], files: set[Path]) -> Iterator[Path]:
    """The Python files that the words of a file name: from a root, or from its own folder."""
    for word in words:
        for folder in (path.parent, *(ROOT / root for root in ROOTS)):
            module = folder / word.removesuffix(STRING).replace(".", "/")
            if not word.endswith(STRING):
                yield from files & {Path(f"{module}.py"), module / "__init__.py"}
            elif SRC not in path.parents:
                yield from files & {Path(f"{module}.py"), module / "__main__.py"}
            elif folder == path.parent:  # a table of commands
                yield from files & {Path(f"{module}.py")}


def _words(path: Path) -> Iterator[str]:
    """Names that a Python file imports; those in its strings, with `STRING` behind them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and NAME.fullmatch(str(node.value)):
            names = (str(node.value), *str(node.value).split("/"))
            yield from (f"{name}{STRING}" for name in names)
