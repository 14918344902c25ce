"""Rest that is not shown of reads as old as `max_age` lets them be: what is told was tried."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.api import Program

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import ModuleResult

SLED = """soter 1;
topic at: float max_age 500ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant Sled period 10ms {
  reads push;
  drives at = x;
  state x: float = 0.0;
  disturbance wind: float in [-0.1, 0.1];
  der x = push + wind;
  measured at within 0.01;
}
node Go period 100ms { publishes push; step { publish push = 1.0; } }
node Back period 100ms {
  subscribes at; publishes push; step { publish push = clamp(-4.0 * at, -1.0, 1.0); } }
rta Keep {
  ac Go;
  sc Back;
  period 100ms;
  safe abs(at) < 3.0;
  rest abs(at) < 0.2 within 2s;
}
system S default { s: Sled; module Keep; until 2s; }
"""


def verified(folder: Path, text: str, explain: bool = True) -> ModuleResult:
    path = folder / "sled.soter"
    path.write_text(text, encoding="utf-8")
    return Program(str(path)).verify(refute=False, explain=explain).modules[0]


def test_younger_reads_that_are_told_show_rest_when_they_are_written(tmp_path: Path) -> None:
    found = verified(tmp_path, SLED).findings["P2a"]
    assert found.verdict == "undecided"
    told = re.search(r"`(max_age \w+)` of `at` \(tried: rest is shown\)", found.hint)
    assert told is not None
    again = verified(tmp_path, SLED.replace("max_age 500ms", told[1]))
    assert again.findings["P2a"].verdict == "proved"


def test_younger_reads_that_do_not_help_are_told_as_such(tmp_path: Path) -> None:
    text = SLED.replace("in [-0.1, 0.1]", "in [-2.0, 2.0]")
    found = verified(tmp_path, text).findings["P2a"]
    assert found.verdict == "undecided"
    assert "(tried: rest is shown)" not in found.hint
    assert "(tried: not enough)" in found.hint


def test_nothing_is_tried_where_nobody_asks_for_it(tmp_path: Path) -> None:
    found = verified(tmp_path, SLED, explain=False).findings["P2a"]
    assert found.verdict == "undecided"
    assert "(tried:" not in found.hint
