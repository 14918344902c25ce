"""Wrong modules because of what stands between plant and module, and between module and plant.

Purpose: `PATHS`: the order of steps in an instant, what is read before anything was published,
estimators and actuators with a state of their own, sensors that fall silent.
Non-goals: SC itself (`wrong_controllers.py`).
"""

from __future__ import annotations

from bench.wrong_base import LINE, RUN, SIGHT, Base, Edit, Shown, Wrong, under
from bench.wrong_controllers import FAST, GOES, careful, declared, one

SCOPE = """node Scope period 10ms {
  subscribes raw;
  publishes pos;
  step { publish pos = raw; }
}"""
NAMES_SCOPE = (r"within the errors declared[^\n]*\bScope\b", r"what Scope publishes is its own")
"""The verdict must speak of the node that does it."""
CMD: tuple[Edit, ...] = (
    ("topic push: float in [-1.0, 1.0] = 0.0;",
     "topic push: float in [-1.0, 1.0] = 0.0;\ntopic force: float in [-1.0, 1.0] = 0.0;"),
    ("plant Body period 10ms {\n  reads push;", "plant Body period 10ms {\n  reads force;"),
    ("drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
     "drives raw = x;\n  state x: float = 0.0;\n  der x = force;"),
    ("  node Scope;\n", "  node Scope;\n  node Servo;\n"),
)
"""SIGHT with a node `Servo` between module and plant."""
PUSHING = under((GOES, "publish push = 1.0;"))
NAMES_SERVO = (r"Servo[^\n]*what they do with[^\n]* belongs to the plants",)


def scope(body: str, *more: str, period: str = "10ms") -> Edit:
    """The estimator with another step."""
    lines = "".join(f"  {line}\n" for line in more)
    return (SCOPE, f"node Scope period {period} {{\n  subscribes raw;\n  publishes pos;\n"
            f"{lines}  step {{ {body} }}\n}}")


def servo(body: str, *more: str, period: str = "10ms") -> tuple[Edit, ...]:
    """An actuator node between module and plant."""
    lines = "".join(f"  {line}\n" for line in more)
    return (*CMD, declared(
        f"node Servo period {period} {{\n  subscribes push;\n  publishes force;\n"
        f"{lines}  step {{ {body} }}\n}}"))


def seen(
    kind: str, name: str, why: str, *edits: Edit, shown: Shown | None = RUN,
    named: tuple[str, ...] = NAMES_SCOPE, base: Base = SIGHT, options: tuple[str, ...] = (),
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
    ("drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
     "drives raw = x;\n  state x: float = 0.7;\n  der x = 4.0 * push;"),
    ("drives pos = x;\n  state x: float = 0.0;\n  der x = push;",
     "drives pos = x;\n  state x: float = 0.7;\n  der x = 4.0 * push;"),
    ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.55"),
    ("safer abs(pos) < 0.5", "safer abs(pos) < 0.4"),
)
"""Four times as fast, from 0.7 on: what is half a second old is of no use."""

# ---------------------------------------------------------------- order and first read

BEFORE = (
    "SC's first step is before the estimator's: it reads the topic's default, and its command "
    "acts until its next step"
)
SLOW_SC: tuple[Edit, ...] = (
    ("node Careful period 50ms", "node Careful period 200ms"),
    ("  period 50ms;\n  safe", "  period 200ms;\n  safe"),
    ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-3.0 * pos, -1.0, 1.0);"),
    ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.5"),
    ("safer abs(pos) < 0.5", "safer abs(pos) < 0.3"),
)
NAMES_FIRST: tuple[str, ...] = ()
"""Order and first reads are followed, not named."""

