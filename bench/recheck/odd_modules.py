"""Whether `soter recheck` follows `soter verify` through every function and operator there is.

    .venv/bin/python bench/recheck/odd_modules.py [--modules N] [--seed N] [--seconds N] [--show N]

Purpose: random modules on one or two states whose SC, predicates and plants are made of all that an
expression can be made of: every function of the prelude with limits that vary, ternaries of numbers
and truths, whole numbers, tables, enums, records, loops. Each is verified with a certificate, which
is checked again. Counted, and shown with number and reason, is what is proved and then *rejected*,
proved and a *crash*, and proved and *not re-checked* although `verify` announced nothing. `--runs`:
what is proved is run as `bench/verify/contradictions.py` does. Exit code 1 where there is one.
Non-goals: schedules, delays, many plants (`contradictions.py`); wrong certificates (`forged.py`).

An expression is made together with an interval in which it surely lies, so that what is added to an
SC that brings the state back is small, and most of the modules are proved.
"""

from __future__ import annotations

import argparse
import math
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT), str(ROOT / "tests")]

from bench.verify.contradictions import TooLongError, runs_of, too_long  # noqa: E402

from soter.api import load  # noqa: E402 - as above
from soter.certificate.rechecker import recheck  # noqa: E402 - as above
from soter.diagnostics.diagnostic import SoterError  # noqa: E402 - as above

KINDS = ("proved, rejected", "proved, crash", "not re-checked, not announced", "proved, violated")
FAILED = "the re-checker itself failed"

Number = tuple[str, float, float]
"""An expression, and the ends of an interval in which its value lies."""

HEAD = """soter 1;
type Side = enum { Left, Middle, Right };
type Pair = { a: float, n: int };
const TABLE: float[5] = [-0.5, 0.25, 1.0, 0.5, -1.0];
fun side(v: float): Side { return v < -0.3 ? Side.Left : (v > 0.3 ? Side.Right : Side.Middle); }
fun pair(v: float): Pair { return { a: v * 0.5, n: int(2.0 * v) }; }
fun longest(v: float, w: float): float {
  var most = 0.0;
  for k in 0..3 { most = max(most, abs(v - TABLE[k] * w)); }
  if v > w { most = most + 0.25; } elseif v < -w { return most; }
  return most;
}
"""
PROGRAM = """{head}topic x: float{bounds} max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period {period} {{
  reads u; drives x = p; state p: float in [-0.1, 0.1]; disturbance w: float in [-0.1, 0.1];
  {moves}
  measured x within 0.02;
}}
node Fast period 50ms {{ subscribes x; publishes u; step {{ publish u = x > 0.0 ? 1.0 : -1.0; }} }}
node Slow period 50ms {{
  subscribes x; publishes u;
  step {{ publish u = clamp({law}, -1.0, 1.0); }}
}}
rta M {{
  ac Fast; sc Slow; period 100ms;
  safe {safe};
  {claims}
}}
system S default {{ p: P; module M; until 10s; }}
"""
TIMES = "late dm 2ms, sc 1ms; response dm 1ms, sc 1ms; acts within 1ms; recover within 30s;"
ONE: dict[str, tuple[str, float, float]] = {
    "sin": ("", -1, 1),
    "cos": ("", -1, 1),
    "atan": ("", -1.6, 1.6),
    "tanh": ("", -1, 1),
    "wrap_angle": ("", -3.2, 3.2),
    "sign": ("", -1, 1),
    "tan": ("clamp(%s, -1.2, 1.2)", -2.6, 2.6),
    "asin": ("clamp(%s, -1.0, 1.0)", -1.6, 1.6),
    "acos": ("clamp(%s, -1.0, 1.0)", 0, 3.2),
    "exp": ("clamp(%s, -3.0, 2.0)", 0, 7.4),
}
"""Functions of one number: what it is limited with, and the ends of the function then."""


