"""Fly laps of the drone program and read them: shared by the demo and the benchmarks.

Purpose: from a run's trace to a lap (time, violations, switches, clearance) and to the records of
the HTML report. Geometry comes out of the program itself, never from copies.
Non-goals: statistics over many laps (`bench/drone/laps.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from city_scene import Scene, Tube

from soter.report.run.record import Decision, Flight, Vec3, Violation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    import soter

PROGRAM = Path(__file__).with_name("motion_primitive.soter")
MODULE = "SafeMotionPrimitive"
ARMS = {"AdvancedOnly": "AC alone", "Protected": "RTA-protected", "SafeOnly": "SC alone"}
CREDIT = "City: Drona project (MIT, 2016)"


@dataclass(frozen=True)
class Lap:
    """One lap. `lap_s` is None when g4 was not reached in the time given."""

    seed: int
    lap_s: float | None
    collided: bool
    left_tube: bool
    ac_share: float
    switches_to_sc: int
    switches_to_ac: int


def read_lap(run: soter.Run) -> Lap:
    """The figures of a finished run; no trace needed. AC share is that of the lap itself."""
    noted = run.final["topics"]["lap"]
    finished = bool(noted["finished"])
    lap_s = float(noted["lap_s"])
    broken = {v.what for v in run.violation_list}
    module = run.modules[MODULE]
    return Lap(
        run.seed,
        lap_s if finished else None,
        any("NoCollision" in w for w in broken),
        any("InTube" in w for w in broken),
        float(noted["ac_s"]) / lap_s if lap_s > 0 else 0.0,
        module.switches_to_sc,
        module.switches_to_ac,
    )


def array(value: Any) -> NDArray[np.float64]:  # noqa: ANN401 - any nested record of floats
    """A record of floats (x, y, z) as an array of shape (..., 3)."""
    return np.stack([value["x"], value["y"], value["z"]], axis=-1)


class City:
    """Geometry of the program's city, in m."""

    def __init__(self, program: soter.Program) -> None:
        city = program.constant("city.CITY")
        self.size = np.array([city.size.x, city.size.y, city.size.z])
        self.boxes = np.array(
            [[[b.low.x, b.low.y, b.low.z], [b.high.x, b.high.y, b.high.z]] for b in city.boxes]
        )
        self.goals = np.array([[g.x, g.y, g.z] for g in program.constant("city.GOALS")])
        self.radius = float(program.constant("city.RADIUS"))
        self.ceiling = float(program.constant("city.CEILING"))
        self.tubes = program.constant("city.TUBES")

    def clearance(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance in m, shape (N,), from the vehicle's hull at p (N, 3) to whatever is nearest."""
        low, high = self.boxes[:, 0], self.boxes[:, 1]
        gap = np.maximum(np.maximum(low - p[:, None], p[:, None] - high), 0.0)
        boxes = np.sqrt((gap**2).sum(axis=2)).min(axis=1)
        top = np.array([self.size[0], self.size[1], self.ceiling])
        walls = np.minimum(p, top - p).min(axis=1)
        nearest: NDArray[np.float64] = np.minimum(boxes, walls) - self.radius
        return nearest


def hover_width(program: soter.Program, city: City, leg: int, tau: float, levels: float) -> float:
    """Largest offset to the side, in m, at which a hovering vehicle mid-tube passes `Fits`.

    Read off the program's own predicate by bisection: the boundary of S_0 or S_1 as drawn.
    """
    fits = program.function("Fits")
    tube = city.tubes[leg]
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}

    def inside(offset: float) -> bool:
        p = {"x": tube.length / 2, "y": offset, "z": 0.0}
        state = {"leg": leg, "p": p, "v": zero, "a": zero, "j": zero, "s": zero}
        return bool(fits(state, tau, levels))

    low, high = 0.0, float(tube.radius)
    if not inside(low):
        return 0.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if inside(middle) else (low, middle)
    return low


