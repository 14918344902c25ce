"""Tests of programs that would be clean for want of looking: nothing judged, or times left out.

Purpose: small programs, each with one `test T`, by what is wrong with them.
Non-goals: exploring them (`tests/unit/explore/test_empty_tests.py`).
"""

from __future__ import annotations

from random import Random

HEAD = """soter 1;
topic x: int in [0, 9] = 0;
topic y: bool = false;
input topic wish: int in [0, 3] = 0;
"""
NODES = """node A period 10ms phase {phase} {{
  publishes x;
  var n: int in [0, 9] = 0;
  step {{ n = n < 9 ? n + 1 : 9; publish x = n; }}
}}
node B period 10ms phase {phase} {{
  subscribes x{more};
  publishes y;
  step {{ {step} }}
}}
"""
WATCHES = "publish y = x > 100;"


def judged(
    items: str,
    *,
    step: str = WATCHES,
    phase: str = "0ms",
    more: str = "",
    inputs: str = "",
    nodes: str = "",
) -> str:
    """A program with a test of these items."""
    body = NODES.format(phase=phase, step=step, more=more)
    return (
        f"{HEAD}{nodes}{body}system S {{ node A; node B; {inputs}until 1s; }}\n"
        f"test T {{ system S; {items} }}\n"
    )


LATE_NODE = """node C period 10s phase 9s {
  subscribes x;
  publishes z;
  assumes x > 100;
  step { publish z = x; }
}
"""
NOTHING_JUDGED = {
    "always false before the first release": judged("horizon 5ms; always false;", phase="9ms"),
    "never true before the first release": judged("horizon 5ms; never true;", phase="9ms"),
    "a nanosecond before it": judged("horizon 8999999ns; always x < 0;", phase="9ms"),
    "two of them": judged("horizon 5ms; always false; never true;", phase="9ms"),
    "under skew": judged("horizon 5ms; skew 1ms; always false;", phase="9ms"),
    "where releases may be lost": judged(
        "horizon 5ms; skip A at most 2; always false;", phase="9ms"
    ),
    "a premise that is never true": judged("horizon 50ms; x > 8 leadsto y within 10ms;"),
    "a premise that is true too late": judged("horizon 50ms; x > 4 leadsto y within 20ms;"),
    "two such premises": judged(
        "horizon 50ms; x > 8 leadsto y within 10ms; x < 0 leadsto y within 10ms;"
    ),
    "deadlines beyond the horizon": judged(
        "horizon 100ms; x == 9 leadsto y within 95ms;", phase="5ms"
    ),
    "no property": judged("horizon 50ms;"),
    "no property under skew": judged("horizon 50ms; skew 3ms;"),
    "a contract of a node that never steps": judged(
        "horizon 50ms;", nodes="topic z: int in [0, 9] = 0;\n" + LATE_NODE
    ).replace("node B; ", "node B; node C; "),
}
"""Where no property is ever judged."""

UNDRIVEN = {
    "an input that nobody draws": judged(
        "horizon 50ms; always !y;", more=", wish", step="publish y = wish > 2;"
    ),
    "an input in a contract": judged("horizon 50ms; always x >= 0;", more=", wish").replace(
        "publishes y;", "publishes y; assumes wish < 3;"
    ),
    "under skew": judged(
        "horizon 50ms; skew 2ms; always !y;", more=", wish", step="publish y = wish > 2;"
    ),
    "an input of a property": judged("horizon 50ms; always wish < 3 || y;", more=", wish"),
    "a queue of inputs": judged(
        "horizon 50ms; always !y;",
        more=", wish queue 2",
        step="for w in wish { if w > 2 { publish y = true; } }",
    ),
}
"""Where an input keeps its default."""


def timed(step: str, *, items: str = "always !y;", nodes: str = "") -> str:
    """A test in which B may be late by up to 10 ms and looks at the time."""
    return judged(f"horizon 60ms; skew 10ms; {items}", step=step, nodes=nodes)


