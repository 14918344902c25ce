"""The drone's laps and a corridor on Betaflight: the coordinates of the proof, wrong modules, laps.

Purpose: that walls' plants are `fence.Loop` in other coordinates; that modules which count on what
the vehicle does not keep are not proved; and, where the firmware is built, single flights.
Non-goals: 2,000 flights (`bench/autopilot/laps.py`), the firmware itself (`test_autopilot.py`).
"""

from __future__ import annotations

import os
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import soter

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
FIRMWARE = Path(
    os.environ.get("SOTER_AUTOPILOT", Path.home() / ".cache" / "soter" / "autopilot" / "betaflight")
)
needs_firmware = pytest.mark.skipif(
    not FIRMWARE.is_file(), reason="Betaflight is not built: examples/autopilot/firmware.py"
)


def copied(tmp_path: Path) -> Path:
    """A copy of both examples; the folder of the autopilot's."""
    for name in ("autopilot", "drone"):
        shutil.copytree(EXAMPLES / name, tmp_path / name)
    return tmp_path / "autopilot"


def changed(path: Path, was: str, now: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert was in text
    path.write_text(text.replace(was, now), encoding="utf-8")


# ---------------------------------------------------------------- the coordinates of the proof

BESIDE = """soter 1;
import "autopilot.soter" as fence;
import "corridor.soter" as corridor;
input topic whim: Vec3 in [-1.5, 1.5];
topic shown: fence.Motion;
node Shake period 10ms {
  subscribes whim;
  publishes fence.accel;
  step { publish fence.accel = whim; }
}
plant Lags period 5ms {
  reads fence.accel;
  drives shown = { p: p, v: v, a: a, b: b };
  state p: Vec3; state v: Vec3; state a: Vec3; state b: Vec3;
  der p = v;
  der v = b - fence.LOOP.drag * v + fence.Off(vec3(SHARE, SHARE, SHARE));
  der b = fence.LOOP.lag * (a - b);
  der a = fence.LOOP.lag * (fence.accel - a);
}
system Highs {
  l: Lags; m: fence.Loop; x: corridor.East; y: corridor.North; z: corridor.Above;
  node Shake; input whim every 300ms; until 2500ms;
}
system Lows {
  l: Lags; m: fence.Loop; x: corridor.West; y: corridor.South; z: corridor.Below;
  node Shake; input whim every 300ms; until 2500ms;
}
"""


@pytest.mark.parametrize(("system", "sign"), [("Highs", 1.0), ("Lows", -1.0)])
@pytest.mark.parametrize("share", [-1.0, 0.0, 0.5])
def test_the_fences_loop_and_walls_are_the_lags_in_other_coordinates(
    tmp_path: Path, system: str, sign: float, share: float
) -> None:
    """The same commands and the same residual: the same distances, whatever is flown."""
    folder = copied(tmp_path)
    changed(
        folder / "autopilot.soter", "share: Vec3 in [-1.0, 1.0]", f"share: Vec3 in {[share] * 2}"
    )
    for bound in ("side", "up"):
        held = f"{sign * share} * fence.LOOP.{bound}"
        changed(
            folder / "corridor.soter",
            f"[-fence.LOOP.{bound}, fence.LOOP.{bound}]",
            f"[{held}, {held}]",
        )
    (folder / "beside.soter").write_text(BESIDE.replace("SHARE", str(share)), encoding="utf-8")
    program = soter.load(folder / "beside.soter")
    run = program.simulate(system, seed=5, sha256=False)
    known = {n: program.constant(f"corridor.{n}") for n in ("LAMBDA", "T", "SHARE")}
    rate, start = known["LAMBDA"], program.constant("corridor.START_ROOM")
    w_of_b = program.constant("fence.W_OF_B")
    p, v, a, b = (run.array(f"l.truth.{n}") for n in "pvab")
    assert run.violations == 0
    assert np.abs(v).max() > 0.5
    states = {
        "p": p,
        "q1": p + v / rate,
        "q": p + known["T"] * v + b / rate**2,
        "w": known["SHARE"] * v + w_of_b * b + a / rate,
    }
    for name, state in states.items():
        assert np.abs(run.array(f"m.truth.{name}") - state).max() < 1e-6, name
        for k, axis in enumerate("xyz"):
            wall = run.array(f"{axis}.truth.{name}")
            expected = sign * state[:, k] if name == "w" else start - sign * state[:, k]
            # Plants of 10 ms hold their state between the steps of one of 5 ms.
            assert np.abs(wall - expected)[::2].max() < 1e-6, (name, axis)


def test_the_follower_shows_those_coordinates() -> None:
    program = soter.load(EXAMPLES / "autopilot" / "corridor.soter")
    known = {n: program.constant(f"fence.{n}") for n in ("LAMBDA", "T", "SHARE", "W_OF_B")}
    start = program.constant("drone.START")
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    v, a, b = ({**zero, "y": s} for s in (1.5, -0.7, 0.4))
    m = program.function("moving")({"p": {**zero, "y": 2.0}, "v": v, "a": a, "b": b})
    assert m.p.y == pytest.approx(start.y + 2.0)
    assert m.q1.y == pytest.approx(start.y + 2.0 + 1.5 / known["LAMBDA"])
    assert m.q.y == pytest.approx(start.y + 2.0 + known["T"] * 1.5 + 0.4 / known["LAMBDA"] ** 2)
    assert m.w.y == pytest.approx(
        known["SHARE"] * 1.5 + known["W_OF_B"] * 0.4 - 0.7 / known["LAMBDA"]
    )


# ---------------------------------------------------------------- the proof


@pytest.mark.long
def test_the_corridor_is_proved_of_the_identified_loop(tmp_path: Path) -> None:
    program = soter.load(EXAMPLES / "autopilot" / "corridor.soter")
    report = program.verify(system="Protected", module="SafeCorridor", cert=str(tmp_path / "proof"))
    assert {m.verdict for m in report.modules} == {"proved"}
    assert soter.recheck(tmp_path / "proof").accepted


WRONG = {
    "a residual three times as large": ("loop.json", '"side": 0.73', '"side": 2.19'),
    "speed forgotten": (
        "corridor.soter",
        "let faster = m.toward + E_V;",
        "let faster = 0.0 * m.toward;",
    ),
    "brakes too good": ("corridor.soter", "const B: float = 1.9;", "const B: float = 3.5;"),
    "SC lets go": (
        "corridor.soter",
        "publish fence.accel = Law(drone.alongX, drone.alongY, drone.alongZ, drone.wish)",
        "publish fence.accel = vec3(0.0, 0.0, 0.0)",
    ),
    "the next box unseen": (
        "corridor.soter",
        "if MayEnter(blocks[at + 1], m) {",
        "if at >= 0 {",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_module_is_not_proved(tmp_path: Path, name: str) -> None:
    file, was, now = WRONG[name]
    folder = copied(tmp_path)
    changed(folder / file, was, now)
    program = soter.load(folder / "corridor.soter")
    report = program.verify(system="Protected", module="SafeCorridor", refute=False)
    verdicts = {m.name: m.verdict for m in report.modules}
    assert "proved" not in {verdicts[f"SafeCorridor as {view}"] for view in ("east", "west")}


# ---------------------------------------------------------------- flights


@cache
def laps() -> soter.Program:
    return soter.load(EXAMPLES / "autopilot" / "laps.soter")


def flown(system: str, seed: int, **params: Any) -> Any:
    return laps().simulate(system, seed=seed, params=params, sha256=False)


@pytest.mark.parametrize("cross", [False, True])
def test_the_drones_own_loop_flies_the_same_boxes(cross: bool) -> None:
    run = flown("OwnLaps", 61, CROSS=cross)
    assert run.violations == 0
    assert run.array("f.lap.finished")[-1] == 1


@needs_firmware
@pytest.mark.parametrize("cross", [False, True])
def test_betaflight_arrives_and_touches_nothing(cross: bool) -> None:
    run = flown("Laps", 62, CROSS=cross)
    assert run.violations == 0
    assert run.array("f.lap.finished")[-1] == 1
    assert 0.5 < run.array("f.lap.ac_s")[-1] / run.array("f.lap.lap_s")[-1] < 1.0
    assert not run.array("f.fence.parted").any()


@needs_firmware
def test_the_same_controller_alone_touches_a_wall() -> None:
    assert flown("Bare", 62).violations > 0


@needs_firmware
@pytest.mark.parametrize("seed", range(63, 68))
def test_hostile_controllers_leave_no_box(seed: int) -> None:
    run = flown("Laps", seed, HOSTILE=True)
    assert run.violations == 0
    assert not run.array("f.fence.parted").any()


@needs_firmware
def test_a_vehicle_that_is_another_raises_the_alarm_before_it_touches_anything() -> None:
    run = flown("Laps", 62, **{"fence.MASS": 1.3, "fence.FAULT": 3.0})
    parted = run.array("f.fence.parted") > 0
    began = run.time_s()[np.argmax(parted)]
    assert parted[-1]
    assert 3.0 <= began < 5.0
    assert all(v.time_s > began for v in run.violation_list)
