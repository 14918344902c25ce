"""A plugin of pytest that notes which statements of `src/soter` each test reaches.

    REACHED=FOLDER PYTHONPATH=bench/house python -m pytest -p reached_statements ...
    python bench/house/reached_statements.py FOLDER

Purpose: every statement of a function of Soter is compiled with a mark before it; after each test
that passes the marks that it left are noted. At the end each process writes one file into `FOLDER`;
`read` gives what all of them hold, and run as a command it prints the share of each room.
Non-goals: statements that run as a module is imported, and what other processes reach.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import importlib.machinery
import os
import pickle
import re
import sys
from array import array
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

SOTER = Path("src/soter").resolve()
"""Tests are run in the folder above `src`."""
MARKS = "soter_marks_"
"""A builtin: one byte a line of all files together."""


def offsets(soter: Path) -> dict[str, int]:
    """By the path of each file below `soter`: how many lines the files before it have."""
    at, given = 0, {}
    for path in sorted(soter.rglob("*.py")):
        given[str(path.relative_to(soter))] = at
        at += len(path.read_text(encoding="utf-8").splitlines()) + 1
    return {**given, "": at}


def statements(tree: ast.Module) -> list[ast.stmt]:
    """The statements inside functions, docstrings aside."""
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    every = {id(n): n for f in functions for n in ast.walk(f) if n is not f}
    return [n for n in every.values() if isinstance(n, ast.stmt) and not is_text(n)]


def is_text(node: ast.stmt) -> bool:
    """A docstring, which nothing runs and before which no mark may stand."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def marked(text: str, offset: int) -> ast.Module:
    """A module in which each statement of a function first sets the mark of its line."""
    tree = ast.parse(text)

    def mark(body: list[ast.stmt]) -> list[ast.stmt]:
        new: list[ast.stmt] = []
        for statement in body:
            if not is_text(statement):
                one = ast.parse(f"{MARKS}[{offset + statement.lineno}] = 1").body[0]
                for node in ast.walk(one):
                    ast.copy_location(node, statement)
                new.append(one)
            new.append(statement)
        return new

    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    inside = {id(node): node for f in functions for node in ast.walk(f)}
    for node in inside.values():
        for field in ("body", "orelse", "finalbody"):
            body = getattr(node, field, None)
            if isinstance(body, list) and body and not isinstance(node, ast.ClassDef):
                setattr(node, field, mark(body))
    return tree


class Notes:
    """What the tests of this process reached, and the seconds that each took."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.offsets = offsets(SOTER)
        self.marks = bytearray(self.offsets[""] + 1)
        self.tests: dict[str, tuple[float, array[int]]] = {}
        self.failed: set[str] = set()
        setattr(builtins, MARKS, self.marks)
        plain = importlib.machinery.SourceFileLoader.get_code

        def get_code(loader: Any, name: str) -> Any:  # noqa: ANN401 - as the loader has it
            path = Path(loader.path)
            if SOTER not in path.parents:
                return plain(loader, name)
            offset = self.offsets[str(path.relative_to(SOTER))]
            return compile(marked(path.read_text(encoding="utf-8"), offset), str(path), "exec")

        importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[assignment,method-assign]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Note what a test reaches, if it passes."""
        self.marks[:] = bytes(len(self.marks))
        before = os.times()
        given = yield
        after = os.times()
        seconds = sum(after[:4]) - sum(before[:4])
        if item.nodeid not in self.failed:
            found = (m.start() for m in re.finditer(b"\x01", self.marks))
            self.tests[item.nodeid] = seconds, array("I", found)
        return given

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note which tests fail."""
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Write what was noted."""
        if self.tests:
            path = self.folder / f"{os.getpid()}.pickle"
            path.write_bytes(pickle.dumps((self.offsets, self.tests)))


def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Before the first `conftest.py`, which imports what is to be marked."""
    early_config.pluginmanager.register(Notes(Path(os.environ["REACHED"])))


def read(folder: Path) -> tuple[dict[str, int], dict[str, tuple[float, array[int]]]]:
    """Offsets of files, and by the name of each test its processor seconds and the marks."""
    where: dict[str, int] = {}
    tests: dict[str, tuple[float, array[int]]] = {}
    for path in sorted(folder.glob("*.pickle")):
        where, found = pickle.loads(path.read_bytes())  # noqa: S301 - written by this run
        tests |= found
    return where, tests


def main() -> int:
    """Print how many of the statements of each room's functions the tests of a run reach."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    where, tests = read(parser.parse_args().folder)
    reached = {mark for _, marks in tests.values() for mark in marks}
    rooms: dict[str, list[bool]] = {}
    for name, offset in where.items():
        path = SOTER / name
        lines = {s.lineno for s in statements(ast.parse(path.read_text()))} if name else set()
        room = name.split("/")[0] if "/" in name else "soter"
        rooms.setdefault(room, []).extend(offset + line in reached for line in lines)
    for room, found in sorted(rooms.items()):
        if found:
            print(f"{room:14} {sum(found) / len(found):6.1%} of {len(found):6,}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
