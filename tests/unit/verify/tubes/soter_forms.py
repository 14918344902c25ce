"""The functions of `forms.soter` and of tubes, compiled, called with forms from Python.

Purpose: `compiled` makes a library of Soter text with a function `tried`, which chooses by a number
what it calls; `Drawn` are forms over shared symbols with values that they stand for.
Non-goals: what is right of them (the tests say that).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import cffi

from generators.engine_comparison import call_compiler
from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of
from soter.native.shared_library import CHECK_FAILED

if TYPE_CHECKING:
    import random
    from collections.abc import Sequence
    from pathlib import Path

SYMBOLS = 4
WIDTH = SYMBOLS + 4
FORMS = (files("soter.verify.tubes") / "forms.soter").read_text(encoding="utf-8")
SIZES = f"const SYMBOLS: int = {SYMBOLS};\nconst NONE: float[SYMBOLS] = [0.0, 0.0, 0.0, 0.0];\n"
TAKEN, GIVEN = 64, 64
"""Forms that `tried` takes and gives."""


def probe(text: str, symbols: int) -> str:
    """A program around `tried(op, a: Form[TAKEN], k: float[64]): Form[GIVEN]`."""
    return f"""soter 1;
{text}
topic done: float = 0.0;
node Probe period 10ms {{
  publishes done;
  var a: Form[{TAKEN}];
  var k: float[64];
  step {{ publish done = tried(0, a, k)[0].lo + {float(symbols)}; }}
}}
system Probing default {{ node Probe; until 1s; }}
"""


class Library:
    """Compiled functions; `call` gives forms as rows of doubles (c, r, lo, hi, g), or a fault."""

    def __init__(self, folder: Path, programs: dict[str, tuple[str, int]]) -> None:
        lines, self.widths = [], {}
        for name, (text, symbols) in programs.items():
            checked = check_file(f"{name}.soter", probe(text, symbols))
            assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
            unit = generate(system_of(checked, "Probing"), prefix=name)
            (folder / f"{name}.h").write_text(unit.header, encoding="utf-8")
            (folder / f"{name}.c").write_text(unit.source, encoding="utf-8")
            faults = re.search(rf"{name}_tried_fn\([^;{{]*fault\s*\*?fault\)", unit.source)
            lines.append(self._wrapper(name, symbols, faults=faults is not None))
            self.widths[name] = symbols + 4
        (folder / "wrap.c").write_text("\n".join(lines), encoding="utf-8")
        built = folder / "wrap.so"
        call_compiler(
            folder, "-O0", "-w", "-fPIC", "-shared", "-o", str(built),
            str(folder / "wrap.c"), str(CHECK_FAILED), "-lm",
        )  # fmt: skip
        self.ffi = cffi.FFI()
        for name in programs:
            self.ffi.cdef(f"int try_{name}(long long op, double *a, double *k, double *out);")
        self.built = self.ffi.dlopen(str(built))

    @staticmethod
    def _wrapper(name: str, symbols: int, *, faults: bool) -> str:
        """One call, over bytes that are copied: a form is its doubles in a row."""
        width = symbols + 4
        return f"""#include "{name}.c"
