"""The prelude's Soter files as trees: their constants, their functions, the comments above them."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import soter.language.prelude
from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.syntax import tree
from soter.language.syntax.parsing.parser import parse

FOLDER = Path(soter.language.prelude.__file__).parent
FILES = ("math.soter", "vectors.soter")


@cache
def parsed(file: str) -> tree.File:
    """One file of the prelude; it has no diagnostics."""
    diagnostics = Diagnostics()
    result = parse(Source(file, text(file)), diagnostics)
    assert not diagnostics.items, [d.message for d in diagnostics.items]
    return result


@cache
def text(file: str) -> str:
    """Its text."""
    return (FOLDER / file).read_text(encoding="utf-8")


def _number(expr: tree.SyntaxExpr) -> float | None:
    if isinstance(expr, tree.UnaryExpr) and expr.op == "-":
        value = _number(expr.operand)
        return None if value is None else -value
    return float(expr.value) if isinstance(expr, (tree.FloatLit, tree.IntLit)) else None


def constants() -> dict[str, tuple[float, ...]]:
    """Name -> the numbers of a constant (one, or the elements of an array) of `math.soter`."""
    numbers_by_name = {}
    for decl in parsed("math.soter").declarations:
        if isinstance(decl, tree.ConstDecl) and decl.value is not None:
            value = decl.value
            elements = value.elements if isinstance(value, tree.ListExpr) else (value,)
            numbers = [_number(e) for e in elements]
            numbers_by_name[decl.name.text] = tuple(n for n in numbers if n is not None)
            assert None not in numbers, decl.name.text
    return numbers_by_name


def public_functions() -> set[str]:
    """The functions a program may call."""
    return {
        decl.name.text
        for file in FILES
        for decl in parsed(file).declarations
        if isinstance(decl, tree.FunDecl) and not decl.name.text.startswith("_")
    }


def comment_above(function: str) -> str:
    """The comment lines right above a function, joined."""
    for file in FILES:
        match = re.search(rf"((?://[^\n]*\n)+)fun {function}\(", text(file))
        if match:
            return " ".join(line.lstrip("/ ") for line in match[1].splitlines())
    return ""
