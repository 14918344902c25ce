"""Contracts of nodes: docs/semantics.md, section Contracts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from soter.language.front_end import check_file, system_of
from soter.semantics.configuration import StepOutcome
from soter.semantics.interpreter import Interpreter
from soter.semantics.judgements import violated_properties

if TYPE_CHECKING:
    from collections.abc import Sequence

MS = 1_000_000

NODE = """soter 1;
input topic x: int in [0, 99] = 0;
topic y: int in [0, 99] = 0;
node N period 10ms {
  subscribes x; publishes y; failsafe y = 50;
  assumes x < 10;
  guarantees y <= x + 1;
  step { assert x != 7; publish y = x > 3 ? x + 2 : x; }
}
system S { node N; until 1s; }
"""
ASSUMED, GUARANTEED = 0, 1


def interpreter(text: str) -> Interpreter:
    return Interpreter(system_of(check_file("contracts.soter", text), None))


def stepped(it: Interpreter, x: int) -> StepOutcome:
    c = replace(it.initial(), ct=0, FN=(0,))
    _, event = it.fire(it.publish(c, {0: x}), 0)
    assert isinstance(event, StepOutcome)
    return event


@pytest.mark.parametrize(
    ("x", "judged"),
    [
        (2, {ASSUMED: False, GUARANTEED: False}),
        (4, {ASSUMED: False, GUARANTEED: True}),
        (20, {ASSUMED: True}),  # nothing is owed by who got what it did not agree to
        (7, {ASSUMED: False}),  # nor by a step that does not complete
    ],
)
def test_assumes_before_the_step_and_guarantees_after_it(x: int, judged: dict[int, bool]) -> None:
    event = stepped(interpreter(NODE), x)
    assert event.contract_violations == judged
    assert event.violated == tuple(i for i, bad in judged.items() if bad)


def test_guarantees_are_owed_only_with_enabled_outputs_and_nothing_by_a_latched_node() -> None:
    it = interpreter(NODE)
    c = it.publish(replace(it.initial(), ct=0, FN=(0,)), {0: 4})
    _, event = it.fire(replace(c, OE=(False,)), 0)
    assert isinstance(event, StepOutcome)
    assert event.contract_violations == {ASSUMED: False}
    _, event = it.fire(replace(c, latched=(True,)), 0)
    assert isinstance(event, StepOutcome)
    assert event.contract_violations == {}


def test_a_contract_that_faults_is_violated() -> None:
    it = interpreter(NODE.replace("assumes x < 10", "assumes 1 / x < 10"))
    assert stepped(it, 0).violated == (ASSUMED,)
    assert stepped(it, 1).violated == ()


def onsets(values: Sequence[int]) -> tuple[Any, int]:
    it = interpreter(NODE)
    left = list(values)
    c, record = it.initial(), it.record()
    for _ in values:
        c = it.instant(c, choose_input=lambda _c: [(0, left.pop(0))], record=record)
    return record.properties, record.violations


def test_onsets_count_from_one_judged_step_to_the_next() -> None:
    properties, violations = onsets([1, 20, 30, 2, 20])
    assert (properties[ASSUMED].count, properties[ASSUMED].first_ns) == (2, 10 * MS)
    assert violations == 2
    properties, _ = onsets([4, 20, 5, 1, 5])  # not judged at 20: still the same violation
    assert (properties[GUARANTEED].count, properties[GUARANTEED].first_ns) == (2, 0)
    assert properties[GUARANTEED].active


def test_contracts_are_not_judged_at_the_end_of_instants() -> None:
    it = interpreter(NODE)
    c = it.publish(replace(it.initial(), ct=0), {0: 50})
    assert violated_properties(it.machine, c) == [False, False]
