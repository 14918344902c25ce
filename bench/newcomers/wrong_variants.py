"""What is changed in each robot, as edits of its program and in its equations.

Purpose: `VARIANTS`: six of each program of `../shared/robots`; the right robot stands first.
Non-goals: flying (`flights.py`), asking Soter (`wrong_robots.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from bench.newcomers.flights import Array, Robot

if TYPE_CHECKING:
    from collections.abc import Callable

PI = np.pi


@dataclass(frozen=True)
class Variant:
    """One robot made wrong."""

    why: str
    edits: dict[str, str]
    robot: Robot
    own_sets: bool = False
    """Whether it has sets of its own: the robot's lattice is where they leave AC in control."""


def rows(*values: Array | float) -> Array:
    """Values of n flights below each other; a number stands for n equal ones."""
    return np.array(np.broadcast_arrays(*[np.atleast_1d(v) for v in values]), dtype=float)


def wrapped(angle: Array) -> Array:
    """In [-pi, pi)."""
    return (angle + PI) % (2 * PI) - PI


def sets(predicate: str) -> dict[str, str]:
    """Sets of its own in place of computed ones: AC is left until `predicate`."""
    return {"  verify {": f"  ttf {predicate};\n  safer !({predicate});\n  verify {{"}


# ---------------------------------------------------------------- a car on a lane


def lane_sc(k_y: float, k_h: float, limit: float) -> Callable[[Array], Array]:
    """Steers by y and the heading."""
    return lambda s: rows(np.clip(-k_y * s[0] - k_h * s[1], -limit, limit))


LANE = Robot(
    low=(-0.9, -0.3),
    high=(0.9, 0.3),
    safe=lambda x: abs(x[0]) < 0.9,
    rates=lambda x, u, d: rows(15.0 * np.sin(x[1]), u[0] + d[0]),
    sc=lane_sc(0.25, 3.0, 0.25),
    ac=((-0.25,), (0.25,)),
    disturbed=((-0.02, 0.02),),
    errors=(0.05, 0.01),
    age_s=0.04,
    period_s=0.04,
    step_s=0.02,
    until_s=40.0,
)
LANE_LAW = "clamp(-0.25 * pose.y - 3.0 * pose.h, -TURN, TURN)"
CAR_ON_A_LANE = (
    Variant(
        "SC turns less than the road",
        {LANE_LAW: LANE_LAW.replace("-TURN, TURN", "-0.015, 0.015")},
        replace(LANE, sc=lane_sc(0.25, 3.0, 0.015)),
    ),
    Variant(
        "SC steers away from the middle",
        {LANE_LAW: LANE_LAW.replace("-0.25 *", "0.25 *")},
        replace(LANE, sc=lane_sc(-0.25, 3.0, 0.25)),
    ),
    Variant(
        "SC holds the heading only",
        {LANE_LAW: "clamp(-3.0 * pose.h, -TURN, TURN)"},
        replace(LANE, sc=lane_sc(0.0, 3.0, 0.25), until_s=200.0),
    ),
    Variant(
        "y is measured within 2 m",
        {"pose.y within 0.05": "pose.y within 2.0"},
        replace(LANE, errors=(2.0, 0.01)),
    ),
    Variant(
        "the road bends more than the car",
        {"in [-0.02, 0.02]": "in [-0.3, 0.3]"},
        replace(LANE, disturbed=((-0.3, 0.3),)),
    ),
    Variant("readings 3 s old", {"max_age 40ms": "max_age 3s"}, replace(LANE, age_s=3.0)),
)

# ---------------------------------------------------------------- a hopper


def hop_sc(base: float, gain: float) -> Callable[[Array], Array]:
    """Thrust by the height of the last apex."""
    return lambda s: rows(np.clip(base + gain * (0.4 - s[0]), 0.0, 0.3))


