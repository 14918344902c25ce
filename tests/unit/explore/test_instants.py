"""Only ends of instants are stored, where all windows are points: what that leaves as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from generators.brute_force import BruteForce
from generators.explorer_configurations import Decoder, replay, stored_configurations
from soter.api.program import load
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test
from tables import all_rows

EXAMPLES = Path(__file__).parents[3] / "examples/testing"

CHAIN = """soter 1;
type Small = int in [0, 3];
topic x : Small;
topic y : Small;
topic z : Small;
node A period 10ms { publishes x; step { publish x = choose { 0, 1, 3 }; } }
node B period 10ms {
  subscribes x;
  publishes y;
  step { publish y = x; }
}
node C period 10ms { subscribes y; publishes z; guarantees z != 3; step { publish z = y; } }
system S { node A; node B; }
system Judged { node A; node B; node C; }
test Middle { system Judged; horizon 30ms; always x <= 3; }
test End { system S; horizon 30ms; always x != 3 || y != 3; }
test Late { system S; horizon 30ms; always x <= 3; y == 3 leadsto y == 0 within 10ms; }
"""


def engine_of(test: str, **changed: int) -> Engine:
    system = system_of_test(check_file("chain.soter", CHAIN), test)
    assert system.test is not None
    plan = replace(system.test, **changed)  # type: ignore[arg-type]
    return Engine(replace(system, test=plan))


@all_rows("reduction", ["instants", "all"])
@all_rows("test", ["Middle", "End", "Late"])
def test_a_trace_between_ends_has_all_its_steps(test: str, reduction: str) -> None:
    engine = engine_of(test)
    exploration = engine.explore(EngineSettings(reduction=reduction))
    assert exploration.status == "violated"
    possible, breaks, _ = replay(engine, exploration.steps, exploration.broken)
    assert possible == len(exploration.steps) > 2
    assert breaks


BREAKS = """soter 1;
topic x : int in [0, 3];
topic y : int in [0, 3];
node A period 10ms { publishes x; guarantees x != 3; step { publish x = choose { 0, 3 }; } }
node B period 10ms { subscribes x; publishes y; step { publish y = x; } }
system S { node A; node B; }
test T { system S; horizon 30ms; always y <= 3; }
"""


@all_rows("reduction", ["instants", "groups", "all"])
@all_rows("plainly", [False, True])
def test_where_a_step_breaks_a_contract_the_middle_of_its_instant_is_not_stored(
    reduction: str, plainly: bool
) -> None:
    engine = Engine(system_of_test(check_file("breaks.soter", BREAKS), "T"))
    how = EngineSettings(reduction=reduction, plainly=plainly)
    stored = []
    for go_on in (True, False):
        assert engine.explore(replace(how, keep=True, go_on=go_on)).status == "violated"
        stored.append({w.tobytes() for w in stored_configurations(engine)})
    assert stored[1] <= stored[0]


def test_far_fewer_are_stored_and_as_many_steps_counted() -> None:
    system = system_of_test(check_file(str(EXAMPLES / "two_modules.soter")), "BothStayInside")
    assert system.test is not None
    engine = Engine(replace(system, test=replace(system.test, horizon_ns=60_000_000)))
    whole = engine.explore(EngineSettings(reduction="ample"))
    ends = engine.explore(EngineSettings(reduction="all"))
    assert whole.status == ends.status == "exhausted"
    assert ends.states < whole.states / 5
    assert whole.depth == ends.depth


def test_groups_give_the_ends_that_steps_give() -> None:
    system = system_of_test(check_file(str(EXAMPLES / "two_modules.soter")), "BothStayInside")
    assert system.test is not None
    engine = Engine(replace(system, test=replace(system.test, horizon_ns=60_000_000)))
    configuration_sets = []
    for reduction in ("instants", "groups", "all"):
        how = EngineSettings(reduction=reduction, keep=True)
        assert engine.explore(how).status == "exhausted"
        configuration_sets.append({w.tobytes() for w in stored_configurations(engine)})
    assert configuration_sets[0] == configuration_sets[1] == configuration_sets[2]


def test_where_windows_are_no_points_every_configuration_is_stored() -> None:
    engine = engine_of("Late", skew_ns=5_000_000)
    plain = engine.explore(EngineSettings(reduction="none", go_on=True))
    assert engine.explore(EngineSettings(reduction="instants", go_on=True)).states == plain.states


STOPPED = """soter 1;
topic b: bool;
topic c: bool;
node Reads period 20ms { subscribes c; publishes b; assumes age(c) > 10.0; step { publish b = c; } }
node Writes period 10ms { publishes c; step { publish c = true; } }
node Beside period 20ms { subscribes b; publishes d; step { publish d = b; } }
topic d: bool;
system S { node Beside; node Reads; node Writes; }
test T { system S; skip Writes at most 2; horizon 20ms; }
"""


@pytest.mark.parametrize("reduction", ["instants", "groups", "all"])
def test_what_a_broken_contract_leaves_in_the_middle_is_not_stored(reduction: str) -> None:
    """The search ends with the contract; what it had come to by then passed for ends of instants.

    A layer's table has the calendar of its configurations once, so it refused them: a defect was
    told in place of the violation.
    """
    system = system_of_test(check_file("stopped.soter", STOPPED), "T")
    judge, engine = BruteForce(system), Engine(system)
    exploration = engine.explore(EngineSettings(reduction=reduction, keep=True))
    assert exploration.status == "violated"
    decoder = Decoder(judge, engine.plan)
    configurations = [decoder.world(w.tobytes()) for w in stored_configurations(engine)]
    assert all(w.c.ct < 0 or judge.observable(w) for w in configurations)


LARGE = """soter 1;
type Some = int in [0, 36];
topic x : Some;
topic y : Some;
topic c : bool;
topic d : bool;
topic z : bool;
node A period 100ms { publishes x; step { publish x = choose [0, 36]; } }
node B period 100ms { publishes y; step { publish y = choose [0, 36]; } }
node C period 100ms { publishes c; step { publish c = choose bool; } }
node D period 100ms { publishes d; step { publish d = choose bool; } }
node E period 10ms {
  subscribes x, y, c, d;
  publishes z;
  step { publish z = x == y && c && d; }
}
system S { node A; node B; node C; node D; node E; }
test T { system S; horizon 15ms; always x <= 36; }
"""
"""The first instant is large, the second has one step."""


def test_what_an_instant_had_no_memory_for_is_not_forgotten_in_the_next() -> None:
    engine = Engine(system_of_test(check_file("large.soter", LARGE), "T"))
    whole = engine.explore(EngineSettings(plainly=True))
    assert whole.status == "exhausted"
    for memory in range(1_000_000, 2_000_000, 200_000):
        exploration = engine.explore(EngineSettings(plainly=True, memory=memory))
        assert (exploration.status, exploration.states == whole.states) in {
            ("memory", False),
            ("exhausted", True),
        }
        assert exploration.covered_ns == (
            whole.covered_ns if exploration.status == "exhausted" else 0
        )


def test_a_search_that_goes_the_same_ways_again_and_again_says_what_else_there_is(
    tmp_path: Path,
) -> None:
    path = tmp_path / "chain.soter"
    path.write_text(CHAIN)
    [test_result] = load(path).explore("End").tests
    dear = replace(test_result, states=10, transitions=10_000, seconds=3.0)
    assert "took 1,000 transitions" in dear.slow_search_note
    assert "--reduction ample" in dear.slow_search_note
    assert not replace(dear, transitions=500).slow_search_note
    assert not replace(dear, seconds=0.5).slow_search_note
    assert not replace(dear, options=SearchOptions(reduction="ample")).slow_search_note
