"""Small towers for tests: two modules over one axis, with what may be changed in them by name.

Purpose: `tower`: the program; `WRONG_BELOW`, `WRONG_ABOVE`: changes after which the claim of the
module below, or of the one above, must not be proved, with a word of why.
Non-goals: judging anything.
"""

from __future__ import annotations

TOWER = """soter 1;
topic x: float in [-5.0, 5.0] max_age 10ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {
  reads u;
  drives x = p;
  state p: float;
  disturbance w: float in [-0.1, 0.1];
  der p = u + w;
  measured x within 0.02;
}
node Any period 10ms { publishes u; step { publish u = choose { -1.0, 1.0 }; } }
node Near period 10ms {
  subscribes x;
  publishes u;
  step { publish u = clamp(-x, -0.5, 0.5); }
}
node Back period 10ms {
  subscribes x;
  publishes u;
  step { publish u = clamp(-2.0 * x, -1.0, 1.0); }
}
rta Inner {
  ac Any;
  sc Near;
  period 20ms;
  safe abs(x) < 2.0;
  ttf abs(x) > 1.8;
  safer abs(x) < 1.5;
  verify {
    grid x in [-2.2, 2.2] / 220;
    late dm 1ms, sc 1ms;
    response dm 1ms, sc 1ms;
    acts within 1ms;
  }
}
rta Outer {
  ac module Inner;
  sc Back;
  period 50ms;
  safe abs(x) < 3.0;
  ttf abs(x) > 1.7;
  safer abs(x) < 1.6;
  verify {
    grid x in [-3.2, 3.2] / 320;
    late dm 1ms, sc 1ms;
    response dm 1ms, sc 1ms;
    acts within 1ms;
  }
}
system Lane default {
  c: Cart;
  module Outer;
  until 20s;
  always abs(c.truth.p) < 3.0;
  always mode(Outer) == Mode.SC || abs(c.truth.p) < 2.0;
}
"""
GRID = "grid x in [-2.2, 2.2] / 220;"
GENTLE = "step { publish u = clamp(-x, -0.5, 0.5); }"
OUTER_TIMES = """/ 320;
    late dm 1ms, sc 1ms;"""
HIGHEST = """rta Highest {
  ac module Outer;
  sc Still;
  period 100ms;
  safe abs(x) < 4.0;
  ttf abs(x) > 3.8;
  safer abs(x) < 1.0;
}
node Still period 10ms { publishes u; step { publish u = 0.0; } }
system Lane"""

WRONG_BELOW = {
    "given back outside R(H)": ([("safer abs(x) < 1.6", "safer abs(x) < 1.97")], "outside R(H)"),
    "given back outside the grid": (
        [("safer abs(x) < 1.6", "safer abs(x) < 1.6 || x > 4.0")],
        "outside the grid",
    ),
    "given back by what no plant shows": (
        [("safer abs(x) < 1.6", "safer mode(Inner) == Mode.AC")],
        "says nothing of its plants",
    ),
    "given back by a mode, or by what plants show": (
        [("safer abs(x) < 1.6", "safer abs(x) < 1.6 || mode(Inner) == Mode.SC")],
        "says nothing of its plants",
    ),
    "a verdict that comes late is not counted": (
        [
            (GRID, f"{GRID} horizon 34ms;"),
            (OUTER_TIMES, OUTER_TIMES.replace("dm 1ms", "dm 20ms")),
            ("node Back period 10ms", "node Back period 50ms"),
        ],
        "a hand-back of the module above",
    ),
    "a topic without a set": (
        [("topic x: float in [-5.0, 5.0] max_age", "topic x: float max_age")],
        "bounds",
    ),
    "an SC that faults elsewhere": (
        [(GENTLE, "step { assert abs(x) < 2.5; publish u = clamp(-x, -0.5, 0.5); }")],
        "might fault",
    ),
    "an SC that leaves its set elsewhere": (
        [(GENTLE, "step { publish u = -0.25 * x; }")],
        "or publish outside its set",
    ),
    "an SC that keeps nothing": ([(GENTLE, "step { publish u = clamp(x, -0.5, 0.5); }")], "K"),
    "a ttf that asks too late": ([("ttf abs(x) > 1.8", "ttf abs(x) > 1.99")], "ttf"),
    "a takeover that nobody follows": (
        [(GENTLE, f"on takeover {{ assert abs(x) < 2.0; }}\n  {GENTLE}")],
        "on takeover",
    ),
    "two modules above": (
        [("system Lane", HIGHEST), ("module Outer;\n  until", "module Highest;\n  until")],
        "two modules are above it",
    ),
    "a module above that never gives back": (
        [("until 20s;", "force Outer sc; until 20s;")],
        "forced",
    ),
    "a plant that moves in steps": (
        [
            ("der p = u + w;", "next p = p + 0.01 * (u + w);"),
            ("max_age 10ms", "max_age 5ms"),
            ("response dm 1ms, sc 1ms;\n    acts within 1ms;", ""),
            ("late dm 1ms, sc 1ms;", ""),
        ],
        "steps",
    ),
    "an induction": ([(GRID, "induction;")], "induction"),
}
"""Name -> changes of `TOWER` with which `Inner` must not be proved, and a word of why."""
WRONG_ABOVE = {
    "an SC that is too weak": (
        [("-2.0 * x, -1.0, 1.0", "-2.0 * x, -0.05, 0.05")],
        "",
    ),
    "a ttf that looks the other way": ([("ttf abs(x) > 1.7", "ttf x > 1.7")], "ttf"),
    "a ttf that asks too late": ([("ttf abs(x) > 1.7", "ttf abs(x) > 2.99")], "ttf"),
    "given back too early": ([("safer abs(x) < 1.6", "safer abs(x) < 2.99")], "safer"),
    "what the module below keeps is no excuse": ([("ttf abs(x) > 1.7", "ttf false")], "ttf"),
    "a horizon that is too short": ([("/ 320;", "/ 320; horizon 30ms;")], "missing"),
    "a start outside": ([("state p: float;", "state p: float = 3.1;")], "start"),
    "an induction": ([("grid x in [-3.2, 3.2] / 320;", "induction;")], "induction"),
}
"""The same of `Outer`."""


def changed(changes: list[tuple[str, str]]) -> str:
    """The program with every place of each text replaced; ValueError where one is not there."""
    text = TOWER
    for old, new in changes:
        if old not in text:
            raise ValueError(old)
        text = text.replace(old, new)
    return text
