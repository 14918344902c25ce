"""An empty K, or no cell inside `safe`, on smaller cells as well: what is told of it."""

from __future__ import annotations

import pytest

from soter.verify.claims import choose_cells_and_levels
from soter.verify.diagnosis import open_claims, tried_remedies
from unit.verify.diagnosis.tank_modules import cause, changed, explained


def test_no_cell_inside_safe_is_told_apart() -> None:
    thin = ("safe level > 0.2 && level < 1.8", "safe level > 0.99 && level < 1.01")
    module_result = explained(changed(thin, ("/ 320", "/ 16")))
    assert module_result.findings["P2a"].text == "K is empty: there is no C"
    assert "at the declared start it is true" in module_result.findings["P2a"].causes[0].text
    elsewhere = explained(changed(thin, ("/ 320", "/ 16"), ("float = 1.0", "float = 1.5")))
    assert "at the declared start it is false" in elsewhere.findings["P2a"].causes[0].text


@pytest.mark.long
def test_a_k_that_no_run_leaves_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choose_cells_and_levels, "SIZES", ())
    module_result = explained(changed(("/ 320", "/ 4")))
    assert module_result.findings["P2a"].leaving is None
    assert dict(cause(module_result, "P2a", "no_run").numbers)["runs"] > 10


def test_sc_is_not_blamed_where_no_run_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choose_cells_and_levels, "SIZES", ())
    monkeypatch.setattr(open_claims, "RUNS_S", 0.5)
    finding = explained(changed(("/ 320", "/ 4"))).findings["P2a"]
    assert finding.text == "K is empty: but no run of the model was seen to leave C"
    assert [c.kind for c in finding.causes] == ["no_run"]
    assert not any("if that is what was meant" in text for text in finding.tried)


def test_without_time_there_is_a_verdict_and_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choose_cells_and_levels, "SIZES", ())
    monkeypatch.setattr(tried_remedies, "LEAST_S", 0.0)
    monkeypatch.setattr(tried_remedies, "OF_PROOF", 0.0)
    monkeypatch.setattr(tried_remedies, "SHOWN_S", 0.0)
    finding = explained(changed(("/ 320", "/ 4"))).findings["P2a"]
    assert (finding.verdict, finding.leaving) == ("undecided", None)
    assert "of 0 runs" in finding.causes[0].text


def test_an_invariant_that_fails_in_a_trial_is_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise AssertionError("an invariant")

    monkeypatch.setattr(choose_cells_and_levels, "SIZES", ())
    monkeypatch.setattr("soter.verify.diagnosis.tried_remedies.worst_vacuity", broken)
    monkeypatch.setattr("soter.verify.diagnosis.tried_remedies.coarser_problem", broken)
    with pytest.raises(AssertionError, match="an invariant"):
        explained(changed(("/ 320", "/ 4")))
