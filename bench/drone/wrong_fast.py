"""Wrong motion primitives, followers and whole stacks: which text becomes what.

Purpose: `FAST`, changes to `corridor.soter` and to the program of all modules; `ASSUMED`, changes
that break what the proofs take for granted of the program: those are proved, and the verdict has
to name what they break.
Non-goals: batteries and planners (`wrong_slow.py`).
"""

from __future__ import annotations

from functools import partial

from bench.drone.wrong_base import Edit, World, Wrong

RAMS = "examples/drone/corridor_adversaries.soter"
OWN = "bench/drone/drone_wrong_corridor.soter"
HOSTILE = "examples/drone/surveillance_adversaries.soter"
LEFT = "Contains"
"""The box that is flown."""


def _worlds(*systems: str) -> tuple[World, ...]:
    own = ("Jumping", "Landing")
    return tuple(World(OWN if s in own else RAMS, s, 60.0, LEFT, 4) for s in systems)


RAMMED = _worlds("Ramming", "Pushing", "Jerking")
STACK = tuple(World(HOSTILE, s, 60.0, LEFT, 3) for s in ("Ramming", "Twitching"))


def _fast(
    kind: str,
    name: str,
    words: str,
    *edits: tuple[str, ...],
    worlds: tuple[World, ...] = RAMMED,
    verify: tuple[str, str | None] = ("corridor.soter", "SafeMotionPrimitive"),
    why: str = "",
    assumed: str = "",
) -> Wrong:
    return Wrong(
        kind,
        name,
        words,
        tuple(
            Edit(e[0], e[1], e[2]) if len(e) == 3 else Edit("corridor.soter", e[0], e[1])
            for e in edits
        ),
        verify,
        () if why else worlds,
        why,
        assumed,
    )


# ---------------------------------------------------------------- motion primitive
_motion = partial(_fast, "motion")
TTF = "ttf !S0(east, west, north, south, above, below, H) || !permit;"
SAFER = "safer S0(east, west, north, south, above, below, H_SAFER);"
NEED = """return m.ahead - E_Q >= Need(faster, tau, u, b, tail) && faster + (u + D) * tau <= fastest
      && m.toward - E_V - (u + D) * tau >= -fastest;"""
LAW = "return clamp(9.0 * (clamp(2.0 * Gap(m, wished, margin), -creep, creep) - m.w), -u, u);"
MOTIONS = (
    _motion("ttf never", "DM asks only for the permit", (TTF, "ttf !permit;")),
    _motion(
        "ttf of a floor plan",
        "DM forgets ceiling and ground",
        ("&& Level(s, tau) && Upright(a, tau)\n      && Upright(b, tau);", "&& Level(s, tau);"),
    ),
    _motion(
        "no look-ahead",
        "DM acts when the wall is reached",
        (TTF, "ttf !PhiSafe_MPr(east, west, north, south, above, below) || !permit;"),
    ),
    _motion(
        "speed forgotten",
        "the sets go by distance alone",
        (NEED, "return m.ahead - E_Q >= tail;"),
    ),
    _motion(
        "brakes too good",
        "the sets count on 8 m/s² of braking",
        ("const B: float = 3.0;", "const B: float = 8.0;"),
    ),
    _motion(
        "brakes too good upright",
        "the sets count on 4 m/s² of braking upright",
        ("const B_UP: float = 0.88;", "const B_UP: float = 4.0;"),
    ),
    _motion(
        "no margin",
        "no look-ahead, errors or tail in the sets",
        (NEED, "return m.ahead >= m.toward * abs(m.toward) / (2.0 * b);"),
    ),
    _motion(
        "safer too wide",
        "control comes back wherever the box is not left",
        (SAFER, "safer PhiSafe_MPr(east, west, north, south, above, below);"),
    ),
    _motion(
        "SC too weak",
        "SC brakes with a fifth of what the sets count on",
        (LAW, LAW.replace("-u, u)", "-0.2 * u, 0.2 * u)")),
    ),
    _motion("SC lets go", "SC asks for nothing", (LAW, "return 0.0;")),
    _motion("SC reversed", "SC goes the wrong way", (LAW, LAW.replace("clamp(9.0", "clamp(-9.0"))),
    _motion(
        "a gale",
        "five times the wind in the world and in the proof",
        ("iris.soter", "const WIND: float = 0.3;", "const WIND: float = 1.5;"),
    ),
)

