"""One server for the tests of a file, and programs in a folder of their own."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from editor_client import Editor, editor

if TYPE_CHECKING:
    from collections.abc import Iterator

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    """An editor with a server; documents that a test opens are its own."""
    with editor(tmp_path_factory.mktemp("editor")) as made:
        yield made


@pytest.fixture
def wall(tmp_path: Path) -> Path:
    """A folder with the cart and what imports it."""
    for name in ("cart.soter", "cart_test.soter", "cart_firmware.soter"):
        shutil.copy(EXAMPLES / "wall" / name, tmp_path / name)
    return tmp_path
