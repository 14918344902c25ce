"""Every operation of soter_form.h against exact arithmetic: outward, at every eps.

A random form is a centre, slopes, a remainder and ends that cut some of it off; its numbers at a
random eps are exact rationals. What the operation gives for them, exactly and rounded to binary64,
must lie in the resulting form at the same eps. Functions of the prelude are compared with mpmath.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import cffi
import mpmath
import pytest

from generators.engine_comparison import call_compiler
from generators.python_enclosures import seeded
from soter.language.prelude.function_error_bounds import BOUNDS
from soter.native.shared_library import CHECK_FAILED
from soter.verify.enclose.core_enclosure import ENCLOSED
from tables import all_rows

if TYPE_CHECKING:
    import random
    from collections.abc import Callable
    from pathlib import Path

INPUTS = 5
FORMS = 80
POINTS = 6
LARGEST = Fraction(math.nextafter(math.inf, 0.0))

UNARY = ("neg", "abs", "floor", "sqrt", "square", "inverse")
BINARY = ("add", "sub", "mul", "div", "min", "max", "join")
CONSTANT = ("at_least", "at_most")
RANGE = ("shift", "scale", "over")
ROUNDED = frozenset(("square", "add", "sub", "mul", "div", *RANGE))
"""Whose results a program rounds; those of the others are exact."""


def c_text() -> str:
    """Wrappers of one shape around all operations."""
    lines = [f"#define SOTER_INPUTS {INPUTS}", '#include "soter_form.h"']
    calls = {n: f"soter_n_{n}(SOTER_INPUTS, out, &in[0])" for n in UNARY}
    calls |= {n: f"soter_n_{n}(SOTER_INPUTS, out, &in[0], &in[1])" for n in BINARY}
    calls |= {n: f"soter_n_{n}(SOTER_INPUTS, out, &in[0], in[1].lo)" for n in CONSTANT}
    calls |= {n: f"soter_n_{n}(SOTER_INPUTS, out, &in[0], in[1].lo, in[1].hi)" for n in RANGE}
    for n in ENCLOSED:
        more = ", &in[1]" if len(BOUNDS[n].domain) == 2 else ""
        calls[n] = f"soter_n_{n}(SOTER_INPUTS, out, &in[0]{more}, in[2].lo)"
    signature = "(const soter_form in[], soter_form out[])"
    for name, call in calls.items():
        lines.append(f"void wrap_{name}{signature};")
        lines.append(f"void wrap_{name}{signature} {{ {call}; }}")
    lines.append("unsigned compare(const soter_form in[], int op);")
    lines.append("unsigned compare(const soter_form in[], int op) {")
    lines.append("  return op == 0   ? soter_n_less(SOTER_INPUTS, &in[0], &in[1])")
    lines.append("         : op == 1 ? soter_n_no_more(SOTER_INPUTS, &in[0], &in[1])")
    lines.append("                   : soter_equal(&in[0], &in[1]);\n}")
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The compiled wrappers, with their `ffi`."""
    folder: Path = tmp_path_factory.mktemp("forms")
    (folder / "wrap.c").write_text(c_text(), encoding="utf-8")
    built = folder / "wrap.so"
    call_compiler(
        folder,
        "-O2",
        "-fPIC",
        "-shared",
        "-o",
        str(built),
        str(folder / "wrap.c"),
        str(CHECK_FAILED),
        "-lm",
    )
    ffi = cffi.FFI()
    ffi.cdef(f"typedef struct {{ double lo, hi, c, r; double g[{INPUTS}]; }} soter_form;")
    for n in (*UNARY, *BINARY, *CONSTANT, *RANGE, *sorted(ENCLOSED)):
        ffi.cdef(f"void wrap_{n}(const soter_form in[], soter_form out[]);")
    ffi.cdef("unsigned compare(const soter_form in[], int op);")
    return ffi, ffi.dlopen(str(built))


# ---------------------------------------------------------------- random forms


@dataclass
class Sample:
    """Operands as C forms, and points: eps with the exact numbers of the operands there."""

    forms: Any
    points: list[tuple[list[Fraction], list[Fraction]]]


