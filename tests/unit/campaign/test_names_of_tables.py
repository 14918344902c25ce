"""A program may call its own things as C's extra tables are called.

Non-goals: names of C and of its headers, which random programs draw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import soter
from generators.flights_of_runs import figures, figures_of
from soter.campaign.batch_flights import Fleet
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("measured", "measures", "measure_0", "measure_1", "safe_0", "safes", "model", "program")
PROGRAM = """soter 1;
{declared}
topic at: float max_age 100ms;
topic go: float in [-1.0, 1.0] = 0.0;
plant Body period 10ms {{
  reads go;
  drives at = x;
  state x: float in [-0.5, 0.5];
  disturbance w: float in [-0.1, 0.1];
  der x = go + w;
}}
node Push period 10ms {{ subscribes at; publishes go; step {{ publish go = {used}; }} }}
node Hold period 10ms {{ subscribes at; publishes go; step {{ publish go = -at * 0.5; }} }}
rta Guard {{
  period 20ms;
  ac Push;
  sc Hold;
  safe at < 3.0;
  ttf at > 1.0;
  safer at < 0.5;
}}
system S {{
  p: Body;
  module Guard;
  until 200ms;
  measure far = abs(p.truth.x) in [0.0, 5.0] / 50 every 10ms;
  measure near = p.truth.x in [0.0, 5.0] / 50 every 10ms;
}}
"""


def test_a_program_flies_whatever_its_parameters_are_called(tmp_path: Path) -> None:
    file = tmp_path / "named.soter"
    declared = "\n".join(f"param {name}: float = 0.0625 in [0.0, 1.0];" for name in NAMES)
    used = "clamp(-at * (" + " + ".join(NAMES) + "), -1.0, 1.0)"
    file.write_text(PROGRAM.format(declared=declared, used=used), encoding="utf-8")
    system = soter.load(file).flat("S")
    run = NativeProgram(system, "-O1").run(200_000_000, 1, keep_trace=True)
    (flight,) = Fleet(system, 200_000_000, "-O1").fly(range(1), first_seed=1)
    assert figures_of(flight) == figures(run)
