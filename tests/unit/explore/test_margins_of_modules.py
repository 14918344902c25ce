"""`margin(M)` in tests: every AC, every order of steps; nobody takes over before it said."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import soter

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """
soter 1;
topic d: int in [0, 12] max_age 20ms;
topic u: int in [-1, 1] = 0;
topic broken: bool;
plant P period 10ms {
  reads u; drives d = x; state x: int in [0, 12] = 6;
  next x = x + u < 0 ? 0 : (x + u > 12 ? 12 : x + u);
}
node Ac period 10ms { publishes u; step { publish u = choose [-1, 1]; } }
node Sc period 10ms { subscribes d; publishes u; step { publish u = d > 6 ? -1 : 1; } }
node Witness period 5ms {
  publishes broken;
  var until: float = 0.0;
  step {
    publish broken = mode(M) == Mode.SC && time < until - 0.001 + MORE;
    until = margin(M) > 0.0 ? max(until, time + margin(M)) : until;
  }
}
rta M {
  ac Ac; sc Sc; period 30ms;
  safe d < 12; ttf d > 8; safer d < 7;
}
system S { p: P; node Witness; module M; }
test Kept { system S; horizon 240ms; ORDER never broken; }
"""


def tried(folder: Path, *, more: str = "0.0", order: str = "") -> Any:
    path = folder / "margin.soter"
    path.write_text(PROGRAM.replace("MORE", more).replace("ORDER", order), encoding="utf-8")
    (test_result,) = soter.load(path).explore("Kept", output=None).tests
    return test_result


@pytest.mark.parametrize("order", ["", "order deployed;"])
def test_no_order_of_steps_takes_over_before_the_margin_said(tmp_path: Path, order: str) -> None:
    test_result = tried(tmp_path, order=order)
    assert test_result.verdict == "exhausted"
    assert test_result.states > 1000


def test_one_period_more_is_found_to_be_wrong(tmp_path: Path) -> None:
    test_result = tried(tmp_path, more="0.03")
    assert test_result.verdict == "violated"
