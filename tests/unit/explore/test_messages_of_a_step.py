"""Several messages a step in a test: what is found, and how a trace tells it."""

from __future__ import annotations

import pytest

from generators.explorer_agreement import compared, enumerated
from soter.core.steps import lower
from soter.explore.model.exploration_plan import make_plan
from soter.explore.replay import replay
from unit.explore.explored_programs import SEVERAL
from unit.explore.random_walks import system_of_text, walk

FAST = ("-O0",)
ONE_TOO_MANY = """soter 1;
topic x: bool;
topic y: bool;
node Source period 10ms { publishes x[<=1]; step { publish x = true; publish x = false; } }
node Copy period 10ms { subscribes x; publishes y; step { publish y = x; } }
system S { node Source; node Copy; }
test T { system S; horizon 30ms; always true; }
"""


def program(test: str) -> str:
    """The program with this test only, under the name that the comparison asks for."""
    lines = SEVERAL.splitlines()
    return "\n".join(
        line.replace(f"test {test} ", "test T ")
        for line in lines
        if not line.startswith("test ") or line.startswith(f"test {test} ")
    )


@pytest.mark.parametrize(
    ("test", "broken"),
    [("Many", {("property", 0)}), ("Fewer", set()), ("Faults", {("fault", 0)})],
)
def test_every_message_counts(test: str, broken: set[tuple[str, int]]) -> None:
    s = enumerated(0, program(test))
    assert set(s.found.least) == broken
    assert not compared(s, FAST).complaints


def test_a_trace_tells_all_messages_and_each_loss() -> None:
    system = system_of_text(SEVERAL, "Fewer")
    losses: set[int] = set()
    for seed in range(20):
        for step in replay(walk(system, seed).trace, system).steps:
            if step.actor == "source":
                messages = step.published["x"]
                assert isinstance(messages, list)
                assert messages[-1] == step.topics["x"]
                assert len(messages) in (1, 2)
                losses.add(len(step.dropped))
            else:
                assert not step.dropped
    assert losses == {0, 1, 2}


def test_one_message_too_many_may_be_all_that_goes_wrong_in_a_step() -> None:
    system = system_of_text(ONE_TOO_MANY, "T")
    assert make_plan(system, lower(system)).may_fault == {system.component("Source").index}
