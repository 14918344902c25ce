"""Several plans of SC in a certificate and in the logs of flights, and what is refused of them."""

from __future__ import annotations

import json
from copy import deepcopy
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import Program
from soter.certificate.extras.flight_check import open_flights
from soter.certificate.rechecker import recheck
from soter.certificate.report import (
    CONTRADICTED,
    UNCONFIRMED,
    NotRecheckedError,
    RejectedError,
)
from soter.certificate.tubes.check_rest import recheck_plans, recheck_rest
from soter.report.mcap_log import DECISIONS_TOPIC, MODES_TOPIC, LogChannel, LogHeader, McapLog
from soter.report.mcap_reading import log_messages, log_metadata
from unit.certificate import small_proofs
from unit.certificate.tubes.rest_entries import entry, flat_of
from unit.verify.tubes.test_plans import NEAR, changed

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.language.model.system import System

UP_ALONE = changed(*NEAR)
"""From its start only Up goes round the wall."""
BOX = {"c.v": (-0.1, 0.1)}
WAYS = {"c.v": (-0.103, 0.103)}
OWN = ("plants", "times", "inputs", "rest")
Entry = dict[str, Any]


def certified(text: str) -> tuple[System, Entry]:
    """A module's entry, by hand: that of each plan, as if it stood alone."""
    flat = flat_of(text)
    plans = [p.name for p in flat.modules[0].symbol.plans]
    said = f"sc {', '.join(plans)};"
    every = {p: entry(flat_of(text.replace(said, f"sc {p};")), BOX, WAYS) for p in plans}
    head = {k: v for k, v in every[plans[0]].items() if k not in OWN}
    head["system"], head["module"] = flat.name, flat.modules[0].name
    return flat, head | {"plans": {p: {k: e[k] for k in OWN} for p, e in every.items()}}


def test_each_plan_is_shown_again() -> None:
    flat, made = certified(UP_ALONE)
    facts, report = recheck_plans(flat, made)
    assert facts.flying.modules[0].plan is None
    assert {"P2a", "start"} <= set(report.confirmed)
    assert report.in_flight
    assert report.plan_times.keys() == {"Up", "Down"}


def test_the_start_is_shown_of_the_first_plan() -> None:
    with pytest.raises(NotRecheckedError, match="start"):
        recheck_plans(*certified(UP_ALONE.replace("sc Up, Down;", "sc Down, Up;")))


def narrow(made: Entry) -> None:
    made["plans"]["Down"]["rest"]["ways"] = {"c.v": [(-0.01).hex(), (0.01).hex()]}


def other_times(made: Entry) -> None:
    made["plans"]["Down"]["rest"]["switches"] += 1


def moves_further(made: Entry) -> None:
    made["plans"]["Down"]["rest"]["moves"]["c.y"][1] = (9.0).hex()


def leave_out(made: Entry) -> None:
    del made["plans"]["Down"]


def rename(made: Entry) -> None:
    made["plans"]["Brake"] = made["plans"].pop("Down")


def one_alone(made: Entry) -> None:
    made |= made.pop("plans")["Up"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (narrow, "P2a"),
        (other_times, "switches"),
        (moves_further, "what `rest` moves is another"),
        (leave_out, "the plans are others"),
        (rename, "the plans are others"),
    ],
)
def test_what_is_false_of_one_plan_is_not_confirmed(
    change: Callable[[Entry], None], why: str
) -> None:
    flat, made = certified(UP_ALONE)
    change(made)
    with pytest.raises((RejectedError, NotRecheckedError), match=why):
        recheck_plans(flat, made)


def test_an_entry_for_one_plan_is_none_for_several() -> None:
    flat, made = certified(UP_ALONE)
    one_alone(made)
    with pytest.raises(NotRecheckedError, match="several plans"):
        recheck_rest(flat, made)


def test_a_second_entry_of_a_module_does_not_vanish_where_it_cannot_be_read(
    tmp_path: Path,
) -> None:
    (tmp_path / "plans.soter").write_text(UP_ALONE, "utf-8")
    folder = tmp_path / "cert"
    Program(str(tmp_path / "plans.soter")).verify(refute=False, cert=folder)
    manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
    second = deepcopy(manifest["modules"][0])
    one_alone(second)
    manifest["modules"].append(second)
    small_proofs.reseal(folder, manifest)
    report = recheck(folder, workers=1)
    assert report.verdict == "rejected"
    assert "twice" in report.reason


