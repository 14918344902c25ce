"""Plants, laws and real expressions drawn at random, as Soter text and as functions of Python.

Purpose: `drawn_module`, a program whose plant is affine in its commands and disturbances, or is not
(`bent`), with what its rates and its law compute; `drawn_subjects`, the functions of their tubes
compiled; `Real`, a drawn expression with its text and its value.
Non-goals: what is to be true of their tubes.
"""

from __future__ import annotations

import math
import random
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.problem import TubeProblem, TubeTimes
from soter.verify.tubes.tube_check import TubeCheck
from unit.verify.tubes.soter_forms import Library

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path


@dataclass(frozen=True)
class Real:
    """An expression: its text, its value over a list of numbers, whether it has a kink."""

    text: str
    value: Callable[[Sequence[Any], Any], Any]
    kinked: bool = False


class Floats:
    """Functions of floats, as an expression calls them."""

    sin, cos, tanh, atan, sqrt, exp, tan = (
        math.sin, math.cos, math.tanh, math.atan, math.sqrt, math.exp, math.tan,
    )  # fmt: skip
    max, min = max, min

    @staticmethod
    def number(x: float) -> float:
        return x


def real(rng: random.Random, names: Sequence[str], depth: int = 3) -> Real:
    """An expression over names, the value over their numbers in the same order."""
    if depth == 0 or rng.random() < 0.12:
        if rng.random() < 0.3:
            v = rng.choice((0.1, 0.3, 2.0, -0.7, 1e-3, round(rng.uniform(-2, 2), 3)))
            return Real(f"({v})", lambda _, f: f.number(v))
        i = rng.randrange(len(names))
        return Real(names[i], lambda x, _: x[i])
    a, b = (real(rng, names, depth - 1) for _ in range(2))
    low, high = sorted((round(rng.uniform(-2, 0.5), 2), round(rng.uniform(0.6, 2), 2)))
    kinks = a.kinked or b.kinked
    name = rng.choice(("sin", "cos", "tanh", "atan"))
    return rng.choice((
        Real(f"({a.text} + {b.text})", lambda x, f: a.value(x, f) + b.value(x, f), kinks),
        Real(f"({a.text} - {b.text})", lambda x, f: a.value(x, f) - b.value(x, f), kinks),
        Real(f"({a.text} * {b.text})", lambda x, f: a.value(x, f) * b.value(x, f), kinks),
        Real(f"({a.text} * {a.text})", lambda x, f: a.value(x, f) * a.value(x, f), a.kinked),
        Real(f"({a.text} / 3.0)", lambda x, f: a.value(x, f) / 3, a.kinked),
        Real(f"{name}({a.text})", lambda x, f: getattr(f, name)(a.value(x, f)), a.kinked),
        Real(
            f"sqrt(1.0 + {a.text} * {a.text})",
            lambda x, f: f.sqrt(1 + a.value(x, f) * a.value(x, f)), a.kinked,
        ),
        Real(
            f"({a.text} / (1.5 + {b.text} * {b.text}))",
            lambda x, f: a.value(x, f) / (f.number(1.5) + b.value(x, f) * b.value(x, f)), kinks,
        ),
        Real(
            f"({a.text} / (abs({a.text}) + 0.2))",
            lambda x, f: a.value(x, f)
            / (f.max(a.value(x, f), -a.value(x, f)) + f.number(0.2)), a.kinked,
        ),
        Real(
            f"exp(-({a.text} * {a.text}))",
            lambda x, f: f.exp(-(a.value(x, f) * a.value(x, f))), a.kinked,
        ),
        Real(
            f"tan(0.9 * sin({a.text}))",
            lambda x, f: f.tan(f.number(0.9) * f.sin(a.value(x, f))), a.kinked,
        ),
        Real(
            f"clamp({a.text}, {low}, {high})",
            lambda x, f: f.min(f.max(a.value(x, f), f.number(low)), f.number(high)), True,
        ),
        Real(f"max({a.text}, {b.text})", lambda x, f: f.max(a.value(x, f), b.value(x, f)), True),
        Real(f"abs({a.text})", lambda x, f: f.max(a.value(x, f), -a.value(x, f)), True),
    ))  # fmt: skip


