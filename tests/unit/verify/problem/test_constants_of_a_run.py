"""Float states without dynamics: constants of a run, of which only the range is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter

if TYPE_CHECKING:
    from pathlib import Path

TANK = """soter 1;
topic level: float max_age 100ms;
topic pump: float in [-0.1, 0.1] = 0.0;
plant Tank period 50ms {
  reads pump;
  drives level = h;
  state h: float = 1.0;
  state gain: float in [GAINS];
  der h = gain * pump;
  measured level within 0.01;
}
node Learned period 100ms {
  subscribes level;
  publishes pump;
  step { publish pump = level < 1.7 ? 0.1 : -0.1; }
}
node Hold period 100ms {
  subscribes level;
  publishes pump;
  step { publish pump = clamp(0.5 * (1.0 - level), -0.1, 0.1); }
}
rta SafeTank {
  ac Learned;
  sc Hold;
  period 100ms;
  safe level > 0.2 && level < 1.8;
  ttf level < 0.3 || level > 1.7;
  safer level > 0.4 && level < 1.6;
  verify { grid level in [0.2, 1.8] / 320; grid t.gain in [GAINS] / 2; }
}
system Plant { t: Tank; module SafeTank; until 60s; }
"""


def _verdicts(folder: Path, gains: str) -> dict[str, str]:
    path = folder / "tank.soter"
    path.write_text(TANK.replace("GAINS", gains), encoding="utf-8")
    report = soter.load(path).verify(refute=False)
    return {name: f.verdict for name, f in report["SafeTank"].findings.items()}


def test_a_constant_of_which_only_the_range_is_known_is_proved_for_the_range(
    tmp_path: Path,
) -> None:
    verdict_by_property = _verdicts(tmp_path, "0.5, 1.5")
    assert set(verdict_by_property.values()) <= {"proved", "assumed"}, verdict_by_property


@pytest.mark.parametrize("gains", ["-1.5, 1.5", "0.5, 9.0"])
def test_a_range_with_values_for_which_it_is_false_is_not_proved(
    tmp_path: Path, gains: str
) -> None:
    verdict_by_property = _verdicts(tmp_path, gains)
    assert "undecided" in verdict_by_property.values(), verdict_by_property
