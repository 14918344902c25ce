"""The figures that the drone's design rests on (docs/drone.md), measured on the program itself.

Non-goals: the laps (`bench/drone/laps.py`), proofs (`soter verify`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"


@pytest.fixture(scope="module")
def constants() -> dict[str, Any]:
    checked = check_file(str(DRONE / "motion_primitive.soter"))
    assert checked.ok, checked.diagnostics.items
    assert checked.program is not None
    return {name: c.value for name, c in checked.program.consts.items()}


def run_of(file: str, system: str, seed: int, seconds: int, **params: int) -> Any:
    program = NativeProgram(system_of(check_file(str(DRONE / file)), system, params))
    return program.run(seconds * 10**9, seed, keep_trace=True)


def test_the_page_says_the_times_that_are_declared() -> None:
    text = (DRONE / "motion_primitive.soter").read_text(encoding="utf-8")
    page = (DRONE.parents[1] / "docs" / "drone.md").read_text(encoding="utf-8")
    for word, named in (("late", "a lateness of"), ("response", "responses? of")):
        (line,) = re.findall(rf"^ *{word} (dm .*);", text, re.MULTILINE)
        declared = {x.split()[1] for x in line.split(", ")}
        told = re.findall(rf"{named}\s(\d+) µs", page)
        assert len(told) > 1
        assert declared == {f"{n}us" for n in told}, (word, line, told)


# ---------------------------------------------------------------- geometry


def gap_between(centre: Floats, axes: Floats, half: Floats, low: Floats, high: Floats) -> float:
    """Greatest separation over the 15 axes of an oriented and an upright box; > 0: disjoint."""
    middle, spread = (low + high) / 2, (high - low) / 2
    edges = [np.cross(a, b) for a in np.eye(3) for b in axes]
    best = -np.inf
    for normal in [*np.eye(3), *axes, *edges]:
        length = np.linalg.norm(normal)
        if length < 1e-9:
            continue
        n = normal / length
        reach = half @ np.abs(axes @ n) + spread @ np.abs(n)
        best = max(best, float(abs(n @ (centre - middle)) - reach))
    return best


def tubes_as_boxes(constants: dict[str, Any]) -> list[tuple[Floats, Floats, Floats]]:
    boxes = []
    for start, along, side, up, length, radius, height, back, front in constants["city.TUBES"]:
        axes = np.array([along, side, up])
        half = np.array([(length + back + front) / 2, radius, height])
        centre = np.array(start) + axes[0] * (length + front - back) / 2
        boxes.append((centre, axes, half))
    return boxes


def test_the_tubes_keep_the_vehicle_clear_of_every_building(constants: dict[str, Any]) -> None:
    _, boxes = constants["city.CITY"]
    for centre, axes, half in tubes_as_boxes(constants):
        for low, high in boxes:
            gap = gap_between(centre, axes, half, np.array(low), np.array(high))
            assert gap >= constants["city.RADIUS"] + 0.005


def test_the_tubes_keep_the_vehicle_between_ground_and_ceiling(constants: dict[str, Any]) -> None:
    size, _ = constants["city.CITY"]
    top = np.array([size[0], size[1], constants["city.CEILING"]])
    for centre, axes, half in tubes_as_boxes(constants):
        reach = half @ np.abs(axes) + constants["city.RADIUS"]
        assert (centre - reach >= 0).all()
        assert (centre + reach <= top).all()


def test_turning_into_a_tube_widens_bounds_by_no_more_than_TURN(  # noqa: N802 - its name
    constants: dict[str, Any],
) -> None:
    for _, axes, _ in tubes_as_boxes(constants):
        assert np.abs(axes).sum(axis=1).max() <= constants["city.TURN"]


# ---------------------------------------------------------------- residual


def residual(run: Any) -> Floats:
    """|acceleration flown without wind - a_ref| on each axis of the tube, (N, 3), m/s^2."""
    d, topics = run.trace["d"], run.trace["topics"]
    q = d["q"]
    spin = sum(d["spin"][n] ** 2 for n in d["spin"].dtype.names)
    lift = 5.84e-6 * spin / 1.5
    flown = np.stack(
        [
            2 * (q["x"] * q["z"] + q["w"] * q["y"]) * lift,
            2 * (q["y"] * q["z"] - q["w"] * q["x"]) * lift,
            (1 - 2 * (q["x"] ** 2 + q["y"] ** 2)) * lift - 9.81,
        ],
        axis=1,
    )
    a = next(topics[n] for n in topics.dtype.names if n.endswith("reference"))["a"]
    reference = np.stack([a["x"], a["y"], a["z"]], axis=1)
    tubes = np.array([[t[1], t[2], t[3]] for t in _tubes(run)])
    leg = next(topics[n] for n in topics.dtype.names if n.endswith("tubeState"))["leg"]
    # what stands in the topic after t is the reference for the next instant
    gap = flown[1:] - reference[:-1]
    residuals: Floats = np.abs(np.einsum("nij,nj->ni", tubes[leg[1:].astype(int)], gap))
    return residuals


def _tubes(run: Any) -> Any:
    return next(c.value for n, c in run.system.program.consts.items() if n.endswith("TUBES"))


@pytest.mark.long
def test_the_residual_stays_below_what_the_sets_assume(constants: dict[str, Any]) -> None:
    worst = np.zeros(3)
    for shake_ms in (50, 120, 200, 300):
        for seed in range(3):
            run = run_of("adversaries.soter", "Shaken", seed, 60, SHAKE=shake_ms * 10**6)
            worst = np.maximum(worst, residual(run).max(axis=0))
    for system in ("Twitching", "Jerking", "Pushing", "Ramming", "Reversing", "Rhythmic"):
        worst = np.maximum(worst, residual(run_of("adversaries.soter", system, 0, 60)).max(axis=0))
    assert worst.max() <= constants["RESIDUAL"], worst
    assert worst.max() >= 0.05, "a residual of nothing was measured wrongly"


# ---------------------------------------------------------------- S_0, axis by axis


def clip(x: Floats, bound: float) -> Floats:
    return np.minimum(np.maximum(x, -bound), bound)


@dataclass(frozen=True)
class Axis:
    """One axis: what acts, what the sets count on, and SC's target seen from the wall at `high`."""

    u: float
    brake: float
    tail: float
    creep: float
    target: float
    low: float
    high: float
    speeds: Floats


