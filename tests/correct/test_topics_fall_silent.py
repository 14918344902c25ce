"""A robot whose place and speed come in two topics, one of which falls silent for a while.

A decision module that pairs an old place with a new speed gives AC control where it should not: of
seeds 0 to 39 eight ended behind the wall, before it compared the two stamps.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from soter import load
from soter.cli.main import main
from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """soter 1;
topic place: float max_age 1s;
topic speed: float in [-2.0, 40.0] max_age 1s;
type Pedals = { gas: float, brake: float };
topic pedals: Pedals in [0.0, 1.0] = { gas: 0.0, brake: 1.0 };
node Push period 20ms { publishes pedals; step { publish pedals = { gas: 1.0, brake: 0.0 }; } }
node Stop period 50ms { publishes pedals; step { publish pedals = { gas: 0.0, brake: 1.0 }; } }
rta Keep {
  ac Push;
  sc Stop;
  period 50ms;
  safe place < 200.0;
  rest abs(speed) < 0.3 moves place by 0.07 within 30s;
  verify { late dm 1ms, sc 1ms; response dm 1ms, sc 1ms; acts within 1ms; dropout 1s; }
}
plant Car period 5ms {
  reads pedals;
  drives place = x;
  drives speed = v;
  state x: float in [40.0, 60.0];
  state v: float = 16.0;
  der x = v;
  der v = 0.1 * pedals.gas - 2.0 * pedals.brake * v / (abs(v) + 0.1);
  measured place within 0.001, speed within 0.001;
}
system Silences default {
  car: Car;
  module Keep;
  until 16s;
  always car.truth.x < 200.0;
  faults { silent car.TOPIC at 15 per 1min for 1s; }
}
"""


@pytest.mark.parametrize("topic", ["place", "speed"])
def test_no_flight_ends_behind_the_wall_while_one_topic_is_silent(
    topic: str, tmp_path: Path
) -> None:
    path = tmp_path / "silences.soter"
    path.write_text(TEXT.replace("TOPIC", topic))
    flat = system_of(check_file(str(path)), "Silences")
    assert [f.inside for f in flat.faults] == ["as silent as `dropout` says"]
    for seed in (0, 9, 12):
        run = load(path).simulate(seed=seed)
        assert run.violations == 0
        assert any(c.stale for c in run.changes)


def test_a_run_says_which_reads_are_of_another_instant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "silences.soter"
    path.write_text(TEXT.replace("TOPIC", "place"))
    assert main(["run", str(path), "--seed", "9", "--json"]) == 0
    changes = json.loads(capsys.readouterr().out)["mode_changes"]
    stale = [x for c in changes for x in c["why"]["stale"]]
    assert stale
    assert {(x["topic"], x["beside"]) for x in stale} == {("place", "speed")}
