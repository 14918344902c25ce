"""The explorer as a library: what it finds, how it ends, what is kept of it."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators.explorer_configurations import packed_bits, replay, stored_configurations
from soter.explore.engine.explorer_library import Engine, EngineSettings, c_sources
from soter.explore.search_options import SAMPLING, STEPS_MAX, STRATEGIES
from soter.language.front_end import check_file, system_of_test
from soter.native.cache import SOTER

if TYPE_CHECKING:
    from soter.explore.engine.coverage import EngineProgress
    from soter.explore.engine.explorer_library import Searched

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "testing"
PLAIN = """soter 1;
type Colour = enum { Red, Green, Blue };
topic out: int in [-2, 2];
topic hue: Colour;
topic sum: int in [-9, 9];
topic place: int in [-2, 2];
plant P period 10ms { reads out; drives place = x;
  state x: int in [-2, 2] = 0; next x = max(-2, min(x + out, 2)); }
node Free period 10ms { subscribes place; publishes out, hue; failsafe out = 0;
  var last: int in [-2, 2] = 0; on takeover { last = 0; }
  step {
    let now: int = choose { last, 1, -1 };
    if choose bool { publish out = now; publish hue = fair choose Colour; }
    last = max(-2, min(now, 2));
  }
}
node Home period 20ms { subscribes place; publishes out, hue; on takeover { n = 1; }
  var n: int in [0, 3] = 0;
  step { n = (n + 1) % 4; publish out = place > 0 ? -1 : place < 0 ? 1 : 0;
    if n == 2 { publish hue = Colour.Blue; } }
}
rta M { ac Free; sc Home; period 20ms; safe abs(place) <= 2; ttf abs(place) > 1;
  safer place == 0; clean 1; }
node Add period 30ms { subscribes place queue 2, out queue 2 drop_newest, hue; publishes sum;
  step { var s: int = 0; for x in place { s = s + x; } for x in out { s = s + x; }
    if hue == Colour.Green { publish sum = s; } } }
system S { p: P; module M; node Add; always sum < 9; }
test T { system S; horizon 20ms; skip Add; }
test Wide { system S; horizon 10ms; skew 5ms; late M.Home by 5ms; }
"""


def plain(test: str) -> Engine:
    checked = check_file("plain.soter", PLAIN)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    return Engine(system_of_test(checked, test))


@pytest.fixture(scope="module")
def two() -> Engine:
    return Engine(system_of_test(check_file(str(EXAMPLES / "two_modules.soter")), "BothStayInside"))


@pytest.fixture(scope="module")
def greedy() -> Engine:
    path = EXAMPLES / "two_modules_greedy.soter"
    return Engine(system_of_test(check_file(str(path)), "SomebodyLeaves"))


def packed(engine: Engine, exploration: Searched) -> set[bytes]:
    words = {packed_bits(engine, w).tobytes() for w in stored_configurations(engine)}
    assert len(words) == exploration.states
    return words


@pytest.mark.parametrize("test", ["T", "Wide"])
def test_remembered_steps_and_steps_that_are_run_reach_the_same_configurations(test: str) -> None:
    engine = plain(test)
    assert engine.model.plain
    one = EngineSettings(reduction="none", keep=True, max_states=200_000)
    remembered = engine.explore(one)
    there = packed(engine, remembered)
    run = engine.explore(
        EngineSettings(reduction="none", keep=True, max_states=200_000, plainly=True)
    )
    assert remembered.status == run.status == "exhausted"
    assert there == packed(engine, run)
    engine.close()


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.long
def test_exhaustive_strategies_end_and_samples_never_say_so(two: Engine, strategy: str) -> None:
    wanted = "runs" if strategy in SAMPLING else "exhausted"
    assert two.explore(EngineSettings(strategy=strategy, runs=10)).status == wanted


def test_all_reductions_and_storages_say_the_same(two: Engine) -> None:
    assert two.explore(EngineSettings(reduction="sleep")).status == "exhausted"
    assert two.explore(EngineSettings(storage="fingerprint", threads=2)).status == "exhausted"


def test_a_violation_comes_with_a_trace_that_can_be_run_again(greedy: Engine) -> None:
    exploration = greedy.explore(EngineSettings(strategy="random"))
    assert exploration.status == "violated"
    possible, breaks, configurations = replay(greedy, exploration.steps, exploration.broken)
    assert (possible, breaks) == (len(exploration.steps), True)
    assert configurations.shape == (possible, greedy.configuration_size)
    assert exploration.broken is not None
    least = greedy.find_shortest_trace(EngineSettings(), exploration.broken)
    assert least.status == "violated"
    assert len(least.steps) <= len(exploration.steps)
    assert replay(greedy, least.steps, exploration.broken)[1]


def test_the_search_for_the_least_trace_looks_whether_it_is_to_end_while_it_stores_a_layer() -> (
    None
):
    """A layer of a thousand; a bound is looked at where the clock is, every 256 of them."""
    text = """soter 1;
