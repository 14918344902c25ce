"""An SC that stops: a `rest` is read off runs and tried; what is told can be pasted."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from unittest.mock import patch

import pytest

from soter.language.front_end import check_file
from soter.verify.claims.case import Case
from soter.verify.command import modules_of, problems_of
from soter.verify.diagnosis import rest_from_runs
from soter.verify.diagnosis.tried_remedies import Trials
from soter.verify.diagnosis.variations import NotProved, Remedy, remedies
from soter.verify.enclose.compiled_enclosures import CompiledEnclosures, library_of
from soter.verify.verify_module import module_method
from unit.verify.diagnosis.tank_modules import TANK

if TYPE_CHECKING:
    from soter.verify.problem.problem import Problem

CART = """soter 1;
topic seen: { x: float, v: float } max_age 100ms;
topic speed: float in [-0.5, 0.5] = 0.0;
plant Cart period 50ms {
  reads speed;
  drives seen = { x: x, v: v };
  state x: float = 2.0;
  state v: float = 0.0;
  disturbance slope: float in [-0.5, 0.5];
  der x = -v + slope * v;
  der v = (speed - v) / 0.2;
  measured seen.x within 0.01, seen.v within 0.01;
}
node Drive period 100ms { publishes speed; step { publish speed = 0.5; } }
node Stop period 100ms { subscribes seen; publishes speed; step { publish speed = 0.0; } }
rta Halt {
  ac Drive; sc Stop; period 100ms;
  safe seen.x > 0.1;
  verify { grid seen.x in [0.1, 4.1] / 8, seen.v in [-0.6, 0.6] / 6; }
}
system S default { c: Cart; module Halt; until 10s; }
"""
STOPS = "publish speed = 0.0; } }\nrta"
BRAKES = STOPS, "publish speed = clamp(-seen.v, -0.5, 0.5); } }\nrta"
GOES_ON = STOPS, "publish speed = 0.2; } }\nrta"
TURNS = (
    ("{ x: float, v: float } max", "{ x: float, v: float, h: float } in { h in [-4.0, 4.0] } max"),
    ("{ x: x, v: v }", "{ x: x, v: v, h: h }"),
    ("  disturbance", "  state h: float = 0.5;\n  disturbance"),
    ("der x = -v + slope * v;", "der x = -v * cos(h) + slope * v; der h = 0.3 * v;"),
    ("seen.v in [-0.6, 0.6] / 6", "seen.v in [-0.6, 0.6] / 6, seen.h in [-1.0, 1.0] / 6"),
)


def changed(*pairs: tuple[str, str]) -> str:
    text = CART
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def problem_of(text: str) -> Problem:
    checked = check_file("cart.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    (problem,) = problems_of(modules_of(checked, None, None, {}))
    return problem


def not_proved(text: str) -> NotProved:
    """A module as if no set was found: of an SC that stops none ever is on so few cells."""
    problem = problem_of(text)
    library, _ = library_of(problem)
    case = Case(problem, (), CompiledEnclosures(library, problem, ()))
    return NotProved(problem, ("P2a", "start"), (case,), None)


def rests_tried(text: str) -> list[Remedy]:
    with patch.multiple(rest_from_runs, CPU_S=60.0, HOLDS=400, PATTERNS=4):
        return [r for r in remedies(not_proved(text)) if r.said.startswith("`rest ")]


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param((), id="stops where it is"),
        pytest.param((("/ 0.2", "/ 0.6"),), id="stops slowly"),
        pytest.param((("safe seen.x > 0.1", "safe seen.v < 0.55 && seen.x > 0.1"),), id="bounds v"),
        pytest.param(None, id="holds a place, in a tank"),
    ],
)
def test_the_rest_that_is_told_was_shown_and_can_be_pasted(
    changes: tuple[tuple[str, str], ...] | None,
) -> None:
    text = TANK if changes is None else changed(*changes)
    trials = Trials(60.0, lambda _: [])
    told = next(r for r in rests_tried(text) if trials.failing(r.problem) == ())
    clause = re.match(r"`(rest [^`]*;)` in the place of (.*)", told.said)
    assert clause is not None, told.said
    for word in clause[2].replace("`", "").split(" and "):
        text = re.sub(rf"verify \{{ {word}.*\}}|\b{word} .*;", "", text, count=1)
    pasted = problem_of(text.replace("period 100ms;\n  safe", f"period 100ms; {clause[1]}\n  safe"))
    result = module_method(pasted).verify(pasted, refute=False, explain=False)
    assert result.verdict == "assumed"
    assert result.findings["P2a"].verdict == result.findings["start"].verdict == "proved"


def test_what_sc_leads_to_no_place_is_not_bounded_in_rest() -> None:
    """It turns while it stops, by less than it turned before: the heading is wherever it is."""
    (first, *_) = rests_tried(changed(*TURNS))
    condition = first.said.partition(" moves ")[0]
    assert "seen.v" in condition
    assert "seen.h" not in condition
    assert "seen.x by" in first.said


def test_nothing_is_told_of_an_sc_that_does_not_stop() -> None:
    """It keeps its speed until it is against the wall."""
    assert not rests_tried(changed(GOES_ON))


@pytest.mark.parametrize(
    "change", [("/ 0.2;", "/ 0.2 + 0.1 * slope;"), BRAKES], ids=["wind", "noise"]
)
def test_a_rest_in_which_something_moves_it_on_is_in_vain(change: tuple[str, str]) -> None:
    trials = Trials(60.0, lambda _: [])
    assert all(trials.failing(r.problem) for r in rests_tried(changed(change)))
