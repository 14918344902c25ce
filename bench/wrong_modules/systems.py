"""Wrong modules because of where they stand, with which parameters, and under which sets.

Purpose: `SYSTEMS`: several systems that hold a module, and parameters.
Non-goals: SC (`controllers.py`), paths (`paths.py`), time (`timing.py`).
"""

from __future__ import annotations

from functools import partial

from bench.wrong_modules.base import CART, LINE, MAP, RUN, SIGHT, Base, Edit, Shown, Wrong, under
from bench.wrong_modules.controllers import declared, one

WORLD = "system World default"
ALWAYS = "until 10s; always abs(p.truth.x) < 1.0; }"
OTHER = Shown(("run", "--system", "Other"))
NAMES_OTHER = (r"in system Other: .*",)
"""With a reason: a system that is listed as *the same problem* is no answer."""


of_systems = partial(one, "systems")


def also(
    name: str,
    other: str,
    *edits: Edit,
    why: str = "in the default system it is right; in `Other` it leaves C",
    base: Base = LINE,
    shown: Shown | None = OTHER,
) -> Wrong:
    """A second system with the same module."""
    return of_systems(
        name, why, (*edits, (WORLD, f"{other}\n{WORLD}")), shown, base, named=NAMES_OTHER
    )


def plant(name: str, body: str) -> str:
    """Another plant for LINE."""
    return f"plant {name} period 10ms {{ reads push; drives pos = x; {body} }}\n"


def other(parts: str, end: str = ALWAYS) -> str:
    """Another system."""
    return f"system Other {{ {parts} {end}"


