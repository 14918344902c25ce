"""What says ACCEPTED executes no text and compiles nothing: a tree is walked."""

from __future__ import annotations

import ast
from pathlib import Path

import soter.certificate

ROOM = Path(soter.certificate.__file__).parent
CALLS = frozenset({"exec", "eval", "compile", "__import__"})
MODULES = frozenset(
    {"re", "ast", "code", "ctypes", "cffi", "importlib", "marshal", "pickle", "runpy", "subprocess"}
)
ASKS_ONLY = ("importlib.util.find_spec",)
"""Whether a solver is installed."""


def used(text: str) -> set[str]:
    """The calls and modules of a file that execute text, read text as code, or start a compiler."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            found |= {node.func.id} & CALLS
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{a.name}" for a in node.names]
        found |= {n for n in names if n.partition(".")[0] in MODULES and n not in ASKS_ONLY}
        found |= {n for n in names if n.startswith("soter.native")}
    return found


def test_no_text_is_executed_and_nothing_is_compiled() -> None:
    files = sorted(ROOM.rglob("*.py"))
    assert len(files) > 40
    assert {f.name: used(f.read_text(encoding="utf-8")) for f in files} == {
        f.name: set() for f in files
    }
    assert not [f for f in ROOM.rglob("*") if f.suffix in {".c", ".h", ".so", ".pyx"}]


def test_what_would_is_seen() -> None:
    for text in (
        "exec(x)",
        "y = [eval(x)]",
        "import re",
        "from importlib import import_module",
        "def f():\n  from soter.native.shared_library import load",
        "import ctypes.util",
    ):
        assert used(text), text
