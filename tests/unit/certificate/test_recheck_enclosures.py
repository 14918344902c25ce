"""What the re-checker computes encloses what programs and plants do."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from flint import arb

import soter
from soter.certificate.extras import prelude_functions
from soter.certificate.reading.linear_flows import LinearFlow, exponential
from soter.certificate.reading.symbolic_reading import Surroundings, SymbolicReader
from soter.certificate.terms.compile_terms import compile_step, form_of_box
from soter.certificate.terms.linear_enclosures import (
    FUNCTIONS,
    ONE,
    ZERO,
    exact,
    line_noisy_max0,
    line_or_range,
)
from soter.certificate.terms.straight_line import OPERATIONS, Builder, Function
from soter.certificate.terms.terms import FALSE, TRUE, Linear, Terms
from soter.language.front_end import check_file
from soter.language.model import typed
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

UNIVARIATE = {**FUNCTIONS, **prelude_functions.FUNCTIONS}
del UNIVARIATE["atan2"], UNIVARIATE["pow"]
PROGRAM = """soter 1;
type P = { x: float, y: float };
const TABLE: float[5] = [1.0, -2.0, 0.5, 4.0, 3.0];
const GRID: float[3][2] = [[1.0, 2.0, 3.0], [-1.0, 0.0, 5.0]];
fun Limits(x: float, y: float): float { return clamp(3.0 * x - y, -1.0, 1.0) + min(x, 0.5 * y); }
fun Roots(x: float, y: float): float { return sqrt(x * x + y * y) + norm(vec2(x, 2.0 * y)); }
fun Parts(x: float, y: float): float { return (x + 1.0) / (5.0 + y) - abs(x - y); }
fun Early(x: float, y: float): float {
  if x > 0.3 {
    return x * y;
  }
  var z = y;
  if y < x {
    z = 2.0 * x;
  }
  return z - 0.25 * x;
}
fun Loops(x: float, y: float): float {
  var sum = 0.0;
  for i in 0..4 {
    sum = 0.5 * sum + (i == 2 ? y : x);
  }
  return sum;
}
fun Looked(x: float, y: float): float {
  let i = max(0, min(int(floor(x + 2.0)), 4));
  return TABLE[i] + y;
}
fun Twice(x: float, y: float): float {
  return GRID[x > 0.0 ? 1 : 0][max(0, min(int(floor(y + 1.0)), 2))];
}
fun Waves(x: float, y: float): float { return sin(2.0 * x) * cos(y) + exp(-0.3 * x) + tanh(y); }
fun Logs(x: float, y: float): float { return log(4.0 + x) - atan(x - y); }
fun Choices(x: float, y: float): float {
  let far = x > 1.0 || (y > 0.5 && !(x < -1.0));
  return far ? smoothstep(0.0, 2.0, x) : saturate(x + y, 0.7);
}
fun Saturated(x: float, y: float): float { return clamp(9.0 * (0.3 * y - x), -1.8, 1.8); }
fun Between(x: float, y: float): float { return max(min(y, x - 1.1), 1.0 - x); }
fun Towards(x: float, y: float): float {
  let gap = x < 1.1 ? x - 1.1 : max(min(y, x - 1.1), 1.0 - 0.5 * y);
  return clamp(9.0 * (clamp(2.0 * gap, -0.7, 0.7) - y), -1.8, 1.8);
}
fun Vectors(x: float, y: float): float {
  let v = 2.0 * vec2(x, y) - vec2(y, x) / 3.0;
  return dot(v, vec2(y, 1.0));
}
"""
NAMES = (
    "Limits",
    "Roots",
    "Parts",
    "Early",
    "Loops",
    "Looked",
    "Twice",
    "Waves",
    "Logs",
    "Choices",
    "Saturated",
    "Between",
    "Towards",
)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("terms") / "terms.soter"
    path.write_text(PROGRAM)
    return path


def term_of(path: Path, name: str, terms: Terms) -> tuple[list[Linear], Linear]:
    """The function's inputs and its value as terms."""
    checked = check_file(str(path))
    assert checked.program is not None
    assert checked.ok, checked.diagnostics
    fun = checked.program.funs[name]
    inputs = [terms.add_input("state", p.name, exact(-6.0), exact(6.0)) for p in fun.parameters]
    reads = tuple(typed.VarRead(p.type, p.span, p) for p in fun.parameters)
    call = typed.TypedCall(fun.result, fun.span, fun, reads)
    reader = SymbolicReader(terms, Surroundings({}, {}))
    value = reader.evaluate(call, dict(zip(fun.parameters, inputs, strict=True)))
    return inputs, value


