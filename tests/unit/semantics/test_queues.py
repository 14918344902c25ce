"""Queues: docs/semantics.md, section Queues."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from soter.language.evaluate.arithmetic import FaultKind
from soter.language.front_end import check_file, system_of
from soter.semantics.configuration import LOST, NEVER, StepOutcome
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from soter.semantics.configuration import Configuration

MS = 1_000_000

READER = """soter 1;
input topic t: int in [0, 999] = 0;
topic sum: int in [0, 99999];
topic old: float;
node Reader period 50ms {
  subscribes t queue 3 POLICY;
  publishes sum, old;
  failsafe sum = 12345;
  step {
    var s = 0;
    for x in t { s = s * 10 + x; }
    assert s < 9000;
    publish sum = s;
    publish old = age(t);
  }
}
system S { node Reader; until 1s; }
"""
GATED = """soter 1;
topic t: int in [0, 9];
topic u: int in [0, 9999];
topic n: int in [0, 99];
node Talker period 10ms { publishes t; step { publish t = 7; } }
node Ac period 10ms {
  subscribes t queue 2 POLICY; publishes u;
  var got: int in [0, 99];
  step { got = t.len; publish u = 1; }
}
node Sc period 10ms { publishes u; step { publish u = 2; } }
rta M { ac Ac; sc Sc; period 10ms; safe true; ttf false; safer false; }
system S { node Talker; module M; until 1s; FORCE }
"""


def interpreter(text: str, **options: Any) -> Interpreter:
    return Interpreter(system_of(check_file("queues.soter", text), None), **options)


class Driver:
    """Publishes on `t` and lets components step, at times of its own."""

    def __init__(self, text: str, policy: str = "", **more: str) -> None:
        for word, by in more.items():
            text = text.replace(word, by)
        self.it = interpreter(text.replace("POLICY", policy))
        self.c: Configuration = replace(self.it.initial(), ct=0)
        self.system = self.it.system
        self.queue = next(t for t in self.system.topics if t.queue_of is not None)

    def put(self, *values: int) -> None:
        topic = self.system.topic("t").index
        for value in values:
            self.c = replace(self.c, ct=self.c.ct + MS)
            self.c = self.it.publish(self.c, {topic: value})

    def step(self, name: str) -> StepOutcome:
        n = self.system.component(name).index
        self.c, event = self.it.fire(replace(self.c, FN=(n,)), n)
        assert isinstance(event, StepOutcome)
        return event

    def topic(self, name: str) -> Any:
        return self.c.Topics[self.system.topic(name).index]

    @property
    def waiting(self) -> Any:
        return self.c.Topics[self.queue.index]


def test_a_reader_gets_all_values_oldest_first_and_each_once() -> None:
    d = Driver(READER)
    d.put(1, 2, 3)
    d.step("Reader")
    assert (d.topic("sum"), d.waiting) == (123, ())
    d.put(4)
    d.step("Reader")
    assert d.topic("sum") == 4
    d.step("Reader")
    assert d.topic("sum") == 0
    assert d.topic("t") == 4


@pytest.mark.parametrize(
    ("policy", "waiting"), [("", (3, 4, 5)), ("drop_oldest", (3, 4, 5)), ("drop_newest", (1, 2, 3))]
)
def test_a_full_queue_drops_by_its_policy(policy: str, waiting: tuple[int, ...]) -> None:
    d = Driver(READER, policy)
    d.put(1, 2, 3, 4, 5)
    assert d.waiting == waiting
    assert d.c.stamps[d.queue.index] == NEVER


def test_a_queue_that_may_not_lose_latches_its_reader_at_its_next_step() -> None:
    d = Driver(READER, "fault")
    d.put(1, 2, 3)
    assert d.c.stamps[d.queue.index] == NEVER
    d.put(4)
    assert (d.waiting, d.c.stamps[d.queue.index]) == ((1, 2, 3), LOST)
    assert d.topic("sum") == 0
    event = d.step("Reader")
    assert event.fault is not None
    assert (event.fault.kind, event.latched) == (FaultKind.CAPACITY, True)
    assert d.topic("sum") == 12345
    assert (d.waiting, d.c.stamps[d.queue.index]) == ((), NEVER)


def test_a_faulted_step_keeps_what_waits() -> None:
    d = Driver(READER)
    d.put(999, 9, 9)
    event = d.step("Reader")
    assert event.fault is not None
    assert event.fault.kind is FaultKind.ASSERT
    assert d.waiting == (999, 9, 9)


def test_the_age_of_a_queue_is_that_of_its_topic() -> None:
    d = Driver(READER)
    d.put(1, 2)
    d.c = replace(d.c, ct=d.c.ct + 5 * MS)
    d.step("Reader")
    assert d.topic("old") == 0.005


def test_nodes_failsafes_and_inputs_all_push() -> None:
    d = Driver(GATED, "drop_newest", FORCE="")
    assert d.step("Talker").published
    assert d.waiting == (7,)
    text = READER.replace("input topic t: int in [0, 999] = 0", "topic t: int in [0, 999] = 0")
    text = text.replace("node Reader;", "node Broken; node Reader;")
    text += "node Broken period 10ms { publishes t; failsafe t = 5; step { assert false; } }"
    d = Driver(text)
    d.step("Broken")
    d.step("Broken")
    assert d.waiting == (5, 5)
    driven = interpreter(READER.replace("POLICY", "").replace("until", "input t every 10ms; until"))
    c = driven.initial()
    for _ in range(4):
        c = driven.instant(c)
        drawn = c.Topics[0]
        assert c.Topics[-1] == () or c.Topics[-1][-1] == drawn


def test_a_completed_step_empties_its_queue_whether_or_not_it_is_enabled() -> None:
    d = Driver(GATED, "drop_newest", FORCE="")
    d.step("Talker")
    assert not d.c.OE[_ac(d)]
    d.step(d.system.components[_ac(d)].name)
    assert d.waiting == ()


def _ac(d: Driver) -> int:
    return d.system.modules[0].ac


def test_an_ac_whose_queue_overflowed_is_gated_once_and_recovers() -> None:
    d = Driver(GATED, "fault", FORCE="force M ac;")
    name = d.system.components[_ac(d)].name
    for _ in range(3):
        d.step("Talker")
    event = d.step(name)
    assert event.fault is not None
    assert (event.fault.kind, event.latched, event.module) == (FaultKind.CAPACITY, False, 0)
    assert d.c.gate_fault == (True,)
    d.step("Talker")
    event = d.step(name)
    assert event.fault is None
    assert d.c.L[_ac(d)] == (1,)


def test_an_extern_gets_its_queue_as_a_list() -> None:
    text = READER.partition("node Reader")[0] + (
        "extern node Reader period 10ms { subscribes t queue 3 fault; publishes sum; }\n"
        "system S { node Reader; until 1s; }"
    )
    seen: list[Any] = []

    def step(inputs: Any) -> dict[str, int]:
        seen.append(list(inputs.t))
        return {"sum": len(inputs.t)}

    it = interpreter(text, externs={"Reader": step})
    c = replace(it.initial(), ct=0)
    for value in (1, 2):
        c = it.publish(c, {0: value})
    c, event = it.fire(replace(c, FN=(0,)), 0)
    assert (seen, c.Topics[1], c.Topics[-1]) == ([[1, 2]], 2, ())
    for value in (1, 2, 3, 4):
        c = it.publish(c, {0: value})
    c, event = it.fire(replace(c, FN=(0,)), 0)
    assert isinstance(event, StepOutcome)
    assert event.fault is not None
    assert event.fault.kind is FaultKind.CAPACITY
    assert seen[-1] == [1, 2, 3]  # it is asked before anybody looks