HOP = Robot(
    low=(0.15,),
    high=(0.8,),
    safe=lambda x: (x[0] > 0.15) & (x[0] < 0.8),
    rates=lambda x, u, d: rows(0.75 * x[0] + u[0] + d[0]),
    sc=hop_sc(0.1, 0.5),
    ac=((0.0,), (0.3,)),
    disturbed=((-0.03, 0.03),),
    errors=(0.01,),
    age_s=0.2,
    period_s=0.4,
    step_s=0.4,
    until_s=40.0,
    maps=True,
)
HOP_LAW = "clamp(0.1 + 0.5 * (0.4 - apex), 0.0, 0.3)"
HOPPER = (
    Variant(
        "SC thrusts too little",
        {HOP_LAW: "clamp(0.03 + 0.05 * (0.4 - apex), 0.0, 0.3)"},
        replace(HOP, sc=hop_sc(0.03, 0.05)),
    ),
    Variant(
        "SC thrusts most where it is high",
        {HOP_LAW: "clamp(0.1 - 0.5 * (0.4 - apex), 0.0, 0.3)"},
        replace(HOP, sc=hop_sc(0.1, -0.5)),
    ),
    Variant(
        "SC overshoots",
        {HOP_LAW: "clamp(0.1 + 9.0 * (0.4 - apex), 0.0, 0.9)", "[0.0, 0.3]": "[0.0, 0.9]"},
        replace(HOP, sc=lambda s: rows(np.clip(0.1 + 9.0 * (0.4 - s[0]), 0.0, 0.9))),
    ),
    Variant(
        "the ground moves by more than SC",
        {"in [-0.03, 0.03]": "in [-0.3, 0.3]"},
        replace(HOP, disturbed=((-0.3, 0.3),)),
    ),
    Variant(
        "the apex is measured within 40 cm",
        {"apex within 0.01": "apex within 0.4", HOP_LAW: HOP_LAW.replace("0.5", "1.0")},
        replace(HOP, errors=(0.4,), sc=hop_sc(0.1, 1.0)),
    ),
    Variant(
        "AC is left until the last centimetre",
        sets("apex < 0.17 || apex > 0.78"),
        replace(HOP, low=(0.17,), high=(0.78,)),
        True,
    ),
)

# ---------------------------------------------------------------- one of six joints


def joint_sc(k_q: float, k_w: float, limit: float) -> Callable[[Array], Array]:
    """A spring and a damper."""
    return lambda s: rows(np.clip(-k_q * s[0] - k_w * s[1], -limit, limit))


JOINT = Robot(
    low=(-3.0, -3.15),
    high=(3.0, 3.15),
    safe=lambda x: (abs(x[0]) < 3.0) & (abs(x[1]) < 3.15),
    rates=lambda x, u, d: rows(x[1], u[0] + d[0]),
    sc=joint_sc(4.0, 4.0, 5.0),
    ac=((-5.0,), (5.0,)),
    disturbed=((-0.5, 0.5),),
    errors=(0.001, 0.01),
    age_s=0.01,
    period_s=0.016,
    step_s=0.008,
    until_s=20.0,
)
JOINT_LAW = "saturate(-4.0 * j.q - 4.0 * j.w, A)"
SIX_JOINTS = (
    Variant(
        "SC is weaker than what disturbs",
        {JOINT_LAW: "saturate(-4.0 * j.q - 4.0 * j.w, 0.4)"},
        replace(JOINT, sc=joint_sc(4.0, 4.0, 0.4)),
    ),
    Variant(
        "SC undamps",
        {JOINT_LAW: "saturate(-4.0 * j.q + 1.0 * j.w, A)"},
        replace(JOINT, sc=joint_sc(4.0, -1.0, 5.0)),
    ),
    Variant(
        "SC damps only",
        {JOINT_LAW: "saturate(-4.0 * j.w, A)"},
        replace(JOINT, sc=joint_sc(0.0, 4.0, 5.0), until_s=60.0),
    ),
    Variant(
        "more disturbance than SC",
        {"in [-0.5, 0.5]": "in [-6.0, 6.0]"},
        replace(JOINT, disturbed=((-6.0, 6.0),)),
    ),
    Variant(
        "the angle is measured within 4 rad",
        {"j.q within 0.001": "j.q within 4.0"},
        replace(JOINT, errors=(4.0, 0.01)),
    ),
    Variant("readings 2 s old", {"max_age 10ms": "max_age 2s"}, replace(JOINT, age_s=2.0)),
)

# ---------------------------------------------------------------- ovens


def oven_sc(gain: float, low: float, high: float) -> Callable[[Array], Array]:
    """Power by the temperature."""
    return lambda s: rows(np.clip(0.5 + gain * (100.0 - s[0]), low, high))


OVEN = Robot(
    low=(60.0,),
    high=(140.0,),
    safe=lambda x: (x[0] > 60.0) & (x[0] < 140.0),
    rates=lambda x, u, d: rows((200.0 * u[0] - x[0]) / 120.0 + d[0]),
    sc=oven_sc(0.02, 0.0, 1.0),
    ac=((0.0,), (1.0,)),
    disturbed=((-0.05, 0.02),),
    errors=(0.5,),
    age_s=2.0,
    period_s=1.0,
    step_s=1.0,
    until_s=1500.0,
    pieces=2,
    late_s=8.0,
)
OVEN_LAW = "clamp(0.5 + 0.02 * (100.0 - temp), 0.0, 1.0)"


