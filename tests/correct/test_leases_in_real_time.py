"""Three processes: a trusted part, its actuators, the world. Who dies is survived by the law.

A lease of the program lasts a tenth of a second more than anything has to take: a machine that is
busy elsewhere takes longer now and then, so whoever rests on that is marked `real_time`.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest

import processes
from generators.c_packages import EXAMPLES
from generators.channel_programs import (
    AC,
    LAW,
    Number,
    Programs,
    ended,
    going,
    library,
    number_of,
    programs,
    soon,
    source_in,
)
from generators.posix_packages import FORGIVING, QUIET, built, owned, report
from soter.native.compiler import WARNINGS

if TYPE_CHECKING:
    import ctypes
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Programs:
    return programs(tmp_path_factory.mktemp("stop"))


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trusted part over the clock of the test."""
    folder = tmp_path_factory.mktemp("vehicle")
    return owned(source_in(folder), folder / "out", "Vehicle")


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("library"))


def listening(code: ctypes.CDLL, made: Programs, folder: Path) -> Number:
    return Number(code, folder, "speed", number_of(made.trusted, "speed"), writes=False)


def speaking(code: ctypes.CDLL, made: Programs, folder: Path) -> Number:
    return Number(code, folder, "position", number_of(made.trusted, "position"), writes=True)


# ---------------------------------------------------------------- the trusted part dies


@pytest.mark.real_time
def test_a_killed_trusted_part_is_survived_by_the_law_and_a_restart_begins_in_sc(
    made: Programs, code: ctypes.CDLL, tmp_path: Path
) -> None:
    speed = listening(code, made, tmp_path)
    with (
        going(made.actuator, tmp_path) as actuator,
        going(made.world, tmp_path, *FORGIVING) as world,
    ):
        soon(lambda: speed.read() == LAW)  # nobody has spoken
        with going(made.trusted, tmp_path) as trusted:
            soon(lambda: speed.read() == AC)
            os.kill(trusted.pid, signal.SIGKILL)
            soon(lambda: speed.read() == LAW)
        with going(made.trusted, tmp_path) as again:
            time.sleep(1.0)
            assert speed.read() == LAW, "nobody has armed the actuators"
            actuator.send_signal(signal.SIGUSR1)
            soon(lambda: speed.read() == AC)
            run_report = ended(again)
        soon(lambda: speed.read() == LAW)
        assert world.poll() is None, "the world goes on"
        moved = ended(world)
        acted = ended(actuator)
    guard = run_report["modules"]["Guard"]
    assert guard["switches_to_ac"] == guard["switches_to_sc"] + 1, "it began in SC, and ended in AC"
    assert run_report["leases"]["Guard"]["given"] > 0
    assert run_report["topics"]["position"]["taken"] > 0
    assert moved["topics"]["speed"]["taken"] > 0
    guard = acted["modules"]["Guard"]
    assert acted["armed"] == 1
    assert guard["ends"] == 2
    assert guard["refused"] > 0, "what the restart said before it was armed"
    assert guard["older"] == 0
    assert guard["state"] == "ended"


@pytest.mark.real_time
def test_a_trusted_part_that_is_held_up_gives_no_more_leases(
    made: Programs, code: ctypes.CDLL, tmp_path: Path
) -> None:
    speed = listening(code, made, tmp_path)
    with (
        going(made.actuator, tmp_path) as actuator,
        going(made.world, tmp_path, *FORGIVING),
        going(made.trusted, tmp_path) as trusted,
    ):
        soon(lambda: speed.read() == AC)
        os.kill(trusted.pid, signal.SIGSTOP)
        soon(lambda: speed.read() == LAW)
        os.kill(trusted.pid, signal.SIGCONT)
        time.sleep(1.0)
        assert speed.read() == LAW
        run_report = ended(trusted)
        acted = ended(actuator)["modules"]["Guard"]
    assert run_report["leases"]["Guard"]["ended_ns"] is not None
    assert run_report["misses"] > 0
    assert (acted["ends"], acted["older"]) == (1, 0)


# ---------------------------------------------------------------- sensors


