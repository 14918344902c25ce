"""Tests that say nothing, by what is wrong with them; and tests beside them that do say something.

Purpose: small programs, each with one `test T`: of `VACUOUS` each has to be told as such, of
`TELLING` none.
Non-goals: exploring them (`tests/unit/explore/test_vacuous.py`).
"""

from __future__ import annotations

BASE = """soter 1;
type Light = enum {{ Red, Amber, Green }};
type Spot = {{ row: int in [0, 3], far: float }};
param LIMIT: int = 5 in [0, 9];
topic x: int in [0, 9] = 0;
topic y: bool = false;
topic f: float in [0.0, 1.0] = 0.0;
topic g: float = 0.0;
topic light: Light;
topic spot: Spot;
topic late: int in [0, 9] = 2;
topic u: int in [-1, 1] = 0;
topic heard: int in [0, 3] = 0;
topic cell: int in [0, 20] = 10;
input topic wish: int in [0, 3] = 0;
fun Always(n: int): bool {{ return n >= 0 || n < 0; }}
fun Half(n: int): int {{ if n > 5 {{ return 5; }} else {{ return n; }} }}
node A period 10ms {{
  publishes x, y, f, g, light, spot;
  {contract}
  var n: int in [0, 9] = 0;
  step {{
    n = choose {{ n, min(n + 1, 9) }};
    publish x = n;
    publish y = n > 3;
    publish f = float(n) / 10.0;
    publish g = 10.0 - float(n);
    publish light = n > 2 ? Light.Green : Light.Red;
    publish spot = {{ row: min(n, 3), far: float(n) }};
  }}
}}
node Later period 10s phase 5s {{ publishes late; step {{ publish late = 7; }} }}
node Hears period 10ms {{ subscribes wish; publishes heard; step {{ publish heard = wish; }} }}
node Still period 10ms {{ publishes heard; step {{ publish heard = 0; }} }}
node Silent period 10ms {{ subscribes x; step {{ }} }}
node Go period 10ms {{ publishes u; step {{ publish u = choose {{ 1, 0 }}; }} }}
node Back period 10ms {{ subscribes cell; publishes u; step {{ publish u = cell > 10 ? -1 : 0; }} }}
node Anything period 10ms {{ publishes u; step {{ publish u = choose {{ -1, 0, 1 }}; }} }}
plant P period 10ms {{
  reads u;
  drives cell = at;
  state at: int in [0, 20] = 10;
  state fixed: int = 3;
  state w: float = 0.0;
  next at = max(0, min(at + u, 20));
  next w = w + 1.0;
}}
rta M {{
  ac Go;
  sc Back;
  period 20ms;
  {clause}
  safe cell <= 18;
  ttf cell > {ttf};
  safer cell <= 12;
}}
system S {{ node A; node Later; p: P; module M; until 1s; {system} }}
test T {{ system S; horizon 50ms; {test} }}
"""


def program(
    test: str, *, contract: str = "", clause: str = "", ttf: str = "13", system: str = ""
) -> str:
    """A program with a test of these items, a contract of its node `A`, a clause of its module."""
    return BASE.format(test=test, contract=contract, clause=clause, ttf=ttf, system=system)


