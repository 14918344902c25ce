"""Robots of several modules, tested by parts: every part can fail, and all are needed."""

from __future__ import annotations

import re

import pytest

from generators.whole_robots import (
    DELIVERY,
    ROBOTS,
    SURVEILLANCE,
    Mutant,
    Robots,
    caught,
    explored,
)
from soter.explore.results import EXHAUSTED, VIOLATED, wholes
from soter.language.front_end import check_file


@pytest.mark.long
@pytest.mark.parametrize(
    ("robots", "mutant"),
    [pytest.param(r, m, id=m.what) for r in ROBOTS for m in r.mutants],
)
def test_a_wrong_program_breaks_a_property_or_a_contract(robots: Robots, mutant: Mutant) -> None:
    assert caught(robots, mutant)


@pytest.mark.long
@pytest.mark.parametrize("robots", ROBOTS, ids=lambda r: r.name)
def test_the_right_program_is_clean(robots: Robots) -> None:
    text = robots.file.read_text(encoding="utf-8")
    results = explored(robots.file, text, ())
    assert {r.name: r.verdict for r in results} == {r.name: EXHAUSTED for r in results}
    (whole,) = wholes(results)
    assert not whole.missing


def test_a_wrong_battery_of_the_drone_breaks_its_part_of_the_whole() -> None:
    wrong = next(m for m in SURVEILLANCE.mutants if m.tests == ("BatteryPart",))
    assert caught(SURVEILLANCE, wrong)
    text = SURVEILLANCE.file.read_text(encoding="utf-8")
    (right,) = explored(SURVEILLANCE.file, text, wrong.tests)
    assert right.verdict == EXHAUSTED


def test_what_is_said_of_the_whole_needs_every_part_clean() -> None:
    given = DELIVERY.file.read_text(encoding="utf-8")
    short = re.sub(r"horizon \d+ms", "horizon 30ms", given)
    names = tuple(check_file(str(DELIVERY.file), short).tests)
    results = explored(DELIVERY.file, short, names)
    assert [r.verdict for r in results] == [EXHAUSTED for _ in names]
    (whole,) = wholes(results)
    assert not whole.missing
    assert whole.horizon_ns == 30_000_000
    assert not whole.assumed, "who is replaced by a plant is heard by nobody"
    (some,) = wholes(results[1:3])
    assert any("runs as it is in no test" in why for why in some.missing)
    results[1].verdict = VIOLATED
    (broken,) = wholes(results)
    assert "Fenced0 is not exhausted and clean" in broken.missing
    assert "not shown as a whole" in broken.text
