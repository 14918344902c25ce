"""What lies beside the Python of Soter comes along when it is installed."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
SOTER = ROOT / "src" / "soter"
ELSEWHERE = (".py", ".pyc", ".so")


def test_every_file_beside_the_python_is_data_of_the_package() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    patterns = re.search(r"\[tool\.setuptools\.package-data\]\nsoter = (\[.*\])", text)
    assert patterns is not None
    packed = {p for pattern in ast.literal_eval(patterns[1]) for p in SOTER.glob(pattern)}
    beside = {p for p in SOTER.rglob("*") if p.is_file() and p.suffix not in ELSEWHERE}
    assert any(p.suffix == ".j2" for p in beside)
    assert {p.relative_to(SOTER).as_posix() for p in beside - packed} == set()
