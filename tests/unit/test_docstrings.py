"""Docstrings say what a signature cannot: the shapes of arrays and what is raised.

A shape is said by one of: a tuple of lengths, `(n, 3)`, `(cells,)`, `(N + 2n, n)`, `(m, *cells)`;
the word `shape` or `shaped` ("of the grid's shape"); what an entry or a row stands for, `one a
cell`, `one for each point`, `a row a time`. Nouns alone ("the states") and `(n)` are none. That a
shape is right no reader of text can tell, nor that a tuple of words is one of lengths.

An exception is said by its name, or by the code of its diagnostic, `S060`, in the docstring of the
function or of its class. What a function catches itself, re-raises, or raises to say that it
cannot happen (`AssertionError`, `NotImplementedError`) need not be said.
"""

from __future__ import annotations

import ast
import builtins
import re
from functools import cache
from typing import TYPE_CHECKING

import pytest

from tables import all_rows
from unit.test_house_figures import SOURCES, SRC, tree_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SOTER = SRC / "soter"
Function = ast.FunctionDef | ast.AsyncFunctionDef

_LENGTH = r"(?:\*?\w+(?: ?[-+*^] ?\w+)*|\.\.\.)"
SHAPE = re.compile(
    rf"\({_LENGTH},(?: {_LENGTH})?(?:, {_LENGTH})*,?\)"
    r"|\bshape[sd]?\b"
    r"|\b(?:one|a row|a column|an entry)(?: \w+)? (?:a|an|per|for each|for every) \w+",
    re.IGNORECASE,
)
CODE = re.compile(r"\b[A-Z]\d{3}\b")
UNSAID = {"AssertionError", "NotImplementedError"}


def _module(path: Path) -> str:
    return ".".join(path.with_suffix("").parts[len(SRC.parts) :])


def _said(*nodes: ast.AST | None) -> str:
    texts = (
        ast.get_docstring(n)
        for n in nodes
        if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
    )
    return " ".join(" ".join((t or "").split()) for t in texts)


def _public(
    body: list[ast.stmt], inside: ast.ClassDef | None = None
) -> Iterator[tuple[ast.ClassDef | None, Function]]:
    """The functions and methods of a module without an underscore, each with its class."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            if not node.name.startswith("_"):
                yield inside, node
        elif isinstance(node, ast.ClassDef):
            if not node.name.startswith("_"):
                yield from _public(node.body, node)
        elif isinstance(node, ast.If | ast.Try):
            yield from _public(node.body, inside)


def _words(node: ast.AST) -> set[str]:
    return set(re.findall(r"\w+", ast.unparse(node)))


@cache
def _aliases() -> dict[tuple[str, str], set[str]]:
    """The names that each module gives to other types, with the words of what they stand for."""
    words_by_alias: dict[tuple[str, str], set[str]] = {}
    for path in SOURCES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Assign):
                target, value = node.targets[0], node.value
            elif isinstance(node, ast.AnnAssign) and node.value is not None:
                target, value = node.target, node.value
            else:
                continue
            type_like = isinstance(value, ast.Subscript | ast.BinOp | ast.Attribute)
            if isinstance(target, ast.Name) and target.id[0].isupper() and type_like:
                words_by_alias[_module(path), target.id] = _words(value)
    return words_by_alias


def _arrays(path: Path) -> set[str]:
    """The words that name an array in a module: numpy's, its own aliases, imported aliases."""
    names = {"NDArray", "ndarray"}
    for module, known in _array_aliases().items():
        if module == _module(path):
            names |= known
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            known = _array_aliases().get(node.module, set())
            names |= {a.asname or a.name for a in node.names if a.name in known}
    return names


@cache
def _array_aliases() -> dict[str, set[str]]:
    aliases_by_module: dict[str, set[str]] = {}
    for (module, name), words in _aliases().items():
        if words & ({"NDArray", "ndarray"} | aliases_by_module.get(module, set())):
            aliases_by_module.setdefault(module, set()).add(name)
    return aliases_by_module


def unsaid_shapes(path: Path) -> list[str]:
    """The public functions of a file that take or give arrays and say no shape."""
    arrays, offenders = _arrays(path), []
    for _, function in _public(tree_of(path).body):
        args = function.args
        given = [*args.posonlyargs, *args.args, *args.kwonlyargs, args.vararg, args.kwarg]
        notes = [a.annotation for a in given if a is not None] + [function.returns]
        if any(_words(n) & arrays for n in notes if n) and not SHAPE.search(_said(function)):
            offenders.append(f"{function.name}:{function.lineno}")
    return offenders


@cache
def _bases() -> dict[str, set[str]]:
    """Every class, of ours and of Python, with the classes that it is one of."""
    bases_by_class = {
        name: {b.__name__ for b in kind.__mro__}
        for name, kind in vars(builtins).items()
        if isinstance(kind, type) and issubclass(kind, BaseException)
    }
    classes = [n for p in SOURCES for n in ast.walk(tree_of(p)) if isinstance(n, ast.ClassDef)]
    for _ in range(3):  # no family of exceptions is deeper
        for node in classes:
            own = {b.id for b in node.bases if isinstance(b, ast.Name)} & bases_by_class.keys()
            if own:
                bases_by_class[node.name] = {node.name}.union(*(bases_by_class[b] for b in own))
    return bases_by_class


