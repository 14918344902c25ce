"""Parts of a system that only properties join: explored alone, and judged together."""

from __future__ import annotations

import math

import pytest

from generators.explorer_configurations import replay
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.reductions import ComposedSearch
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

HEAD = """soter 1;
type Cell = int in [0, 9];
"""


def walker(name: str, period: str, step: str) -> str:
    """A node that walks up: to `step` cells a release, as it chooses."""
    return f"""topic {name}: Cell;
node W{name} period {period} {{
  publishes {name};
  var at: Cell = 0;
  step {{ at = min(9, at + choose [0, {step}]); publish {name} = at; }}
}}
"""


def walkers(test: str) -> str:
    """Two of them and a plant that counts; they share nothing."""
    plant = """topic p: Cell;
plant P period 20ms { drives p = s; state s: Cell = 0; next s = min(9, s + 1); }
"""
    return (
        HEAD
        + walker("a", "10ms", "2")
        + walker("b", "30ms phase 5ms", "1")
        + plant
        + f"system S {{ node Wa; node Wb; p: P; }}\ntest T {{ system S; {test} }}\n"
    )


def engine_of(text: str) -> Engine:
    return Engine(system_of_test(check_file("walkers.soter", text), "T"))


BOTH = "horizon 60ms; always a <= 9; "


def test_parts_are_the_sum_and_not_the_product() -> None:
    engine = engine_of(walkers(BOTH + "always a < 9 || b < 3 || p < 9;"))
    whole = engine.explore(EngineSettings())
    explorations = ComposedSearch(engine, EngineSettings(), None).search_parts(math.inf)
    assert explorations is not None
    assert [f.status for f in explorations] == ["exhausted"] * 3
    assert whole.status == "exhausted"
    assert sum(f.states for f in explorations) < whole.states / 2
    assert bool(engine.seen.judged[1])


@pytest.mark.parametrize(
    ("joint", "broken"),
    [
        ("always !(a == 6 && b == 1)", True),
        ("always !(a == 6 && b == 2 && p == 2)", True),
        ("always !(a == 5 && b == 0 && p == 1)", True),  # b has one release before
        ("always !(a == 4 && b == 2)", True),
        ("always !(a == 9 && b == 0 && p == 1)", False),  # a is there later than p
        ("always !(a >= 1 && b == 3)", False),
        ("never a == 9 && b == 3", False),
    ],
)
def test_a_combination_is_violated_iff_it_is_reached_at_one_time(
    joint: str,
    broken: bool,
) -> None:
    engine = engine_of(walkers(f"{BOTH} {joint};"))
    assert engine.explore(EngineSettings()).status == ("violated" if broken else "exhausted")
    assert ComposedSearch.can_search(engine, EngineSettings())
    explorations = ComposedSearch(engine, EngineSettings(), None).search_parts(math.inf)
    assert explorations is not None
    assert explorations[-1].status == ("violated" if broken else "exhausted")
    if broken:
        assert explorations[-1].broken == (0, 1)
        possible, breaks, _ = replay(engine, explorations[-1].steps, (0, 1))
        assert possible == len(explorations[-1].steps) > 0
        assert breaks


def test_a_violation_of_one_part_alone_comes_first() -> None:
    engine = engine_of(walkers("horizon 60ms; always a <= 3; always a < 9 || b < 3;"))
    explorations = ComposedSearch(engine, EngineSettings(), None).search_parts(math.inf)
    assert explorations is not None
    assert explorations[-1].broken == (0, 0)
    possible, breaks, _ = replay(engine, explorations[-1].steps, (0, 0))
    assert (possible, breaks) == (len(explorations[-1].steps), True)


def test_a_person_is_told_how_many_parts_there_are() -> None:
    text = walkers(BOTH + "always a < 9 || b < 3 || p < 9;")
    with Search(system_of_test(check_file("walkers.soter", text), "T"), SearchOptions()) as search:
        outcome = search.run()
        assert outcome.status == "exhausted"
        assert not outcome.closable, "no longer horizon would show that it holds for ever"
        assert search.parts == 3


@pytest.mark.parametrize(
    ("test", "why"),
    [
        (BOTH + "skew 10ms; always a < 9 || b < 3;", "windows"),
        (BOTH + "late Wa by 10ms; always a < 9 || b < 3;", "windows"),
        (BOTH + "always a < 9 || b < 3 || time < 0.05;", "time"),
        (BOTH + "a == 1 leadsto b == 1 within 30ms; always a < 9 || b < 3;", "deadlines"),
    ],
)
def test_where_more_is_shared_all_of_it_is_explored(test: str, why: str) -> None:
    engine = engine_of(walkers(test))
    assert not ComposedSearch.can_search(engine, EngineSettings()), why


def test_with_several_starts_nothing_is_joined() -> None:
    test = "horizon 40ms; always a < 9 || p < 9;"
    load = walkers(test).replace("next s", "state load: float in [0.0, 1.0];\n  next s")
    engine = engine_of(load)
    assert ComposedSearch.can_search(engine, EngineSettings())
    assert ComposedSearch(engine, EngineSettings(), None).search_parts(math.inf) is None


@pytest.mark.parametrize(
    "changed", [{"strategy": "random"}, {"reduction": "groups"}, {"memory": 2**20}]
)
def test_other_searches_join_nothing(changed: dict[str, str]) -> None:
    engine = engine_of(walkers(BOTH + "always a < 9 || b < 3;"))
    assert ComposedSearch.can_search(engine, EngineSettings())
    assert not ComposedSearch.can_search(engine, EngineSettings(**changed))  # type: ignore[arg-type]


LONG = """soter 1;
type Small = int in [0, 3];
topic x: Small;
topic y: Small;
node A period 1ms { publishes x; step { publish x = choose [0, 3]; } }
node B period 1ms { publishes y; step { publish y = choose [0, 3]; } }
system S { node A; node B; }
test T { system S; horizon 60s; always x + y <= 6; }
"""
"""Few configurations at a time, and very many times."""


def test_where_what_is_noted_is_too_much_the_parts_are_joined_as_others_are() -> None:
    system = system_of_test(check_file("long.soter", LONG), "T")
    for memory, parts in ((2**24, 1), (2**26, 2)):
        with Search(system, SearchOptions(memory=memory)) as search:
            assert search.run().status == "exhausted"
            assert search.parts == parts
