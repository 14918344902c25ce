"""Programs that C runs give what NumPy gives, bit for bit; what cannot be recorded is not run."""

from __future__ import annotations

from contextlib import nullcontext, suppress
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from flint import arb

from soter.certificate.batches import array_lines, array_programs, recorded_arrays
from soter.certificate.batches.array_programs import (
    LIBRARY,
    ArrayFunction,
    _rows,
    record,
    same,
)
from soter.certificate.batches.ball_arrays import (
    FAR,
    BallArray,
    chosen,
    larger,
    no_underflow,
    smaller,
)
from soter.certificate.terms import python_source
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.python_source import WrittenFunction
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from collections.abc import Callable

    Form = tuple[BallArray, ...]

WIDTHS = (2, 3, 63, 64, 65, 200)
BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: x - y,
    "product": lambda x, y: x * y,
    "max": lambda x, y: x.max(y),
    "min": lambda x, y: x.min(y),
    "union": lambda x, y: x.union(y),
    "quotient": lambda x, y: x * y.inverse(),
    "root of size": lambda x, _: abs(x).sqrt(),
    "chosen": lambda x, y: chosen(x < y, x, -y),
    "chosen by <=": lambda x, y: chosen((x <= y) | (x > 1), y, x),
    "chosen by neither": lambda x, y: chosen(~(x >= y) & (y.centre != 1.0), x * y, x.mid()),
    "larger": larger,
    "smaller": smaller,
    "a third": lambda x, y: x * BallArray.of(exact(1.0) / 3) - y,
    "max of 0": lambda x, y: array_lines.line_max0(x.min(y), x.max(y))[1],
    "size": lambda x, y: array_lines.line_abs(x.min(y), x.max(y))[2],
    "floor": lambda x, y: array_lines.line_floor(x.min(y), x.max(y))[3],
    "line of a root": lambda x, y: array_lines.line_sqrt(x.min(y), x.max(y))[2],
    "line of an inverse": lambda x, y: array_lines.line_inverse(x.min(y), x.max(y))[2],
    "square": lambda x, y: array_lines.line_square(x.min(y), x.max(y))[1],
    "noisy": lambda x, y: array_lines.line_noisy_max0(x.min(y), x.max(y), abs(x))[2],
}
pytestmark = pytest.mark.skipif(LIBRARY.function() is None, reason="there is no C compiler")


def balls(draw: np.random.Generator, count: int) -> BallArray:
    """Of all sizes; some exact, some of which nothing is known, some not even numbers."""
    centre = draw.choice([1.0, 1e-9, 1e9, 0.0, -1.0, 1e200], count) * draw.uniform(-2, 2, count)
    radius = np.abs(centre) * draw.choice([0.0, 1e-16, 0.3, 2.0], count)
    radius[draw.random(count) < 0.02] = np.inf
    centre[draw.random(count) < 0.02] = np.nan
    return BallArray(centre, radius)


def random_function(draw: np.random.Generator) -> Callable[[Form], Any]:
    """Some operations one after the other, and all that they give."""
    names = draw.choice(sorted(BINARY), 8)
    places = [draw.integers(0, 3 + k, 2) for k in range(len(names))]

    def function(form: Form) -> Any:
        values = [*form, BallArray.of(0.75)]
        for name, (a, b) in zip(names, places, strict=True):
            values.append(BINARY[name](values[a], values[b]))
        sure = (values[-1] <= values[-2]) & (values[0] < 2)
        return (tuple(values), [values[-1].lower(), values[-1].upper()]), sure

    return function


def test_programs_give_what_numpy_gives() -> None:
    ran = 0
    for seed in range(150):
        draw = np.random.default_rng(seed)
        function = random_function(draw)
        program = record(function, 2)
        assert program is not None
        for count in WIDTHS:
            form = (balls(draw, count), balls(draw, count))
            with np.errstate(all="ignore"):
                expected = function(form)
            with suppress(FloatingPointError):
                assert same(program.run(_rows(form, count), count), expected), seed
                ran += 1
    assert ran > 300


