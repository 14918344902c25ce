"""What a re-check says of how far it is: by what the rest is likely to cost, not by parts."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.certificate.case_check import CaseCheck
from soter.certificate.cell_sets import Grid
from soter.certificate.grid.grid_group import BLOCK, BLOCKS, LOOK, SMALL, block_tasks
from soter.diagnostics.current_phase import whole_shares_to

SIDE = 70
MODEL: Any = SimpleNamespace(facts=SimpleNamespace(parameters=[], times={"d_ns": 0}), parameter=())


def told(*holds: np.ndarray | None) -> list[float]:
    """The shares that are told while so many claims about one grid are shown, on one processor."""
    shares: list[float] = []
    case = CaseCheck(MODEL, [], set(), {}, 1)
    edges = tuple(float(x) for x in range(SIDE + 1))
    for each in holds:
        case.tasks += block_tasks("nothing", Grid((edges, edges)), lambda _: iter(()), each)
    with whole_shares_to(shares.append):
        case._run_tasks()
    return shares


@given(st.integers(1, 200), st.integers(1, 200))
def test_a_claim_counts_by_the_holds_its_cells_are_followed_for(one: int, other: int) -> None:
    assert SIDE * SIDE > SMALL
    first, last = (np.full((SIDE, SIDE), n, dtype=np.uint8) for n in (one, other))
    shares = told(first, last)
    assert len(shares) >= 2 * BLOCKS
    assert all(a < b for a, b in pairwise(shares))
    assert shares[-1] == pytest.approx(1.0)
    # the claims are shown in the other order: the last one first
    weight = (other + LOOK) / (one + other + 2 * LOOK)
    assert shares[len(shares) // 2 - 1] == pytest.approx(weight)


def test_cells_that_are_not_followed_cost_little() -> None:
    holds = np.zeros((SIDE, SIDE), dtype=np.uint8)
    holds[: SIDE // 2] = 100
    steps = np.diff([0.0, *told(holds)])
    assert steps.max() > 100 * steps.min()
    looks = told(None, np.full((SIDE, SIDE), 100, dtype=np.uint8))
    assert looks[len(looks) // 2 - 1] > 0.99


def test_of_many_cells_the_share_moves_in_small_steps() -> None:
    """Of 24 blocks the first one of a lift's 268,800 cells was done after ten minutes."""
    shares: list[float] = []
    case = CaseCheck(MODEL, [], set(), {}, 1)
    grid = Grid(tuple(tuple(float(x) for x in range(n + 1)) for n in (80, 60, 56)))
    case.tasks += block_tasks("nothing", grid, lambda _: iter(()))
    with whole_shares_to(shares.append):
        case._run_tasks()
    assert np.diff([0.0, *shares]).max() <= 2 * BLOCK / (80 * 60 * 56)
