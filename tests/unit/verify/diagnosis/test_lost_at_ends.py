"""K that is lost because an axis ends where the flow comes to rest: the end is named, not SC."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from unit.verify.diagnosis.tank_modules import explained

if TYPE_CHECKING:
    from soter.verify.claims.results import Cause, ModuleResult

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


def lost(module_result: ModuleResult) -> list[Cause]:
    causes = [c for f in module_result.findings.values() for c in f.causes]
    return [c for c in causes if c.kind == "lost_at_end"]


MIRRORED = (("4.0 * h", "-4.0 * h"), ("(power - h)", "(-power - h)"))


@pytest.mark.parametrize(
    ("low", "high", "changes"),
    [(0.0, 3.5, ()), (-3.5, 0.0, MIRRORED)],
    ids=["lower", "upper"],
)
def test_the_end_at_which_k_is_lost_is_named(
    low: float, high: float, changes: tuple[tuple[str, str], ...]
) -> None:
    result = boiler(low, high, *changes)
    assert result.verdict == "undecided"
    why, *_ = lost(result)
    assert "the grid ends at b.h = 0, where `safe` still holds" in why.text
    numbers = dict(why.numbers)
    assert numbers["share_of_C"] > numbers["before"] + 0.05
    told = [t for f in result.findings.values() for t in (*f.tried, f.hint)]
    assert any("a longer axis: `grid b.t" in t for t in told)


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
    why, *_ = lost(result)
    assert "the grid ends at b.t = 0 and b.h = 0, where" in why.text


def test_a_longer_axis_is_no_cause_where_nothing_is_lost_there() -> None:
    assert boiler(-0.5, 3.5).verdict == "proved"


@pytest.mark.parametrize("low", [0.0, -0.5])
def test_an_sc_that_is_too_weak_is_not_blamed_on_an_axis(low: float) -> None:
    """It heats on: from every state the boiler gets too hot, however long the axis is."""
    weak = ("clamp(0.1 * (50.0 - heat.t), 0.0, 3.0)", "clamp(0.1 * (95.0 - heat.t), 2.0, 3.0)")
    result = boiler(low, 3.0, weak)
    assert result.verdict != "proved"
    assert lost(result) == []
