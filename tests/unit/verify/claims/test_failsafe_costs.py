"""What a fail-safe law costs: a law that keeps nothing is given up soon, and no other one is.

Counted in holds of the engine, never in seconds. Without the limit the truck's laws take from 50 to
90 holds a cell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.language.front_end import check_file, system_of
from soter.verify.claims import claims
from soter.verify.deploy.missing_predicates import complete
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.grid.sets import Core, GridGroup
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System
    from soter.verify.grid.case import Case

TRUCK = """soter 1;
topic truck: { h: float, w: float, v: float } max_age 20ms;
topic command: { lift: float, drive: float } in { lift in [-0.5, 0.5], drive in [-1.5, 1.5] };
plant Truck period 10ms {
  reads command;
  drives truck = { h: h, w: w, v: v };
  state h: float = 0.5;
  state w: float = 0.0;
  state v: float = 0.0;
  disturbance floor: float in [-FLOOR, FLOOR] hold 200ms;
  der h = w;
  der w = (command.lift - w) / 0.25;
  der v = MOTOR + floor;
}
node Wms period 20ms {
  publishes command;
  step { publish command = { lift: 0.5, drive: 1.5 }; }
}
node Stop period 20ms {
  subscribes truck;
  publishes command;
  step {
    publish command = {
      lift: clamp(0.5 - truck.h, -0.5, 0.5),
      drive: clamp(-2.0 * truck.v, -1.5, 1.5)
    };
  }
}
rta Stability {
  ac Wms;
  sc Stop;
  period 40ms;
  safe abs(truck.v) * (1.0 + truck.h) < 6.0 && truck.h > 0.0 && truck.h < 4.0;
  failsafe command = { lift: 0.0, drive: 0.0 };
  verify {
    grid truck.h in [0.0, 4.0] / 20, truck.w in [-0.6, 0.6] / 12, truck.v in [-5.0, 5.0] / 30;
    late dm 1ms, sc 1ms;
    response dm 1ms, sc 1ms;
    acts within 2ms;
    levels 2;
  }
}
system Guarded { t: Truck; module Stability; until 10s; }
"""
BEND = "command.drive / (1.0 + 0.1 * h)"
HOPELESS = {
    "a disturbance moves it": {"FLOOR": "0.1", "MOTOR": "command.drive"},
    "a speed only decays": {"FLOOR": "0.0", "MOTOR": "command.drive"},
    "its axes hang together": {"FLOOR": "0.1", "MOTOR": "command.drive - 0.3 * v + 0.1 * h"},
}
BENT = {"FLOOR": "0.1", "MOTOR": "command.drive / (1.0 + 0.1 * h)"}
SWING = """soter 1;
topic motion: { x: float, v: float } max_age 20ms;
topic push: float in [-3.0, 3.0] = 0.0;
plant Bob period 10ms {
  reads push;
  drives motion = { x: x, v: v };
  state x: float;
  state v: float;
  disturbance wind: float in [-0.05, 0.05];
  der x = v;
  der v = push - RESTORE - DAMP * v + wind;
}
node Fast period 10ms { publishes push; step { publish push = 3.0; } }
node Careful period 10ms {
  subscribes motion;
  publishes push;
  step { publish push = clamp(-2.0 * motion.x - 3.0 * motion.v, -3.0, 3.0); }
}
rta Guard {
  ac Fast;
  sc Careful;
  period 50ms;
  safe abs(motion.x) < 10.0;
  failsafe push = 0.0;
  verify { grid motion.x in [-11.0, 11.0] / 60, motion.v in [-16.0, 16.0] / 60; levels 3; }
}
system Track { b: Bob; module Guard; until 10s; }
"""
KEPT = [("1.5 * x", "0.4"), ("1.5 * x", "0.2"), ("7.5 * sin(0.2 * x)", "0.4")]


def filled(source: str, **words: str) -> str:
    for name, word in words.items():
        source = source.replace(name, word)
    return source


def flat_of(source: str) -> System:
    checked = check_file("truck.soter", source)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return system_of(checked, None)


def law_of(source: str) -> Case:
    """The module with its law in the place of SC, C told."""
    flat = flat_of(source)
    law = extract(flat, flat.modules[0]).law
    assert law is not None
    case = claims.open_case(law, library_of(law)[0], law.groups, ())
    assert claims.compute_constraint(case)
    return case


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> list[Core]:
    """Every K that is computed, in order: that of the law comes before that of SC."""
    found: list[Core] = []
    core: Callable[..., Core] = GridGroup.compute_core

    def remembered(self: GridGroup, *args: object, **options: object) -> Core:
        found.append(core(self, *args, **options))
        return found[-1]

    monkeypatch.setattr(GridGroup, "compute_core", remembered)
    monkeypatch.setattr("soter.verify.deploy.missing_predicates._cached_sets", lambda *_: None)
    # P2b, which looks for sets as well, has none here
    monkeypatch.setattr(
        "soter.verify.deploy.missing_predicates.cases_with_way_back", lambda done: done
    )
    return found


@pytest.mark.parametrize(
    "words",
    [*HOPELESS.values(), pytest.param(BENT, marks=pytest.mark.long)],
    ids=[*HOPELESS, "the flow is not linear"],
)
def test_a_law_that_keeps_nothing_is_given_up_soon(
    words: dict[str, str], cores: list[Core]
) -> None:
    flat = flat_of(filled(TRUCK, **words))
    (note,) = complete(flat)
    law, own = cores
    assert not law.cells.any()
    assert own.cells.any()
    assert law.vain > 100
    assert law.steps < 20 * law.witness.size
    assert "may have control" in note


def test_each_module_s_law_is_given_up_for_itself(cores: list[Core]) -> None:
    """Of two modules one has a law that keeps something."""
    other = filled(SWING, RESTORE="1.5 * x", DAMP="0.4").replace("soter 1;", "")
    source = filled(TRUCK, **HOPELESS["a speed only decays"]) + other.replace("system Track", "//")
    source = source.replace(
        "module Stability; until", "b: Bob; module Stability; module Guard; until"
    )
    complete(flat_of(source))
    assert [bool(core.cells.any()) for core in cores] == [False, True, True, True]
    assert [core.vain > 0 for core in cores] == [True, False, False, False]


@pytest.mark.parametrize(("restore", "damp"), KEPT)
def test_a_law_that_keeps_something_is_not_given_up(restore: str, damp: str) -> None:
    """It takes up to 200 holds to come back, and none of its cells is followed for nothing."""
    (proof,) = law_of(filled(SWING, RESTORE=restore, DAMP=damp)).proofs
    engine, allowed = proof.engine, proof.found.allowed
    limited, free = (engine.compute_core(allowed, vain=vain) for vain in (0.001, 0.0))
    assert np.array_equal(limited.witness, free.witness)
    assert free.cells.any()
    assert free.vain == 0
    assert free.witness.max() > 20


def test_what_is_given_up_does_not_hang_on_threads() -> None:
    (proof,) = law_of(filled(TRUCK, **HOPELESS["a disturbance moves it"])).proofs
    engine, allowed = proof.engine, proof.found.allowed
    told = []
    for threads in (1, 2):
        engine.threads = threads
        core = engine.compute_core(allowed, vain=0.001)
        told.append((core.rounds, core.vain, core.cells.any()))
    assert told[0] == told[1]
