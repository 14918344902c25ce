"""The default reduction: which of two it is, and that nobody can tell from what is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from generators.programs_in_instants import program_in_instants
from generators.small_test_programs import small_program
from long_tests import examples, seed_of
from soter.explore.engine import reductions
from soter.explore.engine.explorer_library import Engine, EngineSettings, Searched
from soter.explore.engine.reductions import explore_by_quicker, may_pick_reduction
from soter.language.front_end import check_file, system_of_test

ROOT = Path(__file__).resolve().parents[3]
PROGRAMS = examples(12)
DEFAULT = EngineSettings(closes=True)


def engine_of(path: str, test: str) -> Engine:
    return Engine(system_of_test(check_file(str(ROOT / path)), test))


def said(s: Searched) -> tuple[str, int, int]:
    """What a person is told; of what is violated first there may be several."""
    return s.status, s.covered_ns if s.status == "exhausted" else 0, s.closed_ns


def test_one_group_of_nodes_stores_what_lies_between() -> None:
    engine = engine_of("tests/unit/explore/programs/token_ring.soter", "SomebodyHasAToken")
    found, ends = explore_by_quicker(engine, DEFAULT), engine.explore(DEFAULT)
    assert said(found) == said(ends)
    assert found.states > 10 * ends.states
    assert found.transitions < ends.transitions


def test_groups_that_share_nothing_are_combined() -> None:
    engine = engine_of("examples/testing/two_modules.soter", "BothStayInside")
    found, ends = explore_by_quicker(engine, DEFAULT), engine.explore(DEFAULT)
    assert (found.states, found.transitions) == (ends.states, ends.transitions)
    assert said(found) == said(ends)


def test_steps_that_may_be_late_have_nobody_asleep() -> None:
    engine = engine_of("tests/unit/explore/programs/crossing.soter", "NeverOpen")
    found, plain = (
        explore_by_quicker(engine, DEFAULT),
        engine.explore(EngineSettings(reduction="ample")),
    )
    assert (found.states, found.transitions) == (plain.states, plain.transitions)


@pytest.mark.parametrize("ending", ["violated", "exhausted", "stopped"])
def test_what_ends_show_counts_though_the_larger_search_came_further(
    ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ran out of memory; the search of ends comes to an answer, or is cut short earlier."""
    engine = engine_of("examples/testing/two_modules.soter", "BothStayInside")
    ended = engine.explore(DEFAULT)
    answers = {
        True: replace(ended, status="memory", covered_ns=103),
        False: replace(ended, status=ending, covered_ns=100),
    }
    monkeypatch.setattr(reductions, "_choose_settings", lambda _, s, __: replace(s, between=True))
    monkeypatch.setattr(engine, "explore", lambda how, *_: answers[how.between])
    cut = ending == "stopped"
    assert explore_by_quicker(engine, DEFAULT).status == ("memory" if cut else ending)


@pytest.mark.parametrize(
    "asked",
    [
        {"reduction": "groups"},
        {"strategy": "random"},
        {"storage": "fingerprint"},
        {"max_states": 1000},
        {"known": ((0, 0),)},
        {"keep": True},
        {"plainly": True},
    ],
    ids=str,
)
def test_whoever_asks_for_something_gets_it(asked: dict[str, object]) -> None:
    assert may_pick_reduction(DEFAULT)
    assert not may_pick_reduction(replace(DEFAULT, **asked))  # type: ignore[arg-type]


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize(
    ("program", "test", "closes"),
    [
        ("tests/unit/explore/programs/tank.soter", "NeverFull", False),
        ("examples/testing/three_modules.soter", "Battery", True),
    ],
)
def test_threads_change_nothing_of_the_choice(
    program: str, test: str, closes: bool, threads: int
) -> None:
    engine = engine_of(program, test)
    settings = EngineSettings(closes=closes)
    one, more = (
        explore_by_quicker(engine, settings),
        explore_by_quicker(engine, replace(settings, threads=threads)),
    )
    assert (one.states, one.closed_ns) == (more.states, more.closed_ns)


@pytest.mark.parametrize("seed", range(PROGRAMS))
@pytest.mark.random
def test_random_programs_are_told_the_same_either_way(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reductions, "TRIAL_STEPS", 1)  # nothing ends in the beginnings
    make = program_in_instants if seed % 2 else small_program
    checked = check_file("random.soter", make(seed_of(seed)))
    if not checked.ok:
        pytest.skip("the checker refuses this program (one in 200)")
    engine = Engine(system_of_test(checked, next(iter(checked.tests))))
    bound = replace(DEFAULT, memory=1 << 28)
    ends = engine.explore(bound)
    assert said(explore_by_quicker(engine, bound)) == said(ends)
    middle = replace(bound, between=True)
    for threads in (1, 2, 3):
        assert said(engine.explore(replace(middle, threads=threads))) == said(ends)


def test_where_memory_is_short_only_ends_are_stored_after_all() -> None:
    engine = engine_of("examples/gallery/two_robots.soter", "OldBatteries")
    little = replace(DEFAULT, memory=1800 << 10)
    assert engine.explore(replace(little, between=True)).status == "memory"
    assert engine.explore(little).status == "exhausted"
    assert explore_by_quicker(engine, little).status == "exhausted"


def test_a_violation_that_a_bounded_search_meets_has_the_trace_that_any_search_has() -> None:
    """What was run is bounded of the search alone: the trace may take more."""
    checked = check_file("random.soter", program_in_instants(1))
    engine = Engine(system_of_test(checked, next(iter(checked.tests))))
    whole = engine.explore(DEFAULT)
    assert whole.status == "violated"
    bounded = [engine.explore(replace(DEFAULT, max_ran=n)) for n in range(1, whole.transitions)]
    met = [b for b in bounded if b.status == "violated"]
    assert met
    assert len(met) < len(bounded), "some bounds end the search before"
    assert all(b.steps == whole.steps for b in met)