def number(rng: random.Random, size: float) -> float:
    """Mostly of about `size`; sometimes zero, whole, much smaller or much larger."""
    kind = rng.random()
    if kind < 0.12:
        return 0.0
    if kind < 0.2:
        return float(rng.randint(-3, 3))
    if kind < 0.26:
        return float(rng.choice((-1, 1)) * 10.0 ** rng.uniform(-300, -5))
    if kind < 0.3:
        return float(rng.choice((-1, 1)) * 10.0 ** rng.uniform(5, 150))
    return rng.uniform(-size, size)


def sample(
    ffi: Any, rng: random.Random, count: int, low: float | None, high: float | None
) -> Sample:
    """`count` operands that share the inputs; with `low`, `high` all numbers lie between."""
    forms = ffi.new("soter_form[]", count)
    all_eps = [
        [Fraction(rng.choice((-1.0, 1.0, rng.uniform(-1, 1)))) for _ in range(INPUTS)]
        for _ in range(POINTS)
    ]
    values: list[list[Fraction]] = []
    for k in range(count):
        form = forms[k]
        while True:
            form.c = number(rng, 4.0)
            scale = rng.choice((0.0, 1e-9, 1e-3, 0.1, 1.0))
            form.r = abs(number(rng, 1.0)) * rng.choice((0.0, scale))
            for i in range(INPUTS):
                form.g[i] = number(rng, 1.0) * scale if rng.random() < 0.7 else 0.0
            numbers = [at(form, e) + Fraction(form.r) * _rho(rng) for e in all_eps]
            if low is not None and high is not None:
                inside = [x for x in numbers if low <= x <= high]
                if len(inside) < len(numbers):
                    form_into(form, rng, low, high)
                    numbers = [at(form, e) for e in all_eps]
                    if any(not low <= x <= high for x in numbers):
                        continue
            break
        _ends(form, numbers, rng, low, high)
        values.append(numbers)
    points = [(e, [v[j] for v in values]) for j, e in enumerate(all_eps)]
    return Sample(forms, points)


def form_into(form: Any, rng: random.Random, low: float, high: float) -> None:
    """Somewhere between two numbers."""
    form.c = rng.uniform(low, high)
    room = min(high - form.c, form.c - low) * rng.choice((1e-6, 0.1, 0.99)) / INPUTS
    form.r = 0.0
    for i in range(INPUTS):
        form.g[i] = rng.uniform(-room, room)


def _rho(rng: random.Random) -> Fraction:
    return Fraction(rng.choice((-1.0, 1.0, 0.0, rng.uniform(-1, 1))))


def at(form: Any, eps: list[Fraction]) -> Fraction:
    """The first-order part at an eps."""
    return Fraction(form.c) + sum(
        (Fraction(form.g[i]) * e for i, e in enumerate(eps)), start=Fraction(0)
    )


def down(x: Fraction) -> float:
    """The largest double not above."""
    y = float(x)
    return y if Fraction(y) <= x else math.nextafter(y, -math.inf)


def _ends(
    form: Any, numbers: list[Fraction], rng: random.Random, low: float | None, high: float | None
) -> None:
    """Ends just around the numbers, or wider."""
    margin = rng.choice((0.0, 0.0, 0.1, 1.0)) * float(max(numbers) - min(numbers))
    form.lo, form.hi = down(min(numbers)) - margin, -down(-max(numbers)) + margin
    if low is not None and high is not None:
        form.lo, form.hi = max(form.lo, low), min(form.hi, high)


def encloses(form: Any, eps: list[Fraction], value: Fraction) -> bool:
    """Whether a form holds an exact number at an eps."""
    if not (form.lo == -math.inf or Fraction(form.lo) <= value):
        return False
    if not (form.hi == math.inf or value <= Fraction(form.hi)):
        return False
    return form.r == math.inf or abs(value - at(form, eps)) <= Fraction(form.r)


def rounded(x: Fraction) -> Fraction | None:
    """What the program makes of it; None where that is infinite."""
    try:
        return Fraction(float(x))
    except OverflowError:
        return None


# ---------------------------------------------------------------- arithmetic

