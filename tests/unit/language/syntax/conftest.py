"""What the tests of lexer, parser and printer share."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from generators.file_listing import files_below
from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Source, Span
from soter.language.syntax.parsing.parser import parse

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.syntax.tree import File

HERE = Path(__file__).parent
ROOT = HERE.parents[3]


def parse_text(text: str) -> tuple[File, tuple[Diagnostic, ...]]:
    diagnostics = Diagnostics()
    return parse(Source("test.soter", text), diagnostics), diagnostics.items


def shape_of(node: object) -> Any:
    """The tree without its spans, as something that can be compared."""
    if isinstance(node, tuple):
        return tuple(shape_of(part) for part in node)
    if dataclasses.is_dataclass(node) and not isinstance(node, type):
        values = [(f.name, getattr(node, f.name)) for f in dataclasses.fields(node)]
        kept = tuple((n, shape_of(v)) for n, v in values if not isinstance(v, Span))
        return (type(node).__name__, *kept)
    return node


def sample_files() -> list[Path]:
    """Every Soter file of the project, and the sample with every construct."""
    files = files_below(HERE / "samples", "*.soter")
    for folder in ("examples", "src/soter/language/prelude"):
        files += files_below(ROOT / folder, "*.soter")
    return sorted(files)


@pytest.fixture(scope="session")
def parsed() -> Callable[[str], tuple[File, tuple[Diagnostic, ...]]]:
    """`parsed(text)`: the tree and the diagnostics."""
    return parse_text


@pytest.fixture(scope="session")
def shape() -> Callable[[object], Any]:
    """`shape(tree)`: the tree without spans."""
    return shape_of


@pytest.fixture
def everything() -> str:
    """The sample with every construct."""
    return (HERE / "samples" / "everything.soter").read_text(encoding="utf-8")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "sample" in metafunc.fixturenames:
        files = sample_files()
        metafunc.parametrize("sample", files, ids=[str(f.relative_to(ROOT)) for f in files])