def least_margin(k: dict[str, Any], axis: Axis) -> float:
    """How far from the wall q3 of an axis stays that starts on the boundary of S_0, at worst.

    It starts at remaining speed `speeds`, after a long spell of -u, 0 or u; any control for H is
    u, then SC with a read 10 ms old. Wind and residual push, errors of the estimate stand at their
    bound. The program's formulas, written anew in the filter's states.
    """
    band, fast = k["iris.BAND"], k["iris.FAST"]
    t_lag, p_of_a = 2 / band + 1 / fast, 1 / band**2 + 2 / (band * fast)
    d, h, w = k["D"], 0.002, axis.speeds
    worst = np.inf
    for held in (-axis.u, 0.0, axis.u):
        for sign in (1.0, -1.0):
            v = w - held * (2 / band + 1 / fast)
            seen = w + k["E_V"]
            later = np.maximum(seen + (axis.u + d) * k["H"], 0.0)
            moved = np.maximum((seen + 0.5 * (axis.u + d) * k["H"]) * k["H"], 0.0)
            need = moved + later**2 / (2 * axis.brake) + axis.tail
            q3 = axis.high - (k["E_P"] + t_lag * k["E_V"]) - need
            p = q3 - t_lag * v - p_of_a * held
            # p, q1 and q2 may be anywhere inside as well: at worst as far out as q3 lets them
            for lead, second in ((0.0, 0.0), (1 / band, 0.0), (2 / band, held / band**2)):
                p = p - np.maximum(p + lead * v + second - axis.high + k["LAG"], 0.0)
            inside = p >= axis.low
            p, v = p + k["E_P"], v + k["E_V"]
            a, j, s = np.full_like(p, held), np.zeros_like(p), np.full_like(p, held)
            for lead, second in ((0.0, 0.0), (1 / band, 0.0), (2 / band, held / band**2)):
                p = p - np.maximum(p + lead * v + second - axis.high + k["LAG"], 0.0)
            u, peak = np.full_like(p, axis.u), np.full_like(p, -np.inf)
            past = [(p, v, a, j, s)] * 6
            for step in range(1250):
                if step % 5 == 0 and step * h >= k["H"] - 1e-9:
                    op, ov, oa, oj, os = past[-6]
                    op, ov = op - sign * k["E_P"], ov - sign * k["E_V"]
                    q = op + t_lag * ov + p_of_a * oa + oj / (band**2 * fast)
                    speed = ov + 2 / band * oa + oj / band**2 + os / fast
                    wanted = clip(k["CREEP_GAIN"] * (axis.target - q), axis.creep)
                    u = clip(k["SPEED_GAIN"] * (wanted - speed), axis.u)
                p = p + h * v
                v = v + h * (a + d)
                a, j, s = (
                    a + h * j,
                    j + h * (band**2 * (s - a) - 2 * band * j),
                    s + h * fast * (u - s),
                )
                past = [*past[1:], (p, v, a, j, s)]
                ahead = p + t_lag * v + p_of_a * a + j / (band**2 * fast)
                peak = np.maximum(peak, ahead)
            worst = min(worst, float((axis.high - peak)[inside].min()))
    return worst


