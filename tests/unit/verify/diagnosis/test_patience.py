"""P2b waits where something cheaper fails, is cut short in the end, and never passes for proved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.verify import verify_module as verifying
from soter.verify.claims import claims
from unit.verify import test_verify_groups as plane
from unit.verify.test_verify import changed, result_of

if TYPE_CHECKING:
    from soter.verify.grid.case import Case


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No time for P2b as soon as anything else fails."""
    monkeypatch.setattr(claims, "LEAST_S", -1e9)
    monkeypatch.setattr(claims, "sum", lambda _: -1e9, raising=False)


@pytest.mark.usefixtures("impatient")
def test_p2b_is_undecided_where_it_was_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)
    module_result = result_of(
        changed(("ttf Room(motion, 0.12) < 0.0", "ttf Room(motion, 0.02) < 0.0"))
    )
    assert module_result.findings["ttf"].verdict == "undecided"
    assert module_result.findings["P2b"].verdict == "undecided"
    assert "not looked at to the end" in module_result.findings["P2b"].text
    assert module_result.recover_s is None
    (part,) = module_result.cases[0].groups
    assert part.rank is None


@pytest.mark.usefixtures("impatient")
def test_what_was_cut_is_looked_at_on_the_finer_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    """`ttf` fails at its border at first and is proved on a finer grid: P2b is then, too."""
    bold = changed(("+ 0.8", "+ 0.45"))
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)
    first = result_of(bold)
    assert first.findings["ttf"].verdict == "undecided"
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 2)
    module_result = result_of(bold)
    assert module_result.findings["ttf"].verdict == "proved"
    assert module_result.findings["P2b"].verdict == "proved"
    (part,) = module_result.cases[0].groups
    assert part.rank is not None
    assert np.array_equal(part.rank > 0, part.core > 0)


def test_processor_time_decides_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """What may be proved on a finer grid has no budget: P2b waits until `ttf` holds."""

    def with_nothing_failing(case: Case) -> None:
        assert not [f for f in case.failures if f.claim in claims.CHEAPER]
        claims.find_way_back(case)

    def never(case: Case) -> None:
        raise AssertionError(case)

    monkeypatch.setattr(verifying, "find_way_back", with_nothing_failing)
    monkeypatch.setattr(verifying, "find_way_back_for_report", never)
    module_result = result_of(changed(("+ 0.8", "+ 0.45")))
    assert {module_result.findings[p].verdict for p in ("ttf", "P2b")} == {"proved"}


def test_a_group_that_is_kept_is_not_taken_for_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """x is refined, y is not: what was put off of y is still to be done."""
    coarse = (("/ 200", "/ 80"), ("state loaded: bool;", ""), ("(loaded ? 0.5 : 1.0) * ", ""))
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)
    assert plane.result_of(*coarse).findings["ttf"].verdict == "undecided"
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 2)
    module_result = plane.result_of(*coarse)
    assert module_result.findings["P2b"].verdict == "proved"
    x, y = module_result.cases[0].groups
    assert len(x.edges[0]) > 81
    assert len(y.edges[0]) == 241
    for part in (x, y):
        assert part.rank is not None
        assert np.array_equal(part.rank > 0, part.core > 0)