TAUTOLOGIES = (
    "always x == x",
    "always x >= 0",
    "always x <= 9",
    "never x > 9",
    "never x < 0",
    "always x < 5 || x >= 5",
    "always x != 3 || x == 3",
    "always !(x > 7) || x > 2",
    "always x + 1 > x",
    "always x - x == 0",
    "always x * 2 >= x",
    "always x % 10 == x",
    "always x / 10 == 0",
    "always min(x, 3) <= 3",
    "always max(x, 3) >= 3",
    "always abs(x) == x",
    "always Always(x)",
    "always Half(x) <= 5",
    "always f == f",
    "always f >= 0.0 && f <= 1.0",
    "always f + 1.0 >= 1.0",
    "always f * f >= 0.0",
    "always sqrt(f) <= 1.0",
    "always g * g >= 0.0",
    "always g < 0.0 || g >= 0.0",
    "always abs(g) >= 0.0",
    "always spot.row <= 3",
    "always spot.far == spot.far",
    "always y || !y",
    "never y && !y",
    "always y == y",
    "always light == Light.Red || light == Light.Green || light == Light.Amber",
    "never light == Light.Red && light == Light.Green",
    "always true",
    "never false",
    "always 1 < 2",
    "always LIMIT == 5",
    "always LIMIT <= 9 || x == 4",
    "always time >= 0.0",
    "always time < 10.0",
    "always age(x) >= 0.0",
    "always mode(M) == Mode.SC || mode(M) == Mode.AC",
    "always p.truth.fixed == 3",
    "always p.truth.at <= 20",
    "always late == 2",
    "always late < 7 || x < 3",
    "always x <= 4 || y || !y",
    "always x >= u - 1 || x < u - 1",
    "always x <= u || u <= x",
    "always !(x > 9) || y",
    "always late == 2 || x == 0",
    "always late == 7 ? y : true",
)
"""No value of what they read violates them."""

RELATED = (
    "always f <= g || g <= f",
    "always f < g || f >= g",
    "always f + g == g + f",
    "always !(f < g) || !(g < f)",
)
"""Likewise; floats are compared with each other, which a solver decides where it is installed."""

TIMED = (
    "eventually x < 3 within 20ms",
    "eventually x == x within 20ms",
    "eventually x >= 0 within 20ms",
    "eventually true within 20ms",
    "x > 3 leadsto x >= 0 within 10ms",
    "x > 9 leadsto y within 10ms",
    "false leadsto y within 10ms",
    "y && !y leadsto x > 8 within 10ms",
    "x > 8 leadsto y within 10ms",
    "late == 7 leadsto x > 3 within 10ms",
    "always !(x > 8) || light == Light.Red",
)
"""Nothing is ever asked for, or what is asked for is always there."""

SMALL = "always x < 9; "
OTHERS = {
    "a guarantee that always holds": program("", contract="guarantees x >= 0;"),
    "an assumption that always holds": program(
        "input wish every 10ms;", system="node Hears;"
    ).replace("subscribes wish;", "subscribes wish; assumes wish <= 3;"),
    "a clause that always holds": program("", clause="guarantees any: u >= -1;"),
    "a clause of a premise that cannot hold": program(
        "", clause="guarantees any: !(u > 1) || u < 0;"
    ),
    "a contract that permits nothing": program(
        SMALL + "replace M by contract;", clause="guarantees none: u > 1;"
    ),
    "two clauses that exclude each other": program(
        SMALL + "replace M by contract;", clause="guarantees up: u > 0; guarantees down: u < 0;"
    ),
    "a contract that what is read forbids": program(
        SMALL + "replace M by contract;", clause="guarantees far: cell > 20 || u == 2;"
    ),
    "a fault of who never steps": program(SMALL + "late Later by 5ms;"),
    "a lost release of who never steps": program(SMALL + "skip Later at most 2;"),
    "an overrun of who never steps": program(SMALL + "overrun Later by 5ms;"),
    "an overrun of who publishes nothing": program(
        SMALL + "overrun Silent by 5ms;", system="node Silent;"
    ),
    "an input for nobody": program(SMALL + "input wish every 10ms;"),
    "a replacement for nobody": program(
        SMALL + "replace Hears by Still;", system="node Hears; input wish every 10ms;"
    ),
    "the mode of a module that is forced to SC": program(
        "always mode(M) == Mode.SC;", system="force M sc;"
    ),
    "the mode of a module that is forced to AC": program(
        "never mode(M) == Mode.SC;", system="force M ac;"
    ),
    "a premise in the other mode of a forced module": program(
        "always mode(M) == Mode.AC ? cell < 12 : true;", system="force M sc;"
    ),
    "AC that never has control": program("always cell <= 18;").replace(
        "safer cell <= 12", "safer cell > 20"
    ),
    "an invariant of what always is safe": program("always invariant(M);").replace(
        "safe cell <= 18", "safe cell <= 20"
    ),
    "no property": program(""),
    "an input that keeps its default": program("always heard == 0;", system="node Hears;"),
    "one of two properties cannot fail": program("always x < 9; always x >= 0;"),
    "one of two premises never holds": program("always x < 9; always !(x > 8) || y;"),
}