def test_SC_stops_before_every_wall_from_the_boundary_of_S0(  # noqa: N802 - their names
    constants: dict[str, Any],
) -> None:
    k = constants
    for _, _, _, _, length, radius, height, back, front in k["city.TUBES"]:
        along = (k["U_ALONG"], k["B_ALONG"], k["TAIL_ALONG"], k["CREEP"])
        side = (k["U_SIDE"], k["B_SIDE"], k["TAIL_SIDE"], k["CREEP_SIDE"])
        up = (k["U_UP"], k["B_UP"], k["TAIL_UP"], k["CREEP_UP"])
        aim = length - k["BEFORE"]
        cases = (
            Axis(*along, aim, -back, length + front, np.linspace(-1, 5.3, 64)),
            Axis(*along, -aim, -length - front, back, np.linspace(-1, 3, 41)),
            Axis(*side, 0.0, -radius, radius, np.linspace(-1, 2.5, 36)),
            Axis(*up, 0.0, -height, height, np.linspace(-1, 1.8, 29)),
        )
        for axis in cases:
            assert least_margin(k, axis) > k["LAG"]


# ---------------------------------------------------------------- laps


def test_the_aggressive_AC_keeps_control_for_most_of_its_laps() -> None:  # noqa: N802 - their names
    times: dict[str, list[float]] = {"Protected": [], "AdvancedOnly": []}
    shares = []
    for system, lap_times in times.items():
        program = NativeProgram(
            system_of(check_file(str(DRONE / "motion_primitive.soter")), system)
        )
        for seed in range(500, 540):
            run = program.run(15 * 10**9, seed)
            lap = run.final["topics"]["lap"]
            if system == "Protected":
                assert run.violations == 0
                shares.append(float(lap["ac_s"]) / float(lap["lap_s"]))
            if lap["finished"] and not run.violations:
                lap_times.append(float(lap["lap_s"]))
    assert np.mean(shares) >= 0.96
    assert np.mean(times["Protected"]) <= 1.05 * np.mean(times["AdvancedOnly"])
