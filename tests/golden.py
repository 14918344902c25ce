"""Golden files: long expected texts that are compared as a whole and renewed by a switch.

Purpose: the fixture `golden(name, text)`, which compares `text` with `tests/golden/<name>`;
`pytest --update-golden` writes the files instead, to be reviewed as a diff.
Non-goals: binary files; choosing what is worth a golden.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

FOLDER = Path(__file__).parent / "golden"


def compare(name: str, text: str, *, update: bool) -> None:
    """Compare `text` with the golden file `name`, or write that file."""
    path = FOLDER / name
    if update:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
        return
    if not path.exists():
        pytest.fail(f"no golden file {name}: run pytest --update-golden and look at it")
    expected = path.read_text(encoding="utf-8")
    if text != expected:
        difference = difflib.unified_diff(
            expected.splitlines(), text.splitlines(), f"golden/{name}", "now", lineterm=""
        )
        shown = "\n".join(difference) or "(they differ in line ends only)"
        pytest.fail(f"{shown}\nif this is meant, run pytest --update-golden", pytrace=False)


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """`golden(name, text)`: see `compare`."""
    update = bool(request.config.getoption("--update-golden"))
    return lambda name, text: compare(name, text, update=update)