# ---------------------------------------------------------------- times of the motion primitive
_timed = partial(_fast, "timing")
TIMES = (
    _timed(
        "slow decision",
        "DM looks every 200 ms",
        ("  sc MotionPrimitiveSC;\n  period 10ms;", "  sc MotionPrimitiveSC;\n  period 200ms;"),
        ("horizon 30ms;", "horizon 400ms;"),
    ),
    _timed(
        "slow both",
        "DM looks, and SC speaks, every 200 ms",
        ("  sc MotionPrimitiveSC;\n  period 10ms;", "  sc MotionPrimitiveSC;\n  period 200ms;"),
        ("node MotionPrimitiveSC period 10ms", "node MotionPrimitiveSC period 200ms"),
    ),
    _timed(
        "slow follower",
        "Follower speaks every 200 ms, and so long it counts",
        ("node Follower period 10ms", "node Follower period 200ms"),
        ("max_age 11ms", "max_age 210ms"),
    ),
    _timed(
        "late DM",
        "DM may be 20 ms late",
        ("late dm 500us,", "late dm 20ms,"),
        why="nobody is late in virtual time",
    ),
    _timed(
        "late follower",
        "Follower may be 20 ms late",
        ("Follower 500us;", "Follower 20ms;"),
        why="nobody is late in virtual time",
    ),
    _timed(
        "slow start",
        "what is asked for acts up to 100 ms later",
        ("acts within 0ms;", "acts within 100ms;"),
        why="nothing takes time between an output and the world in virtual time",
    ),
)

# ---------------------------------------------------------------- follower and hand-over
_follower = partial(_fast, "follower")
GUARD = """  return Nested(e) && Level(e, H) && Nested(w) && Level(w, H) && Nested(n) && Level(n, H)
      && Nested(s) && Level(s, H) && Nested(a) && Upright(a, H) && Nested(b) && Upright(b, H);
"""
NEXT = "      if MayEnter(blocks[at + 1], m) {\n"
WAY = "      if MayEnter(way.corridor.blocks[0], m) {\n"
JUMPS = _worlds("Jumping")
FOLLOWERS = (
    _follower("next box unseen", "the next box is entered at once", (NEXT, "      if true {\n")),
    _follower(
        "outside S_0",
        "the next box is entered wherever it is reached",
        (NEXT, "      if boxes.Contains(blocks[at + 1], m.p) {\n"),
    ),
    _follower(
        "speed forgotten",
        "the guard of a box, and what it promises, say nothing of S_0",
        (
            GUARD,
            (
                "  return Nested(e) && Nested(w) && Nested(n) && Nested(s) && Nested(a)\n"
                "      && Nested(b);\n"
            ),
        ),
    ),
    _follower(
        "guard says yes",
        "the guard of a box, and what it promises, are always true",
        (GUARD, "  return e.room > -LONG || w.room + n.room + s.room + a.room + b.room > 0.0;\n"),
        worlds=JUMPS,
    ),
    _follower(
        "by SC anywhere",
        "under SC the next box is entered without a look",
        (NEXT, "      if MayEnter(blocks[at + 1], m) || mode(SafeMotionPrimitive) == Mode.SC {\n"),
    ),
    _follower(
        "one instant early",
        "the mode that was there before DM looked stands for S_0",
        (NEXT, "      if MayEnter(blocks[at + 1], m) || mode(SafeMotionPrimitive) == Mode.AC {\n"),
    ),
    _follower(
        "two at once",
        "S_0 of the next box lets it enter the one behind",
        (
            NEXT + "        at = at + 1;\n",
            NEXT + "        at = at + 2 < blocks.len ? at + 2 : at + 1;\n",
        ),
    ),
    _follower(
        "new way unseen",
        "a new corridor is adopted from anywhere",
        (WAY, "      if true {\n"),
        worlds=JUMPS,
    ),
    _follower(
        "landing ignored by the tube",
        "a landing flies to the last box at once",
        (
            "    let b = blocks[at];\n",
            "    if way.careful {\n      at = blocks.len - 1;\n    }\n    let b = blocks[at];\n",
        ),
        worlds=_worlds("Landing", "Jumping"),
    ),
    _follower(
        "box of another step",
        "the walls are those of the next box, whichever is flown",
        ("    let b = blocks[at];\n", "    let b = blocks[at + 1 < blocks.len ? at + 1 : at];\n"),
    ),
)

