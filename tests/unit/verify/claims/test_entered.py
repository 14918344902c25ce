"""That the state lies in R(H) wherever `enters` holds: shown, or not, of cells and beyond them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.corridor_program import SAFER
from generators.handover_program import GUARDS, IN, of_walls
from soter.api.program import load
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

pytest.importorskip("z3")

SHOWN = "the state of seen lies in R(H)"


def verified(tmp_path: Path, inside: str, safer: str = SAFER) -> tuple[ModuleResult, ...]:
    """The views of the two boxes, entered where `inside` says so."""
    text = of_walls(inside)
    assert SAFER in text
    text = text.replace(SAFER, safer)
    path = tmp_path / "boxes.soter"
    path.write_text(text)
    return load(path).verify(refute=False).modules


def is_shown(module: ModuleResult) -> bool:
    """Said of the verdict, and in exactly one of the two places."""
    assumed = any(SHOWN in a for a in assumption_texts(module.assumptions))
    noted = any(n.startswith("wherever") and SHOWN in n for n in module.notes)
    open_ = {c for c, f in module.findings.items() if not f.holds} - {"P2b"}
    assert open_ == ({"P2a", "P3"} if assumed else set())
    assert assumed == (not noted)
    return noted


@pytest.mark.long
def test_it_is_shown_and_assumed_no_more(tmp_path: Path) -> None:
    modules = verified(tmp_path, IN)
    assert [m.verdict for m in modules] == ["proved", "proved"]
    assert [is_shown(m) for m in modules] == [True, True]


@pytest.mark.long
def test_it_does_not_hang_on_control_coming_back(tmp_path: Path) -> None:
    """R(H) is what it is where SC keeps to no set inside `safer`."""
    far = "safer Fits(left, 0.08) && left.room > 3.0 && Fits(right, 0.08) && right.room > 3.0;"
    modules = verified(tmp_path, IN, far)
    assert [m.findings["P2b"].verdict for m in modules] == ["undecided"] * 2
    assert [is_shown(m) for m in modules] == [True, True]


@pytest.mark.parametrize(("old", "new", "shown", "why"), GUARDS)
def test_a_guard_that_lets_too_much_in_is_not(
    tmp_path: Path, old: str, new: str, shown: list[bool], why: str
) -> None:
    assert old in IN
    modules = verified(tmp_path, IN.replace(old, new))
    assert [is_shown(m) for m in modules] == shown
    assert [why in m.findings["P3"].text for m in modules] == [not s for s in shown]


@pytest.mark.parametrize("tau", [0.0, 0.03, 0.05])
def test_what_is_let_in_lies_in_the_set_wherever_that_is_shown(tmp_path: Path, tau: float) -> None:
    """By a second reading of `Fits`, on states drawn at random."""
    module = verified(tmp_path, IN.replace("0.05", str(tau)))[0]
    (case,) = module.cases
    (group,) = case.groups
    rooms, speeds = (np.array(a.edges) for a in group.group.axes)
    chance = np.random.default_rng(int(1000 * tau))
    room, toward = chance.uniform(-1.0, 4.0, 200_000), chance.uniform(-3.0, 3.0, 200_000)
    later = np.maximum(toward + 3.0 * tau, 0.0)
    moved = np.maximum((toward + 1.5 * tau) * tau, 0.0) + later**2 / 4.0 + 0.15
    let_in = (room >= moved) & (np.abs(toward) + 3.0 * tau <= 2.2)
    at = np.searchsorted(rooms, room[let_in]) - 1, np.searchsorted(speeds, toward[let_in]) - 1
    assert min(a.min() for a in at) >= 0
    assert group.free is not None
    escapes = int((~group.free[at]).sum())
    if is_shown(module):
        assert escapes == 0
    assert is_shown(module) == (tau >= 0.04) or escapes == 0