def _drawn_ends(tube: Any) -> tuple[Vec3, Vec3]:  # noqa: ANN401 - a record of the program
    """Ends to draw: the report extends a tube by its half width, φ_safe by `back` and `front`."""
    start = np.array([tube.start.x, tube.start.y, tube.start.z])
    along = np.array([tube.along.x, tube.along.y, tube.along.z])
    first = start + (tube.radius - tube.back) * along
    last = start + (tube.length + tube.front - tube.radius) * along
    return tuple(first), tuple(last)


def scene(program: soter.Program) -> Scene:
    """The city with its tubes for the report."""
    city = City(program)
    look = float(program.constant("H")), 1.0
    safer = float(program.constant("H_SAFER")), 3.0
    tubes = tuple(
        Tube(
            *_drawn_ends(tube),
            float(tube.radius),
            hover_width(program, city, i, *look),
            hover_width(program, city, i, *safer),
        )
        for i, tube in enumerate(city.tubes)
    )
    names = tuple((f"g{i + 1}", tuple(g)) for i, g in enumerate(city.goals))
    note = (
        "Regions are drawn for a vehicle that hovers at that offset; in motion φ_safer and the "
        "look-ahead shrink towards the side it moves to."
    )
    return Scene(
        (0.0, 0.0, 0.0),
        tuple(city.size),
        city.boxes,
        city.ceiling,
        names,
        tubes,
        note,
        CREDIT,
    )


def flight(program: soter.Program, name: str, run: soter.Run) -> Flight:
    """The record of one traced run for the report."""
    assert run.trace is not None
    city = City(program)
    time_s = run.time_s()
    position = array(run.trace["d"]["p"])
    speed = np.linalg.norm(array(run.trace["d"]["v"]), axis=1)
    module = run.trace["modules"][:, 0]
    in_control = module["mode"] == 1
    clearance = city.clearance(position)
    lap = read_lap(run)
    end = len(time_s)
    if lap.lap_s is not None:  # a second of hovering after the lap is enough to look at
        end = int(np.searchsorted(time_s, lap.lap_s + 1.0))
    part = slice(0, max(end, 2))
    return Flight(
        name,
        ARMS[name],
        time_s[part],
        position[part],
        in_control[part],
        MODULE,
        clearance[part],
        speed[part],
        tuple(d for d in decisions(run) if d.time_s <= time_s[part][-1]),
        tuple(v for v in violations(run, city, position) if v.time_s <= time_s[part][-1]),
        {
            "lap_s": float("nan") if lap.lap_s is None else round(lap.lap_s, 2),
            "violations": len(violations(run, city, position)),
            "switches_to_sc": lap.switches_to_sc,
            "switches_to_ac": lap.switches_to_ac,
            "ac_share": lap.ac_share,
            "min_clearance_m": float(clearance[part].min()),
        },
    )


def decisions(run: soter.Run) -> list[Decision]:
    """Every DM step that changed the mode, with what the DM saw."""
    assert run.trace is not None
    module = run.trace["modules"][:, 0]
    mode = module["mode"].astype(int)
    time_s = run.time_s()
    mode_changes = []
    for i in np.flatnonzero(np.diff(mode)) + 1:
        row = module[i]
        seen = {n: bool(row[n]) for n in ("ttf", "safer", "stale", "saw_gate_fault")}
        if mode[i] == 1:
            mode_changes.append(Decision(float(time_s[i]), MODULE, "AC", "φ_safer holds", seen))
        else:
            why = "ttf_2Δ holds" if seen["ttf"] else "stale read" if seen["stale"] else "gate fault"
            mode_changes.append(Decision(float(time_s[i]), MODULE, "SC", why, seen))
    return mode_changes


def violations(run: soter.Run, city: City, position: NDArray[np.float64]) -> list[Violation]:
    """The first contact with a building, ground, ceiling or edge, if any."""
    hit = np.flatnonzero(city.clearance(position) < 0.0)
    if not len(hit):
        return []
    i = int(hit[0])
    return [Violation(float(run.time_s()[i]), "touches a building", tuple(position[i]))]