def ovens(right: Robot) -> tuple[Variant, ...]:
    """Six wrong ones of an oven."""
    return (
        Variant(
            "SC heats most where it is hot",
            {OVEN_LAW: OVEN_LAW.replace("0.5 +", "0.5 -")},
            replace(right, sc=oven_sc(-0.02, 0.0, 1.0)),
        ),
        Variant(
            "SC heats always", {OVEN_LAW: "0.8"}, replace(right, sc=lambda s: rows(0.8 + 0 * s[0]))
        ),
        Variant(
            "SC never heats enough",
            {OVEN_LAW: OVEN_LAW.replace("1.0)", "0.25)")},
            replace(right, sc=oven_sc(0.02, 0.0, 0.25)),
        ),
        Variant(
            "the door costs more than SC heats",
            {"in [-0.05, 0.02]": "in [-1.3, 0.02]"},
            replace(right, disturbed=((-1.3, 0.02),)),
        ),
        Variant(
            "the temperature is measured within 60 K",
            {"temp within 0.5": "temp within 60.0"},
            replace(right, errors=(60.0,)),
        ),
        Variant(
            "readings are minutes old", {"max_age 2s": "max_age 120s"}, replace(right, age_s=120.0)
        ),
    )


SLOW = replace(OVEN, period_s=2.0, step_s=2.0, late_s=0.0, pieces=4)

# ---------------------------------------------------------------- a boat


def boat_sc(k_y: float, k_psi: float, limit: float) -> Callable[[Array], Array]:
    """The course by y, the rudder by the course."""

    def law(s: Array) -> Array:
        wanted = np.clip(-k_y * s[0], -0.5, 0.5)
        return rows(np.clip(k_psi * (wanted - s[1]) - 2.5 * s[2], -limit, limit))

    return law


BOAT = Robot(
    low=(-30.0, -1.2, -0.35),
    high=(30.0, 1.2, 0.35),
    safe=lambda x: abs(x[0]) < 30.0,
    rates=lambda x, u, d: rows(3.0 * np.sin(x[1]) + d[0], x[2], (0.5 * u[0] - x[2]) / 2.0 + d[1]),
    sc=boat_sc(0.05, 1.2, 0.6),
    ac=((-0.6,), (0.6,)),
    disturbed=((-0.4, 0.4), (-0.02, 0.02)),
    errors=(0.5, 0.02, 0.01),
    age_s=0.2,
    period_s=0.2,
    step_s=0.1,
    until_s=150.0,
    pieces=2,
)
BOAT_LAW = "clamp(1.2 * (wanted - b.psi) - 2.5 * b.r, -D, D)"
BOATS = (
    Variant(
        "SC's rudder is weaker than the waves",
        {BOAT_LAW: BOAT_LAW.replace("-D, D", "-0.06, 0.06")},
        replace(BOAT, sc=boat_sc(0.05, 1.2, 0.06)),
    ),
    Variant(
        "SC steers away",
        {"clamp(-0.05 * b.y": "clamp(0.05 * b.y"},
        replace(BOAT, sc=boat_sc(-0.05, 1.2, 0.6)),
    ),
    Variant(
        "SC's course has the wrong sign",
        {BOAT_LAW: "clamp(-1.2 * (wanted - b.psi) - 2.5 * b.r, -D, D)"},
        replace(BOAT, sc=boat_sc(0.05, -1.2, 0.6)),
    ),
    Variant(
        "the current is faster than the boat",
        {"in [-0.4, 0.4]": "in [-3.2, 3.2]"},
        replace(BOAT, disturbed=((-3.2, 3.2), (-0.02, 0.02))),
    ),
    Variant(
        "y is measured within 35 m",
        {"b.y within 0.5": "b.y within 35.0"},
        replace(BOAT, errors=(35.0, 0.02, 0.01)),
    ),
    Variant(
        "AC is left until the last half metre",
        sets("abs(b.y) > 29.5"),
        replace(BOAT, low=(-29.5, -1.2, -0.35), high=(29.5, 1.2, 0.35)),
        True,
    ),
)

# ---------------------------------------------------------------- a UAV that circles

DUBINS_LAW = "clamp(V / R + 1.0 * wrap_angle(wanted - pose.h), -W, W)"


