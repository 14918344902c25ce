"""What a tube's functions answer in C is what the interpreter answers, bit by bit."""

from __future__ import annotations

from math import inf
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.tubes import compiled_calls
from soter.verify.tubes.compiled_calls import COMPILED, CompiledCaller, CompiledQuestions
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.kinks import kinks_of
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck

REST = Path(__file__).parents[4] / "examples" / "rest"
EXAMPLES = (
    "lane",
    "hall",
    "slip",
    pytest.param("cruise", marks=pytest.mark.long),
    pytest.param("obstacles", marks=pytest.mark.long),
)
"""Among them several plans, a kink at which runs are collected, and a map."""


def check_of(name: str) -> TubeCheck:
    checked = check_file(f"{name}.soter", (REST / f"{name}.soter").read_text(encoding="utf-8"))
    system = system_to_prove(checked, None)
    problem = extract(system, system.modules[0])
    assert isinstance(problem, TubeProblem)
    check = TubeCheck(problem)
    check.kink = next(kinks_of(check.law), None)
    return check


Region = tuple[list[float], list[float]]


@st.composite
def regions(draw: st.DrawFn, n: int) -> Region:
    """A region: the lower and the upper ends of `n` states."""
    middles = draw(st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n))
    halves = draw(st.lists(st.sampled_from((0.0, 1e-3, 0.02, 0.3)), min_size=n, max_size=n))
    pairs = list(zip(middles, halves, strict=True))
    return [m - h for m, h in pairs], [m + h for m, h in pairs]


@pytest.mark.parametrize("name", EXAMPLES)
def test_answers_in_c_are_those_of_the_interpreter(name: str) -> None:
    check = check_of(name)
    interpreted = Caller(check.offline_text({}))
    compiled, n = CompiledQuestions(interpreted.checked), len(check.states)
    first_map = [check.problem.first_map] * bool(check.problem.first_map)
    answers = []

    @settings(max_examples=5, deadline=None, database=None)
    @given(
        box=regions(n),
        end=regions(n),
        far=st.lists(st.sampled_from((inf, 3.0)), min_size=n, max_size=n),
    )
    def ask(box: Region, end: Region, far: list[float]) -> None:
        way = ([-x for x in far], far)
        asked = {"keeps": (box, way, end), "starts": (box,), "good": (box[0], *first_map)}
        for function in COMPILED:
            answer = interpreted.result(function, *asked[function])
            assert repr(compiled.answer(function, asked[function])) == repr(answer)
            answers.append(answer)

    ask()
    assert any(answers), "everything failed"


def test_without_a_compiler_the_interpreter_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    text = check_of("slip").offline_text({})
    assert CompiledCaller(text).affordable > Caller.affordable

    def no_compiler() -> None:
        raise SoterError((Diagnostic("X005", "none"),))

    monkeypatch.setattr(compiled_calls, "find_compiler", no_compiler)
    assert CompiledCaller(text).affordable == Caller.affordable
