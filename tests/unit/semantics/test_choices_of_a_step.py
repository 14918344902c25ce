"""What a step leaves open: docs/semantics.md, section Choices."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product
from typing import TYPE_CHECKING

import pytest

from soter.language.evaluate.environment import ages_after, allowed_picks
from soter.language.front_end import check_file, system_of
from soter.language.model.types import IntType
from soter.semantics.answered_draws import AnsweredDraws
from soter.semantics.draws import SeededDraws, draw_bits
from soter.semantics.interpreter import Interpreter
from soter.semantics.recorded_draws import ChoiceError, RecordedDraws, Recorder

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System

MS = 1_000_000

TWO_A_STEP = """soter 1;
topic a: int in [0, 9];
topic b: { x: bool, y: int in [-3, 3] };
node N period 10ms phase 5ms {
  publishes a, b;
  step {
    publish a = choose { 4, 5, 6 };
    publish b = { x: choose bool, y: choose [-3, 3] };
  }
}
system S { node N; until 1s; }
"""
FAIR = """soter 1;
topic a: int in [0, 9];
node N period 10ms {
  publishes a;
  step { publish a = fair choose { 0, 1, 2 }; assert time < 0.5; }
}
system S { node N; until 1s; }
"""
WORLD = """soter 1;
topic p: { x: float, y: float };
input topic goal: { b: bool, n: int in [1, 3] };
input topic speed: float in [0.0, 8.0] = 1.0;
plant P period 10ms {
  drives p = { x: x + d, y: held };
  state x: float in [2.0, 4.0];
  disturbance d: float in [-1.0, 1.0];
  disturbance held: float in [-1.0, 1.0] hold 20ms;
  measured p.x within 0.5, p.y within 0.0;
}
node N period 10ms { subscribes goal, speed, p; step { } }
system S {
  P: P; node N; until 1s;
  input goal every 10ms; input speed in { 2.5, 7.5 } every 10ms;
}
"""


def system_from(text: str) -> System:
    return system_of(check_file("choices.soter", text), None)


def test_a_choice_is_drawn_from_the_stream_of_its_node_by_release_and_number() -> None:
    it = Interpreter(system_from(TWO_A_STEP), seed=11)
    c = it.initial()
    for release in range(20):
        c = it.instant(c)
        bits = [draw_bits(11, "N.choose", release * 4096 + number) for number in range(3)]
        assert c.Topics == (4 + bits[0] % 3, (bits[1] % 2 == 1, bits[2] % 7 - 3))


def answered(system: System, *picks: int) -> tuple[Interpreter, AnsweredDraws]:
    queue = list(picks)
    draws = AnsweredDraws(system, lambda _stream, _count: queue.pop(0) if queue else 0)
    return Interpreter(system, draws=draws), draws


def test_a_driver_answers_every_choice_and_the_first_alternative_is_the_default() -> None:
    system = system_from(TWO_A_STEP)
    seen = set()
    for picks in product(range(3), range(2), range(7)):
        it, draws = answered(system, *picks)
        c, _ = it.fire(replace(it.initial(), ct=5 * MS, FN=(0,)), 0)
        assert c.Topics == (4 + picks[0], (picks[1] == 1, picks[2] - 3))
        assert [(q.stream, q.count, q.pick) for q in draws.questions] == [
            ("N.choose", n, p) for n, p in zip((3, 2, 7), picks, strict=True)
        ]
        seen.add(c.Topics)
    assert len(seen) == 3 * 2 * 7
    it, _ = answered(system)
    assert it.instant(it.initial()).Topics == (4, (False, -3))


def test_answers_come_from_one_queue_a_stream() -> None:
    system = system_from(TWO_A_STEP)
    it = Interpreter(system, draws=AnsweredDraws(system, {"N.choose": [2, 1], "other": [1]}))
    assert it.instant(it.initial()).Topics == (6, (True, -3))


def test_an_answer_that_is_no_alternative_is_refused() -> None:
    it, _ = answered(system_from(TWO_A_STEP), 3)
    with pytest.raises(AssertionError, match="3 is none of 3 alternatives"):
        it.instant(it.initial())


def test_floats_are_answered_by_middle_low_high_and_the_rest_by_value() -> None:
    system = system_from(WORLD)
    draws = AnsweredDraws(system, lambda _stream, n: n - 1, 5)
    it = Interpreter(system, seed=5, draws=draws)
    c = it.initial()
    assert c.L[0] == (4.0,)
    c = it.instant(c)
    held = SeededDraws(5).uniform("P.held", 0, -1.0, 1.0)
    assert c.Topics == ((4.0 + 1.0 + 0.5, held), (True, 3), 7.5)
    error = system.components[0].measured[0].stream
    assert [(q.stream, q.count) for q in draws.questions] == [
        ("P.x.start", 3), ("input.goal.b", 2), ("input.goal.n", 3), ("input.speed", 2),
        ("P.d", 3), (error, 3),
    ]  # fmt: skip
    default = Interpreter(system, draws=AnsweredDraws(system, {}))
    first = default.instant(default.initial())
    assert first.L[0] == (3.0,)
    assert first.Topics[0][0] == 3.0
    assert first.Topics[1:] == ((False, 1), 2.5)


def test_declared_values_of_an_input_are_drawn_by_one_choice() -> None:
    it = Interpreter(system_from(WORLD), seed=3)
    c = it.initial()
    for index in range(30):
        c = it.instant(c)
        assert c.Topics[2] == (2.5, 7.5)[draw_bits(3, "input.speed", index) % 2]


def test_every_alternative_of_a_fair_choice_comes_in_any_2n_executions() -> None:
    system = system_from(FAIR)
    always: list[tuple[int, Callable[[str, int], int]]] = [
        (0, lambda _stream, _n: 0),  # the first that is allowed
        (2, lambda _stream, n: n - 1),  # the last
    ]
    for first, answer in always:
        draws = AnsweredDraws(system, answer)
        it, got = Interpreter(system, draws=draws), []
        c = it.initial()
        for _ in range(50):
            c = it.instant(c)
            got.append(c.Topics[0])
        assert all(set(got[i : i + 6]) == {0, 1, 2} for i in range(44))
        assert got[:3] == [first] * 3  # and not a turn before it has to


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_fair_choice_allows_exactly_what_keeps_every_deadline(n: int) -> None:
    """By search: an alternative is allowed iff after it somebody can go on for ever."""
    start = (0,) * n
    states, todo = {start}, [start]
    while todo:
        ages = todo.pop()
        for i in range(n):
            after = ages_after(ages, i)
            if max(after) < 2 * n and after not in states:
                states.add(after)
                todo.append(after)
    alive = set(states)
    while True:
        stuck = {a for a in alive if not any(ages_after(a, i) in alive for i in range(n))}
        if not stuck:
            break
        alive -= stuck
    assert start in alive
    for ages in alive:
        assert allowed_picks(ages) == [i for i in range(n) if ages_after(ages, i) in alive]


def test_a_faulted_step_keeps_the_ages() -> None:
    it = Interpreter(system_from(FAIR), seed=1)
    trail = [it.initial()]
    for _ in range(60):
        trail.append(it.instant(trail[-1]))
    assert all(a.L != b.L for a, b in pairwise(trail[:51]))
    assert all(c.L == trail[50].L for c in trail[51:])
    assert trail[-1].latched == (True,)


def test_choices_can_be_written_down_and_read_back() -> None:
    system = system_from(TWO_A_STEP)
    recorder = Recorder(SeededDraws(7))
    first, _ = Interpreter(system, draws=recorder).run(100 * MS)
    again, _ = Interpreter(system, draws=RecordedDraws(recorder.choices)).run(100 * MS)
    assert first == again
    with pytest.raises(ChoiceError, match="none of 2 alternatives"):
        RecordedDraws({"N.choose": [(0, 2)]}).choice("N.choose", 0, 2)
    with pytest.raises(ChoiceError, match="none of 2 alternatives"):
        RecordedDraws({"N.choose": [(0, True)]}).choice("N.choose", 0, 2)


def test_an_int_leaf_without_bounds_has_no_more_than_32_bits_of_alternatives() -> None:
    system = system_from(TWO_A_STEP)
    draws = AnsweredDraws(system, lambda _stream, _n: 1)
    assert draws.leaf_value(IntType(-(2**63), 2**63 - 1), None, "s", 0) == -(2**63) + 1
    assert [q.count for q in draws.questions] == [2**32 - 1]
