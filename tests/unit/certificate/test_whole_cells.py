"""Cells that arrays leave: when Arb shows them whole, no parts of them are looked at."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.certificate.inclusions import group_claims
from soter.certificate.inclusions.group_claims import ChainCheck

CELLS = 40
MANY = group_claims.WHOLE_OF
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


@pytest.mark.parametrize(("cells", "few"), [(MANY, True), (MANY + 1, False)])
def test_of_many_cells_parts_are_looked_at_whatever_arb_shows(cells: int, *, few: bool) -> None:
    check, asked = _check(lambda _: [(0.0, 1.0)])
    assert check._whole_by_arb(_walk(cells), np.ones(cells, dtype=np.bool_)) == few
    assert bool(asked) == few


@pytest.mark.parametrize("bad", [None, [(OUT_OF_IT, 10.0)], [(0.0, 1.0), (OUT_OF_IT, 10.0)]])
def test_one_cell_that_arb_does_not_show_is_enough_for_parts(bad: Any) -> None:
    check, _ = _check(lambda k: bad if k == CELLS - 5 else [(0.0, 1.0)])
    assert not check._whole_by_arb(_walk(), np.ones(CELLS, dtype=np.bool_))


@pytest.mark.parametrize("whole", [True, False])
def test_what_arrays_leave_stays_left_where_arb_shows_it(
    monkeypatch: pytest.MonkeyPatch, *, whole: bool
) -> None:
    check, _ = _check(lambda _: [(0.0, 1.0)] if whole else None)
    left, fewer = np.arange(CELLS) % 8 == 0, np.arange(CELLS) == 0
    monkeypatch.setattr(ChainCheck, "many", True)
    monkeypatch.setattr(check, "chain", lambda *_: SimpleNamespace(arrays=object()))
    monkeypatch.setattr(group_claims, "Walk", lambda *_: _walk())
    monkeypatch.setattr(group_claims, "unled", lambda *_: (left, 1))
    monkeypatch.setattr(group_claims, "unled_in_parts", lambda *_: fewer)
    monkeypatch.setattr(check, "_tries", lambda: ())
    todo = np.ones(CELLS, dtype=np.bool_)
    holds, order = _walk().holds, _walk().order
    given, _ = check.left_of(todo, holds, ((0, CELLS),), None, order, _walk().highest)  # type: ignore[arg-type]
    assert (given == (left if whole else fewer)).all()
