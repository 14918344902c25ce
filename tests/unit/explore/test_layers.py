"""Breadth-first search keeps one layer of its table: what is found stays the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from generators.explorer_configurations import stored_configurations
from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.search_options import REDUCTIONS
from soter.language.front_end import check_file, system_of_test
from tables import all_rows

ROOT = Path(__file__).resolve().parents[3]
HEAD = "soter 1; type Cell = int in [0, 9];"
WALK = (
    "topic {name}: Cell; node N{name} period {period} {{ publishes {name}; var at: Cell = 0;"
    " step {{ at = choose {{ at, min(9, at + 1), max(0, at - 1) }}; publish {name} = at; }} }}"
)


def engine_of(items: str, *walks: tuple[str, str], head: str = HEAD) -> Engine:
    text = head + "".join(WALK.format(name=name, period=period) for name, period in walks)
    nodes = " ".join(f"node N{name};" for name, _ in walks)
    text += f"system S {{ {nodes} }} test T {{ system S; {items} }}"
    return Engine(system_of_test(check_file("walks.soter", text), "T"))


def test_its_table_is_much_smaller_than_one_of_all_that_was_found() -> None:
    walks = (("a", "10ms"), ("b", "10ms"), ("c", "20ms"))
    engine = engine_of("horizon 200ms; always a <= 9;", *walks)
    wide = engine.explore(EngineSettings(reduction="sleep", keep=True))
    kept = {w.tobytes() for w in stored_configurations(engine)}
    assert len(kept) == wide.states
    each = 8 * int(engine.model.words)
    assert wide.table_bytes + wide.frontier_bytes < wide.states * each / 2


def test_where_releases_are_lost_by_overruns_all_layers_are_kept() -> None:
    items = "horizon 60ms; overrun Na by 25ms; always a <= 9;"
    engine = engine_of(items, ("a", "10ms"))
    wide = engine.explore(EngineSettings(reduction="none", keep=True))
    kept = {w.tobytes() for w in stored_configurations(engine)}
    assert wide.status == "exhausted"
    assert wide.states == len(kept)


def test_what_violates_is_not_expanded_by_a_search_that_goes_on() -> None:
    engine = engine_of("horizon 60ms; skew 5ms; always a != 1;", ("a", "10ms"), ("b", "20ms"))
    for reduction in ("none", "instants"):
        wide, plain = (
            engine.explore(EngineSettings(reduction=reduction, plainly=p, go_on=True))
            for p in (False, True)
        )
        assert wide.status == plain.status == "violated"
        assert wide.states == plain.states


def test_threads_take_in_what_is_theirs_before_a_layer_ends() -> None:
    walks = (("a", "10ms"), ("b", "10ms"), ("c", "10ms"), ("d", "10ms"))
    engine = engine_of("horizon 50ms; always a <= 9;", *walks)
    alone = engine.explore(EngineSettings(reduction="none"))
    for memory in (3 << 20, 1 << 30):
        exploration = engine.explore(EngineSettings(reduction="none", threads=3, memory=memory))
        assert (exploration.status, exploration.threads) == ("exhausted", 3)
        assert (exploration.states, exploration.transitions) == (alone.states, alone.transitions)


def stored(engine: Engine, reduction: str, threads: int, memory: int) -> list[bytes]:
    """All configurations that a search stores, in order."""
    how = EngineSettings(reduction=reduction, threads=threads, memory=memory, keep=True)
    exploration = engine.explore(how)
    assert (exploration.status, exploration.threads) == ("exhausted", threads)
    rows = sorted(row.tobytes() for row in stored_configurations(engine))
    assert len(rows) == exploration.states
    return rows


@all_rows(("most", "words"), [("9", 1), ("999999999", 2)])
@all_rows("reduction", REDUCTIONS)
def test_threads_store_the_configurations_that_one_stores(
    reduction: str, most: str, words: int
) -> None:
    """With little memory they hand over often."""
    head = HEAD.replace("9]", f"{most}]")
    walks = (("a", "10ms"), ("b", "10ms"), ("c", "20ms"))
    engine = engine_of("horizon 60ms; always a <= 9;", *walks, head=head)
    assert min(engine.words, 2) == words
    alone = stored(engine, reduction, 1, 1 << 30)
    assert len(alone) > 500
    for threads, memory in ((2, 1 << 30), (3, 8 << 20)):
        assert stored(engine, reduction, threads, memory) == alone


WALKS = (("a", "10ms"), ("b", "10ms"), ("c", "20ms"))
OFTEN = 60
"""Threads meet differently each time."""


@pytest.mark.parametrize("reduction", ["none", "sleep", "instants"])
@pytest.mark.parametrize("threads", [2, 3])
def test_threads_count_what_all_have_taken_in_before_a_bound_is_looked_at(
    reduction: str, threads: int
) -> None:
    engine = engine_of("horizon 60ms; always a + b <= 9;", *WALKS)
    how = EngineSettings(reduction=reduction, max_states=50)
    alone = engine.explore(how)
    assert alone.status == "states"
    for _ in range(OFTEN):
        more = engine.explore(replace(how, threads=threads))
        assert (more.status, more.states, more.depth) == ("states", alone.states, alone.depth)


def test_threads_give_a_configuration_of_several_words_to_one_of_them() -> None:
    head = "soter 1; type Cell = int in [0, 999999999];"
    engine = engine_of("horizon 60ms; always a <= 9;", *WALKS, head=head)
    how = EngineSettings(reduction="none", keep=True)
    alone = engine.explore(how)
    for threads in (2, 3, 4) * (OFTEN // 3):
        assert engine.explore(replace(how, threads=threads)).states == alone.states
