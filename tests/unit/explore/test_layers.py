"""Breadth-first search keeps one layer of its table: what is found stays the same."""

from __future__ import annotations

from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.language.front_end import check_file, system_of_test

HEAD = "soter 1; type Cell = int in [0, 9];"
WALK = (
    "topic {name}: Cell; node N{name} period {period} {{ publishes {name}; var at: Cell = 0;"
    " step {{ at = choose {{ at, min(9, at + 1), max(0, at - 1) }}; publish {name} = at; }} }}"
)


def engine_of(items: str, *walks: tuple[str, str]) -> Engine:
    text = HEAD + "".join(WALK.format(name=name, period=period) for name, period in walks)
    nodes = " ".join(f"node N{name};" for name, _ in walks)
    text += f"system S {{ {nodes} }} test T {{ system S; {items} }}"
    return Engine(system_of_test(check_file("walks.soter", text), "T"))


def test_its_table_is_much_smaller_than_one_of_all_that_was_found() -> None:
    walks = (("a", "10ms"), ("b", "10ms"), ("c", "20ms"))
    engine = engine_of("horizon 200ms; always a <= 9;", *walks)
    wide = engine.explore(EngineSettings(reduction="sleep"))
    deep = engine.explore(EngineSettings(reduction="sleep", strategy="dfs"))
    assert wide.states == deep.states
    assert wide.table_bytes + wide.frontier_bytes < deep.table_bytes / 2


def test_where_releases_are_lost_by_overruns_all_layers_are_kept() -> None:
    items = "horizon 60ms; overrun Na by 25ms; always a <= 9;"
    engine = engine_of(items, ("a", "10ms"))
    wide, deep = (
        engine.explore(EngineSettings(reduction="none", strategy=s)) for s in ("bfs", "dfs")
    )
    assert wide.status == deep.status == "exhausted"
    assert wide.states == deep.states


def test_what_violates_is_not_expanded_by_a_search_that_goes_on() -> None:
    engine = engine_of("horizon 60ms; skew 5ms; always a != 1;", ("a", "10ms"), ("b", "20ms"))
    for reduction in ("none", "instants"):
        wide, deep = (
            engine.explore(EngineSettings(reduction=reduction, strategy=s, go_on=True))
            for s in ("bfs", "dfs")
        )
        assert wide.status == deep.status == "violated"
        assert wide.states == deep.states


def test_threads_take_in_what_is_theirs_before_a_layer_ends() -> None:
    walks = (("a", "10ms"), ("b", "10ms"), ("c", "10ms"), ("d", "10ms"))
    engine = engine_of("horizon 50ms; always a <= 9;", *walks)
    alone = engine.explore(EngineSettings(reduction="none"))
    for memory in (3 << 20, 1 << 30):
        exploration = engine.explore(EngineSettings(reduction="none", threads=3, memory=memory))
        assert (exploration.status, exploration.threads) == ("exhausted", 3)
        assert (exploration.states, exploration.transitions) == (alone.states, alone.transitions)
