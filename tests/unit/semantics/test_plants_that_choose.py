"""Choices of plants: docs/semantics.md, Plants and Choices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file, system_of
from soter.semantics.answered_draws import AnsweredDraws
from soter.semantics.draws import draw_bits
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from soter.language.model.system import System

MS = 1_000_000
BOAT = """soter 1;
topic told: { x: float, k: int, seen: int, late: int };
plant Boat period 10ms {
  drives told = { x: x, k: k, seen: seen, late: choose [5, 7] };
  state x: float;
  state n: int in [0, 999];
  state seen: int in [0, 99];
  let before = n;
  let k = choose [1, 3] + 10 * before;
  let after = k + 1;
  der x = 100.0 * float(k);
  next n = n + 1;
  next seen = choose { after, 0 };
  integrate SCHEME substeps 2;
}
system S { b: Boat; until 1s; }
"""


def system(scheme: str = "rk4") -> System:
    return system_of(check_file("boat.soter", BOAT.replace("SCHEME", scheme)), None)


def told(picks: list[int], until_ms: int, scheme: str = "rk4") -> tuple[list[object], list[int]]:
    """What the plant drives after its steps, and how many alternatives each question had."""
    s = system(scheme)
    draws = AnsweredDraws(s, {"b.choose": picks})
    outputs: list[object] = []
    it = Interpreter(s, draws=draws)
    it.run(until_ms * MS, observe=lambda c, _record: outputs.append(c.Topics[0]))
    return outputs, [a.count for a in draws.questions]


@pytest.mark.parametrize("scheme", ["rk4", "euler"])
def test_a_let_that_chooses_has_one_value_a_step(scheme: str) -> None:
    outputs, asked = told([0, 2, 2, 0, 1], 10, scheme)
    first, second = outputs
    assert first == (0.0, 1, 0, 7)  # k = 1; no motion yet
    assert second == (3.0, 3, 4, 6)  # k = 3 at all stages; seen = after
    assert asked == [3, 3, 3, 2, 3]


def test_it_is_taken_on_the_states_that_the_step_begins_with() -> None:
    outputs, _ = told([0, 0, 0, 0, 0, 0, 0, 0], 20)
    assert [t[1] for t in outputs] == [1, 1, 11]  # type: ignore[index]


def test_a_run_draws_by_the_seed() -> None:
    s = system()
    draws: list[int] = []
    it = Interpreter(s, 7)
    it.run(30 * MS, observe=lambda c, _record: draws.append(c.Topics[0][3]))
    stream = [draw_bits(7, "b.choose", k * 4096 + j) for k, j in ((0, 1), (1, 2), (2, 2), (3, 2))]
    assert draws == [5 + bits % 3 for bits in stream]


def test_a_choice_after_a_fault_is_not_asked() -> None:
    text = BOAT.replace("next n = n + 1;", "next n = n - 1;")
    s = system_of(check_file("boat.soter", text.replace("SCHEME", "rk4")), None)
    draws = AnsweredDraws(s, {})
    it = Interpreter(s, draws=draws)
    _, record = it.run(20 * MS)
    assert record.components[0].faults == 1
    assert [a.count for a in draws.questions] == [3, 3, 3]  # the second step faults in `next n`
