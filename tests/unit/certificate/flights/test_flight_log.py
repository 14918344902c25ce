"""What a log of a flight contradicts is named, each thing by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.certificate.extras import flight_check
from soter.certificate.extras.flight_check import open_flights
from soter.certificate.report import ACCEPTED, NOT_RECHECKED, REJECTED
from soter.diagnostics.current_phase import whole_shares_to
from soter.diagnostics.diagnostic import SoterError
from soter.report import mcap_log
from tables import all_rows
from unit.certificate.flights.logged_flights import (
    MS,
    TEXT,
    Flight,
    Standstill,
    certificate,
    changed,
    next_float,
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


@pytest.fixture(scope="module")
def train(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A certificate, not to be changed."""
    return certificate(tmp_path_factory.mktemp("train") / "cert")


def report_of(folder: Path, log: Path, workers: int = 1) -> FlightReport:
    flights = open_flights(folder, [str(log)])
    assert flights is not None
    (report,) = flights.judge_logs(workers)
    return report


def judged(train: Path, tmp_path: Path, flight: Flight, *, messages: bool = True) -> FlightReport:
    return report_of(train, flight.write(tmp_path / "flight.mcap", messages=messages))


@pytest.mark.parametrize("modes", ["AAAAAAAA", "SSAAASSA", "SSSS", "A"])
def test_a_true_log_is_confirmed(train: Path, tmp_path: Path, modes: str) -> None:
    report = judged(train, tmp_path, Flight(modes))
    assert (report.verdict, report.doubts, report.cut) == (ACCEPTED, [], "")
    assert report.unlogged == []
    counts = report.verdicts, report.confirmed, report.others
    assert counts == (modes.count("A"), modes.count("A"), modes.count("S"))
    assert report.to_ns == (len(modes) - 1) * 100 * MS


def test_reads_without_a_message_to_compare_them_with_are_not_confirmed(
    train: Path, tmp_path: Path
) -> None:
    report = judged(train, tmp_path, Flight("SSAAASSA"), messages=False)
    assert (report.verdict, report.unlogged) == (NOT_RECHECKED, ["sight"])
    assert (report.verdicts, report.confirmed) == (4, 0)
    assert judged(train, tmp_path, Flight("SSSS"), messages=False).verdict == ACCEPTED


def test_control_comes_back_after_a_fault_of_the_gate(train: Path, tmp_path: Path) -> None:
    fault = changed(Flight("AASAAA"), lambda f: predicate(f, 300, "gate_fault", value=True))
    assert judged(train, tmp_path, fault).doubts == []


def test_an_older_read_is_as_good(train: Path, tmp_path: Path) -> None:
    """The plant may have been due after the module."""

    def older(flight: Flight) -> None:
        flight.read(300 * MS).update(value=sight_at(290 * MS), age_ns=10 * MS)

    assert judged(train, tmp_path, changed(Flight(), older)).verdict == ACCEPTED


def at(flight: Flight, time_ms: int, **said: object) -> None:
    flight.steps[time_ms * MS].update(said)


def read(flight: Flight, time_ms: int, **said: object) -> None:
    flight.read(time_ms * MS).update(said)


def predicate(flight: Flight, time_ms: int, name: str, *, value: bool) -> None:
    flight.steps[time_ms * MS]["predicates"][name] = value


def faster(flight: Flight) -> None:
    """A state that is not good, in messages and read alike."""
    fast = sight_at(300 * MS) | {"v": 35.0}
    flight.sights[300 * MS] = fast
    flight.read(300 * MS)["value"] = fast


def negative(flight: Flight) -> None:
    flight.sights[200 * MS] = sight_at(200 * MS) | {"v": 0.0}
    flight.read(200 * MS)["value"] = sight_at(200 * MS) | {"v": -0.0}


def old(flight: Flight) -> None:
    flight.read(200 * MS).update(value=sight_at(170 * MS), age_ns=30 * MS)
    for time_ms in (180, 190, 200):
        del flight.sights[time_ms * MS]


def not_the_last(flight: Flight) -> None:
    flight.read(200 * MS).update(value=sight_at(180 * MS), age_ns=20 * MS)
    del flight.sights[200 * MS]


def second(flight: Flight) -> None:
    flight.steps[330 * MS] = flight.step(330 * MS, "AC", "AC")


def late(flight: Flight) -> None:
    del flight.steps[300 * MS]
    flight.steps[310 * MS] = flight.step(310 * MS, "AC", "AC")