@all_rows("name", [*NAMES, "Vectors"])
def test_a_function_stays_within_its_enclosure(program: Path, name: str) -> None:
    terms = Terms()
    inputs, value = term_of(program, name, terms)
    places = [x.atom for x in inputs]
    step = compile_step(terms, places, 2, [value], ranges=[value], must=terms.obligations)
    function = soter.load(program).function(name)
    draw = np.random.default_rng(len(name))
    known = 0
    for _ in range(150):
        centre = draw.uniform(-2.5, 2.5, 2)
        width = 10.0 ** draw.uniform(-4, 0.3)
        box = [(exact(float(c - width)), exact(float(c + width))) for c in centre]
        image = step(form_of_box(box, symbols=True))
        if image is None:
            continue
        known += 1
        form, (low, high) = image
        for _ in range(6):
            at = draw.choice([-1.0, 1.0, float(draw.uniform(-1, 1))], 2)
            ends = [(float(a), float(b)) for a, b in box]
            x = [
                min(max(a + (b - a) * (s + 1) / 2, a), b)
                for (a, b), s in zip(ends, at, strict=True)
            ]
            y = function(*x)
            assert low <= y <= high
            eps = [
                (exact(v) - (a + b) / 2) / ((b - a) / 2) for v, (a, b) in zip(x, box, strict=True)
            ]
            _, _, middle, g0, g1, rest = form
            off = exact(y) - (middle + g0 * eps[0] + g1 * eps[1])
            assert not abs(off) > rest
    assert known > 100


def test_a_number_over_its_size_saturates() -> None:
    """What friction is: never more than a number over a factor, wherever the cell is."""
    terms = Terms()
    x, y = (terms.add_input("state", name, exact(-6.0), exact(6.0)) for name in "xy")
    size = terms.combine(((exact(2.0), terms.apply_function("abs", x)),), exact(0.1))
    pushed = terms.multiply(terms.combine(((exact(-3.0), y),)), x)
    value = terms.divide(pushed, size)
    places = [a.atom for a in (x, y)]
    step = compile_step(terms, places, 2, [value], ranges=[value], must=terms.obligations)
    draw = np.random.default_rng(19)
    for _ in range(300):
        middle, width = draw.uniform(-1, 1, 2), 10.0 ** draw.uniform(-4, 0.5)
        ends = [(float(c - width), float(c + width)) for c in middle]
        image = step(form_of_box([(exact(a), exact(b)) for a, b in ends], symbols=True))
        assert image is not None
        (_, _, centre, g0, g1, rest), (low, high) = image
        assert high - low <= 3.0 * max(map(abs, ends[1])) + 1e-9
        for _ in range(6):
            s = draw.choice([-1.0, 1.0, float(draw.uniform(-1, 1))], 2)
            a, b = (
                exact(float(c)) + exact(float(width)) * float(t)
                for c, t in zip(middle, s, strict=True)
            )
            exactly = -3 * a * b / (2 * abs(a) + exact(0.1))
            assert low - 1e-12 <= exactly <= high + 1e-12
            off = exactly - (centre + g0 * float(s[0]) + g1 * float(s[1]))
            assert abs(off) <= rest + 1e-12


def test_a_number_is_itself_however_it_was_rounded() -> None:
    terms = Terms()
    x = terms.add_input("state", "x", exact(-6.0), exact(6.0))
    once, again = (terms.rounded_term(terms.combine(((ONE, x),), exact(0.1))) for _ in range(2))
    for op in ("==", "<=", ">="):
        assert terms.compare(op, once, once) is TRUE
        assert terms.compare(op, once, again).kind != "constant"
    for op in ("!=", "<", ">"):
        assert terms.compare(op, once, once) is FALSE
        assert terms.compare(op, once, again).kind != "constant"


def test_small_cells_have_small_enclosures(program: Path) -> None:
    """Nothing is lost where nothing is undecided: a wide enclosure proves nothing."""
    for name in ("Limits", "Parts", "Waves", "Logs", "Roots"):
        terms = Terms()
        inputs, value = term_of(program, name, terms)
        places = [x.atom for x in inputs]
        step = compile_step(terms, places, 2, [value], ranges=[value])
        image = step(
            form_of_box([(exact(0.5), exact(0.501)), (exact(1.1), exact(1.101))], symbols=True)
        )
        assert image is not None
        assert image[1][1] - image[1][0] < 0.02
        assert float(image[0][5]) < 1e-5