def loiter(limit: float, sign: float, share: float) -> Callable[[Array], Array]:
    """Round the middle; `share` of the heading is read."""

    def law(s: Array) -> Array:
        bearing = np.arctan2(s[1], s[0]) + PI / 2
        wanted = bearing + np.arctan(2.0 * (np.hypot(s[0], s[1]) - 60.0) / 60.0)
        turn = 13.0 / 60.0 + sign * wrapped(wanted - share * s[2])
        return rows(np.clip(turn, -limit, limit))

    return law


DUBINS = Robot(
    low=(-300.0, -300.0, -PI),
    high=(300.0, 300.0, PI),
    safe=lambda x: (abs(x[0]) < 300.0) & (abs(x[1]) < 300.0),
    rates=lambda x, u, d: rows(13.0 * np.cos(x[2]) + d[0], 13.0 * np.sin(x[2]) + d[1], u[0]),
    sc=loiter(0.5, 1.0, 1.0),
    ac=((-0.5,), (0.5,), (0.0,)),
    disturbed=((-1.0, 1.0), (-1.0, 1.0)),
    errors=(1.0, 1.0, 0.03),
    age_s=0.1,
    period_s=0.1,
    step_s=0.05,
    until_s=300.0,
    pieces=1,
)
DUBINS_UAV = (
    Variant(
        "SC flies straight on", {DUBINS_LAW: "0.0"}, replace(DUBINS, sc=lambda s: rows(0.0 * s[0]))
    ),
    Variant(
        "SC circles wider than the arena",
        {DUBINS_LAW: DUBINS_LAW.replace("-W, W", "-0.03, 0.03")},
        replace(DUBINS, sc=loiter(0.03, 1.0, 1.0)),
    ),
    Variant(
        "SC circles with the wind, wherever it is",
        {DUBINS_LAW: "0.25"},
        replace(DUBINS, sc=lambda s: rows(0.25 + 0.0 * s[0]), until_s=900.0),
    ),
    Variant(
        "more wind than speed",
        {"wx: float in [-1.0, 1.0]": "wx: float in [-14.0, 14.0]"},
        replace(DUBINS, disturbed=((-14.0, 14.0), (-1.0, 1.0))),
    ),
    Variant(
        "the place is measured within 400 m",
        {"pose.x within 1.0, pose.y within 1.0": "pose.x within 400.0, pose.y within 400.0"},
        replace(DUBINS, errors=(400.0, 400.0, 0.03), until_s=600.0),
    ),
    Variant(
        "a heading that is no period: half of it counts",
        {"cos(h)": "cos(0.5 * h)", "sin(h)": "sin(0.5 * h)"},
        replace(
            DUBINS,
            rates=lambda x, u, d: rows(
                13.0 * np.cos(x[2] / 2) + d[0], 13.0 * np.sin(x[2] / 2) + d[1], u[0]
            ),
        ),
    ),
)

# ---------------------------------------------------------------- brakes


def car_rates(x: Array, u: Array, d: Array) -> Array:
    """A car that neither brakes nor is pushed where it stands."""
    rolls = (x[1] > 0.0) | (u[0] > 0.0)
    return rows(-x[1], np.where(rolls, u[0] + d[0], 0.0))


BRAKE = Robot(
    low=(0.0, 0.0),
    high=(100.0, 18.0),
    safe=lambda x: x[0] > 0.0,
    rates=car_rates,
    sc=lambda s: rows(-6.0 + 0.0 * s[0]),
    ac=((2.0,),),
    disturbed=((-0.5, 0.5),),
    errors=(0.3, 0.1),
    age_s=0.06,
    period_s=0.04,
    step_s=0.02,
    until_s=60.0,
    pieces=2,
)
BRAKE_LAW = "publish accel = -BRAKE; } }"
EMERGENCY_BRAKE = (
    Variant(
        "SC brakes less than the road pushes",
        {BRAKE_LAW: "publish accel = -0.3; } }"},
        replace(BRAKE, sc=lambda s: rows(-0.3 + 0.0 * s[0]), until_s=400.0),
    ),
    Variant(
        "SC goes on slowly",
        {BRAKE_LAW: "publish accel = clamp(0.5 - seen.v, -BRAKE, A); } }"},
        replace(BRAKE, sc=lambda s: rows(np.clip(0.5 - s[1], -6.0, 2.0)), until_s=400.0),
    ),
    Variant(
        "the road pushes more than the brake holds",
        {"in [-0.5, 0.5]": "in [-6.5, 6.5]"},
        replace(BRAKE, disturbed=((-6.5, 6.5),), until_s=400.0),
    ),
    Variant(
        "the gap closes where it stands",
        {"der gap = -v;": "der gap = -v - 0.2;"},
        replace(BRAKE, rates=lambda x, u, d: car_rates(x, u, d) + rows(-0.2, 0.0), until_s=600.0),
    ),
    Variant("readings 9 s old", {"max_age 60ms": "max_age 9s"}, replace(BRAKE, age_s=9.0)),
    Variant(
        "AC is left until the last metre",
        sets("seen.gap < 1.0"),
        replace(BRAKE, low=(1.0, 0.0)),
        True,
    ),
)

