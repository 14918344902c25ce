"""Flights against the clock and with sensors from outside: what their logs may say."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.certificate.extras import flight_check
from soter.certificate.extras.flight_check import open_flights
from soter.certificate.reading.folder import read_certificate, read_program
from unit.certificate.flights.logged_flights import (
    MS,
    TEXT,
    Flight,
    Standstill,
    certificate,
    sight_at,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.certificate.report import FlightReport


@pytest.fixture(autouse=True)
def _no_tube(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs are read; the tube has tests of its own."""
    monkeypatch.setattr(flight_check, "tube_of_entry", lambda *_: Standstill())


def report_of(proof: Path, log: Path) -> FlightReport:
    flights = open_flights(proof, [str(log)])
    assert flights is not None
    (report,) = flights.judge_logs(1)
    return report


def read(flight: Flight, **said: object) -> None:
    """What the verdict of 200 ms says that it read."""
    flight.read(200 * MS).update(said)


def test_a_step_that_took_as_long_as_it_may_is_confirmed(tmp_path: Path) -> None:
    times = "within 5s;\n  verify { late dm 2us; response dm 3us; }\n"
    text = TEXT.replace("within 5s;\n", times, 1)
    assert text != TEXT
    slow = certificate(tmp_path / "cert", text)
    program = read_program(read_certificate(slow))[0].program
    assert program is not None
    for look, reason in (
        ((2_000, 5_000), ""),
        ((2_001, 2_001), "it came 2001 ns after its release, and may 2000 ns"),
        ((0, 5_001), "it was there 5001 ns after its release, and may 5000 ns"),
    ):
        flight = Flight()
        flight.steps[200 * MS]["look"] = look
        flight.header["program_sha256"] = program.sha256
        report = report_of(slow, flight.write(tmp_path / "flight.mcap"))
        assert [d.reason for d in report.doubts] == [reason] * bool(reason)

    for last_ms, missing in ((400, []), (410, ["the verdict is missing"])):
        flight = Flight("AAAA", last_ms * MS)
        flight.header["program_sha256"] = program.sha256
        report = report_of(slow, flight.write(tmp_path / "flight.mcap"))
        assert [d.reason for d in report.doubts] == missing


WORLD = """
system World deploys Line {
  module Follow;
  external topic sight every 10ms delayed 3ms measured sight.gap within 0.1, sight.way within 0.1,
    sight.v within 0.01;
  external topic levers;
}
"""


@pytest.mark.parametrize(
    ("tamper", "reason"),
    [
        (lambda f: f.sights, ""),
        (
            lambda f: read(f, age_ns=-1),
            "it read sight of 200000001 ns, and the last one came at 200000000 ns",
        ),
        (
            lambda f: read(f, value=sight_at(190 * MS)),
            "it read another sight than the last one, which came at 200000000 ns",
        ),
        (
            lambda f: read(f, age_ns=3 * MS + 1),
            "it read sight, which came 3000001 ns late, and may 3000000 ns",
        ),
        (lambda f: read(f, age_ns=21 * MS), "it read sight, 21000000 ns old, and max_age"),
    ],
)
def test_a_sensor_of_a_system_in_the_world_is_read_as_it_has_come(
    tmp_path: Path, tamper: Callable[[Flight], object], reason: str
) -> None:
    """Its stamp says when it was measured; the certificate is about the system with plants."""
    proof = certificate(tmp_path / "cert", TEXT + WORLD)
    program = read_program(read_certificate(proof))[0].program
    assert program is not None
    flight = Flight()
    flight.header.update(program_sha256=program.sha256, system="World")
    for time_ns in flight.steps:
        flight.read(time_ns)["age_ns"] = 3 * MS
    tamper(flight)
    report = report_of(proof, flight.write(tmp_path / "flight.mcap"))
    assert (report.system, report.verdicts) == ("World", 8)
    assert report.confirmed == 8 - bool(reason)
    assert bool(reason) == any(d.reason.startswith(reason) for d in report.doubts)
