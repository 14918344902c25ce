"""What Soter's own runs and logs say was measured: publications, and nothing in between.

Non-goals: logs of somebody else (`test_estimates_of_logs.py`), the judgement itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip("mcap", reason="the extra `logs` is not installed")

from soter.api import load

if TYPE_CHECKING:
    from pathlib import Path

    from soter.monitor.model_membership import Judgement

PROGRAM = """soter 1;
topic place: float max_age 20ms;
topic speed: float max_age 20ms;
topic push: float in [-1.0, 1.0];
plant Cart period 10ms {{
  reads push;
  drives place = x;
  drives speed = v;
  state x: float;
  state v: float;
  der x = v;
  der v = push - v;
  measured place within 0.001, speed within 0.001;
}}
node Fast period 20ms {{ subscribes place, speed; publishes push; step {{
  publish push = {pushes}; }} }}
node Slow period 20ms {{ subscribes place, speed; publishes push; step {{
  publish push = clamp(-place - speed, -1.0, 1.0); }} }}
rta Keeper {{
  ac Fast;
  sc Slow;
  period 20ms;
  safe abs(place) < 30.0;
  ttf abs(place) > 20.0 || abs(speed) > 90.0;
  safer abs(place) < 15.0;
  verify {{ grid c.x in [-30.0, 30.0] / 60, c.v in [-3.0, 3.0] / 60; }}
}}
system Flight default {{ c: Cart; module Keeper; {faults} until 10s; }}
"""
MOVES, RESTS = "sin(3.0 * time)", "0.0 * place"


def judged(folder: Path, faults: str = "", pushes: str = MOVES, seed: int = 1) -> Judgement:
    """Of the run and of its log, which say the same."""
    path = folder / "cart.soter"
    given = f"faults {{ {faults} }}" if faults else ""
    path.write_text(PROGRAM.format(faults=given, pushes=pushes))
    program = load(path)
    assert program.ok, program.diagnostics
    log = folder / "run.mcap"
    program.simulate(seed=seed, log=log)
    (of_run,) = program.monitor(seed=seed, estimates=True)
    (of_log,) = program.monitor(log, estimates=True)
    assert of_run == of_log
    return of_log


SILENT = "silent c.place at 10 per 60s for 1s;"


def test_a_sensor_that_falls_silent_is_not_compared(tmp_path: Path) -> None:
    """Before, it was as soon as another one spoke: alarms of a model that is true."""
    for seed in (1, 3):  # in some of them it is silent as the run begins
        found = judged(tmp_path, SILENT, seed=seed)
        assert found.steps > 900
        assert found.alarms == 0


def test_while_a_topic_is_silent_beyond_its_age_nothing_counts_as_judged(tmp_path: Path) -> None:
    assert 0.0 < judged(tmp_path, SILENT).judged_share < 0.95
    assert judged(tmp_path).judged_share == 1.0


def test_a_sensor_that_repeats_a_value_says_that_it_is_measured(tmp_path: Path) -> None:
    found = judged(tmp_path, "stuck c.place at 10 per 60s for 1s;")
    assert found.alarms > 0
    assert "c.x" in found.alarm_states


def test_standing_still_is_judged_and_explained(tmp_path: Path) -> None:
    found = judged(tmp_path, pushes=RESTS)
    assert (found.alarms, found.judged_share) == (0, 1.0)
    assert found.steps == 1000
