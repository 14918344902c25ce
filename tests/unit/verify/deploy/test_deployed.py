"""With several parameter values the DM has one table: claims and shares are about that one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.language.front_end import check_file, system_of
from soter.verify import verify_module as verifying
from soter.verify.claims import choose_cells_and_levels
from soter.verify.claims.claims import make_tables
from soter.verify.claims.results import PROVED, UNDECIDED
from soter.verify.deploy.missing_predicates import complete
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.verify.claims.results import ModuleResult
    from soter.verify.grid.case import Case

DRIFTS = """soter 1;
topic at: { x: float, side: float } max_age 10ms;
topic u: float in [-2.0, 2.0];
plant P period 10ms {
  reads u;
  drives at = { x: p, side: right ? 1.0 : -1.0 };
  state p: float;
  state right: bool;
  der p = u + (right ? 1.2 : -1.2);
}
node Push period 20ms { publishes u; step { publish u = 2.0; } }
node Rest period 20ms {
  subscribes at;
  publishes u;
  step { publish u = clamp(GAIN * (-REST * at.side - at.x) - 1.2 * at.side, -2.0, 2.0); }
}
rta M {
  ac Push;
  sc Rest;
  period 20ms;
  safe abs(at.x) < 3.0;
  verify { grid at.x in [-3.0, 3.0] / 150; horizon HORIZON; levels 2; }
}
system S { p: P; module M; }
"""
"""Drifting right, AC can reach the wall on the right within H, and SC rests on the left."""


def result_of(rest: str = "1.0", horizon: str = "800ms") -> ModuleResult:
    text = DRIFTS.replace("REST", rest).replace("HORIZON", horizon).replace("GAIN", "2.0")
    checked = check_file("drifts.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    problem = extract(flat, flat.modules[0])
    assert problem.computed
    return verifying.verify_module(problem, refute=False)


def each_alone(cases: Sequence[Case]) -> None:
    """As if the DM had a table for each value of the parameter."""
    for case in cases:
        make_tables([case])


def test_sc_that_rests_where_the_table_never_gives_control_back_is_not_proved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module_result = result_of()
    assert (
        module_result.findings["ttf"].verdict == module_result.findings["safer"].verdict == PROVED
    )
    assert module_result.findings["P2b"].verdict == UNDECIDED
    monkeypatch.setattr(choose_cells_and_levels, "make_tables", each_alone)
    assert result_of().findings["P2b"].verdict == PROVED, "each case for itself would return"


def test_sc_that_rests_where_every_value_gives_control_back_is_proved() -> None:
    module_result = result_of(rest="0.0")
    assert module_result.findings["P2b"].verdict == PROVED


def test_shares_and_sets_are_those_that_the_dm_holds() -> None:
    module_result = result_of()
    one, two = (case.groups[0] for case in module_result.cases)
    both = np.logical_and(one.levels[-1], two.levels[-1])
    assert both.sum() < min(one.levels[-1].sum(), two.levels[-1].sum())
    for part in (one, two):
        assert part.deployed is not None
        assert np.array_equal(part.deployed[1], both)
    assert module_result.shares["gives_back"] == pytest.approx(both.mean())


def test_cases_without_a_common_estimate_let_nobody_have_control() -> None:
    module_result = result_of(horizon="1100ms")
    assert all(case.groups[0].levels[0].any() for case in module_result.cases)
    for claim in ("ttf", "safer", "P2b"):
        assert module_result.findings[claim].verdict == UNDECIDED, claim
    assert "every case" in module_result.findings["ttf"].text


def test_the_sets_of_a_proof_are_the_table_of_a_run() -> None:
    text = DRIFTS.replace("REST", "1.0").replace("HORIZON", "800ms").replace("GAIN", "2.0")
    flat = system_of(check_file("drifts.soter", text), None)
    (note,) = complete(flat)
    module_result = result_of()
    deployed = module_result.cases[0].groups[0].deployed
    assert deployed is not None
    assert f"on {deployed[0].mean():.1%} of the estimates (S_0)" in note
    assert module_result.shares["estimates"] == pytest.approx(deployed[0].mean())
    assert module_result.shares["estimates"] <= module_result.shares["lets_ac"]
