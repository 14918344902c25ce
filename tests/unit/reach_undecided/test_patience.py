"""P2b waits: it is cut short where something cheaper fails, and never passes for proved then."""

from __future__ import annotations

import numpy as np
import pytest

from soter.reach import patience
from soter.reach import verify as verifying
from unit.reach.test_verify import changed, result_of


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No time for P2b as soon as anything else fails."""
    monkeypatch.setattr(patience, "LEAST_S", -1e9)
    monkeypatch.setattr(patience, "sum", lambda _: -1e9, raising=False)


@pytest.mark.usefixtures("impatient")
def test_p2b_is_undecided_where_it_was_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)
    found = result_of(changed(("ttf Room(motion, 0.12) < 0.0", "ttf Room(motion, 0.02) < 0.0")))
    assert found.findings["ttf"].verdict == "undecided"
    assert found.findings["P2b"].verdict == "undecided"
    assert "not looked at to the end" in found.findings["P2b"].text
    assert found.recover_s is None
    (part,) = found.cases[0].groups
    assert part.rank is None


@pytest.mark.usefixtures("impatient")
def test_what_was_cut_is_looked_at_on_the_finer_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    """`ttf` fails at its border at first and is proved on a finer grid: P2b is then, too."""
    bold = changed(("+ 0.8", "+ 0.45"))
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)
    first = result_of(bold)
    assert first.findings["ttf"].verdict == "undecided"
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 2)
    found = result_of(bold)
    assert found.findings["ttf"].verdict == "proved"
    assert found.findings["P2b"].verdict == "proved"
    (part,) = found.cases[0].groups
    assert part.rank is not None
    assert np.array_equal(part.rank > 0, part.core > 0)
