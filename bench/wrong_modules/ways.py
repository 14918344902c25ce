"""Wrong modules because of longer ways: several nodes, other modules, several outputs, drop-outs.

Purpose: `WAYS`: what a model of time along paths has to follow, and where it might stop too early.
Non-goals: single nodes (`paths.py`).
"""

from __future__ import annotations

from functools import partial

from bench.wrong_modules.base import LINE as LIN
from bench.wrong_modules.base import Edit, Shown, Wrong, under
from bench.wrong_modules.controllers import GOES, careful, declared, one
from bench.wrong_modules.paths import CMD, QUICK, SCOPE, scope, seen, servo, start

PUSH = under((GOES, "publish push = 1.0;"))
SCOPE_LINE = "  node Scope;\n"
INNER = (
    "node Draft period {p} {{ subscribes push; publishes force; step {{ publish force = push; }} }}"
    "\nnode Sound period {p} {{ subscribes push; publishes force;"
    " step {{ publish force = push; }} }}\n"
    "rta Inner {{ ac Draft; sc Sound; period {p}; safe true; ttf false; safer true; }}"
)
EYES = (
    "node Draft period {p} {{ subscribes raw; publishes pos; step {{ publish pos = raw; }} }}\n"
    "node Sound period {p} {{ subscribes raw; publishes pos; step {{ publish pos = raw; }} }}\n"
    "rta Eyes {{ ac Draft; sc Sound; period {p}; safe true; ttf false; safer true; }}"
)
KEEP = ("--module", "Keep")
HELD = "what SC publishes waits for a later node's next step: AC's command acts that much longer"
OLD = "what SC reads is as old as the publisher's period"

seen_ways = partial(seen, "ways", named=())
MODULES = (
    seen_ways(
        "another module estimates, every three seconds",
        OLD,
        (SCOPE, EYES.format(p="3s")),
        (SCOPE_LINE, "  module Eyes;\n"),
        *start("0.7"),
        ("topic pos: float max_age", "topic pos: float in [-1e9, 1e9] max_age"),
        options=KEEP,
    ),
    seen_ways(
        "another module estimates, every half second, of a fast plant",
        OLD,
        (SCOPE, EYES.format(p="500ms")),
        (SCOPE_LINE, "  module Eyes;\n"),
        *QUICK,
        ("topic pos: float max_age", "topic pos: float in [-1e9, 1e9] max_age"),
        options=KEEP,
    ),
    seen_ways(
        "another module drives the plant, every 700 ms",
        HELD,
        *(e for e in CMD if "node Servo" not in e[1]),
        declared(INNER.format(p="700ms")),
        (SCOPE_LINE, "  node Scope;\n  module Inner;\n"),
        options=KEEP,
    ),
    seen_ways(
        "another module drives the plant and turns the sign",
        "its SC has crossed wires",
        *(e for e in CMD if "node Servo" not in e[1]),
        declared(INNER.format(p="50ms").replace("force = push;", "force = -push;")),
        (SCOPE_LINE, "  node Scope;\n  module Inner;\n"),
        shown=under((GOES, "publish push = -0.9;")),
        named=(r"\bInner\b", r"\bSound\b"),
        options=KEEP,
    ),
)

MID = (
    "topic push: float in [-1.0, 1.0] = 0.0;",
    (
        "topic push: float in [-1.0, 1.0] = 0.0;\ntopic mid: float in [-1.0, 1.0] = 0.0;\n"
        "topic force: float in [-1.0, 1.0] = 0.0;"
    ),
)
TWO: tuple[Edit, ...] = (
    MID,
    *(e for e in CMD if "topic force" not in e[1] and "node Servo" not in e[1]),
    (SCOPE_LINE, "  node Scope;\n  node Servo;\n  node Relay;\n"),
)


def relayed(first: str, second: str) -> tuple[Edit, ...]:
    """Two nodes between SC and the plant."""
    return (
        *TWO,
        declared(
            f"node Servo period {first} {{ subscribes push; publishes mid;"
            " step { publish mid = push; } }\n"
            f"node Relay period {second} {{ subscribes mid; publishes force;"
            " step { publish force = mid; } }"
        ),
    )


