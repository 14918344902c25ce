"""Sampling by simple plans: what it finds that chance does not, and by what seed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.explorer_configurations import replay
from soter.explore.engine.explorer_library import Engine, EngineSettings
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from soter.explore.engine.explorer_library import Searched

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
test Found { system S; horizon 60ms; never a; always n < 8; }
"""


def search(text: str, test: str, strategy: str, runs: int, seed: int = 1) -> Searched:
    engine = Engine(system_of_text(text, test))
    settings = EngineSettings(strategy=strategy, runs=runs, seed=seed)
    try:
        exploration = engine.explore(settings)
        if exploration.status == "violated":
            assert replay(engine, exploration.steps, exploration.broken, seed)[1]
    finally:
        engine.close()
    return exploration


@pytest.mark.parametrize("test", ["Far", "Between", "Back"])
def test_it_finds_what_chance_does_not_find_in_as_many_executions(test: str) -> None:
    runs = 600
    for seed in (1, 2):
        assert search(FAR, test, "random", runs, seed).status == "runs"
        assert search(FAR, test, "falsify", runs, seed).status == "violated"


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


def test_a_bool_is_violated_all_the_same() -> None:
    assert search(FLAT, "Found", "falsify", 300).status == "violated"
