"""The way back counts cells outside W as further away than every rank."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from bench.recheck_models import Cart

from soter.recheck.inclusions.inclusion import ChainCheck, GroupTables, ranked
from soter.recheck.inclusions.tables import Cells, Grid
from soter.recheck.reading.model import Model
from unit.recheck import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

MIDDLE = (18, 16)
"""A cell that moves, far from the borders of the grid."""


def test_a_rank_that_leads_to_cells_without_one_is_not_shown(tmp_path: Path) -> None:
    (tmp_path / "cart.soter").write_text(Cart().text())
    facts = small_proofs.facts_of(tmp_path / "cart.soter", "Track", "SafeCart")
    extents = (facts.axes[0], facts.axes[1])
    grid = Grid(
        tuple(small_proofs.even_edges(*e, n) for e, n in zip(extents, (36, 24), strict=True))
    )
    none = np.zeros(grid.shape, dtype=np.uint8)
    rank, holds = none.astype(np.uint16), none.copy()
    rank[MIDDLE], holds[MIDDLE] = 1, 4
    group = GroupTables((0, 1), grid, none + 1, rank=rank, rank_holds=holds)
    check = ChainCheck(Model(facts, (), extents), group)
    home = np.zeros(grid.shape, dtype=np.bool_)
    assert list(ranked(check, Cells(grid, home), grid.whole))
    home[...] = True
    home[MIDDLE] = False
    assert not list(ranked(check, Cells(grid, home), grid.whole))