OUTWARD = (
    seen_ways(
        "a second node behind the actuator's, every 700 ms",
        HELD,
        *relayed("10ms", "700ms"),
    ),
    seen_ways(
        "a second node behind the actuator's, every 500 ms",
        HELD,
        *relayed("50ms", "500ms"),
    ),
    seen_ways(
        "three nodes of 10 ms and a slow one in the middle",
        HELD,
        *relayed("600ms", "10ms"),
    ),
    seen_ways(
        "the actuator's node reads a queue and takes the oldest",
        "of 50 commands it keeps the first that came: half a second old",
        *CMD,
        declared(
            "node Servo period 500ms { subscribes push queue 50 drop_newest;"
            " publishes force; step { publish force = push.len > 0 ? push[0] : 1.0; }"
            " }"
        ),
    ),
    seen_ways(
        "the actuator's node publishes every 70th step only",
        HELD,
        *servo(
            "n = n < 69 ? n + 1 : 0; if n == 0 { publish force = push; }",
            "var n: int in [0, 69] = 0;",
        ),
    ),
    seen_ways(
        "the actuator's node does not publish small commands",
        "SC's -0.9 is small: the plant keeps AC's 1.0",
        *servo("if abs(push) > 0.95 { publish force = push; }"),
        ("clamp(-4.0 * pos, -1.0, 1.0);", "clamp(-4.0 * pos, -0.9, 0.9);"),
    ),
)

SOMETIMES = "it publishes only now and then: what SC reads in between is of any age"

