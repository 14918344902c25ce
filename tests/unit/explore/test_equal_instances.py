"""Which instances are taken as equal, and what happens where one should not be."""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING, Any

import pytest

from generators.explorer_agreement import enumerated
from generators.symmetry_agreement import compared_as_equals
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.search import Search
from soter.explore.model.symmetry import RenamingCheck
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.language.model.system import System

FAST = ("-O0",)

PROGRAM = """soter 1;
type Small = int in [0, 2];
param STEP: Small = 1 in [0, 2];
param FIRST: Small = 0 in [0, 2];
param EVERY: duration = 10ms;
topic at : Small in [0, 2];
topic moved : bool;
input topic gate : bool;
topic full : bool;
topic open : bool = true;
input topic in0 : Small in [0, 2];
input topic in1 : Small in [0, 2];
fun apart(a: int, b: int): int { return abs(a - b); }
fun before(a: int, b: int): int { return a - b; }
node Gate period 10ms {
  subscribes in0, in1;
  publishes full;
  step { publish full = $GATE; }
}
node Clerk period 10ms {
  subscribes in0 queue 1, in1 queue 1;
  publishes full;
  var kept0: Small = $KEPT;
  var kept1: Small = 0;
  step {
    for v in in0 { kept0 = v; }
    for v in in1 { kept1 = v; }
    publish full = kept0 > 0 && kept1 > 0;
  }
}
node Clock period 10ms { publishes open; var n: bool; step { n = !n; publish open = n; } }
node Robot period EVERY {
  subscribes gate;
  publishes at, moved;
  var n: Small = FIRST;
  step {
    let before = n;
    n = gate ? 0 : choose { n, min(n + STEP, 2) };
    publish at = n;
    publish moved = before != n;
  }
}
system One { node Robot; }
system S {
  g: $HUB { in0 = r[0].at, in1 = r[1].at };
  node Clock;
  r[0]: One { gate = full };
  r[1]: One { gate = $WIRE };
  $MORE
}
test T { system S; horizon 30ms; $TEST }
"""
PLAIN = {
    "GATE": "in0 > 0 && in1 > 0",
    "KEPT": "0",
    "HUB": "Gate",
    "WIRE": "full",
    "MORE": "",
    "TEST": "always r[0].at + r[1].at < 4;",
}
BOTH = (("r[0]", "r[1]"),)


def program(**changed: str) -> str:
    text = PROGRAM
    for name, value in {**PLAIN, **changed}.items():
        text = text.replace(f"${name}", value)
    return text


def system(**changed: str) -> System:
    return system_of_test(check_file("p.soter", program(**changed)), "T")


def equal(**changed: str) -> tuple[tuple[str, ...], ...]:
    engine = Engine(system(**changed), extra=FAST)
    engine.close()
    return tuple(f.names for f in engine.equal.families)


EQUAL: dict[str, dict[str, str]] = {
    "nothing tells them apart": {},
    "a sum": {"GATE": "in0 + in1 > 2"},
    "an or": {"GATE": "in0 == 2 || in1 == 2"},
    "equality": {"GATE": "in0 == in1"},
    "a comparison and its mirror image": {"GATE": "in0 > in1 || in1 > in0"},
    "the larger one of two": {"GATE": "max(in0, in1) > 1"},
    "a distance": {"GATE": "abs(in0 - in1) > 1"},
    "a function of both": {"TEST": "always apart(r[0].at, r[1].at) < 2;"},
    "queues and what is kept of them": {"HUB": "Clerk"},
    "the same parameter": {"MORE": "set r[0].STEP = 2; set r[1].STEP = 2;"},
    "faults of both": {"TEST": "skip r[0].Robot; skip r[1].Robot; always !open || open;"},
    "a property of each": {"TEST": "always r[0].at < 3; always r[1].at < 3;"},
    "a deadline of each": {
        "TEST": "r[0].moved leadsto r[0].at > 0 within 10ms;"
        " r[1].moved leadsto r[1].at > 0 within 10ms;"
    },
}
APART: dict[str, dict[str, str]] = {
    "a parameter": {"MORE": "set r[0].STEP = 2;"},
    "a first value": {"MORE": "set r[1].FIRST = 1;"},
    "a period": {"MORE": "set r[1].EVERY = 20ms;"},
    "a property of one": {"TEST": "always r[0].at < 2;"},
    "a deadline of one": {"TEST": "r[0].moved leadsto r[0].at > 0 within 10ms;"},
    "deadlines that differ": {
        "TEST": "r[0].moved leadsto r[0].at > 0 within 10ms;"
        " r[1].moved leadsto r[1].at > 0 within 20ms;"
    },
    "a property that asks who is first": {"TEST": "always r[0].at <= r[1].at + 1;"},
    "a function that asks who is first": {"TEST": "always before(r[0].at, r[1].at) < 2;"},
    "lost steps of one": {"TEST": "skip r[0].Robot; always r[0].at + r[1].at < 4;"},
    "lateness of one": {"TEST": "late r[1].Robot by 5ms; always r[0].at + r[1].at < 4;"},
    "lateness that differs": {
        "TEST": "late r[0].Robot by 4ms; late r[1].Robot by 5ms; always r[0].at + r[1].at < 4;"
    },
    "who wins": {"GATE": "in0 > 0 ? in0 > 1 : in1 > 0"},
    "who is subtracted": {"GATE": "in0 - in1 > 0"},
    "another wire": {"WIRE": "open"},
    "a first value of what is kept": {"HUB": "Clerk", "KEPT": "1"},
    "the order within an instant": {"TEST": "order deployed; always r[0].at + r[1].at < 4;"},
}


