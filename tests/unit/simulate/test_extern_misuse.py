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


@pytest.mark.whole
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


@pytest.mark.whole
def test_inputs_in_brackets_are_told_to_be_attributes(tmp_path: Path) -> None:
    said = failure(tmp_path, FUNCTION.format("inputs", 'inputs["motion"]'))
    assert said.endswith("(ai.py:2): its inputs are attributes: `inputs.motion`")


@pytest.mark.whole
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


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (
            "__import__('numpy').array([1.0])",
            "a sequence of 1: give its one element, `float(y[0])`",
        ),
        ("[1.0]", "a sequence of 1: give its one element, `float(y[0])`"),
        ('{"drvie": 1.0}', "a `dict` with `drvie`: an answer's keys are the names of its topics"),
    ],
)
def test_an_answer_of_another_shape_is_told_what_to_give(
    tmp_path: Path, answer: str, said: str
) -> None:
    assert f"expected a number, found {said}" in failure(
        tmp_path, FUNCTION.format("inputs", answer)
    )


@pytest.mark.parametrize("engine", ["interp", "native"])
def test_an_extern_that_never_answers_is_told_by_the_run_and_its_pages(
    tmp_path: Path, engine: str
) -> None:
    (tmp_path / "ai.py").write_text(FUNCTION.format("inputs", "1.0 / 0"), encoding="utf-8")
    (tmp_path / "p.soter").write_text(PROGRAM, encoding="utf-8")
    program = soter.load(tmp_path / "p.soter")
    run = program.simulate(engine=engine, report=tmp_path / "r.html")
    assert run.never_answered == {"Pilot": 1}, "no AC: its first failure is its last"
    assert "Pilot never answered" in repr(run)
    assert run.failures[0].startswith("Pilot failed in every step (1), nothing of it was tried: Z")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert (
        "Pilot never answered: nothing of it was tried. System S: 1 violation in this run." in page
    )
    assert "ZeroDivisionError" in page
    assert "ZeroDivisionError" in run._repr_html_()


def test_an_extern_that_fails_once_answered_otherwise(tmp_path: Path) -> None:
    class Once:
        steps = 0

        def step(self, _inputs: object) -> float:
            self.steps += 1
            return 1.0 / (self.steps - 2)

    (tmp_path / "p.soter").write_text(PROGRAM, encoding="utf-8")
    run = soter.load(tmp_path / "p.soter").bind("Pilot", Once()).simulate()
    assert run.never_answered == {}
    assert run.failures[0].startswith("Pilot failed once: ZeroDivisionError")
    assert "never answered" not in repr(run)
