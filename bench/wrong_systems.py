"""Wrong modules because of where they stand, with which parameters, and under which sets.

Purpose: `SYSTEMS`: several systems that hold a module, parameters, outputs' defaults, ranges that
say less than the plant does, and predicates that are vacuous.
Non-goals: SC (`wrong_controllers.py`), paths (`wrong_paths.py`), time (`wrong_timing.py`).
"""

from __future__ import annotations

from bench.wrong_base import CART, LINE, MAP, RUN, SIGHT, Base, Edit, Shown, Wrong, under
from bench.wrong_controllers import FAST, careful, declared, one

WORLD = "system World default"
ALWAYS = "until 10s; always abs(p.truth.x) < 1.0; }"
OTHER = Shown(("run", "--system", "Other"))
NAMES_OTHER = (r"in system Other: .*",)
"""With a reason: a system that is listed as *the same problem* is no answer."""


def also(name: str, why: str, other: str, *edits: Edit, base: Base = LINE,
         shown: Shown | None = OTHER) -> Wrong:
    """A second system with the same module."""
    return one("systems", name, why, (*edits, (WORLD, f"{other}\n{WORLD}")), shown, base,
               named=NAMES_OTHER)


def plant(name: str, body: str) -> str:
    """Another plant for LINE."""
    return f"plant {name} period 10ms {{ reads push; drives pos = x; {body} }}\n"


def other(parts: str, end: str = ALWAYS) -> str:
    """Another system."""
    return f"system Other {{ {parts} {end}"


ELSEWHERE = "in the default system it is right; in `Other` it leaves C"

