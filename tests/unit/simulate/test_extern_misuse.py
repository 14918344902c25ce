"""An extern that is written for another way of being called is told how it is called."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Motion = { h: float, v: float };
input topic motion: Motion = { h: 0.0, v: 0.0 };
input topic ranges: float[3] = [1.0, 1.0, 1.0];
topic drive: float in [-2.0, 2.0] = 0.0;
extern node Pilot period 50ms from "python:ai.py:Pilot" {
  subscribes motion, ranges;
  publishes drive;
}
system S { node Pilot; until 200ms; }
"""
METHOD = "class Pilot:\n    def step({}):\n        return 1.0\n"
FUNCTION = "def Pilot({}):\n    return {}\n"
CALLED = (
    "`inputs.motion` with h: float, v: float, `inputs.ranges` (array (3,)); "
    'it returns {"drive": float}'
)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def failure(folder: Path, code: str) -> str:
    (folder / "ai.py").write_text(code, encoding="utf-8")
    path = folder / "p.soter"
    path.write_text(PROGRAM, encoding="utf-8")
    result = soter.load(path).simulate(engine="interp")
    return str(result.extern_failures["Pilot"])


@pytest.mark.parametrize(
    ("code", "line"),
    [
        (METHOD.format("inputs"), "`def step(self, inputs):`"),
        (METHOD.format("self, motion, ranges"), "`def step(self, inputs):`"),
        (FUNCTION.format("", "1.0"), "`def Pilot(inputs):`"),
        (FUNCTION.format("motion, ranges", "1.0"), "`def Pilot(inputs):`"),
    ],
)
def test_another_signature_is_told_the_one_that_is_called(
    tmp_path: Path, code: str, line: str
) -> None:
    said = failure(tmp_path, code)
    assert said.startswith("TypeError: ")
    assert said.endswith(f": write {line}; {CALLED}")


def test_inputs_in_brackets_are_told_to_be_attributes(tmp_path: Path) -> None:
    said = failure(tmp_path, FUNCTION.format("inputs", 'inputs["motion"]'))
    assert said.endswith("(ai.py:2): its inputs are attributes: `inputs.motion`")


def test_a_name_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    assert failure(tmp_path, FUNCTION.format("inputs", "inputs.motoin.h")).endswith(
        "is `motion` meant? there are `motion`, `ranges`"
    )
    assert failure(tmp_path, FUNCTION.format("inputs", "inputs.motion.z")).endswith(
        "there are `h`, `v`"
    )


def test_a_mistake_inside_of_it_is_left_to_python(tmp_path: Path) -> None:
    said = failure(tmp_path, FUNCTION.format("inputs", "len(1) + inputs.motion.h"))
    assert said == "TypeError: object of type 'int' has no len() (ai.py:2)"
