"""Each operation of `forms.soter` against Arb: what it gives holds the exact value, and what a
program computes that rounds, at every choice of symbols, by its ends and by its affine part.
"""

from __future__ import annotations

import math
import random
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING, Any

import pytest

from soter.language.prelude.function_error_bounds import BOUNDS
from soter.verify.tubes.generated_functions import Caller
from tables import all_rows
from unit.verify.tubes.soter_forms import (
    FORMS,
    SIZES,
    SYMBOLS,
    Library,
    drawn,
    eps_of,
    off_by,
)

flint = pytest.importorskip("flint")
if TYPE_CHECKING:
    from collections.abc import Callable

arb = flint.arb
EVERY = (-1e30, 1e30)
FEW = 24
POINTS = 3

CALLS = {
    "add": "f_add(a[0], a[1])", "sub": "f_sub(a[0], a[1])", "mul": "f_mul(a[0], a[1])",
    "max": "f_max(a[0], a[1])", "min": "f_min(a[0], a[1])", "square": "f_square(a[0])",
    "sin": "f_sin(a[0])", "cos": "f_cos(a[0])", "inverse": "f_inverse(a[0])",
    "sqrt": "f_sqrt(a[0])", "tan": "f_tan(a[0])", "atan": "f_atan(a[0])",
    "tanh": "f_tanh(a[0])", "exp": "f_exp(a[0])", "wrap_angle": "f_wrap_angle(a[0])",
    "plus": "f_plus(a[0], k[0])", "times": "f_times(a[0], k[0])", "over": "f_over(a[0], k[0])",
    "clamp": "f_clamp(a[0], k[0], k[1])", "limit": "f_limit(a[0], a[1], a[2])",
    "widened": "widened(a[0], k[0])", "range": "f_range(k[0], k[1])",
    "select": "f_select(a[2].lo > 0.0, a[2].hi <= 0.0, a[0], a[1])",
    "share": "f_share(a[0])", "neg": "f_neg(a[0])", "friction": "f_friction(a[0], k[0])",
    "log": "f_log(a[0])", "asin": "f_asin(a[0])", "acos": "f_acos(a[0])",
    "atan2": "f_atan2(a[0], a[1])",
}  # fmt: skip
NUMBERS = {name: i for i, name in enumerate(CALLS)}


def chosen(calls: dict[str, str]) -> str:
    """The text of `tried`: each operation by its number."""
    lines = [f"  if op == {i} {{ b[0] = {call}; }}" for i, call in enumerate(calls.values())]
    return (
        "const ZERO: Form = { c: 0.0, r: 0.0, lo: 0.0, hi: 0.0, g: NONE };\n"
        "fun tried(op: int, a: Form[64], k: float[64]): Form[64] {\n  var b = a;\n"
        + "\n".join(lines) + "\n  return b;\n}\n"
    )  # fmt: skip


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    text = SIZES + FORMS + chosen(CALLS)
    return Library(tmp_path_factory.mktemp("forms"), {"forms": (text, SYMBOLS)})


def exact(name: str, x: list[Fraction], k: list[float]) -> tuple[Fraction, Fraction]:
    """Bounds of the real value that are next to it."""
    with flint.ctx.workprec(1400 if name in ("exp", "wrap_angle") else 300):
        a = [arb(flint.fmpq(v.numerator, v.denominator)) for v in x]
        n = [arb(v) for v in k]
        values: dict[str, Callable[[], Any]] = {
            "add": lambda: a[0] + a[1], "sub": lambda: a[0] - a[1], "mul": lambda: a[0] * a[1],
            "max": lambda: a[0].max(a[1]), "min": lambda: a[0].min(a[1]),
            "square": lambda: a[0] * a[0], "sin": a[0].sin, "cos": a[0].cos,
            "inverse": lambda: 1 / a[0], "sqrt": a[0].sqrt, "tan": a[0].tan,
            "atan": a[0].atan, "tanh": a[0].tanh, "exp": a[0].exp, "log": a[0].log,
            "asin": a[0].asin, "acos": a[0].acos, "atan2": lambda: arb.atan2(a[0], a[1]),
            "plus": lambda: a[0] + n[0], "times": lambda: a[0] * n[0], "over": lambda: a[0] / n[0],
            "clamp": lambda: a[0].max(n[0]).min(n[1]),
            "limit": lambda: a[0].max(a[1]).min(a[2]),
            "wrap_angle": lambda: a[0] - 2 * arb.pi() * (a[0] / (2 * arb.pi()) + 0.5).floor(),
            "select": lambda: a[0] if x[2] > 0 else a[1],
            "neg": lambda: -a[0], "friction": lambda: a[0] / (abs(a[0]) + n[0]),
        }  # fmt: skip
        v = values[name]()
        low, high = v.lower(), v.upper()
        return _fraction(low), _fraction(high)