BETWEEN = "publish y = age(x) > {low} && age(x) < {high};"
GRIDDED = {
    "an age between": timed(BETWEEN.format(low=0.003, high=0.007)),
    "at both ends": timed("publish y = age(x) >= 0.003 && age(x) <= 0.003;"),
    "in seconds of a duration": timed(
        "publish y = age(x) > seconds(3ms) && age(x) < seconds(7ms);"
    ),
    "a constant": timed(
        "publish y = age(x) > LOW && age(x) < LOW + 0.002;", nodes="const LOW: float = 0.004;\n"
    ),
    "a parameter": timed(
        "publish y = age(x) > LOW && age(x) < 0.005;",
        nodes="param LOW: float = 0.002 in [0.0, 1.0];\n",
    ),
    "the other way round": timed("publish y = 0.003 < age(x) && 0.007 > age(x);"),
    "equal": timed("publish y = age(x) == 0.004;"),
    "a local": timed("let a = age(x); publish y = a > 0.003 && a < 0.007;"),
    "an offset": timed("publish y = age(x) - 0.003 > 0.0 && age(x) + 0.003 < 0.01;"),
    "negated": timed("publish y = !(age(x) <= 0.003 || age(x) >= 0.007);"),
    "neighbours": timed(BETWEEN.format(low=0.003, high=0.004)),
    "the time of day": timed("publish y = time > 0.033 && time < 0.037;"),
    "a quotient of whole numbers": timed("publish y = age(x) == 0.003 * float(5 / 2);"),
    "a deadline beside it": timed(
        "publish y = age(x) > 0.004 && age(x) < 1.0;",
        items="y leadsto z within 5ms;",
        nodes="topic z: bool;\nnode E period 10s { publishes z; step { publish z = true; } }\n",
    ).replace("node B; ", "node B; node E; ", 1),
    "in a property": timed(WATCHES, items="always !(age(x) > 0.003 && age(x) < 0.007);"),
    "in a condition": timed("if age(x) > 0.003 { if age(x) < 0.007 { publish y = true; } }"),
    "a choice of two": timed("publish y = age(x) > 0.003 ? age(x) < 0.007 : false;"),
}
"""Where a schedule that is off the grid of periods and skew violates; a finer grid finds it."""

CALCULATED = {
    "a product": timed("publish y = age(x) * 2.0 > 0.006 && age(x) * 2.0 < 0.014;"),
    "a function": timed(
        "publish y = Inside(age(x));",
        nodes="fun Inside(a: float): bool { return a > 0.003 && a < 0.007; }\n",
    ),
    "the smaller one": timed("publish y = min(age(x), 1.0) > 0.003 && age(x) < 0.007;"),
    "twice the time": timed("publish y = time + time == 0.03;"),
    "two ages": timed("publish y = age(x) + age(x) > 0.004 && age(x) + age(x) < 0.006;"),
    "a time less a time less": timed(
        "let was = time - 0.03; publish y = time - (0.0 - was) == 0.0;"
    ),
    "the square": timed("let a = age(x); publish y = abs(a - 0.005) < 0.002;"),
}
"""Where the time is calculated with: no grid is known to be enough."""


def with_item(text: str, item: str) -> str:
    """The program, its test with one item more: `quantum 1ms;`."""
    head = "test T { system S; "
    assert text.count(head) == 1, text
    return text.replace(head, head + item)


def watching(seed: int) -> str:
    """A random program that compares ages, the time and a timer with random thresholds."""
    dice = Random(seed)  # noqa: S311 - the same programs every time are wanted
    steps = [f"let held = age(x) {dice.choice('+-')} {dice.choice((0.0, 0.001, 0.0025))};"]
    timer = "var last: float = 0.0;\n"
    steps.append(f"if x > {dice.randrange(9)} && time - last > {_ms(dice)} {{ last = time; }}")
    clocks = ("age(x)", "time", "held", "time - last", "age(x)")
    compared = [
        f"{dice.choice(clocks)} {dice.choice(('<', '<=', '>', '>=', '=='))} {_ms(dice)}"
        for _ in range(dice.choice((2, 2, 3, 4)))
    ]
    steps.append(f"publish y = {dice.choice((' && ', ' && ', ' || ')).join(compared)};")
    text = judged(
        f"horizon {dice.choice((12, 22))}ms; skew {dice.choice((5, 5, 10))}ms; "
        f"{dice.choice(('late B by 5ms;', '', '', ''))} never y && x > "
        f"{dice.randrange(4)};",
        step=" ".join(steps),
    )
    return text.replace("publishes y;\n  step", f"publishes y;\n  {timer}  step")


def _ms(dice: Random) -> float:
    return dice.choice((1, 2, 3, 4, 5, 7, 10, 12, 15)) / 1000
