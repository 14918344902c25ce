"""`soter verify --synthesize`: controllers that are found, written, and then proved."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.cli.main import main
from soter.verify.synthesized_sc import CellCommands, block_law

if TYPE_CHECKING:
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic

WALLS = """soter 1;
// A cart between two walls, the wind in its back.
const A: float = 3.0;
type Motion = { x: float, v: float };
topic motion: Motion max_age 20ms;
topic accel: float in [-A, A] = 0.0;
plant Cart period 5ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.2, 0.2];
  der x = v;
  der v = accel + wind;
}
node Fast period 10ms { publishes accel; step { publish accel = A; } }
rta Safe {
  ac Fast;
  sc synthesized period 10ms;
  period 50ms;
  safe abs(motion.x) < 2.0;
  verify {
    grid motion.x in [-2.0, 2.0] / 100, motion.v in [-4.0, 4.0] / 100;
    commands accel in { -3.0, 0.0, 3.0 };
  }
}
system S default { c: Cart; module Safe; until 20s; always abs(c.truth.x) < 2.0; }
system Forced { c: Cart; module Safe; force Safe sc; until 20s; always abs(c.truth.x) < 2.0; }
"""


@pytest.fixture
def walls(tmp_path: Path) -> Path:
    path = tmp_path / "walls.soter"
    path.write_text(WALLS)
    return path


@pytest.mark.long
def test_a_controller_between_two_walls_is_found_written_and_proved(walls: Path) -> None:
    path, table = soter.load(walls).synthesize()
    assert (path.name, table.name) == ("walls_sc.soter", "SafeSC.npy")
    program = soter.load(path)
    assert program.diagnostics == ()
    assert program.format() == path.read_text()
    (result,) = program.verify(refute=False).modules
    assert result.findings["P2a"].verdict == "proved"
    assert result.core_share > 0.5
    assert program.simulate("Forced", seed=2, trace=False).violations == 0


def test_the_same_program_gives_the_same_bytes(walls: Path) -> None:
    program = soter.load(walls)
    first = [p.read_bytes() for p in program.synthesize()]
    assert [p.read_bytes() for p in program.synthesize()] == first


def test_without_an_open_controller_nothing_is_written(walls: Path) -> None:
    path, _ = soter.load(walls).synthesize()
    assert soter.load(path).synthesize() == ()


def test_the_command_verifies_what_it_wrote(
    walls: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    exit_code = main(["verify", str(walls), "--synthesize", "-o", str(walls.with_name("w.soter"))])
    out = capsys.readouterr().out
    assert exit_code in (0, 4)
    assert "w.soter" in out
    assert "SafeSC.npy" in out
    assert (walls.with_name("w.soter")).exists()


def test_another_node_of_that_name_is_left_alone(walls: Path) -> None:
    walls.write_text(WALLS.replace("node Fast", "const SafeSC: float = 1.0;\nnode Fast"))
    path, table = soter.load(walls).synthesize()
    assert table.name == "SafeSC_.npy"
    assert "sc SafeSC_;" in path.read_text()


BOAT = """soter 1;
type Pull = { along: float, across: Vec2 };
topic pose: Vec2 max_age 10ms;
topic pull: Pull in { along in [-1.0, 1.0], across in [-1.0, 1.0] };
plant Boat period 20ms {
  reads pull;
  drives pose = { x: x, y: y };
  state x: float = 0.0;
  state y: float = 0.0;
  disturbance stream: float in [-0.3, 0.3];
  next x = x + 0.2 * pull.along + 0.1 * stream;
  next y = y + 0.1 * pull.across.x - 0.1 * pull.across.y;
}
node Drift period 20ms {
  publishes pull;
  step { publish pull = { along: 1.0, across: { x: 1.0, y: 0.0 } }; }
}
rta Moored {
  ac Drift;
  sc synthesized period 20ms;
  period 20ms;
  safe abs(pose.x) < 2.0 && abs(pose.y) < 1.0;
  verify {
    grid pose.x in [-2.0, 2.0] / 64, pose.y in [-1.0, 1.0] / 48;
    commands pull.along in { -1.0, 1.0 };
    commands pull.across.x in { -1.0, 1.0 };
    commands pull.across.y in { -1.0, 1.0 };
  }
}
system S default { b: Boat; module Moored; until 20s; always abs(b.truth.x) < 2.0; }
system Forced { b: Boat; module Moored; force Moored sc; until 20s; always abs(b.truth.x) < 2.0; }
"""


@pytest.mark.long
def test_outputs_with_several_leaves_get_a_constant_each(tmp_path: Path) -> None:
    path = tmp_path / "boat.soter"
    path.write_text(BOAT)
    written, _ = soter.load(path).synthesize()
    text = written.read_text()
    assert "MooredSC_PULL_ACROSS_Y: float[2]" in text
    program = soter.load(written)
    assert program.ok
    assert program.verify(refute=False).modules[0].findings["P2a"].verdict == "proved"
    assert program.simulate("Forced", seed=3, trace=False).violations == 0


# ---------------------------------------------------------------- where there is none


def refusal(path: Path, **options: Any) -> Diagnostic:
    with pytest.raises(soter.SoterError) as caught:
        soter.load(path).synthesize(**options)
    (diagnostic,) = caught.value.diagnostics
    return diagnostic


def test_too_strong_a_wind_has_no_controller(walls: Path) -> None:
    walls.write_text(WALLS.replace("[-0.2, 0.2]", "[-3.2, 3.2]"))
    diagnostic = refusal(walls)
    assert diagnostic.code == "U009"
    assert "no cell" in diagnostic.notes[0]


def test_more_commands_than_the_engine_takes_are_refused_in_words(walls: Path) -> None:
    many = ", ".join(f"{i / 30 - 1.5:.3f}" for i in range(80))
    walls.write_text(WALLS.replace("-3.0, 0.0, 3.0", many))
    diagnostic = refusal(walls)
    assert "64" in diagnostic.notes[0]
    assert "fewer" in diagnostic.helps[0]


def test_errors_of_the_estimate_are_refused_in_words(walls: Path) -> None:
    walls.write_text(WALLS.replace("  der x = v;", "  der x = v;\n  measured motion.x within 0.1;"))
    diagnostic = refusal(walls)
    assert diagnostic.code == "U009"
    assert not any("commands" in text for text in diagnostic.helps)  # more of them would not help


def test_the_output_lies_in_the_programs_folder(walls: Path, tmp_path: Path) -> None:
    assert refusal(walls, output=str(tmp_path / "elsewhere" / "w.soter")).code == "U001"


def test_a_file_of_somebody_else_is_not_overwritten(walls: Path) -> None:
    own = walls.with_name("own.soter")
    own.write_text("soter 1;\n")
    assert refusal(walls, output=str(own)).code == "D008"
    assert own.read_text() == "soter 1;\n"


# ---------------------------------------------------------------- the table


def test_entries_that_a_strict_cell_can_see_agree_on_what_serves_it() -> None:
    core = np.ones((40, 40), dtype=bool)
    free = np.ones_like(core)
    free[10:30, 17] = False  # a stripe where only command 1 keeps K
    admits = np.stack([free, core])
    table = block_law(
        CellCommands(core, admits, free), (0.0, 0.0), (1.0, 1.0), lambda u, p: p - 1.0 + 0.0 * u, 4
    )
    assert table.entries.shape == (10, 10)
    rows, columns = np.nonzero(~free)
    for i, j in zip(rows, columns, strict=True):
        near = table.entries[(i - 2) // 4 : (i + 2) // 4 + 1, (j - 2) // 4 : (j + 2) // 4 + 1]
        assert (near == 1).all()
    assert (table.entries == 0).any(), "elsewhere it is free to choose"


def test_outside_the_core_the_nearest_entry_is_repeated() -> None:
    core = np.zeros((12, 8), dtype=bool)
    core[4:8] = True
    admits = np.stack([np.zeros_like(core), core])
    table = block_law(
        CellCommands(core, admits, np.zeros_like(core)), (0.0, 0.0), (1.0, 1.0), lambda _, p: p, 4
    )
    assert (table.entries == 1).all()