@pytest.mark.parametrize("name", EQUAL)
def test_instances_that_nothing_tells_apart_are_equal(name: str) -> None:
    assert equal(**EQUAL[name]) == BOTH


@pytest.mark.parametrize("name", APART)
def test_instances_that_something_tells_apart_are_not(name: str) -> None:
    assert equal(**APART[name]) == ()


SHOWN = (
    "a sum",
    "a distance",
    "queues and what is kept of them",
    "a deadline of each",
    "who wins",
    "a property that asks who is first",
    "a first value of what is kept",
    "lateness that differs",
    "the order within an instant",
)


@pytest.mark.parametrize("name", SHOWN)
def test_what_is_said_of_them_is_what_the_enumerator_says(name: str) -> None:
    s = enumerated(0, program(**(EQUAL | APART)[name]), 60_000)
    told = compared_as_equals(s, FAST)
    assert told.complaints == []
    assert told.orbits == 0 or told.stored < told.whole


BLIND: dict[str, tuple[str, Any, dict[str, str]]] = {
    "what is judged": ("_keeps_judgements", lambda *_: True, {"TEST": "always r[1].at < 2;"}),
    "what is computed": ("_computation", lambda *_: (), {"MORE": "set r[0].STEP = 2;"}),
    "first values": ("_component_key", lambda *_: (), {"MORE": "set r[1].FIRST = 1;"}),
    "calendars and faults": (
        "_keeps_calendars",
        lambda *_: True,
        {"TEST": APART["lost steps of one"]["TEST"]},
    ),
}


@pytest.mark.parametrize("what", BLIND)
def test_each_check_is_needed(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where one is left out, instances are taken as equal that are not, and it is noticed."""
    method, instead, changed = BLIND[what]
    s = enumerated(0, program(**changed), 60_000)
    assert compared_as_equals(s, FAST).complaints == []
    monkeypatch.setattr(RenamingCheck, method, instead)
    told = compared_as_equals(s, FAST)
    assert told.equal == BOTH
    assert told.complaints != []


def test_reports_say_which_instances_are_equal() -> None:
    with Search(system(), SearchOptions()) as search:
        outcome = search.run()
        assert (outcome.status, search.equal) == ("violated", BOTH)
        assert search.run(known=((0, 0),)).status == "exhausted"
        assert search.equal == ()  # another violation may be of one and not of the other
    for off in ("parts", "groups", "none"):
        with Search(system(), SearchOptions(reduction=off)) as search:
            search.run()
            assert search.equal == ()


THREE = """soter 1;
type Small = int in [0, 3];
topic at : Small in [0, 3];
topic sign : bool;
input topic seen : bool;
node Lamp period 10ms { publishes sign; step { publish sign = choose bool; } }
node Robot period 10ms {
  subscribes seen;
  publishes at;
  var n: Small;
  step { n = seen ? n : min(n + choose { 0, 1 }, 3); publish at = n; }
}
system One { node Robot; }
system S { node Lamp; for i in 0..$N { r[i]: One { seen = sign }; } }
test T { system S; horizon 30ms; for i in 0..$N { always r[i].at < 4; } }
"""


@pytest.mark.parametrize("count", [2, 3, 5])
def test_all_orders_of_many_instances_are_one(count: int) -> None:
    """After k instants the lamp is on or off, and how many have gone 0, 1, ... steps counts."""
    text = THREE.replace("$N", str(count))
    engine = Engine(system_of_test(check_file("p.soter", text), "T"), extra=FAST)
    assert [f.names for f in engine.equal.families] == [tuple(f"r[{k}]" for k in range(count))]
    exploration = engine.explore(EngineSettings(reduction="all"))
    engine.close()
    ways = [comb(min(k + 1, 4) + count - 1, count) for k in (1, 2, 3, 4)]
    assert (exploration.status, exploration.states) == ("exhausted", 1 + 2 * sum(ways))


NESTED = """soter 1;
topic on : bool;
topic all : bool;
input topic first : bool;
input topic second : bool;
input topic go : bool;
node Sensor period 10ms {
  subscribes go;
  publishes on;
  step { publish on = go ? false : choose bool; }
}
node Both period 20ms {
  subscribes first, second;
  publishes all;
  step { publish all = first && second; }
}
node Top period 20ms {
  subscribes first, second;
  publishes all;
  step { publish all = first || second; }
}
system Robot {
  for i in 0..2 { s[i]: Half { go = go }; }
  b: Both { first = s[0].on, second = s[1].on };
}
system Half { node Sensor; }
system S {
  t: Top { first = r[0].all, second = r[1].all };
  for i in 0..2 { r[i]: Robot { go = all }; }
}
test T { system S; horizon 20ms; always !all || r[0].all || r[1].all; }
"""


def test_equal_instances_inside_of_equal_instances() -> None:
    engine = Engine(system_of_test(check_file("p.soter", NESTED), "T"), extra=FAST)
    names = [f.names for f in engine.equal.families]
    assert names == [("r[0].s[0]", "r[0].s[1]"), ("r[1].s[0]", "r[1].s[1]"), ("r[0]", "r[1]")]
    one = engine.explore(EngineSettings(reduction="all"))
    other = engine.explore(EngineSettings(reduction="groups"))
    assert one.status == other.status
    engine.close()


def test_what_one_instance_reached_counts_for_all_of_them() -> None:
    with Search(system(TEST="always r[0].at + r[1].at < 5;"), SearchOptions()) as search:
        assert search.run().status == "exhausted"
        told = search.coverage()
    assert not [x for _, part in told.parts() for x in part.unreached if "r[" in x]
