"""Random programs of straight steps, flown together in campaigns.

Purpose: branches, early returns, loops over constants, whole numbers, enums, records, arrays and
lists that are indexed, draws, gates that refuse, contracts, and operations that fault in some
flights and not in others; branches that change a list.
Non-goals: other constructs (`random_programs.py`).
"""

from __future__ import annotations

import random

COMPARED = ("<", "<=", ">", ">=", "==", "!=")
NUMBERS = ("0.0", "1.0", "-0.5", "2.5", "0.1", "-3.0")

FIXED = """\
fun Plain(p: Pair, q: float): float {
  var r = q;
  if p.on && r < p.a { return p.b; }
  for i in 0..4 {
    if STEPS[i] > r { return r * STEPS[i] + p.a; }
    r = r + STEPS[i];
  }
  return max(r, p.b);
}
fun Squashed(x: float): float { return x / (1.0 + abs(x)); }
fun Chosen(n: int, q: float): Pair {
  if n > 6 { return { a: q, b: ROWS[n % 3].b, on: true }; }
  return ROWS[n / 3];
}
node Teller period 40ms {
  subscribes y;
  publishes points;
  var all: float[<=5];
  step {
    if all.len > 4 { all = []; }
    push all, y;
    publish points = all;
  }
}
node Calm period 20ms {
  subscribes y;
  publishes command;
  var since: float;
  on takeover { since = 0.0; }
  step {
    since = since + 0.02;
    publish command = vec3(clamp(-y, -1.0, 1.0), 0.0, Squashed(since));
  }
}
"""


class _Text:
    """Random code over the names in `floats` and `bools`."""

    def __init__(
        self, rng: random.Random, floats: list[str], bools: list[str], ints: list[str] | None = None
    ) -> None:
        self.rng, self.floats, self.bools, self.ints = rng, floats, bools, ints or []

    def number(self, depth: int) -> str:
        """A float; now and then one that faults."""
        rng = self.rng
        if depth == 0 or rng.random() < 0.15:
            return rng.choice([*self.floats * 4, *NUMBERS])
        a, b = self.number(depth - 1), self.number(depth - 1)
        return rng.choice(
            [
                *(f"({a} {op} {b})" for op in ("+", "-", "*")),
                f"({a} / (1.0 + abs({b})))",
                f"min({a}, {b})",
                f"max({a}, {b})",
                f"abs({a})",
                f"(-{a})",
                f"floor({a})",
                f"sqrt(abs({a}))",
                f"({self.truth(depth - 1)} ? {a} : {b})",
                f"Bent({{ a: {a}, b: {b}, on: {self.truth(depth - 1)} }}, {a})",
                f"({a} / {b})" if rng.random() < 0.1 else f"({a} - {b})",
                *self._by_whole(depth),
            ]
        )

    def _by_whole(self, depth: int) -> list[str]:
        """Floats that whole numbers lead to."""
        if not self.ints:
            return []
        n = self.whole(depth - 1)
        return [f"float({n})", f"STEPS[abs({n}) % 4]", f"Chosen(abs({n}) % 9, {self.number(0)}).b"]

    def whole(self, depth: int) -> str:
        """A small whole number; now and then its computation faults."""
        rng = self.rng
        if depth <= 0 or rng.random() < 0.2:
            return rng.choice([*self.ints * 2, "1", "3", "-2"])
        a, b = self.whole(depth - 1), self.whole(depth - 1)
        return rng.choice(
            [
                *(f"({a} {op} {b}) % 50" for op in ("+", "-", "*")),
                f"({a} / (1 + abs({b})))",
                f"({a} % (2 + abs({b})))",
                f"({a} / {b})" if rng.random() < 0.1 else f"(-{a})",
                f"min({a}, {b})",
                f"max({a}, {b})",
                f"int({self.number(0)} * 3.0) % 50",
                f"({self.truth(0)} ? {a} : {b})",
            ]
        )

    def truth(self, depth: int) -> str:
        """A truth value."""
        rng = self.rng
        if depth == 0 and self.bools:
            return rng.choice(self.bools)
        a, b = self.number(max(0, depth - 1)), self.number(max(0, depth - 1))
        compared = f"{a} {rng.choice(COMPARED)} {b}"
        if depth == 0:
            return f"({compared})"
        c, d = self.truth(depth - 1), self.truth(depth - 1)
        whole = [f"({self.whole(1)} {rng.choice(COMPARED)} {self.whole(1)})"] if self.ints else []
        return rng.choice([f"({compared})", f"({c} && {d})", f"({c} || {d})", f"(!{c})", *whole])

    def changes(self, names: list[str], depth: int) -> str:
        """Statements that change variables, some of them under conditions.

        What they become is small and depends on the wind: worlds stay apart, none comes to rest.
        """
        rng, lines = self.rng, []
        for _ in range(rng.randint(1, 3)):
            name = rng.choice(names)
            if "n" in self.ints and rng.random() < 0.3:
                lines.append(self._counted())
            elif depth and rng.random() < 0.5:
                then, otherwise = (self.changes(names, depth - 1) for _ in range(2))
                lines.append(f"if {self.truth(1)} {{ {then} }} else {{ {otherwise} }}")
            elif depth and rng.random() < 0.4:
                lines.append(
                    f"for i in 0..4 {{ if STEPS[i] < {self.number(1)} "
                    f"{{ {name} = 3.0 * Squashed({name} + STEPS[i] * {self.number(1)}); }} }}"
                )
            else:
                lines.append(f"{name} = 3.0 * Squashed(wind + {self.number(2)});")
        return " ".join(lines)

    def _counted(self) -> str:
        """A statement that changes whole numbers, or arrays and a list that they lead into."""
        return self.rng.choice(
            [
                f"n = abs({self.whole(2)}) % 10;",
                f"total = {self.whole(2)};",
                f"cells[abs({self.whole(1)}) % 3] = {self.whole(1)};",
                f"row[abs({self.whole(1)}) % 3] = 3.0 * Squashed(wind + {self.number(1)});",
                f"phase = {self.truth(1)} ? Phase.Low : {self.truth(0)} ? Phase.High : phase;",
                f"if {self.truth(1)} && wind > 2.0 {{ seen = [m, {self.number(1)}]; }}",
                "if seen.len > n { m = seen[n]; }",
                "if points.len > 0 { m = Squashed(points[n % points.len]); }",
                "for s in seen { m = Squashed(m + s); }",
                "if n > 7 { total = total * 9223372036854775807 % 50; }",
            ]
        )