# ---------------------------------------------------------------- the whole
ALL = ("surveillance.soter", None)
_whole = partial(_fast, "composition", verify=ALL)
BOTH = ("surveillance.soter", "surveillance_adversaries.soter")
LOW = (("battery.START_CHARGE", 0.05),)
"""The unbroken stack stays in its dock with so little."""
AIRBORNE = (World(HOSTILE, "Careless", 60.0, "charge > 0.0", 2, LOW),)


STAYS = "node Stays period 500ms {\n  publishes go;\n  step { publish go = 0.5; }\n}\n\n"
IDLES = """node Idles period 10ms {
  publishes control;
  step { publish control = vec3(0.0, 0.0, 0.0); }
}

"""


def _also(after: str, more: str) -> tuple[tuple[str, str, str], ...]:
    return tuple((file, after, after + more) for file in BOTH)


WHOLE = (
    _whole(
        "battery not asked",
        "the system leaves SafeBattery to its AC",
        *_also("  module battery.SafeBattery;\n", "  force SafeBattery ac;\n"),
        worlds=AIRBORNE,
    ),
    _whole(
        "landing replaced",
        "the system has a node for Land that flies on",
        ("battery.soter", "node Land period", STAYS + "node Land period"),
        *_also("  module battery.SafeBattery;\n", "  replace Land by battery.Stays;\n"),
        worlds=AIRBORNE,
    ),
    _whole(
        "walls not asked",
        "the system leaves SafeMotionPrimitive to its AC",
        *_also("  module drone.SafeMotionPrimitive;\n", "  force SafeMotionPrimitive ac;\n"),
        worlds=STACK,
    ),
    _whole(
        "SC replaced",
        "the system has a node for the motion primitive's SC that asks for nothing",
        ("node MotionPrimitiveSC period", IDLES + "node MotionPrimitiveSC period"),
        *_also(
            "  module drone.SafeMotionPrimitive;\n", "  replace MotionPrimitiveSC by drone.Idles;\n"
        ),
        worlds=STACK,
    ),
    _whole(
        "plan unseen",
        "two modules rely on corridors that the third one's follower adopts unseen after 50 ms",
        ("planner.soter", "        if Proper(c) {\n", "        if true {\n"),
        ("planner.soter", "SETTLED: duration = 250ms", "SETTLED: duration = 50ms"),
        worlds=(World(HOSTILE, "Lying", 60.0, "Sound", 3),),
    ),
)
FAST = (*MOTIONS, *TIMES, *FOLLOWERS, *WHOLE)

# ---------------------------------------------------------------- what is assumed
_assumed = partial(_fast, "assumed")
ASSUMED = (
    _assumed(
        "no inflation in Sound",
        "boxes are free that keep no radius from walls: `safe` itself says too little",
        (
            "boxes.soter",
            "const R: float[3] = [city.RADIUS, city.RADIUS, city.RADIUS];",
            "const R: float[3] = [0.0, 0.0, 0.0];",
        ),
        verify=("planner.soter", "SafePlanner"),
        worlds=(World(RAMS, "Ramming", 60.0, "NoCollision", 4),),
        assumed="opaque .*Sound",
    ),
    _assumed(
        "a gale unforeseen",
        "five times the wind that the proof knows",
        ("iris.soter", "const WIND: float = 0.3;", "const WIND: float = 1.5;"),
        ("const D: float = iris.WIND + RESIDUAL;", "const D: float = 0.3 + RESIDUAL;"),
        assumed="d behaves like",
    ),
    _assumed(
        "walls shown too far",
        "Follower shows every wall half a metre farther",
        *(
            (f"room: {p}, one: {a}, two: {b}, ahead: {c},", shown.format(p, a, b, c))
            for p, a, b, c in (
                ("wall - p", "wall - q1", "wall - q2", "wall - q3"),
                ("p - wall", "q1 - wall", "q2 - wall", "q3 - wall"),
            )
            for shown in ("room: {} + 0.5, one: {} + 0.5, two: {} + 0.5, ahead: {} + 0.5,",)
        ),
        assumed="shows, within the errors declared, the state of d that Follower",
    ),
    _assumed(
        "shaped twice",
        "Shaper flies twice what is asked for",
        ("iris.shaped(filter, control)", "iris.shaped(filter, 2.0 * control)"),
        assumed="Shaper .*what they make of a command belongs to the plants of the proof",
    ),
)
