"""Each function of the prelude lies in its enclosure: exact, off by its bound, as computed."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import pytest
from flint import arb

import soter
from soter.certificate.extras.prelude_functions import FUNCTIONS, PRELUDE, prelude_function
from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.terms import linear_enclosures
from soter.certificate.terms.compile_terms import compile_step, form_of_box
from soter.certificate.terms.linear_enclosures import exact, line_function
from soter.certificate.terms.terms import Terms
from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Range = tuple[float, float]


def smooth_step(low: arb, high: arb, x: arb) -> arb:
    t = ((x - low) / (high - low)).max(arb(0)).min(arb(1))
    return t * t * (3 - 2 * t)


def wrapped(x: arb) -> arb:
    return x - 2 * arb.pi() * (x / (2 * arb.pi()) + arb(0.5)).floor()


@dataclass(frozen=True)
class Function:
    """What a function means, the ranges of its arguments, and which kind of term it is."""

    of: Callable[..., arb]
    ranges: tuple[Range, ...]
    kind: str = ""


ANY = (-6.0, 6.0)
MEANT: dict[str, Function] = {
    "sin": Function(arb.sin, ((-9.0, 9.0),)),
    "cos": Function(arb.cos, ((-9.0, 9.0),)),
    "tan": Function(arb.tan, ((-1.5, 1.5),)),
    "asin": Function(arb.asin, ((-1.0, 1.0),)),
    "acos": Function(arb.acos, ((-1.0, 1.0),)),
    "atan": Function(arb.atan, (ANY,)),
    "tanh": Function(arb.tanh, (ANY,)),
    "exp": Function(arb.exp, (ANY,)),
    "log": Function(arb.log, ((0.015625, 9.0),)),
    "wrap_angle": Function(wrapped, ((-20.0, 20.0),), "wrapped_double"),
    "atan2": Function(arb.atan2, (ANY, ANY)),
    "hypot": Function(lambda x, y: (x * x + y * y).sqrt(), (ANY, ANY), "sqrt"),
    "pow": Function(arb.__pow__, ((0.0, 3.0), (-2.5, 2.5))),
    "smoothstep": Function(smooth_step, ((-1.0, 0.5), (0.75, 3.0), ANY), "smooth_step"),
}
BOXES = 24
EDGES = (0.0, 1.0, -1.0, 0.5, math.pi, -math.pi, math.pi / 2, 3.0, -3.0, 0.75)


def boxes(of: Function, draw: np.random.Generator) -> Iterator[list[Range]]:
    """Boxes of all sizes, of which many begin, end or lie at an edge."""
    for _ in range(BOXES):
        box = []
        for low, high in of.ranges:
            at = float(draw.choice([*EDGES, *draw.uniform(low, high, 8)]))
            width = float(draw.choice([0.0, *(10.0 ** draw.uniform(-15, 0.5, 4))]))
            first = min(max(at - width * float(draw.choice([0.0, 0.5, 1.0])), low), high)
            box.append((first, min(first + width, high)))
        yield box


def may_be(name: str, numbers: tuple[float, ...], value: arb) -> Iterator[arb]:
    """What may be computed: `value`, and what is off it by the tested bound."""
    bound = BOUNDS[name]
    if name == "wrap_angle" and abs(numbers[0]) <= math.pi:
        yield exact(math.pi if numbers[0] <= -math.pi else numbers[0])
        return
    error = exact(bound.ulps * math.ulp(float(value)) + bound.absolute)
    for x in (value, value + error, value - error):
        if name != "wrap_angle" or abs(x) < math.pi:
            yield x.max(exact(bound.values[0])).min(exact(bound.values[1]))


def points(box: list[Range], draw: np.random.Generator) -> Iterator[tuple[float, ...]]:
    """The corners of a box, and numbers inside."""
    yield from itertools.product(*box)
    for _ in range(3):
        yield tuple(float(draw.uniform(a, b)) for a, b in box)


def escapes(name: str, *, rounded: bool, computed: Callable[..., float]) -> list[Any]:
    """Points at which a value is not in the range, or not about the line; how many were known."""
    of, draw, made = MEANT[name], np.random.default_rng(len(name)), Terms()
    inputs = [made.add_input("state", "x", exact(a), exact(b)) for a, b in of.ranges]
    value = prelude_function(Operations(made, rounded=rounded), name, *inputs)
    n, places = len(inputs), [x.atom for x in inputs]
    must = [*made.obligations, *value.rests]
    step = compile_step(made, places, n, [value], ranges=[value], must=must)
    found, known = [], 0
    for box in boxes(of, draw):
        whole = [(exact(a), exact(b)) for a, b in box]
        image = step(form_of_box(whole, symbols=True))
        if image is None:
            continue
        (_, _, centre, *rows), (low, high) = image
        known += 1
        for numbers in points(box, draw):
            with flint.ctx.workprec(300):
                meant = of.of(*map(exact, numbers))
            values = [meant]
            if rounded:
                values = [*may_be(name, numbers, meant), exact(computed(*numbers))]
            for v in values:
                line = centre
                for x, g, (a, b) in zip(numbers, rows, whole, strict=False):
                    line += g * (exact(x) - (a + b) / 2) / ((b - a) / 2) if a < b else 0
                if v > high or v < low or abs(v - line) > rows[n]:
                    found.append((numbers, v))
    assert known > BOXES / 2
    return found


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The functions as programs call them, on the interpreter."""
    text = "soter 1;\n"
    for name, of in MEANT.items():
        given = ", ".join("abc"[: len(of.ranges)])
        parameters = ", ".join(f"{x}: float" for x in "abc"[: len(of.ranges)])
        text += f"fun of_{name}({parameters}): float {{ return {name}({given}); }}\n"
    path: Path = tmp_path_factory.mktemp("prelude") / "functions.soter"
    path.write_text(text)
    return soter.load(path)