TAMPERED: dict[str, tuple[str, Callable[[Flight], object], int, str]] = {
    "a state is not good": ("AAAAAA", faster, 300, "it is too fast"),
    "SC became AC": (
        "ASSSAA",
        lambda f: at(f, 200, mode_after="AC"),
        200,
        'it says "AC", and SC has control',
    ),
    "SC became AC against itself": (
        "ASSSAA",
        lambda f: at(f, 200, mode_after="AC"),
        200,
        'it says "AC" against its own ttf, safer',
    ),
    "the next one knows of SC": (
        "ASSSAA",
        lambda f: at(f, 200, mode_after="AC"),
        300,
        "SC had control before it, and AC by the one before",
    ),
    "AC became SC": (
        "AAAAAA",
        lambda f: at(f, 200, mode_after="SC"),
        200,
        'it says "SC", and AC has control',
    ),
    "ttf was true": (
        "AAAAAA",
        lambda f: predicate(f, 200, "ttf", value=True),
        200,
        'it says "AC" against its own ttf',
    ),
    "it was stale": (
        "AAAAAA",
        lambda f: predicate(f, 200, "stale", value=True),
        200,
        'it says "AC" against its own stale',
    ),
    "a fault of the gate": (
        "AAAAAA",
        lambda f: predicate(f, 200, "gate_fault", value=True),
        200,
        'it says "AC" against its own gate_fault',
    ),
    "safer was false": (
        "SSAAAA",
        lambda f: predicate(f, 200, "safer", value=False),
        200,
        'it says "AC" against its own safer',
    ),
    "a bit of a number": (
        "AAAAAA",
        lambda f: read(f, 200, value=sight_at(200 * MS) | {"v": next_float(10.0)}),
        200,
        "it read sight of 200000000 ns, and the log has another value of then",
    ),
    "a bit of a message": (
        "AAAAAA",
        lambda f: f.sights.update({200 * MS: sight_at(200 * MS) | {"v": next_float(10.0)}}),
        200,
        "it read sight of 200000000 ns, and the log has another value of then",
    ),
    "the sign of a zero": (
        "AAAAAA",
        negative,
        200,
        "it read sight of 200000000 ns, and the log has another value of then",
    ),
    "it was too old": (
        "AAAAAA",
        old,
        200,
        "it read sight, 30000000 ns old, and max_age is 20000000 ns",
    ),
    "it was to come": (
        "AAAAAA",
        lambda f: read(f, 200, age_ns=-10 * MS),
        200,
        "it read sight, -10000000 ns old, and max_age is 20000000 ns",
    ),
    "nobody had published": (
        "AAAAAA",
        lambda f: read(f, 200, age_ns=None),
        200,
        "it read sight, which nobody had published",
    ),
    "a newer one was there": (
        "AAAAAA",
        lambda f: read(f, 200, value=sight_at(180 * MS), age_ns=20 * MS),
        200,
        "it read sight of 180000000 ns, and the last one is of 200000000 ns",
    ),
    "a newer one was there, not of this instant": (
        "AAAAAA",
        not_the_last,
        200,
        "it read sight of 180000000 ns, and the last one is of 190000000 ns",
    ),
    "nothing was published then": (
        "AAAAAA",
        lambda f: read(f, 200, age_ns=5 * MS),
        200,
        "it read sight of 195000000 ns, and the last one is of 200000000 ns",
    ),
    "a topic is left out": (
        "AAAAAA",
        lambda f: at(f, 200, reads={}),
        200,
        "the log does not say what it read of sight.gap, sight.way, sight.v",
    ),
    "two in a period": ("AAAAAA", second, 330, "it is the second one of its period"),
    "late": ("AAAAAA", late, 310, "it came 10000000 ns after its release, and may 0 ns"),
    "late by the clock": (
        "AAAAAA",
        lambda f: at(f, 200, look=(1, 1)),
        200,
        "it came 1 ns after its release, and may 0 ns",
    ),
    "a takeover was late by the clock": (
        "AASSSA",
        lambda f: at(f, 200, look=(1, 1)),
        200,
        "it came 1 ns after its release, and may 0 ns",
    ),
    "SC waits for a verdict that is late": (
        "ASSSAA",
        lambda f: at(f, 200, look=(1, 1)),
        200,
        "it came 1 ns after its release, and may 0 ns",
    ),
    "SC waits for one that is missing": (
        "ASSSSA",
        lambda f: f.steps.pop(300 * MS),
        300,
        "the verdict is missing",
    ),
    "it took too long by the clock": (
        "AAAAAA",
        lambda f: at(f, 200, look=(0, 1)),
        200,
        "it was there 1 ns after its release, and may 0 ns",
    ),
    "one is missing": (
        "AAAAAA",
        lambda f: f.steps.pop(200 * MS),
        200,
        "the verdict is missing",
    ),
    "the first one is missing": (
        "AAAAAA",
        lambda f: f.steps.pop(0),
        0,
        "the verdict is missing",
    ),
    "the last one is missing": (
        "AAAAAA",
        lambda f: f.steps.pop(500 * MS),
        500,
        "the verdict is missing",
    ),
    "that which took control is missing": (
        "AAASSS",
        lambda f: f.steps.pop(300 * MS),
        300,
        "the verdict is missing",
    ),
    "that which gave control is missing": (
        "SSSAAA",
        lambda f: f.steps.pop(300 * MS),
        300,
        "the verdict is missing",
    ),
    "several are missing, AC had control in one of them": (
        "SSASSS",
        lambda f: [f.steps.pop(t * MS) for t in (100, 200, 300)],
        100,
        "3 verdicts are missing",
    ),
    "all are missing": (
        "SSSSSS",
        lambda f: f.steps.clear(),
        0,
        "the log has no verdict of it",
    ),
}