SEVERAL = (
    also(
        "another plant: a wind as strong as SC",
        plant(
            "Windy", "state x: float = 0.0; disturbance w: float in [1.1, 1.1]; der x = push + w;"
        )
        + other("p: Windy; module Keep;"),
    ),
    also(
        "another plant: the wires crossed",
        plant("Crossed", "state x: float = 0.0; der x = -push;")
        + other("p: Crossed; module Keep;"),
        shown=Shown(
            ("run", "--system", "Other"),
            (("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = -1.0;"),),
        ),
    ),
    also(
        "another plant: 13 times as fast",
        plant("Quick", "state x: float = 0.0; der x = 13.0 * push;")
        + other("p: Quick; module Keep;"),
    ),
    also(
        "another plant: unstable",
        plant("Falls", "state x: float = 0.0; der x = push + 3.0 * x;")
        + other("p: Falls; module Keep;"),
    ),
    also(
        "another plant: it starts outside",
        plant("Far", "state x: float = 1.2; der x = push;") + other("p: Far; module Keep;"),
    ),
    also(
        "another plant: publishes every three seconds",
        "plant Slow period 3s { reads push; drives pos = x; state x: float = 0.6; der x = push; }\n"
        + other("p: Slow; module Keep;"),
    ),
    also(
        "another plant: its gauge is off by 0.5",
        "plant Off period 10ms { reads push; drives pos = x - 0.5; state x: float = 0.6;"
        " der x = push; }\n" + other("p: Off; module Keep;"),
    ),
    also(
        "another plant: with a mass",
        plant("Lags", "state x: float = 0.0; state v: float = 0.0; der x = v; der v = push;")
        + other("p: Lags; module Keep;"),
    ),
    also(
        "forced to AC",
        other("p: Line; module Keep; force Keep ac;"),
        why="the DM never switches there",
    ),
    also(
        "SC replaced",
        "node Rash period 50ms { subscribes pos; publishes push;"
        " step { publish push = pos > 0.5 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0); } }\n"
        + other("p: Line; module Keep; replace Keep.Careful by Rash;"),
        why="another SC stands there",
    ),
    also(
        "an estimator between",
        "topic raw: float max_age 20ms;\n"
        "plant Bare period 10ms { reads push; drives raw = x; state x: float = 0.0;"
        " der x = push; }\n"
        "node Scope period 10ms { subscribes raw; publishes pos; var at: float = 0.0;"
        " step { at = at + 0.016 * (raw - at); publish pos = at; } }\n"
        + other("p: Bare; node Scope; module Keep;"),
    ),
    also(
        "another estimator before the flying plant",
        "node Filter period 10ms { subscribes raw; publishes pos; var at: float = 0.0;"
        " step { at = at + 0.016 * (raw - at); publish pos = at; } }\n"
        "system Other { b: Body; node Filter; module Keep; until 10s;"
        " always abs(b.truth.x) < 1.0; }",
        why="the other one filters",
        base=SIGHT,
    ),
    also(
        "another flying plant behind the same abstraction",
        "plant Quick period 10ms { reads push; drives raw = x; state x: float = 0.0;"
        " der x = 13.0 * push; }\n"
        "system Other { b: Quick; node Scope; module Keep; until 10s;"
        " always abs(b.truth.x) < 1.0; }",
        why="it flies four times as fast",
        base=SIGHT,
    ),
    also(
        "an actuator that holds half a second",
        "topic force: float in [-1.0, 1.0] = 0.0;\n"
        "plant Driven period 10ms { reads force; drives pos = x; state x: float = 0.0;"
        " der x = force; }\n"
        "node Servo period 500ms { subscribes push; publishes force;"
        " step { publish force = push; } }\n" + other("p: Driven; node Servo; module Keep;"),
    ),
    also(
        "a parameter set there",
        other("p: Line; module Keep; set GAIN = -4.0;"),
        declared("param GAIN: float = 4.0 in [-9.0, 9.0];"),
        ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-GAIN * pos, -1.0, 1.0);"),
        why="`set GAIN` turns SC round",
    ),
    also(
        "inside a bigger system, with other wires",
        plant("Quick", "state x: float = 0.0; der x = 13.0 * push;")
        + "system Part { p: Quick; module Keep; }\n"
        "system Other { a: Part; until 10s; always abs(a.p.truth.x) < 1.0; }",
        why="the outer system wires the module's own topic to another plant's",
    ),
    also(
        "a map: another plant",
        "plant Hasty period 50ms { reads push; drives pos = x; state x: float = 0.0;"
        " next x = x + 0.5 * push; }\n" + other("p: Hasty; module Keep;"),
        base=MAP,
    ),
    also(
        "a cart: a heavier one",
        "plant Heavy period 10ms { reads accel; drives motion = { x: x, v: v };"
        " state x: float = 0.0; state v: float = 0.0; der x = v; der v = 0.2 * accel; }\n"
        "system Other { c: Heavy; module Keep; until 20s; always abs(c.truth.x) < 4.0; }",
        base=CART,
    ),
    also(
        "two modules on one plant: the second one pulls as well",
        "topic pull: float in [-1.0, 1.0] = 0.0;\n"
        "plant Shared period 10ms { reads push, pull; drives pos = x; state x: float = 0.0;"
        " der x = push + 2.0 * pull; }\n"
        "node A2 period 50ms { publishes pull; step { publish pull = 1.0; } }\n"
        "node S2 period 50ms { publishes pull; step { publish pull = 1.0; } }\n"
        "rta Two { ac A2; sc S2; period 50ms; safe true; ttf true; safer false; }\n"
        + other("p: Shared; module Keep; module Two;"),
        why="in `Other` a second module's output moves the plant, too",
    ),
    also(
        "another estimator of the same name",
        "node Turned period 10ms { subscribes raw; publishes pos; step { publish pos = -raw; } }\n"
        "system Other { b: Body; node Scope; replace Scope by Turned; module Keep; until 10s;"
        " always abs(b.truth.x) < 1.0; }",
        why="`replace` puts a wrong sign there",
        base=SIGHT,
        shown=Shown(
            ("run", "--system", "Other"),
            (("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = 1.0;"),),
        ),
    ),
    also(
        "another plant behind the same abstraction, that starts outside",
        "plant Far period 10ms { reads push; drives raw = x; state x: float = 1.2;"
        " der x = push; }\n"
        "system Other { b: Far; node Scope; module Keep; until 10s;"
        " always abs(b.truth.x) < 1.0; }",
        base=SIGHT,
    ),
    also(
        "a threshold of `ttf` set there",
        other("p: Line; module Keep; set FAR = 1.2;"),
        declared("param FAR: float = 0.7 in [0.0, 2.0];"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > FAR"),
        why="AC flies on until 1.2",
    ),
    also(
        "the output's set is larger there",
        other("p: Line; module Keep; set MAX = 30.0;"),
        declared("param MAX: float = 1.0 in [0.0, 90.0];"),
        ("topic push: float in [-1.0, 1.0]", "topic push: float in [-MAX, MAX]"),
        ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = MAX;"),
        why="AC publishes 30",
    ),
    also(
        "the wind is a parameter there",
        other("p: Line; module Keep; set GUST = 4.0;"),
        declared("param GUST: float = 0.1 in [0.0, 5.0];"),
        ("der x = push;", "der x = push + GUST;"),
    ),
    also(
        "the flying plant's wind is a parameter there",
        "system Other { b: Body; node Scope; module Keep; set GUST = 4.0; until 10s;"
        " always abs(b.truth.x) < 1.0; }",
        declared("param GUST: float = 0.0 in [0.0, 5.0];"),
        (
            "drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
            "drives raw = x;\n  state x: float = 0.0;\n  der x = push + GUST;",
        ),
        base=SIGHT,
    ),
    of_systems(
        "forced to AC in the only system",
        "the DM never switches",
        (("module Keep; until", "module Keep; force Keep ac; until"),),
        RUN,
        named=(r"forced",),
    ),
    of_systems(
        "two instances of the module in one system, one plant of them too fast",
        "the second instance has another plant",
        (
            (
                WORLD,
                plant("Quick", "state x: float = 0.0; der x = 13.0 * push;")
                + "system Left { p: Line; module Keep; }\nsystem Right { p: Quick; module Keep; }\n"
                + WORLD,
            ),
            (
                "{ p: Line; module Keep; until 10s; always abs(p.truth.x) < 1.0; }",
                "{ l: Left; r: Right; until 10s; always abs(r.p.truth.x) < 1.0; }",
            ),
        ),
        named=(r"\bRight\b",),
    ),
)