def _fraction(x: Any) -> Fraction:
    man, exp = x.mid().man_exp()
    return Fraction(int(man)) * Fraction(2) ** int(exp)


WHOLE = "sin cos tan atan tanh exp log asin acos atan2".split()  # noqa: SIM905 - a list of words
ULPS = {n: BOUNDS[n].ulps for n in WHOLE}
ROUNDED = frozenset(("add", "sub", "mul", "square", "inverse", "sqrt", "plus", "times", "over"))
DOMAIN = {
    "inverse": (1e-9, 1e30), "sqrt": (0.0, 1e30), "tan": (-1.45, 1.45), "exp": (-700.0, 600.0),
    "sin": (-9e4, 9e4), "cos": (-9e4, 9e4), "wrap_angle": (-9e4, 9e4), "log": (1e-9, 1e30),
    "asin": (-1.0, 1.0), "acos": (-1.0, 1.0),
}  # fmt: skip


def rounded(name: str, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction]:
    """What a program may compute in place of a value: the next double, or as far as is promised."""
    if name in ROUNDED:
        return Fraction(float(low)), Fraction(float(high))
    if name == "friction":  # a sum and a quotient
        off = Fraction(1.5 * 2.0**-52) * max(abs(low), abs(high)) + Fraction(5e-324)
        return low - off, high + off
    if name in ULPS:
        off = Fraction(ULPS[name]) * Fraction(math.ulp(float(high)))
        least, most = BOUNDS[name].values
        if math.isinf(most):
            return low - off, high + off
        return max(low - off, Fraction(least)), min(high + off, Fraction(most))
    return low, high


def size_of(rng: random.Random) -> float:
    return float(
        rng.choice((1.0, 1.0, 3.0, 10.0 ** rng.uniform(-8, 8), 10.0 ** rng.uniform(-40, 30)))
    )


@all_rows("name", [n for n in CALLS if n not in ("widened", "range", "share")])
def test_an_operation_holds_the_value_and_what_a_program_rounds_it_to(
    library: Library, name: str
) -> None:
    rng = random.Random(name)  # noqa: S311 - drawn examples
    low, high = DOMAIN.get(name, EVERY)
    judged = narrow = 0
    for _ in range(FEW):
        all_eps = [eps_of(rng, SYMBOLS) for _ in range(POINTS)]
        size = size_of(rng)
        forms = [drawn(rng, all_eps, size, low, high) for _ in range(3)]
        if name == "limit":
            forms[1] = drawn(rng, all_eps, size, -1e30, 0.0)
            forms[2] = drawn(rng, all_eps, size, 0.0, 1e30)
        k = [rng.uniform(-size, size), 0.0]
        if name == "over" and rng.random() < 0.5:
            k[0] = rng.uniform(-3, 3)
        if name == "friction":
            k[0] = max(abs(k[0]) * rng.choice((1.0, 1e-3)), 1e-30)
        if name == "clamp":
            k[1] = k[0] + rng.choice((0.0, rng.uniform(0, size)))
            if rng.random() < 0.6:  # a value at one of its kinks, where it is furthest from a line
                kink = float(rng.choice(forms[0].values))
                k = rng.choice(([kink - size, kink], [kink, kink + size]))
        if (got := library.call("forms", NUMBERS[name], [f.row for f in forms], k)) is None:
            assert name in ("inverse", "sqrt", "limit", "tan", "log", "asin", "acos")
            continue
        row = got[0]
        for i, eps in enumerate(all_eps):
            x = [f.values[i] for f in forms]
            for bounds in (value := exact(name, x, k), rounded(name, *value)):
                # of a number that Arb gives as a ball, its middle is as far off as 2^-250 of it
                slack = (abs(value[1]) + 1) * Fraction(2) ** -250
                off = off_by(row, eps, bounds[0], bounds[1])
                assert off <= slack, (name, [f.row for f in forms], k, row, float(off))
        judged += 1
        narrow += row[1] <= 1e-9 * (1 + size)
    assert judged > FEW // 2
    assert narrow or name == "select"


WILD = (0.0, -0.0, 5e-324, 1e-310, 1e-163, 1e-107, 1.0, 1e5, 1e107, 1e163, 1e299, 1.7e308, math.inf)


