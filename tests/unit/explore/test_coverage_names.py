"""What was not reached has the name that a person would give it."""

from __future__ import annotations

import math

import pytest

from soter.explore.command import TraceHeader, explore_test
from soter.explore.engine.coverage import (
    Coverage,
    CoverageKind,
    CoveredLeaf,
    branches_coverage,
    leaf_classes,
    leaf_value,
    modules_coverage,
    value_class,
    values_coverage,
)
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from soter.language.model.types import (
    BOOL,
    FLOAT,
    ArrayType,
    EnumType,
    IntType,
    ListType,
    RecordType,
    Type,
    leaves,
)
from tables import all_rows

COLOUR = EnumType("Colour", ("RED", "GREEN"))


@all_rows(
    ("leaf", "names"),
    [
        (CoveredLeaf("t", BOOL, -math.inf, math.inf), ["t = false", "t = true"]),
        (CoveredLeaf("t.c", COLOUR, -math.inf, math.inf), ["t.c = RED", "t.c = GREEN"]),
        (CoveredLeaf("t", IntType(-1, 1), -1, 1), ["t = -1", "t = 0", "t = 1"]),
        (
            CoveredLeaf("t", IntType(-100, 100), -100, 100),
            ["t = -100", "t = 100", "t in [-99, -1]", "t = 0", "t in [1, 99]"],
        ),
        (CoveredLeaf("t", IntType(0, 200), 0, 200), ["t = 0", "t = 200", "t in [1, 199]"]),
        (CoveredLeaf("t", FLOAT, -math.inf, math.inf), ["t < 0", "t = 0", "t > 0"]),
        (CoveredLeaf("t", FLOAT, 0.0, 3.0), ["t = 0", "t = 3", "t in (0, 3)"]),
        (
            CoveredLeaf("t", FLOAT, -3.5, 3.0),
            ["t = -3.5", "t = 3", "t in (-3.5, 0)", "t = 0", "t in (0, 3)"],
        ),
        (CoveredLeaf("t", FLOAT, -math.inf, 3.0), ["t = 3", "t < 0", "t = 0", "t in (0, 3)"]),
        (CoveredLeaf("t", FLOAT, -math.inf, -3.0), ["t = -3", "t < -3"]),
        (
            CoveredLeaf("t", IntType(-1, 100), -1, 100),
            ["t = -1", "t = 100", "t = 0", "t in [1, 99]"],
        ),
        (
            CoveredLeaf("t", IntType(-100, 1), -100, 1),
            ["t = -100", "t = 1", "t in [-99, -1]", "t = 0"],
        ),
        (CoveredLeaf("t", FLOAT, 0.5, 2.0), ["t = 0.5", "t = 2", "t in (0.5, 2)"]),
        (CoveredLeaf("t", FLOAT, -2.0, 0.0), ["t = -2", "t = 0", "t in (-2, 0)"]),
        (CoveredLeaf("t", FLOAT, 1.0, 1.0), ["t = 1"]),
    ],
)
def test_classes_of_values(leaf: CoveredLeaf, names: list[str]) -> None:
    assert [name for _, name in leaf_classes(leaf)] == names


@pytest.mark.parametrize(
    ("t", "low", "high"),
    [
        (FLOAT, -3.5, 3.0),
        (FLOAT, 0.0, 2.0),
        (FLOAT, -math.inf, math.inf),
        (FLOAT, -math.inf, 0.0),
        (IntType(-1, 100), -1, 100),
        (IntType(-100, 100), -100, 100),
        (IntType(-2, 3), -2, 3),
        (BOOL, -math.inf, math.inf),
        (COLOUR, -math.inf, math.inf),
    ],
)
def test_every_value_has_a_class_that_is_counted_and_none_is_empty(
    t: Type, low: float, high: float
) -> None:
    leaf = CoveredLeaf("t", t, low, high)
    inside = [max(low, -5.0), min(high, 5.0), 0.0, low / 2, high / 2, -1.0, 1.0, low, high]
    values = [v for v in inside if low <= v <= high and math.isfinite(v)]
    if t in (BOOL, COLOUR):
        values = [0, 1]
    if isinstance(t, IntType):
        values = list(range(int(low), int(high) + 1))
    assert {value_class(leaf, v) for v in values} == {number for number, _ in leaf_classes(leaf)}


def test_the_scalar_at_a_path() -> None:
    t = RecordType((("a", FLOAT), ("b", ArrayType(FLOAT, 2)), ("c", ListType(FLOAT, 2))))
    value = (1.0, (2.0, 3.0), (4.0,))
    values = [leaf_value(t, value, path) for path, _ in leaves(t)]
    assert values == [1.0, 2.0, 3.0, None]


def test_small_sets_are_numbered_from_their_least_value() -> None:
    row = [0] * 256
    row[8] = row[10] = 1
    part = values_coverage([CoveredLeaf("t", IntType(-1, 1), -1, 1)], [row])
    assert (part.reached, part.total, part.unreached) == (2, 3, ("t = 0",))


def test_a_forced_module_has_one_mode_and_no_switches() -> None:
    modes, switches = modules_coverage(
        [("A", None), ("B", "ac")], [[1, 0], [0, 1]], [[0, 0], [0, 0]]
    )
    assert modes == CoverageKind(3, ("A in AC",))
    assert switches == CoverageKind(2, ("A to SC", "A to AC"))


def test_branches_are_bits_of_words_of_64() -> None:
    names = [f"branch {i}" for i in range(70)]
    bits = [2**64 - 1 - 2, 0b100001]
    assert branches_coverage(names, bits).unreached == (
        "branch 1",
        *[f"branch {i}" for i in range(65, 69)],
    )


def test_two_searches_reach_together_what_either_reached() -> None:
    assert CoverageKind(3, ("a", "b")).merge(CoverageKind(3, ("b", "c"))) == CoverageKind(3, ("b",))
    coverage = Coverage(modes=CoverageKind(2, ("M in AC",)), values=CoverageKind(1, ("t = 1",)))
    assert coverage.unreached == ("M in AC", "t = 1")


LATCHED = """soter 1;
topic pos: float max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms { reads vel; drives pos = x; state x: float; der x = vel; }
node Fast period 10ms { publishes vel; step { publish vel = 1.0; } }
node Back period 10ms { publishes vel; step { publish vel = -1.0; } }
rta M {
  ac Fast; sc Back; period 10ms; returns never;
  safe pos < 1.0; ttf pos > 0.05; safer pos < 0.02;
}
system S { c: Cart; module M; until 1s; }
test Kept { system S; order deployed; horizon 100ms; always pos < 1.0; }
"""


def test_what_a_dm_remembers_is_no_value_to_be_reached() -> None:
    """The DM stores it itself: a latch, or a plan, that changed stood among what never was."""
    checked = check_file("latched.soter", LATCHED)
    result = explore_test(
        system_of_test(checked, "Kept"), SearchOptions(), TraceHeader("latched.soter", {})
    )
    names = result.coverage.values.unreached
    assert "pos < 0" in names
    assert not [n for n in names if n.startswith("M.")]
    assert result.coverage.values.total == 3 + 5, "of pos, and of vel"