EXACT: dict[str, Callable[..., Fraction | None]] = {
    "neg": lambda x: -x,
    "abs": abs,
    "floor": lambda x: Fraction(math.floor(x)),
    "square": lambda x: x * x,
    "inverse": lambda x: 1 / x,
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y if y else None,
    "min": min,
    "max": max,
}


def check(library: Any, name: str, s: Sample, exact: Callable[..., Fraction | None]) -> int:
    """Assert that all points hold; gives how many said something of first order."""
    ffi, lib = library
    out = ffi.new("soter_form[]", 1)
    getattr(lib, f"wrap_{name}")(s.forms, out)
    told = 0
    for eps, numbers in s.points:
        value = exact(*numbers)
        if value is None:
            continue
        seen = [value, rounded(value)] if name in ROUNDED else [value]
        for v in seen:
            if v is None:
                assert out[0].lo == -math.inf or out[0].hi == math.inf, name
            else:
                assert encloses(out[0], eps, v), (name, numbers, float(v))
        told += out[0].r < math.inf
    return told


@pytest.mark.parametrize("name", [n for n in (*UNARY, *BINARY) if n in EXACT])
def test_operations_enclose_exact_and_rounded_results(library: Any, name: str) -> None:
    rng = seeded(name)
    told = 0
    for _ in range(FORMS):
        s = sample(library[0], rng, 2, None, None)
        exact = EXACT[name]
        if name in UNARY:
            s = Sample(s.forms, [(e, v[:1]) for e, v in s.points])
        if name == "inverse" and s.forms[0].lo <= 0.0 <= s.forms[0].hi:
            continue
        told += check(library, name, s, exact)
    assert told > FORMS * POINTS / 4


@pytest.mark.parametrize("name", ["add", "sub", "mul", "scale", "shift", "square"])
def test_rounding_of_centre_and_slopes_is_in_the_remainder(library: Any, name: str) -> None:
    """Large parts that cancel to a small number, known to be small by its ends."""
    ffi, _ = library
    rng = seeded(name)
    seen = 0
    for _ in range(8 * FORMS):
        eps = [Fraction(rng.uniform(-1, 1)) for _ in range(INPUTS)]
        forms = ffi.new("soter_form[]", 2)
        values = []
        for k in range(2):
            for i in range(INPUTS):
                forms[k].g[i] = rng.uniform(-1, 1)
            forms[k].c = 0.0
            forms[k].c = -float(at(forms[k], eps))
            x = at(forms[k], eps)
            values.append(x)
            forms[k].lo, forms[k].hi = down(x), -down(-x)
        if name in RANGE:
            low = rng.uniform(-1, 1)
            forms[1].lo = forms[1].hi = low
            values[1] = Fraction(low)
            if name == "shift":
                low = forms[1].lo = forms[1].hi = -float(values[0])
                forms[0].c += 1.0 / 3.0
                values = [at(forms[0], eps), Fraction(low)]
                forms[0].lo, forms[0].hi = down(values[0]), -down(-values[0])
        wanted = values[:1] if name == "square" else values
        exact = {**EXACT, "scale": EXACT["mul"], "shift": EXACT["add"]}[name]
        seen += check(library, name, Sample(forms, [(eps, wanted)]), exact)
    assert seen > 4 * FORMS


def test_undecided_branches_hold_either_side(library: Any) -> None:
    rng = seeded(5)
    for _ in range(FORMS):
        s = sample(library[0], rng, 2, None, None)
        check(library, "join", s, lambda x, _y: x)
        check(library, "join", s, lambda _x, y: y)


@pytest.mark.parametrize("name", [*CONSTANT, *RANGE])
def test_operations_with_constants_hold(library: Any, name: str) -> None:
    rng = seeded(name)
    exact: dict[str, Callable[[Fraction, Fraction], Fraction]] = {
        "at_least": max,
        "at_most": min,
        "shift": lambda x, k: x + k,
        "scale": lambda x, k: x * k,
        "over": lambda x, k: x / k,
    }
    for _ in range(FORMS):
        s = sample(library[0], rng, 2, None, None)
        low = number(rng, 3.0)
        high = low if name in CONSTANT or rng.random() < 0.5 else low + abs(number(rng, 0.1))
        if name == "over" and low <= 0.0 <= high:
            continue
        s.forms[1].lo, s.forms[1].hi = low, high
        for k in (Fraction(low), Fraction(high), (Fraction(low) + Fraction(high)) / 2):
            points = [(e, [v[0], k]) for e, v in s.points]
            check(library, name, Sample(s.forms, points), exact[name])


