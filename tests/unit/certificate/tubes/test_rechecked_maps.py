"""What the re-checker says of a module whose `safe` reads a map."""

from __future__ import annotations

from functools import cache
from math import inf, nan
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import Program
from soter.certificate.report import NotRecheckedError
from soter.certificate.tubes.check_rest import recheck_rest
from soter.certificate.tubes.rest_problem import read_rest_problem
from soter.certificate.tubes.tube_chains import ModuleTube
from soter.cli.main import main
from unit.certificate.tubes import rest_entries
from unit.verify.tubes.test_world_maps import BEFORE_A_WALL, changed, check_of

if TYPE_CHECKING:
    from pathlib import Path

BOX, WAYS = {"t.v": (-0.35, 0.35)}, {"t.v": (-0.4, 0.4)}


def tube_of(text: str) -> ModuleTube:
    flat = rest_entries.flat_of(text)
    problem = read_rest_problem(flat, "Stop")
    return ModuleTube(problem, {1: WAYS["t.v"]})


@cache
def entry() -> dict[str, Any]:
    return rest_entries.entry(rest_entries.flat_of(BEFORE_A_WALL), BOX, WAYS)


def estimate(p: float, v: float, low: float, high: float) -> dict[str, float]:
    return {"sled.p": p, "sled.v": v, "free.low": low, "free.high": high}


def test_the_contract_is_an_assumption_on_both_sides() -> None:
    _, report = recheck_rest(rest_entries.flat_of(BEFORE_A_WALL), entry())
    assert report.claims["start"] == "proved"
    assert "map free" in {a.key for a in report.assumptions}


def test_a_start_with_nothing_free_is_not_confirmed() -> None:
    nothing = changed(BEFORE_A_WALL, ("high: 5.0 }", "high: -5.0 }"))
    with pytest.raises(NotRecheckedError, match="start"):
        recheck_rest(rest_entries.flat_of(nothing), entry())


def test_a_verdict_is_about_the_map_that_was_read() -> None:
    """One tube, asked with one map after another, and with the first one again."""
    tube = tube_of(BEFORE_A_WALL)
    assert set(tube.estimate_fields) == set(estimate(0.0, 0.0, 0.0, 0.0))
    for high, good in ((9.0, True), (3.2, False), (9.0, True), (6.0, True), (3.0, False)):
        assert (tube.why_not_good(estimate(2.0, 3.0, -5.0, high)) is None) == good, high
        assert not good or check_of(BEFORE_A_WALL).returns_true("good", [2.0, 3.0], [-5.0, high])
    assert tube.why_starts_not_good() is None
    for wrong in (nan, inf, -inf):
        assert tube.why_not_good(estimate(2.0, 3.0, wrong, 9.0)) is not None


REFUSED = {
    "is read by SC": (
        ("node Brake period 50ms {", "node Brake period 50ms { subscribes free;"),
        ("gas: 0.0, brake: 1.0 }; } }", "gas: 0.0 * free.low, brake: 1.0 }; } }"),
    ),
    "is read by `rest`": (("< 0.3 moves", "< 0.3 && free.low < 0.0 moves"),),
    "has no age": (("\n    max_age 250ms", ""),),
    "is not made of floats": (
        ("high: float };", "high: float, n: int in [0, 9] };"),
        ("high: 5.0 }", "high: 5.0, n: 0 }"),
    ),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_is_no_map_is_not_rechecked(why: str) -> None:
    with pytest.raises(NotRecheckedError, match=why):
        read_rest_problem(rest_entries.flat_of(changed(BEFORE_A_WALL, *REFUSED[why])), "Stop")


def test_every_verdict_of_a_flight_is_confirmed_with_its_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at, log = tmp_path / "world.soter", tmp_path / "flight.mcap"
    at.write_text(BEFORE_A_WALL, encoding="utf-8")
    Program(str(at)).simulate(until="1s", seed=1, log=str(log))
    assert main(["verify", str(at), "--cert", str(tmp_path / "cert")]) == 0
    assert main(["recheck", str(tmp_path / "cert"), "--log", str(log)]) == 0
    assert "CONFIRMED" in capsys.readouterr().out
