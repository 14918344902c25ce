"""Modules whose commands act many periods late: proved and accepted where they are right."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.command import verify
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic

OVEN = """soter 1;
topic temp: float max_age 2s;
topic power: float in [0.0, 1.0] = 0.0;
plant Oven period 500ms {
  reads power;
  drives temp = x;
  state x: float = 100.0;
  disturbance door: float in [-0.05, 0.02];
  der x = (200.0 * power - x) / 120.0 + door;
  measured temp within 0.5;
}
node Policy period 1s { publishes power; step { publish power = 1.0; } }
node Hold period 1s {
  subscribes temp;
  publishes power;
  step { publish power = clamp(0.5 + 0.02 * (100.0 - temp), 0.0, 1.0); }
}
rta Oven1 {
  ac Policy;
  sc Hold;
  period 1s;
  safe temp < 140.0 && temp > 60.0;
  verify { grid temp in [60.0, 140.0] / 320; acts within 8s; }
}
system S default { o: Oven; module Oven1; until 1200s; always o.truth.x < 140.0; }
"""
"""First order and a dead time of up to eight periods."""

WRONG = {
    "a gain that swings": [("0.02 *", "0.5 *"), ("< 140.0", "< 110.0"), ("> 60.0", "> 90.0")],
    "the wrong sign": [("100.0 - temp", "temp - 100.0")],
    "a dead time of minutes": [("within 8s", "within 200s")],
    "a faster oven": [("/ 120.0", "/ 4.0")],
    "a wide error": [("within 0.5;", "within 39.0;")],
    "a strong door": [("[-0.05, 0.02]", "[-0.9, 0.9]")],
}


def written(text: str, changes: list[tuple[str, str]]) -> str:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def test_an_oven_with_a_dead_time_of_eight_periods_is_proved_and_accepted(tmp_path: Path) -> None:
    path = tmp_path / "oven.soter"
    path.write_text(OVEN, encoding="utf-8")
    report = soter.load(path).verify(cert=tmp_path / "cert")
    (module,) = report.modules
    assert not module.problem.times.schedule.are_windows_short
    assert {c: f.verdict for c, f in module.findings.items() if c in ("P2a", "P2b", "P3")} == {
        "P2a": "proved", "P2b": "proved", "P3": "proved"
    }  # fmt: skip
    assert report.verdict == "proved"
    assert soter.recheck(tmp_path / "cert").accepted


def test_where_reads_of_the_past_reach_almost_to_a_limit_of_sc_a_proof_is_accepted(
    tmp_path: Path,
) -> None:
    """From 67 K SC heats with all it has, whatever it read in the last ten seconds: by 0.5 K."""
    slow = [("period 1s;", "period 2s;"), ("acts within", "levels 2; acts within")]
    text = written(OVEN, slow).replace("period 1s {", "period 2s {")
    path = tmp_path / "oven.soter"
    path.write_text(text, encoding="utf-8")
    report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert report.verdict == "proved"
    rechecked = soter.recheck(tmp_path / "cert")
    assert rechecked.accepted, rechecked.reason


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_oven_is_not_proved(name: str) -> None:
    report = verify(check_file("oven.soter", written(OVEN, WRONG[name])), refute=False)
    assert report.verdict != "proved"


@pytest.mark.parametrize(
    "changes",
    [
        [("  verify {", "  failsafe power = 0.5;\n  verify {")],
        [("  verify {", "  shield 8;\n  verify {")],
    ],
)
def test_where_no_proof_is_known_it_is_refused(changes: list[tuple[str, str]]) -> None:
    with pytest.raises(SoterError) as raised:
        verify(check_file("oven.soter", written(OVEN, changes)), refute=False)
    (said,) = raised.value.diagnostics
    assert said.code == "R015"
    assert any("`acts within A to 8s`" in h for h in said.helps)


def test_a_least_time_is_no_lateness() -> None:
    text = written(OVEN, [("within 8s", "within 8s to 8500ms")])
    (module,) = verify(check_file("oven.soter", text), refute=False).modules
    assert module.problem.times.schedule.are_windows_short


def refused(text: str) -> tuple[Diagnostic, ...]:
    """What is said of a program before anything is computed."""
    try:
        flat = system_of(check_file("oven.soter", text), None)
        extract(flat, flat.modules[0])
    except SoterError as error:
        return error.diagnostics
    return ()


@pytest.mark.parametrize("module", ["1s", "3s"])
@pytest.mark.parametrize(
    "times",
    [
        "acts within 8s;",
        "acts within 1100ms; response dm 300ms;",
        "acts within 600ms; late sc 100ms; response dm 900ms;",
        "response dm 600ms, sc 900ms;",
    ],
)
def test_the_period_that_is_advised_is_accepted(times: str, module: str) -> None:
    """By P1a, too, and with the wait for the DM that the new periods make."""
    changes = [
        ("period 1s;", f"period {module};"),
        ("acts within 8s;", times),
        ("  verify {", "  shield 8;\n  verify {"),
    ]
    text = written(OVEN, changes)
    (said,) = refused(text)
    assert said.code == "R015"
    (period,) = re.findall(r" (?:of SC )?of ([0-9. ms]*\d ?m?s)\b", str(said.helps[-1]))
    slower = [("node Hold period 1s", f"node Hold period {period.replace(' ', '')}")]
    if "P1a" in str(said.helps[-1]):
        assert any(d.code == "P1a" for d in refused(written(text, slower)))
        slower += [(f"  period {module};", f"  period {period.replace(' ', '')};")]
    assert not refused(written(text, slower))
