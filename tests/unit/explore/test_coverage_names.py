"""What was not reached has the name that a person would give it."""

from __future__ import annotations

import math

import pytest

from soter.explore.coverage import (
    Coverage,
    Leaf,
    Part,
    branches_part,
    classes_of,
    modules_parts,
    values_part,
)
from soter.program.types import BOOL, FLOAT, EnumType, IntType

COLOUR = EnumType("Colour", ("RED", "GREEN"))


@pytest.mark.parametrize(
    ("leaf", "names"),
    [
        (Leaf("t", BOOL, -math.inf, math.inf), ["t = false", "t = true"]),
        (Leaf("t.c", COLOUR, -math.inf, math.inf), ["t.c = RED", "t.c = GREEN"]),
        (Leaf("t", IntType(-1, 1), -1, 1), ["t = -1", "t = 0", "t = 1"]),
        (
            Leaf("t", IntType(-100, 100), -100, 100),
            ["t = -100", "t = 100", "t negative", "t zero", "t positive"],
        ),
        (Leaf("t", IntType(0, 200), 0, 200), ["t = 0", "t = 200", "t positive"]),
        (Leaf("t", FLOAT, -math.inf, math.inf), ["t negative", "t zero", "t positive"]),
        (Leaf("t", FLOAT, 0.5, 2.0), ["t = 0.5", "t = 2", "t positive"]),
        (Leaf("t", FLOAT, -2.0, 0.0), ["t = -2", "t = 0", "t negative"]),
        (Leaf("t", FLOAT, 1.0, 1.0), ["t = 1"]),
    ],
)
def test_classes_of_values(leaf: Leaf, names: list[str]) -> None:
    assert [name for _, name in classes_of(leaf)] == names


def test_small_sets_are_numbered_from_their_least_value() -> None:
    row = [0] * 256
    row[8] = row[10] = 1
    part = values_part([Leaf("t", IntType(-1, 1), -1, 1)], [row])
    assert (part.reached, part.total, part.unreached) == (2, 3, ("t = 0",))


def test_a_forced_module_has_one_mode_and_no_switches() -> None:
    modes, switches = modules_parts([("A", None), ("B", "ac")], [[1, 0], [0, 1]], [[0, 0], [0, 0]])
    assert modes == Part(3, ("A in AC",))
    assert switches == Part(2, ("A to SC", "A to AC"))


def test_branches_are_bits_of_words_of_64() -> None:
    names = [f"branch {i}" for i in range(70)]
    bits = [2**64 - 1 - 2, 0b100001]
    assert branches_part(names, bits).unreached == (
        "branch 1",
        *[f"branch {i}" for i in range(65, 69)],
    )


def test_two_searches_reach_together_what_either_reached() -> None:
    assert Part(3, ("a", "b")).merged(Part(3, ("b", "c"))) == Part(3, ("b",))
    coverage = Coverage(modes=Part(2, ("M in AC",)), values=Part(1, ("t = 1",)))
    assert coverage.unreached == ("M in AC", "t = 1")