@cache
def _makers() -> dict[tuple[str, str], str]:
    """The functions that give an exception to raise, by module and (last resort) by name alone."""
    class_by_maker: dict[tuple[str, str], str] = {}
    for path in SOURCES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef) and node.returns is not None:
                made = ast.unparse(node.returns).strip("'\"")
                if made in _bases():
                    class_by_maker[_module(path), node.name] = made
                    class_by_maker["", node.name] = made
    return class_by_maker


def _raised(node: ast.Raise, module: str) -> str | None:
    """The name of the class that is raised, None where it is a value that came from elsewhere."""
    if node.exc is None:
        return None
    made = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
    name = made.attr if isinstance(made, ast.Attribute) else getattr(made, "id", "")
    if isinstance(node.exc, ast.Call) and name not in _bases():
        return _makers().get((module, name)) or _makers().get(("", name)) or name
    return name if name in _bases() else None


def _caught(node: ast.Try) -> set[str]:
    classes: set[str] = set()
    for handler in node.handlers:
        again = any(isinstance(n, ast.Raise) and n.exc is None for n in ast.walk(handler))
        if not again:
            classes |= _words(handler.type) if handler.type else {"BaseException"}
    return classes


def _escaping(nodes: list[ast.stmt] | list[ast.AST], module: str) -> set[str]:
    """The classes raised by these statements themselves that they do not catch."""
    classes: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Raise):
            name = _raised(node, module)
            classes |= {name} if name else set()
        elif isinstance(node, ast.Try):
            inner, caught = _escaping(node.body, module), _caught(node)
            classes |= {n for n in inner if not _bases().get(n, {n}) & caught}
            rest = [*node.handlers, *node.orelse, *node.finalbody]
            classes |= _escaping(list[ast.AST](rest), module)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            classes |= _escaping(list(ast.iter_child_nodes(node)), module)
    return classes - UNSAID


def unsaid_exceptions(path: Path) -> list[str]:
    """The public functions of a file that raise what their docstring does not name."""
    offenders = []
    for owner, function in _public(tree_of(path).body):
        said = _said(function, owner)
        for name in sorted(_escaping(function.body, _module(path))):
            coded = "SoterError" in _bases().get(name, ()) and CODE.search(said)
            if not coded and not re.search(rf"\b{name}\b", said):
                offenders.append(f"{function.name}:{function.lineno} {name}")
    return offenders


@pytest.mark.long
@all_rows("path", SOURCES, ids=lambda p: str(p.relative_to(SOTER)))
def test_functions_of_arrays_say_their_shapes(path: Path) -> None:
    assert unsaid_shapes(path) == []


@all_rows("path", SOURCES, ids=lambda p: str(p.relative_to(SOTER)))
def test_functions_that_raise_say_what(path: Path) -> None:
    assert unsaid_exceptions(path) == []


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ("The states.", True),
        ("The states (n).", True),
        ("Of one state, in SI units.", True),
        ("The states (n,).", False),
        ("Edges (cells * 2^times + 1,).", False),
        ("In the grid's shape.", False),
        ("A row a facet.", False),
    ],
)
def test_a_shape_that_is_not_said_is_found(tmp_path: Path, said: str, found: bool) -> None:
    path = tmp_path / "shapes.py"
    body = f"def given(x: list[NDArray[np.float64]]) -> None:\n    {said!r}\n"
    path.write_text(body, encoding="utf-8")
    assert unsaid_shapes(path) == (["given:1"] if found else [])


@pytest.mark.parametrize(
    ("said", "body", "found"),
    [
        ("It.", "raise ValueError('no')", ["ValueError"]),
        ("ValueError where it is none.", "raise ValueError('no')", []),
        ("It.", "raise mistake('U001', 'no')", ["SoterError"]),
        ("U001 where it is none.", "raise mistake('U001', 'no')", []),
        ("It.", "try:\n        raise KeyError\n    except LookupError:\n        pass", []),
        ("It.", "try:\n        raise KeyError\n    except OSError:\n        pass", ["KeyError"]),
        ("It.", "try:\n        raise KeyError\n    except KeyError:\n        raise", ["KeyError"]),
        ("It.", "def inner() -> None:\n        raise ValueError('no')", []),
        ("It.", "raise AssertionError('no')", []),
    ],
)
def test_an_exception_that_is_not_said_is_found(
    tmp_path: Path, said: str, body: str, found: list[str]
) -> None:
    path = tmp_path / "raises.py"
    path.write_text(f"def given() -> None:\n    {said!r}\n    {body}\n", encoding="utf-8")
    assert unsaid_exceptions(path) == [f"given:1 {name}" for name in found]