VACUOUS = {**{v: program(f"{v};") for v in (*TAUTOLOGIES, *RELATED, *TIMED)}, **OTHERS}
"""Each is told, in its verdict or beside it."""

PLAIN = (
    "always x < 9",
    "always x <= 5",
    "never x == 8",
    "always x != 7",
    "always !y || x > 3",
    "always y ? x > 3 : true",
    "always y == (x > 3)",
    "always f < 0.95",
    "always f <= 0.5",
    "always g > 0.5",
    "always g <= 10.0",
    "always f + g < 10.5",
    "always f * f < 0.9",
    "always sqrt(f) < 0.98",
    "always spot.row < 3 || spot.far >= 3.0",
    "always spot.far < 9.5",
    "always light != Light.Amber",
    "never light == Light.Green && x < 3",
    "always light == Light.Red || x > 2",
    "always cell <= 18",
    "always p.truth.at <= 15",
    "always p.truth.at > 0",
    "always p.truth.w < 100.0",
    "always p.truth.w == p.truth.w",
    "always p.truth.w >= 0.0 || p.truth.w < 0.0",
    "always p.truth.fixed + x < 12",
    "always mode(M) == Mode.SC || cell < 16",
    "always invariant(M)",
    "always invariants",
    "always x * x <= 80",
    "always x + x < 18",
    "always x - 9 < 0",
    "always x >= u",
    "always 10 / (x - 10) < -1",
    "always x / 2 < 4",
    "always x % 3 < 2",
    "always Half(x) < 5",
    "always min(x, 7) < 7",
    "always max(x, 7) < 8",
    "always abs(u) < 1",
    "always age(x) < 0.02",
    "always time < 1.0 && x < 9",
    "always time < 0.045",
    "always x < LIMIT + 2",
    "eventually p.truth.w > 2.0 within 40ms",
    "eventually x > 0 within 40ms",
    "eventually x < 1 && p.truth.w > 2.0 within 40ms",
    "y leadsto x > 3 within 10ms",
    "x == 2 leadsto light == Light.Red within 10ms",
    "x == 1 leadsto p.truth.w > 1.0 within 20ms",
    "cell > 10 leadsto cell <= 12 within 20ms",
)
TELLING = {
    **{v: program(f"{v};") for v in PLAIN},
    "a guarantee": program("", contract="guarantees x < 9;"),
    "an implication as guarantee": program("", contract="guarantees !y || x > 3;"),
    "a clause": program("", clause="guarantees low: u <= 0;"),
    "a contract in its place": program(
        SMALL + "replace M by contract;", clause="guarantees low: u <= 0;"
    ),
    "a contract that a topic decides": program(
        SMALL + "replace M by contract;", clause="guarantees low: cell <= 10 || u < 0;"
    ),
    "late": program(SMALL + "late A by 5ms;"),
    "lost releases": program(SMALL + "skip A at most 1;"),
    "overruns": program(SMALL + "overrun A by 5ms;"),
    "skew": program(SMALL + "skew 2ms;"),
    "a controller replaced": program("always cell <= 18; replace Go by Anything;"),
    "an input": program("always heard < 3; input wish every 10ms;", system="node Hears;"),
    "a stand-in that makes the test smaller": program(
        SMALL + "replace Hears by contract;", system="node Hears; input wish every 10ms;"
    ),
    "a stand-in that is read": program(
        "always heard < 3; replace Hears by contract;", system="node Hears; input wish every 10ms;"
    ),
    "a module that is forced to AC": program("always cell <= 18;", system="force M ac;"),
}
"""None of these is to be told as vacuous: each could fail, or does."""
