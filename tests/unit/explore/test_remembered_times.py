"""Steps are remembered where times are chosen: a search that runs each stores the same."""

from __future__ import annotations

import pytest

from generators.explorer_configurations import packed_bits, stored_configurations
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.language.front_end import check_file, system_of_test

PROGRAM = """soter 1;
topic place: int in [-3, 3] max_age 20ms;
topic out: int in [-1, 1];
topic beat: int in [0, 1];
topic misses: int in [0, 3];
plant P period 10ms { reads out; drives place = x;
  state x: int in [-3, 3] = 0; next x = max(-3, min(x + out, 3)); }
node Free period 10ms { publishes out; step { publish out = choose { 0, 1, -1 }; } }
node Home period 10ms { subscribes place; publishes out;
  step { publish out = place > 0 ? -1 : place < 0 ? 1 : 0; } }
rta M { ac Free; sc Home; period 20ms; safe abs(place) <= 3; ttf abs(place) > 1;
  safer place == 0; }
node Beat period 20ms { publishes beat; step { publish beat = 1; } }
node Dog period 10ms { subscribes beat queue 2 drop_newest; publishes misses; var n: int in [0, 3];
  step {
    if age(beat) > 0.022 { n = min(n + 1, 3); } else { n = 0; }
    for b in beat { n = n == 3 ? 3 : n; }
    publish misses = n;
  } }
node Clock period 20ms { subscribes misses; publishes late; var n: int in [0, 1];
  step { publish late = time > 0.025 && misses > 0; } }
topic late: bool;
system Ages { node Beat; node Dog; node Clock; always misses <= 3 || late; }
system Kept { p: P; module M; always abs(place) <= 3; }
test Age { system Ages; horizon 50ms; skew 10ms; quantum 5ms; }
test Lost { system Ages; horizon 40ms; skip Beat at most 1; late Dog by 10ms; quantum 5ms; }
test Owed { system Ages; horizon 40ms; late Beat by 15ms; quantum 5ms;
  misses > 0 leadsto misses == 0 within 20ms; eventually beat == 1 within 30ms; }
test Module { system Kept; horizon 40ms; late M.Home by 10ms; quantum 5ms; always invariant(M); }
test Points { system Kept; horizon 60ms; out != 0 leadsto out == 0 within 30ms; }
"""
CHOOSES = {"Module", "Points"}
"""Where AC chooses in vain: a step that is remembered makes one move of what is written alike."""


@pytest.mark.parametrize("test", ["Age", "Lost", "Owed", "Module", "Points"])
def test_steps_remembered_with_their_times_reach_the_configurations_of_steps_that_are_run(
    test: str,
) -> None:
    checked = check_file("times.soter", PROGRAM)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    engine = Engine(system_of_test(checked, test))
    assert not engine.model.plain
    assert engine.model.brief
    outcome_by_mode = {}
    for plainly in (False, True):
        how = EngineSettings(reduction="none", keep=True, go_on=True, plainly=plainly)
        search = engine.explore(how)
        assert search.status in {"exhausted", "violated"}
        configurations = {packed_bits(engine, w).tobytes() for w in stored_configurations(engine)}
        assert len(configurations) == search.states
        outcome_by_mode[plainly] = (search.status, configurations, search.transitions)
    assert outcome_by_mode[False][:2] == outcome_by_mode[True][:2]
    assert len(outcome_by_mode[True][1]) > 60
    if test in CHOOSES:
        assert outcome_by_mode[False][2] < outcome_by_mode[True][2]
    engine.close()


FAR = """soter 1;
topic beat : int in [0, 1];
topic other : int in [0, 1];
topic out : int in [0, 1];
node Beat period 8589934594ns { publishes beat; step { publish beat = 1; } }
node Tiny period 8589934594ns phase 1ns { publishes other; step { publish other = 1; } }
node Dog period 4294967297ns { publishes out; step { publish out = 1; } }
system S { node Beat; node Tiny; node Dog; }
test T { system S; horizon 5s; never age(beat) > 2.0; }
"""
"""Before the last step 2^32 ticks of 1 ns pass."""


@pytest.mark.parametrize("plainly", [False, True])
def test_ticks_between_two_steps_may_be_more_than_32_bits_tell(plainly: bool) -> None:
    engine = Engine(system_of_test(check_file("far.soter", FAR), "T"))
    assert engine.plan.tick_ns == 1
    assert engine.explore(EngineSettings(plainly=plainly)).status == "violated"
    engine.close()


LONG = """soter 1;
topic x: int in [0, 3];
topic y: int in [0, 3];
node A period 1ms { publishes x; step { publish x = choose [0, 3]; } }
node B period 1ms { publishes y; step { publish y = choose [0, 3]; } }
system S { node A; node B; }
test T { system S; horizon 30s; always x + y <= 6; }
"""
"""Every instant has a schedule of its own."""


def test_what_there_is_no_memory_to_remember_takes_none() -> None:
    engine = Engine(system_of_test(check_file("long.soter", LONG), "T"))
    for reduction in ("groups", "all"):
        exploration = engine.explore(EngineSettings(reduction=reduction, memory=2**24))
        assert (exploration.status, exploration.states) == ("exhausted", 16 * 30_001 + 1)
        assert exploration.total_bytes < 2**23
    engine.close()