@pytest.mark.parametrize("name", sorted(BINARY))
@pytest.mark.parametrize("constant", [None, 0, 1])
def test_each_operation_with_constants(name: str, constant: int | None) -> None:
    draw = np.random.default_rng(len(name))

    def function(form: Form) -> Any:
        x, y = form if constant is None else (form[0], BallArray.of(-0.75))
        return BINARY[name](*((y, x) if constant else (x, y)))

    program = record(function, 2)
    assert program is not None
    form = (balls(draw, 300), balls(draw, 300))
    with no_underflow():
        expected = function(form)
    assert same(program.run(_rows(form, 300), 300), expected)


def test_forms_with_constants_and_exact_numbers() -> None:
    """What is the same for all boxes, and has no radius, is one number for each box in C."""
    form = (BallArray(np.linspace(-1.0, 1.0, 70)), BallArray(np.array([0.25])))

    def both(f: Form) -> Any:
        return f[0] * f[1], f[0] + f[1]

    function = ArrayFunction(both, lambda: both)
    results = [function(form) for _ in range(4)]
    assert function._program is not None
    assert all(same(r, results[0]) for r in results)


def test_bits_are_those_of_arrays() -> None:
    """`and`, `or`, `not` as they are written, on all pairs of what may be known."""
    yes = BallArray(np.array([1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, -1.0, 0.0]), np.full(9, 0.5))
    no = BallArray(np.repeat([1.0, -1.0, 0.0], 3), np.full(9, 0.5))

    def function(names: dict[str, Any]) -> Callable[[Form], Any]:
        bits, negation, by_truth = names["bits"], names["NOT"], names["by_truth"]

        def written(form: Form) -> Any:
            a, b = (bits(x > 0, x <= 0) for x in form)
            both = ((a | b) & 1) | (a & b & 2)
            either = ((a | b) & 2) | (a & b & 1)
            value = by_truth(both, form[0], form[1], BallArray.of(0.5))
            return (a, negation[b], both, either, 2 | (a & 1), value), (both == 2) & (either == 3)

        return written

    plain, recorded = ({**array_lines.NAMES, **x} for x in ({}, recorded_arrays.RECORDED))
    program = record(function(recorded), 2)
    assert program is not None
    result = program.run(_rows((yes, no), 9), 9)
    assert same(result, function(plain)((yes, no)))
    assert {int(x) for x in result[0][0]} == {1, 2, 3}


ASKS: dict[str, Callable[[Form], Any]] = {
    "a branch": lambda f: f[0] if (f[0] > 0).all() else -f[0],
    "a truth": lambda f: f[0] if f[0] > 0 else -f[0],
    "an index": lambda f: np.array([1.0, 2.0])[f[0].centre],
    "different values": lambda f: np.unique(f[0].centre),
    "another type": lambda f: f[0].centre.astype(np.int64),
    "truths as numbers": lambda f: f[0].centre + (f[0].centre > 0),
    "numbers as truths": lambda f: f[0].centre & 1,  # type: ignore[operator]
    "a sum over boxes": lambda f: f[0].centre.sum(),
    "a table": lambda f: f[0].centre * np.array([1.0, 2.0]),
    "a NaN": lambda f: f[0].centre * np.nan,
    "another function": lambda f: np.sin(f[0].centre),
    "others into it": lambda f: np.add(f[0].centre, 1.0, where=np.array([True, False])),
}


@pytest.mark.parametrize("why", sorted(ASKS))
def test_what_depends_on_values_is_not_recorded(why: str) -> None:
    assert record(ASKS[why], 1) is None


@pytest.mark.parametrize("place", [3, 150, 299])
@pytest.mark.parametrize(("size", "fails"), [(1e-140, False), (1e-170, True)])
def test_an_underflow_is_one_in_c_too(size: float, place: int, *, fails: bool) -> None:
    """Wherever it is among the boxes."""
    program = record(lambda f: f[0] * f[0], 1)
    assert program is not None
    centre = np.ones(300)
    centre[place] = size
    rows = _rows((BallArray(centre),), 300)
    with pytest.raises(FloatingPointError) if fails else nullcontext():
        program.run(rows, 300)


