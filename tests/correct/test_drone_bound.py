"""What is derived of the drone's residual holds of its flights, and breaks with its constants.

Purpose: `bench/drone/bound.py` on the program as it is, on hostile flights and on changed vehicles.
Non-goals: the rest that is not derived (`bench/drone/rhythms.py` searches it).
"""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.drone import bound
from bench.drone.bound import DRONE, FLIGHTS, PLACES, STATES, Loop, derived, flown, told

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any

    import numpy.typing as npt
    from flint import arb

    Floats = npt.NDArray[np.float64]

SHARP = ("a_ref", "a_ref'", "a_ref''", "z, of the attitude loop", "f, of the lift")
"""Quantities that a hostile flight brings within a fifth of what is derived of them."""


@pytest.mark.parametrize("place", PLACES)
def test_the_linear_part_leaves_something_of_the_residual(place: str) -> None:
    b = derived(place)
    assert (b.counted > 0.05).all(), "a bound on nothing"
    assert (b.left > 0.0).all(), b.left
    turn = abs(b.frames).sum(axis=2).max()
    assert float(b.constants["D"]) >= turn * float(b.constants["iris.WIND"]) + b.residual


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


def simulated(k: dict[str, Any], steps: int, parts: int) -> Floats:
    """z and f of an axis after a pulse of 5 ms, (steps, parts, 2): its equations, by Runge-Kutta.

    Written from iris.soter and not from bound.py: two rotors behind LAG_UP and LAG_DOWN, told what
    brings each to the same thrust within REACH.
    """
    band, fast, rate, tilt, up, down, reach = (
        float(k[f"iris.{n}"])
        for n in ("BAND", "FAST", "RATE_GAIN", "TILT_GAIN", "LAG_UP", "LAG_DOWN", "REACH")
    )
    h = float(k["iris.STEP"]) / parts
    lags = np.array([up, down])
    # what adds to a', a'', s'; the angle and its rate follow the mean of two moments, then lifts
    y, seen = np.zeros(9), np.zeros((steps, parts, 2))
    for n in range(steps):
        a, j, s, angle, turn = y[:5]
        y[5:7], y[7:9] = y[5:7].mean(), y[7:9].mean()
        wanted = band**2 * (s - a) - 2 * band * j + rate * (j - turn) + rate * tilt * (a - angle)
        told = [
            v + (goal - v) / (1 - np.exp(-reach / lags)) for v, goal in ((y[5], wanted), (y[7], a))
        ]
        u = float(n == 0)

        def slope(y: Floats, told: Any = told, u: float = u) -> Floats:
            return np.concatenate(
                [
                    [y[1], band**2 * (y[2] - y[0]) - 2 * band * y[1], fast * (u - y[2])],
                    [y[4], y[5:7].mean()],
                    (told[0] - y[5:7]) / lags,
                    (told[1] - y[7:9]) / lags,
                ]
            )

        for part in range(parts):
            seen[n, part] = y[3] - y[0], y[7:9].mean() - y[0]
            one = slope(y)
            two = slope(y + h / 2 * one)
            three = slope(y + h / 2 * two)
            y = y + h / 6 * (one + 2 * two + 2 * three + slope(y + h * three))
    return seen


def test_another_simulation_comes_to_what_is_derived_and_not_beyond() -> None:
    b = derived("corridors")
    most = np.abs(simulated(b.constants, 300, 8)).sum(axis=0).max(axis=0)
    limits = b.reach.tilt.max(), b.reach.lift.max()
    assert (most <= limits).all()
    assert (most > 0.98 * np.array(limits)).all(), (most, limits)


def test_the_page_has_what_is_derived_rounded_up() -> None:
    bounds = [derived(place) for place in PLACES]
    lines = told(bounds).splitlines()
    assert "\n".join(lines) in (DRONE.parents[1] / "docs" / "drone.md").read_text(encoding="utf-8")
    figures = [[float(x) for x in line.split()[2:]] for line in lines[2:]]
    exact = [(b.counted[i], b.left[i]) for b in bounds for i in range(3)]
    for (most, residual, left), (counted, rest) in zip(figures, exact, strict=True):
        assert counted <= most < counted + 1.1e-4
        assert rest - 1.1e-4 < left <= rest
        assert most + left <= residual + 1e-12


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


def test_a_wider_gate_widens_what_is_derived(tmp_path: Path) -> None:
    folder = tmp_path / "drone"
    shutil.copytree(DRONE, folder, ignore=shutil.ignore_patterns("__pycache__", ".soter"))
    file = folder / PLACES["corridors"]
    text, before = file.read_text(encoding="utf-8"), "y in [-U, U], z in [-U_UP, U_UP] };"
    assert before in text
    after = before.replace("y in [-U, U]", "y in [-2.0 * U, U]")
    file.write_text(text.replace(before, after), encoding="utf-8")
    wide, narrow = derived("corridors", folder), derived("corridors")
    assert wide.bound == pytest.approx(narrow.bound * (1.0, 2.0, 1.0))
    assert wide.counted[1] > 1.2 * narrow.counted[1]


class Fading(Loop):
    """Every state is a tenth of what it was, and the set-point."""

    def after(self, x: Sequence[arb], u: arb, t: arb) -> list[arb]:  # noqa: ARG002 - a loop's
        return [v / 10 + u for v in x]


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_what_is_cut_off_a_response_is_no_more_than_what_is_said_to_lie_beyond(
    steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bound, "STEPS", steps)
    loop = Fading({"iris.STEP": 0.005})
    assert loop.pulses.nrows() == STATES + 1
    cut = sum(0.1**k for k in range(steps - 1, 40))  # a pulse is in the states one step later
    assert float(loop.beyond) >= cut * (1.0 - 1e-12)