ORDER = (
    seen("order", "SC steps before the estimator: the default pulls it out", BEFORE,
         *SLOW_SC, *start("-0.85"), default("0.9"), named=NAMES_FIRST),
    seen("order", "the default is on the other side of a door", BEFORE,
         *SLOW_SC, *start("0.85"), default("-1.0"), named=NAMES_FIRST),
    seen("order", "the estimator starts a second later", "SC answers the default for a second",
         scope("if time >= 1.0 { publish pos = raw; }"), default("-0.3"),
         named=()),
    seen("order", "the estimator starts 300 ms later, the state is near the border",
         "SC answers the default for 300 ms",
         scope("if time >= 0.3 { publish pos = raw; }"),
         *start("0.8"), default("-0.3"), named=()),
    seen("order", "two nodes on the path, the later one declared first",
         "at 0 s neither has published anything for SC: it reads the default; each adds a period",
         ("topic push: float", "topic mid: float max_age 20ms;\ntopic push: float"),
         (SCOPE, "node Last period 10ms { subscribes mid; publishes pos;"
          " step { publish pos = mid; } }\n"
          "node First period 10ms { subscribes raw; publishes mid; step { publish mid = raw; } }"),
         ("  node Scope;\n", "  node Last;\n  node First;\n"),
         *SLOW_SC, *start("-0.85"), default("0.9"), named=()),
    seen("order", "an estimator that is two periods behind",
         "two nodes, each holds what it read for 200 ms: 400 ms old under a `max_age` of 210 ms",
         ("topic push: float", "topic mid: float max_age 210ms;\ntopic push: float"),
         (SCOPE, "node Last period 200ms { subscribes mid; publishes pos;"
          " step { publish pos = mid; } }\n"
          "node First period 200ms { subscribes raw; publishes mid; step { publish mid = raw; } }"),
         ("  node Scope;\n", "  node Last;\n  node First;\n"),
         ("topic pos: float max_age 20ms;", "topic pos: float max_age 210ms;"),
         ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.65"),
         named=()),
    seen("order", "two nodes that hold for 200 ms each, in step",
         "half a period apart: 300 ms old under a `max_age` of 210 ms",
         ("topic push: float", "topic mid: float max_age 210ms;\ntopic push: float"),
         (SCOPE, "node First period 200ms { subscribes raw; publishes mid;"
          " step { publish mid = raw; } }\n"
          "node Last period 200ms phase 100ms { subscribes mid; publishes pos;"
          " step { publish pos = mid; } }"),
         ("  node Scope;\n", "  node First;\n  node Last;\n"),
         ("topic pos: float max_age 20ms;", "topic pos: float max_age 210ms;"),
         ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.75"), named=()),
    seen("order", "a fresh stamp on an old sample, after the first sample",
         "First samples every 500 ms, Last republishes every 10 ms, and never a default",
         ("topic push: float", "topic mid: float max_age 1s;\ntopic push: float"),
         (SCOPE, "node First period 500ms { subscribes raw; publishes mid;"
          " step { publish mid = raw; } }\n"
          "node Last period 10ms phase 5ms { subscribes mid; publishes pos;"
          " step { publish pos = mid; } }"),
         ("  node Scope;\n", "  node First;\n  node Last;\n"), named=()),
    seen("order", "the DM believes in a fresh stamp on an old sample",
         "First samples every 500 ms, Last republishes every 10 ms: the stamp is fresh, the state "
         "half a second old",
         ("topic push: float", "topic mid: float max_age 1s;\ntopic push: float"),
         (SCOPE, "node First period 500ms { subscribes raw; publishes mid;"
          " step { publish mid = raw; } }\n"
          "node Last period 10ms { subscribes mid; publishes pos; step { publish pos = mid; } }"),
         ("  node Scope;\n", "  node First;\n  node Last;\n"),
         named=()),
    seen("order", "the actuator's node steps before SC in the instant",
         "the command waits for the actuator's next step, up to 700 ms later",
         *servo("publish force = push;", period="700ms"), named=()),
    seen("order", "SC before the estimator, and the DM too: a `ttf` of the default",
         "the default looks fine: SC pushes right from 0.9 on",
         *start("0.9"), default("-1.0"), *SLOW_SC, named=NAMES_FIRST),
    seen("order", "SC faults at the default: it asserts that it sees something",
         "at 0 s it reads the default 0.0, and is latched before the estimator's first step",
         *careful("assert pos != 0.0; publish push = clamp(-4.0 * pos + 2.0, -1.0, 1.0);"),
         *start("0.5"), ("grid pos in [-1.0, 1.0] / 80", "grid pos in [0.1, 0.9] / 64"),
         ("safe abs(pos) < 1.0", "safe pos > 0.1 && pos < 0.9"),
         ("ttf abs(pos) > 0.7", "ttf pos < 0.3 || pos > 0.7"),
         ("safer abs(pos) < 0.5", "safer pos > 0.4 && pos < 0.6"), named=NAMES_FIRST),
    seen("order", "SC divides by the default",
         "at 0 s it divides by 0.0, and is latched",
         *careful("publish push = clamp(2.0 - 4.0 * pos * (pos / pos), -1.0, 1.0);"),
         *start("0.5"), ("grid pos in [-1.0, 1.0] / 80", "grid pos in [0.1, 0.9] / 64"),
         ("safe abs(pos) < 1.0", "safe pos > 0.1 && pos < 0.9"),
         ("ttf abs(pos) > 0.7", "ttf pos < 0.3 || pos > 0.7"),
         ("safer abs(pos) < 0.5", "safer pos > 0.4 && pos < 0.6"), named=NAMES_FIRST),
    seen("order", "SC looks the default up in a table",
         "the default 9.0 is beyond the table: SC is latched at 0 s",
         declared("const LAW: float[11] = "
                  "[1.0, 1.0, 1.0, 0.8, 0.4, 0.0, -0.4, -0.8, -1.0, -1.0, -1.0];"),
         *careful("publish push = LAW[int(floor(pos * 4.0 + 5.5))];"),
         default("9.0"), named=NAMES_FIRST),
    seen("order", "SC publishes outside its set at the default",
         "the default 3.0 lies outside of the grid: SC's command there is refused",
         *careful("publish push = pos > 2.0 ? 1.5 : clamp(-4.0 * pos, -1.0, 1.0);"),
         default("3.0"), named=NAMES_FIRST),
    seen("order", "SC converts the default", "the default 1e30 is no int: latched at 0 s",
         *careful("let n = int(pos); publish push = n > 9 ? 0.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
         default("1e30"), named=NAMES_FIRST),
    seen("order", "an element of a record has another default than the state",
         BEFORE, *start("-0.85"), ("topic raw: float", "type Seen = { x: float, n: float };\ntopic raw: float"),
         ("topic pos: float max_age 20ms;",
          "topic pos: Seen = { x: 0.9, n: 0.0 } max_age 20ms;"),
         ("drives pos = x;", "drives pos = { x: x, n: 0.0 };"),
         ("measured pos within 0.02;", "measured pos.x within 0.02;"),
         ("step { publish pos = raw; }", "step { publish pos = { x: raw, n: 0.0 }; }"),
         ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = pos.x >= 0.0 ? 1.0 : -1.0;"),
         ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-3.0 * pos.x, -1.0, 1.0);"),
         ("node Careful period 50ms", "node Careful period 200ms"),
         ("  period 50ms;\n  safe", "  period 200ms;\n  safe"),
         ("safe abs(pos) < 1.0", "safe abs(pos.x) < 1.0"),
         ("ttf abs(pos) > 0.7", "ttf abs(pos.x) > 0.5"),
         ("safer abs(pos) < 0.5", "safer abs(pos.x) < 0.3"),
         ("grid pos in", "grid pos.x in"), named=NAMES_FIRST),
)

# ---------------------------------------------------------------- estimators

LAGS = "what it publishes is not the state within the error that the model declares"
KEEPS = "var at: float = 0.0;"

ESTIMATORS = (
    seen("estimators", "a low-pass filter of 0.6 s", LAGS,
         scope("at = at + 0.016 * (raw - at); publish pos = at;", KEEPS)),
    seen("estimators", "a moving average over 64 samples", LAGS,
         scope("xs[n] = raw; n = n < 63 ? n + 1 : 0; var s = 0.0; for x in xs { s = s + x; }"
               " publish pos = s / 64.0;", "var xs: float[64];", "var n: int in [0, 63] = 0;")),
    seen("estimators", "a delay line of 40 samples", LAGS,
         scope("publish pos = xs[n]; xs[n] = raw; n = n < 39 ? n + 1 : 0;",
               "var xs: float[40];", "var n: int in [0, 39] = 0;")),
    seen("estimators", "a dead reckoning that never looks", "it counts on what was commanded half",
         (SCOPE, "node Scope period 10ms {\n  subscribes raw, push;\n  publishes pos;\n"
          "  var at: float = 0.0;\n  step { at = at + 0.5 * push * dt; publish pos = at; }\n}")),
    seen("estimators", "a dead reckoning with a drift", "0.2 a second off",
         (SCOPE, "node Scope period 10ms {\n  subscribes raw, push;\n  publishes pos;\n"
          "  var at: float = 0.0;\n"
          "  step { at = at + (push - 0.2) * dt; publish pos = at; }\n}")),
    seen("estimators", "a rate limiter", "it follows at half of the speed",
         scope("at = at + clamp(raw - at, -0.005, 0.005); publish pos = at;", KEEPS)),
    seen("estimators", "a slope that is measured wrong", "half of the place",
         scope("publish pos = 0.5 * raw;")),
    seen("estimators", "an offset of 0.4", LAGS, scope("publish pos = raw - 0.4;"), shown=PUSHING),
    seen("estimators", "a gauge that ends at 0.6", LAGS,
         scope("publish pos = clamp(raw, -0.6, 0.6);")),
    seen("estimators", "a coarse gauge: whole steps of 0.97", LAGS,
         scope("publish pos = 0.97 * floor(raw / 0.97);"), shown=PUSHING),
    seen("estimators", "a gauge that is blind on the right", "it says 0.0 beyond 0.4",
         scope("publish pos = raw > 0.4 ? 0.0 : raw;")),
    seen("estimators", "a wrong sign", LAGS, scope("publish pos = -raw;"), shown=PUSHING),
    seen("estimators", "a hysteresis of 0.97", LAGS,
         scope("if abs(raw - at) > 0.97 { at = raw; } publish pos = at;", KEEPS)),
    seen("estimators", "a gauge that freezes after 3 s", "time is in no set of states",
         scope("if time < 3.2 { at = raw; } publish pos = at;", KEEPS)),
    seen("estimators", "an estimator every second behind `max_age 10ms`",
         "SC answers a read that is up to a second old; nothing enforces its age",
         scope("publish pos = raw;", period="1s"), *QUICK,
         ("topic pos: float max_age 20ms;", "topic pos: float max_age 10ms;"),
         named=()),
    seen("estimators", "an estimator every three seconds behind `max_age 20ms`",
         "SC answers a read that is up to three seconds old; nothing enforces its age",
         scope("publish pos = raw;", period="3s"), *start("0.7"),
         named=()),
    seen("estimators", "an estimator every second, and a `max_age` of a second",
         "the stamp is young enough, and H* counts it: a `ttf` for 20 ms is not",
         scope("publish pos = raw;", period="1s"),
         ("topic pos: float max_age 20ms;", "topic pos: float max_age 1s;"),
         named=()),
    seen("estimators", "an estimator that mixes two places",
         "half of what it read a second ago",
         scope("publish pos = 0.5 * raw + 0.5 * xs[n]; xs[n] = raw; n = n < 99 ? n + 1 : 0;",
               "var xs: float[100];", "var n: int in [0, 99] = 0;")),
    seen("estimators", "an estimator that publishes every 50th step",
         "SC and DM read what is half a second old: the DM sees that it is stale, SC does not",
         scope("n = n < 49 ? n + 1 : 0; if n == 1 { publish pos = raw; }",
               "var n: int in [0, 49] = 0;"), *QUICK,
         named=()),
    seen("estimators", "no plant drives what the module reads: a filter between",
         "a filter of 0.6 s between plant and module, and no model beside it",
         ("drives pos = x;", "drives raw = x;"),
         ("topic pos: float max_age 20ms;",
          "topic raw: float max_age 20ms;\ntopic pos: float max_age 20ms;"),
         declared("node Scope period 10ms {\n  subscribes raw;\n  publishes pos;\n  var at: float"
                  " = 0.0;\n  step { at = at + 0.016 * (raw - at); publish pos = at; }\n}"),
         ("{ p: Line; module Keep;", "{ p: Line; node Scope; module Keep;"),
         ("grid pos in", "grid p.x in"), base=LINE),
    seen("estimators", "no plant drives what the module reads: a node every second",
         "what SC reads is up to a second old",
         ("drives pos = x;", "drives raw = x;"),
         ("topic pos: float max_age 20ms;",
          "topic raw: float max_age 20ms;\ntopic pos: float max_age 2s;"),
         declared("node Scope period 1s {\n  subscribes raw;\n  publishes pos;\n"
                  "  step { publish pos = raw; }\n}"),
         ("{ p: Line; module Keep;", "{ p: Line; node Scope; module Keep;"),
         ("grid pos in", "grid p.x in"), base=LINE),
    seen("estimators", "a plant for the module's eyes: its own model of the world",
         "the model that drives `pos` is not moved by what moves the body, and nothing ties them",
         ("abstracts b by m: Model = { x: b.truth.x };\n", ""),
         ("  b: Body;\n  node Scope;\n", "  b: Body;\n  m: Model;\n"),
         ("drives raw = x;\n  state x: float = 0.0;\n  der x = push;",
          "drives raw = x;\n  state x: float = 0.0;\n  der x = 2.0 * push;"),
         named=(r"\bm for some\b", r"\bModel\b")),
)

# ---------------------------------------------------------------- actuators

ACTUATORS = (
    seen("actuators", "a filter of 5 s before the plant", "commands act late and little by little",
         *servo("f = f + 0.002 * (push - f); publish force = f;", "var f: float = 0.0;"),
         named=NAMES_SERVO),
    seen("actuators", "a rate limiter before the plant", "a second from left to right",
         *servo("f = f + clamp(push - f, -0.02, 0.02); publish force = clamp(f, -1.0, 1.0);",
                "var f: float = 0.0;"), named=NAMES_SERVO),
    seen("actuators", "a hold of half a second before the plant", "half a second more of AC",
         *servo("publish force = push;", period="500ms"), named=()),
    seen("actuators", "a delay of 40 samples before the plant", "0.4 s more of AC",
         *servo("publish force = xs[n]; xs[n] = push; n = n < 39 ? n + 1 : 0;",
                "var xs: float[40];", "var n: int in [0, 39] = 0;"), named=NAMES_SERVO),
    seen("actuators", "a dead band before the plant", "what is smaller than 1 is nothing",
         *servo("publish force = abs(push) < 0.99 ? 0.2 : push;"),
         ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-4.0 * pos, -0.9, 0.9);"),
         named=NAMES_SERVO),
    seen("actuators", "a wire crossed before the plant", "the sign is wrong",
         *servo("publish force = -push;"), shown=under(
             ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = -0.9;")),
         named=NAMES_SERVO),
    seen("actuators", "an actuator that keeps pushing right", "it only knows one way",
         *servo("publish force = max(push, 0.1);"), named=NAMES_SERVO),
    seen("actuators", "an actuator that stops after 3 s", "then it pushes right",
         *servo("publish force = time < 3.0 ? push : 1.0;"), named=NAMES_SERVO),
    seen("actuators", "an actuator that faults when it changes its mind", "latched, it holds 1.0",
         *servo("assert push * f >= 0.0; f = push; publish force = push;", "var f: float = 0.0;"),
         named=NAMES_SERVO),
    seen("actuators", "an actuator that counts commands in a queue", "its queue overflows: latched",
         *CMD, declared("node Servo period 200ms {\n  subscribes push queue 1 fault;\n"
                        "  publishes force;\n  failsafe force = 1.0;\n"
                        "  step { for p in push { publish force = p; } }\n}"),
         named=()),
    seen("actuators", "no model: a hold of half a second before the plant",
         "half a second more of AC",
         ("topic push: float in [-1.0, 1.0] = 0.0;",
          "topic push: float in [-1.0, 1.0] = 0.0;\ntopic force: float in [-1.0, 1.0] = 0.0;"),
         ("  reads push;", "  reads force;"), ("der x = push;", "der x = force;"),
         declared("node Servo period 500ms { subscribes push; publishes force;"
                  " step { publish force = push; } }"),
         ("{ p: Line; module Keep;", "{ p: Line; node Servo; module Keep;"),
         base=LINE, named=()),
    seen("actuators", "no model: a filter before the plant", "commands act late",
         ("topic push: float in [-1.0, 1.0] = 0.0;",
          "topic push: float in [-1.0, 1.0] = 0.0;\ntopic force: float in [-1.0, 1.0] = 0.0;"),
         ("  reads push;", "  reads force;"), ("der x = push;", "der x = force;"),
         declared("node Servo period 10ms { subscribes push; publishes force; var f: float = 0.0;"
                  " step { f = f + 0.002 * (push - f); publish force = clamp(f, -1.0, 1.0); } }"),
         ("{ p: Line; module Keep;", "{ p: Line; node Servo; module Keep;"),
         base=LINE, named=NAMES_SERVO),
)

# ---------------------------------------------------------------- sensors that fall silent

SILENCE = (r"never drop out", r"outage")

STALE = (
    seen("stale", "a gauge that says nothing beyond 0.6",
         "the DM sees that it is stale and hands over to an SC that answers the last read",
         scope("if raw < 0.6 { publish pos = raw; }"),
         *careful("publish push = clamp(4.0 * (0.62 - pos), -1.0, 1.0);"),
         ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.75"),
         ("safer abs(pos) < 0.5", "safer pos > 0.3 && pos < 0.7"), named=SILENCE),
    seen("stale", "a gauge that is latched by a fault of its own",
         "after it asserts, nobody publishes `pos` any more",
         scope("assert raw < 0.5; publish pos = raw;"),
         *careful("publish push = clamp(4.0 * (0.55 - pos), -1.0, 1.0);"),
         ("safer abs(pos) < 0.5", "safer pos > 0.3 && pos < 0.6"), named=SILENCE),
    seen("stale", "a gauge that publishes outside its set", "it is latched beyond 0.5",
         ("topic pos: float max_age 20ms;", "topic pos: float in [-1.0, 0.5] max_age 20ms;"),
         *careful("publish push = clamp(4.0 * (0.55 - pos), -1.0, 1.0);"),
         ("safer abs(pos) < 0.5", "safer pos > 0.3 && pos < 0.6"),
         named=(*SILENCE, r"declared sets")),
    seen("stale", "a gauge that stops for good at 2 s", "SC answers its last read for ever",
         scope("if time < 2.0 { publish pos = raw; }"),
         *careful("publish push = clamp(4.0 * (0.5 - pos), -1.0, 1.0);"),
         ("safer abs(pos) < 0.5", "safer pos > 0.2 && pos < 0.6"),
         ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = pos > 0.3 ? -1.0 : 1.0;"),
         named=SILENCE),
    Wrong("stale", "a plant whose sensor may drop out", LINE,
          careful("publish push = clamp(4.0 * (0.4 - pos), -1.0, 1.0);"),
          "the DM hands over when the read is stale, and SC answers a read of any age: to be proved "
          "or named", None, SILENCE),
    Wrong("stale", "a plant that publishes every three seconds under `max_age 20ms`", LINE,
          (("plant Line period 10ms", "plant Line period 3s"),
           ("state x: float = 0.0;", "state x: float = 0.7;")),
          "SC reads what is up to three seconds old", RUN),
    Wrong("stale", "a plant that publishes every 400 ms, and a `max_age` of 400 ms", LINE,
          (("plant Line period 10ms", "plant Line period 400ms"),
           ("max_age 20ms", "max_age 400ms")),
          "`ttf` looks ahead 0.3 s, and needs 0.45", None),
    Wrong("stale", "a second sensor, slower than the first", LINE,
          (("topic pos: float max_age 20ms;",
            "topic pos: float max_age 20ms;\ntopic far: float max_age 20ms;"),
           ("{ p: Line; module Keep;", "{ p: Line; q: Far; module Keep;"),
           declared("plant Far period 3s { reads push; drives far = y; state y: float = 0.7;"
                    " der y = push; }"),
           *careful("publish push = clamp(-4.0 * far, -1.0, 1.0);", reads="far"),
           ("state x: float = 0.0;", "state x: float = 0.7;"),
           ("grid pos in [-1.0, 1.0] / 80;", "grid pos in [-1.0, 1.0] / 80, far in [-1.0, 1.0] / 80;")),
          "SC reads the slow one: three seconds old under a `max_age` of 20 ms", RUN),
    Wrong("stale", "SC reads what the DM does not, without an age", LINE,
          (("topic pos: float max_age 20ms;",
            "topic pos: float max_age 20ms;\ntopic far: float;"),
           ("drives pos = x;", "drives pos = x;\n  drives far = x;"),
           *careful("publish push = clamp(-4.0 * far, -1.0, 1.0);", reads="far")),
          "nothing bounds the age of `far`: it may stop, and the DM does not look at it",
          None, SILENCE),
)

PATHS = (*ORDER, *ESTIMATORS, *ACTUATORS, *STALE)
