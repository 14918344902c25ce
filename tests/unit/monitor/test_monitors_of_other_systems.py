"""A model monitor in a system whose plants are others than those that it was made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.api import load
from soter.cli.main import main

if TYPE_CHECKING:
    from pathlib import Path

MOVED = """soter 1;
param GAIN: float = 1.0 in [0.5, 2.0];
topic pos: float in [-20.0, 20.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
plant Cart period 10ms {
  reads vel; drives pos = clamp(x, -20.0, 20.0); state x: float; der x = GAIN * vel;
}
node Fast period 10ms { publishes vel; step { publish vel = 1.0; } }
node Stop period 10ms { publishes vel; step { publish vel = 0.0; } }
rta Guard {
  ac Fast; sc Stop; period 50ms;
  safe abs(pos) < 10.0; ttf abs(pos) > 9.0; safer abs(pos) < 8.0;
  verify { grid c.x in [-11.0, 11.0] / 200; }
}
system Track { c: Cart; module Guard; until 1s; }
"""


def test_a_system_of_which_no_monitor_can_be_made_is_warned_of_and_the_others_run(
    tmp_path: Path,
) -> None:
    (tmp_path / "cart.soter").write_text(MOVED)
    load(tmp_path / "cart.soter").emit_monitor(tmp_path / "watch.soter")
    path = tmp_path / "watched.soter"
    path.write_text("""soter 1;
import "cart.soter" as m;
import "watch.soter" as w;
plant Bent period 10ms {
  reads m.vel; drives m.pos = clamp(x, -20.0, 20.0); state x: float; der x = m.vel * abs(x);
}
system Straight default { c: m.Cart; module m.Guard; node w.ModelMonitor; until 1s; }
system Crooked { c: Bent; module m.Guard; node w.ModelMonitor; set m.GAIN = 1.5; until 1s; }
""")
    program = load(path)
    assert program.ok
    (warning,) = program.diagnostics
    assert (warning.code, "`Crooked`" in warning.message) == ("D022", True)
    assert main(["run", str(path)]) == 0


OTHER = "system Other { c: Cart; module Guard; until 1s; }"
FLOWN = MOVED.replace("system Track", f"{OTHER}\nsystem Track default")


def test_a_log_of_another_flight_is_told_beside_its_verdict(tmp_path: Path) -> None:
    """Its alarms are no word on the model; nor is a log of another program that raises none."""
    log, path = tmp_path / "f.mcap", tmp_path / "p.soter"
    path.write_text(FLOWN)
    for params, system in (({"GAIN": 2.0}, "Track"), ({}, "Other"), ({}, "Track")):
        load(path).simulate(log=log, params=params, system=system)
        (same,) = load(path).monitor(log, system=system, params=params)
        assert same.notes == ()
        (m,) = load(path).monitor(log)
        told = [f"param GAIN is {p} in the log, the default here" for p in params.values()]
        told += [f"system is {s} in the log, Track here" for s in [system] if s != "Track"]
        assert [n.partition(": ")[2] for n in m.notes] == told
        assert (m.alarms > 0) == bool(params)
    path.write_text(FLOWN.replace("< 8.0", "< 7.5"))
    (m,) = load(path).monitor(log)
    assert "what is judged is not what flew: program_sha256 is" in m.notes[0]