def test_no_line_says_less_than_the_range(program: Path) -> None:
    """However wide the cell: a law that is saturated on both sides has a rest of half its range."""
    terms = Terms()
    inputs, value = term_of(program, "Saturated", terms)
    places = [x.atom for x in inputs]
    step = compile_step(terms, places, 2, [value], ranges=[value])
    draw = np.random.default_rng(3)
    for _ in range(200):
        middle, width = draw.uniform(-1, 1, 2), draw.uniform(0.1, 3)
        box = [(exact(float(c - width)), exact(float(c + width))) for c in middle]
        image = step(form_of_box(box, symbols=True))
        assert image is not None
        form, (low, high) = image
        assert -1.8 - 1e-9 < low <= high < 1.8 + 1e-9
        assert float(form[5]) <= (high - low) / 2 + 1e-9


def test_a_limit_that_varies_is_a_limit(program: Path) -> None:
    terms = Terms()
    inputs, value = term_of(program, "Between", terms)
    places = [x.atom for x in inputs]
    step = compile_step(terms, places, 2, [value], ranges=[value])
    draw = np.random.default_rng(4)
    for _ in range(200):
        (a, b), (c, d) = np.sort(draw.uniform(-4, 4, (2, 2)))
        box = [(exact(float(a)), exact(float(b))), (exact(float(c)), exact(float(d)))]
        image = step(form_of_box(box, symbols=True))
        assert image is not None
        low, high = image[1]
        assert high <= max(min(d, b - 1.1), 1.0 - a) + 1e-9
        assert low >= max(min(c, a - 1.1), 1.0 - b) - 1e-9


def test_linear_combinations_cancel(tmp_path: Path) -> None:
    path = tmp_path / "cancel.soter"
    path.write_text(
        "soter 1;\n"
        "fun Same(x: float, y: float): float { return (3.0 * x + y) - (x + y) - 2.0 * x; }\n"
    )
    terms = Terms()
    _, value = term_of(path, "Same", terms)
    assert value.is_constant
    assert float(value.radius) < 1e-13


@all_rows("name", sorted(UNIVARIATE))
def test_lines_enclose_their_functions(name: str) -> None:
    exactly = {
        "max0": lambda x: max(x, 0.0),
        "abs": abs,
        "square": lambda x: x * x,
        "floor": math.floor,
        "inverse": lambda x: 1 / x,
        "soft_sign": lambda x: x / (1 + abs(x)),
        "sqrt": lambda x: math.sqrt(max(x, 0.0)),
        "truncated": math.trunc,
        "smooth_step": lambda x: min(max(x, 0.0), 1.0) ** 2 * (3 - 2 * min(max(x, 0.0), 1.0)),
        "wrap_angle": lambda x: math.remainder(x, 2 * math.pi),
        "wrapped_double": lambda x: math.remainder(x, 2 * math.pi),
    }
    function = exactly.get(name) or getattr(math, name)
    draw = np.random.default_rng(7)
    for _ in range(400):
        low = float(draw.uniform(-3, 3))
        high = low + float(10.0 ** draw.uniform(-6, 0.6))
        if name in ("inverse", "log") and low <= 0.0:
            low, high = 0.01 - low, 0.01 - low + (high - low)
        if name in ("asin", "acos"):
            low, high = math.sin(low), math.sin(high)
            low, high = min(low, high), max(low, high)
        slope, offset, spread, least, most = UNIVARIATE[name](exact(low), exact(high))
        for x in (low, high, float(draw.uniform(low, high)), min(max(0.0, low), high)):
            if name == "sqrt" and x < 0.0:
                continue
            y = exact(float(function(x)))
            near = arb(0, 1e-14 * (1 + abs(float(y))))
            assert not abs(y - slope * exact(x) - offset + near) > spread
            assert not y + near < least
            assert not y + near > most