def test_an_sc_that_does_not_do_what_its_plans_do_is_not_rechecked() -> None:
    flat, made = certified(UP_ALONE)
    (choice,) = flat.modules[0].symbol.sc.step
    arms = choice.arms  # type: ignore[attr-defined]
    for step in (choice.otherwise, ()):  # type: ignore[attr-defined]
        choice.arms = ((arms[0][0], step),)  # type: ignore[attr-defined]
        with pytest.raises(NotRecheckedError, match="made of its plans"):
            recheck_plans(flat, made)


# ---------------------------------------------------------------- flights


def rewritten(log: Path, other: Path, change: Callable[[list[dict[str, Any]]], None]) -> Path:
    """The log with other decisions."""
    channels: dict[str, list[tuple[int, Any]]] = {}
    for time_ns, channel, m in log_messages(log):
        channels.setdefault(channel, []).append((time_ns, m))
    steps = deepcopy([m for _, m in channels[DECISIONS_TOPIC]])
    change(steps)
    times = [t for t, _ in channels[DECISIONS_TOPIC]]
    channels[DECISIONS_TOPIC] = list(zip(times, steps, strict=True))
    assert MODES_TOPIC in channels
    said = log_metadata(log)
    head = LogHeader(said["program_sha256"], said["system"], int(said["seed"]), "test")
    schema: dict[str, Any] = {"type": "object", "properties": {}}
    file = McapLog(other, [(name, schema) for name in channels], head)
    with file.dropped_on_error():
        file.add([LogChannel(name, schema, ms) for name, ms in channels.items()])
    file.close()
    return other


def kinds(certificate: Path, log: Path) -> set[tuple[int, str]]:
    flights = open_flights(certificate, [str(log)])
    assert flights is not None
    (report,) = flights.judge_logs(workers=1)
    assert report.verdicts > 0
    return {(d.time_ns, d.kind) for d in report.doubts}


def test_a_flight_is_asked_of_the_plan_of_each_verdict(tmp_path: Path) -> None:
    """Up is good at the first looks, and Down is not; then SC flies Up."""
    pytest.importorskip("mcap")
    path, log, other = (tmp_path / n for n in ("plans.soter", "flight.mcap", "other.mcap"))
    path.write_text(UP_ALONE.replace("aside = 0.0; }", "aside = -1.0; }"), "utf-8")
    program = Program(str(path))
    program.verify(refute=False, cert=tmp_path / "cert")
    assert recheck(tmp_path / "cert", workers=1).verdict == "accepted"
    program.simulate(until="500ms", log=log)
    assert kinds(tmp_path / "cert", log) == set()
    told = [m for _, channel, m in log_messages(log) if channel == DECISIONS_TOPIC]
    assert {m["plan"] for m in told} == {"Up"}
    good = next(k for k, m in enumerate(told) if m["mode_after"] == "AC")
    lost = next(k for k, m in enumerate(told) if k > good and m["mode_after"] == "SC")

    def another(steps: list[dict[str, Any]]) -> None:
        for step in steps[good:]:
            step["plan"] = "Down"

    named = kinds(tmp_path / "cert", rewritten(log, other, another))
    assert (good * 100_000_000, UNCONFIRMED) in named
    assert CONTRADICTED in {kind for _, kind in named}, "SC flew Up"

    def without_a_verdict(steps: list[dict[str, Any]]) -> None:
        for step in steps[lost:]:
            step["plan"] = "Down"

    named = kinds(tmp_path / "cert", rewritten(log, other, without_a_verdict))
    assert (lost * 100_000_000, CONTRADICTED) in named

    def no_such(steps: list[dict[str, Any]]) -> None:
        steps[good]["plan"] = ""

    assert (good * 100_000_000, UNCONFIRMED) in kinds(
        tmp_path / "cert", rewritten(log, other, no_such)
    )
