"""Shipped examples with something changed in them, in a folder of the test's own."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

DRONE = Path(__file__).resolve().parents[1] / "examples" / "drone"


@pytest.fixture
def drone(tmp_path: Path) -> Path:
    """A copy of `examples/drone`."""
    folder = tmp_path / "drone"
    shutil.copytree(DRONE, folder, ignore=shutil.ignore_patterns("__pycache__", ".soter"))
    return folder


def changed(path: Path, old: str, new: str) -> None:
    """Writes a file with `new` wherever it says `old`, which it has to say."""
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