@all_rows("name", [n for n in CALLS if n not in ("widened", "range", "share")])
def test_wild_numbers_are_held_or_nothing_is_said(library: Library, name: str) -> None:
    """Denormal, huge and endless forms: no end is ever NaN, or too near."""
    rng = random.Random(f"wild {name}")  # noqa: S311 - drawn examples
    for _ in range(10 * FEW):
        rows, x = [], []
        for _ in range(3):
            one, other = (rng.choice((-1, 1)) * rng.choice(WILD) for _ in range(2))
            if rng.random() < 0.7:
                other = one * rng.choice((3.0, 0.3))
            lo, hi = min(one, other), max(one, other)
            if lo == math.inf or hi == -math.inf:
                lo, hi = -math.inf, math.inf
            made = library.call("forms", NUMBERS["range"], [], [lo, hi])
            assert made is not None
            rows.append(made[0])
            ends = [v for v in (lo, hi, 0.5 * lo + 0.5 * hi) if abs(v) < 1e308 and lo <= v <= hi]
            x.append(Fraction(rng.choice(ends or [1.7e308 if hi > 0 else -1.7e308])))
        k = [rng.choice((-1, 1)) * rng.choice(WILD[:-2]), 0.0]
        k[1] = max(k[0], rng.choice(WILD[:-2]))
        if name == "friction" and not 0.0 < k[0] < 1e300:
            continue
        if name == "limit" and not x[1] <= x[2]:
            continue
        if (name == "over" and k[0] == 0.0) or (name == "inverse" and not x[0]):
            continue
        if (got := library.call("forms", NUMBERS[name], rows, k)) is None:
            continue
        row = got[0]
        assert row[2] == row[2]
        assert row[3] == row[3]
        if (name == "sqrt" and x[0] < 0) or (name == "exp" and not -800 < x[0] < 800):
            continue
        value = exact(name, x, k)
        slack = (abs(value[1]) + Fraction(2) ** -1100) * Fraction(2) ** -250
        off = off_by(row, [Fraction(0)] * SYMBOLS, value[0], value[1])
        assert off <= slack, (name, rows, k, row, [float(v) for v in x])


WIDE = [(1e200, 2e200), (-2e200, -1e200), (1e308, 1.5e308), (-1.5e308, -1e308), (5e-324, 1e-320),
        (-1e-320, -5e-324), (-math.inf, math.inf), (0.0, math.inf), (1.0, math.inf),
        (-math.inf, -1.0), (710.0, 720.0), (-1e308, 1e308), (1e299, 2e299), (0.5, 2.0)]  # fmt: skip
OF_ONE: dict[str, Callable[..., Fraction]] = {
    "neg": lambda x: -x,
    "square": lambda x: x * x,
    "abs": abs,
    "inverse": lambda x: 1 / x,
}
OF_NUMBERS: dict[str, Callable[..., Fraction]] = {
    "times": lambda x, k: x * k,
    "over": lambda x, k: x / k,
    "plus": lambda x, k: x + k,
}
OF_TWO: dict[str, Callable[..., Fraction]] = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "max": max,
    "min": min,
}


def test_ranges_that_leave_the_doubles_hold_what_is_computed() -> None:
    """No end is ever no number, which `min` and `max` of a program would leave out."""
    caller = Caller(SIZES + FORMS)
    asked: list[Any] = [(n, f, (a,), ()) for n, f in OF_ONE.items() for a in WIDE]
    numbers = (1e200, -1e200, 1e-200, 1e308, -1e308, 3.0)
    asked += [(n, f, (a,), (k,)) for n, f in OF_NUMBERS.items() for a in WIDE for k in numbers]
    asked += [(n, f, (a, b), ()) for n, f in OF_TWO.items() for a in WIDE for b in WIDE]
    asked += [(n, None, (a,), ()) for n in ("exp", "tanh", "atan", "share") for a in WIDE]
    for name, f, over, k in asked:
        got = caller.result(f"i_{name}", *over, *k)
        if got is None:  # a divisor that may be zero
            continue
        assert got[0] <= got[1], (name, over, k, got)
        for ends in product(*over) if f is not None else ():
            if all(map(math.isfinite, ends)):
                exactly = f(*map(Fraction, (*ends, *k)))
                assert got[0] <= exactly <= got[1], (name, ends, k, got)


def test_what_has_one_end_keeps_it_in_sums_limits_and_multiples(library: Library) -> None:
    """A gap to somebody who drives off has no upper end."""

    def of(name: str, *rows: list[float], k: tuple[float, ...] = ()) -> list[float]:
        got = library.call("forms", NUMBERS[name], rows, k)
        assert got is not None
        return got[0]

    gap, other = of("range", k=(3.0, math.inf)), of("range", k=(1.0, 2.0))
    assert of("add", gap, other)[2:4] == pytest.approx([4.0, math.inf])
    assert of("sub", other, gap)[2:4] == pytest.approx([-math.inf, -1.0])
    assert of("times", gap, k=(2.0,))[2:4] == pytest.approx([6.0, math.inf])
    assert of("max", gap, other)[2:4] == pytest.approx([3.0, math.inf])
    assert of("clamp", gap, k=(0.0, 5.0))[2:4] == pytest.approx([3.0, 5.0])
    assert of("mul", gap, other)[2:4] == [-math.inf, math.inf]
