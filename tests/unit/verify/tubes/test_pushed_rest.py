"""A boat that wind pushes at rest, too: what is said of a `rest` that is not shown, with figures.

Purpose: verdicts, diagnostics and lints that a stranger met who put a robot of his own behind it.
Non-goals: what is proved (`test_rest_claims.py`).
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from soter.api import Program
from soter.diagnostics.diagnostic import SoterError
from soter.language.check.step_cost import MAX_OPERATIONS
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.tubes.generated_functions import TooLongError
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck

BOAT = """soter 1;
type Fix = { x: float unit "m", v: float unit "m/s" };
topic fix: Fix in { x in [-100.0, 100.0], v in [-5.0, 5.0] } max_age 50ms;
topic thrust: float in [-1.0, 1.0] = 0.0;
plant Boat period 10ms {
  reads thrust;
  drives fix = { x: x, v: v };
  measured fix.x within 0.2, fix.v within 0.05;
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.1, 0.1];
  der x = v;
  der v = 1.5 * thrust - 0.8 * v + wind;
}
node Go period 20ms { subscribes fix; publishes thrust; step { publish thrust = 1.0; } }
node Stop period 100ms { subscribes fix; publishes thrust; step { publish thrust = LAW; } }
rta Keep {
  ac Go;
  sc Stop;
  period 100ms;
  safe abs(fix.x) < 20.0;
  rest REST within 10s;
}
system Lake default { b: Boat; module Keep; until 1s; }
"""
COAST, BRAKE, HOLD = "0.0", "clamp(-fix.v, -1.0, 1.0)", "clamp(-0.3 * fix.x - fix.v, -1.0, 1.0)"


def check_of(program: Program) -> TubeCheck:
    flat = system_to_prove(check_file("boat.soter", Path(program.path).read_text()), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def boat(folder: Path, law: str, rest: str, *changes: tuple[str, str]) -> Program:
    text = BOAT.replace("LAW", law).replace("REST", rest)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "boat.soter"
    path.write_text(text, encoding="utf-8")
    return Program(str(path))


@pytest.mark.parametrize("period", ["100ms", "200ms", "1s"])
def test_a_slower_sc_of_a_module_with_rest_is_not_exchanged(tmp_path: Path, period: str) -> None:
    slower = ("period 100ms", f"period {period}")
    text = "abs(fix.v) < 0.2 moves fix.x by 1.0"
    program = boat(tmp_path, COAST, text, slower)
    assert "W012" not in {d.code for d in program.check().warnings}
    predicates = (f"rest {text} within 10s", "ttf fix.x > 9.0; safer fix.x < 8.0")
    program = boat(tmp_path, COAST, text, slower, predicates)
    assert "W012" in {d.code for d in program.check().warnings}


def test_a_time_that_is_too_long_is_told_with_the_longest(tmp_path: Path) -> None:
    program = boat(tmp_path, HOLD, "abs(fix.v) < 0.5", ("within 10s", "within 120s"))
    with pytest.raises(SoterError) as caught:
        program.verify()
    (told,) = caught.value.diagnostics
    assert told.code == "R007"
    assert "1e+08 operations" in told.message
    found = re.fullmatch(r"`within ([\d.]+)s` at most, (\d+) steps of SC", told.helps[0])
    assert found is not None
    within, steps = found.groups()
    assert float(within) == pytest.approx(0.1 * int(steps))
    check = check_of(program)
    assert check.operations(int(steps)) <= MAX_OPERATIONS
    with pytest.raises(TooLongError):
        check.operations(int(steps) + 1)
