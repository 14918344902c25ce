"""The way back counts cells outside W as further away than every rank."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.recheck.models import Cart

from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.grid.group_claims import ChainCheck, GroupTables, cells_not_nearer
from soter.certificate.reading.case_model import CaseModel
from unit.certificate import small_proofs

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
    check = ChainCheck(CaseModel(facts, (), extents), group)
    home = np.zeros(grid.shape, dtype=np.bool_)
    assert list(cells_not_nearer(check, Cells(grid, home), grid.all_cells))
    home[...] = True
    home[MIDDLE] = False
    assert not list(cells_not_nearer(check, Cells(grid, home), grid.all_cells))


LATE = """soter 1;
topic y: { x0: float, x1: float } max_age 1000us;
topic u0: float in [-3.0, 3.0] = 0.0;
topic u1: float in [-3.0, 3.0] = 0.0;
plant P period 2000us {
  reads u0, u1;
  drives y = { x0: x0, x1: x1 };
  state x0: float = 0.0;
  state x1: float = 0.0;
  disturbance w0: float in [-0.6, 0.6];
  der x0 = -0.174 * x0 + 1.0 * u0 + w0;
  der x1 = 1.1 * x0 + 1.0 * u1;
  measured y.x0 within 0.008, y.x1 within 0.008;
}
node Ac period 1000us { publishes u0, u1; step { publish u0 = 3.0; publish u1 = 3.0; } }
node Sc period 10000us phase 2000us {
  subscribes y;
  publishes u0, u1;
  step {
    publish u0 = clamp(-(5.83 * y.x0), -3.0, 3.0);
    publish u1 = clamp(-(49.3 * y.x1), -3.0, 3.0);
  }
}
rta M {
  ac Ac;
  sc Sc;
  period 12000us;
  safe abs(y.x0) < 1.0 && abs(y.x1) < 1.0;
  verify {
    grid y.x0 in [-1.0, 1.0] / 60, y.x1 in [-1.0, 1.0] / 60;
    late dm 0us, sc 0us;
    response dm 1000us, sc 0us;
    acts within 4000us;
  }
}
system S { p: P; module M; until 10s; }
"""
"""A command may act 5 ms late, half of SC's period, and answers what was 5 ms before that."""
FAST = (6, 34)
"""x0 in [-0.8, -0.7667], x1 in [0.1333, 0.1667]: all commands of two holds are at a limit."""


@pytest.mark.parametrize(("lowest", "shown"), [(31, True), (32, False)])
def test_a_rank_that_holds_only_where_commands_are_as_late_as_each_other(
    tmp_path: Path, lowest: int, shown: bool
) -> None:
    """After two holds x1 is 0.037 at least. With any lateness for each command: 0.031."""
    (tmp_path / "late.soter").write_text(LATE)
    facts = small_proofs.facts_of(tmp_path / "late.soter", "S", "M")
    grid = Grid(tuple(small_proofs.even_edges(-1.0, 1.0, 60) for _ in range(2)))
    rank = np.zeros(grid.shape, dtype=np.uint16)
    holds = rank.astype(np.uint8)
    rank[FAST], holds[FAST] = 1, 2
    group = GroupTables((0, 1), grid, holds * 0 + 1, rank=rank, rank_holds=holds)
    check = ChainCheck(CaseModel(facts, (), ((-1.0, 1.0), (-1.0, 1.0))), group)
    home = np.zeros(grid.shape, dtype=np.bool_)
    home[:, lowest:] = True
    home[FAST] = False
    assert (not list(cells_not_nearer(check, Cells(grid, home), grid.all_cells))) == shown