def test_the_line_under_noise_encloses() -> None:
    draw = np.random.default_rng(11)
    for _ in range(500):
        low = float(draw.uniform(-2, 2))
        high = low + float(draw.uniform(0, 2))
        noise = float(10.0 ** draw.uniform(-3, 0.3))
        slope, kept, offset, spread = line_noisy_max0(*map(exact, (low, high, noise)))
        for x in (low, high, float(draw.uniform(low, high)), min(max(noise, low), high)):
            for n in (-noise, noise, float(draw.uniform(-noise, noise))):
                off = exact(max(x + n, 0.0)) - slope * exact(x) - kept * exact(n) - offset
                assert not abs(off) > spread + 1e-14


def test_the_better_of_line_and_range_encloses() -> None:
    draw = np.random.default_rng(13)
    chosen = set()
    for _ in range(500):
        slope, offset, x = (float(v) for v in draw.uniform(-2, 2, 3))
        spread = float(draw.uniform(0, 2))
        value = slope * x + offset + spread * float(draw.choice([-1.0, 0.3, 1.0]))
        low, high = value - float(draw.uniform(0, 2)), value + float(draw.uniform(0, 2))
        weight, middle, rest = line_or_range(*(exact(v) for v in (offset, spread, low, high)))
        chosen.add(float(weight))
        off = exact(value) - weight * exact(slope) * exact(x) - middle
        assert not abs(off) > rest + 1e-14
        assert rest <= exact(spread).min(exact((high - low) / 2) + 1e-14)
    assert chosen == {0.0, 1.0}


# ---------------------------------------------------------------- flows


def numeric(
    a: np.ndarray, b: np.ndarray, time: float, steps: int = 4000
) -> tuple[np.ndarray, np.ndarray]:
    """e^{At}, and the integral of |e^{As} b|, by small steps."""
    n = len(a)
    h = time / steps
    one = np.eye(n) + h * a + h * h / 2 * a @ a + h**3 / 6 * a @ a @ a
    e, total = np.eye(n), np.zeros(n)
    for _ in range(steps):
        total += np.abs(e @ b + 0.5 * h * a @ e @ b) * abs(h)
        e = e @ one
    return e, total


def test_motions_enclose_solutions() -> None:
    draw = np.random.default_rng(5)
    for _ in range(10):
        a, b = draw.uniform(-8, 8, (3, 3)), draw.uniform(-2, 2, 3)
        flow = LinearFlow(
            (0, 1, 2),
            [[exact(float(x)) for x in row] for row in a],
            [[], [], []],
            [ZERO] * 3,
            [[exact(float(x))] for x in b],
            (),
        )
        for time in (Fraction(1, 50), Fraction(-1, 50), Fraction(1, 10)):
            e, total = numeric(a, b, float(time))
            first, last = min(time, Fraction(0)), max(time, Fraction(0))
            motion, wide = flow.solution(time, time), flow.solution(first, last)
            added = flow.noise_bounds(flow.noise, first, last)
            for i in range(3):
                for j in range(3):
                    assert abs(float(motion.state[i][j]) - e[i, j]) < 1e-6
                    assert not exact(float(e[i, j])) > wide.state[i][j].upper() + 1e-6
                    assert not exact(float(e[i, j])) < wide.state[i][j].lower() - 1e-6
                assert total[i] * (1 - 1e-4) <= float(added[i]) <= total[i] * 1.3 + 1e-9


def test_structure_stays_exact() -> None:
    """What is 0 or 1 by structure is no ball, so that sets may end at the edge of a cell."""
    a = [[ZERO, exact(1.0)], [ZERO, ZERO]]
    e = exponential(a, Fraction(0), Fraction(1, 10))
    assert e[0][0] == 1
    assert e[1][0].is_zero()
    assert e[1][1] == 1
    assert e[0][1].contains(arb(0.05))


@pytest.mark.parametrize("name", ["add", "sub", "mul"])
def test_what_is_folded_is_what_is_computed(name: str) -> None:
    """Zeros and ones that are known need no operation; the same of a program in a program."""
    numbers = [exact(x) for x in (0.0, 1.0, -1.0, 2.5)]
    for known in numbers:
        make = Builder()
        x = make.input_at(0)
        both = [make.apply(name, known, x), make.apply(name, x, known)]
        function = Function(make, 1, both)
        other = Builder()
        again = Function(other, 1, function((other.input_at(0),)))
        for y in (exact(-3.0), exact(0.125)):
            expected = (OPERATIONS[name](known, y), OPERATIONS[name](y, known))
            assert function((y,)) == expected
            assert again((y,)) == expected