@dataclass(frozen=True)
class DrawnModule:
    """A program, and what its plant and its SC compute."""

    text: str
    states: int
    controls: int
    drift: list[Real]
    by_control: list[list[Real]]
    by_disturbance: list[Real]
    grips: list[Real]
    """Of the disturbance times the first command."""
    law: list[Real]
    disturbed: float
    bent: list[Real]
    """Of states, commands and the disturbance, in this order; none where it is affine."""

    @property
    def kinked(self) -> bool:
        rows = [*self.by_control, self.drift, self.by_disturbance, self.grips, self.bent]
        return any(e.kinked for row in rows for e in row)

    def rate(self, x: Sequence[float], u: Sequence[float], w: float) -> list[float]:
        """The derivative of the state."""
        return [
            self.drift[i].value(x, Floats)
            + sum(self.by_control[i][k].value(x, Floats) * u[k] for k in range(self.controls))
            + self.by_disturbance[i].value(x, Floats) * w
            + self.grips[i].value(x, Floats) * u[0] * w
            + (self.bent[i].value([*x, *u, w], Floats) if self.bent else 0.0)
            for i in range(self.states)
        ]


def drawn_module(rng: random.Random, *, bent: bool = False) -> DrawnModule:
    """A plant of two or three states with one or two commands and a disturbance."""
    n, m = rng.choice((2, 3)), rng.choice((1, 2))
    own, seen = [f"s{i}" for i in range(n)], [f"pose.s{i}" for i in range(n)]
    drift = [real(rng, own) for _ in range(n)]
    by_control = [[real(rng, own, 1) for _ in range(m)] for _ in range(n)]
    by_disturbance = [real(rng, own, 1) for _ in range(n)]
    grips = [real(rng, own, 1) for _ in range(n)]
    law = [real(rng, own, 2) for _ in range(m)]
    wide = rng.choice((0.01, 0.3))
    inputs = [*own, *(f"order.u{k}" for k in range(m)), "w"]
    bends = [real(rng, inputs) for _ in range(n)] if bent else []
    lines = [
        "soter 1;",
        f"type Pose = {{ {', '.join(f's{i}: float' for i in range(n))} }};",
        f"type Order = {{ {', '.join(f'u{k}: float' for k in range(m))} }};",
        "topic pose: Pose max_age 20ms;",
        "topic order: Order in { " + ", ".join(f"u{k} in [-2.0, 2.0]" for k in range(m)) + " }"
        " = { " + ", ".join(f"u{k}: 0.0" for k in range(m)) + " };",
        "plant Body period 10ms {",
        "  reads order;",
        f"  drives pose = {{ {', '.join(f's{i}: s{i}' for i in range(n))} }};",
        *[f"  state s{i}: float = 0.0;" for i in range(n)],
        f"  disturbance w: float in [-{wide}, {wide}];",
    ]
    for i in range(n):
        by = "".join(f" + {by_control[i][k].text} * order.u{k}" for k in range(m))
        by += f" + {by_disturbance[i].text} * w + {grips[i].text} * order.u0 * w"
        by += f" + {bends[i].text}" if bent else ""
        lines.append(f"  der s{i} = {drift[i].text}{by};")
    measured = ", ".join(f"pose.s{i} within 0.01" for i in range(n))
    laws = [_renamed(law[k].text, own, seen) for k in range(m)]
    answer = ", ".join(f"u{k}: clamp({laws[k]}, -2.0, 2.0)" for k in range(m))
    for name in ("Ac", "Sc"):
        node = f"node {name} period 50ms {{ subscribes pose; publishes order; step {{"
        lines.append(f"{node} publish order = {{ {answer} }}; }} }}")
    lines.insert(-2, f"  measured {measured};\n}}")
    bounds = " && ".join(f"abs({s}) < 50.0" for s in seen)
    lines += [
        f"rta M {{ ac Ac; sc Sc; period 50ms; safe {bounds};",
        "  rest abs(pose.s0) < 40.0 within 2s; }",
        "system S default { b: Body; module M; until 1s; }",
    ]
    held = [_held(e) for e in law]
    parts = drift, by_control, by_disturbance, grips, held, wide, bends
    return DrawnModule("\n".join(lines), n, m, *parts)


def _held(e: Real) -> Real:
    """An expression between the ends of a command."""
    return Real(
        "", lambda x, f: f.min(f.max(e.value(x, f), f.number(-2.0)), f.number(2.0)), kinked=True
    )


def _renamed(text: str, own: list[str], seen: list[str]) -> str:
    for a, b in zip(own, seen, strict=True):
        text = text.replace(a, b)
    return text


