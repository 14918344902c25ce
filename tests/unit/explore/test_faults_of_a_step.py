"""Each thing that alone may make a step fault is known, and what follows of it is found."""

from __future__ import annotations

import pytest

from generators.explorer_agreement import compared, enumerated
from soter.core.steps import lower
from soter.explore.model.exploration_plan import make_plan

FAST = ("-O0",)
PROGRAM = """soter 1;
type Level = int in [0, 9];
topic ping: bool;
topic wide: Level;
topic few: Level in [0, 3];
topic level: int;
topic number: float in [-1.0, 1.0];
topic go: bool;
topic lost: bool;
fun same(it: bool): bool {{ return it; }}
fun digit(i: Level): int {{ let all = [1, 2, 3]; return all[i]; }}
node Pinger period 10ms {{
  publishes ping, wide;
  step {{ publish ping = true; publish wide = 9; }}
}}
node Ac period 30ms {{ {ac} }}
node Sc period 30ms {{ publishes {outputs}; step {{ publish go = false; }} }}
node Watch period 30ms {{
  subscribes go;
  publishes lost, level;
  var went: bool;
  step {{ publish lost = went && !go; publish level = 7; went = went || go; }}
}}
rta M {{ ac Ac; sc Sc; period 30ms; safe true; ttf false; safer true; }}
system S {{ node Pinger; module M; node Watch; }}
test T {{ system S; horizon 60ms; always !lost; }}
"""
HARMLESS = {
    "nothing": "subscribes ping; publishes go; step { publish go = ping || !ping; }",
    "a queue that forgets": "subscribes ping queue 1; publishes go; "
    "step { publish go = ping.len < 9; }",
    "a function that cannot": "subscribes ping; publishes go; step { publish go = same(ping); }",
}
FAULTS = {
    "a full queue": "subscribes ping queue 1 fault; publishes go; step { publish go = true; }",
    "an assertion": "subscribes wide; publishes go; "
    'step { publish go = true; assert wide < 9, "never"; }',
    "an index": "subscribes wide; publishes go; "
    "step { let all = [true, true]; publish go = wide < 9 || all[wide]; }",
    "a list that is full": "subscribes wide; publishes go; "
    "step { var all: bool[<=2] = []; for i in 0..9 { if i < wide { push all, true; } } "
    "publish go = true; }",
    "a function": "subscribes wide; publishes go; "
    "step { publish go = wide < 9 || digit(wide) > 0; }",
    "a number outside of its set": "subscribes wide; publishes go, number; "
    "step { publish go = true; publish number = float(wide); }",
    "an int outside of its set": "subscribes wide; publishes go, few; "
    "step { publish go = true; publish few = wide; }",
}
"""Advanced controllers by what alone can make their step fault; the second one's step does."""


def program(ac: str) -> str:
    outputs = ac.partition("publishes ")[2].partition(";")[0].replace("[<=1]", "")
    return PROGRAM.format(ac=ac, outputs=outputs)


@pytest.mark.parametrize("what", [*FAULTS, *HARMLESS])
def test_a_step_may_fault_by_one_thing_alone(what: str) -> None:
    """It is known of the AC exactly where its step does fault, in some execution."""
    s = enumerated(0, program((FAULTS | HARMLESS)[what]))
    may = {s.system.components[i].name for i in make_plan(s.system, lower(s.system)).may_fault}
    others = {"M.Sc", "Pinger"}  # the AC's outputs, and a number in a set
    assert may - others == ({"M.Ac"} if what in FAULTS else set())
    assert set(s.found.least) == ({("property", 0)} if what in FAULTS else set())


@pytest.mark.parametrize("what", ["a full queue", "an index", "a queue that forgets"])
def test_the_search_finds_what_follows_of_a_fault(what: str) -> None:
    assert not compared(enumerated(0, program((FAULTS | HARMLESS)[what])), FAST).complaints
