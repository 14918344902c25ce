"""Logs that were damaged: refused, read as before, or with a word about it; never wrongly.

Non-goals: the ways themselves (`bench/hostile/log_damages.py`), whose whole table is a long test.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from bench.hostile.damaged_logs import (
    REFUSED,
    SAME,
    UNSEEN,
    WRONG,
    cells,
    flips,
    outcome,
    read,
)
from bench.hostile.log_damages import KINDS, WAYS, flight

if TYPE_CHECKING:
    from pathlib import Path


def test_there_are_44_ways_and_11_kinds() -> None:
    assert (len(WAYS), len(KINDS)) == (44, 11)


@pytest.mark.parametrize("kind", KINDS)
def test_some_ways_of_each_kind(kind: str) -> None:
    chosen = list(WAYS)[::8]
    found = cells(chosen, [kind], seed=2)
    assert WRONG not in found.values()
    assert REFUSED in found.values()


@pytest.mark.long
def test_every_way_of_each_kind() -> None:
    found = cells(list(WAYS), list(KINDS), seed=1)
    assert WRONG not in found.values()
    covered = [what for (_, kind), what in found.items() if kind in ("CSV, gzip", "MCAP, chunks")]
    assert UNSEEN not in covered, "a checksum covers every value of these"


def test_the_oracle_finds_what_is_wrong(tmp_path: Path) -> None:
    """The same log with one value that is another, as if no checksum had been looked at."""
    for name, what in (("MCAP, chunks", WRONG), ("CSV", UNSEEN)):
        kind, other = KINDS[name], flight()
        other[60].content["pose"]["pose"]["position"]["x"] += 1e-9
        good = read(kind, kind.written(tmp_path / name / "good", flight()))
        assert outcome(kind, kind.written(tmp_path / name / "other", other), good) == what
        assert outcome(kind, kind.written(tmp_path / name / "again", flight()), good) == SAME


def test_bits_of_a_log_of_soter() -> None:
    assert flips(30, seed=2)[WRONG] == 0


@pytest.mark.long
def test_a_thousand_bits_of_a_log_of_soter() -> None:
    counts = flips(1000, seed=1)
    assert counts[WRONG] == 0
    assert counts[REFUSED] + counts[SAME] == 1000