topic n: int in [0, 999];
node Any period 10ms { publishes n; step { publish n = choose [0, 999]; } }
system S { node Any; }
test T { system S; horizon 30ms; never n == 7 && time > 0.025; }
"""
    engine = Engine(system_of_test(check_file("layers.soter", text), "T"))
    met = engine.explore(EngineSettings())
    assert met.broken is not None
    what = engine.ffi.new("soter_broken *", {"what": met.broken[0], "index": met.broken[1]})
    progress = engine.ffi.new("soter_explore_progress *")
    result = engine.ffi.new("soter_explore_result *")
    trace = engine.ffi.new("soter_trace_step[]", STEPS_MAX)
    options = engine.option_struct(EngineSettings(max_states=300))
    engine.lib.soter_explore_least(
        engine.model, options, what[0], progress, result, trace, STEPS_MAX
    )
    assert engine._read_result(result, trace, 0.0).status == "states"
    assert 300 <= progress.states < 300 + 256
    assert engine.find_shortest_trace(EngineSettings(), met.broken).status == "violated"


def test_a_trace_that_is_no_execution_stops_where_it_leaves_the_test(greedy: Engine) -> None:
    exploration = greedy.explore(EngineSettings(strategy="random"))
    wrong = [*exploration.steps[:3], exploration.steps[1], *exploration.steps[3:]]
    possible, breaks, _ = replay(greedy, wrong, exploration.broken)
    assert possible == 3
    assert not breaks


def test_interrupting_ends_a_search_in_order_with_what_it_found(two: Engine) -> None:
    looks: list[EngineProgress] = []

    def interrupt(progress: EngineProgress) -> None:
        looks.append(progress)
        raise KeyboardInterrupt

    exploration = two.explore(EngineSettings(strategy="random", runs=10**12), interrupt)
    assert exploration.status == "stopped"
    assert len(looks) == 1
    assert exploration.runs > 0
    assert threading.active_count() == 1


def test_what_looking_raises_is_raised_after_the_search_has_ended(two: Engine) -> None:
    def fail(_: EngineProgress) -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        two.explore(EngineSettings(strategy="random", runs=10**12), fail)
    assert threading.active_count() == 1


def test_bounds_end_a_search(two: Engine) -> None:
    assert two.explore(EngineSettings(max_states=1_000)).status == "states"
    assert two.explore(EngineSettings(reduction="none", memory=300_000)).status == "memory"
    assert two.explore(EngineSettings(strategy="random", runs=10)).status == "runs"


def test_configurations_are_kept_only_where_asked_for(two: Engine) -> None:
    exploration = two.explore(EngineSettings(max_states=1_000, keep=True))
    assert len(stored_configurations(two)) == exploration.states
    two.explore(EngineSettings(max_states=1_000))
    assert len(stored_configurations(two)) == 0


def test_coverage_says_what_stepped_and_what_was_published(two: Engine) -> None:
    two.explore(EngineSettings())
    assert two.seen.fired.all()
    assert two.seen.modes.all()
    assert two.seen.switches.all()
    unit = two.generated.unit
    assert len(unit.branches) == int(two.model.branches)


def test_the_layout_is_the_one_of_the_header(two: Engine) -> None:
    assert two.configuration_size == two.generated.configuration_size
    assert two.bits == two.generated.bits
    assert two.words == -(-two.bits // 64)


def test_every_file_of_the_explorer_is_compiled() -> None:
    there = set(SOTER.rglob("soter_explore*.[ch]"))
    assert len(there) > 15
    assert set(c_sources()) == there