#include <string.h>
int try_{name}(long long op, double *a, double *k, double *out) {{
  static {name}_Form_{TAKEN} taken;
  static {name}_Form_{GIVEN} made;
  {name}_double_64 numbers;
  soter_fault fault;
  memset(&fault, 0, sizeof fault);
  memcpy(&taken, a, sizeof taken);
  memcpy(&numbers, k, sizeof numbers);
  {name}_tried_fn(op, &taken, &numbers, &made{", &fault" if faults else ""});
  memcpy(out, &made, sizeof(double) * {GIVEN * width});
  return fault != 0;
}}
"""

    def call(
        self, name: str, op: int, forms: Sequence[Sequence[float]], numbers: Sequence[float] = ()
    ) -> list[list[float]] | None:
        """What `tried` gives; None where something faults."""
        width = self.widths[name]
        a = self.ffi.new("double[]", TAKEN * width)
        for i, f in enumerate(forms):
            a[i * width : (i + 1) * width] = list(f)
        k = self.ffi.new("double[64]", [*numbers, *[0.0] * (64 - len(numbers))])
        out = self.ffi.new("double[]", GIVEN * width)
        if getattr(self.built, f"try_{name}")(op, a, k, out):
            return None
        flat = list(out)
        return [flat[i * width : (i + 1) * width] for i in range(GIVEN)]


@dataclass
class Drawn:
    """A form and what it stands for at some choices of its symbols: eps -> a value."""

    row: list[float]
    values: list[Fraction]


def eps_of(rng: random.Random, symbols: int) -> list[Fraction]:
    """A choice of symbols, often at ends."""
    return [
        Fraction(rng.choice((-1, 1))) if rng.random() < 0.6 else Fraction(rng.uniform(-1, 1))
        for _ in range(symbols)
    ]


def drawn(
    rng: random.Random, all_eps: list[list[Fraction]], size: float, low: float, high: float
) -> Drawn:
    """A form about a number within [low, high], with a value there for each choice of symbols."""
    wide = size * rng.choice((0.0, 1e-9, 1e-3, 0.1, 1.0))
    c = max(min(rng.choice((0.0, rng.uniform(-size, size))), high), low)
    g = [rng.choice((0.0, rng.uniform(-wide, wide))) for _ in all_eps[0]]
    r = rng.choice((0.0, rng.uniform(0, wide)))
    bound = Fraction(low), Fraction(high)
    values = []
    for eps in all_eps:
        share = rng.choice((-1.0, 1.0, rng.uniform(-1, 1)))
        v = Fraction(c) + sum(Fraction(x) * e for x, e in zip(g, eps, strict=True))
        values.append(min(max(v + Fraction(share) * Fraction(r), bound[0]), bound[1]))
    # a value that was moved into the bounds is further off
    off = [
        abs(v - Fraction(c) - sum(Fraction(x) * e for x, e in zip(g, eps, strict=True)))
        for v, eps in zip(values, all_eps, strict=True)
    ]
    r = max(r, up(max(off)))
    most = Fraction(c) + sum(map(Fraction, map(abs, g))) + Fraction(r)
    least = 2 * Fraction(c) - most
    lo = max(down(least), low) if rng.random() < 0.5 else down(min(values))
    hi = min(up(most), high) if rng.random() < 0.5 else up(max(values))
    return Drawn([c, r, lo, hi, *g], values)


def up(x: Fraction) -> float:
    """The least double at or above."""
    import math

    f = float(x)
    return f if Fraction(f) >= x else math.nextafter(f, math.inf)


def down(x: Fraction) -> float:
    """The greatest double at or below."""
    return -up(-x)


def off_by(row: Sequence[float], eps: Sequence[Fraction], low: Any, high: Any) -> Fraction:
    """How far [low, high] lies outside a form at a choice of symbols, in parts; 0: in it."""
    c, r, lo, hi, *g = row
    if not (lo <= hi):
        return Fraction(10**9)
    below, above = Fraction(low), Fraction(high)
    worst = Fraction(0)
    if lo > -1e308:
        worst = max(worst, Fraction(lo) - below)
    if hi < 1e308:
        worst = max(worst, above - Fraction(hi))
    if all(abs(x) < 1e308 for x in (c, r, *g)):
        at = Fraction(c) + sum(Fraction(x) * e for x, e in zip(g, eps, strict=True))
        worst = max(worst, at - Fraction(r) - below, above - at - Fraction(r))
    elif any(x != x for x in (c, *g)) and r < 1e308:  # noqa: PLR0124
        return Fraction(10**9)  # a centre that is none, and nothing says so
    return worst
