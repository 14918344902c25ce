"""Which files of tests `make test-changed` takes, in a small tree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import changed_tests

if TYPE_CHECKING:
    from pathlib import Path

TREE = {
    "src/soter/__init__.py": "",
    "src/soter/__main__.py": "from soter.cli import main",
    "src/soter/cli/__init__.py": "",
    "src/soter/cli/main.py": 'COMMANDS = {"fly": "flies"}',
    "src/soter/cli/fly.py": "def run():\n    from soter.model import motion\n",
    "src/soter/model/__init__.py": "",
    "src/soter/model/motion.py": "",
    "src/soter/model/picture.py": "",
    "tests/helper.py": "import soter.model.picture",
    "tests/unit/test_motion.py": "from soter.model.motion import x",
    "tests/unit/test_picture.py": "from helper import x",
    "tests/unit/test_commands.py": 'run("python", "-m", "soter")',
    "tests/unit/test_robots.py": 'ROBOTS = ROOT / "examples"',
    "tests/unit/test_prose.py": '"""Tells of motion and of examples."""',
    "examples/cart/cart.soter": "",
}


@pytest.mark.parametrize(
    ("changed", "tests"),
    [
        ("src/soter/model/motion.py", {"test_motion", "test_commands"}),
        ("src/soter/model/picture.py", {"test_picture"}),
        ("src/soter/cli/fly.py", {"test_commands"}),
        ("tests/helper.py", {"test_picture"}),
        ("tests/unit/test_prose.py", {"test_prose"}),
        ("examples/cart/cart.soter", {"test_robots"}),
    ],
)
def test_whoever_uses_a_changed_file_is_taken_and_nobody_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changed: str, tests: set[str]
) -> None:
    for name, text in TREE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    monkeypatch.setattr(changed_tests, "ROOT", tmp_path)
    monkeypatch.setattr(changed_tests, "SRC", tmp_path / "src")
    found = changed_tests.tests_of([tmp_path / changed])
    assert {path.stem for path in found} == tests
