"""Numbers that masks choose are those that branches choose."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.campaign import compiled_unit
from soter.campaign.batch_flights import Fleet
from soter.campaign.compiled_unit import generate_measured
from soter.language.front_end import check_file, system_of
from soter.simulate.run import run_interpreted

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

SECOND = 10**9
SEARCH = """soter 1;
input topic wind: float in [-4.0, 4.0];
topic place: float in [-1.0e6, 1.0e6];

fun Find(x: float): float {
  var low = 0;
  var high = 64;
  for step in 0..6 {
    let mid = (low + high) / 2;
    if x >= -4.0 + 0.125 * float(mid) { low = mid; } else { high = mid; }
  }
  var same = 3;
  if x > 0.5 { same = low; } else { same = high; }
  var left = 5;
  var right = 7;
  if x < 1.0 { left = right; } else { right = left; }
  var none = 9;
  if x < -1.0 { none = low; }
  return float(low + 100 * same + 10000 * left + 70000 * right + 200 * none);
}

node Finder period 100ms { subscribes wind; publishes place; step { publish place = Find(wind); } }
system Whole default { node Finder; input wind every 100ms; until 10s; never place > 5.0e5; }
"""


def test_flights_with_masks_are_flights_with_branches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "search.soter"
    file.write_text(SEARCH, encoding="utf-8")
    system = system_of(check_file(str(file)), "Whole")
    source = generate_measured(system).source
    assert source.count("const int64_t given_mask_") == 3, "the one with one side is left"
    flights = Fleet(system, 5 * SECOND).fly(range(8), first_seed=1)
    assert flights[0].violations == run_interpreted(system, 5 * SECOND, 1).violations > 0
    monkeypatch.setattr(compiled_unit, "without_branches", lambda f: f)
    assert "given_mask_" not in generate_measured(system).source
    assert Fleet(system, 5 * SECOND).fly(range(8), first_seed=1) == flights
