"""A cart whose module leaves `ttf` and `safer` to the compiler."""

import re
from pathlib import Path

import pytest

CART = Path(__file__).parents[4] / "examples" / "wall" / "cart.soter"


@pytest.fixture(scope="session")
def open_text() -> str:
    """The cart with an AC that only ever pushes at the wall, and no predicates; a coarser grid."""
    text = CART.read_text(encoding="utf-8")
    for old, new in (
        (r"\n  (ttf|safer) [^\n]*", ""),
        (r"publish accel = clamp\(4[^\n]*", "publish accel = goal > -100.0 ? A : -A;"),
        (r"grid [^\n]*", "grid motion.x in [-WALL, WALL] / 200, motion.v in [-8.0, 8.0] / 160;"),
    ):
        text, count = re.subn(old, new, text)
        assert count, old
    return text


@pytest.fixture
def open_cart(tmp_path: Path, open_text: str) -> Path:
    path = tmp_path / "open.soter"
    path.write_text(open_text, encoding="utf-8")
    return path
