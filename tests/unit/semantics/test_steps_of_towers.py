"""A module in the place of AC: docs/semantics.md, Modules above modules."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file, system_of
from soter.language.model.system import modules_above
from soter.semantics.configuration import StepOutcome
from soter.semantics.interpreter import Interpreter
from tables import all_rows

if TYPE_CHECKING:
    from soter.semantics.configuration import Configuration

TOWER = """soter 1;
input topic high: bool;
input topic middle: bool;
input topic low: bool;
input topic fails: bool;
topic u: int in [0, 9];
topic told: bool;
node Ac period 10ms {
  subscribes fails; publishes u;
  var taken: int in [0, 99];
  on takeover { taken = taken + 1; }
  step { assert !fails; publish u = in_control ? 4 : 9; }
}
node LowSc period 10ms { publishes u; step { publish u = in_control ? 3 : 9; } }
node MiddleSc period 10ms { publishes u; step { publish u = in_control ? 2 : 9; } }
node HighSc period 10ms { publishes u; step { publish u = in_control ? 1 : 9; } }
rta Low { ac Ac; sc LowSc; period 20ms; safe true; ttf low; safer !low; clean 2; }
rta Middle { ac module Low; sc MiddleSc; period 20ms; safe true; ttf middle; safer !middle; }
rta High { ac module Middle; sc HighSc; period 20ms; safe true; ttf high; safer !high; }
node Tells period 10ms { publishes told; step { publish told = mode(Low) == Mode.AC; } }
system S { module High; node Tells; until 1s; FORCE }
"""
NAMES = ("High.HighSc", "High.Middle.MiddleSc", "High.Middle.Low.LowSc", "High.Middle.Low.Ac")
DMS = ("High.dm", "High.Middle.dm", "High.Middle.Low.dm")


class Driver:
    """Sets the inputs and lets components step, in any order."""

    def __init__(self, force: str = "") -> None:
        checked = check_file("tower.soter", TOWER.replace("FORCE", force))
        assert checked.ok, [d.message for d in checked.diagnostics.items]
        self.system = system_of(checked, None)
        self.it = Interpreter(self.system)
        self.c: Configuration = replace(self.it.initial(), ct=0)

    def put(self, **values: bool) -> None:
        for name, value in values.items():
            self.c = self.it.publish(self.c, {self.system.topic(name).index: value})

    def step(self, *names: str) -> None:
        for name in names:
            n = self.system.component(name).index
            self.c, event = self.it.fire(replace(self.c, FN=(n,)), n)
            if isinstance(event, StepOutcome):
                assert not event.latched

    @property
    def control(self) -> list[str]:
        return [n for n in NAMES if self.c.OE[self.system.component(n).index]]

    @property
    def u(self) -> object:
        return self.c.Topics[self.system.topic("u").index]


def test_every_module_starts_in_sc_and_the_topmost_sc_has_control() -> None:
    d = Driver()
    assert d.control == ["High.HighSc"]
    d.step(*NAMES)
    assert d.u == 1
    assert [m.name for m in d.system.modules] == ["High", "High.Middle", "High.Middle.Low"]
    assert [m.name for m in modules_above(d.system, 2)] == ["High.Middle", "High"]


@all_rows("order", [DMS, DMS[::-1], (DMS[1], DMS[0], DMS[2])])
@all_rows("unsafe", range(8))
def test_the_topmost_module_in_sc_has_control_whoever_decides_first(
    order: tuple[str, ...], unsafe: int
) -> None:
    d = Driver()
    d.step(*DMS)
    assert d.control == ["High.Middle.Low.Ac"]
    high, middle, low = (bool(unsafe >> i & 1) for i in range(3))
    d.put(high=high, middle=middle, low=low)
    d.step(*order)
    at = 0 if high else 1 if middle else 2 if low else 3
    assert d.control == [NAMES[at]]
    d.step(*NAMES)
    assert d.u == at + 1
    d.put(high=False, middle=False, low=False)
    d.step(*order[::-1])
    assert d.control == ["High.Middle.Low.Ac"]


def test_the_module_below_goes_on_deciding() -> None:
    d = Driver()
    d.put(high=True)
    d.step(*DMS, "Tells")
    assert d.c.Topics[d.system.topic("told").index] is True
    assert d.control == ["High.HighSc"]


def test_takeover_runs_where_control_comes_through_all_modules() -> None:
    d = Driver()
    ac = d.system.component("High.Middle.Low.Ac").index
    d.step("High.Middle.Low.dm", "High.Middle.Low.Ac")
    assert d.c.L[ac] == (0,)
    d.step("High.dm", "High.Middle.dm", "High.Middle.Low.Ac", "High.Middle.Low.Ac")
    assert d.c.L[ac] == (1,)
    d.put(middle=True)
    d.step("High.Middle.dm", "High.Middle.Low.Ac")
    d.put(middle=False)
    d.step("High.Middle.dm", "High.Middle.Low.Ac")
    assert d.c.L[ac] == (2,)


def test_a_gate_fault_is_the_business_of_the_module_of_that_ac() -> None:
    d = Driver()
    d.step(*DMS)
    d.put(fails=True)
    d.step("High.Middle.Low.Ac", *DMS)
    assert d.control == ["High.Middle.Low.LowSc"]
    assert d.c.clean_needed == (0, 0, 2)
    d.put(high=True, fails=False)
    d.step("High.dm")
    d.put(fails=True)
    d.step("High.Middle.Low.Ac")
    assert d.c.gate_fault == (False, False, False), "it had no control"


@pytest.mark.parametrize(
    ("force", "control"),
    [
        ("force High ac;", "High.Middle.MiddleSc"),
        ("force High sc;", "High.HighSc"),
    ],
)
def test_a_forced_module_keeps_its_mode(force: str, control: str) -> None:
    d = Driver(force)
    assert d.control == [control]
    d.put(high="ac" in force)
    d.step("High.dm")
    assert d.control == [control]
