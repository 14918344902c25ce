"""Wrong modules because of what stands between plant and module, and between module and plant.

Purpose: `ESTIMATORS`, and what the other entries about paths are written with.
Non-goals: SC itself (`controllers.py`).
"""

from __future__ import annotations

from functools import partial

from bench.wrong_modules.base import LINE, RUN, SIGHT, Base, Edit, Shown, Wrong, under
from bench.wrong_modules.controllers import GOES, declared, one

SCOPE = """node Scope period 10ms {
  subscribes raw;
  publishes pos;
  step { publish pos = raw; }
}"""
NAMES_SCOPE = (r"within the errors declared[^\n]*\bScope\b", r"what Scope publishes is its own")
"""The verdict must speak of the node that does it."""
CMD: tuple[Edit, ...] = (
    (
        "topic push: float in [-1.0, 1.0] = 0.0;",
        "topic push: float in [-1.0, 1.0] = 0.0;\ntopic force: float in [-1.0, 1.0] = 0.0;",
    ),
    ("plant Body period 10ms {\n  reads push;", "plant Body period 10ms {\n  reads force;"),
    (
        "drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
        "drives raw = x;\n  state x: float = 0.0;\n  der x = force;",
    ),
    ("  node Scope;\n", "  node Scope;\n  node Servo;\n"),
)
"""SIGHT with a node `Servo` between module and plant."""
PUSHING = under((GOES, "publish push = 1.0;"))
NAMES_SERVO = (r"Servo[^\n]*what they (do with|make of)[^\n]* belongs? to the plants",)


def scope(body: str, *more: str, period: str = "10ms") -> Edit:
    """The estimator with another step."""
    lines = "".join(f"  {line}\n" for line in more)
    return (
        SCOPE,
        (
            f"node Scope period {period} {{\n  subscribes raw;\n  publishes pos;\n"
            f"{lines}  step {{ {body} }}\n}}"
        ),
    )


def servo(body: str, *more: str, period: str = "10ms") -> tuple[Edit, ...]:
    """An actuator node between module and plant."""
    lines = "".join(f"  {line}\n" for line in more)
    return (
        *CMD,
        declared(
            f"node Servo period {period} {{\n  subscribes push;\n  publishes force;\n"
            f"{lines}  step {{ {body} }}\n}}"
        ),
    )


def seen(
    kind: str,
    name: str,
    why: str,
    *edits: Edit,
    shown: Shown | None = RUN,
    named: tuple[str, ...] = NAMES_SCOPE,
    base: Base = SIGHT,
    options: tuple[str, ...] = (),
) -> Wrong:
    """An entry about SIGHT."""
    return one(kind, name, why, edits, shown, base, named=named, options=options)


def start(x: str) -> tuple[Edit, ...]:
    """Both plants start there."""
    return (
        ("drives raw = x;\n  state x: float = 0.0;", f"drives raw = x;\n  state x: float = {x};"),
        ("drives pos = x;\n  state x: float = 0.0;", f"drives pos = x;\n  state x: float = {x};"),
    )


def default(value: str) -> Edit:
    """What is read before anything was published."""
    return ("topic pos: float max_age 20ms;", f"topic pos: float = {value} max_age 20ms;")


QUICK: tuple[Edit, ...] = (
    (
        "drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
        "drives raw = x;\n  state x: float = 0.7;\n  der x = 4.0 * push;",
    ),
    (
        "drives pos = x;\n  state x: float = 0.0;\n  der x = push;",
        "drives pos = x;\n  state x: float = 0.7;\n  der x = 4.0 * push;",
    ),
    ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.55"),
    ("safer abs(pos) < 0.5", "safer abs(pos) < 0.4"),
)
"""Four times as fast, from 0.7 on: what is half a second old is of no use."""

# ---------------------------------------------------------------- estimators

LAGS = "what it publishes is not the state within the error that the model declares"
KEEPS = "var at: float = 0.0;"

