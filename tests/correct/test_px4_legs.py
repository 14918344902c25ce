"""Legs that PX4 flew: the module of goto.soter has SC in control before a tube is left.

Non-goals: the whole set of legs (`bench/drone/real_logs.py`).
"""

from __future__ import annotations

import csv
import gzip
from pathlib import Path
from typing import Any

import pytest

from soter.api import load
from soter.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
DRONE = ROOT / "examples" / "drone"
PX4_LOG, PX4_MAP = DRONE / "px4_goto.csv.gz", DRONE / "px4_goto.toml"


@pytest.mark.parametrize(("set_", "leg"), [("1", "65"), ("2", "0"), ("3", "44")])
def test_on_a_leg_of_px4_sc_has_control_before_the_tube_is_left(set_: str, leg: str) -> None:
    judge_leg(set_, leg)


def test_the_page_shows_what_the_command_says(capsys: Any) -> None:
    where = ("--where", "set=1", "--where", "leg=65")
    arguments = ("monitor", DRONE / "goto.soter", PX4_LOG, "--map", PX4_MAP, *where)
    assert main([*map(str, arguments)]) == 3
    said = capsys.readouterr().out
    page = (ROOT / "docs" / "real-logs.md").read_text(encoding="utf-8")
    shown = [line for line in said.splitlines() if line.startswith(("module ", "SafeGoTo  "))]
    assert len(shown) == 2
    assert all(line in page for line in shown)


@pytest.mark.long
def test_on_every_leg_of_the_sample_sc_has_control_before_the_tube_is_left() -> None:

    with gzip.open(PX4_LOG, "rt") as file:
        legs = {(r["set"], r["leg"]) for r in csv.DictReader(file)}
    assert len(legs) == 40
    left = sum(judge_leg(*leg) for leg in legs)
    assert left == 13


def judge_leg(set_: str, leg: str) -> bool:
    judged = load(DRONE / "goto.soter").judge_log(PX4_LOG, PX4_MAP, where={"set": set_, "leg": leg})
    (module,) = judged.modules
    assert module.stale == 0
    assert judged.left_out == judged.refused == {}
    if module.first_outside_s is None:
        return False
    before = [c for c in module.changes if c.time_s <= module.first_outside_s]
    assert not before or before[-1].to == "SC"
    return True
