"""Several messages a step: docs/semantics.md, AC-or-SC-Step 3 and Queues."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from soter.language.evaluate.arithmetic import FaultKind
from soter.language.front_end import check_file, system_of
from soter.semantics.configuration import StepOutcome
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.semantics.configuration import Configuration

TALKER = """soter 1;
input topic n: int in [0, 9] = 0;
type Wide = int in [0, 999];
topic t: Wide in [0, 99];
topic u: int in [0, 99];
topic sum: int in [0, 999999];
node Talker period 10ms {
  subscribes n;
  publishes t[<=3], u;
  failsafe t = 77;
  var steps: int in [0, 99];
  guarantees t >= 20;
  step {
    steps = steps + 1;
    for i in 0..9 { if i < n { publish t = 10 * i + 10; } }
    publish u = 1;
    publish u = 2;
    if n == 2 { publish t = STEPS; }
  }
}
node Reader period 50ms { subscribes t queue 4 POLICY; publishes sum; step {
  var s = 0; for x in t { s = s * 100 + x; } publish sum = min(s, 999999);
} }
system S { node Talker; node Reader; until 1s; }
"""


class Driver:
    """Lets the talker step."""

    def __init__(self, policy: str = "", third: str = "99") -> None:
        text = TALKER.replace("POLICY", policy).replace("STEPS", third)
        self.system = system_of(check_file("several.soter", text), None)
        self.it = Interpreter(self.system)
        self.c: Configuration = replace(self.it.initial(), ct=0)

    def step(self, n: int) -> StepOutcome:
        self.c = self.it.publish(self.c, {self.system.topic("n").index: n})
        talker = self.system.component("Talker").index
        self.c, event = self.it.fire(replace(self.c, FN=(talker,)), talker)
        assert isinstance(event, StepOutcome)
        return event

    def value(self, name: str) -> object:
        return self.c.Topics[self.system.topic(name).index]

    @property
    def waiting(self) -> object:
        return self.value("Reader.t.queue")

    def named(self, values: Mapping[int, object]) -> dict[str, object]:
        return {self.system.topics[i].name: v for i, v in values.items()}


def test_every_message_is_queued_in_order_and_the_topic_keeps_the_last() -> None:
    d = Driver()
    event = d.step(3)
    assert d.waiting == (10, 20, 30)
    assert d.value("t") == 30
    assert d.value("u") == 2
    assert d.named(event.published) == {"t": 30, "u": 2}
    assert d.named(event.bursts) == {"t": (10, 20, 30)}


def test_no_message_leaves_topic_and_queue_alone() -> None:
    d = Driver()
    event = d.step(0)
    assert d.waiting == ()
    assert d.value("t") == 0
    assert d.named(event.bursts) == {}


def test_a_full_queue_does_for_each_message_as_its_policy_says() -> None:
    for policy, left in (("drop_oldest", (30, 10, 20, 30)), ("drop_newest", (10, 20, 30, 10))):
        d = Driver(policy)
        d.step(3)
        d.step(3)
        assert d.waiting == left, policy


def test_one_message_too_many_is_a_step_fault_and_none_goes_out() -> None:
    d = Driver()
    event = d.step(4)
    assert event.fault is not None
    assert event.fault.kind is FaultKind.CAPACITY
    assert "more than 3 messages" in event.fault.detail
    assert event.latched
    assert d.waiting == (77,)  # the fail-safe value
    assert d.value("u") == 0


def test_one_message_outside_of_the_set_keeps_back_all() -> None:
    d = Driver(third="100")
    event = d.step(2)
    assert event.fault is not None
    assert event.fault.kind is FaultKind.RANGE
    assert d.waiting == (77,)


def test_a_message_that_is_not_the_last_is_judged_too() -> None:
    d = Driver()
    checked = d.it.machine.checks
    seen: list[object] = []
    t = d.system.topic("t").index

    def note(value: object, span: object) -> None:
        seen.append(value)
        checked[t](value, span)  # type: ignore[arg-type]

    d.it.machine.checks = tuple([note if i == t else check for i, check in enumerate(checked)])
    d.step(3)
    assert seen == [10, 20, 30]


def test_guarantees_read_the_last_message() -> None:
    d = Driver()
    assert d.step(2).violated == ()  # 10, 20, 99: the first would break it
    assert d.step(1).violated != ()


@pytest.mark.parametrize(
    ("answer", "kept", "waiting"),
    [([5, 6], 6, (5, 6)), ((7,), 7, (7,)), ([], 0, ()), (None, 0, ())],
)
def test_an_extern_answers_with_its_messages(
    answer: object, kept: int, waiting: tuple[int, ...]
) -> None:
    it = externs(answer)
    c, _ = it.run(0)
    assert c.Topics[it.system.topic("t").index] == kept
    assert c.Topics[it.system.topic("Reader.t.queue").index] == waiting


@pytest.mark.parametrize("answer", [[1, 2, 3], 4, [1, 10]])
def test_an_extern_that_answers_otherwise_faults(answer: object) -> None:
    it = externs(answer)
    c, record = it.run(0)
    assert record.components[it.system.component("X").index].faults == 1
    assert c.Topics[it.system.topic("Reader.t.queue").index] == ()


def externs(answer: object) -> Interpreter:
    text = """soter 1;
topic t: int in [0, 9];
topic sum: int in [0, 99];
extern node X period 10ms { publishes t[<=2]; }
node Reader period 10ms phase 5ms {
  subscribes t queue 5; publishes sum; step { publish sum = t.len; }
}
system S { node X; node Reader; until 1s; }
"""
    system = system_of(check_file("extern.soter", text), None)
    return Interpreter(system, 0, {"X": lambda _inputs: {"t": answer}})
