"""Wrong modules because of what stands behind SC, and of sensors that fall silent.

Purpose: `ACTUATORS`, `STALE`.
Non-goals: longer ways (`ways.py`).
"""

from __future__ import annotations

from functools import partial

from bench.wrong_modules.base import LINE, under
from bench.wrong_modules.controllers import careful, declared, one
from bench.wrong_modules.paths import (
    CMD,
    NAMES_SERVO,
    scope,
    seen,
    servo,
)

of_actuators = partial(seen, "actuators", named=NAMES_SERVO)
ACTUATORS = (
    of_actuators(
        "a filter of 5 s before the plant",
        "commands act late and little by little",
        *servo("f = f + 0.002 * (push - f); publish force = f;", "var f: float = 0.0;"),
    ),
    of_actuators(
        "a rate limiter before the plant",
        "a second from left to right",
        *servo(
            "f = f + clamp(push - f, -0.02, 0.02); publish force = clamp(f, -1.0, 1.0);",
            "var f: float = 0.0;",
        ),
    ),
    of_actuators(
        "a hold of half a second before the plant",
        "half a second more of AC",
        *servo("publish force = push;", period="500ms"),
        named=(),
    ),
    of_actuators(
        "a delay of 40 samples before the plant",
        "0.4 s more of AC",
        *servo(
            "publish force = xs[n]; xs[n] = push; n = n < 39 ? n + 1 : 0;",
            "var xs: float[40];",
            "var n: int in [0, 39] = 0;",
        ),
    ),
    of_actuators(
        "a dead band before the plant",
        "what is smaller than 1 is nothing",
        *servo("publish force = abs(push) < 0.99 ? 0.2 : push;"),
        ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-4.0 * pos, -0.9, 0.9);"),
    ),
    of_actuators(
        "a wire crossed before the plant",
        "the sign is wrong",
        *servo("publish force = -push;"),
        shown=under(("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = -0.9;")),
    ),
    of_actuators(
        "an actuator that keeps pushing right",
        "it only knows one way",
        *servo("publish force = max(push, 0.1);"),
    ),
    of_actuators(
        "an actuator that stops after 3 s",
        "then it pushes right",
        *servo("publish force = time < 3.0 ? push : 1.0;"),
    ),
    of_actuators(
        "an actuator that faults when it changes its mind",
        "latched, it holds 1.0",
        *servo("assert push * f >= 0.0; f = push; publish force = push;", "var f: float = 0.0;"),
    ),
    of_actuators(
        "an actuator that counts commands in a queue",
        "its queue overflows: latched",
        *CMD,
        declared(
            "node Servo period 200ms {\n  subscribes push queue 1 fault;\n"
            "  publishes force;\n  failsafe force = 1.0;\n"
            "  step { for p in push { publish force = p; } }\n}"
        ),
        named=(),
    ),
    of_actuators(
        "no model: a hold of half a second before the plant",
        "half a second more of AC",
        (
            "topic push: float in [-1.0, 1.0] = 0.0;",
            "topic push: float in [-1.0, 1.0] = 0.0;\ntopic force: float in [-1.0, 1.0] = 0.0;",
        ),
        ("  reads push;", "  reads force;"),
        ("der x = push;", "der x = force;"),
        declared(
            "node Servo period 500ms { subscribes push; publishes force;"
            " step { publish force = push; } }"
        ),
        ("{ p: Line; module Keep;", "{ p: Line; node Servo; module Keep;"),
        base=LINE,
        named=(),
    ),
    of_actuators(
        "no model: a filter before the plant",
        "commands act late",
        (
            "topic push: float in [-1.0, 1.0] = 0.0;",
            "topic push: float in [-1.0, 1.0] = 0.0;\ntopic force: float in [-1.0, 1.0] = 0.0;",
        ),
        ("  reads push;", "  reads force;"),
        ("der x = push;", "der x = force;"),
        declared(
            "node Servo period 10ms { subscribes push; publishes force; var f: float = 0.0;"
            " step { f = f + 0.002 * (push - f); publish force = clamp(f, -1.0, 1.0); } }"
        ),
        ("{ p: Line; module Keep;", "{ p: Line; node Servo; module Keep;"),
        base=LINE,
    ),
)

# ---------------------------------------------------------------- sensors that fall silent

