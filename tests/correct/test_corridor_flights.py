"""The drone in corridors of boxes: proved a wall at a time, flown, and broken where it must be."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from soter.api import load
from soter.program.build import check_file

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
WALLS = ("east", "west", "north", "south", "above", "below")
PROGRAM = check_file(str(DRONE / "corridor.soter")).program
assert PROGRAM is not None
E_Q, E_V, D = (float(PROGRAM.consts[n].value) for n in ("E_Q", "E_V", "D"))
LEVEL, UPRIGHT = (
    tuple(float(PROGRAM.consts[n + more].value) for n in ("U", "B", "TAIL", "W"))
    for more in ("", "_UP")
)


def test_the_motion_primitive_is_proved_for_every_corridor() -> None:
    report = load(DRONE / "corridor.soter").verify(refute=False)
    assert [m.name.rpartition(" ")[2] for m in report.modules] == list(WALLS)
    assert [m.verdict for m in report.modules] == ["proved"] * 6
    assert all(
        any("jumps into" in a or "jumps while" in a for a in m.problem.assumptions)
        for m in report.modules
    ), "that boxes change is an assumption"


def room(wall: np.ndarray, tau: float, u: float, b: float, tail: float, fastest: float) -> bool:
    """`Fits` of corridor.soter, written once more."""
    faster = float(wall["toward"]) + E_V
    later = max(faster + (u + D) * tau, 0.0)
    need = max((faster + 0.5 * (u + D) * tau) * tau, 0.0) + later**2 / (2 * b) + tail
    slow = float(wall["toward"]) - E_V - (u + D) * tau
    return bool(float(wall["ahead"]) - E_Q >= need and later <= fastest and slow >= -fastest)


@pytest.mark.parametrize(
    ("file", "system"),
    [("corridor.soter", "Protected"), ("corridor_adversaries.soter", "Failing")],
)
def test_a_box_is_entered_inside_of_its_s0_only(file: str, system: str) -> None:
    run = load(DRONE / file).simulate(system, until=90.0, seed=3)
    assert run.violations == 0
    assert run.trace is not None
    named = run.trace["topics"]
    topics = {n.rsplit(".", 1)[-1]: named[n] for n in named.dtype.names or ()}
    box = np.array(topics["flown"]["block"]["high"].tolist())
    changes = np.flatnonzero((np.diff(box, axis=0) != 0.0).any(axis=1)) + 1
    assert len(changes) >= 5
    for i in changes:
        for name in WALLS:
            limits = UPRIGHT if name in ("above", "below") else LEVEL
            assert room(topics[name][i], 0.03, *limits), (i, name)


def test_a_box_that_is_entered_anywhere_is_left(tmp_path: Path) -> None:
    """What is assumed of `Follower` is needed."""
    folder = tmp_path / "drone"
    shutil.copytree(DRONE, folder, ignore=shutil.ignore_patterns("__pycache__", ".soter"))
    path = folder / "corridor.soter"
    text = path.read_text(encoding="utf-8")
    guard = "if MayEnter(blocks[at + 1], m) {"
    assert guard in text
    path.write_text(
        text.replace(guard, "if boxes.Contains(blocks[at + 1], m.p) {"), encoding="utf-8"
    )
    found = [
        load(folder / "corridor_adversaries.soter").simulate(name, until=300.0, seed=1, trace=False)
        for name in ("Ramming", "Pushing", "Jerking", "Failing")
    ]
    assert sum(run.violations for run in found) > 0
