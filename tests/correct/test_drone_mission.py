"""What the mission's report shows is what the run did."""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def mission() -> Iterator[Any]:
    sys.path.insert(0, str(DRONE))
    try:
        import mission as module

        yield module
    finally:
        sys.path.remove(str(DRONE))


@functools.cache
def flown(system: str, until_s: float, seed: int, charge: float) -> Any:
    import mission as module

    return module.fly(module.HOSTILE, system, system, until_s=until_s, seed=seed, charge=charge)


@pytest.mark.long
def test_plans_are_kept_as_they_came_into_force(mission: Any) -> None:
    one = flown("Lying", 60.0, 3, 1.0)
    force = one.last["inForce"]
    assert len(one.watch.adopted) == int(force["adopted"]) > 3
    last = one.watch.adopted[-1]
    blocks = force["corridor"]["blocks"]
    count = int(blocks["len"])
    assert len(last.points) == count + 1
    final = mission.array(blocks["items"]["aim"][count - 1])
    assert np.array_equal(last.points[-1], final)
    assert last.number == int(force["number"])


@pytest.mark.long
def test_a_liars_plans_are_turned_down_each_for_a_reason_of_the_program() -> None:
    one = flown("Lying", 60.0, 3, 1.0)
    planner = one.run.modules["SafePlanner"]
    reasons = {p.why for p in one.watch.turned_down}
    assert 100 < len(one.watch.turned_down) <= planner.switches_to_sc
    assert {"InBuilding", "Elsewhere", "Empty"} <= reasons
    assert "Covered" not in reasons
    refused = [way for way in one.flight().ways if way.refused]
    assert len(refused) > 50
    assert all(np.isfinite(way.points).all() for way in refused)


@pytest.mark.long
def test_the_samples_are_the_runs_states() -> None:
    one = flown("Lying", 60.0, 3, 1.0)
    time_s = one.watch.column("time_s")
    assert np.allclose(np.diff(time_s), 0.05)
    assert time_s[-1] == pytest.approx(60.0)
    flight = one.flight()
    share = flight.in_control[:-1].mean()
    assert share == pytest.approx(one.run.modules["SafeMotionPrimitive"].ac_share, abs=0.02)
    assert flight.clearance_m.min() > 0.0
    p = one.run.final["d"]["p"]
    assert np.array_equal(flight.position[-1], [float(p[k]) for k in "xyz"])


def test_the_dock_that_it_is_charged_in_is_named(mission: Any) -> None:
    one = flown("Careless", 60.0, 2, 0.8)
    # 0.8 of the charge is below safer: the DM holds it in its dock, until it is charged
    assert one.docks() == [0]
    assert not one.watch.column("modes")[1, 0]
    names = [name for name, _ in mission.scene([one]).goals]
    assert names == ["p1", "p2", "p3", "p4", "p5", "p6", "dock 1"]
