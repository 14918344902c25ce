"""Made-up but plausible records: three flights through the city, a cart before its wall.

Purpose: something for the report's tests, and its makers' eyes, to look at.
Non-goals: being right. No figure in here was measured; the real ones come from runs.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "examples" / "drone"))

from city_scene import Scene, Tube
from city_view import CityView

from soter.report.html import write_html
from soter.report.run.record import (
    Cell,
    Chart,
    Comparison,
    Controller,
    Decision,
    Flight,
    ModeBand,
    ReportPage,
    Series,
    Threshold,
    Vec3,
    Violation,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

# The authors' city (utopia.xml of the Drona project, MIT 2016): low and high corners in m.
CITY = np.asarray(
    [
        [[31.04, 27.49, 0], [40.59, 37.54, 5.05]],
        [[30.89, 5.23, 0], [40.94, 14.78, 5.05]],
        [[12.64, 5.18, 0], [21.94, 12.98, 5]],
        [[2.21, 13.86, 0], [10.01, 23.16, 5]],
        [[5.29, 32.49, 0], [13.59, 36.09, 7]],
        [[15.49, 26.67, 0], [25.04, 36.72, 5.05]],
        [[39.57, 21.69, 0], [41.57, 24.49, 2]],
        [[8.48, 6.17, 0], [10.88, 7.97, 2]],
        [[7.81, 9.3, 0], [10.21, 11.1, 2]],
        [[6, 17, 0], [45, 19, 3]],
        [[35, 10, 0], [36, 31, 3]],
        [[28, 18, 0], [29, 43, 3]],
        [[18, 9, 0], [19, 30, 3]],
        [[11, 19, 0], [12, 40, 3]],
        [[11, 39, 0], [28, 40, 3]],
    ],
    dtype=np.float64,
)
GOALS: tuple[tuple[str, Vec3], ...] = (
    ("g1", (24.0, 24.4, 4.0)),
    ("g2", (12.2, 21.0, 4.0)),
    ("g3", (14.4, 15.2, 4.0)),
    ("g4", (28.5, 13.4, 4.0)),
)
SAFE_M, LOOK_M, SAFER_M = 1.9, 1.25, 0.75
STEP_S, PERIOD_S = 0.01, 0.05
MODULE = "SafeMotionPrimitive"
Arm = Literal["ac", "rta", "sc"]


def scene() -> Scene:
    """Return the city with the tubes of one lap."""
    corners = [position for _, position in GOALS]
    tubes = tuple(
        Tube(start, end, SAFE_M, LOOK_M, SAFER_M)
        for start, end in zip(corners, [*corners[1:], corners[0]], strict=True)
    )
    return Scene(
        lo=(0, 0, 0),
        hi=(50, 50, 7),
        boxes=CITY,
        ceiling_m=6.0,
        goals=GOALS,
        tubes=tubes,
        note="The regions depend on the velocity too; they are drawn for a vehicle at rest.",
        credit="City: utopia.xml of the Drona project (MIT licence, 2016), the authors' workspace.",
    )


def clearance(point: NDArray[np.float64]) -> float:
    """Return the distance in m to the nearest box, less a radius; negative inside one."""
    gap = np.maximum(CITY[:, 0] - point, point - CITY[:, 1])
    outside = np.linalg.norm(np.maximum(gap, 0), axis=1)
    inside = np.minimum(gap.max(axis=1), 0)
    return float((outside + inside).min()) - 0.3


@dataclass
class _Track:
    """What a flight leaves behind."""

    time_s: list[float] = field(default_factory=list)
    position: list[NDArray[np.float64]] = field(default_factory=list)
    ac: list[bool] = field(default_factory=list)
    clearance_m: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    violations: list[Violation] = field(default_factory=list)


def _frame(
    point: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return how far beyond the tube's core a point is, the nearest point, and the direction."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    s = float((point - start) @ along)
    nearest = start + np.clip(s, 0, length) * along
    return float(np.abs(point - nearest).max()), nearest, along


def fly(arm: Arm, laps: int = 1, seed: int = 1) -> _Track:
    """Fly `laps` laps as AC alone, under the DM, or as SC alone."""
    rng = np.random.default_rng(seed)
    corners = [np.asarray(position, dtype=np.float64) for _, position in GOALS]
    corners = [*corners[1:], corners[0]] * laps
    start, leg = np.asarray(GOALS[0][1], dtype=np.float64), 0
    point, velocity, wind = start.copy(), np.zeros(3), np.zeros(3)
    track, ac, touching, k = _Track(), arm == "ac", False, 0
    while leg < len(corners) and k < 20_000:
        t, end = k * STEP_S, corners[leg]
        off, nearest, along = _frame(point, start, end)
        ahead, _, _ = _frame(point + 0.42 * velocity, start, end)
        if arm == "rta" and k % round(PERIOD_S / STEP_S) == 0:
            ttf, safer = ahead > LOOK_M, off < SAFER_M and ahead < SAFER_M
            if (ac and ttf) or (not ac and safer):
                ac = not ac
                track.decisions.append(_decision(t, ac, ttf, safer, LOOK_M - ahead, point))
        hold = _hold(point, velocity, nearest, along, end)
        command = _rush(point, velocity, end) if ac else hold
        wind = 0.99 * wind + 0.02 * rng.normal(size=3)
        velocity = velocity + STEP_S * (np.clip(command, -5.5, 5.5) + wind)
        point = point + STEP_S * velocity
        gap = clearance(point)
        if gap <= 0 and not touching:
            track.violations.append(
                Violation(t, "NoCollision(d.truth): the vehicle touches a building", _vec(point))
            )
        touching = gap <= 0
        track.time_s.append(t)
        track.position.append(point.copy())
        track.ac.append(ac)
        track.clearance_m.append(gap)
        track.speed.append(float(np.linalg.norm(velocity)))
        if np.linalg.norm(point - end) < (1.6 if ac else 0.5):
            start, leg = end, leg + 1
        k += 1
    return track


def _rush(
    point: NDArray[np.float64], velocity: NDArray[np.float64], goal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Fly at the goal as fast as it goes; brake too late."""
    error = goal - point
    distance = float(np.linalg.norm(error))
    wanted = error / max(distance, 1e-6) * min(6.4, 3.0 * distance)
    return 0.9 * (wanted - velocity)