MS = 1_000_000
TIMES = TubeTimes(40 * MS, 80 * MS, 80 * MS, 23 * MS, 5 * MS, 50 * MS, 20)
OLD_READS = replace(TIMES, delay=61 * MS)
"""Two commands of SC, and any before them, may act while a read gets as old as this."""
TRIED = """
fun tried(op: int, a: Form[64], k: float[64]): Form[64] {
  var b = a;
  var x: Forms = NOWHERE;
  var v: Forms = NOWHERE;
  var u: Controls = ANY_COMMAND;
  var other: Controls = ANY_COMMAND;
  for i in 0..STATES { x[i] = a[i]; v[i] = a[10 + i]; }
  for i in 0..CONTROLS { u[i] = a[20 + i]; other[i] = a[30 + i]; }
  if op == 0 {
    var wide = DISTURBED;
    for i in 0..MOVED { wide[i] = k[1 + i]; }
    let s = flow(x, u, wide, k[0], MOVES);
    for i in 0..STATES { b[i] = s.end[i]; b[10 + i] = s.way[i]; }
    for i in 0..STATES { b[20 + i] = f_range(s.rate[i].lo, s.rate[i].hi); }
    b[30] = f_number(s.found ? 1.0 : 0.0);
  }
  if op == 1 {
    var acted: Acted = ANY_ACTED;
    for i in 0..ACTED { acted[i] = a[20 + i]; }
    let y = reduced(x, acted);
    for i in 0..STATES { b[i] = y.x[i]; }
    for i in 0..ACTED { b[20 + i] = y.u[i]; }
  }
  if op == 2 {
    var acted: Acted = ANY_ACTED;
    for i in 0..ACTED { acted[i] = a[20 + i]; }
    var rate = NO_RANGES;
    for i in 0..STATES { rate[i] = ends(a[10 + i]); }
    var rates_of: Ranges[DEPTH] = NO_PAST;
    for p in 0..DEPTH { rates_of[p] = rate; }
    let y = answered(x, acted, rates_of, int(k[0]));
    for i in 0..CONTROLS { b[i] = y.u[i]; }
    b[10] = f_number(y.found ? 1.0 : 0.0);
  }
  if op == 4 {
    let y = between(u, other);
    let w = apart(u, other);
    for i in 0..CONTROLS { b[i] = y[i]; b[10 + i] = f_number(w[DISTURBANCES + i]); }
  }
  if op == 5 {
    let y = rates(x, u);
    let w = bends(x, u, v);
    for i in 0..STATES { b[i] = y[i]; b[10 + i] = w[i]; }
    let e = effects(bounds(x), orders(u));
    let s = speeds(bounds(x), orders(u));
    for i in 0..STATES * MOVED { b[20 + i] = f_number(0.0); }
    for i in 0..EFFECTS {
      b[20 + STATES * EFFECT[i].mover + EFFECT[i].state] = f_range(e[i].lo, e[i].hi);
    }
    for i in 0..STATES {
      b[i].lo = max(b[i].lo, s[i].lo);
      b[i].hi = min(b[i].hi, s[i].hi);
    }
  }
  if op == 6 { let y = law(x); for i in 0..CONTROLS { b[i] = y[i]; } }
  if op == 7 {
    var y: float[STATES] = NO_RATES;
    for i in 0..STATES { y[i] = k[i]; }
    let z = estimated(y);
    for i in 0..STATES { b[i] = z[i]; }
    b[10] = f_number(good(y) ? 1.0 : 0.0);
  }
  return b;
}
"""


@dataclass
class Subject:
    """A drawn module and the sizes of its forms."""

    name: str
    module: DrawnModule
    symbols: int
    moves: int
    depth: int


NUMBERS = "SYMBOLS", "MOVES", "DEPTH"


def source_of(text: str, times: TubeTimes, precision: int = 0) -> tuple[str, int, int, int]:
    """The check of a program's module, `tried` behind it; its SYMBOLS, MOVES and DEPTH."""
    flat = system_to_prove(check_file("drawn.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    check = TubeCheck(problem)
    check.times, check.precision = times, precision
    made = check.text_in_flight(dict.fromkeys(check.states, Interval(-1.0, 1.0)))
    sizes = [int(made.split(f"const {n}: int = ")[1].split(";")[0]) for n in NUMBERS]
    return made + TRIED, sizes[0], sizes[1], sizes[2]


def drawn_subjects(
    folder: Path, count: int, *, bent: bool, times: TubeTimes = TIMES, precision: int = 0
) -> tuple[Library, list[Subject]]:
    """The first modules that are not refused: what no number stands for may be hidden in a rate."""
    found: list[Subject] = []
    programs, drawn_from = {}, iter(range(3 * count))
    while len(found) < count:
        number = next(drawn_from)
        module = drawn_module(random.Random(number), bent=bent)  # noqa: S311 - drawn examples
        with suppress(SoterError):
            text, symbols, moves, depth = source_of(module.text, times, precision)
            name = f"drawn_{number}"
            programs[name] = text, symbols
            found.append(Subject(name, module, symbols, moves, depth))
    return Library(folder, programs), found
