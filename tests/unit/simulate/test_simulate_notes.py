"""What a run says of itself although nothing failed, and what it says of failures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import soter

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TWISTED = "one of them is likely the wrong way round"
ENGINES = ["native", "interp"]
TEXT = """
soter 1;
type Push = { x: float, y: float };
topic pos: float;
topic u: Push in { x in [-1.0, 1.0], y in [-1.0, 1.0] };
plant Point period 10ms { reads u; drives pos = x; state x: float; der x = u.x; }
extern node Pilot period 20ms { subscribes pos; publishes u; }
node Stay period 20ms {
  subscribes pos; publishes u;
  step { publish u = { x: clamp(-pos, -1.0, 1.0), y: 0.0 }; }
}
rta Guard { ac Pilot; sc Stay; period 100ms; safe abs(pos) < 9.0; ttf pos > 8.0; safer SAFER; }
system S default { p: Point; module Guard; until 2s; always abs(p.truth.x) < 9.0; }
system Alone { p: Point; node Pilot; until 2s; always abs(p.truth.x) < 9.0; }
"""


@pytest.fixture
def made(tmp_path: Path) -> Callable[..., soter.Program]:
    def make(pilot: object, safer: str = "pos < 7.0") -> soter.Program:
        path = tmp_path / "test.soter"
        path.write_text(TEXT.replace("SAFER", safer))
        program = soter.load(path)
        assert program.ok
        return program.bind("Pilot", pilot)

    return make


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("nothing", [None, {}, {"u": None}])
def test_a_policy_that_never_publishes_is_noted(
    made: Callable[..., soter.Program], engine: str, nothing: object
) -> None:
    run = made(lambda _: nothing).simulate(engine=engine)
    assert run.notes == ["Guard.Pilot published nothing in 101 of 101 steps"]
    assert run.violations == 0


@pytest.mark.parametrize("engine", ENGINES)
def test_saying_nothing_now_and_then_is_fine(
    made: Callable[..., soter.Program], engine: str
) -> None:
    def every(n: int) -> Callable[[Any], object]:
        calls = iter(range(10**6))
        return lambda _: (0.0, 0.0) if next(calls) % n == 0 else None

    assert made(every(2)).simulate(engine=engine).notes == []
    program = made(every(3))
    assert program.simulate(engine=engine).notes == [
        "Guard.Pilot published nothing in 67 of 101 steps"
    ]


@pytest.mark.parametrize("engine", ENGINES)
def test_predicates_the_wrong_way_round_are_noted(
    made: Callable[..., soter.Program], engine: str
) -> None:
    run = made(lambda _: (0.0, 0.0), safer="pos > -99.0").simulate(engine=engine)
    assert run.notes == []
    swapped = TEXT.replace("ttf pos > 8.0", "ttf pos < 8.0")
    path = run.system.program.path
    with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123 - a text path
        file.write(swapped.replace("SAFER", "pos < 7.0"))
    run = soter.load(path).bind("Pilot", lambda _: (0.0, 0.0)).simulate(engine=engine)
    assert run.notes == [
        f"Guard: ttf and safer held together in {n} of {n} decisions: {TWISTED}" for n in (21,)
    ]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ((0.0, 5), "`u.y` would be 5.0, not in [-1.0, 1.0]"),
        ((float("nan"), 0.0), "`u.x` would be nan"),
    ],
)
def test_what_the_gate_refused_is_named(
    made: Callable[..., soter.Program], engine: str, answer: object, said: str
) -> None:
    run = made(lambda _: answer).simulate(engine=engine)
    assert run.extern_failures == {"Guard.Pilot": said}
    assert run.modules["Guard"].gate_faults > 0


@pytest.mark.parametrize("engine", ENGINES)
def test_an_exception_is_placed_in_the_own_file(
    made: Callable[..., soter.Program], engine: str, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pilot.py").write_text(
        "import json\n\n\ndef deeper():\n    json.loads('{')\n\n\ndef step(inputs):\n    deeper()\n"
    )
    run = made("python:pilot.py:step").simulate(engine=engine)
    said = run.extern_failures["Guard.Pilot"]
    assert said.startswith("JSONDecodeError: ")
    assert said.endswith("(pilot.py:5)")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_fault_of_a_trusted_node_points_to_its_declaration(
    made: Callable[..., soter.Program], engine: str
) -> None:
    run = made(lambda _: (9.0, 0.0)).simulate("Alone", engine=engine)
    (violation,) = run.violation_list
    assert violation.span is not None
    assert violation.span.line == TEXT[: TEXT.index("extern node")].count("\n") + 1