INWARD = (
    seen_ways(
        "an estimator that publishes only what is new",
        SOMETIMES,
        scope("if abs(raw) > 0.95 { publish pos = raw; }"),
        *start("0.96"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7"),
        *careful("publish push = clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    seen_ways(
        "an estimator that publishes in a branch that time closes",
        SOMETIMES,
        scope("if time < 0.05 { publish pos = raw; }"),
        *start("0.7"),
    ),
    seen_ways(
        "an estimator that publishes when it likes to",
        SOMETIMES,
        scope(
            "if choose { false, false, false, false, false, false, false, false, false, false,"
            " false, false, false, false, false, false, false, false, false, true }"
            " { publish pos = raw; }"
        ),
        *QUICK,
        shown=Shown(("run", "--until", "300s")),
    ),
    seen_ways(
        "a second estimator takes over from the first, later",
        "Late publishes what Scope read 600 ms ago, on the same path",
        ("topic push: float", "topic mid: float max_age 20ms;\ntopic push: float"),
        (
            SCOPE,
            (
                "node Scope period 10ms { subscribes raw; publishes mid;"
                " step { publish mid = raw; } }\n"
                "node Late period 10ms { subscribes mid queue 60; publishes pos;"
                " step { publish pos = mid.len > 0 ? mid[0] : 0.0; } }"
            ),
        ),
        (SCOPE_LINE, "  node Scope;\n  node Late;\n"),
        *start("0.7"),
        shown=None,
    ),
)

INNER_SERVO = (
    "node Servo period 50ms {{ subscribes push, raw; publishes mid;"
    " step {{ publish mid = raw > 9.0 ? 0.0 : push; }} }}\n"
    "node Relay period {p} {{ subscribes mid; publishes force; step {{ publish force = mid; }} }}"
)
INNER_WAYS = (
    seen_ways(
        "a node behind SC that also reads the sensor, and a slow one behind it",
        HELD,
        *TWO,
        declared(INNER_SERVO.format(p="700ms")),
    ),
    seen_ways(
        "the flying plant shows itself every 600 ms, the estimator every 10 ms",
        "the stamp is fresh, the state up to 610 ms old",
        ("plant Body period 10ms", "plant Body period 600ms"),
        shown=PUSH,
    ),
)

# one output goes through a node, the other one does not: they do not switch together
SKEWED = (
    (
        "topic push: float in [-1.0, 1.0] = 0.0;",
        (
            "topic push: float in [-1.0, 1.0] = 0.0;\ntopic pull: float in [-1.0, 1.0] = 0.0;\n"
            "topic force: float in [-1.0, 1.0] = 0.0;"
        ),
    ),
    (
        (
            "plant Body period 10ms {\n  reads push;\n  drives raw = x;\n  state x: float = 0.0;\n"
            "  der x = push;"
        ),
        (
            "plant Body period 10ms {\n  reads force, pull;\n  drives raw ="
            " x;\n  state x: float = 0.0;\n"
            "  der x = 5.0 * force * pull - x;"
        ),
    ),
    (
        (
            "plant Model period 10ms {\n  reads push;\n  drives pos = x;\n  state x: float = 0.0;\n"
            "  der x = push;"
        ),
        (
            "plant Model period 10ms {\n  reads push, pull;\n  drives pos ="
            " x;\n  state x: float = 0.0;\n"
            "  der x = 5.0 * push * pull - x;"
        ),
    ),
    (SCOPE_LINE, "  node Scope;\n  node Servo;\n"),
    ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.3"),
    ("safer abs(pos) < 0.5", "safer abs(pos) < 0.2"),
    (
        "publishes push;\n  " + GOES.join(("step { ", " }")),
        "publishes push, pull;\n  step { publish push = 1.0; publish pull = 1.0; }",
    ),
    (
        "publishes push;\n  step { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
        (
            "publishes push, pull;\n  var odd: bool = false;\n"
            "  step { odd = !odd; publish push = odd ? 1.0 : 0.0; publish pull = odd ? 0.0 : 1.0; }"
        ),
    ),
)
APART = "the two outputs do not switch at once: in between both are 1, and the plant creeps out"


def skewed(phase: str, name: str) -> Wrong:
    """Two outputs that must switch together."""
    return seen_ways(
        name,
        APART,
        *SKEWED,
        declared(
            f"node Servo period 50ms phase {phase} {{ subscribes push; publishes force;"
            " step { publish force = push; } }"
        ),
        shown=Shown(("run", "--until", "60s")),
    )


SKEW = (
    skewed("30ms", "two outputs, one of them 30 ms later through a node"),
    skewed("40ms", "two outputs, one of them 40 ms later through a node"),
)

SILENT = "the declared silence of a sensor is longer than SC can do without"


def silent(text: str, *more: Edit) -> tuple[Edit, ...]:
    """A drop-out that is declared."""
    return (("acts within 0ms;", f"acts within 0ms;\n    dropout {text};"), *more)


DROPOUTS = (
    seen_ways(
        "a declared drop-out of a second, a fast plant",
        SILENT,
        *silent("1s"),
        *QUICK,
        shown=None,
    ),
    seen_ways("a declared drop-out of three seconds", SILENT, *silent("3s"), shown=None),
    one(
        "ways",
        "a declared drop-out of three seconds, without a model",
        SILENT,
        silent("3s"),
        None,
        LIN,
    ),
    one(
        "ways",
        "a declared drop-out of 400 ms: SC follows a goal near the wall",
        SILENT,
        (
            *silent("400ms"),
            *careful("publish push = clamp(8.0 * (0.85 - pos), -1.0, 1.0);"),
            ("safer abs(pos) < 0.5", "safer pos > 0.2 && pos < 0.9"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.9"),
        ),
        None,
        LIN,
    ),
)

LATE_TWINS = (
    "test Late { system World; late Scope by 60ms; late Twin by 60ms; quantum 20ms;"
    " horizon 60ms; always abs(b.truth.x) < 1.0; }\nsystem World default {"
)
MIXED = (
    seen_ways(
        "two estimators of one kind: one has spoken, the other has not yet",
        "SC sees a state beside a default and asserts that both are near: it is latched",
        *start("0.45"),
        (
            "topic pos: float max_age 20ms;",
            "topic pos: float max_age 200ms;\ntopic far: float max_age 200ms;",
        ),
        ("  drives pos = x;\n", "  drives pos = x;\n  drives far = x;\n"),
        ("measured pos within 0.02;", "measured pos within 0.02, far within 0.02;"),
        (
            SCOPE,
            (
                "node Scope period 100ms { subscribes raw; publishes"
                " pos;"
                " step { publish pos = raw; } }\n"
                "node Twin period 100ms { subscribes raw; publishes far; step {"
                " publish far = raw; } }"
            ),
        ),
        (SCOPE_LINE, "  node Scope;\n  node Twin;\n"),
        *careful(
            "assert abs(pos - far) < 0.4; publish push = clamp(-0.8 * (pos + far), -1.0, 1.0);",
            reads="pos, far",
        ),
        ("late dm 0ms, sc 0ms", "late dm 0ms, sc 0ms, Scope 60ms, Twin 60ms"),
        ("response dm 0ms, sc 0ms", "response dm 0ms, sc 0ms, Scope 0ms, Twin 0ms"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.4"),
        ("safer abs(pos) < 0.5", "safer abs(pos) < 0.3"),
        shown=Shown(("test",), (("system World default {", LATE_TWINS),)),
        named=(r"what SC reads together shows the plants at one instant: pos, far",),
    ),
)

TIMES_OF_NODES = (
    seen_ways(
        "a declared lateness of the estimator's, longer than its period",
        "an estimator that is 200 ms late, every 10 ms, is never done",
        ("late dm 0ms, sc 0ms", "late dm 0ms, sc 0ms, Scope 200ms"),
        shown=None,
    ),
    seen_ways(
        "a declared lateness of the estimator's, and a bold `ttf`",
        "9 ms late: what is read is 9 ms older, and the wall is nearer than that",
        ("late dm 0ms, sc 0ms", "late dm 0ms, sc 0ms, Scope 9ms"),
        ("response dm 0ms, sc 0ms", "response dm 0ms, sc 0ms, Scope 1ms"),
        ("max_age 20ms;\ntopic push", "max_age 40ms;\ntopic push"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.93"),
        shown=None,
    ),
    seen_ways(
        "an estimator every 40 ms, and a bold `ttf`",
        "stamp 40 ms old, state 40 ms older still",
        scope("publish pos = raw;", period="40ms"),
        ("max_age 20ms;\ntopic push", "max_age 60ms;\ntopic push"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.93"),
        shown=PUSH,
    ),
)

WAYS = (*INNER_WAYS, *MIXED, *TIMES_OF_NODES, *MODULES, *OUTWARD, *INWARD, *SKEW, *DROPOUTS)
