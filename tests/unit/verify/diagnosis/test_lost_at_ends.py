"""K that is lost because an axis ends where the flow comes to rest: a longer one is tried."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from unit.verify.diagnosis.tank_modules import explained

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

BOILER = """soter 1;
type Heat = { t: float, h: float };
topic heat: Heat max_age 500ms;
topic power: float in [0.0, 3.0] = 0.0;
plant Boiler period 500ms {
  reads power;
  drives heat = { t: t, h: h };
  state t: float in [40.0, 60.0];
  state h: float = 0.0;
  disturbance inflow: float in [-0.5, 0.5] hold 2s;
  der t = 4.0 * h - 0.1 * (t - 20.0) + inflow;
  der h = (power - h) / 2.0;
}
extern node Learned period 1s { subscribes heat; publishes power; }
node Cool period 500ms {
  subscribes heat;
  publishes power;
  step { publish power = clamp(0.1 * (50.0 - heat.t), 0.0, 3.0); }
}
rta Keep {
  ac Learned; sc Cool; period 1s;
  safe heat.t < 90.0;
  verify { grid heat.t in [10.0, 90.0] / 40, heat.h in [LOW, HIGH] / CELLS; }
}
system Protected { b: Boiler; module Keep; until 120s; }
"""


def boiler(low: float, high: float, *changes: tuple[str, str]) -> ModuleResult:
    text = BOILER.replace("LOW", str(low)).replace("HIGH", str(high))
    text = text.replace("CELLS", str(round(10 * (high - low))))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return explained(text)


def longer(module_result: ModuleResult) -> list[str]:
    """The longer axes that were tried, and what came of them."""
    told = [t for f in module_result.findings.values() for t in f.tried]
    return [t for t in told if "a longer axis: " in t]


MIRRORED = (("4.0 * h", "-4.0 * h"), ("(power - h)", "(-power - h)"))


@pytest.mark.parametrize(
    ("low", "high", "changes"),
    [(0.0, 3.5, ()), (-3.5, 0.0, MIRRORED)],
    ids=["lower", "upper"],
)
def test_the_end_at_which_k_is_lost_is_moved(
    low: float, high: float, changes: tuple[tuple[str, str], ...]
) -> None:
    result = boiler(low, high, *changes)
    assert result.verdict == "undecided"
    (told,) = (t for t in longer(result) if t.startswith("with a longer axis: "))
    grid = re.search(r"`grid b\.t in \[[^`]*, b\.h in \[([^,]*), ([^\]]*)\] / \d+;`", told)
    assert grid is not None
    assert float(grid[1]) < 0.0 < float(grid[2])
    assert float(grid[1]) <= low < high <= float(grid[2])


@pytest.mark.long
def test_ends_of_two_axes() -> None:
    """SC turns it off: both states go to 0, and stay there."""
    result = boiler(
        0.0,
        3.0,
        ("4.0 * h - 0.1 * (t - 20.0) + inflow", "(h - t) / 2.0"),
        ("  disturbance inflow: float in [-0.5, 0.5] hold 2s;\n", ""),
        ("t: float in [40.0, 60.0]", "t: float = 1.0"),
        ("clamp(0.1 * (50.0 - heat.t), 0.0, 3.0)", "0.0"),
        ("heat.t < 90.0", "heat.t < 2.5"),
        ("[10.0, 90.0] / 40", "[0.0, 3.0] / 30"),
    )
    assert any(t.startswith("with a longer axis: `grid b.t in [-0.3, ") for t in longer(result))


def test_a_longer_axis_is_not_tried_where_nothing_is_lost_there() -> None:
    assert boiler(-0.5, 3.5).verdict == "proved"


@pytest.mark.parametrize("low", [0.0, -0.5])
def test_an_sc_that_is_too_weak_is_not_helped_by_an_axis(low: float) -> None:
    """It heats on: from every state the boiler gets too hot, however long the axis is."""
    weak = ("clamp(0.1 * (50.0 - heat.t), 0.0, 3.0)", "clamp(0.1 * (95.0 - heat.t), 2.0, 3.0)")
    result = boiler(low, 3.0, weak)
    assert result.verdict != "proved"
    assert not any(t.startswith("with a longer axis") for t in longer(result))
