"""Wrong modules because of sets: outputs, disturbances, errors, inputs, and vacuous predicates.

Purpose: `SETS`.
Non-goals: SC (`controllers.py`).
"""

from __future__ import annotations

from functools import partial

from bench.wrong_modules.base import CART, LINE, MAP, RUN, SIGHT, Base, Edit, Shown, Wrong, under
from bench.wrong_modules.controllers import careful, declared, one

of_gates = partial(one, "gates")
GATES = (
    of_gates(
        "the output's default pushes to the wall, and SC comes late",
        "from 0.8 on the default acts for 300 ms, until SC's first step",
        (
            ("= 0.0;\n\nplant", "= 1.0;\n\nplant"),
            ("state x: float = 0.0;", "state x: float = 0.8;"),
            ("node Careful period 50ms", "node Careful period 400ms phase 300ms"),
            ("  period 50ms;\n  safe", "  period 400ms;\n  safe"),
            ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-2.0 * pos, -1.0, 1.0);"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.1"),
            ("safer abs(pos) < 0.5", "safer abs(pos) < 0.05"),
        ),
    ),
    of_gates(
        "the output's default lies outside of its set",
        "what acts before anything is published is not in U",
        (("= 0.0;\n\nplant", "= 30.0;\n\nplant"),),
        None,
        codes=("V001", "V002", "V004", "V009"),
    ),
    of_gates(
        "the set is far larger than what the plant was thought to take",
        "AC may publish 30, and no look-ahead of 0.3 is enough",
        (("float in [-1.0, 1.0] = 0.0;", "float in [-30.0, 30.0] = 0.0;"),),
        under(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 30.0;")),
    ),
    of_gates(
        "a second output that SC never publishes",
        "AC leaves `brake` at its worst, and SC does not touch it",
        (
            (
                "topic push: float in [-1.0, 1.0] = 0.0;",
                "topic push: float in [-1.0, 1.0] = 0.0;\ntopic pull: float in [0.0, 2.0] = 0.0;",
            ),
            ("  reads push;", "  reads push, pull;"),
            ("der x = push;", "der x = push + pull;"),
            (
                "publishes push;\n  step { publish push = pos >=",
                "publishes push, pull;\n  step { publish pull = 2.0; publish push = pos >=",
            ),
            (
                "publishes push;\n  step { publish push = clamp",
                "publishes push, pull;\n  step { publish push = clamp",
            ),
        ),
    ),
    of_gates(
        "a second output that SC publishes only at rest",
        "AC leaves `pull` at its worst until SC is at rest",
        (
            (
                "topic push: float in [-1.0, 1.0] = 0.0;",
                "topic push: float in [-1.0, 1.0] = 0.0;\ntopic pull: float in [0.0, 2.0] = 0.0;",
            ),
            ("  reads push;", "  reads push, pull;"),
            ("der x = push;", "der x = push + pull;"),
            (
                "publishes push;\n  step { publish push = pos >=",
                "publishes push, pull;\n  step { publish pull = 2.0; publish push = pos >=",
            ),
            (
                "publishes push;\n  step { publish push = clamp",
                (
                    "publishes push, pull;\n  step { if abs(pos) < 0.3 { publish pull = 0.0; }"
                    " publish push = clamp"
                ),
            ),
        ),
    ),
    of_gates(
        "an output of which the plant takes the third power",
        "the plant amplifies what the gate lets pass",
        (
            ("float in [-1.0, 1.0] = 0.0;", "float in [-3.0, 3.0] = 0.0;"),
            ("der x = push;", "der x = push * push * push;"),
        ),
        under(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 3.0;")),
    ),
)

of_ranges = partial(one, "ranges")
RANGES = (
    of_ranges(
        "a disturbance as strong as SC",
        "nothing holds against it",
        (("  der x = push;", "  disturbance w: float in [1.1, 1.1];\n  der x = push + w;"),),
    ),
    of_ranges(
        "a disturbance on one side only",
        "zero at its low end, 1.5 at its high end",
        (("  der x = push;", "  disturbance w: float in [0.0, 1.5];\n  der x = push + w;"),),
        None,
    ),
    of_ranges(
        "an error of measurement as large as C",
        "the DM sees anything",
        (("  der x = push;\n}", "  der x = push;\n  measured pos within 0.9;\n}"),),
        Shown(
            ("run", "--until", "300s"),
            (("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 1.0;"),),
        ),
    ),
    of_ranges(
        "an error where only the DM looks",
        "`ttf` reads the blurred topic, SC the exact one",
        (
            (
                "topic pos: float max_age 20ms;",
                "topic pos: float max_age 20ms;\ntopic est: float max_age 20ms;",
            ),
            ("drives pos = x;", "drives pos = x;\n  drives est = x;"),
            ("  der x = push;\n}", "  der x = push;\n  measured est within 0.5;\n}"),
            ("ttf abs(pos) > 0.7", "ttf abs(est) > 0.7"),
            ("safer abs(pos) < 0.5", "safer abs(est) < 0.5"),
        ),
    ),
    of_ranges(
        "an initial range that reaches beyond C",
        "it may start at 1.4",
        (("state x: float = 0.0;", "state x: float in [-1.4, 1.4];"),),
        Shown(("run", "--seed", "1")),
    ),
    of_ranges(
        "an initial range that leaves no time",
        "it may start at 0.999",
        (
            ("state x: float = 0.0;", "state x: float in [-0.999, 0.999];"),
            ("= 0.0;\n\nplant", "= 1.0;\n\nplant"),
            ("node Careful period 50ms", "node Careful period 50ms phase 40ms"),
        ),
        under(("state x: float in [-0.999, 0.999];", "state x: float = 0.999;")),
    ),
    of_ranges(
        "a constant of the plant that is drawn at the start",
        "the plant's gain is anything up to 14",
        (
            (
                "  state x: float = 0.0;",
                "  state x: float = 0.0;\n  state g: float in [1.0, 14.0];",
            ),
            ("der x = push;", "der x = g * push;"),
            (
                "grid pos in [-1.0, 1.0] / 80;",
                "grid pos in [-1.0, 1.0] / 80; grid p.g in [1.0, 14.0] / 8;",
            ),
        ),
        under(("state g: float in [1.0, 14.0];", "state g: float = 13.0;")),
    ),
    of_ranges(
        "the model beside the flying plant knows no wind",
        "the body has a wind of 1, its model none: that it behaves like it is assumed, and wrong",
        (
            (
                "drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
                (
                    "drives raw = x;\n  state x: float = 0.0;\n  disturbance w:"
                    " float in [1.1, 1.1];\n"
                    "  der x = push + w;"
                ),
            ),
        ),
        RUN,
        SIGHT,
        named=(r"b behaves like m",),
    ),
    of_ranges(
        "the model beside the flying plant starts elsewhere",
        "the body starts at 1.2, its model at 0: the map says where a run starts",
        (("drives raw = x;\n  state x: float = 0.0;", "drives raw = x;\n  state x: float = 1.2;"),),
        RUN,
        SIGHT,
    ),
    of_ranges(
        "an input topic that SC follows out of C",
        "SC goes to the goal, which may be at 1.5",
        (
            declared("input topic goal: float in [-1.5, 1.5] = 0.0;"),
            ("module Keep; until", "module Keep; input goal in { 1.5 } every 3s; until"),
            *careful("publish push = clamp(4.0 * (goal - pos), -1.0, 1.0);", reads="pos, goal"),
        ),
    ),
    of_ranges(
        "an input topic by which SC divides",
        "the input may be zero: SC is latched",
        (
            declared("input topic scale: float in [0.0, 1.0] = 1.0;"),
            ("module Keep; until", "module Keep; input scale in { 0.0 } every 3s; until"),
            *careful("publish push = clamp(-4.0 * pos / scale, -1.0, 1.0);", reads="pos, scale"),
        ),
    ),
    of_ranges(
        "a switch that somebody else sets",
        "`stop` is true after 3 s, and SC does not do what it should",
        (
            declared(
                "topic stop: bool;\n"
                "node Stopper period 50ms { publishes stop; step { publish stop = time > 3.0; }"
                " }"
            ),
            ("{ p: Line; module Keep;", "{ p: Line; node Stopper; module Keep;"),
            *careful(
                "publish push = stop ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);", reads="pos, stop"
            ),
        ),
    ),
    of_ranges(
        "a phase that somebody else sets",
        "in phase Land SC pushes right",
        (
            declared(
                "type Phase = enum { Climb, Land };\ntopic phase_now: Phase;\n"
                "node Phases period 50ms { publishes phase_now;"
                " step { publish phase_now = time > 3.0 ? Phase.Land : Phase.Climb; } }"
            ),
            ("{ p: Line; module Keep;", "{ p: Line; node Phases; module Keep;"),
            *careful(
                "publish push = phase_now == Phase.Land ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                reads="pos, phase_now",
            ),
        ),
    ),
    of_ranges(
        "a gear that somebody else sets",
        "in gear 9 SC pushes right",
        (
            declared(
                "topic gear: int in [0, 9];\n"
                "node Gears period 50ms { publishes gear; step { publish gear ="
                " time > 3.0 ? 9 : 0; } }"
            ),
            ("{ p: Line; module Keep;", "{ p: Line; node Gears; module Keep;"),
            *careful(
                "publish push = gear > 8 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);", reads="pos, gear"
            ),
        ),
    ),
    of_ranges(
        "`ttf` believes a switch that somebody else sets",
        "true: nobody hands over",
        (
            declared(
                "topic sure: bool;\n"
                "node Sure period 50ms { publishes sure; step { publish sure = true; } }"
            ),
            ("{ p: Line; module Keep;", "{ p: Line; node Sure; module Keep;"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && !sure"),
        ),
    ),
    of_ranges(
        "a node's topic that SC trusts",
        "`bias` may be 1 by its set, and the node publishes that",
        (
            declared(
                "topic bias: float in [-1.0, 1.0] = 0.0;\n"
                "node Biased period 50ms { publishes bias; step { publish bias = 1.0; } }"
            ),
            ("{ p: Line; module Keep;", "{ p: Line; node Biased; module Keep;"),
            *careful("publish push = clamp(bias - 0.5 * pos, -1.0, 1.0);", reads="pos, bias"),
        ),
    ),
)

SCHEMES = (
    of_ranges(
        "a stiff plant, and Euler's scheme",
        "the equation is stable, what runs is not: each step of 10 ms turns the sign and doubles",
        (
            ("der x = push;", "der x = push - 300.0 * x;\n  integrate euler;"),
            ("state x: float = 0.0;", "state x: float = 0.01;"),
        ),
        RUN,
        named=(r"not the simulator's scheme",),
    ),
    of_ranges(
        "a stiff plant, and the scheme of Runge and Kutta",
        "the equation is stable, what runs is not",
        (
            ("der x = push;", "der x = push - 320.0 * x;"),
            ("state x: float = 0.0;", "state x: float = 0.01;"),
        ),
        RUN,
        named=(r"not the simulator's scheme",),
    ),
    of_ranges(
        "a plant that stops beyond the topic's set",
        "beyond 0.6 it publishes nothing and stands still for ever",
        (("topic pos: float max_age", "topic pos: float in [-0.6, 0.6] max_age"),),
        RUN,
        named=(r"declared sets",),
    ),
    of_ranges(
        "`ttf` believes an input topic",
        "where the input says so nobody hands over",
        (
            declared("input topic knob: float in [-1.0, 1.0] = -1.0;"),
            ("module Keep; until", "module Keep; input knob in { -1.0 } every 3s; until"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && knob > 0.0"),
        ),
    ),
    of_ranges(
        "a promise to give control back within 100 ms",
        "from 0.7 to 0.5 it takes 200 ms at least",
        (("    acts within 0ms;", "    acts within 0ms;\n    recover within 100ms;"),),
        None,
    ),
)

IDLE = "AC never has control: nothing is assured, because nothing is allowed"
SAYS_IDLE = (r"(?i)\bAC\b[^\n]*\b(never|hardly|no control|cannot|nowhere)", r"(?i)vacuous")


def empty(
    name: str, why: str, *edits: Edit, named: tuple[str, ...] = SAYS_IDLE, base: Base = LINE
) -> Wrong:
    """A predicate that says nothing; to be said in the headline."""
    return one("vacuous", name, why, edits, None, base, named=named)


VACUOUS = (
    empty("`ttf true`", IDLE, ("ttf abs(pos) > 0.7", "ttf true")),
    empty("`ttf` that always holds, in words", IDLE, ("ttf abs(pos) > 0.7", "ttf abs(pos) >= 0.0")),
    empty(
        "`ttf` of a square that is never negative",
        IDLE,
        ("ttf abs(pos) > 0.7", "ttf pos * pos > -1.0"),
    ),
    empty(
        "`ttf` but in a thousandth of C",
        IDLE,
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.0005"),
        ("safer abs(pos) < 0.5", "safer abs(pos) < 0.5"),
    ),
    empty("`safer` that holds nowhere", IDLE, ("safer abs(pos) < 0.5", "safer abs(pos) > 3.0")),
    empty("`safer false`", IDLE, ("safer abs(pos) < 0.5", "safer false")),
    empty("`safer` at one point", IDLE, ("safer abs(pos) < 0.5", "safer pos == 0.0")),
    empty("a constraint that holds nowhere", "C is empty", ("safe abs(pos) < 1.0", "safe false")),
    empty(
        "`ttf` holds wherever `safer` does",
        "what is given back is taken at once",
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 || abs(pos) < 0.6"),
    ),
    empty("a cart with `ttf true`", IDLE, ("ttf !Fits(motion, 0.3)", "ttf true"), base=CART),
    empty("a map with `ttf true`", IDLE, ("ttf abs(pos) > 0.7", "ttf true"), base=MAP),
    empty(
        "a horizon so long that computed sets are empty",
        "R(H) is empty: the table says `ttf` everywhere",
        ("  ttf abs(pos) > 0.7;\n", ""),
        ("  safer abs(pos) < 0.5;\n", ""),
        ("    acts within 0ms;", "    acts within 0ms;\n    horizon 5s;"),
    ),
)

SETS = (*GATES, *RANGES, *SCHEMES, *VACUOUS)
