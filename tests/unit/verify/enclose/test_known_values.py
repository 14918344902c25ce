"""What is settled while emitting holds the exact result and the rounded one."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from generators.python_enclosures import seeded
from soter.codegen import c_tree as c
from soter.verify.enclose.enclosed_operations import EnclosureOperations
from soter.verify.enclose.enclosure_emitter import (
    Emitter,
    FloatRange,
    Form,
    Op,
    comparison_of_ranges,
    range_of_binary,
    range_of_unary,
)

COUNT = 400
NUMBERS = (0.0, 1.0, -1.0, 0.1, 3.0, 1e-320, 5e-324, 1e300, -1e308, 1.0 / 3.0)


def spans(key: str) -> list[FloatRange]:
    """Single numbers and ranges."""
    rng = seeded(key)
    samples = []
    for _ in range(COUNT):
        x = rng.choice(NUMBERS) if rng.random() < 0.4 else rng.uniform(-4, 4)
        width = rng.choice((0.0, 0.0, 0.5))
        samples.append(FloatRange(x, x + width))
    return samples


def ends(s: FloatRange) -> tuple[Fraction, Fraction]:
    """Both ends, exactly."""
    return Fraction(s.low), Fraction(s.high)


def inside(s: FloatRange) -> tuple[float, float, float]:
    """Ends and middle."""
    return s.low, s.high, min(max(0.5 * s.low + 0.5 * s.high, s.low), s.high)


@pytest.mark.parametrize("op", ["+", "-", "*", "/"])
def test_operations_on_constants_round_outward(op: str) -> None:
    settled = 0
    for a, b in zip(spans("left" + op), spans("right" + op), strict=True):
        got = range_of_binary(op, a, b)
        if got is None:
            continue
        settled += 1
        for x in ends(a):
            for y in ends(b):
                exact = {"+": x + y, "-": x - y, "*": x * y, "/": x / y if y else Fraction(0)}[op]
                assert Fraction(got.low) <= exact <= Fraction(got.high), (op, a, b)
                assert got.low <= float(exact) <= got.high, (op, a, b)
    assert settled > COUNT / 2


def test_roots_of_constants_round_outward() -> None:
    for a in spans("roots"):
        got = range_of_unary("sqrt", a)
        if a.low < 0.0:
            assert got is None
            continue
        assert got is not None
        assert Fraction(got.low) ** 2 <= Fraction(a.low), a
        assert Fraction(a.high) <= Fraction(got.high) ** 2, a
        assert got.low <= math.sqrt(a.low) <= math.sqrt(a.high) <= got.high


def test_comparisons_of_constants_decide_only_what_is_certain() -> None:
    decided = 0
    for a, b in zip(spans("one"), spans("other"), strict=True):
        for op in ("<", "<=", ">", ">=", "==", "!="):
            got = comparison_of_ranges(op, (a.low, a.high), (b.low, b.high))
            seen = set()
            for x in inside(a):
                for y in inside(b):
                    seen.add(
                        {
                            "<": x < y, "<=": x <= y, ">": x > y, ">=": x >= y, "==": x == y,
                            "!=": x != y,
                        }[op]
                    )  # fmt: skip
            decided += got is not None
            assert got is None or seen == {got}, (op, a, b)
    assert decided > COUNT


def test_a_constant_that_is_a_range_stays_one() -> None:
    """`x - [1, 3]` is `x + [-3, -1]`; a maximum with a range is no maximum with its end."""
    emitter = Emitter()
    ops = EnclosureOperations(emitter)
    x = Form(c.Name("x"))
    ops.binary("-", x, FloatRange(1.0, 3.0))
    ops.min_or_max("max", x, FloatRange(1.0, 3.0))
    shift, most = emitter.block
    assert isinstance(shift, Op)
    assert isinstance(most, Op)
    assert shift.function == "soter_n_shift"
    numbers = [float.fromhex(a.text) for a in shift.arguments if isinstance(a, c.Number)]
    assert numbers == [-3.0, -1.0]
    assert most.function == "soter_n_max"