# ---------------------------------------------------------------- behind another car


def road_rates(x: Array, u: Array, d: Array) -> Array:
    """Gap, speed, speed of the lead."""
    rolls = (x[1] > 0.0) | (u[0] > 0.0)
    ends = ((x[2] <= 0.0) & (d[0] < 0.0)) | ((x[2] >= 30.0) & (d[0] > 0.0))
    return rows(x[2] - x[1], np.where(rolls, u[0], 0.0), np.where(ends, 0.0, d[0]))


def follow_sc(brake: float, sign: float, room: float) -> Callable[[Array], Array]:
    """Keeps the distance that a full stop of both needs."""

    def law(s: Array) -> Array:
        v, lead = np.maximum(s[1], 0.0), np.maximum(s[2], 0.0)
        left = s[0] + lead * lead / 12.0 - v * v / 11.0 - v - room
        most = np.where(v > 29.0, 0.0, 2.0)
        return rows(np.clip(0.5 * left + sign * (lead - v), -brake, most))

    return law


ROAD = Robot(
    low=(0.0, 0.0, 0.0),
    high=(150.0, 31.0, 31.0),
    safe=lambda x: x[0] > 0.0,
    rates=road_rates,
    sc=follow_sc(6.0, 1.0, 4.0),
    ac=((2.0,),),
    disturbed=((-5.0, 2.0),),
    errors=(0.3, 0.1, 0.3),
    age_s=0.06,
    period_s=0.04,
    step_s=0.02,
    until_s=60.0,
    pieces=2,
)
CRUISE_CONTROL = (
    Variant(
        "SC never brakes",
        {"-BRAKE, v > 29.0 ? 0.0 : A)": "0.1, v > 29.0 ? 0.1 : A)"},
        replace(ROAD, sc=lambda s: np.maximum(follow_sc(6.0, 1.0, 4.0)(s), 0.1), until_s=200.0),
    ),
    Variant(
        "SC keeps a distance of minus 30 m",
        {"1.0 * v - 4.0": "1.0 * v + 30.0"},
        replace(ROAD, sc=follow_sc(6.0, 1.0, -30.0), until_s=200.0),
    ),
    Variant(
        "the gap is measured within 160 m",
        {"seen.gap within 0.3": "seen.gap within 160.0"},
        replace(ROAD, errors=(160.0, 0.1, 0.3), until_s=200.0),
    ),
    Variant(
        "the lead may drive backwards",
        {"lead <= 0.0 && lead_accel < 0.0": "lead <= -5.0 && lead_accel < 0.0"},
        replace(
            ROAD,
            rates=lambda x, u, d: road_rates(rows(x[0], x[1], x[2] + 5.0), u, d) - rows(5.0, 0, 0),
            until_s=200.0,
        ),
    ),
    Variant(
        "readings 9 s old", {"max_age 60ms": "max_age 9s"}, replace(ROAD, age_s=9.0, until_s=100.0)
    ),
    Variant(
        "AC is left until the last metre",
        sets("seen.gap < 1.0"),
        replace(ROAD, low=(1.0, 0.0, 0.0)),
        True,
    ),
)

# ---------------------------------------------------------------- away from the ground


def pull_sc(low: float, high: float, gain: float) -> Callable[[Array], Array]:
    """Pulls up and levels off at 1000 m."""

    def law(s: Array) -> Array:
        wanted = np.clip(0.002 * (1000.0 - s[0]), -0.2, 0.2)
        return rows(np.clip(np.cos(s[1]) + gain * (wanted - s[1]), low, high))

    return law