class Maker:
    """Makes expressions that read `names`, each a number in [-size, size]."""

    def __init__(self, rng: random.Random, names: dict[str, float]) -> None:
        self.rng, self.names = rng, names

    def leaf(self) -> Number:
        """A name, or a number."""
        if self.rng.random() < 0.85:
            name = self.rng.choice(list(self.names))
            return name, -self.names[name], self.names[name]
        value = self.rng.choice((-1.5, -0.5, 0.0, 0.25, 1.0, 2.0, 0.1))
        return repr(value), value, value

    def number(self, depth: int) -> Number:
        """A float."""
        if depth == 0:
            return self.leaf()
        kinds = (self._sum, self._one, self._one, self._two, self._two, self._of_choices)
        return self.rng.choice((*kinds, self._of_vectors, self._of_wholes))(depth - 1)

    def _sum(self, depth: int) -> Number:
        (a, a0, a1), (b, b0, b1) = self.number(depth), self.number(depth)
        size = max(abs(b0), abs(b1))
        if (op := self.rng.choice("+-*/n")) == "+":
            return f"({a} + {b})", a0 + b0, a1 + b1
        if op == "-":
            return f"({a} - {b})", a0 - b1, a1 - b0
        if op == "n":
            return f"(-{a})", -a1, -a0
        if op == "*":
            ends = [x * y for x in (a0, a1) for y in (b0, b1)]
            return f"({a} * {b})", min(ends), max(ends)
        far = max(abs(a0), abs(a1))
        form = self.rng.choice(("({} / (abs({}) + 0.5))", "({0} / (0.7 + {1} * {1}))"))
        return form.format(a, b), -2 * far, 2 * far + 0 * size

    def _one(self, depth: int) -> Number:
        a, low, high = self.number(depth)
        far = max(abs(low), abs(high))
        name = self.rng.choice((*ONE, "abs", "floor", "sqrt", "log", "radians", "degrees"))
        if name in ONE:
            limited, least, most = ONE[name]
            return f"{name}({limited % a if limited else a})", least, most
        if name in ("abs", "floor"):
            return f"{name}({a})", -far - 1 if name == "floor" else 0.0, far
        if name == "sqrt":
            return f"sqrt({self.rng.choice((f'abs({a})', f'{a} * {a}'))})", 0, far + 1
        if name == "log":
            return f"log(abs({a}) + 0.5)", -0.7, math.log(far + 0.5)
        factor = math.pi / 180 if name == "radians" else 180 / math.pi
        return f"{name}({a})", low * factor - 1, high * factor + 1

    def _two(self, depth: int) -> Number:
        (a, a0, a1), (b, b0, b1) = self.number(depth), self.number(depth)
        far, size = max(abs(a0), abs(a1)), max(abs(b0), abs(b1))
        most, least = max(a1, b1), min(a0, b0)
        width = self.rng.choice((f"abs({b}) + 0.1", "0.5", f"0.1 + {b} * {b}"))
        forms: tuple[Number, ...] = (
            (f"min({a}, {b})", least, min(a1, b1)),
            (f"max({a}, {b})", max(a0, b0), most),
            (f"atan2({a}, {b})", -3.2, 3.2),
            (f"atan2({a}, abs({b}) + 0.3)", -1.6, 1.6),
            (f"hypot({a}, {b})", 0, far + size),
            (f"clamp({a}, {b}, {b} + {width})", b0, b1 + size * size + size + 1),
            (f"clamp({a}, -abs({b}), abs({b}))", -size, size),
            (f"lerp({a}, {b}, clamp({b}, 0.0, 1.0))", least - 1, most + 1),
            (f"smoothstep(-0.6, 0.6, {a})", 0, 1),
            (f"smoothstep({b}, {b} + {width}, {a})", 0, 1),
            (f"pow(abs({a}) + 0.3, clamp({b}, -2.0, 2.0))", 0, max(12.0, (far + 0.3) ** 2)),
            (f"pow(clamp({a}, -2.0, 2.0), 3.0)", -8, 8),
            (f"pow(clamp({a}, -2.0, 2.0), 2.0)", 0, 4),
            (f"pow(abs({a}), 1.5)", 0, far**1.5 + 1),
            (f"longest({a}, {b})", 0, far + size + 1),
        )
        return self.rng.choice(forms)

    def _of_choices(self, depth: int) -> Number:
        (a, a0, a1), (b, b0, b1) = self.number(depth), self.number(depth)
        return f"({self.truth(depth)} ? {a} : {b})", min(a0, b0), max(a1, b1)

    def _of_vectors(self, depth: int) -> Number:
        (a, a0, a1), (b, b0, b1) = self.number(depth), self.number(depth)
        far, size = max(abs(a0), abs(a1)), max(abs(b0), abs(b1))
        v, w = f"vec2({a}, {b})", f"vec3({a}, 0.4, {b})"
        unit = "{ x: 1.0, y: 0.0 }"
        turn = f"quat_normalize(quat(1.0, 0.2, {a}, 0.0))"
        forms: tuple[Number, ...] = (
            (f"norm({v})", 0, far + size),
            (f"dot({v}, vec2(0.5, -1.0))", -far - size, far + size),
            (f"unit2(vec2({a}, abs({b}) + 0.2), {unit}).x", -1, 1),
            (f"unit({w}, vec3(1.0, 0.0, 0.0)).z", -1, 1),
            (f"cross({w}, vec3(1.0, 2.0, -1.0)).y", -far - size, far + size),
            (f"quat_rotate({turn}, vec3(0.0, 0.5, 1.0)).z", -1.2, 1.2),
            (f"saturate({v}, 0.8).y", -0.8, 0.8),
            (f"pair({a}).a", a0 / 2, a1 / 2),
        )
        return self.rng.choice(forms)

    def _of_wholes(self, depth: int) -> Number:
        n, low, high = self.whole(depth)
        if self.rng.random() < 0.5:
            return f"float({n})", low, high
        return f"TABLE[min(max({n}, 0), 4)]", -1, 1

    def whole(self, depth: int) -> Number:
        """An int."""
        a, low, high = self.number(depth)
        low, high = math.floor(low) - 1, math.ceil(high) + 1
        far = max(abs(low), abs(high))
        forms: tuple[Number, ...] = (
            (f"int({a})", low, high),
            (f"int(floor({a}))", low, high),
            (f"abs(int({a}))", 0, far),
            (f"(2 * int({a}) - 1)", 2 * low - 1, 2 * high - 1),
            (f"({a} < 0.5 ? int({a}) : 3)", min(low, 3), max(high, 3)),
            (f"min(int({a}), 2)", min(low, 2), 2),
            (f"pair({a}).n", 2 * low, 2 * high),
            (f"int({a} - {a})", 0, 0),
        )
        return self.rng.choice(forms)

    def truth(self, depth: int) -> str:
        """A bool."""
        if depth > 0 and self.rng.random() < 0.6:
            p, q, r = (self.truth(depth - 1) for _ in range(3))
            forms = (f"!({p})", f"({p} && {q})", f"({p} || {q})", f"({p} ? {q} : {r})")
            return self.rng.choice((*forms, f"(({p}) == ({q}))", f"(({p}) != ({q}))"))
        a, b = (self.number(min(depth, 1))[0] for _ in range(2))
        op = self.rng.choice(("<", "<=", ">", ">="))
        n, member = self.whole(0)[0], self.rng.choice(("Left", "Middle", "Right"))
        others = (f"({n} {op} 1)", f"({n} == 0)", f"(side({a}) == Side.{member})")
        return self.rng.choice((f"({a} {op} {b})", f"({a} {op} {b})", *others))

    def small(self, size: float, depth: int) -> str:
        """An expression in [-size, size] or hardly beyond."""
        text, low, high = self.number(depth)
        half = max(high - low, 1e-3) / 2
        return f"{size / half!r} * ({text} - {(low + high) / 2!r})"


