"""What bench/newcomers reads of programs and of printed advice is what stands there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.newcomers.equations import robot_of
from bench.newcomers.first_attempt import TRIED, followed
from bench.newcomers.flights import jumping, lattice, leaves, left_by, left_in_c, library
from bench.newcomers.wrong_robots import Wrong, edited

from soter.verify.claims.choose_cells_and_levels import CELLS_MAX
from unit.verify.diagnosis.tank_modules import TANK, changed, explained

if TYPE_CHECKING:
    from pathlib import Path

COARSE = (
    ("  ttf level < 0.25 || level > 1.75;\n", ""),
    ("  safer level > 0.4 && level < 1.6;\n", ""),
    ("/ 320", "/ 16; levels 3"),
)
CAR = """soter 1;
const A: float = 2.0;  // const B: float = 3.0;
topic seen: { gap: float, v: float } max_age 60ms;
topic cmd: { accel: float, lamp: float } in { accel in [-3.0 * A, A], lamp in [0.0, 1.0] };
plant Car period 10ms {
  reads cmd;
  drives seen = { gap: gap, v: v };
  state v: float = 10.0;
  state gap: float = 80.0;
  disturbance grip: float in [-0.5, 0.25];
  der gap = -v;
  der v = v > 0.0 || cmd.accel > 0.0 && gap < 50.0 ? cmd.accel + grip : 0.0;
  measured seen.gap within 0.3;
}
node Drive period 20ms { publishes cmd; step { publish cmd = { accel: A, lamp: 0.0 }; } }
node Brake period 25ms {
  subscribes seen;
  publishes cmd;
  step {
    let near = seen.gap - 4.0;
    let wanted = clamp(near > 10.0 ? -A : near - seen.v, -3.0 * A, A);
    publish cmd = { accel: wanted, lamp: 1.0 };
  }
}
rta Aeb {
  ac Drive;
  sc Brake;
  period 40ms;
  safe seen.gap > 0.0 && abs(seen.v) < 20.0;
  verify { grid seen.gap in [0.0, 100.0] / 250, seen.v in [-A, 18.0] / 190; acts within 100ms; }
}
system S default { c: Car; module Aeb; always c.truth.gap > 0.0; }
"""
WEAK = changed(("clamp(0.5 * (1.0 - level), -0.1, 0.1)", "-0.1"))


def test_what_flies_is_what_the_program_says() -> None:
    robot = robot_of(CAR, 5.0, {"seen.v": (0.0, None)})
    assert (robot.low, robot.high) == ((0.0, 0.0), (18.0, 100.0))
    assert (robot.errors, robot.disturbed) == ((0.0, 0.3), ((-0.5, 0.25),))
    assert (robot.age_s, robot.late_s, robot.period_s, robot.step_s) == (0.06, 0.1, 0.04, 0.025)
    assert (robot.pieces, robot.maps, robot.until_s) == (3, False, 5.0)
    ends = {(-6.0, 0.0), (-6.0, 1.0), (2.0, 0.0), (2.0, 1.0)}
    assert set(robot.ac) == ends | {(-6.0, 0.5), (2.0, 0.5), (-2.0, 0.0), (-2.0, 1.0)}
    x = np.array([[5.0, 0.0, 0.0, 21.0], [80.0, 60.0, 40.0, -1.0]])  # v, gap
    u = np.array([[2.0, 2.0, 2.0, -6.0], [0.0, 0.0, 0.0, 0.0]])
    d = np.full((1, 4), 0.25)
    assert robot.rates(x, u, d).tolist() == [[2.25, 0.0, 2.25, -5.75], [-5.0, 0.0, 0.0, -21.0]]
    assert robot.sc(x).tolist() == [[-2.0, -2.0, -2.0, -6.0], [1.0] * 4]
    assert robot.safe(x).tolist() == [True, True, True, False]


def test_a_shape_that_is_not_read_ends_in_an_exception() -> None:
    in_parentheses = CAR.replace("v > 0.0 || cmd.accel > 0.0", "(v > 0.0 || cmd.accel > 0.0)")
    with pytest.raises(SyntaxError):
        robot_of(in_parentheses, 5.0, {})
    with pytest.raises(NameError):
        robot_of(CAR.replace("-3.0 * A, A]", "-3.0 * B, A]"), 5.0, {})
    with pytest.raises(AssertionError):
        edited(CAR, Wrong("of another program", {"der h": "der g"}))


def test_a_flight_finds_what_leaves_and_only_that() -> None:
    """A tank that SC fills or empties by more than what leaks; and one where it cannot."""
    left, starts = leaves(robot_of(TANK, 60.0, {"level": (0.3, 1.7)}), own_sets=False)
    assert (left, starts) == (0, 41)
    assert leaves(robot_of(WEAK, 60.0, {}), own_sets=False) == (39, 39)


@pytest.mark.parametrize("program", [CAR, WEAK])
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("ac", [-1, 0])
def test_flights_in_c_leave_where_those_of_numpy_do(
    program: str, late: bool, ac: int, tmp_path: Path
) -> None:
    robot = replace(robot_of(program, 3.0, {}), age_s=0.5)
    start = lattice(robot, 7)
    left = left_in_c(robot, start, late, ac, library(robot, str(tmp_path)), jumping(robot))
    assert left.tolist() == left_by(robot, start, late, ac).tolist()
    assert left.any()
    assert not left.all()


@pytest.mark.parametrize(
    "edits",
    [
        COARSE,
        (("max_age 100ms", "max_age 4s"),),
        (("ac Learned; sc Hold;", "ac Hold; sc Learned;"),),
    ],
)
def test_advice_that_was_tried_is_followed_as_it_is_printed(
    edits: tuple[tuple[str, str], ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CELLS_MAX, "P2b", 0)  # smaller cells are advised, not chosen
    text = changed(*edits)
    hints = [f.hint for f in explained(text).findings.values() if f.hint and TRIED in f.hint]
    advice, _, outcome = hints[0].partition(TRIED)
    assert outcome.startswith("every claim is proved")
    after = followed(text, advice)
    assert after != text
    assert explained(after).verdict == "proved"