JET = Robot(
    low=(50.0, -0.8, -1.1),
    high=(2000.0, 0.8, 5.1),
    safe=lambda x: x[0] > 50.0,
    rates=lambda x, u, d: rows(
        180.0 * np.sin(x[1]) + d[0], 9.81 / 180.0 * (x[2] - np.cos(x[1])), (u[0] - x[2]) / 0.3
    ),
    sc=pull_sc(-1.0, 5.0, 20.0),
    ac=((-1.0,), (5.0,)),
    disturbed=((-2.0, 2.0),),
    errors=(3.0, 0.005, 0.05),
    age_s=0.05,
    period_s=0.1,
    step_s=0.05,
    until_s=300.0,
    pieces=2,
)
PULL_LAW = "clamp(cos(f.g) + 20.0 * (wanted - f.g), -1.0, 5.0)"
GROUND_AVOIDANCE = (
    Variant(
        "SC pulls less than its weight",
        {PULL_LAW: PULL_LAW.replace("-1.0, 5.0", "-1.0, 0.5")},
        replace(JET, sc=pull_sc(-1.0, 0.5, 20.0)),
    ),
    Variant(
        "SC descends",
        {"clamp(0.002 * (1000.0 - f.h), -0.2, 0.2)": "-0.1"},
        replace(JET, sc=lambda s: rows(np.clip(np.cos(s[1]) + 20.0 * (-0.1 - s[1]), -1.0, 5.0))),
    ),
    Variant(
        "SC levels off below the ground",
        {"(1000.0 - f.h)": "(40.0 - f.h)"},
        replace(JET, sc=lambda s: pull_sc(-1.0, 5.0, 20.0)(rows(s[0] + 960.0, s[1], s[2]))),
    ),
    Variant(
        "gusts of 60 m/s downwards",
        {"in [-2.0, 2.0]": "in [-60.0, 2.0]"},
        replace(JET, disturbed=((-60.0, 2.0),)),
    ),
    Variant(
        "the height is measured within 1,200 m",
        {"f.h within 3.0": "f.h within 1200.0"},
        replace(JET, errors=(1200.0, 0.005, 0.05)),
    ),
    Variant(
        "AC is left until the last 10 m",
        sets("f.h < 60.0"),
        replace(JET, low=(60.0, -0.8, -1.1)),
        True,
    ),
)

# ---------------------------------------------------------------- an upright pendulum


def hold_sc(k_a: float, k_w: float, limit: float) -> Callable[[Array], Array]:
    """Holds it upright."""
    return lambda s: rows(np.clip(-k_a * s[0] - k_w * s[1], -limit, limit))


POLE = Robot(
    low=(-0.5, -2.5),
    high=(0.5, 2.5),
    safe=lambda x: abs(x[0]) < 0.5,
    rates=lambda x, u, d: rows(x[1], 15.0 * np.sin(x[0]) + 3.0 * u[0] + d[0]),
    sc=hold_sc(12.0, 3.0, 2.0),
    ac=((-2.0,), (2.0,)),
    disturbed=((-0.1, 0.1),),
    errors=(0.005, 0.02),
    age_s=0.05,
    period_s=0.05,
    step_s=0.05,
    until_s=20.0,
    pieces=5,
)
HOLD_LAW = "clamp(-12.0 * p.a - 3.0 * p.w, -T, T)"
PENDULUM = (
    Variant(
        "SC is weaker than the push",
        {HOLD_LAW: HOLD_LAW.replace("-T, T", "-0.03, 0.03")},
        replace(POLE, sc=hold_sc(12.0, 3.0, 0.03)),
    ),
    Variant(
        "SC holds less than gravity pulls",
        {HOLD_LAW: HOLD_LAW.replace("-12.0", "-4.0")},
        replace(POLE, sc=hold_sc(4.0, 3.0, 2.0)),
    ),
    Variant(
        "SC undamps",
        {HOLD_LAW: HOLD_LAW.replace("- 3.0", "+ 3.0")},
        replace(POLE, sc=hold_sc(12.0, -3.0, 2.0)),
    ),
    Variant(
        "pushed more than SC holds",
        {"in [-0.1, 0.1]": "in [-6.5, 6.5]"},
        replace(POLE, disturbed=((-6.5, 6.5),)),
    ),
    Variant(
        "the angle is measured within .3 rad",
        {"p.a within 0.005": "p.a within 0.3"},
        replace(POLE, errors=(0.3, 0.02)),
    ),
    Variant("readings 600 ms old", {"max_age 50ms": "max_age 600ms"}, replace(POLE, age_s=0.6)),
)

# ---------------------------------------------------------------- a lift


def home_sc(k_h: float, k_v: float, k_a: float, limit: float) -> Callable[[Array], Array]:
    """Height, speed, acceleration, jerk."""

    def law(s: Array) -> Array:
        v = np.clip(k_h * (15.0 - s[0]), -2.0, 2.0)
        a = np.clip(k_v * (v - s[1]), -1.0, 1.0)
        return rows(np.clip(k_a * (a - s[2]), -limit, limit))

    return law