def test_rows_that_are_strided_are_copied() -> None:
    both = np.arange(600.0)
    form = (BallArray(both[::2], both[1::2] * 1e-9), BallArray(both[::-2]))
    program = record(lambda f: f[0] * f[1], 2)
    assert program is not None
    assert same(program.run(_rows(form, 300), 300), form[0] * form[1])


def test_what_is_demanded_has_to_be_certain_of_each_box() -> None:
    """`if v1 != 2: return None`, of arrays: boxes around 1 may be above it."""
    lines = [
        "(l0, h0,) = form",
        "v1 = bits(h0 <= K1, l0 > K1)",
        "if v1 != 2: return None",
        "return ((l0,), ())",
    ]
    written = WrittenFunction(lines, {"K1": exact(1.0), "bits": None})
    centre = np.linspace(0.0, 2.0, 200)
    form = (BallArray(centre), BallArray(centre + 0.02))
    for _ in range(3):  # NumPy, then C
        _, sure = written.of_many(form)
        assert np.array_equal(sure, centre + 0.02 <= 1.0)
    assert written.of_many._program is not None


def test_a_far_inverse_is_recorded_with_both_ways() -> None:
    program = record(lambda f: f[0].inverse(), 1)
    assert program is not None
    form = (BallArray(np.array([2.0, 4 * FAR, -4 * FAR, 0.0, 1e-9]), np.zeros(5)),)
    with no_underflow():
        assert same(program.run(_rows(form, 5), 5), form[0].inverse())


def test_a_program_that_gives_anything_else_is_not_run() -> None:
    """As if C, or what was recorded, had a fault."""
    function = ArrayFunction(lambda f: f[0] + 1, lambda: lambda f: f[0] + 2)
    form = (BallArray(np.arange(70.0)),)
    for _ in range(4):
        assert same(function(form), form[0] + 1)
    assert function._program is None


def test_without_a_compiler_numpy_does_all(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> None:
        raise SoterError(())

    monkeypatch.setattr(array_programs, "find", none)
    monkeypatch.setattr(array_programs, "LIBRARY", array_programs._Library())
    function = ArrayFunction(lambda f: f[0] + 1, lambda: pytest.fail("asked"))
    form = (BallArray(np.arange(70.0)),)
    for _ in range(4):
        assert same(function(form), form[0] + 1)


def test_functions_are_shared_by_what_they_are_made_of() -> None:
    lines = ["(l0, h0) = form", "v1 = K1*l0 + K2", "return ((v1,), ())"]
    one, other, third = (
        WrittenFunction(lines, {"K1": exact(a), "K2": b})
        for a, b in ((2.0, exact(1.0)), (2.0, exact(1.0)), (3.0, exact(1.0)))
    )
    assert one.of_many is other.of_many
    assert one.of_many is not third.of_many
    unknown = [WrittenFunction(lines, {"K1": exact(2.0), "K2": x}) for x in (arb("inf"),) * 2]
    assert unknown[0].of_many is not unknown[1].of_many
    kinds = (1, 1.0, True, 0.0, -0.0)
    assert len({python_source.content_of(x) for x in kinds}) == len(kinds)


@pytest.mark.parametrize(("a", "b"), [*product((1.0, np.nan, np.inf), repeat=2)])
def test_same_tells_numbers_apart(a: float, b: float) -> None:
    one, other = (BallArray(np.array([0.0, x]), np.zeros(2)) for x in (a, b))
    assert same(((one,), [one.centre]), ((other,), [other.centre])) == (a is b)
    assert not same((one, one), (one,))
    assert same(BallArray(np.ones(2)), BallArray(np.ones(2), np.zeros(2)))
    assert not same(BallArray(np.ones(2)), BallArray(np.ones(2), np.array([0.0, 1e-300])))
