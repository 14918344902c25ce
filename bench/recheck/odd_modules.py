"""Whether `soter recheck` follows `soter verify` through every function and operator there is.

    .venv/bin/python bench/recheck/odd_modules.py [--modules N] [--seed N] [--runs] [--show NUMBER]

Purpose: random modules whose SC, predicates and plants are made of all that an expression can be
made of: every function of the prelude with limits that vary, ternaries of numbers and truths, whole
numbers, tables, enums, records, loops, numbers that are none and only compared. Each is verified
with a certificate, which is checked again. Counted, and shown with number and reason, is what is
proved and then *rejected*, proved and a *crash*, and proved and *not re-checked* although `verify`
announced nothing. `--runs`: what is proved is run as `bench/verify/contradictions.py` does. Exit
code 1 where there is one of these. Ctrl-C ends it with what was until then.
Non-goals: schedules, delays, many plants (`contradictions.py`); wrong certificates (`forged.py`).

What is added to an SC that brings the state back, or to a rate, is limited: most are proved.
"""

from __future__ import annotations

import argparse
import random
import signal
import string
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

SMOOTH = (
    *("({a} + {b})", "({a} - {b})", "({a} * {b})", "(-{a})", "abs({a})", "sqrt(abs({a}) + 0.1)"),
    *("({a} / (abs({b}) + 0.5))", "({a} / (0.7 + {b} * {b}))", "min({a}, {b})", "max({a}, {b})"),
    *("sin({a})", "cos({a})", "atan({a})", "tanh({a})", "tan(clamp({a}, -1.2, 1.2))"),
    *("exp(clamp({a}, -3.0, 2.0))", "hypot({a}, {b})", "clamp({a}, {b}, {b} + {w})"),
    *("clamp({a}, -abs({b}), abs({b}))", "lerp({a}, {b}, clamp({c}, 0.0, 1.0))", "radians({a})"),
    *("smoothstep(-0.6, 0.6, {a})", "smoothstep({b}, {b} + {w}, {a})", "norm(vec2({a}, {b}))"),
    *("dot(vec2({a}, {b}), vec2(0.5, -1.0))", "saturate(vec2({a}, {b}), 0.8).y", "pair({a}).a"),
)
"""Numbers that `rest` may be followed with; a, b, c: such, w: a width, n: an int, t: a truth."""
NUMBERS = (
    *SMOOTH,
    *("sqrt({a} * {a})", "floor({a})", "wrap_angle({a})", "wrap_angle(3.0 * {a})", "sign({a})"),
    *("degrees(0.01 * {a})", "asin(clamp({a}, -1.0, 1.0))", "acos(clamp({a}, -1.0, 1.0))"),
    *("log(abs({a}) + 0.5)", "atan2({a}, {b})", "atan2({a}, abs({b}) + 0.3)", "longest({a}, {b})"),
    *("pow(abs({a}) + 0.3, clamp({b}, -2.0, 2.0))", "pow(abs({a}), 1.5)", "pow(2.0, tanh({a}))"),
    *("pow(clamp({a}, -2.0, 2.0), 2.0)", "pow(clamp({a}, -2.0, 2.0), 3.0)", "({t} ? {a} : {b})"),
    *("unit2(vec2({a}, abs({b}) + 0.2), vec2(1.0, 0.0)).x", "cross({v}, vec3(1.0, 2.0, -1.0)).y"),
    *("unit({v}, vec3(1.0, 0.0, 0.0)).z", "quat_rotate_inverse({q}, {v}).x"),
    *("quat_rotate(quat_mul({q}, {q}), vec3(0.0, 0.5, 1.0)).z", "float({n})"),
    "TABLE[min(max({n}, 0), 4)]",
)
INTS = (
    *("int({a})", "int(floor({a}))", "abs(int({a}))", "(2 * int({a}) - 1)", "min(int({a}), 2)"),
    *("({t} ? int({a}) : 3)", "pair({a}).n", "int({a} - {a})", "(int({a}) - int({b}))"),
)
TRUTHS = (
    *("!({t})", "({t} && {s})", "({t} || {s})", "({t} ? {s} : {r})", "(({t}) == ({s}))"),
    *("(({t}) != ({s}))", "({n} {op} 1)", "({n} == 0)", "(side({a}) == Side.{m})"),
    *("close({a}, {b})", *3 * ("({a} {op} {b})",), "(log({a}) < {b})", "(asin({a}) > {b})"),
    *("(sqrt({a}) <= {b})", "(pow({a}, 1.5) > {b})", "(exp(900.0 * {a}) > {b})"),
)
LIMITED = ("clamp({}, -1.0, 1.0)", "tanh({})", "sin({})", "({0} / (1.0 + abs({0})))")
PROGRAM = """soter 1;
type Side = enum {{ Left, Middle, Right }};
type Pair = {{ a: float, n: int }};
const TABLE: float[5] = [-0.5, 0.25, 1.0, 0.5, -1.0];
fun side(v: float): Side {{ return v < -0.3 ? Side.Left : (v > 0.3 ? Side.Right : Side.Middle); }}
fun pair(v: float): Pair {{ return {{ a: v * 0.5, n: int(2.0 * v) }}; }}
fun close(v: float, w: float): bool {{ let apart = v - w; return abs(apart) < 0.2 || v == w; }}
fun longest(v: float, w: float): float {{
  var most = 0.0;
  for k in 0..3 {{ most = max(most, abs(v - TABLE[k] * w)); }}
  if v > w {{ most = most + 0.25; }} elseif v < -w {{ return most; }}
  return most;
}}
topic x: float{bounds} max_age 20ms;
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
SUBJECTS = ("grid", "grid", "grid", "grid", "computed", "map", "map", "two", "rest", "grid")


class Maker:
    """Makes expressions that read `names`."""

    def __init__(self, rng: random.Random, names: str, numbers: tuple[str, ...] = NUMBERS) -> None:
        self.rng, self.names, self.numbers = rng, names, numbers

    def number(self, depth: int) -> str:
        """A float."""
        if depth > 0:
            return self._filled(self.rng.choice(self.numbers), depth - 1)
        if self.rng.random() < 0.85:
            return self.rng.choice(self.names)
        return self.rng.choice(("-1.5", "-0.5", "0.0", "0.25", "1.0", "2.0", "0.1"))

    def truth(self, depth: int) -> str:
        """A bool."""
        form = self.rng.choice(TRUTHS if depth > 0 else ("({a} {op} {b})",))
        return self._filled(form, max(depth - 1, 0))

    def small(self, size: float, depth: int) -> str:
        """An expression in [-size, size]."""
        limited = self.rng.choice(LIMITED[: 2 if self.numbers is SMOOTH else None])
        return f"{size} * {limited.format(self.number(depth))}"

    def _filled(self, form: str, depth: int) -> str:
        fields = {name for _, name, *_ in string.Formatter().parse(form) if name}
        return form.format(**{name: self._part(name, depth) for name in sorted(fields)})

    def _part(self, name: str, depth: int) -> str:
        if name in "abc":
            return self.number(depth)
        if name in "tsr":
            return self.truth(depth)
        if name == "n":
            ints = INTS if depth > 0 else INTS[:3]
            return self._filled(self.rng.choice(ints), max(depth - 1, 0))
        a, b = self.number(depth), self.number(depth)
        return {
            "w": self.rng.choice((f"abs({a}) + 0.1", "0.5", f"0.1 + {b} * {b}")),
            "v": f"vec3({a}, 0.4, {b})",
            "q": f"quat_normalize(quat(1.0, 0.2, {a}, 0.0))",
            "m": self.rng.choice(("Left", "Middle", "Right")),
            "op": self.rng.choice(("<", "<=", ">", ">=")),
        }[name]

    def near(self, limit: float, *, inside: bool) -> str:
        """A predicate that says about |x| < limit, or > limit."""
        op, other = ("<", "&&") if inside else (">", "||")
        less = round(limit - 0.03 if inside else limit + 0.03, 9)
        plain, size = f"x {'>' if inside else '<'} -{limit} {other} x {op} {limit}", f"abs(x) {op}"
        depth = 0 if self.numbers is SMOOTH else 2
        forms = (
            f"{size} {limit}",
            plain,
            f"abs(x) + {self.small(0.02, 2)} {op} {less}",
            f"({self.truth(depth)} ? {size} {limit} : ({plain}))",
            f"({self.truth(depth)} ? {plain} : {size} {less})",
            f"({plain}) == ({self.truth(depth)} || true)",
        )
        return self.rng.choice(forms[:3] if self.numbers is SMOOTH else forms)


def module(number: int) -> tuple[str, str]:
    """Kind and text of a random program."""
    rng = random.Random(f"odd {number}")  # noqa: S311 - test programs
    kind = rng.choice(SUBJECTS)
    numbers, depth = (SMOOTH if kind == "rest" else NUMBERS), rng.choice((1, 1, 2, 2, 3))
    read, own = Maker(rng, "x", numbers), Maker(rng, "pwu", numbers)
    law = f"-2.0 * x + {read.small(0.15, depth)}"
    if rng.random() < 0.3:
        limit = f"0.3 * abs({read.small(0.9, 1)})"
        law = f"clamp({law}, {limit} - 1.0, 1.0 - {limit})"
    rate = "u + w" + (f" + {own.small(0.1, depth)}" if rng.random() < 0.5 else "")
    moves = f"next p = p + 0.05 * ({rate});" if kind == "map" else f"der p = {rate};"
    if kind == "two":
        moves += f" state q: float = 0.0; der q = {Maker(rng, 'pq').small(0.5, 2)} - q;"
    written = f"ttf {read.near(0.5, inside=False)};\n  safer {read.near(0.35, inside=True)};\n  "
    claims = f"verify {{ grid x in [-1.25, 1.25] / {rng.choice((50, 100))}; "
    claims += "grid p.q in [-2.0, 2.0] / 40; }" if kind == "two" else "}"
    if kind == "grid":
        claims = claims.replace("}", TIMES + " }")
    if kind == "rest":
        claims = f"rest {read.near(0.5, inside=True)} within 5s;"
    return kind, PROGRAM.format(
        bounds="" if kind == "rest" else " in [-3.0, 3.0]",
        period="50ms" if kind == "map" else "10ms",
        moves=moves,
        law=law,
        safe=read.near(1.0, inside=True),
        claims=written * (kind in ("grid", "map", "two")) + claims,
    )


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
    in_part = " in part" * (checked.accepted and not checked.safe)
    verdicts = f"proved, {checked.verdict}{in_part}"
    if FAILED in checked.reason:
        return verdicts, KINDS[1], checked.reason
    if checked.verdict == "rejected":
        return verdicts, KINDS[0], checked.reason
    if checked.verdict == "not re-checked":
        announced = all(m.not_rechecked for m in report.modules)
        return verdicts, "" if announced else KINDS[2], checked.reason
    violated = next(runs_of(path, report), None) if runs else None
    return (verdicts, "", "") if violated is None else (verdicts, KINDS[3], violated[1])


def main() -> int:
    """Everything."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--modules", type=int, default=500, help="so many that are proved")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=120, help="of the processor, for a module")
    parser.add_argument("--runs", action="store_true", help="run what is proved, too")
    parser.add_argument("--show", type=int, help="print the program of this number instead")
    options = parser.parse_args()
    if options.show is not None:
        print(module(options.show)[1])
        return 0
    signal.signal(signal.SIGPROF, too_long)
    began, verdicts, kinds = time.perf_counter(), Counter[str](), Counter[str]()
    number = options.seed * 10_000

    def proved(*words: str) -> int:
        return sum(n for v, n in verdicts.items() if ": proved" in v and all(w in v for w in words))

    while proved() < options.modules:
        kind, text = module(number)
        signal.setitimer(signal.ITIMER_PROF, options.seconds)
        try:
            with tempfile.TemporaryDirectory() as work:
                said, wrong, why = judged(text, Path(work), runs=options.runs)
        except TooLongError:
            said, wrong, why = "too long", "", "of this program"
        except KeyboardInterrupt:
            break
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        verdicts[f"{kind}: {said}"] += 1
        kinds[wrong] += 1
        if why:
            print(f"{number} {kind}: {wrong or said}: {why[:200]}", flush=True)
        number += 1
    for line, many in sorted(verdicts.items()):
        print(f"{many:5}  {line}")
    print("  ".join(f"{k}: {kinds[k]}" for k in KINDS))
    ends = {w: proved(f", {w}") for w in ("accepted", "accepted in part", "not re-checked")}
    ends["accepted"] -= ends["accepted in part"]
    print(f"of {proved()} proved " + ", ".join(f"{n} {w}" for w, n in ends.items()))
    shown, took = sum(kinds[k] for k in KINDS), time.perf_counter() - began
    print(f"wrong: {shown} of {proved()} proved (target 0), {took:.0f} s")
    return 1 if shown else 0


if __name__ == "__main__":
    raise SystemExit(main())