of_estimators = partial(seen, "estimators")
ESTIMATORS = (
    of_estimators(
        "a low-pass filter of 0.6 s",
        LAGS,
        scope("at = at + 0.016 * (raw - at); publish pos = at;", KEEPS),
    ),
    of_estimators(
        "a moving average over 64 samples",
        LAGS,
        scope(
            "xs[n] = raw; n = n < 63 ? n + 1 : 0; var s = 0.0; for x in xs { s = s + x; }"
            " publish pos = s / 64.0;",
            "var xs: float[64];",
            "var n: int in [0, 63] = 0;",
        ),
    ),
    of_estimators(
        "a delay line of 40 samples",
        LAGS,
        scope(
            "publish pos = xs[n]; xs[n] = raw; n = n < 39 ? n + 1 : 0;",
            "var xs: float[40];",
            "var n: int in [0, 39] = 0;",
        ),
    ),
    of_estimators(
        "a dead reckoning that never looks",
        "it counts on what was commanded half",
        (
            SCOPE,
            (
                "node Scope period 10ms {\n  subscribes raw, push;\n  publishes pos;\n"
                "  var at: float = 0.0;\n  step { at = at + 0.5 * push * dt; publish pos = at; }\n}"
            ),
        ),
    ),
    of_estimators(
        "a dead reckoning with a drift",
        "0.2 a second off",
        (
            SCOPE,
            (
                "node Scope period 10ms {\n  subscribes raw, push;\n  publishes pos;\n"
                "  var at: float = 0.0;\n"
                "  step { at = at + (push - 0.2) * dt; publish pos = at; }\n}"
            ),
        ),
    ),
    of_estimators(
        "a rate limiter",
        "it follows at half of the speed",
        scope("at = at + clamp(raw - at, -0.005, 0.005); publish pos = at;", KEEPS),
    ),
    of_estimators(
        "a slope that is measured wrong",
        "half of the place",
        scope("publish pos = 0.5 * raw;"),
    ),
    of_estimators("an offset of 0.4", LAGS, scope("publish pos = raw - 0.4;"), shown=PUSHING),
    of_estimators(
        "a gauge that ends at 0.6",
        LAGS,
        scope("publish pos = clamp(raw, -0.6, 0.6);"),
    ),
    of_estimators(
        "a coarse gauge: whole steps of 0.97",
        LAGS,
        scope("publish pos = 0.97 * floor(raw / 0.97);"),
        shown=PUSHING,
    ),
    of_estimators(
        "a gauge that is blind on the right",
        "it says 0.0 beyond 0.4",
        scope("publish pos = raw > 0.4 ? 0.0 : raw;"),
    ),
    of_estimators("a wrong sign", LAGS, scope("publish pos = -raw;"), shown=PUSHING),
    of_estimators(
        "a hysteresis of 0.97",
        LAGS,
        scope("if abs(raw - at) > 0.97 { at = raw; } publish pos = at;", KEEPS),
    ),
    of_estimators(
        "a gauge that freezes after 3 s",
        "time is in no set of states",
        scope("if time < 3.2 { at = raw; } publish pos = at;", KEEPS),
    ),
    of_estimators(
        "an estimator every second behind `max_age 10ms`",
        "SC answers a read that is up to a second old; nothing enforces its age",
        scope("publish pos = raw;", period="1s"),
        *QUICK,
        ("topic pos: float max_age 20ms;", "topic pos: float max_age 10ms;"),
        named=(),
    ),
    of_estimators(
        "an estimator every three seconds behind `max_age 20ms`",
        "SC answers a read that is up to three seconds old; nothing enforces its age",
        scope("publish pos = raw;", period="3s"),
        *start("0.7"),
        named=(),
    ),
    of_estimators(
        "an estimator every second, and a `max_age` of a second",
        "the stamp is young enough, and H* counts it: a `ttf` for 20 ms is not",
        scope("publish pos = raw;", period="1s"),
        ("topic pos: float max_age 20ms;", "topic pos: float max_age 1s;"),
        named=(),
    ),
    of_estimators(
        "an estimator that mixes two places",
        "half of what it read a second ago",
        scope(
            "publish pos = 0.5 * raw + 0.5 * xs[n]; xs[n] = raw; n = n < 99 ? n + 1 : 0;",
            "var xs: float[100];",
            "var n: int in [0, 99] = 0;",
        ),
    ),
    of_estimators(
        "an estimator that publishes every 50th step",
        "SC and DM read what is half a second old: the DM sees that it is stale, SC does not",
        scope(
            "n = n < 49 ? n + 1 : 0; if n == 1 { publish pos = raw; }", "var n: int in [0, 49] = 0;"
        ),
        *QUICK,
        named=(),
    ),
    of_estimators(
        "no plant drives what the module reads: a filter between",
        "a filter of 0.6 s between plant and module, and no model beside it",
        ("drives pos = x;", "drives raw = x;"),
        (
            "topic pos: float max_age 20ms;",
            "topic raw: float max_age 20ms;\ntopic pos: float max_age 20ms;",
        ),
        declared(
            "node Scope period 10ms {\n  subscribes raw;\n  publishes pos;\n  var at: float"
            " = 0.0;\n  step { at = at + 0.016 * (raw - at); publish pos = at; }\n}"
        ),
        ("{ p: Line; module Keep;", "{ p: Line; node Scope; module Keep;"),
        ("grid pos in", "grid p.x in"),
        base=LINE,
    ),
    of_estimators(
        "no plant drives what the module reads: a node every second",
        "what SC reads is up to a second old",
        ("drives pos = x;", "drives raw = x;"),
        (
            "topic pos: float max_age 20ms;",
            "topic raw: float max_age 20ms;\ntopic pos: float max_age 2s;",
        ),
        declared(
            "node Scope period 1s {\n  subscribes raw;\n  publishes pos;\n"
            "  step { publish pos = raw; }\n}"
        ),
        ("{ p: Line; module Keep;", "{ p: Line; node Scope; module Keep;"),
        ("grid pos in", "grid p.x in"),
        base=LINE,
    ),
    of_estimators(
        "a plant for the module's eyes: its own model of the world",
        "the model that drives `pos` is not moved by what moves the body, and nothing ties them",
        ("abstracts b by m: Model = { x: b.truth.x };\n", ""),
        ("  b: Body;\n  node Scope;\n", "  b: Body;\n  m: Model;\n"),
        (
            "drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
            "drives raw = x;\n  state x: float = 0.0;\n  der x = 2.0 * push;",
        ),
        named=(r"\bm for some\b", r"\bModel\b"),
    ),
)