SHAFT = Robot(
    low=(0.0, -3.0, -1.4),
    high=(30.0, 3.0, 1.4),
    safe=lambda x: (x[0] > 0.0) & (x[0] < 30.0) & (abs(x[1]) < 3.0) & (abs(x[2]) < 1.4),
    rates=lambda x, u, d: rows(x[1], x[2] + d[0], u[0]),
    sc=home_sc(0.35, 0.9, 4.0, 1.5),
    ac=((-1.5,), (1.5,)),
    disturbed=((-0.05, 0.05),),
    errors=(0.02, 0.02, 0.02),
    age_s=0.04,
    period_s=0.04,
    step_s=0.02,
    until_s=90.0,
    pieces=1,
)
LIFT = (
    Variant(
        "SC drives away",
        {"0.35 * (15.0 - m.h)": "-0.35 * (15.0 - m.h)"},
        replace(SHAFT, sc=home_sc(-0.35, 0.9, 4.0, 1.5)),
    ),
    Variant(
        "the speed has the wrong sign",
        {"0.9 * (v - m.v)": "-0.9 * (v - m.v)"},
        replace(SHAFT, sc=home_sc(0.35, -0.9, 4.0, 1.5)),
    ),
    Variant(
        "the acceleration is not fed back",
        {"4.0 * (a - m.a)": "4.0 * a"},
        replace(SHAFT, sc=lambda s: home_sc(0.35, 0.9, 4.0, 1.5)(rows(s[0], s[1], 0.0 * s[2]))),
    ),
    Variant(
        "more sway than SC accelerates",
        {"in [-0.05, 0.05]": "in [-1.2, 1.2]"},
        replace(SHAFT, disturbed=((-1.2, 1.2),)),
    ),
    Variant(
        "the speed is measured within 2.5 m/s",
        {"m.v within 0.02": "m.v within 2.5"},
        replace(SHAFT, errors=(0.02, 2.5, 0.02)),
    ),
    Variant("readings 3 s old", {"max_age 40ms": "max_age 3s"}, replace(SHAFT, age_s=3.0)),
)

# ---------------------------------------------------------------- a motor


def volts(low: float, sign: float) -> Callable[[Array], Array]:
    """Brakes gently, at a held current."""

    def law(s: Array) -> Array:
        brake = np.clip(0.01 * s[1], -3.0, 3.0)
        return rows(np.clip(0.0302 * s[1] - 0.2 * s[0] - sign * brake, -low, low))

    return law


MOTOR = Robot(
    low=(-30.0, -790.0),
    high=(30.0, 790.0),
    safe=lambda x: (abs(x[0]) < 30.0) & (abs(x[1]) < 790.0),
    rates=lambda x, u, d: rows(
        (u[0] - 0.299 * x[0] - 0.0302 * x[1]) / 0.000082,
        (0.0302 * x[0] + d[0]) / 0.000114 - 0.1 * x[1],
    ),
    sc=volts(24.0, 1.0),
    ac=((-24.0,), (24.0,)),
    disturbed=((-0.05, 0.05),),
    errors=(0.1, 2.0),
    age_s=1e-4,
    period_s=5e-5,
    step_s=5e-5,
    until_s=0.3,
    pieces=2,
)
MOTOR_LAW = "clamp(0.0302 * m.w - 0.2 * m.i - clamp(0.01 * m.w, -3.0, 3.0), -U, U)"
MOTORS = (
    Variant(
        "SC drives on",
        {MOTOR_LAW: MOTOR_LAW.replace("- clamp", "+ clamp")},
        replace(MOTOR, sc=volts(24.0, -1.0)),
    ),
    Variant(
        "SC shorts the wrong way",
        {MOTOR_LAW: "clamp(6.0 * m.i, -U, U)"},
        replace(MOTOR, sc=lambda s: rows(np.clip(6.0 * s[0], -24.0, 24.0))),
    ),
    Variant(
        "SC holds 40 A",
        {MOTOR_LAW: "clamp(0.0302 * m.w + 0.299 * 40.0, -U, U)"},
        replace(MOTOR, sc=lambda s: rows(np.clip(0.0302 * s[1] + 11.96, -24.0, 24.0))),
    ),
    Variant(
        "a load that SC does not hold",
        {"in [-0.05, 0.05]": "in [-1.0, 1.0]"},
        replace(MOTOR, disturbed=((-1.0, 1.0),)),
    ),
    Variant(
        "the current is measured within 60 A",
        {"m.i within 0.1": "m.i within 60.0"},
        replace(MOTOR, errors=(60.0, 2.0)),
    ),
    Variant("readings 3 ms old", {"max_age 100us": "max_age 3ms"}, replace(MOTOR, age_s=3e-3)),
)

