"""What is derived of the drone's residual holds of its flights, and breaks with its constants.

Purpose: `bench/drone/bound.py` on the program as it is, on hostile flights and on changed vehicles.
Non-goals: the rest that is not derived (`bench/drone/rhythms.py` searches it).
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest
from bench.drone.bound import DRONE, FLIGHTS, PLACES, derived, flown

if TYPE_CHECKING:
    from pathlib import Path

SHARP = ("a_ref", "a_ref'", "a_ref''", "z, of the attitude loop", "f, of the lift")
"""Quantities that a hostile flight brings within a fifth of what is derived of them."""


@pytest.mark.parametrize("place", PLACES)
def test_the_linear_part_leaves_something_of_the_residual(place: str) -> None:
    b = derived(place)
    assert (b.counted > 0.05).all(), "a bound on nothing"
    assert (b.left > 0.0).all(), b.left
    assert float(b.constants["D"]) >= float(b.constants["iris.WIND"]) + b.residual


@pytest.mark.parametrize("place", PLACES)
def test_no_hostile_flight_is_beyond_what_is_derived_and_some_come_close(place: str) -> None:
    file, systems = FLIGHTS[place]
    assert "Rhythmic" in systems
    extremes = flown(derived(place), range(3), 60, DRONE / file, "Rhythmic")
    assert len(extremes) == 24
    assert not {n: x for n, x in extremes.items() if x[0] > x[1]}
    axes = "xyz" if place == "corridors" else "xz"  # this AC never leaves the leg along x
    close = {f"{n} {axis}" for n in SHARP for axis in axes}
    assert not {n: extremes[n] for n in close if extremes[n][0] < 0.8 * extremes[n][1]}


CHANGED = {
    "reach": ("const REACH: float = 0.006;", "const REACH: float = 0.012;"),
    "tilt": ("const TILT_GAIN: float = 8.0;", "const TILT_GAIN: float = 3.0;"),
    "band": ("const BAND: float = 9.0;", "const BAND: float = 18.0;"),
    "speed": ("const SPEED_MAX: float = 1100.0;", "const SPEED_MAX: float = 950.0;"),
}
FLOWN = ("band", "speed")
"""Where the linear part still leaves something, and a flight is beyond it."""
LONG = ("tilt", "speed")


@pytest.mark.parametrize(
    "change",
    [pytest.param(c, marks=pytest.mark.long if c in LONG else ()) for c in CHANGED],
)
def test_a_vehicle_that_follows_worse_is_told(change: str, tmp_path: Path) -> None:
    folder = tmp_path / "drone"
    shutil.copytree(DRONE, folder, ignore=shutil.ignore_patterns("__pycache__", ".soter"))
    iris = folder / "iris.soter"
    text, (before, after) = iris.read_text(encoding="utf-8"), CHANGED[change]
    assert before in text
    iris.write_text(text.replace(before, after), encoding="utf-8")
    b = derived("corridors", folder)
    if change in FLOWN:
        extremes = flown(b, range(1), 30, folder / FLIGHTS["corridors"][0], "Rhythmic")
        assert {n for n, (most, limit) in extremes.items() if most > limit} & {
            "rest x",
            "rest y",
            "rest z",
        }
    else:
        assert b.left.min() < 0.0, b.left
