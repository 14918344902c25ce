"""One server for the tests of a file, and programs in a folder of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from editor_client import Editor, editor

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    """An editor with a server; documents that a test opens are its own."""
    with editor(tmp_path_factory.mktemp("editor")) as made:
        yield made