def _hold(
    point: NDArray[np.float64],
    velocity: NDArray[np.float64],
    nearest: NDArray[np.float64],
    along: NDArray[np.float64],
    goal: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Hold the centre line, creep along it."""
    wanted = 2.2 * (nearest - point) + along * min(1.95, float((goal - point) @ along))
    return 4.0 * (wanted - velocity)


def _decision(
    t: float, ac: bool, ttf: bool, safer: bool, margin: float, point: NDArray[np.float64]
) -> Decision:
    """Record a change of mode."""
    to: Controller = "AC" if ac else "SC"
    reason = (
        "the vehicle is in φ_safer again"
        if ac
        else "ttf_2Δ: the advanced controller could leave φ_safe within 2Δ"
    )
    predicates = {"ttf": ttf, "safer": safer, "look-ahead margin / m": round(margin, 3)}
    return Decision(t, MODULE, to, reason, predicates, _vec(point))


def _vec(point: NDArray[np.float64]) -> Vec3:
    """Turn an array into a tuple."""
    x, y, z = point.tolist()
    return (x, y, z)


def flight(arm: Arm, name: str, title: str, laps: int = 2) -> Flight:
    """Fly and fill the record."""
    track = fly(arm, laps)
    modes = np.asarray(track.ac)
    return Flight(
        name=name,
        title=title,
        time_s=np.asarray(track.time_s),
        position=np.asarray(track.position),
        in_control=modes,
        module=MODULE,
        clearance_m=np.asarray(track.clearance_m),
        speed=np.asarray(track.speed),
        decisions=tuple(track.decisions),
        violations=tuple(track.violations),
        summary={
            "lap_s": track.time_s[-1] / laps,
            "violations": len(track.violations),
            "switches_to_sc": sum(d.to == "SC" for d in track.decisions),
            "switches_to_ac": sum(d.to == "AC" for d in track.decisions),
            "ac_share": float(modes.mean()),
            "min_clearance_m": float(min(track.clearance_m)),
        },
    )


def flights() -> tuple[Flight, ...]:
    """Return the three arms of the demo."""
    return (
        flight("ac", "AdvancedOnly", "AC alone"),
        flight("rta", "Protected", "RTA-protected"),
        flight("sc", "SafeOnly", "SC alone"),
    )


def city_page() -> ReportPage:
    """Return the page the demo would write."""
    arms = flights()
    paper_lap = ("10 s", "14 s", "24 s")
    rows = (
        (
            "time for a lap g1 → g4",
            tuple(
                Cell(f"{float(a.summary['lap_s']):.1f} s", paper)
                for a, paper in zip(arms, paper_lap, strict=True)
            ),
        ),
        (
            "violations",
            tuple(
                Cell(str(a.summary["violations"]), paper)
                for a, paper in zip(arms, ("collides", "none", "none"), strict=True)
            ),
        ),
        (
            "switches to SC / back to AC",
            tuple(
                Cell(f"{a.summary['switches_to_sc']} / {a.summary['switches_to_ac']}") for a in arms
            ),
        ),
        (
            "AC in control",
            tuple(
                Cell(f"{100 * float(a.summary['ac_share']):.0f} %", paper)
                for a, paper in zip(arms, ("", "> 96 %", ""), strict=True)
            ),
        ),
    )
    return ReportPage(
        title="Soter · a drone in the paper's city, three ways",
        subtitle=(
            "The same advanced controller flies the laps g1 → g2 → g3 → g4 between the buildings "
            "on its own, under a decision module, and not at all. Below: where control changed "
            "hands, why, and how close the walls came."
        ),
        comparison=Comparison(
            columns=tuple(a.title for a in arms),
            rows=rows,
            note=(
                "The paper flew its laps in Gazebo with PX4 in the loop; its share of AC comes "
                "from 104 hours of surveillance missions. Another route, another simulator: "
                "compare the ratios, not the seconds."
            ),
        ),
        scene=CityView(scene()),
        flights=arms,
        assumptions=(
            "Wind stays within ±0.3 m/s² on each axis; the run draws it from there.",
            "The estimator errs by no more than 0.05 m and 0.1 m/s; DM and SC run every period.",
            "φ_safer and the look-ahead are closed forms with margins, not yet proved.",
            "The axis model behind the margins misses the 13-state Iris by at most 0.29 m/s².",
        ),
        provenance={
            "program": "examples/drone/motion_primitive.soter",
            "sha256": "9f2c41d07be5a1c7f0a4e1d5c6b6a9d09c44e0d4b1f6a5b8e7c2d3f4a5968778",
            "seed": "1",
            "soter": "0.1.0 (Python 3.11.7, gcc 12.2.0)",
            "command": "soter run examples/drone/motion_primitive.soter --system Protected "
            "--until 30s --seed 1",
        },
    )


def cart(name: str, title: str, *, protected: bool) -> Chart:
    """Drive the cart at its wall, with or without a DM."""
    wall, limit = 10.0, 3.0
    count = 1500
    time_s = np.asarray(np.arange(count) * 0.01, dtype=np.float64)
    x, v, ac = 0.0, 0.0, True
    xs, vs, us, acs = np.empty(count), np.empty(count), np.empty(count), np.ones(count, bool)
    decisions: list[Decision] = []
    for k in range(count):
        braking = max(v, 0.0) ** 2 / (2 * (limit - 0.4))
        margin = wall - x - braking - 0.5 * max(v, 0)
        if protected and k % 5 == 0:
            if ac and margin < 0.2:
                ac = False
                decisions.append(
                    Decision(k * 0.01, "SafeCart", "SC", "ttf holds", {"margin / m": margin})
                )
            elif not ac and margin > 0.9:
                ac = True
                decisions.append(
                    Decision(k * 0.01, "SafeCart", "AC", "safer holds", {"margin / m": margin})
                )
        fast = 4.0 * (9.5 - x) - 1.0 * v
        careful = 2.0 * (wall - 1.0 - x) - 3.0 * v
        u = float(np.clip(fast if ac else careful, -limit, limit))
        xs[k], vs[k], us[k], acs[k] = x, v, u, ac
        x, v = x + 0.01 * v, v + 0.01 * u
    crossed = np.flatnonzero((xs[1:] >= wall) & (xs[:-1] < wall)) + 1
    violations = tuple(Violation(float(time_s[i]), "Clear(c.truth)") for i in crossed)
    return Chart(
        name=name,
        title=title,
        time_s=time_s,
        series=(
            Series("position", "m", xs, "position", (Threshold("wall", wall),)),
            Series("goal", "m", np.full(count, 9.5), "position"),
            Series("speed", "m/s", vs),
            Series("acceleration", "m/s²", us),
        ),
        modes=(ModeBand("SafeCart", acs),),
        decisions=tuple(decisions),
        violations=violations,
        summary={
            "violations": len(violations),
            "ac_share": float(acs.mean()),
            "switches_to_sc": sum(d.to == "SC" for d in decisions),
            "switches_to_ac": sum(d.to == "AC" for d in decisions),
        },
    )


def cart_page() -> ReportPage:
    """Return the page of a program without geometry."""
    return ReportPage(
        title="Soter · a cart that must not touch the wall",
        charts=(
            cart("Protected", "Protected", protected=True),
            cart("Unprotected", "Unprotected", protected=False),
        ),
        assumptions=("Every acceleration lies in [-3, 3] m/s².",),
        provenance={"program": "examples/wall/cart.soter", "seed": "1"},
    )


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    write_html(city_page(), folder / "city.html")
    write_html(cart_page(), folder / "cart.html")
