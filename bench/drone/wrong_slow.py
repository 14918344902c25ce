"""Wrong batteries and planners, and times that are wrong: which text becomes what.

Purpose: `SLOW`, changes to `battery.soter` and `planner.soter`; each is unsafe in a world that is
named with it, or says why no flight can show that.
Non-goals: motion primitive, followers, the whole (`wrong_fast.py`).
"""

from __future__ import annotations

from bench.drone.wrong_base import Edit, World, Wrong

# ---------------------------------------------------------------- battery
BATTERY = "bench/drone/drone_wrong_battery.soter"
EMPTY, RESERVE = "charge > 0.0", "DRAIN"
WORST = (
    Edit("battery.soter", "power: float in [LEAST, MOST]", "power: float in [MOST, MOST]"),
    Edit(
        "battery.soter",
        "{ charge: charge, docked: docked }",
        "{ charge: charge + ERROR, docked: docked }",
    ),
    Edit("battery.soter", "  measured battery.charge within ERROR;\n", ""),
)
"""All the time the most power there may be, and a charge that is shown as high as it may be."""


def _late(shows: str, seeds: int = 4, until_s: float = 3600.0) -> tuple[World, ...]:
    return tuple(
        World(BATTERY, system, until_s, shows, seeds, narrowed=WORST)
        for system in ("Late", "Wavering")
    )


def _battery(
    name: str, words: str, *edits: tuple[str, str], shows: str = RESERVE, why: str = ""
) -> Wrong:
    return Wrong(
        "battery",
        name,
        words,
        tuple(Edit("battery.soter", old, new) for old, new in edits),
        ("battery.soter", "SafeBattery"),
        _late(shows) if not why else (),
        why,
    )


TTF = "ttf margin < E + SPENT * TURN + CELL;"
BATTERIES = (
    _battery("no reserve", "DM acts when nothing is left", (TTF, "ttf margin < 0.0;")),
    _battery(
        "turn forgotten",
        "ttf without the 1.5 s until a landing has begun",
        (TTF, "ttf margin < E;"),
    ),
    _battery(
        "errors forgotten", "ttf without the error of the charge", (TTF, "ttf margin < CELL;")
    ),
    _battery(
        "ttf never",
        "DM looks at a margin that cannot be",
        (TTF, "ttf margin < -10.0;"),
        shows=EMPTY,
    ),
    _battery(
        "cheap landing",
        "a second of landing is counted as 0.9 of what it may cost",
        ("const DRAIN: float = 1.1 * MOST;", "const DRAIN: float = 0.9 * MOST;"),
        shows=EMPTY,
    ),
    _battery(
        "SC flies on", "Land says go", ("publish go = 0.0;", "publish go = 1.0;"), shows=EMPTY
    ),
    _battery(
        "SC hesitates",
        "Land says go until the reserve is overdrawn by a twentieth of the charge",
        (
            "node Land period 500ms {\n  publishes go;\n  step { publish go = 0.0; }",
            (
                "node Land period 500ms {\n  subscribes margin;\n  publishes go;\n"
                "  step { publish go = margin > -0.05 ? 1.0 : 0.0; }"
            ),
        ),
        shows=EMPTY,
    ),
    _battery(
        "slow decision",
        "DM looks every 5 s",
        ("  sc Land;\n  period 500ms;", "  sc Land;\n  period 5s;"),
    ),
    _battery(
        "slow SC",
        "Land speaks every 10 s",
        ("node Land period 500ms", "node Land period 10s"),
        why="the compiler refuses it (P1a)",
    ),
    _battery(
        "slow order",
        "Order hears every 10 s what was decided",
        ("node Order period 100ms", "node Order period 10s"),
    ),
    _battery(
        "slow reserve",
        "Reserve computes every 10 s, and so long its margin counts",
        ("node Reserve period 100ms", "node Reserve period 10s"),
        ("topic margin: float max_age 110ms;", "topic margin: float max_age 10010ms;"),
        (
            "topic battery: Battery = { charge: 1.0, docked: true } max_age 100ms;",
            "topic battery: Battery = { charge: 1.0, docked: true } max_age 20s;",
        ),
    ),
    _battery(
        "slow start",
        "a landing begins up to 2 s after it is asked for",
        ("acts within 110ms;", "acts within 2s;"),
        why="nothing takes time between an output and the world in virtual time",
    ),
)

# ---------------------------------------------------------------- planner
PLANNER = "bench/drone/drone_wrong_planner.soter"
LIES = (World(PLANNER, "Lying", 40.0, "Sound", 4),)
JUDGED = "        let c = Judged(candidate, request);\n        if Proper(c) {\n"
SETTLED = ("const SETTLED: duration = 250ms;", "const SETTLED: duration = {}ms;")


def _planner(name: str, words: str, *edits: tuple[str, ...]) -> Wrong:
    return Wrong(
        "planner",
        name,
        words,
        tuple(
            Edit(e[0], e[1], e[2]) if len(e) == 3 else Edit("planner.soter", e[0], e[1])
            for e in edits
        ),
        ("planner.soter", "SafePlanner"),
        LIES,
    )