def near(rng: random.Random, make: Maker, name: str, limit: float, *, inside: bool) -> str:
    """A predicate that says about |name| < limit, or > limit."""
    op, other = ("<", "&&") if inside else (">", "||")
    less = limit - 0.03 if inside else limit + 0.03
    plain = f"{name} {'>' if inside else '<'} -{limit} {other} {name} {op} {limit}"
    forms = (
        f"abs({name}) {op} {limit}",
        plain,
        f"({make.truth(2)} ? abs({name}) {op} {limit} : ({plain}))",
        f"abs({name}) + {make.small(0.02, 2)} {op} {less}",
        f"({make.truth(2)} ? {plain} : abs({name}) {op} {less})",
        f"({plain}) == ({make.truth(1)} || true)",
    )
    return rng.choice(forms)


def module(number: int) -> tuple[str, str]:
    """Kind and text of a random program."""
    rng = random.Random(f"odd {number}")  # noqa: S311 - test programs
    kind = rng.choice(("grid", "grid", "grid", "computed", "map", "rest", "polytope", "two"))
    read, own = Maker(rng, {"x": 1.5}), Maker(rng, {"p": 1.5, "w": 0.1, "u": 1.0})
    depth = rng.choice((1, 2, 2, 3))
    law = f"-2.0 * x + {read.small(0.05 if kind == 'polytope' else 0.15, depth)}"
    if rng.random() < 0.3:
        limit = f"0.3 * abs({Maker(rng, {'x': 1.0}).small(0.9, 1)})"
        law = f"clamp({law}, {limit} - 1.0, 1.0 - {limit})"
    rate = f"u + w + {own.small(0.1, depth)}" if rng.random() < 0.5 else "u + w"
    moves = f"next p = p + 0.05 * ({rate});" if kind == "map" else f"der p = {rate};"
    written = f"ttf {near(rng, read, 'x', 0.5, inside=False)};\n  safer "
    written += f"{near(rng, read, 'x', 0.35, inside=True)};"
    cells, times = rng.choice((50, 100)), TIMES if kind == "grid" else ""
    claims = "" if kind in ("computed", "polytope") else f"{written}\n  "
    claims += f"verify {{ grid x in [-1.25, 1.25] / {cells}; {times} }}"
    if kind == "two":
        claims = claims.replace("}", "grid P.q in [-2.0, 2.0] / 40; }").replace("P.q", "p.q")
    if kind == "polytope":
        claims = "verify { polytope x in [-1.25, 1.25]; }"
    if kind == "rest":
        claims = f"rest {near(rng, read, 'x', 0.5, inside=True)} within 5s;"
    more = f"state q: float = 0.0; der q = {Maker(rng, {'q': 2.0, 'p': 1.5}).small(0.5, 2)} - q;"
    text = PROGRAM.format(
        head=HEAD,
        bounds="" if kind == "rest" else " in [-3.0, 3.0]",
        period="50ms" if kind == "map" else "10ms",
        moves=moves + (more if kind == "two" else ""),
        law=law,
        safe=near(rng, read, "x", 1.0, inside=True),
        claims=claims,
    )
    return kind, text


