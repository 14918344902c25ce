"""The programs of a MAVLink package beside an autopilot that pymavlink plays.

The peer behaves as PX4's documentation says of OFFBOARD; no autopilot is here. What rests on when
this machine schedules whom is marked. Non-goals: how quickly (`bench/mavlink/peer_loss.py`);
conversions (`tests/unit/targets/test_mavlink_conversion.py`).
"""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import struct
import time
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")

from bench.mavlink import bad_input, peer_loss
from bench.mavlink.mavlink_stack import EXAMPLE, MAPPING, missing, stack
from pymavlink.dialects.v20 import common as mavlink

import processes
import soter
from generators.c_packages import make

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = pytest.mark.skipif(bool(missing()), reason=f"not here: {missing()}")


def built_package(folder: Path, mapping: Path = MAPPING) -> Path:
    soter.load(EXAMPLE).build("mavlink", folder, "Companion", mapping=mapping)
    done = make(folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_package(tmp_path_factory.mktemp("stack") / "package")


@pytest.mark.real_time
@pytest.mark.parametrize("case", list(bad_input.CASES))
def test_what_is_wrong_on_the_wire_commands_nothing(package: Path, case: str) -> None:
    heard, many, ended = bad_input.one(package, case)
    assert heard <= bad_input.RIGHT
    assert ended == ""
    assert many != 0


@pytest.mark.real_time
@pytest.mark.parametrize("who", list(peer_loss.KILLS))
def test_after_a_death_the_autopilot_has_the_command_that_was_declared(
    package: Path, who: str
) -> None:
    delays, wrong = peer_loss.measured(package, who, 1)
    assert wrong == []
    assert delays[0] is not None
    assert delays[0] <= peer_loss.BOUNDS_MS[who]


@pytest.fixture
def wires() -> Any:
    """Makes wires, and closes them."""
    made: list[Any] = []

    def make(port: int) -> Any:
        made.append(bad_input.Wire(port))
        return made[-1]

    yield make
    for wire in made:
        wire.close()


DELAY_NS = 60_000_000  # of the mapping


def running(all_: Any) -> None:
    """Until the bridge hears."""
    said = all_.heard
    processes.until(
        lambda: any("it runs" in x for x in said.get("bridge", [])), all_.running["bridge"]
    )


@contextlib.contextmanager
def listening(package: Path) -> Iterator[Any]:
    """The programs of a package, of which the bridge alone runs, and hears."""
    with stack(package) as all_:
        all_.bridge()
        running(all_)
        yield all_


def taken(all_: Any) -> dict[str, Any]:
    """What the bridge says of motion, at its end."""
    all_.end("bridge")
    report = all_.report()
    assert report["topics"][0]["topic"] == "motion"
    return {**report, "motion": report["topics"][0]}


def silent(wire: Any) -> Any:
    """An autopilot that answers no TIMESYNC."""
    wire.answers = False
    return wire


@pytest.fixture
def without_delay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("late")
    lines = MAPPING.read_text().splitlines()
    text = "\n".join(x for x in lines if not x.startswith("delay ="))
    (folder / "geofence.toml").write_text(text)
    return built_package(folder / "package", folder / "geofence.toml")


def test_without_timesync_and_without_a_delay_nothing_that_has_a_stamp_is_taken(
    without_delay: Path, wires: Any
) -> None:
    with listening(without_delay) as all_:
        wire = silent(wires(all_.port))
        wire.during(1.5, wire.good)
        told = taken(all_)
        assert told["motion"]["without_a_common_clock"] > 0
        assert told["motion"]["taken"] == 0


def test_without_timesync_messages_count_from_their_arrival_and_the_delay(
    package: Path, wires: Any
) -> None:
    with listening(package) as all_:
        wire = silent(wires(all_.port))
        began = time.monotonic_ns()
        wire.during(1.5, wire.good)
        _, measured = newest(all_.channels / "motion")
        assert began - DELAY_NS <= measured <= time.monotonic_ns() - DELAY_NS
        told = taken(all_)
        assert told["motion"]["taken"] == told["motion"]["by_arrival"] > 0
        assert told["clock"]["exchanges"] == 0 < told["clock"]["requests"]


def newest(channel: Path) -> tuple[int, int]:
    """The number of the newest value of a channel, and when it was measured, ns."""
    data = channel.read_bytes()
    places = (0, (len(data) - 64) // 2)  # a line of the cache ends it
    return max(struct.unpack_from("<Qq", data, at + 24) for at in places)


def test_a_message_that_waited_for_a_stopped_bridge_is_as_old_as_it_is(
    package: Path, wires: Any
) -> None:
    """It came when nobody looked: after the last time that somebody did, and no later."""
    with listening(package) as all_:
        wire = silent(wires(all_.port))
        wire.during(1.0, wire.good)
        bridge, motion = all_.running["bridge"], all_.channels / "motion"
        bridge.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, bridge.pid, os.WSTOPPED)
        before, _ = newest(motion)
        sent = time.monotonic_ns()
        wire.good()
        while time.monotonic_ns() < sent + 50_000_000:
            time.sleep(0.001)
        bridge.send_signal(signal.SIGCONT)
        processes.until(lambda: newest(motion)[0] > before, all_.running["bridge"])
        assert newest(motion)[1] <= sent - DELAY_NS


def test_what_comes_after_a_silence_counts_from_its_own_stamp(package: Path, wires: Any) -> None:
    """Whoever was silent for long may send again what was measured before that."""
    with listening(package) as all_:
        wire, motion = wires(all_.port), all_.channels / "motion"
        wire.during(1.5, wire.good)
        silent(wire).during(3.5, lambda: None)
        before, _ = newest(motion)
        wire.send(wire.place(ahead_ms=-60_000))
        processes.until(lambda: newest(motion)[0] > before, all_.running["bridge"])
        assert newest(motion)[1] < time.monotonic_ns() - 60 * 10**9


def test_an_autopilot_that_began_anew_is_heard_again(package: Path, wires: Any) -> None:
    with listening(package) as all_:
        wire = wires(all_.port)
        wire.during(1.5, wire.good)
        wire.began = time.monotonic_ns()
        wire.during(1.5, wire.good)
        told = taken(all_)
        assert told["clock"]["jumps"] == 1
        assert told["motion"]["taken"] > 30


def test_gaps_and_repetitions_of_a_sequence_are_counted(package: Path, wires: Any) -> None:
    with listening(package) as all_:
        wire = wires(all_.port)
        wire.during(0.5, wire.good)
        wire.link.seq = (wire.link.seq + 5) % 256
        frame = wire.place()
        for _ in range(3):
            wire.send(frame)
        wire.during(0.3, wire.good)
        (autopilot, _) = taken(all_)["sources"]
        assert (autopilot["lost"], autopilot["repeated"]) == (5, 2)


def test_the_bridge_beats_answers_timesync_and_says_when_the_law_is_its_own(
    package: Path, wires: Any
) -> None:
    with stack(package) as all_:
        all_.actuator()
        all_.bridge()
        running(all_)
        wire = wires(all_.port)
        wire.send(wire.packed(mavlink.MAVLink_timesync_message(0, 4711)))
        beats, answers = [], []

        def listen() -> None:
            wire.good()
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                for m in wire.link.parse_buffer(wire.socket.recv(4096)) or []:
                    beats.extend([m] if m.get_type() == "HEARTBEAT" else [])
                    answers.extend([m] if m.get_type() == "TIMESYNC" and m.tc1 else [])

        def turns(count: int, done: Callable[[], bool]) -> None:
            def step() -> bool:
                nonlocal count
                count -= 1
                listen()
                return count < 0 and done()

            processes.until(step, all_.running["bridge"])

        began = time.monotonic()
        turns(100, lambda: len(beats) > 1 and len(answers) > 0)
        assert len(beats) <= time.monotonic() - began + 2  # one a second
        assert {(m.type, m.autopilot, m.system_status) for m in beats} == {(18, 8, 4)}
        assert {(m.get_srcSystem(), m.get_srcComponent()) for m in beats} == {(1, 191)}
        assert [m.ts1 for m in answers] == [4711]
        all_.end("actuator", signal.SIGKILL)
        turns(100, lambda: beats[-1].system_status == 5)  # MAV_STATE_CRITICAL: they are gone
        (command,) = [t for t in taken(all_)["topics"] if t["way"] == "out"]
        assert command["the_law_in_a_silence"] > 10


def test_a_serial_line_carries_both_ways(package: Path, wires: Any) -> None:
    controller, line = pty.openpty()
    with stack(package) as all_:
        url = f"serial://{os.ttyname(line)}:57600"
        program = package / "build" / "geofence_bridge"
        words = ["--channels", str(all_.channels), "--url", url, "--status", "json"]
        all_.start("bridge", program, *words)
        running(all_)
        os.set_blocking(controller, False)
        wire = wires(all_.port)
        heard: list[str] = []
        os.write(controller, b"\xfd garbage \xfe")

        def step() -> bool:
            os.write(controller, wire.place())
            with contextlib.suppress(BlockingIOError):
                for m in wire.link.parse_buffer(os.read(controller, 4096)) or []:
                    heard.append(m.get_type())
                    if m.get_type() == "TIMESYNC" and m.tc1 == 0:
                        answer = mavlink.MAVLink_timesync_message(wire.boot_ns(), m.ts1)
                        os.write(controller, wire.packed(answer))
            return min(heard.count(x) for x in ("HEARTBEAT", "TIMESYNC")) > 3  # one a second

        processes.until(step, all_.running["bridge"])
        told = taken(all_)
        assert told["motion"]["taken"] > 50
        assert told["clock"]["runs"]
    os.close(controller)
    os.close(line)


def test_a_line_that_is_none_is_told(package: Path) -> None:
    with stack(package) as all_:
        program = package / "build" / "geofence_bridge"
        for url in ("serial:///dev/null:57600", "udpin://256.0.0.1:1", "udpin://127.0.0.1:x", "x"):
            process = all_.start("bridge", program, "--channels", all_.channels, "--url", url)
            assert process.wait(processes.TIMEOUT_S) == 1
            all_.end("bridge")
