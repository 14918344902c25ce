"""What a run tells of a latch: what it waits for at every step of its DM, and where in a report."""

from __future__ import annotations

import pytest

from soter.language.front_end import check_file, system_of
from soter.simulate.decisions import decision_steps, latched_rows
from soter.simulate.run import NativeProgram, run_interpreted
from soter.simulate.run_report import run_chart

CART = """soter 1;
topic pos: float in [-50.0, 50.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
input topic button: bool max_age 400ms;
plant Cart period 10ms { reads vel; drives pos = x; state x: float; der x = vel; }
node Fast period 10ms { publishes vel; step { publish vel = 1.0; } }
node Back period 10ms {
  subscribes pos;
  publishes vel;
  step { publish vel = clamp(-pos, -1.0, 1.0); }
}
rta Guard {
  ac Fast;
  sc Back;
  period 50ms;
  safe abs(pos) < 3.0;
  ttf abs(pos) > 2.0;
  safer abs(pos) < 1.0;
  RETURNS
}
system Track { c: Cart; module Guard; input button every 300ms; until 60s; }
"""
S = 10**9
WORDS = {
    "returns after button;": {
        "latched: waits for button to be released and pressed",
        "latched: waits for button to be pressed",
        "not safer yet",
        "not safer yet and latched: waits for button to be released and pressed",
        "not safer yet and latched: waits for button to be pressed",
        "safer: far enough inside φ_safe",
        "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)",
        "",
    },
    "returns never;": {
        "latched: it returns never",
        "not safer yet and latched: it returns never",
        "safer: far enough inside φ_safe",
        "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)",
        "",
    },
    "": {
        "not safer yet",
        "safer: far enough inside φ_safe",
        "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)",
        "",
    },
}


@pytest.mark.parametrize("returns", WORDS)
def test_every_step_says_what_the_latch_waits_for(returns: str) -> None:
    system = system_of(check_file("track.soter", CART.replace("RETURNS", returns)), None)
    run = NativeProgram(system).run(60 * S, 3, keep_trace=True)
    told = list(decision_steps(run.system, run.require_trace()))
    assert {d.reason for d in told} == WORDS[returns]
    again = run_interpreted(system, 5 * S, 3, keep_trace=True)
    assert list(decision_steps(system, again.require_trace())) == told[: 5 * 20 + 1]


@pytest.mark.parametrize("returns", WORDS)
def test_a_report_shows_where_it_waits(returns: str) -> None:
    system = system_of(check_file("track.soter", CART.replace("RETURNS", returns)), None)
    run = NativeProgram(system).run(60 * S, 3, keep_trace=True)
    chart = run_chart(run)
    shown = [s.values for s in chart.series if s.name == "latched(Guard)"]
    assert len(shown) == bool(returns)
    trace = run.require_trace()
    if returns:
        values = shown[0]
        assert 0 < values.sum() < len(trace)
        assert (values.astype(bool) == latched_rows(system.modules[0], trace)).all()
        assert not values[trace["modules"]["mode"][:, 0] == 1].any()
    assert not any("Guard.latch" in s.name for s in chart.series)
