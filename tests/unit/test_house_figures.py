"""The figures of the house: circles of imports, sizes, calls that nobody can read.

`python tests/unit/test_house_figures.py` lists what is over a figure, asserted here or not yet.
"""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

SRC = Path(__file__).resolve().parents[2] / "src"

MODULES_IN_A_ROOM = 16
LINES_OF_A_FILE = 500
LINES_OF_A_FUNCTION = 70
POSITIONAL = 7
"""Arguments without names that one call may have."""


@cache
def trees() -> dict[Path, ast.Module]:
    """Every source by its path, parsed when somebody asks: each worker reads this file."""
    return {
        p.relative_to(SRC): ast.parse(p.read_text(encoding="utf-8"))
        for p in sorted((SRC / "soter").rglob("*.py"))
        if "templates" not in p.parts
    }


def name_of(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(path: Path) -> str:
    return ".".join(path.parent.parts)


def imports() -> dict[str, set[str]]:
    """Every file by name -> the files it imports, for annotations too."""
    names = {name_of(p) for p in trees()}
    graph: dict[str, set[str]] = {}
    for path, tree in trees().items():
        found = graph.setdefault(name_of(path), set())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found |= {a.name for a in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                wholes = {f"{node.module}.{a.name}" for a in node.names}
                found |= wholes & names or {node.module}
                found |= {node.module} if wholes - names else set()
        found &= names - {name_of(path)}
    return graph


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Files each of which reaches all others of its circle."""

    def reached(start: str) -> set[str]:
        seen, todo = set[str](), [start]
        while todo:
            new = graph[todo.pop()] - seen
            seen |= new
            todo += new
        return seen

    reach = {name: reached(name) for name in graph}
    found = {frozenset(m for m in reach[n] if n in reach[m]) for n in graph if n in reach[n]}
    return [set(c) for c in found]


def long_files() -> Iterator[str]:
    for path in trees():
        lines = len((SRC / path).read_text(encoding="utf-8").splitlines())
        if lines > LINES_OF_A_FILE:
            yield f"{path}: {lines}"


def long_functions() -> Iterator[str]:
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > LINES_OF_A_FUNCTION:
                    yield f"{path}:{node.lineno} {node.name}: {lines}"


def long_calls() -> Iterator[str]:
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and len(node.args) > POSITIONAL:
                name = ast.unparse(node.func)
                if "lib." not in name:  # C knows no names of arguments
                    yield f"{path}:{node.lineno} {name}: {len(node.args)}"


def test_circles_are_seen() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "e"}, "e": {"d"}}
    assert sorted(map(sorted, circles(graph))) == [["b", "c"], ["d", "e"]]
    assert "soter.program.model.system" in imports()["soter.program.flatten.derived"]


def test_files_do_not_import_each_other_in_circles() -> None:
    assert circles(imports()) == []


def test_a_room_is_small_enough_to_be_known() -> None:
    sizes = Counter(room_of(p) for p in trees() if p.name != "__init__.py")
    assert {r: n for r, n in sizes.items() if n > MODULES_IN_A_ROOM} == {}


def test_a_call_names_its_arguments_where_they_are_many() -> None:
    assert list(long_calls()) == []


REASONS = {
    "soter/program/flatten/elaborate.py": "one pass: the order of mention numbers the topics",
    "soter/program/model/typed.py": "the checked tree, records only",
    "soter/syntax/tree.py": "the tree, records only",
}
"""Files that are longer, and why."""


def test_a_file_is_short_or_says_why_not() -> None:
    assert {x.partition(":")[0] for x in long_files()} == set(REASONS)


def test_a_function_fits_on_a_page() -> None:
    assert list(long_functions()) == []
