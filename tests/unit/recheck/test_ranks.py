"""The way back counts cells outside W as further away than every rank."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.api import recheck
from unit.recheck import small_proofs

if TYPE_CHECKING:
    from pathlib import Path


def test_a_rank_that_leads_out_of_w_is_rejected(copied: Path) -> None:
    """Cells outside K get a rank and one hold: hardly any of them is nearer to Q then."""
    manifest: dict[str, Any] = json.loads((copied / "manifest.json").read_text())
    group = manifest["modules"][0]["cases"][0]["groups"][0]
    core = np.frombuffer((copied / group["K"]).read_bytes(), dtype="<u1")
    rank = np.frombuffer((copied / group["W"]).read_bytes(), dtype="<u2").copy()
    holds = np.frombuffer((copied / group["W_N"]).read_bytes(), dtype="<u1").copy()
    outside = np.flatnonzero((core == 0) & (rank == 0))
    chosen = outside[:: max(1, len(outside) // 20)]
    rank[chosen], holds[chosen] = 1, 1
    (copied / group["W"]).write_bytes(rank.tobytes())
    (copied / group["W_N"]).write_bytes(holds.tobytes())
    small_proofs.reseal(copied, manifest)
    report = recheck(copied)
    assert not report.accepted
    assert "nearer to Q" in report.reason
