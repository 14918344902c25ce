"""Vehicles that stand whoever comes: no wrong one is proved.

Purpose: each edit of `generators/passive_vehicles.py` leaves `safe`, and the prover does
not say otherwise.
Non-goals: the right ones (`correct/test_vehicles_among_people.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
from generators.passive_vehicles import WRONG_VEHICLES

if TYPE_CHECKING:
    from pathlib import Path

    from generators.passive_vehicles import WrongVehicle

QUICK = ("people run, and ttf counts with people who walk", "the DM looks too seldom")
EVERY = [
    pytest.param(w, id=f"{w.file}: {w.name}", marks=() if w.name in QUICK else pytest.mark.long)
    for w in WRONG_VEHICLES
]


@pytest.mark.parametrize("wrong", EVERY)
def test_a_wrong_vehicle_is_not_proved(wrong: WrongVehicle, tmp_path: Path) -> None:
    report = soter.load(wrong.write(tmp_path)).verify(refute=False)
    verdicts = {name: f.verdict for name, f in report["Passive"].findings.items()}
    assert report.verdict != "proved"
    assert any(verdicts[claim] not in {"proved", "assumed"} for claim in wrong.fails), verdicts
