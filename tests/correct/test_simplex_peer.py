"""The loop that simplex_peer.py measures: what it says of SC is a share of its own turns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.running import simplex_peer

import processes

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("gymnasium", reason="the extra `learn` is not installed")


def test_the_share_of_sc_is_one_of_the_turns_of_its_round(tmp_path: Path) -> None:
    program = simplex_peer.built(tmp_path / "c")
    (tmp_path / "rounds").write_text("\n" * 6)
    with (tmp_path / "rounds").open() as rounds:
        done = processes.run([program], stdin=rounds, capture_output=True, text=True, check=True)
    shares = [float(line.split()[1]) for line in done.stdout.splitlines()]
    assert len(shares) == 6
    assert all(0.0 < share < 1.0 for share in shares)
    assert max(shares) - min(shares) < 1e-3, "every round has the same turns"