SEVERAL = (
    also("another plant: a wind as strong as SC", ELSEWHERE,
         plant("Windy", "state x: float = 0.0; disturbance w: float in [1.1, 1.1];"
                        " der x = push + w;") + other("p: Windy; module Keep;")),
    also("another plant: the wires crossed", ELSEWHERE,
         plant("Crossed", "state x: float = 0.0; der x = -push;")
         + other("p: Crossed; module Keep;"),
         shown=Shown(("run", "--system", "Other"),
                     (("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = -1.0;"),))),
    also("another plant: 13 times as fast", ELSEWHERE,
         plant("Quick", "state x: float = 0.0; der x = 13.0 * push;")
         + other("p: Quick; module Keep;")),
    also("another plant: unstable", ELSEWHERE,
         plant("Falls", "state x: float = 0.0; der x = push + 3.0 * x;")
         + other("p: Falls; module Keep;")),
    also("another plant: it starts outside", ELSEWHERE,
         plant("Far", "state x: float = 1.2; der x = push;") + other("p: Far; module Keep;")),
    also("another plant: publishes every three seconds", ELSEWHERE,
         "plant Slow period 3s { reads push; drives pos = x; state x: float = 0.6; der x = push; }\n"
         + other("p: Slow; module Keep;")),
    also("another plant: its gauge is off by 0.5", ELSEWHERE,
         "plant Off period 10ms { reads push; drives pos = x - 0.5; state x: float = 0.6;"
         " der x = push; }\n" + other("p: Off; module Keep;")),
    also("another plant: with a mass", ELSEWHERE,
         plant("Lags", "state x: float = 0.0; state v: float = 0.0; der x = v; der v = push;")
         + other("p: Lags; module Keep;")),
    also("forced to AC", "the DM never switches there",
         other("p: Line; module Keep; force Keep ac;")),
    also("SC replaced", "another SC stands there",
         "node Rash period 50ms { subscribes pos; publishes push;"
         " step { publish push = pos > 0.5 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0); } }\n"
         + other("p: Line; module Keep; replace Keep.Careful by Rash;")),
    also("an estimator between", ELSEWHERE,
         "topic raw: float max_age 20ms;\n"
         "plant Bare period 10ms { reads push; drives raw = x; state x: float = 0.0;"
         " der x = push; }\n"
         "node Scope period 10ms { subscribes raw; publishes pos; var at: float = 0.0;"
         " step { at = at + 0.016 * (raw - at); publish pos = at; } }\n"
         + other("p: Bare; node Scope; module Keep;")),
    also("another estimator before the flying plant", "the other one filters",
         "node Filter period 10ms { subscribes raw; publishes pos; var at: float = 0.0;"
         " step { at = at + 0.016 * (raw - at); publish pos = at; } }\n"
         "system Other { b: Body; node Filter; module Keep; until 10s;"
         " always abs(b.truth.x) < 1.0; }", base=SIGHT),
    also("another flying plant behind the same abstraction", "it flies four times as fast",
         "plant Quick period 10ms { reads push; drives raw = x; state x: float = 0.0;"
         " der x = 13.0 * push; }\n"
         "system Other { b: Quick; node Scope; module Keep; until 10s;"
         " always abs(b.truth.x) < 1.0; }", base=SIGHT),
    also("an actuator that holds half a second", ELSEWHERE,
         "topic force: float in [-1.0, 1.0] = 0.0;\n"
         "plant Driven period 10ms { reads force; drives pos = x; state x: float = 0.0;"
         " der x = force; }\n"
         "node Servo period 500ms { subscribes push; publishes force;"
         " step { publish force = push; } }\n"
         + other("p: Driven; node Servo; module Keep;")),
    also("a parameter set there", "`set GAIN` turns SC round",
         other("p: Line; module Keep; set GAIN = -4.0;"),
         declared("param GAIN: float = 4.0 in [-9.0, 9.0];"),
         ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-GAIN * pos, -1.0, 1.0);")),
    also("inside a bigger system, with other wires",
         "the outer system wires the module's own topic to another plant's",
         plant("Quick", "state x: float = 0.0; der x = 13.0 * push;")
         + "system Part { p: Quick; module Keep; }\n"
         "system Other { a: Part; until 10s; always abs(a.p.truth.x) < 1.0; }"),
    also("a map: another plant", ELSEWHERE,
         "plant Hasty period 50ms { reads push; drives pos = x; state x: float = 0.0;"
         " next x = x + 0.5 * push; }\n" + other("p: Hasty; module Keep;"), base=MAP),
    also("a cart: a heavier one", ELSEWHERE,
         "plant Heavy period 10ms { reads accel; drives motion = { x: x, v: v };"
         " state x: float = 0.0; state v: float = 0.0; der x = v; der v = 0.2 * accel; }\n"
         "system Other { c: Heavy; module Keep; until 20s; always abs(c.truth.x) < 4.0; }",
         base=CART),
    also("two modules on one plant: the second one pulls as well",
         "in `Other` a second module's output moves the plant, too",
         "topic pull: float in [-1.0, 1.0] = 0.0;\n"
         "plant Shared period 10ms { reads push, pull; drives pos = x; state x: float = 0.0;"
         " der x = push + 2.0 * pull; }\n"
         "node A2 period 50ms { publishes pull; step { publish pull = 1.0; } }\n"
         "node S2 period 50ms { publishes pull; step { publish pull = 1.0; } }\n"
         "rta Two { ac A2; sc S2; period 50ms; safe true; ttf true; safer false; }\n"
         + other("p: Shared; module Keep; module Two;")),
    also("another estimator of the same name", "`replace` puts a wrong sign there",
         "node Turned period 10ms { subscribes raw; publishes pos; step { publish pos = -raw; } }\n"
         "system Other { b: Body; node Scope; replace Scope by Turned; module Keep; until 10s;"
         " always abs(b.truth.x) < 1.0; }", base=SIGHT,
         shown=Shown(("run", "--system", "Other"), (
             ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 1.0;"),))),
    also("another plant behind the same abstraction, that starts outside", ELSEWHERE,
         "plant Far period 10ms { reads push; drives raw = x; state x: float = 1.2;"
         " der x = push; }\n"
         "system Other { b: Far; node Scope; module Keep; until 10s;"
         " always abs(b.truth.x) < 1.0; }", base=SIGHT),
    also("a threshold of `ttf` set there", "AC flies on until 1.2",
         other("p: Line; module Keep; set FAR = 1.2;"),
         declared("param FAR: float = 0.7 in [0.0, 2.0];"),
         ("ttf abs(pos) > 0.7", "ttf abs(pos) > FAR")),
    also("the output's set is larger there", "AC publishes 30",
         other("p: Line; module Keep; set MAX = 30.0;"),
         declared("param MAX: float = 1.0 in [0.0, 90.0];"),
         ("topic push: float in [-1.0, 1.0]", "topic push: float in [-MAX, MAX]"),
         ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = MAX;")),
    also("the wind is a parameter there", ELSEWHERE,
         other("p: Line; module Keep; set GUST = 4.0;"),
         declared("param GUST: float = 0.1 in [0.0, 5.0];"),
         ("der x = push;", "der x = push + GUST;")),
    also("the flying plant's wind is a parameter there", ELSEWHERE,
         "system Other { b: Body; node Scope; module Keep; set GUST = 4.0; until 10s;"
         " always abs(b.truth.x) < 1.0; }",
         declared("param GUST: float = 0.0 in [0.0, 5.0];"),
         ("drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
          "drives raw = x;\n  state x: float = 0.0;\n  der x = push + GUST;"), base=SIGHT),
    one("systems", "forced to AC in the only system", "the DM never switches",
        (("module Keep; until", "module Keep; force Keep ac; until"),), RUN, named=(r"forced",)),
    one("systems", "two instances of the module in one system, one plant of them too fast",
        "the second instance has another plant",
        ((WORLD, plant("Quick", "state x: float = 0.0; der x = 13.0 * push;")
          + "system Left { p: Line; module Keep; }\nsystem Right { p: Quick; module Keep; }\n"
          + WORLD),
         ("{ p: Line; module Keep; until 10s; always abs(p.truth.x) < 1.0; }",
          "{ l: Left; r: Right; until 10s; always abs(r.p.truth.x) < 1.0; }")),
        named=(r"\bRight\b",)),
)

VALUES = "it is proved for one value of the parameter only, and wrong for others in its range"


def param(name: str, why: str, said: str, setting: str, *edits: Edit,
          base: Base = LINE, edits_of_run: tuple[Edit, ...] = ()) -> Wrong:
    """A parameter whose default is right."""
    word = setting.partition("=")[0]
    return one("parameters", name, why, (declared(said), *edits),
               Shown(("run", "--set", setting), edits_of_run), base, named=(rf"(?m)^(?!.*warning).*\b{word}\b",))


PARAMETERS = (
    param("SC's gain", VALUES, "param GAIN: float = 4.0 in [-9.0, 9.0];", "GAIN=-4.0",
          ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-GAIN * pos, -1.0, 1.0);")),
    param("SC's gain, without a range", VALUES, "param GAIN: float = 4.0;", "GAIN=-1.0",
          ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-GAIN * pos, -1.0, 1.0);")),
    param("the plant's gain", VALUES, "param POWER: float = 1.0 in [0.0, 20.0];", "POWER=13.0",
          ("der x = push;", "der x = POWER * push;")),
    param("the threshold of `ttf`", VALUES, "param FAR: float = 0.7 in [0.0, 2.0];", "FAR=1.2",
          ("ttf abs(pos) > 0.7", "ttf abs(pos) > FAR")),
    param("the period of the DM", VALUES, "param EVERY: duration = 50ms;", "EVERY=500ms",
          ("  period 50ms;\n  safe", "  period EVERY;\n  safe")),
    param("the wind", VALUES, "param GUST: float = 0.1 in [0.0, 5.0];", "GUST=4.0",
          ("der x = push;", "der x = push + GUST;")),
    param("the initial state", VALUES, "param START: float = 0.0 in [-2.0, 2.0];", "START=1.5",
          ("state x: float = 0.0;", "state x: float = START;")),
    param("a switch that turns SC off", VALUES, "param OFF: bool = false;", "OFF=true",
          ("clamp(-4.0 * pos, -1.0, 1.0);", "OFF ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);")),
    param("the set of the output", VALUES, "param MAX: float = 1.0 in [0.0, 90.0];", "MAX=30.0",
          ("topic push: float in [-1.0, 1.0]", "topic push: float in [-MAX, MAX]"),
          edits_of_run=(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = MAX;"),)),
    param("the constraint", VALUES, "param WALL: float = 1.0 in [0.1, 9.0];", "WALL=0.3",
          ("safe abs(pos) < 1.0", "safe abs(pos) < WALL"),
          ("always abs(p.truth.x) < 1.0", "always abs(p.truth.x) < WALL")),
    param("the period of the sensor", VALUES, "param TICK: duration = 10ms;", "TICK=3s",
          ("plant Line period 10ms", "plant Line period TICK"),
          ("state x: float = 0.0;", "state x: float = 0.6;")),
    one("parameters", "a plant's parameter that somebody may change while it matters",
        "a load of 3 makes the plant four times as fast; nothing keeps it from changing at 0.69",
        (("  state x: float = 0.0;", "  state x: float = 0.0;\n  state load: int in [0, 3] = 0;"),
         ("der x = push;", "der x = (1.0 + float(load)) * push;"),
         ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.65")), None,
        named=(r"load changes only",)),
    one("parameters", "a plant's parameter for one value of which the wires are crossed",
        "sign 1 is wrong", (
            ("  state x: float = 0.0;", "  state x: float = 0.0;\n  state s: int in [0, 1] = 0;"),
            ("der x = push;", "der x = s == 1 ? -push : push;")),
        under(("state s: int in [0, 1] = 0;", "state s: int in [0, 1] = 1;"),
              ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = -1.0;"))),
)

GATES = (
    one("gates", "the output's default pushes to the wall, and SC comes late",
        "from 0.8 on the default acts for 300 ms, until SC's first step", (
            ("= 0.0;\n\nplant", "= 1.0;\n\nplant"),
            ("state x: float = 0.0;", "state x: float = 0.8;"),
            ("node Careful period 50ms", "node Careful period 400ms phase 300ms"),
            ("  period 50ms;\n  safe", "  period 400ms;\n  safe"),
            ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-2.0 * pos, -1.0, 1.0);"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.1"),
            ("safer abs(pos) < 0.5", "safer abs(pos) < 0.05"))),
    one("gates", "the output's default lies outside of its set",
        "what acts before anything is published is not in U",
        (("= 0.0;\n\nplant", "= 30.0;\n\nplant"),), None, codes=("V001", "V002", "V004", "V009")),
    one("gates", "the set is far larger than what the plant was thought to take",
        "AC may publish 30, and no look-ahead of 0.3 is enough",
        (("float in [-1.0, 1.0] = 0.0;", "float in [-30.0, 30.0] = 0.0;"),),
        under(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 30.0;"))),
    one("gates", "a second output that SC never publishes",
        "AC leaves `brake` at its worst, and SC does not touch it",
        (("topic push: float in [-1.0, 1.0] = 0.0;",
          "topic push: float in [-1.0, 1.0] = 0.0;\ntopic pull: float in [0.0, 2.0] = 0.0;"),
         ("  reads push;", "  reads push, pull;"), ("der x = push;", "der x = push + pull;"),
         ("publishes push;\n  step { publish push = pos >=",
          "publishes push, pull;\n  step { publish pull = 2.0; publish push = pos >="),
         ("publishes push;\n  step { publish push = clamp",
          "publishes push, pull;\n  step { publish push = clamp"))),
    one("gates", "a second output that SC publishes only at rest",
        "AC leaves `pull` at its worst until SC is at rest",
        (("topic push: float in [-1.0, 1.0] = 0.0;",
          "topic push: float in [-1.0, 1.0] = 0.0;\ntopic pull: float in [0.0, 2.0] = 0.0;"),
         ("  reads push;", "  reads push, pull;"), ("der x = push;", "der x = push + pull;"),
         ("publishes push;\n  step { publish push = pos >=",
          "publishes push, pull;\n  step { publish pull = 2.0; publish push = pos >="),
         ("publishes push;\n  step { publish push = clamp",
          "publishes push, pull;\n  step { if abs(pos) < 0.3 { publish pull = 0.0; }"
          " publish push = clamp"))),
    one("gates", "an output of which the plant takes the third power",
        "the plant amplifies what the gate lets pass",
        (("float in [-1.0, 1.0] = 0.0;", "float in [-3.0, 3.0] = 0.0;"),
         ("der x = push;", "der x = push * push * push;")),
        under(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 3.0;"))),
)

RANGES = (
    one("ranges", "a disturbance as strong as SC", "nothing holds against it",
        (("  der x = push;", "  disturbance w: float in [1.1, 1.1];\n  der x = push + w;"),)),
    one("ranges", "a disturbance on one side only", "zero at its low end, 1.5 at its high end",
        (("  der x = push;", "  disturbance w: float in [0.0, 1.5];\n  der x = push + w;"),), None),
    one("ranges", "an error of measurement as large as C", "the DM sees anything",
        (("  der x = push;\n}", "  der x = push;\n  measured pos within 0.9;\n}"),),
        Shown(("run", "--until", "300s"),
              (("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 1.0;"),))),
    one("ranges", "an error where only the DM looks",
        "`ttf` reads the blurred topic, SC the exact one", (
            ("topic pos: float max_age 20ms;",
             "topic pos: float max_age 20ms;\ntopic est: float max_age 20ms;"),
            ("drives pos = x;", "drives pos = x;\n  drives est = x;"),
            ("  der x = push;\n}", "  der x = push;\n  measured est within 0.5;\n}"),
            ("ttf abs(pos) > 0.7", "ttf abs(est) > 0.7"),
            ("safer abs(pos) < 0.5", "safer abs(est) < 0.5"))),
    one("ranges", "an initial range that reaches beyond C", "it may start at 1.4",
        (("state x: float = 0.0;", "state x: float in [-1.4, 1.4];"),),
        Shown(("run", "--seed", "1"))),
    one("ranges", "an initial range that leaves no time", "it may start at 0.999",
        (("state x: float = 0.0;", "state x: float in [-0.999, 0.999];"),
         ("= 0.0;\n\nplant", "= 1.0;\n\nplant"),
         ("node Careful period 50ms", "node Careful period 50ms phase 40ms")),
        under(("state x: float in [-0.999, 0.999];", "state x: float = 0.999;"))),
    one("ranges", "a constant of the plant that is drawn at the start",
        "the plant's gain is anything up to 14",
        (("  state x: float = 0.0;", "  state x: float = 0.0;\n  state g: float in [1.0, 14.0];"),
         ("der x = push;", "der x = g * push;"),
         ("grid pos in [-1.0, 1.0] / 80;", "grid pos in [-1.0, 1.0] / 80; grid p.g in [1.0, 14.0] / 8;")),
        under(("state g: float in [1.0, 14.0];", "state g: float = 13.0;"))),
    one("ranges", "the model beside the flying plant knows no wind",
        "the body has a wind of 1, its model none: that it behaves like it is assumed, and wrong",
        (("drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
          "drives raw = x;\n  state x: float = 0.0;\n  disturbance w: float in [1.1, 1.1];\n"
          "  der x = push + w;"),), RUN, SIGHT, named=(r"b behaves like m",)),
    one("ranges", "the model beside the flying plant starts elsewhere",
        "the body starts at 1.2, its model at 0: where it starts is assumed, and wrong",
        (("drives raw = x;\n  state x: float = 0.0;", "drives raw = x;\n  state x: float = 1.2;"),),
        RUN, SIGHT, named=(r"initial states of m", r"starts")),
    one("ranges", "an input topic that SC follows out of C",
        "SC goes to the goal, which may be at 1.5", (
            declared("input topic goal: float in [-1.5, 1.5] = 0.0;"),
            ("module Keep; until", "module Keep; input goal in { 1.5 } every 3s; until"),
            *careful("publish push = clamp(4.0 * (goal - pos), -1.0, 1.0);", reads="pos, goal"))),
    one("ranges", "an input topic by which SC divides", "the input may be zero: SC is latched", (
        declared("input topic scale: float in [0.0, 1.0] = 1.0;"),
        ("module Keep; until", "module Keep; input scale in { 0.0 } every 3s; until"),
        *careful("publish push = clamp(-4.0 * pos / scale, -1.0, 1.0);", reads="pos, scale"))),
    one("ranges", "a node's topic that SC trusts",
        "`bias` may be 1 by its set, and the node publishes that", (
            declared("topic bias: float in [-1.0, 1.0] = 0.0;\n"
                     "node Biased period 50ms { publishes bias; step { publish bias = 1.0; } }"),
            ("{ p: Line; module Keep;", "{ p: Line; node Biased; module Keep;"),
            *careful("publish push = clamp(bias - 0.5 * pos, -1.0, 1.0);", reads="pos, bias"))),
)

SCHEMES = (
    one("ranges", "a stiff plant, and Euler's scheme",
        "the equation is stable, what runs is not: each step of 10 ms turns the sign and doubles",
        (("der x = push;", "der x = push - 300.0 * x;\n  integrate euler;"),
         ("state x: float = 0.0;", "state x: float = 0.01;")), RUN,
        named=(r"not the simulator's scheme",)),
    one("ranges", "a stiff plant, and the scheme of Runge and Kutta",
        "the equation is stable, what runs is not",
        (("der x = push;", "der x = push - 320.0 * x;"),
         ("state x: float = 0.0;", "state x: float = 0.01;")), RUN,
        named=(r"not the simulator's scheme",)),
    one("ranges", "a plant that stops beyond the topic's set",
        "beyond 0.6 it publishes nothing and stands still for ever", (
            ("topic pos: float max_age", "topic pos: float in [-0.6, 0.6] max_age"),), RUN,
        named=(r"declared sets",)),
    one("ranges", "`ttf` believes an input topic", "where the input says so nobody hands over", (
        declared("input topic knob: float in [-1.0, 1.0] = -1.0;"),
        ("module Keep; until", "module Keep; input knob in { -1.0 } every 3s; until"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && knob > 0.0"))),
    one("ranges", "a promise to give control back within 100 ms",
        "from 0.7 to 0.5 it takes 200 ms at least",
        (("    acts within 0ms;", "    acts within 0ms;\n    recover within 100ms;"),), None),
)

IDLE = "AC never has control: nothing is assured, because nothing is allowed"
SAYS_IDLE = (r"(?i)\bAC\b[^\n]*\b(never|hardly|no control|cannot|nowhere)", r"(?i)vacuous")


def empty(name: str, why: str, *edits: Edit, named: tuple[str, ...] = SAYS_IDLE,
          base: Base = LINE) -> Wrong:
    """A predicate that says nothing; to be said in the headline."""
    return one("vacuous", name, why, edits, None, base, named=named)


VACUOUS = (
    empty("`ttf true`", IDLE, ("ttf abs(pos) > 0.7", "ttf true")),
    empty("`ttf` that always holds, in words", IDLE, ("ttf abs(pos) > 0.7", "ttf abs(pos) >= 0.0")),
    empty("`ttf` of a square that is never negative", IDLE,
          ("ttf abs(pos) > 0.7", "ttf pos * pos > -1.0")),
    empty("`ttf` but in a thousandth of C", IDLE, ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.0005"),
          ("safer abs(pos) < 0.5", "safer abs(pos) < 0.5")),
    empty("`safer` that holds nowhere", IDLE, ("safer abs(pos) < 0.5", "safer abs(pos) > 3.0")),
    empty("`safer false`", IDLE, ("safer abs(pos) < 0.5", "safer false")),
    empty("`safer` at one point", IDLE, ("safer abs(pos) < 0.5", "safer pos == 0.0")),
    empty("a constraint that holds nowhere", "C is empty", ("safe abs(pos) < 1.0", "safe false")),
    empty("`ttf` holds wherever `safer` does", "what is given back is taken at once",
          ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 || abs(pos) < 0.6")),
    empty("a cart with `ttf true`", IDLE, ("ttf !Fits(motion, 0.3)", "ttf true"), base=CART),
    empty("a map with `ttf true`", IDLE, ("ttf abs(pos) > 0.7", "ttf true"), base=MAP),
    empty("a horizon so long that computed sets are empty",
          "R(H) is empty: the table says `ttf` everywhere",
          ("  ttf abs(pos) > 0.7;\n", ""), ("  safer abs(pos) < 0.5;\n", ""),
          ("    acts within 0ms;", "    acts within 0ms;\n    horizon 5s;")),
)

SYSTEMS = (*SEVERAL, *PARAMETERS, *GATES, *RANGES, *SCHEMES, *VACUOUS)