# ---------------------------------------------------------------- all of them


def judged(text: str, work: Path, *, runs: bool) -> tuple[str, str, str]:
    """What became of a program: the verdicts, what is wrong (one of `KINDS`, or ""), and why."""
    path = work / "program.soter"
    path.write_text(text)
    try:
        report = load(path).verify(cert=work / "cert", refute=False)
    except SoterError as error:
        return f"refused {error.diagnostics[0].code}", "", error.diagnostics[0].message
    if report.verdict not in ("proved", "assumed"):
        return report.verdict, "", ""
    checked = recheck(work / "cert", 1)
    verdicts = f"proved, {checked.verdict}"
    if FAILED in checked.reason:
        return verdicts, KINDS[1], checked.reason
    if checked.verdict == "rejected":
        return verdicts, KINDS[0], checked.reason
    if checked.verdict == "not re-checked":
        announced = all(m.not_rechecked for m in report.modules)
        return verdicts, "" if announced else KINDS[2], checked.reason
    violated = next(runs_of(path, report), None) if runs else None
    return verdicts, *(("", "") if violated is None else (KINDS[3], violated[1]))


def main() -> int:
    """Everything."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--modules", type=int, default=500, help="so many that are proved")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=120, help="for one module")
    parser.add_argument("--runs", action="store_true", help="run what is proved, too")
    parser.add_argument("--show", type=int, help="print the program of this number instead")
    options = parser.parse_args()
    if options.show is not None:
        print(module(options.show)[1])
        return 0
    signal.signal(signal.SIGALRM, too_long)
    began, verdicts, kinds = time.perf_counter(), Counter[str](), Counter[str]()
    number = options.seed * 10_000
    while sum(n for v, n in verdicts.items() if ": proved" in v) < options.modules:
        kind, text = module(number)
        signal.alarm(options.seconds)
        try:
            with tempfile.TemporaryDirectory() as work:
                said, wrong, why = judged(text, Path(work), runs=options.runs)
        except TooLongError:
            said, wrong, why = "too long", "", ""
        finally:
            signal.alarm(0)
        verdicts[f"{kind}: {said}"] += 1
        if wrong or why:
            kinds[wrong] += 1
            print(f"{number} {kind}: {wrong or said}: {why[:200]}", flush=True)
        number += 1
    for line, many in sorted(verdicts.items()):
        print(f"{many:5}  {line}")
    shown = sum(kinds[k] for k in KINDS)
    print("  ".join(f"{k}: {kinds[k]}" for k in KINDS))
    print(
        f"wrong: {shown} of {options.modules} proved (target 0), {time.perf_counter() - began:.0f} s"
    )
    return 1 if shown else 0


if __name__ == "__main__":
    raise SystemExit(main())
