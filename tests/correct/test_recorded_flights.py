"""What a program that was built for a robot recorded, and what `soter recheck --log` says of it.

The program runs over the clock of the test (`owned_clock.c`): nobody is late unless the test says.
"""

from __future__ import annotations

import hashlib
import struct
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest

import soter
from generators.c_packages import CART, make
from generators.channel_programs import Words, going, library, number_of
from generators.posix_packages import owned, report
from soter.report.mcap_reading import log_messages
from soter.simulate.flight_recording import END_BYTES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.api import Program
    from soter.certificate.report import FlightReport

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

LANE = CART.parents[1] / "rest" / "lane.soter"
SEED, UNTIL = 3, 6.0
LATE = 200_000
"""How late the decision module of the lane may be, ns."""
LOOK = 1000
"""The clock of the test goes on by so much where somebody looks at it, ns."""
MS = 1_000_000
BESIDE = 64
"""Bytes of a record before its state; one module."""


@pytest.fixture(scope="module")
def lane() -> Program:
    return soter.load(LANE)


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return owned(LANE, tmp_path_factory.mktemp("lane") / "out")


@pytest.fixture(scope="module")
def proof(lane: Program, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("proof") / "cert"
    lane.verify(cert=folder)
    return folder


def flown(
    car: Path, path: Path, *events: str, more: tuple[str, ...] = (), expected: int = 0
) -> Path:
    options = ("--seed", str(SEED), "--until", str(UNTIL), "--record", str(path), *more)
    report(car, *options, events=events, expected=expected)
    return path


def rechecked(lane: Program, proof: Path, recording: Path) -> tuple[soter.Run, FlightReport]:
    log = recording.with_suffix(".mcap")
    run = lane.simulate(recorded=recording, log=log)
    checked = soter.recheck(proof, logs=[log])
    assert checked.accepted
    return run, checked.flights[0]


def test_what_flew_is_what_runs_and_every_verdict_is_confirmed(
    lane: Program, proof: Path, car: Path, tmp_path: Path
) -> None:
    run, flight = rechecked(lane, proof, flown(car, tmp_path / "flight.rec"))
    other = lane.simulate(seed=SEED, until=UNTIL, log=tmp_path / "run.mcap")
    assert (run.trace_sha256, run.seed, run.cut) == (other.trace_sha256, SEED, "")
    logs = [list(log_messages(tmp_path / f"{name}.mcap")) for name in ("run", "flight")]
    looks = [m for _, channel, m in logs[1] if channel == "soter/decisions"]
    for look in looks:
        late, done = look.pop("late_ns"), look.pop("done_ns")
        assert 0 < late < done < 100 * LOOK
    assert logs[0] == logs[1]
    assert (flight.verdict, flight.cut) == ("accepted", "")
    assert flight.confirmed == flight.verdicts == len(looks) == 121


@pytest.mark.parametrize("held_ns", [LATE - 20 * LOOK, LATE + LOOK])
def test_a_verdict_that_came_too_late_is_named_whatever_the_driver_allows(
    lane: Program, proof: Path, car: Path, tmp_path: Path, held_ns: int
) -> None:
    """`--late` is the driver's; the proof is about what the program declares."""
    event, allowed = f"held:1500000000:{held_ns}", ("--late", "10000")
    run, flight = rechecked(lane, proof, flown(car, tmp_path / "flight.rec", event, more=allowed))
    assert run.misses_recorded == 0
    named = [(d.time_ns, d.module, d.reason.split(" after")[0]) for d in flight.doubts]
    if held_ns < LATE:
        assert (named, flight.verdict) == ([], "accepted")
    else:
        (late,) = {m["late_ns"] for m in steps(tmp_path / "flight.mcap") if m["late_ns"] > LATE}
        assert named == [(1_500_000_000, "SafeLane", f"it came {late} ns")]
        assert flight.verdict == "rejected"
    assert flight.confirmed == flight.verdicts - len(named) == 121 - len(named)


@pytest.mark.parametrize(("at_ms", "held_ns"), [(1500, 201_000), (1495, 2_000_000_000)])
def test_a_takeover_that_came_too_late_is_named(
    lane: Program, proof: Path, car: Path, tmp_path: Path, at_ms: int, held_ns: int
) -> None:
    """The verdict before it counts until then; also where the calendar began anew."""
    event = f"held:{at_ms}000000:{held_ns}"
    run, flight = rechecked(lane, proof, flown(car, tmp_path / "flight.rec", event, expected=4))
    assert run.misses_recorded > 0
    (late,) = {m["late_ns"] for m in steps(tmp_path / "flight.mcap") if m["late_ns"] > LATE}
    assert held_ns <= late < held_ns + 10 * MS
    named = [(d.time_ns, d.reason.split(" after")[0]) for d in flight.doubts]
    assert (named, flight.verdict) == ([(1_500_000_000, f"it came {late} ns")], "rejected")
    assert (flight.confirmed, flight.others) == (120, 1)


def test_a_calendar_that_began_anew_between_verdicts_is_named(
    lane: Program, proof: Path, car: Path, tmp_path: Path
) -> None:
    event = "held:1525000000:2000000000"
    _, flight = rechecked(lane, proof, flown(car, tmp_path / "flight.rec", event, expected=4))
    assert flight.verdict == "rejected"
    assert {d.time_ns for d in flight.doubts} == {1_550_000_000}


def held_up(car: Path, folder: Path) -> Path:
    """A flight whose decision module is late once, and says "SC"."""
    return flown(car, folder / "flight.rec", "held:1500000000:201000", expected=4)


def steps(log: Path) -> list[dict[str, Any]]:
    return [m for _, channel, m in log_messages(log) if channel == "soter/decisions"]


def changed(
    recording: Path, run: soter.Run, ms: tuple[int, int], change: Callable[[bytearray], None]
) -> Path:
    """A recording of which somebody changed the states of some instants, and sealed it again."""
    data, size = recording.read_bytes(), BESIDE + run.dtype.itemsize
    begin, end = data.index(b"\n\n") + 2, len(data) - END_BYTES
    records = []
    for at in range(begin, end, size):
        state = bytearray(data[at + BESIDE : at + size])
        if ms[0] * MS <= struct.unpack_from("<q", state)[0] <= ms[1] * MS:
            change(state)
        records.append(data[at : at + BESIDE] + bytes(state))
    body = data[:begin] + b"".join(records)
    seal = f"{hashlib.sha256(body).hexdigest()}\n".encode()
    other = recording.with_name("changed.rec")
    other.write_bytes(body + data[end : -len(seal)] + seal)
    return other


@pytest.mark.parametrize(("until_ms", "named_ms"), [(1500, 1550), (1540, 1500)])
def test_a_verdict_that_was_changed_is_named(
    lane: Program, proof: Path, car: Path, tmp_path: Path, until_ms: int, named_ms: int
) -> None:
    """SC took over, and somebody says that AC went on: until the next instant, or verdict."""
    recording = held_up(car, tmp_path)
    run, _ = rechecked(lane, proof, recording)
    fields = run.dtype["modules"].base.fields
    assert fields is not None

    def no_takeover(state: bytearray) -> None:
        for name, value in {"saw_gate_fault": 0, "gate_fault": 0, "mode": 1}.items():
            state[run.layout.module_offset + fields[name][1]] = value

    _, flight = rechecked(lane, proof, changed(recording, run, (1500, until_ms), no_takeover))
    assert flight.verdict == "rejected"
    assert named_ms * MS in {d.time_ns for d in flight.doubts}
    assert flight.confirmed < flight.verdicts == 121


def test_an_estimate_from_which_sc_does_not_come_to_rest_is_named(
    lane: Program, proof: Path, car: Path, tmp_path: Path
) -> None:
    """A decision module that said "AC" where it may not: its own words are all in order."""
    recording = flown(car, tmp_path / "flight.rec")
    run, _ = rechecked(lane, proof, recording)
    pose = run.layout.topic_offset([t.name for t in run.system.topics].index("pose"))
    fields = run.dtype.fields
    assert fields is not None

    def near_the_edge(state: bytearray) -> None:
        for at in (pose, fields["c"][1]):  # what is seen, and where the car is
            struct.pack_into("<d", state, at + 8, 1.49)

    _, flight = rechecked(lane, proof, changed(recording, run, (2950, 3000), near_the_edge))
    assert flight.verdict == "not re-checked"
    assert {d.time_ns for d in flight.doubts} == {2_950_000_000, 3_000_000_000}
    assert all(d.estimate["pose.offset"] == 1.49 for d in flight.doubts)
    assert flight.confirmed == flight.verdicts - 2


def test_a_flight_that_was_cut_is_confirmed_up_to_there_and_told(
    lane: Program, proof: Path, car: Path, tmp_path: Path
) -> None:
    recording = flown(car, tmp_path / "flight.rec")
    data = recording.read_bytes()
    recording.write_bytes(data[: len(data) // 2])
    run, flight = rechecked(lane, proof, recording)
    assert "its end is missing" in run.cut
    assert flight.cut == run.cut
    assert 0 < flight.confirmed == flight.verdicts <= 61
    assert flight.to_ns / 1e9 == pytest.approx(UNTIL / 2, abs=0.1)


def test_a_log_on_a_full_disk_leaves_a_recording_without_an_end(car: Path) -> None:
    said: dict[str, Any] = report(car, "--until", "1", "--record", "/dev/full")
    assert any("the log `/dev/full` cannot be written" in note for note in said["notes"])


VEHICLE = """
system Vehicle deploys Protected {
  module SafeLane;
  external topic pose every 5ms measured pose.along within 1.0, pose.offset within 0.02,
    pose.heading within 0.003;
  external topic turn;
}
"""


@pytest.mark.real_time
def test_a_vehicle_in_the_world_is_confirmed_by_the_proof_of_its_plants(tmp_path: Path) -> None:
    """Its sensor is another program; on a busy machine steps are late, and that is named."""
    source = tmp_path / "lane.soter"
    source.write_text(LANE.read_text(encoding="utf-8") + VEHICLE, encoding="utf-8")
    lane = soter.load(source)
    lane.verify(cert=tmp_path / "cert", system="Protected")
    lane.build("posix", tmp_path / "out", "Vehicle", cert=tmp_path / "cert")
    assert make(tmp_path / "out", "CFLAGS=-O2 -Werror").returncode == 0
    program, channels = tmp_path / "out" / "lane", tmp_path / "channels"
    channels.mkdir()
    number = number_of(program, "pose")
    pose = Words(library(tmp_path), channels, "pose", number, 3, writes=True)
    recording = tmp_path / "flight.rec"
    said = 0
    pose.write(0.0, 0.1, 0.0)
    with going(program, channels, "--until", "3", "--record", str(recording)) as trusted:
        while trusted.poll() is None:
            said += 1
            pose.write(0.03 * said, 0.1, 0.0)
            time.sleep(0.002)
        trusted.communicate()
    log = tmp_path / "flight.mcap"
    run = lane.simulate(system="Vehicle", recorded=recording, log=log)
    flight = soter.recheck(tmp_path / "cert", logs=[log]).flights[0]
    assert (run.cut, flight.system, flight.unlogged) == ("", "Vehicle", [])
    assert flight.verdicts + flight.others == 61
    assert all(" after its release" in d.reason for d in flight.doubts)
    assert flight.confirmed >= flight.verdicts - len(flight.doubts) > 0
    ages = [m["reads"]["pose"]["age_ns"] for m in steps(log)]
    assert any(0 < age < 10 * MS for age in ages)
