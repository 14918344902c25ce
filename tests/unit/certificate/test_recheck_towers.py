"""The re-checker on towers: what it confirms by itself, and what it rejects."""

from __future__ import annotations

import json
import random
import shutil
from typing import TYPE_CHECKING, Any

import pytest

from soter.api.program import load
from soter.api.rechecking import recheck
from soter.certificate.reading.derived_times import (
    Clock,
    TimingSetting,
    TopicPath,
    TopicReading,
    derive,
    handed_back,
)
from soter.verify.problem.schedule import ActuationPath, Releases, Schedule, SensorPath
from tables import all_rows
from unit.certificate import small_proofs
from unit.verify.towers import GENTLE, GRID, TOWER, WRONG_BELOW, changed

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.certificate.report import Report

pytest.importorskip("flint")

LATE = "a verdict that comes late is not counted"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Certificates of the module below, by program; `late` counts what a late verdict asks."""
    folder = tmp_path_factory.mktemp("towers")
    late = changed(WRONG_BELOW[LATE][0]).replace(" horizon 34ms;", "")
    certificates = {}
    for name, text in (("plain", TOWER), ("late", late)):
        path = folder / f"{name}.soter"
        path.write_text(text)
        load(path).verify(module="Inner", refute=False, cert=folder / name)
        certificates[name] = folder / name
    return certificates


def _edited(
    made: dict[str, Path], tmp_path: Path, name: str, change: Callable[[dict[str, Any]], None]
) -> Report:
    folder = tmp_path / "certificate"
    shutil.copytree(made[name], folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    change(manifest)
    small_proofs.only_claimed(folder, manifest)
    small_proofs.seal(folder, manifest)
    return recheck(folder)


def _of_program(made: dict[str, Path], tmp_path: Path, *changes: tuple[str, str]) -> Report:
    folder = tmp_path / "certificate"
    shutil.copytree(made["plain"], folder)
    small_proofs.edit_program(folder, *changes)
    return recheck(folder)


def test_what_holds_while_the_one_above_is_in_ac_is_confirmed(made: dict[str, Path]) -> None:
    report = recheck(made["plain"])
    assert report.accepted, report.reason
    assert report.safe
    assert not report.returns
    (module,) = report.modules
    assert module.whilst == " while Outer is in AC"
    keys = {a.key for a in module.assumptions}
    assert {"while Outer", "verdict of Outer", "sets while Outer"} <= keys
    assert any(s.key.startswith("module Lane Outer") for s in report.not_covered)


def test_the_one_above_is_confirmed(tmp_path: Path) -> None:
    path = tmp_path / "tower.soter"
    path.write_text(TOWER)
    load(path).verify(module="Outer", refute=False, cert=tmp_path / "certificate")
    report = recheck(tmp_path / "certificate")
    assert report.accepted, report.reason
    assert report.safe
    assert report.returns
    assert report.modules[0].whilst == ""


def test_a_late_verdict_counts_here_too(made: dict[str, Path], tmp_path: Path) -> None:
    report = recheck(made["late"])
    assert report.accepted, report.reason
    own = report.modules[0].times["H_star_ns"]

    def shorter(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["times"] |= {"H_star_ns": 34_000_000, "H_ns": 34_000_000}

    assert own > 34_000_000
    rejected = _edited(made, tmp_path, "late", shorter)
    assert not rejected.accepted
    assert "H_star_ns" in rejected.reason or "H_ns" in rejected.reason


CLAIMED = {
    "P2b": "SC has control only while Outer is in AC",
    "failsafe": "command the same actuators",
}


@pytest.mark.parametrize("claim", CLAIMED)
def test_what_nobody_may_claim_there_is_rejected(
    made: dict[str, Path], tmp_path: Path, claim: str
) -> None:
    def claims(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["claims"][claim] = "proved"

    report = _edited(made, tmp_path, "plain", claims)
    assert not report.accepted
    assert CLAIMED[claim] in report.reason


def test_start_needs_what_shows_r_of_h(made: dict[str, Path], tmp_path: Path) -> None:
    def claims(manifest: dict[str, Any]) -> None:
        manifest["modules"][0]["claims"] = {"P2a": "proved", "start": "proved"}

    report = _edited(made, tmp_path, "plain", claims)
    assert not report.accepted
    assert "R(H)" in report.reason


HIGHEST = WRONG_BELOW["two modules above"][0]
PROGRAMS = {
    "given back outside R(H)": (
        [("safer abs(x) < 1.6", "safer abs(x) < 1.97")],
        "may give control back elsewhere",
    ),
    "given back outside the grid": (
        [("safer abs(x) < 1.6", "safer abs(x) < 1.6 || x > 4.0")],
        "outside the grid",
    ),
    "given back by what no plant shows": (
        [("safer abs(x) < 1.6", "safer mode(Inner) == Mode.AC")],
        "says nothing of the plants",
    ),
    "given back by a mode, or by what plants show": (
        [("safer abs(x) < 1.6", "safer abs(x) < 1.6 || mode(Inner) == Mode.SC")],
        "says nothing of the plants",
    ),
    "a verdict that comes late": (
        [
            ("/ 320;\n    late dm 1ms", "/ 320;\n    late dm 20ms"),
            ("node Back period 10ms", "node Back period 50ms"),
        ],
        "H_star_ns",
    ),
    "a topic without a set": (
        [("topic x: float in [-5.0, 5.0] max_age", "topic x: float max_age")],
        "",
    ),
    "an SC that faults elsewhere": (
        [(GENTLE, "step { assert abs(x) < 2.5; publish u = clamp(-x, -0.5, 0.5); }")],
        "SC may fault",
    ),
    "an SC that leaves its set elsewhere": (
        [(GENTLE, "step { publish u = x > 2.4 ? -0.5 * x : clamp(-x, -0.5, 0.5); }")],
        "SC may fault",
    ),
    "two modules above": (
        [HIGHEST[0], ("module Outer;\n  until", "module Highest;\n  until")],
        "has no module",
    ),
    "one above that never gives back": ([("until 20s;", "force Outer sc; until 20s;")], "forced"),
    "times of the one above that nobody declared": (
        [("/ 320;\n    late dm 1ms, sc 1ms;", "/ 320;\n    late sc 1ms;")],
        "P1c",
    ),
    "another program below": ([(GENTLE, "step { publish u = clamp(x, -0.5, 0.5); }")], ""),
    "a hint that views are entered by": ([(GRID, f"{GRID} enters x < 1.0;")], ""),
}


@all_rows("name", PROGRAMS)
def test_another_program_than_was_proved_is_rejected(
    made: dict[str, Path], tmp_path: Path, name: str
) -> None:
    changes, why = PROGRAMS[name]
    report = _of_program(made, tmp_path, *changes)
    assert not report.accepted
    assert why in report.reason


def test_three_levels_are_refused_for_the_lowest(tmp_path: Path, made: dict[str, Path]) -> None:
    folder = tmp_path / "certificate"
    shutil.copytree(made["plain"], folder)
    changes = PROGRAMS["two modules above"][0]
    manifest = small_proofs.edit_program(folder, *changes)
    manifest["modules"][0]["module"] = "Highest.Outer.Inner"
    small_proofs.seal(folder, manifest)
    assert "below two other modules" in recheck(folder).reason


# ---------------------------------------------------------------- times


def test_both_derivations_of_a_hand_back_agree() -> None:
    """The prover's sum is never shorter than what the re-checker enumerates, and often the same."""
    chance, equal = random.Random(5), 0  # noqa: S311 - no secret
    for _ in range(300):
        ms = 1_000_000
        sensor = chance.choice([5, 10, 20]) * ms
        sc = chance.choice([10, 20, 30]) * ms
        dm = sc * chance.choice([1, 2, 3])
        upper = chance.choice([10, 20, 25, 50, 60]) * ms
        late, response = (chance.randrange(3) * ms for _ in range(2))
        slow = chance.randrange(0, 20) * ms, chance.randrange(0, 4) * ms
        phase = chance.randrange(0, 10) * ms
        acts, age = chance.randrange(3) * ms, sensor + chance.randrange(10) * ms
        read = TopicReading("x", (TopicPath(Clock("s", sensor)),), age)
        setting = TimingSetting(
            Clock("dm", dm, 0, late, response),
            Clock("sc", sc, phase, late, response),
            (read,),
            (read,),
        )
        setting = TimingSetting(
            setting.dm, setting.sc, (read,), (read,), (type(setting.effects[0])(0, acts),)
        )
        if sum(slow) > upper or setting.starts_by(phase) + response > phase + sc:
            continue
        above = Clock("above", upper, chance.randrange(0, 5) * ms, *slow)
        enumerated = handed_back(setting, derive(setting), above, age)
        path = SensorPath(Releases(sensor), (), age)
        schedule = Schedule(
            Releases(dm, 0, late, response),
            Releases(sc, phase, late, response),
            (path,),
            (path,),
            (ActuationPath(0, acts),),
            back=age + sum(slow),
        )
        assert enumerated <= schedule.handed_back
        equal += enumerated == schedule.handed_back
    assert equal > 10