SOON = (SETTLED[0], SETTLED[1].format(50))
"""With 250 ms DM sees to it that nothing unfit is ever refused: then what follows harms nobody."""
TRUSTS = (JUDGED, JUDGED.replace("if Proper(c)", "if true"))
REFUSED = "          now.refused = after(now.refused);\n"
COVERED = "          now.corridor = c;\n"
STRAIGHT = """          now.corridor = {
            verdict: boxes.Verdict.Covered,
            blocks: [{ low: request.start, high: request.goal, aim: request.goal }]
          };
          now.number = request.number;
"""
WIDER = "          now.corridor.blocks[0].high.x = c.blocks[0].high.x + 1.0;\n"
FIRST = """const FIRST: InForce = {
  number: 1, corridor: boxes.refused(boxes.Verdict.Empty), adopted: 0, refused: 0,
  reason: boxes.Verdict.Covered, overdue: false,
};
topic inForce: InForce = FIRST;"""
PLANNERS = (
    _planner(
        "θ ≤ H, 50 ms",
        "the follower trusts DM alone, and adopts after 50 ms",
        TRUSTS,
        SOON,
    ),
    _planner(
        "ttf forgets the plan",
        "the follower trusts DM alone, which asks only whether an answer is late, after 100 ms",
        TRUSTS,
        ("ttf !Fits(candidate, request) || inForce.overdue;", "ttf inForce.overdue;"),
        (SETTLED[0], SETTLED[1].format(100)),
    ),
    _planner(
        "checks what was there",
        "the candidate is judged while it is young, another one adopted",
        ("  var judged: bool;", "  var good: bool;\n  var judged: bool;"),
        (
            "      judged = false;\n",
            "      judged = false;\n      good = Proper(Judged(candidate, request));\n",
        ),
        (JUDGED, JUDGED.replace("if Proper(c)", "if good")),
        SOON,
    ),
    _planner(
        "adopts, then looks",
        "the corridor changes before it is judged, after 50 ms",
        (
            JUDGED,
            JUDGED.replace("        if Proper", "        now.corridor = c;\n        if Proper"),
        ),
        SOON,
    ),
    _planner(
        "refused, but answered",
        "a refused plan counts as the answer to its request, after 50 ms",
        (REFUSED, REFUSED + COVERED + "          now.number = request.number;\n"),
        SOON,
    ),
    _planner(
        "in force from the start",
        "there is a plan in force before there is one",
        ("  var now: InForce;\n", "  var now: InForce = FIRST;\n"),
        ("topic inForce: InForce;", FIRST),
    ),
    _planner(
        "changed after the check",
        "the first aim becomes where the vehicle was, when the corridor was found sound",
        (COVERED, COVERED + "          now.corridor.blocks[0].aim = request.start;\n"),
    ),
    _planner(
        "wider than checked",
        "a metre of room is added to what was found sound",
        (COVERED, COVERED + WIDER),
    ),
    _planner(
        "straight on",
        "what cannot be covered is flown in one box, after 50 ms",
        (REFUSED, REFUSED + STRAIGHT),
        SOON,
    ),
    _planner(
        "no inflation",
        "Cover keeps no clearance from walls and does not ask Sound, the follower believes it",
        (
            "return c.verdict == boxes.Verdict.Covered && boxes.Sound(c.blocks);",
            "return c.verdict == boxes.Verdict.Covered;",
        ),
        ("cover.soter", "&& !(boxes.Sound(c.blocks) && boxes", "&& !(boxes"),
        ("cover.soter", "boxes.THICK[", "boxes.SOLID["),
    ),
)
SLOW = (*BATTERIES, *PLANNERS)

# ---------------------------------------------------------------- what is assumed of the battery
ABSTRACT = "b behaves like"


def _taken(name: str, words: str, *edits: tuple[str, str], shows: str = EMPTY) -> Wrong:
    return Wrong(
        "assumed",
        name,
        words,
        tuple(Edit("battery.soter", old, new) for old, new in edits),
        ("battery.soter", "SafeBattery"),
        _late(shows),
        assumed=ABSTRACT,
    )


TAKEN = (
    _taken(
        "cost forgotten",
        "the margin is the charge: a landing costs nothing",
        ("publish margin = battery.charge - DRAIN * now.left;", "publish margin = battery.charge;"),
    ),
    _taken(
        "mode one instant early",
        "a landing begins only where the mode is still AC",
        ("    if !onwards {\n", "    if !onwards && mode(SafeBattery) == Mode.AC {\n"),
    ),
    _taken(
        "a hungry camera",
        "a mission costs five times what the proof knows",
        ("const CAMERA: float = 0.05 * NOMINAL;", "const CAMERA: float = 8.0 * NOMINAL;"),
        shows=RESERVE,
    ),
)
