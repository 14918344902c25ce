"""Wrong modules because of the order of steps, and of what is read before anything was published.

Purpose: `ORDER`.
Non-goals: what estimators make of a state (`paths.py`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from bench.wrong_modules.controllers import careful, declared
from bench.wrong_modules.paths import (
    SCOPE,
    default,
    scope,
    seen,
    servo,
    start,
)

if TYPE_CHECKING:
    from bench.wrong_modules.base import Edit

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

of_order = partial(seen, "order", named=())
ORDER = (
    of_order(
        "SC steps before the estimator: the default pulls it out",
        BEFORE,
        *SLOW_SC,
        *start("-0.85"),
        default("0.9"),
    ),
    of_order(
        "the default is on the other side of a door",
        BEFORE,
        *SLOW_SC,
        *start("0.85"),
        default("-1.0"),
    ),
    of_order(
        "the estimator starts a second later",
        "SC answers the default for a second",
        scope("if time >= 1.0 { publish pos = raw; }"),
        default("-0.3"),
    ),
    of_order(
        "the estimator starts 300 ms later, the state is near the border",
        "SC answers the default for 300 ms",
        scope("if time >= 0.3 { publish pos = raw; }"),
        *start("0.8"),
        default("-0.3"),
    ),
    of_order(
        "two nodes on the path, the later one declared first",
        "at 0 s neither has published anything for SC: it reads the default; each adds a period",
        ("topic push: float", "topic mid: float max_age 20ms;\ntopic push: float"),
        (
            SCOPE,
            (
                "node Last period 10ms { subscribes mid; publishes pos;"
                " step { publish pos = mid; } }\n"
                "node First period 10ms { subscribes raw; publishes mid; step {"
                " publish mid = raw; } }"
            ),
        ),
        ("  node Scope;\n", "  node Last;\n  node First;\n"),
        *SLOW_SC,
        *start("-0.85"),
        default("0.9"),
    ),
    of_order(
        "an estimator that is two periods behind",
        "two nodes, each holds what it read for 200 ms: 400 ms old under a `max_age` of 210 ms",
        ("topic push: float", "topic mid: float max_age 210ms;\ntopic push: float"),
        (
            SCOPE,
            (
                "node Last period 200ms { subscribes mid; publishes pos;"
                " step { publish pos = mid; }"
                " }\n"
                "node First period 200ms { subscribes raw; publishes mid; step"
                " { publish mid = raw; } }"
            ),
        ),
        ("  node Scope;\n", "  node Last;\n  node First;\n"),
        ("topic pos: float max_age 20ms;", "topic pos: float max_age 210ms;"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.65"),
    ),
    of_order(
        "two nodes that hold for 200 ms each, in step",
        "half a period apart: 300 ms old under a `max_age` of 210 ms",
        ("topic push: float", "topic mid: float max_age 210ms;\ntopic push: float"),
        (
            SCOPE,
            (
                "node First period 200ms { subscribes raw; publishes mid;"
                " step { publish mid = raw; } }\n"
                "node Last period 200ms phase 100ms { subscribes mid; publishes pos;"
                " step { publish pos = mid; } }"
            ),
        ),
        ("  node Scope;\n", "  node First;\n  node Last;\n"),
        ("topic pos: float max_age 20ms;", "topic pos: float max_age 210ms;"),
        ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.75"),
    ),
    of_order(
        "a fresh stamp on an old sample, after the first sample",
        "First samples every 500 ms, Last republishes every 10 ms, and never a default",
        ("topic push: float", "topic mid: float max_age 1s;\ntopic push: float"),
        (
            SCOPE,
            (
                "node First period 500ms { subscribes raw; publishes mid;"
                " step { publish mid = raw; } }\n"
                "node Last period 10ms phase 5ms { subscribes mid; publishes pos;"
                " step { publish pos = mid; } }"
            ),
        ),
        ("  node Scope;\n", "  node First;\n  node Last;\n"),
    ),
    of_order(
        "the DM believes in a fresh stamp on an old sample",
        "First samples every 500 ms, Last republishes every 10 ms: the stamp is fresh, the state "
        "half a second old",
        ("topic push: float", "topic mid: float max_age 1s;\ntopic push: float"),
        (
            SCOPE,
            (
                "node First period 500ms { subscribes raw; publishes"
                " mid;"
                " step { publish mid = raw; } }\n"
                "node Last period 10ms { subscribes mid; publishes pos; step {"
                " publish pos = mid; } }"
            ),
        ),
        ("  node Scope;\n", "  node First;\n  node Last;\n"),
    ),
    of_order(
        "the actuator's node steps before SC in the instant",
        "the command waits for the actuator's next step, up to 700 ms later",
        *servo("publish force = push;", period="700ms"),
    ),
    of_order(
        "SC before the estimator, and the DM too: a `ttf` of the default",
        "the default looks fine: SC pushes right from 0.9 on",
        *start("0.9"),
        default("-1.0"),
        *SLOW_SC,
    ),
    of_order(
        "SC faults at the default: it asserts that it sees something",
        "at 0 s it reads the default 0.0, and is latched before the estimator's first step",
        *careful("assert pos != 0.0; publish push = clamp(-4.0 * pos + 2.0, -1.0, 1.0);"),
        *start("0.5"),
        ("grid pos in [-1.0, 1.0] / 80", "grid pos in [0.1, 0.9] / 64"),
        ("safe abs(pos) < 1.0", "safe pos > 0.1 && pos < 0.9"),
        ("ttf abs(pos) > 0.7", "ttf pos < 0.3 || pos > 0.7"),
        ("safer abs(pos) < 0.5", "safer pos > 0.4 && pos < 0.6"),
    ),
    of_order(
        "SC divides by the default",
        "at 0 s it divides by 0.0, and is latched",
        *careful("publish push = clamp(2.0 - 4.0 * pos * (pos / pos), -1.0, 1.0);"),
        *start("0.5"),
        ("grid pos in [-1.0, 1.0] / 80", "grid pos in [0.1, 0.9] / 64"),
        ("safe abs(pos) < 1.0", "safe pos > 0.1 && pos < 0.9"),
        ("ttf abs(pos) > 0.7", "ttf pos < 0.3 || pos > 0.7"),
        ("safer abs(pos) < 0.5", "safer pos > 0.4 && pos < 0.6"),
    ),
    of_order(
        "SC looks the default up in a table",
        "the default 9.0 is beyond the table: SC is latched at 0 s",
        declared(
            "const LAW: float[11] = [1.0, 1.0, 1.0, 0.8, 0.4, 0.0, -0.4, -0.8, -1.0, -1.0, -1.0];"
        ),
        *careful("publish push = LAW[int(floor(pos * 4.0 + 5.5))];"),
        default("9.0"),
    ),
    of_order(
        "SC publishes outside its set at the default",
        "the default 3.0 lies outside of the grid: SC's command there is refused",
        *careful("publish push = pos > 2.0 ? 1.5 : clamp(-4.0 * pos, -1.0, 1.0);"),
        default("3.0"),
    ),
    of_order(
        "SC converts the default",
        "the default 1e30 is no int: latched at 0 s",
        *careful("let n = int(pos); publish push = n > 9 ? 0.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
        default("1e30"),
    ),
    of_order(
        "an element of a record has another default than the state",
        BEFORE,
        *start("-0.85"),
        ("topic raw: float", "type Seen = { x: float, n: float };\ntopic raw: float"),
        ("topic pos: float max_age 20ms;", "topic pos: Seen = { x: 0.9, n: 0.0 } max_age 20ms;"),
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
        ("grid pos in", "grid pos.x in"),
    ),
)