def _mass(rng: random.Random) -> str:
    """The plant."""
    plant = _Text(rng, ["s", "v", "d.x", "command.x"], [])
    return f"""plant Mass period 10ms {{
  reads command;
  drives y = s;
  state s: float;
  state v: float = 0.5;
  disturbance d: Vec3 in [-1.0, 1.0] hold {rng.choice((10, 30))}ms;
  der s = v;
  der v = clamp({plant.number(2)}, -5.0, 5.0) - s;
  measured y within 0.1;
}}
"""


def _declared(rng: random.Random, gain: str) -> str:
    """Types, constants and topics."""
    return f"""soter 1;
type Pair = {{ a: float, b: float, on: bool }};
type Phase = enum {{ Low, Middle, High }};
type Tally = {{ n: int in [0, 9], total: int in [-200, 200], phase: Phase }};
const ROWS: Pair[3] = [
  {{ a: 0.5, b: -1.0, on: true }}, {{ a: 2.0, b: 0.25, on: false }},
  {{ a: -3.0, b: 1.5, on: true }},
];
const STEPS: float[4] = [0.5, -1.0, {rng.choice(NUMBERS)}, 2.0];
input topic wind: float in [-3.0, 3.0];
topic y: float;
topic made: Pair;
topic told: float in [-{gain}, {gain}];
topic counted: Tally in {{ n in [0, {rng.choice((7, 9))}] }};
topic points: float[<=5];
topic command: Vec3 in [-1.0, 1.0];
"""


def _bold(ac: _Text) -> str:
    """AC."""
    return f"""node Bold period 20ms {{
  subscribes y, wind, made, counted;
  publishes command;
  var held: float;
  step {{
    {ac.changes(["held"], 1)}
    let along = clamp(0.45 * held, -1.02, 1.02) + 0.03 * wind * y;
    publish command = vec3(along, Squashed({ac.number(1)}), 0.0);
  }}
}}
"""


def program(number: int, faults: str = "") -> str:
    """Program `number`; its system is `Whole`, its module `Guard`, a node of it `Shape`."""
    rng = random.Random(number)  # noqa: S311 - programs
    inside = _Text(rng, ["p.a", "p.b", "q", "r"], ["p.on"])
    node = _Text(
        rng,
        ["y", "wind", "m", "all.a", "row[1]", "row[n % 3]", "age(points)"],
        ["flag", "all.on", "(phase == Phase.High)", "(mode(Guard) == Mode.SC)"],
        ["n", "total", "cells[n % 3]", "cells[1]", "points.len"],
    )
    counted = ["counted.n", "counted.total"]
    ac = _Text(rng, ["y", "wind", "held", "made.a"], ["made.on"], counted)
    dm = _Text(rng, ["y", "made.a", "made.b"], ["made.on", "(counted.phase != Phase.Low)"], counted)
    gain = rng.choice(["1.0", "4.0", "30.0"])
    return f"""{_declared(rng, gain)}
fun Bent(p: Pair, q: float): float {{
  let r = Plain(p, q);
  if r < q {{ return {inside.number(1).replace("Bent", "Plain")}; }}
  return {inside.number(1).replace("Bent", "Plain")};
}}

{_mass(rng)}node Shape period {rng.choice((10, 20))}ms {{
  subscribes y, wind, points;
  publishes made, told, counted;
  {rng.choice(("", "assumes abs(y) < 0.4; guarantees counted.n < 8 || made.on;"))}
  var m: float;
  var flag: bool;
  var all: Pair;
  var row: float[3];
  var n: int in [0, 9];
  var total: int;
  var cells: int[3];
  var phase: Phase;
  var seen: float[<=2];
  step {{
    {node.changes(["m", "all.a", "all.b", "row[0]", "row[1]"], 2)}
    flag = {node.truth(2)};
    all.on = {node.truth(1)};
    {rng.choice(("", "", "assert wind < 2.9;"))}
    if {node.truth(1)} {{ publish told = {gain} * Squashed(m); }}
    if {rng.choice(("true", node.truth(1)))} {{
      publish counted = {{ n: n, total: total % 200, phase: phase }};
    }}
    publish made = {{ a: clamp(all.a, -9.0, 9.0), b: clamp(row[1], -9.0, 9.0), on: flag }};
  }}
}}
{_bold(ac)}{FIXED}rta Guard {{
  ac Bold;
  sc Calm;
  period 20ms;
  safe abs(y) < 9.0;
  ttf {dm.truth(2)} && abs(y) > 0.3;
  safer {dm.truth(1)} || abs(y) < 0.2;
}}
system Whole default {{
  d: Mass;
  node Teller;
  node Shape;
  module Guard;
  input wind every {rng.choice((15, 40))}ms;
  until 3s;
  {rng.choice(("", "", "force Guard ac;"))}
  always abs(d.truth.s) < 0.5;
  never {dm.truth(2)};
  {faults}
}}
"""
