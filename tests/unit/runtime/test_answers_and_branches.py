"""`soter_answers` in C: what is asked, what a wrong pick becomes, which branches are noted."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import pytest

from generators.any_order_driver import Native
from generators.engine_comparison import Subject, compile_library, subject
from soter.codegen.unit import Unit, generate
from soter.semantics.draws import fnv1a_64

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
input topic x: int in [0, 9] = 0;
topic y: int in [0, 99] = 0;
node N period 10ms {
  subscribes x; publishes y;
  var n: int in [0, 9];
  step {
    if x < 2 {
      publish y = choose [10, 12];
    } elseif x < 4 {
      n = n + 1;
      assert n > 5;
      if x == 2 { publish y = 3; }
    } else {
      if choose bool && choose bool { publish y = 4; }
    }
  }
}
node Other period 10ms { subscribes y; step { } }
system S { node N; node Other; input x every 10ms; until 1s; }
"""


@dataclass(eq=False)
class Covered(Subject):
    """A program whose nodes note their branches."""

    @cached_property
    def unit(self) -> Unit:
        return generate(self.system, prefix=self.name, branches=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Covered, Path]:
    plain = subject("covered", PROGRAM, 3, 10)
    covered_subject = Covered(**vars(plain))
    return covered_subject, compile_library(
        [covered_subject], tmp_path_factory.mktemp("covered"), "-O1"
    )


class Picks(random.Random):
    """Not random: the picks that are given, then 0; always all of them."""

    def __init__(self, *picks: int) -> None:
        super().__init__(0)
        self.picks = list(picks)

    def choice(self, seq: tuple[int, ...]) -> int:  # type: ignore[override]
        if len(seq) == 3:  # how many are given
            return seq[-1]
        return self.picks.pop(0) if self.picks else 0


def native(made: tuple[Covered, Path], x: int, *picks: int) -> tuple[Native, int]:
    s, library = made
    engine = Native(library, s, Picks())
    engine.start(1)
    engine.state[s.layout.topic_offset(0)] = x
    engine.at(10_000_000)
    engine.chance = Picks(*picks)
    engine.fire(0)
    return engine, int(engine.state[s.layout.topic_offset(1)])


@pytest.mark.parametrize(("pick", "value"), [(0, 10), (1, 11), (2, 12), (3, 10), (2**31, 10)])
def test_a_pick_that_is_no_alternative_is_the_default(
    made: tuple[Covered, Path], pick: int, value: int
) -> None:
    engine, y = native(made, 0, pick)
    assert y == value
    assert engine.asked() == [(fnv1a_64("N.choose"), 3, pick if pick < 3 else 0)]


def test_only_what_is_evaluated_is_asked(made: tuple[Covered, Path]) -> None:
    assert len(native(made, 5, 0)[0].asked()) == 1
    assert len(native(made, 5, 1)[0].asked()) == 2
    assert native(made, 5, 1, 1)[1] == 4


def taken(made: tuple[Covered, Path], x: int, *picks: int) -> set[tuple[int, bool]]:
    branches = made[0].unit.branches
    assert {b.component for b in branches} == {"N"}
    engine, _ = native(made, x, *picks)
    return {(branches[i].span.line, branches[i].taken) for i in engine.branches}


def test_branches_are_noted_by_line_and_side(made: tuple[Covered, Path]) -> None:
    assert taken(made, 0) == {(8, True)}
    assert taken(made, 5, 0) == {(8, False), (10, False), (15, False)}
    assert taken(made, 5, 1, 1) == {(8, False), (10, False), (15, True)}
    numbered = {(b.span.line, b.taken) for b in made[0].unit.branches}
    assert numbered == {(line, side) for line in (8, 10, 13, 15) for side in (True, False)}


def test_what_follows_a_fault_is_no_branch_taken(made: tuple[Covered, Path]) -> None:
    assert taken(made, 2) == {(8, False), (10, True)}


def test_without_the_option_nothing_is_noted(made: tuple[Covered, Path]) -> None:
    plain = generate(made[0].system, prefix="covered")
    assert plain.branches == ()
    assert "soter_branch" not in plain.source
