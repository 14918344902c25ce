"""`soter recheck DIR --log LOG`: exits, documents, words; and the whole way from a run to it."""

from __future__ import annotations

import itertools
import json
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest

from json_documents import problems_of
from soter.api import Program
from soter.certificate import proof_methods
from soter.certificate.extras import flight_check
from soter.certificate.proof_methods import ModuleMethod
from soter.certificate.reading.folder import Certificate
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.tubes import check_rest
from soter.cli.main import main
from unit.certificate.flights.logged_flights import (
    FOLLOW,
    MS,
    Flight,
    Standstill,
    certificate,
    changed,
    sight_at,
)
from unit.certificate.tubes import rest_entries

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def train(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A certificate whose claims are taken for shown, and a tube that asks for little."""
    monkeypatch.setattr(check_rest, "_claim_checks", lambda *_: ())
    monkeypatch.setattr(flight_check, "tube_of_entry", lambda *_: Standstill())
    return certificate(tmp_path / "cert")


def document(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    made: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert not problems_of(made)
    return made


def rechecked(train: Path, *logs: Path) -> list[str]:
    return ["recheck", str(train), *(x for log in logs for x in ("--log", str(log)))]


def too_fast(flight: Flight) -> None:
    fast = sight_at(300 * MS) | {"v": 35.0}
    flight.sights[300 * MS] = fast
    flight.read(300 * MS)["value"] = fast


def test_all_confirmed_is_0(
    train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [Flight(m).write(tmp_path / f"{m}.mcap") for m in ("AAAA", "SSAA", "SSSS")]
    assert main([*rechecked(train, *logs), "--json"]) == 0
    flights = document(capsys)["flights"]
    assert [f["verdict"] for f in flights] == ["accepted"] * 3
    assert [(f["verdicts"], f["confirmed"], f["said_sc"]) for f in flights] == [
        (4, 4, 0),
        (2, 2, 2),
        (0, 0, 4),
    ]
    assert main(rechecked(train, logs[1])) == 0
    said = capsys.readouterr().out
    assert f'CONFIRMED  {logs[1]}: 2 of 2 verdicts "AC" confirmed (' in said


def test_one_that_is_not_confirmed_is_5(
    train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [
        Flight().write(tmp_path / "good.mcap"),
        changed(Flight(), too_fast).write(tmp_path / "bad.mcap"),
    ]
    assert main([*rechecked(train, *logs), "--json"]) == 5
    good, bad = document(capsys)["flights"]
    assert (good["verdict"], good["doubts"]) == ("accepted", [])
    assert (bad["verdict"], bad["verdicts"], bad["confirmed"]) == ("not re-checked", 8, 7)
    (doubt,) = bad["doubts"]
    assert doubt == {
        "time_ns": 300 * MS,
        "module": "Follow",
        "kind": "not confirmed",
        "reason": "it is too fast",
        "estimate": {f"sight.{n}": x for n, x in (sight_at(300 * MS) | {"v": 35.0}).items()},
    }
    assert main(rechecked(train, *logs)) == 5
    said = capsys.readouterr().out
    assert "NOT CONFIRMED" in said
    assert "0.3 s  Follow  not confirmed: it is too fast  (sight.gap = 199.7" in said


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("wrong", [False, True])
def test_one_that_is_interrupted_is_130_and_told_up_to_there(
    train: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    workers: int,
    wrong: bool,
) -> None:
    """Whatever was asked until then; where something is contradicted that stays so."""
    monkeypatch.setattr("os.cpu_count", lambda: workers)
    answers = flight_check.Flights._judged_verdicts

    def two(*arguments: Any) -> Iterator[Any]:
        with closing(answers(*arguments)) as every:
            yield from itertools.islice(every, 2)
            raise KeyboardInterrupt

    monkeypatch.setattr(flight_check.Flights, "_judged_verdicts", two)
    flight = Flight("AAAA")
    if wrong:
        flight.read(0)["age_ns"] = 10**10
    log = flight.write(tmp_path / "one.mcap")
    assert main([*rechecked(train, log, log), "--json"]) == 130
    (told,) = document(capsys)["flights"]
    assert told["interrupted"]
    assert (told["asked"], told["verdicts"]) == (2, 4)
    assert told["verdict"] == ("rejected" if wrong else "not re-checked")
    assert main(rechecked(train, log)) == 130
    said = capsys.readouterr().out
    assert "that were asked of 4 verdicts" in said
    assert ("CONTRADICTED" if wrong else "INTERRUPTED") in said


def test_one_that_is_interrupted_while_it_is_read_is_130(
    train: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def read(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(flight_check, "read_flight", read)
    assert main(rechecked(train, Flight("AAAA").write(tmp_path / "one.mcap"))) == 130
    said = capsys.readouterr().out
    assert "INTERRUPTED" in said
    assert "P2a" in said  # what was confirmed of the certificate


def test_what_is_contradicted_is_3(
    train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = changed(Flight(), lambda f: f.steps.pop(300 * MS)).write(tmp_path / "gone.mcap")
    assert main(rechecked(train, gone)) == 3
    said = capsys.readouterr().out
    assert "CONTRADICTED" in said
    assert "0.3 s  Follow  contradicted: the verdict is missing" in said


def test_many_doubts_are_all_in_the_document_and_on_the_page(
    train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def forgets(flight: Flight) -> None:
        for step in flight.steps.values():
            step["reads"] = {}

    log = changed(Flight("A" * 30), forgets).write(tmp_path / "flight.mcap")
    page = tmp_path / "page.html"
    assert main([*rechecked(train, log), "--report", str(page)]) == 5
    said = capsys.readouterr().out
    assert said.count("not confirmed: the log does not say") == 20
    assert "and 10 more" in said
    assert page.read_text(encoding="utf-8").count("not confirmed: the log does not say") == 30
    assert main([*rechecked(train, log), "--json"]) == 5
    assert len(document(capsys)["flights"][0]["doubts"]) == 30


def test_a_log_without_a_verdict_is_4(train: Path, tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    data = Flight("A" * 3).write(log).read_bytes()
    log.write_bytes(data[: len(data) // 4])
    assert main(rechecked(train, log)) == 4


@pytest.mark.parametrize("name", ["P2a", "start"])
def test_a_rest_that_is_not_claimed_is_4(
    train: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Verdicts rest on it."""
    log = Flight().write(tmp_path / "flight.mcap")
    assert main(rechecked(train, log)) == 0
    monkeypatch.setitem(rest_entries.CLAIMS, name, "undecided")
    assert main(rechecked(certificate(tmp_path / "other"), log)) == 4


def test_another_flight_is_1(
    train: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is checked, and of all logs at once none."""
    log = Flight().write(tmp_path / "flight.mcap")
    other = changed(Flight(), lambda f: f.header.update(system="Other")).write(tmp_path / "o.mcap")
    assert main([*rechecked(train, log, other), "--json"]) == 1
    made = document(capsys)
    assert [d["code"] for d in made["diagnostics"]] == ["D023"]
    assert main([*rechecked(train, tmp_path / "nothing.mcap"), "--json"]) == 1
    assert [d["code"] for d in document(capsys)["diagnostics"]] == ["D006"]


def test_what_rests_on_a_certificate_that_is_not_accepted_is_not_0(
    train: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = Flight().write(tmp_path / "flight.mcap")
    (train / "program" / "more").write_text("")
    assert main([*rechecked(train, log), "--json"]) == 3
    assert document(capsys)["flights"] == []
    (train / "program" / "more").unlink()

    def beyond(*_: object) -> Any:
        raise NotRecheckedError("beyond")

    monkeypatch.setitem(proof_methods.MODULES, "rest", lambda: ModuleMethod(beyond, beyond))
    assert main([*rechecked(train, log), "--json"]) == 5
    made = document(capsys)
    assert (made["verdict"], made["flights"][0]["verdict"]) == ("not re-checked", "accepted")


def test_no_flight_is_judged_by_what_is_false_or_was_changed(
    train: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = Flight().write(tmp_path / "flight.mcap")

    def false(*_: object) -> Any:
        raise RejectedError("it is false")

    with monkeypatch.context() as patch:
        patch.setitem(proof_methods.MODULES, "rest", lambda: ModuleMethod(false, false))
        assert main([*rechecked(train, log), "--json"]) == 3
        assert document(capsys)["flights"] == []
    monkeypatch.setattr(Certificate, "seal", property(lambda self: str(id(self))))
    assert main([*rechecked(train, log), "--json"]) == 3
    made = document(capsys)
    assert (made["reason"], made["flights"]) == ("it was changed while it was being read", [])


def test_from_a_run_to_its_confirmation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing stands for anything: the engine decides, and the tube in Arb confirms it."""
    log = tmp_path / "flight.mcap"
    Program(str(FOLLOW)).simulate(until="600ms", log=log)
    assert main([*rechecked(certificate(tmp_path / "cert"), log), "--json"]) == 0
    (flight,) = document(capsys)["flights"]
    assert (flight["verdict"], flight["verdicts"], flight["confirmed"]) == ("accepted", 7, 7)


APART = {
    'type Sight = { gap: float unit "m", way: float unit "m", v: float unit "m/s" };\n': "",
    "topic sight: Sight in { v in [-2.0, 40.0] } max_age 20ms;": "topic gap: float max_age 20ms;\n"
    "topic way: float max_age 20ms;\ntopic speeds: float[1] in [-2.0, 40.0] max_age 20ms;",
    "  subscribes sight;": "  subscribes gap, speeds;",
    "  drives sight = { gap: gap, way: way, v: v };": "  drives gap = gap;\n  drives way = way;\n"
    "  drives speeds = [v];",
    ", sight.v within 0.05": "",
    "sight.gap": "gap",
    "sight.way": "way",
    "sight.v": "speeds[0]",
}
"""A plain number in a topic, and one in an array."""


@pytest.mark.long
def test_estimates_of_several_topics(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = FOLLOW.read_text(encoding="utf-8")
    for old, new in APART.items():
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "follow.soter"
    path.write_text(text, encoding="utf-8")
    log = tmp_path / "flight.mcap"
    Program(str(path)).simulate(until="600ms", log=log)
    assert main([*rechecked(certificate(tmp_path / "cert", text), log), "--json"]) == 0
    (flight,) = document(capsys)["flights"]
    assert (flight["verdict"], flight["verdicts"], flight["confirmed"]) == ("accepted", 7, 7)
