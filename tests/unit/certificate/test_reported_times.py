"""The times that the re-checker reports are the program's, whatever a manifest says."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import pytest
from bench.recheck.overstated import Base, base_of, sealed
from bench.recheck.small_modules import Edit

from soter.api import recheck

if TYPE_CHECKING:
    from pathlib import Path

LATE_BY = 53_000_000
"""ns: `silent` declares drop-outs of 20 ms, ages of 30 ms, lateness and answers of 1 ms each."""


@lru_cache
def silent() -> Base:
    return base_of("silent")


def test_a_right_certificate_says_when_sc_first_answers_to_a_silent_sensor() -> None:
    assert silent().reached["h0_ns"] == LATE_BY


@pytest.mark.parametrize("less", [1, 10_000_000, 20_000_000])
def test_a_lowered_h0_is_refused_or_the_true_one_reported(tmp_path: Path, less: int) -> None:
    def lower(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["times"]["h0_ns"] -= less

    sealed(tmp_path / "cert", silent(), Edit("times", "h0_ns", False, lower, None, None))
    report = recheck(tmp_path / "cert")
    for module in report.modules:
        assert module.times["h0_ns"] >= silent().reached["h0_ns"]