@all_rows("name", TAMPERED)
def test_what_was_changed_is_named(train: Path, tmp_path: Path, name: str) -> None:
    modes, change, time_ms, reason = TAMPERED[name]
    flight = Flight(modes)
    assert judged(train, tmp_path, flight).verdict == ACCEPTED
    report = judged(train, tmp_path, changed(flight, change))
    assert (time_ms * MS, "Follow", reason) in {
        (d.time_ns, d.module, d.reason) for d in report.doubts
    }
    whole = name in {"a state is not good", "a topic is left out"}
    assert report.verdict == (NOT_RECHECKED if whole else REJECTED)
    doubted = {d.time_ns for d in report.doubts}
    unconfirmed = sum(t in doubted and s["mode_after"] == "AC" for t, s in steps(flight, change))
    assert report.confirmed == report.verdicts - unconfirmed


def steps(flight: Flight, change: Callable[[Flight], object]) -> list[tuple[int, dict[str, str]]]:
    return list(changed(flight, change).steps.items())


def test_a_cut_log_is_read_up_to_there(
    train: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of every length: all that was whole is judged, and nothing else is missed."""
    monkeypatch.setattr(mcap_log, "CHUNK_BYTES", 4096)
    log = tmp_path / "flight.mcap"
    data = Flight("A" * 40).write(log).read_bytes()
    found = []
    for part in (0.2, 0.3, 0.4, 0.5, 0.6, 0.999):
        log.write_bytes(data[: int(len(data) * part)])
        report = report_of(train, log)
        assert (report.verdict, report.doubts, bool(report.cut)) == (ACCEPTED, [], True)
        assert report.confirmed == report.verdicts
        assert report.verdicts == (report.to_ns // (100 * MS) + 1 if report.verdicts else 0)
        found.append(report.verdicts)
    assert found == sorted(found)
    assert 0 < found[1] < found[3] < found[5] == 39  # the last instant may not be whole


def test_a_log_of_a_run_without_an_end_says_so(
    train: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is whole as a file; of its last instant nobody knows whether it is whole."""
    monkeypatch.setattr(mcap_log, "CHUNK_BYTES", 4096)
    log = Flight("A" * 40).write(tmp_path / "flight.mcap")
    data = log.read_bytes()
    for part in (0.4, 0.6):
        log.write_bytes(data[: int(len(data) * part)])
        cut = report_of(train, log)
        assert mcap_log.mend_log(log)
        mended = report_of(train, log)
        assert (mended.verdict, mended.doubts, mended.cut) == (ACCEPTED, [], "the process died")
        assert (mended.verdicts, mended.to_ns) == (cut.verdicts, cut.to_ns)


def test_a_log_without_its_head_says_nothing(train: Path, tmp_path: Path) -> None:
    log = Flight().write(tmp_path / "flight.mcap")
    for data in (log.read_bytes()[:60], b""):
        log.write_bytes(data)
        with pytest.raises(SoterError) as raised:
            report_of(train, log)
        assert raised.value.diagnostics[0].code == "D006"


def test_a_log_that_was_damaged_is_refused(train: Path, tmp_path: Path) -> None:
    log = Flight().write(tmp_path / "flight.mcap")
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 1
    log.write_bytes(data)
    with pytest.raises(SoterError) as raised:
        report_of(train, log)
    assert raised.value.diagnostics[0].code == "D006"


OTHERS: dict[str, Callable[[Flight], object]] = {
    "its program is": lambda f: f.header.update(program_sha256="ab" * 32),
    "system `Elsewhere` flew": lambda f: f.header.update(system="Elsewhere"),
    "CREEP was 0.2 in it": lambda f: f.more.update({"param CREEP": "0.2"}),
}


@pytest.mark.parametrize("text", OTHERS)
def test_a_log_of_something_else_is_refused(train: Path, tmp_path: Path, text: str) -> None:
    log = changed(Flight(), OTHERS[text]).write(tmp_path / "flight.mcap")
    with pytest.raises(SoterError) as raised:
        open_flights(train, [str(log)])
    assert raised.value.diagnostics[0].code == "D023"
    assert text in raised.value.diagnostics[0].message


def test_a_certificate_without_rest_confirms_no_flight(tmp_path: Path) -> None:
    folder = certificate(tmp_path / "cert", rest="induction")
    with pytest.raises(SoterError) as raised:
        open_flights(folder, [str(Flight().write(tmp_path / "flight.mcap"))])
    assert raised.value.diagnostics[0].code == "D023"


def test_a_certificate_of_other_text_is_of_another_program(tmp_path: Path) -> None:
    folder = certificate(
        tmp_path / "cert", TEXT.replace("BRAKE: float = 2.0", "BRAKE: float = 2.1")
    )
    with pytest.raises(SoterError) as raised:
        open_flights(folder, [str(Flight().write(tmp_path / "flight.mcap"))])
    assert raised.value.diagnostics[0].code == "D023"


AGES: tuple[object, ...] = ("0", 0.0, False, [], 10**30)
ODD: dict[str, list[object]] = {
    "reads": [
        5,
        [5],
        {"sight": 1},
        {"sight": {}},
        {"sight": {"value": {}, "age_ns": 0}},
        {"sight": {"value": None, "age_ns": 0}},
        {"sight": {"value": sight_at(0) | {"gap": "NaN"}, "age_ns": 0}},
        {"nobody": {"value": 1.0, "age_ns": 0}},
        *({"sight": {"value": sight_at(200 * MS), "age_ns": age}} for age in AGES),
    ],
    "mode_after": [None, 7, ["AC"], "ac"],
    "mode_before": [None, "ac"],
    "predicates": [None, 3, {}, {"ttf": False}],
}


@all_rows(("name", "value"), [(n, v) for n, vs in ODD.items() for v in vs])
def test_what_nobody_writes_is_refused_or_named(
    train: Path, tmp_path: Path, name: str, value: object
) -> None:
    flight = changed(Flight(), lambda f: f.steps[200 * MS].update({name: value}))
    try:
        report = judged(train, tmp_path, flight)
    except SoterError as error:
        codes = [d.code for d in error.diagnostics]
    else:
        codes = ["D006"] if any(d.time_ns == 200 * MS for d in report.doubts) else []
    assert codes == ["D006"]


@pytest.mark.parametrize("workers", [1, 3])
def test_processes_find_the_same(train: Path, tmp_path: Path, workers: int) -> None:
    report = report_of(train, changed(Flight(), faster).write(tmp_path / "f.mcap"), workers)
    assert [(d.time_ns, d.reason) for d in report.doubts] == [(300 * MS, "it is too fast")]
    assert (report.verdicts, report.confirmed) == (8, 7)


def test_the_share_that_is_done_is_that_of_verdicts(train: Path, tmp_path: Path) -> None:
    flights = open_flights(train, [str(Flight().write(tmp_path / "flight.mcap"))])
    assert flights is not None
    shares: list[float] = []
    with whole_shares_to(shares.append):
        list(flights.judge_logs(1))
    assert shares == [(k + 1) / 8 for k in range(8)]


def test_what_the_tube_cannot_do_confirms_nothing(
    train: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> Standstill:
        raise ValueError("no tube")

    monkeypatch.setattr(flight_check, "tube_of_entry", fails)
    report = judged(train, tmp_path, Flight())
    assert (report.verdict, report.confirmed, len(report.doubts)) == (NOT_RECHECKED, 0, 8)
    assert "no tube" in report.doubts[0].reason
    monkeypatch.setattr(flight_check, "tube_of_entry", lambda *_: Standstill())
    monkeypatch.setattr(Standstill, "why_not_good", fails)
    report = judged(train, tmp_path, Flight())
    assert (report.verdict, report.confirmed, len(report.doubts)) == (NOT_RECHECKED, 0, 8)
