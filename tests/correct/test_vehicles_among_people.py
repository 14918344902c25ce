"""Other vehicles among moving things: nobody is touched by one that moves.

Purpose: `wheels.soter`, `announced.soter` and `hover.soter` of `examples/exploration/` are proved,
and somebody else agrees; those who mean to be hit are not, by a vehicle that moves; one that does
not switch hits them; and what is simulated does as the plant of the proof may.
Non-goals: wrong modules (`unit/verify/claims/test_passive_vehicles.py`); `people.soter`.
"""

from __future__ import annotations

import re
from itertools import pairwise
from math import sqrt
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "exploration"
KINDS = ("Hunting", "Luring", "Strolling")
SEEDS = range(1, 4)
VEHICLES = ("wheels.soter", "announced.soter", "hover.soter")
NOT_ASKED = {"P2b"}
"""`recover never`."""


def verdicts_of(file: str, cert: Path | None = None) -> dict[str, str]:
    """What was said of each claim of `Passive` in a file; re-checked where there is a `cert`."""
    report = soter.load(FOLDER / file).verify(refute=False, cert=cert)
    if cert is not None:
        again = soter.recheck(cert)
        assert again.accepted, again.reason
    return {name: f.verdict for name, f in report["Passive"].findings.items()}


@pytest.mark.parametrize("file", ["wheels.soter", "announced.soter"])
def test_wheels_are_proved_with_their_fail_safe_law(file: str) -> None:
    verdicts = verdicts_of(file)
    assert {name for name, v in verdicts.items() if v != "proved"} == NOT_ASKED


@pytest.mark.long
@pytest.mark.parametrize("file", ["wheels.soter", "announced.soter"])
def test_somebody_else_agrees_of_wheels(file: str, tmp_path: Path) -> None:
    verdicts = verdicts_of(file, tmp_path / "cert")
    assert {name for name, v in verdicts.items() if v != "proved"} == NOT_ASKED


@pytest.mark.long
def test_the_drone_is_proved_and_somebody_else_agrees(tmp_path: Path) -> None:
    verdicts = verdicts_of("hover.soter", tmp_path / "cert")
    assert {name for name, v in verdicts.items() if v != "proved"} == NOT_ASKED | {"failsafe"}


@pytest.mark.parametrize("file", VEHICLES)
@pytest.mark.parametrize("kind", KINDS)
def test_nobody_is_hit_by_a_vehicle_that_moves(kind: str, file: str) -> None:
    program = soter.load(FOLDER / file)
    for seed in SEEDS:
        run = program.simulate(system="Hunted", seed=seed, params={"walkers.KIND": kind})
        assert run.violations == 0, run.violation_list
        assert run.modules["Passive"].switches_to_sc > 2


@pytest.mark.parametrize("file", VEHICLES)
@pytest.mark.parametrize("kind", ["Hunting", "Luring"])
def test_people_are_hit_where_nobody_switches(kind: str, file: str) -> None:
    program = soter.load(FOLDER / file)
    runs = [
        program.simulate(system="Bare", seed=seed, params={"walkers.KIND": kind}) for seed in SEEDS
    ]
    assert sum(run.violations for run in runs) > 0


SHARES = st.floats(0.8, 1.2)


@given(SHARES, SHARES, st.floats(-3.0, 3.0))
def test_a_base_of_any_lag_and_strength_is_one_of_the_proof(
    gain: float, most: float, off: float
) -> None:
    """`grip` of `wheels.soter`: the rate is between 0.8 and 1.2 times that of the nominal base."""
    nominal = min(max(6.0 * off, -2.0), 2.0)
    rate = min(max(gain * 6.0 * off, -most * 2.0), most * 2.0)
    low, high = sorted((0.8 * nominal, 1.2 * nominal))
    assert low - 1e-12 <= rate <= high + 1e-12


def cascade(
    w: float, rest: float, band: float, fast: float, wind: float
) -> list[tuple[float, float, float]]:
    """Bounds every ms from when |w| fell from `w` to `rest`: s, of |p - q3| in the plane, of |v|.

    Each stage of `motion_primitive.soter` is a lag of non-negative terms: bounds go in for values.
    """
    w2, w1, v = w + wind / fast, w + wind / fast + wind / band, w + wind / fast + 2.0 * wind / band
    to_q2 = (w + wind / fast) / fast
    to_q1 = (fast * to_q2 + wind / band) / band
    to_p = (band * to_q1 + wind / band) / band
    rows, step = [], 1e-4
    for k in range(20000):
        if k % 10 == 0:
            rows.append((k * step, sqrt(2.0) * (to_q2 + to_q1 + to_p), v))
        w2 += step * (fast * (rest - w2) + wind)
        w1 += step * (band * (w2 - w1) + wind)
        v += step * (band * (w1 - v) + wind)
        to_q2 += step * (rest + wind / fast - fast * to_q2)
        to_q1 += step * (fast * to_q2 + wind / band - band * to_q1)
        to_p += step * (band * to_q1 + wind / band - band * to_p)
    return rows


def test_who_is_at_the_hull_finds_the_drone_as_slow_as_touch_says() -> None:
    """LAG and TOUCH of `hover.soter` follow from REST, the filter and the wind."""
    text = (FOLDER / "hover.soter").read_text("utf-8")
    figure = {n: float(x) for n, x in re.findall(r"const (\w+): float = ([0-9.]+);", text)}
    rest, wind, lag_s = figure["REST"], 0.47, 2.0 / 9.0 + 1.0 / 12.0
    most = figure["FAST"] + 0.1 + (figure["U"] + wind) * figure["LOOK"]
    rows = cascade(most, rest, 9.0, 12.0, wind)
    nearer = 1.0 + sqrt(2.0) * (rest + lag_s * wind)  # m/s: how fast somebody comes to q3 at rest
    at_hull = [nearer * s >= figure["LAG"] - off for s, off, _ in rows]
    assert not at_hull[0]
    assert all(later >= now for now, later in pairwise(at_hull))
    assert (
        max(v for (_, _, v), touched in zip(rows, at_hull, strict=True) if touched)
        < (figure["TOUCH"])
    )
