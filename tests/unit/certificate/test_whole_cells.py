"""Cells that arrays leave: when Arb shows them whole, no parts of them are looked at."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.certificate.inclusions import group_claims
from soter.certificate.inclusions.group_claims import ChainCheck

CELLS = 40
OUT_OF_IT = 9.0
"""Where a box ends that is not of a lower order."""


def _walk(cells: int = CELLS) -> Any:
    return SimpleNamespace(
        within=None,
        holds=np.full(cells, 3, dtype=np.uint8),
        order=np.ones(cells, dtype=np.int64),
        highest=lambda box: (box[0] >= OUT_OF_IT).astype(np.int64),
    )


def _check(ends_of: Any) -> tuple[ChainCheck, list[int]]:
    """A check of which Arb says where cells end."""
    check, asked = ChainCheck.__new__(ChainCheck), []

    def reached(at: Any, wanted: Any, *_: Any) -> Any:
        assert wanted == [3]
        assert at[0][1] == at[0][0] + 1
        asked.append(at[0][0])
        ends = ends_of(at[0][0])
        return iter([] if ends is None else [(3, ends)])

    check.reached = reached  # type: ignore[method-assign, assignment]
    return check, asked


def test_few_cells_are_looked_at_and_only_those_that_are_left() -> None:
    check, asked = _check(lambda _: [(0.0, 1.0)])
    left = np.arange(CELLS) % 2 == 1
    assert check._whole_by_arb(_walk(), left)
    assert 1 < len(asked) <= group_claims.WHOLE
    assert all(left[k] for k in asked)


@pytest.mark.parametrize("bad", [None, [(OUT_OF_IT, 10.0)], [(0.0, 1.0), (OUT_OF_IT, 10.0)]])
@pytest.mark.parametrize(("share", "whole"), [(0.25, True), (0.5, False), (0.75, False)])
def test_parts_are_looked_at_where_arb_does_not_lead_most_cells(
    bad: Any, share: float, *, whole: bool
) -> None:
    check, _ = _check(lambda k: bad if k < share * CELLS else [(0.0, 1.0)])
    assert check._whole_by_arb(_walk(), np.ones(CELLS, dtype=np.bool_)) == whole


@pytest.mark.parametrize("whole", [True, False])
def test_what_arrays_leave_stays_left_where_arb_shows_it(
    monkeypatch: pytest.MonkeyPatch, *, whole: bool
) -> None:
    check, _ = _check(lambda _: [(0.0, 1.0)] if whole else None)
    left, fewer = np.arange(CELLS) % 8 == 0, np.arange(CELLS) == 0
    monkeypatch.setattr(group_claims, "unled", lambda *_: (left, 1))
    monkeypatch.setattr(group_claims, "unled_in_parts", lambda *_: fewer)
    monkeypatch.setattr(check, "_tries", lambda: ())
    given, _ = check.left_of(_walk(), np.ones(CELLS, dtype=np.bool_), ((0, CELLS),))
    assert (given == (left if whole else fewer)).all()


@pytest.mark.parametrize("arrays", [True, False])
def test_cells_that_fail_as_they_are_are_looked_at_in_parts_together(
    monkeypatch: pytest.MonkeyPatch, *, arrays: bool
) -> None:
    """What arrays do not show of them, Arb is asked about; what neither shows has failed."""
    check, asked_together, asked = ChainCheck.__new__(ChainCheck), [], []
    check.group = SimpleNamespace(grid=SimpleNamespace(shape=(CELLS,)))  # type: ignore[assignment]

    def in_parts(_walk: Any, left: Any, _tries: Any) -> Any:
        asked_together.append(int(left.sum()))
        return left & (np.arange(CELLS) % 3 == 0)

    def leads(cell: Any, ways: Any) -> bool:
        if len(ways) == 1:
            return bool(cell[0][0] >= CELLS - 2)  # of two cells finer tubes are enough
        asked.append(cell[0][0])
        return bool(cell[0][0] % 2)

    monkeypatch.setattr(group_claims, "unled_in_parts", in_parts)
    monkeypatch.setattr(group_claims, "TOGETHER", 16)
    monkeypatch.setattr(check, "_tries", lambda: ())
    monkeypatch.setattr(group_claims, "ALONE", 3)
    cells = [((k, k + 1),) for k in [*range(20), CELLS - 2, CELLS - 1]]
    failed = list(check.failed(_walk() if arrays else None, iter(cells), leads))
    assert asked_together == ([16, 4] if arrays else [])
    assert asked == [k for k in range(20) if k % 3 == 0 or not arrays]
    assert failed == [((k, k + 1),) for k in asked if k % 2 == 0]
