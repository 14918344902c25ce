"""In a flow a function of the prelude is the real one, whatever its code does with rounding."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING

import pytest

from soter.certificate.reading.case_model import CaseModel, new_command_terms
from soter.certificate.terms.compile_terms import all_certain
from unit.certificate import small_proofs
from unit.certificate.test_problem_by_definition import point
from unit.certificate.test_reading_by_evaluation import at
from unit.verify.problem.test_left_out_states import changed

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TURN = 2.0 * math.pi
FUNCTIONS: dict[str, tuple[Callable[[float], float], float]] = {
    "sin": (math.sin, 9.0),
    "cos": (math.cos, 9.0),
    "tan": (math.tan, 1.4),
    "asin": (math.asin, 0.95),
    "acos": (math.acos, 0.95),
    "atan": (math.atan, 9.0),
    "exp": (math.exp, 9.0),
    "tanh": (math.tanh, 9.0),
    "wrap_angle": (lambda x: x - TURN * round(x / TURN), 20.0),
}


def model_of(folder: Path, rate: str, reach: float) -> CaseModel:
    """The lane with another rate of y; terms are for headings of up to `reach`."""
    path = folder / "lane.soter"
    path.write_text(changed("15.0 * sin(h)", rate), encoding="utf-8")
    facts = small_proofs.facts_of(path, "S", "SafeLane")
    facts.extents = tuple((-reach / 3.0, reach / 3.0) for _ in facts.states)
    return CaseModel(facts, (), facts.extents)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_rate_is_what_mathematics_says(tmp_path: Path, name: str) -> None:
    function, reach = FUNCTIONS[name]
    model = model_of(tmp_path, f"{name}(h)", reach)
    terms, states = model.new_terms()
    rates, _ = model.rates(terms, states, new_command_terms(model.facts, terms))
    chance = random.Random(name)  # noqa: S311 - no secrets
    for _ in range(200):
        h = chance.uniform(-reach, reach)
        found = at(terms, rates[1], point(terms, {"c.x": 0.0, "c.y": 0.0, "c.h": h}))
        assert found == pytest.approx(function(h), abs=1e-9 * max(1.0, abs(function(h))))
        assert float(rates[1].low) - 1e-9 <= function(h) <= float(rates[1].high) + 1e-9


@pytest.mark.parametrize(("reach", "defined"), [(1.5, True), (1.6, False), (9.0, False)])
def test_a_tangent_is_defined_up_to_a_quarter_of_a_turn(
    tmp_path: Path, reach: float, defined: bool
) -> None:
    model = model_of(tmp_path, "tan(h)", reach)
    terms, states = model.new_terms()
    model.rates(terms, states, new_command_terms(model.facts, terms))
    assert all_certain(terms, terms.obligations) is defined