SILENCE = (r"never drop out", r"outage")

of_stale = partial(seen, "stale", named=SILENCE)
of_plants = partial(one, "stale")
STALE = (
    of_stale(
        "a gauge that says nothing beyond 0.6",
        "the DM sees that it is stale and hands over to an SC that answers the last read",
        scope("if raw < 0.6 { publish pos = raw; }"),
        *careful("publish push = clamp(4.0 * (0.62 - pos), -1.0, 1.0);"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.75"),
        ("safer abs(pos) < 0.5", "safer pos > 0.3 && pos < 0.7"),
    ),
    of_stale(
        "a gauge that is latched by a fault of its own",
        "after it asserts, nobody publishes `pos` any more",
        scope("assert raw < 0.5; publish pos = raw;"),
        *careful("publish push = clamp(4.0 * (0.55 - pos), -1.0, 1.0);"),
        ("safer abs(pos) < 0.5", "safer pos > 0.3 && pos < 0.6"),
    ),
    of_stale(
        "a gauge that publishes outside its set",
        "it is latched beyond 0.5",
        ("topic pos: float max_age 20ms;", "topic pos: float in [-1.0, 0.5] max_age 20ms;"),
        *careful("publish push = clamp(4.0 * (0.55 - pos), -1.0, 1.0);"),
        ("safer abs(pos) < 0.5", "safer pos > 0.3 && pos < 0.6"),
        named=(*SILENCE, r"declared sets"),
    ),
    of_stale(
        "a gauge that stops for good at 2 s",
        "SC answers its last read for ever",
        scope("if time < 2.0 { publish pos = raw; }"),
        *careful("publish push = clamp(4.0 * (0.5 - pos), -1.0, 1.0);"),
        ("safer abs(pos) < 0.5", "safer pos > 0.2 && pos < 0.6"),
        ("publish push = pos >= 0.0 ? 1.0 : -1.0;", "publish push = pos > 0.3 ? -1.0 : 1.0;"),
    ),
    of_plants(
        "a plant whose sensor may drop out",
        "the DM hands over when the read is stale, and SC answers a read of any age: to be proved "
        "or named",
        careful("publish push = clamp(4.0 * (0.4 - pos), -1.0, 1.0);"),
        None,
        named=SILENCE,
    ),
    of_plants(
        "a plant that publishes every three seconds under `max_age 20ms`",
        "SC reads what is up to three seconds old",
        (
            ("plant Line period 10ms", "plant Line period 3s"),
            ("state x: float = 0.0;", "state x: float = 0.7;"),
        ),
    ),
    of_plants(
        "a plant that publishes every 400 ms, and a `max_age` of 400 ms",
        "`ttf` looks ahead 0.3 s, and needs 0.45",
        (("plant Line period 10ms", "plant Line period 400ms"), ("max_age 20ms", "max_age 400ms")),
        None,
    ),
    of_plants(
        "a second sensor, slower than the first",
        "SC reads the slow one: three seconds old under a `max_age` of 20 ms",
        (
            (
                "topic pos: float max_age 20ms;",
                "topic pos: float max_age 20ms;\ntopic far: float max_age 20ms;",
            ),
            ("{ p: Line; module Keep;", "{ p: Line; q: Far; module Keep;"),
            declared(
                "plant Far period 3s { reads push; drives far = y; state y: float = 0.7;"
                " der y = push; }"
            ),
            *careful("publish push = clamp(-4.0 * far, -1.0, 1.0);", reads="far"),
            ("state x: float = 0.0;", "state x: float = 0.7;"),
            (
                "grid pos in [-1.0, 1.0] / 80;",
                "grid pos in [-1.0, 1.0] / 80, far in [-1.0, 1.0] / 80;",
            ),
        ),
    ),
    of_plants(
        "SC reads what the DM does not, without an age",
        "nothing bounds the age of `far`: it may stop, and the DM does not look at it",
        (
            ("topic pos: float max_age 20ms;", "topic pos: float max_age 20ms;\ntopic far: float;"),
            ("drives pos = x;", "drives pos = x;\n  drives far = x;"),
            *careful("publish push = clamp(-4.0 * far, -1.0, 1.0);", reads="far"),
        ),
        None,
        named=SILENCE,
    ),
)