# ---------------------------------------------------------------- a differential drive


def jackal_rates(push: float, turn: float = 1.0) -> Callable[[Array, Array, Array], Array]:
    """Place, heading, speed; it is pushed by `push` times what disturbs it."""
    return lambda x, u, d: rows(
        x[3] * np.cos(turn * x[2]) + push * d[1],
        x[3] * np.sin(turn * x[2]),
        u[1] + d[0],
        np.clip(8.0 * (u[0] - x[3]), -1.5, 1.5),
    )


def stop_at(v: float, w: float) -> Callable[[Array], Array]:
    """One command."""
    return lambda s: rows(v + 0.0 * s[0], w)


JACKAL = Robot(
    low=(-5.0, -5.0, -PI, -0.1),
    high=(5.0, 5.0, PI, 1.7),
    safe=lambda x: (abs(x[0]) < 5.0) & (abs(x[1]) < 5.0),
    rates=jackal_rates(0.0),
    sc=stop_at(0.0, 0.0),
    ac=((1.5, 0.0), (1.5, 1.5), (0.0, 1.5)),
    disturbed=((-0.05, 0.05), (-1.0, 1.0)),
    errors=(0.03, 0.03, 0.02, 0.03),
    age_s=0.05,
    period_s=0.04,
    step_s=0.02,
    until_s=30.0,
    pieces=1,
)
STOP_LAW = "publish cmd = { v: 0.0, w: 0.0 };"
DIFFERENTIAL_DRIVE = (
    Variant(
        "SC goes on slowly",
        {STOP_LAW: "publish cmd = { v: 0.3, w: 0.0 };"},
        replace(JACKAL, sc=stop_at(0.3, 0.0), until_s=80.0),
    ),
    Variant(
        "it rolls by itself",
        {"der v = clamp(8.0 * (cmd.v - v)": "der v = clamp(8.0 * (cmd.v + 0.2 - v)"},
        replace(
            JACKAL, rates=lambda x, u, d: jackal_rates(0.0)(x, u + rows(0.2, 0.0), d), until_s=80.0
        ),
    ),
    Variant(
        "it is pushed",
        {
            "  der x = v * cos(h);": "  der x = v * cos(h) + push;",
            "  der x": "  disturbance push: float in [-0.2, 0.2];\n  der x",
        },
        replace(JACKAL, rates=jackal_rates(0.2), until_s=80.0),
    ),
    Variant("readings 20 s old", {"max_age 50ms": "max_age 20s"}, replace(JACKAL, age_s=20.0)),
    Variant(
        "SC turns on the spot, and half of the heading counts",
        {
            STOP_LAW: "publish cmd = { v: 0.3, w: 0.0 };",
            "cos(h)": "cos(0.5 * h)",
            "sin(h)": "sin(0.5 * h)",
        },
        replace(JACKAL, sc=stop_at(0.3, 0.0), rates=jackal_rates(0.0, 0.5), until_s=80.0),
    ),
    Variant(
        "AC is left until the last decimetre",
        sets("abs(p.x) > 4.9 || abs(p.y) > 4.9"),
        replace(JACKAL, low=(-4.9, -4.9, -PI, -0.1), high=(4.9, 4.9, PI, 1.7)),
        True,
    ),
)

VARIANTS = {
    "boat": (BOAT, BOATS),
    "car_on_a_lane": (LANE, CAR_ON_A_LANE),
    "cruise_control": (ROAD, CRUISE_CONTROL),
    "differential_drive": (JACKAL, DIFFERENTIAL_DRIVE),
    "dubins_uav": (DUBINS, DUBINS_UAV),
    "emergency_brake": (BRAKE, EMERGENCY_BRAKE),
    "ground_avoidance": (JET, GROUND_AVOIDANCE),
    "hopper": (HOP, HOPPER),
    "lift": (SHAFT, LIFT),
    "motor": (MOTOR, MOTORS),
    "oven": (OVEN, ovens(OVEN)),
    "pendulum": (POLE, PENDULUM),
    "six_joints": (JOINT, SIX_JOINTS),
    "slow_oven": (SLOW, ovens(SLOW)),
}
"""The right robot, of which not every start may leave `safe`, and the wrong ones."""