def old_reads(run_report: dict[str, Any], module: str, topic: str) -> list[float]:
    """How old a topic was whose read ended the leases, and how old it may be, ms; no note: []."""
    read = re.compile(
        rf"leases of {module} ended as \S+ read `{topic}` ([\d.]+) ms old, of (.+) ms"
    )
    matches = [m for n in run_report["notes"] if (m := read.fullmatch(n))]
    assert len(matches) <= 1
    return [float(x) for m in matches for x in m.groups()]


def heard_by(vehicle: Path, folder: Path, until: str) -> dict[str, Any]:
    """The report of the trusted part, whose clock stands at this time as its run begins."""
    events = [f"clock:{time.monotonic_ns()}:0"]
    options = ["--channels", str(folder), "--until", until, "--wait", "0"]
    return report(vehicle, *options, events=events)


def test_a_sensor_that_falls_silent_ends_the_lease(
    vehicle: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    position = Number(code, tmp_path, "position", number_of(vehicle, "position"), writes=True)
    position.write(1.0)
    run_report = heard_by(vehicle, tmp_path, "2")
    assert run_report["topics"]["position"]["taken"] == 1
    lease = run_report["leases"]["Guard"]
    assert lease["given"] > 0
    assert lease["stale"] > 0
    assert 400_000_000 < lease["ended_ns"] < 800_000_000, "0.6 s after the last value"
    (age_ms, most_ms) = old_reads(run_report, "Guard", "position")
    assert most_ms == 600.0
    assert most_ms < age_ms <= lease["ended_ns"] / 1e6 + 100.0, "the first read that was too old"
    assert run_report["modules"]["Guard"]["takeovers"]["stale"] == 1
    assert run_report["misses"] == 0


@pytest.mark.real_time
def test_a_sensor_that_speaks_nonsense_for_a_while_latches_nothing(
    made: Programs, code: ctypes.CDLL, tmp_path: Path
) -> None:
    speed, position = listening(code, made, tmp_path), speaking(code, made, tmp_path)
    position.write(1.0)
    with going(made.actuator, tmp_path) as actuator, going(made.trusted, tmp_path) as trusted:
        for turn in range(100):
            if turn == 20:
                position.write(float("nan"))
            elif turn == 24:
                position.write(51.0)
            elif turn == 28:
                position.write(1.0, behind_ns=10**10)
            elif turn == 32:
                position.write(1.0, behind_ns=-(10**10))
            elif turn < 36 or turn > 40:  # and nothing for a while
                position.write(1.0)
            time.sleep(0.03)
        assert speed.read() == AC
        run_report = ended(trusted)
        acted = ended(actuator)["modules"]["Guard"]
    topic = run_report["topics"]["position"]
    assert topic["refused"] <= 2
    assert topic["taken"] > 10
    assert topic["refused"] + topic["older"] + topic["future"] >= 1
    assert run_report["leases"]["Guard"]["ended_ns"] is None
    assert acted["ends"] == 0


@pytest.mark.parametrize(
    ("value", "behind_ns", "counted"),
    [
        (float("nan"), 0, "refused"),
        (float("inf"), 0, "refused"),
        (51.0, 0, "refused"),
        (1.0, -(10**10), "future"),
    ],
)
def test_a_value_that_is_none_is_counted_and_not_taken(
    vehicle: Path, code: ctypes.CDLL, tmp_path: Path, value: float, behind_ns: int, counted: str
) -> None:
    position = Number(code, tmp_path, "position", number_of(vehicle, "position"), writes=True)
    position.write(value, behind_ns=behind_ns)
    topic = heard_by(vehicle, tmp_path, "0.3")["topics"]["position"]
    assert topic == {**topic, "taken": 0, "refused": 0, "older": 0, "future": 0, counted: 1}


def test_a_sensor_that_nobody_speaks_for_is_told(made: Programs, tmp_path: Path) -> None:
    run_report = report(
        made.trusted, "--channels", str(tmp_path), "--until", "0.5", "--wait", "0.1", *FORGIVING
    )
    assert any("nobody speaks on `position`" in n for n in run_report["notes"])
    assert run_report["leases"]["Guard"]["given"] == 0
    assert run_report["leases"]["Guard"]["stale"] > 0
    said = [n for n in run_report["notes"] if n.startswith("leases of Guard ended as ")]
    assert len(said) == 1
    assert said[0].endswith("read `position`, which nobody had published")


@pytest.mark.real_time
def test_an_sc_that_latched_gives_no_leases_whoever_has_control(
    made: Programs, code: ctypes.CDLL, tmp_path: Path
) -> None:
    """Decision 110: the DM does not look; nobody is obeyed where SC could not act."""
    speed, position = listening(code, made, tmp_path), speaking(code, made, tmp_path)
    position.write(1.0)
    with going(made.actuator, tmp_path), going(made.trusted, tmp_path) as trusted:

        def becomes(wanted: float, at: float) -> bool:
            position.write(at)
            return speed.read() == wanted

        soon(lambda: becomes(AC, 1.0))
        soon(lambda: becomes(LAW, 31.0))
        for _ in range(30):
            assert becomes(LAW, 1.0)
            time.sleep(0.02)
        run_report = ended(trusted)
    assert run_report["violations"] == 1, "the fault of SC"
    assert run_report["leases"]["Guard"]["ended_ns"] > 0
    assert run_report["misses"] == run_report["leases"]["Guard"]["stale"] == 0
    assert old_reads(run_report, "Guard", "position") == []
    guard = run_report["modules"]["Guard"]
    assert guard["switches_to_ac"] > guard["switches_to_sc"], "AC has control, and is not obeyed"


@pytest.mark.real_time
def test_the_sensor_of_the_page_is_heard_and_hears(tmp_path: Path) -> None:
    examples = EXAMPLES / "wall"
    built(examples / "stop_vehicle.soter", tmp_path / "vehicle")
    vehicle = tmp_path / "vehicle" / "stop_vehicle"
    sources = [examples / "firmware" / "sensor.c", *vehicle.parent.glob("soter_outside.c")]
    sources += (vehicle.parent / name for name in ("soter_channel.c", "soter_posix_check.c"))
    flags = ["-std=c99", *WARNINGS, f"-I{vehicle.parent}"]
    processes.run(["cc", *flags, "-o", tmp_path / "sensor", *sources, "-lm"], check=True)
    with (
        going(vehicle.with_name("stop_vehicle_actuator"), tmp_path) as actuator,
        processes.started([tmp_path / "sensor", tmp_path, "300"], stdout=processes.PIPE) as sensor,
    ):
        run_report = report(vehicle, "--channels", str(tmp_path), "--until", "1")
        said, _ = sensor.communicate(timeout=processes.TIMEOUT_S)
        acted = ended(actuator)["modules"]["Guard"]
    assert run_report["notes"] == []
    assert run_report["topics"]["position"]["taken"] > 10
    late = run_report["leases"]["Guard"]["ended_ns"]
    assert acted["taken"] > 0 or late is not None, "a machine may be late by a millisecond"
    assert acted["ends"] == (1 if acted["taken"] else 0)
    assert acted["older"] == 0
    assert b"last speed 0.000" in said, "the law, or SC"


# ---------------------------------------------------------------- what is not there


def test_without_channels_nothing_is_run(made: Programs) -> None:
    done = processes.run([made.trusted, *QUIET], capture_output=True, text=True)
    assert done.returncode == 1
    assert "`position` comes from outside: --channels FOLDER" in done.stderr
    assert processes.run([made.actuator], capture_output=True).returncode == 2


@pytest.mark.parametrize("what", ["folder", "size", "layout"])
def test_a_channel_that_cannot_be_had_is_told(made: Programs, tmp_path: Path, what: str) -> None:
    folder = tmp_path / "away" if what == "folder" else tmp_path
    if what == "size":
        (tmp_path / "position").write_bytes(bytes(64))
    if what == "layout":
        (tmp_path / "position").symlink_to(tmp_path / "elsewhere")
    done = processes.run(
        [made.trusted, *QUIET, "--channels", folder, "--until", "1"], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert f"not run: the channel `position` in `{folder}`" in done.stderr


def test_a_value_of_another_layout_is_not_taken(
    made: Programs, code: ctypes.CDLL, tmp_path: Path
) -> None:
    other = Number(code, tmp_path, "position", 12345, writes=True)
    other.write(1.0)
    run_report = report(
        made.trusted, "--channels", str(tmp_path), "--until", "0.3", "--wait", "0", *FORGIVING
    )
    topic = run_report["topics"]["position"]
    assert topic["taken"] == 0
    assert topic["bad"] > 0
