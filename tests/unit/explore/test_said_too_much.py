"""Where a search once said more than it knew: parts, bounds, choices, traces."""

from __future__ import annotations

import pytest

from soter.explore.command import TraceHeader, explore_test
from soter.explore.search_options import SearchOptions
from tables import all_rows
from unit.explore.random_walks import system_of_text

TOLD = TraceHeader("small.soter", {})

OTHER = "topic z: bool; node B period 10ms { publishes z; step { publish z = true; } }"
LATE_START = (
    """soter 1;
topic x: bool = false;
node A period 40ms phase 20ms { publishes x; step { publish x = true; } }
"""
    + OTHER
)
"""What nobody has written yet is seen because another part of the system steps."""
STARTS = {
    "steps later": LATE_START + "system S { node A; node B; always x; always z; }"
    " test T { system S; horizon 30ms; }",
    "never steps": LATE_START + "system S { node A; node B; always x; always z; }"
    " test T { system S; horizon 10ms; }",
    "may be late": LATE_START.replace(" phase 20ms", "")
    + "system S { node A; node B; always x; always z; }"
    " test T { system S; horizon 5ms; late A by 3ms; }",
}
OFF_THE_GRID = (
    """soter 1;
topic x: bool = false;
node A period 40ms { publishes x; step { publish x = time > 0.004 && time < 0.006; } }
"""
    + OTHER.replace("10ms", "40ms phase 5ms")
    + "system S { node A; node B; never x; always z || !z; }"
    " test T { system S; horizon 30ms; skew 20ms; quantum 10ms; }"
)
TWO_PARTS = """soter 1;
topic x: bool = true;
topic z: bool = true;
node A period 40ms { publishes x; step { publish x = true; } }
node B period 10ms { publishes z; step { publish z = choose bool; } }
system S { node A; node B; always x; always z; }
test T { system S; horizon 30ms; }
"""
MANY_CHOICES = """soter 1;
topic x: bool = false;
node A period 40ms { publishes x; step {
  var ok: bool = true;
  for i in 0..300 { if ok { ok = choose bool; } }
  publish x = ok; } }
system S { node A; never x; }
test T { system S; horizon 30ms; }
"""
WIDE_INPUT = """soter 1;
input topic x: int in [0, 4294967296] = 0;
topic y: bool = false;
node A period 10ms { subscribes x; publishes y; step { publish y = x == 4294967295; } }
system S { node A; input x every 10ms; never y; }
test T { system S; horizon 10ms; }
"""
DEEP = (
    "soter 1; type K = int in [0, 1000000];"
    + "".join(
        f"topic t{i}: K; node N{i} period 10ms {{ publishes t{i}; var n: K = 0;"
        f" step {{ n = choose {{ n, n + 1 }}; publish t{i} = n; }} }}"
        for i in range(4)
    )
    + "system S { node N0; node N1; node N2; node N3; never t0 + t1 + t2 + t3 >= 36; }"
    " test T { system S; horizon 200ms; }"
)


@pytest.mark.parametrize("name", STARTS)
def test_a_start_that_others_let_be_seen(name: str) -> None:
    test_result = explore_test(system_of_text(STARTS[name], "T"), SearchOptions(), TOLD)
    assert test_result.verdict == "violated"


def test_a_step_beside_another_part_off_the_grid() -> None:
    assert (
        explore_test(system_of_text(OFF_THE_GRID, "T"), SearchOptions(), TOLD).verdict == "violated"
    )


@all_rows("most", [1, 2, 3, 4])
def test_a_bound_that_ends_the_search_before_the_last_part(most: int) -> None:
    options = SearchOptions(max_states=most)
    assert explore_test(system_of_text(TWO_PARTS, "T"), options, TOLD).verdict != "exhausted"


@pytest.mark.parametrize("threads", [1, 2])
def test_more_choices_than_there_is_room_for(threads: int) -> None:
    options = SearchOptions(threads=threads)
    test_result = explore_test(system_of_text(MANY_CHOICES, "T"), options, TOLD)
    assert (test_result.verdict, test_result.bound) == ("bound", "choices")


def test_an_input_with_more_values_than_fit() -> None:
    options = SearchOptions(memory=2**22)
    test_result = explore_test(system_of_text(WIDE_INPUT, "T"), options, TOLD)
    assert test_result.verdict == "bound"


@pytest.mark.parametrize("memory", [4 * 2**20, 5 * 2**20, 6 * 2**20])
def test_a_violation_whose_links_do_not_fit_has_a_trace(memory: int) -> None:
    test_result = explore_test(system_of_text(DEEP, "T"), SearchOptions(memory=memory), TOLD)
    assert test_result.verdict in {"violated", "bound"}
    if test_result.verdict == "violated":
        assert (test_result.replayed is None) == bool(test_result.not_shown)
        assert test_result.replayed is None or test_result.replayed.reproduced
