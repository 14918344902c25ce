"""Sampling that is guided by robustness: what it finds that chance does not, and by what seed."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from soter.explore.engine.explorer_library import Engine, EngineSettings
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from soter.explore.engine.explorer_library import Searched
    from soter.explore.results import Robustness

FAR = """soter 1;
topic u: float in [-1.0, 1.0] = 0.0;
topic place: float;
plant Point period 10ms {
  reads u; drives place = x;
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.1, 0.1];
  der x = v;
  der v = u + wind;
}
node Any period 20ms { publishes u; step { publish u = choose { 1.0, -1.0 }; } }
fun Near(x: float): bool { return abs(x) < 0.9; }
system S { p: Point; any: Any; until 2s; }
test Far { system S; horizon 1500ms; always Near(p.truth.x); }
test Between { system S; horizon 1500ms; never p.truth.x > 0.15 && p.truth.v < -0.4; }
test Park {
  system S;
  horizon 1500ms;
  never abs(p.truth.x - 0.3) < 0.004 && abs(p.truth.v) < 0.01 && time > 1.3;
}
test Among {
  system S;
  horizon 1500ms;
  never p.truth.x > 50.0 || p.truth.x < -50.0 || p.truth.v > 50.0 || p.truth.v < -50.0
      || (abs(p.truth.x - 0.3) < 0.004 && abs(p.truth.v) < 0.01 && time > 1.3);
}
test Back {
  system S;
  horizon 1500ms;
  (p.truth.v > 0.3) leadsto p.truth.v < 0.1 within 1100ms;
}
test Never { system S; horizon 500ms; always Near(p.truth.x); }
"""
SLOW = """soter 1;
topic x: int in [0, 9];
topic y: int in [0, 20];
node Source period 10ms { publishes x; step { publish x = choose [0, 4]; } }
node Adder period 20ms {
  subscribes x; publishes y;
  assumes x <= 3;
  step { publish y = x + choose [0, 2]; }
}
system S { source: Source; adder: Adder; until 100ms; }
test Contract { system S; skew 5ms; horizon 60ms; }
test Times { system S; late adder by 30ms; horizon 60ms; skip source at most 2; always y <= 5; }
"""


MIXED = """soter 1;
topic seen: float;
input topic goal: float in [-1.0, 1.0] = 0.0;
topic push: float in [-2.0, 2.0] = 0.0;
plant Point period 10ms {
  reads push; drives seen = x;
  state x: float = 0.0;
  disturbance wind: float in [-0.5, 0.5];
  der x = push + wind;
  measured seen within 0.1;
}
node Follower period 20ms {
  subscribes seen, goal; publishes push;
  step { publish push = clamp(4.0 * (goal - seen), -2.0, 2.0); }
}
system S { p: Point; follower: Follower; until 2s; }
test All {
  system S;
  horizon 1s;
  input goal every 100ms;
  late follower by 20ms;
  skip follower at most 2;
  always abs(p.truth.x) < 1.2;
}
"""
FLAT = """soter 1;
topic a: bool;
topic n: int in [0, 9];
node Any period 10ms {
  publishes a, n;
  guarantees n <= 9;
  step { publish a = choose bool; publish n = choose [0, 5]; }
}
system S { any: Any; until 1s; }
test Told { system S; horizon 60ms; never a && !a; always n < 8; }
test Flat { system S; horizon 60ms; never a && !a; }
test Found { system S; horizon 60ms; never a; always n < 8; }
"""


def search(
    text: str, test: str, strategy: str, runs: int, seed: int = 1, *, unguided: bool = False
) -> Searched:
    engine = Engine(system_of_text(text, test))
    settings = EngineSettings(strategy=strategy, runs=runs, seed=seed, unguided=unguided)
    try:
        exploration = engine.explore(settings)
        if exploration.status == "violated":
            assert engine.replay(exploration.steps, seed)[1] == exploration.broken
    finally:
        engine.close()
    return exploration


@pytest.mark.parametrize("test", ["Far", "Between", "Back"])
def test_it_finds_what_chance_does_not_find_in_as_many_executions(test: str) -> None:
    runs = 600
    for seed in (1, 2):
        assert search(FAR, test, "random", runs, seed).status == "runs"
        assert search(FAR, test, "falsify", runs, seed).status == "violated"


def test_robustness_leads_to_a_place_that_simple_plans_alone_do_not_meet() -> None:
    for seed in (3, 4, 5):
        assert search(FAR, "Park", "falsify", 2_500, seed).status == "violated"


def test_what_cannot_be_violated_does_not_keep_it_from_what_can() -> None:
    for seed in (1, 3):
        assert search(FAR, "Among", "falsify", 1_500, seed).status == "violated"


def test_without_its_guide_it_does_not_get_there() -> None:
    for seed in (3, 4, 5):
        assert search(FAR, "Park", "falsify", 2_500, seed, unguided=True).status == "runs"


def test_the_same_seed_makes_the_same_search() -> None:
    first, again = (search(FAR, "Between", "falsify", 600, 3) for _ in range(2))
    assert (first.steps, first.runs, first.states) == (again.steps, again.runs, again.states)
    other = search(FAR, "Between", "falsify", 600, 4)
    assert other.steps != first.steps


def test_where_nothing_is_wrong_it_makes_all_its_runs_and_is_never_clean() -> None:
    exploration = search(FAR, "Never", "falsify", 2_000)
    assert (exploration.status, exploration.runs) == ("runs", 2_000)


@pytest.mark.parametrize("test", ["Contract", "Times"])
def test_contracts_and_lateness_are_sampled_as_well(test: str) -> None:
    assert search(SLOW, test, "falsify", 500).status == "violated"


def test_inputs_errors_disturbances_lateness_and_loss_go_together() -> None:
    for seed in (1, 2):
        assert search(MIXED, "All", "random", 600, seed).status == "runs"
        assert search(MIXED, "All", "falsify", 600, seed).status == "violated"


def nearest(text: str, test: str, runs: int = 300) -> dict[str, Robustness]:
    with Search(
        system_of_text(text, test), SearchOptions(strategy="falsify", runs=runs)
    ) as searched:
        outcome = searched.run()
        told = {r.text: r for r in searched.robustness()}
    assert (outcome.status == "violated") == any(
        r.least is not None and r.least < 0.0 for r in told.values()
    )
    return told


def test_what_compares_no_numbers_is_named_and_not_followed() -> None:
    told = nearest(FLAT, "Told")
    assert {t: r.guided for t, r in told.items()} == {
        "never a && !a": False,
        "always n < 8": True,
        "guarantees n <= 9 in any": False,
    }
    assert told["never a && !a"].least is None
    least = told["always n < 8"].least
    assert least is not None
    assert least == pytest.approx(3 / 8), "5 of 8, and 8 is the widest distance"
    flat = nearest(FLAT, "Flat")
    assert not any(r.guided for r in flat.values())


def test_a_bool_is_violated_all_the_same() -> None:
    assert search(FLAT, "Found", "falsify", 300).status == "violated"


def test_only_falsify_tells_how_near_it_came() -> None:
    with Search(
        system_of_text(FLAT, "Told"), SearchOptions(strategy="random", runs=10)
    ) as searched:
        searched.run()
        assert searched.robustness() == ()


@pytest.mark.parametrize("seed", range(6))
def test_the_least_robustness_is_negative_iff_the_property_was_violated(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 - a test
    limits = [rng.choice((0.1, 0.2, 0.35, 0.5, 3.0)) for _ in range(3)]
    x, v, both = limits
    stated = f"always abs(p.truth.x) < {x}; never p.truth.v > {v}; "
    stated += f"always p.truth.x < {both} || p.truth.v < {both};"
    text = FAR.replace(
        "test Far {", f"test Some {{ system S; horizon 600ms; {stated} }} test Far {{"
    )
    engine = Engine(system_of_text(text, "Some"))
    known: list[tuple[int, int]] = []
    while True:
        settings = EngineSettings(strategy="falsify", runs=400, seed=seed, known=tuple(known))
        exploration = engine.explore(settings)
        if exploration.broken is None:
            break
        known.append(exploration.broken)
    least: dict[tuple[int, int], float] = {}
    for aim, near in zip(engine.generated.aims, engine.seen.nearest.tolist(), strict=True):
        key = (aim.what, aim.index)
        least[key] = min(least.get(key, near), near)
    engine.close()
    assert {key for key, near in least.items() if near < 0.0} == set(known)


LATE = """soter 1;
topic h: float in [-50.0, 50.0];
topic u: float in [-1.0, 1.0];
plant Tank period 50ms {
  reads u; drives h = clamp(x, -50.0, 50.0); state x: float; der x = u;
}
node Ctl period 100ms { publishes u; step { publish u = choose { 1.0, -1.0 }; } }
system S { t: Tank; node Ctl; until 10s; }
test Answer { system S; horizon 2s; abs(h) > 0.3 leadsto abs(h) < 0.3 within 800ms; }
test Late { system S; skew 20ms; horizon 2s; abs(h) > 0.3 leadsto abs(h) < 0.3 within 800ms; }
test End { system S; horizon 2s; eventually h > 1.5 within 2s; }
test Reach { system S; horizon 2s; eventually h > 1.5 within 1900ms; }
test Both { system S; horizon 2s; eventually h > 1.9 within 1500ms; eventually h < 9.0 within 1s; }
"""


@pytest.mark.parametrize("test", ["Answer", "Late", "End", "Reach", "Both"])
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_deadline_that_was_missed_is_below_zero_and_one_that_was_kept_above(
    test: str, seed: int
) -> None:
    options = SearchOptions(strategy="falsify", runs=300, seed=seed)
    with Search(system_of_text(LATE, test), options) as searched:
        outcome = searched.run()
        told = searched.robustness()
    assert outcome.status == "violated"
    assert outcome.broken is not None
    least = [r.least for r in told]
    below = [i for i, r in enumerate(least) if r is not None and r < 0.0]
    assert below == [outcome.broken[1]], least
    assert all(r != 0.0 for r in least)


def test_a_promise_that_is_kept_in_the_last_instant_of_its_time_is_kept() -> None:
    text = """soter 1;
topic n: int in [0, 9];
node Count period 10ms {
  publishes n; var k: int in [0, 9]; step { k = min(k + 1, 9); publish n = k; }
}
system S { node Count; until 1s; }
test In { system S; horizon 60ms; eventually n == 4 within 30ms; }
test Out { system S; horizon 60ms; eventually n == 4 within 20ms; }
"""
    kept, missed = (nearest(text, test, 5).popitem()[1].least for test in ("In", "Out"))
    assert kept is not None
    assert missed is not None
    assert 0.0 < kept < 1e-3
    assert missed == pytest.approx(-0.5), "10 ms over, of 20 ms"
