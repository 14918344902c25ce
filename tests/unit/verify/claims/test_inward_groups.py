"""Groups that no command moves: what they keep by the flow at the ends of their grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.api import load

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
topic seen: { p: float, q: float } max_age 10ms;
topic u: float in [-1.0, 1.0];
plant Lag period 10ms {
  reads u;
  drives seen = { p: p, q: q };
  state p: float;
  state q: float;
  disturbance d: float in [-0.1, 0.1];
  der q = u;
  der p = RATE * (q - p) + d;
}
const RATE: float = @RATE;
node Fast period 10ms { subscribes seen; publishes u; step {
  publish u = seen.q < 9.0 ? 1.0 : 0.0; } }
node Slow period 10ms { subscribes seen; publishes u; step {
  publish u = clamp(-4.0 * seen.q, -1.0, 1.0); } }
rta Keeper {
  ac Fast;
  sc Slow;
  period 10ms;
  safe abs(seen.p) <= 1.5;
  ttf abs(seen.q) > 0.8;
  safer abs(seen.q) < 0.6;
  verify {
    grid seen.q in [-1.0, 1.0] / 200;
    grid seen.p in [-@SIZE, @SIZE] / 1;
  }
}
system S { d: Lag; module Keeper; until 5s; }
"""


def verdict(folder: Path, rate: float, size: float) -> str:
    path = folder / "lag.soter"
    path.write_text(PROGRAM.replace("@RATE", str(rate)).replace("@SIZE", str(size)))
    (module,) = load(path).verify(refute=False).modules
    return str(module.findings["P2a"].verdict)


@pytest.mark.parametrize(
    ("rate", "size", "inwards"),
    [
        (5.0, 1.03, True),  # 5 (1 - 1.03) + 0.1 < 0
        (5.0, 1.01, False),  # 5 (1 - 1.01) + 0.1 > 0
        (-5.0, 1.03, False),  # runs away from q
    ],
)
def test_one_cell_is_kept_exactly_if_the_flow_points_inwards_at_its_ends(
    tmp_path: Path, rate: float, size: float, *, inwards: bool
) -> None:
    assert (verdict(tmp_path, rate, size) == "proved") == inwards
