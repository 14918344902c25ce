"""Where nothing is claimed of a fail-safe law: also where a prover would claim it."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import recheck
from soter.certificate.extras.failsafe_law import make_law_problem
from soter.certificate.reading.module_facts import DiffersError
from soter.language.front_end import check_file, system_of
from soter.verify.problem import extract as extracting
from soter.verify.problem.extract import extract
from soter.verify.scope import problem_key
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.report import Report

MAP = """soter 1;
topic pos: float in [-50.0, 50.0] max_age 5ms;
topic u: float in [-6.0, 6.0] = 0.0;
plant P period 10ms { reads u; drives pos = x; state x: float; next x = 0.5 * x + u; }
node Fast period 10ms { publishes u; step { publish u = 6.0; } }
node Stop period 10ms { publishes u; step { publish u = 0.0; } }
rta Guard {
  ac Fast;
  sc Stop;
  period 10ms;
  safe abs(pos) < 10.0;
  ttf pos > 7.8 || pos < -7.8;
  safer abs(pos) < 7.8;
  failsafe u = 0.0;
  verify { late dm 0ms, sc 0ms; response dm 0ms, sc 0ms; acts within 0ms; GRID }
}
system Track { c: P; module Guard; until 10s; }
""".replace("GRID", "grid pos in [-10.0, 10.0] / 400;")
MOVED = """soter 1;
topic pos: float in [-50.0, 50.0] max_age 20ms;
topic vel: float in [-1.0, 1.0] = 0.0;
topic push: float in [-0.1, 0.1];
topic beside: float in [-9.0, 9.0];
plant Wind period 10ms { reads beside; drives push = 0.01 * y; state y: float; next y = beside; }
plant Cart period 10ms {
  reads vel, push;
  drives pos = x;
  state x: float;
  der x = vel * (1.0 + push);
}
node Blow period 10ms { publishes beside; step { publish beside = 0.0; } }
node Fast period 10ms { publishes vel; step { publish vel = 1.0; } }
node Stop period 10ms { publishes vel; step { publish vel = 0.0; } }
rta Guard {
  ac Fast;
  sc Stop;
  period 50ms;
  safe abs(pos) < 10.0;
  failsafe vel = 0.0;
  verify {
    grid pos in [-10.0, 10.0] / 100;
    late dm 1ms, sc 1ms;
    response dm 1ms, sc 1ms;
    acts within 2ms;
    recover never;
  }
}
system Track { c: Cart; w: Wind; node Blow; module Guard; until 10s; }
"""


def rechecked(folder: Path, text: str) -> tuple[str, Report]:
    """What the prover says of the law, and what the re-checker says of its certificate."""
    path = folder / "stop.soter"
    path.write_text(text)
    report = soter.load(path).verify(cert=folder / "cert", refute=False)
    return report.modules[0].findings["failsafe"].verdict, recheck(folder / "cert")


@pytest.mark.parametrize(
    ("text", "why"),
    [(MAP, "the plants move in steps"), (MOVED, "others move the plants")],
    ids=["map", "moved by others"],
)
def test_a_law_that_only_the_prover_would_claim_is_rejected(
    text: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = tmp_path / "honest"
    honest.mkdir()
    verdict, recheck_report = rechecked(honest, text)
    assert verdict == "undecided"
    assert recheck_report.accepted, recheck_report.reason
    assert "failsafe" not in recheck_report.modules[0].confirmed
    monkeypatch.setattr(extracting, "_why_law_uncovered", lambda _: "")
    dishonest = tmp_path / "dishonest"
    dishonest.mkdir()
    verdict, recheck_report = rechecked(dishonest, text)
    assert verdict == "proved", "the sets are there: only the argument is missing"
    assert not recheck_report.accepted
    assert why in recheck_report.reason


STILL = MOVED.replace("vel * (1.0 + push)", "vel").replace("reads vel, push;", "reads vel;")
OVEN = """topic heat: float in [-9.0, 9.0] max_age 20ms;
plant Oven period 10ms { reads vel; drives heat = h; state h: float; der h = vel; }
node Fast"""
STOPS = "Stop period 10ms { publishes vel; step { publish vel = 0.0"
COOLS = "Stop period 10ms { subscribes heat; publishes vel; step { publish vel = min(heat, 0.0)"
HEATED = (("node Fast", OVEN), ("w: Wind;", "w: Wind; o: Oven;"), (STOPS, COOLS))
MIXER = """topic wheel: float;
node Mixer period 10ms { subscribes vel; publishes wheel; step { publish wheel = vel; } }
node Fast"""
MIXED = (("node Fast", MIXER), ("node Blow; module", "node Blow; node Mixer; module"))


@all_rows(
    ("pairs", "why"),
    [
        ((), ""),
        ((*HEATED, ("/ 100;", "/ 100; grid o.h in [-9.0, 9.0] / 9;")), ""),
        (HEATED, "not about the states of the module"),
        (MIXED, "`Mixer` reads the module's outputs"),
        ((*MIXED, ("subscribes vel;", "subscribes pos;"), ("wheel = vel", "wheel = pos")), ""),
    ],
)
def test_a_law_is_about_the_same_states_and_acts_itself(
    tmp_path: Path, pairs: tuple[tuple[str, str], ...], why: str
) -> None:
    text = STILL
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    (tmp_path / "stop.soter").write_text(text)
    facts = small_proofs.facts_of(tmp_path / "stop.soter", "Track", "Guard")
    with pytest.raises(DiffersError, match=why) if why else nullcontext():
        make_law_problem(facts)


def test_two_problems_with_other_laws_are_not_the_same(tmp_path: Path) -> None:
    path = tmp_path / "stop.soter"
    path.write_text(
        MOVED.replace("vel * (1.0 + push)", "vel").replace("reads vel, push;", "reads vel;")
    )
    flat = system_of(check_file(str(path)), "Track")
    problem = extract(flat, flat.modules[0])
    assert problem.law is not None
    assert problem_key(problem) == problem_key(extract(flat, flat.modules[0]))
    assert problem_key(replace(problem, law=None)) != problem_key(problem)
    creeps = replace(problem.module, law=dict.fromkeys(problem.module.law, 0.25))
    assert problem_key(replace(problem, module=creeps)) != problem_key(problem)


@pytest.mark.long
def test_what_would_help_is_said_of_each_law_that_is_not_shown(tmp_path: Path) -> None:
    hints = {}
    alone = MOVED.replace("vel * (1.0 + push)", "vel").replace("reads vel, push;", "reads vel;")
    for name, text in {
        "moved": MOVED,
        "drifts": alone.replace("failsafe vel = 0.0", "failsafe vel = 0.5"),
    }.items():
        path = tmp_path / f"{name}.soter"
        path.write_text(text)
        (module,) = soter.load(path).verify(refute=False).modules
        finding = module.findings["failsafe"]
        assert finding.verdict == "undecided"
        hints[name] = finding.hint
    assert "nobody else moves them" in hints["moved"]
    assert "comes to rest, exactly" in hints["drifts"]
