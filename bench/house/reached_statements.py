"""A plugin of pytest that notes which statements of `src/soter` each test reaches.

    REACHED=FOLDER PYTHONPATH=bench/house python -m pytest -p reached_statements ...

Purpose: every statement of a function of Soter is compiled with a mark before it; after each test
the marks that it left are noted. At the end each process writes one file into `FOLDER`; `read`
gives what all of them hold.
Non-goals: statements that run as a module is imported, and what other processes reach.
"""

from __future__ import annotations

import ast
import builtins
import importlib.machinery
import os
import pickle
import re
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


def marked(text: str, offset: int) -> ast.Module:
    """A module in which each statement of a function first sets the mark of its line."""
    tree = ast.parse(text)

    def mark(body: list[ast.stmt]) -> list[ast.stmt]:
        new: list[ast.stmt] = []
        for k, statement in enumerate(body):
            first = statement.value if k == 0 and isinstance(statement, ast.Expr) else None
            if not isinstance(first, ast.Constant):  # a docstring stays the first
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


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Notes(Path(os.environ["REACHED"])))


def read(folder: Path) -> tuple[dict[str, int], dict[str, tuple[float, array[int]]]]:
    """Offsets of files, and by the name of each test its processor seconds and the marks."""
    where: dict[str, int] = {}
    tests: dict[str, tuple[float, array[int]]] = {}
    for path in sorted(folder.glob("*.pickle")):
        where, found = pickle.loads(path.read_bytes())  # noqa: S301 - written by this run
        tests |= found
    return where, tests