of_parameters = partial(one, "parameters")


VALUES = "it is proved for one value of the parameter only, and wrong for others in its range"


def param(
    name: str,
    said: str,
    setting: str,
    *edits: Edit,
    why: str = VALUES,
    base: Base = LINE,
    edits_of_run: tuple[Edit, ...] = (),
) -> Wrong:
    """A parameter whose default is right."""
    word = setting.partition("=")[0]
    return of_parameters(
        name,
        why,
        (declared(said), *edits),
        Shown(("run", "--set", setting), edits_of_run),
        base,
        named=(rf"(?m)^(?!.*warning).*\b{word}\b",),
    )


PARAMETERS = (
    param(
        "SC's gain",
        "param GAIN: float = 4.0 in [-9.0, 9.0];",
        "GAIN=-4.0",
        ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-GAIN * pos, -1.0, 1.0);"),
    ),
    param(
        "SC's gain, without a range",
        "param GAIN: float = 4.0;",
        "GAIN=-1.0",
        ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-GAIN * pos, -1.0, 1.0);"),
    ),
    param(
        "the plant's gain",
        "param POWER: float = 1.0 in [0.0, 20.0];",
        "POWER=13.0",
        ("der x = push;", "der x = POWER * push;"),
    ),
    param(
        "the threshold of `ttf`",
        "param FAR: float = 0.7 in [0.0, 2.0];",
        "FAR=1.2",
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > FAR"),
    ),
    param(
        "the period of the DM",
        "param EVERY: duration = 50ms;",
        "EVERY=500ms",
        ("  period 50ms;\n  safe", "  period EVERY;\n  safe"),
    ),
    param(
        "the wind",
        "param GUST: float = 0.1 in [0.0, 5.0];",
        "GUST=4.0",
        ("der x = push;", "der x = push + GUST;"),
    ),
    param(
        "the initial state",
        "param START: float = 0.0 in [-2.0, 2.0];",
        "START=1.5",
        ("state x: float = 0.0;", "state x: float = START;"),
    ),
    param(
        "a switch that turns SC off",
        "param OFF: bool = false;",
        "OFF=true",
        ("clamp(-4.0 * pos, -1.0, 1.0);", "OFF ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    param(
        "the set of the output",
        "param MAX: float = 1.0 in [0.0, 90.0];",
        "MAX=30.0",
        ("topic push: float in [-1.0, 1.0]", "topic push: float in [-MAX, MAX]"),
        edits_of_run=(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = MAX;"),),
    ),
    param(
        "the constraint",
        "param WALL: float = 1.0 in [0.1, 9.0];",
        "WALL=0.3",
        ("safe abs(pos) < 1.0", "safe abs(pos) < WALL"),
        ("always abs(p.truth.x) < 1.0", "always abs(p.truth.x) < WALL"),
    ),
    param(
        "the period of the sensor",
        "param TICK: duration = 10ms;",
        "TICK=3s",
        ("plant Line period 10ms", "plant Line period TICK"),
        ("state x: float = 0.0;", "state x: float = 0.6;"),
    ),
    of_parameters(
        "a plant's parameter that somebody may change while it matters",
        "a load of 3 makes the plant four times as fast; nothing keeps it from changing at 0.69",
        (
            (
                "  state x: float = 0.0;",
                "  state x: float = 0.0;\n  state load: int in [0, 3] = 0;",
            ),
            ("der x = push;", "der x = (1.0 + float(load)) * push;"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.65"),
        ),
        None,
        named=(r"load changes only",),
    ),
    of_parameters(
        "a plant's parameter for one value of which the wires are crossed",
        "sign 1 is wrong",
        (
            ("  state x: float = 0.0;", "  state x: float = 0.0;\n  state s: int in [0, 1] = 0;"),
            ("der x = push;", "der x = s == 1 ? -push : push;"),
        ),
        under(
            ("state s: int in [0, 1] = 0;", "state s: int in [0, 1] = 1;"),
            ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = -1.0;"),
        ),
    ),
)

SYSTEMS = (*SEVERAL, *PARAMETERS)
