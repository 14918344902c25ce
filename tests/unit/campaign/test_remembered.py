"""What a campaign does not compute again is what would have come out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.campaign import compiled_unit
from soter.campaign.batch_flights import Fleet
from soter.campaign.compiled_unit import generate_measured
from soter.codegen.unit import UnitBuilder
from soter.language.front_end import check_file, system_of
from soter.simulate.run import run_interpreted

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

SECOND = 10**9
PLANS = """soter 1;
type Plan = Vec3[<=12];
input topic wind: float in [-4.0, 4.0];
topic plan: Plan in [-100.0, 100.0];
topic limit: float in [0.0, 20.0] = 6.0;
topic said: float in [-100.0, 100.0];

fun Longest(p: Plan, most: float): float {
  var far = 0.0;
  for i in 0..12 {
    for j in 0..12 {
      if i < p.len && j < p.len {
        far = max(far, norm(p[i] - p[j]));
      }
    }
  }
  assert(far < 0.5 || far > 1.5);
  return far - most;
}

node Bold period 100ms {
  subscribes wind;
  publishes plan;
  var at: float;
  var held: Plan;
  var count: int in [0, 5];
  step {
    count = (count + 1) % 5;
    if count == 0 {
      at = wind;
      held = [];
      for i in 0..4 {
        push held, vec3(at * float(i), 1.0, 0.0);
      }
    }
    publish plan = held;
  }
}
node Calm period 100ms {
  publishes plan;
  step {
    var p: Plan = [];
    push p, vec3(0.0, 0.0, 0.0);
    publish plan = p;
  }
}
node Bounds period 300ms {
  subscribes wind;
  publishes limit, said;
  var k: int in [0, 3];
  step {
    k = (k + 1) % 4;
    if k != 1 { publish limit = 4.0 + abs(wind); }
    publish said = wind;
  }
}
rta Planning {
  ac Bold;
  sc Calm;
  period 100ms;
  safe Longest(plan, 20.0) < 0.0;
  ttf Longest(plan, limit) > 0.0;
  safer Longest(plan, limit) < -1.0;
}
system Whole default {
  node Bounds;
  module Planning;
  input wind every 50ms;
  until 20s;
  always Longest(plan, limit) < 2.5;
  always said < 3.5;
  never said > 2.0 && limit < 7.0;
}
"""


@pytest.fixture
def whole(tmp_path: Path) -> System:
    file = tmp_path / "plans.soter"
    file.write_text(PLANS, encoding="utf-8")
    return system_of(check_file(str(file)), "Whole")


def test_a_dear_call_of_a_dm_and_what_only_nodes_say_are_remembered(whole: System) -> None:
    source = generate_measured(whole).source
    assert "plans_Longest_fn_anew" in source
    assert source.count(".active != 0U") == 3
    assert "_anew" not in generate_measured(whole, remembers=False).source


def test_flights_that_remember_are_those_of_the_interpreter(whole: System) -> None:
    flights = Fleet(whole, 20 * SECOND).fly(range(12), first_seed=3)
    assert sum(f.violations for f in flights) > 12
    assert any(0 < f.ac_s[0] < 20 for f in flights)
    for flight in flights:
        run = run_interpreted(whole, 20 * SECOND, flight.seed)
        assert flight.violations == run.violations
        assert list(flight.broken) == [v.what for v in run.violation_list for _ in range(v.count)]
        assert flight.ac_s[0] / 20 == pytest.approx(next(iter(run.modules.values())).ac_share)


def test_every_event_is_that_of_flights_that_remember_nothing(
    whole: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights = Fleet(whole, 20 * SECOND).fly(range(40), first_seed=1)
    monkeypatch.setattr(compiled_unit, "_expensive_functions", lambda _: frozenset())
    monkeypatch.setattr(
        compiled_unit.MeasuredUnitBuilder, "property_function", UnitBuilder.property_function
    )
    assert "_anew" not in generate_measured(whole).source
    assert Fleet(whole, 20 * SECOND).fly(range(40), first_seed=1) == flights
