"""People: a rover that nobody is touched by while it moves, whatever they do.

Purpose: examples/exploration/people.soter is proved, and somebody else agrees; people who mean to
be hit are not, by a moving rover; one that does not switch hits them.
Non-goals: wrong modules (`unit/verify/claims/test_passive_safety.py`).
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import soter
from unit.certificate import small_proofs

PEOPLE = Path(__file__).resolve().parents[2] / "examples" / "exploration" / "people.soter"
SEEDS = range(1, 6)
KINDS = {
    "they walk into it": "Hunting",
    "they wait until it is fast": "Luring",
    "they stroll": "Strolling",
}


def test_it_is_proved_and_somebody_else_agrees(tmp_path: Path) -> None:
    report = soter.load(PEOPLE).verify(refute=False, cert=tmp_path / "cert")
    verdicts = {name: f.verdict for name, f in report["Passive"].findings.items()}
    assert verdicts.pop("P2b") == "assumed"  # `recover never`
    assert verdicts.pop("failsafe") == "assumed"  # none is declared
    assert set(verdicts.values()) == {"proved"}, verdicts
    again = soter.recheck(tmp_path / "cert")
    assert again.accepted, again.reason
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text("utf-8"))
    assert manifest["params"]["KIND"] == 0
    manifest["params"]["KIND"] = 3  # it has three members: 0, 1 and 2
    small_proofs.seal(tmp_path / "cert", manifest)
    forged = soter.recheck(tmp_path / "cert")
    assert not forged.accepted
    assert "KIND" in forged.reason


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_nobody_is_hit_by_a_rover_that_moves(kind: str) -> None:
    program = soter.load(PEOPLE)
    for seed in SEEDS:
        run = program.simulate(system="Hunted", seed=seed, params={"KIND": kind})
        assert run.violations == 0, run.violation_list
        assert run.modules["Passive"].switches_to_sc > 2


def test_people_are_hit_where_nobody_switches(tmp_path: Path) -> None:
    text = PEOPLE.read_text("utf-8")
    old = "ttf seen.gap < need(seen.v) || abs(seen.v) > FAST;"
    assert old in text
    (tmp_path / "people.soter").write_text(
        text.replace(old, "ttf seen.gap < 0.0;"), encoding="utf-8"
    )
    program = soter.load(tmp_path / "people.soter")
    for kind in KINDS.values():
        run = program.simulate(system="Hunted", seed=1, params={"KIND": kind})
        assert run.violations > 0
