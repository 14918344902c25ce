"""A node that says how long its steps take: a proof counts with the longest, on both sides."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from bench.recheck.small_modules import PROGRAMS

import soter
from soter.api import recheck
from soter.diagnostics.diagnostic import SoterError
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

SAID = ("Estimate 1ms, Driver 1ms", "Driver 1ms")
TAKES = ("node Estimate period 10ms {", "node Estimate period 10ms { takes [1us, 1ms];")


def saved(folder: Path, *pairs: tuple[str, str]) -> Path:
    text = PROGRAMS["flying"]
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = folder / "small.soter"
    path.write_text(text)
    return path


def program(folder: Path, *pairs: tuple[str, str]) -> soter.Program:
    return soter.load(saved(folder, *pairs))


def proved(folder: Path, *pairs: tuple[str, str]) -> dict[str, Any]:
    """What a certificate says of the module; it is in `folder / "cert"`."""
    folder.mkdir()
    program(folder, *pairs).verify(refute=False, cert=folder / "cert")
    manifest = json.loads((folder / "cert" / "manifest.json").read_text())
    entry: dict[str, Any] = manifest["modules"][0]
    return entry


@pytest.mark.long
def test_a_proof_counts_with_the_longest_and_its_certificate_is_accepted(tmp_path: Path) -> None:
    said, takes = proved(tmp_path / "said"), proved(tmp_path / "takes", SAID, TAKES)
    assert takes["times"] == said["times"]
    report = recheck(tmp_path / "takes" / "cert")
    assert report.accepted, report.reason


def test_a_longer_step_makes_what_is_read_older(tmp_path: Path) -> None:
    longer = (TAKES[0], TAKES[1].replace("1ms", "3ms"))
    short, long = (
        small_proofs.facts_of(saved(tmp_path, SAID, by), "S", "M").times for by in (TAKES, longer)
    )
    assert long["A_ns"] == short["A_ns"] + 2_000_000


def test_a_step_longer_than_its_period_is_no_part_of_a_proof(tmp_path: Path) -> None:
    longer = (TAKES[0], TAKES[1].replace("1ms", "11ms"))
    with pytest.raises(SoterError, match="R015"):
        program(tmp_path, SAID, longer).verify(refute=False)
