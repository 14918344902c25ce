"""What is settled while emitting holds the exact result and the rounded one."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from generators.enclosing import seeded
from soter.codegen.enclosure_values import Span, compared, span_binary, span_unary

COUNT = 400
NUMBERS = (0.0, 1.0, -1.0, 0.1, 3.0, 1e-320, 5e-324, 1e300, -1e308, 1.0 / 3.0)


def spans(key: str) -> list[Span]:
    """Single numbers and ranges."""
    rng = seeded(key)
    found = []
    for _ in range(COUNT):
        x = rng.choice(NUMBERS) if rng.random() < 0.4 else rng.uniform(-4, 4)
        width = rng.choice((0.0, 0.0, 0.5))
        found.append(Span(x, x + width))
    return found


def ends(s: Span) -> tuple[Fraction, Fraction]:
    """Both ends, exactly."""
    return Fraction(s.low), Fraction(s.high)


@pytest.mark.parametrize("op", ["+", "-", "*", "/"])
def test_operations_on_constants_round_outward(op: str) -> None:
    settled = 0
    for a, b in zip(spans("left" + op), spans("right" + op), strict=True):
        got = span_binary(op, a, b)
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
        got = span_unary("sqrt", a)
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
            got = compared(op, (a.low, a.high), (b.low, b.high))
            seen = set()
            for x in (a.low, a.high, 0.5 * a.low + 0.5 * a.high):
                for y in (b.low, b.high, 0.5 * b.low + 0.5 * b.high):
                    seen.add(
                        {
                            "<": x < y, "<=": x <= y, ">": x > y, ">=": x >= y, "==": x == y,
                            "!=": x != y,
                        }[op]
                    )  # fmt: skip
            decided += got is not None
            assert got is None or seen == {got}, (op, a, b)
    assert decided > COUNT
