"""The step of the simulator's scheme in the re-checker: a list of its own, refused beyond it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.linear_flows import ORDERS, linear_flow
from soter.certificate.report import NotRecheckedError
from soter.language.syntax.schemes import SCHEMES
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path


def test_only_schemes_whose_step_is_the_series_of_the_solution_are_known() -> None:
    for name, order in ORDERS.items():
        assert SCHEMES[name].order == SCHEMES[name].stages == order


def test_a_scheme_that_is_not_known_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "small.soter").write_text(PROGRAMS["flying"])
    facts = small_proofs.facts_of(tmp_path / "small.soter", "S", "M")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(len(facts.states))))
    members = tuple(range(len(facts.states)))
    assert linear_flow(model, members).members == members
    for component in facts.plants:
        assert component.plant is not None
        component.plant.method = "leapfrog"
    with pytest.raises(NotRecheckedError, match="integrated by `leapfrog`"):
        linear_flow(model, members)
