"""`clip = True` of an extern: numbers at the ends of their topics' sets, and no step fault."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Push = { x: float, y: float };
topic t: float;
topic push: Push in { x in [-1.0, 1.0], y in [0.0, 0.1] };
topic gear: int in [0, 3];
topic row: float[2] in [-2.0, 2.0];
topic said: float in [0.0, 1.0];
plant Clock period 10ms { drives t = x; state x: float = 0.0; next x = x + 1.0; }
extern node Pilot period 10ms from "python:pilot.py:Pilot" {
  subscribes t;
  publishes push, gear, row, said[<=2];
}
system S { c: Clock; node Pilot; until 50ms; always gear < 4; }
"""
PILOT = """
class Pilot:
    clip = {clip}
    def step(self, inputs):
        return {{"push": (-7.5, 0.5), "gear": {gear}, "row": {row}, "said": [3.0, -1.0]}}
"""


def run(folder: Path, **how: Any) -> soter.Run:
    (folder / "p.soter").write_text(PROGRAM, encoding="utf-8")
    said = {"clip": True, "gear": 9, "row": "[5.0, -0.5]"} | how.pop("said", {})
    (folder / "pilot.py").write_text(PILOT.format(**said), encoding="utf-8")
    return soter.load(folder / "p.soter").simulate(**how)


@pytest.mark.parametrize("engine", ["native", "interp"])
@pytest.mark.parametrize("apart", [False, True])
def test_numbers_are_put_at_the_ends_of_their_sets(
    tmp_path: Path, engine: str, *, apart: bool
) -> None:
    made = run(tmp_path, engine=engine, apart=apart)
    assert (made.violations, made.extern_failures) == (0, {})
    assert made.array("push")[-1].tolist() == [-1.0, 0.1]
    assert made.array("gear")[-1] == 3
    assert made.array("row")[-1].tolist() == [2.0, -0.5]
    assert made.array("said")[-1] == 0.0


@pytest.mark.parametrize(
    "said", [{"clip": False}, {"row": '[float("nan"), 0.0]'}, {"row": '[float("inf"), 0.0]'}]
)
def test_without_it_and_of_what_is_no_number_the_gate_refuses(
    tmp_path: Path, said: dict[str, Any]
) -> None:
    made = run(tmp_path, said=said)
    assert made.violations > 0
    assert np.ptp(made.array("row")) == 0.0


def test_a_method_of_that_name_says_nothing(tmp_path: Path) -> None:
    made = run(tmp_path, said={"clip": "lambda self: True"})
    assert made.violations > 0