def test_every_function_that_is_read_as_what_it_means_is_asked_here() -> None:
    assert MEANT.keys() == PRELUDE


@pytest.mark.parametrize("name", sorted(MEANT))
@pytest.mark.parametrize("rounded", [True, False])
def test_a_function_does_not_leave_its_enclosure(program: Any, name: str, rounded: bool) -> None:
    assert escapes(name, rounded=rounded, computed=program.function(f"of_{name}")) == []


@pytest.mark.parametrize("name", sorted(MEANT))
@pytest.mark.parametrize("part", ["spread", "range"])
def test_an_enclosure_that_is_too_narrow_by_a_billionth_of_a_thousandth_is_left(
    program: Any, name: str, part: str
) -> None:
    """So the test above is able to fail: for its line, and for its range."""
    kind = MEANT[name].kind or name
    core = linear_enclosures.FUNCTIONS
    whole = line_function(kind)

    def narrow(*box: arb) -> tuple[arb, ...]:
        *slopes, spread, least, most = whole(*box)
        less = exact(1e-12)
        if part == "spread":
            return *slopes, spread - less, least, most
        return *slopes, spread, least + less, most - less

    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(core if kind in core else FUNCTIONS, kind, narrow)
        assert escapes(name, rounded=True, computed=program.function(f"of_{name}"))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_a_whole_power_is_one_of_negative_numbers_too(n: int) -> None:
    made = Terms()
    x = made.add_input("state", "x", exact(-2.0), exact(2.0))
    value = prelude_function(Operations(made, rounded=True), "pow", x, float(n))
    assert (made.obligations, value.rests) == ([], ())
    step: Any = compile_step(made, [0], 1, [value], ranges=[value])
    for low, high in ((-2.0, 2.0), (-1.5, -0.5), (-0.25, 0.5), (0.0, 1.0), (-1.0, 0.0)):
        _, (least, most) = step(form_of_box([(exact(low), exact(high))], symbols=True))
        values = [v**n for v in (low, high, 0.0) if low <= v <= high]
        assert least <= min(values)
        assert max(values) <= most
        assert most - least < max(values) - min(values) + 1e-12
    assert prelude_function(Operations(made, rounded=True), "pow", x, n + 0.5).rests


def test_a_power_of_zero_is_known_for_exponents_above_it_alone() -> None:
    for exponents, known in (((0.5, 2.0), True), ((-0.5, 2.0), False), ((-2.0, -1.0), False)):
        *_, least, most = FUNCTIONS["pow"](*map(exact, (0.0, 2.0, *exponents)))
        assert bool(least.is_finite() and most.is_finite()) is known


def test_an_angle_beside_the_origin_is_any() -> None:
    for box in ((-1.0, 1.0, -1.0, 1.0), (0.0, 1.0, -1.0, 1.0), (-0.5, 0.5, -2.0, -1.0)):
        *_, least, most = FUNCTIONS["atan2"](*map(exact, box))
        assert least <= -math.pi
        assert most >= math.pi
    *_, least, most = FUNCTIONS["atan2"](*map(exact, (0.25, 1.0, -1.0, 1.0)))
    assert (float(least), float(most)) == pytest.approx(
        (math.atan2(0.25, 1.0), math.atan2(0.25, -1.0))
    )
