"""Whole programs of kinds that are not carts: proved, and not one step beyond."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators.file_listing import files_below
from soter.api import load

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

ROOT = Path(__file__).resolve().parents[4]
PROGRAMS = files_below(ROOT / "examples" / "generality", "*.soter")
SLOW = {
    "drag",
    "pendulum",
    "gimbal",
}  # more than 3 s of processor time each
NEVER_BACK = {
    "standing"
}  # where it stands it is not given back, and nothing can be done about that


def verified(path: Path) -> ModuleResult:
    (module,) = load(path).verify(refute=False).modules
    return module


def not_proved(module: ModuleResult) -> set[str]:
    return {n for n, f in module.findings.items() if f.verdict not in ("proved", "assumed")}


@pytest.mark.parametrize(
    "path", [p for p in PROGRAMS if p.stem not in SLOW], ids=lambda p: str(p.stem)
)
def test_an_honest_module_is_proved(path: Path) -> None:
    expected = {"P2b"} if path.stem in NEVER_BACK else set()
    assert [not_proved(m) for m in load(path).verify(refute=False).modules if not_proved(m)] == (
        [expected] if expected else []
    )


WRONG = [
    # stands, but for a wind
    ("standing", "  der x = speed;", ("  disturbance w: float in [-0.000001, 0.000001];\n"
     "  der x = speed + w;")),
    ("standing", "  der x = speed;", ("  disturbance w: float in [0.0, 0.000001];\n"
     "  der x = speed + w;")),
    # nearly stands
    ("standing", "publish speed = 0.0;", "publish speed = 0.000001;"),
    # stands only for some time
    ("standing", "publish speed = 0.0;", ("n = min(n + 1, 100);\n"
     "    publish speed = n < 100 ? 0.0 : 0.01;")),
    # a grid that ends above the level that is kept
    ("two_tanks", "[0.0, RIM] / 100, levels.lower", "[0.0001, RIM] / 100, levels.lower"),
    # a leak that the levels do not know of
    ("two_tanks", "float in [0.0, 0.001];", "float in [-0.000001, 0.001];"),
    # a pump that also empties
    ("two_tanks", "topic pump: float in [0.0, PUMP]", "topic pump: float in [-0.000001, PUMP]"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "was", "becomes"), WRONG, ids=range(len(WRONG)))
def test_a_module_just_beyond_is_not(name: str, was: str, becomes: str, tmp_path: Path) -> None:
    text = (ROOT / "examples" / "generality" / f"{name}.soter").read_text(encoding="utf-8")
    assert text.count(was) == 1
    text = text.replace(was, becomes)
    if "n = min" in becomes:
        text = text.replace("publishes speed;\n  step {\n    n =", "publishes speed;\n"
                            "  var n: int in [0, 100] = 0;\n  step {\n    n =")  # fmt: skip
    path = tmp_path / f"{name}.soter"
    path.write_text(text, encoding="utf-8")
    assert not_proved(verified(path)) & {"P2a", "P3"}
