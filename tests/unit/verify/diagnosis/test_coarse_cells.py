"""An empty K, or no cell inside `safe`, on smaller cells as well: what is told of it."""

from __future__ import annotations

import numpy as np
import pytest

from soter.verify.claims import choice
from soter.verify.diagnosis import empty_invariant, experiments
from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds


def test_no_cell_inside_safe_is_told_apart() -> None:
    thin = ("safe level > 0.2 && level < 1.8", "safe level > 0.99 && level < 1.01")
    module_result = explained(changed(thin, ("/ 320", "/ 16")))
    assert module_result.findings["P2a"].text == "K is empty: there is no C"
    assert "holds at the declared start" in module_result.findings["P2a"].causes[0].text
    elsewhere = explained(changed(thin, ("/ 320", "/ 16"), ("float = 1.0", "float = 1.5")))
    assert "false at the declared start" in elsewhere.findings["P2a"].causes[0].text


@pytest.mark.long
def test_a_k_that_no_run_leaves_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "SIZES", ())
    module_result = explained(changed(("/ 320", "/ 4")))
    assert module_result.findings["P2a"].leaving is None
    assert dict(cause(module_result, "P2a", "no_run").numbers)["runs"] > 10


@pytest.mark.parametrize("most", [4, 2], ids=["declared cells", "merged"])
def test_sc_is_not_blamed_where_no_run_leaves(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "SIZES", ())
    monkeypatch.setattr(empty_invariant, "COARSE", (most, most))
    monkeypatch.setattr(empty_invariant, "RUNS_S", 0.5)
    finding = explained(changed(("/ 320", "/ 4"))).findings["P2a"]
    assert finding.text == "K is empty: but no run of the model was seen to leave C"
    assert finding.hint == "`core` that says where to look for K (not tried)"
    (measured,) = [c for c in finding.causes if c.kind in ("strength", "weak")]
    assert ("coarser than the declared ones" in measured.text) == (most < 4)
    assert not any("if that is what was meant" in text for text in finding.tried)


def test_what_was_cut_short_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "SIZES", ())
    monkeypatch.setattr(empty_invariant, "BUDGET_S", 0.0)
    module_result = explained(changed(("/ 320", "/ 4")))
    assert kinds(module_result, "P2a")[-1] == "cut"
    bold = explained(changed(("level < 0.25 || level > 1.75", "level < 0.232 || level > 1.768")))
    assert bold.findings["ttf"].verdict == "undecided"


@pytest.mark.long
def test_an_invariant_that_fails_in_an_experiment_is_a_defect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(*_: object) -> None:
        raise AssertionError("an invariant")

    monkeypatch.setattr(choice, "SIZES", ())
    monkeypatch.setattr("soter.verify.diagnosis.experiments.allowed_on", broken)
    with pytest.raises(AssertionError, match="an invariant"):
        explained(changed(("/ 320", "/ 4")))


def test_cells_that_cannot_be_halved_are_no_experiment() -> None:
    edges = np.array([1.0, np.nextafter(1.0, 2.0)])
    assert experiments.split(edges, 1) is None
    assert experiments.split(np.array([0.0, 1.0]), 2) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    assert experiments.split(np.linspace(0.0, 1.0, 40_000), 1) is None
