"""A cart whose module leaves `ttf` and `safer` to the compiler."""

import re
from pathlib import Path

import pytest

CART = Path(__file__).parents[3] / "examples" / "wall" / "cart.soter"


def without_predicates(text: str) -> str:
    """The cart with an AC that only ever pushes at the wall, and no predicates; a coarser grid."""
    text = re.sub(r"\n  (ttf|safer) [^\n]*", "", text)
    text = re.sub(
        r"publish accel = clamp\(4[^\n]*", "publish accel = goal > -100.0 ? A : -A;", text
    )
    return re.sub(
        r"grid [^\n]*", "grid motion.x in [-WALL, WALL] / 200, motion.v in [-8.0, 8.0] / 160;", text
    )


@pytest.fixture
def open_cart(tmp_path: Path) -> Path:
    path = tmp_path / "open.soter"
    path.write_text(without_predicates(CART.read_text(encoding="utf-8")), encoding="utf-8")
    return path