def test_square_roots_hold(library: Any) -> None:
    ffi, lib = library
    rng = seeded(7)
    out = ffi.new("soter_form[]", 1)
    told = 0
    for _ in range(2 * FORMS):
        s = sample(ffi, rng, 1, 0.0, 10.0 ** rng.uniform(-9, 9))
        lib.wrap_sqrt(s.forms, out)
        for eps, (x,) in s.points:
            with mpmath.workprec(300):
                root = _fraction(mpmath.sqrt(mpmath.mpf(x.numerator) / x.denominator))
            assert encloses(out[0], eps, root)
            assert encloses(out[0], eps, Fraction(float(root)))
            told += out[0].r < math.inf
    assert told > FORMS


def _fraction(x: Any) -> Fraction:
    return Fraction(*mpmath.libmp.to_rational(x._mpf_))


def test_comparisons_say_what_may_be(library: Any) -> None:
    ffi, lib = library
    rng = seeded(8)
    decided = 0
    for _ in range(4 * FORMS):
        s = sample(ffi, rng, 2, None, None)
        for op, holds in enumerate(("<", "<=", "==")):
            said = lib.compare(s.forms, op)
            decided += said != 3
            for _, (x, y) in s.points:
                true = {"<": x < y, "<=": x <= y, "==": x == y}[holds]
                assert said & (2 if true else 1), (holds, float(x), float(y))
    assert decided > FORMS


# ---------------------------------------------------------------- functions of the prelude

WHERE = {
    "sin": (-40.0, 40.0), "cos": (-40.0, 40.0), "tan": (-1.5, 1.5), "exp": (-30.0, 30.0),
    "log": (1e-6, 1e6), "tanh": (-6.0, 6.0), "atan": (-50.0, 50.0), "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0), "atan2": (-5.0, 5.0), "hypot": (-1e3, 1e3), "pow": (0.01, 20.0),
}  # fmt: skip


@all_rows("far", [1.0, 1.0e9])
@all_rows("name", sorted(ENCLOSED))
def test_functions_of_the_prelude_hold(library: Any, name: str, far: float) -> None:
    """Exact, and as far off as the prelude may be; also where that were much further."""
    ffi, lib = library
    rng = seeded(name)
    out = ffi.new("soter_form[]", 1)
    count = len(BOUNDS[name].domain)
    low, high = (_finite(x) for x in BOUNDS[name].values)
    told = narrow = 0
    ulps = BOUNDS[name].ulps * far
    for _ in range(FORMS // 2):
        s = sample(ffi, rng, 3, *WHERE[name])
        s.forms[2].lo = ulps
        getattr(lib, f"wrap_{name}")(s.forms, out)
        for eps, numbers in s.points:
            with mpmath.workprec(200):
                arguments = [mpmath.mpf(x.numerator) / x.denominator for x in numbers[:count]]
                if name == "atan2" and numbers[1] <= 0 == numbers[0]:
                    continue
                function = mpmath.power if name == "pow" else getattr(mpmath, name)
                exact = _fraction(mpmath.mpf(function(*arguments)))
            off = Fraction(ulps) * Fraction(math.ulp(float(exact)))
            for value in (exact, exact - off, exact + off):
                bounded = max(min(value, high), low)
                assert encloses(out[0], eps, bounded), (name, [float(x) for x in numbers])
            told += out[0].r < math.inf
            narrow += out[0].hi - out[0].lo < 10.0
    assert told > FORMS / 2
    assert narrow > FORMS / 4


def _finite(x: float) -> Fraction:
    return Fraction(x) if math.isfinite(x) else (LARGEST if x > 0 else -LARGEST)
